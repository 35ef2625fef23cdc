// SPDX-License-Identifier: Apache-2.0
#include "tactile/imprint.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <span>

#include "base/math.hpp"
#include "tactile/coarse.hpp"

#if defined(__ARM_NEON)
#include <arm_neon.h>
#endif

namespace holdfast::imprint {
namespace {

// --- Which samples ---

struct Place {
  std::int8_t a = 0, b = 0;
};

constexpr auto kFirstFree = [] {  // of each row
  std::array<std::int32_t, kSide> first{};
  for (int b = 0; b < kSide; ++b) {
    while (!is_free(first[idx(b)], b)) ++first[idx(b)];
  }
  return first;
}();

constexpr auto kPlaces = [] {
  std::array<Place, kFree> places{};
  std::size_t n = 0;
  for (std::int8_t b = 0; b < kSide; ++b) {
    for (std::int8_t a = 0; a < kSide; ++a) {
      if (is_free(a, b)) places[n++] = {a, b};
    }
  }
  return places;
}();

// Neighbours along a, then along b, as indices of samples.
struct Pair {
  std::uint8_t first = 0, second = 0;
};

constexpr auto kNeighbours = [] {
  std::array<Pair, 2 * kPairs> pairs{};
  std::size_t n = 0;
  for (const bool along_a : {true, false}) {
    for (std::uint8_t i = 0; i < kFree; ++i) {
      for (std::uint8_t k = 0; k < kFree; ++k) {
        const int da = kPlaces[k].a - kPlaces[i].a, db = kPlaces[k].b - kPlaces[i].b;
        if (along_a ? da == 1 && db == 0 : da == 0 && db == 1) pairs[n++] = {i, k};
      }
    }
  }
  return pairs;
}();

// Twice the mean slope along a and along b, kFree times, is a sum of samples with these weights: central differences,
// and one-sided ones at the rim.
struct SlopeWeights {
  std::array<std::int8_t, kFree> a{}, b{};
};

constexpr SlopeWeights kSlope = [] {
  SlopeWeights weights;
  const auto at = [](int a, int b) {
    if (a < 0 || b < 0 || !is_free(a, b)) return -1;
    int i = 0;
    while (kPlaces[idx(i)].a != a || kPlaces[idx(i)].b != b) ++i;
    return i;
  };
  const auto add = [](std::array<std::int8_t, kFree>& to, int i, int before, int after) {
    if (before < 0 && after < 0) return;
    const int times = before < 0 || after < 0 ? 2 : 1;
    const std::size_t last = idx(after < 0 ? i : after), first = idx(before < 0 ? i : before);
    to[last] = static_cast<std::int8_t>(to[last] + times);
    to[first] = static_cast<std::int8_t>(to[first] - times);
  };
  for (int i = 0; i < kFree; ++i) {
    const Place p = kPlaces[idx(i)];
    add(weights.a, i, at(p.a - 1, p.b), at(p.a + 1, p.b));
    add(weights.b, i, at(p.a, p.b - 1), at(p.a, p.b + 1));
  }
  return weights;
}();
// The patch is its own mirror image about its diagonal, and so are the two slopes.
static_assert([] {
  for (std::size_t i = 0; i < kFree; ++i) {
    for (std::size_t k = 0; k < kFree; ++k) {
      if (kPlaces[i].a == kPlaces[k].b && kPlaces[i].b == kPlaces[k].a && kSlope.a[i] != kSlope.b[k]) return false;
    }
  }
  return true;
}());

// --- The reduced picture ---

// So many reduced pixels a pitch at least; at most twice as many.
constexpr std::int32_t kLeastPitch_q8 = 2896;  // 16 / sqrt 2

struct Box {
  std::int32_t left, top, right, bottom;  // inclusive, working pixels
};

// What the lattice and two pitches around it cover: a dot that goes further is lost.
Box reach_of(const MarkerField& rest, PixelsQ8 pitch, const LumaView& picture) {
  Box box{picture.width, picture.height, -1, -1};
  const std::int32_t margin = 2 * pitch.raw();
  for (std::int32_t i = 0; i < rest.grid.count(); ++i) {
    const Marker& dot = rest.markers[idx(i)];
    if (!dot.valid) continue;
    box.left = std::min(box.left, (dot.x.raw() - margin) >> 8);
    box.top = std::min(box.top, (dot.y.raw() - margin) >> 8);
    box.right = std::max(box.right, (dot.x.raw() + margin) >> 8);
    box.bottom = std::max(box.bottom, (dot.y.raw() + margin) >> 8);
  }
  return {std::max(box.left, 0), std::max(box.top, 0), std::min(box.right, picture.width - 1),
          std::min(box.bottom, picture.height - 1)};
}

// Whole boxes only. false: there is not even a pixel. The largest picture fits when it is reduced most, so nothing ends
// the loop but a return.
static_assert((kMaxLumaWidth >> kMaxReduction_log2) * (kMaxLumaHeight >> kMaxReduction_log2) <= kMaxReducedPixels);
bool place_picture(Reduced& out, const MarkerField& rest, PixelsQ8 pitch, const LumaView& picture) {
  const Box box = reach_of(rest, pitch, picture);
  out.reduction_log2 = 0;
  while (out.reduction_log2 < kMaxReduction_log2 && (pitch.raw() >> (out.reduction_log2 + 1)) >= kLeastPitch_q8) {
    ++out.reduction_log2;
  }
  for (; out.reduction_log2 <= kMaxReduction_log2; ++out.reduction_log2) {
    out.left = box.left >> out.reduction_log2;
    out.top = box.top >> out.reduction_log2;
    out.width = ((box.right + 1) >> out.reduction_log2) - out.left;
    out.height = ((box.bottom + 1) >> out.reduction_log2) - out.top;
    if (out.width < 2 || out.height < 2) return false;
    if (out.width * out.height <= kMaxReducedPixels) return true;
  }
  return false;
}

// Sums stay in 16 bits, which the compiler's vectors need to be told at every step.
std::uint16_t u16(std::uint32_t value) {
  return static_cast<std::uint16_t>(value);
}

// The picture is reduced in strips so wide, from the top down, whose rows stay in vectors; one more for what is beside.
using Vector [[gnu::vector_size(2 * kLanes)]] = std::uint16_t;
constexpr std::size_t kVectors = kStrip / kLanes + 1;
using Vectors = std::array<Vector, kVectors>;

// A row of boxes as 4 x luma, from column `left` on; columns and rows beyond the edge repeat it.
// Range: sums of 16 x 16 pixels are 65 280 at most.
Vectors box_row(const Reduced& to, const LumaView& picture, std::int32_t left, std::int32_t y) {
  constexpr std::int32_t kColumns = kVectors * kLanes;
  const std::int32_t side = 1 << to.reduction_log2;
  const std::int32_t begin = std::max(left, 0), end = std::min(left + kColumns, to.width);
  const std::uint8_t* from =
      picture.row((to.top + std::clamp(y, 0, to.height - 1)) * side) + std::ptrdiff_t{to.left + begin} * side;
  std::int32_t width = (end - begin) * side;
  std::array<std::uint16_t, (kColumns << kMaxReduction_log2)> sums, halves;  // NOLINT: filled as far as they are read
  for (std::int32_t x = 0; x < width; ++x) sums[idx(x)] = from[x];
  for (std::int32_t line = 1; line < side; ++line) {
    from += picture.stride;
    for (std::int32_t x = 0; x < width; ++x) sums[idx(x)] = u16(std::uint32_t{sums[idx(x)]} + from[x]);
  }
  for (; width > end - begin; width /= 2) {
    for (std::int32_t x = 0; x < width / 2; ++x) {
      halves[idx(x)] = u16(std::uint32_t{sums[idx(2 * x)]} + sums[idx(2 * x + 1)]);
    }
    std::copy_n(halves.begin(), width / 2, sums.begin());
  }
  const int shift = 2 * (to.reduction_log2 - 1);
  if (shift < 0) {
    for (std::int32_t x = 0; x < width; ++x) sums[idx(x)] = u16(std::uint32_t{sums[idx(x)]} * 4);
  } else if (shift > 0) {
    for (std::int32_t x = 0; x < width; ++x) sums[idx(x)] = u16((sums[idx(x)] + (1u << (shift - 1))) >> shift);
  }
  std::array<std::uint16_t, kColumns> row;  // NOLINT: filled below
  std::fill_n(row.begin(), begin - left, sums[0]);
  std::copy_n(sums.begin(), width, row.begin() + (begin - left));
  std::fill(row.begin() + (end - left), row.end(), sums[idx(width - 1)]);
  return std::bit_cast<Vectors>(row);
}

// The same of boxes of 2 x 2, away from the edges, whose upper half begins at `upper`.
Vectors pair_row(const std::uint8_t* upper, std::ptrdiff_t stride) {
  Vectors out;  // NOLINT: filled below
  for (std::size_t k = 0; k < kVectors; ++k, upper += sizeof(Vector)) {
#if defined(__ARM_NEON)  // two instructions instead of five
    out[k] = std::bit_cast<Vector>(vpadalq_u8(vpaddlq_u8(vld1q_u8(upper)), vld1q_u8(upper + stride)));
#else
    Vector a, b;
    std::memcpy(&a, upper, sizeof a);
    std::memcpy(&b, upper + stride, sizeof b);
    out[k] = (a & 255) + (a >> 8) + (b >> 8) + (b & 255);  // of bytes, in either order
#endif
  }
  return out;
}

// (sum + 2) / 4. By reference: the integer gate compiles without vector registers, in which a value would be handed
// over.
void take_quarter(Vector& sum) {
#if defined(__ARM_NEON)  // one instruction instead of two
  sum = std::bit_cast<Vector>(vrshrq_n_u16(std::bit_cast<uint16x8_t>(sum), 2));
#else
  sum = (sum + 2) >> 2;
#endif
}

// Boxes, then 1-2-1 both ways, each as 1-1 twice, from column `left` on. 16 x luma. Range: sums of 4 * 4 * 1020.
// `row_at`: the boxes of a row from column left - 1 on.
template <typename RowAt>
void smooth_strip(Reduced& out, RowAt row_at, std::int32_t left, std::int32_t top, std::int32_t bottom) {
  const std::ptrdiff_t width = out.width;
  // `two`: the sum of the row above and this one, `one`: this one. Leaves those of the next row in `one` and `next`.
  const auto step = [&](Vectors& two, Vectors& one, Vectors& next, std::int32_t y) {
    next = row_at(y + 1);
    std::uint16_t* const to = out.pixels.data() + y * width + left;
    for (std::size_t k = 0; k < kVectors; ++k) {
      one[k] += next[k];
      two[k] += one[k];
    }
    for (std::size_t k = 0; k < kVectors; ++k) {
      two[k] += __builtin_shufflevector(two[k], two[std::min(k + 1, kVectors - 1)], 1, 2, 3, 4, 5, 6, 7, 8);
    }
    for (std::size_t k = 0; k + 1 < kVectors; ++k) {
      Vector pixels = two[k] + __builtin_shufflevector(two[k], two[k + 1], 1, 2, 3, 4, 5, 6, 7, 8);
      take_quarter(pixels);
      std::memcpy(to + k * kLanes, &pixels, sizeof pixels);
    }
  };
  Vectors a = row_at(top - 1), b = row_at(top), c;  // NOLINT: filled by the first step
  for (std::size_t k = 0; k < kVectors; ++k) a[k] += b[k];
  // Three change places, so that none is copied.
  for (std::int32_t y = top; y <= bottom; y += 3) {
    step(a, b, c, y);
    if (y + 1 > bottom) return;
    step(b, c, a, y + 1);
    if (y + 2 > bottom) return;
    step(c, a, b, y + 2);
  }
}

void reduce_strip(Reduced& out, const LumaView& picture, std::int32_t left, std::int32_t top, std::int32_t bottom) {
  if (out.reduction_log2 == 1 && left > 0 && left - 1 + std::int32_t{kVectors} * kLanes <= out.width) {
    const std::uint8_t* const first = picture.row(2 * out.top) + 2 * std::ptrdiff_t{out.left + left - 1};
    const std::ptrdiff_t stride = picture.stride;
    const auto row_at = [first, stride, last = out.height - 1](std::int32_t y) {
      return pair_row(first + 2 * stride * std::clamp(y, 0, last), stride);
    };
    smooth_strip(out, row_at, left, top, bottom);
  } else {
    const auto row_at = [&](std::int32_t y) { return box_row(out, picture, left - 1, y); };
    smooth_strip(out, row_at, left, top, bottom);
  }
}

// What `box` has of it. From the right, so that what a strip writes beyond its row is written again. The last strip
// goes to the left as far as keeps it away from the edge, where that is enough.
void reduce(Reduced& out, const LumaView& picture, const Box& box) {
  const std::int32_t last = out.width + 1 - std::int32_t{kVectors} * kLanes;
  const bool is_enough = last > 0 && box.right < last + kStrip;
  for (std::int32_t left = box.left + (box.right - box.left) / kStrip * kStrip; left >= box.left; left -= kStrip) {
    reduce_strip(out, picture, is_enough ? std::min(left, last) : left, box.top, box.bottom);
  }
}

// --- Patches ---

// None on a single line of dots, which tells nothing of what lies beside it.
std::int32_t patches_of(GridSize grid) {
  if (grid.rows < 2 || grid.cols < 2) return 0;
  const std::int32_t dots = grid.count();
  return kPatchesPerDot * (dots <= kMaxPrintedDots ? dots : dots / 2);
}

std::int32_t dot_of(GridSize grid, std::int32_t patch) {
  return patch / kPatchesPerDot * (grid.count() <= kMaxPrintedDots ? 1 : 2);
}

// Towards which side of its dot a patch lies, by its lane.
constexpr std::int32_t side_x(std::int32_t lane) {
  return (lane & 1) == 0 ? 1 : -1;
}
constexpr std::int32_t side_y(std::int32_t lane) {
  return (lane & 2) == 0 ? 1 : -1;
}
static_assert(kPatchesPerDot == 4);

Corner corner_of(GridSize grid, std::int32_t own, std::int32_t lane) {
  const std::int32_t row = own / grid.cols, col = own % grid.cols;
  const std::int32_t right = col + side_x(lane), below = row + side_y(lane);
  const std::int32_t beside = right >= 0 && right < grid.cols ? own + side_x(lane) : own;
  const std::int32_t down = below >= 0 && below < grid.rows ? side_y(lane) * grid.cols : 0;
  const auto u8 = [](std::int32_t dot) { return static_cast<std::uint8_t>(dot); };
  static_assert(kMaxMarkers <= 256);
  return {u8(own), u8(beside), u8(own + down), u8(beside + down)};
}

// A coordinate of the working picture, in reduced pixels from `origin` on. Range: |x| <= 2^20, so 2^24 in Q12.
std::int32_t reduced_q12(std::int32_t x_q8, std::int32_t origin, std::int32_t reduction_log2) {
  const std::int32_t side = 1 << reduction_log2;
  return ((x_q8 - (side - 1) * 128) * 16 >> reduction_log2) - origin * 4096;
}

// How far a patch's corners lie along one axis of the picture, from its first sample and its steps.
struct Extent {
  std::int32_t least_q12, most_q12;
};

Extent extent_of(std::int32_t first_q12, std::int32_t a_q12, std::int32_t b_q12) {
  const std::int32_t far_a = (kSide - 1) * a_q12, far_b = (kSide - 1) * b_q12;
  return {first_q12 + std::min(far_a, 0) + std::min(far_b, 0), first_q12 + std::max(far_a, 0) + std::max(far_b, 0)};
}

// -1 or 0: no branch keeps the compiler from vectors.
std::int32_t inside(Extent extent, std::int32_t size) {
  return ~(extent.least_q12 >> 31) & (extent.most_q12 - (size - 1) * 4096) >> 31;
}

// Of one patch, into its lane. Steps along a lattice link of the dot: towards the patch, or away from it at the
// lattice's edge.
void lay_out(const Reduced& picture, const MarkerField& rest, std::int32_t dot, std::int32_t lane, Layout& out) {
  const GridSize grid = rest.grid;
  const std::size_t l = idx(lane);
  const Corner corner = corner_of(grid, dot, lane);
  out.corner[l] = corner;
  out.column[l] = static_cast<std::int16_t>(4 * (dot % grid.cols) + side_x(lane) - 2 * (grid.cols - 1));
  out.row[l] = static_cast<std::int16_t>(4 * (dot / grid.cols) + side_y(lane) - 2 * (grid.rows - 1));
  const bool has_beside = corner.beside != corner.own, has_over = corner.over != corner.own;
  const Marker& own = rest.markers[corner.own];
  const Marker& first = rest.markers[has_beside ? corner.beside : idx(dot - side_x(lane))];
  const Marker& second = rest.markers[has_over ? corner.over : idx(dot - side_y(lane) * grid.cols)];
  if (!own.valid || !rest.markers[corner.across].valid || !first.valid || !second.valid) return;
  // A 16th of the link: what is Q8 of the whole is Q12 of the step.
  static_assert(kStepsPerPitch == 16);
  const auto step = [&](PixelsQ8 from, PixelsQ8 to, bool towards) {
    const std::int64_t link_q8 = towards ? to.raw() - from.raw() : from.raw() - to.raw();
    return static_cast<std::int32_t>(div_round(link_q8, std::int64_t{1} << picture.reduction_log2));
  };
  const auto along = [&](PixelsQ8 Marker::*axis, std::int32_t origin, std::int32_t size, Axis& to) {
    const std::int32_t a_q12 = step(own.*axis, first.*axis, has_beside);
    const std::int32_t b_q12 = step(own.*axis, second.*axis, has_over);
    const std::int32_t first_q12 = reduced_q12((own.*axis).raw(), origin, picture.reduction_log2) + (a_q12 + b_q12) / 2;
    to.first_q12[l] = first_q12;
    to.a_q12[l] = a_q12;
    to.b_q12[l] = b_q12;
    return inside(extent_of(first_q12, a_q12, b_q12), size);
  };
  const std::int32_t across = along(&Marker::x, picture.left, picture.width, out.x);
  const std::int32_t down = along(&Marker::y, picture.top, picture.height, out.y);
  out.usable[l] = across & down;
}

// How far a dot is from its rest position.
struct Move {
  std::int32_t x_q8, y_q8;
  std::int32_t known;  // -1: neither place is a guess
};
using Moves = std::array<Move, kMaxMarkers>;

Moves moves_of(const MarkerField& now, const MarkerField& rest) {
  Moves out;  // NOLINT: filled as far as it is read
  for (std::size_t i = 0; i < idx(rest.grid.count()); ++i) {
    const Marker& to = now.markers[i];
    const Marker& from = rest.markers[i];
    out[i] = {to.x.raw() - from.x.raw(), to.y.raw() - from.y.raw(), to.valid && from.valid ? -1 : 0};
  }
  return out;
}

// What moved the dots of eight patches.
struct Pulls {
  Lanes<std::int32_t> own_q8, beside_q8, over_q8, across_q8;
};

// Where the patch is now, on a gel that has moved and stretched: its middle, a quarter of the way from its dot to each
// neighbour, takes the bilinear mean of the four dots' displacements, and its steps their slope there. Beside a contact
// the gel bends within a pitch; without the slope that shows as motion. Range: displacements of 2^21 in Q8.
void follow(Axis& axis, const Pulls& pulls, std::int32_t reduction_log2) {
  // Sixteenths of Q8 are Q12; a slope is a quarter's 4 over the 16 steps of a pitch, so a quarter of Q8 is Q12 of it.
  static_assert(kStepsPerPitch == 16);
#pragma GCC unroll 1
  for (std::size_t i = 0; i < kLanes; ++i) {
    const std::int32_t own = pulls.own_q8[i], beside = pulls.beside_q8[i];
    const std::int32_t over = pulls.over_q8[i], across = pulls.across_q8[i];
    const std::int32_t a = (3 * (beside - own) + across - over) / 4 >> reduction_log2;
    const std::int32_t b = (3 * (over - own) + across - beside) / 4 >> reduction_log2;
    axis.first_q12[i] += ((9 * own + 3 * beside + 3 * over + across) >> reduction_log2) - (kSide - 1) * (a + b) / 2;
    axis.a_q12[i] += a;
    axis.b_q12[i] += b;
  }
}

// Along one axis, of all patches in the same lane that are in view.
struct Extents {
  Lanes<std::int32_t> least_q12, most_q12;
};

struct Places {
  Axis x, y;
};

// Of eight patches, in view or not (-1, 0); those that are not go to the first pixel.
Lanes<std::int32_t> find(const Reduced& picture, const Layout& layout, const Moves& moves, Places& out, Extents& x,
                         Extents& y) {
  Pulls pulls_x, pulls_y;    // NOLINT: filled below
  Lanes<std::int32_t> seen;  // NOLINT
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    const Corner corner = layout.corner[lane];
    const Move &own = moves[corner.own], &beside = moves[corner.beside];
    const Move &over = moves[corner.over], &across = moves[corner.across];
    pulls_x.own_q8[lane] = own.x_q8;
    pulls_y.own_q8[lane] = own.y_q8;
    pulls_x.beside_q8[lane] = beside.x_q8;
    pulls_y.beside_q8[lane] = beside.y_q8;
    pulls_x.over_q8[lane] = over.x_q8;
    pulls_y.over_q8[lane] = over.y_q8;
    pulls_x.across_q8[lane] = across.x_q8;
    pulls_y.across_q8[lane] = across.y_q8;
    seen[lane] = layout.usable[lane] & own.known & beside.known & over.known & across.known;
  }
  out = {layout.x, layout.y};
  follow(out.x, pulls_x, picture.reduction_log2);
  follow(out.y, pulls_y, picture.reduction_log2);
#pragma GCC unroll 1
  for (std::size_t i = 0; i < kLanes; ++i) {
    const Extent across = extent_of(out.x.first_q12[i], out.x.a_q12[i], out.x.b_q12[i]);
    const Extent down = extent_of(out.y.first_q12[i], out.y.a_q12[i], out.y.b_q12[i]);
    const std::int32_t mask = inside(across, picture.width) & inside(down, picture.height) & seen[i];
    seen[i] = mask;
    x.least_q12[i] = std::min(x.least_q12[i], (across.least_q12 & mask) | (INT32_MAX & ~mask));
    x.most_q12[i] = std::max(x.most_q12[i], across.most_q12 & mask);
    y.least_q12[i] = std::min(y.least_q12[i], (down.least_q12 & mask) | (INT32_MAX & ~mask));
    y.most_q12[i] = std::max(y.most_q12[i], down.most_q12 & mask);
    out.x.first_q12[i] &= mask;
    out.x.a_q12[i] &= mask;
    out.x.b_q12[i] &= mask;
    out.y.first_q12[i] &= mask;
    out.y.a_q12[i] &= mask;
    out.y.b_q12[i] &= mask;
  }
  return seen;
}

// The pixels around all of that.
Box reach_of(const Extents& x, const Extents& y) {
  const auto least = [](const Extents& of) {
    return *std::min_element(of.least_q12.begin(), of.least_q12.end()) >> 12;
  };
  const auto most = [](const Extents& of) {
    return (*std::max_element(of.most_q12.begin(), of.most_q12.end()) >> 12) + 1;
  };
  return {least(x), least(y), most(x), most(y)};
}

void spots_of(const Places& f, std::int32_t width, Spots& out) {
  using Four [[gnu::vector_size(16)]] = std::int32_t;
  constexpr std::size_t kHalves = 2;
  using Both = std::array<Four, kHalves>;
  static_assert(sizeof(Both) == sizeof(Lanes<std::int32_t>));
  const auto both = [](const Lanes<std::int32_t>& lanes, Both& out_both) {
    std::memcpy(&out_both, &lanes, sizeof lanes);
  };
  Both ax, ay, bx, by, row_x, row_y;  // NOLINT: filled below
  both(f.x.a_q12, ax);
  both(f.y.a_q12, ay);
  both(f.x.b_q12, bx);
  both(f.y.b_q12, by);
  both(f.x.first_q12, row_x);
  both(f.y.first_q12, row_y);
  Spot* spot = out.data();
  for (std::int32_t b = 0; b < kSide; ++b) {
    Both x = row_x, y = row_y;
    for (std::size_t h = 0; h < kHalves; ++h) {
      x[h] += ax[h] * kFirstFree[idx(b)];
      y[h] += ay[h] * kFirstFree[idx(b)];
      row_x[h] += bx[h];
      row_y[h] += by[h];
    }
    for (std::int32_t a = kFirstFree[idx(b)]; a < kSide; ++a, ++spot) {
      for (std::size_t h = 0; h < kHalves; ++h) {
        const Four bytes = ((y[h] >> 12) * width + (x[h] >> 12)) * 2;
        std::memcpy(&spot->x_q12[4 * h], &x[h], sizeof x[h]);
        std::memcpy(&spot->y_q12[4 * h], &y[h], sizeof y[h]);
        std::memcpy(&spot->bytes[4 * h], &bytes, sizeof bytes);
        x[h] += ax[h];
        y[h] += ay[h];
      }
    }
  }
}

void sample(const Reduced& picture, const Places& f, Eight<std::int16_t>& out) {
  Spots spots;  // NOLINT: filled below
  spots_of(f, picture.width, spots);
  Squares squares;  // NOLINT
  const auto* const upper = reinterpret_cast<const std::byte*>(picture.pixels.data());
  const std::byte* lower = upper + 2 * std::ptrdiff_t{picture.width};
  asm("" : "+r"(lower));  // or gcc adds the width again for every sample
  for (std::size_t i = 0; i < kFree; ++i) {
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const std::int32_t bytes = spots[i].bytes[lane];
      Square square;
      std::memcpy(square.data(), upper + bytes, 2 * sizeof square[0]);
      std::memcpy(&square[2], lower + bytes, 2 * sizeof square[0]);
      squares[i * kLanes + lane] = square;
    }
  }
  blend(squares, spots, out);
}

