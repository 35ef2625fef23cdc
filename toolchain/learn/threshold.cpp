// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/threshold.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>

#include "base/math.hpp"
#include "toolchain/learn/metrics.hpp"
#include "toolchain/learn/splits.hpp"

namespace holdfast::learn {
namespace {

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

// 1 where it says slip.
std::vector<std::uint8_t> verdicts_of(const Samples& samples, std::span<const double> motions, double threshold) {
  static const std::size_t contact = feature_index("contact");
  std::vector<std::uint8_t> verdicts(motions.size());
  for (std::size_t i = 0; i < motions.size(); ++i) {
    verdicts[i] = samples.rows[i].x[contact] != 0 && motions[i] > threshold ? 1 : 0;
  }
  return verdicts;
}

}  // namespace

std::vector<double> imprint_motions(const Samples& samples) {
  const std::size_t motion = feature_index("imprint_log2_um_q8");
  const std::size_t growth = feature_index("imprint_growth_log2_q8");
  std::vector<double> motions;
  motions.reserve(samples.rows.size());
  for (const Row& row : samples.rows) motions.push_back(row.x[growth] <= kMostGrowth ? row.x[motion] : 0);
  return motions;
}

double held_minutes(const Samples& samples, std::span<const int> trials) {
  double s = 0.0;
  for (const int t : trials) {
    const std::span<const Row> rows = samples.of(samples.trials[idx(t)]);
    for (std::size_t i = 1; i < rows.size(); ++i) {
      if (rows[i].label == Label::kHold) s += rows[i].t_s - rows[i - 1].t_s;
    }
  }
  return s / 60.0;
}

double threshold_of(const Samples& samples, std::span<const double> motions, std::span<const int> trials,
                    const Budget& budget, int raise_frames) {
  // From above, over what held rows show: between two of these numbers nothing changes but detection.
  std::vector<double> held;
  for (const int t : trials) {
    const Trial& trial = samples.trials[idx(t)];
    for (int r = trial.first; r < trial.first + trial.count; ++r) {
      if (samples.rows[idx(r)].label == Label::kHold) held.push_back(motions[idx(r)]);
    }
  }
  std::sort(held.begin(), held.end());
  held.erase(std::unique(held.begin(), held.end()), held.end());
  const auto most = std::lround(held_minutes(samples, trials) / budget.minutes_per_alarm);
  const auto allowed = [&](double threshold) {
    return alarms_of(samples, trials, verdicts_of(samples, motions, threshold), raise_frames) <= most;
  };
  // Not every step: a hundredth of them at a time, then one by one.
  std::size_t lowest = held.size();  // index of the lowest threshold that is allowed
  const std::size_t stride = std::max<std::size_t>(1, held.size() / 100);
  while (lowest >= stride && allowed(held[lowest - stride])) lowest -= stride;
  while (lowest > 0 && allowed(held[lowest - 1])) --lowest;
  if (lowest == held.size()) return (held.empty() ? 0.0 : held.back()) + budget.margin;
  return held[lowest] + budget.margin;
}

RecordedScore leave_one_out(const Samples& samples, const Budget& budget, int raise_frames) {
  std::vector<int> trials(samples.trials.size());
  std::iota(trials.begin(), trials.end(), 0);
  const std::vector<double> motions = imprint_motions(samples);
  std::vector<std::uint8_t> verdicts(samples.rows.size());
  for (const Split& split : by_object(samples, trials)) {
    const double threshold = threshold_of(samples, motions, split.train, budget, raise_frames);
    const std::vector<std::uint8_t> said = verdicts_of(samples, motions, threshold);
    for (const int t : split.test) {
      const Trial& trial = samples.trials[idx(t)];
      std::copy_n(said.begin() + trial.first, trial.count, verdicts.begin() + trial.first);
    }
  }
  return score_recordings(samples, verdicts, {.raise_frames = raise_frames});
}

}  // namespace holdfast::learn
