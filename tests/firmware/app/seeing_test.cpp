// SPDX-License-Identifier: Apache-2.0
// What the firmware keeps to be looked at: times of its tasks, the flight recorder, the marker frames.
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <memory>
#include <random>
#include <vector>

#include "app/recorder.hpp"
#include "app/timing.hpp"
#include "drivers/sim/clock.hpp"
#include "link/marker_frame.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace std::chrono_literals;

TEST_GROUP(Timing){};

// Against the sorted list: never below the true percentile, and less than an eighth above it.
TEST(Timing, TellsPercentilesWithinAnEighth) {
  std::mt19937 random(3);
  for (const int most_log2 : {3, 10, 17, 23}) {
    timing::Histogram histogram;
    std::vector<std::int64_t> all;
    for (int k = 0; k < 5000; ++k) {
      const auto us = static_cast<std::int64_t>(random() >> (32 - most_log2));
      all.push_back(us);
      histogram.add(Micros{us});
    }
    std::sort(all.begin(), all.end());
    LONGS_EQUAL(5000, histogram.count());
    LONGS_EQUAL(all.back(), histogram.most().count());
    for (const std::uint32_t permille : {1U, 10U, 500U, 900U, 990U, 999U, 1000U}) {
      const std::int64_t exact = all[(all.size() * permille + 999) / 1000 - 1];
      const std::int64_t told = histogram.quantile(permille).count();
      CHECK(told >= exact && told <= exact + exact / 8);
    }
  }
}

TEST(Timing, TakesAnyTime) {
  timing::Histogram histogram;
  LONGS_EQUAL(0, histogram.quantile(500).count());
  histogram.add(Micros{-5});
  histogram.add(Micros{INT64_MAX});
  LONGS_EQUAL(0, histogram.quantile(0).count());
  LONGS_EQUAL(0, histogram.quantile(500).count());
  LONGS_EQUAL((1 << 24) - 1, histogram.quantile(1000).count());
  histogram.clear();
  LONGS_EQUAL(0, histogram.count());
  // One in a few thousand is the longest all the same.
  for (int k = 0; k < 2000; ++k) histogram.add(1us);
  histogram.add(1s);
  LONGS_EQUAL(1, histogram.quantile(999).count());
  LONGS_EQUAL(1'000'000, histogram.quantile(1000).count());
}

TEST(Timing, CountsWhatIsLate) {
  timing::Stopwatch stopwatch;
  stopwatch.begin();
  stopwatch.lap(Task::kDecode);  // without a clock nothing is counted
  LONGS_EQUAL(0, stopwatch.of(Task::kDecode).count());
  sim::Clock clock;
  stopwatch.use(clock);
  stopwatch.begin();
  clock.advance(3ms);
  stopwatch.lap(Task::kDecode);
  clock.advance(7ms);
  stopwatch.lap(Task::kTrack);
  LONGS_EQUAL(3000, stopwatch.of(Task::kDecode).most().count());
  LONGS_EQUAL(7000, stopwatch.of(Task::kTrack).most().count());
  LONGS_EQUAL(0, stopwatch.late(Task::kDecode));
  LONGS_EQUAL(1, stopwatch.late(Task::kTrack));
  stopwatch.clear();
  LONGS_EQUAL(0, stopwatch.late(Task::kTrack));
  for (std::size_t k = 0; k < kTasks.size(); ++k) LONGS_EQUAL(k, static_cast<std::size_t>(kTasks[k].task));
}

TEST_GROUP(Recorder) {
  std::unique_ptr<Recorder> recorder = std::make_unique<Recorder>();
  pipeline::Result result;
  DisplacementField field;
  supervisor::Outputs outputs;
  Micros now{};

  void setup() override {
    result.grid = field.grid = {7, 9};
    result.referenced = true;
    for (int i = 0; i < 63; ++i) {
      field.markers[idx(i)] = {Micrometres::from_raw(i * 1000 - 31'000), Micrometres::from_raw(40'000 - i * 1500),
                               i != 5};
    }
  }
  void take(DeviceState state, Reason reason) {
    now += 40ms;
    ++result.sequence;
    result.timestamp = now - 45ms;
    outputs.state = state;
    outputs.reason = reason;
    recorder->take(result, field, outputs, now);
  }
};

