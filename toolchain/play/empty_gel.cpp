// SPDX-License-Identifier: Apache-2.0
#include "toolchain/play/empty_gel.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "base/math.hpp"
#include "tactile/imprint.hpp"
#include "tactile/reference.hpp"
#include "vision/luma_input.hpp"
#include "vision/tracker.hpp"

namespace holdfast::tool {
namespace {

constexpr int kLeastFrames = 4;             // shorter is no rest
constexpr int kMostFrames = 10;             // averaged, as the device does
constexpr std::size_t kMostIntervals = 48;  // compared with each other
constexpr double kStill = 0.013;            // of the pitch: 0.4 px of 31, 8 sigma of rest noise
constexpr double kSameLight = 0.1;          // of the mean luma: light that flickers or settles
// A picture of the gel as it would be at this mean luma: light scales the relief.
constexpr double kLuma = 128;

// The relief of an object stands in every frame: the tenth patch from the top has so many times that of the middle one,
// and so much at all (levels^2). It refuses none of the 109 recordings with an empty interval and 51 of 91 without one
// (tests/bench/rest.sh, 2026-11-25). A camera with less noise shows less relief more clearly: a simulated knurl of 40
// um 10 times and 0.8.
struct Pressed {
  double times, relief;
};
constexpr std::array<Pressed, 2> kPressed{{{2.8, 4.0}, {5.0, 0.6}}};

double sq(double value) {
  return value * value;
}

struct Interval {
  long first = 0;
  int frames = 0;
  GridSize grid;
  double luma = 0;
  MarkerField begins;
  std::array<double, kMaxMarkers> x{}, y{};
  std::array<int, kMaxMarkers> seen{};
  std::array<std::array<double, imprint::kFree>, imprint::kMaxPatches> patches{};
  std::array<int, imprint::kMaxPatches> shown{};

  [[nodiscard]] long last() const { return first + frames - 1; }
};

// Neighbours within a patch, by their places in Samples.
std::vector<std::pair<std::size_t, std::size_t>> neighbours() {
  std::array<std::array<int, imprint::kSide>, imprint::kSide> at{};
  int next = 0;
  for (int b = 0; b < imprint::kSide; ++b) {
    for (int a = 0; a < imprint::kSide; ++a) at[idx(b)][idx(a)] = imprint::is_free(a, b) ? next++ : -1;
  }
  std::vector<std::pair<std::size_t, std::size_t>> out;
  const auto add = [&](int one, int other) {
    if (one >= 0 && other >= 0) out.emplace_back(idx(one), idx(other));
  };
  for (int b = 0; b < imprint::kSide; ++b) {
    for (int a = 0; a < imprint::kSide; ++a) {
      if (a + 1 < imprint::kSide) add(at[idx(b)][idx(a)], at[idx(b)][idx(a + 1)]);
      if (b + 1 < imprint::kSide) add(at[idx(b)][idx(a)], at[idx(b + 1)][idx(a)]);
    }
  }
  return out;
}

double quantile(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  const auto at = std::min(values.size() - 1, static_cast<std::size_t>(share * static_cast<double>(values.size())));
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(at), values.end());
  return values[at];
}

// Gradient energy of a patch of `a`, or of a - b. Levels^2.
double relief(const Interval& a, const Interval* b, std::size_t patch) {
  static const auto pairs = neighbours();
  double sum = 0;
  for (const auto& [one, other] : pairs) {
    double d = a.patches[patch][one] - a.patches[patch][other];
    if (b != nullptr) d -= b->patches[patch][one] - b->patches[patch][other];
    sum += sq(d);
  }
  return 2 * sum / static_cast<double>(pairs.size());
}

// Second differences of the places of a, or of a - b, where both show them. Pixels^2.
double bend(const Interval& a, const Interval& shown, const Interval* b) {
  double sum = 0;
  const auto add = [&](int i, int step) {
    const std::size_t k[] = {idx(i), idx(i + step), idx(i + 2 * step)};
    for (const std::size_t at : k) {
      if (a.seen[at] == 0 || shown.seen[at] == 0) return;
    }
    const auto second = [&](const std::array<double, kMaxMarkers>& of, const std::array<double, kMaxMarkers>* less) {
      const double d = of[k[0]] - 2 * of[k[1]] + of[k[2]];
      return less == nullptr ? d : d - ((*less)[k[0]] - 2 * (*less)[k[1]] + (*less)[k[2]]);
    };
    sum += sq(second(a.x, b != nullptr ? &b->x : nullptr)) + sq(second(a.y, b != nullptr ? &b->y : nullptr));
  };
  for (int row = 0; row < a.grid.rows; ++row) {
    for (int col = 0; col < a.grid.cols; ++col) {
      if (col + 2 < a.grid.cols) add(row * a.grid.cols + col, 1);
      if (row + 2 < a.grid.rows) add(row * a.grid.cols + col, a.grid.cols);
    }
  }
  return sum;
}

// How much more loaded `a` is than `b`: -2.4 to 2.4, near 0 when both are or the difference is noise.
double vote(const Interval& a, const Interval& b, double pitch) {
  constexpr double kMost = 1.2;
  double difference = 0, weight = 0;
  std::vector<double> changes;
  for (std::size_t patch = 0; patch < imprint::kMaxPatches; ++patch) {
    if (a.shown[patch] == 0 || b.shown[patch] == 0) continue;
    const double change = relief(a, &b, patch);
    difference += change * (relief(a, nullptr, patch) - relief(b, nullptr, patch));
    weight += sq(change);
    changes.push_back(change);
  }
  double out = 0;
  // What changed over what is noise: 2 for two pictures of the same state.
  const double stands_out = quantile(changes, 0.9) / std::max(quantile(changes, 0.25), 0.02);
  if (weight > 0 && stands_out >= 3.5) {
    out += std::clamp(difference / weight, -kMost, kMost) * std::min(1.0, (stands_out - 3) / 3);
  }
  const double bend_a = bend(a, b, nullptr), bend_b = bend(b, a, nullptr), bent = bend(a, b, &b);
  const double least = std::max(std::min(bend_a, bend_b), 1e-9 * sq(pitch));
  const double terms = 4.0 * a.grid.count();  // about: two directions, two axes
  if (bent / terms >= sq(0.0045 * pitch)) {
    out += std::clamp((bend_a - bend_b) / bent, -kMost, kMost) * std::min(1.0, bent / least / 0.3);
  }
  return out;
}

// The intervals at rest, as the frames come.
class Rests {
 public:
  void add(const MarkerField& field, const LumaView& luma, const imprint::State& seen, double pitch, long frame) {
    const double mean = mean_of(luma);
    if (!continues(field, mean, pitch)) {
      close();
      now_ = std::make_unique<Interval>();
      now_->first = frame;
      now_->grid = field.grid;
      now_->luma = mean;
      now_->begins = field;
    }
    ++now_->frames;
    for (std::size_t i = 0; i < idx(field.grid.count()); ++i) {
      const Marker& marker = field.markers[i];
      if (!marker.valid) continue;
      ++now_->seen[i];
      now_->x[i] += marker.x.raw() / 256.0;
      now_->y[i] += marker.y.raw() / 256.0;
    }
    const double scale = kLuma / std::max(mean, 1.0) / 16;
    for (std::size_t patch = 0; patch < imprint::kMaxPatches; ++patch) {
      if (!seen.last.seen[patch]) continue;
      ++now_->shown[patch];
      for (std::size_t i = 0; i < imprint::kFree; ++i) now_->patches[patch][i] += seen.last.samples[patch][i] * scale;
    }
  }

