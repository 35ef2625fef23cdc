// SPDX-License-Identifier: Apache-2.0
// Settings as somebody writes them: a flat TOML file of `name = value`, checked against the firmware's own table of
// parameters, and back.
//
//   # a sponge gripper
//   hold_ms = 300
//   mode = "precise"          # or its number
#pragma once

#include <string>
#include <string_view>

#include "params/params.hpp"

namespace holdfast::tool {

// What is not in the text keeps its default. Empty, or one line: file, line, what, likely cause, next step. `path` is
// for that line only. Range: any text.
[[nodiscard]] std::string settings_of_toml(std::string_view text, const std::string& path, Params& params);

// What differs from the defaults, with unit and range behind it.
[[nodiscard]] std::string toml_of_settings(const Params& params);

}  // namespace holdfast::tool
