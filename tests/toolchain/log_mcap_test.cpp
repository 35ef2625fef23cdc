// SPDX-License-Identifier: Apache-2.0
// MCAP files, written and read. The oracles: what was written, a second reader that knows the index only
// (tests/fuzz/mcap_check.hpp). The official reader, which checks the sums, has its say in tests/npm/check_logs.sh.
#include "toolchain/log/mcap_reader.hpp"

#include <algorithm>
#include <map>
#include <numeric>
#include <ostream>
#include <random>
#include <streambuf>

#include "tests/fuzz/mcap_check.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast::log;
using holdfast::test::mcap_by_index;
using holdfast::test::mcap_places;
using holdfast::test::McapBytes;
using holdfast::test::McapPlace;
using holdfast::test::McapSeen;
using holdfast::test::small_mcap;
using holdfast::test::without_sums;

namespace {

std::vector<McapSeen> messages_of(const McapBytes& bytes, McapFile* file = nullptr) {
  std::vector<McapSeen> seen;
  const McapFile read = read_mcap(bytes, [&](const McapFile&, const McapMessage& m) {
    seen.emplace_back(m.channel, m.sequence, m.logged_ns, std::string(m.data.begin(), m.data.end()));
  });
  if (file != nullptr) *file = read;
  return seen;
}

// The first thing that is wrong; empty: nothing is.
std::string fault_of(const McapBytes& bytes) {
  const McapFile file = read_mcap(bytes);
  return file.faults.empty() ? "" : file.faults.front().what;
}

void check_fault(const char* expected, const McapBytes& bytes) {
  STRCMP_EQUAL(expected, fault_of(bytes).c_str());
}

// Beginnings of the content of all records of one kind.
std::vector<McapPlace> places_of(const McapBytes& bytes, Op op) {
  std::vector<McapPlace> out;
  for (const McapPlace& place : mcap_places(bytes)) {
    if (place.op == static_cast<int>(op)) out.push_back(place);
  }
  CHECK_TEXT(!out.empty(), "no such record");
  return out;
}

}  // namespace

TEST_GROUP(Mcap){};

TEST(Mcap, GivesBackWhatWasWritten) {
  std::mt19937 random(1);
  std::ostringstream out;
  McapWriter writer(out);
  std::vector<McapSeen> written;
  std::vector<std::uint16_t> channels;
  std::uint64_t time_ns = 5'000;
  for (std::uint32_t i = 0; i < 400; ++i) {
    if (i % 100 == 0) {  // also when others have messages already
      const std::string name = "/channel_" + std::to_string(i);
      channels.push_back(writer.add_channel(name, i < 200 ? "a/msg/A" : "a/msg/B", "uint8 a\n"));
    }
    // Some empty, some larger than a chunk.
    const std::size_t size = i % 97 == 5 ? 1'000'000 : random() % 20'000 * (i % 3);
    McapBytes data(size);
    for (auto& byte : data) byte = static_cast<std::uint8_t>(random());
    const std::uint16_t channel = channels[random() % channels.size()];
    time_ns += random() % 1'000'000'000;
    writer.write(channel, i, time_ns, data);
    written.emplace_back(channel, i, time_ns, std::string(data.begin(), data.end()));
  }
  writer.finish();
  const std::string text = out.str();
  const McapBytes bytes(text.begin(), text.end());
  McapFile file;
  CHECK(written == messages_of(bytes, &file));  // in order
  LONGS_EQUAL(0, file.faults.size());
  CHECK_TRUE(file.whole);
  CHECK(file.profile == "ros2" && file.library == "holdfast");
  LONGS_EQUAL(2, file.schemas.size());
  LONGS_EQUAL(4, file.channels.size());
  CHECK(file.channels.at(3).topic == "/channel_300" && file.schemas.at(file.channels.at(3).schema).name == "a/msg/B");
  CHECK(file.schemas.at(1).text == "uint8 a\n" && file.schemas.at(1).encoding == "ros2msg");
  CHECK_EQUAL(std::get<2>(written.front()), file.all.first_ns);
  CHECK_EQUAL(std::get<2>(written.back()), file.all.last_ns);
  // Chunks hold whole messages, and no more than fills one.
  const std::size_t total = std::accumulate(written.begin(), written.end(), std::size_t{0},
                                            [](std::size_t sum, const auto& m) { return sum + std::get<3>(m).size(); });
  CHECK(file.chunks >= 4 && file.chunks <= total / (768 * 1024) + 1);
  std::sort(written.begin(), written.end());
  CHECK(written == mcap_by_index(bytes));
}

