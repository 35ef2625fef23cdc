// SPDX-License-Identifier: Apache-2.0
// The frames of a run as MCAP: /holdfast/slip for each, /holdfast/markers where there are any, /holdfast/camera where
// there are pictures, and then /holdfast/annotations, which a viewer draws over them: markers, their way from rest in
// true length, state and evidence. JPEG pictures go in untouched; grey ones become JPEG of one component, and the
// file's metadata says so. Times count from `begun_ns`: 0, so that they count from the first frame, or when that was,
// by the wall clock. Sequence numbers are those of the frames.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <ostream>
#include <span>
#include <string>

#include "hal/camera.hpp"
#include "toolchain/log/mcap_writer.hpp"
#include "toolchain/log/messages.hpp"

namespace holdfast::log {

class FrameLog {
 public:
  static constexpr int kQuality = 95;  // of grey pictures

  explicit FrameLog(std::ostream& out, std::uint64_t begun_ns = 0);
  // `arrows`: row by row of `cols`, a lost marker not valid; `arrow_px`: how many of their pixels one of the picture's
  // is. `given`: as the camera gave it; without bytes: no picture.
  void add(const FrameRecord& since_begun, std::span<const Arrow> arrows, int cols, const hal::Frame& given,
           double arrow_px = 1);
  // What the file is to say of itself, before the end.
  void about(const std::map<std::string, std::string>& entries) { about_.insert(entries.begin(), entries.end()); }
  // Once, after the last frame, and again after each step_back().
  void finish();
  // After a write that failed: McapWriter::step_back().
  [[nodiscard]] std::optional<std::uint64_t> step_back() { return writer_.step_back(); }
  [[nodiscard]] std::uint64_t frames() const { return writer_.count(slip_); }
  [[nodiscard]] bool has_pictures() const { return camera_.has_value(); }
  [[nodiscard]] bool has_encoded() const { return encoded_; }

 private:
  McapWriter writer_;
  std::uint64_t begun_ns_;
  std::uint16_t slip_, markers_;
  std::optional<std::uint16_t> camera_, annotations_;
  bool encoded_ = false;
  std::map<std::string, std::string> about_;
};

}  // namespace holdfast::log
