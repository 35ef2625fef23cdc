// SPDX-License-Identifier: Apache-2.0
// The firmware's Hand-E against the simulated one (drivers/sim/hande), which shares no code with it.
#include "grip/hande.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "drivers/sim/clock.hpp"
#include "drivers/sim/hande.hpp"
#include "tests/fuzz/modbus_check.hpp"

#include <CppUTest/TestHarness.h>

namespace hande = holdfast::hande;
namespace sim = holdfast::sim;
using hande::Feedback;
using hande::Object;
using hande::Wanted;
using holdfast::Micros;
using holdfast::Reason;
using sim::LineTrouble;
using namespace std::chrono_literals;

namespace {

constexpr Wanted kClose{.go = true, .position = 255, .speed = 255, .force = 20};
constexpr Wanted kOpen{.go = true, .position = 0, .speed = 255, .force = 20};

// A gripper without a life of its own: it answers at once with the status that it is given.
class Puppet final : public holdfast::hal::Serial {
 public:
  std::uint8_t action = 0x31, fault = 0, echo = 0, position = 13, current = 0;
  std::vector<std::vector<std::uint8_t>> written;  // outputs

 private:
  bool do_write(std::span<const std::uint8_t> request) override {
    reply_ = {request[0], request[1]};
    if (request[1] == 16) {
      reply_.insert(reply_.end(), request.begin() + 2, request.begin() + 6);
      written.emplace_back(request.begin() + 7, request.end() - 2);
    } else {
      reply_.push_back(static_cast<std::uint8_t>(2 * request[5]));
      for (const std::uint8_t byte : {action, std::uint8_t{0}, fault, echo, position, current}) reply_.push_back(byte);
    }
    holdfast::test::seal(reply_);
    return true;
  }
  std::size_t do_read(std::span<std::uint8_t> bytes) override {
    const std::size_t count = std::min(bytes.size(), reply_.size());
    std::copy_n(reply_.begin(), count, bytes.begin());
    reply_.erase(reply_.begin(), reply_.begin() + static_cast<std::ptrdiff_t>(count));
    return count;
  }
  std::vector<std::uint8_t> reply_;
};

// The firmware and the gripper on one clock.
struct Rig {
  sim::Clock clock;
  sim::HandE gripper;
  hande::Config config;
  hande::State state;
  Wanted wanted;
  Feedback seen;
  Micros step = 5ms;  // between two calls

  Rig() : Rig(sim::HandE::Config{}) {}
  explicit Rig(const sim::HandE::Config& c) : gripper(clock, c) { clock.advance(1s); }

  void call() {
    clock.advance(step);
    seen = hande::update(state, config, gripper, wanted, clock.now());
  }
  void run(Micros duration) {
    for (const Micros end = clock.now() + duration; clock.now() < end;) call();
  }
  template <typename Condition>
  bool until(Condition condition, Micros within = 5s) {
    for (const Micros end = clock.now() + within; clock.now() < end;) {
      call();
      if (condition()) return true;
    }
    return false;
  }
  bool activate() {
    return until([&] { return seen.activated; });
  }
  bool grip(const sim::HandE::Object& object) {
    if (!activate()) return false;
    gripper.put_object(object);
    wanted = kClose;
    return until([&] { return seen.holding; });
  }
  // The firmware starts anew; the gripper has not noticed.
  void restart() {
    state = {};
    seen = {};
    wanted = {};
  }
};

std::uint8_t counts(double width_mm) {
  return static_cast<std::uint8_t>(std::lround(230 - width_mm * 217 / 50));
}

}  // namespace

TEST_GROUP(HandE) {
  Rig rig;
  sim::HandE& gripper = rig.gripper;
  const Feedback& seen = rig.seen;

  void teardown() override {
    CHECK_TRUE(gripper.shortest_gap() >= 5ms);
  }
};

