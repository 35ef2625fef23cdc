// SPDX-License-Identifier: Apache-2.0
// What a slip tree reads and what it answers: one table for the firmware, the tree compiler and the trainer.
//
// A model names its feature set; the set fixes which features come in, in which order, unit and Q format.
// A new set is a new row here; sets are never changed once a model was trained on them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <type_traits>

#include "base/math.hpp"
#include "tactile/types.hpp"

namespace holdfast {

enum class Verdict : std::uint8_t { kHold = 0, kSlip = 1 };

struct FeatureInfo {
  std::string_view name;  // as in model texts; ends in its unit and Q format
  std::string_view unit;
  int q;                     // fraction bits: raw = value * 2^q
  std::int32_t min;          // raw range, from base/units.hpp
  std::int32_t max;          //
  bool needs_earlier_frame;  // a rate: unknown on the first frame and after a gap
  std::int32_t (*read)(const Features&);
};

namespace tree_io_detail {

template <auto Member>
constexpr FeatureInfo feature(std::string_view name, std::string_view unit, int q, bool needs_earlier_frame) {
  using Type = std::remove_cvref_t<decltype(Features{}.*Member)>;
  return {name, unit, q, Type::kMin, Type::kMax, needs_earlier_frame, [](const Features& features) {
            return (features.*Member).raw();
          }};
}

}  // namespace tree_io_detail

// Every feature that a model may read, in the order of a dataset's columns.
inline constexpr auto kFeatures = std::to_array<FeatureInfo>({
    // The paper, section III.
    tree_io_detail::feature<&Features::vx>("vx_um_s", "um/s", 0, true),
    tree_io_detail::feature<&Features::vy>("vy_um_s", "um/s", 0, true),
    tree_io_detail::feature<&Features::entropy>("entropy_nat_q16", "nat", 16, false),
    tree_io_detail::feature<&Features::entropy_rate>("entropy_rate_nat_s_q8", "nat/s", 8, true),
});
inline constexpr int kFeatureCount = static_cast<int>(kFeatures.size());

struct FeatureSet {
  std::string_view name;
  std::span<const std::uint8_t>
      members;  // indices into kFeatures, in the order in which a model of this set reads them

  [[nodiscard]] constexpr int size() const { return static_cast<int>(members.size()); }
  [[nodiscard]] constexpr const FeatureInfo& operator[](int i) const { return kFeatures[members[idx(i)]]; }
};

namespace tree_io_detail {

inline constexpr std::array<std::uint8_t, 2> kVelocity{0, 1};
inline constexpr std::array<std::uint8_t, 2> kEntropy{2, 3};
inline constexpr std::array<std::uint8_t, 4> kPaper{0, 1, 2, 3};

}  // namespace tree_io_detail

inline constexpr auto kFeatureSets = std::to_array<FeatureSet>({
    {"velocity", tree_io_detail::kVelocity},  // the paper's three: Vx and Vy; E and dE/dt; all four
    {"entropy", tree_io_detail::kEntropy},
    {"paper", tree_io_detail::kPaper},
});

// nullptr: no such set.
[[nodiscard]] constexpr const FeatureSet* find_feature_set(std::string_view name) {
  for (const FeatureSet& set : kFeatureSets) {
    if (set.name == name) return &set;
  }
  return nullptr;
}

}  // namespace holdfast
