// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/scene/picture/render.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "drivers/sim/scene/math/portable.hpp"
#include "drivers/sim/scene/math/random.hpp"

namespace holdfast::scene {
namespace {

// --- Noise ---

constexpr std::size_t kTileSize = std::size_t{1} << 18;

using NoiseTile = std::array<std::int16_t, kTileSize>;

// Normal numbers in Q12. The sum of 12 uniforms of 16 bits has a sigma of 65536 and a mean of 393210.
void fill(NoiseTile& tile) {
  Random random(0x686f6c6466617374u);
  for (std::int16_t& normal : tile) {
    std::int32_t sum = -393210;
    for (int draw = 0; draw < 3; ++draw) {
      const std::uint64_t bits = random.next();
      for (int k = 0; k < 64; k += 16) sum += static_cast<std::int32_t>((bits >> k) & 0xffff);
    }
    normal = static_cast<std::int16_t>(sum >> 4);
  }
}

// Filled once, about 2 ms; half a megabyte that is nobody's heap.
const NoiseTile& noise_tile() {
  static NoiseTile tile;
  [[maybe_unused]] static const bool filled = (fill(tile), true);
  return tile;
}

// Levels in Q8 plus an offset and noise, rounded and clamped. Range: |level|, |offset| < 2^22, sigma <= 64: products
// below 2^29.
void finish(const std::int32_t* level_q8, std::int32_t offset_q8, const std::int16_t* normal_q12, std::int32_t sigma_q8,
            std::size_t count, std::uint8_t* out) {
  for (std::size_t i = 0; i < count; ++i) {
    const std::int32_t noise_q8 = (normal_q12[i] * sigma_q8 + (1 << 11)) >> 12;
    out[i] = static_cast<std::uint8_t>(std::clamp((level_q8[i] + noise_q8 + offset_q8 + 128) >> 8, 0, 255));
  }
}

// --- Light ---

// How one channel sees the light: tint of the middle and the direction towards its lamp.
struct Channel {
  double tint;
  double lamp_x;
  double lamp_y;
};

// Lamps 120 degrees apart: red below, green left, blue above. Tints as in the middle of a real empty frame
// (115, 117, 157); their luma is 0.
constexpr std::array<Channel, 3> kRgb{{{-6.0, 0.5, 0.866}, {-4.0, -1.0, 0.0}, {36.34, 0.5, -0.866}}};

constexpr std::array<double, 3> kBt601{0.299, 0.587, 0.114};

constexpr Channel luma_of(const std::array<Channel, 3>& rgb) {
  Channel luma{0.0, 0.0, 0.0};
  for (std::size_t i = 0; i < rgb.size(); ++i) {
    luma.tint += kBt601[i] * rgb[i].tint;
    luma.lamp_x += kBt601[i] * rgb[i].lamp_x;
    luma.lamp_y += kBt601[i] * rgb[i].lamp_y;
  }
  return luma;
}

constexpr std::array<Channel, 1> kLuma{{luma_of(kRgb)}};

// Shares of PictureConfig::shading. Luma sees 0.41 of a lamp's gradient (the three nearly cancel).
constexpr double kLampShare = 1.0;
constexpr double kFalloffShare = 0.7;

std::int32_t to_q8(double level) {
  return static_cast<std::int32_t>(std::lround(level * 256.0));
}

// Light that falls on one column (axis 0) or row (axis 1): the field is their sum, so a row of the picture
// costs one addition per sample. Falloff is centred so that its mean over the picture is 0.
double light(const PictureConfig& config, const Channel& channel, int axis, int position) {
  if (config.shading == 0.0) return 0.0;
  const double half = 0.5 * (axis == 0 ? config.width : config.height);
  const double u = (position + 0.5) / half - 1.0;
  const double lamp = axis == 0 ? channel.lamp_x : channel.lamp_y;
  return config.shading * (kLampShare * lamp * u - kFalloffShare * (u * u - 1.0 / 3.0));
}

// --- Rows ---

// The pixels of one row within `reach` of a point; first > last when there are none, wherever the point lies.
struct Chord {
  int first = 0;
  int last = -1;
  double dy = 0.0;
};

Chord chord_of(PointPx center, double reach, int y, int width) {
  const double dy = y - center.y;
  if (!(std::abs(dy) < reach) || !(center.x > -reach && center.x < width + reach)) return {};
  const double half = std::sqrt(reach * reach - dy * dy);
  return {static_cast<int>(std::ceil(std::max(0.0, center.x - half))),
          static_cast<int>(std::floor(std::min(width - 1.0, center.x + half))), dy};
}

// Times of a frame as shares of it: 0 = the first row's exposure starts, 1 = the last row's ends.
struct Shutter {
  double row_share = 0.0;  // from the start of a row to that of the next
  double exposure_share = 0.0;

