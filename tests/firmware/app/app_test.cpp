// SPDX-License-Identifier: Apache-2.0
// The whole firmware on simulated devices in virtual time: what a receiver sees on the two lines and on the serial
// link.
//
// The receiver's rule (DESIGN.md, Outputs): GRIP_OK counts only while the last edge of ALIVE is younger than 150 ms.
#include "app/app.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "drivers/sim/camera_faults.hpp"
#include "drivers/sim/camera_memory.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/gpio.hpp"
#include "drivers/sim/serial.hpp"
#include "tests/support/frames.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/spread_tree.hpp"
#include "tests/support/status_receiver.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::reference_model;
using namespace std::chrono_literals;
using hal::Level;
using hal::Line;
using test::kSpreadTree;
using test::NoJpeg;

namespace {

constexpr Micros kFresh{150'000};

// One picture for ever, every 40 ms, as old as the plan says when it arrives: ages[k] for the k-th frame, then 40 ms.
class AgedCamera final : public hal::Camera {
 public:
  AgedCamera(sim::Clock& clock, const LumaView& picture, std::vector<Micros> ages,
             hal::PixelFormat format = hal::PixelFormat::kLuma8)
      : clock_(clock), picture_(picture), ages_(std::move(ages)), format_(format) {}

 private:
  [[nodiscard]] bool do_start() override { return true; }
  [[nodiscard]] hal::Capture do_next(hal::Frame& frame, Micros) override {
    clock_.advance(40ms);
    frame.bytes = {picture_.data, static_cast<std::size_t>(picture_.stride * picture_.height)};
    frame.format = format_;
    frame.width = picture_.width;
    frame.height = picture_.height;
    frame.stride = picture_.stride;
    frame.timestamp = clock_.now() - (shown_ < ages_.size() ? ages_[shown_] : Micros{40ms});
    frame.sequence = static_cast<std::uint32_t>(shown_++);
    return hal::Capture::kFrame;
  }
  void do_release(const hal::Frame&) override {}
  void do_stop() override {}
  [[nodiscard]] bool do_live() const override { return false; }

  sim::Clock& clock_;
  LumaView picture_;
  std::vector<Micros> ages_;
  hal::PixelFormat format_;
  std::size_t shown_ = 0;
};

// Takes its time over every picture.
struct SlowJpeg final : test::PictureJpeg {
  SlowJpeg(sim::Clock& clock, const Picture& shows) {
    picture = shows;
    meanwhile = [this, &clock] { clock.advance(takes); };
  }
  Micros takes{};
};

// Has nothing, and comes back with that before the time is over, as a driver does that a signal woke.
class HastyCamera final : public hal::Camera {
 public:
  explicit HastyCamera(sim::Clock& clock) : clock_(clock) {}
  int asked = 0;

 private:
  [[nodiscard]] bool do_start() override { return true; }
  [[nodiscard]] hal::Capture do_next(hal::Frame&, Micros timeout) override {
    clock_.advance(std::min(timeout, Micros{30ms}));
    ++asked;
    return hal::Capture::kTimeout;
  }
  void do_release(const hal::Frame&) override {}
  void do_stop() override {}
  sim::Clock& clock_;
};

// The process is stopped (SIGSTOP, a debugger) right after this line took its level, for so long.
class StoppedAt final : public hal::Gpio {
 public:
  StoppedAt(sim::Gpio& inside, sim::Clock& clock, Line line) : inside_(inside), clock_(clock), line_(line) {}
  Micros stopped{};

 private:
  [[nodiscard]] bool do_set(Line line, Level level) override {
    const bool taken = inside_.set(line, level);
    if (line == line_) clock_.advance(stopped);
    return taken;
  }
  [[nodiscard]] std::optional<Level> do_read(hal::Input) override { return std::nullopt; }
  sim::Gpio& inside_;
  sim::Clock& clock_;
  Line line_;
};

// Lines that refuse a run of calls, and an observer who notes what may never happen.
class RefusingGpio final : public hal::Gpio {
 public:
  enum class Who { kGripOk, kAlive, kBoth, kGripOkHigh, kGripOkLow };
  struct Plan {
    std::uint64_t first_call = UINT64_MAX;  // from here on, for `calls` calls that fit `who`
    std::uint64_t calls = 0;
    Who who = Who::kBoth;
    bool takes_it = false;  // the chip says no, but the line moves all the same
  };
  Plan plan;

  [[nodiscard]] Level level(Line line) const { return level_[static_cast<std::size_t>(line)]; }
  [[nodiscard]] int alive_edges() const { return alive_edges_; }
  [[nodiscard]] std::uint64_t calls() const { return calls_; }
  // What happened since the last call of begin_step().
  void begin_step() {
    alive_edges_before_step_ = alive_edges_;
    refused_ = rose_before_alive_ = false;
    last_grip_ok_told_ = level(Line::kGripOk);
  }
  [[nodiscard]] bool refused() const { return refused_; }
  [[nodiscard]] bool rose_before_alive() const { return rose_before_alive_; }
  [[nodiscard]] Level last_grip_ok_told() const { return last_grip_ok_told_; }
  // Since start: ALIVE moved after a refusal while GRIP_OK was HIGH and had not obeyed again.
  [[nodiscard]] int edges_that_lie() const { return edges_that_lie_; }

 private:
  [[nodiscard]] bool do_set(Line line, Level to) override {
    const bool refuses = calls_++ >= plan.first_call && fits(line, to) && refusals_ < plan.calls;
    Level& level = level_[static_cast<std::size_t>(line)];
    const Level was = level;
    if (refuses) ++refusals_;
    if (!refuses || plan.takes_it) level = to;
    if (line == Line::kAlive && level != was) {
      ++alive_edges_;
      if (distrusted_ && this->level(Line::kGripOk) == Level::kHigh) ++edges_that_lie_;
    }
    if (line == Line::kGripOk) {
      last_grip_ok_told_ = to;
      if (was == Level::kLow && level == Level::kHigh && alive_edges_ == alive_edges_before_step_) {
        rose_before_alive_ = true;
      }
      if (!refuses) distrusted_ = false;
    }
    if (refuses) refused_ = distrusted_ = true;
    return !refuses;
  }
  [[nodiscard]] std::optional<Level> do_read(hal::Input) override { return std::nullopt; }
  [[nodiscard]] bool fits(Line line, Level to) const {
    switch (plan.who) {
      case Who::kGripOk:
        return line == Line::kGripOk;
      case Who::kAlive:
        return line == Line::kAlive;
      case Who::kGripOkHigh:
        return line == Line::kGripOk && to == Level::kHigh;
      case Who::kGripOkLow:
        return line == Line::kGripOk && to == Level::kLow;
      case Who::kBoth:
        break;
    }
    return true;
  }

  std::array<Level, hal::kLineCount> level_{};
  int alive_edges_ = 0, alive_edges_before_step_ = 0, edges_that_lie_ = 0;
  std::uint64_t calls_ = 0, refusals_ = 0;
  bool refused_ = false, rose_before_alive_ = false, distrusted_ = false;
  Level last_grip_ok_told_ = Level::kLow;
};

// A sensor whose frames may come without a stamp, stamped by the driver when they came; and which may not take its
// settings.
class DoubtfulCamera final : public hal::Camera {
 public:
  DoubtfulCamera(hal::Camera& inside, const sim::Clock& clock) : inside_(inside), clock_(clock) {}
  bool stamps = true, takes_settings = true, is_live = true;

 private:
  [[nodiscard]] bool do_start() override { return inside_.start(); }
  [[nodiscard]] hal::Capture do_next(hal::Frame& frame, Micros timeout) override {
    const hal::Capture capture = inside_.next(frame, timeout);
    frame.stamped = stamps;
    if (!stamps) frame.timestamp = clock_.now();
    return capture;
  }
  void do_release(const hal::Frame& frame) override { inside_.release(frame); }
  void do_stop() override { inside_.stop(); }
  [[nodiscard]] bool do_steady() const override { return takes_settings; }
  [[nodiscard]] bool do_live() const override { return is_live; }
  hal::Camera& inside_;
  const sim::Clock& clock_;
};

void state_is(DeviceState want, DeviceState got) {
  LONGS_EQUAL(static_cast<int>(want), static_cast<int>(got));
}
void reason_is(Reason want, Reason got) {
  LONGS_EQUAL(static_cast<int>(want), static_cast<int>(got));
}

}  // namespace

TEST_GROUP(App) {
  sim::Clock clock;
  sim::Gpio gpio{clock};
  sim::Serial link;
  NoJpeg jpeg;
  std::vector<Picture> pictures;
  std::unique_ptr<sim::CameraMemory> memory;
  std::unique_ptr<sim::FaultyCamera> camera;
  std::unique_ptr<App> app;
  test::StatusReceiver receiver;
  std::uint16_t sequence = 0;
  std::uint64_t events_read = 0;
  // A receiver's view.
  Micros last_edge{-10s};

  void teardown() override {
    app.reset();
    camera.reset();
    memory.reset();
    pictures.clear();
    pictures.shrink_to_fit();
  }

  void film(int empty, int dragged = 0) {
    pictures = test::drag_film(empty, dragged);
  }

  const model::Tree* tree = nullptr;  // in place of the compiled one

  void build(std::vector<sim::FaultSpan> faults = {}, std::uint64_t cycles = 1) {
    memory = std::make_unique<sim::CameraMemory>(clock, test::luma_views(pictures),
                                                 sim::CameraMemory::Config{.cycles = cycles, .live = true});
    camera = std::make_unique<sim::FaultyCamera>(*memory, clock, std::move(faults), std::size_t{320 * 240});
    app = std::make_unique<App>(Devices{*camera, gpio, link, clock, jpeg}, tree);
  }

  // The one status frame of the last step().
  status_frame::StatusFrame report() {
    const std::vector<std::uint8_t> bytes = link.output_bytes();
    link.clear_output();
    int frames = 0;
    status_frame::StatusFrame last;
    for (const std::uint8_t byte : bytes) {
      if (const auto decoded = receiver.push(byte)) {
        CHECK_TRUE(decoded->ok());
        last = decoded->frame;
        ++frames;
      }
    }
    LONGS_EQUAL(1, frames);
    LONGS_EQUAL(sequence++, last.sequence);
    return last;
  }

  std::vector<sim::GpioEvent> new_events() {
    const auto& ring = gpio.events();
    std::vector<sim::GpioEvent> out;
    for (std::size_t i = ring.size() - static_cast<std::size_t>(ring.total() - events_read); i < ring.size(); ++i)
      out.push_back(ring[i]);
    events_read = ring.total();
    return out;
  }

  // One step with everything that must hold after any step whatever the devices do.
  bool step(status_frame::StatusFrame* told = nullptr) {
    const std::uint64_t edges = gpio.edges(Line::kAlive);
    const bool more = app->step();
    const status_frame::StatusFrame frame = report();
    if (told != nullptr) *told = frame;

    const supervisor::Outputs& outputs = app->outputs();
    state_is(outputs.state, frame.state);
    reason_is(outputs.reason, frame.reason);
    CHECK_EQUAL(outputs.grip_ok, frame.grip_ok);
    CHECK_EQUAL(outputs.slip, frame.slip);
    CHECK_EQUAL(frame.state == DeviceState::kOk, frame.grip_ok);
    if (app->result().quality.ok()) LONGS_EQUAL(0, memory->borrowed());  // a late frame waits inside FaultyCamera

    // What the status frame says of ALIVE is the level of the line, not what was meant.
    CHECK_EQUAL(gpio.level(Line::kAlive) == Level::kHigh, frame.alive);

    // At most one edge of ALIVE per step, and none without an accepted frame.
    const std::uint64_t moved = gpio.edges(Line::kAlive) - edges;
    CHECK_TRUE(moved <= 1);
    if (!app->result().quality.ok()) LONGS_EQUAL(0, moved);
    if (moved == 1) last_edge = clock.now();
    return more;
  }

  bool told_fine() const {
    return gpio.level(Line::kGripOk) == Level::kHigh && clock.now() - last_edge < kFresh;
  }

  void start() {
    CHECK_TRUE(app->start(Params{}).ok());
    (void)new_events();
  }
  void run(int steps) {
    for (int k = 0; k < steps; ++k) CHECK_TRUE(step());
  }
};

TEST(App, DrivesBothLinesLowBeforeTheCameraStarts) {
  film(1);
  build();
  CHECK_TRUE(gpio.set(Line::kGripOk, Level::kHigh) &&
             gpio.set(Line::kAlive, Level::kHigh));  // left by an earlier process
  (void)new_events();
  CHECK_TRUE(app->start(Params{}).ok());
  const auto events = new_events();
  LONGS_EQUAL(2, events.size());
  CHECK_TRUE(events[0].line == Line::kGripOk && events[0].level == Level::kLow);
  CHECK_TRUE(events[1].line == Line::kAlive && events[1].level == Level::kLow);
}

TEST(App, RefusesToStartWithoutSoundParametersLinesOrCamera) {
  film(1);
  build();
  Params wrong;
  wrong.grid_rows = 2;
  reason_is(Reason::kConfig, app->start(wrong).reason);
  gpio.fail_next(1);
  reason_is(Reason::kGpioFailed, app->start(Params{}).reason);
  test::NoCamera none;
  App blind(Devices{none, gpio, link, clock, jpeg});
  reason_is(Reason::kCameraGone, blind.start(Params{}).reason);
  CHECK_TRUE(gpio.level(Line::kGripOk) == Level::kLow);
}

TEST(App, RefusesToStartWhenAliveCannotBeLowered) {
  film(1);
  build();
  CHECK_TRUE(gpio.set(Line::kAlive, Level::kHigh));
  gpio.stick(Line::kAlive);
  reason_is(Reason::kGpioFailed, app->start(Params{}).reason);
  gpio.stick(Line::kAlive, false);
  reason_is(Reason::kNone, app->start(Params{}).reason);
}

// The watching thread lowered GRIP_OK while this one was away: that is a fault, told once, and not made good silently.
TEST(App, FaultsWhenTheWatchdogHadToLowerTheLine) {
  film(30);
  build();
  start();
  run(15);
  CHECK_TRUE(gpio.level(Line::kGripOk) == Level::kHigh);
  const std::uint32_t faults = app->supervisor().faults;
  CHECK_FALSE(app->watchdog().watch(gpio, clock.now()));
  CHECK_TRUE(app->watchdog().watch(gpio, clock.now() + 200ms + 1us));
  CHECK_TRUE(gpio.level(Line::kGripOk) == Level::kLow);
  CHECK_TRUE(app->step());
  sequence += 2;  // the fault has a status frame of its own, so that nobody misses it
  link.clear_output();
  LONGS_EQUAL(faults + 1, app->supervisor().faults);
  run(3);
  LONGS_EQUAL(faults + 1, app->supervisor().faults);
  CHECK_TRUE(gpio.level(Line::kGripOk) == Level::kHigh);
}

TEST(App, LearnsThenVouches) {
  film(15);
  build();
  start();
  for (int k = 1; k <= 15; ++k) {
    const bool alive = gpio.level(Line::kAlive) == Level::kHigh;
    status_frame::StatusFrame told;
    CHECK_TRUE(step(&told));
    state_is(k < 10 ? DeviceState::kReference : DeviceState::kOk, told.state);
    CHECK_TRUE((gpio.level(Line::kGripOk) == Level::kHigh) == (k >= 10));
    CHECK_TRUE((gpio.level(Line::kAlive) == Level::kHigh) != alive);
    CHECK_EQUAL(k >= 10, told.features_valid);
    LONGS_EQUAL(k >= 10 ? 63 : 0, told.markers);
    LONGS_EQUAL(400, told.age_100us);  // latency of the camera: 40 ms
    LONGS_EQUAL((k - 1) * 40'000, told.timestamp_us);
  }
  LONGS_EQUAL(15, gpio.edges(Line::kAlive));
}

// The status frame carries the figures of this frame's result, and nothing when there is none.
TEST(App, ReportsWhatItMeasured) {
  film(12, 10);
  build({{15, 1, sim::CameraFault::kBad, {}}});
  start();
  for (int k = 0; k < 22; ++k) {
    status_frame::StatusFrame told;
    CHECK_TRUE(step(&told));
    const pipeline::Result& r = app->result();
    CHECK_EQUAL(r.quality.ok() && r.referenced, told.features_valid);
    if (!told.features_valid) {
      LONGS_EQUAL(0, told.markers);
      LONGS_EQUAL(0, told.vx_um_s);
      LONGS_EQUAL(0, told.vy_um_s);
      LONGS_EQUAL(0, told.entropy_nat_q16);
      LONGS_EQUAL(0, told.entropy_rate_nat_s_q8);
      continue;
    }
    LONGS_EQUAL(r.features.markers, told.markers);
    LONGS_EQUAL(r.features.vx.raw(), told.vx_um_s);
    LONGS_EQUAL(r.features.vy.raw(), told.vy_um_s);
    LONGS_EQUAL(r.features.entropy.raw(), told.entropy_nat_q16);
    LONGS_EQUAL(r.features.entropy_rate.raw(), told.entropy_rate_nat_s_q8);
  }
}

// ALIVE confirms GRIP_OK, so GRIP_OK takes its level first, in every frame. A rise goes out after ALIVE: until then
// GRIP_OK is told to stay LOW. What is a slip here, kSpreadTree says.
TEST(App, SetsGripOkBeforeAliveAndRaisesItAfter) {
  film(14, 12);
  tree = &kSpreadTree;
  build();
  start();
  bool rose = false, fell = false;
  for (int k = 0; k < 26; ++k) {
    const bool was = gpio.level(Line::kGripOk) == Level::kHigh;
    CHECK_TRUE(step());
    const auto events = new_events();
    const bool is = gpio.level(Line::kGripOk) == Level::kHigh;
    const bool rises = is && !was;
    LONGS_EQUAL(rises ? 3 : 2, events.size());
    CHECK_TRUE(events[0].line == Line::kGripOk);
    CHECK_TRUE(events[0].level == (was && is ? Level::kHigh : Level::kLow));
    CHECK_TRUE(events[1].line == Line::kAlive);
    if (rises) CHECK_TRUE(events[2].line == Line::kGripOk && events[2].level == Level::kHigh);
    rose = rose || rises;
    if (!was || is) continue;
    fell = true;
    state_is(DeviceState::kSlip, app->outputs().state);
  }
  CHECK_TRUE(rose && fell);
}

TEST(App, EndsWithTheStream) {
  film(12);
  build();
  start();
  run(12);
  CHECK_TRUE(told_fine());
  status_frame::StatusFrame told;
  CHECK_FALSE(step(&told));
  state_is(DeviceState::kFault, told.state);
  reason_is(Reason::kCameraGone, told.reason);
  CHECK_TRUE(gpio.level(Line::kGripOk) == Level::kLow);
  LONGS_EQUAL(12, gpio.edges(Line::kAlive));
}

TEST(App, LowersGripOkWhenItStops) {
  film(12);
  build();
  start();
  run(12);
  CHECK_TRUE(gpio.level(Line::kGripOk) == Level::kHigh);
  const std::uint64_t edges = gpio.edges(Line::kAlive);
  app->stop();
  CHECK_TRUE(gpio.level(Line::kGripOk) == Level::kLow);
  CHECK_FALSE(app->outputs().grip_ok);
  LONGS_EQUAL(edges, gpio.edges(Line::kAlive));  // an edge would confirm a frame that never was
  app->stop();
  CHECK_TRUE(gpio.level(Line::kGripOk) == Level::kLow);
}

// GRIP_OK rises with a frame alone: the OK that is held over rejected ones speaks of an edge of ALIVE long ago.
TEST(App, RaisesNothingAfterItStoppedWithoutAnAcceptedFrame) {
  film(12);
  build();
  start();
  run(12);
  app->stop();
  const std::uint64_t edges = gpio.edges(Line::kAlive);
  (void)new_events();
  for (int k = 0; k < 3; ++k) {
    CHECK_TRUE(app->poll(100ms - 1us) == App::Polled::kWaiting);
    CHECK_TRUE(app->poll(1us) == App::Polled::kSignalled);
    state_is(DeviceState::kFault, app->outputs().state);
  }
  for (const sim::GpioEvent& event : new_events()) CHECK_TRUE(event.told == Level::kLow);
  LONGS_EQUAL(edges, gpio.edges(Line::kAlive));
}

// Silence: after 150 ms without a frame the state is FAULT; a receiver knows it from ALIVE by then. With the frames
// back it goes on without learning anew.
TEST(App, FaultsOnSilenceAndComesBack) {
  film(12);
  build({{20, 10, sim::CameraFault::kOff, {}}}, 4);
  start();
  run(20);
  const Micros last_good = clock.now();
  CHECK_TRUE(told_fine());
  bool faulted = false;
  while (clock.now() < last_good + 400ms) {
    status_frame::StatusFrame told;
    CHECK_TRUE(step(&told));
    reason_is(Reason::kNoFrame, told.reason);
    if (clock.now() - last_good > 150ms) {
      state_is(DeviceState::kFault, told.state);
      CHECK_FALSE(told_fine());
      faulted = true;
    }
  }
  CHECK_TRUE(faulted);
  run(3);  // nothing to be compared with in any of them
  reason_is(Reason::kRecovering, app->outputs().reason);
  CHECK_FALSE(told_fine());
  run(1);
  state_is(DeviceState::kOk, app->outputs().state);
  CHECK_TRUE(told_fine());
}

// A driver that comes back early with nothing is asked again: silence is told every 100 ms and not more often.
TEST(App, WaitsOnWhenTheCameraComesBackEarlyWithNothing) {
  HastyCamera hasty(clock);
  App other(Devices{hasty, gpio, link, clock, jpeg});
  CHECK_TRUE(other.start(Params{}).ok());
  for (int k = 1; k <= 3; ++k) {
    CHECK_TRUE(other.step());
    LONGS_EQUAL(k * 100'000, clock.now().count());
    LONGS_EQUAL(4 * k, hasty.asked);
    reason_is(Reason::kNoFrame, report().reason);
  }
  clock.advance(250ms);  // overdue: asked once more, and not waited for
  CHECK_TRUE(other.step());
  LONGS_EQUAL(550'000, clock.now().count());
}

// Frames that came and were refused say more than the silence after them; one that was accepted ends that.
TEST(App, NamesTheRefusedFramesInTheSilenceAfterThem) {
  film(12);
  build(
      {{15, 2, sim::CameraFault::kBad, {}}, {17, 20, sim::CameraFault::kOff, {}}, {45, 20, sim::CameraFault::kOff, {}}},
      8);
  start();
  run(17);
  bool silent = false;
  for (status_frame::StatusFrame told; !app->result().quality.ok();) {
    reason_is(Reason::kJpegDamaged, app->outputs().reason);
    silent = silent || app->outputs().state == DeviceState::kFault;
    CHECK_TRUE(step(&told));
  }
  CHECK_TRUE(silent);
  for (int k = 0; k < 7; ++k) CHECK_TRUE(step());
  CHECK_TRUE(app->result().quality.ok());
  for (int k = 0; k < 3; ++k) {
    CHECK_TRUE(step());
    reason_is(Reason::kNoFrame, app->outputs().reason);
  }
}

TEST(App, RejectsFramesThatRunBackwardsAndGoesOn) {
  film(12);
  // The frame before is 80 ms old by then: 70 ms further back is just young enough to be judged by its order alone.
  build({{15, 1, sim::CameraFault::kBackwards, 70ms},
         {17, 1, sim::CameraFault::kBackwards, 0ms},
         {19, 1, sim::CameraFault::kBackwards, 100ms}},
        3);
  start();
  for (int k = 0; k < 30; ++k) {
    const std::uint64_t edges = gpio.edges(Line::kAlive);
    CHECK_TRUE(step());
    const bool backwards = k == 15 || k == 17 || k == 19;
    if (backwards) reason_is(k == 19 ? Reason::kFrameStale : Reason::kTimeNotForward, app->outputs().reason);
    LONGS_EQUAL(backwards ? 0 : 1, gpio.edges(Line::kAlive) - edges);
    if (k >= 10) state_is(DeviceState::kOk, app->outputs().state);
  }
}

// 150 ms old is the oldest frame that counts, 5 ms ahead of the clock the youngest; neither limit moves a line.
TEST(App, AcceptsFramesFrom150MillisecondsOldTo5MillisecondsAhead) {
  struct Case {
    Micros age;
    Reason reason;
  };
  film(1);
  for (const Case& c : {Case{150ms, Reason::kNone},
                        {150'001us, Reason::kFrameStale},
                        {151ms, Reason::kFrameStale},
                        {1h, Reason::kFrameStale},
                        {0ms, Reason::kNone},
                        {-5ms, Reason::kNone},
                        {-5'001us, Reason::kTimeNotForward},
                        {-6ms, Reason::kTimeNotForward},
                        {-1h, Reason::kTimeNotForward}}) {
    // All frames of one age: each is newer than the one before, so nothing but its age can be held against it.
    AgedCamera aged(clock, pictures[0].view(), std::vector<Micros>(14, c.age));
    sim::Gpio lines{clock};
    sim::Serial wire;
    App other(Devices{aged, lines, wire, clock, jpeg});
    CHECK_TRUE(other.start(Params{}).ok());
    for (int k = 1; k <= 14; ++k) {
      CHECK_TRUE(other.step());
      const bool sound = c.reason == Reason::kNone;
      CHECK_EQUAL(sound, other.result().quality.ok());
      if (!sound) reason_is(c.reason, other.outputs().reason);
      state_is(!sound   ? DeviceState::kFault
               : k < 10 ? DeviceState::kReference
                        : DeviceState::kOk,
               other.outputs().state);
      LONGS_EQUAL(sound ? k : 0, lines.edges(Line::kAlive));
    }
    // What was refused has left nothing behind: the first sane frame counts. (One that was ahead of time delays it by
    // one.)
    CHECK_TRUE(other.step());
    CHECK_TRUE(other.step());
    CHECK_TRUE(other.result().quality.ok());
  }
}

// A recording begins again with the frame that is good; a device, and a recording that is judged as one, wants three,
// and a fourth where there is nothing to compare the third with.
TEST(App, ARecordingIsJudgedAsADeviceWhereThatIsAskedFor) {
  film(1);
  for (const bool as_device : {false, true}) {
    build();
    std::vector<Micros> ages(20, 40ms);
    std::fill(ages.begin() + 16, ages.end(), 300ms);
    AgedCamera aged(clock, pictures[0].view(), ages, hal::PixelFormat::kMjpeg);
    SlowJpeg decoder(clock, pictures[0]);
    App other(Devices{aged, gpio, link, clock, decoder, as_device});
    CHECK_TRUE(other.start(Params{}).ok());
    for (std::size_t k = 0; k < ages.size(); ++k) CHECK_TRUE(other.step());
    state_is(DeviceState::kFault, other.outputs().state);
    for (int k = 1; k <= 4; ++k) {
      CHECK_TRUE(other.step());
      CHECK_TRUE(other.result().quality.ok());
      state_is(as_device && k < 4 ? DeviceState::kFault : DeviceState::kOk, other.outputs().state);
    }
  }
}

// 40 ms old when it came, and 150 when it was decided is the most.
TEST(App, DoesNotVouchForAFrameThatWasDecidedTooLate) {
  film(1);
  AgedCamera aged(clock, pictures[0].view(), {}, hal::PixelFormat::kMjpeg);
  SlowJpeg slow(clock, pictures[0]);
  App other(Devices{aged, gpio, link, clock, slow});
  CHECK_TRUE(other.start(Params{}).ok());
  for (int k = 0; k < 12; ++k) CHECK_TRUE(other.step());
  CHECK_TRUE(gpio.level(Line::kGripOk) == Level::kHigh);
  slow.takes = 110ms;
  std::uint64_t edges = gpio.edges(Line::kAlive);
  CHECK_TRUE(other.step());
  CHECK_TRUE(other.result().quality.ok());
  LONGS_EQUAL(edges + 1, gpio.edges(Line::kAlive));
  slow.takes = 110'001us;
  edges = gpio.edges(Line::kAlive);
  CHECK_TRUE(other.step());
  reason_is(Reason::kFrameStale, other.result().quality.reason);
  reason_is(Reason::kFrameStale, other.outputs().reason);
  LONGS_EQUAL(edges, gpio.edges(Line::kAlive));
  CHECK_TRUE(gpio.level(Line::kGripOk) == Level::kLow);  // 150 ms without an accepted frame
}

// The contact ends once: with a frame that is decided too late the loss is told with the next one.
TEST(App, TellsALossOfContactThatWasDecidedTooLate) {
  film(1, 6);
  for (const bool anew : {false, true}) {  // of another stream it says nothing
    AgedCamera aged(clock, pictures[0].view(), {}, hal::PixelFormat::kMjpeg);
    SlowJpeg slow(clock, pictures[0]);
    App other(Devices{aged, gpio, link, clock, slow, true});
    CHECK_TRUE(other.start(Params{}).ok());
    const auto show = [&](const Picture& picture, int frames) {
      slow.picture = picture;
      for (int k = 0; k < frames; ++k) CHECK_TRUE(other.step());
    };
    show(pictures[0], 30);
    show(pictures[6], 12);
    CHECK_TRUE(other.result().contact.touching);
    show(pictures[0], 3);
    CHECK_TRUE(other.result().contact.touching);
    slow.takes = 110'001us;
    show(pictures[0], 1);
    reason_is(Reason::kFrameStale, other.result().quality.reason);
    CHECK_FALSE(other.state().contact.touching);
    slow.takes = {};
    if (anew) CHECK_TRUE(other.start(Params{}).ok());
    show(pictures[0], 4);  // that end the FAULT
    state_is(anew ? DeviceState::kOk : DeviceState::kSlip, other.outputs().state);
    reason_is(anew ? Reason::kNone : Reason::kContactLost, other.outputs().reason);
  }
}

// Stopped between the lines: before the edge of ALIVE there is none, after it GRIP_OK is taken back at once.
TEST(App, TakesBackWhatItSaidBeforeItWasStopped) {
  film(14);
  for (const Line line : {Line::kGripOk, Line::kAlive}) {
    build();
    StoppedAt lines(gpio, clock, line);
    App other(Devices{*camera, lines, link, clock, jpeg});
    CHECK_TRUE(other.start(Params{}).ok());
    for (int k = 0; k < 12; ++k) CHECK_TRUE(other.step());
    CHECK_TRUE(gpio.level(Line::kGripOk) == Level::kHigh);
    lines.stopped = 111ms;  // the frame is 40 ms old by then
    const std::uint64_t edges = gpio.edges(Line::kAlive);
    CHECK_TRUE(other.step());
    LONGS_EQUAL(line == Line::kAlive ? 1 : 0, gpio.edges(Line::kAlive) - edges);
    CHECK_TRUE(gpio.level(Line::kGripOk) == Level::kLow);
    state_is(DeviceState::kFault, other.outputs().state);
    reason_is(Reason::kFrameStale, other.outputs().reason);
  }
}

// A frame that arrived a second late, and all that queued behind it, were taken for news: "fine" on stale data.
TEST(App, DoesNotVouchForAFrameASecondOld) {
  film(12);
  build({{20, 1, sim::CameraFault::kLate, 1s}}, 5);
  start();
  int stale = 0;
  while (clock.now() < 2s && step()) {
    const pipeline::Result& result = app->result();
    const Micros age = clock.now() - result.timestamp;
    if (result.quality.ok()) CHECK_TRUE(age <= 150ms);
    stale += result.quality.reason == Reason::kFrameStale ? 1 : 0;
    if (told_fine()) CHECK_TRUE(age < 300ms);
  }
  CHECK_TRUE(stale > 15);
  state_is(DeviceState::kOk, app->outputs().state);
  CHECK_TRUE(told_fine());
}

// Stamped when it was taken, a frame looks fresh however long it lay in a buffer: nobody may be told "fine" by it.
TEST(App, FramesOfUnknownAgeVouchForNothing) {
  film(12);
  build({}, 10);
  DoubtfulCamera doubtful(*camera, clock);
  app = std::make_unique<App>(Devices{doubtful, gpio, link, clock, jpeg});
  start();
  run(15);
  CHECK_TRUE(told_fine());
  doubtful.stamps = false;
  const Micros last_good = last_edge;
  for (int k = 0; k < 25; ++k) {
    status_frame::StatusFrame told;
    CHECK_TRUE(step(&told));
    reason_is(Reason::kFrameUnstamped, told.reason);
    if (clock.now() - last_good <= 150ms) continue;
    state_is(DeviceState::kFault, told.state);
    CHECK_FALSE(told_fine());
  }
  LONGS_EQUAL(last_good.count(), last_edge.count());
  doubtful.stamps = true;
  run(4);
  state_is(DeviceState::kOk, app->outputs().state);
  CHECK_TRUE(told_fine());

  // From the start on: not even a rest position is learned.
  doubtful.stamps = false;
  start();
  run(20);
  state_is(DeviceState::kFault, app->outputs().state);
  reason_is(Reason::kFrameUnstamped, app->outputs().reason);
  CHECK_FALSE(app->first_confirmed().has_value());

  // A recording has no age, with stamps or without.
  doubtful.is_live = false;
  start();
  run(20);
  CHECK_TRUE(app->first_confirmed().has_value());
}

// With another exposure or gain it goes on measuring, and slip is told; but nothing was measured so, and nothing is
// confirmed.
TEST(App, ACameraThatDoesNotTakeItsSettingsIsDegraded) {
  film(15, 14);
  build({}, 10);
  DoubtfulCamera doubtful(*camera, clock);
  app = std::make_unique<App>(Devices{doubtful, gpio, link, clock, jpeg});
  doubtful.takes_settings = false;
  start();
  run(14);
  state_is(DeviceState::kDegraded, app->outputs().state);
  reason_is(Reason::kCameraControls, app->outputs().reason);
  CHECK_FALSE(told_fine());
  LONGS_EQUAL(14, gpio.edges(Line::kAlive));
  doubtful.takes_settings = true;
  run(1);
  state_is(DeviceState::kOk, app->outputs().state);
  CHECK_TRUE(told_fine());
}

TEST(App, RejectsGarbageAndDamagedTransfers) {
  film(12);
  build({{14, 2, sim::CameraFault::kGarbage, {}}, {20, 8, sim::CameraFault::kBad, {}}}, 4);
  start();
  Micros last_accepted{};
  for (int k = 0; k < 40; ++k) {
    CHECK_TRUE(step());
    const bool bad = k == 14 || k == 15 || (k >= 20 && k < 28);
    CHECK_EQUAL(!bad, app->result().quality.ok());
    if (!bad) last_accepted = clock.now();
    if (bad && k >= 20) reason_is(Reason::kJpegDamaged, app->outputs().reason);
    if (bad && clock.now() - last_accepted > 150ms) state_is(DeviceState::kFault, app->outputs().state);
    if (!bad && k >= 10) state_is(k >= 28 && k <= 30 ? DeviceState::kFault : DeviceState::kOk, app->outputs().state);
  }
}

TEST(App, LivesWithDroppedFrames) {
  film(12);
  build({{13, 1, sim::CameraFault::kDropped, {}}, {16, 2, sim::CameraFault::kDropped, {}}}, 3);
  start();
  for (int k = 0; k < 25; ++k) {
    CHECK_TRUE(step());
    if (app->result().quality.ok()) CHECK_TRUE(k < 9 || app->outputs().grip_ok);
  }
}

// A line that refuses: FAULT(gpio_failed), and ALIVE does not confirm it. Refused LOW is the dangerous one.
TEST(App, StopsAliveWhenGripOkCannotBeLowered) {
  film(14, 14);
  tree = &kSpreadTree;
  build();
  start();
  run(14);
  CHECK_TRUE(told_fine());
  gpio.stick(Line::kGripOk);
  int slips = 0;
  for (int k = 0; k < 14; ++k) {
    const std::uint64_t edges = gpio.edges(Line::kAlive);
    CHECK_TRUE(step());
    if (app->result().request != GripRequest::kTighten) continue;
    ++slips;
    LONGS_EQUAL(edges, gpio.edges(Line::kAlive));
    state_is(DeviceState::kFault, app->outputs().state);
    reason_is(Reason::kGpioFailed, app->outputs().reason);
    CHECK_FALSE(app->outputs().grip_ok);
  }
  CHECK_TRUE(slips > 5);
  CHECK_FALSE(told_fine());
}

// GRIP_OK was refused while HIGH: FAULT was reported, but ALIVE went on and a receiver was told "fine" for ever.
TEST(App, StopsVouchingWhenGripOkIsRefusedWhileHigh) {
  film(12);
  build({}, 6);
  RefusingGpio lines;
  App other(Devices{*camera, lines, link, clock, jpeg});
  CHECK_TRUE(other.start(Params{}).ok());
  for (int k = 0; k < 14; ++k) CHECK_TRUE(other.step());
  CHECK_TRUE(lines.level(Line::kGripOk) == Level::kHigh);
  lines.plan = {0, 1000, RefusingGpio::Who::kGripOk, false};
  const int edges = lines.alive_edges();
  for (int k = 0; k < 10; ++k) {
    CHECK_TRUE(other.step());
    state_is(DeviceState::kFault, other.outputs().state);
    reason_is(Reason::kGpioFailed, other.outputs().reason);
    CHECK_TRUE(lines.level(Line::kGripOk) == Level::kHigh);  // nothing can be done about that
    LONGS_EQUAL(edges, lines.alive_edges());
  }
  lines.plan = {};
  for (int k = 0; k < 10; ++k) CHECK_TRUE(other.step());
  lines.plan = {0, 1000, RefusingGpio::Who::kGripOk, false};  // what obeyed in between counts for nothing
  CHECK_TRUE(other.step());
  lines.plan = {};
  for (int k = 1; k <= 28; ++k) {  // 25 that obey, and 3 that end a FAULT
    CHECK_TRUE(other.step());
    state_is(k < 28 ? DeviceState::kFault : DeviceState::kOk, other.outputs().state);
    LONGS_EQUAL(edges + std::max(0, k - 25), lines.alive_edges());
  }
}

// ALIVE was refused: FAULT was reported, and GRIP_OK stayed HIGH.
TEST(App, LowersGripOkWhenAliveIsRefused) {
  film(12);
  build({}, 4);
  RefusingGpio lines;
  App other(Devices{*camera, lines, link, clock, jpeg});
  CHECK_TRUE(other.start(Params{}).ok());
  for (int k = 0; k < 14; ++k) CHECK_TRUE(other.step());
  CHECK_TRUE(lines.level(Line::kGripOk) == Level::kHigh);
  const Micros confirmed = clock.now();
  lines.plan = {0, 1000, RefusingGpio::Who::kAlive, false};
  for (int k = 0; k < 3; ++k) {
    CHECK_TRUE(other.step());
    state_is(DeviceState::kFault, other.outputs().state);
    reason_is(Reason::kGpioFailed, other.outputs().reason);
    CHECK_TRUE(lines.level(Line::kGripOk) == Level::kLow);
  }
  // The watchdog heard of none of them.
  CHECK_TRUE(other.watchdog().watch(lines, confirmed + 200ms + 1us));
}

// After one refusal ALIVE was told the level that it had: no edge for the first frame that counts again.
TEST(App, TogglesAliveOnTheFirstFrameThatIsTrustedAgain) {
  film(12);
  build({}, 20);
  start();
  for (int calls = 1; calls <= 4; ++calls) {
    run(5);
    gpio.fail_next(calls);
    const std::uint64_t edges = gpio.edges(Line::kAlive);
    // The refused frame makes two calls of set(), each further one a call until GRIP_OK obeys.
    run(1 + std::max(0, calls - 2) + 25);
    LONGS_EQUAL(0, gpio.edges(Line::kAlive) - edges);
    state_is(DeviceState::kFault, app->outputs().state);
    run(1);
    LONGS_EQUAL(1, gpio.edges(Line::kAlive) - edges);
  }
}

// A refusal of either line at any call, once or for long, whether or not the line moves all the same, beside
// bad frames and a slip: ALIVE never moves beside a GRIP_OK that has not obeyed since, and GRIP_OK is told LOW last.
TEST(App, NeverVouchesAfterARefusalUntilGripOkObeysAgain) {
  using Who = RefusingGpio::Who;
  film(5, 8);
  Params params;
  params.reference_frames = 2;
  int refused_steps = 0;
  const auto play = [&](const RefusingGpio::Plan& plan) {
    build({{3, 1, sim::CameraFault::kBad, {}}, {6, 1, sim::CameraFault::kBad, {}}});
    link.clear_output();
    RefusingGpio lines;
    App other(Devices{*camera, lines, link, clock, jpeg});
    CHECK_TRUE(other.start(params).ok());
    lines.plan = plan;
    const SimpleString what =
        StringFromFormat("call %d for %d calls, line %d, moves %d", static_cast<int>(plan.first_call),
                         static_cast<int>(plan.calls), static_cast<int>(plan.who), plan.takes_it ? 1 : 0);
    for (bool more = true; more;) {
      lines.begin_step();
      more = other.step();
      LONGS_EQUAL_TEXT(0, lines.edges_that_lie(), what.asCharString());
      // (An edge that went out though it was refused cannot be known of: the next one is missing.)
      if (!plan.takes_it) CHECK_FALSE_TEXT(lines.rose_before_alive(), what.asCharString());
      if (!lines.refused()) continue;
      ++refused_steps;
      CHECK_TRUE_TEXT(lines.last_grip_ok_told() == Level::kLow, what.asCharString());
      state_is(DeviceState::kFault, other.outputs().state);
      reason_is(Reason::kGpioFailed, other.outputs().reason);
      CHECK_FALSE(other.outputs().grip_ok);
    }
    return lines.calls();
  };
  const std::uint64_t calls = play({});
  CHECK_TRUE(calls > 20);
  for (std::uint64_t first = 2; first < calls; ++first) {
    for (const std::uint64_t count : {1ULL, 2ULL, 3ULL, 1000ULL}) {
      for (const Who who : {Who::kGripOk, Who::kAlive, Who::kBoth, Who::kGripOkHigh, Who::kGripOkLow}) {
        for (const bool takes_it : {false, true}) (void)play({first, count, who, takes_it});
      }
    }
  }
  CHECK_TRUE(refused_steps > 1000);
}

// A restart within 150 ms of a good frame: the OK of the run before was still held over the first bad transfer.
TEST(App, VouchesForNothingAfterARestartUntilAFrameIsAccepted) {
  film(14);
  build({{14, 2, sim::CameraFault::kBad, {}}});
  start();
  run(13);
  CHECK_TRUE(gpio.level(Line::kGripOk) == Level::kHigh);
  for (int refused = 0; refused < 2; ++refused) {
    if (refused == 0) run(1);
    app->stop();
    CHECK_TRUE(app->start(Params{}).ok());
    CHECK_TRUE(step());
    CHECK_FALSE(app->result().quality.ok());
    state_is(DeviceState::kFault, app->outputs().state);
    reason_is(Reason::kJpegDamaged, app->outputs().reason);
    CHECK_TRUE(gpio.level(Line::kGripOk) == Level::kLow);
  }
  CHECK_TRUE(step());
  state_is(DeviceState::kOk, app->outputs().state);  // the lattice and the rest positions are still known
}

TEST(App, KnowsWhenItVouchedFirst) {
  film(14);
  build({{0, 2, sim::CameraFault::kBad, {}}, {6, 1, sim::CameraFault::kBad, {}}});
  start();
  for (int bad = 0; bad < 2; ++bad) {
    CHECK_FALSE(app->first_confirmed().has_value());
    CHECK_TRUE(step());
  }
  CHECK_FALSE(app->first_confirmed().has_value());
  (void)new_events();
  CHECK_TRUE(step());
  const Micros edge = new_events().back().time;
  CHECK_TRUE(edge > Micros{0} && app->first_confirmed() == edge);
  run(6);
  CHECK_TRUE(app->first_confirmed() == edge);
  app->stop();
  CHECK_TRUE(app->start(Params{}).ok());
  CHECK_FALSE(app->first_confirmed().has_value());
}

// What an update waits for: not while the gel is learned, not by a frame that was refused, and not once it is dragged.
TEST(App, HoldsNothingOnlyByAFrameOfAnEmptyGel) {
  film(30, 12);
  build({{22, 2, sim::CameraFault::kBad, {}}});
  start();
  int empty = 0, refused = 0, held = 0;
  for (int k = 0; k < 42; ++k) {
    const std::uint64_t edges = gpio.edges(Line::kAlive);
    CHECK_TRUE(step());
    const bool accepted = gpio.edges(Line::kAlive) > edges, ok = app->last_status().state == DeviceState::kOk;
    if (k < 30) {
      CHECK_EQUAL(accepted && ok, app->holds_nothing());
      ++(app->holds_nothing() ? empty : refused);
    } else if (k >= 36) {  // 1.8 px and more of 39 between markers
      CHECK_FALSE(app->holds_nothing());
      ++held;
    }
  }
  CHECK_TRUE(empty > 10 && refused > 10 && held == 6);
}

// A tree that asks nothing of the picture: nobody can tell.
TEST(App, DoesNotHoldNothingWhereContactIsNotJudged) {
  tree = &kSpreadTree;
  film(30);
  build();
  start();
  for (int k = 0; k < 30; ++k) {
    CHECK_TRUE(step());
    CHECK_FALSE(app->holds_nothing());
  }
  state_is(DeviceState::kOk, app->last_status().state);
}

// What an update is kept by. Frames while the empty gel is learned, the first after a fault, and those over which OK is
// held are no proof.
TEST(App, CountsOkFramesSinceTheLastFault) {
  film(50);
  build({{20, 1, sim::CameraFault::kBad, {}}, {30, 8, sim::CameraFault::kBad, {}}});
  start();
  std::uint64_t expected = 0, before_fault = 0, not_ok = 0, held = 0;
  for (int k = 0; k < 48; ++k) {
    const std::uint64_t edges = gpio.edges(Line::kAlive);
    CHECK_TRUE(step());
    const bool accepted = gpio.edges(Line::kAlive) > edges, ok = app->last_status().state == DeviceState::kOk;
    if (accepted && !ok) ++not_ok;
    if (!accepted && ok) ++held;
    if (accepted && ok) ++expected;
    if (app->last_status().state == DeviceState::kFault)
      before_fault = std::max(before_fault, std::exchange(expected, 0));
    LONGS_EQUAL(expected, app->ok_frames());
  }
  CHECK_TRUE(before_fault > 15 && expected > 0 && not_ok > 3 && held > 0);
  app->stop();
  CHECK_TRUE(app->start(Params{}).ok());
  LONGS_EQUAL(0, app->ok_frames());
}

// The link full: counted, and nothing else changes.
TEST(App, DoesNotCareWhetherAnybodyReadsTheLink) {
  film(12);
  build();
  start();
  link.set_full(true);
  for (int k = 0; k < 12; ++k) CHECK_TRUE(app->step());
  LONGS_EQUAL(12, app->link_refused());
  CHECK_TRUE(gpio.level(Line::kGripOk) == Level::kHigh);
  LONGS_EQUAL(12, gpio.edges(Line::kAlive));
}

TEST(App, TakesAPictureForTheReference) {
  film(1, 3);
  build();
  hal::Frame frame;
  frame.bytes = pictures[0].pixels;
  frame.format = hal::PixelFormat::kLuma8;
  frame.width = frame.stride = 320;
  frame.height = 240;
  CHECK_TRUE(app->learn(Params{}, frame).ok());
  start();
  CHECK_TRUE(step());
  state_is(DeviceState::kOk, app->outputs().state);
  frame.bytes = pictures[3].pixels;  // bent: somebody has chosen it all the same
  CHECK_TRUE(app->learn(Params{}, frame).ok());
  Params wrong;
  wrong.reference_frames = 0;
  reason_is(Reason::kConfig, app->learn(wrong, frame).reason);
}

// A model that reads no picture had no empty gel learned: asked for its features, it begins anew, and not otherwise.
TEST(App, LearnsTheEmptyGelWhenTheFeaturesOfThePictureAreAskedFor) {
  film(12);
  tree = &kSpreadTree;
  build({}, 4);
  start();
  run(12);
  LONGS_EQUAL(0, app->state().imprint.empty.frames);
  Params other;
  other.hold_ms = 300;
  app->reconfigure(other);
  CHECK_TRUE(app->state().reference.known);
  other.all_features = 1;
  app->reconfigure(other);
  CHECK_FALSE(app->state().reference.known);
  run(14);
  state_is(DeviceState::kOk, app->outputs().state);
  CHECK_TRUE(app->state().imprint.empty.frames > 0);
}

// The lattice that was tracked is not the one that is asked for now.
TEST(App, LooksForAnotherLatticeWhenItIsReconfigured) {
  film(12);
  build({}, 4);
  start();
  run(12);
  state_is(DeviceState::kOk, app->outputs().state);
  LONGS_EQUAL(320, app->state().luma.width);
  Params other;
  other.mode = 1 - other.mode;
  app->reconfigure(other);
  LONGS_EQUAL(0, app->state().luma.width);  // pictures of another scale have another size
  run(12);
  state_is(DeviceState::kOk, app->outputs().state);
  other.grid_rows = 5;
  other.grid_cols = 5;
  app->reconfigure(other);
  for (int k = 0; k < 12; ++k) {
    CHECK_TRUE(step());
    CHECK_FALSE(app->result().quality.ok() && app->result().grid == (GridSize{7, 9}));
  }
}

// E in bins of another width is another figure: no rate is made of both.
TEST(App, TakesNoEntropyRateAcrossAChangeOfTheHistogram) {
  film(12, 9);
  build();
  start();
  run(20);
  const std::int32_t before = app->result().features.entropy.raw();
  Params other;
  other.histogram_range_um = 500;
  app->reconfigure(other);
  run(1);
  CHECK_TRUE(std::abs(app->result().features.entropy.raw() - before) > 65536 / 10);  // 0.1 nat
  LONGS_EQUAL(0, app->result().features.entropy_rate.raw());
}

// Any schedule of faults: whenever a receiver is told "fine", the firmware itself says OK or has lost no more than the
// 150 ms that the rule allows. One long run over all kinds.
TEST(App, IsNeverFineForAReceiverUnlessItWasWithin150Milliseconds) {
  using sim::CameraFault;
  film(12, 14);
  build({{16, 3, CameraFault::kBad, {}},
         {30, 9, CameraFault::kOff, {}},
         {44, 2, CameraFault::kGarbage, {}},
         {50, 1, CameraFault::kBackwards, 1s},
         {55, 12, CameraFault::kGarbage, {}},
         {70, 5, CameraFault::kDropped, {}},
         {80, 6, CameraFault::kBad, {}},
         {90, 1, CameraFault::kLate, 90ms},
         {96, 30, CameraFault::kOff, {}}},
        6);
  start();
  Micros last_ok{-10s};
  while (step()) {
    if (app->outputs().state == DeviceState::kOk && app->result().quality.ok()) last_ok = clock.now();
    if (told_fine()) CHECK_TRUE(clock.now() - last_ok < kFresh);
  }
  CHECK_FALSE(told_fine());
}
