// SPDX-License-Identifier: Apache-2.0
#include "grip/hande.hpp"

#include <algorithm>
#include <optional>

#include "base/math.hpp"

namespace holdfast::hande {
namespace {

// ACTION REQUEST, the high byte of the first output register.
constexpr std::uint16_t kActivate = 0x0100;  // rACT
constexpr std::uint16_t kGo = 0x0800;        // rGTO

// GRIPPER STATUS
constexpr std::uint8_t kActive = 0x01;  // gACT
constexpr std::uint8_t kGoing = 0x08;   // gGTO
constexpr int kActivationDone = 3;      // gSTA

constexpr std::uint8_t kHot = 0x8;
constexpr std::uint8_t kNoCommunication = 0x9;
constexpr std::uint8_t kFirstMajor = 0xA;
constexpr std::uint8_t kReleasing = 0xB;

int activation(const State& state) {
  return (state.action >> 4) & 3;
}

// Minor faults 5 and 7 say that it must be activated, or has not yet been; gACT and gSTA tell the same.
bool activated(const State& state) {
  return (state.action & kActive) != 0 && activation(state) == kActivationDone && state.fault < kFirstMajor;
}

Reason major(std::uint8_t fault) {
  switch (fault) {
    case 0xA:
      return Reason::kGripperUndervoltage;
    case kReleasing:
      return Reason::kGripperReleasing;
    case 0xD:
      return Reason::kGripperActivation;
    case 0xE:
      return Reason::kGripperOvercurrent;
    case 0xF:
      return Reason::kGripperReleased;
    default:
      return Reason::kGripperInternal;
  }
}

std::uint8_t position_in(const Outputs& outputs) {
  return static_cast<std::uint8_t>(outputs[1]);
}

// ---- What the gripper says

void forget_contact(State& state) {
  state.contact = state.lost = state.stopped_short = false;
  state.closing = true;
}

// The status shows the command that was written last. Position and rGTO are echoed, speed and force are not.
bool heard(const State& state) {
  return state.echo == position_in(state.outputs) && ((state.action & kGoing) != 0) == ((state.outputs[0] & kGo) != 0);
}

// gOBJ may be believed: it means something, and it means the present command.
bool object_counts(const State& state) {
  return state.step == Step::kNone && activated(state) && (state.action & kGoing) != 0 &&
         (!state.commanded || heard(state));
}

void found(State& state, bool closing) {
  state.contact = state.reported = true;
  state.closing = closing;
  state.contact_position = state.position;
  state.lost = false;
}

void lose(State& state) {
  state.contact = false;
  state.lost = true;
}

// gOBJ 3 although the fingers have stopped short of where they should be: the gripper has lost what it held, or holds
// something so thin that it never saw it. A status may be older than its echo for a moment, so it has to last.
void stopped_short(State& state, const Config& config, Micros now) {
  const int request = std::min<int>(state.echo, config.closed_counts);
  const int missing = state.closing ? request - state.position : state.position - request;
  const int moved = state.position - state.short_position;
  if (missing <= config.same_counts) {
    state.stopped_short = false;
    return;
  }
  if (!state.stopped_short || moved > config.same_counts || -moved > config.same_counts) {
    state.stopped_short = true;
    state.short_since = now;
    state.short_position = state.position;
    state.short_current = false;
  }
  state.short_current = state.short_current || state.current_10ma >= config.holding_10ma;
  if (now - state.short_since < config.short_after) return;
  if (state.contact && state.reported) {
    lose(state);
  } else if (!state.contact && !state.lost && state.closing && state.short_current) {
    state.contact = true;
    state.reported = false;
    state.contact_position = state.position;
  }
}

// Range: counts are 0..255; their differences fit int.
void judge_object(State& state, const Config& config, Micros now) {
  const bool counts = object_counts(state);
  state.object = counts ? static_cast<Object>(1 + (state.action >> 6)) : Object::kNone;
  if (state.object == Object::kContactClosing && state.position >= config.closed_counts) {
    state.object = Object::kAtPosition;  // the fingers have met each other
  }
  const bool contact = state.object == Object::kContactOpening || state.object == Object::kContactClosing;
  if (contact) found(state, state.object == Object::kContactClosing);
  if (state.object != Object::kAtPosition) state.stopped_short = false;
  if (state.contact) {
    const int passed = (state.position - state.contact_position) * (state.closing ? 1 : -1);
    const int yield = state.object == Object::kAtPosition ? config.same_counts : config.yield_counts;
    if (passed > yield) {
      lose(state);
    } else if (passed < -config.yield_counts) {
      state.contact = false;  // opened by someone
    }
  }
  if (state.object == Object::kAtPosition) stopped_short(state, config, now);
}

// ---- Activation

void enter(State& state, Step step, Micros now) {
  state.step = step;
  state.step_since = now;
}

void activate(State& state, const Config& config, Micros now) {
  state.acknowledged = false;
  if (state.attempts >= config.activations) {
    state.latched = Reason::kGripperActivation;
    state.step = Step::kNone;
    return;
  }
  ++state.attempts;
  count_up(state.counters.activations);
  forget_contact(state);
  enter(state, Step::kClear, now);
}

void activation_ended(State& state, Reason latched) {
  state.step = Step::kNone;
  state.latched = latched;
  state.acknowledged = false;
  if (latched == Reason::kNone) state.attempts = 0;
}

void no_step(State& state, const Config& config, Micros now) {
  if (state.fault >= kFirstMajor) {
    state.latched = major(state.fault);
  } else if (activated(state)) {
    if (state.latched != Reason::kNone) activation_ended(state, Reason::kNone);  // someone else did it
  } else if (state.latched != Reason::kNone) {
    return;
  } else if ((state.action & kActive) != 0 && activation(state) != 0) {
    enter(state, Step::kWait, now);  // someone activates it
  } else if (state.contact) {
    // It was switched off and on with an object in its fingers, and its brake still holds that.
    state.latched = Reason::kGripperUndervoltage;
  } else {
    activate(state, config, now);
  }
}

void judge_activation(State& state, const Config& config, Micros now) {
  const bool active = (state.action & kActive) != 0;
  const bool in_time = now - state.step_since < config.echo_within;  // the status may be older than the step
  switch (state.step) {
    case Step::kNone:
      no_step(state, config, now);
      break;
    case Step::kClear:
    case Step::kSet:
      break;
    case Step::kCleared:
      if (!active) {
        enter(state, Step::kSet, now);
      } else if (!in_time) {
        enter(state, Step::kClear, now);
      }
      break;
    case Step::kWait:
      if (activated(state)) {
        activation_ended(state, Reason::kNone);
      } else if (state.fault >= kFirstMajor && !in_time) {
        activation_ended(state, major(state.fault));
      } else if ((!active && !in_time) || now - state.step_since >= config.activation_within) {
        activate(state, config, now);
      }
      break;
  }
  // A release under way is waited for. (Nothing is latched while a step is.)
  if (!state.reactivate || state.fault == kReleasing) return;
  state.reactivate = false;
  if (state.latched == Reason::kNone) return;
  state.latched = Reason::kNone;
  state.attempts = 0;
  activate(state, config, now);
}

// ---- Exchanges

void status_came(State& state, const Config& config, Micros now) {
  const auto registers = modbus_rtu::registers(state.bus);
  state.known = true;
  state.status_at = state.bus.sent;
  state.action = static_cast<std::uint8_t>(registers[0] >> 8);
  state.fault = static_cast<std::uint8_t>((registers[1] >> 8) & 0xF);
  state.echo = static_cast<std::uint8_t>(registers[1]);
  state.position = static_cast<std::uint8_t>(registers[2] >> 8);
  state.current_10ma = static_cast<std::uint8_t>(registers[2]);
  judge_activation(state, config, now);
  // A gripper that was restarted, that follows someone else, or that found the line silent has to be told again.
  if (state.acknowledged && now - state.acknowledged_at >= config.echo_within && state.fault < kFirstMajor &&
      (!heard(state) || state.fault == kNoCommunication)) {
    state.acknowledged = false;
  }
  judge_object(state, config, now);
}

void write_was_taken(State& state, Micros now) {
  if (state.step == Step::kClear) {
    enter(state, Step::kCleared, now);
  } else if (state.step == Step::kSet) {
    enter(state, Step::kWait, now);
  } else {
    state.acknowledged = true;
    state.acknowledged_at = now;
  }
}

void reply_missed(State& state, const Config& config, bool damaged, Micros now) {
  // Range: 60 s * 2^16 fits int64; at one a second misses count for 34 years.
  const int doublings = std::min(state.misses, 16);
  state.try_at = now + std::min(config.back_off * (1 << doublings), config.longest_back_off);
  if (state.misses < 1 << 30) ++state.misses;
  state.damaged = damaged;
  state.acknowledged = false;
  state.in_step = false;
  count_up(state.counters.missed);
}

void take(State& state, const Config& config, modbus_rtu::Progress result, Micros now) {
  switch (result) {
    case modbus_rtu::Progress::kIdle:
    case modbus_rtu::Progress::kBusy:
      break;
    case modbus_rtu::Progress::kOk:
      state.misses = 0;
      if (state.exchange == Exchange::kWrite) {
        write_was_taken(state, now);
        break;
      }
      state.in_step = true;
      status_came(state, config, now);
      break;
    case modbus_rtu::Progress::kTimeout:
    case modbus_rtu::Progress::kRefused:
      reply_missed(state, config, false, now);
      break;
    case modbus_rtu::Progress::kDamaged:
    case modbus_rtu::Progress::kException:
      reply_missed(state, config, true, now);
      break;
  }
}

// Nothing: it has to stay as it is. After no_step() a gripper that is not activated is latched, or in a step.
std::optional<Outputs> outputs_for(State& state, const Wanted& wanted) {
  if (state.step == Step::kClear) return Outputs{};
  if (state.step == Step::kSet) return Outputs{kActivate};
  if (state.step != Step::kNone || (state.action & kActive) == 0) return std::nullopt;
  if (state.latched != Reason::kNone) return std::nullopt;
  if (wanted.go) {
    state.kept = wanted;
    state.commanded = true;
  }
  if (!state.commanded) return std::nullopt;
  const unsigned action = kActivate | (wanted.go ? kGo : 0U);
  return Outputs{static_cast<std::uint16_t>(action), state.kept.position,
                 static_cast<std::uint16_t>(state.kept.speed << 8 | state.kept.force)};
}

void begin_write(State& state, const Config& config, const Outputs& outputs) {
  const bool opens = (outputs[0] & kGo) != 0 &&
                     (position_in(outputs) - state.position) * (state.closing ? 1 : -1) < -config.same_counts;
  if (opens) forget_contact(state);
  state.outputs = outputs;
  state.acknowledged = false;
  count_up(state.counters.writes);
  state.exchange = Exchange::kWrite;
  modbus_rtu::begin_write(state.bus, config.bus, kOutputs, outputs);
}

// A late reply to an earlier try is refused for its length, which comes again with the sixth further try: with the
// back-off as it is no earlier than 2.8 s later. The registers behind the third are reserved and read 0.
void begin_read(State& state, const Config& config) {
  constexpr int kLengths = 6;
  static_assert(kRegisters + kLengths - 1 <= modbus_rtu::kMaxRegisters);
  const auto more = static_cast<std::size_t>(state.misses % kLengths);
  state.exchange = Exchange::kRead;
  modbus_rtu::begin_read(state.bus, config.bus, kStatus, kRegisters + more);
}

void begin(State& state, const Config& config, const Wanted& wanted, Micros now) {
  if (!state.in_step) {
    begin_read(state, config);
    return;
  }
  const std::optional<Outputs> outputs = outputs_for(state, wanted);
  const bool has_them = outputs && state.acknowledged && state.outputs == *outputs;
  if (outputs && !has_them) {
    begin_write(state, config, *outputs);
    return;
  }
  const bool busy = wanted.go || state.step != Step::kNone;
  const bool due = now - state.bus.sent >= (busy ? config.poll : config.idle_poll);
  if (!due && state.exchange != Exchange::kWrite) return;
  if (has_them) count_up(state.counters.suppressed);
  begin_read(state, config);
}

Reason reason_of(const State& state, const Config& config) {
  if (state.misses >= config.retries) return state.damaged ? Reason::kGripperReply : Reason::kGripperSilent;
  if (state.latched != Reason::kNone) return state.latched;
  if (!state.known) return Reason::kNone;
  if (state.step != Step::kNone || state.fault == 0x5 || state.fault == 0x7) return Reason::kGripperActivating;
  if (state.lost) return Reason::kGripperLost;
  if (state.fault == kNoCommunication && state.commanded) return Reason::kGripperSilent;
  return state.fault == kHot ? Reason::kGripperHot : Reason::kNone;
}

}  // namespace

Feedback update(State& state, const Config& config, hal::Serial& port, const Wanted& wanted, Micros now) {
  if (wanted.reactivate && !state.was_reactivate && state.latched != Reason::kNone) state.reactivate = true;
  state.was_reactivate = wanted.reactivate;

  take(state, config, modbus_rtu::update(state.bus, config.bus, port, now), now);
  if (modbus_rtu::idle(state.bus) && now >= state.try_at) {
    begin(state, config, wanted, now);
    take(state, config, modbus_rtu::update(state.bus, config.bus, port, now), now);
  }

  Feedback seen;
  seen.age = state.known ? now - state.status_at : Micros{0};
  seen.fresh = state.known && state.misses < config.retries && seen.age <= config.fresh_for;
  seen.activated = state.step == Step::kNone && activated(state);
  seen.moving = state.object == Object::kMoving || ((state.action & kActive) != 0 && activation(state) == 1);
  seen.object = state.object;
  seen.position = state.position;
  seen.echo = state.echo;
  seen.current_10ma = state.current_10ma;
  seen.fault = state.fault;
  seen.fault_reason = reason_of(state, config);
  seen.latched = state.latched != Reason::kNone;
  seen.holding = state.contact;
  seen.lost = state.lost;
  seen.counters = state.counters;
  seen.bus = state.bus.counters;
  return seen;
}

}  // namespace holdfast::hande
