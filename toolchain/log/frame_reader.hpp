// SPDX-License-Identifier: Apache-2.0
// Our messages in an MCAP file of ours.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>

#include "toolchain/log/mcap_reader.hpp"
#include "toolchain/log/messages.hpp"

namespace holdfast::log {

struct FrameVisit {
  std::function<void(const FrameRecord&)> slip;
  std::function<void(const CompressedImage&)> picture;
};

// Gives the messages of our topics to those that are there. `file` then says what is wrong, also a message that is not
// what its schema says; a topic of ours with another schema, as of another version, is a fault.
[[nodiscard]] McapFile read_frames(std::span<const std::uint8_t> bytes, const FrameVisit& visit);

// "FILE: what. Likely cause: ... Next: ..." of the first fault.
[[nodiscard]] std::string fault_line(const std::string& path, const McapFile& file);

}  // namespace holdfast::log
