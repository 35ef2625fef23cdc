// SPDX-License-Identifier: Apache-2.0
// The frames of a run as MCAP: /holdfast/slip for each, /holdfast/markers where there are any, /holdfast/camera where
// the camera sent JPEG. Times count from `begun_ns`: 0, so that they count from the first frame, or when that was, by
// the wall clock. Sequence numbers are those of the frames.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <ostream>
#include <span>
#include <string>

#include "toolchain/log/mcap_writer.hpp"
#include "toolchain/log/messages.hpp"

namespace holdfast::log {

class FrameLog {
 public:
  explicit FrameLog(std::ostream& out, std::uint64_t begun_ns = 0);
  // `arrows`: row by row of `cols`, a lost marker not valid. `jpeg`: as the camera sent it; empty: none.
  void add(const FrameRecord& since_begun, std::span<const Arrow> arrows, int cols, std::span<const std::uint8_t> jpeg);
  void about(const std::map<std::string, std::string>& entries) { writer_.add_metadata("holdfast", entries); }
  // Once, after the last frame.
  void finish() { writer_.finish(); }
  [[nodiscard]] bool has_pictures() const { return camera_.has_value(); }

 private:
  McapWriter writer_;
  std::uint64_t begun_ns_;
  std::uint16_t slip_, markers_;
  std::optional<std::uint16_t> camera_;
};

}  // namespace holdfast::log