// What lies on the empty gel, 16 x luma. Range of the mean: 16 * 4080.
Eight<std::int16_t> over_empty(const Eight<std::int16_t>& now, const Eight<std::uint16_t>& empty_q4) {
  Eight<std::int16_t> c;  // NOLINT
  for (std::size_t s = 0; s < c.size(); ++s) c[s] = static_cast<std::int16_t>(now[s] - (u16(empty_q4[s] + 8u) >> 4));
  return c;
}

// Their gradient energy, kPairs times. Range: differences of 12 bits and a sign, twice.
Lanes<std::uint32_t> relief_of(const Eight<std::int16_t>& c) {
  Lanes<std::uint32_t> sum{};
#pragma GCC unroll 34
  for (const Pair& pair : kNeighbours) {
#pragma GCC unroll 1
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const auto slope = static_cast<std::int16_t>(c[pair.second * kLanes + lane] - c[pair.first * kLanes + lane]);
      sum[lane] += static_cast<std::uint32_t>(slope * slope);
    }
  }
  return sum;
}

constexpr int kChangeShift = 8;

struct Moments {
  Lanes<std::int32_t> sum{};
  Lanes<std::int32_t> squares{};
  // Mean square about the mean, 1/625 levels^2. Range: 25 * 25 * 4080^2 = 2^33.3 before the shift.
  [[nodiscard]] std::int32_t variance(std::size_t lane) const {
    return static_cast<std::int32_t>((std::int64_t{kFree} * squares[lane] - square(sum[lane])) >> kChangeShift);
  }
};

