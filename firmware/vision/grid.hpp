// SPDX-License-Identifier: Apache-2.0
// Gives each dot its name: which row and column of the printed lattice it is.
//
// Knows nothing of scale, crop or rotation (below 40 degrees): pitch and axes come from the dots themselves. Walks
// from dot to dot with a basis that follows the deformation, so the lattice may be sheared, twisted and bulged.
// Tolerates missing dots and stray blobs. Keeps the rows and columns that stay inside the picture and says which it
// leaves out. Where rows x cols can be laid over the dots in more than one way, an earlier field decides; without one
// it refuses, because a wrong name is worse than none.
#pragma once

#include <array>
#include <cstdint>

#include "base/status.hpp"
#include "vision/dots.hpp"
#include "vision/markers.hpp"

namespace holdfast::grid {

struct Config {
  GridSize size;           // printed grid
  bool auto_size = false;  // take the lattice found instead of `size`
  // Markers that may be missing, in parts of 16 of the grid. Price of more: a wrong column is taken for a right
  // one when a whole line is hidden.
  std::int32_t missing_sixteenths = 2;
  // The same when an earlier field is known and no other place covers nearly as many dots.
  std::int32_t missing_sixteenths_sure = 5;
  // An outer line is left out when a third of its markers lie nearer to the picture's edge than this, in percent of the
  // pitch: a dot has a radius of 0.17 to 0.26 pitch and must stay inside when the gel moves. Price of more: good
  // markers (on 200 recordings 42 keeps a tenth fewer than 28); of less: lines that are lost whenever the gel is
  // sheared (1 % of the frames have less than 90 % of their markers at 28, 0.1 % at 32, 40 % without this rule).
  std::int32_t edge_pct = 32;
};

// Lines left out at first sight because the picture's edge cuts them, or would cut them under shear.
struct Cut {
  std::uint8_t top = 0, bottom = 0;  // rows
  std::uint8_t left = 0, right = 0;  // columns
  [[nodiscard]] constexpr int lines() const { return top + bottom + left + right; }
  friend constexpr bool operator==(Cut, Cut) = default;
};

struct Lattice {
  MarkerField field;  // valid = dot found and not cut by the picture's edge
  PixelsQ8 pitch;     // mean of row and column spacing, working image
  GridSize found;     // extent of the lattice seen, also when it does not fit `size`
  Cut cut;            // lines of it that `field` leaves out
  int strays = 0;     // dots without a name
};

// Cells are addressed around the seed dot; a printed grid has at most 16 rows or columns.
inline constexpr int kReach = 16;
inline constexpr int kCells = 2 * kReach + 1;

struct State {
  struct Vector {
    std::int32_t x_px_q8 = 0, y_px_q8 = 0;
  };
  struct Node {
    std::int8_t row = 0, col = 0;
    bool named = false;
    Vector along_row, along_col;  // step to the next column, to the next row, near this dot
  };
  std::array<Node, kMaxDots> nodes;
  std::array<std::array<std::int16_t, kCells>, kCells> cells;  // dot index, -1 = empty
  std::array<std::int16_t, kMaxDots> queue;
  std::array<std::int32_t, 4 * kMaxDots> scratch;
};

// `prior`: where the markers were last (nullptr at start). On failure `out.found` tells what was seen.
// kTooFewDots, kNoLattice, kGridMismatch (smaller than configured), kGridAmbiguous (larger than configured).
[[nodiscard]] Status register_dots(State& state, const Config& config, const dots::Dots& dots, const MarkerField* prior,
                                   Lattice& out);

}  // namespace holdfast::grid
