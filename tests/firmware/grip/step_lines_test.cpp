// SPDX-License-Identifier: Apache-2.0
#include "grip/step_lines.hpp"

#include <chrono>
#include <cstdint>
#include <tuple>
#include <utility>
#include <vector>

#include "drivers/sim/clock.hpp"
#include "drivers/sim/gpio.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace std::chrono_literals;
using hal::Level;
using hal::Line;

namespace {

// A robot controller: looks at both lines every 8 ms from its own start on, and counts a pulse when it has seen HIGH
// twice in a row after LOW.
class Controller {
 public:
  explicit Controller(Micros phase) : next_(phase) {}

  void look(const sim::Gpio& gpio, Micros now) {
    for (; next_ <= now; next_ += 8ms) {
      const bool up = gpio.level(Line::kIncrease) == Level::kHigh;
      const bool down = gpio.level(Line::kDecrease) == Level::kHigh;
      both_ |= up && down;
      steps_ += counted(up, up_) - counted(down, down_);
    }
  }
  [[nodiscard]] int steps() const { return steps_; }
  [[nodiscard]] bool saw_both() const { return both_; }

 private:
  static int counted(bool high, int& run) {
    run = high ? run + 1 : 0;
    return run == 2 ? 1 : 0;
  }
  Micros next_;
  int steps_ = 0, up_ = 0, down_ = 0;
  bool both_ = false;
};

}  // namespace

TEST_GROUP(StepLines) {
  sim::Clock clock;
  sim::Gpio gpio{clock};
  step_lines::State state;
  step_lines::Config config;

  Status tick(int steps, Micros by = 1ms) {
    clock.advance(by);
    return step_lines::update(state, config, gpio, steps, clock.now());
  }
};

TEST(StepLines, StartsWithBothLinesLowAndOwesNothing) {
  CHECK_TRUE(step_lines::start(state, gpio, 7).ok());
  for (int i = 0; i < 200; ++i) CHECK_TRUE(tick(7).ok());
  CHECK_EQUAL(0u, gpio.edges(Line::kIncrease));
  CHECK_EQUAL(0u, gpio.edges(Line::kDecrease));
}

TEST(StepLines, DoesNotStartWhileALineCannotBeLowered) {
  for (const auto& [stuck, other] : {std::pair{Line::kIncrease, Line::kDecrease}, {Line::kDecrease, Line::kIncrease}}) {
    CHECK_TRUE(gpio.set(stuck, Level::kHigh) && gpio.set(other, Level::kHigh));
    gpio.stick(stuck);
    CHECK_TRUE(step_lines::start(state, gpio, 0).reason == Reason::kGpioFailed);
    CHECK_TRUE(gpio.level(other) == Level::kLow);  // which a gripper could take for a step
    CHECK_TRUE(tick(1).reason == Reason::kGpioFailed);
    CHECK_TRUE(gpio.level(other) == Level::kLow);
    gpio.stick(stuck, false);
    CHECK_TRUE(step_lines::start(state, gpio, 0).ok());
  }
}

TEST(StepLines, PulsesAreAsLongAsTheConfigurationSays) {
  for (const auto& [settings, pulse, gap] :
       {std::tuple{step_lines::Config{}, 24ms, 24ms}, {{30ms, 50ms}, 30ms, 50ms}}) {
    config = settings;
    CHECK_TRUE(step_lines::start(state, gpio, 0).ok());
    std::vector<Micros> edges;
    Level before = Level::kLow;
    for (int i = 0; i < 300; ++i) {
      CHECK_TRUE(tick(3).ok());
      if (gpio.level(Line::kIncrease) == before) continue;
      before = gpio.level(Line::kIncrease);
      edges.push_back(clock.now());
    }
    CHECK_EQUAL(6u, edges.size());
    for (std::size_t k = 1; k < edges.size(); ++k) CHECK_TRUE(edges[k] - edges[k - 1] == (k % 2 == 1 ? pulse : gap));
  }
}

