// SPDX-License-Identifier: Apache-2.0
// What must hold for the firmware's Hand-E whatever comes out of its serial port, for libFuzzer (modbus_fuzz.cpp) and
// for the tests. The input is a script: each byte's low three bits say what happens, its others how much (see play()).
// What is a right reply is judged here from the bytes of the request and the definition of the CRC.
#pragma once

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <random>
#include <span>
#include <string>
#include <vector>

#include "grip/hande.hpp"
#include "hal/serial.hpp"
#include "tests/support/modbus_bytes.hpp"

namespace holdfast::test {

inline bool sealed(std::span<const std::uint8_t> frame) {
  if (frame.size() < 4) return false;
  const std::uint16_t crc = modbus_crc(frame.first(frame.size() - 2));
  return frame[frame.size() - 2] == (crc & 0xFF) && frame[frame.size() - 1] == crc >> 8;
}

// Keeps what was asked last, and what was read since then.
class ModbusPort final : public hal::Serial {
 public:
  ModbusBytes waiting;
  ModbusBytes request;
  ModbusBytes heard;
  std::size_t read_bytes = 0, read_calls = 0, writes = 0;  // set back by whoever counts
  bool out = false;

 private:
  bool do_write(std::span<const std::uint8_t> bytes) override {
    ++writes;
    if (out) return false;
    request.assign(bytes.begin(), bytes.end());
    heard.clear();
    return true;
  }
  std::size_t do_read(std::span<std::uint8_t> bytes) override {
    const std::size_t count = std::min(bytes.size(), waiting.size());
    std::copy_n(waiting.begin(), count, bytes.begin());
    heard.insert(heard.end(), waiting.begin(), waiting.begin() + static_cast<std::ptrdiff_t>(count));
    waiting.erase(waiting.begin(), waiting.begin() + static_cast<std::ptrdiff_t>(count));
    read_bytes += count;
    ++read_calls;
    return count;
  }
};

class ModbusScript {
 public:
  explicit ModbusScript(std::span<const std::uint8_t> bytes) : bytes_(bytes) { (void)next(); }

  // A finding in words; empty: nothing to say.
  std::string play() {
    while (finding_.empty() && at_ < bytes_.size()) {
      const std::uint8_t op = next();
      const std::size_t much = op >> 3;
      switch (op & 7) {
        case 0:  // any bytes
          for (std::size_t i = 0; i <= much; ++i) port_.waiting.push_back(next());
          break;
        case 1:  // the right reply
          say(reply(), 0);
          break;
        case 2: {  // changed in one byte
          ModbusBytes frame = reply();
          if (!frame.empty()) frame[much % frame.size()] ^= next();
          say(frame, 0);
          break;
        }
        case 3:  // cut short
          say(reply(), much + 1);
          break;
        case 4:
          now_ += std::chrono::milliseconds(4 * much);
          break;
        case 5:
          now_ += std::chrono::milliseconds(100 * much);
          break;
        case 6:
          wanted_ = {(much & 1) != 0, next(), next(), next(), (much & 8) != 0};
          break;
        default:
          port_.out = (much & 1) != 0;
      }
      call();
      if (port_.waiting.size() > 8192) port_.waiting.resize(8192);
    }
    return finding_;
  }

 private:
  std::uint8_t next() { return at_ < bytes_.size() ? bytes_[at_++] : std::uint8_t{0}; }

  // To the last request; what it brings comes from the script, with a gripper that is active more often than not.
  ModbusBytes reply() {
    const ModbusBytes& asked = port_.request;
    if (asked.size() < 8) return {};
    ModbusBytes frame{asked[0], asked[1]};
    if (asked[1] == 16) {
      frame.insert(frame.end(), asked.begin() + 2, asked.begin() + 6);
    } else {
      const unsigned bytes = 2U * asked[5];
      frame.push_back(static_cast<std::uint8_t>(bytes));
      for (unsigned i = 0; i < bytes; ++i) frame.push_back(i < 6 ? next() : std::uint8_t{0});
    }
    seal(frame);
    return frame;
  }
  void say(const ModbusBytes& frame, std::size_t less) {
    if (less >= frame.size()) return;
    port_.waiting.insert(port_.waiting.end(), frame.begin(), frame.end() - static_cast<std::ptrdiff_t>(less));
  }

  void expect(bool holds, const char* what) {
    if (!holds && finding_.empty()) finding_ = what;
  }

  // By its bytes: a reply to the request before, and nothing else.
  static bool is_reply(const ModbusBytes& asked, const ModbusBytes& heard) {
    if (asked.size() < 8 || heard.size() < 7 || !sealed(heard) || heard[0] != asked[0] || heard[1] != asked[1]) {
      return false;
    }
    if (asked[1] == 16) return heard.size() == 8 && std::equal(&heard[2], &heard[6], &asked[2]);
    return heard[2] == 2 * asked[5] && heard.size() == 5U + heard[2];
  }

