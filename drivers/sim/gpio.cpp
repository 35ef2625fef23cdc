// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/gpio.hpp"

namespace holdfast::sim {

bool Gpio::do_set(hal::Line line, hal::Level level) {
  LineState& state = line_of(line);
  const bool refused = failures_ > 0;
  if (refused) --failures_;
  if (!refused && !state.stuck && state.level != level) {
    state.level = level;
    ++state.edges;
  }
  events_.push({clock_.now(), line, level, state.level});
  return !refused && state.level == level;
}

}  // namespace holdfast::sim
