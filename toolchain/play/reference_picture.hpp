// SPDX-License-Identifier: Apache-2.0
// Which picture of a recording shows the empty gel.
#pragma once

#include <string>

#include "drivers/sim/recording.hpp"
#include "vision/luma_input.hpp"

namespace holdfast::tool {

// "first", "last" or a number; anything else is the name of an image file.
[[nodiscard]] bool names_a_frame(const std::string& reference);

// That frame of the recording, or another image that arrives at the same working size.
[[nodiscard]] sim::Result<sim::RecordedFrame> reference_picture(const sim::Recording& recording,
                                                                const std::string& reference,
                                                                const luma_input::Config& luma);

}  // namespace holdfast::tool
