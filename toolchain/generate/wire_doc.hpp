// SPDX-License-Identifier: Apache-2.0
// What others need to talk to the firmware, written from the tables that it encodes with.
#pragma once

#include <string>
#include <string_view>

#include "link/link.hpp"

namespace holdfast::wire_doc {

// u8, i16, ...
[[nodiscard]] std::string_view name_of(link::WireType type);

// The whole of firmware/link/LINK.md: framing, the kinds of frame, their numbers in words, and worked examples.
[[nodiscard]] std::string link_markdown();

// The whole of firmware/app/STATES.md: states, the rules that lead to them, and every reason with cause and next step.
[[nodiscard]] std::string states_markdown();

// The whole of firmware/params/mode_prices.gen.hpp, from the table that `holdfast trade` measured; empty: it has not
// all modes.
[[nodiscard]] std::string mode_prices(const std::string& trade_csv);

// The whole of firmware/ERRORS.md: every reason, every refusal of the console and of the link, with cause and next
// step.
[[nodiscard]] std::string errors_markdown();

// The whole of firmware/params/PARAMETERS.md: every parameter, who may change it and why, and its price.
[[nodiscard]] std::string parameters_markdown();

// The whole of toolchain/page/tables.js: the constants of the page's decoder, and the words for its numbers.
[[nodiscard]] std::string page_tables();

// The whole of toolchain/python/holdfast/tables.py: likewise, for programs in Python.
[[nodiscard]] std::string python_tables();

}  // namespace holdfast::wire_doc
