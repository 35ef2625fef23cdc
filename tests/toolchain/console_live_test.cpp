// SPDX-License-Identifier: Apache-2.0
// The live view of `holdfast console`, looked at without a terminal. The two whole screens in tests/data were drawn by
// this test and judged by eye; HOLDFAST_DRAW=1 writes them again.
#include "toolchain/console/live_view.hpp"

#include <cmath>
#include <cstdlib>
#include <string>
#include <vector>

#include "base/math.hpp"
#include "link/status_frame.hpp"
#include "tests/support/temp_dir.hpp"
#include "toolchain/console/canvas.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

using namespace holdfast;
using console_tool::Canvas;
using console_tool::draw;
using console_tool::LiveLook;
using console_tool::LiveModel;
using console_tool::Style;
using console_tool::Telemetry;

namespace {

constexpr int kFrames = 250;  // ten seconds

// A gel that is pulled to the right and turned a little from the fourth second on, and slips from the seventh on.
LiveModel dragged() {
  LiveModel model;
  model.title = "holdfastd 0.1.0 on sim, model slip_v4";
  model.port = "/dev/serial/by-id/usb-holdfast-if00";
  DisplacementField rest;
  for (int i = 0; i < rest.grid.count(); ++i) {
    rest.markers[idx(i)] = {Micrometres::from_raw((i % 9 - 4) * 2020), Micrometres::from_raw((i / 9 - 3) * 2020), true};
  }
  for (int k = 0; k < kFrames; ++k) {
    const double t = k * 0.04;
    const double pull = std::clamp((t - 4.0) / 3.0, 0.0, 1.0);
    Telemetry::Frame frame;
    frame.number = k;
    frame.time_us = k * 40'000;
    frame.accepted = k > 0;
    frame.status.sequence = static_cast<std::uint16_t>(k);
    frame.status.alive = k % 2 == 1;
    frame.status.slip = t > 7.0;
    frame.status.grip_ok = t > 0.5 && !frame.status.slip;
    frame.status.state = frame.status.slip ? DeviceState::kSlip : t > 0.5 ? DeviceState::kOk : DeviceState::kReference;
    frame.status.reason = frame.status.slip ? Reason::kSlipDetected : t > 0.5 ? Reason::kNone : Reason::kLearning;
    frame.status.features_valid = t > 0.5;
    frame.status.markers = 62;
    frame.status.age_100us = 412;
    frame.status.vx_um_s = static_cast<std::int32_t>(pull > 0 && pull < 1 ? 150 + 40 * (k % 3) : 0);
    frame.status.vy_um_s = frame.status.vx_um_s / 2;
    frame.status.entropy_nat_q16 = static_cast<std::int32_t>(65536 * 2.2 * pull);
    frame.status.entropy_rate_nat_s_q8 = static_cast<std::int32_t>(pull > 0 && pull < 1 ? 256 * 0.73 : -10);
    model.take(frame, t);
    if (k % 5 != 0 || !frame.status.features_valid) continue;
    DisplacementField field;
    for (int i = 0; i < field.grid.count(); ++i) {
      const int row = i / 9;
      const double x = i % 9 - 4;
      const double y = row - 3;
      const double near = std::exp(-(x * x + y * y) / 9.0);
      field.markers[idx(i)] = {Micrometres::from_raw(static_cast<int>(pull * near * (600 - 90 * y))),
                               Micrometres::from_raw(static_cast<int>(pull * near * (90 * x + 60))), i != 20};
    }
    model.take(rest, field, t);
  }
  model.lost = 3;
  model.now_s = (kFrames - 1) * 0.04 + 0.01;
  return model;
}

std::string text_of(const std::vector<std::string>& lines) {
  std::string out;
  for (const std::string& line : lines) out += line + "\n";
  return out;
}

std::size_t width_of(const std::string& line) {
  std::size_t width = 0;
  for (const char c : line) width += (static_cast<unsigned char>(c) & 0xC0U) == 0x80U ? 0 : 1;
  return width;
}

}  // namespace

TEST_GROUP(ConsoleLive){static void check_golden(const LiveModel& model, const LiveLook& look, const char* name){
    const std::string path = std::string(HOLDFAST_SOURCE_DIR "/tests/data/") + name;
const std::string text = text_of(draw(model, look));
if (std::getenv("HOLDFAST_DRAW") != nullptr) test::write_file(path, text);
STRCMP_EQUAL(test::read_file(path).c_str(), text.c_str());
}
static void check_has(const LiveModel& model, const char* part, LiveLook look = {}) {
  STRCMP_CONTAINS(part, text_of(draw(model, look)).c_str());
}
}
;

