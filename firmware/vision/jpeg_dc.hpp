// SPDX-License-Identifier: Apache-2.0
// JPEG pictures to luma at 1/8: the firmware's own decoder, plain scalar form. The fast form is vision/jpeg_fast.
//
// Why 1/8 is cheap. JPEG cuts a picture into blocks of 8x8 pixels and sends each as 64 frequency coefficients. The
// first, called DC, is 8 times the block's mean, so luma at 1/8 needs one number per block and no inverse transform
// at all. The other 63 (AC) are 95 % of the bytes, but of them we need only to know where they end.
//
// What a block looks like in the bit stream (ITU-T T.81, F.2.2): a prefix code names the size s of the DC difference
// to the block before, then s bits hold it. Then AC symbols: a prefix code for one byte (run r, size s), r zeros are
// skipped, s bits hold the coefficient. (0,0) ends the block, (15,0) is 16 zeros, and the block also ends when the
// 63rd coefficient was sent. Colour pictures interleave: each MCU holds, say for 4:2:2, two luma blocks, one Cb, one
// Cr, and whether we want Cb or not, its bits lie between us and the next luma block.
//
// The method: walk, do not decode. The next kIndexBits bits index a table that says how many bits *all* symbols
// take which are settled by these bits, their values included, and by how many coefficients they advance. The value
// bits of the last symbol may lie beyond the index, because they are skipped unseen. Two to six look-ups walk a
// block of a typical camera picture, where a decoder needs one step per coefficient. One entry is 16 bits:
//
//     bits 0-7   bits to skip, at most kMaxSkip, so that three look-ups fit the 56 bits of a filled window
//     bits 8-13  coefficients to advance
//     bit 14     never set in a good entry; alone, it sends the symbol to the slow path (long or bad code)
//     bit 15     the block ended here
//
// With the upper byte added to the coefficient number k (1..63), bit 6 of the sum tells of a slow entry *and* of an
// advance past 63, bit 7 tells that the block is done: two tests per look-up are all the safety there is to pay for.
// The slow path takes exactly one symbol by the canonical rule and makes every judgement.
//
// What is refused: whatever libjpeg-turbo warns of or fails at, and more, because lost USB payload shows as small
// irregularities: codes that are in no table, an advance past coefficient 63, whole bytes left over before a
// marker, DC outside of what 8-bit samples can give, anything but EOI after the scan. Padding after EOI is ignored.
// What is accepted equals libjpeg-turbo's output (scale 1/8, JCS_GRAYSCALE) in every byte.
//
// Which streams are accepted at all: vision/jpeg_stream.hpp.
//
// Memory: State, fixed. Reads stay inside the span. Time: at most one walk over the bytes, plus making at most
// eight tables when a picture brings others than the one before.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

#include "base/status.hpp"
#include "vision/jpeg_stream.hpp"
#include "vision/luma.hpp"

