// SPDX-License-Identifier: Apache-2.0
// What must hold for any bytes that are given as an MCAP file, for libFuzzer (mcap_fuzz.cpp) and for the host tests;
// files that it starts from; and a second reader, which finds messages by the index alone.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <sstream>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

#include "toolchain/log/mcap_reader.hpp"
#include "toolchain/log/mcap_writer.hpp"
#include "toolchain/log/messages.hpp"

namespace holdfast::test {

using McapBytes = std::vector<std::uint8_t>;
// channel, sequence, time, bytes
using McapSeen = std::tuple<std::uint64_t, std::uint64_t, std::uint64_t, std::string>;

inline std::uint64_t mcap_number(std::span<const std::uint8_t> bytes, std::size_t at, int size) {
  std::uint64_t value = 0;
  for (int i = size - 1; i >= 0; --i) value = value * 256 + bytes[at + static_cast<std::size_t>(i)];
  return value;
}

inline void put_mcap_number(McapBytes& bytes, std::size_t at, std::uint64_t value, int size) {
  for (int i = 0; i < size; ++i) bytes[at++] = static_cast<std::uint8_t>(value >> (8 * i));
}

// Where the records are, of a file whose records follow each other to its end; those of chunks too.
struct McapPlace {
  int op = 0;
  std::size_t at = 0;       // of the opcode
  std::size_t content = 0;  // of what follows the length
  std::size_t size = 0;     // of that
};
inline std::vector<McapPlace> mcap_places(std::span<const std::uint8_t> bytes) {
  std::vector<McapPlace> places;
  std::size_t at = 8;
  while (bytes.size() >= at + 9) {
    const std::uint64_t size = mcap_number(bytes, at + 1, 8);
    if (size > bytes.size() - at - 9) break;
    places.push_back({bytes[at], at, at + 9, static_cast<std::size_t>(size)});
    const bool plain_chunk = bytes[at] == 6 && size >= 40 && mcap_number(bytes, at + 9 + 28, 4) == 0;
    at += 9 + (plain_chunk ? 40 : static_cast<std::size_t>(size));  // a chunk's records follow its head
  }
  return places;
}

// The same with all check sums left out, so that what is wrong gets past them.
inline McapBytes without_sums(McapBytes bytes) {
  for (const McapPlace& place : mcap_places(bytes)) {
    if (place.op == 0x06 && place.size >= 40) put_mcap_number(bytes, place.content + 24, 0, 4);
    if (place.op == 0x0F && place.size >= 4) put_mcap_number(bytes, place.content, 0, 4);
    if (place.op == 0x02 && place.size >= 20) put_mcap_number(bytes, place.content + 16, 0, 4);
  }
  return bytes;
}

// What the index leads to, of a file in which nothing is wrong: footer, indexes of chunks, indexes of messages.
inline std::vector<McapSeen> mcap_by_index(std::span<const std::uint8_t> bytes) {
  std::vector<McapSeen> seen;
  if (bytes.size() < 8 + 29 + 8 || mcap_number(bytes, bytes.size() - 36, 8) != 20) return seen;
  std::size_t at = mcap_number(bytes, bytes.size() - 28, 8);
  while (at != 0 && bytes[at] != 0x02) {
    const std::size_t content = at + 9;
    if (bytes[at] == 0x08) {
      const std::size_t chunk = mcap_number(bytes, content + 16, 8);
      const std::size_t records = chunk + 9 + 40;  // no name of a compression
      const std::size_t pairs = mcap_number(bytes, content + 32, 4);
      for (std::size_t i = content + 36; i < content + 36 + pairs; i += 10) {
        const std::size_t index = mcap_number(bytes, i + 2, 8) + 9;
        const std::size_t size = mcap_number(bytes, index + 2, 4);
        for (std::size_t k = index + 6; k < index + 6 + size; k += 16) {
          const std::size_t message = records + mcap_number(bytes, k + 8, 8);
          const std::size_t data = mcap_number(bytes, message + 1, 8) - 22;
          const auto* const first = reinterpret_cast<const char*>(bytes.data()) + message + 31;
          seen.emplace_back(mcap_number(bytes, message + 9, 2), mcap_number(bytes, message + 11, 4),
                            mcap_number(bytes, message + 15, 8), std::string(first, data));
        }
      }
    }
    at = content + mcap_number(bytes, at + 1, 8);
  }
  std::sort(seen.begin(), seen.end());
  return seen;
}

template <log::IsMessage T>
bool decodes_to_itself(std::span<const std::uint8_t> bytes) {
  const auto message = log::decode<T>(bytes);
  return !message || std::ranges::equal(log::encode(*message), bytes);
}

// A finding in words; empty: nothing to say.
//   * every message lies in the file, on a channel that is known; as many as are counted
//   * the same bytes say the same again; a fault lies in the file and has words
//   * where nothing is wrong, the file was read to its end
//   * bytes that are a message of ours are written the same again
inline std::string check_mcap_bytes(std::span<const std::uint8_t> bytes) {
  std::string finding;
  std::vector<McapSeen> seen;
  const log::McapFile file = log::read_mcap(bytes, [&](const log::McapFile& so_far, const log::McapMessage& m) {
    const bool inside = m.data.empty() ||
                        (m.data.data() >= bytes.data() && m.data.data() + m.data.size() <= bytes.data() + bytes.size());
    if (!inside) finding = "a message outside of the file";
    if (!so_far.channels.contains(m.channel)) finding = "a message of no channel";
    seen.emplace_back(m.channel, m.sequence, m.logged_ns, std::string(m.data.begin(), m.data.end()));
    if (!decodes_to_itself<log::FrameRecord>(m.data) || !decodes_to_itself<log::MarkerField>(m.data) ||
        !decodes_to_itself<log::CompressedImage>(m.data)) {
      finding = "a message that is written otherwise again";
    }
  });
  if (!finding.empty()) return finding;
  if (file.all.messages != seen.size()) return "another number of messages";
  const log::McapFile again = log::read_mcap(bytes);
  if (again.faults.size() != file.faults.size() || again.all.messages != file.all.messages) {
    return "read otherwise the second time";
  }
  for (const log::McapFault& fault : file.faults) {
    if (fault.what.empty() || fault.at > bytes.size()) return "a fault without words, or outside of the file";
  }
  if (!file.faults.empty()) return "";
  return file.whole ? "" : "broken off, and nothing is wrong";
}

// A small file: `messages` of two channels.
inline McapBytes small_mcap(int messages, std::string_view schema = "t/msg/A", std::string_view text = "uint8 a\n",
                            std::span<const std::uint8_t> data = {}) {
  std::ostringstream out;
  log::McapWriter writer(out);
  const std::uint16_t one = writer.add_channel("/one", schema, text);
  const std::uint16_t two = writer.add_channel("/two", schema, text);
  const McapBytes short_data{0, 1, 0, 0, 7};
  for (int i = 0; i < messages; ++i) {
    const auto k = static_cast<std::uint32_t>(i);
    writer.write(i % 3 == 0 ? two : one, k, 1000 + 40 * k, data.empty() ? std::span(short_data) : data);
  }
  writer.finish();
  const std::string bytes = out.str();
  return {bytes.begin(), bytes.end()};
}

// A file as other programs may write it: no index, no sums, records of kinds that ours does not have, messages outside
// of chunks.
inline McapBytes foreign_mcap() {
  McapBytes out{0x89, 'M', 'C', 'A', 'P', '0', '\r', '\n'};
  const auto record = [&](int op, std::string_view content) {
    out.push_back(static_cast<std::uint8_t>(op));
    const std::size_t length = out.size();
    out.insert(out.end(), 8, 0);
    bool quoted = false;
    for (std::size_t i = 0; i < content.size(); ++i) {
      if (content[i] == '\'') {
        quoted = !quoted;
      } else if (quoted) {
        out.push_back(static_cast<std::uint8_t>(content[i]));
      } else if (content[i] != ' ') {
        out.push_back(static_cast<std::uint8_t>(std::stoi(std::string(content.substr(i++, 2)), nullptr, 16)));
      }
    }
    put_mcap_number(out, length, out.size() - length - 8, 8);
  };
  // Numbers as they stand in the file, texts in quotation marks.
  record(0x01, "00000000 00000000");
  record(0x03, "0100 01000000'A' 07000000'ros2msg' 07000000'uint8 a'");
  record(0x04, "0500 0100 02000000'/a' 03000000'cdr' 00000000");
  record(0x05, "0500 01000000 0100000000000000 0200000000000000 0001000007");
  record(0x0C, "01000000'm' 00000000");
  record(0x09, "0000000000000000 0000000000000000 01000000'n' 01000000't' 0200000000000000'xy' 00000000");
  record(0x80, "'of somebody else'");
  record(0x0F, "00000000");
  record(0x02, "0000000000000000 0000000000000000 00000000");
  out.insert(out.end(), out.begin(), out.begin() + 8);
  return out;
}

// Files without and with messages, of our schemas and of others, and one that breaks off.
inline std::vector<McapBytes> mcap_seeds() {
  log::FrameRecord state;
  state.state_name = "OK";
  state.reason_name = "none";
  log::MarkerField markers;
  markers.row = markers.col = markers.valid = {0, 1};
  markers.x_px = markers.y_px = markers.dx_px = markers.dy_px = {1.5, -2};
  const McapBytes jpeg{0xFF, 0xD8, 0xFF, 0xD9};
  log::CompressedImage picture;
  picture.data = jpeg;
  std::vector<McapBytes> seeds{small_mcap(0), small_mcap(1), small_mcap(7), foreign_mcap()};
  const auto add = [&]<log::IsMessage T>(const T& message) {
    const McapBytes data = log::encode(message);
    seeds.push_back(small_mcap(2, log::schema_name<T>(), "uint8 a\n", data));
  };
  add(state);
  add(markers);
  add(picture);
  seeds.push_back(seeds[2]);
  seeds.back().resize(seeds.back().size() / 2);
  return seeds;
}

}  // namespace holdfast::test
