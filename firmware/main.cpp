// SPDX-License-Identifier: Apache-2.0
#include <optional>
#include <span>
#include <string_view>
#include <type_traits>

#include "app/daemon.hpp"
#include "base/status.hpp"
#include "board/board.hpp"

namespace {

// A refused line is not repeated: the next change of state says more.
void say(std::string_view text) {
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(text.data());
  (void)holdfast::board::host().write({bytes, text.size()});
}

void say_state(holdfast::DeviceState state, holdfast::Reason reason) {
  say(holdfast::info(state).name);
  say(" ");
  say(holdfast::info(reason).name);
  say("\r\n");
}

}  // namespace

int main(int argc, char** argv) {
  if (const std::optional<int> status = holdfast::board::make(argc, argv)) return *status;
  static holdfast::Daemon daemon(holdfast::board::devices(), holdfast::board::periphery());
  static_assert(std::is_trivially_destructible_v<holdfast::Daemon>, "the board's threads end after it");
  if (!holdfast::board::watch(daemon.app().watchdog())) return 1;
  if (const holdfast::Status status = daemon.start(holdfast::board::params()); !status.ok()) {
    say_state(holdfast::DeviceState::kFault, status.reason);
    return 1;
  }
  holdfast::DeviceState shown = holdfast::DeviceState::kBoot;
  say_state(shown, holdfast::Reason::kNone);
  while (!holdfast::board::over()) {
    daemon.poll();
    const holdfast::supervisor::Outputs& outputs = daemon.app().outputs();
    if (outputs.state == shown) continue;
    shown = outputs.state;
    say_state(shown, outputs.reason);
  }
  daemon.stop();
  return 0;
}
