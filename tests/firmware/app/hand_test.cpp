// SPDX-License-Identifier: Apache-2.0
// A device of two fingers: two cameras that are not synchronous, one pair of lines. What the lines must never say is
// judged as a receiver does.
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "app/daemon.hpp"
#include "console/console.hpp"
#include "drivers/sim/camera_memory.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/gpio.hpp"
#include "drivers/sim/hande.hpp"
#include "drivers/sim/keep.hpp"
#include "drivers/sim/serial.hpp"
#include "link/evidence_frame.hpp"
#include "link/link.hpp"
#include "link/status_frame.hpp"
#include "tests/support/frames.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/status_receiver.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::reference_model;
using namespace std::chrono_literals;
using hal::Level;
using hal::Line;

namespace {

constexpr Micros kRule = 150ms;  // DESIGN.md, the receiver's rule
constexpr std::string_view kLeft = "28D1-D7C6";
constexpr std::string_view kRight = "28D3-K2R9";

// A sensor that may be pulled out, or go silent in its place, or be another one.
class Plug final : public hal::Camera {
 public:
  Plug(sim::CameraMemory& inside, sim::Clock& clock, std::string_view identity)
      : sensor(identity), inside_(inside), clock_(clock) {}
  std::string_view sensor;
  bool out = false;
  bool silent = false;
  int frames = 0;
  std::function<void()> at_stop = [] {};

 private:
  [[nodiscard]] bool do_start() override { return !out && inside_.start(); }
  [[nodiscard]] hal::Capture do_next(hal::Frame& frame, Micros timeout) override {
    if (out) return hal::Capture::kGone;
    if (silent) {  // what it sees meanwhile is lost
      const Micros deadline = clock_.now() + timeout;
      while (inside_.next(frame, deadline - clock_.now()) == hal::Capture::kFrame) inside_.release(frame);
      return hal::Capture::kTimeout;
    }
    const hal::Capture got = inside_.next(frame, timeout);
    frames += got == hal::Capture::kFrame ? 1 : 0;
    return got;
  }
  void do_release(const hal::Frame& frame) override { inside_.release(frame); }
  void do_stop() override {
    at_stop();
    inside_.stop();
  }
  [[nodiscard]] std::string_view do_identity() const override { return sensor; }

  sim::CameraMemory& inside_;
  sim::Clock& clock_;
};

}  // namespace

