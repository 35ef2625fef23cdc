// SPDX-License-Identifier: Apache-2.0
// Frames of `watch on`, put together again: one time line whatever the device's clock and numbers do.
#include "toolchain/console/telemetry.hpp"

#include <chrono>

#include "base/math.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace std::chrono_literals;
using console_tool::Telemetry;
using status_frame::StatusFrame;

TEST_GROUP(ConsoleTelemetry) {
  Telemetry telemetry;
  Telemetry::Moment at{};
  StatusFrame status;

  // 40 ms later by both clocks.
  Telemetry::Received next(std::chrono::microseconds device = 40ms, std::chrono::microseconds receiver = 40ms) {
    at += receiver;
    status.timestamp_us += static_cast<std::uint32_t>(device.count());
    ++status.sequence;
    status.alive = !status.alive;
    return telemetry.take(status, at);
  }
};

TEST(ConsoleTelemetry, CountsFromTheFirstFrame) {
  status.timestamp_us = 4'000'000'000U;
  status.sequence = 65'530;
  LONGS_EQUAL(0, next().time_us);
  for (int k = 1; k < 20; ++k) {  // both wrap in between
    const Telemetry::Received frame = next(40ms, 39ms + (k % 3) * 1ms);
    LONGS_EQUAL(k * 40'000, frame.time_us);
    LONGS_EQUAL(k, frame.number);
    CHECK(frame.accepted);
  }
  LONGS_EQUAL(0, telemetry.lost());
}

TEST(ConsoleTelemetry, TheStampMayWrapWithinAGap) {
  status.timestamp_us = 0xFFFFFFF0U;
  (void)next(0us);
  LONGS_EQUAL(2'000'000, next(2s, 2100ms).time_us);
  LONGS_EQUAL(5'000'000'000, next(4998s, 4998s).time_us);  // more than one turn of 71.6 min
}

TEST(ConsoleTelemetry, LostFramesLeaveANumberOut) {
  (void)next();
  status.sequence = static_cast<std::uint16_t>(status.sequence + 3);
  const Telemetry::Received frame = next(160ms, 160ms);
  LONGS_EQUAL(3, frame.lost);
  LONGS_EQUAL(4, frame.number);
  LONGS_EQUAL(160'000, frame.time_us);
  LONGS_EQUAL(3, telemetry.lost());
}

TEST(ConsoleTelemetry, TimeRunsWhileTheCameraStands) {
  (void)next();
  std::int64_t before = next().time_us;
  for (int k = 0; k < 100; ++k) {
    const Telemetry::Received frame = next(0us, 150ms);
    CHECK(frame.time_us > before);
    before = frame.time_us;
  }
  // It is back, with a stamp of its clock, which ran on.
  const std::int64_t back = next(15'100ms, 100ms).time_us;
  CHECK(back > before);
  CHECK(back <= before + 200'000);
}

TEST(ConsoleTelemetry, ADeviceThatBeginsAnewGoesOnWhereTheReceiverIs) {
  (void)next();
  const std::int64_t before = next().time_us;
  status.timestamp_us = 17;
  status.sequence = 0;
  telemetry.begin_anew();
  const Telemetry::Received frame = next(0us, 3s);
  LONGS_EQUAL(before + 3'000'000, frame.time_us);
  LONGS_EQUAL(2, frame.number);
  LONGS_EQUAL(0, frame.lost);
  // And without being told: a number that far away is no gap.
  status.sequence = 30'000;
  LONGS_EQUAL(0, next().lost);
}

TEST(ConsoleTelemetry, AFieldIsWholeWithItsLastPiece) {
  DisplacementField field;
  for (int i = 0; i < field.grid.count(); ++i) {
    field.markers[idx(i)] = {Micrometres::from_raw(10 * i - 300), Micrometres::from_raw(-7 * i), i != 11};
  }
  const std::int32_t pieces = marker_frame::frames_of(field.grid);
  for (std::int32_t k = 0; k < pieces; ++k) {
    LONGS_EQUAL(k == pieces - 1,
                telemetry.take(link::Kind::kDisplacement, marker_frame::displacement_piece(field, 9, k)));
  }
  CHECK(telemetry.field().has_value());
  LONGS_EQUAL(9, telemetry.field_sequence());
  for (int i = 0; i < field.grid.count(); ++i) {
    const MarkerDisplacement& got = telemetry.field()->markers[idx(i)];
    LONGS_EQUAL(i != 11, got.valid);
    if (got.valid) LONGS_EQUAL(10 * i - 300, got.dx.raw());
  }
  CHECK_FALSE(telemetry.rest().has_value());
  // One that lacks a piece never is, and does not spoil the next.
  for (std::int32_t k = 1; k < pieces; ++k) {
    CHECK_FALSE(telemetry.take(link::Kind::kDisplacement, marker_frame::displacement_piece(field, 14, k)));
  }
  LONGS_EQUAL(9, telemetry.field_sequence());
  for (std::int32_t k = 0; k < pieces; ++k) {
    (void)telemetry.take(link::Kind::kDisplacement, marker_frame::displacement_piece(field, 19, k));
  }
  LONGS_EQUAL(19, telemetry.field_sequence());
}
