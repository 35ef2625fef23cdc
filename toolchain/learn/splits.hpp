// SPDX-License-Identifier: Apache-2.0
// How rows are parted into training and test. by_frame() is there to show what it flatters: frames of one trial on both
// sides.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "toolchain/learn/samples.hpp"

namespace holdfast::learn {

// Trials by index of Samples::trials.
struct Split {
  std::string name;  // "fold 1", or the object left out
  std::vector<int> train;
  std::vector<int> test;
};

// k folds of whole trials, drawn by `seed`; trials of slip and of hold are spread evenly.
[[nodiscard]] std::vector<Split> by_trial(const Samples& samples, const std::vector<int>& trials, int folds,
                                          std::uint64_t seed);
// One split per object, in the order of first appearance.
[[nodiscard]] std::vector<Split> by_object(const Samples& samples, const std::vector<int>& trials);
// k folds of single rows (indices of Samples::rows): the leak, shown on purpose.
struct RowSplit {
  std::vector<int> train;
  std::vector<int> test;
};
[[nodiscard]] std::vector<RowSplit> by_frame(const Samples& samples, const std::vector<int>& trials, int folds,
                                             std::uint64_t seed);

}  // namespace holdfast::learn
