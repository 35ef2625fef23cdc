// SPDX-License-Identifier: Apache-2.0
// The whole chain from luma to request: which frames it refuses and why, what it keeps, and that the figures of
// rendered motion are those of the double reference on the true positions.
#include "app/pipeline.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <numbers>
#include <vector>

#include "tests/support/frames.hpp"
#include "tests/support/reference.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::reference_model;
using namespace std::chrono_literals;
using test::frame_of;

TEST_GROUP(Pipeline) {
  std::unique_ptr<pipeline::State> state = std::make_unique<pipeline::State>();
  pipeline::Config config;
  test::PictureJpeg jpeg;
  scene::PictureConfig view = scene::cropped_320x240();
  Grid grid;
  Micros now{1s};
  std::uint64_t seed = 200;
  std::vector<Point> truth;

  Picture picture(const Warp& warp = {}) {
    truth = lattice_px(grid, view, warp);
    return picture_of(view, truth, ++seed);
  }
  pipeline::Result give(hal::Frame frame, Micros after = 40ms) {
    now += after;
    frame.timestamp = now;
    return pipeline::update(*state, config, jpeg, frame);
  }
  pipeline::Result show(const Warp& warp = {}, Micros after = 40ms) {
    const Picture shown = picture(warp);
    return give(frame_of(shown), after);
  }
  void rejects(Reason why, const pipeline::Result& result) {
    LONGS_EQUAL(static_cast<int>(why), static_cast<int>(result.quality.reason));
  }
  // A highlight in the middle of some dots: the search finds them, their windows do not take them for dots.
  Picture with_highlights(const std::function<bool(std::size_t)>& on) {
    Picture shown = picture();
    for (std::size_t i = 0; i < truth.size(); ++i) {
      if (on(i)) draw_disc(shown, truth[i], 4.0, 150);
    }
    return shown;
  }
  // Learns from ten still frames.
  void learn() {
    for (int k = 0; k < 10; ++k) CHECK_TRUE(show().quality.ok());
    CHECK_TRUE(state->reference.known);
  }
};

TEST(Pipeline, LearnsFromTheFirstStillFramesThenMeasures) {
  for (int k = 1; k <= 12; ++k) {
    const pipeline::Result result = show();
    CHECK_TRUE(result.quality.ok());
    LONGS_EQUAL(63, result.markers);
    CHECK_TRUE((GridSize{7, 9}) == result.grid);
    CHECK_EQUAL(k >= 10, result.referenced);
    CHECK_EQUAL(k >= 11, result.features.rates_valid);
    CHECK_TRUE(result.timestamp == now);
  }
  LONGS_EQUAL(0, state->saturations.count);
}

// A camera's first frames: dark, lighter, and then as it stays. The ten still frames count from the last step on, in
// the light of which the lattice is registered; a step that comes later, within the ten, begins them again.
TEST(Pipeline, LearnsNothingWhileTheLightSettles) {
  const auto show_at = [&](int percent) {
    Picture shown = picture();
    for (std::uint8_t& level : shown.pixels) level = static_cast<std::uint8_t>(level * percent / 100);
    return give(frame_of(shown), 40ms);
  };
  int frames = 0;
  for (const int percent : {74, 97, 100, 100, 100, 96}) {
    const pipeline::Result result = show_at(percent);
    CHECK_TRUE(result.quality.ok());
    CHECK_FALSE(result.referenced);
    CHECK_EQUAL(frames > 0, result.light_changed);
    ++frames;
  }
  for (int k = 2; k <= 10; ++k) {
    const pipeline::Result result = show_at(96);
    CHECK_EQUAL(k == 10, result.referenced);
  }
  CHECK_FALSE(show_at(70).light_changed);  // learned: the light may change
  pipeline::tare(*state);
  CHECK_FALSE(show_at(70).light_changed);  // begins in this light
}

