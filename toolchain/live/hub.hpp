// SPDX-License-Identifier: Apache-2.0
// One device, several who listen: what its console's port says goes to each of them, what they say goes to the port
// line by line, and the newest picture to whoever asks.
//
// For any threads. Nobody who is slow holds the device up: a listener that is more than kMostWaiting bytes behind loses
// what waits, which its receiver notices as it would on a wire.
//
// All hear all, also those who may only look: the port is kept from echoing, before an `unlock`, behind an `echo on`
// and whenever a prompt shows that it does (a board that has started anew); while it streams it prints none.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "hal/serial.hpp"

namespace holdfast::live {

struct Picture {
  std::uint16_t sequence = 0;  // of the status frame of the same picture
  std::uint64_t number = 0;    // counts the pictures that were shown, from 1
  std::vector<std::uint8_t> jpeg;
};

// The port: what a console in this process writes to and reads from.
class Hub final : public hal::Serial {
 public:
  static constexpr std::size_t kMostWaiting = 1 << 20;  // bytes, for each listener
  static constexpr std::size_t kMostSaid = 1 << 16;     // bytes that wait for the device
  // Whatever stands on the console's line goes, and what follows is not echoed.
  static constexpr std::string_view kQuiet = "\x05\x15\r\necho off\r\n";
  using Millis = std::chrono::milliseconds;

  class Listener {
    friend class Hub;
    std::string waiting_;
    bool controls_ = false;
  };
  // From now on it hears what the port says. `controls`: may change the device; when the last of those leaves, the
  // console is locked.
  [[nodiscard]] std::shared_ptr<Listener> listen(bool controls);
  void leave(const std::shared_ptr<Listener>& listener);
  // Waits for what came; nothing within the time: empty. False: the device has ended.
  [[nodiscard]] bool hear(Listener& listener, std::string& bytes, Millis at_most);
  // Whether the line is an `unlock`, with whatever code.
  [[nodiscard]] static bool unlocks(std::string_view line);
  // To the device, whole lines. False: too much waits for it.
  [[nodiscard]] bool say(std::string_view lines);
  [[nodiscard]] std::size_t listeners() const;

  // Somebody waits for a picture, or did within the last second.
  [[nodiscard]] bool picture_wanted() const;
  void show(std::uint16_t sequence, std::vector<std::uint8_t> jpeg);
  // One that is newer than number `after`.
  [[nodiscard]] std::optional<Picture> picture(std::uint64_t after, Millis at_most);

  // Of a device that is no part of this process: its bytes, and what it is to be told.
  void spread(std::span<const std::uint8_t> bytes);
  [[nodiscard]] std::size_t said(std::span<std::uint8_t> bytes);

  // Nobody waits any longer.
  void end();

 private:
  [[nodiscard]] bool do_write(std::span<const std::uint8_t> bytes) override {
    spread(bytes);
    return true;
  }
  [[nodiscard]] std::size_t do_read(std::span<std::uint8_t> bytes) override { return said(bytes); }

  mutable std::mutex mutex_;
  std::condition_variable heard_, shown_;
  std::vector<std::shared_ptr<Listener>> listeners_;
  std::string to_device_;
  std::size_t prompt_seen_ = 0;  // bytes of what ends a prompt that were just spread
  Picture picture_;
  std::chrono::steady_clock::time_point wanted_at_{};
  bool ended_ = false;
};

}  // namespace holdfast::live
