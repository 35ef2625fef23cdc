// SPDX-License-Identifier: Apache-2.0
// The far end of an emulated machine's USB port: the usbredir protocol (its public description, version 0.7), spoken
// by the side that has the device. Bytes in, bytes out; sockets and clocks are the caller's.
//
// Both sides say hello with what they can do; then this side describes the camera and plugs it in. Requests of endpoint
// 0 are answered at once, transfers of the stream when the camera has something for them.
// Hostile bytes end in broken(): a message longer than any that has a use here, one that is too short for its type, a
// hello that is none, more transfers at once than a host has. Nothing is read past what was sent.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <string>

#include "tests/system/usb_camera.hpp"

namespace holdfast::test {

class UsbredirPeer {
 public:
  static constexpr std::uint32_t kLongest = 70'000;  // of a message: a control transfer of 65535 bytes and its head
  static constexpr std::size_t kMostTransfers = 256;

  // `camera` outlives this object.
  explicit UsbredirPeer(UsbCamera& camera) : camera_(camera) {}

  // A connection was made: everything of an earlier one is forgotten.
  void begin();
  // False: the other side does not speak the protocol; broken() says how. The caller hangs up.
  [[nodiscard]] bool receive(std::span<const std::uint8_t> bytes);
  [[nodiscard]] const std::string& broken() const { return broken_; }
  // Answers the transfers for which the camera has something by now.
  void pump(Moment now);
  // When pump() may have something again by itself; none: not before the next receive().
  [[nodiscard]] std::optional<Moment> due() const;
  // To be sent; the caller takes it out.
  [[nodiscard]] Bytes& out() { return out_; }

  // The cable. It stays as it is told through begin().
  void plug();
  void unplug();
  [[nodiscard]] bool plugged() const { return wanted_; }
  [[nodiscard]] bool attached() const { return cable_ == Cable::kIn; }  // the other side knows of the device
  [[nodiscard]] bool refused() const { return refused_; }               // by the other side's filter
  [[nodiscard]] const std::string& other_side() const { return other_side_; }
  [[nodiscard]] std::size_t waiting() const { return transfers_.size(); }

 private:
  struct Transfer {
    std::uint64_t id = 0;
    std::size_t room = 0;
  };
  enum class Cable : std::uint8_t { kOut, kIn, kLeaving };  // leaving: the other side has yet to say that it knows

  [[nodiscard]] bool break_off(std::string reason);
  [[nodiscard]] bool take_hello(std::span<const std::uint8_t> body);
  [[nodiscard]] bool take(std::uint32_t type, std::uint64_t id, std::span<const std::uint8_t> body);
  [[nodiscard]] bool take_control(std::uint64_t id, std::span<const std::uint8_t> body);
  [[nodiscard]] bool take_bulk(std::uint64_t id, std::span<const std::uint8_t> body);
  void cancel(std::uint64_t id);
  void attach();
  void send(std::uint32_t type, std::uint64_t id, const Bytes& body);
  void send_bulk(std::uint64_t id, std::uint8_t endpoint, std::uint8_t status, const Bytes& data);
  [[nodiscard]] bool both_can(unsigned capability) const { return (capabilities_ >> capability & 1U) != 0; }
  [[nodiscard]] std::size_t header_size() const;

  UsbCamera& camera_;
  Bytes in_, out_;
  bool greeted_ = false;
  std::uint32_t capabilities_ = 0;  // of both sides
  std::string other_side_;
  std::string broken_;
  Cable cable_ = Cable::kOut;
  bool wanted_ = true;
  bool refused_ = false;
  std::deque<Transfer> transfers_;
};

}  // namespace holdfast::test