// What is learned while something presses is refused and said; when it is gone the empty gel is learned. A TARE after
// the refusal confirms that the gel is empty.
TEST(Pipeline, RefusesARestPositionLearnedInContact) {
  const Warp pressed = bulged(0.6, 2.0);
  const auto ten = [&](const Warp& warp) {
    pipeline::Result result;
    for (int k = 0; k < 12; ++k) result = show(warp);  // the first may only end the stillness
    return result;
  };
  pipeline::Result result = ten(pressed);
  CHECK_TRUE(result.quality.ok());
  CHECK_TRUE(result.bent);
  CHECK_FALSE(result.referenced);
  result = ten({});
  CHECK_FALSE(result.bent);
  CHECK_TRUE(result.referenced);
  pipeline::tare(*state);
  CHECK_TRUE(ten(pressed).bent);  // nothing was refused before: a TARE alone is no confirmation
  pipeline::tare(*state);
  CHECK_TRUE(ten(pressed).referenced);
  pipeline::tare(*state);
  CHECK_TRUE(ten(pressed).bent);  // and one confirmation is for one rest position
  pipeline::forget(*state);
  CHECK_TRUE(ten(pressed).bent);  // other settings confirm nothing
  pipeline::tare(*state);
  CHECK_TRUE(ten(pressed).referenced);
  pipeline::forget(*state);
  CHECK_TRUE(ten(pressed).bent);  // nor does what was confirmed last
}

// A light that never settles is said in every frame, however long it lasts; nothing is learned in it.
TEST(Pipeline, SaysThatTheLightNeverSettles) {
  for (int k = 0; k < 500; ++k) {
    Picture shown = picture();
    const int percent = 80 + k * 7 % 20;
    for (std::uint8_t& level : shown.pixels) level = static_cast<std::uint8_t>(level * percent / 100);
    const pipeline::Result result = give(frame_of(shown), 40ms);
    CHECK_TRUE(result.quality.ok());
    CHECK_FALSE(result.referenced);
    CHECK_EQUAL(k > 0, result.light_changed);
  }
}

// Displacement against rendered truth. Centres: 0.029 px rms in two axes, 0.0205 px each; of a displacement with the
// rest mean of 10 frames 0.0215 px = 1.36 um. V is a mean over 63 markers of two of them: 0.23 um / dt, and the common
// part of the rest error drops out; E is compared through the histogram of the firmware's own displacements.
TEST(Pipeline, MeasuresWhatTheTruthSays) {
  learn();
  const std::vector<Point> rest_px = truth;
  Positions rest(rest_px.begin(), rest_px.end());
  const double pitch_px = 2.02 * view.px_per_mm;
  Model model;
  double sum_um2 = 0.0;
  int n = 0;
  for (int frame = 0; frame < 40; ++frame) {
    const double t = frame * 0.15;
    const pipeline::Result result = show(
        chained(gaussian({0.4, -0.3}, 3.5, 0.9 * std::sin(t), 0.5 * std::sin(0.7 * t)), rotated(0.5 * std::sin(t))));
    CHECK_TRUE(result.quality.ok() && result.referenced);
    const reference_model::Features want =
        model.update(Positions(truth.begin(), truth.end()), rest, pitch_px, now.count());
    LONGS_EQUAL(want.markers, result.features.markers);
    for (std::size_t i = 0; i < 63; ++i) {
      const MarkerDisplacement& d = state->displacement.markers[i];
      CHECK_TRUE(d.valid);
      const double scale_um = 2020.0 / pitch_px;
      const double off_x = d.dx.raw() - (truth[i].x - rest_px[i].x) * scale_um;
      const double off_y = d.dy.raw() - (truth[i].y - rest_px[i].y) * scale_um;
      sum_um2 += off_x * off_x + off_y * off_y;
      ++n;
    }
    // The firmware's own displacements, in double: the same histogram and entropy.
    Displacements own(63);
    for (std::size_t i = 0; i < 63; ++i) {
      own[i] = Point{static_cast<double>(state->displacement.markers[i].dx.raw()),
                     static_cast<double>(state->displacement.markers[i].dy.raw())};
    }
    const Histogram histogram = histogram_of(own, 1900.0);
    for (std::size_t b = 0; b < kHistogramBins; ++b) LONGS_EQUAL(histogram[b], result.features.histogram[b]);
    DOUBLES_EQUAL(static_cast<double>(entropy_long_double(histogram)), result.features.entropy.raw() / 65536.0, 1e-5);
    if (frame == 0) continue;
    CHECK_TRUE(result.features.rates_valid);
    // 6 sigma of 0.23 um / 40 ms = 35 um/s, and 1 % of the speed: the registered pitch is that well known.
    DOUBLES_EQUAL(want.vx_um_s, result.features.vx.raw(), 35.0 + 0.01 * std::abs(want.vx_um_s));
    DOUBLES_EQUAL(want.vy_um_s, result.features.vy.raw(), 35.0 + 0.01 * std::abs(want.vy_um_s));
  }
  // 2-D: 0.029 px and the rest's share are 1.92 um; 0.58 um of rounding twice; 1 % of pitch on up to 1 mm: 3 um.
  CHECK_TRUE(std::sqrt(sum_um2 / n) <= 3.6);
}

