// SPDX-License-Identifier: Apache-2.0
// How much the markers look like slip: a linear score of their features' magnitudes, in octaves. It is trained with a
// model (toolchain/learn/score.hpp), kept in it, and read by its tree as one more feature.
//
//   score = bias + sum of weight_i log2(|x_i| + offset_i)        log2 of the odds of slip; Q8, so +256 doubles the odds
//
// Why beside a tree: on recorded clips a depth-6 tree of the paper's four features finds 4 of 17 onsets at 1.6 false
// alarms a minute, such a score of the same four 11 at 1.2. Slip shows in several magnitudes at once, in each a little;
// a tree cuts one at a time, and few times. The sign of x is left out: it says which way, not whether.
// An offset is about what its feature shows at rest: below it, an octave more of noise is no more of slip. The odds are
// those among the rows that were learned from, as they were weighted; the tree's thresholds take what is off.
//
// Rounding: log2_q8 rounds down by less than one LSB, the sum to nearest once, so a score is off by less than 1/2 plus
// the sum of |weight_i| (as factors, 256 = 1) LSB.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <string_view>

#include "base/math.hpp"
#include "base/units.hpp"
#include "slip/tree_io.hpp"

namespace holdfast::score {

inline constexpr int kMaxTerms = 8;

struct Term {
  std::uint8_t feature = 0;    // of kFeatures
  std::int16_t weight_q8 = 0;  // a factor in 1/256: score per octave of x; +-128
  std::uint16_t offset = 0;    // raw, as x; at least 1
  friend constexpr bool operator==(const Term&, const Term&) = default;
};

struct Score {
  int count = 0;             // terms in use; 0: no score
  std::int32_t bias_q8 = 0;  // log2 of odds
  std::array<Term, kMaxTerms> terms{};
  friend constexpr bool operator==(const Score&, const Score&) = default;
};

// What a term may read: the markers' features. Not the score itself, and not the imprint, which a model reads beside
// it.
[[nodiscard]] constexpr bool may_read(const FeatureInfo& feature) {
  return feature.stage == Stage::kAlways || feature.stage == Stage::kField;
}

// Index into kFeatures; kFeatureCount: no such feature.
[[nodiscard]] constexpr std::uint8_t index_of(std::string_view feature) {
  std::uint8_t i = 0;
  while (i < kFeatureCount && kFeatures[i].name != feature) ++i;
  return i;
}

// Any count of terms, each of a feature of its own, none for nothing; what is not in use is zero.
[[nodiscard]] constexpr bool is_valid(const Score& score) {
  if (score.count < 0 || score.count > kMaxTerms || (score.count == 0 && score.bias_q8 != 0)) return false;
  for (int i = 0; i < kMaxTerms; ++i) {
    const Term& term = score.terms[idx(i)];
    if (i >= score.count) {
      if (term != Term{}) return false;
      continue;
    }
    if (term.feature >= kFeatureCount || !may_read(kFeatures[term.feature])) return false;
    if (term.weight_q8 == 0 || term.offset == 0) return false;
    for (int before = 0; before < i; ++before) {
      if (score.terms[idx(before)].feature == term.feature) return false;
    }
  }
  return true;
}

// A term reads something that this stage makes.
[[nodiscard]] constexpr bool reads(const Score& score, Stage stage) {
  return std::ranges::any_of(std::span(score.terms).first(idx(score.count)),
                             [&](const Term& term) { return kFeatures[term.feature].stage == stage; });
}

// `x`: what the terms read, in their order. Saturates at +-32 octaves of odds, and counts.
// Range: a valid score, any x. |x| + offset < 2^32, so log2 < 2^13 in Q8; times a weight below 2^28, so eight of them
// and the bias (2^39) stay below 2^40.
[[nodiscard]] constexpr Log2Q8 of(const Score& score, std::span<const std::int32_t> x, Saturations& saturations) {
  std::int64_t sum_q16 = std::int64_t{score.bias_q8} * 256;
  for (int i = 0; i < score.count; ++i) {
    const Term& term = score.terms[idx(i)];
    const std::int64_t raw = x[idx(i)];
    sum_q16 += std::int64_t{term.weight_q8} * log2_q8(static_cast<std::uint64_t>((raw < 0 ? -raw : raw) + term.offset));
  }
  return Log2Q8::saturate(div_round(sum_q16, 256), saturations);
}

}  // namespace holdfast::score
