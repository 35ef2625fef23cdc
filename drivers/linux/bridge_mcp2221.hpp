// SPDX-License-Identifier: Apache-2.0
// Four GPIO lines on a USB plug: Microchip's MCP2221A, for a desk without header pins.
//
// The chip is a full-speed HID device that answers each report of 64 bytes by one, a millisecond each way, so a set()
// with its read-back takes about 4 ms (four reports), and holds the next caller off for as long. No call waits longer
// than 4 * Config::patience plus what the kernel needs to send: normally microseconds, up to 5 s when the chip is
// wedged (usbhid's limit). Where that matters, use pins of the board. What the pins do before open(), and after the
// process ended, is the chip's flash and its latches: nothing pulls them LOW. GP2 is HIGH from the factory on as soon
// as USB works. The receiver's rule (GRIP_OK counts while ALIVE toggles) covers both; a pull-down at the wire covers an
// unplugged chip.
//
// Linux has its own driver (hid-mcp2221), which takes the chip as a GPIO chip labelled "mcp2221_gpio" and leaves no
// hidraw device to this one (seen on Linux 6.1). Its reading of pins always gave 1 before Linux 6.4 (commit
// e36c31f8cac5), so that the read-back of gpio_gpiod.hpp fails there; unload it then (modprobe -r hid_mcp2221) and use
// this. Rows of the wiring table are the same for both: chip "mcp2221_gpio" with offsets 0 to 3. Here "GP0" to "GP3"
// are names as well.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <mutex>
#include <optional>
#include <span>
#include <string>

#include "drivers/common/gpio_wiring.hpp"
#include "hal/gpio.hpp"

namespace holdfast::drivers {

inline constexpr std::uint16_t kMcp2221Vendor = 0x04d8;
inline constexpr std::uint16_t kMcp2221Product = 0x00dd;

// A desk's table: GP2, which the chip drives by itself until open(), is left out.
inline constexpr std::array<Wiring, 3> kMcp2221Desk{{
    {.role = hal::Line::kGripOk, .line = {}, .chip = "mcp2221_gpio", .offset = 0},
    {.role = hal::Line::kAlive, .line = {}, .chip = "mcp2221_gpio", .offset = 1},
    {.role = hal::Input::kTare, .line = {}, .chip = "mcp2221_gpio", .offset = 3},
}};

// Reports to and from a HID device that numbers none.
class HidPort {
 public:
  using Report = std::array<std::uint8_t, 64>;
  enum class Got : std::uint8_t { kReport, kNothing, kGone };

  virtual ~HidPort() = default;
  // False: the device is gone.
  [[nodiscard]] bool send(const Report& report) { return do_send(report); }
  // Waits at most so long, zero: not at all.
  [[nodiscard]] Got receive(Report& report, std::chrono::milliseconds at_most) { return do_receive(report, at_most); }

 private:
  [[nodiscard]] virtual bool do_send(const Report& report) = 0;
  [[nodiscard]] virtual Got do_receive(Report& report, std::chrono::milliseconds at_most) = 0;
};

class Mcp2221Gpio final : public hal::Gpio {
 public:
  static constexpr std::size_t kPins = 4;

  struct Config {
    std::span<const Wiring> wiring;          // the board's table; read by open() alone
    std::chrono::milliseconds patience{20};  // for one answer; price: see above
  };

  // `port` outlives this. One that is gone stays gone: its calls fail at once until open() is called again.
  explicit Mcp2221Gpio(HidPort& port) : port_(port) {}
  ~Mcp2221Gpio() override { close(); }
  Mcp2221Gpio(const Mcp2221Gpio&) = delete;
  Mcp2221Gpio& operator=(const Mcp2221Gpio&) = delete;

  // Outputs are LOW from the moment they are outputs; pins that the table does not name stay what they are. Empty: all
  // pins are set up and read as they should. Otherwise one line: what, likely cause, next step. Uses the heap.
  [[nodiscard]] std::string open(const Config& config);
  // Drives all outputs LOW.
  void close();

 private:
  struct Pin {
    std::uint8_t number = 0;
    bool active_low = false;
  };
  using Report = HidPort::Report;

  [[nodiscard]] bool do_set(hal::Line line, hal::Level level) override;
  [[nodiscard]] std::optional<hal::Level> do_read(hal::Input input) override;

  // Waits at most for one set() of another thread.
  [[nodiscard]] std::unique_lock<std::mutex> turn();
  // The answer to a command; nothing: none in time, refused, or gone.
  [[nodiscard]] std::optional<Report> ask(const Report& command);
  [[nodiscard]] bool drive(const Pin& pin, bool high);
  [[nodiscard]] std::optional<bool> level_of(const Pin& pin, bool output);
  [[nodiscard]] std::string set_up();

  HidPort& port_;
  std::chrono::milliseconds patience_{};
  std::mutex mutex_;  // an answer belongs to the command before it
  std::atomic<bool> usable_{false};
  std::array<std::optional<Pin>, hal::kLineCount> outputs_;
  std::array<std::optional<Pin>, hal::kInputCount> inputs_;
};

}  // namespace holdfast::drivers
