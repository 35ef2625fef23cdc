// SPDX-License-Identifier: Apache-2.0
// The settings whose price `holdfast trade` measures: mode fast, and what differs from it in one knob at a time.
//
// Most are parameters of the firmware (params/params.hpp). The others are choices that it has made: how many centrings
// and how large a window, how fine a centre is kept, how many markers there are. They are swept all the same, because a
// choice that nobody has priced is a guess; Tuning says how each is imposed from outside.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "app/pipeline.hpp"
#include "params/params.hpp"
#include "tactile/types.hpp"
#include "toolchain/trade/film.hpp"
#include "toolchain/trade/learned.hpp"

namespace holdfast::trade {

// What others do with the same pictures, told where the markers lie at first; pictures alone. Or with the same markers.
enum class Rival : std::uint8_t {
  kNone,
  kBlobs,         // OpenCV: grey at 1/8, Canny, SimpleBlobDetector: the paper's method
  kBlurredBlobs,  // the same after a Gaussian blur of 5 pixels
  kFlow,          // OpenCV: grey at 1/8, pyramidal Lucas-Kanade: what the vendor's library does
  kFullBlobs,     // the paper's method at full size
  kDesk,          // double precision and OpenCV's DTrees (learned.hpp), markers alone
};

enum class ModelChoice : std::uint8_t { kCommitted, kPaper };

struct Tuning {
  bool library_jpeg = false;  // libjpeg-turbo decodes at every scale, also at 1/8
  int passes = tracker::Config{}.passes;
  std::int32_t window_pct = tracker::Config{}.window_pct;
  std::int32_t imprint_lag_ms = static_cast<std::int32_t>(imprint::Config{}.lag / Micros{1000});
  ModelChoice model = ModelChoice::kCommitted;
  // What the camera sends; a film for each.
  int picture_width = kPictureWidth;
  // Of what was filmed at 25 fps, every so many-th frame.
  int frame_every = 1;
  // From here on what only a run from markers can impose (Grasp).
  int marker_every = 1;  // of the rows, and of the columns
  int centre_bits = 8;   // of a centre's fraction: the rest is rounded away
  // A tree that the run teaches itself, from the markers on: on this feature set, so deep. 0: none.
  std::string_view learned_set;
  int learned_depth = 0;
  Rival rival = Rival::kNone;
  learn::EntropyForm form{};  // of kDesk
};

struct Point {
  std::string knob;
  std::string value;
  std::string mode;  // the shipped mode that this is; empty: none
  Params params;
  Tuning tuning;

  // Whether a picture cannot show it: such a setting is tried on markers alone.
  [[nodiscard]] bool needs_markers() const { return tuning.marker_every > 1 || tuning.centre_bits < 8 || learns(); }
  [[nodiscard]] bool learns() const { return tuning.learned_depth > 0 || tuning.rival == Rival::kDesk; }
};

// The first three are the shipped modes, in their order.
[[nodiscard]] std::vector<Point> points();

// What differs from mode fast, as words that the programs understand which count instructions
// (tests/bench/setting_cost, rival_cost). Nothing: the point needs markers, a desk computer or another film.
[[nodiscard]] std::optional<std::string> settings_of(const Point& point);
[[nodiscard]] std::optional<Rival> find_rival(std::string_view name);

// The pipeline of a point; `tree` as pipeline_config() wants it.
[[nodiscard]] pipeline::Config config_of(const Point& point, const model::Tree* tree);

// What a tracker with fewer markers, or with coarser centres, would have seen. Fewer markers are a coarser lattice.
[[nodiscard]] MarkerField coarsened(const MarkerField& field, const Tuning& tuning);

}  // namespace holdfast::trade
