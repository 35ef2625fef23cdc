// SPDX-License-Identifier: Apache-2.0
#include "grip/modbus_rtu.hpp"

#include <algorithm>
#include <cassert>

#include "base/math.hpp"

namespace holdfast::modbus_rtu {
namespace {

constexpr std::uint8_t kRead = 4;
constexpr std::uint8_t kWrite = 16;
constexpr std::uint8_t kExceptionBit = 0x80;
constexpr std::size_t kAcknowledgement = 8;  // bytes of the reply to a write

consteval std::array<std::uint16_t, 256> make_table() {
  std::array<std::uint16_t, 256> table{};
  for (std::uint32_t byte = 0; byte < table.size(); ++byte) {
    std::uint32_t crc = byte;
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ ((crc & 1U) != 0 ? 0xA001U : 0U);
    table[byte] = static_cast<std::uint16_t>(crc);
  }
  return table;
}

constexpr std::array<std::uint16_t, 256> kTable = make_table();

void put(State& state, std::uint8_t byte) {
  assert(state.request_size < state.request.size());
  state.request[state.request_size++] = byte;
}

void put16(State& state, std::size_t value) {
  put(state, static_cast<std::uint8_t>(value >> 8));
  put(state, static_cast<std::uint8_t>(value));
}

void open(State& state, const Config& config, std::uint8_t function) {
  assert(idle(state));
  state.request_size = 0;
  put(state, config.slave);
  put(state, function);
}

void close(State& state, std::size_t read_count) {
  const std::uint16_t sum = crc(std::span(state.request).first(state.request_size));
  put(state, static_cast<std::uint8_t>(sum));
  put(state, static_cast<std::uint8_t>(sum >> 8));
  state.register_count = read_count;
  state.reply_size = read_count > 0 ? 5 + 2 * read_count : kAcknowledgement;
  state.phase = State::Phase::kToSend;
}

// Throws away what came before the request. A line that still has more brings it in front of the reply, which then is
// a damaged one.
void drain(State& state, hal::Serial& port) {
  std::array<std::uint8_t, 64> stray;
  static_assert(kMostBytesPerUpdate % stray.size() == 0);
  for (std::size_t read = 0; read < kMostBytesPerUpdate; read += stray.size()) {
    const std::size_t count = port.read(stray);
    count_up(state.counters.stray_bytes, static_cast<std::uint32_t>(count));
    if (count < stray.size()) return;
  }
}

bool line_is_free(const State& state, const Config& config, Micros now) {
  if (!state.used) return true;
  const Micros since = now - state.sent;
  return since >= config.spacing && (since >= config.settled || now - state.heard >= config.quiet);
}

Progress send(State& state, const Config& config, hal::Serial& port, Micros now) {
  drain(state, port);
  if (!line_is_free(state, config, now)) return Progress::kBusy;
  if (!port.write(std::span(state.request).first(state.request_size))) {
    state.phase = State::Phase::kIdle;
    count_up(state.counters.refused);
    return Progress::kRefused;
  }
  state.phase = State::Phase::kAwaiting;
  state.used = true;
  state.sent = state.heard = now;
  state.reply_count = 0;
  count_up(state.counters.requests);
  return Progress::kBusy;
}

// Of the first `size` bytes.
bool crc_fits(const State& state, std::size_t size) {
  const std::uint16_t sum = crc(std::span(state.reply).first(size - 2));
  return state.reply[size - 2] == (sum & 0xFF) && state.reply[size - 1] == sum >> 8;
}

bool is_exception(const State& state) {
  return state.reply[0] == state.request[0] && state.reply[1] == (state.request[1] | kExceptionBit) &&
         crc_fits(state, kException);
}

bool is_reply(const State& state) {
  if (state.reply[0] != state.request[0] || state.reply[1] != state.request[1]) return false;
  // A write is acknowledged with its address and count; other replies say how many bytes they bring.
  const bool fits = state.request[1] == kWrite ? std::equal(&state.request[2], &state.request[6], &state.reply[2])
                                               : state.reply[2] == 2 * state.register_count;
  return fits && crc_fits(state, state.reply_size);
}

void take_registers(State& state) {
  for (std::size_t i = 0; i < state.register_count; ++i) {
    state.registers[i] = static_cast<std::uint16_t>(state.reply[3 + 2 * i] << 8 | state.reply[4 + 2 * i]);
  }
}

Progress receive(State& state, const Config& config, hal::Serial& port, Micros now) {
  // Each pass but the last brings a byte or more: reply_size passes at most.
  while (state.reply_count < state.reply_size) {
    const std::size_t missing = state.reply_size - state.reply_count;
    const std::size_t count = port.read(std::span(state.reply).subspan(state.reply_count, missing));
    if (count == 0) break;
    state.reply_count += std::min(count, missing);
    state.heard = now;
  }
  const auto end = [&](Progress result, std::uint32_t& counter) {
    state.phase = State::Phase::kIdle;
    count_up(counter);
    return result;
  };
  if (state.reply_count >= kException && is_exception(state)) {
    state.exception = state.reply[2];
    return end(Progress::kException, state.counters.exceptions);
  }
  if (state.reply_count == state.reply_size) {
    if (!is_reply(state)) return end(Progress::kDamaged, state.counters.damaged);
    take_registers(state);
    return end(Progress::kOk, state.counters.replies);
  }
  if (now - state.sent < config.timeout) return Progress::kBusy;
  return state.reply_count > 0 ? end(Progress::kDamaged, state.counters.damaged)
                               : end(Progress::kTimeout, state.counters.timeouts);
}

}  // namespace

std::uint16_t crc(std::span<const std::uint8_t> bytes) {
  std::uint16_t sum = 0xFFFF;
  for (const std::uint8_t byte : bytes) {
    sum = static_cast<std::uint16_t>((sum >> 8) ^ kTable[(sum ^ byte) & 0xFF]);
  }
  return sum;
}

void begin_read(State& state, const Config& config, std::uint16_t address, std::size_t count) {
  assert(count >= 1 && count <= kMaxRegisters);
  open(state, config, kRead);
  put16(state, address);
  put16(state, count);
  close(state, count);
}

void begin_write(State& state, const Config& config, std::uint16_t address, std::span<const std::uint16_t> registers) {
  assert(!registers.empty() && registers.size() <= kMaxRegisters);
  open(state, config, kWrite);
  put16(state, address);
  put16(state, registers.size());
  put(state, static_cast<std::uint8_t>(2 * registers.size()));
  for (const std::uint16_t value : registers) put16(state, value);
  close(state, 0);
}

Progress update(State& state, const Config& config, hal::Serial& port, Micros now) {
  switch (state.phase) {
    case State::Phase::kToSend:
      return send(state, config, port, now);
    case State::Phase::kAwaiting:
      return receive(state, config, port, now);
    case State::Phase::kIdle:
      break;
  }
  drain(state, port);
  return Progress::kIdle;
}

}  // namespace holdfast::modbus_rtu
