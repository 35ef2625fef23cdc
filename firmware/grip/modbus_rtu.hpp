// SPDX-License-Identifier: Apache-2.0
// Modbus RTU master: one request at a time, fixed memory, never blocks. Functions 4 (read input registers) and 16
// (write), as in "MODBUS over serial line" V1.02 and "MODBUS application protocol" V1.1b3.
//
// begin_...() lays a request out; update() sends it as soon as the line may be used and gathers the reply from whatever
// bytes have come. A reply counts only when its length, CRC, slave, function and counts are those that the request
// calls for. The length is known from the request, so no silence has to be measured, and no byte behind the reply is
// taken: what is there when the next request goes out belongs to the past and is thrown away.
//
// RTU replies carry no number. A reply that comes after its timeout looks like the reply to the next request, if that
// is of the same kind; who retries should ask for another count of registers (hande.cpp does).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "base/units.hpp"
#include "hal/serial.hpp"

namespace holdfast::modbus_rtu {

inline constexpr std::size_t kMaxRegisters = 8;  // of one request in each direction; the Hand-E has no more
inline constexpr std::size_t kMaxRequest = 9 + 2 * kMaxRegisters;
inline constexpr std::size_t kMaxReply = 5 + 2 * kMaxRegisters;
inline constexpr std::size_t kException = 5;  // bytes of an exception reply, less than any other has

// No call of update() reads more bytes than this: what 115200 baud bring in 44 ms, so that a line that babbles is
// emptied as fast as it fills by a caller that comes every 40 ms.
inline constexpr std::size_t kMostBytesPerUpdate = 512;
static_assert(kMaxReply <= kMostBytesPerUpdate);

struct Config {
  std::uint8_t slave = 9;
  Micros timeout{50'000};  // from the request to the end of its reply; longer: a cut cable is noticed later
  // From request to request; Robotiq: 200 Hz at most.
  Micros spacing{5'000};
  // From a reply to the next request: 3.5 characters, 1.75 ms above 19200 baud. Not waited for when `settled` has
  // passed since the request, for then the reply has long been over, whenever the caller came to look.
  Micros quiet{1'750};
  Micros settled{10'000};
};

enum class Progress : std::uint8_t {
  kIdle,       // nothing was begun
  kBusy,       // waits to be sent, or for the reply
  kOk,         // registers() holds what was read
  kTimeout,    // not a byte came
  kDamaged,    // what came was no reply to this request, or too little of one
  kException,  // the slave refuses: State::exception
  kRefused,    // the port did not take the request
};

struct Counters {
  std::uint32_t requests = 0;  // sent
  std::uint32_t replies = 0;   // good ones
  std::uint32_t timeouts = 0;
  std::uint32_t damaged = 0;
  std::uint32_t exceptions = 0;
  std::uint32_t refused = 0;
  std::uint32_t stray_bytes = 0;  // thrown away between reply and request
};

struct State {
  enum class Phase : std::uint8_t { kIdle, kToSend, kAwaiting };
  Phase phase = Phase::kIdle;
  std::array<std::uint8_t, kMaxRequest> request{};
  std::array<std::uint8_t, kMaxReply> reply{};
  std::size_t request_size = 0;
  std::size_t reply_size = 0;  // awaited
  std::size_t reply_count = 0;
  std::array<std::uint16_t, kMaxRegisters> registers{};
  std::size_t register_count = 0;
  std::uint8_t exception = 0;
  bool used = false;  // since when the line is in use, `sent` and `heard` tell:
  Micros sent{};      // the last request
  Micros heard{};     // the last byte of its reply, when update() saw it
  Counters counters;
};

// Range: any length. Polynomial 0x8005 reflected, start 0xFFFF; the low byte goes out first.
[[nodiscard]] std::uint16_t crc(std::span<const std::uint8_t> bytes);

[[nodiscard]] inline bool idle(const State& state) {
  return state.phase == State::Phase::kIdle;
}

// Only while idle(). Range: 1 to kMaxRegisters registers.
void begin_read(State& state, const Config& config, std::uint16_t address, std::size_t count);
void begin_write(State& state, const Config& config, std::uint16_t address, std::span<const std::uint16_t> registers);

// Range: now never runs backwards. Each result but kIdle and kBusy is told once.
[[nodiscard]] Progress update(State& state, const Config& config, hal::Serial& port, Micros now);

// What the last kOk of a read brought.
[[nodiscard]] inline std::span<const std::uint16_t> registers(const State& state) {
  return std::span(state.registers).first(state.register_count);
}

}  // namespace holdfast::modbus_rtu
