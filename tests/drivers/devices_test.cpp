// SPDX-License-Identifier: Apache-2.0
// What the simulated devices add to the HAL's contract (contract_test.cpp): memory of what happened, and faults.
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <vector>

#include "drivers/sim/camera_faults.hpp"
#include "drivers/sim/camera_memory.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/gpio.hpp"
#include "drivers/sim/ring.hpp"
#include "drivers/sim/serial.hpp"

#include <CppUTest/TestHarness.h>

namespace sim = holdfast::sim;
namespace hal = holdfast::hal;
using hal::Capture;
using hal::Level;
using hal::Line;
using sim::CameraFault;
using sim::FaultSpan;
using std::chrono::microseconds;
using namespace std::chrono_literals;

TEST_GROUP(SimRing){};

TEST(SimRing, KeepsTheNewest) {
  sim::Ring<int> ring(3);
  LONGS_EQUAL(0, ring.size());
  for (int i = 1; i <= 10; ++i) {
    ring.push(i);
    LONGS_EQUAL(i, ring.total());
    LONGS_EQUAL(std::min(i, 3), ring.size());
    LONGS_EQUAL(i, ring[ring.size() - 1]);
    LONGS_EQUAL(std::max(1, i - 2), ring[0]);
  }
  ring.clear();
  LONGS_EQUAL(0, ring.size());
}

TEST_GROUP(SimClock){};

TEST(SimClock, MovesOnlyForwardAndOnlyWhenTold) {
  sim::Clock clock;
  CHECK_TRUE(clock.now() == 0us);
  clock.advance_to(5ms);
  clock.advance_to(3ms);
  CHECK_TRUE(clock.now() == 5ms);
  clock.advance(2ms);
  clock.advance(-1ms);
  CHECK_TRUE(clock.now() == 7ms);
}

TEST_GROUP(SimGpio) {
  sim::Clock clock;
  sim::Gpio gpio{clock, 4};
};

TEST(SimGpio, RecordsTimeLineAndLevel) {
  clock.advance_to(40ms);
  CHECK_TRUE(gpio.set(Line::kGripOk, Level::kHigh));
  clock.advance_to(80ms);
  CHECK_TRUE(gpio.set(Line::kAlive, Level::kHigh));
  LONGS_EQUAL(2, gpio.events().size());
  CHECK_TRUE((sim::GpioEvent{40ms, Line::kGripOk, Level::kHigh, Level::kHigh}) == gpio.events()[0]);
  CHECK_TRUE((sim::GpioEvent{80ms, Line::kAlive, Level::kHigh, Level::kHigh}) == gpio.events()[1]);
}

TEST(SimGpio, ManyEventsKeepTheNewestAndCountEdges) {
  for (int i = 1; i <= 1001; ++i) CHECK_TRUE(gpio.set(Line::kAlive, i % 2 != 0 ? Level::kHigh : Level::kLow));
  CHECK_TRUE(gpio.set(Line::kAlive, Level::kHigh));  // told again: an event, not an edge
  LONGS_EQUAL(1002, gpio.events().total());
  LONGS_EQUAL(4, gpio.events().size());
  LONGS_EQUAL(1001, gpio.edges(Line::kAlive));
  LONGS_EQUAL(0, gpio.edges(Line::kGripOk));
}

TEST(SimGpio, RefusesAsOftenAsTold) {
  gpio.fail_next(2);
  CHECK_FALSE(gpio.set(Line::kGripOk, Level::kHigh));
  CHECK_FALSE(gpio.set(Line::kGripOk, Level::kLow));  // refused even if it is there already
  CHECK_TRUE(gpio.level(Line::kGripOk) == Level::kLow);
  CHECK_TRUE((sim::GpioEvent{0us, Line::kGripOk, Level::kHigh, Level::kLow}) == gpio.events()[0]);
  CHECK_TRUE(gpio.set(Line::kGripOk, Level::kHigh));
}

