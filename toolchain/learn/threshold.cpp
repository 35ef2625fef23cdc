// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/detectors.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>

#include "base/math.hpp"
#include "toolchain/learn/learners.hpp"
#include "toolchain/learn/metrics.hpp"
#include "toolchain/learn/splits.hpp"

namespace holdfast::learn {
namespace {

using Error = std::optional<std::string>;
using Values = std::vector<double>;

Error speed(const Samples& samples, std::span<const int> /*trials*/, Values& values) {
  const std::size_t x = feature_index("vx_um_s");
  const std::size_t y = feature_index("vy_um_s");
  for (const Row& row : samples.rows) values.push_back(std::hypot(row.x[x], row.x[y]));
  return std::nullopt;
}

// What moves while the relief grows is a contact that is being made.
Error imprint(const Samples& samples, std::span<const int> /*trials*/, Values& values) {
  const std::size_t motion = feature_index("imprint_log2_um_q8");
  const std::size_t growth = feature_index("imprint_growth_log2_q8");
  for (const Row& row : samples.rows) values.push_back(row.x[growth] <= kMostGrowth ? row.x[motion] : 0);
  return std::nullopt;
}

// Times that the request rises on rows that hold.
int alarms_of(const Samples& samples, std::span<const int> trials, const std::vector<std::uint8_t>& verdicts,
              int raise_frames) {
  decision::Config config;
  config.raise_frames = raise_frames;
  int alarms = 0;
  for (const int t : trials) {
    const Trial& trial = samples.trials[idx(t)];
    const std::span<const Row> rows = samples.of(trial);
    const std::vector<std::uint8_t> up =
        requests_of(samples, trial, std::span(verdicts).subspan(idx(trial.first), idx(trial.count)), config);
    for (std::size_t i = 0; i < rows.size(); ++i) {
      alarms += rows[i].label == Label::kHold && up[i] != 0 && (i == 0 || up[i - 1] == 0) ? 1 : 0;
    }
  }
  return alarms;
}

}  // namespace

const std::array<Detector, 2> kDetectors{{
    {"|V| alone", false, speed},
    {"imprint alone", true, imprint},
}};

const Detector& imprint_detector() {
  return kDetectors[1];
}

std::vector<std::uint8_t> verdicts_of(const Samples& samples, const Detector& detector, std::span<const double> values,
                                      double threshold) {
  static const std::size_t contact = feature_index("contact");
  std::vector<std::uint8_t> verdicts(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    const bool told = !detector.in_contact || samples.rows[i].x[contact] != 0;
    verdicts[i] = told && values[i] > threshold ? 1 : 0;
  }
  return verdicts;
}

double threshold_of(const Samples& samples, const Detector& detector, std::span<const int> trials,
                    std::span<const double> values, const Budget& budget, int raise_frames) {
  // From above, over what held rows show: between two of these numbers nothing changes but detection.
  Values held;
  for (const int t : trials) {
    const Trial& trial = samples.trials[idx(t)];
    for (int r = trial.first; r < trial.first + trial.count; ++r) {
      if (samples.rows[idx(r)].label == Label::kHold) held.push_back(values[idx(r)]);
    }
  }
  std::sort(held.begin(), held.end());
  held.erase(std::unique(held.begin(), held.end()), held.end());
  const auto allowed = [&](double threshold) {
    return alarms_of(samples, trials, verdicts_of(samples, detector, values, threshold), raise_frames) <= budget.alarms;
  };
  // Not every step: a hundredth of them at a time, then one by one.
  std::size_t lowest = held.size();  // index of the lowest threshold that is allowed
  const std::size_t stride = std::max<std::size_t>(1, held.size() / 100);
  while (lowest >= stride && allowed(held[lowest - stride])) lowest -= stride;
  while (lowest > 0 && allowed(held[lowest - 1])) --lowest;
  if (lowest == held.size()) return (held.empty() ? 0.0 : held.back()) + budget.margin;
  return held[lowest] + budget.margin;
}

std::optional<std::string> leave_one_out(const Samples& samples, const Detector& detector, const Budget& budget,
                                         int raise_frames, RecordedScore& score) {
  std::vector<int> trials(samples.trials.size());
  std::iota(trials.begin(), trials.end(), 0);
  std::vector<std::uint8_t> verdicts(samples.rows.size());
  for (const Split& split : by_object(samples, trials)) {
    Values values;
    values.reserve(samples.rows.size());
    if (auto error = detector.values(samples, split.train, values)) return split.name + " left out: " + *error;
    const double threshold = threshold_of(samples, detector, split.train, values, budget, raise_frames);
    const std::vector<std::uint8_t> said = verdicts_of(samples, detector, values, threshold);
    for (const int t : split.test) {
      const Trial& trial = samples.trials[idx(t)];
      std::copy_n(said.begin() + trial.first, trial.count, verdicts.begin() + trial.first);
    }
  }
  score = score_recordings(samples, verdicts, {.raise_frames = raise_frames});
  return std::nullopt;
}

}  // namespace holdfast::learn
