// SPDX-License-Identifier: Apache-2.0
// The page of a session: the frame around its content, and the part that only lives with a script.
//
// Its sources are toolchain/page; CMake puts them into the tool. One file that loads nothing: its content security
// policy forbids the browser every address. With data it shows a recording frame by frame; in Chromium it also reads
// the port `host` of a board that is plugged in (Web Serial API).
#pragma once

#include <string>
#include <string_view>

namespace holdfast::tool::page {

// In this order, with what is to be read without a script between them.
[[nodiscard]] std::string begin(std::string_view title);
[[nodiscard]] std::string explorer();
// `data`: of Track::json(), or "null".
[[nodiscard]] std::string end(const std::string& data);

// The whole page without data. `served`: by `holdfast live`, which feeds it; else it asks for a serial port.
[[nodiscard]] std::string live(bool served = false);

}  // namespace holdfast::tool::page
