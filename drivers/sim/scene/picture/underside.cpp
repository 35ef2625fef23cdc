// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/scene/picture/underside.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <vector>

#include "drivers/sim/scene/math/portable.hpp"
#include "drivers/sim/scene/math/random.hpp"

namespace holdfast::scene {
namespace {

using std::numbers::pi;

constexpr std::uint64_t kGrainStream = 0x677261696eU;

// The gel rounds what is sharper.
constexpr double kLeastRim_mm = 0.3;
// A relief of this pitch is half as high in the picture.
constexpr double kSkin_mm = 0.25;
// The relief fades between these shares of the contact's level: 0.84 and 1.14 radii of a paraboloid.
constexpr float kFade = 0.3F;

// Bounds of the contact's level, shares of the depth: the layer may pile up beside the object (up to twice the depth),
// and a flat's rim begins to carry before its area grows.
constexpr double kLeastLevel = 0.1;
constexpr double kMostLevel = 2.0;
// Of the depth, what at least is left outside of the contact.
constexpr double kLeastOutside = 0.25;

// Where areas are measured: the pad, as it lies under an object that has not moved.
constexpr Vec2 kHalfPad_mm{12.625, 10.375};
constexpr double kCell_mm = 0.1;
constexpr std::size_t kCellsPerStep = 25;
constexpr double kAreaStep_mm2 = kCellsPerStep * kCell_mm * kCell_mm;

// A height and its slopes.
struct Height {
  float mm = 0.0F;
  float x = 0.0F;
  float y = 0.0F;
};

float floored(float x, int& whole) {
  whole = static_cast<int>(x);
  whole -= static_cast<float>(whole) > x ? 1 : 0;
  return x - static_cast<float>(whole);
}

// -cos / 2 from crest to crest, 0 in the mean: by the half angle, whose Taylor series within a quarter turn err by
// 4e-6. Range: |along| < 2^22 periods, where floats have halves.
Height wave(float along_mm, float per_mm) {
  int whole = 0;
  const float x = static_cast<float>(pi) * (floored(along_mm * per_mm + 0.5F, whole) - 0.5F);
  const float z = x * x;
  const float s = x * (1.0F + z * (-1.6666667e-1F + z * (8.3333333e-3F + z * (-1.9841270e-4F + z * 2.7557319e-6F))));
  const float c =
      1.0F + z * (-0.5F + z * (4.1666667e-2F + z * (-1.3888889e-3F + z * (2.4801587e-5F + z * -2.7557319e-7F))));
  return {s * s - 0.5F, static_cast<float>(2.0 * pi) * per_mm * s * c, 0.0F};
}

// --- Grain ---

constexpr int kDirections = 32;
using Directions = std::array<std::array<float, 2>, kDirections>;

const Directions& directions() {
  static const Directions all = [] {
    Directions out{};
    for (std::size_t i = 0; i < out.size(); ++i) {
      const double angle = 2.0 * pi * (static_cast<double>(i) + 0.5) / kDirections;
      out[i] = {static_cast<float>(portable::cos(angle)), static_cast<float>(portable::sin(angle))};
    }
    return out;
  }();
  return all;
}

// Perlin's noise in cells of the lattice (Improving Noise, 2002). Keeps the last cell: the next pixel mostly lies in
// it.
class Lattice {
 public:
  explicit Lattice(std::uint32_t seed) : seed_(seed) {}

  Height at(float x, float y) {
    int i = 0;
    int j = 0;
    const float u = floored(x, i);
    const float v = floored(y, j);
    if (i != i_ || j != j_) enter(i, j);
    // Of each corner, whose gradients meet in the point.
    std::array<float, 4> g{};
    for (std::size_t k = 0; k < g.size(); ++k) {
      g[k] = corners_[k][0] * (u - static_cast<float>(k & 1U)) + corners_[k][1] * (v - static_cast<float>(k >> 1U));
    }
    const float fu = u * u * u * (10.0F + u * (-15.0F + 6.0F * u));
    const float fv = v * v * v * (10.0F + v * (-15.0F + 6.0F * v));
    const float du = 30.0F * u * u * (u - 1.0F) * (u - 1.0F);
    const float dv = 30.0F * v * v * (v - 1.0F) * (v - 1.0F);
    const auto mix = [&](float a, float b, float c, float d) {
      const float top = a + fu * (b - a);
      return top + fv * (c + fu * (d - c) - top);
    };
    const auto axis = [&](std::size_t n) {
      return mix(corners_[0][n], corners_[1][n], corners_[2][n], corners_[3][n]);
    };
    return {mix(g[0], g[1], g[2], g[3]), axis(0) + du * (g[1] - g[0] + fv * (g[3] - g[2] - g[1] + g[0])),
            axis(1) + dv * (g[2] - g[0] + fu * (g[3] - g[1] - g[2] + g[0]))};
  }

