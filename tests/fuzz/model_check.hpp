// SPDX-License-Identifier: Apache-2.0
// What must hold for any bytes that are given as a compiled model, for libFuzzer (model_fuzz.cpp) and for the tests;
// and the models that both start from. Everything here follows the byte table of slip/model_file.hpp by its numbers,
// and judges a tree path by path, where the firmware takes one pass.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <random>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/crc32.hpp"
#include "slip/model_file.hpp"

namespace holdfast::test {

using ModelBytes = std::vector<std::uint8_t>;
inline constexpr std::size_t kModelBytes = 5296;

inline void put_number(ModelBytes& bytes, std::size_t at, std::int64_t value, int size) {
  for (int i = 0; i < size; ++i) bytes[at++] = static_cast<std::uint8_t>(value >> (8 * i));
}

inline std::int64_t get_number(std::span<const std::uint8_t> bytes, std::size_t at, int size) {
  std::int64_t value = 0;
  for (int i = size - 1; i >= 0; --i) value = value * 256 + bytes[at + static_cast<std::size_t>(i)];
  return value;
}

inline void put_name(ModelBytes& bytes, std::size_t at, std::string_view name) {
  std::copy(name.begin(), name.end(), bytes.begin() + static_cast<std::ptrdiff_t>(at));
}

// With the CRC that belongs to the rest.
inline ModelBytes repaired(ModelBytes bytes) {
  bytes.resize(kModelBytes);
  put_number(bytes, 5292, crc32(std::span(bytes).first(5292)), 4);
  return bytes;
}

inline ModelBytes model_bytes(const FeatureSet& set, std::span<const model::Node> nodes,
                              std::string_view name = "test") {
  ModelBytes bytes(kModelBytes);
  put_name(bytes, 0, std::string_view("\x89HFT\r\n\x1a\n"));
  put_number(bytes, 8, 3, 2);
  put_number(bytes, 10, static_cast<std::int64_t>(nodes.size()), 2);
  put_number(bytes, 12, set.size(), 1);
  put_number(bytes, 16, 0x01020304, 4);
  put_name(bytes, 20, name);
  put_name(bytes, 52, set.name);
  for (int i = 0; i < set.size(); ++i) {
    put_name(bytes, 84 + 32 * static_cast<std::size_t>(i), set[i].name);
    put_number(bytes, 1108 + static_cast<std::size_t>(i), set[i].q, 1);
  }
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    put_number(bytes, 1140 + 8 * i, nodes[i].threshold, 4);
    put_number(bytes, 1144 + 8 * i, nodes[i].child_false, 2);
    put_number(bytes, 1146 + 8 * i, nodes[i].feature, 1);
    put_number(bytes, 1147 + 8 * i, static_cast<int>(nodes[i].kind), 1);
  }
  return repaired(bytes);
}

// A valid tree, grown from its root with random features and thresholds wherever a path leaves room for them.
class RandomNodes {
 public:
  RandomNodes(std::uint32_t seed, const FeatureSet& set, int max_depth, int max_nodes)
      : random_(seed), set_(set), max_depth_(max_depth), max_nodes_(max_nodes) {
    Ranges ranges;
    for (int i = 0; i < set.size(); ++i) ranges.push_back({set[i].min, set[i].max});
    grow(0, 0, ranges);
  }
  [[nodiscard]] const std::vector<model::Node>& nodes() const { return nodes_; }

 private:
  using Ranges = std::vector<std::array<std::int64_t, 2>>;

  // `promised`: nodes that the path above still has to add, one for each second child.
  void grow(int depth, int promised, const Ranges& ranges) {
    const std::size_t at = nodes_.size();
    const auto feature = static_cast<std::size_t>(random_() % static_cast<std::uint32_t>(set_.size()));
    const auto [min, max] = ranges[feature];
    const int most = static_cast<int>(at) + promised + 3;
    if (depth == max_depth_ || most > max_nodes_ || min >= max || (depth > 1 && random_() % 8 == 0)) {
      nodes_.push_back({.kind = slip_ ? model::Kind::kSlip : model::Kind::kHold});
      slip_ = !slip_;
      return;
    }
    const std::int64_t threshold = min + static_cast<std::int64_t>(random_()) % (max - min);
    nodes_.push_back({.threshold = static_cast<std::int32_t>(threshold),
                      .feature = static_cast<std::uint8_t>(feature),
                      .kind = model::Kind::kSplit});
    Ranges rest = ranges;
    rest[feature] = {min, threshold};
    grow(depth + 1, promised + 1, rest);
    nodes_[at].child_false = static_cast<std::uint16_t>(nodes_.size());
    rest[feature] = {threshold + 1, max};
    grow(depth + 1, promised, rest);
  }

