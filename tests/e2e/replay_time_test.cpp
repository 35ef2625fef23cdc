// SPDX-License-Identifier: Apache-2.0
// The time of a recording is its own: what its stamps are is for the firmware to accept or to reject, as of a camera.
#include <memory>
#include <sstream>
#include <string>
#include <variant>
#include <vector>

#include "drivers/sim/camera_replay.hpp"
#include "tests/support/folders.hpp"
#include "tests/support/host_process.hpp"
#include "tests/support/mjpg_file.hpp"
#include "tests/support/picture_clip.hpp"
#include "tests/support/temp_dir.hpp"
#include "toolchain/play/rig.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;
using namespace std::chrono_literals;
using holdfast::test::kFilm;
using holdfast::test::kTool;

// The film with these stamps: one picture each.
sim::Recording film_at(const std::vector<Micros>& times) {
  std::vector<sim::StampedPicture> pictures;
  std::size_t offset = 0;
  for (const test::Jpeg& picture : test::read_mjpg(kFilm)) {
    if (pictures.size() == times.size()) break;
    pictures.push_back({offset, picture.size(), times[pictures.size()]});
    offset += picture.size();
  }
  LONGS_EQUAL(times.size(), pictures.size());
  auto opened =
      sim::Recording::open(kFilm, {.pictures = std::make_shared<const std::vector<sim::StampedPicture>>(pictures)});
  CHECK(std::holds_alternative<sim::Recording>(opened));
  return std::get<sim::Recording>(std::move(opened));
}

struct Told {
  Reason quality = Reason::kNone;
  DeviceState state = DeviceState::kBoot;
  Reason reason = Reason::kNone;
};

// Every step of the firmware, those in which no frame came among them.
std::vector<Told> told_of(const std::vector<Micros>& times) {
  tool::Rig rig{Params{}};
  sim::Recording recording = film_at(times);
  const auto first = std::get<sim::RecordedFrame>(recording.at("first"));
  sim::CameraReplay camera(std::move(recording), rig.clock());
  App& app = rig.connect(camera);
  CHECK(app.learn(Params{}, sim::as_frame(first)).ok());
  CHECK(app.start(Params{}).ok());
  std::vector<Told> told;
  while (app.step()) told.push_back({app.result().quality.reason, app.outputs().state, app.outputs().reason});
  return told;
}

std::string last_row_at(const std::string& clip, const std::string& fps, const std::string& features) {
  const test::Finished run = test::run({kTool, "replay", clip, "--fps", fps, "--features", features});
  STRCMP_EQUAL("", run.err.c_str());
  std::istringstream lines(test::read_file(features));
  std::string line, last;
  while (std::getline(lines, line)) last = line;
  const std::size_t state = last.find(',', last.find(',') + 1) + 1;
  return last.substr(state, last.find(',', last.find(',', state) + 1) - state);
}

}  // namespace

TEST_GROUP(ReplayTime) {
  test::TempDir dir;
};

TEST(ReplayTime, StampsThatDoNotMoveForwardAreRejected) {
  const std::vector<Told> told = told_of({0ms, 40ms, 80ms, 60ms, 80ms, 120ms, 2h, 160ms, -1h, 200ms});
  const std::vector<Reason> expected{
      Reason::kNone, Reason::kNone,           Reason::kNone, Reason::kTimeNotForward, Reason::kTimeNotForward,
      Reason::kNone, Reason::kTimeNotForward, Reason::kNone, Reason::kFrameStale,     Reason::kNone};
  LONGS_EQUAL(expected.size(), told.size());
  for (std::size_t i = 0; i < expected.size(); ++i) CHECK(told[i].quality == expected[i]);
}

// Of stamps that never are of use again time goes on, and the device says so as of a camera that is silent.
TEST(ReplayTime, StampsOfAnotherClockToTheEndAreAFault) {
  for (const Micros base : {Micros{2h}, Micros{-2h}, Micros{80ms}}) {
    const Micros step = base == 80ms ? 0ms : 40ms;  // the last one stands still
    const std::vector<Told> told = told_of(
        {0ms, 40ms, 80ms, base, base + step, base + 2 * step, base + 3 * step, base + 4 * step, base + 5 * step});
    CHECK(told[2].state == DeviceState::kOk);
    CHECK(told.back().state == DeviceState::kFault);
  }
}

TEST(ReplayTime, AGapIsTimeInWhichNoFrameCame) {
  const std::vector<Told> told = told_of({0ms, 40ms, 80ms, 480ms, 520ms});
  // 80 ms and the frame at 480: steps of 100 ms without a frame. Silent for more than 150 ms: FAULT.
  CHECK(told.size() > 5);
  bool silent = false;
  for (const Told& one : told) {
    silent = silent || (one.state == DeviceState::kFault && one.reason == Reason::kNoFrame);
  }
  CHECK(silent);
  const Told& after = told[told.size() - 2];
  CHECK(after.quality == Reason::kNone && after.reason == Reason::kTimeGap);
}

TEST(ReplayTime, ASlowRecordingSaysSo) {
  const std::string clip = (dir / "clip").string();
  LONGS_EQUAL(31, test::write_clip(test::press_scene(1.2), clip));
  const std::string features = (dir / "f.csv").string();
  STRCMP_EQUAL("DEGRADED,frame_rate", last_row_at(clip, "11.9", features).c_str());
  STRCMP_EQUAL("DEGRADED,frame_rate", last_row_at(clip, "5", features).c_str());
  STRCMP_EQUAL("OK,none", last_row_at(clip, "12.1", features).c_str());
  STRCMP_EQUAL("OK,none", last_row_at(clip, "60", features).c_str());  // faster than the sensor: nothing is lost
}