TEST(Mcap, ReadsWhatOthersWrite) {
  McapFile file;
  const std::vector<McapSeen> seen = messages_of(holdfast::test::foreign_mcap(), &file);
  STRCMP_EQUAL("", fault_of(holdfast::test::foreign_mcap()).c_str());
  CHECK(file.whole);
  const std::vector<McapSeen> expected{{5, 1, 1, std::string("\0\1\0\0\7", 5)}};
  CHECK(expected == seen);
  STRCMP_EQUAL("", fault_of(small_mcap(0)).c_str());
  LONGS_EQUAL(0, messages_of(small_mcap(0)).size());
}

TEST(Mcap, NoticesEveryFlip) {
  const McapBytes good = small_mcap(7);
  STRCMP_EQUAL("", fault_of(good).c_str());
  for (std::size_t i = 0; i < good.size(); ++i) {
    for (const int flip : {0x01, 0x10, 0x80, 0xFF}) {
      McapBytes bad = good;
      bad[i] = static_cast<std::uint8_t>(bad[i] ^ flip);
      if (fault_of(bad).empty()) FAIL(("not noticed: byte " + std::to_string(i)).c_str());
      STRCMP_EQUAL("", holdfast::test::check_mcap_bytes(bad).c_str());
      // Nor does it bring anything down when no sum protects it.
      STRCMP_EQUAL("", holdfast::test::check_mcap_bytes(without_sums(bad)).c_str());
    }
  }
}

TEST(Mcap, GivesWhatStandsBeforeTheBreak) {
  const McapBytes good = small_mcap(7);
  const std::vector<McapSeen> all = messages_of(good);
  for (std::size_t size = 0; size < good.size(); ++size) {
    McapFile file;
    const std::vector<McapSeen> seen =
        messages_of(McapBytes(good.begin(), good.begin() + static_cast<long>(size)), &file);
    CHECK(!file.whole && !file.faults.empty());
    CHECK(seen.size() <= all.size() && std::equal(seen.begin(), seen.end(), all.begin()));
    const std::size_t chunk_end = places_of(good, Op::kMessageIndex).front().at;
    LONGS_EQUAL(size < chunk_end ? 0 : all.size(), seen.size());
  }
}

