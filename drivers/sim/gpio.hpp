// SPDX-License-Identifier: Apache-2.0
// Output lines that remember what they were told, when, and what became of it. Lines start LOW.
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "drivers/sim/ring.hpp"
#include "drivers/sim/tape.hpp"
#include "hal/clock.hpp"
#include "hal/gpio.hpp"

namespace holdfast::sim {

struct GpioEvent {
  std::chrono::microseconds time{};  // on the clock given
  hal::Line line = hal::Line::kGripOk;
  hal::Level told = hal::Level::kLow;   // what the firmware asked for
  hal::Level level = hal::Level::kLow;  // what the line shows afterwards: an observer's truth
  friend bool operator==(const GpioEvent&, const GpioEvent&) = default;
};

class Gpio final : public hal::Gpio {
 public:
  static constexpr std::size_t kDefaultEvents = 4096;

  explicit Gpio(const hal::Clock& clock, std::size_t events = kDefaultEvents) : clock_(clock), events_(events) {}

  // Every change of a level goes there as well. The tape outlives the lines; it may hold their levels from before.
  void record(Tape& tape);

  // The next `count` calls of set() are refused by the chip: false, and the line keeps its level.
  void fail_next(int count) { failures_ = count; }
  // What the robot's side puts on an input; before the first call none is wired.
  void drive(hal::Input input, hal::Level level) { inputs_[static_cast<std::size_t>(input)] = level; }
  // The line keeps its present level whatever it is told. Read back, so telling it the other level returns false.
  void stick(hal::Line line, bool stuck = true) { line_of(line).stuck = stuck; }

  [[nodiscard]] hal::Level level(hal::Line line) const { return line_of(line).level; }
  // How often the line really changed its level.
  [[nodiscard]] std::uint64_t edges(hal::Line line) const { return line_of(line).edges; }
  // Every call of set(), the newest kept.
  [[nodiscard]] const Ring<GpioEvent>& events() const { return events_; }

 private:
  struct LineState {
    hal::Level level = hal::Level::kLow;
    bool stuck = false;
    std::uint64_t edges = 0;
  };

  [[nodiscard]] bool do_set(hal::Line line, hal::Level level) override;
  [[nodiscard]] std::optional<hal::Level> do_read(hal::Input input) override {
    return inputs_[static_cast<std::size_t>(input)];
  }
  [[nodiscard]] TapeEvent event_of(hal::Line line, hal::Level level) const;
  [[nodiscard]] LineState& line_of(hal::Line line) { return lines_[static_cast<std::size_t>(line)]; }
  [[nodiscard]] const LineState& line_of(hal::Line line) const { return lines_[static_cast<std::size_t>(line)]; }

  const hal::Clock& clock_;
  Ring<GpioEvent> events_;
  std::array<LineState, hal::kLineCount> lines_{};
  std::array<std::optional<hal::Level>, hal::kInputCount> inputs_{};
  int failures_ = 0;
  Tape* tape_ = nullptr;
};

}  // namespace holdfast::sim
