// SPDX-License-Identifier: Apache-2.0
// Numbers of the MCAP format, version 0 (https://mcap.dev/spec): what writer and reader agree on. A record is an
// opcode, the length of its content in 8 bytes, and the content; numbers are little endian.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace holdfast::log {

inline constexpr std::array<std::uint8_t, 8> kMcapMagic{0x89, 'M', 'C', 'A', 'P', '0', '\r', '\n'};

enum class Op : std::uint8_t {
  kHeader = 0x01,
  kFooter = 0x02,
  kSchema = 0x03,
  kChannel = 0x04,
  kMessage = 0x05,
  kChunk = 0x06,
  kMessageIndex = 0x07,
  kChunkIndex = 0x08,
  kAttachment = 0x09,
  kAttachmentIndex = 0x0A,
  kStatistics = 0x0B,
  kMetadata = 0x0C,
  kMetadataIndex = 0x0D,
  kSummaryOffset = 0x0E,
  kDataEnd = 0x0F,
};

inline constexpr std::size_t kRecordHead = 9;  // opcode and length

}  // namespace holdfast::log
