// SPDX-License-Identifier: Apache-2.0
#include "tests/system/usbredir.hpp"

#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <span>

namespace holdfast::test {
namespace {

constexpr std::size_t kStream = 16 + (UsbCamera::kEndpoint & 0xf);  // endpoints to the host are the upper half

// As the library has it: 0, nothing by now; -1, nothing ever again.
int result_of(ssize_t count) {
  return count >= 0 ? static_cast<int>(count) : errno == EAGAIN || errno == EINTR ? 0 : -1;
}

}  // namespace

void UsbredirPeer::begin(int socket) {
  socket_ = socket;
  transfers_.clear();
  cable_ = Cable::kOut;
  parser_.reset(usbredirparser_create());
  usbredirparser& parser = *parser_;
  parser.priv = this;
  parser.log_func = [](void*, int level, const char* text) {
    if (level <= usbredirparser_warning) std::fprintf(stderr, "%s\n", text);
  };
  parser.read_func = [](void* self, std::uint8_t* data, int size) {
    const ssize_t count = ::read(static_cast<UsbredirPeer*>(self)->socket_, data, static_cast<std::size_t>(size));
    return count == 0 ? -1 : result_of(count);
  };
  parser.write_func = [](void* self, std::uint8_t* data, int size) {
    return result_of(
        ::send(static_cast<UsbredirPeer*>(self)->socket_, data, static_cast<std::size_t>(size), MSG_NOSIGNAL));
  };
  parser.hello_func = [](void* self, usb_redir_hello_header*) {
    auto& peer = *static_cast<UsbredirPeer*>(self);
    if (peer.wanted_) peer.attach();
  };
  parser.device_disconnect_ack_func = [](void* self) {
    auto& peer = *static_cast<UsbredirPeer*>(self);
    peer.cable_ = Cable::kOut;
    if (peer.wanted_) peer.attach();
  };
  parser.reset_func = &heard<&UsbredirPeer::reset>;
  parser.set_configuration_func = &heard<&UsbredirPeer::set_configuration>;
  parser.get_configuration_func = &heard<&UsbredirPeer::get_configuration>;
  parser.set_alt_setting_func = &heard<&UsbredirPeer::set_interface>;
  parser.get_alt_setting_func = &heard<&UsbredirPeer::get_interface>;
  parser.cancel_data_packet_func = &heard<&UsbredirPeer::cancel>;
  parser.control_packet_func = &heard<&UsbredirPeer::control>;
  parser.bulk_packet_func = &heard<&UsbredirPeer::bulk>;
  // Of endpoints that it does not have.
  const auto no_answer = [](auto...) {};
  parser.start_iso_stream_func = no_answer;
  parser.stop_iso_stream_func = no_answer;
  parser.start_interrupt_receiving_func = no_answer;
  parser.stop_interrupt_receiving_func = no_answer;
  parser.iso_packet_func = no_answer;
  parser.interrupt_packet_func = no_answer;
  // An emulated xHCI refuses a device whose side lacks packet sizes or 64-bit ids.
  std::array<std::uint32_t, USB_REDIR_CAPS_SIZE> capabilities{};
  for (const int capability :
       {usb_redir_cap_connect_device_version, usb_redir_cap_device_disconnect_ack,
        usb_redir_cap_ep_info_max_packet_size, usb_redir_cap_64bits_ids, usb_redir_cap_32bits_bulk_length}) {
    usbredirparser_caps_set_cap(capabilities.data(), capability);
  }
  usbredirparser_init(&parser, "holdfast emulated camera", capabilities.data(), USB_REDIR_CAPS_SIZE,
                      usbredirparser_fl_usb_host);
}

// Endpoints first: the other side looks at them when the device comes.
void UsbredirPeer::attach() {
  camera_.reset();
  usb_redir_ep_info_header endpoints{};
  std::fill(std::begin(endpoints.type), std::end(endpoints.type), std::uint8_t{usb_redir_type_invalid});
  endpoints.type[0] = endpoints.type[16] = usb_redir_type_control;
  endpoints.max_packet_size[0] = endpoints.max_packet_size[16] = 64;
  endpoints.type[kStream] = usb_redir_type_bulk;
  endpoints.max_packet_size[kStream] = UsbCamera::kPacket;
  endpoints.interface[kStream] = 1;
  usbredirparser_send_ep_info(parser_.get(), &endpoints);
  usb_redir_interface_info_header interfaces{};
  interfaces.interface_count = 2;
  for (std::uint8_t k = 0; k < 2; ++k) {
    interfaces.interface[k] = k;
    interfaces.interface_class[k] = 0x0e;
    interfaces.interface_subclass[k] = static_cast<std::uint8_t>(k + 1);  // of control, of the stream
  }
  usbredirparser_send_interface_info(parser_.get(), &interfaces);
  const UsbIdentity& identity = camera_.identity();
  usb_redir_device_connect_header device{usb_redir_speed_high, 0xef, 2, 1, identity.vendor, identity.product, 0x0100};
  usbredirparser_send_device_connect(parser_.get(), &device);
  cable_ = Cable::kIn;
}

void UsbredirPeer::plug() {
  wanted_ = true;
  if (parser_ != nullptr && usbredirparser_have_peer_caps(parser_.get()) != 0 && cable_ == Cable::kOut) attach();
}

void UsbredirPeer::unplug() {
  wanted_ = false;
  if (cable_ != Cable::kIn) return;
  transfers_.clear();
  camera_.reset();
  usbredirparser_send_device_disconnect(parser_.get());
  cable_ = can(usb_redir_cap_device_disconnect_ack) ? Cable::kLeaving : Cable::kOut;
}

void UsbredirPeer::set_configuration(std::uint64_t id, usb_redir_set_configuration_header* asked) {
  usb_redir_configuration_status_header answer{};
  answer.status = camera_.set_configuration(asked->configuration) ? usb_redir_success : usb_redir_inval;
  answer.configuration = camera_.configuration();
  usbredirparser_send_configuration_status(parser_.get(), id, &answer);
}

void UsbredirPeer::get_configuration(std::uint64_t id) {
  usb_redir_configuration_status_header answer{usb_redir_success, camera_.configuration()};
  usbredirparser_send_configuration_status(parser_.get(), id, &answer);
}

void UsbredirPeer::set_interface(std::uint64_t id, usb_redir_set_alt_setting_header* asked) {
  usb_redir_alt_setting_status_header answer{usb_redir_success, asked->interface, 0};
  if (!camera_.set_interface(asked->interface, asked->alt)) answer.status = usb_redir_inval;
  usbredirparser_send_alt_setting_status(parser_.get(), id, &answer);
}

void UsbredirPeer::get_interface(std::uint64_t id, usb_redir_get_alt_setting_header* asked) {
  usb_redir_alt_setting_status_header answer{usb_redir_success, asked->interface, 0};
  usbredirparser_send_alt_setting_status(parser_.get(), id, &answer);
}

void UsbredirPeer::control(std::uint64_t id, usb_redir_control_packet_header* asked, std::uint8_t* data, int size) {
  const UsbSetup setup{asked->requesttype, asked->request, asked->value, asked->index, asked->length};
  const bool in = (setup.request_type & 0x80) != 0;
  std::optional<Bytes> found = camera_.control(setup, {data, static_cast<std::size_t>(size)});
  usbredirparser_free_packet_data(parser_.get(), data);
  usb_redir_control_packet_header answer = *asked;
  answer.status = found ? usb_redir_success : usb_redir_stall;
  if (!found || !in) found.emplace();
  answer.length = in || answer.status != usb_redir_success ? static_cast<std::uint16_t>(found->size()) : setup.length;
  usbredirparser_send_control_packet(parser_.get(), id, &answer, found->data(), static_cast<int>(found->size()));
}

void UsbredirPeer::bulk(std::uint64_t id, usb_redir_bulk_packet_header* asked, std::uint8_t* data, int) {
  usbredirparser_free_packet_data(parser_.get(), data);
  const std::uint32_t high = can(usb_redir_cap_32bits_bulk_length) ? asked->length_high : 0U;
  const std::uint32_t room = high << 16 | asked->length;
  if (asked->endpoint != UsbCamera::kEndpoint || room == 0) return send_bulk(id, asked->endpoint, usb_redir_inval, {});
  transfers_.push_back({id, room});
}

void UsbredirPeer::cancel(std::uint64_t id) {
  // None: its answer is on the way.
  if (std::erase_if(transfers_, [id](const Transfer& transfer) { return transfer.id == id; }) == 0) return;
  send_bulk(id, UsbCamera::kEndpoint, usb_redir_cancelled, {});
}

void UsbredirPeer::send_bulk(std::uint64_t id, std::uint8_t endpoint, std::uint8_t status, Bytes data) {
  usb_redir_bulk_packet_header answer{};
  answer.endpoint = endpoint;
  answer.status = status;
  answer.length = static_cast<std::uint16_t>(data.size());
  answer.length_high = static_cast<std::uint16_t>(data.size() >> 16);
  usbredirparser_send_bulk_packet(parser_.get(), id, &answer, data.data(), static_cast<int>(data.size()));
}

void UsbredirPeer::pump(Moment now) {
  while (!transfers_.empty() && cable_ == Cable::kIn) {
    std::optional<Bytes> data = camera_.payload(transfers_.front().room, now);
    if (!data) return;
    send_bulk(transfers_.front().id, UsbCamera::kEndpoint, usb_redir_success, std::move(*data));
    transfers_.pop_front();
  }
}

}  // namespace holdfast::test
