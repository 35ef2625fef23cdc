// SPDX-License-Identifier: Apache-2.0
#include "toolchain/log/mcap_reader.hpp"

#include <zlib.h>

#include <algorithm>
#include <concepts>
#include <optional>
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

  void fault(std::uint64_t at, std::string what) {
    if (file_.faults.size() < McapFile::kMostFaults) file_.faults.push_back({at, std::move(what)});
  }
  void expect(bool good, std::uint64_t at, const char* what) {
    if (!good) fault(at, what);
  }

  void take(const Record& record) {
    Content content(record.content);
    if (part_ == Part::kStart) {
      expect(record.is(Op::kHeader), record.at, "the first record is no header");
      part_ = Part::kData;
      if (record.is(Op::kHeader)) {
        file_.profile = content.text();
        file_.library = content.text();
      }
    } else if (record.is(Op::kFooter)) {
      take_footer(record, content);
    } else if (part_ == Part::kData) {
      take_data(record, content);
    }  // the summary says again what the data said
    expect(content.ok(), record.at, "a record is shorter than its fields");
  }

  void take_data(const Record& record, Content& content) {
    switch (static_cast<Op>(record.op)) {
      case Op::kChunk:
        take_chunk(record, content);
        break;
      case Op::kDataEnd:
        take_data_end(record, content);
        break;
      default:
        take_record(record, content);
    }
  }

  // Of the data, or of a chunk in them. What is not read here is skipped: an index, an attachment, somebody's own.
  void take_record(const Record& record, Content& content) {
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
      default:
        expect(record.op != 0 && !record.is(Op::kHeader), record.at, "a record of a kind that cannot be here");
    }
  }

  void take_schema(const Record& record, Content& content) {
    const auto id = content.number<std::uint16_t>();
    McapSchema schema{content.text(), content.text(), {}};
    schema.text = content.text();
    if (!content.ok()) return;
    const auto [known, fresh] = file_.schemas.try_emplace(id, schema);
    expect(fresh || known->second == schema, record.at, "a schema that differs from the one before of its number");
  }

  void take_channel(const Record& record, Content& content) {
    const auto id = content.number<std::uint16_t>();
    McapChannel channel;
    channel.schema = content.number<std::uint16_t>();
    channel.topic = content.text();
    channel.encoding = content.text();
    (void)content.text();  // a map of texts
    if (!content.ok()) return;
    expect(channel.schema == 0 || file_.schemas.contains(channel.schema), record.at,
           "a channel whose schema is not there");
    const auto [known, fresh] = file_.channels.try_emplace(id, channel);
    expect(fresh || known->second == channel, record.at, "a channel that differs from the one before of its number");
  }

  void take_message(const Record& record, Content& content) {
    McapMessage message;
    message.channel = content.number<std::uint16_t>();
    message.sequence = content.number<std::uint32_t>();
    message.logged_ns = content.number<std::uint64_t>();
    message.published_ns = content.number<std::uint64_t>();
    if (!content.ok()) return;
    message.data = content.rest();
    if (!file_.channels.contains(message.channel)) return fault(record.at, "a message whose channel is not there");
    file_.told[message.channel].add(message.logged_ns);
    file_.all.add(message.logged_ns);
    if (each_) each_(file_, message);
  }

  void take_chunk(const Record& record, Content& content) {
    (void)content.take(8 + 8);  // times
    const auto size = content.number<std::uint64_t>();
    const auto sum = content.number<std::uint32_t>();
    const std::string_view compression = content.text();
    const Bytes records = content.take(content.number<std::uint64_t>());
    if (!content.ok()) return;
    ++file_.chunks;
    if (!compression.empty()) {
      fault(record.at, "a chunk that is compressed, which is not read here");
    } else if (records.size() != size) {
      fault(record.at, "a chunk that is not as long as it says");
    } else if (sum != 0 && sum_of(records) != sum) {
      fault(record.at, "a chunk whose check sum is not that of its bytes");
    } else {
      read_chunk(records);
    }
  }

  void read_chunk(Bytes records) {
    const auto base = static_cast<std::uint64_t>(records.data() - bytes_.data());
    std::uint64_t offset = 0;
    while (offset < records.size()) {
      std::optional<Record> record = next_record(records, offset);
      if (!record) return fault(base + offset, "a chunk whose last record is not whole");
      offset = record->end();
      record->at += base;
      Content content(record->content);
      take_record(*record, content);
      expect(content.ok(), record->at, "a record is shorter than its fields");
    }
  }

  void take_data_end(const Record& record, Content& content) {
    const auto sum = content.number<std::uint32_t>();
    expect(sum == 0 || sum_of(bytes_.first(static_cast<std::size_t>(record.at))) == sum, record.at,
           "the data's check sum is not that of their bytes");
    part_ = Part::kSummary;
    summary_start_ = record.end();
  }

  void take_footer(const Record& record, Content& content) {
    expect(part_ == Part::kSummary, record.at, "the data have no end");
    const auto start = content.number<std::uint64_t>();
    (void)content.number<std::uint64_t>();  // where the offsets into the summary are
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
    expect(sum == 0 || sum_of(summed) == sum, record.at, "the summary's check sum is not that of its bytes");
  }

  Bytes bytes_;
  const McapVisit& each_;
  McapFile file_;
  Part part_ = Part::kStart;
  std::uint64_t summary_start_ = 0;
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
