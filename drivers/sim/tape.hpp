// SPDX-License-Identifier: Apache-2.0
// Memory shared with an observer in another process: what the output lines did, and what the world around them really
// was. The one who judges whether a robot was told "fine" must not be the one who is judged, and must outlive it.
//
// One writer, one reader, no lock: a writer that is killed at any instruction leaves whole events behind it.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "hal/gpio.hpp"

namespace holdfast::sim {

enum class TapeKind : std::uint8_t {
  kLine,    // which: hal::Line, value: its level from now on
  kUnsafe,  // which: of several reasons; value 1: from now on "fine" would be untrue (fault, stale data); 0: no longer
  kState,   // which: DeviceState, value: Reason, as the firmware says them
  kEnd,     // the writer has finished in order
};

struct TapeEvent {
  std::int64_t time_us = 0;  // of the writer's world
  TapeKind kind = TapeKind::kLine;
  std::uint8_t which = 0;
  std::uint8_t value = 0;
};

class Tape {
 public:
  static constexpr std::uint64_t kEvents = 1U << 16;
  enum class Full : std::uint8_t {
    kWait,  // the writer waits for the reader: nothing is lost. In virtual time
    kDrop,  // the oldest are lost, and the reader is told
  };

  // Memory that a child process inherits.
  [[nodiscard]] static std::optional<Tape> anonymous(Full full);
  // A file that another process opens: made, or opened as it is. One of another size, a link or a device is refused.
  [[nodiscard]] static std::optional<Tape> file(const std::filesystem::path& path, Full full, bool create,
                                                std::string& error);
  Tape(Tape&& other) noexcept;
  Tape& operator=(Tape&&) = delete;
  Tape(const Tape&) = delete;
  Tape& operator=(const Tape&) = delete;
  ~Tape();

  void write(const TapeEvent& event);
  // The next event not yet read.
  [[nodiscard]] std::optional<TapeEvent> read();
  // Events that were overwritten before they were read.
  [[nodiscard]] std::uint64_t lost() const { return lost_; }

  // Levels now, for whoever samples instead of reading events.
  [[nodiscard]] bool level(hal::Line line) const {
    return memory_->levels[static_cast<std::size_t>(line)].load(std::memory_order_acquire) != 0;
  }

 private:
  struct Memory {
    std::atomic<std::uint64_t> written;
    std::atomic<std::uint64_t> read;
    std::array<std::atomic<std::uint8_t>, hal::kLineCount> levels;
    std::array<TapeEvent, kEvents> events;
  };
  static_assert(std::atomic<std::uint64_t>::is_always_lock_free && std::atomic<std::uint8_t>::is_always_lock_free);

  Tape(Memory* memory, Full full) : memory_(memory), full_(full) {}

  Memory* memory_ = nullptr;
  Full full_;
  std::uint64_t lost_ = 0;
};

}  // namespace holdfast::sim
