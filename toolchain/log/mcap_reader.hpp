// SPDX-License-Identifier: Apache-2.0
// Reads an MCAP file and checks every length and check sum in it. What leads there from the end, indexes and counts, is
// not read: who wrote the sums wrote them, too.
//
// One pass over the bytes, in order, so that a file which breaks off still gives what is whole before that. Any bytes
// will do: it never reads outside of them, ends after one pass, and keeps no more than a few times their size. Views
// point into the bytes. A chunk whose sum is wrong, or that is compressed (lz4, zstd: not read here), gives nothing.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace holdfast::log {

struct McapSchema {
  std::string_view name;
  std::string_view encoding;
  std::string_view text;
  friend bool operator==(const McapSchema&, const McapSchema&) = default;
};

struct McapChannel {
  std::uint16_t schema = 0;  // 0: none
  std::string_view topic;
  std::string_view encoding;
  friend bool operator==(const McapChannel&, const McapChannel&) = default;
};

struct McapMessage {
  std::uint16_t channel = 0;
  std::uint32_t sequence = 0;
  std::uint64_t logged_ns = 0;
  std::uint64_t published_ns = 0;
  std::span<const std::uint8_t> data;
};

struct McapFault {
  std::uint64_t at = 0;  // byte of the file
  std::string what;
};

struct McapFile {
  static constexpr std::size_t kMostFaults = 20;

  struct Told {
    std::uint64_t messages = 0;
    std::uint64_t first_ns = 0;
    std::uint64_t last_ns = 0;
    void add(std::uint64_t time_ns);
  };

  std::string_view profile;
  std::string_view library;
  std::map<std::uint16_t, McapSchema> schemas;
  std::map<std::uint16_t, McapChannel> channels;
  std::map<std::uint16_t, Told> told;  // by channel; those without messages are not in it
  Told all;
  std::uint64_t chunks = 0;
  bool whole = false;             // read to its end
  std::vector<McapFault> faults;  // the first ones; none: nothing is wrong
};

// Whether the bytes begin as an MCAP file does.
[[nodiscard]] bool is_mcap(std::span<const std::uint8_t> bytes);

// `each` gets every message that can be read, in the order of the file; its channel is known then.
using McapVisit = std::function<void(const McapFile&, const McapMessage&)>;
[[nodiscard]] McapFile read_mcap(std::span<const std::uint8_t> bytes, const McapVisit& each = {});

}  // namespace holdfast::log