  // Also before a frame that cannot be used.
  void close() {
    if (now_ && now_->frames >= kLeastFrames) keep(std::move(now_));
    now_.reset();
  }

  [[nodiscard]] std::vector<std::unique_ptr<Interval>> take() {
    close();
    if (newest_) kept_.push_back(std::move(newest_));
    return std::move(kept_);
  }

 private:
  static double mean_of(const LumaView& luma) {
    std::uint64_t sum = 0;
    for (int y = 0; y < luma.height; ++y) {
      const std::uint8_t* row = luma.data + static_cast<std::ptrdiff_t>(y) * luma.stride;
      sum = std::accumulate(row, row + luma.width, sum);
    }
    return static_cast<double>(sum) / (static_cast<double>(luma.width) * luma.height);
  }

  [[nodiscard]] bool continues(const MarkerField& field, double luma, double pitch) const {
    if (!now_ || now_->frames >= kMostFrames || now_->grid != field.grid) return false;
    if (std::abs(luma - now_->luma) >= kSameLight * now_->luma) return false;
    const double most = kStill * pitch * 256;
    for (std::size_t i = 0; i < idx(field.grid.count()); ++i) {
      const Marker& before = now_->begins.markers[i];
      const Marker& marker = field.markers[i];
      if (!before.valid || !marker.valid) continue;
      if (std::abs(marker.x.raw() - before.x.raw()) > most || std::abs(marker.y.raw() - before.y.raw()) > most) {
        return false;
      }
    }
    return true;
  }

  // Every `stride_`-th, and always the newest.
  void keep(std::unique_ptr<Interval> interval) {
    for (std::size_t i = 0; i < interval->seen.size(); ++i) {
      interval->x[i] /= std::max(interval->seen[i], 1);
      interval->y[i] /= std::max(interval->seen[i], 1);
    }
    for (std::size_t patch = 0; patch < imprint::kMaxPatches; ++patch) {
      for (double& value : interval->patches[patch]) value /= std::max(interval->shown[patch], 1);
    }
    if (newest_ && (count_ - 1) % stride_ == 0) kept_.push_back(std::move(newest_));
    newest_ = std::move(interval);
    ++count_;
    if (kept_.size() + 1 < kMostIntervals) return;
    std::vector<std::unique_ptr<Interval>> half;
    for (std::size_t i = 0; i < kept_.size(); i += 2) half.push_back(std::move(kept_[i]));
    kept_ = std::move(half);
    stride_ *= 2;
  }

