// SPDX-License-Identifier: Apache-2.0
#include "tests/system/usbredir.hpp"

#include <algorithm>
#include <string_view>
#include <utility>

namespace holdfast::test {
namespace {

// Types of messages.
constexpr std::uint32_t kHello = 0, kDeviceConnect = 1, kDeviceDisconnect = 2, kReset = 3, kInterfaceInfo = 4,
                        kEndpointInfo = 5, kSetConfiguration = 6, kGetConfiguration = 7, kConfigurationStatus = 8,
                        kSetAltSetting = 9, kGetAltSetting = 10, kAltSettingStatus = 11, kStartIso = 12, kStopIso = 13,
                        kIsoStatus = 14, kStartInterrupt = 15, kStopInterrupt = 16, kInterruptStatus = 17,
                        kAllocStreams = 18, kFreeStreams = 19, kStreamsStatus = 20, kCancelData = 21,
                        kFilterReject = 22, kDisconnectAck = 24, kControlPacket = 100, kBulkPacket = 101;

// Capabilities, as bits. An emulated xHCI refuses a device whose side lacks packet sizes or 64-bit ids.
constexpr unsigned kConnectVersion = 1, kCanAckDisconnect = 3, kMaxPacketSize = 4, kIds64 = 5, kLongBulk = 6;
constexpr std::uint32_t kOurs =
    1U << kConnectVersion | 1U << kCanAckDisconnect | 1U << kMaxPacketSize | 1U << kIds64 | 1U << kLongBulk;

constexpr std::uint8_t kSuccess = 0, kCancelled = 1, kInvalid = 2, kStall = 4;
constexpr std::uint8_t kHighSpeed = 2;
constexpr std::size_t kVersionText = 64;
constexpr std::size_t kMostEndpoints = 32;
constexpr std::size_t kControlHead = 10;

std::uint32_t word(std::span<const std::uint8_t> bytes, std::size_t at, std::size_t size) {
  std::uint32_t value = 0;
  for (std::size_t k = 0; k < size; ++k) value |= static_cast<std::uint32_t>(bytes[at + k]) << (8 * k);
  return value;
}

void put(Bytes& out, std::uint64_t value, std::size_t size) {
  for (std::size_t k = 0; k < size; ++k) out.push_back(static_cast<std::uint8_t>(value >> (8 * k)));
}

// What a message of this type holds at least; none: it is of no interest here.
std::optional<std::size_t> least_size(std::uint32_t type) {
  switch (type) {
    case kSetConfiguration:
    case kGetAltSetting:
    case kStopIso:
    case kStopInterrupt:
    case kStartInterrupt:
      return 1;
    case kSetAltSetting:
      return 2;
    case kStartIso:
      return 3;
    case kAllocStreams:
      return 8;
    case kFreeStreams:
      return 4;
    case kReset:
    case kGetConfiguration:
    case kCancelData:
    case kFilterReject:
    case kDisconnectAck:
      return 0;
    case kControlPacket:
      return kControlHead;
    case kBulkPacket:
      return 8;
    default:
      return std::nullopt;
  }
}

}  // namespace

std::size_t UsbredirPeer::header_size() const {
  return greeted_ && both_can(kIds64) ? 16 : 12;
}

void UsbredirPeer::send(std::uint32_t type, std::uint64_t id, const Bytes& body) {
  put(out_, type, 4);
  put(out_, body.size(), 4);
  put(out_, id, header_size() - 8);
  out_.insert(out_.end(), body.begin(), body.end());
}

void UsbredirPeer::begin() {
  in_.clear();
  out_.clear();
  transfers_.clear();
  broken_.clear();
  greeted_ = false;
  capabilities_ = 0;
  cable_ = Cable::kOut;
  refused_ = false;
  Bytes hello;
  for (const char letter : std::string_view("holdfast emulated camera")) {
    hello.push_back(static_cast<std::uint8_t>(letter));
  }
  hello.resize(kVersionText);
  put(hello, kOurs, 4);
  send(kHello, 0, hello);
}

bool UsbredirPeer::break_off(std::string reason) {
  broken_ = std::move(reason);
  transfers_.clear();
  cable_ = Cable::kOut;
  return false;
}

bool UsbredirPeer::receive(std::span<const std::uint8_t> bytes) {
  if (!broken_.empty()) return false;
  in_.insert(in_.end(), bytes.begin(), bytes.end());
  std::size_t at = 0;
  while (in_.size() - at >= header_size()) {
    const std::size_t head = header_size();
    const std::span<const std::uint8_t> rest = std::span(in_).subspan(at);
    const std::uint32_t type = word(rest, 0, 4);
    const std::uint32_t length = word(rest, 4, 4);
    if (length > kLongest) {
      return break_off("a message of type " + std::to_string(type) + " has " + std::to_string(length) + " bytes");
    }
    if (rest.size() - head < length) break;
    const std::uint64_t id = word(rest, 8, 4) | (head == 16 ? static_cast<std::uint64_t>(word(rest, 12, 4)) << 32 : 0);
    const std::span<const std::uint8_t> body = rest.subspan(head, length);
    if (!greeted_ && type != kHello) return break_off("the first message is no hello");
    if (greeted_ && type == kHello) return break_off("a second hello");
    if (type == kHello ? !take_hello(body) : !take(type, id, body)) return false;
    at += head + length;
  }
  in_.erase(in_.begin(), in_.begin() + static_cast<std::ptrdiff_t>(at));
  return true;
}

bool UsbredirPeer::take_hello(std::span<const std::uint8_t> body) {
  if (body.size() < kVersionText) return break_off("a hello of " + std::to_string(body.size()) + " bytes");
  other_side_.clear();
  for (const std::uint8_t letter : body.first(kVersionText)) {
    if (letter < 0x20 || letter > 0x7e) break;
    other_side_.push_back(static_cast<char>(letter));
  }
  capabilities_ = body.size() >= kVersionText + 4 ? word(body, kVersionText, 4) & kOurs : 0;
  greeted_ = true;
  if (wanted_) attach();
  return true;
}

// Endpoints first: the other side looks at them when the device comes.
void UsbredirPeer::attach() {
  camera_.reset();
  std::array<std::uint8_t, kMostEndpoints> types{};
  std::array<std::uint8_t, kMostEndpoints> interfaces{};
  std::array<std::uint16_t, kMostEndpoints> packets{};
  types.fill(255);  // there is none
  types[0] = types[16] = 0;
  packets[0] = packets[16] = 64;
  constexpr std::size_t kStream = 16 + (UsbCamera::kEndpoint & 0xf);
  types[kStream] = 2;  // bulk
  packets[kStream] = UsbCamera::kPacket;
  interfaces[kStream] = 1;
  Bytes endpoints(types.begin(), types.end());
  endpoints.resize(2 * kMostEndpoints);  // intervals: bulk has none
  endpoints.insert(endpoints.end(), interfaces.begin(), interfaces.end());
  if (both_can(kMaxPacketSize)) {
    for (const std::uint16_t size : packets) put(endpoints, size, 2);
  }
  send(kEndpointInfo, 0, endpoints);

  Bytes info;
  put(info, 2, 4);
  info.resize(4 + 4 * kMostEndpoints);
  constexpr std::array<std::uint8_t, 4> kControlInterface{0, 0x0e, 1, 0};
  constexpr std::array<std::uint8_t, 4> kStreamInterface{1, 0x0e, 2, 0};
  for (std::size_t k = 0; k < 4; ++k) {  // number, class, subclass, protocol
    info[4 + k * kMostEndpoints] = kControlInterface[k];
    info[4 + k * kMostEndpoints + 1] = kStreamInterface[k];
  }
  send(kInterfaceInfo, 0, info);

  const UsbIdentity& identity = camera_.identity();
  Bytes device{kHighSpeed, 0xef, 2, 1};
  put(device, identity.vendor, 2);
  put(device, identity.product, 2);
  if (both_can(kConnectVersion)) put(device, 0x0100, 2);
  send(kDeviceConnect, 0, device);
  cable_ = Cable::kIn;
}

void UsbredirPeer::plug() {
  wanted_ = true;
  if (greeted_ && broken_.empty() && cable_ == Cable::kOut) attach();
}

void UsbredirPeer::unplug() {
  wanted_ = false;
  if (cable_ != Cable::kIn) return;
  transfers_.clear();
  camera_.reset();
  send(kDeviceDisconnect, 0, {});
  cable_ = both_can(kCanAckDisconnect) ? Cable::kLeaving : Cable::kOut;
}

bool UsbredirPeer::take(std::uint32_t type, std::uint64_t id, std::span<const std::uint8_t> body) {
  const std::optional<std::size_t> least = least_size(type);
  if (!least) return true;
  if (body.size() < *least) {
    return break_off("a message of type " + std::to_string(type) + " has only " + std::to_string(body.size()) +
                     " bytes");
  }
  if (type == kDisconnectAck) {
    if (cable_ == Cable::kLeaving) {
      cable_ = Cable::kOut;
      if (wanted_) attach();
    }
    return true;
  }
  if (cable_ != Cable::kIn) return true;  // meant for the device that was unplugged meanwhile
  switch (type) {
    case kFilterReject:
      refused_ = true;
      transfers_.clear();
      cable_ = Cable::kOut;
      return true;
    case kReset:
      camera_.reset();
      return true;
    case kSetConfiguration: {
      const std::uint8_t status = camera_.set_configuration(body[0]) ? kSuccess : kInvalid;
      send(kConfigurationStatus, id, {status, camera_.configuration()});
      return true;
    }
    case kGetConfiguration:
      send(kConfigurationStatus, id, {kSuccess, camera_.configuration()});
      return true;
    case kSetAltSetting: {
      const std::uint8_t status = camera_.set_interface(body[0], body[1]) ? kSuccess : kInvalid;
      send(kAltSettingStatus, id, {status, body[0], 0});
      return true;
    }
    case kGetAltSetting:
      send(kAltSettingStatus, id, {kSuccess, body[0], 0});
      return true;
    case kStartIso:
    case kStopIso:
      send(kIsoStatus, id, {kInvalid, body[0]});
      return true;
    case kStartInterrupt:
    case kStopInterrupt:
      send(kInterruptStatus, id, {kInvalid, body[0]});
      return true;
    case kAllocStreams:
    case kFreeStreams: {
      Bytes answer(body.begin(), body.begin() + 4);  // the endpoints, as a set
      put(answer, 0, 4);
      answer.push_back(kInvalid);
      send(kStreamsStatus, id, answer);
      return true;
    }
    case kCancelData:
      cancel(id);
      return true;
    case kControlPacket:
      return take_control(id, body);
    default:
      return take_bulk(id, body);
  }
}

bool UsbredirPeer::take_control(std::uint64_t id, std::span<const std::uint8_t> body) {
  const std::uint8_t endpoint = body[0];
  UsbSetup setup;
  setup.request = body[1];
  setup.request_type = body[2];
  setup.value = static_cast<std::uint16_t>(word(body, 4, 2));
  setup.index = static_cast<std::uint16_t>(word(body, 6, 2));
  setup.length = static_cast<std::uint16_t>(word(body, 8, 2));
  const std::span<const std::uint8_t> data = body.subspan(kControlHead);
  const bool in = (setup.request_type & 0x80) != 0;
  if (data.size() != (in ? 0U : setup.length)) {
    return break_off("a control request of " + std::to_string(setup.length) + " bytes brings " +
                     std::to_string(data.size()));
  }
  const std::optional<Bytes> answer = camera_.control(setup, data);
  Bytes out{endpoint, setup.request, setup.request_type, answer ? kSuccess : kStall};
  put(out, setup.value, 2);
  put(out, setup.index, 2);
  put(out, !answer ? 0 : in ? answer->size() : setup.length, 2);
  if (answer && in) out.insert(out.end(), answer->begin(), answer->end());
  send(kControlPacket, id, out);
  return true;
}

bool UsbredirPeer::take_bulk(std::uint64_t id, std::span<const std::uint8_t> body) {
  const std::size_t head = both_can(kLongBulk) ? 10 : 8;
  if (body.size() < head) return break_off("a bulk transfer with a head of " + std::to_string(body.size()) + " bytes");
  const std::uint8_t endpoint = body[0];
  const std::size_t room = word(body, 2, 2) | (head == 10 ? word(body, 8, 2) << 16 : 0);
  if (endpoint != UsbCamera::kEndpoint || room == 0) {
    send_bulk(id, endpoint, kInvalid, {});
    return true;
  }
  if (body.size() != head) return break_off("a bulk transfer to the host brings data");
  if (transfers_.size() == kMostTransfers) return break_off("too many transfers at once");
  transfers_.push_back({id, room});
  return true;
}

void UsbredirPeer::cancel(std::uint64_t id) {
  const auto found =
      std::find_if(transfers_.begin(), transfers_.end(), [id](const Transfer& transfer) { return transfer.id == id; });
  if (found == transfers_.end()) return;  // its answer is on the way
  transfers_.erase(found);
  send_bulk(id, UsbCamera::kEndpoint, kCancelled, {});
}

void UsbredirPeer::send_bulk(std::uint64_t id, std::uint8_t endpoint, std::uint8_t status, const Bytes& data) {
  Bytes out{endpoint, status};
  put(out, data.size() & 0xffff, 2);
  put(out, 0, 4);  // streams are for USB 3
  if (both_can(kLongBulk)) put(out, data.size() >> 16, 2);
  out.insert(out.end(), data.begin(), data.end());
  send(kBulkPacket, id, out);
}

void UsbredirPeer::pump(Moment now) {
  while (!transfers_.empty() && cable_ == Cable::kIn) {
    const std::optional<Bytes> data = camera_.payload(transfers_.front().room, now);
    if (!data) return;
    send_bulk(transfers_.front().id, UsbCamera::kEndpoint, kSuccess, *data);
    transfers_.pop_front();
  }
}

std::optional<Moment> UsbredirPeer::due() const {
  return transfers_.empty() ? std::nullopt : camera_.due();
}

}  // namespace holdfast::test
