// SPDX-License-Identifier: Apache-2.0
#include "toolchain/console/find.hpp"

#include <fmt/format.h>

#include <filesystem>
#include <vector>

#include "drivers/common/trouble.hpp"

namespace holdfast::console_tool {
namespace {

using devices::Item;
using devices::Verdict;

// ttyS are a computer's own plugs: a Holdfast is on none of them, and what is there may take any letter for a command.
bool may_be(const Item& item) {
  const std::string name = std::filesystem::path(item.path).filename().string();
  return name.starts_with("ttyUSB") || name.starts_with("ttyACM") || name.starts_with("ttyAMA");
}

}  // namespace

Found find_device(const devices::Places& places, Signals& signals, Millis deadline) {
  std::vector<std::string> answered, silent, busy, others;
  for (const Item& item : devices::serial_ports(places)) {
    if (!may_be(item) || item.verdict == Verdict::kNote) continue;
    const std::string name = item.name.starts_with('/') ? item.name : item.path;
    Port port;
    const Port::Opened opened = port.open(name);
    if (opened == Port::Opened::kBusy) {
      busy.push_back(name);
    } else if (opened != Port::Opened::kYes) {
      others.push_back(refusal(name, opened));
    } else if (Device device(port, signals, deadline); device.attach(deadline)) {
      answered.push_back(name);
    } else {
      silent.push_back(name);
    }
  }
  if (answered.size() == 1) return {answered.front(), {}};
  if (answered.size() > 1) {
    return {{},
            trouble(fmt::format("{} devices answer: {}", answered.size(), fmt::join(answered, ", ")),
                    "more than one is plugged in", "name the port: holdfast console " + answered.front())};
  }
  if (!busy.empty()) {
    return {{},
            trouble(fmt::format("no free port answers as a Holdfast, and {} is busy", fmt::join(busy, ", ")),
                    "another console or terminal program has it", "end that one: fuser -v " + busy.front())};
  }
  if (!silent.empty()) {
    return {{},
            trouble(fmt::format("no port answers as a Holdfast: {} stay silent", fmt::join(silent, ", ")),
                    "the firmware is not running, or its console is on another port",
                    "look at the device; a port that is not listed can be named: holdfast console PORT")};
  }
  if (!others.empty()) return {{}, others.front()};
  return {{},
          trouble("there is no serial port that a Holdfast could be on", "the device is not plugged in",
                  "plug it in, or name the port: holdfast console PORT")};
}

}  // namespace holdfast::console_tool