TEST(Pipeline, DecidesTheSameWithoutTheForces) {
  learn();
  const auto without = std::make_unique<pipeline::State>(*state);
  pipeline::Config no_load = config;
  no_load.with_load = false;
  const Picture shown = picture(chained(gaussian({0.4, -0.3}, 3.5, 0.9, 0.5), rotated(0.5)));
  const pipeline::Result with_forces = give(frame_of(shown));
  hal::Frame frame = frame_of(shown);
  frame.timestamp = now;
  const pipeline::Result result = pipeline::update(*without, no_load, jpeg, frame);
  CHECK_TRUE(with_forces.load.basis == load::Basis::kNominal && with_forces.load.shear_x.raw() != 0);
  CHECK_TRUE(result.load.basis == load::Basis::kNone);
  LONGS_EQUAL(0, result.load.shear_x.raw());
  LONGS_EQUAL(with_forces.features.entropy.raw(), result.features.entropy.raw());
  LONGS_EQUAL(with_forces.features.vx.raw(), result.features.vx.raw());
}

// A relief that goes by its own pitch in four frames looks as if it stood still. While a slip of the hand is raised, by
// whichever finger, a picture of three frames ago is looked at as well.
TEST(Pipeline, LooksAtASecondPictureWhileTheHandSlips) {
  config.with_imprint = config.judges_contact = true;
  learn();
  for (int k = 0; k < 20; ++k) {
    Picture shown = picture();
    for (int y = 60; y < 180; ++y) {
      for (int x = 80; x < 240; ++x) {
        std::uint8_t& pixel = shown.pixels[static_cast<std::size_t>(y * shown.width + x)];
        if (pixel > 90) pixel = static_cast<std::uint8_t>(pixel + 8 * ((x + 3 * k) % 12 < 6 ? 1 : -1));
      }
    }
    const auto other = std::make_unique<pipeline::State>(*state);
    const pipeline::Result alone = give(frame_of(shown));
    CHECK_TRUE(alone.quality.ok());
    other->decision.raised = state->decision.raised = false;
    hal::Frame frame = frame_of(shown);
    frame.timestamp = now;
    const pipeline::Result both = pipeline::update(*other, config, jpeg, frame, true);
    if (k < 12) continue;
    CHECK_TRUE(alone.features.imprint.turnover.raw() < 100);
    CHECK_TRUE(both.features.imprint.turnover.raw() > 500);
  }
}

TEST(Pipeline, RefusesFramesThatDoNotComeForward) {
  learn();
  rejects(Reason::kTimeNotForward, show({}, 0us));
  rejects(Reason::kTimeNotForward, show({}, -1us));
  now += 1us;
  rejects(Reason::kTimeNotForward, show({}, -10s));
  now += 10s;
  const pipeline::Result next = show();
  CHECK_TRUE(next.quality.ok());
  CHECK_TRUE(next.features.rates_valid);
}