  std::mt19937 random_;
  const FeatureSet& set_;
  int max_depth_;
  int max_nodes_;
  bool slip_ = false;
  std::vector<model::Node> nodes_;
};

// The oracle: reads the table by its numbers and follows every path.
class ModelOracle {
 public:
  explicit ModelOracle(std::span<const std::uint8_t> bytes) : bytes_(bytes) { valid_ = judge(); }

  [[nodiscard]] bool valid() const { return valid_; }
  [[nodiscard]] const FeatureSet& set() const { return *set_; }
  [[nodiscard]] std::size_t count() const { return reached_.size(); }
  // Of a valid model.
  [[nodiscard]] Verdict answer(std::span<const std::int32_t> x) const {
    std::size_t at = 0;
    while (kind(at) == 2) at = x[feature(at)] <= threshold(at) ? at + 1 : child_false(at);
    return kind(at) == 1 ? Verdict::kSlip : kind(at) == 3 ? Verdict::kSlipNow : Verdict::kHold;
  }
  [[nodiscard]] std::size_t kind(std::size_t node) const { return bytes_[1147 + 8 * node]; }
  [[nodiscard]] std::size_t feature(std::size_t node) const { return bytes_[1146 + 8 * node]; }
  [[nodiscard]] std::int32_t threshold(std::size_t node) const {
    return static_cast<std::int32_t>(get_number(bytes_, 1140 + 8 * node, 4));
  }

 private:
  using Ranges = std::vector<std::array<std::int64_t, 2>>;

  [[nodiscard]] std::size_t child_false(std::size_t node) const {
    return static_cast<std::size_t>(get_number(bytes_, 1144 + 8 * node, 2));
  }
  // Zero-padded; "?" when something stands behind the padding's start.
  [[nodiscard]] std::string name(std::size_t at) const {
    const std::string field(bytes_.begin() + static_cast<std::ptrdiff_t>(at),
                            bytes_.begin() + static_cast<std::ptrdiff_t>(at + 32));
    const std::string word = field.substr(0, field.find('\0'));
    return field == word + std::string(32 - word.size(), '\0') ? word : "?";
  }
  [[nodiscard]] bool is_zero(std::size_t from, std::size_t to) const {
    return std::ranges::all_of(bytes_.subspan(from, to - from), [](std::uint8_t byte) { return byte == 0; });
  }

  bool judge() {
    if (bytes_.size() != kModelBytes) return false;
    const std::string magic(bytes_.begin(), bytes_.begin() + 8);
    if (magic != "\x89HFT\r\n\x1a\n" || get_number(bytes_, 8, 2) != 3) return false;
    if (get_number(bytes_, 5292, 4) != crc32(bytes_.first(5292)) || !is_zero(5228, 5292) || !is_zero(13, 16)) {
      return false;
    }
    const std::string called = name(20);
    constexpr std::string_view kLetters = "abcdefghijklmnopqrstuvwxyz";
    constexpr std::string_view kMore = "abcdefghijklmnopqrstuvwxyz0123456789_";
    if (called.empty() || kLetters.find(called[0]) == std::string_view::npos) return false;
    if (called.find_first_not_of(kMore) != std::string::npos) return false;
    set_ = find_feature_set(name(52));
    if (set_ == nullptr || bytes_[12] != set_->size()) return false;
    for (int i = 0; i < 32; ++i) {
      const auto at = static_cast<std::size_t>(i);
      const bool used = i < set_->size();
      if (name(84 + 32 * at) != (used ? (*set_)[i].name : "")) return false;
      if (bytes_[1108 + at] != (used ? (*set_)[i].q : 0)) return false;
    }
    const auto count = static_cast<std::size_t>(get_number(bytes_, 10, 2));
    if (count < 3 || count > 511 || !is_zero(1140 + 8 * count, 5228)) return false;
    reached_.assign(count, 0);
    Ranges ranges;
    for (int i = 0; i < set_->size(); ++i) ranges.push_back({(*set_)[i].min, (*set_)[i].max});
    return follow(0, 0, ranges) && std::ranges::all_of(reached_, [](int times) { return times == 1; }) && holds_ &&
           slips_;
  }

