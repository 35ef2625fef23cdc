// SPDX-License-Identifier: Apache-2.0
// The appliance around the App on simulated devices: commands, wires, a camera that comes back, a grasp that outlives
// the process. What it does when things fail is tried by the hundred in tests/e2e/faults_test.cpp.
#include "app/daemon.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "drivers/sim/camera_faults.hpp"
#include "drivers/sim/camera_memory.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/gpio.hpp"
#include "drivers/sim/hande.hpp"
#include "drivers/sim/keep.hpp"
#include "drivers/sim/noise.hpp"
#include "drivers/sim/serial.hpp"
#include "drivers/sim/supply.hpp"
#include "tests/support/frames.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/set_back.hpp"
#include "tests/support/spread_tree.hpp"
#include "tests/support/status_receiver.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::reference_model;
using namespace std::chrono_literals;
using command_frame::Command;
using command_frame::Outcome;
using hal::Input;
using hal::Level;
using hal::Line;
using test::kSpreadTree;
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

// What the camera is plugged into: another sensor may be in it, or none that answers.
class Socket final : public hal::Camera {
 public:
  Socket(hal::Camera& inside, sim::Clock& clock, std::string_view identity)
      : sensor(identity), inside_(inside), clock_(clock) {}
  std::string_view sensor;
  bool silent = false;
  bool refuses = false;
  bool watched = false;  // for frozen pictures: the films of these tests repeat
  std::vector<Micros> starts;

 private:
  [[nodiscard]] bool do_start() override {
    starts.push_back(clock_.now());
    return !refuses && inside_.start();
  }
  [[nodiscard]] hal::Capture do_next(hal::Frame& frame, Micros timeout) override {
    if (!silent) return inside_.next(frame, timeout);
    clock_.advance(timeout);
    return hal::Capture::kTimeout;
  }
  void do_release(const hal::Frame& frame) override { inside_.release(frame); }
  void do_stop() override { inside_.stop(); }
  [[nodiscard]] std::string_view do_identity() const override { return sensor; }
  [[nodiscard]] bool do_live() const override { return watched; }

  hal::Camera& inside_;
  sim::Clock& clock_;
};

// A camera whose stamps are those of a clock that is set back.
class StampedBy final : public hal::Camera {
 public:
  StampedBy(hal::Camera& inside, const test::SetBack& clock) : inside_(inside), clock_(clock) {}

 private:
  [[nodiscard]] bool do_start() override { return inside_.start(); }
  [[nodiscard]] hal::Capture do_next(hal::Frame& frame, Micros timeout) override {
    const hal::Capture capture = inside_.next(frame, timeout);
    frame.timestamp -= clock_.by;
    return capture;
  }
  void do_release(const hal::Frame& frame) override { inside_.release(frame); }
  void do_stop() override { inside_.stop(); }
  hal::Camera& inside_;
  const test::SetBack& clock_;
};

}  // namespace