TEST(Pipeline, RefusesFramesThatContradictThemselves) {
  learn();
  const Picture shown = picture();
  const hal::Frame good = frame_of(shown);
  const auto with = [&](auto change) {
    hal::Frame frame = good;
    change(frame);
    return give(frame);
  };
  rejects(Reason::kFrameFormat, with([](hal::Frame& f) { f.width = 0; }));
  rejects(Reason::kFrameFormat, with([](hal::Frame& f) { f.height = 0; }));
  rejects(Reason::kFrameFormat, with([](hal::Frame& f) { f.height = -240; }));
  rejects(Reason::kFrameFormat, with([](hal::Frame& f) { f.width = -320; }));
  rejects(Reason::kFrameFormat, with([](hal::Frame& f) { f.stride = 319; }));
  rejects(Reason::kFrameFormat, with([](hal::Frame& f) { f.stride = -320; }));
  rejects(Reason::kFrameFormat, with([](hal::Frame& f) { f.bytes = {}; }));
  rejects(Reason::kFrameFormat, with([](hal::Frame& f) { f.bytes = f.bytes.first(f.bytes.size() - 1); }));
  rejects(Reason::kFrameFormat, with([](hal::Frame& f) { f.width = f.height = f.stride = INT32_MAX; }));
  rejects(Reason::kFrameFormat, with([](hal::Frame& f) { f.height = 239; }));  // another size than before
  CHECK_TRUE(give(good).quality.ok());
}

TEST(Pipeline, RefusesPicturesOutsideItsMemory) {
  const Picture small = flat(63, 48, 100);
  const Picture low = flat(64, 47, 100);
  const Picture large = flat(1641, 1232, 100);
  const Picture high = flat(1640, 1233, 100);
  rejects(Reason::kPictureTooSmall, give(frame_of(small)));
  rejects(Reason::kPictureTooSmall, give(frame_of(low)));
  rejects(Reason::kPictureTooSmall, give(frame_of(flat(1, 1, 0))));
  rejects(Reason::kPictureTooLarge, give(frame_of(large)));
  rejects(Reason::kPictureTooLarge, give(frame_of(high)));
  // A refused picture does not fix the size of the stream.
  CHECK_TRUE(show().quality.ok());
}

// The last row need not be padded to the stride.
TEST(Pipeline, TakesAPaddedPictureThatEndsWithItsLastPixel) {
  const Picture plain = picture();
  constexpr std::size_t kStride = 333;
  std::unique_ptr<std::uint8_t[]> block(new std::uint8_t[239 * kStride + 320]);
  for (std::size_t y = 0; y < 240; ++y)
    std::copy_n(plain.pixels.begin() + static_cast<std::ptrdiff_t>(y * 320), 320, block.get() + y * kStride);
  hal::Frame frame = frame_of(plain);
  frame.bytes = {block.get(), 239 * kStride + 320};
  frame.stride = kStride;
  const pipeline::Result result = give(frame);
  CHECK_TRUE(result.quality.ok());
  LONGS_EQUAL(63, result.markers);
}

// 71 % of 63 is 44.7: 45 are enough. The dots go one by one from the inside, so that no outer line is hidden
// and no name is in doubt; several at once would look like a jump.
TEST(Pipeline, RefusesFramesWithTooFewMarkers) {
  learn();
  const auto all = lattice_px(grid, view);
  std::vector<std::size_t> inner;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (i % 9 > 0 && i % 9 < 8 && i / 9 > 0 && i / 9 < 6) inner.push_back(i);
  }
  for (std::size_t gone = 1; gone <= 22; ++gone) {
    std::vector<Point> left;
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (std::find(inner.begin(), inner.begin() + static_cast<std::ptrdiff_t>(gone), i) ==
          inner.begin() + static_cast<std::ptrdiff_t>(gone))
        left.push_back(all[i]);
    }
    const Picture shown = picture_of(view, left, gone);
    const pipeline::Result result = give(frame_of(shown));
    LONGS_EQUAL(63 - gone, result.markers);
    rejects(gone <= 18 ? Reason::kNone : Reason::kMarkersLost, result);
    CHECK_EQUAL(gone <= 18, result.referenced);
  }
  CHECK_TRUE(show().quality.ok());
}

