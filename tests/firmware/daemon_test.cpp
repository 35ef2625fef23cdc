// SPDX-License-Identifier: Apache-2.0
// The appliance around the App on simulated devices: commands, wires, a camera that comes back, a grasp that outlives
// the process. What it does when things fail is tried by the hundred in tests/e2e/faults_test.cpp.
#include "app/daemon.hpp"

#include <array>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "drivers/sim/camera_faults.hpp"
#include "drivers/sim/camera_memory.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/gpio.hpp"
#include "drivers/sim/hande.hpp"
#include "drivers/sim/keep.hpp"
#include "drivers/sim/serial.hpp"
#include "tests/support/frames.hpp"
#include "tests/support/reference.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::reference_model;
using namespace std::chrono_literals;
using command_frame::Command;
using command_frame::Result;
using hal::Input;
using hal::Level;
using hal::Line;
using test::NoJpeg;

namespace {

// Endless bytes, and a count of how many were asked for at once.
class Flood final : public hal::Serial {
 public:
  std::size_t most = 0;
  std::uint64_t calls = 0;

 private:
  [[nodiscard]] bool do_write(std::span<const std::uint8_t>) override { return true; }
  [[nodiscard]] std::size_t do_read(std::span<std::uint8_t> bytes) override {
    most = std::max(most, bytes.size());
    ++calls;
    for (std::uint8_t& byte : bytes) {
      random_ = random_ * 1664525 + 1013904223;
      byte = static_cast<std::uint8_t>(random_ >> 24);
    }
    return bytes.size();
  }
  std::uint32_t random_ = 1;
};

}  // namespace

TEST_GROUP(Daemon) {
  sim::Clock clock;
  sim::Gpio gpio{clock};
  sim::Serial link;
  sim::Keep keep{keepsake::kBytes};
  NoJpeg jpeg;
  std::unique_ptr<sim::HandE> hand;
  std::vector<Picture> pictures;
  std::unique_ptr<sim::CameraMemory> memory;
  std::unique_ptr<sim::FaultyCamera> camera;
  std::unique_ptr<Daemon> daemon;
  Params params;
  std::uint16_t sequence = 0;

  void teardown() override {
    daemon.reset();
    camera.reset();
    memory.reset();
    hand.reset();
    pictures.clear();
    pictures.shrink_to_fit();
  }

  // Eight pictures of the gel, empty or pressed on, shown over and over.
  void film(bool pressed = false) {
    const scene::PictureConfig view = scene::cropped_320x240();
    pictures.clear();
    for (std::uint64_t k = 0; k < 8; ++k) {
      const double drag = pressed ? 0.6 : 0.0;
      pictures.push_back(picture_of(view, lattice_px({}, view, gaussian({0.4, -0.3}, 4.0, drag, 0.3 * drag)), 300 + k));
    }
  }

  void build(std::vector<sim::FaultSpan> faults = {}, std::string_view identity = "28D1-D7C6") {
    plug(std::move(faults), identity);
    start();
  }
  // The camera is not there yet, and refuses to start three times.
  void build_without_camera(std::string_view identity = "28D1-D7C6") {
    plug({{0, 3, sim::CameraFault::kGone, {}}}, identity);
    hal::Frame frame;
    CHECK_TRUE(camera->start());
    CHECK_TRUE(camera->next(frame, 0us) == hal::Capture::kGone);
    start();
  }
  void plug(std::vector<sim::FaultSpan> faults, std::string_view identity) {
    std::vector<LumaView> views;
    for (const Picture& picture : pictures) views.push_back(picture.view());
    memory = std::make_unique<sim::CameraMemory>(
        clock, views, sim::CameraMemory::Config{.cycles = 1'000'000, .live = true, .identity = identity});
    camera = std::make_unique<sim::FaultyCamera>(*memory, clock, std::move(faults), std::size_t{320 * 240});
  }
  void start() {
    hand = std::make_unique<sim::HandE>(clock);
    daemon = std::make_unique<Daemon>(Devices{*camera, gpio, link, clock, jpeg}, Periphery{*hand, keep});
    CHECK_TRUE(daemon->start(params).ok());
  }

  void run(Micros time) {
    for (const Micros end = clock.now() + time; clock.now() < end;) daemon->poll();
  }
  [[nodiscard]] DeviceState state() const {
    return daemon->app().outputs().state;
  }
  [[nodiscard]] Reason reason() const {
    return daemon->app().outputs().reason;
  }
  [[nodiscard]] bool fine() const {
    return gpio.level(Line::kGripOk) == Level::kHigh;
  }

  // The answer to a command, within a few polls.
  std::optional<Result> ask(Command command, std::uint8_t argument, std::uint16_t number) {
    std::array<std::uint8_t, command_frame::kCommandBytes> wire{};
    (void)command_frame::encode(command_frame::CommandFrame{number, command, argument}, wire);
    CHECK_TRUE(link.feed(wire));
    link.clear_output();
    run(20ms);
    link::Receiver receiver;
    for (const std::uint8_t byte : link.output_bytes()) {
      if (receiver.push(byte) != link::Event::kFrame) continue;
      const auto answer = command_frame::read_answer(receiver.payload());
      if (answer && answer->sequence == number) return answer->result;
    }
    return std::nullopt;
  }
  std::optional<Result> ask(Command command, std::uint8_t argument = 0) {
    return ask(command, argument, ++sequence);
  }
};