TEST_GROUP(Hand) {
  sim::Clock clock;
  sim::Gpio gpio{clock};
  sim::Serial link;
  sim::Keep keep{checkpoint::kHandBytes};
  test::NoJpeg jpeg;
  std::unique_ptr<sim::HandE> gripper;
  std::vector<Picture> pictures;
  std::array<std::unique_ptr<sim::CameraMemory>, 2> memory;
  std::array<std::unique_ptr<Plug>, 2> plugs;
  std::unique_ptr<Finger> right;
  std::unique_ptr<Daemon> daemon;
  Params params;
  std::optional<Micros> edge_at;  // of ALIVE, as a receiver has seen it
  std::uint64_t edges = 0;
  Micros told_until{};  // a receiver was told "fine" up to then

  void setup() override {
    film(8);
    gripper = std::make_unique<sim::HandE>(clock);
  }
  void film(int still, int dragged = 0) {
    pictures = test::drag_film(still, dragged);
    const std::vector<LumaView> views = test::luma_views(pictures);
    for (std::size_t i = 0; i < 2; ++i) {  // the right one's frames arrive 15 ms behind the left one's
      const sim::CameraMemory::Config config{.latency = i == 0 ? 40ms : 55ms, .cycles = 1'000'000, .live = true};
      memory[i] = std::make_unique<sim::CameraMemory>(clock, views, config);
      plugs[i] = std::make_unique<Plug>(*memory[i], clock, i == 0 ? kLeft : kRight);
    }
  }
  void teardown() override {
    daemon.reset();
    right.reset();
    gripper.reset();
    for (std::size_t i = 0; i < 2; ++i) {
      plugs[i].reset();
      memory[i].reset();
    }
    pictures.clear();
    pictures.shrink_to_fit();
  }

  void start_with_swapped_sensors() {
    params.left_sensor = camera_keeper::number_of(kLeft);
    params.right_sensor = camera_keeper::number_of(kRight);
    plugs[0]->sensor = kRight;
    plugs[1]->sensor = kLeft;
    start();
  }
  void start() {
    daemon.reset();
    right = std::make_unique<Finger>(*plugs[1]);
    daemon = std::make_unique<Daemon>(Devices{*plugs[0], gpio, link, clock, jpeg, false, right.get()},
                                      Periphery{*gripper, keep});
    CHECK_TRUE(daemon->start(params).ok());
  }
  void poll() {
    const bool high = gpio.level(Line::kGripOk) == Level::kHigh;
    const std::optional<Micros> edge = edge_at;
    daemon->poll();
    (void)daemon->app().watchdog().watch(gpio, clock.now());
    if (high && edge) told_until = std::max(told_until, std::min(clock.now(), *edge + kRule));
    if (gpio.edges(Line::kAlive) != edges) edge_at = clock.now();
    edges = gpio.edges(Line::kAlive);
  }
  void run(Micros time) {
    for (const Micros end = clock.now() + time; clock.now() < end;) poll();
  }
  [[nodiscard]] bool fine() const {
    return gpio.level(Line::kGripOk) == Level::kHigh && edge_at && clock.now() - *edge_at < kRule;
  }
  [[nodiscard]] const App& app() const {
    return daemon->app();
  }
  void says(DeviceState state, Reason reason) const {
    LONGS_EQUAL(static_cast<int>(state), static_cast<int>(app().outputs().state));
    LONGS_EQUAL(static_cast<int>(reason), static_cast<int>(app().outputs().reason));
  }
  void settled() {
    run(1s);
    CHECK_TRUE(fine());
  }
  // Runs on until a receiver is told "fine"; how long that took.
  Micros until_fine(Micros most) {
    const Micros from = clock.now();
    while (!fine() && clock.now() - from < most) poll();
    const std::string what =
        std::string(info(app().outputs().state).name) + ", " + std::string(info(app().outputs().reason).name);
    CHECK_TRUE_TEXT(fine(), what.c_str());
    return clock.now() - from;
  }
  static int occurrences(std::string_view text, std::string_view part) {
    int count = 0;
    for (std::size_t at = text.find(part); at != std::string_view::npos; at = text.find(part, at + 1)) ++count;
    return count;
  }
  // A console's answer.
  std::string ask(std::string_view line) {
    sim::Serial host{1 << 20};
    console::Console console(host, *daemon, clock, console::Place{.board = "test", .prompts = false});
    console.start(params);
    host.clear_output();
    CHECK_TRUE(host.feed({reinterpret_cast<const std::uint8_t*>(line.data()), line.size()}));
    for (int k = 0; k < 200; ++k) {
      poll();
      console.poll();
    }
    const std::vector<std::uint8_t> bytes = host.output_bytes();
    return {bytes.begin(), bytes.end()};
  }
  // What the wire brought since the last call.
  std::vector<status_frame::StatusFrame> told() {
    std::vector<status_frame::StatusFrame> out;
    test::StatusReceiver receiver;
    for (const std::uint8_t byte : link.output_bytes()) {
      if (const auto decoded = receiver.push(byte); decoded && decoded->ok()) out.push_back(decoded->frame);
    }
    link.clear_output();
    return out;
  }
};

TEST(Hand, VouchesWhenBothHaveLearned) {
  start();
  LONGS_EQUAL(2, app().fingers());
  while (!app().result(1).referenced && clock.now() < 2s) {
    CHECK_FALSE(fine());
    poll();
  }
  settled();
  // 25 pairs a second: ALIVE moves once for each, though twice as many frames are decided.
  const std::uint64_t before = edges;
  const int left = plugs[0]->frames;
  const int frames = plugs[1]->frames;
  for (const Micros end = clock.now() + 4s; clock.now() < end;) {
    poll();
    CHECK_TRUE(app().holds_nothing());  // with the frames of either
  }
  CHECK_TRUE(edges - before >= 99 && edges - before <= 101);
  CHECK_TRUE(plugs[0]->frames - left >= 99 && plugs[1]->frames - frames >= 99);
}