TEST(StepLines, AControllerOf8MsCountsEveryStepWhateverTheCallsAndThePhase) {
  for (const Micros period : {Micros{1000}, Micros{7000}, Micros{13'000}, Micros{40'000}, Micros{66'667}}) {
    for (int phase = 0; phase < 8; ++phase) {
      sim::Clock time;
      sim::Gpio lines(time);
      Controller controller(Micros{phase * 1000});
      step_lines::State walk;
      CHECK_TRUE(step_lines::start(walk, lines, 0).ok());
      // Up by 9 in jumps, back to -4, up to 2: what a grip, a release and a grip ask for.
      const int plan[] = {1, 2, 5, 9, 9, 3, -4, -4, 0, 2};
      int wanted = 0;
      Micros next_call{};
      for (int ms = 0; ms < 40'000; ++ms) {
        time.advance(1ms);
        wanted = plan[ms / 4000];
        if (time.now() >= next_call) {
          CHECK_TRUE(step_lines::update(walk, {}, lines, wanted, time.now()).ok());
          next_call += period;
        }
        CHECK_FALSE(lines.level(Line::kIncrease) == Level::kHigh && lines.level(Line::kDecrease) == Level::kHigh);
        controller.look(lines, time.now());
      }
      CHECK_EQUAL(wanted, controller.steps());
      CHECK_FALSE(controller.saw_both());
    }
  }
}

TEST(StepLines, OwedStepsAndTheirOppositesCancel) {
  CHECK_TRUE(step_lines::start(state, gpio, 0).ok());
  CHECK_TRUE(tick(5).ok());  // the first of five is out
  for (int i = 0; i < 500; ++i) CHECK_TRUE(tick(1).ok());
  CHECK_EQUAL(2u, gpio.edges(Line::kIncrease));
  CHECK_EQUAL(0u, gpio.edges(Line::kDecrease));
}

TEST(StepLines, ALineThatRefusesStopsItForGoodWithBothLinesLow) {
  // Refuses at the rise, at the fall, and while told LOW before the other rises.
  for (const int which : {0, 1, 2}) {
    sim::Gpio lines(clock);
    step_lines::State walk;
    CHECK_TRUE(step_lines::start(walk, lines, 0).ok());
    Status status;
    for (int i = 0; i < 400 && status.ok(); ++i) {
      clock.advance(1ms);
      const bool high = lines.level(Line::kIncrease) == Level::kHigh;
      if (which == 0 && i == 100) lines.fail_next(1);
      if (which == 1 && high) lines.fail_next(1);
      if (which == 2 && i == 100) lines.stick(Line::kIncrease);
      const int wanted = which == 1 ? 1 : i < 100 ? 0 : 1;
      status = step_lines::update(walk, {}, lines, wanted, clock.now());
    }
    CHECK_TRUE(status.reason == Reason::kGpioFailed);
    CHECK_TRUE(lines.level(Line::kIncrease) == Level::kLow);
    CHECK_TRUE(lines.level(Line::kDecrease) == Level::kLow);
    const std::uint64_t edges = lines.edges(Line::kIncrease) + lines.edges(Line::kDecrease);
    for (int i = 0; i < 200; ++i) {
      clock.advance(10ms);
      CHECK_TRUE(step_lines::update(walk, {}, lines, 9, clock.now()).reason == Reason::kGpioFailed);
    }
    CHECK_EQUAL(edges, lines.edges(Line::kIncrease) + lines.edges(Line::kDecrease));
    // A new start counts again.
    lines.stick(Line::kIncrease, false);
    CHECK_TRUE(step_lines::start(walk, lines, 0).ok());
    CHECK_TRUE(step_lines::update(walk, {}, lines, 1, clock.now()).ok());
    CHECK_TRUE(lines.level(Line::kIncrease) == Level::kHigh);
  }
}

TEST(StepLines, AnIncreaseLineStuckHighKeepsDecreaseLow) {
  CHECK_TRUE(step_lines::start(state, gpio, 0).ok());
  CHECK_TRUE(tick(1).ok());
  CHECK_TRUE(gpio.level(Line::kIncrease) == Level::kHigh);
  gpio.stick(Line::kIncrease);
  Status status;
  for (int i = 0; i < 200; ++i) {
    status = tick(-3);
    CHECK_TRUE(gpio.level(Line::kDecrease) == Level::kLow);
  }
  CHECK_TRUE(status.reason == Reason::kGpioFailed);
}

TEST(StepLines, NothingRisesWhileTheOtherLineCannotBeLowered) {
  // Somebody else holds the other line HIGH.
  sim::Gpio lines(clock);
  step_lines::State walk;
  CHECK_TRUE(step_lines::start(walk, lines, 0).ok());
  CHECK_TRUE(lines.set(Line::kDecrease, Level::kHigh));
  lines.stick(Line::kDecrease);
  CHECK_TRUE(step_lines::update(walk, {}, lines, 1, clock.now()).reason == Reason::kGpioFailed);
  CHECK_EQUAL(0u, lines.edges(Line::kIncrease));
}

TEST(StepLines, PulsesAControllerCouldMissAreRefused) {
  CHECK_TRUE(step_lines::validate({}).ok());
  CHECK_TRUE(step_lines::validate({20ms, 20ms}).ok());
  CHECK_TRUE(step_lines::validate({19'999us, 20ms}).reason == Reason::kConfig);
  CHECK_TRUE(step_lines::validate({20ms, 19'999us}).reason == Reason::kConfig);
}
