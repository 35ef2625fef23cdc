// SPDX-License-Identifier: Apache-2.0
// subtract() of coarse.hpp in vector code: the same integers as subtract_scalar().
//
// NEON has the upper half of a product of 32 bits, rounded, in one instruction; gcc 12 makes seven for four numbers by
// products of 64 bits. A frame's take 28 000 aarch64 instructions instead of 44 000. SSE2 has no such product; there
// the scalar code stays. Not part of the integer gate: vector registers are its point.
#include <algorithm>

#include "tactile/coarse.hpp"

#if defined(__ARM_NEON)
#include <arm_neon.h>
#endif

namespace holdfast::coarse {

void subtract(Vector& v, const Vector& mode, std::int32_t share, int room, std::size_t n) {
#if defined(__ARM_NEON)
  // (share mode + 2^(room - 1)) >> room is the rounded upper half of (2^e share) (2^up mode), e + up = 31 - room.
  // Beyond a room of 31 it is the upper half cut off, which loses only bits below those that the rest of the shift
  // rounds by.
  constexpr int kMostUp = 11;  // |mode| is 2^20 at most, and -2^31 twice would not fit
  const int up = std::clamp(31 - room, 0, kMostUp - 1), rest = std::max(room - 31, 0);
  const int32x4_t factor = vdupq_n_s32(share * (1 << std::max(31 - room - up, 0)));
  const int32x4_t left = vdupq_n_s32(up), right = vdupq_n_s32(-rest);
#pragma GCC unroll 4
  for (std::size_t i = 0; i < n; i += 4) {
    const int32x4_t one = vshlq_s32(vld1q_s32(&mode[i]), left);
    const int32x4_t part = rest == 0 ? vqrdmulhq_s32(one, factor) : vrshlq_s32(vqdmulhq_s32(one, factor), right);
    vst1q_s32(&v[i], vsubq_s32(vld1q_s32(&v[i]), part));
  }
#else
  subtract_scalar(v, mode, share, room, n);
#endif
}

}  // namespace holdfast::coarse
