// SPDX-License-Identifier: Apache-2.0
// The kernel's side of a video device: what videobuf2 and uvcvideo do, written from the kernel's documentation of the
// calls. The real kernel is met in tests/system.
//
// Modelled: open files, formats, controls, mapped buffers and their queues; refusals by errno; a device that is gone.
// Not modelled: time, and what is in a buffer.
#pragma once

#include <fcntl.h>
#include <linux/videodev2.h>
#include <poll.h>
#include <sys/mman.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "drivers/linux/camera_controls.hpp"
#include "drivers/linux/kernel.hpp"

namespace holdfast::test {

struct VideoDevice {
  std::uint32_t caps = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
  std::uint32_t width = 3280, height = 2464;
  std::uint32_t most_buffers = 32;
  std::map<std::uint32_t, std::int32_t> controls;  // those that it has
  std::set<std::uint32_t> stubborn;                // of those: keep their value, whatever they are told
  std::size_t length = 4096;
  // What was filled, in order: what VIDIOC_DQBUF will answer.
  struct Filled {
    std::uint32_t bytes = 0, flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC, sequence = 0;
    std::chrono::microseconds stamp{};
  };
  std::deque<Filled> filled;
  std::vector<bool> queued;
  bool streaming = false;
  bool gone = false;
  int opens = 0;
};

class VideoModel : public drivers::Kernel {
 public:
  std::map<std::string, VideoDevice> devices;
  std::map<std::string, int> refusals;   // of open: errno
  std::map<unsigned long, int> refused;  // of ioctl: errno
  std::ptrdiff_t streams_at_most = 100;  // for which all devices' one bus has bandwidth
  int polled_ms = -1;
  int maps = 0;  // buffers that are mapped

  VideoDevice& add_camera(const std::string& path) {
    VideoDevice& device = devices[path];
    for (const drivers::CameraControl& control : drivers::camera_controls()) device.controls[control.id] = -77;
    return device;
  }
  [[nodiscard]] int open_files() const { return open_; }

  int open(const char* path, int) override {
    errno = ENOENT;
    if (const auto refusal = refusals.find(path); refusal != refusals.end()) {
      errno = refusal->second;
      return -1;
    }
    if (!devices.contains(path)) return -1;
    ++open_;
    names_.emplace_back(path);
    ++devices[path].opens;
    return static_cast<int>(names_.size()) + 99;
  }
  int close(int fd) override {
    --open_;
    device(fd).streaming = false;
    return 0;
  }
  int poll(pollfd* one, int timeout_ms) override {
    polled_ms = timeout_ms;
    VideoDevice& d = device(one->fd);
    one->revents = 0;
    if (d.gone) one->revents = POLLERR | POLLHUP;
    if (!d.filled.empty()) one->revents = static_cast<short>(one->revents | POLLIN);
    return one->revents != 0 ? 1 : 0;
  }
  void* map(int, std::size_t, off_t offset) override {
    ++maps;
    return offset == 7 ? MAP_FAILED : reinterpret_cast<void*>(static_cast<std::uintptr_t>(0x10000 + offset));
  }
  void unmap(void*, std::size_t) override { --maps; }
  int ioctl(int fd, unsigned long request, void* argument) override {
    VideoDevice& d = device(fd);
    if (d.gone) return error(ENODEV);
    if (const auto refusal = refused.find(request); refusal != refused.end()) return error(refusal->second);
    switch (request) {
      case VIDIOC_QUERYCAP:
        static_cast<v4l2_capability*>(argument)->device_caps = d.caps;
        return 0;
      case VIDIOC_S_FMT: {  // the nearest that it has
        auto& pix = static_cast<v4l2_format*>(argument)->fmt.pix;
        pix.width = d.width, pix.height = d.height, pix.pixelformat = V4L2_PIX_FMT_MJPEG;
        return 0;
      }
      case VIDIOC_S_PARM:
        return 0;
      case VIDIOC_S_CTRL: {
        const auto* control = static_cast<v4l2_control*>(argument);
        if (!d.controls.contains(control->id)) return error(EINVAL);
        // Kept by what is automatic.
        if (control->id == V4L2_CID_EXPOSURE_ABSOLUTE && d.controls[V4L2_CID_EXPOSURE_AUTO] != V4L2_EXPOSURE_MANUAL) {
          return error(EACCES);
        }
        if (d.stubborn.contains(control->id)) return error(EIO);
        d.controls[control->id] = control->value;
        return 0;
      }
      case VIDIOC_G_CTRL: {
        auto* control = static_cast<v4l2_control*>(argument);
        if (!d.controls.contains(control->id)) return error(EINVAL);
        control->value = d.controls[control->id];
        return 0;
      }
      case VIDIOC_REQBUFS: {
        auto* buffers = static_cast<v4l2_requestbuffers*>(argument);
        buffers->count = std::min(buffers->count, d.most_buffers);
        d.queued.assign(buffers->count, false);
        return 0;
      }
      case VIDIOC_QUERYBUF: {
        auto* buffer = static_cast<v4l2_buffer*>(argument);
        buffer->length = static_cast<std::uint32_t>(d.length);
        buffer->m.offset = buffer->index * 0x1000;
        return 0;
      }
      case VIDIOC_QBUF: {
        const auto* buffer = static_cast<v4l2_buffer*>(argument);
        if (buffer->index >= d.queued.size() || d.queued[buffer->index]) return error(EINVAL);
        d.queued[buffer->index] = true;
        return 0;
      }
      case VIDIOC_STREAMON:
        if (std::ranges::count_if(devices, [](const auto& one) { return one.second.streaming; }) >= streams_at_most) {
          return error(ENOSPC);  // of the host controller, or of its driver
        }
        d.streaming = true;
        return 0;
      case VIDIOC_STREAMOFF:
        d.streaming = false;
        return 0;
      case VIDIOC_DQBUF: {
        auto* buffer = static_cast<v4l2_buffer*>(argument);
        const auto free = std::find(d.queued.begin(), d.queued.end(), true);
        if (!d.streaming) return error(EINVAL);
        if (d.filled.empty() || free == d.queued.end()) return error(EAGAIN);
        *free = false;
        buffer->index = static_cast<std::uint32_t>(free - d.queued.begin());
        const VideoDevice::Filled& next = d.filled.front();
        buffer->bytesused = next.bytes, buffer->flags = next.flags, buffer->sequence = next.sequence;
        buffer->timestamp = {next.stamp.count() / 1'000'000, next.stamp.count() % 1'000'000};
        d.filled.pop_front();
        return 0;
      }
      default:
        return error(ENOTTY);
    }
  }

 private:
  static int error(int number) {
    errno = number;
    return -1;
  }
  [[nodiscard]] const std::string& name(int fd) const { return names_.at(static_cast<std::size_t>(fd) - 100); }
  [[nodiscard]] VideoDevice& device(int fd) { return devices.at(name(fd)); }

  std::vector<std::string> names_;
  int open_ = 0;
};

}  // namespace holdfast::test
