// SPDX-License-Identifier: Apache-2.0
// Golden frames: Robotiq, Hand-E instruction manual, sections 4.7.3 to 4.8 (both editions: function 3 and function 4).
#include "grip/modbus_rtu.hpp"

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <functional>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/sim/serial.hpp"
#include "tests/support/modbus_bytes.hpp"

#include <CppUTest/TestHarness.h>

namespace rtu = holdfast::modbus_rtu;
namespace sim = holdfast::sim;
using holdfast::Micros;
using holdfast::test::hex;
using holdfast::test::with_crc;
using Bytes = holdfast::test::ModbusBytes;
using rtu::Progress;
using namespace std::chrono_literals;

namespace {

using rtu::State;
using Words = std::vector<std::uint16_t>;
using Begin = std::function<void(State&, const rtu::Config&)>;

Begin write(std::uint16_t at, const Words& values) {
  return [=](State& s, const rtu::Config& c) { rtu::begin_write(s, c, at, values); };
}
Begin read(std::uint16_t at, std::uint16_t count) {
  return [=](State& s, const rtu::Config& c) { rtu::begin_read(s, c, at, count); };
}
struct Golden {
  std::string_view request;
  std::string_view reply;
  Words registers;  // that the reply brings
  Begin begin;
};

constexpr std::string_view kAck = "09 10 03E8 0003 0130";

const std::vector<Golden> kGoldens{
    {"09 10 03E8 0003 06 0100 0000 0000 72E1", kAck, {}, write(0x3E8, {0x0100, 0, 0})},
    {"09 10 03E8 0003 06 0000 0000 0000 7330", kAck, {}, write(0x3E8, {0, 0, 0})},
    {"09 10 03E8 0003 06 0900 00FF FFFF 4229", kAck, {}, write(0x3E8, {0x0900, 0x00FF, 0xFFFF})},
    {"09 10 03E8 0003 06 0900 0000 FFFF 7219", kAck, {}, write(0x3E8, {0x0900, 0, 0xFFFF})},
    {"09 10 03E9 0002 04 60E6 3CC8 EC7C", "09 10 03E9 0002 9130", {}, write(0x3E9, {0x60E6, 0x3CC8})},
    {"09 04 07D0 0001 300F", "09 04 02 1100 54A1", {0x1100}, read(0x7D0, 1)},
    {"09 04 07D0 0001 300F", "09 04 02 3100 4D61", {0x3100}, read(0x7D0, 1)},
    {"09 04 07D0 0003 B1CE", "09 04 06 F900 0000 0D00 17AA", {0xF900, 0, 0x0D00}, read(0x7D0, 3)},
    {"09 04 07D0 0003 B1CE", "09 04 06 3900 0000 BB10 7106", {0x3900, 0, 0xBB10}, read(0x7D0, 3)},
};

// A port that counts what is asked of it.
class CountingPort final : public holdfast::hal::Serial {
 public:
  sim::Serial line{65536, 65536};
  std::size_t bytes = 0;
  std::size_t calls = 0;

 private:
  bool do_write(std::span<const std::uint8_t> out) override { return line.write(out); }
  std::size_t do_read(std::span<std::uint8_t> in) override {
    const std::size_t count = line.read(in);
    bytes += count;
    ++calls;
    return count;
  }
};

}  // namespace

TEST_GROUP(ModbusRtu) {
  rtu::Config config;
  rtu::State state;
  sim::Serial port;
  Micros now = 1s;

  Progress step(Micros by = 0us) {
    now += by;
    return rtu::update(state, config, port, now);
  }
  void feed(const Bytes& bytes) {
    CHECK_TRUE(port.feed(bytes));
  }
  // The request of `golden`, sent; the line has been quiet before.
  void request(const Golden& golden) {
    now += 1s;
    golden.begin(state, config);
    CHECK_TRUE(Progress::kBusy == step());
    CHECK_TRUE(State::Phase::kAwaiting == state.phase);
  }
  Progress reply(const Golden& golden, const Bytes& bytes) {
    request(golden);
    feed(bytes);
    Progress result = step(3ms);
    if (result == Progress::kBusy) result = step(config.timeout);
    return result;
  }
};

TEST(ModbusRtu, GoldenFramesByteForByteInBothDirections) {
  CHECK_TRUE(kGoldens.size() == 9);
  for (const Golden& golden : kGoldens) {
    const std::string name(golden.request);
    for (const std::string_view frame : {golden.request, golden.reply}) {
      const Bytes whole = hex(frame);
      const Bytes body(whole.begin(), whole.end() - 2);
      CHECK_TEXT(with_crc(body) == whole, "the golden frame itself");
    }
    port.clear_output();
    CHECK_TEXT(Progress::kOk == reply(golden, hex(golden.reply)), name.c_str());
    CHECK_TEXT(port.output_bytes() == hex(golden.request), name.c_str());
    const auto got = rtu::registers(state);
    CHECK_TEXT(Words(got.begin(), got.end()) == golden.registers, name.c_str());
    CHECK_TRUE(Progress::kIdle == step(1ms));  // told once
  }
}