TEST(Pipeline, SaysWhyThereIsNoLattice) {
  rejects(Reason::kTooFewDots, give(frame_of(flat(320, 240, 90))));
  config.tracker.grid.size = {8, 10};
  rejects(Reason::kGridMismatch, show());
  CHECK_TRUE((GridSize{7, 9}) == state->tracker.found);
}

TEST(Pipeline, PassesTheDecodersReasonOn) {
  hal::Frame frame;
  frame.width = 3280;
  frame.height = 2464;
  jpeg.picture = picture();
  jpeg.status = {Reason::kJpegDamaged};
  rejects(Reason::kJpegDamaged, give(frame));
  jpeg.status = {};
  CHECK_TRUE(give(frame).quality.ok());
  LONGS_EQUAL(2, jpeg.calls);
  LONGS_EQUAL(8, static_cast<int>(jpeg.asked));
}

// Time is judged first: a picture seen twice is not decoded twice.
TEST(Pipeline, DoesNotDecodeAFrameThatIsNotNewer) {
  hal::Frame frame;
  frame.width = 3280;
  jpeg.picture = picture();
  CHECK_TRUE(give(frame).quality.ok());
  rejects(Reason::kTimeNotForward, give(frame, 0us));
  LONGS_EQUAL(1, jpeg.calls);
}

// Small cameras are decoded at a finer scale, so that at least 300 columns remain, or all there are.
TEST(Pipeline, DecodesSmallCamerasAtAFinerScale) {
  struct Case {
    DecodeScale mode;
    std::int32_t width;
    int denominator;
  };
  for (const Case& c : {Case{DecodeScale::kEighth, 3280, 8},
                        {DecodeScale::kEighth, 2400, 8},
                        {DecodeScale::kEighth, 2399, 4},
                        {DecodeScale::kEighth, 1280, 4},
                        {DecodeScale::kEighth, 640, 2},
                        {DecodeScale::kEighth, 320, 1},
                        {DecodeScale::kQuarter, 3280, 4},
                        {DecodeScale::kHalf, 3280, 2},
                        {DecodeScale::kHalf, 320, 1},
                        {DecodeScale::kFull, 3280, 1}}) {
    LONGS_EQUAL(c.denominator, static_cast<int>(luma_input::scale_for(c.mode, c.width)));
  }
}

// hal/camera.hpp: the width of an MJPEG frame may be 0, not announced. It was taken for a camera too small to reduce.
TEST(Pipeline, DecodesAtTheModesScaleWhenTheWidthIsNotAnnounced) {
  for (const DecodeScale scale :
       {DecodeScale::kEighth, DecodeScale::kQuarter, DecodeScale::kHalf, DecodeScale::kFull}) {
    config.luma.scale = scale;
    hal::Frame frame;
    jpeg.picture = picture();
    CHECK_TRUE(give(frame).quality.ok());
    LONGS_EQUAL(static_cast<int>(scale), static_cast<int>(jpeg.asked));
    LONGS_EQUAL(static_cast<int>(scale), luma_input::reduction(config.luma, frame));
    LONGS_EQUAL(1, luma_input::reduction(config.luma, frame_of(jpeg.picture)));  // luma is worked on as it comes
  }
}

// Rates stand on the last accepted frame, however many bad ones lie between, up to max_gap.
TEST(Pipeline, MeasuresAcrossRejectedFrames) {
  learn();
  (void)show();
  const Picture black = flat(320, 240, 0);
  for (int k = 0; k < 3; ++k) CHECK_FALSE(give(frame_of(black), 30ms).quality.ok());
  // 0.16 mm within 130 ms.
  pipeline::Result result = show(shifted(0.16, 0.0), 40ms);
  CHECK_TRUE(result.quality.ok() && result.features.rates_valid);
  DOUBLES_EQUAL(0.16e3 / 0.130, result.features.vx.raw(), 25.0);
  result = show(shifted(0.16, 0.0), 251ms);
  CHECK_TRUE(result.quality.ok());
  CHECK_FALSE(result.features.rates_valid);
}

