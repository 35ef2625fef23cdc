// SPDX-License-Identifier: Apache-2.0
#include "toolchain/log/mcap_reader.hpp"

#include <zlib.h>

#include <algorithm>
#include <concepts>
#include <optional>
#include <set>
#include <utility>

#include "toolchain/log/mcap_format.hpp"

namespace holdfast::log {
namespace {

using Bytes = std::span<const std::uint8_t>;

std::uint32_t sum_of(Bytes bytes) {
  return static_cast<std::uint32_t>(::crc32_z(0, bytes.data(), bytes.size()));
}

// Takes a record's content apart. After something that does not fit in it is not ok() and gives zeros.
class Content {
 public:
  explicit Content(Bytes bytes) : rest_(bytes) {}

  [[nodiscard]] bool ok() const { return ok_; }
  // Everything was taken, and all of it was there. Later versions may add fields at the end of a record.
  [[nodiscard]] Bytes rest() { return std::exchange(rest_, {}); }

  template <std::unsigned_integral T>
  T number() {
    const Bytes bytes = take(sizeof(T));
    T value = 0;
    for (std::size_t i = bytes.size(); i-- > 0;) value = static_cast<T>(std::uint64_t{value} << 8 | bytes[i]);
    return value;
  }
  std::string_view text() {
    const Bytes bytes = take(number<std::uint32_t>());
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
  }
  Bytes take(std::uint64_t size) {
    ok_ = ok_ && size <= rest_.size();
    if (!ok_) return {};
    const Bytes taken = rest_.first(static_cast<std::size_t>(size));
    rest_ = rest_.subspan(taken.size());
    return taken;
  }
  // An array or map of two numbers, behind its length in bytes.
  template <typename A, typename B>
  std::vector<std::pair<A, B>> pairs() {
    Content inside(take(number<std::uint32_t>()));
    std::vector<std::pair<A, B>> out;
    while (inside.ok() && !inside.rest_.empty()) {
      const A first = inside.number<A>();
      const B second = inside.number<B>();
      if (inside.ok()) out.emplace_back(first, second);
    }
    ok_ = ok_ && inside.ok();
    return out;
  }

 private:
  Bytes rest_;
  bool ok_ = true;
};

struct Record {
  std::uint64_t at = 0;  // in the file
  std::uint8_t op = 0;
  Bytes content;
  [[nodiscard]] std::uint64_t end() const { return at + kRecordHead + content.size(); }
  [[nodiscard]] bool is(Op o) const { return op == static_cast<std::uint8_t>(o); }
};

std::optional<Record> next_record(Bytes bytes, std::uint64_t at) {
  Content head(bytes.subspan(std::min(static_cast<std::size_t>(at), bytes.size())));
  Record record{at, head.number<std::uint8_t>(), {}};
  record.content = head.take(head.number<std::uint64_t>());
  if (!head.ok()) return std::nullopt;
  return record;
}

class Reading {
 public:
  Reading(Bytes bytes, const McapVisit& each) : bytes_(bytes), each_(each) {}

  McapFile read() {
    if (!is_mcap(bytes_)) {
      fault(0, "no MCAP file: its first bytes are others");
      return std::move(file_);
    }
    std::uint64_t at = kMcapMagic.size();
    while (part_ != Part::kEnd) {
      const std::optional<Record> record = next_record(bytes_, at);
      if (!record) {
        fault(at, "the file breaks off");
        return std::move(file_);
      }
      take(*record);
      at = record->end();
    }
    const Bytes rest = bytes_.subspan(static_cast<std::size_t>(at));
    if (!is_mcap(rest) || rest.size() != kMcapMagic.size()) {
      fault(at, "the file does not end with MCAP's last bytes");
      return std::move(file_);
    }
    file_.whole = true;
    return std::move(file_);
  }

 private:
  enum class Part : std::uint8_t { kStart, kData, kSummary, kEnd };