TEST(Daemon, LearnsAndVouches) {
  film();
  build();
  run(1s);
  CHECK_TRUE(fine());
  CHECK_FALSE(daemon->resumed());
  LONGS_EQUAL(1, daemon->camera_starts());
}

TEST(Daemon, AnswersEveryCommand) {
  film();
  build();
  run(1s);
  CHECK_TRUE(ask(Command::kArm) == Result::kDone);
  CHECK_TRUE(ask(Command::kOpening, 1) == Result::kDone);
  CHECK_TRUE(ask(Command::kOpening, 0) == Result::kDone);
  CHECK_TRUE(ask(Command::kOpening, 2) == Result::kArgument);
  CHECK_TRUE(ask(Command::kGrip, 1) == Result::kState);  // no gripper is set up
  CHECK_TRUE(ask(Command::kRelease) == Result::kState);
  CHECK_TRUE(ask(static_cast<Command>(77)) == Result::kUnknown);
  CHECK_TRUE(fine());
}

TEST(Daemon, LearnsAnewOnTareAndOnlyOnceForARepetition) {
  film();
  build();
  run(1s);
  CHECK_TRUE(ask(Command::kTare, 0, 7) == Result::kDone);
  run(60ms);
  CHECK_TRUE(state() == DeviceState::kReference);
  CHECK_FALSE(fine());
  run(1s);
  CHECK_TRUE(fine());
  CHECK_TRUE(ask(Command::kTare, 0, 8) == Result::kDone);
  run(300ms);
  CHECK_TRUE(state() == DeviceState::kReference);
  CHECK_TRUE(ask(Command::kTare, 0, 8) == Result::kDone);  // answered again, and not begun again
  run(200ms);
  CHECK_TRUE(fine());
}

// OPENING masks slip, so it ends itself.
TEST(Daemon, EndsAnOpeningThatIsNeverTakenBack) {
  film();
  params.opening_max_ms = 500;
  build();
  run(1s);
  CHECK_TRUE(ask(Command::kOpening, 1) == Result::kDone);
  run(200ms);
  CHECK_TRUE(reason() == Reason::kOpening && daemon->app().state().opening);
  run(400ms);
  CHECK_TRUE(reason() == Reason::kNone && !daemon->app().state().opening);
  CHECK_TRUE(ask(Command::kOpening, 1) == Result::kDone);
  run(100ms);
  CHECK_TRUE(ask(Command::kOpening, 0) == Result::kDone);
  run(60ms);
  CHECK_FALSE(daemon->app().state().opening);
}