// What was asked of the gripper stays asked while frames are bad.
TEST(Pipeline, KeepsTheRequestOverRejectedFrames) {
  learn();
  state->decision.raised = true;
  state->decision.last_slip = now;
  const Picture black = flat(320, 240, 0);
  for (int k = 0; k < 20; ++k) {
    const pipeline::Result result = give(frame_of(black));
    CHECK_FALSE(result.quality.ok());
    CHECK_FALSE(result.referenced);
    LONGS_EQUAL(static_cast<int>(GripRequest::kTighten), static_cast<int>(result.request));
  }
}

// 0.03 mm aside, as a gel that warms: no contact, and the rest position comes after it, 1/32 px in 64 frames. What
// touches the gel is not followed, nor is anything unless it was asked for.
TEST(Pipeline, LetsTheRestPositionFollowAnEmptyGel) {
  config.with_imprint = true;
  for (const bool follows : {false, true}) {
    for (const double drift_mm : {0.03, 0.2}) {
      config.follow_drift = follows;
      pipeline::tare(*state);
      learn();
      const std::int32_t learned = state->reference.rest.markers[31].x.raw();
      for (int k = 0; k < 13 + 64; ++k) (void)show(shifted(drift_mm, 0.0));
      const std::int32_t rest = state->reference.rest.markers[31].x.raw();
      LONGS_EQUAL(follows && drift_mm < 0.1 ? 8 : 0, rest - learned);
      LONGS_EQUAL(rest, state->tracker.home.x[31].raw());
    }
  }
}

// However often the process is started anew: a slow shear would be followed away otherwise.
TEST(Pipeline, FollowsDriftFromWhatAnEarlierProcessLearned) {
  config.with_imprint = config.follow_drift = true;
  learn();
  const MarkerField learned = state->reference.rest;
  for (int k = 0; k < 13 + 64; ++k) (void)show(shifted(0.03, 0.0));
  CHECK_TRUE(state->reference.rest.markers[31].x.raw() > learned.markers[31].x.raw());
  const auto kept = std::make_unique<checkpoint::Contents>();
  pipeline::remember(*state, config, *kept);
  state = std::make_unique<pipeline::State>();
  pipeline::resume(*state, *kept);
  CHECK_TRUE(show(shifted(0.03, 0.0)).referenced);
  LONGS_EQUAL(learned.markers[31].x.raw(), state->reference.first.markers[31].x.raw());
}