 private:
  void enter(int i, int j) {
    i_ = i;
    j_ = j;
    for (unsigned k = 0; k < corners_.size(); ++k) {
      std::uint32_t hash = (static_cast<std::uint32_t>(i) + (k & 1U)) * 0x9e3779b1U ^
                           (static_cast<std::uint32_t>(j) + (k >> 1U)) * 0x85ebca77U ^ seed_;
      hash = (hash ^ (hash >> 15)) * 0x2c1b3c6dU;
      hash = (hash ^ (hash >> 12)) * 0x297a2d39U;
      corners_[k] = directions_[(hash ^ (hash >> 15)) >> 27];
    }
  }

  const Directions& directions_ = directions();
  std::uint32_t seed_;
  int i_ = std::numeric_limits<int>::min();
  int j_ = 0;
  std::array<std::array<float, 2>, 4> corners_{};
};

// Measured over 1600 cells: rms of the sum of the two lattices, and its rms frequency in cycles a cell.
constexpr double kGrainRms = 0.305;
constexpr double kGrainFrequency = 0.652;

class Grain {
 public:
  explicit Grain(std::uint64_t seed)
      : first_(static_cast<std::uint32_t>(seed)), second_(static_cast<std::uint32_t>(seed >> 32)) {}

  // Of rms 1/4 and rms frequency 1. Slopes too are per period.
  Height at(float x, float y) {
    constexpr auto kCells = static_cast<float>(1.0 / kGrainFrequency);
    x *= kCells;
    y *= kCells;
    const Height a = first_.at(x, y);
    const Height b = second_.at(0.8F * x - 0.6F * y + 0.37F, 0.6F * x + 0.8F * y + 0.61F);
    constexpr auto kScale = static_cast<float>(0.25 / kGrainRms);
    return {kScale * (a.mm + b.mm), kScale * kCells * (a.x + 0.8F * b.x + 0.6F * b.y),
            kScale * kCells * (a.y - 0.6F * b.x + 0.8F * b.y)};
  }

 private:
  Lattice first_;
  Lattice second_;
};

// What a pose says, in the numbers of the formulas.
struct Indentation {
  Indentation(double level_mm, double end_mm)
      : level(static_cast<float>(level_mm)),
        end(static_cast<float>(end_mm)),
        room(end - level),
        per_room(room > 0.0F ? 1.0F / room : 0.0F),
        per_fade(1.0F / (2.0F * kFade * level)) {}
  float level;
  float end;
  float room;  // from the one to the other
  float per_room;
  float per_fade;
};

// Columns of a row whose distance along a direction is within `half`; the direction's step is that of a column.
void narrow(double start, double step, double half, double& first, double& last) {
  if (std::abs(step) < 1e-12) {
    if (std::abs(start) > half) last = first - 1.0;
    return;
  }
  const double a = (-half - start) / step;
  const double b = (half - start) / step;
  first = std::max(first, std::min(a, b));
  last = std::min(last, std::max(a, b));
}

}  // namespace

struct Underside::Model {
  Model(const Shape& shape, const Relief& relief, std::uint64_t seed, double lens_sigma_mm);

