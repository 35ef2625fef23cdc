// SPDX-License-Identifier: Apache-2.0
#include "drivers/common/sysfs_supply.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <charconv>
#include <chrono>
#include <cstdio>
#include <optional>
#include <string_view>
#include <system_error>

namespace holdfast::drivers {
namespace {

constexpr std::chrono::seconds kEvery{1};
constexpr int kSensors = 32;  // hwmon0 to hwmon31: a board has a handful

using Room = std::array<char, 64>;

// The first line of the file, without memory; empty: there is none.
template <typename... Parts>
std::string_view line_of(Room& room, const char* format, Parts... parts) {
  std::array<char, 256> path{};
  if (std::snprintf(path.data(), path.size(), format, parts...) >= static_cast<int>(path.size())) return {};
  const int fd = ::open(path.data(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (fd < 0) return {};
  const ssize_t size = ::read(fd, room.data(), room.size());
  ::close(fd);
  const std::string_view text(room.data(), size > 0 ? static_cast<std::size_t>(size) : 0);
  return text.substr(0, text.find('\n'));
}

std::optional<unsigned> number(std::string_view text, int base) {
  unsigned value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, base);
  if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return value;
}

}  // namespace

SysfsSupply::~SysfsSupply() {
  {
    const std::lock_guard lock(mutex_);
    end_ = true;
  }
  wake_.notify_one();
  if (thread_.joinable()) thread_.join();
}

void SysfsSupply::start() {
  try {
    thread_ = std::thread([this] {
      std::unique_lock lock(mutex_);
      do look();
      while (!wake_.wait_for(lock, kEvery, [this] { return end_; }));
    });
  } catch (const std::system_error&) {
    thread_ = {};
  }
}

void SysfsSupply::look() {
  State state = by_hwmon();
  if (state == State::kUnknown) state = by_firmware();
  missed_.store(state == State::kUnknown ? missed() + 1 : 0, std::memory_order_relaxed);
  state_.store(state, std::memory_order_relaxed);
}

// Numbers are given in the order in which drivers come: the name says which one it is.
hal::Supply::State SysfsSupply::by_hwmon() {
  Room room{};
  for (int k = 0; k < kSensors; ++k) {
    const int n = (sensor_ + k) % kSensors;
    if (line_of(room, "%s/class/hwmon/hwmon%d/name", config_.sys.c_str(), n) != config_.sensor) continue;
    sensor_ = n;
    const auto alarm = number(line_of(room, "%s/class/hwmon/hwmon%d/in0_lcrit_alarm", config_.sys.c_str(), n), 10);
    return !alarm ? State::kUnknown : *alarm != 0 ? State::kLow : State::kGood;
  }
  return State::kUnknown;
}

hal::Supply::State SysfsSupply::by_firmware() const {
  Room room{};
  const auto bits =
      number(line_of(room, "%s/devices/platform/soc/soc:firmware/get_throttled", config_.sys.c_str()), 16);
  return !bits ? State::kUnknown : (*bits & 1U) != 0 ? State::kLow : State::kGood;
}

}  // namespace holdfast::drivers