  explicit Shutter(const PictureConfig& config) {
    const PictureEffects& e = config.effects;
    const double whole_ms = e.exposure_ms + e.rolling_shutter_ms;
    if (!(whole_ms > 0.0)) return;
    exposure_share = e.exposure_ms / whole_ms;
    if (config.height > 1) row_share = e.rolling_shutter_ms / whole_ms / (config.height - 1);
  }
  [[nodiscard]] double middle(int y) const { return row_share * y + 0.5 * exposure_share; }
};

double between(double from, double to, double share) {
  return from == to ? from : from + share * (to - from);
}

PointPx between(PointPx from, PointPx to, double share) {
  return {between(from.x, to.x, share), between(from.y, to.y, share)};
}

Imprint between(const Imprint& from, const Imprint& to, double share) {
  return {between(from.center, to.center, share),       between(from.radius_px, to.radius_px, share),
          between(from.rim_slope, to.rim_slope, share), between(from.object, to.object, share),
          between(from.turn_rad, to.turn_rad, share),   between(from.depth_mm, to.depth_mm, share)};
}

// Slope of the bulge over its rim slope and the distance from its middle: r/a inside, (2 - r/a)^2 outside, then 0.
float bulge_slope(float r, float radius) {
  const float fade = std::max(0.0f, 2.0f - r / radius);
  return r <= radius ? 1.0f / radius : fade * fade / r;
}

// Adds the imprint to a row.
template <std::size_t kChannels>
void add_imprint(const PictureConfig& config, const std::array<Channel, kChannels>& channels, const Imprint& contact,
                 int y, std::vector<std::int32_t>& row) {
  const Chord chord = chord_of(contact.center, 2.0 * contact.radius_px, y, config.width);
  const float radius = static_cast<float>(contact.radius_px);
  const float gain = static_cast<float>(256.0 * config.imprint_gain * contact.rim_slope);
  const float dy = static_cast<float>(chord.dy);
  std::array<float, kChannels> lamp_x{};
  std::array<float, kChannels> lamp_y{};
  for (std::size_t c = 0; c < kChannels; ++c) {
    lamp_x[c] = static_cast<float>(channels[c].lamp_x);
    lamp_y[c] = static_cast<float>(channels[c].lamp_y);
  }
  for (int x = chord.first; x <= chord.last; ++x) {
    const float dx = static_cast<float>(x - contact.center.x);
    const float slope = bulge_slope(std::sqrt(dx * dx + dy * dy), radius);
    for (std::size_t c = 0; c < kChannels; ++c) {
      row[static_cast<std::size_t>(x) * kChannels + c] +=
          static_cast<std::int32_t>(gain * slope * (dx * lamp_x[c] + dy * lamp_y[c]));
    }
  }
}

// --- What lies under the gel ---

// Slopes of one row, where they are not 0, and the instants at which its exposure sees them.
struct Slopes {
  std::vector<float> x;
  std::vector<float> y;
  int instants = 1;
  int first = 0;
  int last = -1;

