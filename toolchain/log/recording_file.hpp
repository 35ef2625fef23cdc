// SPDX-License-Identifier: Apache-2.0
// Recordings as Recording::open() takes them, and logs of ours (.mcap) with the pictures that they hold.
#pragma once

#include <filesystem>

#include "drivers/sim/recording.hpp"

namespace holdfast::log {

[[nodiscard]] sim::Result<sim::Recording> open_recording(const std::filesystem::path& path,
                                                         sim::RecordingOptions options = {});

}  // namespace holdfast::log
