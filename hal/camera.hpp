// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

namespace holdfast::hal {

enum class PixelFormat : std::uint8_t {
  kMjpeg,  // bytes = one JPEG stream; width, height and stride are what the driver announced, or 0
  kLuma8,  // bytes = height rows of stride bytes, 8-bit luma
};

// A frame as the driver holds it: borrowed, valid until release().
struct Frame {
  std::span<const std::uint8_t> bytes;
  PixelFormat format = PixelFormat::kMjpeg;
  std::int32_t width = 0;                 // pixels
  std::int32_t height = 0;                // pixels
  std::int32_t stride = 0;                // bytes from row to row (kLuma8)
  std::chrono::microseconds timestamp{};  // start of exposure on the HAL clock's time base
  std::uint32_t sequence = 0;             // counts what the sensor sent; a gap is a dropped frame
  bool stamped = true;                    // false: nobody knows how old it is; `timestamp` is when the driver took it
};

enum class Capture : std::uint8_t {
  kFrame,    // `frame` is filled; give it back with release()
  kTimeout,  // nothing within the time given; the stream may still recover
  kBad,      // the driver threw a damaged transfer away; nothing to release
  kGone,     // the stream ended: unplugged, or end of the recording
};

// One video stream. Not for still pictures or for changing formats while streaming.
class Camera {
 public:
  virtual ~Camera() = default;
  // Opens and starts the stream; false: the device is not there or refuses (the driver keeps the story).
  [[nodiscard]] bool start() { return running_ = do_start(); }
  // Waits at most `timeout` for the next frame. Allowed after start() only: otherwise kGone.
  [[nodiscard]] Capture next(Frame& frame, std::chrono::microseconds timeout) {
    return running_ ? do_next(frame, timeout) : Capture::kGone;
  }
  void release(const Frame& frame) { do_release(frame); }
  void stop() {
    if (running_) do_stop();
    running_ = false;
  }
  // Which sensor this is, its serial number: another one has another gel. Valid after start(), until the next; empty:
  // the driver cannot tell.
  [[nodiscard]] std::string_view identity() const { return do_identity(); }
  // Why the last start() failed, one line for people: what, likely cause, next step. Empty: it did not, or the driver
  // cannot tell. Valid until the next call of the camera.
  [[nodiscard]] std::string_view problem() const { return do_problem(); }
  // What of the camera's settings is not as the driver set it, one line for people: what, likely cause, next step.
  // Empty: nothing, or the driver cannot tell. Valid as problem().
  [[nodiscard]] std::string_view unset() const { return do_unset(); }
  // Its brightness and its frame rate are what the driver set, and the camera does not change them by itself. False: a
  // setting for that is among unset().
  [[nodiscard]] bool steady() const { return do_steady(); }
  // A sensor that sends pictures now: no two are alike, because they have noise, and it must neither hurry nor be late.
  // Not so a recording, or a scene that is drawn without noise.
  [[nodiscard]] bool live() const { return do_live(); }

 private:
  [[nodiscard]] virtual bool do_start() = 0;
  [[nodiscard]] virtual Capture do_next(Frame& frame, std::chrono::microseconds timeout) = 0;
  virtual void do_release(const Frame& frame) = 0;
  virtual void do_stop() = 0;
  [[nodiscard]] virtual std::string_view do_identity() const { return {}; }
  [[nodiscard]] virtual std::string_view do_problem() const { return {}; }
  [[nodiscard]] virtual std::string_view do_unset() const { return {}; }
  [[nodiscard]] virtual bool do_steady() const { return true; }
  [[nodiscard]] virtual bool do_live() const { return true; }
  bool running_ = false;
};

}  // namespace holdfast::hal