  bool follow(std::size_t node, int depth, const Ranges& ranges) {
    if (node >= reached_.size() || ++reached_[node] > 1) return false;
    if (kind(node) < 2 || kind(node) == 3) {
      (kind(node) == 0 ? holds_ : slips_) = true;
      return is_zero(1140 + 8 * node, 1147 + 8 * node);
    }
    if (kind(node) > 3 || depth == 24 || feature(node) >= static_cast<std::size_t>(set_->size())) return false;
    const auto [min, max] = ranges[feature(node)];
    if (threshold(node) < min || threshold(node) >= max) return false;
    Ranges rest = ranges;
    rest[feature(node)] = {min, threshold(node)};
    if (!follow(node + 1, depth + 1, rest)) return false;
    rest[feature(node)] = {std::int64_t{threshold(node)} + 1, max};
    return follow(child_false(node), depth + 1, rest);
  }

  std::span<const std::uint8_t> bytes_;
  const FeatureSet* set_ = nullptr;
  std::vector<int> reached_;
  bool holds_ = false;
  bool slips_ = false;
  bool valid_ = false;
};

// A finding in words; empty: nothing to say.
//   * the firmware takes what the oracle takes, and refuses what it refuses, with words for it
//   * what is refused answers slip
//   * what is taken answers as the oracle does, at every threshold -1, 0, +1 and at the ends of every feature
inline std::string check_model_bytes(std::span<const std::uint8_t> bytes) {
  model::Tree tree;
  const model_file::Refusal refusal = model_file::read(bytes, tree);
  const ModelOracle oracle(bytes);
  const std::string what(info(refusal).what);
  if ((refusal == model_file::Refusal::kNone) != oracle.valid()) return "the oracle does not agree: " + what;
  if (what.empty() || info(refusal).cause.empty() || info(refusal).next.empty()) return "refused without words";
  std::vector<std::int32_t> x(kFeatureCount);
  if (!oracle.valid()) {
    return model::evaluate(tree, x) == Verdict::kSlip && tree.count == 1 ? "" : "refused, and left half a tree";
  }
  std::mt19937 random(1);
  for (std::size_t node = 0; node < oracle.count(); ++node) {
    if (oracle.kind(node) != 2) continue;
    for (int i = 0; i < oracle.set().size(); ++i) {
      const FeatureInfo& f = oracle.set()[i];
      const std::int64_t span = std::int64_t{f.max} - f.min + 1;
      x[static_cast<std::size_t>(i)] = static_cast<std::int32_t>(f.min + static_cast<std::int64_t>(random()) % span);
    }
    std::int32_t& probed = x[oracle.feature(node)];
    const FeatureInfo& f = oracle.set()[static_cast<int>(oracle.feature(node))];
    const std::int32_t t = oracle.threshold(node);
    for (const std::int32_t value : {t - 1, t, t + 1, f.min, f.max, INT32_MIN, INT32_MAX}) {
      probed = value;
      if (model::evaluate(tree, x) != oracle.answer(x)) return "another answer at node " + std::to_string(node);
    }
  }
  return "";
}

// Whole files: one small tree for each set, trees up to the limits, and one for each thing that can be wrong with a
// tree.
inline std::vector<ModelBytes> model_seeds() {
  std::vector<ModelBytes> seeds;
  std::uint32_t seed = 0;
  for (const FeatureSet& set : kFeatureSets) {
    for (const int depth : {1, 4, 24}) {
      seeds.push_back(model_bytes(set, RandomNodes(++seed, set, depth, depth < 24 ? 63 : 511).nodes()));
    }
  }
  const FeatureSet& set = kFeatureSets.front();
  const std::vector<model::Node> good = RandomNodes(1, set, 4, 63).nodes();
  const auto broken = [&](auto change) {
    std::vector<model::Node> nodes = good;
    change(nodes);
    seeds.push_back(model_bytes(set, nodes));
  };
  broken([](auto& nodes) { nodes[0].child_false = 0; });
  broken([](auto& nodes) { nodes[0].child_false = 600; });
  broken([](auto& nodes) { ++nodes[0].child_false; });
  broken([](auto& nodes) { nodes[0].threshold = INT32_MAX; });
  broken([](auto& nodes) { nodes.pop_back(); });
  broken([](auto& nodes) { nodes.push_back({}); });
  return seeds;
}

}  // namespace holdfast::test
