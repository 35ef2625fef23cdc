// SPDX-License-Identifier: Apache-2.0
// Our own decision tree (CART: Breiman, Friedman, Olshen, Stone 1984), grown for a device that compares integers.
//
// One predicate, x <= t, t an integer: the midpoint of two neighbouring values, rounded down. A split is the one of the
// largest gain of information among those that leave `min_leaf` rows on both sides; of equal gains the first feature
// and the lowest threshold win. Weights are summed per class before the class's own weight is applied, so rows of
// weight 2 and doubled rows give the same bits, and so do any order of rows. Rows of weight 0 are not there at all.
// Pruning: of all subtrees the smallest one of least error + prune * leaves, error as a share of the total weight.
// Even with prune = 0 a split goes that does not lessen the error: no node keeps two leaves of one verdict.
// Range: up to 2^31 rows; weights 0 or more, of which some are positive. A leaf where both classes weigh the same says
// slip: to tighten is the safe side.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "toolchain/learn/learners.hpp"

namespace holdfast::learn {

struct TreeNode {
  bool is_leaf = true;
  bool slip = false;           // verdict of a leaf
  int column = 0;              // of the matrix
  std::int32_t threshold = 0;  // x <= threshold goes to child_true
  int child_true = 0;
  int child_false = 0;
};

struct BinaryTree {
  std::vector<TreeNode> nodes;  // root first, then level by level

  [[nodiscard]] bool slips(std::span<const std::int32_t> x) const;
  [[nodiscard]] int leaves() const;
};

struct CartConfig {
  int max_depth = 8;
  int min_leaf = 40;
  double prune = 0.0;
  double hold_weight = 1.0;  // of a hold row, on top of the row's own
  double slip_weight = 1.0;
};

[[nodiscard]] BinaryTree grow_cart(const Matrix& rows, const CartConfig& config);

// The same verdicts with no node above two leaves of one verdict, level by level.
[[nodiscard]] BinaryTree tidied(const BinaryTree& tree);

// Nothing when the tree is a single leaf: a model must be able to say both.
[[nodiscard]] std::optional<treec::Model> model_of(const BinaryTree& tree, const FeatureSet& set);

}  // namespace holdfast::learn
