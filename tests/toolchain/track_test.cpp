// SPDX-License-Identifier: Apache-2.0
#include "toolchain/session/track.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "toolchain/session/report.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::tool;

namespace {

bool has(const Thinned& thinned, std::uint32_t index) {
  return std::any_of(thinned.pieces().begin(), thinned.pieces().end(), [&](const auto& p) { return p.index == index; });
}

std::size_t bytes_of(const Thinned& thinned) {
  std::size_t bytes = 0;
  for (const auto& piece : thinned.pieces()) bytes += piece.bytes.size();
  return bytes;
}

FrameRecord row(long number) {
  FrameRecord frame;
  frame.frame = static_cast<std::uint32_t>(number);
  frame.set_time(0.04 * static_cast<double>(number));
  frame.accepted = frame.features_valid = true;
  frame.state = DeviceState::kOk;
  return frame;
}

}  // namespace

TEST_GROUP(Track){};

TEST(Track, KeepsEverythingThatFits) {
  Thinned thinned(1000);
  for (std::uint32_t i = 0; i < 100; ++i) thinned.keep({i, false, std::vector<std::uint8_t>(10)});
  LONGS_EQUAL(100, thinned.pieces().size());
  LONGS_EQUAL(1, thinned.stride());
}

TEST(Track, ThinsEvenlyAndKeepsEvents) {
  Thinned thinned(1000);
  for (std::uint32_t i = 0; i < 100'000; ++i) {
    const bool event = i % 9999 == 5;
    if (thinned.wants(i, event)) thinned.keep({i, event, std::vector<std::uint8_t>(10)});
    CHECK(bytes_of(thinned) <= 1000);
  }
  for (std::uint32_t i = 5; i < 100'000; i += 9999) CHECK(has(thinned, i));
  LONGS_EQUAL(2048, thinned.stride());
  for (std::uint32_t i = 0; i < 100'000; i += 2048) CHECK(has(thinned, i));
}

TEST(Track, ARunOfNothingButEventsIsBoundedToo) {
  Thinned thinned(1000);
  for (std::uint32_t i = 0; i < 10'000; ++i) thinned.keep({i, true, std::vector<std::uint8_t>(10)});
  CHECK(bytes_of(thinned) <= 1000);
  CHECK(thinned.pieces().size() > 20);
  CHECK(has(thinned, 0));
}

TEST(Track, APieceLargerThanTheBudgetIsKeptAlone) {
  Thinned thinned(10);
  thinned.keep({0, false, std::vector<std::uint8_t>(100)});
  LONGS_EQUAL(1, thinned.pieces().size());
}

TEST(Track, SaysWhatIsKnownOfTheLatency) {
  Track unknown, known;
  for (long i = 0; i < 101; ++i) {
    FrameRecord record = row(i);
    unknown.add(record, {}, {});
    record.decided_us = 1000.0 + 10.0 * static_cast<double>(i);
    known.add(record, {}, {});
  }
  CHECK(nlohmann::json::parse(unknown.json({}))["latency"].is_null());
  const auto latency = nlohmann::json::parse(known.json({}))["latency"];
  LONGS_EQUAL(101, latency["count"].get<int>());
  DOUBLES_EQUAL(1500, latency["p50_us"].get<double>(), 0);
  DOUBLES_EQUAL(1990, latency["p99_us"].get<double>(), 0);
  DOUBLES_EQUAL(2000, latency["max_us"].get<double>(), 0);
  DOUBLES_EQUAL(2000, latency["range_us"].get<double>(), 0);
  int sum = 0;
  for (const int bin : latency["bins"]) sum += bin;
  LONGS_EQUAL(101, sum);
}

TEST(Track, NamesThatAreNotTextDoNotStopIt) {
  ReportInfo info{};
  info.marks = {{0.0, "bad \xff name </script>", true}};
  Track track;
  track.add(row(0), {}, {});
  const std::string json = track.json(info);
  CHECK(json.find('<') == std::string::npos);
  CHECK(nlohmann::json::parse(json)["marks"].size() == 1);
}
