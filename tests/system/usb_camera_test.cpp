// SPDX-License-Identifier: Apache-2.0
// The emulated camera against what a host expects of it: descriptors are walked as a host walks them, controls asked
// as the UVC driver asks, the stream put together again from its payloads.
#include "tests/system/usb_camera.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>
// last: it redefines new
#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace std::chrono_literals;

namespace {

using test::Bytes;
using test::Moment;
using test::UsbCamera;

constexpr Moment kStart{};

std::uint32_t word(const Bytes& bytes, std::size_t at, std::size_t size) {
  std::uint32_t value = 0;
  for (std::size_t k = size; k-- > 0;) value = value << 8 | bytes.at(at + k);
  return value;
}

// Pictures that differ in every byte, of lengths around those of payloads.
std::vector<Bytes> film_of(const std::vector<std::size_t>& sizes) {
  std::vector<Bytes> film;
  for (std::size_t k = 0; k < sizes.size(); ++k) {
    Bytes picture(sizes[k]);
    for (std::size_t i = 0; i < picture.size(); ++i) {
      picture[i] = static_cast<std::uint8_t>(i * 7 + i / 251 + 31 * k);
    }
    film.push_back(picture);
  }
  return film;
}

std::string string_at(UsbCamera& camera, std::uint32_t index) {
  const std::optional<Bytes> bytes =
      camera.control({0x80, 6, static_cast<std::uint16_t>(0x300 | index), 0x409, 255}, {});
  if (!bytes || bytes->size() < 2 || (*bytes)[0] != bytes->size()) return "none";
  std::string text;
  for (std::size_t k = 2; k + 1 < bytes->size(); k += 2) text += static_cast<char>(word(*bytes, k, 2));
  return text;
}

// One frame as a UVC driver puts it together; none: the stream gives nothing (more).
struct Frame {
  Bytes picture;
  std::uint8_t toggle = 0;
  bool error = false;
};
std::optional<Frame> read_frame(UsbCamera& camera, Moment now, std::size_t room = UsbCamera::kPayload) {
  Frame frame;
  for (bool first = true;; first = false) {
    const std::optional<Bytes> payload = camera.payload(room, now);
    if (!payload) return std::nullopt;
    if (payload->size() > room || payload->size() < 2 || (*payload)[0] != 2 || ((*payload)[1] & 0x80) == 0) {
      FAIL("no payload header");
    }
    const std::uint8_t flags = (*payload)[1];
    if (!first && (flags & 1) != frame.toggle) FAIL("the toggle changes within a frame");
    frame.toggle = static_cast<std::uint8_t>(flags & 1);
    frame.error = frame.error || (flags & 0x40) != 0;
    frame.picture.insert(frame.picture.end(), payload->begin() + 2, payload->end());
    if ((flags & 2) != 0) return frame;
    // What a transfer is not filled by ends a payload; only a whole one may fill it.
    if (room < UsbCamera::kPayload) CHECK(payload->size() < room);
  }
}

}  // namespace

TEST_GROUP(UsbCamera) {
  std::vector<Bytes> film = film_of({40'000, 16'382, 16'383, 1, 50'000});
  UsbCamera camera{film};

  std::optional<Bytes> ask(std::uint8_t request, std::uint8_t unit, std::uint8_t selector, std::uint16_t length = 64) {
    return camera.control(
        {0xa1, request, static_cast<std::uint16_t>(selector << 8), static_cast<std::uint16_t>(unit << 8), length}, {});
  }
  bool set(std::uint8_t unit, std::uint8_t selector, const Bytes& value) {
    return camera
        .control({0x21, 1, static_cast<std::uint16_t>(selector << 8), static_cast<std::uint16_t>(unit << 8),
                  static_cast<std::uint16_t>(value.size())},
                 value)
        .has_value();
  }
  std::uint32_t why() {
    const std::optional<Bytes> code = ask(0x81, 0, 2);
    return code ? word(*code, 0, 1) : 999;
  }
  std::optional<Bytes> ask_stream(std::uint8_t request, std::uint8_t selector) {
    return camera.control({0xa1, request, static_cast<std::uint16_t>(selector << 8), 1, 64}, {});
  }
  bool set_stream(std::uint8_t selector, const Bytes& value) {
    return camera
        .control({0x21, 1, static_cast<std::uint16_t>(selector << 8), 1, static_cast<std::uint16_t>(value.size())},
                 value)
        .has_value();
  }
  void start() {
    CHECK(camera.set_configuration(1));
    CHECK(set_stream(2, Bytes(26)));
  }
};