TEST(Mcap, LosesOnlyTheChunkThatIsDamaged) {
  std::ostringstream out;
  McapWriter writer(out);
  const std::uint16_t channel = writer.add_channel("/a", "a/msg/A", "uint8 a\n");
  const McapBytes data(800'000, 1);  // a chunk each
  for (std::uint32_t i = 0; i < 3; ++i) writer.write(channel, i, i, data);
  writer.finish();
  const std::string text = out.str();
  McapBytes bytes(text.begin(), text.end());
  const auto chunks = places_of(bytes, Op::kChunk);
  LONGS_EQUAL(3, chunks.size());
  bytes[chunks[1].content + 1000] = 2;
  McapFile file;
  const std::vector<McapSeen> seen = messages_of(bytes, &file);
  LONGS_EQUAL(2, seen.size());
  LONGS_EQUAL(2, std::get<1>(seen[1]));
  STRCMP_EQUAL("a chunk whose check sum is not that of its bytes", file.faults.front().what.c_str());
  CHECK_EQUAL(chunks[1].at, file.faults.front().at);
}

namespace {

// A disk of so many bytes.
class SmallDisk : public std::streambuf {
 public:
  explicit SmallDisk(std::size_t room) : room_(room) {}
  void cut(std::uint64_t length) {
    CHECK(length <= bytes.size());
    bytes.resize(length);
  }
  McapBytes bytes;

 protected:
  std::streamsize xsputn(const char* data, std::streamsize count) override {
    const std::size_t taken = std::min(static_cast<std::size_t>(count), room_ - bytes.size());
    bytes.insert(bytes.end(), data, data + taken);
    return static_cast<std::streamsize>(taken);
  }
  int_type overflow(int_type) override { return traits_type::eof(); }

 private:
  std::size_t room_;
};

}  // namespace

TEST(Mcap, EndsWholeOnADiskThatIsFull) {
  constexpr std::size_t kMessage = 300'000;  // three fill a chunk
  constexpr std::uint32_t kMessages = 12;
  const auto write_on = [](SmallDisk& disk) {
    std::ostream out(&disk);
    McapWriter writer(out);
    const std::uint16_t channel = writer.add_channel("/a", "a/msg/A", "uint8 a\n");
    std::uint32_t next = 0;
    for (; out && next < kMessages; ++next) writer.write(channel, next, next, McapBytes(kMessage, 7));
    if (out) {
      writer.add_metadata("holdfast", {{"source", "here"}});
      writer.finish();
    }
    const bool failed = !out;
    while (!out) {
      const auto length = writer.step_back();
      if (!length) return -1L;
      disk.cut(*length);
      out.clear();
      writer.add_metadata("holdfast", {{"source", "here"}});
      writer.finish();
      out.flush();
    }
    return failed ? static_cast<long>(writer.count(channel)) : static_cast<long>(kMessages);
  };
  SmallDisk large(100'000'000);
  LONGS_EQUAL(kMessages, write_on(large));
  const std::size_t whole = large.bytes.size();
  const auto check = [&](std::size_t room, long expected) {
    SmallDisk disk(room);
    LONGS_EQUAL(expected, write_on(disk));
    if (expected < 0) return;
    McapFile file;
    const std::vector<McapSeen> seen = messages_of(disk.bytes, &file);
    STRCMP_EQUAL("", fault_of(disk.bytes).c_str());
    CHECK(file.whole);
    LONGS_EQUAL(expected, seen.size());
    CHECK(seen == mcap_by_index(disk.bytes));
    LONGS_EQUAL(1, places_of(disk.bytes, Op::kMetadata).size());
    for (std::uint32_t i = 0; i < seen.size(); ++i) LONGS_EQUAL(i, std::get<1>(seen[i]));
  };
  check(whole, 12);
  check(whole - 1, 9);  // the end did not fit: a chunk makes room for it
  check(whole - 300, 9);
  check(3'000'000, 9);
  check(2'000'000, 6);
  check(1'000'000, 3);
  check(800'000, -1);
  check(0, -1);
  // Whatever is left behind a chunk, the file is whole.
  for (std::size_t room = 1'799'000; room < 1'803'000; room += 37) {
    SmallDisk disk(room);
    const long kept = write_on(disk);
    CHECK(kept == 3 || kept == 6);
    STRCMP_EQUAL("", fault_of(disk.bytes).c_str());
  }
}

TEST(Mcap, SaysWhatIsWrong) {
  const McapBytes good = without_sums(small_mcap(7));
  STRCMP_EQUAL("", fault_of(good).c_str());
  // Adds `by` to the byte `offset` bytes into the content of record `which` of a kind.
  const auto changed = [&](Op op, std::size_t which, std::size_t offset, int by = 1) {
    McapBytes bytes = good;
    const std::size_t at = places_of(bytes, op).at(which).content + offset;
    bytes[at] = static_cast<std::uint8_t>(bytes[at] + by);
    return bytes;
  };
  constexpr auto kKind = static_cast<std::size_t>(-9);
  check_fault("a chunk that is not as long as it says", changed(Op::kChunk, 0, 16));
  check_fault("a message whose channel is not there", changed(Op::kMessage, 0, 0, 9));
  check_fault("a channel whose schema is not there", changed(Op::kChannel, 0, 2, 5));
  check_fault("a channel that differs from the one before of its number", changed(Op::kChannel, 1, 0, -1));
  check_fault("a record of a kind that cannot be here", changed(Op::kMessageIndex, 0, kKind, -7));
  check_fault("the data have no end", changed(Op::kDataEnd, 0, kKind, -1));
  check_fault("the footer has another place for the summary", changed(Op::kFooter, 0, 0));
  // Sums that are there and wrong.
  check_fault("a chunk whose check sum is not that of its bytes", changed(Op::kChunk, 0, 24));
  check_fault("the data's check sum is not that of their bytes", changed(Op::kDataEnd, 0, 0));
  check_fault("the summary's check sum is not that of its bytes", changed(Op::kFooter, 0, 16));
}

TEST(Mcap, SaysNoMoreThanAFewThingsAtOnce) {
  McapBytes bytes = without_sums(small_mcap(500));
  for (const McapPlace& place : places_of(bytes, Op::kMessage)) bytes[place.content] = 99;
  LONGS_EQUAL(McapFile::kMostFaults, read_mcap(bytes).faults.size());
}

TEST(Mcap, TheSeedsOfTheFuzzerHoldWhatItChecks) {
  for (const McapBytes& seed : holdfast::test::mcap_seeds()) {
    CHECK(seed.size() < 4096);
    STRCMP_EQUAL("", holdfast::test::check_mcap_bytes(seed).c_str());
    STRCMP_EQUAL("", holdfast::test::check_mcap_bytes(without_sums(seed)).c_str());
  }
}
