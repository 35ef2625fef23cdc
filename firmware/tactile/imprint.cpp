// SPDX-License-Identifier: Apache-2.0
#include "tactile/imprint.hpp"

#include <algorithm>

#include "base/math.hpp"

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
  return kPatchesPerDot * (dots <= kMaxDots ? dots : dots / 2);
}

Corner corner_of(GridSize grid, std::int32_t patch) {
  const std::int32_t own = patch / kPatchesPerDot * (grid.count() <= kMaxDots ? 1 : 2);
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
bool inside(const Reduced& picture, const Frame& f, std::int32_t dx_q12, std::int32_t dy_q12) {
  for (const std::int32_t a : {0, kSide - 1}) {
    for (const std::int32_t b : {0, kSide - 1}) {
      if (!inside(picture, f.x_q12 + dx_q12 + a * f.ax_q12 + b * f.bx_q12,
                  f.y_q12 + dy_q12 + a * f.ay_q12 + b * f.by_q12)) {
        return false;
      }
    }
  }
  return true;
}

// Steps along a lattice link of the dot: towards the patch, or away from it at the lattice's edge.
Frame frame_of(const Reduced& picture, const MarkerField& rest, std::int32_t patch) {
  const Corner corner = corner_of(rest.grid, patch);
  const Marker& own = rest.markers[idx(corner.own)];
  const std::int32_t beside = corner.beside != corner.own ? corner.beside : corner.own - corner.sx;
  const std::int32_t over = corner.over != corner.own ? corner.over : corner.own - corner.sy * rest.grid.cols;
  Frame out;
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
  out.usable = inside(picture, out, 0, 0);
  return out;
}

// The four dots around a patch, and what each counts for at its middle, a quarter of the way to each neighbour.
// Sixteenths.
std::array<std::int32_t, 4> dots_of(const Corner& corner) {
  return {corner.own, corner.beside, corner.over, corner.across};
}
constexpr std::array<std::int32_t, 4> kWeights{9, 3, 3, 1};

// Displacement of a patch's middle. false: one of its dots is lost.
bool displacement_q12(const MarkerField& now, const MarkerField& rest, std::int32_t patch, std::int32_t reduction_log2,
                      std::int32_t& dx_q12, std::int32_t& dy_q12) {
  const std::array<std::int32_t, 4> dots = dots_of(corner_of(rest.grid, patch));
  std::int32_t x = 0, y = 0;
  for (std::size_t k = 0; k < dots.size(); ++k) {
    const Marker& to = now.markers[idx(dots[k])];
    const Marker& from = rest.markers[idx(dots[k])];
    if (!to.valid || !from.valid) return false;
    x += kWeights[k] * (to.x.raw() - from.x.raw());
    y += kWeights[k] * (to.y.raw() - from.y.raw());
  }
  dx_q12 = x >> reduction_log2;  // sixteenths of Q8 are Q12
  dy_q12 = y >> reduction_log2;
  return true;
}

// Between pixels in 1/256: coarser steps show at the dots' rims as relief. Range: 12 bits times 2^16 stay below 2^28.
void sample(const Reduced& picture, const Frame& f, std::int32_t dx_q12, std::int32_t dy_q12, Samples& out) {
  for (std::size_t i = 0; i < kPlaces.size(); ++i) {
    const std::int32_t x = f.x_q12 + dx_q12 + kPlaces[i].a * f.ax_q12 + kPlaces[i].b * f.bx_q12;
    const std::int32_t y = f.y_q12 + dy_q12 + kPlaces[i].a * f.ay_q12 + kPlaces[i].b * f.by_q12;
    const std::uint16_t* from = picture.pixels.data() + std::ptrdiff_t{y >> 12} * picture.width + (x >> 12);
    const std::int32_t fx = (x >> 4) & 255, fy = (y >> 4) & 255;
    const std::int32_t upper = from[0] * (256 - fx) + from[1] * fx;
    const std::int32_t lower = from[picture.width] * (256 - fx) + from[picture.width + 1] * fx;
    out[i] = static_cast<std::int16_t>((upper * (256 - fy) + lower * fy + (1 << 15)) >> 16);
  }
}

// Gradient energy of what lies on the empty gel, kPairs times. Range: differences of 12 bits and a sign, twice.
std::uint32_t relief_of(const Samples& now, const std::array<std::uint16_t, kFree>& empty_q4) {
  Samples c{};
  for (std::size_t i = 0; i < c.size(); ++i) c[i] = static_cast<std::int16_t>(now[i] - ((empty_q4[i] + 8) >> 4));
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

// --- Motion ---

// Mean square of how the motion of a patch's dots since then differs from its middle's: in steps between samples, Q12,
// at most half a pitch's. Both pictures have shown the patch, so its dots are there. Range: dots 2^21 apart, so squares
// of 2^43 and a spread below 2^51; what is shifted is below 64 pitches squared, 2^46.
constexpr int kBend_q = 12;
constexpr std::int64_t kMostBend = square(kStepsPerPitch / 2) << kBend_q;
std::int64_t bend(const MarkerField& now, const MarkerField& then, std::int32_t patch, std::int64_t pitch_q8) {
  const std::array<std::int32_t, 4> dots = dots_of(corner_of(now.grid, patch));
  std::int64_t x = 0, y = 0, squares = 0;
  for (std::size_t k = 0; k < dots.size(); ++k) {
    const Marker& to = now.markers[idx(dots[k])];
    const Marker& from = then.markers[idx(dots[k])];
    const std::int32_t dx = to.x.raw() - from.x.raw(), dy = to.y.raw() - from.y.raw();
    x += std::int64_t{kWeights[k]} * dx;
    y += std::int64_t{kWeights[k]} * dy;
    squares += kWeights[k] * (square(dx) + square(dy));
  }
  // 256 times the mean square, by the square of 16 steps.
  static_assert(kStepsPerPitch == 16);
  const std::int64_t spread = 16 * squares - x * x - y * y;
  const std::int64_t pitch2 = pitch_q8 * pitch_q8;
  return spread >= pitch2 * (kMostBend >> kBend_q) ? kMostBend : div_round(spread << kBend_q, pitch2);
}

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

// Relief of a patch above which something is pressed into it.
std::int64_t threshold_of(const State& state, const Config& config) {
  const std::int64_t floor = std::int64_t{kPairs} * config.contact_floor_q8;
  if (state.empty.frames <= kNoiseAfter) return 2 * floor;
  return std::max(floor, state.empty.noise_relief * config.contact_over_noise_q4 / 16);
}

// What keeps a few weak patches from showing noise as motion: of the whole contact as much as a relief of 1.2 levels^2
// in one patch, and 0.12 levels^2 in each. Twice, as two reliefs are added.
constexpr std::int64_t kLeastRelief = std::int64_t{2} * kPairs * 256 * 12 / 10;
constexpr std::int64_t kLeastReliefPerPatch = std::int64_t{2} * kPairs * 256 * 12 / 100;

// log2 of motion in um: R = change / kFree^2, G = relief / (2 kPairs). Range, of 320 patches: 0 < change < 2^42, relief
// < 2^41; times 34 and 625 below 2^51.
std::int64_t motion_log2_q8(std::int64_t change, std::int64_t relief, std::int32_t pitch_um) {
  const std::int32_t ratio_q8 =
      log2_q8(static_cast<std::uint64_t>(change) * (2 * kPairs)) -
      log2_q8(static_cast<std::uint64_t>(std::max<std::int64_t>(relief, 1)) * (kFree * kFree));
  const std::int32_t step_q8 = log2_q8(static_cast<std::uint64_t>(pitch_um)) - 4 * 256;
  static_assert(kStepsPerPitch == 1 << 4);
  return std::max(step_q8 + ratio_q8 / 2, 0);
}

// Into the mean of the empty gel: of all frames up to kEmptyMean, then fading.
void learn(State& state, std::int32_t patch, const Samples& now) {
  std::array<std::uint16_t, kFree>& mean_q4 = state.empty.samples_q4[idx(patch)];
  const bool first = !state.empty.learned[idx(patch)];
  for (std::size_t i = 0; i < now.size(); ++i) {
    const std::int32_t now_q4 = now[i] * 16;
    const std::int64_t step = first ? now_q4 - mean_q4[i] : div_round(now_q4 - mean_q4[i], state.empty.frames);
    mean_q4[i] = static_cast<std::uint16_t>(mean_q4[i] + step);
  }
  state.empty.learned[idx(patch)] = true;
}

void place(State& state, const LumaView& picture, const MarkerField& rest, PixelsQ8 pitch) {
  const bool placed = place_picture(state.picture, rest, pitch, picture);
  if (!placed) state.picture.width = 0;
  state.width = picture.width;
  state.height = picture.height;
  for (std::int32_t p = 0; p < patches_of(rest.grid); ++p) {
    state.frames[idx(p)] = placed ? frame_of(state.picture, rest, p) : Frame{};
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
  state.empty.noise_motion.fill(0);
  state.empty.noise_frames.fill(0);
  state.count = 0;
}

ImprintFeatures update(State& state, const Config& config, const LumaView& picture, const MarkerField& markers,
                       const MarkerField& rest, PixelsQ8 pitch, bool empty, Micros now, Saturations& saturations) {
  ImprintFeatures out{};
  if (!state.placed || picture.width != state.width || picture.height != state.height) {
    place(state, picture, rest, pitch);
  }
  // Another stream may count its time from another start.
  if (state.count > 0 && now <= state.kept[idx(state.newest)].at) state.count = 0;
  Kept& last = state.last;
  last.at = now;
  last.markers = markers;
  last.seen.fill(false);
  if (state.picture.width == 0) return out;

  reduce(state.picture, picture);
  const std::int64_t threshold = threshold_of(state, config);
  if (empty) state.empty.frames = std::min(state.empty.frames + 1, kEmptyMean);
  std::int64_t reliefs_seen = 0;
  std::int32_t in_contact = 0, patches_seen = 0;
  const std::int32_t patches = patches_of(rest.grid);
  for (std::int32_t p = 0; p < patches; ++p) {
    const Frame& frame = state.frames[idx(p)];
    std::int32_t dx_q12 = 0, dy_q12 = 0;
    if (!frame.usable || !displacement_q12(markers, rest, p, state.picture.reduction_log2, dx_q12, dy_q12)) continue;
    if (!inside(state.picture, frame, dx_q12, dy_q12)) continue;
    Samples& samples = last.samples[idx(p)];
    sample(state.picture, frame, dx_q12, dy_q12, samples);
    last.relief[idx(p)] = state.empty.learned[idx(p)] ? relief_of(samples, state.empty.samples_q4[idx(p)]) : 0;
    if (empty) {
      learn(state, p, samples);
      state.empty.marked[idx(p)] = is_marked(state.empty.samples_q4[idx(p)], config);
    }
    if (state.empty.marked[idx(p)]) continue;
    last.seen[idx(p)] = true;
    if (last.relief[idx(p)] > threshold) ++in_contact;
    reliefs_seen += last.relief[idx(p)];
    ++patches_seen;
  }
  if (empty && patches_seen > 0 && state.empty.frames > kNoiseAfter) {
    state.empty.noise_relief +=
        div_round(reliefs_seen / patches_seen - state.empty.noise_relief, state.empty.frames - kNoiseAfter);
  }
  out.patches = Count::from_raw(in_contact);

  const std::array<Log2Q8*, kLags.size()> motions{&out.motion_short, &out.motion, &out.motion_long};
  for (std::size_t k = 0; k < kLags.size(); ++k) {
    const Kept* const then = picture_before(state, now, kLags[k]);
    if (then == nullptr) continue;
    std::int64_t change = 0, relief = 0, bent = 0, all = 0;
    std::int32_t pressed = 0, seen = 0;
    for (std::int32_t p = 0; p < patches; ++p) {
      if (!last.seen[idx(p)] || !then->seen[idx(p)]) continue;
      const std::int64_t r = change_of(last.samples[idx(p)], then->samples[idx(p)]);
      const std::int64_t reliefs = std::int64_t{last.relief[idx(p)]} + then->relief[idx(p)];
      all += r;
      ++seen;
      if (reliefs <= 2 * threshold) continue;
      change += r;
      relief += reliefs;
      bent += reliefs * bend(markers, then->markers, p, pitch.raw());
      ++pressed;
    }
    if (empty && seen > 0) {
      state.empty.noise_frames[k] = std::min(state.empty.noise_frames[k] + 1, kEmptyMean);
      state.empty.noise_motion[k] += div_round(all / seen - state.empty.noise_motion[k], state.empty.noise_frames[k]);
    }
    if (pressed < config.least_patches) continue;
    change -= pressed * state.empty.noise_motion[k];
    // Range: reliefs of 2^32 times bends of 2^18, none negative, of 320 patches, stay below 2^59.
    if (change <= bent / (std::int64_t{2} * kPairs << kBend_q) * (kFree * kFree)) continue;
    relief += kLeastRelief + pressed * (kLeastReliefPerPatch - 2 * state.empty.noise_relief);
    *motions[k] = Log2Q8::saturate(motion_log2_q8(change, relief, config.pitch_um), saturations);
  }

  if (state.count == 0 || now - state.kept[idx(state.newest)].at >= kKeepEvery) {
    state.newest = (state.newest + 1) % kKept;
    state.count = std::min(state.count + 1, kKept);
    state.kept[idx(state.newest)] = last;
  }
  return out;
}

}  // namespace holdfast::imprint