  template <ShapeKind kKind>
  [[nodiscard]] Height base(float x, float y) const;
  template <ShapeKind kKind>
  [[nodiscard]] Height object(float x, float y) const;
  [[nodiscard]] Height relief(float x, float y, Grain& grain) const;
  template <ShapeKind kKind>
  [[nodiscard]] Height pressed(const Indentation& contact, float x, float y, Grain& grain) const;
  template <ShapeKind kKind>
  [[nodiscard]] Columns add(const Pose& pose, const Row& row, float weight, std::span<float> slope_x,
                            std::span<float> slope_y) const;
  template <typename Visit>
  auto with_kind(Visit visit) const;
  [[nodiscard]] Indentation indentation_of(const Pose& pose) const;
  [[nodiscard]] Vec2 reach_mm(const Indentation& contact) const;
  [[nodiscard]] double level_mm(double area_mm2) const;
  void measure();

  ShapeKind kind;
  bool ball;  // without texture
  double yaw_rad;
  // Of the shape.
  float curve_x = 0.0F;  // 1 / radius; of a flat's rim, of an edge's crest
  float curve_y = 0.0F;
  float flank = 0.0F;   // slope
  float flat_x = 0.0F;  // half of a flat within its rim; half of an edge's crest
  float flat_y = 0.0F;
  float lean = 0.0F;  // slope
  float lean_mm = 0.0F;
  TextureKind texture;
  float texture_mm;
  float texture_per_mm;
  // Of the relief in the picture.
  ReliefKind relief_kind;
  float relief_mm = 0.0F;
  float relief_per_mm = 1.0F;
  std::uint64_t grain_seed;
  std::vector<float> levels;  // of areas in steps of kAreaStep_mm2
};

Underside::Model::Model(const Shape& shape, const Relief& relief, std::uint64_t seed, double lens_sigma_mm)
    : kind(shape.kind),
      ball(shape.kind == ShapeKind::kSphere && as_round(shape)),
      yaw_rad(shape.yaw_rad),
      texture(shape.texture),
      texture_mm(static_cast<float>(shape.texture_height_mm)),
      texture_per_mm(static_cast<float>(1.0 / shape.texture_pitch_mm)),
      relief_kind(relief.height_um > 0.0 ? relief.kind : ReliefKind::kNone),
      relief_per_mm(static_cast<float>(1.0 / relief.pitch_mm)),
      grain_seed(Random(seed, kGrainStream, 0).next()) {
  const double slope = portable::tan(shape.flank_deg * pi / 180.0);
  const double rim = std::max(shape.rim_mm, kLeastRim_mm);
  const auto to = [](float& figure, double value) { figure = static_cast<float>(value); };
  switch (kind) {
    case ShapeKind::kSphere:
      to(curve_x, 1.0 / shape.radius_mm);
      curve_y = curve_x;
      break;
    case ShapeKind::kEllipsoid:
      to(curve_x, 1.0 / shape.radius_mm);
      to(curve_y, 1.0 / shape.radius_y_mm);
      break;
    case ShapeKind::kCylinder:
      to(curve_y, 1.0 / shape.radius_mm);
      break;
    case ShapeKind::kCone:
      to(flank, slope);
      break;
    case ShapeKind::kEdge:
      to(flank, slope);
      to(flat_y, slope * shape.radius_mm);
      to(curve_y, 1.0 / shape.radius_mm);
      break;
    case ShapeKind::kDisc:
    case ShapeKind::kBox: {
      const bool disc = kind == ShapeKind::kDisc;
      const double half_y = disc ? shape.radius_mm : shape.half_y_mm;
      to(flat_x, (disc ? shape.radius_mm : shape.half_x_mm) - shape.rim_mm);
      to(flat_y, half_y - shape.rim_mm);
      to(curve_x, 1.0 / rim);
      const double tilt = portable::tan(shape.tilt_rad);
      to(lean, -tilt);
      to(lean_mm, std::abs(tilt) * half_y);
      break;
    }
  }
  if (relief_kind != ReliefKind::kNone) {
    const double p2 = relief.pitch_mm * relief.pitch_mm;
    const double skin = p2 / (p2 + kSkin_mm * kSkin_mm);
    const double lens = portable::exp(-2.0 * pi * pi * lens_sigma_mm * lens_sigma_mm / p2);
    to(relief_mm, 1e-3 * relief.height_um * skin * lens);
  }
  if (!ball) measure();
}

template <ShapeKind kKind>
Height Underside::Model::base(float x, float y) const {
  if constexpr (kKind == ShapeKind::kSphere || kKind == ShapeKind::kEllipsoid) {
    return {0.5F * (curve_x * x * x + curve_y * y * y), curve_x * x, curve_y * y};
  }
  if constexpr (kKind == ShapeKind::kCylinder) return {0.5F * curve_y * y * y, 0.0F, curve_y * y};
  if constexpr (kKind == ShapeKind::kCone) {
    const float r = std::sqrt(x * x + y * y);
    if (r == 0.0F) return {};
    const float by = flank / r;
    return {flank * r, by * x, by * y};
  }
  if constexpr (kKind == ShapeKind::kEdge) {
    const float away = std::abs(y);
    if (away < flat_y) return {0.5F * curve_y * y * y, 0.0F, curve_y * y};
    return {flank * (away - 0.5F * flat_y), 0.0F, y < 0.0F ? -flank : flank};
  }
  Height out{lean_mm + lean * y, 0.0F, lean};
  if constexpr (kKind == ShapeKind::kDisc) {
    const float r = std::sqrt(x * x + y * y);
    const float over = r - flat_x;
    if (over <= 0.0F) return out;
    out.mm += 0.5F * curve_x * over * over;
    const float by = curve_x * over / r;
    out.x += by * x;
    out.y += by * y;
  }
  if constexpr (kKind == ShapeKind::kBox) {
    const float over_x = std::abs(x) - flat_x;
    const float over_y = std::abs(y) - flat_y;
    const float over = std::max(over_x, over_y);
    if (over <= 0.0F) return out;
    out.mm += 0.5F * curve_x * over * over;
    if (over_x >= over_y) {
      out.x += x < 0.0F ? -curve_x * over : curve_x * over;
    } else {
      out.y += y < 0.0F ? -curve_x * over : curve_x * over;
    }
  }
  return out;
}

template <ShapeKind kKind>
Height Underside::Model::object(float x, float y) const {
  Height out = base<kKind>(x, y);
  if (texture == TextureKind::kNone) return out;
  const bool bumps = texture == TextureKind::kBumps;
  const float each = bumps ? 0.5F * texture_mm : texture_mm;
  const Height along = wave(x, texture_per_mm);
  out.mm += each * (0.5F + along.mm);
  out.x += each * along.x;
  if (!bumps) return out;
  const Height across = wave(y, texture_per_mm);
  out.mm += each * (0.5F + across.mm);
  out.y += each * across.x;
  return out;
}

Height Underside::Model::relief(float x, float y, Grain& grain) const {
  switch (relief_kind) {
    case ReliefKind::kNone:
      break;
    case ReliefKind::kRidges: {
      const Height along = wave(x, relief_per_mm);
      return {relief_mm * along.mm, relief_mm * along.x, 0.0F};
    }
    case ReliefKind::kBumps: {
      const Height along = wave(x, relief_per_mm);
      const Height across = wave(y, relief_per_mm);
      const float each = 0.5F * relief_mm;
      return {each * (along.mm + across.mm), each * along.x, each * across.x};
    }
    case ReliefKind::kGrain: {
      const Height noise = grain.at(x * relief_per_mm, y * relief_per_mm);
      const float slope = relief_mm * relief_per_mm;
      return {relief_mm * noise.mm, slope * noise.x, slope * noise.y};
    }
  }
  return {};
}

// The gel's surface at a place in the object's frame.
template <ShapeKind kKind>
Height Underside::Model::pressed(const Indentation& contact, float x, float y, Grain& grain) const {
  const bool bulge_is_drawn = kKind == ShapeKind::kSphere && ball;
  Height h;
  if (bulge_is_drawn) {
    h = {x * x + y * y, 2.0F * x, 2.0F * y};  // and the level is the radius squared
  } else {
    h = object<kKind>(x, y);
  }
  Height out;
  if (!bulge_is_drawn) {
    const float left = std::clamp((contact.end - h.mm) * contact.per_room, 0.0F, 1.0F);
    const float follows = left * left;
    out = {std::min(h.mm, contact.level) + contact.room / 3.0F * (1.0F - follows * left), follows * h.x, follows * h.y};
  }
  const float share = (contact.level * (1.0F + kFade) - h.mm) * contact.per_fade;
  if (share <= 0.0F || relief_kind == ReliefKind::kNone) return out;
  const Height r = relief(x, y, grain);
  if (share >= 1.0F) return {out.mm + r.mm, out.x + r.x, out.y + r.y};
  const float in = share * share * (3.0F - 2.0F * share);
  const float fades = -6.0F * share * (1.0F - share) * contact.per_fade * r.mm;
  return {out.mm + in * r.mm, out.x + in * r.x + fades * h.x, out.y + in * r.y + fades * h.y};
}

template <typename Visit>
auto Underside::Model::with_kind(Visit visit) const {
  switch (kind) {
    case ShapeKind::kEllipsoid:
      return visit.template operator()<ShapeKind::kEllipsoid>();
    case ShapeKind::kCylinder:
      return visit.template operator()<ShapeKind::kCylinder>();
    case ShapeKind::kCone:
      return visit.template operator()<ShapeKind::kCone>();
    case ShapeKind::kDisc:
      return visit.template operator()<ShapeKind::kDisc>();
    case ShapeKind::kBox:
      return visit.template operator()<ShapeKind::kBox>();
    case ShapeKind::kEdge:
      return visit.template operator()<ShapeKind::kEdge>();
    case ShapeKind::kSphere:
      break;
  }
  return visit.template operator()<ShapeKind::kSphere>();
}

Indentation Underside::Model::indentation_of(const Pose& pose) const {
  if (ball) {
    const double square = pose.radius_mm * pose.radius_mm;
    return {square, square};
  }
  const double depth = std::max(pose.depth_mm, 1e-6);
  const double level =
      std::clamp(level_mm(pi * pose.radius_mm * pose.radius_mm), kLeastLevel * depth, kMostLevel * depth);
  const double outside = std::max(depth - level, kLeastOutside * depth);
  return {level, level + 3.0 * outside};
}

// How far from the object's place the surface has slopes, in its frame.
Vec2 Underside::Model::reach_mm(const Indentation& contact) const {
  constexpr double kEndless = 1e4;
  const auto high = static_cast<double>(std::max(contact.end, contact.level * (1.0F + kFade)));
  if (ball) {
    const double r = std::sqrt(static_cast<double>(contact.level) * (1.0 + static_cast<double>(kFade)));
    return {r, r};
  }
  const auto bowl = [&](float curve) { return std::sqrt(2.0 * high / static_cast<double>(curve)); };
  switch (kind) {
    case ShapeKind::kSphere:
    case ShapeKind::kEllipsoid:
      return {bowl(curve_x), bowl(curve_y)};
    case ShapeKind::kCylinder:
      return {kEndless, bowl(curve_y)};
    case ShapeKind::kCone: {
      const double r = high / static_cast<double>(flank);
      return {r, r};
    }
    case ShapeKind::kEdge:
      return {kEndless, high / static_cast<double>(flank) + 0.5 * static_cast<double>(flat_y)};
    case ShapeKind::kDisc:
    case ShapeKind::kBox: {
      // A lean takes away at most what it adds in the middle, and some beyond the outline.
      const double rim = std::sqrt(2.0 * (high + static_cast<double>(lean_mm)) / static_cast<double>(curve_x));
      return {static_cast<double>(flat_x) + rim, static_cast<double>(flat_y) + rim};
    }
  }
  return {};
}

template <ShapeKind kKind>
Underside::Columns Underside::Model::add(const Pose& pose, const Row& row, float weight, std::span<float> slope_x,
                                         std::span<float> slope_y) const {
  const Indentation contact = indentation_of(pose);
  const double turn = pose.turn_rad + yaw_rad;
  const double c = portable::cos(turn);
  const double s = portable::sin(turn);
  const double dx = row.x_mm - pose.at_mm.x;
  const double dy = row.y_mm - pose.at_mm.y;
  const Vec2 start{c * dx + s * dy, c * dy - s * dx};
  const Vec2 step{c * row.step_mm, -s * row.step_mm};
  const Vec2 reach = reach_mm(contact);
  double first = 0.0;
  double last = static_cast<double>(slope_x.size()) - 1.0;
  narrow(start.x, step.x, reach.x, first, last);
  narrow(start.y, step.y, reach.y, first, last);
  if (!(first <= last)) return {};
  const Columns columns{static_cast<int>(std::ceil(first)), static_cast<int>(std::floor(last))};
  Grain grain(grain_seed);
  const float cosine = weight * static_cast<float>(c);
  const float sinus = weight * static_cast<float>(s);
  for (int column = columns.first; column <= columns.last; ++column) {
    const Height h = pressed<kKind>(contact, static_cast<float>(start.x + column * step.x),
                                    static_cast<float>(start.y + column * step.y), grain);
    const auto i = static_cast<std::size_t>(column);
    slope_x[i] += cosine * h.x - sinus * h.y;
    slope_y[i] += sinus * h.x + cosine * h.y;
  }
  return columns;
}

void Underside::Model::measure() {
  const double c = portable::cos(yaw_rad);
  const double s = portable::sin(yaw_rad);
  std::vector<float> heights;
  with_kind([&]<ShapeKind kKind>() {
    for (double y = 0.5 * kCell_mm - kHalfPad_mm.y; y < kHalfPad_mm.y; y += kCell_mm) {
      for (double x = 0.5 * kCell_mm - kHalfPad_mm.x; x < kHalfPad_mm.x; x += kCell_mm) {
        heights.push_back(object<kKind>(static_cast<float>(c * x + s * y), static_cast<float>(c * y - s * x)).mm);
      }
    }
  });
  std::ranges::sort(heights);
  for (std::size_t i = 0; i < heights.size(); i += kCellsPerStep) levels.push_back(heights[i]);
}

double Underside::Model::level_mm(double area_mm2) const {
  if (levels.empty()) return 0.0;
  const double steps = std::clamp(area_mm2 / kAreaStep_mm2, 0.0, static_cast<double>(levels.size() - 1));
  const auto below = std::min(static_cast<std::size_t>(steps), levels.size() - 2);
  const auto from = static_cast<double>(levels[below]);
  return from + (steps - static_cast<double>(below)) * (static_cast<double>(levels[below + 1]) - from);
}

Underside::Underside(const Shape& shape, const Relief& relief, std::uint64_t seed, double lens_sigma_mm)
    : model_(std::make_unique<const Model>(shape, relief, seed, lens_sigma_mm)) {}
Underside::~Underside() = default;

bool Underside::round() const {
  return model_->ball;
}

bool Underside::plain() const {
  return model_->ball && model_->relief_kind == ReliefKind::kNone;
}

double Underside::level_mm(double area_mm2) const {
  return model_->level_mm(area_mm2);
}

Underside::Surface Underside::surface(const Pose& pose, Vec2 at_mm) const {
  if (!(pose.radius_mm > 0.0)) return {};
  const Model& model = *model_;
  const double c = portable::cos(pose.turn_rad + model.yaw_rad);
  const double s = portable::sin(pose.turn_rad + model.yaw_rad);
  const Vec2 from = at_mm - pose.at_mm;
  Grain grain(model.grain_seed);
  const Indentation contact = model.indentation_of(pose);
  const Height h = model.with_kind([&]<ShapeKind kKind>() {
    return model.pressed<kKind>(contact, static_cast<float>(c * from.x + s * from.y),
                                static_cast<float>(c * from.y - s * from.x), grain);
  });
  const auto x = static_cast<double>(h.x);
  const auto y = static_cast<double>(h.y);
  return {static_cast<double>(h.mm), {c * x - s * y, s * x + c * y}};
}

Underside::Columns Underside::add_row(const Pose& pose, const Row& row, float weight, std::span<float> slope_x,
                                      std::span<float> slope_y) const {
  if (!(pose.radius_mm > 0.0) || plain()) return {};
  return model_->with_kind([&]<ShapeKind kKind>() { return model_->add<kKind>(pose, row, weight, slope_x, slope_y); });
}

}  // namespace holdfast::scene
