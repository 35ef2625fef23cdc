// SPDX-License-Identifier: Apache-2.0
// blend() of imprint.hpp in vector code: the same integers as blend_scalar().
//
// Written out for NEON because gcc 12 makes 44 instructions for eight samples of the scalar loop, and 34 of this; it
// takes the factors for 32 bits, and so does not find the products of 16. Elsewhere the scalar code stays.
// Not part of the integer gate: vector registers are its point.
#include "tactile/imprint.hpp"

#if defined(__ARM_NEON)
#include <arm_neon.h>
#endif

namespace holdfast::imprint {

void blend(const Squares& squares, const Spots& spots, Eight<std::int16_t>& out) {
#if defined(__ARM_NEON)
  const uint16x8_t one = vdupq_n_u16(256);
  const auto fraction = [](const std::int32_t* q12) {
    const uint16x8_t low = vuzp1q_u16(vreinterpretq_u16_s32(vld1q_s32(q12)), vreinterpretq_u16_s32(vld1q_s32(q12 + 4)));
    return vandq_u16(vshrq_n_u16(low, 4), vdupq_n_u16(255));
  };
  std::int16_t* to = out.data();
  const Square* square = squares.data();
  for (const Spot& spot : spots) {
    const uint16x8x4_t p = vld4q_u16(square->data());
    const uint16x8_t fx = fraction(spot.x_q12.data()), fy = fraction(spot.y_q12.data());
    const uint16x8_t left = vsubq_u16(one, fx), up = vsubq_u16(one, fy);
    const auto low = [&](uint16x8_t first, uint16x8_t second) {
      return vmlal_u16(vmull_u16(vget_low_u16(first), vget_low_u16(left)), vget_low_u16(second), vget_low_u16(fx));
    };
    const auto high = [&](uint16x8_t first, uint16x8_t second) {
      return vmlal_high_u16(vmull_high_u16(first, left), second, fx);
    };
    const uint32x4_t sum_low = vmlaq_u32(vmulq_u32(low(p.val[0], p.val[1]), vmovl_u16(vget_low_u16(up))),
                                         low(p.val[2], p.val[3]), vmovl_u16(vget_low_u16(fy)));
    const uint32x4_t sum_high = vmlaq_u32(vmulq_u32(high(p.val[0], p.val[1]), vmovl_high_u16(up)),
                                          high(p.val[2], p.val[3]), vmovl_high_u16(fy));
    vst1q_s16(to, vreinterpretq_s16_u16(vrshrn_high_n_u32(vrshrn_n_u32(sum_low, 16), sum_high, 16)));
    square += kLanes;
    to += kLanes;
  }
#else
  blend_scalar(squares, spots, out);
#endif
}

}  // namespace holdfast::imprint
