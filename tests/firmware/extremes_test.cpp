// SPDX-License-Identifier: Apache-2.0
// The ends of the stages' ranges and one step beyond: what leaves a range is cut and counted, and nothing wraps. Each
// stage's own test has its ends as far as they are that stage's alone; here is what several share, or had left out.
// Whether an intermediate overflows on the way is for the sanitizer build to see (preset asan).
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <memory>
#include <vector>

#include "app/app.hpp"
#include "app/freshness.hpp"
#include "app/health.hpp"
#include "app/pipeline.hpp"
#include "app/supervisor.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/gpio.hpp"
#include "drivers/sim/serial.hpp"
#include "tests/support/frames.hpp"
#include "tests/support/reference.hpp"
#include "vision/exposure.hpp"
#include "vision/window.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace std::chrono_literals;
using reference_model::Picture;
using test::frame_of;
using test::NoJpeg;

namespace {

constexpr std::int32_t kMost_um = Micrometres::kMax;
constexpr std::array<int, 6> kMarkerCounts{0, 1, 2, 62, 63, 128};
// No clock of ours gets there; the ranges of the stages end there.
constexpr Micros kEndOfTime{(std::int64_t{1} << 62) - 1};

PixelsQ8 raw(std::int64_t q8) {
  return PixelsQ8::from_raw(static_cast<std::int32_t>(q8));
}

MarkerDisplacement moved(std::int32_t dx_um, std::int32_t dy_um) {
  return {Micrometres::from_raw(dx_um), Micrometres::from_raw(dy_um), true};
}

// The first `count` markers, all moved alike; a lattice of 63 or, for more, of 128.
DisplacementField alike(int count, std::int32_t dx_um, std::int32_t dy_um) {
  DisplacementField field;
  field.grid = count <= 63 ? GridSize{7, 9} : GridSize{8, 16};
  for (std::int32_t i = 0; i < count; ++i) field.markers[idx(i)] = moved(dx_um, dy_um);
  return field;
}

// 4 steps of Q8 are a micrometre: displacements of whole micrometres come out of the pixels as they went in.
constexpr std::int32_t kStepsPerUm = 4;
constexpr std::int32_t kPitch_um = 2020;

MarkerField lattice(std::int64_t dx_um, std::int64_t dy_um) {
  MarkerField field;
  for (std::int32_t i = 0; i < field.grid.count(); ++i) {
    const std::int32_t row = i / field.grid.cols;
    const std::int32_t col = i % field.grid.cols;
    field.markers[idx(i)] = {raw((col * kPitch_um + dx_um) * kStepsPerUm), raw((row * kPitch_um + dy_um) * kStepsPerUm),
                             true};
  }
  return field;
}

Picture dots_of(const reference_model::Grid& grid, const scene::PictureConfig& view) {
  return reference_model::picture_of(view, reference_model::lattice_px(grid, view), 1);
}

// One picture again and again, with the stamps it is told.
class StampedCamera final : public hal::Camera {
 public:
  explicit StampedCamera(Picture picture) : picture_(std::move(picture)) {}
  Micros stamp{};

 private:
  [[nodiscard]] bool do_start() override { return true; }
  [[nodiscard]] hal::Capture do_next(hal::Frame& frame, Micros /*timeout*/) override {
    frame = frame_of(picture_);
    frame.timestamp = stamp;
    frame.sequence = sequence_++;
    return hal::Capture::kFrame;
  }
  void do_release(const hal::Frame& /*frame*/) override {}
  void do_stop() override {}
  [[nodiscard]] bool do_live() const override { return false; }

  Picture picture_;
  std::uint32_t sequence_ = 0;
};

void reason_is(Reason want, Reason got) {
  STRCMP_EQUAL(info(want).name.data(), info(got).name.data());
}

}  // namespace

TEST_GROUP(Extremes) {
  Saturations saturations;
  std::unique_ptr<pipeline::State> state = std::make_unique<pipeline::State>();
  pipeline::Config config;
  NoJpeg jpeg;

  void teardown() override {
    state.reset();
  }

  pipeline::Result mark(const MarkerField& field, Micros now, std::uint32_t sequence = 0) {
    return pipeline::update_markers(*state, config, field, now, sequence);
  }
  // Learns the rest position from frames that end at `now`.
  void learn(Micros now, Micros period = 40ms) {
    *state = {};
    for (int k = config.reference.frames - 1; k >= 0; --k) {
      CHECK_TRUE(mark(lattice(0, 0), now - k * period).quality.ok());
    }
    CHECK_TRUE(state->reference.known);
  }
};

// --- What is counted since start ---