namespace holdfast::jpeg_dc {

// Index bits of a walk table. Price: 11 halves the tables (they compete for a first-level cache of 32 KB) and costs
// 9 % more look-ups; 13 gains 1 % on x86.
inline constexpr int kIndexBits = 12;
inline constexpr int kMaxSkip = 18;
inline constexpr int kDcIndexBits = 9;  // all codes of the standard DC tables

struct DcTable {
  Code code;
  std::array<std::uint16_t, 1U << kDcIndexBits> first;  // size of the difference << 8 | length of the code; 0: slow
};

struct AcTable {
  Code code;
  std::array<std::uint16_t, 1U << kIndexBits> walk;  // see the head of this file
};

struct State {
  std::array<DcTable, kTableIds> dc;
  std::array<AcTable, kTableIds> ac;
  Error error = Error::kNone;     // of the last picture
  std::uint32_t tables_made = 0;  // since start; grows only when a picture brings other tables than the one before
};

// In pixels of the luma at 1/8. The upper limit is LumaBuffer's memory: kMaxLumaWidth x kMaxLumaHeight.
struct Limits {
  std::int32_t min_width = kMinLumaWidth;
  std::int32_t min_height = kMinLumaHeight;
};

// Result: ceil(width / 8) x ceil(height / 8) pixels. `out` is undefined unless ok();
// state.error says why. The state serves the next picture after any error. kJpegDamaged, kFrameFormat,
// kPictureTooSmall, kPictureTooLarge.
[[nodiscard]] Status decode(State& state, std::span<const std::uint8_t> bytes, LumaBuffer& out, Limits limits = {});

// ---- What jpeg_fast shares with this form ----

// Bits 6 and 7 of a coefficient number after a look-up.
inline constexpr std::uint32_t kSlow = 64;
inline constexpr std::uint32_t kEnded = 128;

// DC of 8-bit samples is within +-1024 even with divisor 1; twice that leaves room for encoders that round badly.
inline constexpr std::int32_t kMaxDc = 2047;

struct Block {
  const DcTable* dc = nullptr;
  const AcTable* ac = nullptr;
  std::size_t component = 0;  // 0: luma
  std::int32_t x = 0;         // place in the MCU, blocks
  std::int32_t y = 0;
};

// The entropy-coded part of a picture whose headers were found good.
struct Scan {
  Cursor data{};                        // its first byte, and the end of the picture's bytes
  std::array<Block, kMaxBlocks> block;  // of an MCU, in the order in which they are sent
  std::size_t blocks = 0;               // in an MCU
  std::int32_t across = 1;              // luma blocks of an MCU
  std::int32_t down = 1;
  std::int32_t mcus_across = 0;
  std::int32_t mcus_down = 0;
  std::int32_t luma_quant = 1;        // divisor of DC, 1..32767
  std::int32_t restart_interval = 0;  // MCUs; 0: none
};

// Reads the headers, sizes `out`, makes the tables that are not those of the picture before.
[[nodiscard]] Error open(State& state, Bytes bytes, const Limits& limits, LumaBuffer& out, Scan& scan);

// The data of `scan` by the plain walk.
[[nodiscard]] Error read_mcus(Scan& scan, LumaBuffer& out);

struct AcStep {
  std::uint32_t bits = 0;  // to skip
  std::uint32_t k = 0;     // the next coefficient, kEnded after the last
  Error error = Error::kNone;
};

// One AC symbol by the canonical rule: the judgement that both walks send their slow entries to.
// Range: k 1..63; window16 holds the next 16 bits.
[[nodiscard]] AcStep ac_step(const Code& code, std::uint32_t window16, std::uint32_t k);

// The symbols settled by the kIndexBits of `index`, in the form at the head of this file. Before them come `used` bits
// of `advance` coefficients.
[[nodiscard]] std::uint16_t walk_entry(const Code& code, std::uint32_t index, std::uint32_t used = 0,
                                       std::uint32_t advance = 0);

// The value whose `size` bits lead the window (T.81, F.2.2.1): a leading 0 is negative.
// Range: size 0..15, result within +-32767; size 0 gives 0.
[[nodiscard]] constexpr std::int32_t difference(std::uint64_t window, std::uint32_t size) {
  const auto bits = static_cast<std::int32_t>(window >> 1 >> (63 - size));
  return bits < (1 << size) >> 1 ? bits - (1 << size) + 1 : bits;
}

// libjpeg's 1x1 inverse transform: the mean to the nearest, halves up, modulo 1024 as its range table has it, then
// the level shift and the limits of a sample.
// Range: dc within kMaxDc, quant 1..32767: the product is below 2^26.
[[nodiscard]] constexpr std::uint8_t pixel(std::int32_t dc, std::int32_t quant) {
  const std::int32_t mean = (((dc * quant + 4) >> 3) + 512) & 1023;  // 512 more than it is
  return static_cast<std::uint8_t>(std::min(std::max(mean - 512 + 128, 0), 255));
}

// The next 8 bytes, first byte on top. Not spelled out in shifts: at -O3 gcc vectorises those instead of making one
// load and one swap of them.
[[nodiscard]] inline std::uint64_t next_eight(const std::uint8_t* at) {
  std::uint64_t eight = 0;
  std::memcpy(&eight, at, sizeof eight);
  return std::endian::native == std::endian::little ? __builtin_bswap64(eight) : eight;
}

// A byte of 0xFF is somewhere among these eight.
[[nodiscard]] constexpr bool any_ff(std::uint64_t bytes) {
  return ((~bytes - 0x0101010101010101U) & bytes & 0x8080808080808080U) != 0;
}

}  // namespace holdfast::jpeg_dc