TEST(Recorder, KeepsTheLastTenSeconds) {
  for (int k = 0; k < 300; ++k) take(DeviceState::kOk, Reason::kNone);
  const Recorder::Frames& frames = recorder->frames();
  LONGS_EQUAL(256, frames.size());
  for (std::size_t k = 0; k < frames.size(); ++k) LONGS_EQUAL(300 - 256 + k + 1, frames[k].sequence);
  const FlightFrame& last = frames[frames.size() - 1];
  LONGS_EQUAL(45'000, last.age_us);
  LONGS_EQUAL(-31'000, last.displacement[0].x_um);
  LONGS_EQUAL(INT16_MAX, last.displacement[0].y_um);  // 40 mm is cut
  LONGS_EQUAL(0, last.displacement[5].x_um);
  LONGS_EQUAL(0, last.displacement[5].y_um);
  CHECK(last.features);
  LONGS_EQUAL(0, recorder->before_fault().size());
}

TEST(Recorder, SetsTheFramesBeforeAFaultAside) {
  for (int k = 0; k < 10; ++k) take(DeviceState::kOk, Reason::kNone);
  result.quality = {Reason::kNoFrame};
  take(DeviceState::kFault, Reason::kNoFrame);
  take(DeviceState::kFault, Reason::kCameraGone);  // the same fault goes on
  result.quality = kOkStatus;
  for (int k = 0; k < 400; ++k) take(DeviceState::kOk, Reason::kNone);
  const Recorder::Frames& frames = recorder->before_fault();
  LONGS_EQUAL(11, frames.size());
  LONGS_EQUAL(1, frames[0].sequence);
  CHECK(frames[10].state == DeviceState::kFault);
  CHECK_FALSE(frames[10].features);
  LONGS_EQUAL(4, recorder->events().size());
  LONGS_EQUAL(static_cast<int>(Reason::kCameraGone), recorder->events()[2].b);
}

TEST(Recorder, KeepsTheNewestEvents) {
  for (int k = 0; k < 200; ++k) recorder->note(EventKind::kSetting, Micros{k}, k, -k);
  LONGS_EQUAL(128, recorder->events().size());
  LONGS_EQUAL(199, recorder->events()[127].a);
  LONGS_EQUAL(-72, recorder->events()[0].b);
  recorder->note(EventKind::kCameraStarted, 1s);  // what has no numbers shows none
  CHECK(recorder->events()[127].a == 0 && recorder->events()[127].b == 0);
  for (std::size_t k = 0; k < kEvents.size(); ++k) LONGS_EQUAL(k, static_cast<std::size_t>(kEvents[k].kind));
}

// An age that no clock can have is cut and not wrapped.
TEST(Recorder, CutsAges) {
  take(DeviceState::kOk, Reason::kNone);
  result.timestamp = Micros{-(std::int64_t{1} << 60)};
  recorder->take(result, field, outputs, now);
  LONGS_EQUAL(INT32_MAX, recorder->frames()[1].age_us);
  result.timestamp = now + 1s;
  recorder->take(result, field, outputs, now);
  LONGS_EQUAL(0, recorder->frames()[2].age_us);
}

TEST_GROUP(MarkerFrame) {
  DisplacementField field;
  MarkerField rest;

  void setup() override {
    field.grid = rest.grid = {7, 9};
    for (int i = 0; i < 63; ++i) {
      field.markers[idx(i)] = {Micrometres::from_raw(37 * i - 900), Micrometres::from_raw(900 - 11 * i), i % 7 != 3};
      Marker& marker = rest.markers[idx(i)];
      marker.x = PixelsQ8::from_raw((100 + 20 * (i % 9)) * 256);
      marker.y = PixelsQ8::from_raw((50 + 20 * (i / 9)) * 256);
      marker.valid = true;
    }
  }
  static marker_frame::MarkerFrame over_the_wire(link::Kind kind, const marker_frame::MarkerFrame& frame) {
    std::array<std::uint8_t, marker_frame::kWireBytes> wire{};
    LONGS_EQUAL(marker_frame::kWireBytes, marker_frame::encode(kind, frame, wire));
    link::Payload payload;
    CHECK(link::open(wire, payload) == link::DecodeError::kNone);
    const auto read = marker_frame::read(kind, payload);
    CHECK(read.has_value());
    CHECK_FALSE(marker_frame::read(kind == link::Kind::kRest ? link::Kind::kDisplacement : link::Kind::kRest, payload)
                    .has_value());
    return read.value_or(marker_frame::MarkerFrame{});
  }
};

TEST(MarkerFrame, CarriesAWholeField) {
  field.markers[63].valid = true;  // behind the last one: nobody's
  LONGS_EQUAL(13, marker_frame::frames_of(field.grid));
  for (std::int32_t piece = 0; piece < 13; ++piece) {
    const marker_frame::MarkerFrame frame = marker_frame::displacement_piece(field, 1234, piece);
    CHECK(over_the_wire(link::Kind::kDisplacement, frame) == frame);
    LONGS_EQUAL(1234, frame.sequence);
    for (std::int32_t k = 0; k < 5; ++k) {
      const std::int32_t i = piece * 5 + k;
      const bool valid = i < 63 && i % 7 != 3;
      CHECK_EQUAL(valid, (frame.valid >> k & 1) != 0);
      LONGS_EQUAL(valid ? 37 * i - 900 : 0, frame.points[idx(k)].x_um);
      LONGS_EQUAL(valid ? 900 - 11 * i : 0, frame.points[idx(k)].y_um);
    }
  }
}

// 20 px are a pitch of 2020 um: the corners lie four and three pitches from the middle.
TEST(MarkerFrame, PlacesTheRestPositionsAroundTheirMiddle) {
  const auto frame = marker_frame::rest_piece(rest, PixelsQ8::from_raw(20 * 256), 2020, 9, 0);
  CHECK(over_the_wire(link::Kind::kRest, frame) == frame);
  LONGS_EQUAL(-4 * 2020, frame.points[0].x_um);
  LONGS_EQUAL(-3 * 2020, frame.points[0].y_um);
  LONGS_EQUAL(-3 * 2020, frame.points[1].x_um);
  rest.markers = {};
  LONGS_EQUAL(0, marker_frame::rest_piece(rest, PixelsQ8::from_raw(1), 2020, 9, 0).valid);
}

TEST(MarkerFrame, CutsWhatNoGelCanShow) {
  field.markers[0] = {Micrometres::from_raw(Micrometres::kMax), Micrometres::from_raw(Micrometres::kMin), true};
  const auto frame = marker_frame::displacement_piece(field, 0, 0);
  LONGS_EQUAL(INT16_MAX, frame.points[0].x_um);
  LONGS_EQUAL(INT16_MIN, frame.points[0].y_um);
}

TEST(MarkerFrame, RefusesWhatNoLatticeHas) {
  const auto refused = [](const marker_frame::MarkerFrame& frame) {
    std::array<std::uint8_t, marker_frame::kWireBytes> wire{};
    marker_frame::encode(link::Kind::kRest, frame, wire);
    link::Payload payload;
    CHECK(link::open(wire, payload) == link::DecodeError::kNone);
    return !marker_frame::read(link::Kind::kRest, payload).has_value();
  };
  marker_frame::MarkerFrame frame = marker_frame::displacement_piece(field, 0, 1);
  CHECK_FALSE(refused(frame));
  frame.first = 7;
  CHECK(refused(frame));
  frame.first = 65;
  CHECK(refused(frame));
  frame.first = 0;
  frame.rows = 100;
  frame.cols = 100;
  CHECK(refused(frame));
}