// Of the values at(sample, lane). Range: five of 12 bits and a sign stay in 16 bits.
template <typename At>
Moments moments_of(At at) {
  constexpr std::size_t kTogether = 5;
  static_assert(kFree % kTogether == 0);
  Moments out;
  for (std::size_t first = 0; first < kFree; first += kTogether) {
    Lanes<std::int16_t> part{};
#pragma GCC unroll 5
    for (std::size_t i = first; i < first + kTogether; ++i) {
#pragma GCC unroll 1
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        const std::int16_t one = at(i, lane);
        part[lane] = static_cast<std::int16_t>(part[lane] + one);
        out.squares[lane] += one * one;
      }
    }
#pragma GCC unroll 1
    for (std::size_t lane = 0; lane < kLanes; ++lane) out.sum[lane] += part[lane];
  }
  return out;
}

// The empty gel shows so much of its own that a little less than perfect tracking would pass for a relief. Range:
// slopes of 16 bits and a sign, twice 17 of them.
Lanes<bool> are_marked(const Eight<std::uint16_t>& empty_q4, const Config& config) {
  Lanes<std::int64_t> sum{};
#pragma GCC unroll 34
  for (const Pair& pair : kNeighbours) {
#pragma GCC unroll 1
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const auto slope = static_cast<std::uint16_t>(
          std::abs(empty_q4[pair.second * kLanes + lane] - empty_q4[pair.first * kLanes + lane]));
      sum[lane] += std::uint32_t{slope} * slope;
    }
  }
  Lanes<bool> out;  // NOLINT
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    out[lane] = sum[lane] > std::int64_t{kPairs} * config.most_print * 256 * 256;
  }
  return out;
}

