// SPDX-License-Identifier: Apache-2.0
// Generated from toolchain/model/slip_v1.tree; do not edit. treec writes it.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "slip/tree_io.hpp"

namespace holdfast::slip_tree {

inline constexpr std::string_view kName = "slip_v1";
inline constexpr std::string_view kFeatureSet = "paper";
inline constexpr int kDepth = 3;
inline constexpr int kNodes = 7;
inline constexpr std::uint32_t kModelCrc32 = 0x4681102B;  // of the model's text

[[nodiscard]] constexpr Verdict evaluate(const std::array<std::int32_t, 4>& x) {
  const std::int32_t entropy_nat_q16 = x[2];
  const std::int32_t entropy_rate_nat_s_q8 = x[3];
  if (entropy_nat_q16 <= 58982) return Verdict::kHold;
  if (entropy_rate_nat_s_q8 <= 768) {
    if (entropy_nat_q16 <= 124518) return Verdict::kHold;
    return Verdict::kSlip;
  }
  return Verdict::kSlip;
}

}  // namespace holdfast::slip_tree