// Whenever either falls silent, or is pulled out: 150 ms later nobody is told that all is fine.
TEST(Hand, AFingerThatIsLostLowersTheLinesInTime) {
  start();
  settled();
  for (const bool pulled : {false, true}) {
    for (Micros at = 0ms; at < 40ms; at += 1700us) {
      // By turns: ALIVE then moves with frames of the finger that was lost last, and behind those of the next one.
      for (std::size_t finger = 0; finger < 2; ++finger) {
        for (const Micros end = clock.now() + 200ms + at; clock.now() < end;) poll();
        CHECK_TRUE(fine());
        const Micros lost_at = clock.now();
        (pulled ? plugs[finger]->out : plugs[finger]->silent) = true;
        while (clock.now() < lost_at + 400ms) poll();
        CHECK_TRUE(told_until <= lost_at + kRule);
        says(DeviceState::kFault, pulled ? Reason::kCameraGone : Reason::kNoFrame);
        plugs[finger]->out = plugs[finger]->silent = false;
        CHECK_TRUE(until_fine(3s) < 2s);
      }
    }
  }
}

TEST(Hand, GoesOnWithOneWhereItIsTold) {
  params.lost_finger = 1;
  start();
  settled();
  for (std::size_t finger = 0; finger < 2; ++finger) {
    plugs[finger]->out = true;
    CHECK_TRUE(until_fine(1s) < 300ms);
    run(2s);
    const std::uint64_t before = edges;
    run(1s);
    CHECK_TRUE(fine() && edges - before >= 24);
    // The other as well: nothing is left to go on with.
    plugs[1 - finger]->silent = true;
    run(kRule + 40ms);
    CHECK_FALSE(fine());
    LONGS_EQUAL(static_cast<int>(DeviceState::kFault), static_cast<int>(app().outputs().state));
    plugs[0]->out = plugs[1]->out = plugs[0]->silent = plugs[1]->silent = false;
    run(3s);
    CHECK_TRUE(fine());
    for (int i = 0; i < 2; ++i) CHECK_TRUE(app().supervisor(i).device == DeviceState::kOk);
  }
}

// The marker of an empty hand lets an update in: what a lost finger touches nobody knows.
TEST(Hand, DoesNotCallItselfEmptyWithoutOneOfItsFingers) {
  params.lost_finger = 1;
  start();
  settled();
  CHECK_TRUE(app().holds_nothing());
  plugs[1]->out = true;
  run(1s);
  CHECK_TRUE(fine());
  CHECK_FALSE(app().holds_nothing());
  plugs[1]->out = false;
  run(3s);
  CHECK_TRUE(app().holds_nothing());
}

// A driver may hang while it stops: the lines come first.
TEST(Hand, LowersTheLinesBeforeItStopsTheCameras) {
  start();
  settled();
  int stopped = 0;
  for (const auto& plug : plugs) {
    plug->at_stop = [&] {
      CHECK_TRUE(gpio.level(Line::kGripOk) == Level::kLow);
      ++stopped;
    };
  }
  daemon->stop();
  LONGS_EQUAL(2, stopped);
}

// While the right one is pulled out and plugged in again, no frame of the left one is lost or late.
TEST(Hand, OneIsSwappedWhileTheOtherRuns) {
  start();
  settled();
  const int before = plugs[0]->frames;
  plugs[1]->out = true;
  run(4s);
  CHECK_TRUE(plugs[0]->frames - before >= 99);
  CHECK_TRUE(app().supervisor(0).device == DeviceState::kOk);
  says(DeviceState::kFault, Reason::kCameraGone);
  plugs[1]->sensor = "ABCD-1234";
  plugs[1]->out = false;
  run(1s);
  says(DeviceState::kFault, Reason::kCameraWrong);
  plugs[1]->sensor = kRight;
  CHECK_TRUE(until_fine(3s) < 2s);
  LONGS_EQUAL(1, daemon->camera_starts(0));
}

