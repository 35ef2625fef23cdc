// SPDX-License-Identifier: Apache-2.0
// The GelSight Mini behind uvcvideo: MJPG 3280x2464, the one thing it offers, by V4L2's mapped buffers, from which the
// decoder reads without a copy.
//
// start() looks for the sensor, because its device file changes with every replug, and takes the one that is there, or
// the one whose serial is asked for; nothing is taken for a GelSight because its USB id is the same (usb_sensor.hpp).
// It sets the controls that make pictures comparable (camera_controls.hpp).
//
// Time stamps are uvcvideo's: the monotonic clock's, start of exposure as the driver reckons it. Sequence numbers count
// what the sensor sent, also what no buffer was free for. Frames that come damaged (V4L2_BUF_FLAG_ERROR) or empty are
// given back at once: Capture::kBad. Buffers are handed out in the order in which they were filled: whoever was late
// meets old frames first, as their time stamps say.
//
// No heap at all; memory is the kernel's, 16.2 MB a buffer, because the sensor announces the size of a raw picture.
// Not here: unbinding and resetting the port (sensor_main.cpp does, with rights that the firmware has not), audio,
// other sizes and formats.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>

#include "drivers/linux/camera_controls.hpp"
#include "drivers/linux/fixed_text.hpp"
#include "drivers/linux/kernel.hpp"
#include "drivers/linux/usb_sensor.hpp"
#include "hal/camera.hpp"

namespace holdfast::drivers {

class V4l2Camera final : public hal::Camera {
 public:
  static constexpr std::size_t kMostBuffers = 8;
  struct Config {
    std::string_view serial{};   // with or without its dash; empty: the only sensor there is
    const char* sysfs = "/sys";  // tests bring their own
    std::int32_t width = 3280;   // pixels
    std::int32_t height = 2464;  // pixels
    std::uint32_t fps = 25;
    // One is being decoded, one filled, two between for a frame that takes longer. Range: 2..kMostBuffers.
    std::size_t buffers = 4;
    // Seconds of the world in one of the firmware's: 1, but for an emulated board (board/virt).
    std::int32_t time_scale = 1;
  };
  // Since the object was made.
  struct Counts {
    std::uint64_t frames = 0;
    std::uint64_t damaged = 0;  // flagged by the kernel
    std::uint64_t empty = 0;
    std::uint64_t unstamped = 0;  // not by the monotonic clock: hal::Frame::stamped is false
    std::uint64_t starts = 0;     // that worked
    ControlsOff controls_off;     // since the last start
  };

  explicit V4l2Camera(const Config& config, Kernel& kernel = Kernel::real()) : config_(config), kernel_(kernel) {}
  ~V4l2Camera() override { stop(); }
  V4l2Camera(const V4l2Camera&) = delete;
  V4l2Camera& operator=(const V4l2Camera&) = delete;

  [[nodiscard]] const Counts& counts() const { return counts_; }

 private:
  struct Buffer {
    void* memory = nullptr;
    std::size_t length = 0;
  };

  [[nodiscard]] bool do_start() override;
  [[nodiscard]] hal::Capture do_next(hal::Frame& frame, std::chrono::microseconds timeout) override;
  void do_release(const hal::Frame& frame) override;
  void do_stop() override { close(); }
  [[nodiscard]] std::string_view do_identity() const override { return sensor_.serial.view(); }
  [[nodiscard]] std::string_view do_problem() const override { return problem_.view(); }
  [[nodiscard]] std::string_view do_unset() const override { return unset_.view(); }
  [[nodiscard]] bool do_steady() const override { return are_steady(counts_.controls_off); }

  [[nodiscard]] bool open_node();
  [[nodiscard]] bool set_format();
  [[nodiscard]] bool map_buffers();
  [[nodiscard]] bool queue(std::uint32_t index);
  [[nodiscard]] bool fail(std::string_view what, std::string_view cause, std::string_view next);
  void close();

  Config config_;
  Kernel& kernel_;
  FixedText<511> problem_;
  FixedText<511> unset_;
  UsbCensus census_;
  SensorSearch sensor_;
  int fd_ = -1;
  std::array<Buffer, kMostBuffers> buffers_{};
  std::size_t buffer_count_ = 0;
  std::optional<std::uint32_t> lent_;
  Counts counts_;
};

}  // namespace holdfast::drivers
