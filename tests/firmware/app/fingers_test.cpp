// SPDX-License-Identifier: Apache-2.0
// What the lines of a hand say of two fingers, and that of one finger they say what they say without a hand.
#include "app/fingers.hpp"

#include <array>
#include <chrono>
#include <memory>
#include <random>

#include "slip/slip_tree.gen.hpp"
#include "tests/support/frames.hpp"
#include "tests/support/reference.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::reference_model;
using namespace std::chrono_literals;

namespace {

int name(DeviceState state) {
  return static_cast<int>(state);
}

}  // namespace

TEST_GROUP(Fingers) {
  fingers::Config config = fingers::config_of(2, {}, {});
  fingers::Hand hand;
  Micros now{1s};

  static pipeline::Result fine() {
    pipeline::Result out;
    out.referenced = true;
    out.grid = {7, 9};
    out.markers = out.features.markers = 63;
    out.features.contact = Count::from_raw(1);
    out.features.imprint.patches = Count::from_raw(20);
    return out;
  }
  static pipeline::Result slipping() {
    pipeline::Result out = fine();
    out.features.imprint.motion = Log2Q8::from_raw(slip_tree::kFirst[0].threshold + 500);
    return out;
  }
  static pipeline::Result refused(Reason why) {
    pipeline::Result out = fine();
    out.quality = {why};
    return out;
  }
  fingers::Result give(int finger, pipeline::Result seen, Micros after = 20ms) {
    now += after;
    seen.timestamp = now - 40ms;
    return fingers::decide(hand, config, finger, seen, now);
  }
  // Both fingers well.
  void settle() {
    for (int k = 0; k < 4; ++k) (void)give(k % 2, fine());
  }
};

TEST(Fingers, GripOkNeedsEveryFinger) {
  CHECK_FALSE(give(0, fine()).hand.grip_ok);  // of the right nothing is known
  LONGS_EQUAL(name(DeviceState::kBoot), name(give(0, fine()).hand.state));
  CHECK_TRUE(give(1, fine()).hand.grip_ok);

  pipeline::Result learning = fine();
  learning.referenced = false;
  CHECK_FALSE(give(1, learning).hand.grip_ok);
  LONGS_EQUAL(name(DeviceState::kReference), name(give(0, fine()).hand.state));
  // The last to be well comes first in the pair: it rises with the edge of the other one's frame.
  const fingers::Result well = give(1, fine());
  LONGS_EQUAL(name(DeviceState::kOk), name(well.hand.state));
  CHECK_FALSE(well.hand.grip_ok);
  CHECK_TRUE(give(0, fine()).hand.grip_ok);

  pipeline::Result few = fine();
  few.features.markers = 50;
  CHECK_FALSE(give(0, few).hand.grip_ok);
  const fingers::Result degraded = give(1, fine());
  LONGS_EQUAL(name(DeviceState::kDegraded), name(degraded.hand.state));
  LONGS_EQUAL(static_cast<int>(Reason::kFewMarkers), static_cast<int>(degraded.hand.reason));
  LONGS_EQUAL(name(DeviceState::kOk), name(degraded.finger.state));
}

TEST(Fingers, ASlipThatOneFingerSeesClearlyIsTheHandsAtOnce) {
  settle();
  const fingers::Result slip = give(1, slipping());
  CHECK_TRUE(slip.hand.slip);
  CHECK_FALSE(slip.hand.grip_ok);
  LONGS_EQUAL(name(DeviceState::kSlip), name(slip.hand.state));
  const fingers::Result other = give(0, fine());
  CHECK_TRUE(other.hand.slip);
  LONGS_EQUAL(name(DeviceState::kSlip), name(other.finger.state));
}

// One that comes back is at FAULT for three frames and not counted, but what it sees slips all the same.
TEST(Fingers, ASlipOfAFingerThatIsNotCountedIsTheHands) {
  config.one_may_be_lost = true;
  settle();
  for (int k = 0; k < 12; ++k) (void)give(0, fine());
  CHECK_TRUE(give(0, fine()).hand.grip_ok);
  const fingers::Result slip = give(1, slipping());
  LONGS_EQUAL(name(DeviceState::kFault), name(slip.finger.state));
  CHECK_TRUE(slip.hand.slip);
  CHECK_FALSE(slip.hand.grip_ok);
  LONGS_EQUAL(name(DeviceState::kSlip), name(slip.hand.state));
  LONGS_EQUAL(static_cast<int>(Reason::kSlipDetected), static_cast<int>(slip.hand.reason));
}

TEST(Fingers, ASilentFingerIsAFaultOfTheHand) {
  settle();
  const Micros last = now;  // the right's
  fingers::Result result;
  do result = give(0, fine());
  while (result.hand.state == DeviceState::kOk && now < last + 1s);
  LONGS_EQUAL(name(DeviceState::kFault), name(result.hand.state));
  LONGS_EQUAL(static_cast<int>(Reason::kNoFrame), static_cast<int>(result.hand.reason));
  CHECK_FALSE(result.hand.grip_ok);
  CHECK_TRUE(now - last > 150ms && now - last <= 170ms);  // the receiver's rule, and a frame of the left
  CHECK_FALSE(result.hand.accepted);
}

