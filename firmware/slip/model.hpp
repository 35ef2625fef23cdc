// SPDX-License-Identifier: Apache-2.0
// A slip tree that was loaded instead of compiled in: a table of nodes in fixed memory, of any feature set.
//
// Same predicate as the compiled form: x <= t. The nodes lie in preorder, so that the child of a true predicate is the
// next node, and one pass from the first to the last sees every path (model_file.hpp: check()). Whoever fills a
// table has checked it; evaluate() is bounded all the same.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <string_view>

#include "base/math.hpp"
#include "slip/tree_io.hpp"

namespace holdfast::model {

inline constexpr int kMaxNodes = 511;  // a complete tree of depth 8, the deepest that `holdfast train` grows unasked
inline constexpr int kMaxDepth = 24;   // predicates from the root to a leaf: bounds the work per frame
inline constexpr int kNameBytes = 32;

enum class Kind : std::uint8_t { kHold = 0, kSlip = 1, kSplit = 2, kSlipNow = 3 };

struct Node {
  std::int32_t threshold = 0;     // split: x <= threshold goes to the next node,
  std::uint16_t child_false = 0;  // all else to this one
  std::uint8_t feature = 0;       // split: which of the set's features x is
  Kind kind = Kind::kSlip;
  friend constexpr bool operator==(const Node&, const Node&) = default;
};
static_assert(sizeof(Node) == 8);

// A tree that nobody filled answers slip: the safe side.
struct Tree {
  std::array<char, kNameBytes> name{};            // zero-padded
  std::uint32_t text_crc32 = 0;                   // of the text that it was compiled from
  const FeatureSet* set = &kFeatureSets.front();  // what it reads; never null
  int count = 1;                                  // nodes in use
  std::array<Node, kMaxNodes> nodes{};            // root first
};

[[nodiscard]] constexpr std::string_view name_of(const Tree& tree) {
  const std::string_view padded(tree.name.data(), tree.name.size());
  return padded.substr(0, padded.find('\0'));
}

// Predicates on the longest path. Range: a checked tree (model_file::check()), whose children lie behind their parents.
[[nodiscard]] constexpr int depth_of(const Tree& tree) {
  std::array<std::uint8_t, kMaxNodes> depth{};
  std::uint8_t most = 0;
  for (int i = 0; i < tree.count; ++i) {
    const Node& node = tree.nodes[idx(i)];
    if (node.kind != Kind::kSplit) continue;
    const auto below = static_cast<std::uint8_t>(depth[idx(i)] + 1);
    depth[idx(i) + 1] = below;
    depth[node.child_false] = below;
    most = std::max(most, below);
  }
  return most;
}

// `x`: the features of tree.set, in its order. At most kMaxDepth predicates; a longer path, which no checked tree has,
// answers slip.
[[nodiscard]] constexpr Verdict evaluate(const Tree& tree, std::span<const std::int32_t> x) {
  std::size_t at = 0;
  for (int step = 0; step <= kMaxDepth; ++step) {
    const Node& node = tree.nodes[at];
    if (node.kind == Kind::kHold) return Verdict::kHold;
    if (node.kind == Kind::kSlip) return Verdict::kSlip;
    if (node.kind == Kind::kSlipNow) return Verdict::kSlipNow;
    at = x[node.feature] <= node.threshold ? at + 1 : node.child_false;
  }
  return Verdict::kSlip;
}

}  // namespace holdfast::model
