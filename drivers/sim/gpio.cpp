// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/gpio.hpp"

namespace holdfast::sim {

TapeEvent Gpio::event_of(hal::Line line, hal::Level level) const {
  return {clock_.now().count(), TapeKind::kLine, static_cast<std::uint8_t>(line),
          static_cast<std::uint8_t>(level == hal::Level::kHigh ? 1 : 0)};
}

// A line keeps its level when the process that drove it ends.
void Gpio::record(Tape& tape) {
  tape_ = &tape;
  for (std::size_t k = 0; k < lines_.size(); ++k) {
    lines_[k].level = tape.level(static_cast<hal::Line>(k)) ? hal::Level::kHigh : hal::Level::kLow;
  }
}

bool Gpio::do_set(hal::Line line, hal::Level level) {
  LineState& state = line_of(line);
  const bool refused = failures_ > 0;
  if (refused) --failures_;
  if (!refused && !state.stuck && state.level != level) {
    state.level = level;
    ++state.edges;
    if (tape_ != nullptr) tape_->write(event_of(line, level));
  }
  events_.push({clock_.now(), line, level, state.level});
  return !refused && state.level == level;
}

}  // namespace holdfast::sim
