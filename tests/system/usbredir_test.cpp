// SPDX-License-Identifier: Apache-2.0
// The usbredir peer against a host written for these tests: its messages are put together and taken apart here, from
// the protocol's description.
#include "tests/system/usbredir.hpp"

#include <array>
#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "tests/system/camera_commands.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace std::chrono_literals;

namespace {

using test::Bytes;
using test::Moment;
using test::UsbCamera;
using test::UsbredirPeer;

constexpr Moment kStart{};
// What an emulated xHCI's side says that it can do; and without acknowledged unplugging.
constexpr std::uint32_t kAll = 1U << 1 | 1U << 2 | 1U << 3 | 1U << 4 | 1U << 5 | 1U << 6 | 1U << 7;
constexpr std::uint32_t kNoAck = kAll & ~(1U << 3);

void put(Bytes& out, std::uint64_t value, std::size_t size) {
  for (std::size_t k = 0; k < size; ++k) out.push_back(static_cast<std::uint8_t>(value >> (8 * k)));
}

std::uint64_t word(const Bytes& bytes, std::size_t at, std::size_t size) {
  std::uint64_t value = 0;
  for (std::size_t k = size; k-- > 0;) value = value << 8 | bytes.at(at + k);
  return value;
}

struct Message {
  std::uint64_t type = 0;
  std::uint64_t id = 0;
  Bytes body;
};

Bytes message(std::uint32_t type, std::uint64_t id, const Bytes& body, std::size_t id_size = 8) {
  Bytes out;
  put(out, type, 4);
  put(out, body.size(), 4);
  put(out, id, id_size);
  out.insert(out.end(), body.begin(), body.end());
  return out;
}

Bytes hello(std::uint32_t capabilities) {
  Bytes body(64);
  body[0] = 'h';
  put(body, capabilities, 4);
  return message(0, 0, body, 4);
}

Bytes control(std::uint8_t type, std::uint8_t request, std::uint32_t value, std::uint32_t index, std::uint32_t length,
              const Bytes& data = {}) {
  Bytes body{static_cast<std::uint8_t>(type & 0x80), request, type, 0};
  put(body, value, 2);
  put(body, index, 2);
  put(body, length, 2);
  body.insert(body.end(), data.begin(), data.end());
  return body;
}

Bytes bulk(std::uint32_t length, std::uint8_t endpoint = 0x81) {
  Bytes body{endpoint, 0};
  put(body, length & 0xffff, 2);
  put(body, 0, 4);
  put(body, length >> 16, 2);
  return body;
}

}  // namespace

