// SPDX-License-Identifier: Apache-2.0
// The settings whose price `holdfast trade` measures: mode fast, and what differs from it in one knob at a time.
//
// Most are parameters of the firmware (params/params.hpp). The others are choices that it has made: how many centrings
// and how large a window. They are swept all the same, because a choice that nobody has priced is a guess; Tuning says
// how each is imposed from outside.
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

namespace holdfast::trade {

// What others do with the same pictures, told where the markers lie at first.
enum class Rival : std::uint8_t {
  kNone,
  kBlobs,         // OpenCV: grey at 1/8, Canny, SimpleBlobDetector: the paper's method
  kBlurredBlobs,  // the same after a Gaussian blur of 5 pixels
  kFlow,          // OpenCV: grey at 1/8, pyramidal Lucas-Kanade: what the vendor's library does
  kFullBlobs,     // the paper's method at full size
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
  Rival rival = Rival::kNone;
};

struct Point {
  std::string knob;
  std::string value;
  std::string mode;  // the shipped mode that this is; empty: none
  Params params;
  Tuning tuning;
};

// The first three are the shipped modes, in their order.
[[nodiscard]] std::vector<Point> points();

// What differs from mode fast, as words that the programs understand which count instructions
// (tests/bench/setting_cost, rival_cost). Nothing: the point needs another film.
[[nodiscard]] std::optional<std::string> settings_of(const Point& point);
[[nodiscard]] std::optional<Rival> find_rival(std::string_view name);

// The pipeline of a point; `tree` as pipeline_config() wants it.
[[nodiscard]] pipeline::Config config_of(const Point& point, const model::Tree* tree);

}  // namespace holdfast::trade
