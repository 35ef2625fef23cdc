// SPDX-License-Identifier: Apache-2.0
// The log as a table: one header, then a row for each frame. First column t_s; every cell is a number in plain decimal
// notation, none is empty and none is nan, so that PlotJuggler, spreadsheets and strict readers take it as it is.
// Columns are those of FrameRecord without its texts, an element of an array each. A figure that means nothing in a
// frame is 0, and features_valid or rates_valid say so.
#pragma once

#include <string>

#include "toolchain/log/messages.hpp"

namespace holdfast::log {

// Both end with a newline.
[[nodiscard]] std::string csv_header();
[[nodiscard]] std::string csv_row(const FrameRecord& state);

}  // namespace holdfast::log
