// SPDX-License-Identifier: Apache-2.0
// A slip tree that was loaded instead of compiled in: a table of nodes in fixed memory.
//
// Same predicate as the compiled form: x <= t, true goes left. Price against it: 2-3 times the instructions, still
// nothing beside one frame. Whoever fills the table has checked it (treec::check); evaluate() is bounded all the same.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "base/math.hpp"
#include "slip/tree_io.hpp"

namespace holdfast::model {

inline constexpr int kMaxNodes = 255;
inline constexpr int kMaxDepth = 16;

struct Node {
  std::int32_t threshold = 0;
  std::uint8_t feature = 0;      // index into the feature set
  std::uint8_t child_true = 0;   // node index
  std::uint8_t child_false = 0;  // node index
  bool is_leaf = true;
  Verdict verdict = Verdict::kSlip;  // of a leaf
};

struct Tree {
  std::array<Node, kMaxNodes> nodes{};  // root first
};

// At most kMaxDepth predicates; a longer path, which no checked tree has, answers kSlip: the safe side.
[[nodiscard]] constexpr Verdict evaluate(const Tree& tree, std::span<const std::int32_t> x) {
  std::int32_t at = 0;
  for (int step = 0; step <= kMaxDepth; ++step) {
    const Node& node = tree.nodes[idx(at)];
    if (node.is_leaf) return node.verdict;
    at = x[node.feature] <= node.threshold ? node.child_true : node.child_false;
  }
  return Verdict::kSlip;
}

}  // namespace holdfast::model
