// SPDX-License-Identifier: Apache-2.0
// Generated from toolchain/model/slip_v1.tree; do not edit. holdfast compile writes it.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "slip/tree_io.hpp"

namespace holdfast::slip_tree {

inline constexpr std::string_view kName = "slip_v1";
inline constexpr std::string_view kFeatureSet = "paper";
inline constexpr int kDepth = 4;
inline constexpr int kNodes = 13;
inline constexpr std::uint32_t kModelCrc32 = 0xCA51BB89;  // of the model's text

[[nodiscard]] constexpr Verdict evaluate(const std::array<std::int32_t, 4>& x) {
  const std::int32_t entropy_nat_q16 = x[2];
  const std::int32_t entropy_rate_nat_s_q8 = x[3];
  if (entropy_nat_q16 <= 92162) {
    if (entropy_rate_nat_s_q8 <= 60) return Verdict::kHold;
    if (entropy_nat_q16 <= 23651) {
      if (entropy_rate_nat_s_q8 <= 1362) return Verdict::kSlip;
      return Verdict::kHold;
    }
    return Verdict::kHold;
  }
  if (entropy_nat_q16 <= 116740) {
    if (entropy_rate_nat_s_q8 <= -351) return Verdict::kHold;
    return Verdict::kSlip;
  }
  return Verdict::kSlip;
}

}  // namespace holdfast::slip_tree
