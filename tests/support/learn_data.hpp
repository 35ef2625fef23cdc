// SPDX-License-Identifier: Apache-2.0
// Made-up samples and matrices for the tests of learning: any number of features, all inside their ranges.
#pragma once

#include <algorithm>
#include <cstdint>
#include <initializer_list>
#include <numeric>
#include <random>
#include <string>
#include <vector>

#include "toolchain/learn/learners.hpp"
#include "toolchain/learn/samples.hpp"

namespace holdfast::test {

// Around the middle of the feature's range, in thousandths of it; never outside.
inline std::int32_t feature_at(std::size_t i, double thousandths) {
  const FeatureInfo& info = kFeatures[i];
  const double span = static_cast<double>(info.max) - info.min;
  const double x = info.min + span * (0.5 + thousandths / 1000.0);
  return static_cast<std::int32_t>(std::clamp(x, static_cast<double>(info.min), static_cast<double>(info.max)));
}

// Trials at 25 frames a second: 3 rows open (the first not accepted), 20 hold, then 12 slip in every second trial, and
// 2 open. A slip shows as `apart` standard deviations in every feature.
inline learn::Samples grasps(int trials, std::uint64_t seed, double apart = 2.0) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> noise;
  constexpr const char* kObjects[] = {"ball", "box", "sponge"};
  learn::Samples samples;
  for (int t = 0; t < trials; ++t) {
    const bool slips = t % 2 == 1;
    learn::Trial trial;
    trial.object = kObjects[t % 3];
    trial.primitive = "translate_x";
    trial.kind = slips ? "slip" : "static";
    trial.seed = seed + static_cast<std::uint64_t>(t);
    trial.first = static_cast<int>(samples.rows.size());
    trial.count = slips ? 37 : 25;
    for (int k = 0; k < trial.count; ++k) {
      learn::Row row;
      row.trial = t;
      row.frame = k;
      row.t_s = 0.04 * k;
      const bool open = k < 3 || k >= trial.count - 2;
      row.label = open ? learn::Label::kOpen : k < 23 ? learn::Label::kHold : learn::Label::kSlip;
      row.slip_fraction = row.label == learn::Label::kSlip ? 0.75 : 0.0;
      row.slide_mm_s = row.label == learn::Label::kSlip ? 3.5 : 0.0;
      row.accepted = k > 0;
      for (std::size_t i = 0; row.accepted && i < row.x.size(); ++i) {
        row.x[i] = feature_at(i, noise(random) + (row.label == learn::Label::kSlip ? apart : 0.0));
      }
      samples.rows.push_back(row);
    }
    samples.trials.push_back(trial);
  }
  return samples;
}

inline std::vector<int> all_trials(const learn::Samples& samples) {
  std::vector<int> trials(samples.trials.size());
  std::iota(trials.begin(), trials.end(), 0);
  return trials;
}

// A set whose columns are the first feature, over and over: matrices for trees need no more than a width.
class WideSet {
 public:
  explicit WideSet(int width) : members_(static_cast<std::size_t>(width), 0), set_{"wide", members_} {}
  ~WideSet() = default;
  WideSet(const WideSet&) = delete;
  WideSet& operator=(const WideSet&) = delete;

  const FeatureSet& set() const { return set_; }

 private:
  std::vector<std::uint8_t> members_;
  FeatureSet set_;
};

inline void add_row(learn::Matrix& matrix, std::initializer_list<std::int32_t> x, int slip, int times = 1) {
  for (int i = 0; i < times; ++i) {
    matrix.x.insert(matrix.x.end(), x);
    matrix.slip.push_back(static_cast<std::uint8_t>(slip));
    matrix.row.push_back(matrix.height() - 1);
  }
}

}  // namespace holdfast::test