  struct Chunk {
    std::uint64_t at = 0, end = 0;
    std::uint64_t first_ns = 0, last_ns = 0;  // as it says
    std::uint64_t stored = 0, size = 0;       // bytes, compressed or not
    std::string_view compression;
    bool read = false;
    McapFile::Told told;                                                                    // what is in it
    std::map<std::uint16_t, std::vector<std::pair<std::uint64_t, std::uint64_t>>> entries;  // likewise; time, offset
    std::map<std::uint16_t, std::uint64_t> indexes;                                         // channel, where it is
    std::uint64_t indexes_end = 0;
  };

  void fault(std::uint64_t at, std::string what) {
    if (file_.faults.size() < McapFile::kMostFaults) file_.faults.push_back({at, std::move(what)});
  }
  void expect(bool good, std::uint64_t at, const char* what) {
    if (!good) fault(at, what);
  }

  void take(const Record& record) {
    if (part_ == Part::kStart) {
      expect(record.is(Op::kHeader), record.at, "the first record is no header");
      part_ = Part::kData;
      if (record.is(Op::kHeader)) return take_header(record);
    }
    if (!record.is(Op::kMessageIndex)) end_indexes(record.at);
    Content content(record.content);
    const bool in_data = part_ == Part::kData;
    switch (static_cast<Op>(record.op)) {
      case Op::kSchema:
        take_schema(record, content);
        break;
      case Op::kChannel:
        take_channel(record, content);
        break;
      case Op::kMessage:
        take_message(record, content);
        break;
      case Op::kChunk:
        take_chunk(record, content);
        break;
      case Op::kMessageIndex:
        take_message_index(record, content);
        break;
      case Op::kAttachment:
        take_attachment(record, content);
        break;
      case Op::kMetadata:
        must_be_in(Part::kData, record);
        (void)content.text();
        (void)content.take(content.number<std::uint32_t>());
        metadata_[record.at] = record.end() - record.at;
        break;
      case Op::kDataEnd:
        take_data_end(record, content);
        break;
      case Op::kChunkIndex:
        take_chunk_index(record, content);
        break;
      case Op::kAttachmentIndex:
        check_place(record, content, attachments_, "an index of an attachment that is not there");
        break;
      case Op::kMetadataIndex:
        check_place(record, content, metadata_, "an index of metadata that is not there");
        break;
      case Op::kStatistics:
        take_statistics(record, content);
        break;
      case Op::kSummaryOffset:
        take_summary_offset(record, content);
        break;
      case Op::kFooter:
        take_footer(record, content);
        break;
      default:  // of a later version, or somebody's own
        expect(record.op != 0 && !record.is(Op::kHeader), record.at, "a record of a kind that cannot be here");
    }
    expect(content.ok(), record.at, "a record is shorter than its fields");
    // After DataEnd itself the summary has begun.
    if (!in_data && part_ == Part::kSummary && !record.is(Op::kSummaryOffset)) {
      if (groups_.empty() || groups_.back().op != record.op) groups_.push_back({record.op, record.at, 0});
      groups_.back().length = record.end() - groups_.back().start;
    }
  }

  void must_be_in(Part part, const Record& record) {
    expect(part_ == part, record.at,
           part == Part::kData ? "a record of the data behind their end" : "a record of the summary among the data");
  }

  void take_header(const Record& record) {
    Content content(record.content);
    file_.profile = content.text();
    file_.library = content.text();
    expect(content.ok(), record.at, "a record is shorter than its fields");
  }

  void take_schema(const Record& record, Content& content) {
    const auto id = content.number<std::uint16_t>();
    McapSchema schema{content.text(), content.text(), {}};
    schema.text = content.text();
    if (!content.ok()) return;
    expect(id != 0, record.at, "a schema with the number 0");
    const auto known = file_.schemas.find(id);
    if (known != file_.schemas.end()) {
      expect(known->second == schema, record.at, "a schema that differs from the one before of its number");
      return;
    }
    expect(part_ == Part::kData, record.at, "a schema that only the summary has");
    file_.schemas[id] = schema;
  }

