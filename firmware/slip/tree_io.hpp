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

struct FeatureSet {
  std::string_view name;
  std::span<const FeatureInfo> features;
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

// The paper, section III.
inline constexpr std::array<FeatureInfo, 4> kPaperFeatures{
    tree_io_detail::feature<&Features::vx>("vx_um_s", "um/s", 0, true),
    tree_io_detail::feature<&Features::vy>("vy_um_s", "um/s", 0, true),
    tree_io_detail::feature<&Features::entropy>("entropy_nat_q16", "nat", 16, false),
    tree_io_detail::feature<&Features::entropy_rate>("entropy_rate_nat_s_q8", "nat/s", 8, true),
};

inline constexpr std::array<FeatureSet, 1> kFeatureSets{{{"paper", kPaperFeatures}}};

}  // namespace holdfast