TEST_GROUP(Usbredir) {
  Bytes picture = Bytes(20'000, 0x5a);
  UsbCamera camera{{picture}};
  UsbredirPeer peer{camera};

  bool tell(const Bytes& bytes) {
    return peer.receive(bytes);
  }

  // What it has said since the last call. The header's ids are 32 bits in the hello, and as agreed afterwards.
  std::vector<Message> heard(bool hello_first = false, std::size_t id_size = 8) {
    std::vector<Message> messages;
    Bytes out;
    std::swap(out, peer.out());
    for (std::size_t at = 0; at < out.size();) {
      const std::size_t ids = hello_first && messages.empty() ? 4 : id_size;
      const std::size_t length = word(out, at + 4, 4);
      Message next{word(out, at, 4), word(out, at + 8, ids), {}};
      CHECK(at + 8 + ids + length <= out.size());
      next.body.assign(out.begin() + static_cast<std::ptrdiff_t>(at + 8 + ids),
                       out.begin() + static_cast<std::ptrdiff_t>(at + 8 + ids + length));
      messages.push_back(next);
      at += 8 + ids + length;
    }
    return messages;
  }

  void connect(std::uint32_t capabilities = kAll) {
    peer.begin();
    CHECK(tell(hello(capabilities)));
    CHECK(peer.attached());
    peer.out().clear();
  }
  void stream() {
    connect();
    CHECK(tell(message(6, 1, {1})));
    CHECK(tell(message(100, 2, control(0x21, 1, 0x200, 1, 26, Bytes(26)))));
    CHECK(camera.streaming());
    peer.out().clear();
  }
};

TEST(Usbredir, SaysHelloAndDescribesTheCameraBeforeItComes) {
  peer.begin();
  CHECK(!peer.attached());
  CHECK(tell(hello(kAll)));
  const std::vector<Message> said = heard(true);
  LONGS_EQUAL(4, said.size());
  LONGS_EQUAL(0, said[0].type);
  LONGS_EQUAL(68, said[0].body.size());
  LONGS_EQUAL(1U << 1 | 1U << 3 | 1U << 4 | 1U << 5 | 1U << 6, word(said[0].body, 64, 4));
  LONGS_EQUAL(5, said[1].type);
  LONGS_EQUAL(96 + 64, said[1].body.size());
  for (std::size_t k = 0; k < 32; ++k) {
    LONGS_EQUAL(k == 0 || k == 16 ? 0 : k == 17 ? 2 : 255, said[1].body[k]);
    LONGS_EQUAL(k == 17 ? 1 : 0, said[1].body[64 + k]);
    LONGS_EQUAL(k == 0 || k == 16 ? 64 : k == 17 ? 512 : 0, word(said[1].body, 96 + 2 * k, 2));
  }
  LONGS_EQUAL(4, said[2].type);
  LONGS_EQUAL(4 + 128, said[2].body.size());
  LONGS_EQUAL(2, word(said[2].body, 0, 4));
  LONGS_EQUAL(0x0100, word(said[2].body, 4, 2));       // numbers 0 and 1
  LONGS_EQUAL(0x0e0e, word(said[2].body, 4 + 32, 2));  // video
  LONGS_EQUAL(0x0201, word(said[2].body, 4 + 64, 2));  // control, streaming
  LONGS_EQUAL(1, said[3].type);
  CHECK((said[3].body == Bytes{2, 0xef, 2, 1, 0x45, 0x0c, 0x6d, 0x63, 0x00, 0x01}));
}

TEST(Usbredir, SpeaksToASideThatCanNothing) {
  peer.begin();
  CHECK(tell(message(0, 0, Bytes(64), 4)));
  std::vector<Message> said = heard(true, 4);
  LONGS_EQUAL(4, said.size());
  LONGS_EQUAL(96, said[1].body.size());
  LONGS_EQUAL(8, said[3].body.size());
  CHECK(tell(message(6, 7, {1}, 4)));
  CHECK(tell(message(100, 8, control(0x21, 1, 0x200, 1, 26, Bytes(26)), 4)));
  Bytes short_head = bulk(16'384);
  short_head.resize(8);
  CHECK(tell(message(101, 9, short_head, 4)));
  peer.pump(kStart);
  said = heard(false, 4);
  LONGS_EQUAL(3, said.size());
  LONGS_EQUAL(9, said[2].id);
  LONGS_EQUAL(8 + 16'384, said[2].body.size());
  peer.unplug();
  CHECK(!peer.attached());
  peer.plug();  // nobody will say that it knows
  CHECK(peer.attached());
}

TEST(Usbredir, CarriesRequestsAndTheirAnswers) {
  connect();
  CHECK(tell(message(100, 0x1122334455667788, control(0x80, 6, 0x100, 0, 18))));
  CHECK(tell(message(100, 5, control(0x80, 6, 0x600, 0, 10))));
  CHECK(tell(message(6, 6, {1})));
  CHECK(tell(message(6, 7, {2})));
  CHECK(tell(message(7, 8, {})));
  CHECK(tell(message(9, 9, {1, 0})));
  CHECK(tell(message(9, 10, {1, 3})));
  CHECK(tell(message(10, 11, {1})));
  CHECK(tell(message(100, 12, control(0x21, 1, 0x900, 0x200, 2, {140, 0}))));
  const std::vector<Message> said = heard();
  LONGS_EQUAL(9, said.size());
  LONGS_EQUAL(100, said[0].type);
  CHECK(said[0].id == 0x1122334455667788);
  LONGS_EQUAL(10 + 18, said[0].body.size());
  LONGS_EQUAL(0, said[0].body[3]);
  LONGS_EQUAL(18, word(said[0].body, 8, 2));
  CHECK(Bytes(said[0].body.begin() + 10, said[0].body.end()) == camera.device_descriptor());
  LONGS_EQUAL(4, said[1].body[3]);  // refused
  LONGS_EQUAL(10, said[1].body.size());
  CHECK((said[2].body == Bytes{0, 1}));
  CHECK((said[3].body == Bytes{2, 1}));  // no such configuration: the old one stays
  CHECK((said[4].body == Bytes{0, 1}));
  CHECK((said[5].body == Bytes{0, 1, 0}));
  CHECK((said[6].body == Bytes{2, 1, 0}));
  CHECK((said[7].body == Bytes{0, 1, 0}));
  LONGS_EQUAL(0, said[8].body[3]);
  LONGS_EQUAL(2, word(said[8].body, 8, 2));
  LONGS_EQUAL(10, said[8].body.size());
  LONGS_EQUAL(140, *camera.control_value("gamma"));
}

TEST(Usbredir, AnswersTransfersInTheirOrderWhenThereIsSomething) {
  stream();
  camera.set_period(40ms);
  for (std::uint64_t id = 20; id < 24; ++id) CHECK(tell(message(101, id, bulk(16'384))));
  peer.pump(kStart);
  std::vector<Message> said = heard();
  LONGS_EQUAL(2, said.size());
  LONGS_EQUAL(20, said[0].id);
  LONGS_EQUAL(21, said[1].id);
  LONGS_EQUAL(10 + 16'384, said[0].body.size());
  LONGS_EQUAL(16'384, word(said[0].body, 2, 2));
  LONGS_EQUAL(10 + 2 + 20'000 - 16'382, said[1].body.size());
  LONGS_EQUAL(2, peer.waiting());
  CHECK(peer.due() == kStart + 40ms);
  peer.pump(kStart + 39ms);
  LONGS_EQUAL(0, heard().size());
  peer.pump(kStart + 40ms);
  said = heard();
  LONGS_EQUAL(2, said.size());
  LONGS_EQUAL(22, said[0].id);
  CHECK(!peer.due().has_value());  // nothing is asked for
}

TEST(Usbredir, ACancelledTransferIsAnsweredOnce) {
  stream();
  camera.stall(true);
  CHECK(tell(message(101, 30, bulk(16'384))));
  CHECK(tell(message(101, 31, bulk(16'384))));
  CHECK(tell(message(21, 30, {})));
  CHECK(tell(message(21, 30, {})));
  CHECK(tell(message(21, 99, {})));
  std::vector<Message> said = heard();
  LONGS_EQUAL(1, said.size());
  LONGS_EQUAL(30, said[0].id);
  LONGS_EQUAL(1, said[0].body[1]);
  camera.stall(false);
  peer.pump(kStart);
  said = heard();
  LONGS_EQUAL(1, said.size());
  LONGS_EQUAL(31, said[0].id);
}

TEST(Usbredir, RefusesEndpointsThatTheCameraLacks) {
  stream();
  CHECK(tell(message(101, 40, bulk(512, 0x82))));
  CHECK(tell(message(101, 41, bulk(0, 0x81))));
  Bytes out = bulk(4, 0x01);
  out.resize(out.size() + 4);
  CHECK(tell(message(101, 42, out)));
  CHECK(tell(message(12, 43, {0x81, 32, 3})));
  CHECK(tell(message(15, 44, {0x83})));
  CHECK(tell(message(18, 45, {0, 0, 2, 0, 4, 0, 0, 0})));
  CHECK(tell(message(77, 46, {1, 2, 3})));  // unknown: passed over
  const std::vector<Message> said = heard();
  LONGS_EQUAL(6, said.size());
  for (std::size_t k = 0; k < 3; ++k) {
    LONGS_EQUAL(40 + k, said[k].id);
    LONGS_EQUAL(2, said[k].body[1]);
  }
  LONGS_EQUAL(14, said[3].type);
  CHECK((said[3].body == Bytes{2, 0x81}));
  LONGS_EQUAL(17, said[4].type);
  CHECK((said[4].body == Bytes{2, 0x83}));
  LONGS_EQUAL(20, said[5].type);
  LONGS_EQUAL(9, said[5].body.size());
  LONGS_EQUAL(2, said[5].body[8]);
}

// The other side has messages on the way to a device that has gone; the next one must not get them.
TEST(Usbredir, ComesBackOnlyWhenTheOtherSideKnowsThatItWent) {
  stream();
  CHECK(tell(message(101, 50, bulk(16'384))));
  peer.unplug();
  std::vector<Message> said = heard();
  LONGS_EQUAL(1, said.size());
  LONGS_EQUAL(2, said[0].type);
  LONGS_EQUAL(0, said[0].body.size());
  peer.plug();
  CHECK(tell(message(101, 51, bulk(16'384))));
  CHECK(tell(message(6, 52, {1})));
  peer.pump(kStart);
  LONGS_EQUAL(0, heard().size());
  CHECK(!peer.attached());
  CHECK(tell(message(24, 0, {})));
  said = heard();
  LONGS_EQUAL(3, said.size());
  LONGS_EQUAL(1, said[2].type);
  CHECK(peer.attached());
  CHECK(!camera.streaming());
  LONGS_EQUAL(0, camera.configuration());
  CHECK(tell(message(24, 0, {})));  // once too often
  CHECK(peer.attached());
  LONGS_EQUAL(0, peer.waiting());
}

TEST(Usbredir, StaysUnpluggedThroughAReconnection) {
  connect(kNoAck);
  peer.unplug();
  peer.begin();
  CHECK(tell(hello(kAll)));
  CHECK(!peer.attached());
  peer.plug();
  CHECK(peer.attached());
  LONGS_EQUAL(4, heard(true).size());
}

TEST(Usbredir, ARefusedDeviceIsGone) {
  connect();
  CHECK(tell(message(22, 0, {})));
  CHECK(peer.refused());
  CHECK(!peer.attached());
}

// Every message cut anywhere: nothing comes of it before its end, then the same as in one piece.
TEST(Usbredir, TakesMessagesInPieces) {
  Bytes all = hello(kAll);
  for (const Bytes& next : {message(6, 1, {1}), message(100, 2, control(0x80, 6, 0x200, 0, 255)),
                            message(100, 3, control(0x21, 1, 0x900, 0x200, 2, {140, 0}))}) {
    all.insert(all.end(), next.begin(), next.end());
  }
  peer.begin();
  peer.out().clear();
  CHECK(tell(all));
  const Bytes whole = peer.out();
  for (const std::size_t piece : {1U, 2U, 3U, 7U, 15U, 16U, 17U, 80U}) {
    UsbCamera other_camera{{picture}};
    UsbredirPeer other{other_camera};
    other.begin();
    other.out().clear();
    for (std::size_t at = 0; at < all.size(); at += piece) {
      CHECK(other.receive(std::span(all).subspan(at, std::min(piece, all.size() - at))));
    }
    CHECK(other.out() == whole);
  }
}

TEST(Usbredir, BreaksOffWhatIsNoProtocol) {
  const Bytes long_hello = message(0, 0, Bytes(100'000), 4);
  const std::vector<std::pair<Bytes, const char*>> first{
      {message(6, 1, {1}, 4), "no hello"},
      {message(0, 0, Bytes(63), 4), "hello of 63"},
      {long_hello, "100000 bytes"},
      {message(0xffffffff, 0, {}, 4), "no hello"},
  };
  for (const auto& [bytes, reason] : first) {
    peer.begin();
    CHECK(!tell(bytes));
    STRCMP_CONTAINS(reason, peer.broken().c_str());
    CHECK(!tell(hello(kAll)));  // it is over
    CHECK(!peer.attached());
  }
  Bytes endless;
  put(endless, 100, 4);
  put(endless, 0xffffffff, 4);
  put(endless, 1, 8);
  const std::vector<std::pair<Bytes, const char*>> later{
      {message(0, 0, Bytes(68)), "second hello"},
      {message(6, 1, {}), "type 6 has only 0"},
      {message(9, 1, {1}), "type 9 has only 1"},
      {message(100, 1, Bytes(9)), "type 100 has only 9"},
      {message(101, 1, Bytes(7)), "type 101 has only 7"},
      {message(101, 1, {0x81, 0, 0, 64, 0, 0, 0, 0}), "head of 8"},
      {message(100, 1, control(0x80, 6, 0x100, 0, 18, {1})), "brings 1"},
      {message(100, 1, control(0x21, 1, 0x900, 0x200, 2, {1})), "brings 1"},
      {message(100, 1, control(0x21, 1, 0x900, 0x200, 0xffff, {1})), "65535 bytes"},
      {endless, "4294967295 bytes"},
  };
  for (const auto& [bytes, reason] : later) {
    connect();
    CHECK(!tell(bytes));
    STRCMP_CONTAINS(reason, peer.broken().c_str());
  }
  stream();
  camera.stall(true);
  for (std::uint64_t id = 0; id < UsbredirPeer::kMostTransfers; ++id) CHECK(tell(message(101, id, bulk(512))));
  CHECK(!tell(message(101, 999, bulk(512))));
  STRCMP_CONTAINS("too many", peer.broken().c_str());
  LONGS_EQUAL(0, peer.waiting());
  connect();  // and a new connection is a new beginning
  CHECK(tell(message(7, 1, {})));
}

// A machine that has gone mad: whatever comes, it is answered, passed over or broken off. The sanitizers watch.
TEST(Usbredir, SurvivesNoise) {
  std::uint32_t random = 7;
  const auto draw = [&random] { return (random = random * 1664525U + 1013904223U) >> 8; };
  int broken = 0, well = 0;
  for (int round = 0; round < 3000; ++round) {
    peer.begin();
    bool open = tell(hello(draw()));
    for (int k = 0; k < 30 && open; ++k) {
      Bytes body(draw() % 40);
      for (std::uint8_t& byte : body) byte = static_cast<std::uint8_t>(draw());
      if (draw() % 2 == 0)
        body = draw() % 2 == 0 ? bulk(draw()) : control(0x21, 1, (draw() % 12) << 8, draw() % 0x301, 2, {1, 0});
      Bytes next = message(draw() % 2 == 0 ? draw() % 30 : 100 + draw() % 2, draw(), body);
      if (draw() % 16 == 0) next[draw() % next.size()] ^= static_cast<std::uint8_t>(1U << draw() % 8);
      open = tell(next);
      peer.pump(kStart + std::chrono::milliseconds(k));
      peer.out().clear();
      if (draw() % 32 == 0) draw() % 2 == 0 ? peer.plug() : peer.unplug();
    }
    ++(open ? well : broken);
  }
  CHECK(broken > 100);
  CHECK(well > 100);
}

TEST(Usbredir, ObeysCommands) {
  stream();
  STRCMP_EQUAL("ok", test::obey("play 0 0\n", camera, peer).c_str());
  STRCMP_CONTAINS("error: no such pictures", test::obey("play 0 1", camera, peer).c_str());
  STRCMP_CONTAINS("error: no such pictures", test::obey("play 1 0", camera, peer).c_str());
  STRCMP_CONTAINS("error: play takes", test::obey("play 0", camera, peer).c_str());
  STRCMP_EQUAL("ok", test::obey(" play 0 0 then 0 0", camera, peer).c_str());
  STRCMP_EQUAL("ok", test::obey("period 7", camera, peer).c_str());
  CHECK(camera.payload(65'536, kStart).has_value());
  CHECK(camera.payload(65'536, kStart).has_value());
  CHECK(camera.due() == kStart + 7ms);
  for (const char* bad :
       {"", "\n", "period", "period x", "period -1", "period 1x", "period 99999999", "stall", "stall maybe", "jump",
        "plug now", "as a b", "as a b c", "as a b 0c45:", "as a b 0c45:12345", "status 1"}) {
    STRCMP_CONTAINS("error: ", test::obey(bad, camera, peer).c_str());
    STRCMP_CONTAINS("Next: ", test::obey(bad, camera, peer).c_str());
  }
  STRCMP_EQUAL("ok", test::obey("unplug", camera, peer).c_str());
  CHECK(!peer.attached());
  STRCMP_CONTAINS("ok", test::obey("as USB 2.0 Camera SN01 0c45:6366", camera, peer).c_str());
  STRCMP_EQUAL("ok", test::obey("plug", camera, peer).c_str());
  peer.out().clear();
  CHECK(tell(message(24, 0, {})));
  STRCMP_EQUAL("USB 2.0 Camera", camera.identity().name.c_str());
  STRCMP_EQUAL("SN01", camera.identity().serial.c_str());
  LONGS_EQUAL(0x6366, word(heard().back().body, 6, 2));
  const std::string status = test::obey("status", camera, peer);
  STRCMP_CONTAINS("ok frames=1 picture=0 plugged=1 attached=1", status.c_str());
  STRCMP_CONTAINS(" exposure_auto=8 exposure_absolute=157 ", status.c_str());
  CHECK(status.find('\n') == std::string::npos);
  STRCMP_CONTAINS("truncate N", test::obey("help", camera, peer).c_str());
  for (const char* good : {"truncate 1", "error 1", "freeze on", "freeze off", "step 0", "run"}) {
    STRCMP_EQUAL("ok", test::obey(good, camera, peer).c_str());
  }
}
