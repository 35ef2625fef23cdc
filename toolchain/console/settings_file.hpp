// SPDX-License-Identifier: Apache-2.0
// A device's parameters in a file, and back.
//
// `set NAME VALUE` lines, as the device's own `dump` and `diff` write them, and comments. A backup of ours has a first
// and a last comment; the last one has the sum of what stands between, so that a file that was cut or damaged on the
// way is refused. Whoever edits one takes both comments out. Nothing is set unless every line fits the device.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "toolchain/console/device.hpp"

namespace holdfast::console_tool {

struct Parameter {
  std::string name;
  std::int64_t value = 0, min = 0, max = 0, default_value = 0;
  std::string unit;
  std::string applies;  // when a new value counts
};

struct Setting {
  std::string name;
  std::int64_t value = 0;
  std::size_t line = 0;  // of the file, from 1
};

struct SettingsText {
  std::vector<Setting> settings;
  std::string error;  // one line, without the file's name; empty: good
};
// Range: any bytes.
[[nodiscard]] SettingsText parse_settings(std::string_view text);
// Empty, or why they do not fit the device, all of them named.
[[nodiscard]] std::string check_settings(const std::vector<Setting>& settings, const std::vector<Parameter>& device);
// `version`: the device's, as JSON; `dump`: its lines.
[[nodiscard]] std::string backup_text(std::string_view version, const std::vector<std::string>& dump);

// The device's parameters, from `get json`. Empty, or the error line.
[[nodiscard]] std::string read_parameters(Device& device, std::vector<Parameter>& parameters);

// Both: empty, or the error line. `report`: what was done, a line each.
[[nodiscard]] std::string backup(Device& device, const std::string& path, std::vector<std::string>& report);
// All or nothing, and stored: when the device refuses one of them, or to store them, the earlier values come back.
[[nodiscard]] std::string restore(Device& device, const std::string& path, std::vector<std::string>& report);

}  // namespace holdfast::console_tool