TEST(Fingers, AliveTogglesWhenEveryFingerHadAFrame) {
  settle();
  int toggles = 0;
  for (int k = 0; k < 30; ++k) toggles += give(k % 2, fine()).hand.accepted ? 1 : 0;
  LONGS_EQUAL(15, toggles);
  for (int k = 0; k < 5; ++k) CHECK_FALSE(give(0, fine(), 1ms).hand.accepted);
  CHECK_FALSE(give(1, refused(Reason::kJpegDamaged), 1ms).hand.accepted);
  CHECK_TRUE(give(1, fine(), 1ms).hand.accepted);
  CHECK_FALSE(give(1, fine(), 1ms).hand.accepted);
}

// Random lives of two fingers: whatever comes, GRIP_OK is LOW while slip is raised, and while a finger is not OK, and
// it rises with an edge of ALIVE.
TEST(Fingers, NeverConfirmASlip) {
  std::mt19937 random(5);
  int slips = 0;
  int fine_frames = 0;
  bool was_ok = false;
  std::array<DeviceState, 2> last{};
  for (int k = 0; k < 20'000; ++k) {
    const auto chance = [&](int percent) { return std::uniform_int_distribution(0, 99)(random) < percent; };
    const int finger = chance(50) ? 1 : 0;
    pipeline::Result seen = chance(2) ? slipping() : fine();
    if (chance(5)) seen.quality = {Reason::kMarkersLost};
    if (chance(1)) seen.referenced = false;
    const fingers::Result result = give(finger, seen, chance(1) ? 200ms : 15ms);
    last[static_cast<std::size_t>(finger)] = result.finger.state;
    slips += result.hand.slip ? 1 : 0;
    fine_frames += result.hand.grip_ok ? 1 : 0;
    CHECK_FALSE(result.hand.grip_ok && result.hand.slip);
    CHECK_FALSE(result.hand.grip_ok && !was_ok && !result.hand.accepted);
    was_ok = result.hand.grip_ok;
    if (result.hand.grip_ok) CHECK_TRUE(last[0] == DeviceState::kOk && last[1] == DeviceState::kOk);
  }
  CHECK_TRUE(slips > 1000 && fine_frames > 1000);
}

// Random lives of one finger, beside the supervisor that a device without a hand has.
TEST(Fingers, OfOneFingerAreWhatItsSupervisorSays) {
  config = fingers::config_of(1, {}, {});
  supervisor::State alone;
  decision::State decision;
  std::mt19937 random(3);
  int slips = 0;
  int refusals = 0;
  for (int k = 0; k < 5000; ++k) {
    const auto chance = [&](int percent) { return std::uniform_int_distribution(0, 99)(random) < percent; };
    now += chance(3) ? 200ms : 40ms;
    pipeline::Result seen = chance(15) ? slipping() : fine();
    if (chance(10)) seen.quality = {Reason::kMarkersLost};
    if (chance(5)) seen.referenced = false;
    seen.timestamp = now;
    if (seen.quality.ok()) {
      const Verdict verdict =
          seen.referenced ? classifier::classify(config.pipeline.classifier, seen.features) : Verdict::kHold;
      seen.request = decision::update(decision, config.pipeline.decision, verdict, now);
    } else {
      seen.request = decision.raised ? GripRequest::kTighten : GripRequest::kHold;
      ++refusals;
    }
    const supervisor::Outputs expected = supervisor::update(alone, config.supervisor, seen, now);
    const supervisor::Outputs got = fingers::decide(hand, config, 0, seen, now).hand;
    LONGS_EQUAL(name(expected.state), name(got.state));
    LONGS_EQUAL(static_cast<int>(expected.reason), static_cast<int>(got.reason));
    CHECK_EQUAL(expected.slip, got.slip);
    CHECK_EQUAL(expected.accepted, got.accepted);
    CHECK_EQUAL(expected.grip_ok, got.grip_ok);
    slips += got.slip ? 1 : 0;
  }
  CHECK_TRUE(slips > 100 && refusals > 100);
}

// Two cameras' pictures through two pipelines: each learns its own gel, and neither hears of the other's.
TEST(Fingers, EachHasItsOwnRestPosition) {
  auto state = std::make_unique<fingers::State>();
  test::NoJpeg jpeg;
  const Grid grid;
  const scene::PictureConfig view = scene::cropped_320x240();
  config.pipeline.with_imprint = config.pipeline.with_field = false;
  std::uint64_t seed = 1;
  fingers::Result result;
  pipeline::Result seen;
  const auto show = [&](int finger, const Warp& warp) {
    now += 20ms;
    const Picture picture = picture_of(view, lattice_px(grid, view, warp), ++seed);
    hal::Frame frame = test::frame_of(picture);
    frame.timestamp = now;
    result = fingers::update(*state, config, finger, jpeg, frame, now, seen);
  };
  const Warp left{};
  const Warp right = shifted(0.16, 0.08);
  for (int k = 0; k < 12; ++k) {
    show(0, left);
    CHECK_EQUAL(k >= 10, result.hand.grip_ok);  // by then the right has learned too
    show(1, right);
    CHECK_EQUAL(k >= 9, result.hand.grip_ok);
  }
  const Marker a = state->fingers[0].reference.rest.markers[31];
  const Marker b = state->fingers[1].reference.rest.markers[31];
  const Point at = lattice_px(grid, view, left)[31];
  const Point there = lattice_px(grid, view, right)[31];
  DOUBLES_EQUAL(there.x - at.x, (b.x.raw() - a.x.raw()) / 256.0, 0.05);  // px: the noise of two pictures
  DOUBLES_EQUAL(there.y - at.y, (b.y.raw() - a.y.raw()) / 256.0, 0.05);
  CHECK_TRUE(there.x - at.x > 1.0);
}
