// SPDX-License-Identifier: Apache-2.0
#include "toolchain/trade/knobs.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <initializer_list>
#include <string_view>
#include <utility>

#include "app/app.hpp"

namespace holdfast::trade {
namespace {

class List {
 public:
  Point& add(std::string_view knob, std::string value) {
    Point& point = all_.emplace_back();
    point.knob = knob;
    point.value = std::move(value);
    return point;
  }
  void sweep(std::int32_t Params::*member, std::initializer_list<std::int32_t> values) {
    for (const ParamInfo& row : kParams) {
      if (row.member != member) continue;
      for (const std::int32_t value : values) {
        Point& point = add(row.name, fmt::format("{}{}{}", value, row.unit.empty() ? "" : " ", row.unit));
        point.params.*member = value;
      }
    }
  }
  [[nodiscard]] std::vector<Point> take() { return std::move(all_); }

 private:
  std::vector<Point> all_;
};

}  // namespace

std::vector<Point> points() {
  List list;
  for (std::size_t i = 0; i < kModes.size(); ++i) {
    Point& point = list.add("mode", std::string(kModes[i].name));
    point.mode = kModes[i].name;
    point.params.mode = static_cast<std::int32_t>(i);
  }
  list.sweep(&Params::jpeg_lanes, {0, 1, 2});
  list.add("jpeg_decoder", "libjpeg-turbo").tuning.library_jpeg = true;
  list.sweep(&Params::jpeg_threads, {2});
  for (const int passes : {1, 2, 3}) {
    list.add("passes", fmt::format("{}", passes)).tuning.passes = passes;
  }
  for (const int pct : {50, 100, 150}) {
    list.add("window", fmt::format("{} % of the pitch", pct)).tuning.window_pct = pct;
  }
  for (const int lag_ms : {80, 120, 180}) {
    list.add("imprint lag", fmt::format("{} ms", lag_ms)).tuning.imprint_lag_ms = lag_ms;
  }
  for (const int width : {1640, 640}) {
    list.add("camera", fmt::format("{}x{}", width, picture_height(width))).tuning.picture_width = width;
  }
  list.sweep(&Params::reference_frames, {1, 3, 30});
  list.add("features", "the paper's four").tuning.model = ModelChoice::kPaper;
  for (const int every : {2, 3}) {
    Point& point = list.add("frame rate", fmt::format("{:.3g} fps", 25.0 / every));
    point.tuning.frame_every = every;
    // The gel is left empty for half a second only.
    point.params.reference_frames /= every;
  }
  list.sweep(&Params::raise_frames, {1, 3, 5});
  list.sweep(&Params::hold_ms, {0, 80, 1000});
  list.sweep(&Params::histogram_range_um, {950, 1425, 2850, 3800});
  const auto rival = [&](std::string_view name, Rival which) {
    list.add("others", std::string(name)).tuning.rival = which;
  };
  rival("OpenCV 1/8 + Canny + SimpleBlob", Rival::kBlobs);
  rival("the same after blur", Rival::kBlurredBlobs);
  rival("OpenCV 1/8 + Lucas-Kanade", Rival::kFlow);
  rival("OpenCV full size + Canny + SimpleBlob", Rival::kFullBlobs);
  return list.take();
}

namespace {

constexpr std::array<std::pair<std::string_view, Rival>, 4> kRivals{{{"blobs", Rival::kBlobs},
                                                                     {"blurred_blobs", Rival::kBlurredBlobs},
                                                                     {"flow", Rival::kFlow},
                                                                     {"full_blobs", Rival::kFullBlobs}}};

}  // namespace

std::optional<Rival> find_rival(std::string_view name) {
  const auto* const found = std::ranges::find(kRivals, name, &std::pair<std::string_view, Rival>::first);
  return found == kRivals.end() ? std::nullopt : std::optional(found->second);
}

std::optional<std::string> settings_of(const Point& point) {
  if (point.tuning.picture_width != kPictureWidth) return std::nullopt;
  const auto* const rival = std::ranges::find(kRivals, point.tuning.rival, &std::pair<std::string_view, Rival>::second);
  if (rival != kRivals.end()) return fmt::format("rival={}", rival->first);
  std::string out;
  const auto add = [&](std::string_view name, std::string_view value) {
    out += fmt::format("{}{}={}", out.empty() ? "" : " ", name, value);
  };
  for (const ParamInfo& row : kParams) {
    const std::int32_t value = point.params.*row.member;
    if (value != Params{}.*row.member) add(row.name, fmt::format("{}", value));
  }
  if (point.tuning.passes != Tuning{}.passes) add("passes", fmt::format("{}", point.tuning.passes));
  if (point.tuning.window_pct != Tuning{}.window_pct) add("window_pct", fmt::format("{}", point.tuning.window_pct));
  if (point.tuning.imprint_lag_ms != Tuning{}.imprint_lag_ms) {
    add("imprint_lag_ms", fmt::format("{}", point.tuning.imprint_lag_ms));
  }
  if (point.tuning.library_jpeg) add("decoder", "library");
  if (point.tuning.model == ModelChoice::kPaper) add("features", "paper");
  return out.empty() ? "mode=fast" : out;
}

pipeline::Config config_of(const Point& point, const model::Tree* tree) {
  pipeline::Config config = pipeline_config(point.params, false, tree);
  config.tracker.passes = point.tuning.passes;
  config.tracker.window_pct = point.tuning.window_pct;
  config.imprint.lag = std::chrono::milliseconds(point.tuning.imprint_lag_ms);
  return config;
}

}  // namespace holdfast::trade