TEST(Hand, SwappedSensorsAreNoticed) {
  start_with_swapped_sensors();
  run(2s);
  says(DeviceState::kFault, Reason::kCameraWrong);
  CHECK_FALSE(fine());
  LONGS_EQUAL(0, plugs[0]->frames + plugs[1]->frames);
  plugs[0]->sensor = kLeft;
  run(2s);
  says(DeviceState::kFault, Reason::kCameraWrong);  // of the other
  plugs[1]->sensor = kRight;
  until_fine(3s);
}

TEST(Hand, OneSensorIsNotBoth) {
  params.left_sensor = params.right_sensor = 7;
  ParamProblem problem;
  CHECK_FALSE(validate(params, &problem).ok());
  STRNCMP_EQUAL("right_sensor", problem.row->name.data(), problem.row->name.size());
}

TEST(Hand, TheNextProcessGoesOnWithBothReferences) {
  start();
  settled();
  const Marker left = app().state(0).reference.rest.markers[31];
  const Marker other = app().state(1).reference.rest.markers[31];
  start();
  CHECK_TRUE(daemon->resumed(0) && daemon->resumed(1));
  CHECK_TRUE(until_fine(2s) < 400ms);  // 10 frames would have to be learned otherwise
  LONGS_EQUAL(left.x.raw(), app().state(0).reference.rest.markers[31].x.raw());
  LONGS_EQUAL(other.x.raw(), app().state(1).reference.rest.markers[31].x.raw());
  // Each finger's own: in the other's place it is another sensor's.
  plugs[0]->sensor = kRight;
  plugs[1]->sensor = kLeft;
  start();
  CHECK_FALSE(daemon->resumed(0) || daemon->resumed(1));
  // TARE forgets both.
  run(1s);
  CHECK_TRUE(daemon->obey({.command = command_frame::Command::kTare, .argument = 1}) == command_frame::Outcome::kDone);
  start();
  CHECK_FALSE(daemon->resumed(0) || daemon->resumed(1));
}

TEST(Hand, StatusFramesTellOfEachFingerWhereTheyAreAskedFor) {
  start();
  settled();
  for (const auto& frame : told()) LONGS_EQUAL(0, frame.fingers);
  params.status_version = 2;
  daemon->reconfigure(params);
  (void)told();
  run(400ms);
  auto frames = told();
  CHECK_TRUE(frames.size() >= 19 && frames.size() <= 21);  // one for each picture of either
  for (const auto& frame : frames) {
    LONGS_EQUAL(3, frame.fingers);
    LONGS_EQUAL(3, frame.healthy);
    LONGS_EQUAL(0, frame.contact);
    CHECK_TRUE(frame.features_valid && frame.age_100us < 900);
  }
  plugs[1]->silent = true;
  run(300ms);
  frames = told();
  LONGS_EQUAL(3, frames.back().fingers);
  LONGS_EQUAL(1, frames.back().healthy);
  LONGS_EQUAL(static_cast<int>(DeviceState::kFault), static_cast<int>(frames.back().state));
  CHECK_TRUE(frames.back().features_valid);  // the left one's
}

// An object that is dragged touches both gels; when it is gone without a word, both fingers are well and the grip is
// not.
TEST(Hand, StatusFramesTellOfContactAndOfItsLoss) {
  film(30, 30);
  params.status_version = 2;
  start();
  run(1s);
  (void)told();
  std::array<int, 4> contacts{};
  int lost = 0;
  for (int k = 0; k < 20; ++k) {
    run(100ms);
    for (const auto& frame : told()) {
      ++contacts[frame.contact];
      if (frame.reason != Reason::kContactLost) continue;
      ++lost;
      LONGS_EQUAL(3, frame.healthy);
      LONGS_EQUAL(static_cast<int>(DeviceState::kSlip), static_cast<int>(frame.state));
    }
  }
  CHECK_TRUE(contacts[0] > 10 && contacts[3] > 10 && lost > 0);
}