TEST(ConsoleLive, TheSmallestWholeScreen) {
  check_golden(dragged(), {.columns = 80, .rows = 24, .unicode = true}, "live_80x24.txt");
}

TEST(ConsoleLive, ALargeScreen) {
  check_golden(dragged(), {.columns = 120, .rows = 40, .unicode = true}, "live_120x40.txt");
}

TEST(ConsoleLive, AScreenWithoutUnicodeIsAscii) {
  check_golden(dragged(), {}, "live_80x24_ascii.txt");
  for (const char c : text_of(draw(dragged(), {}))) CHECK(static_cast<unsigned char>(c) < 0x80);
}

// Any size: as many lines as asked for, none too wide, and what matters most as long as there is room.
TEST(ConsoleLive, FitsEverySize) {
  const LiveModel model = dragged();
  for (int rows = 0; rows <= 60; rows += rows < 26 ? 1 : 7) {
    for (int columns = 0; columns <= 200; columns += columns < 90 ? 1 : 13) {
      for (const bool unicode : {false, true}) {
        const auto lines = draw(model, {.columns = columns, .rows = rows, .unicode = unicode});
        LONGS_EQUAL(rows, lines.size());
        for (const std::string& line : lines) CHECK(width_of(line) <= static_cast<std::size_t>(columns));
      }
    }
  }
  check_has(model, "the whole view needs 80x24, this is 60x10", {.columns = 60, .rows = 10});
  check_has(model, "SLIP", {.columns = 60, .rows = 10});
}

TEST(ConsoleLive, BelievesGripOkOnlyWhileAliveIsFresh) {
  LiveModel model;
  check_has(model, "LOW: not fine");
  Telemetry::Frame frame;
  frame.status.grip_ok = true;
  frame.status.state = DeviceState::kOk;
  model.take(frame, 1.0);
  model.now_s = 1.01;
  check_has(model, "HIGH, not believed");  // a first frame's level confirms nothing
  frame.status.alive = true;
  model.take(frame, 1.04);
  model.now_s = 1.04 + 0.1499;
  check_has(model, "HIGH: fine");
  model.now_s = 1.04 + 0.1501;
  check_has(model, "HIGH, not believed");
  check_has(model, "silent for 150 ms");
}

TEST(ConsoleLive, SaysWhatIsWrong) {
  LiveModel model;
  check_has(model, "no frame has come yet");
  Telemetry::Frame frame;
  frame.status.state = DeviceState::kFault;
  frame.status.reason = Reason::kCameraGone;
  model.take(frame, 1.0);
  model.now_s = 1.5;
  check_has(model, "FAULT     camera_gone: the camera ended the stream");
  check_has(model, "cause     sensor unplugged, or end of a recording");
  check_has(model, "next      plug the sensor in again");
  model.now_s = 4.0;
  check_has(model, "SILENT    no frame for 3 s; the last one said FAULT camera_gone");
  model.away = true;
  check_has(model, "AWAY      the port has gone");
}

TEST(ConsoleLive, KeepsTenSecondsAndNoMore) {
  LiveModel model;
  Telemetry::Frame frame;
  for (int k = 0; k < 5000; ++k) {
    frame.status.alive = k % 2 == 1;
    frame.status.reason = k % 2 == 1 ? Reason::kNone : Reason::kSlipDetected;
    frame.accepted = true;
    model.take(frame, k * 0.04);
  }
  model.now_s = 4999 * 0.04;
  CHECK(model.samples.size() <= 251);
  LONGS_EQUAL(LiveModel::kEvents, model.events.size());
  DOUBLES_EQUAL(25.0, model.fps(), 0.01);
}

TEST(ConsoleLive, ShowsNoControlCharactersOfADevice) {
  LiveModel model = dragged();
  model.title = "evil\x1B[2J\ntitle";
  for (const std::string& line : draw(model, {})) {
    for (const char c : line) CHECK(c >= ' ');
  }
}

TEST(ConsoleLive, ColorsOnlyWhenAsked) {
  CHECK(text_of(draw(dragged(), {})).find('\x1B') == std::string::npos);
  const std::string colored = text_of(draw(dragged(), {.color = true}));
  STRCMP_CONTAINS("\x1B[0;1;31mSLIP", colored.c_str());
  Canvas canvas(8, 1);
  canvas.put(0, 0, "ab", Style::kBad);
  canvas.put(2, 0, "c");
  STRCMP_EQUAL("\x1B[0;1;31mab\x1B[0mc", canvas.lines(true)[0].c_str());
}