TEST(ModbusRtu, CrcIsTheDefinition) {
  std::mt19937 random(1);
  for (std::size_t length = 0; length < 300; ++length) {
    Bytes bytes(length);
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random());
    LONGS_EQUAL(holdfast::test::modbus_crc(bytes), rtu::crc(bytes));
  }
  LONGS_EQUAL(0x4B37, rtu::crc(Bytes{'1', '2', '3', '4', '5', '6', '7', '8', '9'}));  // the catalogue's check value
}

TEST(ModbusRtu, EverySingleByteCorruptionIsRefused) {
  for (const Golden& golden : kGoldens) {
    const Bytes good = hex(golden.reply);
    for (std::size_t at = 0; at < good.size(); ++at) {
      for (unsigned flip = 1; flip < 256; ++flip) {
        Bytes bad = good;
        bad[at] = static_cast<std::uint8_t>(bad[at] ^ flip);
        CHECK_TRUE(Progress::kDamaged == reply(golden, bad));
      }
    }
  }
}

TEST(ModbusRtu, EveryTruncationIsRefusedAtTheTimeout) {
  for (const Golden& golden : kGoldens) {
    const Bytes good = hex(golden.reply);
    for (std::size_t length = 0; length < good.size(); ++length) {
      request(golden);
      feed(Bytes(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(length)));
      CHECK_TRUE(Progress::kBusy == step(50ms - 1us));
      CHECK_TRUE((length == 0 ? Progress::kTimeout : Progress::kDamaged) == step(1us));
      CHECK_TRUE(Progress::kIdle == step());
    }
  }
}

TEST(ModbusRtu, WellMadeRepliesToOtherRequestsAreRefused) {
  struct Case {
    const char* name;
    Bytes reply;
  };
  const Case to_read[] = {
      {"another slave", with_crc(hex("0A 04 06 F900 0000 0D00"))},
      {"another function", with_crc(hex("09 03 06 F900 0000 0D00"))},
      {"another length", with_crc(hex("09 04 04 F900 0000 0D00"))},
      {"fewer registers", with_crc(hex("09 04 04 F900 0000"))},
      {"more registers", with_crc(hex("09 04 08 F900 0000 0D00 0000"))},
      {"an acknowledgement", hex("09 10 03E8 0003 0130")},
      {"its own request", hex("09 04 07D0 0003 B1CE")},
      {"CRC with its bytes swapped", hex("09 04 06 F900 0000 0D00 AA17")},
      {"a byte of noise in front", hex("00 09 04 06 F900 0000 0D00 17AA")},
  };
  const Golden& read = kGoldens[7];
  for (const Case& c : to_read) CHECK_TEXT(Progress::kDamaged == reply(read, c.reply), c.name);
  const Case to_write[] = {
      {"another address", with_crc(hex("09 10 03E9 0003"))},
      {"another count", with_crc(hex("09 10 03E8 0002"))},
  };
  for (const Case& c : to_write) CHECK_TEXT(Progress::kDamaged == reply(kGoldens[0], c.reply), c.name);
}

TEST(ModbusRtu, ExceptionsAreToldWithTheirNumber) {
  for (const Golden& golden : kGoldens) {
    const Bytes sent = hex(golden.request);
    const Bytes exception = with_crc({sent[0], static_cast<std::uint8_t>(sent[1] | 0x80), 2});
    CHECK_TRUE(Progress::kException == reply(golden, exception));
    LONGS_EQUAL(2, state.exception);
    CHECK_TRUE(Progress::kDamaged == reply(golden, with_crc({8, static_cast<std::uint8_t>(sent[1] | 0x80), 2})));
  }
}

TEST(ModbusRtu, RepliesComeInAnyPieces) {
  std::mt19937 random(3);
  for (int round = 0; round < 300; ++round) {
    const Golden& golden = kGoldens[random() % kGoldens.size()];
    const Bytes good = hex(golden.reply);
    request(golden);
    std::size_t at = 0;
    while (at < good.size()) {
      const std::size_t piece = std::min<std::size_t>(random() % 4, good.size() - at);
      feed(Bytes(good.begin() + static_cast<std::ptrdiff_t>(at),
                 good.begin() + static_cast<std::ptrdiff_t>(at + piece)));
      at += piece;
      CHECK_TRUE((at == good.size() ? Progress::kOk : Progress::kBusy) == step(100us));
    }
  }
}