TEST(Hand, OfOneFingerVersion1IsSentForEver) {
  params.status_version = 2;
  daemon = std::make_unique<Daemon>(Devices{*plugs[0], gpio, link, clock, jpeg}, Periphery{*gripper, keep});
  CHECK_TRUE(daemon->start(params).ok());
  settled();
  for (const auto& frame : told()) LONGS_EQUAL(0, frame.fingers);
}

// What a person at the console sees of both, and of sensors in each other's place.
TEST(Hand, TheConsoleNamesBothFingers) {
  start();
  settled();
  std::string seen = ask("devices\r");
  const std::string number = std::to_string(camera_keeper::number_of(kRight));
  STRCMP_CONTAINS("left", seen.c_str());
  STRCMP_CONTAINS("right", seen.c_str());
  STRCMP_CONTAINS("28D3-K2R9", seen.c_str());
  STRCMP_CONTAINS(("number " + number).c_str(), seen.c_str());
  plugs[1]->out = true;
  run(1s);
  STRCMP_CONTAINS(", FAULT camera_gone, ", ask("devices\r").c_str());
  plugs[1]->sensor = "ABCD-1234";  // another one, where any would have done
  plugs[1]->out = false;
  run(1s);
  seen = ask("devices\r");
  STRCMP_CONTAINS(", FAULT camera_wrong, ", seen.c_str());
  CHECK_TRUE(seen.find("store number") == std::string::npos);
  start_with_swapped_sensors();
  run(1s);
  seen = ask("devices\r");
  STRCMP_CONTAINS("the other finger's sensor", seen.c_str());
  STRCMP_CONTAINS(("number " + number).c_str(), seen.c_str());
  plugs[0]->sensor = "ABCD-1234";
  plugs[1]->sensor = kRight;  // it will be tried in a moment
  seen = ask("devices\r");
  STRCMP_CONTAINS("this is not the stored sensor", seen.c_str());
  CHECK_TRUE(seen.find("the other finger's sensor") == std::string::npos);
  // A device of one finger.
  daemon = std::make_unique<Daemon>(Devices{*plugs[0], gpio, link, clock, jpeg}, Periphery{*gripper, keep});
  CHECK_TRUE(daemon->start(params).ok());
  run(1s);
  STRCMP_CONTAINS("this is not the stored sensor", ask("devices\r").c_str());
}