TEST(SimGpio, AStuckLineKeepsItsLevelAndIsReadBack) {
  CHECK_TRUE(gpio.set(Line::kGripOk, Level::kHigh));
  gpio.stick(Line::kGripOk);
  CHECK_FALSE(gpio.set(Line::kGripOk, Level::kLow));
  CHECK_TRUE(gpio.level(Line::kGripOk) == Level::kHigh);
  CHECK_TRUE(gpio.set(Line::kGripOk, Level::kHigh));
  CHECK_TRUE(gpio.set(Line::kAlive, Level::kHigh));  // the other line is free
  gpio.stick(Line::kGripOk, false);
  CHECK_TRUE(gpio.set(Line::kGripOk, Level::kLow));
}

TEST_GROUP(SimSerial) {
  sim::Serial serial{8, 6};
  std::array<std::uint8_t, 16> buffer{};
};

TEST(SimSerial, KeepsTheNewestBytesAndCountsAll) {
  const std::array<std::uint8_t, 5> bytes{1, 2, 3, 4, 5};
  CHECK_TRUE(serial.write(bytes));
  CHECK_TRUE(serial.write(bytes));
  LONGS_EQUAL(10, serial.output().total());
  LONGS_EQUAL(2, serial.writes_taken());
  CHECK_TRUE((std::vector<std::uint8_t>{3, 4, 5, 1, 2, 3, 4, 5}) == serial.output_bytes());
  serial.clear_output();
  CHECK_TRUE(serial.output_bytes().empty());
}

TEST(SimSerial, ScriptedInputIsReadInOrderAcrossTheEndOfItsMemory) {
  std::uint8_t sent = 0;
  std::uint8_t want = 0;
  for (int round = 0; round < 50; ++round) {
    const std::array<std::uint8_t, 4> bytes{sent, std::uint8_t(sent + 1), std::uint8_t(sent + 2),
                                            std::uint8_t(sent + 3)};
    if (serial.feed(bytes)) sent = static_cast<std::uint8_t>(sent + 4);
    const std::size_t count = serial.read(std::span(buffer).first(3));
    for (std::size_t i = 0; i < count; ++i) LONGS_EQUAL(want++, buffer[i]);
  }
  CHECK_TRUE(want > 100);
  LONGS_EQUAL(serial.waiting(), static_cast<std::uint8_t>(sent - want));
}

TEST(SimSerial, InputThatDoesNotFitIsTakenNotAtAll) {
  const std::array<std::uint8_t, 7> bytes{};
  CHECK_FALSE(serial.feed(bytes));
  LONGS_EQUAL(0, serial.waiting());
  CHECK_TRUE(serial.feed(std::span(bytes).first(6)));
  CHECK_FALSE(serial.feed(std::span(bytes).first(1)));
}

TEST(SimSerial, RefusesWhileFull) {
  const std::array<std::uint8_t, 2> bytes{7, 8};
  serial.set_full(true);
  CHECK_FALSE(serial.write(bytes));
  LONGS_EQUAL(1, serial.writes_refused());
  LONGS_EQUAL(0, serial.output().total());
  serial.set_full(false);
  CHECK_TRUE(serial.write(bytes));
}

TEST(SimSerial, AHangUpLosesWhatWaited) {
  const std::array<std::uint8_t, 2> bytes{7, 8};
  CHECK_TRUE(serial.feed(bytes));
  serial.hang_up();
  LONGS_EQUAL(0, serial.read(buffer));
  CHECK_FALSE(serial.feed(bytes));
  CHECK_FALSE(serial.write(bytes));
  serial.reconnect();
  LONGS_EQUAL(0, serial.read(buffer));
  CHECK_TRUE(serial.feed(bytes));
  LONGS_EQUAL(2, serial.read(buffer));
}

namespace {

constexpr std::int32_t kWidth = 4;
constexpr std::int32_t kHeight = 3;
constexpr std::int32_t kStride = 5;
constexpr microseconds kPeriod = 40ms;

// Pictures that differ: picture k is filled with k + 1.
struct Pictures {
  std::array<std::array<std::uint8_t, kStride * kHeight>, 3> pixels{};
  Pictures() {
    for (std::size_t k = 0; k < pixels.size(); ++k) pixels[k].fill(static_cast<std::uint8_t>(k + 1));
  }
  [[nodiscard]] std::vector<holdfast::LumaView> views() const {
    std::vector<holdfast::LumaView> views;
    for (const auto& p : pixels) views.push_back({p.data(), kWidth, kHeight, kStride});
    return views;
  }
};

}  // namespace

