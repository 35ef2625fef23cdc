// SPDX-License-Identifier: Apache-2.0
#include "toolchain/log/mcap_writer.hpp"

#include <zlib.h>

#include <algorithm>
#include <concepts>

namespace holdfast::log {
namespace {

using Buffer = std::vector<std::uint8_t>;

// The C++ library's default. A picture of 8 megapixels fills it, and what is read for one message stays small.
constexpr std::size_t kChunkBytes = 768 * 1024;

void add_number(Buffer& to, std::unsigned_integral auto value) {
  for (std::size_t i = 0; i < sizeof value; ++i) {
    to.push_back(static_cast<std::uint8_t>(static_cast<std::uint64_t>(value) >> (8 * i)));
  }
}

void add_bytes(Buffer& to, std::span<const std::uint8_t> bytes) {
  to.insert(to.end(), bytes.begin(), bytes.end());
}

std::uint32_t sum(std::uint32_t before, std::span<const std::uint8_t> bytes) {
  return static_cast<std::uint32_t>(::crc32_z(before, bytes.data(), bytes.size()));
}

void add_text(Buffer& to, std::string_view text) {
  add_number(to, static_cast<std::uint32_t>(text.size()));
  to.insert(to.end(), text.begin(), text.end());
}

// A map or an array of pairs of numbers, behind its length in bytes.
void add_pairs(Buffer& to, const auto& pairs) {
  Buffer content;
  for (const auto& [first, second] : pairs) {
    add_number(content, first);
    add_number(content, second);
  }
  add_number(to, static_cast<std::uint32_t>(content.size()));
  add_bytes(to, content);
}

Buffer record(Op op, const Buffer& content) {
  Buffer out{static_cast<std::uint8_t>(op)};
  add_number(out, std::uint64_t{content.size()});
  add_bytes(out, content);
  return out;
}

}  // namespace

void McapWriter::TimeSpan::add(std::uint64_t time_ns, bool is_first) {
  first = is_first ? time_ns : std::min(first, time_ns);
  last = is_first ? time_ns : std::max(last, time_ns);
}

McapWriter::McapWriter(std::ostream& out) : out_(out) {
  put(kMcapMagic);
  Buffer header;
  add_text(header, "ros2");
  add_text(header, "holdfast");
  put(record(Op::kHeader, header));
  mark();
}

std::uint16_t McapWriter::add_channel(std::string_view topic, std::string_view schema, std::string_view schema_text) {
  const auto [known, is_new] = ids_.try_emplace(std::string(schema), static_cast<std::uint16_t>(ids_.size() + 1));
  const std::uint16_t schema_id = known->second;
  if (is_new) {
    Buffer content;
    add_number(content, schema_id);
    add_text(content, schema);
    add_text(content, "ros2msg");
    add_text(content, schema_text);
    schemas_.push_back(record(Op::kSchema, content));
    add_bytes(chunk_, schemas_.back());
  }
  const auto id = static_cast<std::uint16_t>(channels_.size());
  Buffer content;
  add_number(content, id);
  add_number(content, schema_id);
  add_text(content, topic);
  add_text(content, "cdr");
  add_number(content, std::uint32_t{0});  // metadata
  channels_.push_back(record(Op::kChannel, content));
  add_bytes(chunk_, channels_.back());
  counts_[id] = 0;
  return id;
}

void McapWriter::write(std::uint16_t channel, std::uint32_t sequence, std::uint64_t time_ns,
                       std::span<const std::uint8_t> data) {
  chunk_span_.add(time_ns, index_.empty());
  span_.add(time_ns, messages_ == 0);
  index_[channel].emplace_back(time_ns, chunk_.size());
  chunk_.push_back(static_cast<std::uint8_t>(Op::kMessage));
  add_number(chunk_, std::uint64_t{2 + 4 + 8 + 8 + data.size()});
  add_number(chunk_, channel);
  add_number(chunk_, sequence);
  add_number(chunk_, time_ns);  // logged
  add_number(chunk_, time_ns);  // published
  add_bytes(chunk_, data);
  ++counts_[channel];
  ++messages_;
  if (chunk_.size() >= kChunkBytes) flush_chunk();
}

void McapWriter::flush_chunk() {
  if (chunk_.empty()) return;
  Buffer head;
  add_number(head, chunk_span_.first);
  add_number(head, chunk_span_.last);
  add_number(head, std::uint64_t{chunk_.size()});
  add_number(head, sum(0, chunk_));
  add_text(head, "");  // no compression
  add_number(head, std::uint64_t{chunk_.size()});

  const std::uint64_t start = position_;
  Buffer before{static_cast<std::uint8_t>(Op::kChunk)};
  add_number(before, std::uint64_t{head.size() + chunk_.size()});
  put(before);
  put(head);
  put(chunk_);
  const std::uint64_t length = position_ - start;

  std::map<std::uint16_t, std::uint64_t> index_offsets;
  for (const auto& [channel, entries] : index_) {
    index_offsets[channel] = position_;
    Buffer content;
    add_number(content, channel);
    add_pairs(content, entries);
    put(record(Op::kMessageIndex, content));
  }

  Buffer index;
  add_number(index, chunk_span_.first);
  add_number(index, chunk_span_.last);
  add_number(index, start);
  add_number(index, length);
  add_pairs(index, index_offsets);
  add_number(index, position_ - start - length);
  add_text(index, "");
  add_number(index, std::uint64_t{chunk_.size()});  // compressed
  add_number(index, std::uint64_t{chunk_.size()});
  chunk_indexes_.push_back(record(Op::kChunkIndex, index));

  chunk_.clear();
  index_.clear();
  chunk_span_ = {};
  mark();
}

void McapWriter::mark() {
  if (!out_.flush()) return;
  if (marks_.size() == kMarks) marks_.pop_front();
  marks_.push_back({position_, crc_, schemas_.size(), channels_.size(), chunk_indexes_.size(), metadata_indexes_.size(),
                    counts_, messages_, span_});
}

std::optional<std::uint64_t> McapWriter::step_back() {
  if (marks_.empty() || marks_.back().messages == 0) return std::nullopt;
  const Mark to = std::move(marks_.back());
  marks_.pop_back();
  position_ = to.position;
  crc_ = to.crc;
  schemas_.resize(to.schemas);
  channels_.resize(to.channels);
  chunk_indexes_.resize(to.chunks);
  metadata_indexes_.resize(to.metadata);
  counts_ = to.counts;
  messages_ = to.messages;
  span_ = to.span;
  chunk_.clear();
  index_.clear();
  chunk_span_ = {};
  return position_;
}

void McapWriter::add_metadata(std::string_view name, const std::map<std::string, std::string>& entries) {
  flush_chunk();
  Buffer pairs;
  for (const auto& [key, value] : entries) {
    add_text(pairs, key);
    add_text(pairs, value);
  }
  Buffer content;
  add_text(content, name);
  add_number(content, static_cast<std::uint32_t>(pairs.size()));
  add_bytes(content, pairs);
  const std::uint64_t start = position_;
  put(record(Op::kMetadata, content));
  Buffer index;
  add_number(index, start);
  add_number(index, position_ - start);
  add_text(index, name);
  metadata_indexes_.push_back(record(Op::kMetadataIndex, index));
}

void McapWriter::finish() {
  flush_chunk();
  Buffer data_end;
  add_number(data_end, crc_);
  put(record(Op::kDataEnd, data_end));

  const std::uint64_t summary_start = position_;
  crc_ = 0;
  Buffer statistics;
  add_number(statistics, messages_);
  add_number(statistics, static_cast<std::uint16_t>(schemas_.size()));
  add_number(statistics, static_cast<std::uint32_t>(channels_.size()));
  add_number(statistics, std::uint32_t{0});  // attachments
  add_number(statistics, static_cast<std::uint32_t>(metadata_indexes_.size()));
  add_number(statistics, static_cast<std::uint32_t>(chunk_indexes_.size()));
  add_number(statistics, span_.first);
  add_number(statistics, span_.last);
  add_pairs(statistics, counts_);

  Buffer offsets;
  const auto put_group = [&](Op op, std::span<const Buffer> records) {
    if (records.empty()) return;
    const std::uint64_t start = position_;
    for (const Buffer& one : records) put(one);
    Buffer content{static_cast<std::uint8_t>(op)};
    add_number(content, start);
    add_number(content, position_ - start);
    add_bytes(offsets, record(Op::kSummaryOffset, content));
  };
  put_group(Op::kSchema, schemas_);
  put_group(Op::kChannel, channels_);
  const Buffer counted = record(Op::kStatistics, statistics);
  put_group(Op::kStatistics, {&counted, 1});
  put_group(Op::kChunkIndex, chunk_indexes_);
  put_group(Op::kMetadataIndex, metadata_indexes_);
  const std::uint64_t offsets_start = position_;
  put(offsets);

  // The sum ends with the two numbers of the footer that stand before it.
  Buffer footer{static_cast<std::uint8_t>(Op::kFooter)};
  add_number(footer, std::uint64_t{8 + 8 + 4});
  add_number(footer, summary_start);
  add_number(footer, offsets_start);
  put(footer);
  Buffer end;
  add_number(end, crc_);
  put(end);
  put(kMcapMagic);
}

void McapWriter::put(std::span<const std::uint8_t> bytes) {
  out_.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  crc_ = sum(crc_, bytes);
  position_ += bytes.size();
}

}  // namespace holdfast::log
