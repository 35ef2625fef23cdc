// SPDX-License-Identifier: Apache-2.0
// What the camera sees: a lit gel, the imprint of the object, dark dots and noise; if asked for, what blurs, bends,
// soils and wears the picture.
//
// Modelled
//   * light from three sides (red from below right, green from the left, blue from above right) that
//     falls off towards the corners; luma is the BT.601 sum of the three
//   * the imprint, bright on the side that faces each light. Of a smooth sphere, or where no Underside is given: a
//     round bulge whose slope rises to the contact's rim and fades at twice its radius. Else the slopes of the
//     Underside: shape, texture and relief of the object, where the object is
//   * if asked for (Walls), what a lamp does on a steep wall out of proportion to its slope: light on the side that
//     faces it and nothing off the other, a highlight where the wall mirrors it, and a shadow with an edge
//   * dots as antialiased discs; before rounding to 8 bits their centroid is exact to 0.0003 px, after it to
//     0.002 px rms at the default contrast
//   * Gaussian noise of the same sigma in every sample, then rounding and clamping to 8 bits
//   * as PictureEffects, all off: motion blur and rolling shutter of dots, imprint and relief, dirt, worn dots, lit and
//     shaded rims of dots, dark margins around the gel; drift and flicker as an offset of each frame
//
// Not modelled
//   * the dots' speckle, and ellipses under strain; real corners are darker still
//   * shadows beyond the wall that casts them; lens distortion; Bayer pattern; blur of edges that stand still, other
//   than those of dots
//   * blur of the round bulge, which is smooth over its whole radius: each row has it as in the middle of its exposure
//   * paths that bend or change speed within a frame; flicker within a frame (bands); light that scales, not adds
//   * worn places that move with the gel: they stay in the picture, as dirt does (the gel moves less than a patch)
//
// Noise comes from one fixed tile of 2^18 normal numbers (xoshiro256**, sums of 12 uniforms, so no value
// beyond 6 sigma), read from a random place for each row: integers only. The same frame gives the same bytes on
// every CPU, because the file is built without contraction of products (drivers/CMakeLists.txt sees to it).
// Cost of a frame with 63 dots and an imprint (thread CPU time, median of 200, x86-64, other work beside): grey at
// 410x308 0.37 ms (imprint 0.18, dots 0.1), RGB at 3280x2464 35 ms. Motion over 5 px at 410 columns adds 0.4 ms;
// all effects together add 0.6 ms, 30 ms at 3280x2464.
// What an Underside adds, by the contact's radius of 3 and 4 mm: a ball's grain 0.3 and 0.8 ms, its ridges 0.25 and
// 0.45 ms, a box without relief 0.1 ms, an ellipsoid with bumps 1.0 and 1.7 ms; RGB at 3280x2464 8 to 110 ms. A smooth
// ball costs what it did.
//
// Convention: x right, y down, centre of the top-left pixel = (0, 0), pixels of the picture rendered.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "drivers/sim/scene/contact/contact.hpp"
#include "drivers/sim/scene/picture/underside.hpp"

