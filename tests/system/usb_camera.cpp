// SPDX-License-Identifier: Apache-2.0
#include "tests/system/usb_camera.hpp"

#include <algorithm>
#include <utility>

namespace holdfast::test {
namespace {

// ---- Requests and descriptors, by the names of USB 2.0 and of the USB Video Class 1.0
constexpr std::uint8_t kGetStatus = 0, kClearFeature = 1, kSetFeature = 3, kGetDescriptor = 6;
constexpr std::uint8_t kDevice = 1, kConfiguration = 2, kString = 3, kInterface = 4, kEndpointDescriptor = 5,
                       kAssociation = 11, kClassInterface = 0x24;
constexpr std::uint8_t kSetCur = 0x01, kGetCur = 0x81, kGetMin = 0x82, kGetMax = 0x83, kGetRes = 0x84, kGetLen = 0x85,
                       kGetInfo = 0x86, kGetDef = 0x87;
constexpr std::uint8_t kVideo = 0x0e, kVideoControl = 1, kVideoStreaming = 2, kVideoCollection = 3;
constexpr std::uint8_t kProbe = 1, kCommit = 2;
constexpr std::uint8_t kMakerString = 1, kNameString = 2, kSerialString = 3;
constexpr std::uint8_t kOutputTerminal = 3;
constexpr std::size_t kProbeSize = 26;
constexpr std::uint32_t kInterval = 400'000;  // 100 ns: 25 fps
// Why a request is refused.
constexpr std::uint8_t kNoError = 0, kWrongState = 2, kOutOfRange = 4, kNoSuchUnit = 5, kNoSuchControl = 6,
                       kNoSuchRequest = 7;
constexpr std::uint8_t kErrorCode = 2;  // the control that tells

constexpr std::uint8_t kEndOfHeader = 0x80, kErrorBit = 0x40, kEndOfFrame = 0x02;

// Little-endian bytes.
class Writer {
 public:
  Writer& u8(std::uint32_t value) { return put(value, 1); }
  Writer& u16(std::uint32_t value) { return put(value, 2); }
  Writer& u24(std::uint32_t value) { return put(value, 3); }
  Writer& u32(std::uint32_t value) { return put(value, 4); }
  Writer& add(const Bytes& bytes) {
    bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
    return *this;
  }
  Bytes take() { return std::move(bytes_); }

