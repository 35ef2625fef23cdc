// SPDX-License-Identifier: Apache-2.0
#include "toolchain/console/live.hpp"

#include <fmt/format.h>
#include <langinfo.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string_view>

#include "toolchain/console/live_view.hpp"
#include "toolchain/console/screen.hpp"
#include "toolchain/console/trouble.hpp"
#include "toolchain/console/watching.hpp"

namespace holdfast::console_tool {
namespace {

using Clock = std::chrono::steady_clock;

constexpr Millis kRedrawEvery{84};  // 12 times a second

// What happened before somebody looked.
void add_earlier_events(Device& device, LiveModel& model) {
  const Answer answer = device.say("log events json");
  if (!answer.ok() || answer.lines.empty()) return;
  const auto json = nlohmann::json::parse(answer.lines.back(), nullptr, false);
  const auto rows = json.is_object() ? json.value("events", nlohmann::json::array()) : nlohmann::json::array();
  std::vector<LiveEvent> events;
  for (const auto& row : rows) {
    if (!row.is_object()) continue;
    events.push_back({-row.value("ago_s", 0.0),
                      fmt::format("{} {} {}", row.value("event", ""), row.value("what", ""), row.value("value", ""))});
  }
  std::ranges::sort(events, {}, &LiveEvent::at_s);
  for (LiveEvent& event : events) model.note(std::move(event.text), event.at_s);
}

std::string title_of(const Device& device) {
  const auto json = nlohmann::json::parse(device.version(), nullptr, false);
  if (!json.is_object()) return {};
  return fmt::format("{} on {}, model {}", json.value("firmware", "?"), json.value("board", "?"),
                     json.value("model", "?"));
}

}  // namespace

std::string run_live(Device& device) {
  if (::isatty(STDIN_FILENO) != 1 || ::isatty(STDOUT_FILENO) != 1) {
    return trouble("the live view needs a terminal", "its input or output is a file or a pipe",
                   "use --record for a file, or run it at a terminal");
  }
  const char* const no_color = std::getenv("NO_COLOR");
  LiveLook look;
  look.unicode = std::string_view(::nl_langinfo(CODESET)) == "UTF-8";
  look.color = no_color == nullptr || *no_color == '\0';

  const Clock::time_point begun = Clock::now();
  const auto now_s = [&] { return std::chrono::duration<double>(Clock::now() - begun).count(); };
  LiveModel model;
  model.title = title_of(device);
  model.port = device.port_name();
  add_earlier_events(device, model);
  Watching watching(device, [&](const std::string& line) { model.note(line, now_s()); });
  watching.on_frame = [&](const Telemetry::Frame& frame) { model.take(frame, now_s()); };
  watching.on_field = [&] {
    const Telemetry& telemetry = watching.telemetry();
    if (telemetry.rest() && telemetry.field()) model.take(*telemetry.rest(), *telemetry.field(), now_s());
  };
  if (std::string error = watching.begin(); !error.empty()) return error;

  Screen screen;
  Clock::time_point draw_at = Clock::now();
  while (true) {
    const auto left = std::chrono::ceil<Millis>(draw_at - Clock::now());
    const Signals::What what = watching.turn(std::max(left, Millis{0}), STDIN_FILENO);
    if (what == Signals::What::kInterrupt || what == Signals::What::kEnd) return {};
    if (what == Signals::What::kResize) screen.forget();
    for (auto key = screen.key(); key; key = screen.key()) {
      if (*key == 'q' || *key == 'Q') return {};
      if (*key == '\x0C') screen.forget();
    }
    if (Clock::now() < draw_at) continue;
    draw_at = Clock::now() + kRedrawEvery;
    model.now_s = now_s();
    model.away = watching.away();
    const Screen::Size size = screen.size();
    look.columns = size.columns;
    look.rows = size.rows;
    screen.show(draw(model, look));
  }
}

}  // namespace holdfast::console_tool
