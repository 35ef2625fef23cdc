// SPDX-License-Identifier: Apache-2.0
#include <span>
#include <string_view>

#include "app/app.hpp"
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

int main() {
  static holdfast::App app(holdfast::board::devices());
  if (const holdfast::Status status = app.start(holdfast::board::params()); !status.ok()) {
    say_state(holdfast::DeviceState::kFault, status.reason);
    return 1;
  }
  holdfast::DeviceState shown = holdfast::DeviceState::kBoot;
  say_state(shown, holdfast::Reason::kNone);
  while (app.step()) {
    if (app.outputs().state == shown) continue;
    shown = app.outputs().state;
    say_state(shown, app.outputs().reason);
  }
  app.stop();
  return 0;
}