// --- Evidence ---

const Kept* picture_before(const State& state, Micros now, Micros lag) {
  const Kept* best = nullptr;
  Micros off = lag / 3;
  for (int back = 0; back < state.count; ++back) {
    const Kept& kept = state.kept[idx((state.newest + kKept - back) % kKept)];
    const Micros late = now - kept.at - lag;
    const Micros distance = late < Micros{0} ? -late : late;
    if (distance > off) continue;
    off = distance;
    best = &kept;
  }
  return best;
}

// The one kept after it. nullptr: none
const Kept* kept_after(const State& state, const Kept& kept) {
  const auto index = static_cast<int>(&kept - state.kept.data());
  return index == state.newest ? nullptr : &state.kept[idx((index + 1) % kKept)];
}

// Relief of a patch above which something is pressed into it.
std::int64_t threshold_of(const State& state, const Config& config) {
  const std::int64_t floor = std::int64_t{kPairs} * config.contact_floor_q8;
  if (state.empty.frames <= kNoiseAfter) return 2 * floor;
  return std::max(floor, state.empty.noise_relief * config.contact_over_noise_q4 / 16);
}

// The patches among kSlope's weights, along the axes of the patch. Range: 25 weights of up to 4 on 16 bits.
template <typename Sample>
Lanes<std::int32_t> slope_of(const std::array<std::int8_t, kFree>& weights, const Eight<Sample>& samples) {
  Lanes<std::int32_t> sum{};
#pragma GCC unroll 25
  for (std::size_t i = 0; i < kFree; ++i) {
#pragma GCC unroll 1
    for (std::size_t lane = 0; lane < kLanes; ++lane) sum[lane] += weights[i] * samples[i * kLanes + lane];
  }
  return sum;
}