// The right one is pulled out, and another one comes: what is shown of the left one does not change.
TEST(Hand, TheConsoleShowsTheFiguresOfEach) {
  const auto line = [](const std::string& text, std::string_view begin) {
    const std::size_t at = text.find("\n" + std::string(begin));
    CHECK_TRUE_TEXT(at != std::string::npos, text.c_str());
    return text.substr(at + 1, text.find('\r', at) - at - 1);
  };
  start();
  STRCMP_CONTAINS("ERR", ask("frame\r").c_str());
  settled();
  const std::string screen = ask("status\r");
  std::ptrdiff_t lines = 0;
  for (std::size_t at = 0, end = 0; (end = screen.find('\n', at)) != std::string::npos; at = end + 1) {
    lines += std::max<std::ptrdiff_t>(1, static_cast<std::ptrdiff_t>(end - at + 78) / 80);
  }
  CHECK_TRUE_TEXT(lines <= 23, screen.c_str());
  std::string json = ask("status json\r");
  for (const char* const name : {"left", "right"}) {
    STRCMP_CONTAINS("state OK, reason none, contact EMPTY, evidence imprint 0 of ", line(screen, name).c_str());
    STRCMP_CONTAINS(", fps 25.00, markers 63, entropy_nat ", line(screen, name).c_str());
    const std::string its = std::string("\"") + name + R"(":{"state":"OK","reason":"none","contact":"EMPTY",)";
    STRCMP_CONTAINS(its.c_str(), json.c_str());
    STRCMP_CONTAINS(": known yes, rows 7, cols 9, lines_cut 0, markers 63, ",
                    (":" + line(ask("reference\r"), name).substr(21)).c_str());
  }
  STRCMP_CONTAINS(R"(},"last_slip_s_ago":null,)", json.c_str());
  std::string markers = ask("frame\r");
  LONGS_EQUAL(1 + 63, occurrences(markers, "\nleft "));  // sequence and quality, and a row for each
  LONGS_EQUAL(1 + 63, occurrences(markers, "\nright "));
  STRCMP_CONTAINS("quality none", line(markers, "right").c_str());

  (void)ask("tasks clear\r");
  plugs[1]->out = true;
  run(4s);
  const std::string tasks = ask("tasks json\r");
  // 100 frames in 4 s, and those that came while the console was asked; each as old as its camera's latency.
  STRCMP_CONTAINS(R"({"finger":"left","task":"age","count":111,"p50_us":40000,)", tasks.c_str());
  STRCMP_CONTAINS(R"({"finger":"right","task":"age","count":11,"p50_us":55000,)", tasks.c_str());
  STRCMP_CONTAINS(R"({"finger":null,"task":"serve","count":)", tasks.c_str());
  LONGS_EQUAL(1, occurrences(tasks, R"("task":"console")"));
  json = ask("status json\r");
  STRCMP_CONTAINS(R"({"state":"FAULT","reason":"camera_gone",)", json.c_str());
  STRCMP_CONTAINS(R"("left":{"state":"OK")", json.c_str());
  STRCMP_CONTAINS(R"("right":{"state":"FAULT","reason":"camera_gone","contact":null,)", json.c_str());
  STRCMP_CONTAINS(R"("faults_since_start":1,)", json.c_str());  // though the left one had none
  STRCMP_CONTAINS("quality camera_gone", line(ask("frame\r"), "right").c_str());
  STRCMP_CONTAINS("camera_gone     right ", ask("log\r").c_str());
  const std::string flight = ask("log frames\r");
  CHECK_TRUE(occurrences(flight, "\nleft ") >= 100);
  const std::size_t gone = flight.find(" camera_gone    FAULT ");  // its quality
  CHECK_TRUE(gone != std::string::npos);
  CHECK_TRUE(flight.substr(flight.rfind('\n', gone) + 1, 6) == "right ");
  CHECK_TRUE(occurrences(ask("log fault\r"), "\nright ") >= 24);

  plugs[1]->out = false;
  plugs[1]->sensor = "ABCD-1234";
  start();
  const std::string reference = ask("reference json\r");
  LONGS_EQUAL(1, occurrences(reference, R"("resumed":true},"right":{)"));
  LONGS_EQUAL(1, occurrences(reference, R"("resumed":false}})"));
}

// `watch on`: evidence of both once there is a reference, markers of the left one, nothing of a finger that is silent.
TEST(Hand, TheConsoleStreamsTheEvidenceOfBoth) {
  sim::Serial host;
  start();
  console::Console console(host, *daemon, clock, console::Place{.board = "test", .prompts = false});
  console.start(params);
  const std::string_view line = "watch on\r";
  CHECK_TRUE(host.feed({reinterpret_cast<const std::uint8_t*>(line.data()), line.size()}));
  struct Counts {
    int statuses = 0;
    std::array<int, 2> evidences{};
  };
  const auto heard_for = [&](Micros time) {
    host.clear_output();
    for (const Micros end = clock.now() + time; clock.now() < end;) {
      poll();
      console.poll();
    }
    holdfast::link::Receiver receiver;
    Counts out;
    for (const std::uint8_t byte : host.output_bytes()) {
      if (receiver.push(byte) != holdfast::link::Event::kFrame) continue;
      if (const auto evidence = evidence_frame::read(receiver.payload())) ++out.evidences[evidence->finger];
      if (status_frame::read(receiver.payload()).ok()) ++out.statuses;
    }
    return out;
  };
  Counts heard = heard_for(150ms);
  CHECK_TRUE(heard.statuses > 0 && heard.evidences[0] + heard.evidences[1] == 0);
  settled();
  heard = heard_for(1s);
  CHECK_TRUE(heard.evidences[0] >= 24 && heard.evidences[1] >= 24);
  plugs[1]->silent = true;
  heard = heard_for(1s);
  CHECK_TRUE(heard.evidences[0] >= 24 && heard.evidences[1] <= 1);
  CHECK_TRUE(heard.statuses > heard.evidences[0] + 5);  // what is said of the silent one
}
