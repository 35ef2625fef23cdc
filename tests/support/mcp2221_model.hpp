// SPDX-License-Identifier: Apache-2.0
// The GPIO side of a Microchip MCP2221A behind its HID reports, after data sheet DS20005565, section 3.1.
//
// Modelled: commands 0x50, 0x51, 0x60 and 0x61 as far as the four GP pins go; what pins are from the factory; latches,
//   directions and other uses of pins; wires that are driven from outside or stuck; answers that are late, lost, of an
//   unknown command (byte 1 not 0), or of a device that is gone.
// Not modelled: I2C, UART, ADC, DAC, clock, interrupts, flash, passwords, and time: an answer is there at once.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <thread>
#include <vector>

#include "drivers/linux/bridge_mcp2221.hpp"

namespace holdfast::test {

class Mcp2221Model final : public drivers::HidPort {
 public:
  struct Pin {
    int use = 0;  // 0: GPIO
    bool input = false;
    bool latch = false;
    bool outside = false;          // what the wire shows when the pin does not drive it
    bool stuck = false;            // the wire shows `outside` whatever drives it
    std::vector<bool> shown = {};  // every level that the wire was driven to as a GPIO output
  };
  // From the factory: LED of UART reception, LED of UART transmission, USBCFG, LED of I2C.
  std::array<Pin, 4> pins{Pin{.use = 2}, Pin{.use = 3}, Pin{.use = 1}, Pin{.use = 1}};

  std::atomic<bool> hangs{false};    // a command does not come back from the kernel
  std::atomic<bool> hanging{false};  // one is there now
  int silent = 0;                    // so many commands get no answer
  int late = 0;                      // so many answers come only before the next one
  int foreign = 0;                   // so many answers come behind one to another program
  int refusing = 0;                  // so many commands are answered with an error, and not obeyed
  bool gone = false;
  int commands = 0;
  int overlaps = 0;                           // commands that came before the answer to the one before was taken
  std::chrono::milliseconds asked_to_wait{};  // the longest

  [[nodiscard]] bool wire(std::size_t pin) const {
    const Pin& p = pins[pin];
    return p.stuck || p.use != 0 || p.input ? p.outside : p.latch;
  }
  // A report that nobody asked for.
  void inject(const Report& report) { answers_.push_back(report); }

 private:
  [[nodiscard]] bool do_send(const Report& report) override {
    if (gone) return false;
    while (hangs) {
      hanging = true;
      std::this_thread::yield();
    }
    ++commands;
    if (!answers_.empty()) ++overlaps;
    Report answer{report[0]};
    if (refusing > 0) {
      --refusing;
      answer[1] = 0x01;
    } else if (report[0] == 0x50) {
      set_outputs(report, answer);
    } else if (report[0] == 0x51) {
      for (std::size_t i = 0; i < pins.size(); ++i) {
        answer[2 + 2 * i] = pins[i].use != 0 ? 0xEE : static_cast<std::uint8_t>(wire(i));
        answer[3 + 2 * i] = pins[i].use != 0 ? 0xEF : static_cast<std::uint8_t>(pins[i].input);
      }
    } else if (report[0] == 0x60) {
      if ((report[7] & 0x80) != 0) {
        for (std::size_t i = 0; i < pins.size(); ++i) configure(pins[i], report[8 + i]);
      }
    } else if (report[0] == 0x61) {
      answer[2] = 18;  // length of the chip's settings, then of the pins'
      answer[3] = 4;
      for (std::size_t i = 0; i < pins.size(); ++i) {
        answer[22 + i] =
            static_cast<std::uint8_t>((pins[i].latch ? 0x10 : 0) | (pins[i].input ? 0x08 : 0) | pins[i].use);
      }
    } else {
      answer[1] = 0x01;
    }
    if (foreign > 0) {
      --foreign;
      answers_.push_back({0x10});
    }
    if (silent > 0) {
      --silent;
    } else if (late > 0) {
      --late;
      delayed_.push_back(answer);
    } else {
      answers_.push_back(answer);
    }
    std::this_thread::yield();  // the other thread's chance to come in between
    return true;
  }

  [[nodiscard]] Got do_receive(Report& report, std::chrono::milliseconds at_most) override {
    asked_to_wait = std::max(asked_to_wait, at_most);
    if (gone) return Got::kGone;
    if (answers_.empty()) {
      // What was late is there when the next one looks.
      answers_.swap(delayed_);
      return Got::kNothing;
    }
    report = answers_.front();
    answers_.pop_front();
    return Got::kReport;
  }

  void set_outputs(const Report& report, Report& answer) {
    for (std::size_t i = 0; i < pins.size(); ++i) {
      const std::size_t at = 2 + 4 * i;
      Pin& pin = pins[i];
      for (std::size_t k = 0; k < 4; ++k) answer[at + k] = report[at + k];
      if (pin.use != 0) {
        answer[at + 1] = 0xEE;
        answer[at + 3] = 0xEF;
        continue;
      }
      if (report[at + 2] != 0) pin.input = report[at + 3] != 0;
      if (report[at] != 0) {
        pin.latch = report[at + 1] != 0;
        if (!pin.input) pin.shown.push_back(pin.latch);
      }
    }
  }

  static void configure(Pin& pin, std::uint8_t settings) {
    pin.use = settings & 0x07;
    pin.input = (settings & 0x08) != 0;
    pin.latch = (settings & 0x10) != 0;
    if (pin.use == 0 && !pin.input) pin.shown.push_back(pin.latch);
  }

  std::deque<Report> answers_;
  std::deque<Report> delayed_;
};

}  // namespace holdfast::test