  void widen(int from, int to) {
    if (to < from) return;
    first = last < first ? from : std::min(first, from);
    last = std::max(last, to);
  }
  void clear() {
    for (int i = first; i <= last; ++i) x[static_cast<std::size_t>(i)] = y[static_cast<std::size_t>(i)] = 0.0F;
    first = 0;
    last = -1;
  }
};

// One for each rim's softness of the way, which is less than a relief shows: a quarter of its period is the least that
// the lens lets through.
constexpr int kMostSights = 16;

int sights(const PictureConfig& config, const Shutter& shutter, const Imprint& from, const Imprint& to) {
  const double turn_px = std::abs(to.turn_rad - from.turn_rad) * std::max(from.radius_px, to.radius_px);
  const double way_px = portable::hypot(to.object.x - from.object.x, to.object.y - from.object.y) + turn_px;
  const double count = std::ceil(shutter.exposure_share * way_px / config.edge_softness_px);
  return static_cast<int>(std::clamp(count, 1.0, static_cast<double>(kMostSights)));
}

template <std::size_t kChannels>
void add_underside(const PictureConfig& config, const std::array<Channel, kChannels>& channels, const Shutter& shutter,
                   const Underside& underside, const Imprint& from, const Imprint& to, int y, Slopes& slopes,
                   std::vector<std::int32_t>& row) {
  const double mm_per_px = 1.0 / config.px_per_mm;
  const Underside::Row places{-config.center_x_px * mm_per_px, (y - config.center_y_px) * mm_per_px, mm_per_px};
  for (int k = 0; k < slopes.instants; ++k) {
    const double share = shutter.row_share * y + shutter.exposure_share * ((k + 0.5) / slopes.instants);
    const Imprint now = between(from, to, share);
    const Underside::Pose press{
        {(now.object.x - config.center_x_px) * mm_per_px, (now.object.y - config.center_y_px) * mm_per_px},
        now.turn_rad,
        now.depth_mm,
        now.radius_px * mm_per_px};
    const auto columns =
        underside.add_row(press, places, 1.0F / static_cast<float>(slopes.instants), slopes.x, slopes.y);
    slopes.widen(columns.first, columns.last);
  }
  const auto gain = static_cast<float>(256.0 * config.imprint_gain);
  for (int x = slopes.first; x <= slopes.last; ++x) {
    const auto column = static_cast<std::size_t>(x);
    for (std::size_t c = 0; c < kChannels; ++c) {
      row[column * kChannels + c] +=
          static_cast<std::int32_t>(gain * (slopes.x[column] * static_cast<float>(channels[c].lamp_x) +
                                            slopes.y[column] * static_cast<float>(channels[c].lamp_y)));
    }
  }
}

// --- Walls ---

constexpr float kMirrorSlope = 0.3F;
constexpr float kMirrorReach = 0.25F;
constexpr float kShadowSlope = 0.1F;
constexpr float kShadowEdge = 0.04F;

// What one lamp adds to a wall, beyond the imprint.
float wall_light(const Walls& walls, const Channel& lamp, float slope_x, float slope_y) {
  const auto lamp_x = static_cast<float>(lamp.lamp_x);
  const auto lamp_y = static_cast<float>(lamp.lamp_y);
  const float facing = slope_x * lamp_x + slope_y * lamp_y;
  const float off_x = slope_x - kMirrorSlope * lamp_x;
  const float off_y = slope_y - kMirrorSlope * lamp_y;
  const float mirrors = std::max(0.0F, 1.0F - (off_x * off_x + off_y * off_y) / (kMirrorReach * kMirrorReach));
  const float away = std::clamp((-facing - kShadowSlope) / kShadowEdge + 0.5F, 0.0F, 1.0F);
  return static_cast<float>(walls.gain) * std::max(0.0F, facing) +
         static_cast<float>(walls.specular) * mirrors * mirrors -
         static_cast<float>(walls.shadow) * away * away * (3.0F - 2.0F * away);
}

// Adds them to a row: of the slopes that lie there and, of a sphere, of its bulge.
template <std::size_t kChannels>
void add_walls(const PictureConfig& config, const Imprint* bulge, int y, Slopes& slopes,
               std::vector<std::int32_t>& row) {
  if (bulge != nullptr) {
    const Chord chord = chord_of(bulge->center, 2.0 * bulge->radius_px, y, config.width);
    const auto dy = static_cast<float>(chord.dy);
    for (int x = chord.first; x <= chord.last; ++x) {
      const auto dx = static_cast<float>(x - bulge->center.x);
      const float slope = static_cast<float>(bulge->rim_slope) *
                          bulge_slope(std::sqrt(dx * dx + dy * dy), static_cast<float>(bulge->radius_px));
      slopes.x[static_cast<std::size_t>(x)] += slope * dx;
      slopes.y[static_cast<std::size_t>(x)] += slope * dy;
    }
    slopes.widen(chord.first, chord.last);
  }
  for (int x = slopes.first; x <= slopes.last; ++x) {
    const auto column = static_cast<std::size_t>(x);
    float luma = 0.0F;
    for (std::size_t c = 0; c < kRgb.size(); ++c) {
      const float light = 256.0F * wall_light(config.walls, kRgb[c], slopes.x[column], slopes.y[column]);
      if constexpr (kChannels == 1) {
        luma += static_cast<float>(kBt601[c]) * light;
      } else {
        row[column * kChannels + c] += static_cast<std::int32_t>(light);
      }
    }
    if constexpr (kChannels == 1) row[column] += static_cast<std::int32_t>(luma);
  }
}

// --- Discs: dots and dirt ---

// The rim rises like an edge behind a Gaussian blur; its 1 % and 99 % points lie one softness either side.
// A smooth rim is what makes the sampled centroid exact: at a softness of 1.3 px the spectrum left at one
// cycle per pixel is 0.002 here, 0.02 for a cubic smoothstep and 0.12 for a straight ramp.
constexpr double kSigmas = 2.326;
// Where the rim ends: 0.02 % of the contrast is left, far below a rounding step.
constexpr double kRimReach = 1.5;

// Share of a pixel that a disc covers, in Q15, from the outer end of the rim inwards. A step is 0.04 % of the
// softness, 0.03 % of the contrast: it moves a centroid by less than 0.0001 px.
constexpr int kRimSteps = 8192;
constexpr std::int32_t kCovered = 1 << 15;
using RimTable = std::array<std::uint16_t, kRimSteps + 1>;

void fill(RimTable& rim) {
  for (int step = 0; step <= kRimSteps; ++step) {
    const double inside = kRimReach * (2.0 * step / kRimSteps - 1.0);
    const double share = 0.5 * portable::erfc(-inside * (kSigmas / std::numbers::sqrt2));
    rim[static_cast<std::size_t>(step)] = static_cast<std::uint16_t>(std::lround(share * kCovered));
  }
}

// Filled once, 0.2 ms.
const RimTable& rim_table() {
  static RimTable rim;
  [[maybe_unused]] static const bool filled = (fill(rim), true);
  return rim;
}

struct Disc {
  PointPx from;
  PointPx to;
  double radius = 0.0;
  double contrast = 1.0;
  int first_row = 0;
  int last_row = -1;
  int instants = 1;  // at which a row's exposure sees it
};

// Sub-instants lie at most this many sigmas of the rim apart, which hides them (a ripple of exp(-2 pi^2 / 1.5^2),
// 0.02 % of the contrast) and makes the rim along the path a tenth of a sigma too sharp. More than the most of them
// (54 px of path at 320 columns) would show as stripes.
constexpr double kInstantSigmas = 1.5;
constexpr int kMostInstants = 64;

void place(const PictureConfig& config, const Shutter& shutter, Disc disc, std::vector<Disc>& discs) {
  const double reach = disc.radius + kRimReach * config.edge_softness_px;
  const double top = std::min(disc.from.y, disc.to.y) - reach;
  const double bottom = std::max(disc.from.y, disc.to.y) + reach;
  if (!(top < config.height) || !(bottom > -1.0)) return;  // nor when one of them is no number
  disc.first_row = static_cast<int>(std::ceil(std::max(top, 0.0)));
  disc.last_row = static_cast<int>(std::floor(std::min(bottom, config.height - 1.0)));
  const double path = shutter.exposure_share * portable::hypot(disc.to.x - disc.from.x, disc.to.y - disc.from.y);
  const double instants = std::ceil(path * kSigmas / (kInstantSigmas * config.edge_softness_px));
  if (instants > 1.0) disc.instants = static_cast<int>(std::min<double>(instants, kMostInstants));
  discs.push_back(disc);
}

// One row of coverage, summed over instants.
struct Coverage {
  std::vector<std::int32_t> share_q15;  // of each pixel
  std::vector<float> facing_x;          // of the rim: its share times the way outwards, for shading
  std::vector<float> facing_y;
  int first = 0;
  int last = -1;
};

// Adds one instant. Pixels within the rim's inner end are covered and need no distance; the others lie within the
// rim, so their step is one of the table's (the half step of rounding is far more than a chord's last bit).
template <bool kShaded>
void cover(const PictureConfig& config, const RimTable& rim, PointPx center, double radius, int y, Coverage& coverage) {
  const double rim_px = kRimReach * config.edge_softness_px;
  const double reach = radius + rim_px;
  const Chord outer = chord_of(center, reach, y, config.width);
  if (outer.last < outer.first) return;
  Chord inner = chord_of(center, radius - rim_px, y, config.width);
  if (inner.last < inner.first) inner = {outer.last + 1, outer.last, 0.0};
  std::int32_t* const share = coverage.share_q15.data();
  const double steps_per_px = kRimSteps / (2.0 * rim_px);
  const double dy2 = outer.dy * outer.dy;
  const auto rim_part = [&](int first, int last) {
    for (int x = first; x <= last; ++x) {
      const double dx = x - center.x;
      const double r = std::sqrt(dx * dx + dy2);
      const auto step = static_cast<std::size_t>(static_cast<int>((reach - r) * steps_per_px + 0.5));
      share[x] += rim[step];
      if constexpr (kShaded) {
        // 1 in the middle of the rim, 0 at its ends.
        const double rising = rim[step] / static_cast<double>(kCovered);
        const double weight = r > 0.0 ? 4.0 * rising * (1.0 - rising) / r : 0.0;
        coverage.facing_x[static_cast<std::size_t>(x)] += static_cast<float>(weight * dx);
        coverage.facing_y[static_cast<std::size_t>(x)] += static_cast<float>(weight * outer.dy);
      }
    }
  };
  rim_part(outer.first, inner.first - 1);
  for (int x = inner.first; x <= inner.last; ++x) share[x] += kCovered;
  rim_part(inner.last + 1, outer.last);
  coverage.first = std::min(coverage.first, outer.first);
  coverage.last = std::max(coverage.last, outer.last);
}

template <std::size_t kChannels>
void add_disc(const PictureConfig& config, const std::array<Channel, kChannels>& channels, const Shutter& shutter,
              const RimTable& rim, const Disc& disc, int y, Coverage& coverage, std::vector<std::int32_t>& row) {
  const bool shaded = config.effects.dot_shading > 0.0;
  coverage.first = config.width;
  coverage.last = -1;
  for (int k = 0; k < disc.instants; ++k) {
    const double share = shutter.row_share * y + shutter.exposure_share * ((k + 0.5) / disc.instants);
    const PointPx center = between(disc.from, disc.to, share);
    if (shaded) {
      cover<true>(config, rim, center, disc.radius, y, coverage);
    } else {
      cover<false>(config, rim, center, disc.radius, y, coverage);
    }
  }
  const std::int32_t dot_q8 = to_q8(config.dot_level);
  const std::int64_t weight_q16 = std::lround(65536.0 * disc.contrast / disc.instants);
  for (int x = coverage.first; x <= coverage.last; ++x) {
    const auto column = static_cast<std::size_t>(x);
    const std::int64_t share_q15 = (coverage.share_q15[column] * weight_q16 + (1 << 15)) >> 16;
    coverage.share_q15[column] = 0;
    for (std::size_t c = 0; c < kChannels; ++c) {
      std::int32_t& level = row[column * kChannels + c];
      level += static_cast<std::int32_t>((share_q15 * (dot_q8 - level) + (1 << 14)) >> 15);
    }
    if (!shaded) continue;
    const double gain_q8 = 256.0 * config.effects.dot_shading * disc.contrast / disc.instants;
    const double facing_x = gain_q8 * static_cast<double>(coverage.facing_x[column]);
    const double facing_y = gain_q8 * static_cast<double>(coverage.facing_y[column]);
    coverage.facing_x[column] = 0.0f;
    coverage.facing_y[column] = 0.0f;
    for (std::size_t c = 0; c < kChannels; ++c) {
      row[column * kChannels + c] +=
          static_cast<std::int32_t>(facing_x * channels[c].lamp_x + facing_y * channels[c].lamp_y);
    }
  }
}

// --- Wear and dirt: where PictureConfig::seed puts them ---

constexpr std::uint64_t kWearStream = 0x77656172u;
constexpr std::uint64_t kDirtStream = 0x64697274u;

// 0 .. 1.
double fraction(std::uint64_t bits) {
  return static_cast<double>(bits >> 11) * 0x1p-53;
}

// Smooth noise: random numbers on a square lattice, cubic between them. Range: |x|, |y| < 2^31.
double patches(std::uint64_t seed, double x, double y) {
  const double column = std::floor(x);
  const double line = std::floor(y);
  const auto corner = [&](double dx, double dy) {
    const auto i = static_cast<std::uint64_t>(static_cast<std::int64_t>(column + dx));
    const auto j = static_cast<std::uint64_t>(static_cast<std::int64_t>(line + dy));
    return fraction(Random(seed ^ (i * 0x9e3779b97f4a7c15u) ^ std::rotl(j * 0xd1342543de82ef95u, 32)).next());
  };
  const auto ease = [](double u) { return u * u * (3.0 - 2.0 * u); };
  const double u = ease(x - column);
  return between(between(corner(0, 0), corner(1, 0), u), between(corner(0, 1), corner(1, 1), u), ease(y - line));
}

// Contrast that a dot has left.
double worn_contrast(const PictureConfig& config, PointPx at) {
  if (!(config.effects.worn_gel > 0.0)) return 1.0;
  const double x_mm = (at.x - config.center_x_px) / config.px_per_mm;
  const double y_mm = (at.y - config.center_y_px) / config.px_per_mm;
  constexpr double kFar_mm = 1e6;  // nothing of it is in the picture
  if (!(std::abs(x_mm) < kFar_mm) || !(std::abs(y_mm) < kFar_mm)) return 1.0;
  constexpr double kPatchPlacemm = 5.0;
  constexpr double kDot_mm = 1.7;
  const std::uint64_t seed = config.seed ^ std::rotl(kWearStream, 32);
  const double wear = 0.6 * patches(seed, x_mm / kPatchPlacemm, y_mm / kPatchPlacemm) +
                      0.4 * patches(seed + 1, x_mm / kDot_mm, y_mm / kDot_mm);
  return 1.0 - config.effects.worn_gel * std::clamp((wear - 0.3) / 0.3, 0.0, 1.0);
}

void place_dirt(const PictureConfig& config, const Shutter& shutter, std::vector<Disc>& discs) {
  Random random(config.seed ^ std::rotl(kDirtStream, 32));
  for (int speck = 0; speck < config.effects.dirt_specks; ++speck) {
    Disc disc;
    disc.from.x = fraction(random.next()) * config.width - 0.5;
    disc.from.y = fraction(random.next()) * config.height - 0.5;
    disc.to = disc.from;
    disc.radius = (0.05 + 0.2 * fraction(random.next())) * config.px_per_mm;
    disc.contrast = 0.3 + 0.6 * fraction(random.next());
    place(config, shutter, disc, discs);
  }
}

// --- Margins ---

// Share of the light that reaches a column (axis 0) or row (axis 1), in Q12: 1 within the window, soft over a
// quarter of a millimetre at its edge.
std::int32_t window_q12(const PictureConfig& config, int axis, int position) {
  const double size_mm = axis == 0 ? config.effects.gel_width_mm : config.effects.gel_height_mm;
  if (!(size_mm > 0.0)) return 1 << 12;
  constexpr double kSoft_mm = 0.25;
  const double center = axis == 0 ? config.center_x_px : config.center_y_px;
  const double inside_mm = 0.5 * size_mm - std::abs(position - center) / config.px_per_mm;
  const double share = std::clamp(0.5 + inside_mm / kSoft_mm, 0.0, 1.0);
  return static_cast<std::int32_t>(std::lround(share * share * (3.0 - 2.0 * share) * (1 << 12)));
}

// Range: levels below 2^19, so products below 2^31.
template <std::size_t kChannels>
void darken_margin(const std::vector<std::int32_t>& window_columns, std::int32_t window_row, std::int32_t margin_q8,
                   std::vector<std::int32_t>& row) {
  for (std::size_t x = 0; x < window_columns.size(); ++x) {
    const std::int32_t share = (window_columns[x] * window_row) >> 12;
    for (std::size_t c = 0; c < kChannels; ++c) {
      std::int32_t& level = row[x * kChannels + c];
      level = margin_q8 + (((level - margin_q8) * share + (1 << 11)) >> 12);
    }
  }
}

// --- Picture ---

// By first row; those of one row in the order they came.
std::vector<Disc> discs_of(const PictureConfig& config, const Shutter& shutter, const PictureFrame& frame) {
  std::vector<Disc> discs;
  discs.reserve(frame.dots.size() + static_cast<std::size_t>(std::max(config.effects.dirt_specks, 0)));
  const double radius = 0.5 * config.dot_diameter_mm * config.px_per_mm;
  for (std::size_t i = 0; i < frame.dots.size(); ++i) {
    const PointPx from = frame.dots[i];
    const PointPx to = i < frame.dots_end.size() ? frame.dots_end[i] : from;
    place(config, shutter, {from, to, radius, worn_contrast(config, from)}, discs);
  }
  place_dirt(config, shutter, discs);
  std::stable_sort(discs.begin(), discs.end(), [](const Disc& a, const Disc& b) { return a.first_row < b.first_row; });
  return discs;
}

template <std::size_t kChannels>
void render(const PictureConfig& config, const std::array<Channel, kChannels>& channels, const PictureFrame& frame,
            std::vector<std::uint8_t>& out) {
  const auto width = static_cast<std::size_t>(config.width);
  const std::size_t samples = width * kChannels;
  out.resize(samples * static_cast<std::size_t>(config.height));

  const bool margin = config.effects.gel_width_mm > 0.0 || config.effects.gel_height_mm > 0.0;
  std::vector<std::int32_t> columns(samples);
  std::vector<std::int32_t> window_columns(margin ? width : 0);
  for (int x = 0; x < config.width; ++x) {
    const auto column = static_cast<std::size_t>(x);
    for (std::size_t c = 0; c < kChannels; ++c) {
      columns[column * kChannels + c] = to_q8(light(config, channels[c], 0, x));
    }
    if (margin) window_columns[column] = window_q12(config, 0, x);
  }

  const Shutter shutter(config);
  const std::vector<Disc> discs = discs_of(config, shutter, frame);
  std::vector<const Disc*> open;  // those that reach into the row
  std::size_t next = 0;
  const RimTable& rim = rim_table();
  const bool shaded = config.effects.dot_shading > 0.0;
  Coverage coverage{std::vector<std::int32_t>(width), std::vector<float>(shaded ? width : 0),
                    std::vector<float>(shaded ? width : 0)};

  const Imprint* const contact = frame.contact;
  const Imprint* const contact_end = frame.contact_end != nullptr ? frame.contact_end : contact;
  const bool slopes_seen = contact != nullptr && frame.underside != nullptr && !frame.underside->plain();
  const bool round = frame.underside == nullptr || frame.underside->round();
  const bool walls_seen = contact != nullptr && config.walls != Walls{};
  Slopes slopes;
  if (slopes_seen || walls_seen)
    slopes = {std::vector<float>(width), std::vector<float>(width), sights(config, shutter, *contact, *contact_end)};

  const NoiseTile& tile = noise_tile();
  const std::int32_t sigma_q8 = to_q8(config.noise_sigma);
  const std::int32_t light_q8 = to_q8(frame.light_levels);
  Random random(config.seed * 0x9e3779b97f4a7c15u ^ std::rotl(frame.seed * 0xd1342543de82ef95u, 32));

  std::vector<std::int32_t> row(samples);
  for (int y = 0; y < config.height; ++y) {
    std::array<std::int32_t, kChannels> base{};
    for (std::size_t c = 0; c < kChannels; ++c) {
      // Shading 0 asks for flat grey: then the lamps' colours go too.
      const double tint = config.shading == 0.0 ? 0.0 : channels[c].tint;
      base[c] = to_q8(config.background + tint + light(config, channels[c], 1, y));
    }
    for (std::size_t i = 0; i < samples; i += kChannels) {
      for (std::size_t c = 0; c < kChannels; ++c) row[i + c] = columns[i + c] + base[c];
    }
    const Imprint now = contact != nullptr ? between(*contact, *contact_end, shutter.middle(y)) : Imprint{};
    if (contact != nullptr && round) add_imprint(config, channels, now, y, row);
    if (slopes_seen) {
      add_underside(config, channels, shutter, *frame.underside, *contact, *contact_end, y, slopes, row);
    }
    if (walls_seen) add_walls<kChannels>(config, round ? &now : nullptr, y, slopes, row);
    slopes.clear();
    for (; next < discs.size() && discs[next].first_row <= y; ++next) open.push_back(&discs[next]);
    std::erase_if(open, [y](const Disc* disc) { return disc->last_row < y; });
    for (const Disc* disc : open) add_disc(config, channels, shutter, rim, *disc, y, coverage, row);
    if (margin) {
      darken_margin<kChannels>(window_columns, window_q12(config, 1, y), to_q8(config.effects.margin_level), row);
    }

    std::uint8_t* to = out.data() + static_cast<std::size_t>(y) * samples;
    std::size_t place = static_cast<std::size_t>(random.next()) % kTileSize;
    for (std::size_t done = 0; done < samples;) {
      const std::size_t count = std::min(samples - done, kTileSize - place);
      finish(row.data() + done, light_q8, tile.data() + place, sigma_q8, count, to + done);
      done += count;
      place = 0;
    }
  }
}

}  // namespace

PictureConfig cropped_320x240() {
  return {};
}

PictureConfig camera_3280x2464() {
  PictureConfig config;
  config.width = 3280;
  config.height = 2464;
  config.px_per_mm = 1.0 / 0.00866;
  config.center_x_px = 1639.5;
  config.center_y_px = 1231.5;
  // As blurred, measured on the gel, as the cropped view.
  config.edge_softness_px *= config.px_per_mm / cropped_320x240().px_per_mm;
  config.noise_sigma = 3.0;
  return config;
}

PictureConfig scaled(PictureConfig config, int width) {
  const double scale = static_cast<double>(width) / config.width;
  config.width = width;
  config.height = static_cast<int>(std::lround(config.height * scale));
  config.px_per_mm *= scale;
  config.edge_softness_px *= scale;
  // Pixel centres are integers, so the picture's corner is (-0.5, -0.5).
  config.center_x_px = (config.center_x_px + 0.5) * scale - 0.5;
  config.center_y_px = (config.center_y_px + 0.5) * scale - 0.5;
  return config;
}

PointPx to_px(const PictureConfig& config, Vec2 mm) {
  return {config.center_x_px + mm.x * config.px_per_mm, config.center_y_px + mm.y * config.px_per_mm};
}

Imprint imprint_px(const PictureConfig& config, const ContactState& contact) {
  Imprint imprint;
  imprint.center = to_px(config, contact.center_mm);
  imprint.radius_px = contact.contact_radius_mm * config.px_per_mm;
  // a / R of a sphere, which is as deep as a^2 / R.
  if (contact.contact_radius_mm > 0.0) imprint.rim_slope = contact.depth_mm / contact.contact_radius_mm;
  return imprint;
}

Imprint imprint_px(const PictureConfig& config, const ContactState& contact, Vec2 object_mm, double turn_rad) {
  Imprint imprint = imprint_px(config, contact);
  imprint.object = to_px(config, object_mm);
  imprint.turn_rad = turn_rad;
  imprint.depth_mm = contact.depth_mm;
  return imprint;
}

double lens_sigma_mm(const PictureConfig& config) {
  return config.edge_softness_px / (kSigmas * config.px_per_mm);
}

std::vector<PointPx> dot_centers_px(const PictureConfig& config, std::span<const Vec2> rest_mm,
                                    std::span<const Vec2> motion_mm) {
  std::vector<PointPx> centers;
  centers.reserve(rest_mm.size());
  for (std::size_t i = 0; i < rest_mm.size(); ++i) {
    const Vec2 u = motion_mm.empty() ? Vec2{} : motion_mm[i];
    centers.push_back(to_px(config, {rest_mm[i].x + u.x, rest_mm[i].y + u.y}));
  }
  return centers;
}

void render_luma(const PictureConfig& config, const PictureFrame& frame, std::vector<std::uint8_t>& out) {
  render(config, kLuma, frame, out);
}

void render_rgb(const PictureConfig& config, const PictureFrame& frame, std::vector<std::uint8_t>& out) {
  render(config, kRgb, frame, out);
}

void render_luma(const PictureConfig& config, std::span<const PointPx> dot_centers, const Imprint* contact,
                 std::uint64_t frame_seed, std::vector<std::uint8_t>& out) {
  render_luma(config, {.dots = dot_centers, .contact = contact, .seed = frame_seed}, out);
}

void render_rgb(const PictureConfig& config, std::span<const PointPx> dot_centers, const Imprint* contact,
                std::uint64_t frame_seed, std::vector<std::uint8_t>& out) {
  render_rgb(config, {.dots = dot_centers, .contact = contact, .seed = frame_seed}, out);
}

}  // namespace holdfast::scene