TEST_GROUP(Daemon) {
  sim::Clock clock;
  sim::Gpio gpio{clock};
  sim::Serial link;
  sim::Keep keep{checkpoint::kBytes};
  sim::Supply supply;
  NoJpeg jpeg;
  std::unique_ptr<sim::HandE> hand;
  std::vector<Picture> pictures;
  std::unique_ptr<sim::CameraMemory> memory;
  std::unique_ptr<sim::FaultyCamera> camera;
  std::unique_ptr<Socket> socket;
  std::unique_ptr<Daemon> daemon;
  Params params;
  const model::Tree* tree = nullptr;  // in place of the compiled one
  std::uint16_t sequence = 0;

  void teardown() override {
    daemon.reset();
    socket.reset();
    camera.reset();
    memory.reset();
    hand.reset();
    pictures.clear();
    pictures.shrink_to_fit();
  }

  // Eight pictures of the gel, empty or pressed on, shown over and over.
  void film(bool pressed = false) {
    pictures.clear();
    for (std::uint64_t k = 0; k < 8; ++k) pictures.push_back(test::dragged_gel(pressed ? 0.6 : 0.0, 300 + k));
  }

  void build(std::vector<sim::FaultSpan> faults = {}, std::string_view identity = "28D1-D7C6") {
    plug(std::move(faults), identity);
    start();
  }
  // The camera is not there yet, and refuses to start three times.
  void build_without_camera(std::string_view identity = "28D1-D7C6") {
    plug({{0, 3, sim::CameraFault::kGone, {}}}, identity);
    hal::Frame frame;
    CHECK_TRUE(socket->start());
    CHECK_TRUE(socket->next(frame, 0us) == hal::Capture::kGone);
    start();
  }
  void plug(std::vector<sim::FaultSpan> faults, std::string_view identity) {
    memory = std::make_unique<sim::CameraMemory>(
        clock, test::luma_views(pictures),
        sim::CameraMemory::Config{.cycles = 1'000'000, .live = true, .identity = identity});
    camera = std::make_unique<sim::FaultyCamera>(*memory, clock, std::move(faults), std::size_t{320 * 240});
    socket = std::make_unique<Socket>(*camera, clock, identity);
  }
  // The gripper outlives the process.
  void start() {
    if (!hand) hand = std::make_unique<sim::HandE>(clock);
    daemon = std::make_unique<Daemon>(Devices{*socket, gpio, link, clock, jpeg}, Periphery{*hand, keep, &supply}, tree);
    CHECK_TRUE(daemon->start(params).ok());
  }
  // With an empty gel, until it is confirmed.
  void start_and_learn() {
    film();
    build();
    run(1s);
    CHECK_TRUE(fine());
  }
  void use(Gripper gripper) {
    params.gripper = static_cast<std::int32_t>(gripper);
  }

  // A Hand-E holds something of 20 mm, by GRIP.
  void grip_an_object() {
    film();
    use(Gripper::kHandE);
    build();
    hand->put_object({.width_mm = 20.0});
    run(1s);
    CHECK_TRUE(ask(Command::kGrip, 1) == Outcome::kDone);
    run(3s);
    CHECK_TRUE(hand->object_held());
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
  std::optional<Outcome> ask(Command command, std::uint8_t argument, std::uint16_t number) {
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
  std::optional<Outcome> ask(Command command, std::uint8_t argument = 0) {
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
  start_and_learn();
  CHECK_TRUE(ask(Command::kArm) == Outcome::kDone);
  CHECK_TRUE(ask(Command::kOpening, 1) == Outcome::kDone);
  CHECK_TRUE(ask(Command::kOpening, 0) == Outcome::kDone);
  CHECK_TRUE(ask(Command::kOpening, 2) == Outcome::kArgument);
  CHECK_TRUE(ask(Command::kGrip, 1) == Outcome::kState);  // no gripper is set up
  CHECK_TRUE(ask(Command::kRelease) == Outcome::kState);
  CHECK_TRUE(ask(static_cast<Command>(77)) == Outcome::kUnknown);
  CHECK_TRUE(fine());
}

TEST(Daemon, LearnsAnewOnTareAndOnlyOnceForARepetition) {
  start_and_learn();
  CHECK_TRUE(ask(Command::kTare, 0, 7) == Outcome::kDone);
  run(60ms);
  CHECK_TRUE(state() == DeviceState::kReference);
  CHECK_FALSE(fine());
  run(1s);
  CHECK_TRUE(fine());
  CHECK_TRUE(ask(Command::kTare, 0, 8) == Outcome::kDone);
  run(300ms);
  CHECK_TRUE(state() == DeviceState::kReference);
  CHECK_TRUE(ask(Command::kTare, 0, 8) == Outcome::kDone);  // answered again, and not begun again
  run(200ms);
  CHECK_TRUE(fine());
  run(1s);
  CHECK_TRUE(ask(Command::kTare, 0, 8) == Outcome::kDone);  // so late it is a command of its own
  run(300ms);
  CHECK_TRUE(state() == DeviceState::kReference);
  CHECK_TRUE(ask(Command::kTare, 0, 9) == Outcome::kDone);  // and one that comes while it learns begins anew
  run(300ms);
  CHECK_TRUE(state() == DeviceState::kReference);
}

// A rest position learned now would hide what presses on the gel: only whoever insists gets it.
TEST(Daemon, RefusesTareWhileSomethingTouchesTheGel) {
  start_and_learn();
  daemon.reset();
  film(true);
  build({{14, 10, sim::CameraFault::kGarbage, {}}});
  run(500ms);
  CHECK_TRUE(daemon->app().result().contact.touching);
  const MarkerField rest = daemon->app().state().reference.rest;
  CHECK_TRUE(ask(Command::kTare, 0) == Outcome::kTouching);
  gpio.drive(Input::kTare, Level::kLow);
  while (daemon->app().result().quality.ok()) daemon->poll();
  CHECK_TRUE(ask(Command::kTare, 0) == Outcome::kTouching);  // nor does it go away because its pictures are refused
  CHECK_FALSE(daemon->app().result().quality.ok());
  run(1s);
  gpio.drive(Input::kTare, Level::kHigh);  // the wire cannot insist
  run(1s);
  const FlightEvent refused = daemon->recorder().events()[daemon->recorder().events().size() - 1];
  CHECK_TRUE(refused.kind == EventKind::kCommand && refused.a == static_cast<int>(Command::kTare) &&
             refused.b == static_cast<int>(Outcome::kTouching));
  CHECK_TRUE(daemon->app().result().contact.touching);
  LONGS_EQUAL(rest.markers[31].x.raw(), daemon->app().state().reference.rest.markers[31].x.raw());
  CHECK_TRUE(ask(Command::kTare, 1) == Outcome::kDone);
  CHECK_FALSE(daemon->app().state().contact.touching);  // against another gel, nobody knows yet
  run(1s);
  CHECK_TRUE(daemon->app().result().referenced && !daemon->app().result().contact.touching);
  CHECK_FALSE(rest.markers[31].x.raw() == daemon->app().state().reference.rest.markers[31].x.raw());
}

// An echo on the line, or a newer sender: what is no command is not answered.
TEST(Daemon, PassesOverSoundFramesThatAreNoCommand) {
  start_and_learn();
  std::array<std::uint8_t, command_frame::kAnswerBytes> wire{};
  (void)command_frame::encode(command_frame::AnswerFrame{5, Command::kTare, Outcome::kDone}, wire);
  CHECK_TRUE(link.feed(wire));
  link.clear_output();
  const std::uint32_t frames = daemon->commands().frames();
  run(200ms);
  LONGS_EQUAL(frames + 1, daemon->commands().frames());
  test::StatusReceiver robot;
  int told = 0;
  for (const std::uint8_t byte : link.output_bytes()) {
    if (const auto status = robot.push(byte)) told += status->ok() ? 1 : 100;
  }
  CHECK_TRUE(told >= 4 && told <= 6);  // status frames alone
  CHECK_TRUE(fine());
}

// OPENING masks slip, so it ends itself.
TEST(Daemon, EndsAnOpeningThatIsNeverTakenBack) {
  film();
  params.opening_max_ms = 500;
  build();
  run(1s);
  CHECK_TRUE(ask(Command::kOpening, 1) == Outcome::kDone);
  run(200ms);
  CHECK_TRUE(reason() == Reason::kOpening && daemon->app().state().opening);
  run(400ms);
  CHECK_TRUE(reason() == Reason::kNone && !daemon->app().state().opening);
  CHECK_TRUE(ask(Command::kOpening, 0) == Outcome::kDone);
  CHECK_TRUE(ask(Command::kOpening, 1) == Outcome::kDone);
  run(100ms);
  CHECK_TRUE(daemon->app().state().opening);
  CHECK_TRUE(ask(Command::kOpening, 0) == Outcome::kDone);
  run(60ms);
  CHECK_FALSE(daemon->app().state().opening);
}

// Said again every quarter of a second it masks slip for 5 s in all, and for 5 s again after each end.
TEST(Daemon, EndsAnOpeningThatIsSaidAgainAndAgain) {
  start_and_learn();
  for (int round = 0; round < 2; ++round) {
    Micros masked{};
    int refused = 0;
    for (Micros said{}; said < 20s; said += 250ms) {
      const auto answer = ask(Command::kOpening, 1);
      CHECK_TRUE(answer == Outcome::kDone || answer == Outcome::kOverdue);
      CHECK_FALSE(answer == Outcome::kOverdue && daemon->is_opening());
      refused += answer == Outcome::kOverdue ? 1 : 0;
      for (const Micros end = clock.now() + 230ms; clock.now() < end;) {
        const Micros before = clock.now();
        daemon->poll();
        if (daemon->app().state().opening) masked += clock.now() - before;
      }
    }
    CHECK_TRUE(masked > 2s && masked < 5100ms);
    CHECK_TRUE(refused >= 59);
    CHECK_TRUE(reason() == Reason::kNone);
    CHECK_TRUE(ask(Command::kOpening, 0) == Outcome::kDone);
  }
  // The wire is a sender like any other, and its fall an end.
  for (Micros said{}; said < 6s; said += 250ms) {
    (void)ask(Command::kOpening, 1);
    run(230ms);
  }
  gpio.drive(Input::kOpening, Level::kHigh);
  run(100ms);
  CHECK_FALSE(daemon->app().state().opening);
  const auto& events = daemon->recorder().events();
  const FlightEvent& last = events[events.size() - 1];
  LONGS_EQUAL(static_cast<int>(EventKind::kCommand), static_cast<int>(last.kind));
  LONGS_EQUAL(2, last.a);
  LONGS_EQUAL(6, last.b);
  gpio.drive(Input::kOpening, Level::kLow);
  run(100ms);
  gpio.drive(Input::kOpening, Level::kHigh);
  run(100ms);
  CHECK_TRUE(daemon->app().state().opening);
}

// A robot that never stops saying OPENING is told of the slip behind its time, not only of none.
TEST(Daemon, TellsOfASlipUnderAnOpeningThatIsHeld) {
  pictures = test::drag_film(70, 12);  // a slip after 2.8 s, and after 6.1 s again
  tree = &kSpreadTree;
  build();
  run(500ms);
  const Micros began = clock.now();
  Micros told{};
  while (told == Micros{} && clock.now() < began + 8s) {
    (void)ask(Command::kOpening, 1);
    for (const Micros end = clock.now() + 230ms; clock.now() < end;) {
      daemon->poll();
      if (state() == DeviceState::kSlip && !fine()) told = clock.now() - began;
    }
  }
  CHECK_TRUE(told > 5s && told < 6500ms);
}

// Fingers move on command alone: neither a start nor a slip that nobody asked to grip for opens or closes them.
TEST(Daemon, LeavesFingersAloneThatNobodyCommanded) {
  constexpr int kGo = 1 << 3;  // rGTO of the Hand-E's first output register
  film();
  use(Gripper::kHandE);
  build();
  hand->put_object({.width_mm = 20.0});
  bool went = false;
  for (const Micros end = clock.now() + 3s; clock.now() < end;) {
    daemon->poll();
    went = went || (hand->output(0) & kGo) != 0;
  }
  LONGS_EQUAL(1, hand->activations());
  CHECK_FALSE(went);
  CHECK_FALSE(hand->object_held());
}

// RELEASE opens the fingers however often it is said; what it masks is capped like OPENING.
TEST(Daemon, CapsWhatReleaseMasksAsWell) {
  grip_an_object();
  for (int k = 0; k < 32; ++k) {
    CHECK_TRUE(ask(Command::kRelease) == Outcome::kDone);
    CHECK_TRUE(daemon->is_opening() == (k < 19) || k == 19 || k == 20);
    run(230ms);
  }
  CHECK_FALSE(hand->object_held());
  CHECK_FALSE(daemon->is_opening());
  CHECK_TRUE(ask(Command::kOpening, 1) == Outcome::kOverdue);
  CHECK_TRUE(ask(Command::kGrip, 1) == Outcome::kDone);  // an end: the fingers close
  CHECK_TRUE(ask(Command::kOpening, 1) == Outcome::kDone);
}

// A robot that never says the end: what it grips next tells that the fingers have closed.
TEST(Daemon, LetsTheNextContactBeOpenedWithoutAnEnd) {
  film();
  const std::vector<Picture> empty = pictures;
  film(true);
  std::vector<Picture> touched = pictures;
  pictures.clear();
  const auto show = [&](const std::vector<Picture>& some) {  // no two alike, as a sensor's
    for (int k = 0; k < 8; ++k) {
      for (Picture picture : some) {
        sim::add_noise(picture.pixels, pictures.size());
        pictures.push_back(picture);
      }
    }
  };
  show(empty);    // 2.56 s
  show(touched);  // and as long
  params.opening_max_ms = 500;
  build();
  run(1s);
  CHECK_TRUE(ask(Command::kOpening, 1) == Outcome::kDone);
  run(1s);
  CHECK_TRUE(ask(Command::kOpening, 1) == Outcome::kOverdue);
  while (!daemon->app().result().contact.touching && clock.now() < 5s) run(20ms);
  CHECK_TRUE(daemon->app().result().contact.touching);
  CHECK_TRUE(ask(Command::kOpening, 1) == Outcome::kDone);
  run(700ms);
  CHECK_FALSE(daemon->is_opening());
  CHECK_TRUE(ask(Command::kOpening, 1) == Outcome::kOverdue);  // it touches still: that is no new contact
}

TEST(Daemon, ObeysWiresThatHoldTheirLevel) {
  start_and_learn();
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
  // Seen HIGH for 10 ms: at once after a frame, when the daemon looks every 5 ms.
  const std::uint32_t shown = daemon->app().result().sequence;
  while (daemon->app().result().sequence == shown) daemon->poll();
  gpio.drive(Input::kOpening, Level::kHigh);
  for (const bool opening : {false, false, true}) {
    daemon->poll();
    CHECK_EQUAL(opening, daemon->app().state().opening);
  }
  gpio.drive(Input::kOpening, Level::kLow);
  run(100ms);
  CHECK_FALSE(daemon->app().state().opening);
}

TEST(Daemon, ReleasesAndArmsByWire) {
  gpio.drive(Input::kRelease, Level::kLow);
  gpio.drive(Input::kArm, Level::kLow);
  grip_an_object();
  CHECK_TRUE(fine());
  gpio.drive(Input::kRelease, Level::kHigh);
  run(3s);
  CHECK_FALSE(hand->object_held());
  hand->set_fault(0xE);  // overcurrent: latched until somebody says ARM
  run(1s);
  CHECK_TRUE(reason() == Reason::kGripperOvercurrent && !fine());
  gpio.drive(Input::kArm, Level::kHigh);
  run(4s);
  LONGS_EQUAL(2, hand->activations());
  CHECK_TRUE(reason() == Reason::kNone && fine());
}

// A robot that leaves its wires HIGH says nothing new to the next process: what it holds it goes on holding.
TEST(Daemon, AWireThatIsHighAtItsStartHasNotRisen) {
  grip_an_object();
  daemon.reset();
  for (const Input input : {Input::kTare, Input::kRelease, Input::kArm}) gpio.drive(input, Level::kHigh);
  build();
  run(3s);
  CHECK_TRUE(hand->object_held() && daemon->resumed() && fine());
  gpio.drive(Input::kRelease, Level::kLow);
  daemon->poll();
  gpio.drive(Input::kRelease, Level::kHigh);  // a glitch
  run(100ms);
  CHECK_TRUE(hand->object_held());
  gpio.drive(Input::kRelease, Level::kLow);
  run(100ms);
  gpio.drive(Input::kRelease, Level::kHigh);
  run(3s);
  CHECK_FALSE(hand->object_held());
  // OPENING is a level, and holds from the first on.
  daemon.reset();
  gpio.drive(Input::kOpening, Level::kHigh);
  build();
  run(100ms);
  CHECK_TRUE(daemon->is_opening());
}

// A flood costs at most 64 bytes a call, whatever comes, and changes nothing.
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
  CHECK_TRUE(flood.most <= 64);
  CHECK_TRUE(fine());
}

// What was gone a second ago is there: a cable is not what is wrong with it.
TEST(Daemon, CallsACameraThatCameBackAndSendsNothingSilent) {
  film();
  build({{20, 3, sim::CameraFault::kGone, {}}});
  while (daemon->streaming() && clock.now() < 2s) daemon->poll();
  CHECK_TRUE(reason() == Reason::kCameraGone);
  socket->silent = true;
  run(2s);
  CHECK_TRUE(daemon->streaming() && state() == DeviceState::kFault);
  CHECK_TRUE(reason() == Reason::kNoFrame);
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
  plug({}, "28D1-D7C6");
  socket->refuses = true;
  start();
  for (const Micros end = clock.now() + 2s; clock.now() < end;) {
    daemon->poll();
    CHECK_FALSE(daemon->streaming());
    CHECK_TRUE(state() == DeviceState::kBoot || (state() == DeviceState::kFault && reason() == Reason::kCameraGone));
  }
  CHECK_TRUE(state() == DeviceState::kFault);
  socket->refuses = false;
  run(1s);
  CHECK_TRUE(fine());
}

// A stream without an accepted frame is started anew after half a second, then after twice that, up to 4 s; a frame
// that is accepted ends that.
TEST(Daemon, StartsAStreamAnewThatHasFallenSilent) {
  start_and_learn();
  socket->silent = true;
  socket->starts = {clock.now()};
  run(17s);
  CHECK_TRUE(daemon->streaming() && !fine() && reason() == Reason::kNoFrame);
  LONGS_EQUAL(1, daemon->camera_starts());  // it never ended: nothing came back
  const Micros waits[] = {500ms, 1s, 2s, 4s, 4s, 4s};
  LONGS_EQUAL(std::size(waits) + 1, socket->starts.size());
  for (std::size_t k = 0; k < std::size(waits); ++k) {
    const Micros wait = socket->starts[k + 1] - socket->starts[k];
    const Micros noticed = k == 0 ? 100ms : 0ms;  // the silence
    CHECK_TRUE(wait > waits[k] && wait <= waits[k] + noticed + 10ms);
  }
  socket->silent = false;
  run(1s);
  CHECK_TRUE(fine());
}

// Silent, and then not to be started again: it is looked for as one that is gone.
TEST(Daemon, LooksForASilentCameraThatDoesNotStartAgain) {
  start_and_learn();
  socket->silent = socket->refuses = true;
  run(2s);
  CHECK_TRUE(!daemon->streaming() && !fine() && reason() == Reason::kCameraGone);
  socket->silent = socket->refuses = false;
  run(1s);
  CHECK_TRUE(daemon->streaming() && fine());
  LONGS_EQUAL(2, daemon->camera_starts());
}

// Another one may be there when a silent stream is started anew; that is told, and nothing else in between.
TEST(Daemon, NamesAnotherSensorAtOnce) {
  start_and_learn();
  socket->silent = true;
  socket->sensor = "ABCD-1234";
  while (daemon->streaming()) daemon->poll();
  for (const Micros end = clock.now() + 2s; clock.now() < end;) {
    daemon->poll();
    CHECK_TRUE(!fine() && (reason() == Reason::kNoFrame || reason() == Reason::kCameraWrong));
  }
  CHECK_TRUE(reason() == Reason::kCameraWrong);
  socket->silent = false;
  socket->sensor = "28D1-D7C6";
  run(1s);
  CHECK_TRUE(fine());
}

// Another sensor in the same socket has another gel: nothing is confirmed until the first one is back.
TEST(Daemon, RefusesAnotherSensorThanTheOneItBeganWith) {
  film();
  build({{25, 1, sim::CameraFault::kGone, {}}});
  run(900ms);
  CHECK_TRUE(fine());
  socket->sensor = "ABCD-1234";
  run(3s);
  CHECK_TRUE(!daemon->streaming() && !fine() && reason() == Reason::kCameraWrong);
  socket->sensor = "28D1-D7C6";
  run(1s);
  CHECK_TRUE(daemon->streaming() && fine());
}

// Against its contract, but boards do it: an hour back must not cost an hour anywhere.
TEST(Daemon, WaitsForNothingLongWhenTheClockIsSetBack) {
  film();
  use(Gripper::kHandE);
  params.opening_max_ms = 500;
  plug({}, "28D1-D7C6");
  hand = std::make_unique<sim::HandE>(clock);
  hand->put_object({.width_mm = 20.0});
  clock.advance(2h);
  test::SetBack board(clock);
  StampedBy stamped(*socket, board);
  daemon = std::make_unique<Daemon>(Devices{stamped, gpio, link, board, jpeg}, Periphery{*hand, keep});
  CHECK_TRUE(daemon->start(params).ok());
  gpio.drive(Input::kTare, Level::kLow);
  run(1s);
  CHECK_TRUE(ask(Command::kGrip, 1) == Outcome::kDone);
  run(3s);
  CHECK_TRUE(hand->object_held() && fine());
  CHECK_TRUE(ask(Command::kOpening, 1) == Outcome::kDone);
  CHECK_TRUE(ask(Command::kArm) == Outcome::kDone);
  gpio.drive(Input::kTare, Level::kHigh);
  daemon->poll();
  const std::uint64_t writes = hand->writes();
  board.by = 1h;
  // A sender that starts anew may begin with the number that was the last: its command is no repetition for an hour.
  const auto arms = [&] {
    int count = 0;
    for (std::size_t k = 0; k < daemon->recorder().events().size(); ++k) {
      const FlightEvent& event = daemon->recorder().events()[k];
      count += event.kind == EventKind::kCommand && event.a == static_cast<int>(Command::kArm) ? 1 : 0;
    }
    return count;
  };
  LONGS_EQUAL(1, arms());
  CHECK_TRUE(ask(Command::kArm, 0, sequence) == Outcome::kDone);
  LONGS_EQUAL(2, arms());
  run(80ms);
  CHECK_TRUE(daemon->app().state().opening && !fine());
  CHECK_FALSE(daemon->app().state().reference.known);  // the wire has held its level for long enough
  run(2s);
  CHECK_FALSE(daemon->app().state().opening);
  CHECK_TRUE(fine() && reason() == Reason::kNone);
  CHECK_TRUE(daemon->gripper().fresh && hand->object_held());
  LONGS_EQUAL(1, hand->activations());
  CHECK_TRUE(hand->writes() <= writes + 1);
  CHECK_TRUE(ask(Command::kRelease) == Outcome::kDone);
  run(3s);
  CHECK_FALSE(hand->object_held());
}

// A pulse that is out ends, and a silence goes on being told.
TEST(Daemon, EndsPulsesAndTellsSilenceWhenTheClockIsSetBack) {
  film();
  use(Gripper::kStepLines);
  plug({}, "28D1-D7C6");
  hand = std::make_unique<sim::HandE>(clock);
  clock.advance(3h);
  test::SetBack board(clock);
  StampedBy stamped(*socket, board);
  daemon = std::make_unique<Daemon>(Devices{stamped, gpio, link, board, jpeg}, Periphery{*hand, keep});
  CHECK_TRUE(daemon->start(params).ok());
  run(1s);
  CHECK_TRUE(ask(Command::kGrip, 1) == Outcome::kDone);
  run(100ms);
  CHECK_TRUE(ask(Command::kRelease) == Outcome::kDone);
  const Micros patience = clock.now() + 1s;
  while (gpio.level(Line::kDecrease) == Level::kLow && clock.now() < patience) daemon->poll();
  const std::uint64_t edges = gpio.edges(Line::kDecrease);
  board.by = 1h;
  run(24ms + 10ms);
  LONGS_EQUAL(edges + 1, gpio.edges(Line::kDecrease));

  run(5s);
  CHECK_TRUE(fine());
  socket->silent = true;
  run(1s);
  board.by = 2h;
  link.clear_output();
  run(500ms);
  test::StatusReceiver robot;
  int told = 0;
  for (const std::uint8_t byte : link.output_bytes()) {
    if (const auto status = robot.push(byte)) told += status->ok() && !status->frame.grip_ok ? 1 : 100;
  }
  CHECK_TRUE(told >= 4 && told <= 6);
}

TEST(Daemon, DoesNotStartOnWhatIsNotSound) {
  film();
  plug({}, "28D1-D7C6");
  hand = std::make_unique<sim::HandE>(clock);
  use(Gripper::kStepLines);
  Daemon other(Devices{*socket, gpio, link, clock, jpeg}, Periphery{*hand, keep});
  Params wrong = params;
  wrong.start_force = wrong.max_force + 1;
  CHECK_TRUE(other.start(wrong).reason == Reason::kConfig);
  for (const Line line : {Line::kGripOk, Line::kAlive, Line::kIncrease, Line::kDecrease}) {
    CHECK_TRUE(gpio.set(line, Level::kHigh));
    gpio.stick(line);
    CHECK_TRUE(other.start(params).reason == Reason::kGpioFailed);
    gpio.stick(line, false);
  }
  CHECK_TRUE(other.start(params).ok());
}

// The table of parameters is the one that users see; the regulator's own ranges are to be no narrower.
TEST(Daemon, EverySettingOfTheTableIsOneThatTheRegulatorTakes) {
  for (const ParamInfo& row : kParams) {
    for (const std::int32_t value : {row.min, row.max}) {
      Params extreme;
      extreme.*row.member = value;
      if (validate(extreme).ok()) CHECK_TRUE(regulator::validate(regulator_config(extreme)).ok());
    }
  }
}

// A lost reply, a pause and the next reply fit into the age that a status may have, and that into the receiver's 150
// ms.
TEST(Daemon, HearsOfASilentHandEWithinTheReceiversTime) {
  const hande::Config config = hande_config({});
  CHECK_TRUE(hande::validate(config).ok());
  CHECK_TRUE(config.bus.timeout == 30ms && config.back_off == 10ms && config.longest_back_off == 250ms);
  CHECK_TRUE(config.idle_poll == 40ms && config.fresh_for == 120ms);
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

// A process that was killed, as by its watchdog, may have died of a fault: with `latch` the next one waits for ARM.
TEST(Daemon, WaitsForArmAfterAProcessThatWasKilled) {
  params.latch = 1;
  film();
  build();
  run(2s);
  CHECK_TRUE(fine());  // the first one since the board is on
  daemon.reset();
  build();
  run(2s);
  CHECK_TRUE(daemon->resumed());
  CHECK_TRUE(state() == DeviceState::kFault && reason() == Reason::kNeedsArm);
  CHECK_FALSE(fine());
  (void)ask(Command::kArm);
  run(200ms);
  CHECK_TRUE(fine());
}

// A camera that is frozen shows a new process its old picture as if it were new, once.
TEST(Daemon, IsNotFineOnOnePictureOfAFrozenCamera) {
  film();
  build();
  run(2s);
  CHECK_TRUE(fine());
  daemon.reset();
  plug({{1, 1'000'000, sim::CameraFault::kStuck, {}}}, "28D1-D7C6");
  socket->watched = true;
  start();
  CHECK_TRUE(daemon->resumed());
  for (const Micros end = clock.now() + 400ms; clock.now() < end;) {  // a restart frees it
    daemon->poll();
    CHECK_FALSE(fine());
  }
  CHECK_TRUE(state() == DeviceState::kFault && reason() == Reason::kFrameFrozen);
}

// The rest position is written when it was learned, and then on an empty gel: a refused frame is no reason to.
TEST(Daemon, WritesNothingForARefusedFrame) {
  start_and_learn();
  daemon.reset();
  film(true);
  build({{20, 2, sim::CameraFault::kGarbage, {}}});
  run(500ms);
  CHECK_TRUE(daemon->resumed() && daemon->app().result().contact.touching);
  const std::vector<std::uint8_t> before(keep.bytes().begin(), keep.bytes().end());
  run(5s);
  CHECK_TRUE(std::equal(before.begin(), before.end(), keep.bytes().begin()));
}

TEST(Daemon, LearnsAnewForAnotherSensorAnotherPitchOrAfterATare) {
  start_and_learn();
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

// Another model was loaded: one that reads the picture needs an empty gel, which one that does not read it has not
// learned. The other way round nothing is missing, and what was learned is handed on.
TEST(Daemon, LearnsAnewForAModelThatReadsMore) {
  film();
  tree = &kSpreadTree;
  build();
  run(1s);
  daemon.reset();
  build();
  CHECK_TRUE(daemon->resumed());
  run(1s);
  daemon.reset();
  tree = nullptr;
  build();
  CHECK_FALSE(daemon->resumed());
  run(1s);
  for (const model::Tree* const next : {&kSpreadTree, static_cast<const model::Tree*>(nullptr)}) {
    daemon.reset();
    tree = next;
    build();
    CHECK_TRUE(daemon->resumed());
    run(1s);
  }
}

// Two that say nothing of themselves may be two sensors.
TEST(Daemon, LearnsAnewForASensorThatDoesNotSayWhichOneItIs) {
  film();
  build({}, "");
  run(1s);
  CHECK_TRUE(fine());
  daemon.reset();
  build({}, "");
  CHECK_FALSE(daemon->resumed());
  run(120ms);
  CHECK_TRUE(state() == DeviceState::kReference);
}

// The gripper holds on while no process runs: the next one wants the force that it had, not the one of a new grip.
TEST(Daemon, HoldsAsHardAsTheProcessBefore) {
  params.start_force = 60;
  grip_an_object();
  daemon.reset();
  params.start_force = 20;
  build();
  run(2s);
  CHECK_TRUE(hand->object_held() && daemon->grip().go && fine());
  LONGS_EQUAL(60, daemon->grip().force);
  LONGS_EQUAL(60, hand->output(5));
  daemon.reset();
  params.max_force = 40;  // the object bears no more, it says now
  build();
  run(1s);
  LONGS_EQUAL(40, hand->output(5));
  daemon.reset();
  use(Gripper::kNone);
  build();
  run(1s);
  CHECK_FALSE(daemon->grip().go);
  daemon.reset();
  use(Gripper::kHandE);  // and what was not held on to is not taken up again
  build();
  run(1s);
  CHECK_FALSE(daemon->grip().go);
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
  CHECK_TRUE(ask(Command::kGrip, 1) == Outcome::kDone);
  run(5s);
  CHECK_TRUE(!daemon->streaming() && hand->object_held());
  CHECK_TRUE(ask(Command::kRelease) == Outcome::kDone);
  run(3s);
  CHECK_FALSE(hand->object_held());
  CHECK_FALSE(fine());
}

// Another picture size is another lattice: the kept rest position does not fit, and is learned.
TEST(Daemon, LearnsAnewWhenThePictureDoesNotFit) {
  start_and_learn();
  daemon.reset();
  const scene::PictureConfig view = scene::cropped_320x240();
  pictures.clear();
  for (std::uint64_t k = 0; k < 8; ++k) {
    std::vector<Point> moved = lattice_px({}, view, gaussian({0.0, 0.0}, 4.0, 0.0, 0.0));
    for (Point& at : moved) at.x = at.x * 0.8 + 20;
    pictures.push_back(picture_of(view, moved, 900 + k));
  }
  build();
  CHECK_TRUE(daemon->resumed());  // as far as is known
  run(120ms);
  CHECK_FALSE(daemon->resumed());
  CHECK_TRUE(state() == DeviceState::kReference);
  run(1s);
  CHECK_TRUE(fine());
}

// From GRIP to the fingers and back: activation, force of the start, release on command.
TEST(Daemon, GripsAndReleasesWithAHandE) {
  grip_an_object();
  LONGS_EQUAL(params.start_force, daemon->grip().force);
  CHECK_TRUE(fine());
  CHECK_TRUE(ask(Command::kRelease) == Outcome::kDone);
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

// RELEASE was answered: a process that is killed before it is done leaves the rest of it to the next one.
TEST(Daemon, LetsGoWhatTheProcessBeforeBeganToLetGo) {
  params.start_force = 120;
  for (const Micros killed_after : {100ms, 300ms, 700ms}) {
    hand.reset();
    keep = sim::Keep{checkpoint::kBytes};
    grip_an_object();
    CHECK_TRUE(ask(Command::kRelease) == Outcome::kDone);
    run(killed_after);
    CHECK_TRUE(hand->object_held());
    daemon.reset();
    build();
    CHECK_TRUE(daemon->is_opening());
    run(3s);
    CHECK_FALSE(hand->object_held());
    CHECK_TRUE(hand->width_mm() > 40.0);
    daemon.reset();
    build();
    CHECK_FALSE(daemon->is_opening());  // that was done
    daemon.reset();
  }
}

// GRIP 0 is RELEASE by another name: the fingers open when no force is left.
TEST(Daemon, OpensOnGripZero) {
  grip_an_object();
  CHECK_TRUE(ask(Command::kGrip, 0) == Outcome::kDone);
  CHECK_TRUE(daemon->app().state().opening);
  run(3s);
  CHECK_FALSE(hand->object_held());
  CHECK_TRUE(hand->width_mm() > 40.0);
}

// What the gripper says: too hot is no reason to let go of anything, a lost object is one not to confirm.
TEST(Daemon, TellsWhatTheGripperSays) {
  grip_an_object();
  CHECK_TRUE(fine());
  hand->set_fault(0x8);
  run(200ms);
  CHECK_TRUE(state() == DeviceState::kDegraded && reason() == Reason::kGripperHot);
  hand->set_fault(0);
  run(200ms);
  CHECK_TRUE(fine());
  hand->remove_object();
  run(500ms);
  CHECK_TRUE(state() == DeviceState::kFault && reason() == Reason::kGripperLost);
}

// Something of 0.5 mm stops them at 228: fingertips that meet at 226 have met, between those that meet at 240 there is
// it.
TEST(Daemon, KnowsByItsFingertipsWhetherTheyClosedOnNothing) {
  for (const int closed : {226, 240}) {
    film();
    use(Gripper::kHandE);
    params.closed_counts = closed;
    build();
    hand->put_object({.width_mm = 0.5});
    run(1s);
    CHECK_TRUE(ask(Command::kGrip, 1) == Outcome::kDone);
    run(3s);
    CHECK_EQUAL(closed == 240, daemon->gripper().holding);
    daemon.reset();
    hand.reset();
  }
}

// Under-voltage of the board, with and without a gripper, and beside what else it says; each change is one event.
TEST(Daemon, IsDegradedWhileTheBoardsSupplyIsLow) {
  using State = hal::Supply::State;
  const auto events = [&] {
    std::string all;
    const Recorder::Events& events = daemon->recorder().events();
    for (std::size_t k = 0; k < events.size(); ++k) {
      if (events[k].kind == EventKind::kSupply) all += static_cast<char>('0' + events[k].a);
    }
    return all;
  };
  film();
  for (const Gripper gripper : {Gripper::kNone, Gripper::kHandE, Gripper::kStepLines}) {
    use(gripper);
    supply.now = State::kUnknown;
    build();
    run(4s);
    CHECK_TRUE(fine());
    for (const State now : {State::kGood, State::kLow, State::kGood, State::kLow, State::kUnknown}) {
      supply.now = now;
      run(1s);
      CHECK_EQUAL(now != State::kLow, fine());
      CHECK_EQUAL(now == State::kLow, state() == DeviceState::kDegraded && reason() == Reason::kBoardUndervoltage);
    }
    STRCMP_EQUAL("12120", events().c_str());
  }
  use(Gripper::kHandE);
  build();
  run(4s);
  supply.now = State::kLow;
  hand->set_fault(0x8);
  run(200ms);
  CHECK_TRUE(reason() == Reason::kGripperHot);
  hand->set_fault(0);
  run(200ms);
  CHECK_TRUE(reason() == Reason::kBoardUndervoltage);
}

// From the picture to the fingers: what slips is held harder, up to the limit, and the limit is told.
TEST(Daemon, TightensWhileItSlipsUpToTheLimit) {
  pictures = test::drag_film(70, 12);
  tree = &kSpreadTree;
  use(Gripper::kHandE);
  params.max_force = params.start_force + 8;
  build();
  hand->put_object({.width_mm = 20.0});
  run(500ms);
  CHECK_TRUE(ask(Command::kTare) == Outcome::kDone);  // nobody looks between the dots, and can tell of contact
  run(500ms);
  CHECK_TRUE(ask(Command::kGrip, 1) == Outcome::kDone);
  run(1700ms);
  LONGS_EQUAL(params.start_force, daemon->grip().force);
  CHECK_TRUE(state() == DeviceState::kOk);
  bool limited = false;
  for (int k = 0; k < 300; ++k) {
    daemon->poll();
    limited = limited || (state() == DeviceState::kSlip && reason() == Reason::kForceLimit);
  }
  LONGS_EQUAL(params.max_force, daemon->grip().force);
  LONGS_EQUAL(params.max_force, hand->output(5));
  CHECK_TRUE(limited);
}

// The same as pulses: softer is one line, and a line that refuses is a FAULT until ARM finds it obeying again.
TEST(Daemon, StepsTheGripperByPulses) {
  film();
  use(Gripper::kStepLines);
  build();
  run(1s);
  CHECK_TRUE(fine());
  CHECK_TRUE(ask(Command::kGrip, 1) == Outcome::kDone);
  run(1s);
  LONGS_EQUAL(0, gpio.edges(Line::kIncrease) + gpio.edges(Line::kDecrease));  // the starting force is step 0
  CHECK_TRUE(ask(Command::kRelease) == Outcome::kDone);
  run(100ms);
  CHECK_TRUE(gpio.edges(Line::kDecrease) > 0);
  LONGS_EQUAL(0, gpio.edges(Line::kIncrease));
  CHECK_TRUE(ask(Command::kArm) == Outcome::kDone);
  run(5s);
  CHECK_TRUE(fine());
  LONGS_EQUAL(gpio.edges(Line::kIncrease), gpio.edges(Line::kDecrease));  // open, and where it began

  gpio.stick(Line::kDecrease);
  CHECK_TRUE(ask(Command::kGrip, 1) == Outcome::kDone);
  run(100ms);
  CHECK_TRUE(ask(Command::kRelease) == Outcome::kDone);
  run(200ms);
  CHECK_TRUE(state() == DeviceState::kFault && reason() == Reason::kGpioFailed);
  CHECK_FALSE(fine());
  gpio.stick(Line::kDecrease, false);
  run(3s);
  CHECK_TRUE(reason() == Reason::kGpioFailed);  // how many pulses were counted is not known
  CHECK_TRUE(ask(Command::kArm) == Outcome::kDone);
  run(1s);
  CHECK_TRUE(fine());
}