  void take_channel(const Record& record, Content& content) {
    const auto id = content.number<std::uint16_t>();
    McapChannel channel;
    channel.schema = content.number<std::uint16_t>();
    channel.topic = content.text();
    channel.encoding = content.text();
    channel.metadata = content.text();
    if (!content.ok()) return;
    expect(channel.schema == 0 || file_.schemas.contains(channel.schema), record.at,
           "a channel whose schema is not there");
    const auto known = file_.channels.find(id);
    if (known != file_.channels.end()) {
      expect(known->second == channel, record.at, "a channel that differs from the one before of its number");
      return;
    }
    expect(part_ == Part::kData, record.at, "a channel that only the summary has");
    file_.channels[id] = channel;
  }

  // The message, when all of it is there.
  std::optional<McapMessage> take_message(const Record& record, Content& content) {
    must_be_in(Part::kData, record);
    McapMessage message;
    message.channel = content.number<std::uint16_t>();
    message.sequence = content.number<std::uint32_t>();
    message.logged_ns = content.number<std::uint64_t>();
    message.published_ns = content.number<std::uint64_t>();
    if (!content.ok()) return std::nullopt;
    message.data = content.rest();
    if (!file_.channels.contains(message.channel)) {
      fault(record.at, "a message whose channel is not there");
      return std::nullopt;
    }
    file_.told[message.channel].add(message.logged_ns);
    file_.all.add(message.logged_ns);
    if (each_) each_(file_, message);
    return message;
  }

  void take_chunk(const Record& record, Content& content) {
    must_be_in(Part::kData, record);
    Chunk chunk;
    chunk.at = record.at;
    chunk.end = chunk.indexes_end = record.end();
    chunk.first_ns = content.number<std::uint64_t>();
    chunk.last_ns = content.number<std::uint64_t>();
    chunk.size = content.number<std::uint64_t>();
    const auto sum = content.number<std::uint32_t>();
    chunk.compression = content.text();
    const Bytes records = content.take(content.number<std::uint64_t>());
    if (!content.ok()) return;
    chunk.stored = records.size();
    ++file_.chunks;
    if (!chunk.compression.empty()) {
      fault(record.at, "a chunk that is compressed, which is not read here");
    } else if (records.size() != chunk.size) {
      fault(record.at, "a chunk that is not as long as it says");
    } else if (sum != 0 && sum_of(records) != sum) {
      fault(record.at, "a chunk whose check sum is not that of its bytes");
    } else {
      read_chunk(chunk, records);
    }
    chunks_[chunk.at] = std::move(chunk);
    last_chunk_ = &chunks_[record.at];
  }

  void read_chunk(Chunk& chunk, Bytes records) {
    const auto base = static_cast<std::uint64_t>(records.data() - bytes_.data());
    std::uint64_t offset = 0;
    while (offset < records.size()) {
      std::optional<Record> record = next_record(records, offset);
      if (!record) return fault(base + offset, "a chunk whose last record is not whole");
      record->at += base;
      Content content(record->content);
      if (record->is(Op::kSchema)) {
        take_schema(*record, content);
      } else if (record->is(Op::kChannel)) {
        take_channel(*record, content);
      } else if (record->is(Op::kMessage)) {
        if (const auto message = take_message(*record, content)) {
          chunk.told.add(message->logged_ns);
          chunk.entries[message->channel].emplace_back(message->logged_ns, offset);
        }
      } else {
        expect(record->op > static_cast<std::uint8_t>(Op::kDataEnd), record->at, "a record that no chunk may hold");
      }
      expect(content.ok(), record->at, "a record is shorter than its fields");
      offset = record->end() - base;
    }
    for (auto& [channel, entries] : chunk.entries) std::sort(entries.begin(), entries.end());
    chunk.read = true;
    expect(chunk.told.first_ns == chunk.first_ns && chunk.told.last_ns == chunk.last_ns, chunk.at,
           "a chunk whose times are not those of its messages");
  }

  void take_message_index(const Record& record, Content& content) {
    must_be_in(Part::kData, record);
    const auto channel = content.number<std::uint16_t>();
    auto entries = content.pairs<std::uint64_t, std::uint64_t>();
    if (!content.ok()) return;
    if (last_chunk_ == nullptr) return fault(record.at, "an index of messages that no chunk stands before");
    Chunk& chunk = *last_chunk_;
    chunk.indexes_end = record.end();
    if (!chunk.indexes.try_emplace(channel, record.at).second) {
      return fault(record.at, "a second index of one channel");
    }
    if (!chunk.read) return;
    std::sort(entries.begin(), entries.end());
    expect(entries == chunk.entries[channel], record.at, "an index that is not that of the messages in the chunk");
  }

