// SPDX-License-Identifier: Apache-2.0
#include "toolchain/mqtt/telemetry.hpp"

#include <ctime>
#include <nlohmann/json.hpp>

#include "toolchain/console/backlog.hpp"

namespace holdfast::fleet {
namespace {

using Json = nlohmann::ordered_json;

using console_tool::kMostLost;

std::string utc(std::int64_t unix_ms) {
  const auto seconds = static_cast<std::time_t>(unix_ms / 1000);
  std::tm parts{};
  char text[40];
  ::gmtime_r(&seconds, &parts);
  const std::size_t size = std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%S", &parts);
  const std::string ms = std::to_string(1000 + unix_ms % 1000);
  return std::string(text, size) + "." + ms.substr(1) + "Z";
}

}  // namespace

void Telemetry::hear(std::span<const std::uint8_t> bytes, Now now, bool old) {
  for (const std::uint8_t byte : bytes) {
    holdfast_status status{};
    switch (holdfast_link_push(&receiver_, byte)) {
      case HOLDFAST_KIND_STATUS:
        if (holdfast_link_status(&receiver_, &status) != 0) {
          take(status, now, old);
        } else {
          ++other_;
        }
        break;
      case HOLDFAST_LINK_OTHER:
        // Marker frames of the console's port are of no interest here, and no error.
        if (receiver_.bytes[0] != HOLDFAST_LINK_VERSION) ++other_;
        break;
      case HOLDFAST_LINK_DAMAGED:
        ++damaged_;
        break;
      default:
        break;
    }
  }
  tick(now);
}

void Telemetry::take(const holdfast_status& status, Now now, bool old) {
  const auto step = static_cast<std::uint16_t>(status.sequence - sequence_);
  if (frames_ > 0 && (step == 0 || step > kMostLost)) ++restarts_;
  if (frames_ > 0 && step > 1 && step <= kMostLost) lost_ += step - 1U;
  sequence_ = status.sequence;
  ++frames_;
  if (old) {
    grip_ = {};
  } else {
    heard_ms_ = now.steady_ms;
    holdfast_grip_update(&grip_, &status, static_cast<std::uint32_t>(now.steady_ms));
  }
  State next = now_is_;
  next.state = status.state;
  next.reason = status.reason;
  next.slip = (status.flags & HOLDFAST_FLAG_SLIP) != 0;
  next.heard = next.heard || !old;
  next.confirmed = holdfast_grip_ok(&grip_, static_cast<std::uint32_t>(now.steady_ms)) != 0;
  if (next == now_is_) return;
  slips_ += next.slip && !now_is_.slip ? 1U : 0U;
  faults_ += next.state == HOLDFAST_STATE_FAULT && now_is_.state != HOLDFAST_STATE_FAULT ? 1U : 0U;
  now_is_ = next;
  ++changes_;
  changed_(state(now));
}

void Telemetry::tick(Now now) {
  State next = now_is_;
  next.confirmed = holdfast_grip_ok(&grip_, static_cast<std::uint32_t>(now.steady_ms)) != 0;
  next.heard = frames_ > 0 && now.steady_ms - heard_ms_ < kSilentMs;
  if (next == now_is_) return;
  silences_ += now_is_.heard && !next.heard ? 1U : 0U;
  now_is_ = next;
  ++changes_;
  changed_(state(now));
}

std::string Telemetry::state(Now now) const {
  return Json{{"time", utc(now.unix_ms)},
              {"state", holdfast_state_name(now_is_.state)},
              {"reason", holdfast_reason_name(now_is_.reason)},
              {"state_number", now_is_.state},
              {"reason_number", now_is_.reason},
              {"slip", now_is_.slip ? 1 : 0},
              {"confirmed", now_is_.confirmed ? 1 : 0},
              {"heard", now_is_.heard ? 1 : 0}}
      .dump();
}

std::string Telemetry::counters(Now now, std::uint64_t dropped, std::uint64_t connects) const {
  return Json{{"time", utc(now.unix_ms)}, {"frames", frames_},     {"lost", lost_},       {"damaged", damaged_},
              {"other", other_},          {"restarts", restarts_}, {"changes", changes_}, {"slips", slips_},
              {"faults", faults_},        {"silences", silences_}, {"dropped", dropped},  {"connects", connects}}
      .dump();
}

}  // namespace holdfast::fleet
