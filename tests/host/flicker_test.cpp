// SPDX-License-Identifier: Apache-2.0
// What is told of a gel that stands still: nothing at rest, and little where markers stand at the edge of a bin.
//
// A histogram with fixed edges flickers: 63 markers alike, moved to an edge, fall on either side by chance, and E
// swings between 0 and ln 2. That is the paper's feature and stays what it is (`entropy_nat`). So that no gripper feels
// it, the compiled model does not read E or dE/dt at all, and a request takes raise_frames slips in a row. Here every
// place in the histogram's range is held still, with markers that jitter as the tracker's do.
//
// Tried and left out: octave bins (field_features.hpp) that a marker leaves only when it is 3, 6 or 10 um past the
// edge. Their entropy swings half as much then, but the requests below stay (over 420 places 15 become 18, 19 and 26):
// it is not the edges that make them.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <numbers>
#include <random>
#include <set>

#include "app/app.hpp"
#include "drivers/common/jpeg_turbo.hpp"
#include "drivers/sim/camera_scene.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/scene/scenes.hpp"
#include "hal/crew.hpp"
#include "toolchain/learn/calibrate.hpp"
#include "toolchain/treec/tree_model.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace std::chrono_literals;

namespace {

// The working image of mode fast.
constexpr double kPitch_px = 41.0;
constexpr double kPitch_um = 2020.0;
constexpr int kRows = 7, kCols = 9;
constexpr Micros kStep = 40ms;

enum class Form { kUniform, kDome };  // all alike, as a flat object that sticks moves them; or most in the middle

struct Held {
  long frames = 0;
  long slips = 0;     // verdicts
  long requests = 0;  // to tighten, counted when they begin
  double swing_nat = 0.0;
  double rate_nat_s = 0.0;
};

class Gel {
 public:
  Gel(Form form, double jitter_um, const model::Tree* tree)
      : form_(form), jitter_um_(jitter_um), config_(pipeline_config(Params{}, false, tree)) {}

  // 2 s at each place, the first half of it to come to rest, on the way from 0 to the histogram's end and beyond.
  Held hold_everywhere() {
    for (int i = 0; i < 25; ++i) (void)next(0.0);
    Held held;
    double at_um = 0.0;
    for (const double place_um : places()) {
      for (; at_um < place_um; at_um = std::min(place_um, at_um + 10.0)) (void)next(at_um);
      for (int i = 0; i < 25; ++i) (void)next(at_um);
      hold(at_um, held);
    }
    return held;
  }

 private:
  void hold(double at_um, Held& held) {
    double least = 1e9, most = 0.0;
    for (int i = 0; i < 25; ++i) {
      const bool before = raised_;
      const pipeline::Result result = next(at_um);
      CHECK_TRUE(result.quality.ok() && result.referenced);
      const double entropy_nat = result.features.entropy.raw() / 65536.0;
      least = std::min(least, entropy_nat);
      most = std::max(most, entropy_nat);
      held.rate_nat_s = std::max(held.rate_nat_s, std::abs(result.features.entropy_rate.raw() / 256.0));
      held.slips += result.verdict == Verdict::kSlip ? 1 : 0;
      held.requests += raised_ && !before ? 1 : 0;
      ++held.frames;
    }
    held.swing_nat = std::max(held.swing_nat, most - least);
  }

  // Every bin's edge, and places 15 um apart.
  [[nodiscard]] std::set<double> places() const {
    std::set<double> out;
    const double range_um = config_.features.histogram_range_um;
    for (int edge = 1; edge <= kHistogramBins; ++edge) out.insert(range_um * edge / kHistogramBins);
    for (double at = 0.0; at < range_um * 1.1; at += 15.0) out.insert(at);
    return out;
  }

  pipeline::Result next(double shift_um) {
    MarkerField field;
    field.grid = {kRows, kCols};
    for (int i = 0; i < field.grid.count(); ++i) {
      const int row = i / kCols, col = i % kCols;
      const double away = std::hypot(row - 3, col - 4);
      const double share = form_ == Form::kUniform ? 1.0 : std::exp(-away * away / 6.0);
      const auto pixels = [&](int place, double um) {
        const double px = kPitch_px * (place + 1) + (um + jitter_um_ * normal_(random_)) * kPitch_px / kPitch_um;
        return PixelsQ8::from_raw(static_cast<std::int32_t>(std::lround(px * 256.0)));
      };
      field.markers[static_cast<std::size_t>(i)] = {
          .x = pixels(col, share * shift_um), .y = pixels(row, 0.0), .valid = true};
    }
    now_ += kStep;
    const pipeline::Result result = pipeline::update_markers(*state_, config_, field, now_, sequence_++);
    raised_ = result.request == GripRequest::kTighten;
    return result;
  }