// One patch in two pictures.
struct Seen {
  std::int32_t patch = 0;
  std::int32_t weight = 0;  // 68 g: of both, in 1/68 levels^2. At most 2^25.1
  std::int32_t change = 0;  // 625 R, in 1/625 levels^2. At most 2^25.4
  std::int32_t same = 0;    // sqrt(V V') without noise, likewise. 0 where noise is all of either
};
constexpr int kWeightShift = 7;
constexpr std::int64_t kWeightUnit = (2 * kPairs * 256) >> kWeightShift;     // 68
constexpr std::int64_t kChangeUnit = (kFree * kFree * 256) >> kChangeShift;  // 625
static_assert(kWeightUnit == 68 && kChangeUnit == 625);

// 0.2 levels^4 a patch, in squares of the weights' unit.
constexpr std::int64_t kRegularisation = kWeightUnit * kWeightUnit / 5;
// A relief is there when its mean square exceeds that of the empty gel's noise by 0.1 levels^4.
constexpr std::int64_t kFloor = kWeightUnit * kWeightUnit / 10;
// Of turnover half as much: what is weak still says that it went.
constexpr std::int64_t kTurnoverFloor = kFloor / 2;

// Those in which least is pressed, which come first. Range: at least kLeastPatches; reorders them.
std::span<Seen> least_of(std::span<Seen> seen) {
  const auto by_weight = [](const Seen& a, const Seen& b) { return a.weight < b.weight; };
  const std::size_t quiet = seen.size() * 2 / 5;
  std::nth_element(seen.begin(), seen.begin() + static_cast<std::ptrdiff_t>(quiet), seen.end(), by_weight);
  return seen.first(quiet);
}

// Newton's method from a power of two within a factor of two of it: three steps leave 0.03 %. Range: 1 to 2^26.
std::int64_t geometric_mean(std::int64_t a, std::int64_t b) {
  const auto bits = [](std::int64_t of) { return static_cast<int>(std::bit_width(static_cast<std::uint64_t>(of))); };
  std::int64_t mean = std::int64_t{1} << (bits(a) + bits(b)) / 2;
  for (int step = 0; step < 3; ++step) mean = (mean + a * b / mean) / 2;
  return mean;
}

constexpr std::int64_t kOne_q10 = 1024;
// The allowance for the way that the gel went, for each mm.
constexpr std::int64_t kTurnoverOfWay_q10 = kOne_q10 / 2;
// The share of what fades in place that is no motion: 3/4.
constexpr std::int64_t kOfFading_q2 = 3;
// A relief is there above this mean of sqrt(V V'): 0.2 levels^2.
constexpr std::int64_t kLeastVariance = kChangeUnit / 5;

// What changed where nothing is pressed in.
struct Noise {
  std::int32_t change = 0;    // q
  std::int64_t variance = 0;  // of V and of V'
  bool covered = false;       // there is no such place: the object covers the gel
};

// Of what changed in the patches in which least is pressed; reorders them.
Noise noise_of(const State& state, const Config& config, const Kept& then, std::span<Seen> least) {
  const auto at = least.begin() + static_cast<std::ptrdiff_t>((least.size() - 1) * 3 / 4);
  std::nth_element(least.begin(), at, least.end(), [](const Seen& a, const Seen& b) { return a.change < b.change; });
  std::array<std::int32_t, kMaxPatches> sums;  // NOLINT: filled as far as it is read
  std::size_t count = 0;
  std::int64_t weight = 0;
  for (const Seen& one : least) {
    sums[count++] = state.last.variance[idx(one.patch)] + then.variance[idx(one.patch)];
    weight += one.weight;
  }
  std::int32_t* const middle = &sums[count / 2];
  std::nth_element(sums.data(), middle, sums.data() + count);
  Noise noise{at->change, *middle / 2};
  const std::int64_t contact = threshold_of(state, config) >> (kWeightShift - 1);
  noise.covered = state.empty.frames > kNoiseAfter && weight >= contact * static_cast<std::int64_t>(count);
  if (!noise.covered) return noise;
  const std::int64_t empty = state.empty.noise_relief * kChangeUnit / (std::int64_t{kPairs} * 256);
  noise.change = static_cast<std::int32_t>(std::min<std::int64_t>(noise.change, 2 * empty));
  noise.variance = std::min(noise.variance, empty);
  return noise;
}