TEST(HandE, ConfigIsChecked) {
  CHECK_TRUE(hande::validate({}).ok());
  const auto refused = [](auto change) {
    hande::Config config;
    change(config);
    return hande::validate(config).reason == Reason::kConfig;
  };
  CHECK_TRUE(refused([](auto& c) { c.bus.slave = 0; }));
  CHECK_TRUE(refused([](auto& c) { c.bus.slave = 248; }));
  CHECK_TRUE(refused([](auto& c) { c.bus.spacing = 4999us; }));
  CHECK_TRUE(refused([](auto& c) { c.bus.timeout = 0us; }));
  CHECK_TRUE(refused([](auto& c) { c.poll = 9999us; }));
  CHECK_TRUE(refused([](auto& c) { c.idle_poll = 500'001us; }));
  CHECK_TRUE(refused([](auto& c) { c.fresh_for = c.idle_poll; }));
  CHECK_TRUE(refused([](auto& c) { c.retries = 0; }));
  CHECK_TRUE(refused([](auto& c) { c.back_off = 2s; }));
  CHECK_TRUE(refused([](auto& c) { c.activations = 0; }));
  CHECK_TRUE(refused([](auto& c) { c.bus.timeout = 500'001us; }));
  CHECK_TRUE(refused([](auto& c) { c.bus.quiet = -1us; }));
  CHECK_TRUE(refused([](auto& c) { c.bus.settled = c.bus.spacing - 1us; }));
  CHECK_TRUE(refused([](auto& c) { c.poll = 500'001us; }));
  CHECK_TRUE(refused([](auto& c) { c.idle_poll = 9999us; }));
  CHECK_TRUE(refused([](auto& c) { c.back_off = 0us; }));
  CHECK_TRUE(refused([](auto& c) { c.longest_back_off = 60'000'001us; }));
  CHECK_TRUE(refused([](auto& c) { c.echo_within = c.poll; }));
  CHECK_TRUE(refused([](auto& c) { c.activation_within = 0us; }));
  // The ends of the ranges are in them.
  hande::Config edge;
  edge.bus = {.slave = 1, .timeout = 1us, .spacing = 5ms, .quiet = 0us, .settled = 5ms};
  edge.poll = edge.idle_poll = 10ms;
  edge.retries = edge.activations = 1;
  edge.back_off = edge.longest_back_off = edge.activation_within = 1us;
  edge.fresh_for = edge.echo_within = 10'001us;
  CHECK_TRUE(hande::validate(edge).ok());
  edge.bus.slave = 247;
  edge.bus.timeout = edge.poll = edge.idle_poll = 500ms;
  edge.fresh_for = edge.echo_within = 501ms;
  edge.back_off = edge.longest_back_off = 60s;
  CHECK_TRUE(hande::validate(edge).ok());
}

TEST(HandE, ActivatesAGripperThatIsNot) {
  rig.call();
  CHECK_FALSE(seen.fresh);
  CHECK_TRUE(rig.until([&] { return seen.fault_reason == Reason::kGripperActivating; }, 50ms));
  const Micros begin = rig.clock.now();
  while (!seen.activated && rig.clock.now() < begin + 3s) {
    CHECK_TRUE(seen.fault_reason == Reason::kGripperActivating);
    rig.call();
  }
  CHECK_TRUE(rig.clock.now() - begin > 1500ms && rig.clock.now() - begin < 1600ms);
  CHECK_TRUE(seen.fresh && !seen.holding && !seen.moving && seen.fault_reason == Reason::kNone);
  LONGS_EQUAL(1, gripper.activations());
  LONGS_EQUAL(2, gripper.writes());  // clear and set
  LONGS_EQUAL(1, seen.counters.activations);
  rig.run(10s);  // nothing is wanted: nothing is written
  LONGS_EQUAL(2, gripper.writes());
}

// Any caller.
TEST(HandE, GripsTightensAndOpensForEveryCaller) {
  for (const Micros step :
       {Micros{1ms}, Micros{3ms}, Micros{5ms}, Micros{7ms}, Micros{10ms}, Micros{25ms}, Micros{40ms}}) {
    Rig r;
    r.step = step;
    CHECK_TRUE(r.grip({.width_mm = 20}));
    CHECK_TRUE(seen.object == Object::kNone);
    CHECK_TRUE(r.seen.object == Object::kContactClosing);
    LONGS_EQUAL(counts(20), r.seen.position);
    LONGS_EQUAL(255, r.seen.echo);
    DOUBLES_EQUAL(20 + 165 * 20 / 255.0, r.gripper.force_n(), 1e-9);

    r.wanted.force = 80;  // a step of the regulator is in the gripper with the next exchange
    const Micros begin = r.clock.now();
    CHECK_TRUE(r.until([&] { return r.gripper.output(5) == 80; }));
    CHECK_TRUE(r.clock.now() - begin <= 25ms + step);
    r.run(500ms);
    CHECK_TRUE(r.seen.holding && !r.seen.lost && r.seen.fresh);
    CHECK_TRUE(r.seen.age <= 20ms + 2 * step + 10ms);

    r.wanted = kOpen;
    CHECK_TRUE(r.until([&] { return r.seen.object == Object::kAtPosition; }));
    CHECK_FALSE(r.seen.holding);
    CHECK_FALSE(r.seen.lost);
    LONGS_EQUAL(13, r.seen.position);
    LONGS_EQUAL(2 + 3, r.gripper.writes());
    LONGS_EQUAL(1, r.gripper.activations());
    LONGS_EQUAL(0, r.seen.counters.missed);
    LONGS_EQUAL(0, r.gripper.damaged());
    CHECK_TRUE(r.gripper.shortest_gap() >= 5ms);
    for (std::size_t i = 0; i < r.gripper.requests().size(); ++i) {
      const auto& request = r.gripper.requests()[i];
      CHECK_TRUE(request.function == 16 || request.function == 4);
      LONGS_EQUAL(3, request.count);
    }
  }
}

TEST(HandE, RedundantWritesAreSuppressedAndTheStatusKeepsTheLineAlive) {
  CHECK_TRUE(rig.grip({}));
  const auto writes = gripper.writes();
  const auto suppressed = seen.counters.suppressed;
  rig.run(60s);
  LONGS_EQUAL(writes, gripper.writes());
  const auto more = seen.counters.suppressed - suppressed;
  CHECK_TRUE(more >= 2399 && more <= 3001);  // one for every status read: each 20 ms, or 25 with calls of 5 ms
  CHECK_TRUE(gripper.longest_gap() <= 110ms);
  rig.wanted.go = false;
  rig.run(60s);
  LONGS_EQUAL(writes + 1, gripper.writes());
  CHECK_TRUE(gripper.longest_gap() <= 110ms);
  LONGS_EQUAL(0, gripper.fault());
}

// With the slowest polls allowed and the slowest caller it still stays below the second of gFLT 9.
TEST(HandE, TheSlowestSettingsKeepTheHeartbeat) {
  rig.config.poll = rig.config.idle_poll = 500ms;
  rig.config.fresh_for = 600ms;
  rig.config.echo_within = 600ms;
  rig.step = 40ms;
  CHECK_TRUE(hande::validate(rig.config).ok());
  CHECK_TRUE(rig.grip({}));
  rig.run(30s);
  CHECK_TRUE(gripper.longest_gap() <= 600ms);
  LONGS_EQUAL(0, seen.fault);
  CHECK_TRUE(seen.fresh);
}

TEST(HandE, AnObjectThatFallsOutIsLost) {
  for (const double width : {5.0, 20.0, 45.0}) {
    Rig r;
    CHECK_TRUE(r.grip({.width_mm = width}));
    r.run(1s);
    r.gripper.remove_object();
    CHECK_TRUE(r.until([&] { return r.seen.lost; }, 100ms));
    CHECK_FALSE(r.seen.holding);
    CHECK_TRUE(r.seen.fault_reason == Reason::kGripperLost);
    r.run(1s);
    CHECK_TRUE(r.seen.lost && !r.seen.holding);  // the fingers have met: still lost
    r.wanted = kOpen;
    CHECK_TRUE(r.until([&] { return r.seen.object == Object::kAtPosition; }));
    CHECK_FALSE(r.seen.lost);
    CHECK_TRUE(r.seen.fault_reason == Reason::kNone);
  }
}

TEST(HandE, ClosingOnNothingIsNeitherHeldNorLost) {
  CHECK_TRUE(rig.activate());
  rig.wanted = kClose;
  for (int i = 0; i < 400; ++i) {
    rig.call();
    CHECK_FALSE(seen.holding);
    CHECK_FALSE(seen.lost);
  }
  CHECK_TRUE(seen.object == Object::kAtPosition);
  LONGS_EQUAL(230, seen.position);
}

// Below 3 mm the gripper never says contact. What shows it: the fingers have stopped short, and pressed.
TEST(HandE, AThinObjectIsHeldAlthoughTheGripperSaysAtPosition) {
  for (const double width : {1.85, 2.0, 2.5, 2.9}) {
    Rig r;
    CHECK_TRUE(r.grip({.width_mm = width}));
    r.run(3s);  // the motor's current has long ended
    CHECK_TRUE(r.seen.holding && !r.seen.lost);
    CHECK_TRUE(r.seen.object == Object::kAtPosition);
    LONGS_EQUAL(0, r.seen.current_10ma);
    r.wanted.force = 60;
    r.run(1s);
    CHECK_TRUE(r.seen.holding);
    r.gripper.remove_object();
    CHECK_TRUE(r.until([&] { return r.seen.lost; }, 200ms));
    CHECK_FALSE(r.seen.holding);
    r.run(1s);
    CHECK_FALSE(r.seen.holding);
  }
}

TEST(HandE, ASoftObjectThatYieldsToMoreForceIsNotLost) {
  CHECK_TRUE(rig.grip({.width_mm = 20, .stiffness_n_mm = 12}));
  for (int force = 20; force <= 250; force += 10) {
    rig.wanted.force = static_cast<std::uint8_t>(force);
    for (int i = 0; i < 60; ++i) {
      rig.call();
      CHECK_FALSE(seen.lost);
      CHECK_TRUE(seen.holding);
    }
  }
  CHECK_TRUE(seen.position > counts(20) + 40);  // 13 mm further
  for (int force = 250; force >= 0; force -= 10) {
    rig.wanted.force = static_cast<std::uint8_t>(force);
    rig.run(300ms);
    CHECK_TRUE(seen.holding);
  }
}

// The same position asked for as that of the contact: gOBJ 3 is then what it says.
TEST(HandE, AtThePositionOfTheContactIsNotLost) {
  CHECK_TRUE(rig.grip({.width_mm = 20}));
  rig.wanted.position = counts(20);
  rig.run(1s);
  CHECK_TRUE(seen.object == Object::kAtPosition && seen.holding && !seen.lost);
  rig.wanted.position = 255;
  rig.run(1s);
  CHECK_TRUE(seen.object == Object::kContactClosing && seen.holding && !seen.lost);
}

// The status is renewed every 10 ms: one that is read right after a command shows the world before it.
TEST(HandE, AStatusOlderThanTheCommandIsNotBelieved) {
  for (int offset_us = 0; offset_us < 10'000; offset_us += 700) {
    Rig r;
    CHECK_TRUE(r.grip({.width_mm = 20}));
    r.wanted = kOpen;
    CHECK_TRUE(r.until([&] { return r.seen.object == Object::kAtPosition; }));
    r.clock.advance(Micros{offset_us});
    r.step = 3ms;
    r.gripper.put_object({.width_mm = 30});
    r.wanted = kClose;
    r.wanted.speed = 0;  // a second to the object
    bool moved = false;
    while (!r.seen.holding && r.clock.now() < 20s) {
      r.call();
      const bool is_new = r.state.acknowledged && r.state.echo == 255;
      moved = moved || r.seen.object == Object::kMoving;
      CHECK_TRUE(!is_new || r.seen.object == Object::kMoving || r.seen.object == Object::kContactClosing);
    }
    CHECK_TRUE(moved && r.seen.holding);
    LONGS_EQUAL(counts(30), r.seen.position);
    r.wanted = kOpen;
    r.wanted.speed = 0;
    // Of the contact before nothing is left once the gripper was told to open.
    CHECK_TRUE(r.until([&] { return !r.seen.holding; }, 100ms));
    while (r.seen.position > 13 && r.clock.now() < 40s) {
      r.call();
      CHECK_FALSE(r.seen.holding);
      CHECK_FALSE(r.seen.lost);
    }
  }
}

// What a command has done is looked at right after it, and not with the next poll.
TEST(HandE, AReadFollowsEveryWrite) {
  rig.step = 1ms;
  CHECK_TRUE(rig.grip({}));
  for (int force = 30; force < 130; ++force) {
    rig.wanted.force = static_cast<std::uint8_t>(force);
    rig.run(43ms);
  }
  const auto& requests = gripper.requests();
  int pairs = 0;
  for (std::size_t i = 0; i + 1 < requests.size(); ++i) {
    if (requests[i].function != 16) continue;
    ++pairs;
    LONGS_EQUAL(4, requests[i + 1].function);
    CHECK_TRUE(requests[i + 1].time - requests[i].time <= 8ms);
  }
  CHECK_TRUE(pairs >= 100);
}

TEST(HandE, WithoutGoTheFingersStayWhereTheyAre) {
  CHECK_TRUE(rig.activate());
  rig.wanted = kClose;
  rig.wanted.speed = 0;
  rig.run(500ms);
  rig.wanted = {};
  rig.run(100ms);
  const double width = gripper.width_mm();
  rig.run(1s);
  DOUBLES_EQUAL(width, gripper.width_mm(), 1e-9);
  LONGS_EQUAL(255, gripper.output(3));  // only rGTO has changed
  LONGS_EQUAL(0x01, gripper.output(0));
  CHECK_TRUE(seen.object == Object::kNone);  // gOBJ means nothing without gGTO
  CHECK_FALSE(seen.moving);
  rig.wanted = kClose;
  CHECK_TRUE(rig.until([&] { return seen.position == 230; }));
}

// ---- Restarts

TEST(HandE, ARestartOfTheFirmwareLeavesTheGraspAlone) {
  for (const bool line_was_out : {false, true}) {
    Rig r;
    CHECK_TRUE(r.grip({.width_mm = 20}));
    r.wanted.force = 90;
    r.run(1s);
    const auto writes = r.gripper.writes();
    const double force = r.gripper.force_n();
    r.restart();
    if (line_was_out) {
      r.gripper.unplug();
      r.run(5s);
      r.gripper.unplug(false);
    }
    CHECK_TRUE(r.until([&] { return r.seen.fresh && r.seen.activated; }, 1500ms));
    CHECK_TRUE(r.seen.holding);
    LONGS_EQUAL(255, r.seen.echo);
    r.run(3s);
    LONGS_EQUAL(writes, r.gripper.writes());  // until something is wanted
    DOUBLES_EQUAL(force, r.gripper.force_n(), 1e-9);
    r.wanted = kClose;
    r.wanted.force = 95;
    r.run(1s);
    LONGS_EQUAL(95, r.gripper.output(5));
    CHECK_TRUE(r.seen.holding && !r.seen.lost);
    LONGS_EQUAL(1, r.gripper.activations());
    LONGS_EQUAL(0, r.gripper.drops());
  }
}

TEST(HandE, AGripperLeftActiveByAnotherMasterIsTakenOver) {
  gripper.put_object({.width_mm = 12});
  gripper.start_active(255, 255, 100);
  rig.run(200ms);
  CHECK_TRUE(seen.activated && seen.holding && seen.object == Object::kContactClosing);
  LONGS_EQUAL(0, gripper.writes());
  gripper.remove_object();
  CHECK_TRUE(rig.until([&] { return seen.lost; }, 300ms));
  LONGS_EQUAL(0, gripper.writes());
}

TEST(HandE, AnActivationUnderWayIsWaitedFor) {
  CHECK_TRUE(rig.until([&] { return gripper.activations() == 1; }));
  rig.run(300ms);
  rig.restart();
  CHECK_TRUE(rig.activate());
  LONGS_EQUAL(1, gripper.activations());
}

// Switched off and on: an object is still between the fingers, and to activate would drop it.
TEST(HandE, AGripperThatLostItsPowerWhileHoldingWaitsForARM) {
  CHECK_TRUE(rig.grip({}));
  gripper.power(false);
  rig.run(3s);
  CHECK_TRUE(seen.fault_reason == Reason::kGripperSilent);
  gripper.power(true);
  rig.run(10s);
  LONGS_EQUAL(1, gripper.activations());
  LONGS_EQUAL(0, gripper.drops());
  CHECK_TRUE(seen.fresh && seen.latched && !seen.activated && seen.holding);
  CHECK_TRUE(seen.fault_reason == Reason::kGripperUndervoltage);
  rig.wanted.reactivate = true;
  CHECK_TRUE(rig.until([&] { return seen.activated; }));
  CHECK_FALSE(seen.latched);
  LONGS_EQUAL(2, gripper.activations());
  rig.run(100ms);
  LONGS_EQUAL(255, gripper.output(3));  // what is wanted is written again
}

TEST(HandE, AGripperThatLostItsPowerWhileEmptyIsActivatedAgain) {
  CHECK_TRUE(rig.activate());
  rig.wanted = kOpen;
  rig.run(1s);
  gripper.power_cycle();
  CHECK_TRUE(rig.until([&] { return !seen.activated; }));
  CHECK_TRUE(rig.activate());
  rig.run(100ms);
  LONGS_EQUAL(0x09, gripper.output(0));
  LONGS_EQUAL(2, gripper.activations());
}

// ---- Faults of the gripper

// The status after a step may be as old as its renewal: whenever the step comes, it is not taken for its result.
TEST(HandE, ReactivationWorksAtEveryMoment) {
  for (int offset_us = 0; offset_us < 10'000; offset_us += 500) {
    for (const Micros step : {Micros{1ms}, Micros{5ms}, Micros{40ms}}) {
      Rig r;
      CHECK_TRUE(r.activate());
      r.gripper.set_fault(0xE);
      r.run(200ms);
      r.clock.advance(Micros{offset_us});
      r.step = step;
      r.wanted.reactivate = true;
      CHECK_TRUE(r.until([&] { return !r.seen.latched; }, 200ms));
      while (!r.seen.activated && r.clock.now() < 10s) {
        r.call();
        CHECK_TRUE(r.seen.fault_reason == Reason::kGripperActivating || r.seen.activated);
      }
      LONGS_EQUAL(2, r.gripper.activations());
    }
  }
}

TEST(HandE, AGripperThatRestartsInItsActivationIsActivatedAgainAtOnce) {
  CHECK_TRUE(rig.until([&] { return gripper.activations() == 1; }));
  rig.run(500ms);
  gripper.power_cycle();
  CHECK_TRUE(rig.until([&] { return seen.activated; }, 2s));
  LONGS_EQUAL(2, gripper.activations());
}

TEST(HandE, AFaultThatEndsByItselfNeedsNoActivation) {
  CHECK_TRUE(rig.grip({}));
  gripper.set_fault(0xB);
  rig.run(200ms);
  rig.wanted.reactivate = true;  // waits for the end of the release
  rig.run(200ms);
  gripper.set_fault(0);
  rig.run(1s);
  CHECK_TRUE(seen.activated && !seen.latched && seen.fault_reason == Reason::kNone);
  LONGS_EQUAL(1, gripper.activations());
}

TEST(HandE, EveryMajorFaultIsLatchedUntilARM) {
  struct Case {
    std::uint8_t fault;
    Reason reason;
  };
  const Case cases[] = {{0xA, Reason::kGripperUndervoltage}, {0xB, Reason::kGripperReleasing},
                        {0xC, Reason::kGripperInternal},     {0xD, Reason::kGripperActivation},
                        {0xE, Reason::kGripperOvercurrent},  {0xF, Reason::kGripperReleased}};
  for (const Case& c : cases) {
    Rig r;
    r.wanted.reactivate = true;  // a level, and before the fault: does not count
    CHECK_TRUE(r.grip({}));
    r.wanted.reactivate = true;
    r.gripper.set_fault(c.fault);
    CHECK_TRUE(r.until([&] { return r.seen.fault_reason == c.reason; }, 200ms));
    LONGS_EQUAL(c.fault, r.seen.fault);
    r.run(5s);
    CHECK_TRUE(r.seen.latched && r.seen.fresh && !r.seen.activated && r.seen.fault_reason == c.reason);
    LONGS_EQUAL(1, r.gripper.activations());
    LONGS_EQUAL(0, r.gripper.drops());

    r.wanted.reactivate = false;
    r.run(100ms);
    r.wanted.reactivate = true;
    r.run(500ms);
    if (c.fault == 0xB) {  // an automatic release is left to end first
      LONGS_EQUAL(1, r.gripper.activations());
      r.gripper.set_fault(0xF);
    }
    CHECK_TRUE(r.until([&] { return r.seen.activated; }));
    LONGS_EQUAL(2, r.gripper.activations());
    r.run(5s);  // the edge counts once
    LONGS_EQUAL(2, r.gripper.activations());
    CHECK_TRUE(r.seen.fault_reason == Reason::kNone && !r.seen.latched);
    LONGS_EQUAL(20, r.gripper.output(5));
    CHECK_TRUE(r.gripper.shortest_gap() >= 5ms);
  }
}

TEST(HandE, MinorFaultsAreReportedAndNotLatched) {
  struct Case {
    std::uint8_t fault;
    Reason reason;
  };
  const Case cases[] = {{0x0, Reason::kNone},
                        {0x5, Reason::kGripperActivating},
                        {0x7, Reason::kGripperActivating},
                        {0x8, Reason::kGripperHot}};
  CHECK_TRUE(rig.grip({}));
  for (const Case& c : cases) {
    gripper.set_fault(c.fault);
    rig.run(200ms);
    CHECK_TRUE(seen.fault_reason == c.reason && !seen.latched && seen.activated && seen.holding);
    LONGS_EQUAL(c.fault, seen.fault);
    gripper.set_fault(0);
    rig.run(200ms);
    CHECK_TRUE(seen.fault_reason == Reason::kNone);
  }
  LONGS_EQUAL(1, gripper.activations());
}

// gFLT 9: the gripper has heard nothing for a second. What it was told is said again.
TEST(HandE, AfterNoCommunicationTheWriteIsRepeated) {
  CHECK_TRUE(rig.grip({}));
  rig.run(200ms);
  const auto writes = gripper.writes();
  gripper.set_fault(9);
  CHECK_TRUE(rig.until([&] { return seen.fault == 9; }, 100ms));
  CHECK_TRUE(seen.fault_reason == Reason::kGripperSilent);
  CHECK_TRUE(rig.until([&] { return gripper.fault() == 0; }, 100ms));
  rig.run(100ms);
  CHECK_TRUE(seen.fault_reason == Reason::kNone && seen.holding);
  LONGS_EQUAL(writes + 1, gripper.writes());

  gripper.unplug();
  rig.run(3s);
  LONGS_EQUAL(9, gripper.fault());
  gripper.unplug(false);
  CHECK_TRUE(rig.until([&] { return seen.fresh && gripper.fault() == 0; }, 1200ms));
  rig.run(100ms);
  LONGS_EQUAL(writes + 2, gripper.writes());
  LONGS_EQUAL(1, gripper.activations());
  CHECK_TRUE(seen.holding && seen.fault_reason == Reason::kNone);
}

TEST(HandE, ReactivateWithoutAFaultIsNotHeard) {
  CHECK_TRUE(rig.grip({}));
  for (int i = 0; i < 10; ++i) {
    rig.wanted.reactivate = i % 2 == 0;
    rig.run(100ms);
  }
  LONGS_EQUAL(1, gripper.activations());
  LONGS_EQUAL(0, gripper.drops());
}

TEST(HandE, AnActivationThatFailsIsLatched) {
  gripper.fail_activation(true);
  CHECK_TRUE(rig.until([&] { return seen.latched; }));
  CHECK_TRUE(seen.fault_reason == Reason::kGripperActivation);
  rig.run(10s);
  LONGS_EQUAL(1, gripper.activations());
  gripper.fail_activation(false);
  rig.wanted.reactivate = true;
  CHECK_TRUE(rig.activate());
}

TEST(HandE, AnActivationThatNeverEndsIsTriedThreeTimes) {
  Rig r(sim::HandE::Config{.activation = 24h});
  CHECK_TRUE(r.until([&] { return r.seen.latched; }, 60s));
  LONGS_EQUAL(3, r.gripper.activations());
  CHECK_TRUE(r.seen.fault_reason == Reason::kGripperActivation);
  r.run(60s);
  LONGS_EQUAL(3, r.gripper.activations());
  r.wanted.reactivate = true;
  r.run(60s);
  LONGS_EQUAL(6, r.gripper.activations());
}

// ---- The line

TEST(HandE, ThreeMissedRepliesAreAFaultAndTheTriesBackOff) {
  CHECK_TRUE(rig.grip({}));
  rig.step = 1ms;
  rig.run(100ms);
  const auto misses = seen.counters.missed;
  gripper.trouble(LineTrouble::kMute);
  const auto heard = gripper.requests().total();
  CHECK_TRUE(rig.until([&] { return seen.counters.missed == misses + 2; }));
  CHECK_TRUE(seen.fault_reason == Reason::kNone && seen.fresh && seen.holding);
  CHECK_TRUE(rig.until([&] { return seen.counters.missed == misses + 3; }));
  CHECK_TRUE(seen.fault_reason == Reason::kGripperSilent && !seen.fresh);
  rig.run(20s);
  CHECK_TRUE(seen.holding);                                                              // what was known last
  const Micros periods[] = {100ms, 150ms, 250ms, 450ms, 850ms, 1050ms, 1050ms, 1050ms};  // time-out and back-off
  const auto& requests = gripper.requests();
  const auto first = static_cast<std::size_t>(requests.size() - (requests.total() - heard));
  for (std::size_t i = 0; i < std::size(periods); ++i) {
    const Micros period = requests[first + i + 1].time - requests[first + i].time;
    CHECK_TRUE(period >= periods[i] && period <= periods[i] + 2ms);
    LONGS_EQUAL(4, requests[first + i + 1].function);  // reads alone, until one is answered
    LONGS_EQUAL(3 + (i + 1) % 6, requests[first + i + 1].count);
  }
  gripper.trouble(LineTrouble::kNone);
  CHECK_TRUE(rig.until([&] { return seen.fresh && seen.fault_reason == Reason::kNone; }, 1200ms));
  LONGS_EQUAL(1, gripper.activations());
  LONGS_EQUAL(0, gripper.drops());
  CHECK_TRUE(seen.holding);
}

// Speed and force are not echoed. After a miss nobody knows what the gripper has.
TEST(HandE, AfterASingleMissWhatIsWantedIsWrittenAgain) {
  CHECK_TRUE(rig.grip({}));
  rig.run(200ms);
  const auto writes = gripper.writes();
  const auto missed = seen.counters.missed;
  gripper.trouble(LineTrouble::kMute);
  CHECK_TRUE(rig.until([&] { return seen.counters.missed == missed + 1; }));
  gripper.trouble(LineTrouble::kNone);
  rig.run(200ms);
  LONGS_EQUAL(writes + 1, gripper.writes());
  LONGS_EQUAL(missed + 1, seen.counters.missed);
  LONGS_EQUAL(0, gripper.fault());
}

TEST(HandE, EveryTroubleOfTheLineIsNamedAndSurvived) {
  struct Case {
    LineTrouble trouble;
    Reason reason;
  };
  const Case cases[] = {
      {LineTrouble::kDeaf, Reason::kGripperSilent},         {LineTrouble::kMute, Reason::kGripperSilent},
      {LineTrouble::kWrongCrc, Reason::kGripperReply},      {LineTrouble::kWrongSlave, Reason::kGripperReply},
      {LineTrouble::kWrongFunction, Reason::kGripperReply}, {LineTrouble::kTruncated, Reason::kGripperReply},
      {LineTrouble::kGarbage, Reason::kGripperReply},       {LineTrouble::kNoiseBefore, Reason::kGripperReply},
      {LineTrouble::kException, Reason::kGripperReply},     {LineTrouble::kLate, Reason::kGripperSilent}};
  for (const Micros step : {Micros{5ms}, Micros{40ms}}) {
    for (const Case& c : cases) {
      Rig r;
      r.step = step;
      CHECK_TRUE(r.grip({}));
      r.run(200ms);
      r.gripper.trouble(c.trouble, 1, 91ms);
      r.run(100ms);
      const auto replies = r.seen.bus.replies;  // one was under way
      r.run(10s);
      CHECK_TRUE(r.seen.fault_reason == c.reason && !r.seen.fresh);
      CHECK_TRUE(r.seen.age > 9s);
      LONGS_EQUAL(replies, r.seen.bus.replies);
      CHECK_TRUE(r.gripper.shortest_gap() >= 5ms);
      r.gripper.trouble(LineTrouble::kNone);
      r.wanted.force = 99;
      CHECK_TRUE(r.until([&] { return r.seen.fault_reason == Reason::kNone; }, 1300ms));
      r.run(200ms);
      LONGS_EQUAL(99, r.gripper.output(5));
      LONGS_EQUAL(1, r.gripper.activations());
      CHECK_TRUE(r.seen.holding && r.seen.fresh);
    }
  }
}

TEST(HandE, AnUnpluggedAdaptorCostsFewTriesAndNothingElse) {
  CHECK_TRUE(rig.grip({}));
  const auto missed = seen.counters.missed;
  gripper.unplug();
  rig.run(60s);
  const auto tries = seen.counters.missed - missed;
  CHECK_TRUE(tries >= 60 && tries <= 66);
  CHECK_TRUE(seen.fault_reason == Reason::kGripperSilent);
  gripper.unplug(false);
  CHECK_TRUE(rig.until([&] { return seen.fresh; }, 1100ms));
  LONGS_EQUAL(1, gripper.activations());
}

// The force is not echoed: a write that was not heard, or whose reply was lost, is found out by nothing but the miss.
TEST(HandE, EveryCommandArrivesOverAnIntermittentLine) {
  for (const auto trouble : {LineTrouble::kDeaf, LineTrouble::kMute, LineTrouble::kWrongCrc, LineTrouble::kTruncated,
                             LineTrouble::kNoiseBefore, LineTrouble::kLate}) {
    Rig r;
    CHECK_TRUE(r.grip({}));
    r.gripper.trouble(trouble, 4, 60ms);
    for (int force = 21; force < 120; ++force) {
      r.wanted.force = static_cast<std::uint8_t>(force);
      CHECK_TRUE(r.until([&] { return r.state.acknowledged && r.state.outputs[2] == (0xFF00 | force); }, 10s));
      LONGS_EQUAL(force, r.gripper.output(5));
    }
    CHECK_TRUE(r.seen.holding && !r.seen.lost);
    LONGS_EQUAL(1, r.gripper.activations());
    CHECK_TRUE(r.gripper.shortest_gap() >= 5ms);
  }
}

// Late replies are those of older questions. Whatever the delay, a status is never older than its age says, which
// fingers that close slowly show.
TEST(HandE, LateRepliesNeverPassForNewOnes) {
  for (int late_ms = 5; late_ms < 2800; late_ms += late_ms < 200 ? 9 : 60) {
    for (const std::uint32_t one_in : {1U, 2U, 3U}) {
      Rig r;
      CHECK_TRUE(r.activate());
      r.wanted = kClose;
      r.wanted.speed = 0;
      r.run(100ms);
      r.gripper.trouble(LineTrouble::kLate, one_in, Micros{late_ms * 1000});
      std::vector<std::uint8_t> truth;  // at each millisecond
      const Micros begin = r.clock.now();
      r.step = 1ms;
      while (r.gripper.width_mm() > 0) {
        r.call();
        truth.push_back(counts(r.gripper.width_mm()));
        const Micros asked = r.clock.now() - r.seen.age - begin - 12ms;  // the renewal, and a step
        if (asked < 0ms) continue;
        CHECK_TRUE(r.seen.position >= truth[static_cast<std::size_t>(asked / 1ms)]);
        CHECK_TRUE(!r.seen.fresh || r.seen.age <= r.config.fresh_for);
      }
    }
  }
}

// Hours of anything: the promises that hold whatever happens.
TEST(HandE, RandomRunsKeepEveryPromise) {
  std::mt19937 random(11);
  const auto below = [&](std::uint32_t n) { return static_cast<std::uint32_t>(random() % n); };
  for (int round = 0; round < 40; ++round) {
    Rig r;
    std::uint32_t last_missed = 0;
    std::uint32_t misses_in_a_row = 0;
    std::uint32_t last_replies = 0;
    Micros last_good = r.clock.now();
    for (int i = 0; i < 6000; ++i) {
      r.step = Micros{1000 + below(below(4) == 0 ? 39'000 : 9'000)};
      if (below(40) == 0) {
        r.wanted = {.go = below(8) != 0,
                    .position = static_cast<std::uint8_t>(random()),
                    .speed = static_cast<std::uint8_t>(random()),
                    .force = static_cast<std::uint8_t>(random()),
                    .reactivate = below(2) == 0};
      }
      if (below(100) == 0) {
        r.gripper.trouble(static_cast<LineTrouble>(below(11)), 1 + below(4), Micros{below(400'000)});
      }
      if (below(60) == 0) r.gripper.trouble(LineTrouble::kNone);
      if (below(60) == 0) r.gripper.put_object({.width_mm = below(500) / 10.0, .stiffness_n_mm = below(3) * 20.0});
      if (below(100) == 0) r.gripper.remove_object();
      if (below(300) == 0) r.gripper.set_fault(static_cast<std::uint8_t>(below(16)));
      if (below(400) == 0) r.gripper.power_cycle();
      if (below(100) == 0) r.gripper.unplug(below(3) == 0);
      if (below(800) == 0) r.clock.advance(Micros{3600s});
      r.call();
      if (r.seen.bus.replies != last_replies) {
        misses_in_a_row = 0;
        last_good = r.clock.now();
      }
      misses_in_a_row += r.seen.counters.missed - last_missed;
      last_replies = r.seen.bus.replies;
      last_missed = r.seen.counters.missed;
      const bool named = r.seen.fault_reason == Reason::kGripperSilent || r.seen.fault_reason == Reason::kGripperReply;
      if (misses_in_a_row >= 3) CHECK_TRUE(named && !r.seen.fresh);
      if (r.seen.fresh) CHECK_TRUE(r.seen.age <= r.config.fresh_for);
      CHECK_TRUE(!(r.seen.holding && r.seen.lost));
      CHECK_TRUE(r.seen.activated || !r.seen.moving || r.seen.fault_reason != Reason::kNone);
      // The line is never left alone for longer than the longest back-off and a time-out.
      CHECK_TRUE(r.state.try_at <= r.clock.now() + 1s);
    }
    CHECK_TRUE(r.gripper.shortest_gap() >= 5ms);
    LONGS_EQUAL(0, r.gripper.damaged());
    // And it always comes back.
    r.step = 10ms;
    r.gripper.trouble(LineTrouble::kNone);
    r.gripper.unplug(false);
    r.gripper.remove_object();
    r.gripper.set_fault(0);
    r.wanted = {};
    r.run(3s);
    r.wanted.reactivate = true;
    r.run(8s);
    r.wanted = kOpen;
    r.wanted.reactivate = false;
    r.run(4s);
    r.wanted.reactivate = true;
    CHECK_TRUE(r.until([&] { return r.seen.object == Object::kAtPosition && r.seen.position == 13; }, 8s));
    CHECK_TRUE(r.seen.fresh);
  }
}

// The fuzzer's judgement (tests/fuzz/modbus_check.hpp) of its seeds and of what is near them.
TEST(HandE, WhateverComesFromThePortNothingIsMadeUp) {
  std::mt19937 random(5);
  for (const holdfast::test::ModbusBytes& seed : holdfast::test::modbus_seeds()) {
    STRCMP_EQUAL("", holdfast::test::check_modbus_bytes(seed).c_str());
    for (int round = 0; round < 300; ++round) {
      holdfast::test::ModbusBytes bytes = seed;
      for (int i = 0; i < 1 + round % 20; ++i) bytes[random() % bytes.size()] = static_cast<std::uint8_t>(random());
      STRCMP_EQUAL("", holdfast::test::check_modbus_bytes(bytes).c_str());
    }
  }
  for (int round = 0; round < 300; ++round) {
    holdfast::test::ModbusBytes bytes(random() % 1000);
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random());
    STRCMP_EQUAL("", holdfast::test::check_modbus_bytes(bytes).c_str());
  }
}

// ---- Statuses one by one: what no simulated gripper says of itself

TEST_GROUP(HandEStatus) {
  Puppet puppet;
  hande::Config config;
  hande::State state;
  Wanted wanted;
  Feedback seen;
  Micros now = 1s;

  void run(Micros duration) {
    for (const Micros end = now + duration; now < end;) {
      now += 5ms;
      seen = hande::update(state, config, puppet, wanted, now);
    }
  }
  void say(unsigned object, unsigned position, unsigned current = 0, Micros duration = 45ms) {
    puppet.action = static_cast<std::uint8_t>(0x39 | object << 6);
    puppet.position = static_cast<std::uint8_t>(position);
    puppet.current = static_cast<std::uint8_t>(current);
    run(duration);
  }
  void close() {
    run(100ms);
    wanted = kClose;
    puppet.echo = 255;
    say(0, 13);
    CHECK_TRUE(seen.moving && !seen.holding);
  }
};

// After the command, but with the gOBJ of before it: a moment of that is neither a grip nor a loss.
TEST(HandEStatus, AtPositionForAMomentIsNotBelieved) {
  close();
  say(3, 13, 10, 30ms);
  CHECK_FALSE(seen.holding);
  say(0, 60, 10);
  CHECK_FALSE(seen.holding);
  CHECK_FALSE(seen.lost);
  say(3, 60, 10, 30ms);
  say(0, 60, 10, 100ms);
  say(3, 60, 10, 30ms);  // the moments do not add up
  CHECK_FALSE(seen.holding);
  say(0, 150, 10);
  say(2, 189);
  CHECK_TRUE(seen.holding);
  say(3, 189, 0, 30ms);
  CHECK_TRUE(seen.holding && !seen.lost);
  say(2, 189);
  CHECK_TRUE(seen.holding && !seen.lost);
}

TEST(HandEStatus, AtPositionThatMovesHasNotStopped) {
  close();
  for (unsigned position = 20; position < 220; position += 10) {
    say(3, position, 10, 45ms);
    CHECK_FALSE(seen.holding);
  }
}

// A grip that the gripper does not report is guessed at while it closes: fingers that are stopped on their way out hold
// nothing.
TEST(HandEStatus, StoppingShortOnTheWayOutIsNoGrip) {
  puppet.position = 200;
  run(100ms);
  wanted = kOpen;
  puppet.echo = 0;
  say(1, 120);
  CHECK_TRUE(seen.holding);
  say(0, 129, 10);  // someone pushed them back
  CHECK_FALSE(seen.holding);
  CHECK_FALSE(seen.lost);
  say(3, 129, 10, 500ms);
  CHECK_TRUE(seen.object == Object::kAtPosition);
  CHECK_FALSE(seen.holding);
  CHECK_FALSE(seen.lost);
}

// gOBJ 3 short of the position and where the contact was: the gripper says that it has lost it.
TEST(HandEStatus, AContactThatBecomesAtPositionIsLost) {
  close();
  say(2, 189);
  CHECK_TRUE(seen.holding);
  say(3, 189, 0, 150ms);
  CHECK_TRUE(seen.lost && !seen.holding);
  say(3, 189, 20, 500ms);
  CHECK_TRUE(seen.lost && !seen.holding);
  say(2, 189);  // it takes it back
  CHECK_TRUE(seen.holding && !seen.lost);
}

TEST(HandEStatus, StoppingShortWithoutPressingIsNoGrip) {
  close();
  say(3, 200, 0, 500ms);
  CHECK_FALSE(seen.holding);
  say(3, 200, 1, 100ms);
  CHECK_TRUE(seen.holding);
  say(3, 200, 0, 500ms);
  CHECK_TRUE(seen.holding);
}

TEST(HandEStatus, FingersThatMeetHoldNothing) {
  close();
  say(2, 226);
  CHECK_FALSE(seen.holding);
  CHECK_TRUE(seen.object == Object::kAtPosition);
  say(2, 225);
  CHECK_TRUE(seen.holding);
  say(0, 250, 10);
  CHECK_TRUE(seen.lost);
}

TEST(HandEStatus, ALittleYieldingIsNoLoss) {
  close();
  say(2, 150);
  say(0, 158, 10);
  CHECK_TRUE(seen.holding && !seen.lost);
  say(2, 158);
  say(0, 166, 10);
  CHECK_TRUE(seen.holding && !seen.lost);
  say(0, 167, 10);
  CHECK_TRUE(!seen.holding && seen.lost);
}

TEST(HandEStatus, FingersThatSomeoneOpenedHoldNothing) {
  close();
  say(2, 150);
  say(0, 142, 10);
  CHECK_TRUE(seen.holding);
  say(0, 141, 10);
  CHECK_FALSE(seen.holding);
  CHECK_FALSE(seen.lost);
}

TEST(HandEStatus, HoldingFromInsideIsTheSameTheOtherWayRound) {
  puppet.position = 200;
  run(100ms);
  wanted = kOpen;
  puppet.echo = 0;
  say(0, 190);
  say(1, 120);
  CHECK_TRUE(seen.holding && seen.object == Object::kContactOpening);
  say(0, 112);
  CHECK_TRUE(seen.holding);
  say(0, 111);
  CHECK_TRUE(seen.lost && !seen.holding);
  say(1, 105);
  CHECK_TRUE(seen.holding && !seen.lost);
  wanted.force = 60;  // the same way: it stays held
  run(100ms);
  CHECK_TRUE(seen.holding);
  wanted = kClose;  // and released by closing
  run(30ms);
  CHECK_TRUE(!seen.holding && !seen.lost);
}

TEST(HandEStatus, AnotherMastersPositionIsWrittenOver) {
  close();
  run(200ms);
  const auto writes = puppet.written.size();
  puppet.echo = 100;
  run(1s);
  const auto more = puppet.written.size() - writes;
  CHECK_TRUE(more >= 5 && more <= 10);  // not with every status
  LONGS_EQUAL(255, puppet.written.back()[3]);
  puppet.echo = 255;
  run(200ms);
  const auto settled = puppet.written.size();
  run(1s);
  LONGS_EQUAL(settled, puppet.written.size());
}

// rACT has to rise: it is set only when the gripper shows that it has seen it cleared.
TEST(HandEStatus, ActivationWaitsForTheClearingToBeSeen) {
  const std::vector<std::uint8_t> clear(6, 0);
  const std::vector<std::uint8_t> set{1, 0, 0, 0, 0, 0};
  puppet.action = 0x31;
  puppet.fault = 0xC;
  run(100ms);
  CHECK_TRUE(puppet.written.empty());
  wanted.reactivate = true;
  run(1s);
  CHECK_TRUE(puppet.written.size() >= 5 && puppet.written.size() <= 11);  // said again, for it is not seen
  for (const auto& outputs : puppet.written) CHECK_TRUE(outputs == clear);
  const auto clears = puppet.written.size();
  puppet.action = 0x00;
  run(60ms);
  LONGS_EQUAL(clears + 1, puppet.written.size());
  CHECK_TRUE(puppet.written.back() == set);
  puppet.action = 0x11;
  puppet.fault = 0;
  run(1s);
  CHECK_TRUE(seen.fault_reason == Reason::kGripperActivating && seen.moving);
  puppet.action = 0x31;
  run(60ms);
  CHECK_TRUE(seen.activated && seen.fault_reason == Reason::kNone);
  LONGS_EQUAL(clears + 1, puppet.written.size());
}
