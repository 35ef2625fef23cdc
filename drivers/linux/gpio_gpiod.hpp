// SPDX-License-Identifier: Apache-2.0
// Lines of the kernel's GPIO chips (/dev/gpiochip*), by libgpiod 1 or 2.
//
// Polarity is applied once, by the kernel: a row that is active_low is requested so, and what is set and read here are
// the application's words. open() asks for all lines or for none; afterwards set() and read() are two system calls at
// most, touch no heap and open nothing, and may come from several threads at once, as the output watchdog needs: there
// is no lock that a hanging driver could hold.
//
// What becomes of an output when the process ends, however it ends (the kernel closes the descriptor):
//   Raspberry Pi OS    the pin stays an output at its last level: pinctrl-bcm2835's persist_gpio_outputs is on there,
//                      and off with `dtparam=strict_gpiod` in config.txt (Raspberry Pi documentation, "GPIO and the
//                      40-pin header"; raspberrypi/linux pull request 6117)
//   mainline, Debian   the pin becomes an input and the wire goes where a resistor takes it: bcm2835_pmx_free() sets
//                      GPIO_IN; since 6.10 the parameter exists there too, and is off (Wahren's patch of May 2024)
//   PL061 (qemu virt)  the level stays: its free() is gpiochip_generic_free(), which does nothing without a pin
//                      controller
//   others             nothing is promised: "reverts to default when the last process [...] exits" (gpioset's help)
// So neither a killed process nor its end lowers GRIP_OK by itself; the receiver's rule (GRIP_OK counts while ALIVE
// toggles) and a pull-down at the wire do. An orderly close() drives every output LOW first. After any other end
// somebody has to call lower(): the unit does (holdfastd --lower).
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "drivers/common/gpio_wiring.hpp"
#include "drivers/linux/gpio_gpiod_library.hpp"
#include "hal/gpio.hpp"

namespace holdfast::drivers {

class GpiodGpio final : public hal::Gpio {
 public:
  struct Config {
    std::span<const Wiring> wiring;      // the board's table; read by open() alone
    std::string consumer = "holdfastd";  // what `gpioinfo` shows as the holder, with the role behind it
    std::string devices = "/dev";        // where the chips' device files are
  };

  GpiodGpio() = default;
  ~GpiodGpio() override { close(); }
  GpiodGpio(const GpiodGpio&) = delete;
  GpiodGpio& operator=(const GpiodGpio&) = delete;

  // Outputs are driven LOW from the moment they are ours (GRIP_OK: not fine), inputs get a resistor towards LOW where
  // the chip has one, so that a broken wire asks for nothing. Empty: all lines are ours, and every output reads LOW.
  // Otherwise one line: what, likely cause, next step; nothing is held then. Uses the heap.
  [[nodiscard]] std::string open(const Config& config);
  void close();

  // For the lines of a process that is gone: takes each output of the table LOW and lets go of it, each by itself; an
  // input stays as it is, and so does a line that somebody else holds, who may be alive.
  struct Lowered {
    bool all = true;       // that nobody else holds
    std::string problems;  // one line each: what, likely cause, next step
  };
  [[nodiscard]] static Lowered lower(const Config& config);

 private:
  // A line that the table does not name takes no level.
  [[nodiscard]] bool do_set(hal::Line line, hal::Level level) override;
  [[nodiscard]] std::optional<hal::Level> do_read(hal::Input input) override;
  [[nodiscard]] gpiod::HeldLine& slot_of(const Role& role);

  std::array<gpiod::HeldLine, hal::kLineCount> outputs_;
  std::array<gpiod::HeldLine, hal::kInputCount> inputs_;
};

}  // namespace holdfast::drivers
