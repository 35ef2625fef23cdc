// SPDX-License-Identifier: Apache-2.0
#include <optional>
#include <type_traits>

#include "app/daemon.hpp"
#include "base/status.hpp"
#include "board/board.hpp"
#include "console/console.hpp"

namespace board = holdfast::board;

int main(int argc, char** argv) {
  if (const std::optional<int> status = board::make(argc, argv)) return *status;
  static holdfast::Daemon daemon(board::devices(), board::periphery(), board::model());
  static holdfast::console::Console console(board::host(), daemon, board::devices().clock, board::place());
  static_assert(std::is_trivially_destructible_v<holdfast::Daemon>, "the board's threads end after it");
  if (!board::watch(daemon.app().watchdog())) return 1;
  if (const holdfast::Status status = daemon.start(board::params()); !status.ok()) {
    console.cannot_start(status.reason);
    return 1;
  }
  board::started();
  console.start(board::params());
  while (!board::over() && !console.asked_to_restart()) {
    daemon.poll();
    console.poll();
    board::tell(daemon.app());
  }
  daemon.stop();
  console.end();
  return 0;
}
