// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/scene/render.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace holdfast::scene {
namespace {

// --- Noise ---

// xoshiro256** by Blackman and Vigna, state filled by splitmix64 (both public domain).
class Random {
 public:
  explicit Random(std::uint64_t seed) {
    for (std::uint64_t& word : state_) {
      seed += 0x9e3779b97f4a7c15u;
      std::uint64_t z = seed;
      z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
      z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
      word = z ^ (z >> 31);
    }
  }

  std::uint64_t next() {
    const std::uint64_t result = std::rotl(state_[1] * 5, 7) * 9;
    const std::uint64_t t = state_[1] << 17;
    state_[2] ^= state_[0];
    state_[3] ^= state_[1];
    state_[1] ^= state_[2];
    state_[0] ^= state_[3];
    state_[2] ^= t;
    state_[3] = std::rotl(state_[3], 45);
    return result;
  }

 private:
  std::array<std::uint64_t, 4> state_{};
};

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

// Levels in Q8 plus noise, rounded and clamped. Range: |level| < 2^22, sigma <= 64: products below 2^29.
void finish(const std::int32_t* level_q8, const std::int16_t* normal_q12, std::int32_t sigma_q8, std::size_t count,
            std::uint8_t* out) {
  for (std::size_t i = 0; i < count; ++i) {
    const std::int32_t noise_q8 = (normal_q12[i] * sigma_q8 + (1 << 11)) >> 12;
    out[i] = static_cast<std::uint8_t>(std::clamp((level_q8[i] + noise_q8 + 128) >> 8, 0, 255));
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

constexpr Channel luma_of(const std::array<Channel, 3>& rgb) {
  constexpr std::array<double, 3> kBt601{0.299, 0.587, 0.114};
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

// Adds the imprint to a row. Slope of the bulge over its rim slope: r/a inside, (2 - r/a)^2 outside, then 0.
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
    const float r = std::sqrt(dx * dx + dy * dy);
    const float fade = std::max(0.0f, 2.0f - r / radius);
    const float slope = r <= radius ? 1.0f / radius : fade * fade / r;
    for (std::size_t c = 0; c < kChannels; ++c) {
      row[static_cast<std::size_t>(x) * kChannels + c] +=
          static_cast<std::int32_t>(gain * slope * (dx * lamp_x[c] + dy * lamp_y[c]));
    }
  }
}

// The rim rises like an edge behind a Gaussian blur; its 1 % and 99 % points lie one softness either side.
// A smooth rim is what makes the sampled centroid exact: at a softness of 1.3 px the spectrum left at one
// cycle per pixel is 0.002 here, 0.02 for a cubic smoothstep and 0.12 for a straight ramp.
constexpr double kSigmas = 2.326;
// Where the rim ends: 0.02 % of the contrast is left, far below a rounding step.
constexpr double kRimReach = 1.5;

// Share of the pixel that a dot covers, from the distance inside its edge in units of the softness.
double coverage(double inside) {
  if (inside >= kRimReach) return 1.0;
  if (inside <= -kRimReach) return 0.0;
  return 0.5 * std::erfc(-inside * (kSigmas / std::numbers::sqrt2));
}

template <std::size_t kChannels>
void add_dot(const PictureConfig& config, PointPx center, int y, std::vector<std::int32_t>& row) {
  const double radius = 0.5 * config.dot_diameter_mm * config.px_per_mm;
  const Chord chord = chord_of(center, radius + kRimReach * config.edge_softness_px, y, config.width);
  const std::int32_t dot_q8 = to_q8(config.dot_level);
  for (int x = chord.first; x <= chord.last; ++x) {
    const double dx = x - center.x;
    const double inside = (radius - std::sqrt(dx * dx + chord.dy * chord.dy)) / config.edge_softness_px;
    const std::int64_t share_q15 = std::lround(coverage(inside) * 32768.0);
    for (std::size_t c = 0; c < kChannels; ++c) {
      std::int32_t& level = row[static_cast<std::size_t>(x) * kChannels + c];
      level += static_cast<std::int32_t>((share_q15 * (dot_q8 - level) + (1 << 14)) >> 15);
    }
  }
}

template <std::size_t kChannels>
void render(const PictureConfig& config, const std::array<Channel, kChannels>& channels, std::span<const PointPx> dots,
            const Imprint* contact, std::uint64_t frame_seed, std::vector<std::uint8_t>& out) {
  const std::size_t samples = static_cast<std::size_t>(config.width) * kChannels;
  out.resize(samples * static_cast<std::size_t>(config.height));

  std::vector<std::int32_t> columns(samples);
  for (int x = 0; x < config.width; ++x) {
    for (std::size_t c = 0; c < kChannels; ++c) {
      columns[static_cast<std::size_t>(x) * kChannels + c] = to_q8(light(config, channels[c], 0, x));
    }
  }

  const NoiseTile& tile = noise_tile();
  const std::int32_t sigma_q8 = to_q8(config.noise_sigma);
  Random random(config.seed * 0x9e3779b97f4a7c15u ^ std::rotl(frame_seed * 0xd1342543de82ef95u, 32));

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
    if (contact != nullptr) add_imprint(config, channels, *contact, y, row);
    for (const PointPx& dot : dots) add_dot<kChannels>(config, dot, y, row);

    std::uint8_t* to = out.data() + static_cast<std::size_t>(y) * samples;
    std::size_t place = static_cast<std::size_t>(random.next()) % kTileSize;
    for (std::size_t done = 0; done < samples;) {
      const std::size_t count = std::min(samples - done, kTileSize - place);
      finish(row.data() + done, tile.data() + place, sigma_q8, count, to + done);
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

Imprint imprint_px(const PictureConfig& config, const GraspConfig& grasp, const GraspTruth& truth) {
  return {to_px(config, truth.contact_center_mm), truth.contact_radius_mm * config.px_per_mm,
          truth.contact_radius_mm / grasp.sphere_radius_mm};
}

std::vector<PointPx> dot_centers_px(const PictureConfig& config, std::span<const MarkerTruth> markers) {
  std::vector<PointPx> centers;
  centers.reserve(markers.size());
  for (const MarkerTruth& marker : markers) {
    centers.push_back(
        to_px(config, {marker.rest_mm.x + marker.displacement_mm.x, marker.rest_mm.y + marker.displacement_mm.y}));
  }
  return centers;
}

void render_luma(const PictureConfig& config, std::span<const PointPx> dot_centers, const Imprint* contact,
                 std::uint64_t frame_seed, std::vector<std::uint8_t>& out) {
  render(config, kLuma, dot_centers, contact, frame_seed, out);
}

void render_rgb(const PictureConfig& config, std::span<const PointPx> dot_centers, const Imprint* contact,
                std::uint64_t frame_seed, std::vector<std::uint8_t>& out) {
  render(config, kRgb, dot_centers, contact, frame_seed, out);
}

}  // namespace holdfast::scene