// Over the patches.
struct Sums {
  std::int64_t evidence = 0;                     // g (R - q)
  std::int64_t energy = 0;                       // g^2
  std::int64_t energy_now = 0, energy_then = 0;  // G^2
  std::int64_t weights = 0;                      // the lesser G of both
  std::int64_t common = 0;                       // 2 C, by these weights
  std::int64_t whole = 0;                        // 2 sqrt(V V'), likewise
  std::int64_t fades = 0;                        // g (V' - V)
  std::int64_t varies = kOne_q10;                // g |V' - V|, never 0
};

// Range, of 320 patches: weights of 2^25.1, changes of 2^25.4 and variances of 2^26.4 make sums below 2^60.
Sums sums_of(const Kept& last, const Kept& before, const Noise& noise, std::span<Seen> seen) {
  Sums sums;
  for (Seen& one : seen) {
    const std::size_t p = idx(one.patch);
    const std::uint32_t relief_now = last.relief[p], relief_then = before.relief[p];
    const std::int32_t now = last.variance[p], then = before.variance[p];
    sums.evidence += std::int64_t{one.weight} * (one.change - noise.change);
    sums.energy += square(one.weight);
    sums.energy_now += square(relief_now >> (kWeightShift - 1));
    sums.energy_then += square(relief_then >> (kWeightShift - 1));

    const std::int64_t weight = std::min(relief_now, relief_then) >> kWeightShift;
    one.same = 0;
    if (now > noise.variance && then > noise.variance) {
      one.same = static_cast<std::int32_t>(geometric_mean(now - noise.variance, then - noise.variance));
    }
    sums.weights += weight;
    sums.common += weight * (now + then - one.change);  // where noise cancels
    sums.whole += weight * 2 * one.same;
    const std::int64_t fades = std::int64_t{one.weight} * (then - now);
    sums.fades += fades;
    sums.varies += std::abs(fades);
  }
  return sums;
}

ShareQ10 turnover_of(const Sums& sums, std::int64_t way_um, Saturations& saturations) {
  if (sums.whole < 2 * kLeastVariance * sums.weights + kOne_q10) return {};  // and it can be divided by
  const std::int64_t stays_q10 = std::max<std::int64_t>(sums.common, 0) / (sums.whole / kOne_q10);
  return ShareQ10::saturate(std::max<std::int64_t>(kOne_q10 - stays_q10 - way_um * kTurnoverOfWay_q10 / 1000, 0),
                            saturations);
}

// The evidence that fading in place explains. Range: as above.
std::int64_t faded(const Sums& sums, const Kept& last, const Kept& before, const Noise& noise,
                   std::span<const Seen> seen) {
  if (sums.fades <= 0) return 0;
  const std::int64_t share_q12 = sums.fades / (sums.varies / kOne_q10) * kOfFading_q2;
  std::int64_t sum = 0;
  for (const Seen& one : seen) {
    const std::int64_t change = one.change - noise.change;
    const std::int64_t now = std::max<std::int64_t>(last.variance[idx(one.patch)] - noise.variance, 0);
    const std::int64_t then = std::max<std::int64_t>(before.variance[idx(one.patch)] - noise.variance, 0);
    if (then <= now || change <= 0) continue;
    const std::int64_t fades = (now + then - 2 * one.same) * share_q12 >> 12;  // (sqrt(V') - sqrt(V))^2
    sum += one.weight * std::min(fades, change);
  }
  return sum;
}

// Energy of the shading, and 1 level^2 a patch. Range: 320 squares of 18 bits.
std::int64_t shading_energy(const Kept& kept, std::span<const Seen> seen, std::span<const Seen> least) {
  constexpr std::int64_t kLevel = 16 * kFree;
  std::int64_t base = 0;
  for (const Seen& one : least) base += kept.shading[idx(one.patch)];
  base = div_round(base, static_cast<std::int64_t>(least.size()));
  std::int64_t sum = square(kLevel) * static_cast<std::int64_t>(seen.size());
  for (const Seen& one : seen) sum += square(kept.shading[idx(one.patch)] - base);
  return sum;
}

// Above this mean of g the relief inside the patches tells more than their means: 0.35 levels^2.
constexpr std::int64_t kMostReliefForCoarse = kWeightUnit * 35;  // hundredths

Log2Q8 coarse_motion(const State& state, const Kept& then, GridSize grid, std::span<const Seen> seen,
                     coarse::Carried carried, std::int32_t step_q8, Saturations& saturations) {
  std::int64_t relief = 0;
  for (const Seen& one : seen) relief += one.weight;
  if (relief * 100 > kMostReliefForCoarse * static_cast<std::int64_t>(seen.size())) return {};
  static_assert(coarse::kMostPatches == kMaxPatches && coarse::kLeastPatches <= kLeastPatches);
  static_assert(2 * (kMaxMarkers / 2 + 2) < 256, "|column| + |row| of a lattice of two lines");
  std::array<coarse::Patch, kMaxPatches> patches;  // NOLINT: filled as far as it is read
  std::size_t count = 0;
  for (std::int32_t first = 0; first < patches_of(grid); first += kLanes) {
    const std::size_t e = idx(first / kLanes);
    const Eight<std::uint16_t>& empty_q4 = state.empty.samples_q4[e];
    const Lanes<std::int32_t> empty_a_q4 = slope_of(kSlope.a, empty_q4), empty_b_q4 = slope_of(kSlope.b, empty_q4);
    for (std::int32_t lane = 0; lane < kLanes; ++lane) {
      const std::size_t k = idx(first + lane);
      if (!state.last.seen[k] || !then.seen[k]) continue;
      coarse::Patch& patch = patches[count++];
      patch.change = state.last.shading[k] - then.shading[k];
      patch.shading = state.last.shading[k] + then.shading[k];
      patch.slope_x = side_x(lane) * (state.last.slope_a[k] + then.slope_a[k]);
      patch.slope_y = side_y(lane) * (state.last.slope_b[k] + then.slope_b[k]);
      patch.empty_x = side_x(lane) * ((empty_a_q4[idx(lane)] + 8) >> 4);
      patch.empty_y = side_y(lane) * ((empty_b_q4[idx(lane)] + 8) >> 4);
      patch.x = state.layout[e].column[idx(lane)];
      patch.y = state.layout[e].row[idx(lane)];
    }
  }
  return coarse::motion(std::span(patches).first(count), carried, step_q8, saturations);
}

