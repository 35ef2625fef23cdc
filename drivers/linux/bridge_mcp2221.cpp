// SPDX-License-Identifier: Apache-2.0
// Commands and byte numbers as in the data sheet, DS20005565, section 3.1.
#include "drivers/linux/bridge_mcp2221.hpp"

#include <algorithm>
#include <string_view>
#include <thread>
#include <variant>
#include <vector>

#include "drivers/common/trouble.hpp"

namespace holdfast::drivers {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr std::uint8_t kSetOutputs = 0x50;
constexpr std::uint8_t kGetPins = 0x51;
constexpr std::uint8_t kSetSram = 0x60;
constexpr std::uint8_t kGetSram = 0x61;
constexpr std::uint8_t kDone = 0x00;  // byte 1 of an answer

// kSetOutputs: from byte 2 on, four bytes a pin: alter the level, level, alter the direction, direction.
constexpr std::size_t alter_at(std::size_t pin) {
  return 2 + 4 * pin;
}
// Answer to kGetPins: from byte 2 on, two bytes a pin: level, direction.
constexpr std::size_t level_at(std::size_t pin) {
  return 2 + 2 * pin;
}
constexpr std::uint8_t kIsOutput = 0x00;
constexpr std::uint8_t kIsInput = 0x01;

// A pin's settings in SRAM: bit 4 level, bit 3 direction, bits 2 to 0 what it is used for (0: GPIO).
constexpr std::size_t kSramAlter = 7;        // of kSetSram; bit 7: take the pins' settings
constexpr std::size_t kSramPins = 8;         // of kSetSram, one byte a pin
constexpr std::size_t kSramAnswerPins = 22;  // of the answer to kGetSram
constexpr std::uint8_t kPinHigh = 0x10;
constexpr std::uint8_t kPinInput = 0x08;

constexpr std::chrono::microseconds kLookAgain{100};
constexpr int kMostStale = 8;  // answers that came too late and wait

constexpr std::string_view kLabel = "mcp2221_gpio";
constexpr std::array<LineInfo, Mcp2221Gpio::kPins> kLines{{{.name = "GP0", .user = {}},
                                                           {.name = "GP1", .user = {}},
                                                           {.name = "GP2", .user = {}},
                                                           {.name = "GP3", .user = {}}}};

std::string bridge_trouble(std::string_view what, std::string_view cause, std::string_view next) {
  return trouble("MCP2221A: " + std::string(what), cause, next);
}

}  // namespace

// Not a timed_mutex: its pthread_mutex_clocklock() is unknown to gcc 12's ThreadSanitizer, which then sees races.
std::unique_lock<std::mutex> Mcp2221Gpio::turn() {
  const auto until = steady_clock::now() + 2 * patience_;
  std::unique_lock lock(mutex_, std::try_to_lock);
  while (!lock.owns_lock() && steady_clock::now() < until) {
    std::this_thread::sleep_for(kLookAgain);
    (void)lock.try_lock();
  }
  return lock;
}

std::optional<Mcp2221Gpio::Report> Mcp2221Gpio::ask(const Report& command) {
  if (!usable_.load(std::memory_order_acquire)) return std::nullopt;
  Report answer{};
  auto got = HidPort::Got::kReport;
  for (int i = 0; i < kMostStale && got == HidPort::Got::kReport; ++i) got = port_.receive(answer, milliseconds{0});
  if (got == HidPort::Got::kGone || !port_.send(command)) {
    usable_.store(false, std::memory_order_release);
    return std::nullopt;
  }
  const auto until = steady_clock::now() + patience_;
  for (int i = 0; i < kMostStale; ++i) {
    const auto left = std::chrono::ceil<milliseconds>(until - steady_clock::now());
    got = port_.receive(answer, std::max(left, milliseconds{0}));
    if (got == HidPort::Got::kGone) usable_.store(false, std::memory_order_release);
    if (got != HidPort::Got::kReport) return std::nullopt;
    if (answer[0] == command[0]) return answer[1] == kDone ? std::optional(answer) : std::nullopt;
  }
  return std::nullopt;
}

std::optional<bool> Mcp2221Gpio::level_of(const Pin& pin, bool output) {
  const std::optional<Report> answer = ask({kGetPins});
  if (!answer) return std::nullopt;
  const std::uint8_t level = (*answer)[level_at(pin.number)];
  const std::uint8_t direction = (*answer)[level_at(pin.number) + 1];
  // A pin that somebody turned round shows a level, and drives none; one that is no GPIO any more has neither
  // direction.
  if (direction != (output ? kIsOutput : kIsInput)) return std::nullopt;
  return (level == 1) != pin.active_low;
}

