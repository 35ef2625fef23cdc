// SPDX-License-Identifier: Apache-2.0
#include "slip/model_file.hpp"

#include "base/crc32.hpp"
#include "base/little_endian.hpp"
#include "base/math.hpp"

namespace holdfast::model_file {
namespace {

using Bytes = std::span<const std::uint8_t>;

[[nodiscard]] bool is_zero(Bytes bytes) {
  return std::ranges::all_of(bytes, [](std::uint8_t byte) { return byte == 0; });
}

[[nodiscard]] bool is_named(Bytes bytes, std::size_t at, std::string_view name) {
  const Bytes field = bytes.subspan(at, kNameBytes);
  return std::ranges::equal(field.first(name.size()), name, {}, {},
                            [](char c) { return static_cast<std::uint8_t>(c); }) &&
         is_zero(field.subspan(name.size()));
}

[[nodiscard]] Refusal check_envelope(Bytes bytes) {
  if (bytes.size() < kMagic.size() || !std::ranges::equal(bytes.first(kMagic.size()), kMagic)) return Refusal::kMagic;
  if (bytes.size() < kVersionAt + 2) return Refusal::kSize;
  if (get_le<std::uint16_t>(bytes, kVersionAt) != kVersion) return Refusal::kVersion;
  if (bytes.size() != kBytes) return Refusal::kSize;
  if (get_le<std::uint32_t>(bytes, kCrcAt) != crc32(bytes.first(kCrcAt))) return Refusal::kCrc;
  return is_zero(bytes.subspan(kSignatureAt, kCrcAt - kSignatureAt)) ? Refusal::kNone : Refusal::kSigned;
}

[[nodiscard]] Refusal fill_head(Bytes bytes, model::Tree& tree) {
  if (!is_zero(bytes.subspan(kFeatureCountAt + 1, kTextCrcAt - kFeatureCountAt - 1))) return Refusal::kForm;
  tree.text_crc32 = get_le<std::uint32_t>(bytes, kTextCrcAt);
  const Bytes name = bytes.subspan(kNameAt, kNameBytes);
  std::size_t length = 0;
  for (; length < name.size() && name[length] != 0; ++length) {
    const char c = static_cast<char>(name[length]);
    const bool letter = c >= 'a' && c <= 'z';
    if (!letter && (length == 0 || (c != '_' && (c < '0' || c > '9')))) return Refusal::kForm;
    tree.name[length] = c;
  }
  return length > 0 && is_zero(name.subspan(length)) ? Refusal::kNone : Refusal::kForm;
}

[[nodiscard]] Refusal fill_set(Bytes bytes, model::Tree& tree) {
  const auto* const set =
      std::ranges::find_if(kFeatureSets, [&](const FeatureSet& s) { return is_named(bytes, kSetAt, s.name); });
  if (set == kFeatureSets.end()) return Refusal::kSetUnknown;
  tree.set = &*set;
  if (bytes[kFeatureCountAt] != set->size()) return Refusal::kFeatures;
  for (int i = 0; i < kMaxFeatures; ++i) {
    const bool used = i < set->size();
    const std::size_t name_at = kFeaturesAt + idx(i) * kNameBytes;
    if (!is_named(bytes, name_at, used ? (*set)[i].name : "") || bytes[kQAt + idx(i)] != (used ? (*set)[i].q : 0)) {
      return Refusal::kFeatures;
    }
  }
  return Refusal::kNone;
}

[[nodiscard]] Refusal fill_nodes(Bytes bytes, model::Tree& tree) {
  tree.count = get_le<std::uint16_t>(bytes, kNodeCountAt);
  if (tree.count < 3 || tree.count > model::kMaxNodes) return Refusal::kForm;
  for (int i = 0; i < tree.count; ++i) {
    const Bytes node = bytes.subspan(kNodesAt + idx(i) * kNodeBytes, kNodeBytes);
    tree.nodes[idx(i)] = {get_le<std::int32_t>(node, 0), get_le<std::uint16_t>(node, 4), node[6],
                          static_cast<model::Kind>(node[7])};
  }
  const std::size_t end = kNodesAt + idx(tree.count) * kNodeBytes;
  return is_zero(bytes.subspan(end, kSignatureAt - end)) ? Refusal::kNone : Refusal::kForm;
}

}  // namespace

// Takes the nodes in their order, which is that of the paths, and keeps no more than the path to the present node: the
// range that its predicates leave to each feature, and how to take that back.
Refusal check(const model::Tree& tree) {
  struct Interval {
    std::int32_t min, max;
  };
  struct Split {
    const model::Node* node;
    Interval whole;  // of its feature, as the path before it leaves it
    bool is_false;   // the path goes on from its second child
  };
  std::array<Interval, kFeatureCount> ranges{};
  for (int i = 0; i < tree.set->size(); ++i) ranges[idx(i)] = {(*tree.set)[i].min, (*tree.set)[i].max};
  std::array<Split, model::kMaxDepth> path{};
  int depth = 0;
  bool answers[2] = {false, false};

  for (int at = 0; at < tree.count; ++at) {
    const model::Node& node = tree.nodes[idx(at)];
    if (node.kind == model::Kind::kSplit) {
      if (node.feature >= tree.set->size()) return Refusal::kNode;
      if (node.child_false >= tree.count) return Refusal::kNoChild;
      if (node.child_false <= at) return Refusal::kCircle;
      if (depth == model::kMaxDepth) return Refusal::kTooDeep;
      Interval& range = ranges[node.feature];
      if (node.threshold < range.min || node.threshold >= range.max) return Refusal::kOneWay;
      path[idx(depth++)] = {&node, range, false};
      range.max = node.threshold;
      continue;
    }
    if (node.kind > model::Kind::kSlipNow || node != model::Node{.kind = node.kind}) return Refusal::kNode;
    answers[node.kind == model::Kind::kHold ? 0 : 1] = true;
    // Back to the last split whose second child is still to come: that child is the next node.
    while (depth > 0 && path[idx(depth - 1)].is_false) {
      const Split& done = path[idx(--depth)];
      ranges[done.node->feature] = done.whole;
    }
    if (depth == 0) {
      if (at + 1 != tree.count) return Refusal::kUnreachable;
      return answers[0] && answers[1] ? Refusal::kNone : Refusal::kOneVerdict;
    }
    Split& turn = path[idx(depth - 1)];
    if (turn.node->child_false != at + 1) {
      return turn.node->child_false > at + 1 ? Refusal::kUnreachable : Refusal::kTwoParents;
    }
    turn.is_false = true;
    ranges[turn.node->feature] = {turn.node->threshold + 1, turn.whole.max};
  }
  return Refusal::kNoChild;  // the last node is a split
}

Refusal read(std::span<const std::uint8_t> bytes, model::Tree& tree) {
  tree = {};
  Refusal refusal = check_envelope(bytes);
  for (const auto fill : {fill_head, fill_set, fill_nodes}) {
    if (refusal == Refusal::kNone) refusal = fill(bytes, tree);
  }
  if (refusal == Refusal::kNone) refusal = check(tree);
  if (refusal != Refusal::kNone) tree = {};
  return refusal;
}

}  // namespace holdfast::model_file
