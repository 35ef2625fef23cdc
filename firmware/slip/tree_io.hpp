// SPDX-License-Identifier: Apache-2.0
// What a slip tree reads and what it answers: one table for the firmware, the tree compiler and the trainer.
//
// A model names its feature set; the set fixes which features come in, in which order, unit and Q format.
// A new set is a new row here; sets are never changed once a model was trained on them.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <type_traits>

#include "base/math.hpp"
#include "tactile/types.hpp"

namespace holdfast {

// kSlip counts towards decision::Config::raise_frames; kSlipNow stands on evidence that needs no second frame.
enum class Verdict : std::uint8_t { kHold = 0, kSlip = 1, kSlipNow = 2 };

// Which stage of pipeline.cpp makes a feature; all but the paper's and the contact are made only for who reads them.
enum class Stage : std::uint8_t { kAlways, kField, kImprint };

// A predicate of a tree: x <= threshold of this feature of its set.
struct Predicate {
  std::uint8_t feature = 0;
  std::int32_t threshold = 0;
};

struct FeatureInfo {
  std::string_view name;  // as in model texts; ends in its unit and Q format
  std::string_view unit;
  int q;                     // fraction bits: raw = value * 2^q
  std::int32_t min;          // raw range, from base/units.hpp
  std::int32_t max;          //
  bool needs_earlier_frame;  // a rate: unknown on the first frame and after a gap
  Stage stage;
  std::int32_t (*read)(const Features&);
};

namespace tree_io_detail {

template <auto Member>
constexpr FeatureInfo feature(std::string_view name, std::string_view unit, int q, bool needs_earlier_frame) {
  using Type = std::remove_cvref_t<decltype(Features{}.*Member)>;
  return {name, unit, q, Type::kMin, Type::kMax, needs_earlier_frame, Stage::kAlways, [](const Features& features) {
            return (features.*Member).raw();
          }};
}

template <auto Member>
constexpr FeatureInfo field_feature(std::string_view name, std::string_view unit, int q, bool needs_earlier_frame) {
  using Type = std::remove_cvref_t<decltype(FieldFeatures{}.*Member)>;
  return {name, unit, q, Type::kMin, Type::kMax, needs_earlier_frame, Stage::kField, [](const Features& features) {
            return (features.field.*Member).raw();
          }};
}

template <auto Member>
constexpr FeatureInfo imprint_feature(std::string_view name, std::string_view unit, int q) {
  using Type = std::remove_cvref_t<decltype(ImprintFeatures{}.*Member)>;
  return {name, unit, q, Type::kMin, Type::kMax, false, Stage::kImprint, [](const Features& features) {
            return (features.imprint.*Member).raw();
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
    // The displacement field's shape and flow.
    tree_io_detail::field_feature<&FieldFeatures::shift>("shift_um", "um", 0, false),
    tree_io_detail::field_feature<&FieldFeatures::reach>("reach_um", "um", 0, false),
    tree_io_detail::field_feature<&FieldFeatures::residual>("residual_um_q4", "um", 4, false),
    tree_io_detail::field_feature<&FieldFeatures::unevenness>("unevenness_log2_q8", "log2", 8, false),
    tree_io_detail::field_feature<&FieldFeatures::evenness>("evenness_q10", "1", 10, false),
    tree_io_detail::field_feature<&FieldFeatures::octave_entropy>("octave_entropy_nat_q16", "nat", 16, false),
    tree_io_detail::field_feature<&FieldFeatures::residual_rate>("residual_rate_um_s", "um/s", 0, true),
    tree_io_detail::field_feature<&FieldFeatures::flow_spread>("flow_spread_um_s", "um/s", 0, true),
    tree_io_detail::field_feature<&FieldFeatures::flow_residual>("flow_residual_um_s", "um/s", 0, true),
    tree_io_detail::field_feature<&FieldFeatures::flow_evenness>("flow_evenness_q10", "1", 10, true),
    tree_io_detail::field_feature<&FieldFeatures::flow_along>("flow_along_q10", "1", 10, true),
    tree_io_detail::field_feature<&FieldFeatures::flow_steady>("flow_steady_q10", "1", 10, true),
    tree_io_detail::field_feature<&FieldFeatures::dilation_rate>("dilation_rate_ppm_s", "1e-6/s", 0, true),
    tree_io_detail::field_feature<&FieldFeatures::easing>("easing_ppm_s", "1e-6/s", 0, true),
    // The picture between the dots.
    tree_io_detail::imprint_feature<&ImprintFeatures::motion>("imprint_log2_um_q8", "log2(um)", 8),
    tree_io_detail::imprint_feature<&ImprintFeatures::growth>("imprint_growth_log2_q8", "log2", 8),
    tree_io_detail::imprint_feature<&ImprintFeatures::coarse>("imprint_coarse_log2_um_q8", "log2(um)", 8),
    tree_io_detail::imprint_feature<&ImprintFeatures::patches>("imprint_patches", "1", 0),
    tree_io_detail::feature<&Features::contact>("contact", "1", 0, false),
    tree_io_detail::imprint_feature<&ImprintFeatures::turnover>("imprint_turnover_q10", "1", 10),
});
inline constexpr int kFeatureCount = static_cast<int>(kFeatures.size());

// Index into kFeatures; kFeatureCount: no such feature.
[[nodiscard]] constexpr std::uint8_t feature_index(std::string_view name) {
  std::uint8_t i = 0;
  while (i < kFeatureCount && kFeatures[i].name != name) ++i;
  return i;
}

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
inline constexpr std::array<std::uint8_t, 13> kField{5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17};
inline constexpr std::array<std::uint8_t, 18> kTouch{5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22};

inline constexpr std::array<std::uint8_t, 19> kGrasp{5,  6,  7,  8,  9,  10, 11, 12, 13, 14,
                                                     15, 16, 17, 18, 19, 20, 21, 22, 23};

}  // namespace tree_io_detail

inline constexpr auto kFeatureSets = std::to_array<FeatureSet>({
    {"velocity", tree_io_detail::kVelocity},  // the paper's three: Vx and Vy; E and dE/dt; all four
    {"entropy", tree_io_detail::kEntropy},
    {"paper", tree_io_detail::kPaper},
    {"field", tree_io_detail::kField},  // shape and flow of the field, without the paper's four
    {"touch", tree_io_detail::kTouch},  // field and imprint, without its turnover
    {"grasp", tree_io_detail::kGrasp},  // with it: what `holdfast fuse` puts together
});

// The set reads something that this stage makes.
[[nodiscard]] constexpr bool reads(const FeatureSet& set, Stage stage) {
  return std::ranges::any_of(set.members, [&](std::uint8_t member) { return kFeatures[member].stage == stage; });
}

// nullptr: no such set.
[[nodiscard]] constexpr const FeatureSet* find_feature_set(std::string_view name) {
  for (const FeatureSet& set : kFeatureSets) {
    if (set.name == name) return &set;
  }
  return nullptr;
}

}  // namespace holdfast
