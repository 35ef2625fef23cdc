// SPDX-License-Identifier: Apache-2.0
// What the camera sees: a lit gel, the imprint of the object, 63 dark dots and noise.
//
// Modelled
//   * light from three sides (red from below right, green from the left, blue from above right) that
//     falls off towards the corners; luma is the BT.601 sum of the three
//   * the imprint: a bulge whose slope rises to the contact's rim and fades at twice its radius, bright
//     on the side that faces each light
//   * dots as antialiased discs; before rounding to 8 bits their centroid is exact to 0.0003 px, after it to
//     0.002 px rms at the default contrast
//   * Gaussian noise of the same sigma in every sample, then rounding and clamping to 8 bits
//
// Not modelled
//   * the dots' speckle, their lit and shaded rims, and ellipses under strain; real corners are darker still
//   * texture of the object; shadows; lens distortion; rolling shutter; Bayer pattern; motion blur
//
// Noise comes from one fixed tile of 2^18 normal numbers (xoshiro256**, sums of 12 uniforms, so no value
// beyond 6 sigma), read from a random place for each row: integers only. The same dot centres give the same
// bytes on every CPU, because the file is built without contraction of products (drivers/CMakeLists.txt sees
// to it). An RGB picture of 3280x2464 takes about 0.05 s.
//
// Convention: x right, y down, centre of the top-left pixel = (0, 0), pixels of the picture rendered.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "drivers/sim/scene/grasp.hpp"

namespace holdfast::scene {

struct PointPx {
  double x = 0.0;
  double y = 0.0;
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
  double noise_sigma = 2.5;    // levels
  std::uint64_t seed = 1;
};

// Like recordings made with the vendor's software: pitch 31.9 px, dots 16.6 px.
[[nodiscard]] PictureConfig cropped_320x240();
// The raw camera: 8.66 um per pixel, pitch 233 px; the cropped view is about the middle 70 %.
[[nodiscard]] PictureConfig camera_3280x2464();
// The same view in `width` columns: lengths scale, levels and noise stay.
[[nodiscard]] PictureConfig scaled(PictureConfig config, int width);

// Imprint of the object.
struct Imprint {
  PointPx center;
  double radius_px = 0.0;
  double rim_slope = 0.0;  // a / R
};

[[nodiscard]] PointPx to_px(const PictureConfig& config, Vec2 mm);
[[nodiscard]] Imprint imprint_px(const PictureConfig& config, const GraspConfig& grasp, const GraspTruth& truth);
[[nodiscard]] std::vector<PointPx> dot_centers_px(const PictureConfig& config, std::span<const MarkerTruth> markers);

// Shape of `out`: height rows of width samples, no padding. `contact` may be null. The same config and
// frame_seed give the same bytes; another frame_seed gives other noise.
void render_luma(const PictureConfig& config, std::span<const PointPx> dot_centers, const Imprint* contact,
                 std::uint64_t frame_seed, std::vector<std::uint8_t>& out);
// The same as R, G, B interleaved.
void render_rgb(const PictureConfig& config, std::span<const PointPx> dot_centers, const Imprint* contact,
                std::uint64_t frame_seed, std::vector<std::uint8_t>& out);

}  // namespace holdfast::scene