  void check_request() {
    const ModbusBytes& asked = port_.request;
    expect(sealed(asked) && asked[0] == config_.bus.slave, "a request that is none");
    expect(sent_ < Micros{0} || now_ - sent_ >= Micros{5'000}, "two requests within 5 ms");
    sent_ = now_;
    if (asked[1] != 16) return;
    const std::uint8_t action = asked[asked.size() - 8];
    expect(action == 0 || action == 1 || action == 9, "an action that nobody wanted");
  }

  void call() {
    now_ += std::chrono::milliseconds(1);
    const std::uint32_t requests = state_.bus.counters.requests;
    const std::uint32_t replies = state_.bus.counters.replies;
    const ModbusBytes asked = port_.request;
    port_.read_bytes = port_.read_calls = port_.writes = 0;
    const ModbusBytes before = port_.heard;
    const ModbusBytes waiting = port_.waiting;
    const hande::Feedback seen = hande::update(state_, config_, port_, wanted_, now_);
    expect(port_.read_bytes <= 2 * modbus_rtu::kMostBytesPerUpdate, "too many bytes read in a call");
    expect(port_.read_calls <= 2 * modbus_rtu::kMaxReply, "too many reads in a call");
    expect(port_.writes <= 1, "two requests in a call");
    if (state_.bus.counters.replies != replies) {
      // Every byte of the reply, and none behind it, was read by the first half of the call.
      const ModbusBytes heard = reply_read(before, waiting, asked);
      expect(state_.bus.counters.replies == replies + 1 && is_reply(asked, heard), "took what is no reply");
      if (asked.size() > 1 && asked[1] != 16) {
        good_ = asked_at_;
        position_ = heard.size() > 7 ? heard[7] : std::uint8_t{0};
      }
    }
    if (state_.bus.counters.requests != requests) {
      check_request();
      asked_at_ = now_;
    }
    expect(!seen.fresh || (good_ >= Micros{0} && now_ - good_ <= config_.fresh_for && seen.position == position_),
           "fresh without a good reply");
    expect(good_ >= Micros{0} || (!seen.activated && !seen.holding && !seen.moving), "knows what it was never told");
    expect(!(seen.holding && seen.lost), "holds what it lost");
  }

  static ModbusBytes reply_read(ModbusBytes heard, const ModbusBytes& waiting, const ModbusBytes& asked) {
    if (asked.size() < 8) return {};
    const std::size_t whole = asked[1] == 16 ? 8 : 5U + 2U * asked[5];
    const std::size_t missing = whole > heard.size() ? whole - heard.size() : 0;
    heard.insert(heard.end(), waiting.begin(),
                 waiting.begin() + static_cast<std::ptrdiff_t>(std::min(missing, waiting.size())));
    return heard;
  }

  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = 0;
  hande::Config config_;
  hande::State state_;
  hande::Wanted wanted_;
  ModbusPort port_;
  Micros now_{1'000'000};
  Micros sent_{-1};
  Micros asked_at_{};
  Micros good_{-1};
  std::uint8_t position_ = 0;
  std::string finding_;
};

// Empty: nothing to say.
inline std::string check_modbus_bytes(std::span<const std::uint8_t> bytes) {
  return ModbusScript(bytes).play();
}

// Scripts of whole lives: activation, a grip, its loss, faults, and each trouble of the line.
inline std::vector<ModbusBytes> modbus_seeds() {
  std::vector<ModbusBytes> seeds;
  for (std::uint8_t mode = 0; mode < 4; ++mode) {
    const auto life = [&](auto tell) {
      ModbusBytes script{mode};
      const auto wait = [&](unsigned ms) { script.push_back(static_cast<std::uint8_t>(4 | (ms / 4) << 3)); };
      // The reply to what is asked next: an acknowledgement takes none of the six bytes, which then are bytes of noise.
      const auto status = [&](unsigned action, unsigned fault, unsigned echo, unsigned position, unsigned current) {
        wait(28);
        script.push_back(1);
        for (const unsigned byte : {action, 0U, fault, echo, position, current}) {
          script.push_back(static_cast<std::uint8_t>(byte));
        }
      };
      const auto want = [&](unsigned flags, unsigned position) {
        script.push_back(static_cast<std::uint8_t>(6 | flags << 3));
        for (const unsigned byte : {position, 255U, 30U}) script.push_back(static_cast<std::uint8_t>(byte));
      };
      tell(script, status, want);
      seeds.push_back(script);
    };
    life([](auto& /*script*/, auto status, auto want) {
      status(0x00, 0, 0, 13, 0);
      for (int i = 0; i < 4; ++i) status(0x11, 0, 0, 13, 0);
      status(0x31, 0, 0, 13, 0);
      want(1, 255);
      for (int i = 0; i < 3; ++i) status(0x39, 0, 255, 100, 10);
      for (int i = 0; i < 3; ++i) status(0xB9, 0, 255, 189, 0);
      for (int i = 0; i < 3; ++i) status(0xF9, 0, 255, 230, 0);
    });
    life([](auto& script, auto status, auto want) {
      want(1, 255);
      for (int i = 0; i < 4; ++i) status(0xF9, 0, 255, 200, 5);
      for (int i = 0; i < 3; ++i) status(0xB9, 0xE, 255, 200, 0);
      want(9, 255);
      for (int i = 0; i < 8; ++i) status(i % 2 == 0 ? 0x00 : 0x31, 0, 255, 200, 0);
      const ModbusBytes troubles{2, 55, 1, 3, 250, 0, 85, 7, 15, 7, 253};
      script.insert(script.end(), troubles.begin(), troubles.end());
      for (int i = 0; i < 8; ++i) status(0xF9, 9, 255, 200, 5);
      want(7, 0);
      for (int i = 0; i < 3; ++i) status(0x01, 0xB, 255, 100, 5);
      for (int i = 0; i < 3; ++i) status(0x01, 0xF, 255, 13, 5);
    });
  }
  return seeds;
}

}  // namespace holdfast::test