// What another process kept is the rest position of one gel in one picture. A marker that either of the two does not
// see cannot contradict.
TEST(Pipeline, ResumesWithWhatFitsTheFirstPicture) {
  learn();
  const std::vector<Point> all = truth;
  const auto kept = std::make_unique<checkpoint::Contents>();
  pipeline::remember(*state, config, *kept);
  const auto resumes = [&](const std::function<void(checkpoint::Contents&)>& change, const Picture& shown) {
    const auto changed = std::make_unique<checkpoint::Contents>(*kept);
    change(*changed);
    state = std::make_unique<pipeline::State>();
    pipeline::resume(*state, *changed);
    const pipeline::Result result = give(frame_of(shown));
    CHECK_TRUE(result.quality.ok());
    CHECK_EQUAL(state->reference.known, result.referenced);
    return result.referenced;
  };
  const Picture shown = picture();
  const auto moved = [&](checkpoint::Contents& c, double pitches) {
    Marker& marker = c.rest.markers[31];
    marker.x = PixelsQ8::from_raw(marker.x.raw() + static_cast<std::int32_t>(pitches * c.pitch.raw()));
  };
  CHECK_TRUE(resumes([](checkpoint::Contents&) {}, shown));
  CHECK_TRUE(resumes([&](checkpoint::Contents& c) { moved(c, 1.4); }, shown));
  CHECK_FALSE(resumes([&](checkpoint::Contents& c) { moved(c, 1.6); }, shown));
  CHECK_TRUE(resumes(
      [&](checkpoint::Contents& c) {
        moved(c, 1.6);
        c.rest.markers[31].valid = false;
      },
      shown));
  std::vector<Point> fewer = all;
  fewer.erase(fewer.begin() + 31);
  CHECK_TRUE(resumes([&](checkpoint::Contents& c) { moved(c, 1.6); }, picture_of(view, fewer, 1)));
  CHECK_FALSE(resumes([](checkpoint::Contents& c) { c.rest.grid = {9, 7}; }, shown));
  CHECK_FALSE(resumes([](checkpoint::Contents& c) { c.width = 640; }, shown));
  CHECK_FALSE(resumes([](checkpoint::Contents& c) { c.height = 200; }, shown));
  // Markers alone have no picture whose size could differ.
  kept->width = 640;
  const MarkerField field = state->tracker.field;
  pipeline::resume(*state, *kept);
  CHECK_TRUE(pipeline::update_markers(*state, config, field, now + 40ms, 1).referenced);
}

// A tree that says slip to everything is not heard on the empty gel, where the picture can tell that it is empty.
// Features that are only recorded change no verdict.
TEST(Pipeline, NothingSlipsWithoutContactWhereThePictureIsRead) {
  const model::Tree always;
  config.classifier.loaded = &always;
  for (const auto& [computed, reads] : {std::pair{false, false}, {true, false}, {true, true}}) {
    config.with_imprint = computed;
    config.judges_contact = reads;
    pipeline::tare(*state);
    learn();
    for (int k = 0; k < 5; ++k) {
      const pipeline::Result result = show();
      CHECK_EQUAL(reads, result.contact.judged);
      CHECK_FALSE(result.contact.touching);
      LONGS_EQUAL(reads ? 0 : 1, result.features.contact.raw());
      LONGS_EQUAL(static_cast<int>(reads ? Verdict::kHold : Verdict::kSlip), static_cast<int>(result.verdict));
    }
  }
  // Dots that moved are a contact, too.
  for (int k = 0; k < 3; ++k) (void)show(shifted(0.2, 0.0));
  const pipeline::Result touched = show(shifted(0.2, 0.0));
  CHECK_TRUE(touched.contact.touching);
  LONGS_EQUAL(static_cast<int>(Verdict::kSlip), static_cast<int>(touched.verdict));
  // What the gripper lets go does not slip, and its contact is not lost but released.
  pipeline::opening(*state, true);
  LONGS_EQUAL(static_cast<int>(Verdict::kHold), static_cast<int>(show(shifted(0.2, 0.0)).verdict));
  contact::Event last = contact::Event::kNone;
  for (int k = 0; k < 8 && last == contact::Event::kNone; ++k) last = show().contact.event;
  LONGS_EQUAL(static_cast<int>(contact::Event::kReleased), static_cast<int>(last));
  pipeline::opening(*state, false);
}

TEST(Pipeline, TakesOneFrameForTheReference) {
  const Picture empty = picture();
  CHECK_TRUE(pipeline::learn(*state, config, jpeg, frame_of(empty)).ok());
  const pipeline::Result result = show(shifted(0.3, -0.2));
  CHECK_TRUE(result.quality.ok() && result.referenced);
  DOUBLES_EQUAL(300.0, state->displacement.markers[31].dx.raw(), 8.0);
  DOUBLES_EQUAL(-200.0, state->displacement.markers[31].dy.raw(), 8.0);
  for (const bool reads : {false, true}) {
    config.with_imprint = reads;
    CHECK_TRUE(pipeline::learn(*state, config, jpeg, frame_of(empty)).ok());
    LONGS_EQUAL(reads ? 1 : 0, state->imprint.empty.frames);
  }
}