TEST(Daemon, ObeysWiresThatHoldTheirLevel) {
  film();
  build();
  run(1s);
  gpio.drive(Input::kTare, Level::kLow);
  gpio.drive(Input::kOpening, Level::kLow);
  run(100ms);
  gpio.drive(Input::kTare, Level::kHigh);  // a glitch
  daemon->poll();
  gpio.drive(Input::kTare, Level::kLow);
  run(200ms);
  CHECK_TRUE(fine());
  gpio.drive(Input::kTare, Level::kHigh);
  run(100ms);
  CHECK_TRUE(state() == DeviceState::kReference);
  run(1s);
  CHECK_TRUE(fine());  // HIGH for long is one command
  gpio.drive(Input::kOpening, Level::kHigh);
  run(100ms);
  CHECK_TRUE(daemon->app().state().opening);
  gpio.drive(Input::kOpening, Level::kLow);
  run(100ms);
  CHECK_FALSE(daemon->app().state().opening);
}

// A flood costs at most kMostLinkBytes a call, whatever comes, and changes nothing.
TEST(Daemon, ReadsABoundedNumberOfBytesFromTheLink) {
  film();
  build();
  Flood flood;
  Daemon flooded(Devices{*camera, gpio, flood, clock, jpeg}, Periphery{*hand, keep});
  CHECK_TRUE(flooded.start(params).ok());
  const std::uint64_t before = flood.calls;
  int polls = 0;
  for (const Micros end = clock.now() + 3s; clock.now() < end; ++polls) flooded.poll();
  LONGS_EQUAL(polls, flood.calls - before);
  CHECK_TRUE(flood.most <= Daemon::kMostLinkBytes);
  CHECK_TRUE(fine());
}

// Looked for more and more seldom, twice a second in the end; back within 2 s with the rest position it had.
TEST(Daemon, StartsACameraThatComesBack) {
  film();
  build({{50, 4, sim::CameraFault::kGone, {}}});
  run(1900ms);
  CHECK_TRUE(fine());
  run(200ms);
  CHECK_TRUE(reason() == Reason::kCameraGone && !fine() && !daemon->streaming());
  Micros waited{};
  while (!fine() && waited < 5s) {
    run(20ms);
    waited += 20ms;
  }
  CHECK_TRUE(waited < 2s);
  LONGS_EQUAL(2, daemon->camera_starts());
}

TEST(Daemon, WaitsForACameraThatIsNotThereAtTheStart) {
  film();
  build();
  sim::FaultyCamera late(*memory, clock, {{0, 3, sim::CameraFault::kGone, {}}}, std::size_t{320 * 240});
  Daemon patient(Devices{late, gpio, link, clock, jpeg}, Periphery{*hand, keep});
  CHECK_TRUE(patient.start(params).ok());
  for (const Micros end = clock.now() + 3s; clock.now() < end;) patient.poll();
  CHECK_TRUE(patient.app().outputs().grip_ok);
}

// A process ends in the middle of a grasp: the next one goes on with its rest position, and with the object.
TEST(Daemon, GoesOnWithAGraspThatAnotherProcessBegan) {
  film();
  build();
  run(2s);
  const MarkerField rest = daemon->app().state().reference.rest;
  daemon.reset();  // no stop(): killed
  film(true);
  build();
  CHECK_TRUE(daemon->resumed());
  run(200ms);
  CHECK_TRUE(daemon->app().result().referenced);
  CHECK_TRUE(state() == DeviceState::kOk || state() == DeviceState::kSlip);
  for (std::size_t i = 0; i < 63; ++i) {
    LONGS_EQUAL(rest.markers[i].x.raw(), daemon->app().state().reference.rest.markers[i].x.raw());
  }
  int displaced = 0;
  for (const MarkerDisplacement& d : daemon->app().state().displacement.markers) {
    displaced += d.valid && std::abs(d.dx.raw()) > 300 ? 1 : 0;
  }
  CHECK_TRUE(displaced > 5);  // 0.6 mm in the middle: what a rest position learned now would hide
}