 private:
  Writer& put(std::uint32_t value, int bytes) {
    for (int k = 0; k < bytes; ++k) bytes_.push_back(static_cast<std::uint8_t>(value >> (8 * k)));
    return *this;
  }
  Bytes bytes_;
};

// A descriptor begins with its length, which comes from what it holds.
Bytes sized(Bytes body) {
  body.insert(body.begin(), static_cast<std::uint8_t>(body.size() + 1));
  return body;
}

std::uint32_t size_of(const Bytes& bytes) {
  return static_cast<std::uint32_t>(bytes.size());
}

Bytes little_endian(int value, std::size_t size) {
  Bytes out;
  for (std::size_t k = 0; k < size; ++k) {
    out.push_back(static_cast<std::uint8_t>(static_cast<std::uint32_t>(value) >> (8 * k)));
  }
  return out;
}

int to_int(std::span<const std::uint8_t> bytes, bool has_sign) {
  std::uint32_t value = 0;
  for (std::size_t k = 0; k < bytes.size(); ++k) value |= static_cast<std::uint32_t>(bytes[k]) << (8 * k);
  const std::size_t bits = 8 * bytes.size();
  if (has_sign && bits < 32 && (value >> (bits - 1)) != 0) value |= ~0U << bits;
  return static_cast<int>(value);
}

Bytes video_control_units() {
  // Exposure: mode, priority, time. Everything of the processing unit that the table has.
  const Bytes camera = sized(Writer()
                                 .u8(kClassInterface)
                                 .u8(2)
                                 .u8(kCameraTerminal)
                                 .u16(0x0201)
                                 .u8(0)
                                 .u8(0)
                                 .u16(0)
                                 .u16(0)
                                 .u16(0)
                                 .u8(3)
                                 .u24(0x00000e)
                                 .take());
  const Bytes processing = sized(
      Writer().u8(kClassInterface).u8(5).u8(kProcessingUnit).u8(kCameraTerminal).u16(0).u8(2).u16(0x177f).u8(0).take());
  const Bytes output =
      sized(Writer().u8(kClassInterface).u8(3).u8(kOutputTerminal).u16(0x0101).u8(0).u8(kProcessingUnit).u8(0).take());
  constexpr std::uint32_t kHeaderSize = 13;
  const std::uint32_t total = kHeaderSize + size_of(camera) + size_of(processing) + size_of(output);
  const Bytes header =
      sized(Writer().u8(kClassInterface).u8(1).u16(0x0100).u16(total).u32(48'000'000).u8(1).u8(1).take());
  return Writer().add(header).add(camera).add(processing).add(output).take();
}

Bytes video_streaming_formats() {
  const Bytes format = sized(Writer().u8(kClassInterface).u8(6).u8(1).u8(1).u8(1).u8(1).u8(0).u8(0).u8(0).u8(0).take());
  constexpr std::uint32_t kBitRate = UsbCamera::kMostBytes * 8U * (10'000'000 / kInterval);
  const Bytes frame = sized(Writer()
                                .u8(kClassInterface)
                                .u8(7)
                                .u8(1)
                                .u8(0)
                                .u16(UsbCamera::kWidth)
                                .u16(UsbCamera::kHeight)
                                .u32(kBitRate)
                                .u32(kBitRate)
                                .u32(UsbCamera::kMostBytes)
                                .u32(kInterval)
                                .u8(1)
                                .u32(kInterval)
                                .take());
  const Bytes color = sized(Writer().u8(kClassInterface).u8(0x0d).u8(1).u8(1).u8(4).take());
  constexpr std::uint32_t kHeaderSize = 14;
  const std::uint32_t total = kHeaderSize + size_of(format) + size_of(frame) + size_of(color);
  const Bytes header = sized(Writer()
                                 .u8(kClassInterface)
                                 .u8(1)
                                 .u8(1)
                                 .u16(total)
                                 .u8(UsbCamera::kEndpoint)
                                 .u8(0)
                                 .u8(kOutputTerminal)
                                 .u8(0)
                                 .u8(0)
                                 .u8(0)
                                 .u8(1)
                                 .u8(0)
                                 .take());
  return Writer().add(header).add(format).add(frame).add(color).take();
}

Bytes interface_descriptor(std::uint8_t number, std::uint8_t endpoints, std::uint8_t subclass) {
  return sized(Writer().u8(kInterface).u8(number).u8(0).u8(endpoints).u8(kVideo).u8(subclass).u8(0).u8(0).take());
}

// The one mode, whatever was asked for.
Bytes probe_answer() {
  return Writer()
      .u16(1)
      .u8(1)
      .u8(1)
      .u32(kInterval)
      .u16(0)
      .u16(0)
      .u16(0)
      .u16(0)
      .u16(0)
      .u32(UsbCamera::kMostBytes)
      .u32(static_cast<std::uint32_t>(UsbCamera::kPayload))
      .take();
}

std::optional<std::size_t> find_control(std::uint32_t unit, std::uint32_t selector) {
  for (std::size_t k = 0; k < kUsbControls.size(); ++k) {
    if (kUsbControls[k].unit == unit && kUsbControls[k].selector == selector) return k;
  }
  return std::nullopt;
}

std::optional<std::size_t> find_control(std::string_view name) {
  for (std::size_t k = 0; k < kUsbControls.size(); ++k) {
    if (kUsbControls[k].name == name) return k;
  }
  return std::nullopt;
}

}  // namespace

UsbCamera::UsbCamera(std::vector<Bytes> film) : film_(std::move(film)) {
  loop_ = now_playing_ = {0, film_.size() - 1};
  for (std::size_t k = 0; k < kUsbControls.size(); ++k) values_[k] = kUsbControls[k].standard;
}

void UsbCamera::reset() {
  configuration_ = 0;
  refused_ = kNoError;
  stop_stream();
}

void UsbCamera::stop_stream() {
  streaming_ = false;
  in_frame_ = false;
  next_at_.reset();
}

// ---- Endpoint 0

Bytes UsbCamera::device_descriptor() const {
  return sized(Writer()
                   .u8(kDevice)
                   .u16(0x0200)
                   .u8(0xef)
                   .u8(2)
                   .u8(1)
                   .u8(64)
                   .u16(identity_.vendor)
                   .u16(identity_.product)
                   .u16(0x0100)
                   .u8(kMakerString)
                   .u8(kNameString)
                   .u8(kSerialString)
                   .u8(1)
                   .take());
}

Bytes UsbCamera::configuration_descriptor() {
  const Bytes association =
      sized(Writer().u8(kAssociation).u8(0).u8(2).u8(kVideo).u8(kVideoCollection).u8(0).u8(kNameString).take());
  const Bytes endpoint = sized(Writer().u8(kEndpointDescriptor).u8(kEndpoint).u8(2).u16(kPacket).u8(0).take());
  const Bytes rest = Writer()
                         .add(association)
                         .add(interface_descriptor(0, 0, kVideoControl))
                         .add(video_control_units())
                         .add(interface_descriptor(1, 1, kVideoStreaming))
                         .add(video_streaming_formats())
                         .add(endpoint)
                         .take();
  const Bytes head =
      sized(Writer().u8(kConfiguration).u16(9 + size_of(rest)).u8(2).u8(1).u8(0).u8(0x80).u8(500 / 2).take());
  return Writer().add(head).add(rest).take();
}

std::optional<Bytes> UsbCamera::descriptor(std::uint8_t type, std::uint8_t index) const {
  if (type == kDevice && index == 0) return device_descriptor();
  if (type == kConfiguration && index == 0) return configuration_descriptor();
  if (type != kString) return std::nullopt;
  Writer writer;
  writer.u8(kString);
  if (index == 0) return sized(writer.u16(0x0409).take());
  const std::array<std::pair<std::uint8_t, const std::string*>, 3> strings{
      {{kMakerString, &identity_.maker}, {kNameString, &identity_.name}, {kSerialString, &identity_.serial}}};
  for (const auto& [number, text] : strings) {
    if (number != index) continue;
    // UTF-16, and a descriptor's length is one byte.
    for (const char letter : text->substr(0, 126)) writer.u16(static_cast<std::uint8_t>(letter));
    return sized(writer.take());
  }
  return std::nullopt;
}

std::optional<Bytes> UsbCamera::standard(const UsbSetup& setup) {
  const bool in = (setup.request_type & 0x80) != 0;
  if (in && setup.request == kGetDescriptor) {
    return descriptor(static_cast<std::uint8_t>(setup.value >> 8), static_cast<std::uint8_t>(setup.value));
  }
  if (in && setup.request == kGetStatus) return Bytes{0, 0};
  if (!in && setup.request == kSetFeature) return Bytes{};
  if (!in && setup.request == kClearFeature) {
    // A bulk stream has no alternate setting 0 to fall back to: clearing its endpoint is how a host says stop.
    if (setup.request_type == 0x02 && setup.index == kEndpoint) stop_stream();
    return Bytes{};
  }
  return std::nullopt;
}

std::optional<Bytes> UsbCamera::refuse(std::uint8_t reason) {
  refused_ = reason;
  return std::nullopt;
}

bool UsbCamera::automatic(std::size_t control) const {
  const UsbControl& row = kUsbControls[control];
  if (row.automatic.empty()) return false;
  const std::optional<std::size_t> ruler = find_control(row.automatic);
  return ruler && values_[*ruler] != row.off;
}

bool UsbCamera::set(std::size_t control, std::span<const std::uint8_t> data) {
  const UsbControl& row = kUsbControls[control];
  const int value = data.size() == row.size ? to_int(data, row.least < 0) : row.most + 1;
  const bool is_mode = row.name == "exposure_auto";
  const bool possible = is_mode ? value == 1 || value == 8 : value >= row.least && value <= row.most;
  if (automatic(control) || !possible) {
    refused_ = possible ? kWrongState : kOutOfRange;
    return false;
  }
  values_[control] = value;
  return true;
}

std::optional<Bytes> UsbCamera::control_of_unit(const UsbSetup& setup, std::span<const std::uint8_t> data) {
  const std::uint32_t unit = setup.index >> 8U;
  const std::uint32_t selector = setup.value >> 8U;
  if (unit == 0) {
    if (selector != kErrorCode) return refuse(kNoSuchControl);
    if (setup.request == kGetCur) return Bytes{std::exchange(refused_, kNoError)};
    if (setup.request == kGetInfo) return Bytes{1};
    return refuse(kNoSuchRequest);
  }
  if (unit > kOutputTerminal) return refuse(kNoSuchUnit);
  const std::optional<std::size_t> found = find_control(unit, selector);
  if (!found) return refuse(kNoSuchControl);
  const UsbControl& row = kUsbControls[*found];
  refused_ = kNoError;
  switch (setup.request) {
    case kSetCur:
      return set(*found, data) ? std::optional(Bytes{}) : std::nullopt;
    case kGetCur:
      return little_endian(values_[*found], row.size);
    case kGetMin:
      return little_endian(row.least, row.size);
    case kGetMax:
      return little_endian(row.most, row.size);
    case kGetRes:
      return little_endian(row.step, row.size);
    case kGetDef:
      return little_endian(row.standard, row.size);
    case kGetLen:
      return Bytes{row.size, 0};
    case kGetInfo:
      return Bytes{static_cast<std::uint8_t>(automatic(*found) ? 0x07 : 0x03)};
    default:
      return refuse(kNoSuchRequest);
  }
}

std::optional<Bytes> UsbCamera::control_of_stream(const UsbSetup& setup, std::span<const std::uint8_t> data) {
  const std::uint32_t selector = setup.value >> 8U;
  if (selector != kProbe && selector != kCommit) return std::nullopt;
  switch (setup.request) {
    case kSetCur:
      if (data.size() != kProbeSize || configuration_ == 0) return std::nullopt;
      if (selector == kCommit) {
        stop_stream();
        streaming_ = true;
      }
      return Bytes{};
    case kGetCur:
    case kGetMin:
    case kGetMax:
    case kGetDef:
      return probe_answer();
    case kGetLen:
      return Bytes{kProbeSize, 0};
    case kGetInfo:
      return Bytes{0x03};
    default:
      return std::nullopt;
  }
}

std::optional<Bytes> UsbCamera::control(const UsbSetup& setup, std::span<const std::uint8_t> data) {
  std::optional<Bytes> answer;
  const bool in = (setup.request_type & 0x80) != 0;
  const bool to_interface = (setup.request_type & 0x7f) == 0x21;
  if ((setup.request_type & 0x60) == 0) {
    answer = standard(setup);
  } else if (to_interface && in == (setup.request != kSetCur)) {
    const std::uint32_t interface = setup.index & 0xffU;
    if (interface == 0) answer = control_of_unit(setup, data);
    if (interface == 1) answer = control_of_stream(setup, data);
  }
  if (answer && answer->size() > setup.length) answer->resize(setup.length);
  return answer;
}

bool UsbCamera::set_configuration(std::uint8_t number) {
  if (number > 1) return false;
  configuration_ = number;
  stop_stream();
  return true;
}

bool UsbCamera::set_interface(std::uint8_t interface, std::uint8_t alternate) const {
  return configuration_ != 0 && interface <= 1 && alternate == 0;
}

// ---- The stream

void UsbCamera::play(const Play& loop, std::optional<Play> once) {
  loop_ = loop;
  now_playing_ = once.value_or(loop);
  next_ = now_playing_.first;
}

void UsbCamera::begin_frame(Moment now) {
  in_frame_ = true;
  toggle_ ^= 1;
  sent_ = 0;
  if (!frozen_ || frames_ == 0) {
    shown_ = next_;
    if (next_ == now_playing_.last) {
      now_playing_ = loop_;
      next_ = loop_.first;
    } else {
      ++next_;
    }
    bytes_ = grain_ ? grain_(film_[shown_], frames_ + 1) : film_[shown_];
  }
  end_ = bytes_.size();
  if (to_truncate_ > 0) {
    --to_truncate_;
    end_ = (end_ + 1) / 2;
  }
  faulty_ = to_fail_ > 0;
  if (faulty_) --to_fail_;
  // From one beginning to the next; a host that was late by more than a period is not made to catch up.
  const Moment planned = next_at_.value_or(now);
  next_at_ = (now - planned > period_ ? now : planned) + period_;
}

std::optional<Bytes> UsbCamera::payload(std::size_t room, Moment now) {
  if (!streaming_ || stalled_ || room <= kHeader + 1) return std::nullopt;
  if (!in_frame_) {
    if (next_at_ && now < *next_at_) return std::nullopt;
    begin_frame(now);
  }
  // A transfer that is full and shorter than a payload would be the first part of one, without its end.
  const std::size_t count = (room >= kPayload ? kPayload : room - 1) - kHeader;
  const std::size_t to = std::min(sent_ + count, end_);
  const bool last = to == end_;
  const auto flags =
      static_cast<std::uint8_t>(kEndOfHeader | toggle_ | (last ? kEndOfFrame : 0) | (last && faulty_ ? kErrorBit : 0));
  Bytes out{kHeader, flags};
  out.insert(out.end(), bytes_.begin() + static_cast<std::ptrdiff_t>(sent_),
             bytes_.begin() + static_cast<std::ptrdiff_t>(to));
  sent_ = to;
  if (last) {
    in_frame_ = false;
    ++frames_;
  }
  return out;
}

std::optional<Moment> UsbCamera::due() const {
  if (!streaming_ || stalled_) return std::nullopt;
  if (in_frame_) return Moment::min();
  return next_at_.value_or(Moment::min());
}

std::string UsbCamera::controls() const {
  std::string out;
  for (std::size_t k = 0; k < kUsbControls.size(); ++k) {
    if (k > 0) out += ' ';
    out.append(kUsbControls[k].name).append("=").append(std::to_string(values_[k]));
  }
  return out;
}

}  // namespace holdfast::test
