// SPDX-License-Identifier: Apache-2.0
// Writes an MCAP file of ROS 2 messages, for Foxglove, PlotJuggler, Rerun and `ros2 bag`.
//
// Profile "ros2": schemas are texts of .msg files (ros2msg), messages are CDR. Uncompressed, because nearly all of it
// is JPEG, with every check sum and index that the format has. Nothing is ever read back or written again, so any
// stream will do; memory is one chunk and 100 bytes for each chunk written. Whether the stream took it all is for its
// owner to ask: step_back() says how a file whose disk is full can still be ended. Not for attachments.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <ostream>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "toolchain/log/mcap_format.hpp"

namespace holdfast::log {

class McapWriter {
 public:
  explicit McapWriter(std::ostream& out);

  // `schema`: "package/msg/Type". Channels of one schema share it by name.
  [[nodiscard]] std::uint16_t add_channel(std::string_view topic, std::string_view schema,
                                          std::string_view schema_text);
  void write(std::uint16_t channel, std::uint32_t sequence, std::uint64_t time_ns, std::span<const std::uint8_t> data);
  // What is to be known of the whole file, under names; the tool of MCAP and Foxglove show it.
  void add_metadata(std::string_view name, const std::map<std::string, std::string>& entries);
  // Once, after the last message, and again after each step_back().
  void finish();
  // After a write that failed: takes back what stands behind the last whole chunk, with each further call one chunk
  // more, and says how long the file is without. The stream's owner cuts it there and calls finish(), which needs some
  // of the space that was given back; when that fails as well, from the start. Nothing: no message would be left.
  [[nodiscard]] std::optional<std::uint64_t> step_back();
  // Messages of the channel, those in the chunk that is not written yet included.
  [[nodiscard]] std::uint64_t count(std::uint16_t channel) const { return counts_.at(channel); }

 private:
  struct TimeSpan {
    std::uint64_t first = 0;
    std::uint64_t last = 0;
    void add(std::uint64_t time_ns, bool is_first);
  };
  // (channel, time, offset in the chunk)
  using Index = std::map<std::uint16_t, std::vector<std::pair<std::uint64_t, std::uint64_t>>>;

  // The file up to the end of a chunk, all of which the stream took.
  struct Mark {
    std::uint64_t position = 0;
    std::uint32_t crc = 0;
    std::size_t schemas = 0, channels = 0, chunks = 0, metadata = 0;
    std::map<std::uint16_t, std::uint64_t> counts;
    std::uint64_t messages = 0;
    TimeSpan span;
  };
  static constexpr std::size_t kMarks = 64;  // 48 MB, of which a summary may need

  void flush_chunk();
  void mark();
  void put(std::span<const std::uint8_t> bytes);

  std::ostream& out_;
  std::uint64_t position_ = 0;
  std::uint32_t crc_ = 0;                     // of the data section, then of the summary
  std::map<std::string, std::uint16_t> ids_;  // of schemas, by name
  std::vector<std::vector<std::uint8_t>> schemas_, channels_, chunk_indexes_,
      metadata_indexes_;                           // records, for the summary
  std::map<std::uint16_t, std::uint64_t> counts_;  // messages of each channel
  std::uint64_t messages_ = 0;
  TimeSpan span_;
  std::vector<std::uint8_t> chunk_;
  Index index_;
  TimeSpan chunk_span_;
  std::deque<Mark> marks_;  // the last ones
};

}  // namespace holdfast::log
