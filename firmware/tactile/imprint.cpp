// SPDX-License-Identifier: Apache-2.0
#include "tactile/imprint.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <numeric>
#include <span>

#include "base/math.hpp"
#include "tactile/coarse.hpp"

namespace holdfast::imprint {
namespace {

// --- Which samples ---

struct Place {
  std::int8_t a = 0, b = 0;
};

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

using Row = std::array<std::uint16_t, kMaxLumaWidth + 2>;

// Sums stay in 16 bits, which the compiler's vectors need to be told at every step.
std::uint16_t u16(std::uint32_t value) {
  return static_cast<std::uint16_t>(value);
}

// One row of boxes as 4 x luma. Range: sums of 16 x 16 pixels are 65 280 at most.
void box_row(const Reduced& to, const LumaView& picture, std::int32_t y, Row& out) {
  const std::int32_t side = 1 << to.reduction_log2;
  const std::int32_t columns = to.width * side;
  Row sums, halves;  // NOLINT: filled below as far as they are read
  const std::uint8_t* first = picture.row((to.top + y) * side) + std::ptrdiff_t{to.left} * side;
  if (side == 1) {
    for (std::int32_t x = 0; x < columns; ++x) out[idx(x)] = u16(std::uint32_t{first[x]} * 4);
    return;
  }
  const std::uint8_t* second = first + picture.stride;
  for (std::int32_t x = 0; x < columns; ++x) sums[idx(x)] = u16(std::uint32_t{first[x]} + second[x]);
  for (std::int32_t line = 2; line < side; ++line) {
    const std::uint8_t* from = first + std::ptrdiff_t{line} * picture.stride;
    for (std::int32_t x = 0; x < columns; ++x) sums[idx(x)] = u16(std::uint32_t{sums[idx(x)]} + from[x]);
  }
  const auto halve = [](const Row& from, Row& into, std::int32_t width) {
    for (std::int32_t x = 0; x < width; ++x) into[idx(x)] = u16(std::uint32_t{from[idx(2 * x)]} + from[idx(2 * x + 1)]);
  };
  std::int32_t width = columns / 2;
  for (; width > to.width; width /= 2) {
    halve(sums, halves, width);
    std::copy_n(halves.begin(), width, sums.begin());
  }
  halve(sums, out, width);
  const int shift = 2 * (to.reduction_log2 - 1);
  if (shift == 0) return;
  for (std::int32_t x = 0; x < width; ++x) out[idx(x)] = u16((out[idx(x)] + (1u << (shift - 1))) >> shift);
}

// 1-2-1 of three rows or columns. Range: 4 * 4080.
void add_121(const std::uint16_t* a, const std::uint16_t* b, const std::uint16_t* c, std::int32_t count,
             std::uint16_t* out) {
  for (std::int32_t x = 0; x < count; ++x)
    out[x] = u16(u16(u16(std::uint32_t{a[x]} + c[x]) + std::uint32_t{b[x]}) + std::uint32_t{b[x]});
}

// Boxes, then 1-2-1 both ways; rows and columns beyond the edge repeat it. 16 x luma.
void reduce(Reduced& out, const LumaView& picture) {
  std::array<Row, 3> rows;  // NOLINT: filled below as far as they are read
  Row down;                 // NOLINT
  const std::int32_t w = out.width;
  box_row(out, picture, 0, rows[0]);
  std::copy_n(rows[0].begin(), w, rows[2].begin());
  for (std::int32_t y = 0; y < out.height; ++y) {
    const Row& above = rows[idx((y + 2) % 3)];
    const Row& here = rows[idx(y % 3)];
    Row& below = rows[idx((y + 1) % 3)];
    if (y + 1 < out.height) {
      box_row(out, picture, y + 1, below);
    } else {
      std::copy_n(here.begin(), w, below.begin());
    }
    // One place to the right, for the columns beyond the edge.
    add_121(above.data(), here.data(), below.data(), w, down.data() + 1);
    down[0] = down[1];
    down[idx(w + 1)] = down[idx(w)];
    std::uint16_t* to = out.pixels.data() + std::ptrdiff_t{y} * w;
    add_121(down.data(), down.data() + 1, down.data() + 2, w, to);
    for (std::int32_t x = 0; x < w; ++x) to[x] = u16(u16(std::uint32_t{to[x]} + 2) >> 2);
  }
}

// --- Patches ---

// The dot of a patch, and its neighbours towards the patch; at the lattice's edge the dot itself.
struct Corner {
  std::int32_t own, beside, over, across;
  std::int32_t sx, sy;
};

// None on a single line of dots, which tells nothing of what lies beside it.
std::int32_t patches_of(GridSize grid) {
  if (grid.rows < 2 || grid.cols < 2) return 0;
  const std::int32_t dots = grid.count();
  return kPatchesPerDot * (dots <= kMaxPrintedDots ? dots : dots / 2);
}

Corner corner_of(GridSize grid, std::int32_t patch) {
  const std::int32_t own = patch / kPatchesPerDot * (grid.count() <= kMaxPrintedDots ? 1 : 2);
  const std::int32_t sx = (patch & 1) == 0 ? 1 : -1;
  const std::int32_t sy = (patch & 2) == 0 ? 1 : -1;
  const std::int32_t row = own / grid.cols, col = own % grid.cols;
  const std::int32_t to_col = col + sx >= 0 && col + sx < grid.cols ? col + sx : col;
  const std::int32_t to_row = row + sy >= 0 && row + sy < grid.rows ? row + sy : row;
  return {own, row * grid.cols + to_col, to_row * grid.cols + col, to_row * grid.cols + to_col, sx, sy};
}

// A coordinate of the working picture, in reduced pixels from `origin` on. Range: |x| <= 2^20, so 2^24 in Q12.
std::int32_t reduced_q12(std::int32_t x_q8, std::int32_t origin, std::int32_t reduction_log2) {
  const std::int32_t side = 1 << reduction_log2;
  return ((x_q8 - (side - 1) * 128) * 16 >> reduction_log2) - origin * 4096;
}

bool inside(const Reduced& picture, std::int32_t x_q12, std::int32_t y_q12) {
  return x_q12 >= 0 && y_q12 >= 0 && x_q12 < (picture.width - 1) * 4096 && y_q12 < (picture.height - 1) * 4096;
}

// All four corners of the patch lie in the picture.
bool inside(const Reduced& picture, const PatchPlace& f) {
  for (const std::int32_t a : {0, kSide - 1}) {
    for (const std::int32_t b : {0, kSide - 1}) {
      if (!inside(picture, f.x_q12 + a * f.ax_q12 + b * f.bx_q12, f.y_q12 + a * f.ay_q12 + b * f.by_q12)) return false;
    }
  }
  return true;
}

// Steps along a lattice link of the dot: towards the patch, or away from it at the lattice's edge.
PatchPlace frame_of(const Reduced& picture, const MarkerField& rest, std::int32_t patch) {
  const Corner corner = corner_of(rest.grid, patch);
  const Marker& own = rest.markers[idx(corner.own)];
  const std::int32_t beside = corner.beside != corner.own ? corner.beside : corner.own - corner.sx;
  const std::int32_t over = corner.over != corner.own ? corner.over : corner.own - corner.sy * rest.grid.cols;
  PatchPlace out;
  if (!own.valid || !rest.markers[idx(corner.across)].valid) return out;
  const Marker& first = rest.markers[idx(beside)];
  const Marker& second = rest.markers[idx(over)];
  if (!first.valid || !second.valid) return out;
  const std::int32_t sa = corner.beside != corner.own ? 1 : -1;
  const std::int32_t sb = corner.over != corner.own ? 1 : -1;
  // A 16th of the link: what is Q8 of the whole is Q12 of the step.
  static_assert(kStepsPerPitch == 16);
  const auto step = [&](std::int32_t link_q8, std::int32_t sign) {
    return static_cast<std::int32_t>(
        div_round(std::int64_t{sign} * link_q8, std::int64_t{1} << picture.reduction_log2));
  };
  out.ax_q12 = step(first.x.raw() - own.x.raw(), sa);
  out.ay_q12 = step(first.y.raw() - own.y.raw(), sa);
  out.bx_q12 = step(second.x.raw() - own.x.raw(), sb);
  out.by_q12 = step(second.y.raw() - own.y.raw(), sb);
  out.x_q12 = reduced_q12(own.x.raw(), picture.left, picture.reduction_log2) + (out.ax_q12 + out.bx_q12) / 2;
  out.y_q12 = reduced_q12(own.y.raw(), picture.top, picture.reduction_log2) + (out.ay_q12 + out.by_q12) / 2;
  out.usable = inside(picture, out);
  return out;
}

// Where the patch is now, on a gel that has moved and stretched: its middle, a quarter of the way from its dot to each
// neighbour, takes the bilinear mean of the four dots' displacements, and its steps their slope there. Beside a contact
// the gel bends within a pitch; without the slope that shows as motion. false: one of the dots is lost.
// Range: displacements of 2^21 in Q8.
bool follow(const MarkerField& now, const MarkerField& rest, std::int32_t patch, std::int32_t reduction_log2,
            PatchPlace& frame) {
  const Corner corner = corner_of(rest.grid, patch);
  std::array<std::int32_t, 4> x{}, y{};
  const std::array<std::int32_t, 4> dots{corner.own, corner.beside, corner.over, corner.across};
  for (std::size_t k = 0; k < dots.size(); ++k) {
    const Marker& to = now.markers[idx(dots[k])];
    const Marker& from = rest.markers[idx(dots[k])];
    if (!to.valid || !from.valid) return false;
    x[k] = to.x.raw() - from.x.raw();
    y[k] = to.y.raw() - from.y.raw();
  }
  // Sixteenths of Q8 are Q12; a slope is a quarter's 4 over the 16 steps of a pitch, so a quarter of Q8 is Q12 of it.
  static_assert(kStepsPerPitch == 16);
  const auto middle = [&](const std::array<std::int32_t, 4>& d) { return 9 * d[0] + 3 * d[1] + 3 * d[2] + d[3]; };
  const auto slope_a = [&](const std::array<std::int32_t, 4>& d) { return (3 * (d[1] - d[0]) + d[3] - d[2]) / 4; };
  const auto slope_b = [&](const std::array<std::int32_t, 4>& d) { return (3 * (d[2] - d[0]) + d[3] - d[1]) / 4; };
  const std::int32_t ax = slope_a(x) >> reduction_log2, ay = slope_a(y) >> reduction_log2;
  const std::int32_t bx = slope_b(x) >> reduction_log2, by = slope_b(y) >> reduction_log2;
  frame.x_q12 += (middle(x) >> reduction_log2) - (kSide - 1) * (ax + bx) / 2;
  frame.y_q12 += (middle(y) >> reduction_log2) - (kSide - 1) * (ay + by) / 2;
  frame.ax_q12 += ax;
  frame.ay_q12 += ay;
  frame.bx_q12 += bx;
  frame.by_q12 += by;
  return true;
}

// Between pixels in 1/256: coarser steps show at the dots' rims as relief. Range: 12 bits times 2^16 stay below 2^28.
void sample(const Reduced& picture, const PatchPlace& f, Samples& out) {
  for (std::size_t i = 0; i < kPlaces.size(); ++i) {
    const std::int32_t x = f.x_q12 + kPlaces[i].a * f.ax_q12 + kPlaces[i].b * f.bx_q12;
    const std::int32_t y = f.y_q12 + kPlaces[i].a * f.ay_q12 + kPlaces[i].b * f.by_q12;
    const std::uint16_t* from = picture.pixels.data() + std::ptrdiff_t{y >> 12} * picture.width + (x >> 12);
    const std::int32_t fx = (x >> 4) & 255, fy = (y >> 4) & 255;
    const std::int32_t upper = from[0] * (256 - fx) + from[1] * fx;
    const std::int32_t lower = from[picture.width] * (256 - fx) + from[picture.width + 1] * fx;
    out[i] = static_cast<std::int16_t>((upper * (256 - fy) + lower * fy + (1 << 15)) >> 16);
  }
}

// The empty gel's patch, 16 x luma.
Samples rounded(const std::array<std::uint16_t, kFree>& empty_q4) {
  Samples samples{};
  for (std::size_t i = 0; i < samples.size(); ++i) samples[i] = static_cast<std::int16_t>((empty_q4[i] + 8) >> 4);
  return samples;
}

// What lies on it.
Samples over_empty(const Samples& now, const std::array<std::uint16_t, kFree>& empty_q4) {
  Samples c = rounded(empty_q4);
  for (std::size_t i = 0; i < c.size(); ++i) c[i] = static_cast<std::int16_t>(now[i] - c[i]);
  return c;
}

// Its gradient energy, kPairs times. Range: differences of 12 bits and a sign, twice.
std::uint32_t relief_of(const Samples& c) {
  std::uint32_t sum = 0;
  for (const Pair& pair : kNeighbours) {
    const std::int32_t slope = c[pair.second] - c[pair.first];
    sum += static_cast<std::uint32_t>(slope * slope);
  }
  return sum;
}

// The empty gel shows so much of its own that a little less than perfect tracking would pass for a relief. Range:
// slopes of 16 bits and a sign, twice 17 of them.
bool is_marked(const std::array<std::uint16_t, kFree>& empty_q4, const Config& config) {
  std::int64_t sum = 0;
  for (const Pair& pair : kNeighbours) sum += square(empty_q4[pair.second] - empty_q4[pair.first]);
  return sum > std::int64_t{kPairs} * config.most_print * 256 * 256;
}

// Mean square about the mean, kFree^2 times. Range: 25 * 25 * 4080^2 = 1.1e10.
std::int64_t change_of(const Samples& now, const Samples& then) {
  std::int32_t sum = 0, squares = 0;
  for (std::size_t i = 0; i < now.size(); ++i) {
    const std::int32_t r = now[i] - then[i];
    sum += r;
    squares += r * r;
  }
  return std::int64_t{kFree} * squares - square(sum);
}

// --- Evidence ---

const Kept* picture_before(const State& state, Micros now) {
  const Kept* best = nullptr;
  Micros off = kLag / 3;
  for (int back = 0; back < state.count; ++back) {
    const Kept& kept = state.kept[idx((state.newest + kKept - back) % kKept)];
    const Micros late = now - kept.at - kLag;
    const Micros distance = late < Micros{0} ? -late : late;
    if (distance > off) continue;
    off = distance;
    best = &kept;
  }
  return best;
}

// Relief of a patch above which something is pressed into it.
std::int64_t threshold_of(const State& state, const Config& config) {
  const std::int64_t floor = std::int64_t{kPairs} * config.contact_floor_q8;
  if (state.empty.frames <= kNoiseAfter) return 2 * floor;
  return std::max(floor, state.empty.noise_relief * config.contact_over_noise_q4 / 16);
}

// The patch among kSlope's weights, along the axes of the patch. Range: 25 weights of up to 4 on 12 bits.
template <typename Value>
std::int32_t slope_of(const std::array<std::int8_t, kFree>& weights, const std::array<Value, kFree>& samples) {
  std::int32_t sum = 0;
  for (std::size_t i = 0; i < weights.size(); ++i) sum += weights[i] * samples[i];
  return sum;
}

// One patch in two pictures.
struct Seen {
  std::int32_t patch = 0;
  std::uint32_t now = 0;    // kPairs G
  std::uint32_t then = 0;   // kPairs G, one lag ago
  std::int32_t weight = 0;  // 68 g: of both, in 1/68 levels^2. At most 2^25.1
  std::int32_t change = 0;  // 625 R, in 1/625 levels^2. At most 2^25.4
};
constexpr int kWeightShift = 7, kChangeShift = 8;
constexpr std::int64_t kWeightUnit = (2 * kPairs * 256) >> kWeightShift;     // 68
constexpr std::int64_t kChangeUnit = (kFree * kFree * 256) >> kChangeShift;  // 625
static_assert(kWeightUnit == 68 && kChangeUnit == 625);

// 0.2 levels^4 a patch, in squares of the weights' unit.
constexpr std::int64_t kRegularisation = kWeightUnit * kWeightUnit / 5;
// A relief is there when its mean square exceeds that of the empty gel's noise by 0.1 levels^4.
constexpr std::int64_t kFloor = kWeightUnit * kWeightUnit / 10;

// Those in which least is pressed, which come first. Range: at least kLeastPatches; reorders them.
std::span<Seen> least_of(std::span<Seen> seen) {
  const auto by_weight = [](const Seen& a, const Seen& b) { return a.weight < b.weight; };
  const std::size_t quiet = seen.size() * 2 / 5;
  std::nth_element(seen.begin(), seen.begin() + static_cast<std::ptrdiff_t>(quiet), seen.end(), by_weight);
  return seen.first(quiet);
}

// What changed there; reorders them.
std::int32_t noise_of(std::span<Seen> least) {
  const auto at = least.begin() + static_cast<std::ptrdiff_t>((least.size() - 1) * 3 / 4);
  std::nth_element(least.begin(), at, least.end(), [](const Seen& a, const Seen& b) { return a.change < b.change; });
  return at->change;
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
  std::array<coarse::Patch, kMaxPatches> patches;  // NOLINT: filled as far as it is read
  std::size_t count = 0;
  for (const Seen& one : seen) {
    const std::size_t k = idx(one.patch);
    const Corner corner = corner_of(grid, one.patch);
    const Samples empty = rounded(state.empty.samples_q4[k]);
    const auto both = [&](const std::array<std::int8_t, kFree>& weights) {
      return slope_of(weights, state.last.samples[k]) + slope_of(weights, then.samples[k]);
    };
    coarse::Patch& patch = patches[count++];
    patch.change = state.last.shading[k] - then.shading[k];
    patch.shading = state.last.shading[k] + then.shading[k];
    const std::int32_t empty_a = slope_of(kSlope.a, empty), empty_b = slope_of(kSlope.b, empty);
    patch.slope_x = corner.sx * (both(kSlope.a) - 2 * empty_a);
    patch.slope_y = corner.sy * (both(kSlope.b) - 2 * empty_b);
    patch.empty_x = corner.sx * empty_a;
    patch.empty_y = corner.sy * empty_b;
    // From the lattice's middle.
    patch.x = 4 * (corner.own % grid.cols) + corner.sx - 2 * (grid.cols - 1);
    patch.y = 4 * (corner.own / grid.cols) + corner.sy - 2 * (grid.rows - 1);
  }
  return coarse::motion(std::span(patches).first(count), carried, step_q8, saturations);
}

// Mean displacement of the markers, each at most two pitches along an axis: no gel goes further (1.1 of them is the
// most on the recordings), and one marker that jumps must not say that all did. Range: 128 times 2^17, times 2^16 um,
// stay below 2^41.
void carry(const MarkerField& markers, const MarkerField& rest, PixelsQ8 pitch, std::int32_t pitch_um, Kept& out) {
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
  const std::int64_t all = std::max<std::int64_t>(n * pitch.raw(), 1);
  out.carried_x_um = static_cast<std::int32_t>(div_round(x * pitch_um, all));
  out.carried_y_um = static_cast<std::int32_t>(div_round(y * pitch_um, all));
}

// Half of the way that the gel went between the two, squared. Range: ways of four pitches, 64 steps, along each axis.
coarse::Carried carried_between(const Kept& now, const Kept& then, std::int32_t pitch_um) {
  constexpr std::int64_t kSteps2_q10 = std::int64_t{kStepsPerPitch} * kStepsPerPitch * 1024 / 4;
  const std::int64_t way_um2 =
      square(now.carried_x_um - then.carried_x_um) + square(now.carried_y_um - then.carried_y_um);
  return {div_round(way_um2 * kSteps2_q10, square(pitch_um))};
}

// Range, of 320 patches: weights of 2^25.1 and changes of 2^25.4 make sums below 2^59.
void compare(const State& state, const Kept& then, const Config& config, GridSize grid, ImprintFeatures& out,
             Saturations& saturations) {
  const Kept& last = state.last;
  std::array<Seen, kMaxPatches> both;  // NOLINT: filled as far as it is read
  std::size_t count = 0;
  for (std::int32_t p = 0; p < patches_of(grid); ++p) {
    if (!last.seen[idx(p)] || !then.seen[idx(p)]) continue;
    const std::uint32_t a = last.relief[idx(p)], b = then.relief[idx(p)];
    both[count++] = {p, a, b, static_cast<std::int32_t>((std::uint64_t{a} + b) >> kWeightShift),
                     static_cast<std::int32_t>(change_of(last.samples[idx(p)], then.samples[idx(p)]) >> kChangeShift)};
  }
  if (count < kLeastPatches) return;
  const auto n = static_cast<std::int64_t>(count);
  const std::span<Seen> seen(both.data(), count);
  const std::span<Seen> least = least_of(seen);
  const std::int64_t noise = noise_of(least);
  std::int64_t evidence = 0, energy = 0, energy_now = 0, energy_then = 0;
  for (const Seen& one : seen) {
    evidence += one.weight * (one.change - noise);
    energy += square(one.weight);
    energy_now += square(one.now >> (kWeightShift - 1));
    energy_then += square(one.then >> (kWeightShift - 1));
  }
  const auto log_of = [](std::int64_t value) { return log2_q8(static_cast<std::uint64_t>(value)); };
  out.growth = Log2Q8::saturate(log_of(shading_energy(last, seen, least)) - log_of(shading_energy(then, seen, least)),
                                saturations);
  static_assert(kStepsPerPitch == 1 << 4);
  const std::int32_t step_q8 = log_of(config.pitch_um) - 4 * 256;
  const coarse::Carried carried = carried_between(last, then, config.pitch_um);
  out.coarse = coarse_motion(state, then, grid, seen, carried, step_q8, saturations);
  const std::int64_t floor = n * (kFloor + square(state.empty.noise_relief >> (kWeightShift - 1)));
  energy += n * kRegularisation;
  evidence -= coarse::explained(carried, energy, kChangeUnit, kWeightUnit);
  if (evidence <= 0 || energy_now < floor || energy_then < floor) return;

  const std::int32_t square_q8 = log_of(evidence) + log_of(kWeightUnit) - log_of(energy) - log_of(kChangeUnit);
  out.motion = Log2Q8::saturate(std::max(step_q8 + square_q8 / 2, 0), saturations);
}

// Into the mean of the empty gel: of all frames up to kEmptyMean, then fading.
void take_into(Empty& empty, std::int32_t patch, const Samples& now) {
  std::array<std::uint16_t, kFree>& mean_q4 = empty.samples_q4[idx(patch)];
  const bool first = !empty.learned[idx(patch)];
  for (std::size_t i = 0; i < now.size(); ++i) {
    const std::int32_t now_q4 = now[i] * 16;
    const std::int64_t step = first ? now_q4 - mean_q4[i] : div_round(now_q4 - mean_q4[i], empty.frames);
    mean_q4[i] = static_cast<std::uint16_t>(mean_q4[i] + step);
  }
  empty.learned[idx(patch)] = true;
}

void place(State& state, const LumaView& picture, const MarkerField& rest, PixelsQ8 pitch) {
  const bool placed = place_picture(state.picture, rest, pitch, picture);
  if (!placed) state.picture.width = 0;
  state.width = picture.width;
  state.height = picture.height;
  for (std::int32_t p = 0; p < patches_of(rest.grid); ++p) {
    state.frames[idx(p)] = placed ? frame_of(state.picture, rest, p) : PatchPlace{};
  }
  state.placed = true;
}

}  // namespace

void forget(State& state) {
  place_again(state);
  state.empty.learned.fill(false);
  state.empty.marked.fill(false);
  state.empty.frames = 0;
  state.empty.noise_relief = 0;
  state.count = 0;
}

ImprintFeatures update(State& state, const Config& config, const LumaView& picture, const MarkerField& markers,
                       const MarkerField& rest, PixelsQ8 pitch, Micros now, Saturations& saturations) {
  ImprintFeatures out{};
  if (!state.placed || picture.width != state.width || picture.height != state.height) {
    place(state, picture, rest, pitch);
  }
  // Another stream may count its time from another start.
  if (state.count > 0 && now <= state.kept[idx(state.newest)].at) state.count = 0;
  Kept& last = state.last;
  last.at = now;
  carry(markers, rest, pitch, config.pitch_um, last);
  last.seen.fill(false);
  state.in_view.fill(false);
  if (state.picture.width == 0) return out;

  reduce(state.picture, picture);
  const std::int64_t threshold = threshold_of(state, config);
  std::int32_t in_contact = 0;
  const std::int32_t patches = patches_of(rest.grid);
  for (std::int32_t p = 0; p < patches; ++p) {
    PatchPlace frame = state.frames[idx(p)];
    if (!frame.usable || !follow(markers, rest, p, state.picture.reduction_log2, frame)) continue;
    if (!inside(state.picture, frame)) continue;
    Samples& samples = last.samples[idx(p)];
    sample(state.picture, frame, samples);
    state.in_view[idx(p)] = true;
    if (!state.empty.learned[idx(p)] || state.empty.marked[idx(p)]) continue;
    last.seen[idx(p)] = true;
    const Samples c = over_empty(samples, state.empty.samples_q4[idx(p)]);
    last.relief[idx(p)] = relief_of(c);
    last.shading[idx(p)] = std::accumulate(c.begin(), c.end(), std::int32_t{0});
    if (last.relief[idx(p)] > threshold) ++in_contact;
  }
  out.patches = Count::from_raw(in_contact);
  if (const Kept* const then = picture_before(state, now); then != nullptr) {
    compare(state, *then, config, rest.grid, out, saturations);
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
  for (std::int32_t p = 0; p < kMaxPatches; ++p) {
    if (!state.in_view[idx(p)]) continue;
    if (state.last.seen[idx(p)]) {
      reliefs += state.last.relief[idx(p)];
      ++seen;
    }
    take_into(empty, p, state.last.samples[idx(p)]);
    empty.marked[idx(p)] = is_marked(empty.samples_q4[idx(p)], config);
  }
  if (seen > 0 && empty.frames > kNoiseAfter) {
    empty.noise_relief += div_round(reliefs / seen - empty.noise_relief, empty.frames - kNoiseAfter);
  }
}

}  // namespace holdfast::imprint
