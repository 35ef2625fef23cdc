// SPDX-License-Identifier: Apache-2.0
#include "drivers/linux/camera_v4l2.hpp"

#include <fcntl.h>
#include <linux/videodev2.h>
#include <poll.h>
#include <sys/mman.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>

#include "drivers/common/monotonic_clock.hpp"

namespace holdfast::drivers {
namespace {

constexpr std::uint32_t kBufferType = V4L2_BUF_TYPE_VIDEO_CAPTURE;

}  // namespace

bool V4l2Camera::fail(std::string_view what, std::string_view cause, std::string_view next) {
  const char* const why = std::strerror(errno);
  problem_ = {};
  problem_ << sensor_.node.view() << ": " << what << " (" << why << "). Likely cause: " << cause << ". Next: " << next;
  close();
  return false;
}

bool V4l2Camera::do_start() {
  close();
  problem_ = {};
  take_census(config_.sysfs, census_);
  sensor_ = find_sensor(census_, config_.serial);
  if (sensor_.result != Search::kFound) {
    problem_ << sensor_.message.view();
    return false;
  }
  if (!open_node() || !set_format()) return false;
  counts_.controls_off = set_camera_controls(kernel_, fd_);
  unset_ = words_of(counts_.controls_off);
  if (!map_buffers()) return false;
  for (std::size_t i = 0; i < buffer_count_; ++i) {
    if (!queue(static_cast<std::uint32_t>(i))) {
      return fail("a buffer is refused", "the driver was unbound meanwhile", "plug the sensor in again");
    }
  }
  std::uint32_t type = kBufferType;
  if (kernel_.ioctl(fd_, VIDIOC_STREAMON, &type) == -1) {
    const bool full = errno == ENOSPC;
    return fail("the stream does not start",
                full ? "another camera has reserved the USB bandwidth" : "a fault of the sensor",
                full ? "use another controller (lsusb -t; a Pi 4 has one for all ports)"
                     : "unplug the sensor and plug it in again");
  }
  ++counts_.starts;
  return true;
}

bool V4l2Camera::open_node() {
  fd_ = kernel_.open(sensor_.node.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
  if (fd_ < 0) {
    const bool rights = errno == EACCES || errno == EPERM;
    return fail("cannot be opened", rights ? "no right to it" : "the sensor is being unplugged",
                rights ? "add the user to the group video" : "plug it in again");
  }
  v4l2_capability capability{};
  if (kernel_.ioctl(fd_, VIDIOC_QUERYCAP, &capability) == -1) {
    return fail("is not a V4L2 device", "another device under this name", "holdfast devices lists what is there");
  }
  constexpr std::uint32_t kNeeded = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
  if ((capability.device_caps & kNeeded) != kNeeded) {
    errno = ENOTSUP;
    return fail("does not capture video", "it is the metadata node", "holdfast devices lists what is there");
  }
  return true;
}

bool V4l2Camera::set_format() {
  v4l2_format format{};
  format.type = kBufferType;
  format.fmt.pix.width = static_cast<std::uint32_t>(config_.width);
  format.fmt.pix.height = static_cast<std::uint32_t>(config_.height);
  format.fmt.pix.pixelformat = V4L2_PIX_FMT_MJPEG;
  format.fmt.pix.field = V4L2_FIELD_ANY;
  if (kernel_.ioctl(fd_, VIDIOC_S_FMT, &format) == -1) {
    const bool busy = errno == EBUSY;
    return fail("takes no format", busy ? "another program has it open" : "a fault of the sensor",
                busy ? "end that program (fuser names it)" : "unplug the sensor and plug it in again");
  }
  // The driver answers with the nearest that it has.
  const v4l2_pix_format& got = format.fmt.pix;
  if (got.pixelformat != V4L2_PIX_FMT_MJPEG || got.width != static_cast<std::uint32_t>(config_.width) ||
      got.height != static_cast<std::uint32_t>(config_.height)) {
    errno = ENOTSUP;
    FixedText<95> what;
    what << "offers " << got.width << "x" << got.height << ", not MJPG " << config_.width << "x" << config_.height;
    return fail(what.view(), "another camera, or another firmware of it", "use a GelSight Mini");
  }
  // The sensor has this rate only; a driver that cannot be asked goes at its own.
  v4l2_streamparm rate{};
  rate.type = kBufferType;
  rate.parm.capture.timeperframe = {1, config_.fps};
  (void)kernel_.ioctl(fd_, VIDIOC_S_PARM, &rate);
  return true;
}

bool V4l2Camera::map_buffers() {
  v4l2_requestbuffers request{};
  request.count = static_cast<std::uint32_t>(std::clamp<std::size_t>(config_.buffers, 2, kMostBuffers));
  request.type = kBufferType;
  request.memory = V4L2_MEMORY_MMAP;
  if (kernel_.ioctl(fd_, VIDIOC_REQBUFS, &request) == -1 || request.count < 2) {
    const bool busy = errno == EBUSY;
    return fail("gives no buffers", busy ? "another program has it open" : "the kernel is short of memory",
                busy ? "end that program (fuser names it)" : "free 64 MB, or set fewer buffers");
  }
  const std::size_t count = std::min<std::size_t>(request.count, kMostBuffers);
  for (std::size_t i = 0; i < count; ++i) {
    v4l2_buffer buffer{};
    buffer.type = kBufferType;
    buffer.memory = V4L2_MEMORY_MMAP;
    buffer.index = static_cast<std::uint32_t>(i);
    if (kernel_.ioctl(fd_, VIDIOC_QUERYBUF, &buffer) == -1) {
      return fail("does not describe its buffers", "the sensor is being unplugged", "plug the sensor in again");
    }
    void* const memory = kernel_.map(fd_, buffer.length, static_cast<off_t>(buffer.m.offset));
    if (memory == MAP_FAILED) {
      return fail("a buffer cannot be mapped", "the process may not have so much memory", "raise its limit by 80 MB");
    }
    buffers_[i] = {memory, buffer.length};
    buffer_count_ = i + 1;
  }
  return true;
}

bool V4l2Camera::queue(std::uint32_t index) {
  v4l2_buffer buffer{};
  buffer.type = kBufferType;
  buffer.memory = V4L2_MEMORY_MMAP;
  buffer.index = index;
  return kernel_.ioctl(fd_, VIDIOC_QBUF, &buffer) != -1;
}

hal::Capture V4l2Camera::do_next(hal::Frame& frame, std::chrono::microseconds timeout) {
  using hal::Capture;
  if (fd_ < 0) return Capture::kGone;
  if (lent_) do_release(frame);  // one is lent at a time
  // Rounded up: a wait that is too short by less than a millisecond would be asked for again at once.
  const auto wait = std::chrono::ceil<std::chrono::milliseconds>(timeout * config_.time_scale);
  pollfd ready{fd_, POLLIN, 0};
  const int events = kernel_.poll(&ready, static_cast<int>(std::clamp<std::int64_t>(wait.count(), 0, 60'000)));
  if (events == 0 || (events < 0 && errno == EINTR)) return Capture::kTimeout;
  v4l2_buffer buffer{};
  buffer.type = kBufferType;
  buffer.memory = V4L2_MEMORY_MMAP;
  // Also after POLLERR and POLLHUP: what is already there is still good, and errno says what happened.
  if (events < 0 || kernel_.ioctl(fd_, VIDIOC_DQBUF, &buffer) == -1) {
    if (errno == EAGAIN && (ready.revents & (POLLERR | POLLHUP | POLLNVAL)) == 0) return Capture::kTimeout;
    if (errno == EIO) {
      ++counts_.damaged;
      return Capture::kBad;
    }
    close();
    return Capture::kGone;
  }
  if (buffer.index >= buffer_count_) {
    close();
    return Capture::kGone;
  }
  const Buffer& memory = buffers_[buffer.index];
  const bool flagged = (buffer.flags & V4L2_BUF_FLAG_ERROR) != 0;
  if (flagged || buffer.bytesused == 0 || buffer.bytesused > memory.length) {
    ++(flagged ? counts_.damaged : counts_.empty);
    if (queue(buffer.index)) return Capture::kBad;
    close();
    return Capture::kGone;
  }
  const bool stamped = (buffer.flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
  if (!stamped) ++counts_.unstamped;
  const std::chrono::microseconds taken =
      stamped ? std::chrono::seconds{buffer.timestamp.tv_sec} + std::chrono::microseconds{buffer.timestamp.tv_usec}
              : MonotonicClock().now();
  frame = {};
  frame.bytes = {static_cast<const std::uint8_t*>(memory.memory), buffer.bytesused};
  frame.format = hal::PixelFormat::kMjpeg;
  frame.width = config_.width;
  frame.height = config_.height;
  frame.timestamp = taken / config_.time_scale;
  frame.sequence = buffer.sequence;
  frame.stamped = stamped;
  lent_ = buffer.index;
  ++counts_.frames;
  return Capture::kFrame;
}

void V4l2Camera::do_release(const hal::Frame&) {
  if (!lent_ || fd_ < 0) return;
  // A buffer that is refused comes with a camera that is gone: the next wait says so.
  (void)queue(*lent_);
  lent_.reset();
}

void V4l2Camera::close() {
  if (fd_ < 0) return;
  const int error = errno;
  std::uint32_t type = kBufferType;
  (void)kernel_.ioctl(fd_, VIDIOC_STREAMOFF, &type);
  for (std::size_t i = 0; i < buffer_count_; ++i) kernel_.unmap(buffers_[i].memory, buffers_[i].length);
  buffer_count_ = 0;
  lent_.reset();
  (void)kernel_.close(fd_);
  fd_ = -1;
  errno = error;
}

}  // namespace holdfast::drivers
