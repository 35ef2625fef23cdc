// SPDX-License-Identifier: Apache-2.0
// The far end of an emulated machine's USB port: usbredir, by its own library, on the side that has the device.
// Requests of endpoint 0 are answered at once, transfers of the stream when the camera has something for them.
#pragma once

#include <usbredirparser.h>

#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>

#include "tests/system/usb_camera.hpp"

namespace holdfast::test {

class UsbredirPeer {
 public:
  // `camera` outlives this object.
  explicit UsbredirPeer(UsbCamera& camera) : camera_(camera) {}

  // A connection was made: everything of an earlier one is forgotten. `socket` does not block.
  void begin(int socket);
  // Whatever came, and whatever waits to be sent. False: the other side has gone or does not speak the protocol, and
  // the caller hangs up.
  [[nodiscard]] bool receive() { return usbredirparser_do_read(parser_.get()) == 0; }
  [[nodiscard]] bool send() { return usbredirparser_do_write(parser_.get()) == 0; }
  [[nodiscard]] bool backlog() const { return usbredirparser_has_data_to_write(parser_.get()) > 0; }
  // Answers the transfers for which the camera has something by now.
  void pump(Moment now);
  // When pump() may have something again by itself; none: not before the next receive().
  [[nodiscard]] std::optional<Moment> due() const { return transfers_.empty() ? std::nullopt : camera_.due(); }

  // The cable. It stays as it is told through begin().
  void plug();
  void unplug();

 private:
  struct Transfer {
    std::uint64_t id = 0;
    std::uint32_t room = 0;
  };
  struct Free {
    void operator()(usbredirparser* parser) const { usbredirparser_destroy(parser); }
  };
  enum class Cable : std::uint8_t { kOut, kIn, kLeaving };  // leaving: the other side has yet to say that it knows

  // A callback of the library: what is meant for a device that was unplugged meanwhile is passed over.
  template <auto kTake, typename... Args>
  static void heard(void* self, Args... args) {
    auto& peer = *static_cast<UsbredirPeer*>(self);
    if (peer.cable_ == Cable::kIn) (peer.*kTake)(args...);
  }
  [[nodiscard]] bool can(int capability) const { return usbredirparser_peer_has_cap(parser_.get(), capability) != 0; }
  void attach();
  void reset() { camera_.reset(); }
  void set_configuration(std::uint64_t id, usb_redir_set_configuration_header* asked);
  void get_configuration(std::uint64_t id);
  void set_interface(std::uint64_t id, usb_redir_set_alt_setting_header* asked);
  void get_interface(std::uint64_t id, usb_redir_get_alt_setting_header* asked);
  void cancel(std::uint64_t id);
  void control(std::uint64_t id, usb_redir_control_packet_header* asked, std::uint8_t* data, int size);
  void bulk(std::uint64_t id, usb_redir_bulk_packet_header* asked, std::uint8_t* data, int size);
  void send_bulk(std::uint64_t id, std::uint8_t endpoint, std::uint8_t status, Bytes data);

  UsbCamera& camera_;
  std::unique_ptr<usbredirparser, Free> parser_;
  int socket_ = -1;
  Cable cable_ = Cable::kOut;
  bool wanted_ = true;
  std::deque<Transfer> transfers_;
};

}  // namespace holdfast::test