  Form form_;
  double jitter_um_;
  pipeline::Config config_;
  std::unique_ptr<pipeline::State> state_ = std::make_unique<pipeline::State>();
  std::mt19937_64 random_{5};
  std::normal_distribution<double> normal_{0.0, 1.0};
  Micros now_ = 1s;
  std::uint32_t sequence_ = 0;
  bool raised_ = false;
};

void tell(const char* who, const char* form, double jitter_um, const Held& held) {
  std::printf("%s, %s, jitter %.1f um: %ld slips and %ld requests in %ld frames; E swings by %.2f nat, dE/dt %.1f\n",
              who, form, jitter_um, held.slips, held.requests, held.frames, held.swing_nat, held.rate_nat_s);
}

}  // namespace

TEST_GROUP(Flicker){};

// 0.6 um is what mode fast makes of the sensor's own picture (README, modes: 0.0104 px of 320), 3 um is a bad one.
TEST(Flicker, NoSlipIsToldWhereAllMarkersStandAtAnEdge) {
  for (const double jitter_um : {0.6, 1.5, 3.0}) {
    const Held held = Gel(Form::kUniform, jitter_um, nullptr).hold_everywhere();
    tell("compiled model", "all alike", jitter_um, held);
    LONGS_EQUAL(0, held.slips);
    // The feature itself: no more than all markers between two bins.
    CHECK_TRUE(held.swing_nat > 0.2 && held.swing_nat <= std::numbers::ln2 + 1e-4);
    CHECK_TRUE(held.rate_nat_s <= std::numbers::ln2 / 0.040 + 1.0 / 256.0);
  }
}

TEST(Flicker, FewRequestsWhereEveryMarkerStandsElsewhere) {
  // No request at the jitter of mode fast. With more of it some places of 154 lie where the model is near its own edge:
  // five requests in 154 s are borne there, 3 and 1 were counted.
  for (const auto& [jitter_um, most] : {std::pair{0.6, 0L}, {1.5, 5L}, {3.0, 5L}}) {
    const Held held = Gel(Form::kDome, jitter_um, nullptr).hold_everywhere();
    tell("compiled model", "a dome", jitter_um, held);
    CHECK_TRUE(held.requests <= most);
  }
}

// The reason why the compiled model does without them.
TEST(Flicker, ThePapersTreeHearsTheEdges) {
  treec::Model text;
  CHECK_FALSE(treec::parse(learn::paper_model_text(), text).has_value());
  const model::Tree paper = treec::to_table(text);
  const Held held = Gel(Form::kUniform, 0.6, &paper).hold_everywhere();
  tell("the paper's tree", "all alike", 0.6, held);
  CHECK_TRUE(held.slips > 0);
}

// The camera's own picture with its noise, JPEG and all, in the default mode; nobody touches the gel.
TEST(Flicker, AnUntouchedGelHasNoEntropyAndNoRate) {
  scene::Scene untouched = scene::sphere_slip();
  untouched.trajectory.resize(1);
  untouched.duration_s = 4.0;
  sim::Clock clock;
  sim::SceneCamera camera(untouched, clock);
  const Params params;
  drivers::TurboJpegDecoder library;
  const auto worker = std::make_unique<jpeg_fast::Worker>();
  hal::Alone crew;
  const auto decoder = std::make_unique<EighthDecoder>(jpeg_config(params), library, std::span(worker.get(), 1), crew);
  const pipeline::Config config = pipeline_config(params);
  const auto state = std::make_unique<pipeline::State>();
  CHECK_TRUE(camera.start());
  hal::Frame frame;
  int judged = 0, moved_um = 0;
  while (camera.next(frame, 1s) == hal::Capture::kFrame) {
    CHECK_TRUE(frame.format == hal::PixelFormat::kMjpeg && frame.width == 3280);
    const pipeline::Result result = pipeline::update(*state, config, *decoder, frame);
    camera.release(frame);
    CHECK_TRUE(result.quality.ok());
    if (!result.referenced) continue;
    ++judged;
    LONGS_EQUAL(63, result.markers);
    LONGS_EQUAL(0, result.features.entropy.raw());
    LONGS_EQUAL(0, result.features.entropy_rate.raw());
    CHECK_TRUE(result.verdict == Verdict::kHold);
    for (const MarkerDisplacement& d : state->displacement.markers) {
      moved_um = std::max({moved_um, std::abs(d.dx.raw()), std::abs(d.dy.raw())});
    }
  }
  std::printf("at rest: E = 0 and dE/dt = 0 in %d of %d frames, the farthest marker at %d um\n", judged, judged,
              moved_um);
  CHECK_TRUE(judged >= 80);
}