TEST_GROUP(SimCameraMemory) {
  Pictures pictures;
  sim::Clock clock;
  hal::Frame frame;
};

TEST(SimCameraMemory, CyclesThroughThePicturesInVirtualTime) {
  sim::CameraMemory camera(clock, pictures.views(), {.period = kPeriod, .latency = 60ms, .cycles = 4});
  clock.advance_to(1s);
  CHECK_TRUE(camera.start());
  for (int k = 0; k < 12; ++k) {
    CHECK_TRUE(Capture::kFrame == camera.next(frame, 1s));
    CHECK_TRUE(frame.timestamp == 1s + k * kPeriod);
    CHECK_TRUE(clock.now() == frame.timestamp + 60ms);
    LONGS_EQUAL(k, frame.sequence);
    CHECK_TRUE(frame.format == hal::PixelFormat::kLuma8);
    LONGS_EQUAL(kStride * kHeight, frame.bytes.size());
    LONGS_EQUAL(k % 3 + 1, frame.bytes.back());
    LONGS_EQUAL(kWidth, frame.width);
    LONGS_EQUAL(kHeight, frame.height);
    LONGS_EQUAL(kStride, frame.stride);
    LONGS_EQUAL(1, camera.borrowed());
    camera.release(frame);
  }
  LONGS_EQUAL(0, camera.borrowed());
  CHECK_TRUE(Capture::kGone == camera.next(frame, 1s));
}

