// SPDX-License-Identifier: Apache-2.0
#include "toolchain/console/watching.hpp"

#include <poll.h>

#include <array>
#include <nlohmann/json.hpp>
#include <utility>

#include "drivers/common/trouble.hpp"

namespace holdfast::console_tool {
namespace {

using Clock = std::chrono::steady_clock;
using namespace std::chrono_literals;

constexpr Millis kTryEvery = 250ms;
constexpr Millis kToAttach = 1500ms;
// A device without a camera says nothing for long; one that was started anew without its port being unplugged has
// forgotten that somebody watches.
constexpr Millis kSilence = 3000ms;
constexpr Millis kSilenceAtEnd = 500ms;

Signals::What wait(int fd, Signals& signals, Millis at_most) {
  std::array<pollfd, 2> ends{{{fd, POLLIN, 0}, {signals.fd(), POLLIN, 0}}};
  (void)::poll(ends.data(), ends.size(), static_cast<int>(std::max<std::int64_t>(at_most.count(), 0)));
  return signals.take();
}

}  // namespace

std::string gone_line(const Device& device) {
  return trouble(device.port_name() + " has gone", "unplugged, or the firmware ended",
                 "plug it in again; this goes on then. Ctrl-C leaves");
}

Watching::Watching(Device& device, std::function<void(const std::string&)> note)
    : device_(device), note_(std::move(note)), before_(device.heard) {
  device_.heard.status = [this](const status_frame::StatusFrame& status) {
    heard_at_ = Clock::now();
    answers();
    const Telemetry::Received frame = telemetry_.take(status, heard_at_);
    if (on_frame) on_frame(frame);
  };
  device_.heard.line = {};
  device_.heard.markers = [this](link::Kind kind, const marker_frame::MarkerFrame& piece) {
    if (!telemetry_.take(kind, piece)) return;
    if (kind == link::Kind::kRest) {
      scale_wanted_ = true;
    } else if (on_field) {
      on_field();
    }
  };
}

Watching::~Watching() {
  device_.heard = before_;
  if (!away_ && !silent_ && device_.port().is_open()) (void)device_.say("watch off");
}

void Watching::answers() {
  if (std::exchange(silent_, false)) note_(device_.port_name() + " answers again");
}

bool Watching::lost() {
  if (!away_ && !silent_ && Clock::now() - heard_at_ > kSilenceAtEnd) silent_ = !device_.attach(kToAttach);
  return away_ || silent_;
}

std::string Watching::begin() {
  heard_at_ = Clock::now();
  if (const Answer answer = device_.say("watch on"); !answer.ok()) return answer.error;
  ask_scale();
  return {};
}

void Watching::ask_scale() {
  scale_wanted_ = false;
  const Answer answer = device_.say("reference json");
  if (!answer.ok() || answer.lines.empty()) return;
  auto json = nlohmann::json::parse(answer.lines.back(), nullptr, false);
  if (json.is_object() && json.contains("left")) json = json["left"];  // of a hand: the finger whose markers come
  // Whatever answers there may say anything.
  if (!json.is_object() || !json.contains("known") || json["known"] != true) return;
  const auto number = [&json](const char* name) {
    const auto found = json.find(name);
    return found != json.end() && found->is_number() ? found->get<double>() : 0.0;
  };
  if (const double pitch_um = number("pitch_printed_um"); pitch_um > 0) px_per_um_ = number("pitch_px") / pitch_um;
}

void Watching::come_back() {
  if (Clock::now() < try_at_) return;
  try_at_ = Clock::now() + kTryEvery;
  if (!device_.reopen()) return;
  if (!device_.attach(kToAttach) || !device_.say("watch on").ok()) return device_.port().close();
  away_ = false;
  heard_at_ = Clock::now();
  telemetry_.begin_anew();
  scale_wanted_ = true;
  note_(device_.port_name() + " is back");
}

Signals::What Watching::turn(Millis at_most) {
  const Signals::What what =
      wait(away_ ? -1 : device_.port().fd(), device_.signals(), away_ ? std::min(at_most, kTryEvery) : at_most);
  if (away_) {
    come_back();
  } else if (!device_.listen()) {
    away_ = true;
    note_(gone_line(device_));
    device_.port().close();
  } else if (scale_wanted_) {
    ask_scale();
  } else if (Clock::now() - heard_at_ > kSilence) {
    heard_at_ = Clock::now();
    // Not say(), which is patient: who records for so many seconds, or presses Ctrl-C, waits for no answer.
    if (device_.attach(kToAttach)) {
      answers();
      (void)device_.say("watch on");
    } else if (device_.port().is_open() && !std::exchange(silent_, true)) {
      note_(trouble(device_.port_name() + " does not answer", "the firmware hangs, or the board is overloaded",
                    "wait, or start the board anew; this goes on then. Ctrl-C leaves"));
    }
  }
  return device_.was_interrupted() ? Signals::What::kInterrupt : what;
}

}  // namespace holdfast::console_tool