// What is there when a request goes out belongs to the past, even a whole reply.
TEST(ModbusRtu, WhatCameBeforeTheRequestIsThrownAway) {
  const Golden& read = kGoldens[7];
  feed(hex("09 04 06 B900 00FF BD00 AAAA"));
  feed(hex("09 04 06 3900 0000 BB10 7106"));
  CHECK_TRUE(Progress::kOk == reply(read, hex(read.reply)));
  LONGS_EQUAL(0xF900, rtu::registers(state)[0]);
  LONGS_EQUAL(22, state.counters.stray_bytes);
  // And what comes behind a reply is thrown away with the next request.
  Bytes more = hex(read.reply);
  more.insert(more.end(), 30, 0x55);
  CHECK_TRUE(Progress::kOk == reply(read, more));
  CHECK_TRUE(Progress::kOk == reply(read, hex(read.reply)));
  LONGS_EQUAL(52, state.counters.stray_bytes);
}

// A line that babbles at 115200 baud for five days has said 2^32 bytes.
TEST(ModbusRtu, CountersStayAtTheirEnd) {
  const Golden& read = kGoldens[7];
  state.counters = {.requests = UINT32_MAX, .replies = UINT32_MAX, .stray_bytes = UINT32_MAX - 5};
  for (int k = 0; k < 2; ++k) {
    feed(hex("09 04 06 B900 00FF BD00 AAAA"));
    CHECK_TRUE(Progress::kOk == reply(read, hex(read.reply)));
    UNSIGNED_LONGS_EQUAL(UINT32_MAX, state.counters.stray_bytes);
    UNSIGNED_LONGS_EQUAL(UINT32_MAX, state.counters.requests);
    UNSIGNED_LONGS_EQUAL(UINT32_MAX, state.counters.replies);
  }
}

TEST(ModbusRtu, ABabblingLineCostsABoundedNumberOfBytesPerCall) {
  CountingPort babbling;
  Bytes noise(60'000, 0x39);
  CHECK_TRUE(babbling.line.feed(noise));
  const auto check = [&] {
    babbling.bytes = babbling.calls = 0;
    (void)rtu::update(state, config, babbling, now);
    CHECK_TRUE(babbling.bytes <= 512);
    CHECK_TRUE(babbling.calls <= 21);
    now += 5ms;
  };
  for (int i = 0; i < 30; ++i) check();  // idle: emptied as far as allowed
  LONGS_EQUAL(30 * 512, state.counters.stray_bytes);
  for (int i = 0; i < 40; ++i) {
    if (rtu::idle(state)) rtu::begin_read(state, config, 0x7D0, 3);
    check();
  }
  LONGS_EQUAL(0, state.counters.replies);
  CHECK_TRUE(state.counters.damaged > 0);
}

TEST(ModbusRtu, ARequestWaitsForSpacingAndSilence) {
  const Golden& read = kGoldens[7];
  request(read);
  const Micros sent = now;
  feed(hex(read.reply));
  CHECK_TRUE(Progress::kOk == step(4ms));  // the last byte is seen at 4 ms: the line is free at 5.75 ms
  read.begin(state, config);
  while (state.phase == State::Phase::kToSend) CHECK_TRUE(Progress::kBusy == step(50us));
  LONGS_EQUAL(5750, (now - sent).count());

  feed(hex(read.reply));
  CHECK_TRUE(Progress::kOk == step(2ms));  // spacing alone
  const Micros second = state.sent;
  read.begin(state, config);
  while (state.phase == State::Phase::kToSend) CHECK_TRUE(Progress::kBusy == step(50us));
  LONGS_EQUAL(5000, (now - second).count());

  // A caller who comes late does not wait once more.
  feed(hex(read.reply));
  CHECK_TRUE(Progress::kOk == step(40ms));
  read.begin(state, config);
  CHECK_TRUE(Progress::kBusy == step());
  CHECK_TRUE(State::Phase::kAwaiting == state.phase);
}

TEST(ModbusRtu, APortThatRefusesEndsTheRequest) {
  port.hang_up();
  kGoldens[0].begin(state, config);
  CHECK_TRUE(Progress::kRefused == step());
  CHECK_TRUE(rtu::idle(state));
  LONGS_EQUAL(0, state.counters.requests);
  port.reconnect();
  CHECK_TRUE(Progress::kOk == reply(kGoldens[0], hex(kGoldens[0].reply)));
}

TEST(ModbusRtu, TheLargestRequestsFit) {
  rtu::begin_write(state, config, 0x3E8, Words(rtu::kMaxRegisters, 0xA55A));
  CHECK_TRUE(Progress::kBusy == step());
  LONGS_EQUAL(rtu::kMaxRequest, port.output_bytes().size());
  feed(with_crc(hex("09 10 03E8 0008")));
  CHECK_TRUE(Progress::kOk == step(5ms));
  rtu::begin_read(state, config, 0x7D0, rtu::kMaxRegisters);
  CHECK_TRUE(Progress::kBusy == step(5ms));
  Bytes body{9, 4, 16};
  for (int i = 0; i < 16; ++i) body.push_back(static_cast<std::uint8_t>(i));
  feed(with_crc(body));
  CHECK_TRUE(Progress::kOk == step(5ms));
  LONGS_EQUAL(rtu::kMaxRegisters, rtu::registers(state).size());
  LONGS_EQUAL(0x0E0F, rtu::registers(state).back());
}