TEST(SimCameraMemory, AMillionFramesLater) {
  sim::CameraMemory camera(clock, pictures.views(), {.cycles = 333'334});
  CHECK_TRUE(camera.start());
  std::uint64_t frames = 0;
  while (camera.next(frame, 1s) == Capture::kFrame) {
    camera.release(frame);
    ++frames;
  }
  LONGS_EQUAL(1'000'002, frames);
  CHECK_TRUE(clock.now() == 1'000'002 * kPeriod);  // the last exposure and 40 ms of latency
}

TEST(SimCameraMemory, ALateReaderGetsOldFramesAtOnce) {
  sim::CameraMemory camera(clock, pictures.views(), {.cycles = 2});
  CHECK_TRUE(camera.start());
  clock.advance_to(10 * kPeriod);
  for (int k = 0; k < 6; ++k) {
    CHECK_TRUE(Capture::kFrame == camera.next(frame, 0us));
    CHECK_TRUE(frame.timestamp == k * kPeriod);
    camera.release(frame);
  }
  CHECK_TRUE(clock.now() == 10 * kPeriod);
}

TEST(SimCameraMemory, NoPicturesIsNoCamera) {
  sim::CameraMemory camera(clock, {}, {});
  CHECK_FALSE(camera.start());
  CHECK_TRUE(Capture::kGone == camera.next(frame, 1s));
}

TEST_GROUP(SimCameraFaults) {
  Pictures pictures;
  sim::Clock clock;
  sim::CameraMemory inside{clock, pictures.views(), {.period = kPeriod, .latency = kPeriod, .cycles = 100}};
  hal::Frame frame;

  struct Seen {
    Capture capture = Capture::kGone;
    microseconds at{};         // the clock when next() returned
    microseconds timestamp{};  // kFrame only, like the rest
    std::uint32_t sequence = 0;
    std::vector<std::uint8_t> bytes;
  };

  // `calls` calls of next(), each frame given back at once.
  std::vector<Seen> film(sim::FaultyCamera & camera, int calls, microseconds timeout = 100ms) {
    std::vector<Seen> seen;
    for (int i = 0; i < calls; ++i) {
      Seen s;
      s.capture = camera.next(frame, timeout);
      s.at = clock.now();
      if (s.capture == Capture::kFrame) {
        s.timestamp = frame.timestamp;
        s.sequence = frame.sequence;
        s.bytes.assign(frame.bytes.begin(), frame.bytes.end());
        LONGS_EQUAL(1, inside.borrowed());
        camera.release(frame);
      }
      LONGS_EQUAL(0, inside.borrowed());
      seen.push_back(std::move(s));
    }
    return seen;
  }

  sim::FaultyCamera started(std::vector<FaultSpan> schedule) {
    sim::FaultyCamera camera(inside, clock, std::move(schedule), kStride * kHeight);
    CHECK_TRUE(camera.start());
    return camera;
  }
};

TEST(SimCameraFaults, WithoutAPlanItIsTheCameraInside) {
  sim::FaultyCamera camera = started({});
  const auto seen = film(camera, 6);
  for (std::size_t k = 0; k < seen.size(); ++k) {
    CHECK_TRUE(seen[k].capture == Capture::kFrame);
    LONGS_EQUAL(k, seen[k].sequence);
    CHECK_TRUE(seen[k].timestamp == static_cast<int>(k) * kPeriod);
    CHECK_TRUE(std::ranges::equal(seen[k].bytes, pictures.pixels[k % 3]));
  }
}

TEST(SimCameraFaults, OffIsATimeoutWithoutAGapInTheSequence) {
  sim::FaultyCamera camera = started({{.first = 2, .count = 4, .fault = CameraFault::kOff}});
  const auto seen = film(camera, 4);
  CHECK_TRUE(seen[1].capture == Capture::kFrame);
  CHECK_TRUE(seen[2].capture == Capture::kTimeout);
  CHECK_TRUE(seen[2].at == seen[1].at + 100ms);
  CHECK_TRUE(seen[3].capture == Capture::kFrame);
  LONGS_EQUAL(2, seen[3].sequence);
  CHECK_TRUE(seen[3].timestamp == 6 * kPeriod);
  CHECK_TRUE(seen[3].at == 7 * kPeriod);
}

TEST(SimCameraFaults, DroppedLeavesAGapInTheSequence) {
  sim::FaultyCamera camera = started({{.first = 1, .count = 1, .fault = CameraFault::kDropped}});
  const auto seen = film(camera, 2);
  LONGS_EQUAL(0, seen[0].sequence);
  LONGS_EQUAL(2, seen[1].sequence);
  CHECK_TRUE(seen[1].timestamp == 2 * kPeriod);
}

TEST(SimCameraFaults, BadIsSaidSo) {
  sim::FaultyCamera camera = started({{.first = 1, .count = 2, .fault = CameraFault::kBad}});
  const auto seen = film(camera, 4);
  CHECK_TRUE(seen[1].capture == Capture::kBad && seen[2].capture == Capture::kBad);
  CHECK_TRUE(seen[3].capture == Capture::kFrame);
  LONGS_EQUAL(3, seen[3].sequence);
}

TEST(SimCameraFaults, StuckRepeatsTheBytesWithNewStamps) {
  sim::FaultyCamera camera = started({{.first = 2, .count = 3, .fault = CameraFault::kStuck}});
  const auto seen = film(camera, 6);
  for (std::size_t k = 2; k < 5; ++k) {
    CHECK_TRUE(seen[k].bytes == seen[1].bytes);
    LONGS_EQUAL(k, seen[k].sequence);
    CHECK_TRUE(seen[k].timestamp == static_cast<int>(k) * kPeriod);
  }
  CHECK_TRUE(std::ranges::equal(seen[5].bytes, pictures.pixels[5 % 3]));
}

TEST(SimCameraFaults, TornIsHalfOfThisFrameAndTheRestOfTheOneBefore) {
  sim::FaultyCamera camera = started({{.first = 1, .count = 2, .fault = CameraFault::kTorn}});
  const auto seen = film(camera, 4);
  constexpr std::size_t kSize = kStride * kHeight;
  constexpr std::size_t kHalf = kSize / 2;
  for (std::size_t k = 1; k < 3; ++k) {
    LONGS_EQUAL(kSize, seen[k].bytes.size());
    for (std::size_t i = 0; i < kSize; ++i) {
      LONGS_EQUAL(i < kHalf ? k % 3 + 1 : (k - 1) % 3 + 1, seen[k].bytes[i]);
    }
    LONGS_EQUAL(k, seen[k].sequence);
  }
  CHECK_TRUE(std::ranges::equal(seen[3].bytes, pictures.pixels[0]));
}

TEST(SimCameraFaults, GarbageHasTheLengthAndNothingElseOfThePicture) {
  sim::FaultyCamera camera = started({{.first = 1, .count = 2, .fault = CameraFault::kGarbage}});
  const auto seen = film(camera, 4);
  LONGS_EQUAL(kStride * kHeight, seen[1].bytes.size());
  CHECK_TRUE(seen[1].bytes != seen[2].bytes);
  CHECK_FALSE(std::ranges::equal(seen[1].bytes, pictures.pixels[1]));
  CHECK_TRUE(std::ranges::equal(seen[3].bytes, pictures.pixels[0]));
}

TEST(SimCameraFaults, LateKeepsItsStampAndWhatFollowsQueuesUp) {
  sim::FaultyCamera camera = started({{.first = 1, .count = 1, .fault = CameraFault::kLate, .by = 70ms}});
  const auto seen = film(camera, 4, 200ms);
  CHECK_TRUE(seen[1].timestamp == kPeriod);
  CHECK_TRUE(seen[1].at == 2 * kPeriod + 70ms);
  CHECK_TRUE(seen[2].at == seen[1].at);  // had arrived meanwhile
  CHECK_TRUE(seen[3].at == 4 * kPeriod + 0ms || seen[3].at == seen[1].at);
  LONGS_EQUAL(3, seen[3].sequence);
}

TEST(SimCameraFaults, LaterThanTheTimeoutIsATimeoutFirst) {
  sim::FaultyCamera camera = started({{.first = 0, .count = 1, .fault = CameraFault::kLate, .by = 250ms}});
  // Arrives at 40 ms inside, is due at 290 ms.
  for (int i = 1; i <= 2; ++i) {
    CHECK_TRUE(Capture::kTimeout == camera.next(frame, 100ms));
    CHECK_TRUE(clock.now() == i * 100ms);
  }
  CHECK_TRUE(Capture::kFrame == camera.next(frame, 100ms));
  CHECK_TRUE(clock.now() == 290ms);
  CHECK_TRUE(frame.timestamp == 0ms);
  camera.release(frame);
  LONGS_EQUAL(0, inside.borrowed());
}

TEST(SimCameraFaults, StoppedWhileHoldingALateFrameGivesItBack) {
  sim::FaultyCamera camera = started({{.first = 0, .count = 1, .fault = CameraFault::kLate, .by = 250ms}});
  CHECK_TRUE(Capture::kTimeout == camera.next(frame, 100ms));
  LONGS_EQUAL(1, inside.borrowed());
  camera.stop();
  LONGS_EQUAL(0, inside.borrowed());
}

TEST(SimCameraFaults, BackwardsIsStampedBeforeTheFrameBefore) {
  sim::FaultyCamera camera = started({{.first = 2, .count = 1, .fault = CameraFault::kBackwards, .by = 5ms}});
  const auto seen = film(camera, 4);
  CHECK_TRUE(seen[2].timestamp == kPeriod - 5ms);
  LONGS_EQUAL(2, seen[2].sequence);
  CHECK_TRUE(seen[3].timestamp == 3 * kPeriod);
}

TEST(SimCameraFaults, GoneRefusesToStartAsOftenAsTold) {
  sim::FaultyCamera camera = started({{.first = 2, .count = 3, .fault = CameraFault::kGone}});
  const auto seen = film(camera, 4);
  CHECK_TRUE(seen[1].capture == Capture::kFrame);
  CHECK_TRUE(seen[2].capture == Capture::kGone && seen[3].capture == Capture::kGone);
  for (int i = 0; i < 3; ++i) CHECK_FALSE(camera.start());
  CHECK_TRUE(camera.start());
  const microseconds replugged = clock.now();
  const auto again = film(camera, 3);
  LONGS_EQUAL(0, again[0].sequence);
  CHECK_TRUE(again[0].timestamp == replugged);
  CHECK_TRUE(again[2].capture == Capture::kFrame);
}

TEST(SimCameraFaults, AnIntermittentFaultIsSeveralSpans) {
  std::vector<FaultSpan> schedule;
  for (std::uint64_t k = 1; k < 12; k += 2) schedule.push_back({.first = k, .count = 1, .fault = CameraFault::kBad});
  sim::FaultyCamera camera = started(std::move(schedule));
  const auto seen = film(camera, 12);
  for (std::size_t k = 0; k < seen.size(); ++k) {
    CHECK_TRUE(seen[k].capture == (k % 2 == 0 ? Capture::kFrame : Capture::kBad));
  }
  LONGS_EQUAL(12, camera.index());
}