namespace holdfast::scene {

struct PointPx {
  double x = 0.0;
  double y = 0.0;
};

// What is wrong with camera and gel: nothing, unless asked for. What is fixed lies where PictureConfig::seed puts it.
// Range: times >= 0 ms; worn_gel 0..1; dirt_specks 0..10000; levels 0..255; sizes >= 0 mm.
struct PictureEffects {
  double exposure_ms = 0.0;         // motion blur; price: the dots' time again for each 0.8 px of path (at 320)
  double rolling_shutter_ms = 0.0;  // from the start of the first row to the start of the last
  int dirt_specks = 0;              // dark, 0.1 .. 0.5 mm across; on the picture, they do not move with the gel
  double worn_gel = 0.0;            // dots lose contrast in patches of some mm; at 1 a third of them is all but gone
  double dot_shading = 0.0;         // levels, of a rim that faces a lamp, in its channel; moves centroids towards
                                    // the shaded side: luma's by 0.07 px at 10 levels and 320 columns
  double gel_width_mm = 0.0;        // of the lit window around the grid's centre; 0 = fills the picture
  double gel_height_mm = 0.0;
  double margin_level = 12.0;  // outside the window
  friend bool operator==(const PictureEffects&, const PictureEffects&) = default;
};

// Light that is not in proportion to the slope of the gel's surface; each lamp's, in its channel. All off: a linear
// picture, whose luma has 0.41 of one lamp's walls, because the three nearly cancel. Here they do not: the wall that
// faces green is brightest, and no wall makes up for another.
// Range: >= 0.
struct Walls {
  double gain = 0.0;      // levels per unit of slope that faces the lamp; 0 for what faces away
  double specular = 0.0;  // levels of a highlight, at the slope of 0.3 towards the lamp and 0.25 around it
  double shadow = 0.0;    // levels less where the wall faces away by more than 0.1: an edge 0.04 of slope wide
  friend bool operator==(const Walls&, const Walls&) = default;
};

// Range: width and height 1..16384; px_per_mm and edge_softness_px > 0; levels 0..255; noise_sigma 0..64.
struct PictureConfig {
  int width = 320;
  int height = 240;
  double px_per_mm = 15.79;
  double center_x_px = 159.5;  // where the centre of the grid lies
  double center_y_px = 119.5;
  double dot_diameter_mm = 1.05;
  double edge_softness_px = 1.3;  // of the dot's rim: 1 % to 99 % takes twice this
  double background = 120.0;      // luma of the middle
  double dot_level = 45.0;
  double shading = 20.0;       // luma from the middle to the side; 0 = flat grey in every channel
  double imprint_gain = 60.0;  // levels per unit of slope of the gel's surface, in the channel that faces it
  Walls walls;
  double noise_sigma = 2.5;  // levels
  std::uint64_t seed = 1;
  PictureEffects effects;
};

// Like recordings made with the vendor's software: pitch 31.9 px, dots 16.6 px.
[[nodiscard]] PictureConfig cropped_320x240();
// The raw camera: 8.66 um per pixel, pitch 233 px; the cropped view is about the middle 70 %.
[[nodiscard]] PictureConfig camera_3280x2464();
// The same view in `width` columns: lengths scale, levels and noise stay.
[[nodiscard]] PictureConfig scaled(PictureConfig config, int width);

// Imprint of the object: of the contact, and of the object itself for what an Underside shows.
struct Imprint {
  PointPx center;
  double radius_px = 0.0;
  double rim_slope = 0.0;  // a / R
  PointPx object{};        // its origin
  double turn_rad = 0.0;   // its twist
  double depth_mm = 0.0;
};

[[nodiscard]] PointPx to_px(const PictureConfig& config, Vec2 mm);
// Of no contact: radius 0, which is not drawn.
[[nodiscard]] Imprint imprint_px(const PictureConfig& config, const ContactState& contact);
[[nodiscard]] Imprint imprint_px(const PictureConfig& config, const ContactState& contact, Vec2 object_mm,
                                 double turn_rad);
// Blur of the dots' rims as a Gaussian, measured on the gel: what an Underside is seen through.
[[nodiscard]] double lens_sigma_mm(const PictureConfig& config);
// Places of dots from where they were printed and how far each has moved: as many, or none = they are at rest.
[[nodiscard]] std::vector<PointPx> dot_centers_px(const PictureConfig& config, std::span<const Vec2> rest_mm,
                                                  std::span<const Vec2> motion_mm = {});

// One picture. Rows are exposed from y / (height - 1) * rolling_shutter_ms on, for exposure_ms; dots and imprint go
// straight from where they are when the first row's exposure starts to where they are when the last row's ends.
struct PictureFrame {
  std::span<const PointPx> dots{};       // dots without a number are not drawn
  std::span<const PointPx> dots_end{};   // as many, in the same order; empty = they stand still
  const Imprint* contact = nullptr;      // null = none
  const Imprint* contact_end = nullptr;  // null = it stands still
  const Underside* underside = nullptr;  // null = the imprint is a round bulge
  double light_levels = 0.0;             // added to every sample: drift and flicker
  std::uint64_t seed = 1;                // of the noise
};

// Shape of `out`: height rows of width samples, no padding. The same config and frame give the same bytes.
void render_luma(const PictureConfig& config, const PictureFrame& frame, std::vector<std::uint8_t>& out);
// The same as R, G, B interleaved.
void render_rgb(const PictureConfig& config, const PictureFrame& frame, std::vector<std::uint8_t>& out);

// Nothing moves. `contact` may be null.
void render_luma(const PictureConfig& config, std::span<const PointPx> dot_centers, const Imprint* contact,
                 std::uint64_t frame_seed, std::vector<std::uint8_t>& out);
void render_rgb(const PictureConfig& config, std::span<const PointPx> dot_centers, const Imprint* contact,
                std::uint64_t frame_seed, std::vector<std::uint8_t>& out);

}  // namespace holdfast::scene