TEST(UsbCamera, IsTheSensorByIdsAndStrings) {
  const std::optional<Bytes> device = camera.control({0x80, 6, 0x100, 0, 18}, {});
  CHECK(device.has_value());
  LONGS_EQUAL(18, device->size());
  LONGS_EQUAL(18, (*device)[0]);
  LONGS_EQUAL(1, (*device)[1]);
  LONGS_EQUAL(0x0200, word(*device, 2, 2));
  LONGS_EQUAL(0x0c45, word(*device, 8, 2));
  LONGS_EQUAL(0x636d, word(*device, 10, 2));
  STRCMP_EQUAL("Arducam Technology Co., Ltd.", string_at(camera, (*device)[14]).c_str());
  STRCMP_EQUAL("GelSight Mini R0B 2BNN-4ZE7", string_at(camera, (*device)[15]).c_str());
  STRCMP_EQUAL("2BNN4ZE7", string_at(camera, (*device)[16]).c_str());
  LONGS_EQUAL(1, (*device)[17]);
  const std::optional<Bytes> languages = camera.control({0x80, 6, 0x300, 0, 255}, {});
  CHECK(languages.has_value());
  LONGS_EQUAL(0x0409, word(*languages, 2, 2));
  CHECK(!camera.control({0x80, 6, 0x3ee, 0x409, 255}, {}).has_value());
  CHECK(!camera.control({0x80, 6, 0x600, 0, 10}, {}).has_value());  // a device without another speed
}

