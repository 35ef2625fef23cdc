// SPDX-License-Identifier: Apache-2.0
// Finds pictures that the JPEG decoder had to accept although bits of them were changed on the way.
//
// After a changed bit the decoder misreads codes until it falls into step again, and brightness is a running sum along
// the blocks: what goes wrong with it stays wrong. To the right of the fault and in all rows of blocks below, the
// picture is brighter or darker by a constant. Of 259 accepted pictures of 3280x2464 (4:2:2 and 4:2:0) that moved a
// marker by over 0.5 px, all had such a step, of 28 to 140 grey levels; the misread blocks alone moved none that far.
// On them this check was made; the campaign (tests/bench/jpeg_corruption) then tried it on others:
//   harmful frames after                  1 bit flipped        1 byte changed
//   3280x2464 at 1/8, 4:2:2               390 -> 0 of 30 000   559 -> 0 of 30 000
//   3280x2464 at 1/8, 4:2:0               178 -> 0 of 10 000   262 -> 0 of 10 000
//   the same, restart after 4 MCUs          9 -> 9 of 10 000     5 -> 5 of 10 000  (4:2:2: none before or after)
//   640x480 at 1/2, 4:2:2                 839 -> 16 of 20 000  1165 -> 16 of 20 000
//   the same, restart after 4 MCUs        422 -> 53 of 20 000   634 -> 84 of 20 000 (before cells were: none found)
// No whole picture was refused. Restart markers end a step after some blocks.
//
// So where a block is as high as four rows or more, each cell of a block's height, or of two, and two blocks' width is
// looked at, too: a cell between a step at its upper rim and the opposite one at its lower rim, of which the smaller
// one counts. Of width * cap, the largest of a picture exceeds that of the frame before by at most 21 % on the clips;
// a picture is refused from Config::limit_pct on.
//
// A step lies between two rows, and neither of the next pairs of rows shares it; rims of dots, imprints and shading
// rise over several rows. So per pixel, with d the difference to the row above,
//   step = sign(d) * clamp(|d| - max(|d of the row above|, |d of the row below|), 0, cap)
// is summed along the row, and over three rows a block apart (at 1/8 a block is a pixel high, at 1/2 four), because the
// fault begins in the middle of a row of blocks: to the right of it the step is above that row, to the left one row of
// blocks lower (4:2:2) or two (4:2:0). Of width * cap, natural pictures reach at
// most 26 % (all 12 150 frames of the real clips, 320x240) and 22 % (all 249 of the simulated grasps, 3280x2464), and
// exceed the frame before by at most 11 %; those 259 reach 59 % and more.
//
// Edges that belong to the scene, such as the housing's or a long hair, are in the frame before as well: what
// counts is by how much a sum exceeds it, in the same or the next row. A scene that has really changed is believed
// after some frames in a row. The first picture has nothing to be compared with and passes.
//
// Does not see: steps of less than about 0.4 * cap levels, or in the picture's first row; misread blocks without a
// step, which count where a block is as large as a dot and a restart marker soon ends the step (640x480 at 1/2, every
// 4 MCUs: 0.3 % of flipped bits, 0.4 % of changed bytes); a fault whose levels came out right in the end. Dots of fewer
// than about eight pixels have rims as sharp as a step; in pictures at least luma_input::kLeastWorkingWidth wide a dot
// has about that and more.
#pragma once

#include <array>
#include <cstdint>

#include "base/status.hpp"
#include "vision/luma.hpp"

namespace holdfast::picture_check {

inline constexpr std::int32_t kMostCap = 16;
inline constexpr std::int32_t kLeastCellBlock = 4;
inline constexpr std::int32_t kGroup = 16;  // columns are looked at so many at a time; a rest is left out

struct Config {
  // Grey levels, 1..kMostCap. Lower: sees smaller steps, and takes more of the dots' rims for steps.
  std::int32_t cap = kMostCap;
  // Of width * cap, 30..100. Lower: sees steps along a part of the row, and refuses straight edges that appear at once.
  std::int32_t limit_pct = 40;
  // Refused pictures in a row before the scene is believed to have changed. Higher: longer blind when it has.
  std::int32_t patience = 3;
};

// Shape: sum of the steps between rows y - 1 and y; index y.
using RowSteps = std::array<std::int32_t, kMaxLumaHeight>;

struct State {
  RowSteps believed{};  // of the last accepted picture
  RowSteps seen{};
  std::int32_t width = 0;  // of the last accepted picture; 0: none yet
  std::int32_t height = 0;
  std::int32_t believed_cell = 0;  // percent
  std::int32_t refused_in_a_row = 0;
};

// kJpegDamaged when the picture has a step that the one before had not. A picture of another size is a first one.
// `block`: rows of the picture that a block of the JPEG stands for: 1, 2, 4 or 8.
// Range: kMinLumaWidth..kMaxLumaWidth columns, of which whole groups count; kMinLumaHeight..kMaxLumaHeight rows.
// A row's sum is at most 1640 * 16 in size; the difference of two sums of three rows, times 100, stays below 2^24.
// Price: 193 000 aarch64 or 277 000 x86 instructions for 410x308, about 1 % of decoding it; 10 KB.
[[nodiscard]] Status update(State& state, const Config& config, const LumaView& luma, std::int32_t block);

// A row of the picture and its neighbours, each of `columns` pixels.
struct Rows {
  const std::uint8_t* two_above = nullptr;
  const std::uint8_t* above = nullptr;
  const std::uint8_t* row = nullptr;
  const std::uint8_t* below = nullptr;
};

// The sum of steps between `above` and `row`. Range: columns a multiple of kGroup, at most kMaxLumaWidth.
// The plain form says what is meant; the vector form (picture_check_simd.cpp) gives the same integers and is used.
[[nodiscard]] std::int32_t row_steps_scalar(const Rows& rows, std::int32_t columns, std::int32_t cap);
[[nodiscard]] std::int32_t row_steps(const Rows& rows, std::int32_t columns, std::int32_t cap);

// The largest cell, percent. Range: block 4 or 8. Looks at one row in `block`.
[[nodiscard]] std::int32_t worst_cell(const LumaView& luma, std::int32_t cap, std::int32_t block);

}  // namespace holdfast::picture_check