bool Mcp2221Gpio::drive(const Pin& pin, bool high) {
  Report command{kSetOutputs};
  command[alter_at(pin.number)] = 1;
  command[alter_at(pin.number) + 1] = high != pin.active_low ? 1 : 0;
  return ask(command).has_value();
}

bool Mcp2221Gpio::do_set(hal::Line line, hal::Level level) {
  const std::optional<Pin>& pin = outputs_[static_cast<std::size_t>(line)];
  const bool high = level == hal::Level::kHigh;
  const auto lock = turn();
  return pin && lock.owns_lock() && drive(*pin, high) && level_of(*pin, true) == high;
}

std::optional<hal::Level> Mcp2221Gpio::do_read(hal::Input input) {
  const std::optional<Pin>& pin = inputs_[static_cast<std::size_t>(input)];
  if (!pin) return std::nullopt;  // before the turn, which may take a question's time
  const auto lock = turn();
  const std::optional<bool> level = lock.owns_lock() ? level_of(*pin, false) : std::nullopt;
  if (!level) return std::nullopt;
  return *level ? hal::Level::kHigh : hal::Level::kLow;
}

// All pins in one command: direction and level change together, so that no output shows its old latch.
std::string Mcp2221Gpio::set_up() {
  constexpr std::string_view kSilent = "no answer, or not one to the question";
  constexpr std::string_view kSilentCause = "another program talks to the chip, or it hangs";
  constexpr std::string_view kReplug = "end the other program, or replug the chip";
  const std::optional<Report> before = ask({kGetSram});
  if (!before) return bridge_trouble(kSilent, kSilentCause, kReplug);
  Report command{kSetSram};
  command[kSramAlter] = 0x80;
  std::copy_n(before->begin() + kSramAnswerPins, kPins, command.begin() + kSramPins);
  for (const std::optional<Pin>& pin : outputs_) {
    if (pin) command[kSramPins + pin->number] = pin->active_low ? kPinHigh : 0;
  }
  for (const std::optional<Pin>& pin : inputs_) {
    if (pin) command[kSramPins + pin->number] = kPinInput;
  }
  if (!ask(command)) return bridge_trouble(kSilent, kSilentCause, kReplug);
  for (const std::optional<Pin>& pin : outputs_) {
    if (pin && level_of(*pin, true) != false) {
      return bridge_trouble(
          "GP" + std::to_string(pin->number) + " was made an output and told LOW, and does not read so",
          "the wire is shorted or driven from outside", "measure the pin with the wire off");
    }
  }
  for (const std::optional<Pin>& pin : inputs_) {
    if (pin && !level_of(*pin, false)) {
      return bridge_trouble("GP" + std::to_string(pin->number) + " did not become an input", kSilentCause, kReplug);
    }
  }
  return "";
}

std::string Mcp2221Gpio::open(const Config& config) {
  close();
  patience_ = config.patience;
  const ChipInfo chip{"MCP2221A", kLabel, kLines};
  std::vector<Place> places(config.wiring.size());
  std::string error = find_all({&chip, 1}, config.wiring, places);
  if (!error.empty()) return error;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const Role& role = config.wiring[i].role;
    const auto* const line = std::get_if<hal::Line>(&role);
    std::optional<Pin>& slot = line != nullptr ? outputs_[static_cast<std::size_t>(*line)]
                                               : inputs_[static_cast<std::size_t>(*std::get_if<hal::Input>(&role))];
    if (slot) {
      error = bridge_trouble(std::string(name_of(role)) + " has two rows", "a typing error in the wiring table",
                             "leave one row for each role");
      break;
    }
    slot = Pin{static_cast<std::uint8_t>(places[i].offset), config.wiring[i].active_low};
  }
  if (error.empty()) {
    usable_.store(true, std::memory_order_release);
    error = set_up();
  }
  if (!error.empty()) close();
  return error;
}

void Mcp2221Gpio::close() {
  for (std::optional<Pin>& pin : outputs_) {
    if (pin) (void)drive(*pin, false);
    pin.reset();
  }
  for (std::optional<Pin>& pin : inputs_) pin.reset();
  usable_.store(false, std::memory_order_release);
}

}  // namespace holdfast::drivers
