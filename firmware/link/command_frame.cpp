// SPDX-License-Identifier: Apache-2.0
#include "link/command_frame.hpp"

namespace holdfast::command_frame {

std::size_t encode(const CommandFrame& frame, std::span<std::uint8_t, kCommandBytes> wire) {
  return link::encode(kCommandFields, frame, wire);
}

std::size_t encode(const AnswerFrame& frame, std::span<std::uint8_t, kAnswerBytes> wire) {
  return link::encode(kAnswerFields, frame, wire);
}

std::optional<CommandFrame> read_command(const link::Payload& payload) {
  CommandFrame frame;
  if (link::read(kCommandFields, payload, frame) != link::DecodeError::kNone) return std::nullopt;
  return frame;
}

std::optional<AnswerFrame> read_answer(const link::Payload& payload) {
  AnswerFrame frame;
  if (link::read(kAnswerFields, payload, frame) != link::DecodeError::kNone) return std::nullopt;
  return frame;
}

}  // namespace holdfast::command_frame
