// SPDX-License-Identifier: Apache-2.0
// One port, several who listen: who hears what, what happens to the slow, and when the console is locked.
#include <array>
#include <atomic>
#include <chrono>
#include <memory>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "tests/support/http.hpp"
#include "toolchain/live/hub.hpp"
#include "toolchain/live/web.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

using namespace holdfast;
using live::Hub;

TEST_GROUP(LiveHub) {
  Hub hub;
  std::string bytes;

  bool writes(std::string_view text) {
    return hub.write({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  }
  std::string to_device() {
    std::array<std::uint8_t, 64> room{};
    const std::size_t count = hub.read(room);
    return {room.begin(), room.begin() + static_cast<std::ptrdiff_t>(count)};
  }
  std::string heard(const std::shared_ptr<Hub::Listener>& listener) {
    CHECK(hub.hear(*listener, bytes, Hub::Millis{0}));
    return bytes;
  }
};

TEST(LiveHub, EachHearsAllFromWhenItCame) {
  CHECK(writes("before "));  // nobody is there: it is gone, and held nothing up
  const auto first = hub.listen(true);
  CHECK(writes("one "));
  const auto second = hub.listen(false);
  CHECK(writes("two"));
  STRCMP_EQUAL("one two", heard(first).c_str());
  STRCMP_EQUAL("two", heard(second).c_str());
  STRCMP_EQUAL("", heard(first).c_str());
  LONGS_EQUAL(2, hub.listeners());
  hub.leave(second);
  hub.leave(second);
  LONGS_EQUAL(1, hub.listeners());
  STRCMP_EQUAL("", to_device().c_str());
}

TEST(LiveHub, LocksTheConsoleWhenTheLastWhoControlsLeaves) {
  const auto looks = hub.listen(false);
  const auto first = hub.listen(true);
  const auto second = hub.listen(true);
  hub.leave(first);
  STRCMP_EQUAL("", to_device().c_str());
  hub.leave(second);
  STRCMP_EQUAL("lock\r\n", to_device().c_str());
  hub.leave(looks);
  STRCMP_EQUAL("", to_device().c_str());
}

TEST(LiveHub, WhoeverIsSlowLosesWhatWaits) {
  const auto slow = hub.listen(false);
  const auto quick = hub.listen(false);
  const std::string block(Hub::kMostWaiting / 2, 'x');
  for (int k = 0; k < 3; ++k) {
    CHECK(writes(block));
    LONGS_EQUAL(block.size(), heard(quick).size());
  }
  LONGS_EQUAL(block.size(), heard(slow).size());
  // And whoever says too much is told that it was too much.
  CHECK(hub.say(std::string(Hub::kMostSaid, 'y')));
  CHECK_FALSE(hub.say("z"));
}

TEST(LiveHub, LinesReachTheDeviceInPiecesAndInOrder) {
  const std::string line(100, 'a');
  CHECK(hub.say(line + "\r\n"));
  CHECK(hub.say("b\r\n"));
  std::string all;
  for (std::string piece = to_device(); !piece.empty(); piece = to_device()) all += piece;
  STRCMP_EQUAL((line + "\r\nb\r\n").c_str(), all.c_str());
}

// All hear what the port says: it may not say a code.
TEST(LiveHub, KeepsThePortFromEchoing) {
  CHECK(hub.say("status\r\n"));
  STRCMP_EQUAL("status\r\n", to_device().c_str());
  for (const std::string unlock : {"unlock desk\r\n", "  unlock desk\r\n"}) {
    CHECK(hub.say(unlock));
    STRCMP_EQUAL((std::string(Hub::kQuiet) + unlock).c_str(), to_device().c_str());
  }
  for (const std::string echo : {"echo on\r\n", "  echo  on\r\n"}) {
    CHECK(hub.say(echo));
    STRCMP_EQUAL((echo + std::string(Hub::kQuiet)).c_str(), to_device().c_str());
  }
  // A prompt is what only a console that echoes draws, in however many pieces it comes; it is told so once.
  CHECK(writes("* SEARCHING\r\n\r> \x1B\x1B[A\x1B"));
  STRCMP_EQUAL("", to_device().c_str());
  CHECK(writes("["));
  CHECK(writes("K\r> \x1B[K"));
  STRCMP_EQUAL(std::string(Hub::kQuiet).c_str(), to_device().c_str());
}

TEST(LiveHub, GivesTheNewestPictureOnce) {
  CHECK_FALSE(hub.picture_wanted());
  CHECK_FALSE(hub.picture(0, Hub::Millis{0}).has_value());
  CHECK(hub.picture_wanted());
  hub.show(7, {1});
  hub.show(9, {2, 3});
  const auto newest = hub.picture(0, Hub::Millis{0});
  CHECK(newest.has_value());
  LONGS_EQUAL(9, newest->sequence);
  LONGS_EQUAL(2, newest->number);
  LONGS_EQUAL(2, newest->jpeg.size());
  CHECK_FALSE(hub.picture(newest->number, Hub::Millis{0}).has_value());
}

TEST(LiveHub, AtTheEndNobodyWaits) {
  const auto listener = hub.listen(true);
  CHECK(writes("last"));
  hub.end();
  CHECK_FALSE(hub.hear(*listener, bytes, Hub::Millis{100'000}));
  STRCMP_EQUAL("last", bytes.c_str());
  CHECK_FALSE(hub.picture(0, Hub::Millis{100'000}).has_value());
}

// Whoever may not say anything is not listened to, and what is said has a length.
TEST(LiveHub, RefusesBeforeABodyIsRead) {
  live::Web web(hub, "page", {});
  STRCMP_EQUAL("", web.start(0).c_str());
  const std::string address = web.address(true);
  struct {
    std::string address, headers;
    const char* status;
  } const refused[] = {
      {address, "Transfer-Encoding: chunked\r\n", " 411 "},
      {address + "0", "Content-Length: 4000\r\n", " 401 "},
      {address + "0", "Transfer-Encoding: chunked\r\n", " 4"},
  };
  for (const auto& one : refused) {
    test::Http http(one.address, "POST /send", one.headers);
    CHECK_TEXT(http.says(one.status) && http.says("\r\n\r\n"), http.said.c_str());
    const std::string block = "10000\r\n" + std::string(0x10000, 'x') + "\r\n";
    int blocks = 0;
    while (blocks < 1000 && http.send(block)) ++blocks;
    CHECK_TEXT(blocks < 1000, one.headers.c_str());
  }
  STRCMP_EQUAL("", to_device().c_str());
  CHECK(test::Http(address, "POST /send", {}, "status").says(" 204 "));
  STRCMP_EQUAL("status\r\n", to_device().c_str());
  CHECK(test::Http(address, "POST /send", {}, std::string(5000, 'x')).says(" 413 "));
  CHECK(test::Http(web.address(false), "POST /send", {}, "status").says(" 403 "));
  CHECK(test::Http(address + "0", "GET /").says("page"));
  CHECK(test::Http(address + "0", "GET /stream").says(" 401 "));
  CHECK(test::Http(address + "0", "GET /picture").says("no token, or a wrong one"));
}

// Whoever asks for the whole of an answer thousands of times, in 8 kB, gets it once.
TEST(LiveHub, ServesNoRanges) {
  live::Web web(hub, "page", {});
  STRCMP_EQUAL("", web.start(0).c_str());
  std::string ranges = "Range: bytes=0-";
  for (int k = 0; k < 2000; ++k) ranges += ",0-";
  ranges += "\r\n";
  test::Http whole(web.address(true), "GET /", ranges);
  CHECK_TEXT(whole.says(" 200 ") && whole.says("Content-Length: 4\r\n") && whole.says("page"), whole.said.c_str());
  test::Http refused(web.address(true) + "0", "GET /stream", ranges);
  CHECK(refused.says(" 401 ") && refused.says("printed"));
  CHECK(refused.said.find("multipart") == std::string::npos);
}

// The lock that a mistyped code closes opens again without anybody's knowing the desk's own code.
TEST(LiveHub, UnlocksAgainAfterAWrongCode) {
  live::Web web(hub, "page", "unlock right");
  STRCMP_EQUAL("", web.start(0).c_str());
  const auto says = [&](const std::string& line) {
    CHECK(test::Http(web.address(true), "POST /send", {}, line).says(" 204 "));
    std::string all;
    for (std::string piece = to_device(); !piece.empty(); piece = to_device()) all += piece;
    return all;
  };
  const std::string quiet(Hub::kQuiet), right = quiet + "unlock right\r\n";
  STRCMP_EQUAL("status\r\n", says("status").c_str());
  STRCMP_EQUAL((quiet + "unlock wrong\r\n").c_str(), says("unlock wrong").c_str());
  // More than once: the console may still refuse all codes.
  for (int k = 0; k < 2; ++k) STRCMP_EQUAL((right + "status\r\n").c_str(), says("status").c_str());
  STRCMP_EQUAL((right + quiet + "unlock other\r\n").c_str(), says("unlock other").c_str());
}

// Browsers and curl leave out the port that is HTTP's own.
TEST(LiveHub, KnowsItsOwnAddress) {
  for (const std::string host : {"127.0.0.1", "localhost"}) {
    CHECK(live::own_address(host, "", 80));
    CHECK(live::own_address(host, "http://" + host, 80));
    CHECK(live::own_address(host + ":80", "http://" + host, 80));
    CHECK(live::own_address(host + ":8632", "http://" + host + ":8632", 8632));
    CHECK_FALSE(live::own_address(host, "", 8632));
    CHECK_FALSE(live::own_address(host + ":80", "", 8632));
    CHECK_FALSE(live::own_address(host + ":8632", "", 80));
    CHECK_FALSE(live::own_address(host, "http://example.com", 80));
    CHECK_FALSE(live::own_address(host + ":8632", "http://" + host, 8632));
  }
  CHECK_FALSE(live::own_address("example.com", "", 80));
  CHECK_FALSE(live::own_address("", "", 80));
  CHECK_FALSE(live::own_address(":80", "", 80));
}

// A head without an end, and one that comes a byte at a time: neither grows without bound nor holds the end up.
TEST(LiveHub, ARequestHasALengthAndEndsWithTheServer) {
  auto web = std::make_unique<live::Web>(hub, "page", std::string());
  STRCMP_EQUAL("", web->start(0).c_str());
  const test::Http endless(web->address(true), "GET /", "X: y");
  const std::string line = "X: " + std::string(1000, 'x') + "\r\n";
  int lines = 0;
  while (lines < 10'000 && endless.send(line)) ++lines;
  CHECK_TEXT(lines < 10'000, "10 MB of head were taken");

  std::atomic<bool> begun = false;
  std::thread dribbles([&] {
    const test::Http slow(web->address(true), "GET /", "X: y");
    while (slow.send("x")) {
      begun = true;
      std::this_thread::yield();
    }
  });
  while (!begun) std::this_thread::yield();
  web.reset();
  dribbles.join();
}

TEST(LiveHub, OnePageTooManyIsTold) {
  live::Web web(hub, "page", {});
  STRCMP_EQUAL("", web.start(0).c_str());
  std::vector<std::unique_ptr<test::Http>> pages;
  for (int page = 0; page < 12; ++page) {
    pages.push_back(std::make_unique<test::Http>(web.address(false), "GET /stream"));
    CHECK(pages.back()->says(" 200 "));
  }
  test::Http more(web.address(false), "GET /stream");
  CHECK_TEXT(more.says(" 503 ") && more.says("close one"), more.said.c_str());
  pages.pop_back();
  // The server learns of it when it looks, within half a second.
  bool taken = false;
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  while (!taken && std::chrono::steady_clock::now() < deadline) {
    taken = test::Http(web.address(false), "GET /stream", "Connection: close\r\n").says(" 200 ");
  }
  CHECK(taken);
}

TEST(LiveHub, TokensAreLongAndDiffer) {
  const std::string a = live::new_token();
  LONGS_EQUAL(32, a.size());
  CHECK(a.find_first_not_of("0123456789abcdef") == std::string::npos);
  CHECK(a != live::new_token());
}