TEST(Pipeline, SaysWhyAPictureIsNoReference) {
  const auto why = [&](const Picture& shown) {
    return static_cast<int>(pipeline::learn(*state, config, jpeg, frame_of(shown)).reason);
  };
  LONGS_EQUAL(static_cast<int>(Reason::kTooFewDots), why(flat(320, 240, 100)));
  LONGS_EQUAL(static_cast<int>(Reason::kFrameFormat), why(flat(160, 120, 100)));  // the stream has its size now
  config.tracker.grid.size = {9, 7};
  LONGS_EQUAL(static_cast<int>(Reason::kGridAmbiguous), why(picture()));
  config.tracker.grid.size = {8, 10};
  LONGS_EQUAL(static_cast<int>(Reason::kGridMismatch), why(picture()));
  config.tracker.grid.size = {7, 9};
  // A lattice of which too little is left, and, if that were allowed, one without two neighbours to take the pitch
  // from.
  LONGS_EQUAL(static_cast<int>(Reason::kMarkersLost), why(with_highlights([](std::size_t i) { return i >= 44; })));
  LONGS_EQUAL(static_cast<int>(Reason::kNone), why(with_highlights([](std::size_t i) { return i >= 45; })));
  config.fault_markers_pct = 1;
  LONGS_EQUAL(static_cast<int>(Reason::kNoLattice), why(with_highlights([](std::size_t i) { return i != 31; })));
  LONGS_EQUAL(static_cast<int>(Reason::kNone), why(picture()));
}

// A simulation that leaves the picture out is held to the order of time as well.
TEST(Pipeline, RefusesMarkersAndFeaturesThatDoNotComeForward) {
  learn();
  const MarkerField field = state->tracker.field;
  CHECK_TRUE(pipeline::update_markers(*state, config, field, now + 40ms, 1).quality.ok());
  rejects(Reason::kTimeNotForward, pipeline::update_markers(*state, config, field, now + 40ms, 2));
  CHECK_TRUE(pipeline::update_features(*state, config, {}, field.grid, now + 80ms, 3).quality.ok());
  rejects(Reason::kTimeNotForward, pipeline::update_features(*state, config, {}, field.grid, now + 79ms, 4));
  CHECK_TRUE(pipeline::update_markers(*state, config, field, now + 120ms, 5).quality.ok());
}

TEST(Pipeline, LearnsAgainAfterTare) {
  learn();
  for (int k = 0; k < 5; ++k) (void)show(shifted(0.1 * k, 0.0));
  state->decision.raised = true;
  pipeline::tare(*state);
  for (int k = 1; k <= 10; ++k) {
    const pipeline::Result result = show(shifted(0.4, 0.0));
    CHECK_EQUAL(k == 10, result.referenced);
    LONGS_EQUAL(static_cast<int>(GripRequest::kHold), static_cast<int>(result.request));
  }
  for (std::size_t i = 0; i < 63; ++i) CHECK_TRUE(std::abs(state->displacement.markers[i].dx.raw()) <= 10);
}

// Two runs over the same frames give the same bytes: nothing hangs on addresses or on what the memory held before.
TEST(Pipeline, IsDeterministic) {
  std::array<std::vector<std::int32_t>, 2> runs;
  for (auto& run : runs) {
    state = std::make_unique<pipeline::State>();
    now = 1s;
    seed = 900;
    for (int frame = 0; frame < 30; ++frame) {
      const pipeline::Result r = show(frame < 12 ? Warp{} : gaussian({0.4, -0.3}, 3.0, 0.06 * frame - 0.7, 0.0));
      for (const std::int32_t v :
           {r.features.vx.raw(), r.features.vy.raw(), r.features.entropy.raw(), r.features.entropy_rate.raw()})
        run.push_back(v);
      for (std::size_t i = 0; i < 63; ++i) run.push_back(state->tracker.field.markers[i].x.raw());
    }
  }
  CHECK_TRUE(runs[0] == runs[1]);
}
