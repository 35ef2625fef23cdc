// SPDX-License-Identifier: Apache-2.0
// The documentation of the wire, written from the tables that the firmware encodes with.
#pragma once

#include <string>

namespace holdfast::wire_doc {

// The whole of firmware/app/STATUS_FRAME.md: framing, fields, flags, states, reasons and a worked example.
[[nodiscard]] std::string status_frame_markdown();

}  // namespace holdfast::wire_doc