TEST(Extremes, CountsOfClampsStayAtTheirEnd) {
  saturations.count = UINT32_MAX - 2;
  for (int k = 0; k < 2; ++k) (void)Micrometres::saturate(kMost_um + 1, saturations);
  UNSIGNED_LONGS_EQUAL(UINT32_MAX, saturations.count);
  (void)Micrometres::saturate(kMost_um + 1, saturations);
  (void)Micrometres::saturate(-kMost_um - 1, saturations);
  UNSIGNED_LONGS_EQUAL(UINT32_MAX, saturations.count);

  // As many as one frame can add: both axes of 128 markers.
  displacement::Config scale;
  MarkerField rest;
  MarkerField now;
  rest.grid = now.grid = {8, 16};
  for (std::int32_t i = 0; i < 128; ++i) {
    rest.markers[idx(i)] = {raw(PixelsQ8::kMin), raw(PixelsQ8::kMax), true};
    now.markers[idx(i)] = {raw(PixelsQ8::kMax), raw(PixelsQ8::kMin), true};
  }
  DisplacementField out;
  saturations.count = UINT32_MAX - 255;
  displacement::update(scale, now, rest, raw(1), saturations, out);
  UNSIGNED_LONGS_EQUAL(UINT32_MAX, saturations.count);
}