  std::unique_ptr<Interval> now_, newest_;
  std::vector<std::unique_ptr<Interval>> kept_;
  std::size_t count_ = 0, stride_ = 1;
};

// The relief of an object in what should be empty.
bool is_pressed(const Interval& interval, double pitch, std::int32_t most_bend_permille) {
  std::vector<double> all;
  for (std::size_t patch = 0; patch < imprint::kMaxPatches; ++patch) {
    if (interval.shown[patch] > 0) all.push_back(relief(interval, nullptr, patch));
  }
  const double high = quantile(all, 0.9), middle = quantile(all, 0.5);
  for (const Pressed& pressed : kPressed) {
    if (high >= pressed.relief && high > pressed.times * middle) return true;
  }
  const double rms = std::sqrt(bend(interval, interval, nullptr) / (4.0 * interval.grid.count()));
  return rms * 1000 > most_bend_permille * pitch;
}

}  // namespace

sim::Result<EmptyGel> find_empty_gel(sim::Recording& recording, const pipeline::Config& config, JpegDecoder& jpeg,
                                     const std::function<bool(long)>& progress) {
  const auto luma_state = std::make_unique<luma_input::State>();
  const auto tracker_state = std::make_unique<tracker::State>();
  const auto imprint_state = std::make_unique<imprint::State>();
  Saturations saturations;
  Rests rests;
  EmptyGel out;
  out.at_rest = false;
  bool any = false;
  double pitch = 0;
  sim::RecordedFrame frame;
  sim::Read read = sim::Read::kFrame;
  while ((read = recording.next(frame)) == sim::Read::kFrame) {
    if (progress && !progress(frame.index + 1)) break;
    LumaView luma;
    const bool usable = luma_input::update(*luma_state, config.luma, jpeg, sim::as_frame(frame), luma).ok() &&
                        tracker::update(*tracker_state, config.tracker, luma).ok();
    if (!usable) {
      rests.close();
      continue;
    }
    const MarkerField& field = tracker_state->field;
    const PixelsQ8 pitch_now = reference::pitch_of(field);
    if (!any) out.first = out.last = out.frame = frame.index;
    any = true;
    pitch = pitch_now.raw() / 256.0;
    // With an empty gel of zeros the patches hold the picture itself.
    imprint::forget(*imprint_state);
    imprint_state->empty.frames = 1;
    imprint_state->empty.learned.fill(true);
    (void)imprint::update(*imprint_state, config.imprint, luma, field, field, pitch_now, frame.time, saturations);
    rests.add(field, luma, *imprint_state, pitch, frame.index);
  }
  if (read == sim::Read::kError) return sim::Error{recording.error()};
  if (!recording.rewind()) return sim::Error{recording.error()};

  const auto intervals = rests.take();
  if (intervals.empty()) return out;
  std::vector<double> mean(intervals.size()), top(intervals.size());
  for (std::size_t i = 0; i < intervals.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (intervals[i]->grid != intervals[j]->grid) continue;
      const double loaded = vote(*intervals[j], *intervals[i], pitch);  // and the other way round its negative
      mean[i] += loaded / static_cast<double>(intervals.size());
      mean[j] -= loaded / static_cast<double>(intervals.size());
      top[i] = std::max(top[i], loaded);
      top[j] = std::max(top[j], -loaded);
    }
  }
  const double best = *std::max_element(mean.begin(), mean.end());
  // Of those that are as good the longest, then the first: a camera may begin with a few stale pictures.
  std::size_t chosen = intervals.size();
  for (std::size_t i = 0; i < intervals.size(); ++i) {
    if (mean[i] < best - 0.05) continue;
    if (chosen == intervals.size() || intervals[i]->frames > intervals[chosen]->frames) chosen = i;
  }
  const Interval& interval = *intervals[chosen];
  out = {interval.first, interval.last(), (interval.first + interval.last()) / 2, true, top[chosen] >= 0.8};
  if (!is_pressed(interval, pitch, config.reference.most_bend_permille)) return out;
  return sim::Error{fmt::format(
      "{}: something presses on the gel in every frame at rest; frames {} to {} show the least of it. Likely cause: "
      "the "
      "recording begins and ends in the grip, or the gel is scratched or dirty. Next: give a picture of the empty gel "
      "of this sensor with --reference FILE, or one of these frames by its number",
      recording.path().string(), out.first, out.last)};
}

}  // namespace holdfast::tool