// Every descriptor begins where the one before ends, says its own length, and the totals are those of what is there.
TEST(UsbCamera, DescriptorsHoldTogether) {
  const std::optional<Bytes> all = camera.control({0x80, 6, 0x200, 0, 0xffff}, {});
  CHECK(all.has_value());
  LONGS_EQUAL(all->size(), word(*all, 2, 2));
  LONGS_EQUAL(250, (*all)[8]);  // 500 mA
  int interfaces = 0, endpoints = 0, formats = 0, frames = 0;
  std::size_t class_end = 0;
  std::uint32_t interface = 99;
  for (std::size_t at = 0; at < all->size(); at += (*all)[at]) {
    const std::uint32_t length = (*all)[at], type = (*all)[at + 1];
    CHECK(length >= 2 && at + length <= all->size());
    if (class_end != 0 && type != 0x24) LONGS_EQUAL(class_end, at);
    if (type != 0x24) class_end = 0;
    if (type == 11) {
      LONGS_EQUAL(2, (*all)[at + 3]);
      LONGS_EQUAL(0x0e, (*all)[at + 4]);
      LONGS_EQUAL(3, (*all)[at + 5]);
      STRCMP_EQUAL("GelSight Mini R0B 2BNN-4ZE7", string_at(camera, (*all)[at + 7]).c_str());
    }
    if (type == 4) {
      LONGS_EQUAL(interfaces, (*all)[at + 2]);
      LONGS_EQUAL(interfaces == 0 ? 0 : 1, (*all)[at + 4]);
      LONGS_EQUAL(0x0e, (*all)[at + 5]);
      LONGS_EQUAL(interfaces + 1, (*all)[at + 6]);
      interface = (*all)[at + 2];
      ++interfaces;
    }
    if (type == 5) {
      ++endpoints;
      LONGS_EQUAL(UsbCamera::kEndpoint, (*all)[at + 2]);
      LONGS_EQUAL(2, (*all)[at + 3]);
      LONGS_EQUAL(512, word(*all, at + 4, 2));
    }
    if (type == 0x24 && (*all)[at + 2] == 1) {
      class_end = at + word(*all, at + (interface == 0 ? 5 : 4), 2);
      if (interface == 0) LONGS_EQUAL(0x0100, word(*all, at + 3, 2));
    }
    if (type == 0x24 && interface == 1 && (*all)[at + 2] == 6) ++formats;
    if (type == 0x24 && interface == 1 && (*all)[at + 2] == 7) {
      ++frames;
      LONGS_EQUAL(30, length);  // 26, and one interval
      LONGS_EQUAL(3280, word(*all, at + 5, 2));
      LONGS_EQUAL(2464, word(*all, at + 7, 2));
      LONGS_EQUAL(16'164'429, word(*all, at + 17, 4));
      LONGS_EQUAL(400'000, word(*all, at + 21, 4));
      LONGS_EQUAL(1, (*all)[at + 25]);
      LONGS_EQUAL(400'000, word(*all, at + 26, 4));
    }
    if (type == 0x24 && interface == 0 && (*all)[at + 2] == 2) LONGS_EQUAL(0x0e, word(*all, at + 15, 3));
    if (type == 0x24 && interface == 0 && (*all)[at + 2] == 5) {
      LONGS_EQUAL(11, length);  // UVC 1.0: no byte of video standards
      LONGS_EQUAL(0x177f, word(*all, at + 8, 2));
    }
  }
  LONGS_EQUAL(2, interfaces);
  LONGS_EQUAL(1, endpoints);
  LONGS_EQUAL(1, formats);
  LONGS_EQUAL(1, frames);
}

TEST(UsbCamera, AnAnswerIsNotLongerThanAskedFor) {
  LONGS_EQUAL(9, camera.control({0x80, 6, 0x200, 0, 9}, {})->size());
  LONGS_EQUAL(0, camera.control({0x80, 6, 0x100, 0, 0}, {})->size());
  LONGS_EQUAL(2, ask(0x84, 1, 4, 2)->size());
}

// The units' bits and the table name the same controls: a bit without a control would be one that refuses.
TEST(UsbCamera, EveryControlOfTheBitsIsThere) {
  struct Bit {
    std::uint8_t unit;
    int bit;
    std::uint8_t selector;
  };
  // UVC 1.0, tables 3-5 and 3-8.
  constexpr std::array<Bit, 14> kBits{{{1, 1, 2},
                                       {1, 2, 3},
                                       {1, 3, 4},
                                       {2, 0, 2},
                                       {2, 1, 3},
                                       {2, 2, 6},
                                       {2, 3, 7},
                                       {2, 4, 8},
                                       {2, 5, 9},
                                       {2, 6, 0xa},
                                       {2, 8, 1},
                                       {2, 9, 4},
                                       {2, 10, 5},
                                       {2, 12, 0xb}}};
  std::uint32_t camera_bits = 0, processing_bits = 0;
  for (const Bit& bit : kBits) {
    (bit.unit == 1 ? camera_bits : processing_bits) |= 1U << bit.bit;
    for (const std::uint8_t request : std::array<std::uint8_t, 7>{0x81, 0x82, 0x83, 0x84, 0x85, 0x86, 0x87}) {
      CHECK(ask(request, bit.unit, bit.selector).has_value());
    }
    const std::uint32_t size = word(*ask(0x85, bit.unit, bit.selector), 0, 2);
    LONGS_EQUAL(size, ask(0x81, bit.unit, bit.selector)->size());
  }
  LONGS_EQUAL(0x0e, camera_bits);
  LONGS_EQUAL(0x177f, processing_bits);
  LONGS_EQUAL(kBits.size(), test::kUsbControls.size());
  CHECK(!ask(0x81, 1, 6).has_value());  // focus: the sensor has none
  LONGS_EQUAL(6, why());
  CHECK(!ask(0x81, 4, 1).has_value());
  LONGS_EQUAL(5, why());
  CHECK(!ask(0x8f, 2, 2).has_value());
  LONGS_EQUAL(7, why());
  LONGS_EQUAL(0, why());  // told once
}

TEST(UsbCamera, RemembersWhatIsSetAndRefusesWhatIsOutOfRange) {
  LONGS_EQUAL(0xffc0, word(*ask(0x82, 2, 2), 0, 2));  // brightness from -64
  LONGS_EQUAL(64, word(*ask(0x83, 2, 2), 0, 2));
  CHECK(set(2, 2, {0xf0, 0xff}));
  LONGS_EQUAL(-16, *camera.control_value("brightness"));
  LONGS_EQUAL(0xfff0, word(*ask(0x81, 2, 2), 0, 2));
  CHECK(!set(2, 2, {65, 0}));
  LONGS_EQUAL(4, why());
  CHECK(!set(2, 2, {0xbf, 0xff}));  // -65
  CHECK(!set(2, 2, {1}));           // half a value
  CHECK(!set(2, 2, {1, 0, 0}));
  LONGS_EQUAL(-16, *camera.control_value("brightness"));
  CHECK(set(2, 9, {140, 0}));
  LONGS_EQUAL(140, *camera.control_value("gamma"));
  LONGS_EQUAL(100, word(*ask(0x87, 2, 9), 0, 2));  // the default stays
  camera.reset();
  LONGS_EQUAL(140, *camera.control_value("gamma"));  // the bus's reset is none of the sensor's
  CHECK(!camera.control_value("focus").has_value());
}

TEST(UsbCamera, WhatAnAutomaticSetsCannotBeSet) {
  LONGS_EQUAL(9, word(*ask(0x84, 1, 2), 0, 1));  // the modes there are
  LONGS_EQUAL(8, word(*ask(0x81, 1, 2), 0, 1));
  LONGS_EQUAL(7, word(*ask(0x86, 1, 4), 0, 1));
  CHECK(!set(1, 4, {180, 0, 0, 0}));
  LONGS_EQUAL(2, why());
  CHECK(!set(1, 2, {2}));  // full automatic, which it has not
  CHECK(set(1, 2, {1}));
  LONGS_EQUAL(3, word(*ask(0x86, 1, 4), 0, 1));
  CHECK(set(1, 4, {180, 0, 0, 0}));
  LONGS_EQUAL(180, *camera.control_value("exposure_absolute"));
  CHECK(!set(2, 0xa, {0x94, 0x11}));
  CHECK(set(2, 0xb, {0}));
  CHECK(set(2, 0xa, {0x94, 0x11}));
  LONGS_EQUAL(4500, *camera.control_value("white_balance_temperature"));
}

TEST(UsbCamera, OffersItsOneModeWhateverIsAskedFor) {
  CHECK(!set_stream(1, Bytes(26)));  // not configured yet
  CHECK(camera.set_configuration(1));
  CHECK(set_stream(1, Bytes(26, 0xff)));
  CHECK(!camera.streaming());
  CHECK(!set_stream(1, Bytes(25)));
  CHECK(!set_stream(2, Bytes(34)));  // that of UVC 1.1
  CHECK(!set_stream(3, Bytes(26)));
  for (const std::uint8_t request : std::array<std::uint8_t, 4>{0x81, 0x82, 0x83, 0x87}) {
    const std::optional<Bytes> mode = ask_stream(request, 1);
    CHECK(mode.has_value());
    LONGS_EQUAL(26, mode->size());
    LONGS_EQUAL(1, (*mode)[2]);
    LONGS_EQUAL(1, (*mode)[3]);
    LONGS_EQUAL(400'000, word(*mode, 4, 4));
    LONGS_EQUAL(16'164'429, word(*mode, 18, 4));
    LONGS_EQUAL(UsbCamera::kPayload, word(*mode, 22, 4));
  }
  CHECK(!camera.payload(UsbCamera::kPayload, kStart).has_value());  // nothing before it is committed
  CHECK(set_stream(2, Bytes(26)));
  CHECK(camera.payload(UsbCamera::kPayload, kStart).has_value());
}

TEST(UsbCamera, SendsThePicturesByteForByte) {
  start();
  camera.set_period(0us);
  std::uint8_t toggle = 9;
  for (std::size_t k = 0; k < 2 * film.size(); ++k) {
    const std::optional<Frame> frame = read_frame(camera, kStart);
    CHECK(frame.has_value());
    CHECK(frame->picture == film[k % film.size()]);
    CHECK(frame->toggle != toggle);
    CHECK(!frame->error);
    toggle = frame->toggle;
    LONGS_EQUAL(k % film.size(), camera.picture());
  }
  LONGS_EQUAL(2 * film.size(), camera.frames());
}

TEST(UsbCamera, SendsThemInTransfersOfAnyLength) {
  for (const std::size_t room : {4U, 512U, 1024U, 8192U, 16'385U, 65'536U}) {
    UsbCamera other(film_of({3000, 20'000}));
    CHECK(other.set_configuration(1));
    CHECK(other.control({0x21, 1, 0x200, 1, 26}, Bytes(26)).has_value());
    CHECK(read_frame(other, kStart, room)->picture == film_of({3000, 20'000})[0]);
    CHECK(read_frame(other, kStart + 40ms, room)->picture == film_of({3000, 20'000})[1]);
  }
  start();
  for (const std::size_t room : {0U, 1U, 2U, 3U}) CHECK(!camera.payload(room, kStart).has_value());
}

TEST(UsbCamera, BeginsAFrameEachPeriodAndDoesNotCatchUp) {
  start();
  camera.set_period(40ms);
  CHECK(read_frame(camera, kStart).has_value());
  CHECK(!camera.payload(UsbCamera::kPayload, kStart + 39ms).has_value());
  CHECK(camera.due() == kStart + 40ms);
  CHECK(read_frame(camera, kStart + 50ms).has_value());  // a little late: the beat stays
  CHECK(camera.due() == kStart + 80ms);
  CHECK(read_frame(camera, kStart + 500ms).has_value());  // far too late: it begins anew
  CHECK(camera.due() == kStart + 540ms);
  CHECK(!camera.payload(UsbCamera::kPayload, kStart + 501ms).has_value());
}

TEST(UsbCamera, PlaysWhatItIsTold) {
  start();
  camera.set_period(0us);
  camera.play({1, 2});
  for (const std::size_t picture : {1U, 2U, 1U}) CHECK(read_frame(camera, kStart)->picture == film[picture]);
  camera.play({3, 3}, UsbCamera::Play{0, 1});
  for (const std::size_t picture : {0U, 1U, 3U, 3U}) CHECK(read_frame(camera, kStart)->picture == film[picture]);
  camera.play({0, 4});
  camera.allow(2);
  CHECK(read_frame(camera, kStart).has_value());
  CHECK(read_frame(camera, kStart).has_value());
  CHECK(!read_frame(camera, kStart).has_value());
  CHECK(!camera.due().has_value());
  camera.allow(std::nullopt);
  CHECK(read_frame(camera, kStart)->picture == film[2]);
}

TEST(UsbCamera, HasTheFaultsItIsTold) {
  start();
  camera.set_period(0us);
  camera.truncate(1);
  camera.fail(2);
  const std::optional<Frame> torn = read_frame(camera, kStart);
  CHECK(torn->error);
  CHECK(torn->picture == Bytes(film[0].begin(), film[0].begin() + 20'000));
  CHECK(read_frame(camera, kStart)->error);
  CHECK(!read_frame(camera, kStart)->error);
  camera.freeze(true);
  const std::uint8_t toggle = read_frame(camera, kStart)->toggle;
  const std::optional<Frame> again = read_frame(camera, kStart);
  CHECK(again->picture == film[2]);
  CHECK(again->toggle != toggle);
  camera.freeze(false);
  CHECK(read_frame(camera, kStart)->picture == film[3]);

  CHECK(camera.payload(UsbCamera::kPayload, kStart).has_value());  // the first of four
  camera.stall(true);
  CHECK(!camera.payload(UsbCamera::kPayload, kStart).has_value());
  CHECK(!camera.due().has_value());
  camera.stall(false);
  const std::optional<Frame> rest = read_frame(camera, kStart);
  CHECK(rest->picture == Bytes(film[4].begin() + 16'382, film[4].end()));
}

// Noise of its own for each frame, by the frame's number; a frozen picture keeps what it had.
TEST(UsbCamera, NoFrameIsLikeAnotherUntilItFreezes) {
  camera.set_grain([](const Bytes& picture, std::uint64_t frame) {
    Bytes other = picture;
    other.push_back(static_cast<std::uint8_t>(frame));
    return other;
  });
  const auto with = [this](std::size_t picture, std::uint8_t frame) {
    Bytes other = film[picture];
    other.push_back(frame);
    return other;
  };
  start();
  camera.set_period(0us);
  camera.play({1, 1});
  CHECK(read_frame(camera, kStart)->picture == with(1, 1));
  CHECK(read_frame(camera, kStart)->picture == with(1, 2));
  camera.freeze(true);
  CHECK(read_frame(camera, kStart)->picture == with(1, 2));
  CHECK(read_frame(camera, kStart)->picture == with(1, 2));
  camera.freeze(false);
  CHECK(read_frame(camera, kStart)->picture == with(1, 5));
}

// As the kernel's driver stops a bulk stream: the next one begins with a whole picture.
TEST(UsbCamera, ClearingTheEndpointStopsTheStream) {
  start();
  CHECK(camera.payload(UsbCamera::kPayload, kStart).has_value());
  CHECK(camera.control({0x02, 1, 0, UsbCamera::kEndpoint, 0}, {}).has_value());
  CHECK(!camera.streaming());
  CHECK(!camera.payload(UsbCamera::kPayload, kStart).has_value());
  CHECK(set_stream(2, Bytes(26)));
  CHECK(read_frame(camera, kStart)->picture == film[1]);
  CHECK(camera.set_configuration(1));
  CHECK(!camera.streaming());
}

TEST(UsbCamera, TakesOnlyTheConfigurationAndSettingsItHas) {
  CHECK(!camera.set_interface(1, 0));
  CHECK(!camera.set_configuration(2));
  CHECK(camera.set_configuration(1));
  CHECK(camera.set_interface(1, 0));
  CHECK(!camera.set_interface(1, 1));
  CHECK(!camera.set_interface(2, 0));
}

TEST(UsbCamera, IsALookAlikeWhenTold) {
  test::UsbIdentity other;
  other.product = 0x6366;
  other.name = std::string(300, 'x');  // longer than a descriptor can hold
  other.serial = "";
  camera.set_identity(other);
  const Bytes device = camera.device_descriptor();
  LONGS_EQUAL(0x6366, word(device, 10, 2));
  LONGS_EQUAL(126, string_at(camera, device[15]).size());
  STRCMP_EQUAL("", string_at(camera, device[16]).c_str());
}

// Whatever is asked: an answer no longer than asked for, or none.
TEST(UsbCamera, AnyRequestIsAnsweredOrRefused) {
  std::uint32_t random = 1;
  const auto draw = [&random] { return static_cast<std::uint16_t>((random = random * 1664525U + 1013904223U) >> 16); };
  int answered = 0;
  for (int k = 0; k < 200'000; ++k) {
    constexpr std::array<std::uint8_t, 8> kTypes{0x80, 0x00, 0x02, 0xa1, 0x21, 0x01, 0x81, 0x82};
    test::UsbSetup setup;
    setup.request_type = k % 3 == 0 ? static_cast<std::uint8_t>(draw()) : kTypes[draw() % kTypes.size()];
    setup.request = static_cast<std::uint8_t>(k % 2 == 0 ? draw() % 12 : 0x80 + draw() % 9);
    setup.value = k % 5 == 0 ? draw() : static_cast<std::uint16_t>((draw() % 12) << 8);
    setup.index = k % 5 == 1 ? draw() : static_cast<std::uint16_t>((draw() % 5) << 8 | draw() % 3);
    setup.length = static_cast<std::uint16_t>(draw() % 64);
    const bool in = (setup.request_type & 0x80) != 0;
    const std::optional<Bytes> answer = camera.control(setup, Bytes(in ? 0 : setup.length, 0xa5));
    if (answer) {
      CHECK(answer->size() <= setup.length);
      ++answered;
    }
  }
  CHECK(answered > 1000);
}
