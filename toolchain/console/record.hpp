// SPDX-License-Identifier: Apache-2.0
// The device's telemetry into a log, as `replay --log` and `--mcap` write them (toolchain/log).
//
// The wire has less than a log of a run does: markers and histogram come with every fifth picture, pictures never, and
// decided_us is 0. Positions count from the middle of the rest positions, in pixels of the device's working image;
// rates_valid is true where the frame before was measured too and none was lost between.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "toolchain/console/device.hpp"

namespace holdfast::console_tool {

struct RecordOptions {
  std::string path;  // ends in .csv or .mcap
  std::optional<double> seconds;
};

// Empty, or why nothing could be recorded to such a file.
[[nodiscard]] std::string check_record_path(const std::string& path);

// Until Ctrl-C, the end, or so many seconds. The file appears when it is complete; memory does not grow with it. Empty,
// or the error line. `note`: what a person should know meanwhile.
[[nodiscard]] std::string record(Device& device, const RecordOptions& options,
                                 const std::function<void(const std::string&)>& note, std::vector<std::string>& report);

}  // namespace holdfast::console_tool