  // Behind the indexes of a chunk: there are none, or one for each channel that has messages in it.
  void end_indexes(std::uint64_t at) {
    if (last_chunk_ == nullptr) return;
    const Chunk& chunk = *std::exchange(last_chunk_, nullptr);
    if (chunk.indexes.empty()) return;
    for (const auto& [channel, entries] : chunk.entries) {
      expect(entries.empty() || chunk.indexes.contains(channel), at, "a channel of the chunk before has no index");
    }
  }

  void take_attachment(const Record& record, Content& content) {
    must_be_in(Part::kData, record);
    (void)content.take(8 + 8);  // times
    (void)content.text();       // name
    (void)content.text();       // kind
    (void)content.take(content.number<std::uint64_t>());
    const auto sum = content.number<std::uint32_t>();
    if (!content.ok()) return;
    attachments_[record.at] = record.end() - record.at;
    const std::size_t summed = record.content.size() - content.rest().size() - 4;
    expect(sum == 0 || sum_of(record.content.first(summed)) == sum, record.at,
           "an attachment whose check sum is not that of its bytes");
  }

  void take_data_end(const Record& record, Content& content) {
    must_be_in(Part::kData, record);
    const auto sum = content.number<std::uint32_t>();
    expect(sum == 0 || sum_of(bytes_.first(static_cast<std::size_t>(record.at))) == sum, record.at,
           "the data's check sum is not that of their bytes");
    part_ = Part::kSummary;
    summary_start_ = record.end();
  }

  void take_chunk_index(const Record& record, Content& content) {
    must_be_in(Part::kSummary, record);
    const auto first_ns = content.number<std::uint64_t>();
    const auto last_ns = content.number<std::uint64_t>();
    const auto at = content.number<std::uint64_t>();
    const auto length = content.number<std::uint64_t>();
    const auto indexes = content.pairs<std::uint16_t, std::uint64_t>();
    const auto indexes_length = content.number<std::uint64_t>();
    const std::string_view compression = content.text();
    const auto stored = content.number<std::uint64_t>();
    const auto size = content.number<std::uint64_t>();
    if (!content.ok()) return;
    const auto found = chunks_.find(at);
    if (found == chunks_.end()) return fault(record.at, "an index of a chunk that is not there");
    const Chunk& chunk = found->second;
    expect(indexed_.insert(at).second, record.at, "a second index of one chunk");
    const bool same = first_ns == chunk.first_ns && last_ns == chunk.last_ns && length == chunk.end - chunk.at &&
                      compression == chunk.compression && stored == chunk.stored && size == chunk.size;
    expect(same, record.at, "an index that is not that of its chunk");
    const std::map<std::uint16_t, std::uint64_t> places(indexes.begin(), indexes.end());
    expect(
        places == chunk.indexes && places.size() == indexes.size() && indexes_length == chunk.indexes_end - chunk.end,
        record.at, "an index that is not that of the chunk's indexes");
  }

  void check_place(const Record& record, Content& content, const std::map<std::uint64_t, std::uint64_t>& places,
                   const char* what) {
    must_be_in(Part::kSummary, record);
    const auto at = content.number<std::uint64_t>();
    const auto length = content.number<std::uint64_t>();
    if (!content.ok()) return;
    const auto found = places.find(at);
    expect(found != places.end() && found->second == length, record.at, what);
  }

