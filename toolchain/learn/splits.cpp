// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/splits.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <random>
#include <utility>

#include "base/math.hpp"

namespace holdfast::learn {
namespace {

// Fisher and Yates, spelled out: the standard leaves std::shuffle's draws open. Remainders favour small numbers by
// less than one in 2^40 for any list that fits in memory.
void shuffle(std::vector<int>& items, std::mt19937_64& random) {
  for (std::size_t left = items.size(); left > 1; --left) std::swap(items[left - 1], items[random() % left]);
}

// Deals the positive and the other items to folds like cards, each kind shuffled; the second kind goes on where the
// first one ended, so folds differ by at most one item. The fold of each item.
template <typename Positive>
std::vector<int> deal(const std::vector<int>& items, int folds, std::uint64_t seed, const Positive& positive) {
  std::array<std::vector<int>, 2> kinds;
  for (int i = 0; i < static_cast<int>(items.size()); ++i) kinds[positive(items[idx(i)]) ? 0 : 1].push_back(i);
  std::mt19937_64 random(seed);
  std::vector<int> fold_of(items.size());
  int next = 0;
  for (std::vector<int>& kind : kinds) {
    shuffle(kind, random);
    for (const int i : kind) {
      fold_of[idx(i)] = next;
      next = (next + 1) % folds;
    }
  }
  return fold_of;
}

}  // namespace

std::vector<Split> by_trial(const Samples& samples, const std::vector<int>& trials, int folds, std::uint64_t seed) {
  const std::vector<int> fold_of = deal(trials, folds, seed, [&](int trial) {
    const std::span<const Row> rows = samples.of(samples.trials[idx(trial)]);
    return std::any_of(rows.begin(), rows.end(),
                       [](const Row& row) { return judged(row) && row.label == Label::kSlip; });
  });
  std::vector<Split> splits(idx(folds));
  for (int fold = 0; fold < folds; ++fold) {
    Split& split = splits[idx(fold)];
    split.name = fmt::format("fold {}", fold + 1);
    for (std::size_t i = 0; i < trials.size(); ++i) {
      (fold_of[i] == fold ? split.test : split.train).push_back(trials[i]);
    }
  }
  return splits;
}

std::vector<Split> by_object(const Samples& samples, const std::vector<int>& trials) {
  std::vector<Split> splits;
  for (const int trial : trials) {
    const std::string& object = samples.trials[idx(trial)].object;
    auto split = std::find_if(splits.begin(), splits.end(), [&](const Split& s) { return s.name == object; });
    if (split == splits.end()) {
      splits.push_back({object, {}, {}});
      split = std::prev(splits.end());
    }
    split->test.push_back(trial);
  }
  for (Split& split : splits) {
    for (const int trial : trials) {
      if (samples.trials[idx(trial)].object != split.name) split.train.push_back(trial);
    }
  }
  return splits;
}

std::vector<RowSplit> by_frame(const Samples& samples, const std::vector<int>& trials, int folds, std::uint64_t seed) {
  std::vector<int> rows;
  for (const int trial : trials) {
    const Trial& t = samples.trials[idx(trial)];
    for (int row = t.first; row < t.first + t.count; ++row) {
      if (judged(samples.rows[idx(row)])) rows.push_back(row);
    }
  }
  const std::vector<int> fold_of =
      deal(rows, folds, seed, [&](int row) { return samples.rows[idx(row)].label == Label::kSlip; });
  std::vector<RowSplit> splits(idx(folds));
  for (int fold = 0; fold < folds; ++fold) {
    for (std::size_t i = 0; i < rows.size(); ++i) {
      (fold_of[i] == fold ? splits[idx(fold)].test : splits[idx(fold)].train).push_back(rows[i]);
    }
  }
  return splits;
}

}  // namespace holdfast::learn
