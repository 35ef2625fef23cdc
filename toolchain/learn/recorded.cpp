// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/recorded.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <utility>
#include <vector>

#include "slip/decision.hpp"

namespace holdfast::learn {
namespace {

// "Shaken" as the label file's README has it: the arm shakes in these frames of every clip but one object's.
bool shaken(const Trial& trial, const Row& row) {
  return row.label == Label::kHold && row.frame >= 100 && row.frame <= 250 && trial.object != "artificial_strawberry";
}

constexpr int kLabelSlack = 3;  // frames

class RecordedTally {
 public:
  RecordedTally(RecordedScore& score, const decision::Config& config) : score_(score), config_(config) {}

  void add(const Samples& samples, const Trial& trial, std::span<const std::uint8_t> verdicts) {
    const std::span<const Row> rows = samples.of(trial);
    const int count = trial.count;
    const std::vector<std::uint8_t> up = requests_of(samples, trial, verdicts, config_);
    const auto rises = [&](int i) {
      return up[static_cast<std::size_t>(i)] != 0 && (i == 0 || up[static_cast<std::size_t>(i - 1)] == 0);
    };
    for (int i = 0; i < count; ++i) {
      const Row& row = rows[static_cast<std::size_t>(i)];
      const double dt_s = i > 0 ? row.t_s - rows[static_cast<std::size_t>(i - 1)].t_s : 0.0;
      for (Exposure* exposure : {&score_.held, &score_.shaken, &score_.empty}) {
        if (row.label != (exposure == &score_.empty ? Label::kEmpty : Label::kHold)) continue;
        if (exposure == &score_.shaken && !shaken(trial, row)) continue;
        exposure->s += dt_s;
        exposure->alarms += rises(i) ? 1 : 0;
      }
    }
    const auto any_in = [&](int from, int to) {
      for (int i = std::max(0, from); i <= to && i < count; ++i) {
        if (up[static_cast<std::size_t>(i)] != 0) return true;
      }
      return false;
    };
    const auto fresh_in = [&](int from, int to) {
      for (int i = std::max(0, from); i <= to && i < count; ++i) {
        if (rises(i)) return true;
      }
      return false;
    };
    // Recorded onset: the first slip row, unless the clip begins with it.
    int onset = 0;
    while (onset < count && rows[static_cast<std::size_t>(onset)].label != Label::kSlip) ++onset;
    if (onset > 0 && onset < count) {
      ++score_.onsets;
      score_.hits += !any_in(onset - 5, onset - 1) && fresh_in(onset, onset + 10) ? 1 : 0;
      for (auto [windows, length] :
           {std::pair(&score_.within_5, 5), std::pair(&score_.within_10, 10), std::pair(&score_.within_15, 15)}) {
        windows->fresh += fresh_in(onset - kLabelSlack, onset + length) ? 1 : 0;
      }
    }
  }

 private:
  RecordedScore& score_;
  const decision::Config& config_;
};

// Share of at least `hits` of `count` when each has the chance `chance`.
double tail(int hits, int count, double chance) {
  double sum = 0.0;
  for (int k = hits; k <= count; ++k) {
    sum += std::exp(std::lgamma(count + 1.0) - std::lgamma(k + 1.0) - std::lgamma(count - k + 1.0) +
                    k * std::log(chance) + (count - k) * std::log1p(-chance));
  }
  return sum;
}

}  // namespace

RecordedScore score_recordings(const Samples& recorded, std::span<const int> trials,
                               std::span<const std::uint8_t> verdicts, const decision::Config& config) {
  RecordedScore score;
  RecordedTally tally(score, config);
  for (const int t : trials) {
    const Trial& trial = recorded.trials[static_cast<std::size_t>(t)];
    tally.add(recorded, trial,
              verdicts.subspan(static_cast<std::size_t>(trial.first), static_cast<std::size_t>(trial.count)));
  }
  return score;
}

RecordedScore score_recordings(const Samples& recorded, std::span<const std::uint8_t> verdicts,
                               const decision::Config& config) {
  std::vector<int> trials(recorded.trials.size());
  std::iota(trials.begin(), trials.end(), 0);
  return score_recordings(recorded, trials, verdicts, config);
}

ShareInterval share_interval(int hits, int count, double confidence) {
  ShareInterval out;
  const double outside = 0.5 * (1.0 - confidence);
  const auto bisect = [](const auto& below) {
    double low = 0.0, high = 1.0;
    for (int i = 0; i < 60; ++i) {
      const double middle = 0.5 * (low + high);
      (below(middle) ? low : high) = middle;
    }
    return 0.5 * (low + high);
  };
  if (hits > 0) out.low = bisect([&](double chance) { return tail(hits, count, chance) < outside; });
  if (hits < count) out.high = bisect([&](double chance) { return 1.0 - tail(hits + 1, count, chance) > outside; });
  return out;
}

}  // namespace holdfast::learn
