// SPDX-License-Identifier: Apache-2.0
// A GelSight Mini as a USB device: descriptors, controls and a stream of JPEG pictures from a film, without a bus.
// usbredir.hpp carries it to an emulated machine.
//
// Modelled, after listings of real sensors: ids and strings, UVC 1.0, the one mode (MJPG 3280x2464, 25 fps), 500 mA,
// the controls that the vendor's script sets, the V4L2 name "GelSight Mini R0B 2BNN-4ZE7: Ge" - the kernel appends what
// the function is called, and it is called as the product. Ranges of brightness, contrast, saturation and hue are the
// sensor's; the others are those of the bridge chip's family. A control that an automatic sets refuses to be set.
// Differs: the stream is bulk and not isochronous, because an emulated machine that falls behind drops isochronous
// packets, and the tests count bytes. Not modelled: the privacy button's interrupt endpoint, still pictures, the
// maker's extension unit, clocks in the payload headers, what the controls do to the picture.
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace holdfast::test {

using Bytes = std::vector<std::uint8_t>;
using Moment = std::chrono::steady_clock::time_point;

struct UsbSetup {
  std::uint8_t request_type = 0;
  std::uint8_t request = 0;
  std::uint16_t value = 0;
  std::uint16_t index = 0;
  std::uint16_t length = 0;
};

struct UsbIdentity {
  std::uint16_t vendor = 0x0c45;
  std::uint16_t product = 0x636d;
  std::string maker = "Arducam Technology Co., Ltd.";
  std::string name = "GelSight Mini R0B 2BNN-4ZE7";
  std::string serial = "2BNN4ZE7";
};

// One row of the table of controls.
struct UsbControl {
  std::string_view name;  // as the vendor's script has it
  std::uint8_t unit = 0;
  std::uint8_t selector = 0;
  std::uint8_t size = 0;
  int least = 0, most = 0, step = 1, standard = 0;
  std::string_view automatic{};  // the control that has to be off for this one to be set
  int off = 0;                   // its value then
};
inline constexpr std::uint8_t kCameraTerminal = 1, kProcessingUnit = 2;
inline constexpr std::array<UsbControl, 14> kUsbControls{{
    {"brightness", kProcessingUnit, 0x02, 2, -64, 64, 1, 0},
    {"contrast", kProcessingUnit, 0x03, 2, 0, 64, 1, 32},
    {"saturation", kProcessingUnit, 0x07, 2, 0, 128, 1, 64},
    {"hue", kProcessingUnit, 0x06, 2, -40, 40, 1, 0},
    {"white_balance_temperature_auto", kProcessingUnit, 0x0b, 1, 0, 1, 1, 1},
    {"white_balance_temperature", kProcessingUnit, 0x0a, 2, 2800, 6500, 1, 4600, "white_balance_temperature_auto", 0},
    {"gamma", kProcessingUnit, 0x09, 2, 72, 500, 1, 100},
    {"gain", kProcessingUnit, 0x04, 2, 0, 100, 1, 0},
    {"power_line_frequency", kProcessingUnit, 0x05, 1, 0, 2, 1, 1},
    {"sharpness", kProcessingUnit, 0x08, 2, 0, 6, 1, 3},
    {"backlight_compensation", kProcessingUnit, 0x01, 2, 0, 2, 1, 1},
    // A set of bits: 1 manual, 8 aperture priority; its step is the set of those there are.
    {"exposure_auto", kCameraTerminal, 0x02, 1, 1, 8, 9, 8},
    {"exposure_absolute", kCameraTerminal, 0x04, 4, 1, 5000, 1, 157, "exposure_auto", 1},
    {"exposure_auto_priority", kCameraTerminal, 0x03, 1, 0, 1, 1, 0},
}};

class UsbCamera {
 public:
  static constexpr std::uint8_t kEndpoint = 0x81;
  static constexpr std::uint16_t kPacket = 512;    // of a high-speed bulk endpoint
  static constexpr std::size_t kPayload = 16'384;  // header and data, at most: one transfer of the kernel's driver
  static constexpr std::uint32_t kMostBytes = 16'164'429;  // of a picture, as the sensor says
  static constexpr int kWidth = 3280, kHeight = 2464;
  static constexpr std::size_t kHeader = 2;

  // Range: at least one picture, none empty.
  explicit UsbCamera(std::vector<Bytes> film);

  // ---- As the bus sees it
  void reset();  // of the bus, and what a plug does
  // A request on endpoint 0; `data` is what came with it. None: it is refused (STALL).
  [[nodiscard]] std::optional<Bytes> control(const UsbSetup& setup, std::span<const std::uint8_t> data);
  [[nodiscard]] bool set_configuration(std::uint8_t number);
  [[nodiscard]] bool set_interface(std::uint8_t interface, std::uint8_t alternate) const;
  [[nodiscard]] std::uint8_t configuration() const { return configuration_; }
  // What the stream has for a transfer of `room` bytes. None: nothing before due().
  [[nodiscard]] std::optional<Bytes> payload(std::size_t room, Moment now);
  // When payload() may have something again, without a command; none: never.
  [[nodiscard]] std::optional<Moment> due() const;
  [[nodiscard]] const UsbIdentity& identity() const { return identity_; }

  // ---- As the test wants it
  struct Play {
    std::size_t first = 0, last = 0;  // pictures of the film, both shown
  };
  // Shows `once` a single time, if there is such, and then `loop` again and again.
  // Range: first <= last < pictures().
  void play(const Play& loop, std::optional<Play> once = {});
  void set_period(std::chrono::microseconds period) { period_ = period; }  // 0: as fast as they are taken
  void stall(bool on) { stalled_ = on; }                                   // the stream stands still, in mid-picture
  void truncate(std::uint64_t frames) { to_truncate_ = frames; }           // they end after half of their bytes
  void fail(std::uint64_t frames) { to_fail_ = frames; }                   // they carry the error bit
  void freeze(bool on) { frozen_ = on; }                                   // the same picture, in new frames
  // What is shown instead of a picture of the film, drawn by the frame's number, from 1; none: the picture itself.
  void set_grain(std::function<Bytes(const Bytes& picture, std::uint64_t frame)> grain) { grain_ = std::move(grain); }
  void set_identity(const UsbIdentity& identity) { identity_ = identity; }  // what is read from now on

  [[nodiscard]] std::size_t pictures() const { return film_.size(); }
  [[nodiscard]] std::uint64_t frames() const { return frames_; }  // sent to their end
  [[nodiscard]] std::size_t picture() const { return shown_; }    // of the frame under way, or sent last
  [[nodiscard]] std::string controls() const;  // "brightness=0 contrast=32 ...", in the table's order

 private:
  [[nodiscard]] static Bytes configuration_descriptor();
  [[nodiscard]] Bytes device_descriptor() const;
  [[nodiscard]] std::optional<Bytes> standard(const UsbSetup& setup);
  [[nodiscard]] std::optional<Bytes> descriptor(std::uint8_t type, std::uint8_t index) const;
  [[nodiscard]] std::optional<Bytes> control_of_unit(const UsbSetup& setup, std::span<const std::uint8_t> data);
  [[nodiscard]] std::optional<Bytes> control_of_stream(const UsbSetup& setup, std::span<const std::uint8_t> data);
  [[nodiscard]] bool set(std::size_t control, std::span<const std::uint8_t> data);
  [[nodiscard]] bool automatic(std::size_t control) const;
  [[nodiscard]] std::optional<Bytes> refuse(std::uint8_t reason);
  void begin_frame(Moment now);
  void stop_stream();

  std::vector<Bytes> film_;
  UsbIdentity identity_;
  std::array<int, kUsbControls.size()> values_{};
  std::uint8_t refused_ = 0;  // why the last request was: UVC's request error code
  std::uint8_t configuration_ = 0;
  bool streaming_ = false;

  std::chrono::microseconds period_{40'000};
  Play loop_, now_playing_;
  std::size_t next_ = 0;  // picture
  std::size_t shown_ = 0;
  Bytes bytes_;  // as it is shown
  std::function<Bytes(const Bytes&, std::uint64_t)> grain_;
  bool stalled_ = false, frozen_ = false;
  std::uint64_t to_truncate_ = 0, to_fail_ = 0;

  bool in_frame_ = false;
  bool faulty_ = false;   // the frame under way carries the error bit
  std::size_t sent_ = 0;  // bytes of the picture
  std::size_t end_ = 0;   // where this frame ends it
  std::uint8_t toggle_ = 0;
  std::optional<Moment> next_at_;  // when the next frame begins; none: at once
  std::uint64_t frames_ = 0;
};

}  // namespace holdfast::test