TEST(Extremes, CountsOfFrozenAndLateFramesStayAtTheirEnd) {
  health::State watched;
  freshness::State pictures;
  pictures.repeated = watched.late_frames = UINT32_MAX - 1;
  const std::vector<std::uint8_t> pixels(64 * 48, 7);
  const LumaView picture{pixels.data(), 64, 48, 64};
  CHECK_TRUE(freshness::update(pictures, picture, 0).ok());
  for (std::uint32_t k = 1; k <= 3; ++k) {
    reason_is(Reason::kFrameFrozen, freshness::update(pictures, picture, k).reason);
    (void)health::strain(watched, {}, k * Micros{40'000}, k, 10s);
    UNSIGNED_LONGS_EQUAL(UINT32_MAX, pictures.repeated);
    UNSIGNED_LONGS_EQUAL(UINT32_MAX, watched.late_frames);
  }
}

// The count of FAULTs is more than a figure: 0 means that nothing has to be recovered from. If it wrapped, the device
// would confirm the first frame after the 2^32nd FAULT, and forget the latch.
TEST(Extremes, AFaultIsOneHoweverManyCameBefore) {
  for (const bool latch : {false, true}) {
    supervisor::State watched;
    supervisor::Config rules;
    rules.latch = latch;
    pipeline::Result good;
    good.referenced = true;
    good.features.markers = good.markers = good.grid.count();
    Micros now{1s};
    const auto accept = [&] { return supervisor::update(watched, rules, good, now += 40ms); };
    CHECK_TRUE(accept().grip_ok);
    watched.faults = UINT32_MAX;
    (void)supervisor::reject(watched, rules, Reason::kCameraGone, GripRequest::kHold, now += 40ms);
    UNSIGNED_LONGS_EQUAL(UINT32_MAX, watched.faults);
    if (latch) {
      for (int k = 0; k < 10; ++k) reason_is(Reason::kNeedsArm, accept().reason);
      (void)supervisor::reject(watched, rules, Reason::kCameraGone, GripRequest::kHold, now += 40ms);
      supervisor::arm(watched);
    }
    for (int k = 1; k < rules.recover_frames; ++k) reason_is(Reason::kRecovering, accept().reason);
    CHECK_TRUE(accept().grip_ok);
    // And a year on, the frames in a row are still enough of them.
    for (int k = 0; k < 5000; ++k) CHECK_TRUE(accept().grip_ok);
    CHECK_TRUE(watched.good_frames >= rules.recover_frames && watched.good_frames <= 1000);
  }
}

// Sums are kept for 64 frames at most, however long the gel stays empty and however far the markers are.
TEST(Extremes, DriftIsFollowedWithoutSummingUp) {
  reference::State learned;
  reference::Config one;
  one.frames = 1;
  one.most_bend_permille = 0;  // no gel has these places
  MarkerField rest = lattice(0, 0);
  rest.markers[0] = {raw(PixelsQ8::kMin), raw(PixelsQ8::kMin), true};
  CHECK_TRUE(reference::update(learned, one, rest));
  MarkerField far = rest;
  far.markers[0] = {raw(PixelsQ8::kMax), raw(PixelsQ8::kMax), true};
  const std::int32_t limit = learned.pitch.raw() / 20;
  for (int k = 0; k < 100'000; ++k) {
    if (k % 1000 == 999) learned.rest = learned.first;  // so that the offset is the largest again
    (void)reference::follow(learned, one, far);
    CHECK_TRUE(learned.count < one.follow_frames);
    CHECK_TRUE(learned.sum_x_px_q8[0] >= 0 && learned.sum_x_px_q8[0] <= one.follow_frames * 2 * PixelsQ8::kMax);
    CHECK_TRUE(learned.rest.markers[0].x.raw() <= PixelsQ8::kMin + limit);
  }
}

TEST(Extremes, FrameNumbersWrap) {
  health::State watched;
  health::Config rules;
  freshness::State pictures;
  std::vector<std::uint8_t> pixels(64 * 48, 7);
  const auto strain = [&](Micros now, std::uint32_t sequence) {
    health::came(watched);
    return health::strain(watched, rules, now, sequence, 50ms);
  };
  for (const std::uint32_t step : {1U, 2U}) {
    health::restart(watched);
    freshness::restart(pictures);
    std::uint32_t sequence = UINT32_MAX - 20 * step;
    Micros now{};
    for (int k = 0; k < 60; ++k) {
      sequence += step;
      now += step * 40ms;
      pixels[static_cast<std::size_t>(k)] += 1;
      CHECK_TRUE(freshness::update(pictures, {pixels.data(), 64, 48, 64}, sequence).ok());
      reason_is(Reason::kNone, strain(now, sequence));
    }
  }
  // The most that can be lost between two frames: 2^32 - 1 periods, which no gap of 40 ms holds.
  health::restart(watched);
  for (std::uint32_t k = 0; k < 20; ++k) reason_is(Reason::kNone, strain(1h + k * Micros{40'000}, k));
  reason_is(Reason::kFrameRate, strain(1h + 800ms, 3));
  // The pipeline hands them on and judges by time alone.
  learn(1s);
  LONGS_EQUAL(UINT32_MAX, mark(lattice(0, 0), 1s + 40ms, UINT32_MAX).sequence);
  const pipeline::Result after = mark(lattice(40, 0), 1s + 80ms, 0);
  LONGS_EQUAL(0, after.sequence);
  CHECK_TRUE(after.quality.ok());
  LONGS_EQUAL(1000, after.features.vx.raw());
}

// The status frame counts in 16 bits and ALIVE in one; camera frames in 32. All three pass their ends here.
TEST(Extremes, StatusFramesCountOnPastTheirEnd) {
  sim::Clock clock;
  sim::Gpio gpio(clock);
  sim::Serial link;
  StampedCamera camera(reference_model::flat(64, 48, 0));
  const auto app = std::make_unique<App>(Devices{camera, gpio, link, clock, jpeg});
  CHECK_TRUE(app->start(Params{}).ok());
  Features still;
  still.markers = 63;
  const std::uint32_t first = UINT32_MAX - 33'000;
  for (std::uint32_t k = 0; k < 66'000; ++k) {
    clock.advance(40ms);
    link.clear_output();
    app->step_features(still, {7, 9}, clock.now(), first + k);
    const status_frame::Decoded told = status_frame::decode(link.output_bytes());
    CHECK_TRUE(told.ok() && told.frame.grip_ok);
    CHECK_TRUE(told.frame.sequence == (k & 0xFFFF));
    CHECK_TRUE(told.frame.alive == (k % 2 == 0));
    CHECK_TRUE(app->result().sequence == first + k);
  }
  UNSIGNED_LONGS_EQUAL(66'000, gpio.edges(hal::Line::kAlive));
  app->stop();
}

// --- Time ---

// A micrometre is a whole number of steps here, so a speed is off by its own rounding alone.
TEST(Extremes, SpeedsAreRightFrom1To240FramesASecond) {
  for (const int fps : {1, 2, 3, 4, 5, 10, 12, 15, 18, 25, 27, 30, 33, 60, 90, 120, 240}) {
    const Micros period{1'000'000 / fps};
    health::State watched;
    Micros now{1h};
    learn(now, period);
    Reason strain = Reason::kNone;
    for (int k = 1; k <= 3 * fps + 16; ++k) {
      now += period;
      const int back_and_forth = k % 16 < 8 ? k % 8 : 8 - k % 8;
      const pipeline::Result got = mark(lattice(24 * back_and_forth, -8 * back_and_forth), now);
      CHECK_TRUE(got.quality.ok());
      CHECK_EQUAL(period > 250ms, got.features.gap);
      CHECK_EQUAL(period <= 250ms, got.features.rates_valid);
      const double sign = k % 16 < 8 ? 1.0 : -1.0;
      const double per_s = got.features.rates_valid ? sign * 1e6 / static_cast<double>(period.count()) : 0.0;
      if (k % 8 != 0) {
        DOUBLES_EQUAL(24.0 * per_s, got.features.vx.raw(), 0.5 + 1e-9);
        DOUBLES_EQUAL(-8.0 * per_s, got.features.vy.raw(), 0.5 + 1e-9);
      }
      health::came(watched);
      strain = health::strain(watched, {}, now, static_cast<std::uint32_t>(k), 50ms);
    }
    reason_is(fps >= 13 && fps <= 32 ? Reason::kNone : Reason::kFrameRate, strain);
  }
  UNSIGNED_LONGS_EQUAL(0, state->saturations.count);
}

TEST(Extremes, OnlyTimeThatAdvancesCounts) {
  struct Case {
    Micros step;
    bool accepted;
    bool rates;
    bool gap;
  };
  for (const Case& c :
       {Case{0us, false, false, false}, Case{-1us, false, false, false}, Case{-10s, false, false, false},
        Case{1us, true, false, false}, Case{999us, true, false, false}, Case{1ms, true, true, false},
        Case{250ms, true, true, false}, Case{250'001us, true, false, true}, Case{10s, true, false, true},
        Case{24h * 365, true, false, true}, Case{kEndOfTime, true, false, true}}) {
    for (const Micros start : {Micros{400ms}, Micros{0}, -kEndOfTime + 400ms}) {
      if (c.step == kEndOfTime && start > Micros{0}) continue;
      learn(start);
      (void)mark(lattice(0, 0), start + 40ms);
      const Micros at = start + 40ms + c.step;
      const pipeline::Result got = mark(lattice(120, -40), at);
      CHECK_EQUAL(c.accepted, got.quality.ok());
      if (!c.accepted) reason_is(Reason::kTimeNotForward, got.quality.reason);
      CHECK_EQUAL(c.rates, got.features.rates_valid);
      CHECK_EQUAL(c.gap, got.features.gap);
      if (!c.rates) {
        LONGS_EQUAL(0, got.features.vx.raw());
        LONGS_EQUAL(0, got.features.entropy_rate.raw());
      }
      // The next frame of the usual kind is measured from the last one that was accepted.
      const Micros next = (c.accepted ? at : start + 40ms) + 40ms;
      const pipeline::Result after = mark(lattice(160, -40), next);
      CHECK_TRUE(after.features.rates_valid);
      LONGS_EQUAL(c.accepted ? 1000 : 4000, after.features.vx.raw());
      LONGS_EQUAL(c.accepted ? 0 : -1000, after.features.vy.raw());
    }
  }
}

// A stamp that no clock can have is old or from the future, and is refused as such. The age that is reported is the
// oldest.
TEST(Extremes, FramesWithImpossibleStampsAreRefused) {
  sim::Clock clock;
  sim::Gpio gpio(clock);
  sim::Serial link;
  StampedCamera camera(dots_of({}, scene::cropped_320x240()));
  const auto app = std::make_unique<App>(Devices{camera, gpio, link, clock, jpeg});
  clock.advance(1h);
  CHECK_TRUE(app->start(Params{}).ok());
  struct Case {
    std::int64_t stamp_us;
    Reason reason;
  };
  for (const Case& c :
       {Case{INT64_MIN, Reason::kFrameStale}, Case{INT64_MIN + 1, Reason::kFrameStale},
        Case{-kEndOfTime.count(), Reason::kFrameStale}, Case{-1, Reason::kFrameStale}, Case{0, Reason::kFrameStale},
        Case{kEndOfTime.count(), Reason::kTimeNotForward}, Case{INT64_MAX, Reason::kTimeNotForward}}) {
    clock.advance(40ms);
    camera.stamp = Micros{c.stamp_us};
    link.clear_output();
    CHECK_TRUE(app->step());
    reason_is(c.reason, app->result().quality.reason);
    const status_frame::Decoded told = status_frame::decode(link.output_bytes());
    CHECK_TRUE(told.ok());
    LONGS_EQUAL(65'535, told.frame.age_100us);
    CHECK_FALSE(told.frame.grip_ok);
    // And none of them stands in the way of those that follow.
    clock.advance(40ms);
    camera.stamp = clock.now();
    CHECK_TRUE(app->step());
    CHECK_TRUE(app->result().quality.ok());
  }
  app->stop();
}

// --- Markers ---

TEST(Extremes, FewMarkersAndMany) {
  for (const int count : kMarkerCounts) {
    features::State before;
    field_features::State shape;
    const DisplacementField first = alike(count, 300, -400);
    Features got = features::update(before, {}, first, 1s, saturations);
    LONGS_EQUAL(count, got.markers);
    LONGS_EQUAL(count, got.histogram[3]);  // 500 um of 1900 / 15 each
    LONGS_EQUAL(0, got.entropy.raw());
    FieldFeatures field = field_features::update(shape, {}, first, 1s, saturations);
    LONGS_EQUAL(count > 0 ? 500 : 0, field.shift.raw());
    LONGS_EQUAL(count > 2 ? 500 : 0, field.reach.raw());  // the third largest
    LONGS_EQUAL(1024, field.evenness.raw());
    LONGS_EQUAL(0, field.octave_entropy.raw());
    CHECK_TRUE(field.residual.raw() <= 1);

    const DisplacementField second = alike(count, 420, -400);
    got = features::update(before, {}, second, 1s + 120ms, saturations);
    CHECK_EQUAL(count > 0, got.rates_valid);
    LONGS_EQUAL(count > 0 ? 1000 : 0, got.vx.raw());
    LONGS_EQUAL(0, got.vy.raw());
    LONGS_EQUAL(0, got.entropy_rate.raw());
    field = field_features::update(shape, {}, second, 1s + 120ms, saturations);
    LONGS_EQUAL(0, field.flow_spread.raw());
    LONGS_EQUAL(0, field.dilation_rate.raw());
    // cos of (120, 0) and (420, -400)
    DOUBLES_EQUAL(count > 0 ? 1024.0 * 420.0 / 580.0 : 0.0, field.flow_along.raw(), 1.0);
    UNSIGNED_LONGS_EQUAL(0, saturations.count);
  }
}

TEST(Extremes, FewMarkersAreAReasonInThePipeline) {
  for (const int count : {0, 1, 2, 44, 45, 62, 63}) {
    learn(1s);
    MarkerField field = lattice(0, 0);
    for (std::int32_t i = count; i < field.grid.count(); ++i) field.markers[idx(i)].valid = false;
    const pipeline::Result got = mark(field, 1s + 40ms);
    reason_is(count * 100 < 63 * config.fault_markers_pct ? Reason::kMarkersLost : Reason::kNone, got.quality.reason);
    LONGS_EQUAL(count, got.markers);
  }
}

// From all in one bin to as many in each within the shortest step, and back: the largest rates of E, both signs.
TEST(Extremes, OneBinAndOnePerBin) {
  const double rise = std::log(15.0) * 1000.0 * 256.0;
  for (const int each : {1, 2, 4, 8}) {
    features::State before;
    const DisplacementField one = alike(15 * each, 0, 0);
    DisplacementField all = one;
    for (std::int32_t i = 0; i < 15 * each; ++i) all.markers[idx(i)] = moved(0, -(i % 15) * 130);
    (void)features::update(before, {}, one, 0ms, saturations);
    const Features up = features::update(before, {}, all, 1ms, saturations);
    for (const std::uint8_t in_bin : up.histogram) LONGS_EQUAL(each, in_bin);
    LONGS_EQUAL(177'475, up.entropy.raw());  // ln 15 = 2.708050201 nat
    DOUBLES_EQUAL(rise, up.entropy_rate.raw(), 0.6);
    const Features down = features::update(before, {}, one, 2ms, saturations);
    LONGS_EQUAL(0, down.entropy.raw());
    LONGS_EQUAL(-up.entropy_rate.raw(), down.entropy_rate.raw());
  }
  UNSIGNED_LONGS_EQUAL(0, saturations.count);
}

// --- Displacements ---

TEST(Extremes, DisplacementEndsWhereItsFormatDoes) {
  const displacement::Config one_to_one{5000};
  const PixelsQ8 pitch = raw(5000);
  DisplacementField out;
  for (const int sign : {1, -1}) {
    for (const std::int32_t step : {-1, 0, 1}) {
      MarkerField rest;
      MarkerField now;
      rest.markers[0] = now.markers[0] = {raw(0), raw(0), true};
      now.markers[0].x = raw(sign * (kMost_um + step));
      const std::uint32_t before = saturations.count;
      displacement::update(one_to_one, now, rest, pitch, saturations, out);
      LONGS_EQUAL(sign * std::min(kMost_um, kMost_um + step), out.markers[0].dx.raw());
      UNSIGNED_LONGS_EQUAL(step > 0 ? 1 : 0, saturations.count - before);
      LONGS_EQUAL(0, out.markers[0].dy.raw());
    }
  }
}

// floor(15 |D| / R) by another way: floor(sqrt(225 D^2) / R) has the same whole part. Every edge of every range, met
// exactly where it is a whole number, and from one micrometre on either side; then along slanted lines, where D^2 comes
// as near to an edge as integers can.
TEST(Extremes, EveryEdgeOfTheHistogram) {
  const auto check = [](std::int32_t dx, std::int32_t dy, std::int32_t range) {
    DisplacementField field;
    field.grid = {1, 1};
    field.markers[0] = moved(dx, dy);
    const auto scaled = static_cast<std::uint64_t>(225 * (square(dx) + square(dy)));
    const auto bin = std::min<std::uint32_t>(isqrt(scaled) / static_cast<std::uint32_t>(range), kHistogramBins - 1);
    LONGS_EQUAL(1, features::histogram_of(field, range)[bin]);
  };
  for (std::int32_t range = 500; range <= 10'000; ++range) {
    for (std::int32_t edge = 1; edge <= kHistogramBins; ++edge) {
      const std::int32_t above = (edge * range + 14) / 15;
      for (const std::int32_t length : {above - 1, above, above + 1}) check(length, 0, range);
    }
  }
  for (const std::int32_t range : {500, 1900, 1901, 9'999, 10'000}) {
    for (std::int32_t edge = 1; edge < kHistogramBins; ++edge) {
      const std::int64_t edge2 = square(edge * range) / 225;  // no length^2 lies between this and the true square
      for (std::int32_t dx = 1; square(dx) < edge2; dx += 1 + range / 200) {
        const auto dy = static_cast<std::int32_t>(isqrt(static_cast<std::uint64_t>(edge2 - square(dx))));
        check(dx, dy, range);
        check(-dx, dy + 1, range);
        check(-dy, -dx, range);
      }
    }
  }
}

// Bin k from 8 um * sqrt 2^(k-1) on, that is from D^2 = 64 * 2^(k-1).
TEST(Extremes, EveryEdgeOfTheOctaves) {
  for (std::int32_t dx = 0; dx <= 800; ++dx) {
    for (std::size_t k = 1; k < kHistogramBins; ++k) {
      const std::int64_t edge2 = std::int64_t{64} << (k - 1);
      if (square(dx) >= edge2) continue;
      const auto below = static_cast<std::int32_t>(isqrt(static_cast<std::uint64_t>(edge2 - 1 - square(dx))));
      for (const std::int32_t dy : {below, below + 1}) {
        const bool reaches = square(dx) + square(dy) >= edge2;
        CHECK_EQUAL(dy > below, reaches);
        const auto bins = field_features::detail::octaves_of(field_features::detail::vectors_of(alike(1, dx, -dy)));
        int from_k_on = 0;
        for (std::size_t bin = k; bin < kHistogramBins; ++bin) from_k_on += bins[bin];
        LONGS_EQUAL(reaches ? 1 : 0, from_k_on);
      }
    }
  }
  const auto far =
      field_features::detail::octaves_of(field_features::detail::vectors_of(alike(128, kMost_um, -kMost_um)));
  LONGS_EQUAL(128, far[kHistogramBins - 1]);
}

// The corner of the format, 92.68 mm away: lengths do not fit and are cut, means over markers do fit.
TEST(Extremes, LargestDisplacementsOfEverySign) {
  for (const int count : {1, 3, 63, 128}) {
    for (const std::int32_t sx : {-1, 1}) {
      for (const std::int32_t sy : {-1, 1}) {
        Saturations clamps;
        features::State before;
        field_features::State shape;
        const DisplacementField there = alike(count, sx * kMost_um, sy * kMost_um);
        const DisplacementField back = alike(count, -sx * kMost_um, -sy * kMost_um);
        (void)features::update(before, {}, there, 0ms, clamps);
        const Features fast = features::update(before, {}, back, 1ms, clamps);
        LONGS_EQUAL(count, fast.histogram[kHistogramBins - 1]);
        LONGS_EQUAL(-sx * MicrometresPerSec::kMax, fast.vx.raw());
        LONGS_EQUAL(-sy * MicrometresPerSec::kMax, fast.vy.raw());
        UNSIGNED_LONGS_EQUAL(2, clamps.count);

        clamps = {};
        FieldFeatures field = field_features::update(shape, {}, there, 0ms, clamps);
        LONGS_EQUAL(kMost_um, field.shift.raw());
        LONGS_EQUAL(count > 2 ? kMost_um : 0, field.reach.raw());
        UNSIGNED_LONGS_EQUAL(count > 2 ? 2 : 1, clamps.count);
        DOUBLES_EQUAL(1023.5, field.evenness.raw(), 0.5);  // roots are cut off
        CHECK_TRUE(field.residual.raw() <= 1);
        field = field_features::update(shape, {}, back, 100ms, clamps);
        LONGS_EQUAL(1024, field.flow_along.raw());
        LONGS_EQUAL(0, field.flow_spread.raw());
      }
    }
  }
}

// Half of the gel to one end, half to the other, and the other way round a tenth of a second later: 1.85 m/s about a
// mean of 0. Then the field that opens and closes as far as there are numbers for it.
TEST(Extremes, LargestFlows) {
  for (const GridSize grid : {GridSize{7, 9}, GridSize{8, 16}, GridSize{16, 8}, GridSize{1, 128}, GridSize{128, 1}}) {
    for (const std::int32_t sign : {1, -1}) {
      const auto field_of = [&](std::int32_t way, bool opens) {
        DisplacementField field;
        field.grid = grid;
        for (std::int32_t i = 0; i < grid.count(); ++i) {
          const std::int32_t x = 2 * (i % grid.cols) - (grid.cols - 1);
          const std::int32_t y = 2 * (i / grid.cols) - (grid.rows - 1);
          const auto end = [&](std::int32_t place) { return way * kMost_um * (place > 0 ? 1 : place < 0 ? -1 : 0); };
          field.markers[idx(i)] = opens ? moved(end(x), end(y)) : moved(end(i % 2 * 2 - 1), -end(i % 2 * 2 - 1));
        }
        return field;
      };
      field_features::State shape;
      Saturations clamps;
      FieldFeatures got = field_features::update(shape, {}, field_of(sign, false), 0ms, clamps);
      DOUBLES_EQUAL(std::sqrt(2.0) * kMost_um * 16.0, got.residual.raw(), 0.02 * kMost_um * 16.0);
      DOUBLES_EQUAL(1023.5, got.evenness.raw(), 0.5);
      got = field_features::update(shape, {}, field_of(-sign, false), 100ms, clamps);
      DOUBLES_EQUAL(std::sqrt(8.0) * kMost_um * 10.0, got.flow_spread.raw(), 0.001 * kMost_um * 10.0);
      LONGS_EQUAL(1024, got.flow_along.raw());
      DOUBLES_EQUAL(1023.5, got.flow_evenness.raw(), 0.5);

      const field_features::Config smallest_pitch{.pitch_um = 1000};
      field_features::forget(shape);
      (void)field_features::update(shape, smallest_pitch, field_of(-sign, true), 0ms, clamps);
      clamps = {};
      got = field_features::update(shape, smallest_pitch, field_of(sign, true), 100ms, clamps);
      LONGS_EQUAL(sign * StrainPpmPerSec::kMax, got.dilation_rate.raw());
      LONGS_EQUAL(sign > 0 ? 0 : StrainPpmPerSec::kMax, got.easing.raw());
      CHECK_TRUE(clamps.count >= 1);
    }
  }
}

// --- Rest position ---

TEST(Extremes, RestPositionAtTheEndsOfTheFormat) {
  reference::State learned;
  reference::Config rules;
  rules.most_bend_permille = 0;  // no gel has these places
  rules.frames = 100;
  rules.still = raw(PixelsQ8::kMax);
  MarkerField corners;
  corners.grid = {1, 3};
  const auto place = [&](std::int32_t k) {
    corners.markers[0] = {raw(PixelsQ8::kMin + k), raw(PixelsQ8::kMax - k), true};
    corners.markers[1] = {raw(PixelsQ8::kMax - k), raw(PixelsQ8::kMin + k), true};
    corners.markers[2] = corners.markers[0];
  };
  for (int k = 0; k < 100; ++k) {
    place(k % 2 == 0 ? 0 : PixelsQ8::kMax);
    CHECK_EQUAL(k == 99, reference::update(learned, rules, corners));
  }
  LONGS_EQUAL(PixelsQ8::kMin / 2, learned.rest.markers[0].x.raw());
  LONGS_EQUAL(PixelsQ8::kMax / 2, learned.rest.markers[1].x.raw());
  place(0);
  // 11.6 thousand pixels from corner to corner: the pitch ends where its format does.
  LONGS_EQUAL(PixelsQ8::kMax, reference::pitch_of(corners).raw());
}

// --- Pictures ---

// Flat pictures of every level: why there is no gel, at the start and with a gel that was known; and both end with the
// first good picture.
TEST(Extremes, FlatPicturesAreRefusedAndLeaveNothingBehind) {
  const Picture gel = dots_of({}, scene::cropped_320x240());
  Micros now{};
  const auto give = [&](const Picture& picture) {
    hal::Frame frame = frame_of(picture);
    frame.timestamp = now += 40ms;
    return pipeline::update(*state, config, jpeg, frame);
  };
  for (const bool known : {false, true}) {
    for (const int level : {0, 1, 15, 16, 128, 239, 240, 254, 255}) {
      *state = {};
      for (int k = 0; known && k < 12; ++k) CHECK_TRUE(give(gel).quality.ok());
      const Picture flat = reference_model::flat(gel.width, gel.height, static_cast<std::uint8_t>(level));
      const Reason why = level < 16 || level > 239 ? Reason::kExposure
                         : known                   ? Reason::kMarkersLost
                                                   : Reason::kTooFewDots;
      for (int k = 0; k < 3; ++k) reason_is(why, give(flat).quality.reason);
      const pipeline::Result after = give(gel);
      CHECK_TRUE(after.quality.ok());
      LONGS_EQUAL(63, after.markers);
      CHECK_EQUAL(known, after.referenced);
    }
  }
  UNSIGNED_LONGS_EQUAL(0, state->saturations.count);
}

// A disc on a flat ground, from one grey level of contrast to all of them, dark ends and bright ends. One level is
// nothing: the margin takes it. From two on the centre is found.
TEST(Extremes, DotsOfEveryContrast) {
  constexpr std::int32_t kSide = 48, kWindow = 24;
  constexpr double kRadius = 7.3;
  const reference_model::Point centre{23.3, 24.6};
  for (int contrast = 1; contrast <= 255; ++contrast) {
    for (const int ground : {contrast, 255}) {
      Picture picture = reference_model::flat(kSide, kSide, static_cast<std::uint8_t>(ground));
      for (int y = 0; y < kSide; ++y) {
        for (int x = 0; x < kSide; ++x) {
          const double inside = kRadius + 0.5 - std::hypot(x - centre.x, y - centre.y);
          const double share = std::clamp(inside, 0.0, 1.0);
          picture.pixels[static_cast<std::size_t>(y * kSide + x)] =
              static_cast<std::uint8_t>(std::lround(ground - share * contrast));
        }
      }
      const PixelsQ8 start = raw(24 * 256);
      LONGS_EQUAL(contrast, window::contrast_at(picture.view(), kWindow, start, start));
      window::Dot dot{start, start, contrast, 0};
      const bool found = window::measure(picture.view(), kWindow, 4, dot);
      CHECK_EQUAL(contrast > 1, found);
      if (!found) continue;
      LONGS_EQUAL(contrast, dot.contrast);
      // One level of the rim: a tenth of a pixel while there are few levels, a fiftieth when there are many.
      const reference_model::Point at{dot.x.raw() / 256.0, dot.y.raw() / 256.0};
      CHECK_TRUE(reference_model::distance(centre, at) <= (contrast < 16 ? 0.1 : 0.02));
    }
  }
}

// The whole search: nothing below the tracker's ten levels, and everything from where dots stand out of the threshold.
TEST(Extremes, GelsOfEveryContrast) {
  scene::PictureConfig view = scene::cropped_320x240();
  view.noise_sigma = 0.0;
  view.shading = 0.0;
  int first_seen = 0;
  for (int contrast = 1; contrast <= 40; ++contrast) {
    for (const double ground : {60.0, 255.0}) {
      view.background = ground;
      view.dot_level = ground - contrast;
      const auto tracked = std::make_unique<tracker::State>();
      const Picture picture = dots_of({}, view);
      const bool found = tracker::update(*tracked, {}, picture.view()).ok();
      const int markers = found ? tracked->field.valid_count() : 0;
      CHECK_TRUE(markers == 0 || markers == 63);
      if (contrast < 10) LONGS_EQUAL(0, markers);
      if (markers == 63 && first_seen == 0) first_seen = contrast;
      if (first_seen != 0) LONGS_EQUAL(63, markers);
    }
  }
  CHECK_TRUE(first_seen >= 10 && first_seen <= 14);
}

// Markers that are known are followed further down: to the ten levels that the tracker asks of a dot. What fades is
// lost, not guessed, and found again.
TEST(Extremes, GelsThatFade) {
  scene::PictureConfig view = scene::cropped_320x240();
  view.noise_sigma = 0.0;
  view.shading = 0.0;
  const auto tracked = std::make_unique<tracker::State>();
  const auto markers_at = [&](int contrast) {
    view.dot_level = view.background - contrast;
    const Picture picture = dots_of({}, view);
    CHECK_TRUE(tracker::update(*tracked, {}, picture.view()).ok());
    return tracked->field.valid_count();
  };
  for (int contrast = 75; contrast >= 1; contrast -= 1 + contrast / 20) {
    LONGS_EQUAL(contrast >= 10 ? 63 : 0, markers_at(contrast));
  }
  LONGS_EQUAL(63, markers_at(75));
}

TEST(Extremes, ExposureOfPicturesTooSmallToSample) {
  const std::array<std::uint8_t, 64> black{};
  for (std::int32_t side = 0; side <= 8; ++side) {
    CHECK_EQUAL(side > exposure::kStep / 2, exposure::is_bad({black.data(), side, side, side}));
  }
}