TEST(Daemon, LearnsAnewForAnotherSensorAnotherPitchOrAfterATare) {
  film();
  build();
  run(1s);
  daemon.reset();
  build({}, "ABCD-1234");
  CHECK_FALSE(daemon->resumed());
  run(1s);
  daemon.reset();
  params.pitch_um = 1500;
  build({}, "ABCD-1234");
  CHECK_FALSE(daemon->resumed());
  run(1s);
  (void)ask(Command::kTare);
  daemon.reset();  // before it has learned
  build({}, "ABCD-1234");
  CHECK_FALSE(daemon->resumed());
}

// The sensor is there only later than the process: it says then which one it is, and what was kept counts from then on.
TEST(Daemon, GoesOnWithAGraspWhenItsCameraComesLater) {
  film();
  build();
  run(10s);  // saved several times
  daemon.reset();
  film(true);
  build_without_camera();
  CHECK_FALSE(daemon->resumed());
  run(2s);
  CHECK_TRUE(daemon->streaming() && daemon->resumed());
  CHECK_TRUE(daemon->app().result().referenced);
  (void)ask(Command::kTare, 1);
  run(1s);  // learned anew, and saved as the newest
  const MarkerField rest = daemon->app().state().reference.rest;
  daemon.reset();
  build();
  run(200ms);
  CHECK_TRUE(daemon->resumed());
  LONGS_EQUAL(rest.markers[31].x.raw(), daemon->app().state().reference.rest.markers[31].x.raw());
  // And another sensor that comes later is still another sensor.
  daemon.reset();
  build_without_camera("ABCD-1234");
  run(2s);
  CHECK_TRUE(daemon->streaming() && !daemon->resumed());
}

// A grip whose sensor is gone can still be put down.
TEST(Daemon, ReleasesWithoutACamera) {
  film();
  params.gripper = static_cast<std::int32_t>(Gripper::kHandE);
  build({{100, 1'000'000, sim::CameraFault::kGone, {}}});
  hand->put_object({.width_mm = 20.0});
  CHECK_TRUE(ask(Command::kGrip, 1) == Result::kDone);
  run(5s);
  CHECK_TRUE(!daemon->streaming() && hand->object_held());
  CHECK_TRUE(ask(Command::kRelease) == Result::kDone);
  run(3s);
  CHECK_FALSE(hand->object_held());
  CHECK_FALSE(fine());
}

// Another picture size is another lattice: the kept rest position does not fit, and is learned.
TEST(Daemon, LearnsAnewWhenThePictureDoesNotFit) {
  film();
  build();
  run(1s);
  daemon.reset();
  const scene::PictureConfig view = scene::cropped_320x240();
  pictures.clear();
  for (std::uint64_t k = 0; k < 8; ++k) {
    std::vector<Point> moved = lattice_px({}, view, gaussian({0.0, 0.0}, 4.0, 0.0, 0.0));
    for (Point& at : moved) at.x = at.x * 0.8 + 20;
    pictures.push_back(picture_of(view, moved, 900 + k));
  }
  build();
  run(120ms);
  CHECK_TRUE(state() == DeviceState::kReference);
  run(1s);
  CHECK_TRUE(fine());
}

// From GRIP to the fingers and back: activation, force of the start, release on command.
TEST(Daemon, GripsAndReleasesWithAHandE) {
  film();
  params.gripper = static_cast<std::int32_t>(Gripper::kHandE);
  build();
  hand->put_object({.width_mm = 20.0});
  run(1s);
  CHECK_TRUE(ask(Command::kGrip, 1) == Result::kDone);
  run(3s);
  CHECK_TRUE(hand->object_held());
  LONGS_EQUAL(params.start_force, daemon->grip().force);
  CHECK_TRUE(fine());
  CHECK_TRUE(ask(Command::kRelease) == Result::kDone);
  run(3s);
  CHECK_FALSE(hand->object_held());
  CHECK_TRUE(hand->width_mm() > 40.0);
  hand->unplug();
  run(150ms);
  CHECK_TRUE(reason() == Reason::kGripperSilent && !fine());
  hand->unplug(false);
  run(1s);
  CHECK_TRUE(fine());
}
