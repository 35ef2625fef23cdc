// SPDX-License-Identifier: Apache-2.0
// What is plugged into this computer that Holdfast can use, what is right or wrong with each, and what to do about it.
// Read from sysfs and from device files that are opened to ask their name: nothing is changed, nothing is sent.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace holdfast::devices {

enum class Verdict : std::uint8_t { kGood, kNote, kWrong };

struct Item {
  std::string kind{};  // camera, gpio, serial, bridge, system
  std::string path{};  // of the device file; empty: none
  std::string name{};
  Verdict verdict = Verdict::kGood;
  std::string what{};                                        // is right or wrong
  std::string fix{};                                         // empty: nothing to do
  std::vector<std::pair<std::string, std::string>> facts{};  // for programs, with stable names
};

struct ChipName {
  std::string label;
  unsigned lines = 0;
};

// Where to look; tests bring a tree of their own.
struct Places {
  std::string sys = "/sys";
  std::string dev = "/dev";
  std::string proc = "/proc";
  // Of a GPIO chip's device file, by the kernel; nothing: errno says why.
  std::function<std::optional<ChipName>(const std::string& path)> chip;
  // Whether this process may read and write it.
  std::function<bool(const std::string& path)> may_use;
};
[[nodiscard]] Places this_computer();

[[nodiscard]] std::vector<Item> cameras(const Places& places);
[[nodiscard]] std::vector<Item> gpio_chips(const Places& places);
[[nodiscard]] std::vector<Item> serial_ports(const Places& places);
[[nodiscard]] std::vector<Item> bridges(const Places& places);
[[nodiscard]] std::vector<Item> inventory(const Places& places);  // all four

// What else keeps a sensor from working well: power, memory, rights to lock memory and to run first.
[[nodiscard]] std::vector<Item> system_state(const Places& places);

}  // namespace holdfast::devices
