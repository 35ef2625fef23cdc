// SPDX-License-Identifier: Apache-2.0
// Which evidence stands behind a verdict, and how far it is from its threshold: for consoles, reports and logs. Nothing
// decides by it.
//
// Decisive is what the model could not do without: the group of features that turns its verdict into hold when it is
// set to rest. That asks the model itself, so it holds for every tree. The threshold shown is that of the first
// predicate on the group's feature, in preorder; a tree has further ones.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <string_view>

#include "base/math.hpp"
#include "slip/classifier.hpp"
#include "slip/slip_tree.gen.hpp"
#include "slip/tree_io.hpp"
#include "tactile/contact.hpp"

namespace holdfast {

enum class Evidence : std::uint8_t { kNone = 0, kImprint = 1, kCoarse = 2, kMarkers = 3, kContact = 4, kTurnover = 5 };
inline constexpr std::array<std::string_view, 6> kEvidenceNames{"none",    "imprint", "coarse",
                                                                "markers", "contact", "turnover"};

namespace evidence {

// The group at rest.
[[nodiscard]] constexpr Features without(Features features, Evidence group) {
  if (group == Evidence::kImprint) features.imprint.motion = {};
  if (group == Evidence::kCoarse) features.imprint.coarse = {};
  if (group == Evidence::kTurnover) features.imprint.turnover = {};
  if (group == Evidence::kMarkers) {
    features.field = {};
    features.vx = features.vy = {};
    features.entropy = {};
    features.entropy_rate = {};
  }
  return features;
}

// Range: any features. The model is asked at most five times, and of a frame that holds not at all.
[[nodiscard]] constexpr Evidence decisive(const classifier::Config& config, Features features, Verdict verdict) {
  if (verdict == Verdict::kHold) return Evidence::kNone;
  if (!classifier::needs(config, Stage::kImprint)) return Evidence::kMarkers;
  if (classifier::classify(config, features) == Verdict::kHold) {  // it is slip because it lasts
    features = classifier::scaled(features, classifier::kLess_q8);
  }
  for (const Evidence group : {Evidence::kImprint, Evidence::kCoarse, Evidence::kTurnover, Evidence::kMarkers}) {
    if (classifier::classify(config, without(features, group)) == Verdict::kHold) return group;
  }
  return Evidence::kImprint;  // each of several would do
}

inline constexpr std::uint8_t kImprintFeature = feature_index("imprint_log2_um_q8");
inline constexpr std::uint8_t kCoarseFeature = feature_index("imprint_coarse_log2_um_q8");
inline constexpr std::uint8_t kTurnoverFeature = feature_index("imprint_turnover_q10");
inline constexpr std::uint8_t kContactFeature = feature_index("contact");

// Of a feature of kFeatures; kNone: it says when to listen, not that something slips.
[[nodiscard]] constexpr Evidence group_of(std::uint8_t feature) {
  if (kFeatures[feature].stage != Stage::kImprint) {
    return feature == kContactFeature ? Evidence::kNone : Evidence::kMarkers;
  }
  if (feature == kImprintFeature) return Evidence::kImprint;
  if (feature == kCoarseFeature) return Evidence::kCoarse;
  return feature == kTurnoverFeature ? Evidence::kTurnover : Evidence::kNone;
}

// A group's first predicate in the model: index into kFeatures, and threshold. kFeatureCount: it asks nothing of it.
[[nodiscard]] constexpr Predicate first_of(const classifier::Config& config, Evidence group) {
  const auto found = [&](std::uint8_t member, std::int32_t threshold, Predicate& out) {
    if (group_of(member) != group) return false;
    out = {member, threshold};
    return true;
  };
  Predicate out{kFeatureCount, 0};
  if (config.loaded == nullptr) {
    for (const Predicate& predicate : slip_tree::kFirst) {
      if (found(classifier::kMembers[predicate.feature], predicate.threshold, out)) break;
    }
    return out;
  }
  for (int i = 0; i < config.loaded->count; ++i) {
    const model::Node& node = config.loaded->nodes[idx(i)];
    if (node.kind != model::Kind::kSplit) continue;
    if (found(config.loaded->set->members[node.feature], node.threshold, out)) break;
  }
  return out;
}

// What is shown of a frame.
struct Shown {
  Evidence evidence = Evidence::kNone;  // decisive, or the strongest of those that may speak
  std::int64_t value_milli = 0;         // thousandths of `unit`
  std::int64_t threshold_milli = 0;
  std::string_view unit;
};

[[nodiscard]] constexpr std::int64_t milli(const FeatureInfo& feature, std::int32_t raw) {
  if (feature.unit == "log2(um)") return raw <= 0 ? 0 : exp2_milli(raw);
  return div_round(std::int64_t{raw} * 1000, std::int64_t{1} << feature.q);
}

// `decisive`: of this frame; kNone where it holds. `lost`: the state says that the contact was lost.
[[nodiscard]] constexpr Shown show(const classifier::Config& config, const Features& features, Evidence decisive,
                                   bool lost) {
  if (lost) {
    return {Evidence::kContact, std::int64_t{features.imprint.patches.raw()} * 1000,
            std::int64_t{contact::Config{}.end_patches} * 1000, "patches"};
  }
  if (decisive == Evidence::kNone) {
    decisive = Evidence::kMarkers;
    if (classifier::needs(config, Stage::kImprint)) {
      const std::int32_t imprint = features.imprint.motion.raw() - first_of(config, Evidence::kImprint).threshold;
      const std::int32_t coarse = features.imprint.coarse.raw() - first_of(config, Evidence::kCoarse).threshold;
      decisive = coarse > imprint ? Evidence::kCoarse : Evidence::kImprint;
    }
  }
  const Predicate first = first_of(config, decisive);
  if (first.feature == kFeatureCount) return {};
  const FeatureInfo& feature = kFeatures[first.feature];
  if (decisive == Evidence::kTurnover) {
    constexpr std::int64_t kPercent = 100;
    return {decisive, kPercent * milli(feature, classifier::input(feature, features)),
            kPercent * milli(feature, first.threshold), "%"};
  }
  return {decisive, milli(feature, classifier::input(feature, features)), milli(feature, first.threshold),
          feature.unit == "log2(um)" ? "um" : feature.unit};
}

}  // namespace evidence
}  // namespace holdfast
