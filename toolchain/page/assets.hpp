// SPDX-License-Identifier: Apache-2.0
// The sources of this folder as text. CMake writes what is behind this (assets.cpp.in).
#pragma once

#include <string_view>

namespace holdfast::tool::page {

[[nodiscard]] std::string_view style_text();
[[nodiscard]] std::string_view explorer_text();
[[nodiscard]] std::string_view script_text();

}  // namespace holdfast::tool::page
