// SPDX-License-Identifier: Apache-2.0
// The kernel's side of GPIO chips as the tests of gpio_gpiod.cpp see it: wires with volts on them. Both fakes of
// libgpiod (fake_gpiod_v1.cpp, fake_gpiod_v2.cpp) turn their calls into these, so one test file tests the driver on
// both.
//
// Modelled: chips with names, labels and lines; who holds a line; direction, active-low, bias and initial level of a
//   request; levels of outputs and inputs on the wire; refusals by errno; a wire that is stuck.
// Not modelled: events, drive, debounce, several lines in one request.
#pragma once

#include <cerrno>
#include <cstddef>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace holdfast::test {

enum class Pull { kAsIs, kUp, kDown };

struct Wire {
  std::string name;
  std::string user;  // of the one who holds it; "" and used: a holder without a name
  bool used = false;
  bool output = false;
  bool active_low = false;
  Pull pull = Pull::kAsIs;
  bool high = false;         // what a voltmeter shows
  bool stuck = false;        // keeps `high` whatever drives it
  int refuse = 0;            // errno of the next request, once
  int refuse_bias = 0;       // errno of every request with a bias
  int refuse_io = 0;         // errno of every get and set
  std::vector<bool> levels;  // every level that the wire was driven to, the initial one first
};

struct Chip {
  std::string name;
  std::string label;
  std::vector<Wire> wires;
};

struct GpioKernel {
  std::map<std::string, Chip> chips;      // by file name of the device
  std::map<std::string, int> unopenable;  // errno by file name
  int opened = 0;                         // chips and requests that nobody has closed yet
  int calls = 0;                          // of anything that opens, since start
  int asked = 0, fails_at = 0,
      error = 0;  // of all calls that may fail: the one with this number (from 1) does, with errno

  static GpioKernel& get() {
    static GpioKernel kernel;
    return kernel;
  }
  static bool fails() {
    GpioKernel& kernel = get();
    if (++kernel.asked != kernel.fails_at) return false;
    errno = kernel.error;
    return true;
  }
  // nullptr with errno.
  static Chip* open(const std::filesystem::path& path) {
    if (fails()) return nullptr;
    GpioKernel& kernel = get();
    ++kernel.calls;
    const auto chip = kernel.chips.find(path.filename());
    const auto refused = kernel.unopenable.find(path.filename());
    if (refused != kernel.unopenable.end() || chip == kernel.chips.end()) {
      errno = refused != kernel.unopenable.end() ? refused->second : ENOENT;
      return nullptr;
    }
    ++kernel.opened;
    return &chip->second;
  }
};

// Both return an errno value, 0: done. Levels are logical.
struct Request {
  bool output = false;
  bool active_low = false;
  Pull pull = Pull::kAsIs;
  bool value = false;
  std::string consumer;
};
inline void drive(Wire& wire, bool logical) {
  if (!wire.stuck) wire.high = logical != wire.active_low;
  wire.levels.push_back(logical != wire.active_low);
}
inline int request(Wire& wire, const Request& request) {
  constexpr int kBusy = 16;
  if (wire.used) return kBusy;
  if (wire.refuse != 0) {
    const int refused = wire.refuse;
    wire.refuse = 0;
    return refused;
  }
  if (request.pull != Pull::kAsIs && wire.refuse_bias != 0) return wire.refuse_bias;
  wire.used = true;
  wire.user = request.consumer.substr(0, 31);
  wire.output = request.output;
  wire.active_low = request.active_low;
  wire.pull = request.pull;
  if (request.output) drive(wire, request.value);
  return 0;
}
inline void release(Wire& wire) {
  wire.used = false;
  wire.user.clear();
}
inline int set(Wire& wire, bool logical) {
  constexpr int kNotPermitted = 1;
  if (wire.refuse_io != 0) return wire.refuse_io;
  if (!wire.output) return kNotPermitted;
  drive(wire, logical);
  return 0;
}
inline bool get(const Wire& wire) {
  return wire.high != wire.active_low;
}

}  // namespace holdfast::test
