// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/recorded.hpp"

#include <algorithm>
#include <array>
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
      if (judged(row)) score_.frames.add(row.label == Label::kSlip, verdicts[static_cast<std::size_t>(i)] != 0);
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
        windows->any += any_in(onset, onset + length) ? 1 : 0;
        windows->fresh += fresh_in(onset - kLabelSlack, onset + length) ? 1 : 0;
      }
    }
    // Sham windows, each as long as its counterpart, at every place where all rows hold.
    for (std::size_t w = 0; w < sham_.size(); ++w) {
      const bool fresh = w % 2 == 1;
      const int length = 5 * (1 + static_cast<int>(w) / 2) + (fresh ? kLabelSlack : 0);
      for (int from = 0; from + length < count; ++from) {
        const auto window = rows.subspan(static_cast<std::size_t>(from), static_cast<std::size_t>(length) + 1);
        const auto all = [&](const auto& is) { return std::all_of(window.begin(), window.end(), is); };
        if (!all([](const Row& row) { return row.label == Label::kHold && row.accepted; })) continue;
        const bool hit = fresh ? fresh_in(from, from + length) : any_in(from, from + length);
        ++sham_[w].held, sham_[w].held_hits += hit ? 1 : 0;
        if (!all([&](const Row& row) { return shaken(trial, row); })) continue;
        ++sham_[w].shaken, sham_[w].shaken_hits += hit ? 1 : 0;
      }
    }
  }

  // After the last add().
  void settle() {
    const auto share = [](long hits, long all) {
      return all > 0 ? static_cast<double>(hits) / static_cast<double>(all) : 0.0;
    };
    for (std::size_t w = 0; w < sham_.size(); ++w) {
      Windows& windows = w < 2 ? score_.within_5 : w < 4 ? score_.within_10 : score_.within_15;
      (w % 2 == 0 ? windows.sham_any : windows.sham_fresh) = share(sham_[w].held_hits, sham_[w].held);
      (w % 2 == 0 ? windows.shaken_any : windows.shaken_fresh) = share(sham_[w].shaken_hits, sham_[w].shaken);
    }
  }

 private:
  struct Sham {
    long held = 0, held_hits = 0, shaken = 0, shaken_hits = 0;
  };
  RecordedScore& score_;
  const decision::Config& config_;
  std::array<Sham, 6> sham_{};  // any and fresh within 5, then within 10, then within 15
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
  score.raise_frames = config.raise_frames;
  RecordedTally tally(score, config);
  for (const int t : trials) {
    const Trial& trial = recorded.trials[static_cast<std::size_t>(t)];
    tally.add(recorded, trial,
              verdicts.subspan(static_cast<std::size_t>(trial.first), static_cast<std::size_t>(trial.count)));
  }
  tally.settle();
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