// Mean displacement of the markers, each at most two pitches along an axis: no gel goes further (1.1 of them is the
// most on the recordings), and one marker that jumps must not say that all did. Range: 128 times 2^18, times 2^16, stay
// below 2^41.
void carry(const MarkerField& markers, const MarkerField& rest, PixelsQ8 pitch, Kept& out) {
  const std::int32_t most = 2 * pitch.raw();
  std::int64_t x = 0, y = 0, n = 0;
  for (std::int32_t i = 0; i < rest.grid.count(); ++i) {
    const Marker& to = markers.markers[idx(i)];
    const Marker& from = rest.markers[idx(i)];
    if (!to.valid || !from.valid) continue;
    x += std::clamp(to.x.raw() - from.x.raw(), -most, most);
    y += std::clamp(to.y.raw() - from.y.raw(), -most, most);
    ++n;
  }
  constexpr std::int64_t kSteps_q12 = std::int64_t{kStepsPerPitch} << 12;
  const std::int64_t all = std::max<std::int64_t>(n * pitch.raw(), 1);
  out.carried_x_q12 = static_cast<std::int32_t>(div_round(x * kSteps_q12, all));
  out.carried_y_q12 = static_cast<std::int32_t>(div_round(y * kSteps_q12, all));
}

// The way that the gel went between the two, squared, in steps. Range: ways of 2^18, squares of 2^37.
std::int64_t way2_q24_between(const Kept& now, const Kept& then) {
  return square(now.carried_x_q12 - then.carried_x_q12) + square(now.carried_y_q12 - then.carried_y_q12);
}

// False: both show too few patches.
bool compare(const State& state, const Kept& then, const Config& config, GridSize grid, ImprintFeatures& out,
             Saturations& saturations) {
  const Kept& last = state.last;
  std::array<Seen, kMaxPatches> both;  // NOLINT: filled as far as it is read
  std::size_t count = 0;
  for (std::int32_t first = 0; first < patches_of(grid); first += kLanes) {
    const std::size_t e = idx(first / kLanes);
    const Eight<std::int16_t>&now = last.samples.eights[e], &before = then.samples.eights[e];
    const Moments change = moments_of([&](std::size_t i, std::size_t lane) {
      return static_cast<std::int16_t>(now[i * kLanes + lane] - before[i * kLanes + lane]);
    });
    for (std::int32_t p = first; p < first + kLanes; ++p) {
      if (!last.seen[idx(p)] || !then.seen[idx(p)]) continue;
      const std::uint32_t a = last.relief[idx(p)], b = then.relief[idx(p)];
      both[count++] = {p, static_cast<std::int32_t>((std::uint64_t{a} + b) >> kWeightShift),
                       change.variance(idx(p - first))};
    }
  }
  if (count < kLeastPatches) return false;
  const auto n = static_cast<std::int64_t>(count);
  const std::span<Seen> seen(both.data(), count);
  const std::span<Seen> least = least_of(seen);
  const Noise noise = noise_of(state, config, then, least);
  const Sums sums = sums_of(last, then, noise, seen);
  const auto log_of = [](std::int64_t value) { return log2_q8(static_cast<std::uint64_t>(value)); };
  const auto energy_in = [&](std::int64_t of) { return log_of(of + n * kRegularisation) / 2; };
  out.growth = Log2Q8::saturate(
      noise.covered ? energy_in(sums.energy_now) - energy_in(sums.energy_then)
                    : log_of(shading_energy(last, seen, least)) - log_of(shading_energy(then, seen, least)),
      saturations);
  static_assert(kStepsPerPitch == 1 << 4);
  const std::int32_t step_q8 = log_of(config.pitch_um) - 4 * 256;
  const std::int64_t way2_q24 = way2_q24_between(last, then);
  const std::int64_t way_um = isqrt(static_cast<std::uint64_t>(way2_q24)) * std::int64_t{config.pitch_um} >> 16;
  const std::int64_t empty = square(state.empty.noise_relief >> (kWeightShift - 1));
  const std::int64_t energy_of_both = std::min(sums.energy_now, sums.energy_then);
  if (energy_of_both >= n * (kTurnoverFloor + empty)) out.turnover = turnover_of(sums, way_um, saturations);
  const coarse::Carried carried{way2_q24 / 4 >> 4};  // half of the way
  out.coarse = coarse_motion(state, then, grid, seen, carried, step_q8, saturations);
  const std::int64_t energy = sums.energy + n * kRegularisation;
  const std::int64_t evidence = sums.evidence - faded(sums, last, then, noise, seen) -
                                coarse::explained(carried, energy, kChangeUnit, kWeightUnit);
  if (evidence <= 0 || energy_of_both < n * (kFloor + empty)) return true;

  const std::int32_t square_q8 = log_of(evidence) + log_of(kWeightUnit) - log_of(energy) - log_of(kChangeUnit);
  out.motion = Log2Q8::saturate(std::max(step_q8 + square_q8 / 2, 0), saturations);
  return true;
}

// Into the mean of the empty gel: of all frames up to kEmptyMean, then fading. Of those `in_view`.
void take_into(Empty& empty, std::int32_t first, const Lanes<bool>& in_view, const Eight<std::int16_t>& now) {
  Eight<std::uint16_t>& mean_q4 = empty.samples_q4[idx(first / kLanes)];
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    bool& learned = empty.learned[idx(first) + lane];
    if (!in_view[lane] || learned) continue;
    for (std::size_t s = lane; s < now.size(); s += kLanes) mean_q4[s] = u16(static_cast<std::uint32_t>(now[s]) * 16);
    learned = true;
  }
  if (empty.frames == 1) return;
  // A difference of 16 bits over `frames`, rounded to nearest: 2^32 / frames, rounded up, is off by less than 64 in
  // 2^32, so the product by less than 2^23 in 2^32, and the quotient's fraction is at most 1 - 1/64.
  static_assert(kEmptyMean <= 64);
  const auto frames = static_cast<std::uint32_t>(empty.frames);
  const std::uint32_t inverse_q32 = UINT32_MAX / frames + 1, half = frames / 2;
  Lanes<std::int32_t> mask;  // NOLINT: filled below
  for (std::size_t lane = 0; lane < kLanes; ++lane) mask[lane] = in_view[lane] ? -1 : 0;
  for (std::size_t i = 0; i < kFree; ++i) {
#pragma GCC unroll 1
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      std::uint16_t& mean = mean_q4[i * kLanes + lane];
      const std::int32_t off = (now[i * kLanes + lane] * 16 - mean) & mask[lane];
      const std::uint32_t rounded = static_cast<std::uint32_t>(std::abs(off)) + half;
      const auto step = static_cast<std::int32_t>(std::uint64_t{rounded} * inverse_q32 >> 32);
      mean = static_cast<std::uint16_t>(mean + (off < 0 ? -step : step));
    }
  }
}

void place(State& state, const LumaView& picture, const MarkerField& rest, PixelsQ8 pitch) {
  const bool placed = place_picture(state.picture, rest, pitch, picture);
  if (!placed) state.picture.width = 0;
  state.width = picture.width;
  state.height = picture.height;
  state.layout.fill({});
  for (std::int32_t p = 0; placed && p < patches_of(rest.grid); ++p) {
    lay_out(state.picture, rest, dot_of(rest.grid, p), p % kLanes, state.layout[idx(p / kLanes)]);
  }
  state.placed = true;
}

