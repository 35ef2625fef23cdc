// SPDX-License-Identifier: Apache-2.0
// Robotiq Hand-E over Modbus RTU: brings the gripper to what is wanted of it and says what it really does.
//
// The gripper is asked before it is told anything. One that is active and holds something when the firmware starts, or
// when the line comes back, is left as it is until something is wanted: to activate it would open its fingers.
//
// update() comes every 5 to 40 ms and does one exchange at a time. Outputs are written only when they differ from what
// the gripper has acknowledged; in between its status is read, which is also the sign of life that it wants once a
// second. After a reply that is missing or damaged nothing is believed to have been acknowledged, and the next request
// is a read of another length (see modbus_rtu.hpp): a slave answers in order, so with its reply the line is in step
// again, and late replies cannot be taken for new ones.
//
// Source: Robotiq, Hand-E instruction manual, chapter 4. Counts are those of its registers.
#pragma once

#include <array>
#include <cstdint>

#include "base/status.hpp"
#include "base/units.hpp"
#include "grip/modbus_rtu.hpp"
#include "hal/serial.hpp"

namespace holdfast::hande {

inline constexpr std::uint16_t kOutputs = 0x03E8;
inline constexpr std::uint16_t kStatus = 0x07D0;
inline constexpr std::size_t kRegisters = 3;
// Of the register rPR.
inline constexpr std::uint8_t kFullyOpen = 0;
inline constexpr std::uint8_t kFullyClosed = 255;

using Outputs = std::array<std::uint16_t, kRegisters>;

struct Config {
  modbus_rtu::Config bus;
  // Between two status reads while the gripper has something to do, and otherwise. The gripper renews its status every
  // 10 ms; shorter gains nothing, longer sees a lost object later.
  Micros poll{20'000};
  Micros idle_poll{100'000};
  int retries = 3;                     // missed replies in a row that make a fault of it
  Micros back_off{50'000};             // after a missed reply; doubles with each further one,
  Micros longest_back_off{1'000'000};  // up to this
  Micros fresh_for{250'000};           // so old a status may be and still count
  // The echo may be late by its renewal and by one read; then the command is taken for lost and written again.
  Micros echo_within{100'000};
  Micros activation_within{8'000'000};  // about 1.5 s; slower with long strokes and low supply
  int activations = 3;                  // so many times, before it counts as failed
  // What the position shows when the fingers meet. Belongs to the fingertips: measure it. Whoever stops there or beyond
  // holds nothing; too low: thin objects are not recognised.
  std::uint8_t closed_counts = 226;
  // The fingers are where they were if they have not moved by more than this. A count is about 0.2 mm.
  std::uint8_t same_counts = 3;
  // A held object may yield by this while the force rises; further, and the fingers have lost it.
  std::uint8_t yield_counts = 8;
  std::uint8_t holding_10ma = 1;  // the current by which a grip is known that the gripper does not report,
  Micros short_after{60'000};     // and for so long the fingers must have stopped short of the position
};

// Range: as the comments say; spacing 5 ms or more, status reads 10 to 500 ms apart.
[[nodiscard]] constexpr Status validate(const Config& config) {
  const modbus_rtu::Config& bus = config.bus;
  const auto polls = [](Micros every) { return every >= Micros{10'000} && every <= Micros{500'000}; };
  const bool ok = bus.slave >= 1 && bus.slave <= 247 && bus.timeout > Micros{0} && bus.timeout <= Micros{500'000} &&
                  bus.spacing >= Micros{5'000} && bus.quiet >= Micros{0} && bus.settled >= bus.spacing &&
                  polls(config.poll) && polls(config.idle_poll) && config.retries >= 1 && config.back_off > Micros{0} &&
                  config.back_off <= config.longest_back_off && config.longest_back_off <= Micros{60'000'000} &&
                  config.fresh_for > config.idle_poll && config.echo_within > config.poll &&
                  config.activation_within > Micros{0} && config.activations >= 1;
  return {ok ? Reason::kNone : Reason::kConfig};
}

// go: move to the position and hold there. Without it the fingers stay where they are; nothing is written before the
// first go. A rising edge of reactivate ends a fault of the gripper, opens the fingers, and is not heard without such a
// fault.
struct Wanted {
  bool go = false;
  std::uint8_t position = kFullyOpen;
  std::uint8_t speed = 0;
  std::uint8_t force = 0;
  bool reactivate = false;
};

// kNone: not told, or told about an older command.
enum class Object : std::uint8_t { kNone, kMoving, kContactOpening, kContactClosing, kAtPosition };

struct Counters {
  std::uint32_t writes = 0;       // requests that write
  std::uint32_t suppressed = 0;   // would have said again what is acknowledged
  std::uint32_t missed = 0;       // requests without a good reply; modbus_rtu::Counters tell why
  std::uint32_t activations = 0;  // begun
};

struct Feedback {
  bool fresh = false;  // a status came and is not old; without it the rest is what was known last
  Micros age{};        // since the status was asked for: it is not older
  bool activated = false;
  bool moving = false;
  Object object = Object::kNone;
  std::uint8_t position = 0;
  std::uint8_t echo = 0;  // of the position wanted
  std::uint8_t current_10ma = 0;
  std::uint8_t fault = 0;               // gFLT
  Reason fault_reason = Reason::kNone;  // of several faults the gravest
  bool latched = false;                 // goes away by Wanted::reactivate only
  bool holding = false;
  bool lost = false;  // was held, and the fingers closed further; until they open or hold again
  Counters counters;
  modbus_rtu::Counters bus;
};

enum class Step : std::uint8_t {
  kNone,
  kClear,    // rACT = 0 is to be written
  kCleared,  // and to be seen
  kSet,      // rACT = 1 is to be written
  kWait,     // and the activation to end
};

// Which exchange is under way.
enum class Exchange : std::uint8_t { kRead, kWrite };

struct State {
  modbus_rtu::State bus;
  Exchange exchange = Exchange::kRead;  // the last one begun
  int misses = 0;                       // in a row
  bool damaged = false;                 // so was the last of them
  Micros try_at{};                      // back-off: not before

  bool known = false;       // a status has come,
  Micros status_at{};       // asked for then:
  std::uint8_t action = 0;  // gACT, gGTO, gSTA, gOBJ
  std::uint8_t fault = 0;
  std::uint8_t echo = 0;
  std::uint8_t position = 0;
  std::uint8_t current_10ma = 0;
  bool in_step = false;  // a read has been answered since the last miss

  Outputs outputs{};          // as last written
  bool acknowledged = false;  // the gripper has them,
  Micros acknowledged_at{};   // since then
  bool commanded = false;     // there was a go since the start
  Wanted kept;                // the last one

  Step step = Step::kNone;
  Micros step_since{};
  int attempts = 0;
  bool was_reactivate = false;
  bool reactivate = false;  // asked for and not yet begun
  Reason latched = Reason::kNone;

  Object object = Object::kNone;
  bool contact = false;               // the fingers hold something:
  bool reported = false;              // the gripper said so,
  bool closing = true;                // from outside, as mostly,
  std::uint8_t contact_position = 0;  // and there
  bool lost = false;
  bool stopped_short = false;  // it says to be at the position wanted, and is not,
  Micros short_since{};
  std::uint8_t short_position = 0;
  bool short_current = false;  // and pressed meanwhile
  Counters counters;
};

// Range: now never runs backwards and may jump by hours. Reads 2 * modbus_rtu::kMostBytesPerUpdate bytes at most.
[[nodiscard]] Feedback update(State& state, const Config& config, hal::Serial& port, const Wanted& wanted, Micros now);

}  // namespace holdfast::hande