  void take_statistics(const Record& record, Content& content) {
    must_be_in(Part::kSummary, record);
    expect(!std::exchange(counted_, true), record.at, "a second record of counts");
    const auto messages = content.number<std::uint64_t>();
    const auto schemas = content.number<std::uint16_t>();
    const auto channels = content.number<std::uint32_t>();
    const auto attachments = content.number<std::uint32_t>();
    const auto metadata = content.number<std::uint32_t>();
    const auto chunks = content.number<std::uint32_t>();
    const auto first_ns = content.number<std::uint64_t>();
    const auto last_ns = content.number<std::uint64_t>();
    const auto by_channel = content.pairs<std::uint16_t, std::uint64_t>();
    if (!content.ok()) return;
    std::map<std::uint16_t, std::uint64_t> told;
    for (const auto& [channel, of_channel] : file_.told) told[channel] = of_channel.messages;
    bool good = messages == file_.all.messages && schemas == file_.schemas.size() &&
                channels == file_.channels.size() && attachments == attachments_.size() &&
                metadata == metadata_.size() && chunks == file_.chunks && first_ns == file_.all.first_ns &&
                last_ns == file_.all.last_ns;
    for (const auto& [channel, count] : by_channel) {
      const auto found = told.find(channel);
      good = good && count == (found != told.end() ? found->second : 0);
      if (found != told.end()) told.erase(found);
    }
    expect(good && told.empty(), record.at, "the counts are not those of the file");
  }

  void take_summary_offset(const Record& record, Content& content) {
    must_be_in(Part::kSummary, record);
    const auto op = content.number<std::uint8_t>();
    const auto start = content.number<std::uint64_t>();
    const auto length = content.number<std::uint64_t>();
    if (offsets_start_ == 0) offsets_start_ = record.at;
    if (!content.ok()) return;
    if (groups_by_start_.empty()) {
      for (const Group& group : groups_) groups_by_start_[group.start] = group;
    }
    const auto found = groups_by_start_.find(start);
    expect(found != groups_by_start_.end() && found->second.op == op && found->second.length == length, record.at,
           "an offset of a group that is not there");
  }

  void take_footer(const Record& record, Content& content) {
    must_be_in(Part::kSummary, record);
    const auto start = content.number<std::uint64_t>();
    const auto offsets = content.number<std::uint64_t>();
    const auto sum = content.number<std::uint32_t>();
    const bool has_summary = part_ == Part::kSummary && summary_start_ != record.at;
    part_ = Part::kEnd;
    if (!content.ok()) return;
    // Readers look for it at its distance from the end.
    expect(record.content.size() == 8 + 8 + 4, record.at, "a footer of another length");
    const std::uint64_t summed_end = record.at + kRecordHead + 8 + 8;
    const Bytes summed =
        bytes_.subspan(static_cast<std::size_t>(summary_start_), static_cast<std::size_t>(summed_end - summary_start_));
    expect(start == (has_summary ? summary_start_ : 0), record.at, "the footer has another place for the summary");
    expect(offsets == 0 || offsets == offsets_start_, record.at, "the footer has another place for the offsets");
    expect(sum == 0 || sum_of(summed) == sum, record.at, "the summary's check sum is not that of its bytes");
    expect(indexed_.empty() || indexed_.size() == chunks_.size(), record.at, "a chunk has no index");
  }

  struct Group {
    std::uint8_t op = 0;
    std::uint64_t start = 0, length = 0;
  };

  Bytes bytes_;
  const McapVisit& each_;
  McapFile file_;
  Part part_ = Part::kStart;
  std::map<std::uint64_t, Chunk> chunks_;
  Chunk* last_chunk_ = nullptr;                         // whose indexes may follow
  std::map<std::uint64_t, std::uint64_t> attachments_;  // where, how long
  std::map<std::uint64_t, std::uint64_t> metadata_;     // likewise
  std::set<std::uint64_t> indexed_;
  std::uint64_t summary_start_ = 0, offsets_start_ = 0;
  std::vector<Group> groups_;
  std::map<std::uint64_t, Group> groups_by_start_;
  bool counted_ = false;
};

}  // namespace

void McapFile::Told::add(std::uint64_t time_ns) {
  first_ns = messages == 0 ? time_ns : std::min(first_ns, time_ns);
  last_ns = messages == 0 ? time_ns : std::max(last_ns, time_ns);
  ++messages;
}

bool is_mcap(std::span<const std::uint8_t> bytes) {
  return bytes.size() >= kMcapMagic.size() && std::equal(kMcapMagic.begin(), kMcapMagic.end(), bytes.begin());
}

McapFile read_mcap(std::span<const std::uint8_t> bytes, const McapVisit& each) {
  return Reading(bytes, each).read();
}

}  // namespace holdfast::log