// Every patch as the picture shows it, into state.last. How many are in contact.
std::int32_t look(State& state, const Config& config, const LumaView& picture, const MarkerField& markers,
                  const MarkerField& rest, bool is_new) {
  Kept& last = state.last;
  const Moves moves = moves_of(markers, rest);
  const std::int64_t threshold = threshold_of(state, config);
  std::array<Places, kEights> places;  // NOLINT: filled as far as it is read
  const std::int32_t patches = patches_of(rest.grid);
  Extents x, y;  // NOLINT: filled below
  for (Extents* extents : {&x, &y}) {
    extents->least_q12.fill(INT32_MAX);
    extents->most_q12.fill(0);
  }
  for (std::int32_t first = 0; first < patches; first += kLanes) {
    const std::size_t e = idx(first / kLanes);
    const Lanes<std::int32_t> seen = find(state.picture, state.layout[e], moves, places[e], x, y);
    for (std::size_t lane = 0; lane < kLanes; ++lane) state.in_view[idx(first) + lane] = seen[lane] != 0;
  }
  // When the patches have just been laid out, all of it: nothing of another layout is left.
  const Box all{0, 0, state.picture.width - 1, state.picture.height - 1};
  reduce(state.picture, picture, is_new ? all : reach_of(x, y));

  std::int32_t in_contact = 0;
  for (std::int32_t first = 0; first < patches; first += kLanes) {
    Eight<std::int16_t>& samples = last.samples.eights[idx(first / kLanes)];
    sample(state.picture, places[idx(first / kLanes)], samples);
    const Eight<std::int16_t> c = over_empty(samples, state.empty.samples_q4[idx(first / kLanes)]);
    const Lanes<std::uint32_t> relief = relief_of(c);
    const Moments moments = moments_of([&](std::size_t i, std::size_t lane) { return c[i * kLanes + lane]; });
    const Lanes<std::int32_t> slope_a = slope_of(kSlope.a, c), slope_b = slope_of(kSlope.b, c);
    std::copy_n(slope_a.begin(), kLanes, last.slope_a.begin() + first);
    std::copy_n(slope_b.begin(), kLanes, last.slope_b.begin() + first);
    for (std::int32_t lane = 0; lane < kLanes; ++lane) {
      const std::size_t p = idx(first + lane);
      last.seen[p] = state.in_view[p] && state.empty.learned[p] && !state.empty.marked[p];
      last.relief[p] = relief[idx(lane)];
      last.shading[p] = moments.sum[idx(lane)];
      last.variance[p] = moments.variance(idx(lane));
      if (last.seen[p] && relief[idx(lane)] > threshold) ++in_contact;
    }
  }
  return in_contact;
}

}  // namespace

void blend_scalar(const Squares& squares, const Spots& spots, Eight<std::int16_t>& out) {
  for (std::size_t s = 0; s < out.size(); ++s) {
    const Spot& spot = spots[s / kLanes];
    const std::int32_t fx = spot.x_q12[s % kLanes] >> 4 & 255, fy = spot.y_q12[s % kLanes] >> 4 & 255;
    const std::int32_t above = squares[s][0] * (256 - fx) + squares[s][1] * fx;
    const std::int32_t below = squares[s][2] * (256 - fx) + squares[s][3] * fx;
    out[s] = static_cast<std::int16_t>((above * (256 - fy) + below * fy + (1 << 15)) >> 16);
  }
}

void forget(State& state) {
  place_again(state);
  state.empty.learned.fill(false);
  state.empty.marked.fill(false);
  state.empty.frames = 0;
  state.empty.noise_relief = 0;
  state.count = 0;
  state.blind = kMostBlind;
}

ImprintFeatures update(State& state, const Config& config, const LumaView& picture, const MarkerField& markers,
                       const MarkerField& rest, PixelsQ8 pitch, Micros now, Saturations& saturations, bool raised) {
  ImprintFeatures out{};
  const bool is_new = !state.placed || picture.width != state.width || picture.height != state.height;
  if (is_new) place(state, picture, rest, pitch);
  // Another stream may count its time from another start.
  if (state.count > 0 && now <= state.kept[idx(state.newest)].at) state.count = 0;
  Kept& last = state.last;
  last.at = now;
  carry(markers, rest, pitch, last);
  last.seen.fill(false);
  state.in_view.fill(false);
  if (state.picture.width == 0) return out;

  const std::int32_t in_contact = look(state, config, picture, markers, rest, is_new);
  out.patches = Count::from_raw(in_contact);
  const Kept* const then = picture_before(state, now, config.lag);
  if (then != nullptr && compare(state, *then, config, rest.grid, out, saturations)) {
    state.blind = 0;
    const Kept* const later = raised ? kept_after(state, *then) : nullptr;
    if (later != nullptr) {
      ImprintFeatures since{};
      (void)compare(state, *later, config, rest.grid, since, saturations);
      out.motion = std::max(out.motion, since.motion);
      out.coarse = std::max(out.coarse, since.coarse);
      out.turnover = std::max(out.turnover, since.turnover);
    }
  } else if (state.blind < kMostBlind) {
    ++state.blind;
    out.blind = true;
  }

  if (state.count == 0 || now - state.kept[idx(state.newest)].at >= kKeepEvery) {
    state.newest = (state.newest + 1) % kKept;
    state.count = std::min(state.count + 1, kKept);
    state.kept[idx(state.newest)] = last;
  }
  return out;
}

void learn_empty(State& state, const Config& config) {
  Empty& empty = state.empty;
  if (std::none_of(state.in_view.begin(), state.in_view.end(), [](bool seen) { return seen; })) return;
  empty.frames = std::min(empty.frames + 1, kEmptyMean);
  std::int64_t reliefs = 0;
  std::int32_t seen = 0;
  for (std::int32_t first = 0; first < kMaxPatches; first += kLanes) {
    Lanes<bool> in_view;  // NOLINT: filled below
    std::copy_n(state.in_view.begin() + first, kLanes, in_view.begin());
    if (std::none_of(in_view.begin(), in_view.end(), [](bool one) { return one; })) continue;
    take_into(empty, first, in_view, state.last.samples.eights[idx(first / kLanes)]);
    const Lanes<bool> marked = are_marked(empty.samples_q4[idx(first / kLanes)], config);
    for (std::int32_t lane = 0; lane < kLanes; ++lane) {
      const std::size_t p = idx(first + lane);
      if (!state.in_view[p]) continue;
      empty.marked[p] = marked[idx(lane)];
      if (!state.last.seen[p]) continue;
      reliefs += state.last.relief[p];
      ++seen;
    }
  }
  if (seen > 0 && empty.frames > kNoiseAfter) {
    empty.noise_relief += div_round(reliefs / seen - empty.noise_relief, empty.frames - kNoiseAfter);
  }
}

}  // namespace holdfast::imprint
