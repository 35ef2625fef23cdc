// SPDX-License-Identifier: Apache-2.0
// The V4L2 camera against a model of the kernel: a video device that does what videobuf2 and uvcvideo do, written from
// the kernel's documentation of the calls. The real kernel is met in tests/system.
#include "drivers/linux/camera_v4l2.hpp"

#include <fcntl.h>
#include <linux/videodev2.h>
#include <poll.h>
#include <sys/mman.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <deque>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "tests/support/sysfs_tree.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;
using drivers::V4l2Camera;
using hal::Capture;
using std::chrono::microseconds;
using namespace std::chrono_literals;

struct Device {
  std::uint32_t caps = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
  std::uint32_t width = 3280, height = 2464;
  std::uint32_t most_buffers = 32;
  std::map<std::uint32_t, std::int32_t> controls;  // those that it has
  std::size_t length = 4096;
  // What was filled, in order: what VIDIOC_DQBUF will answer.
  struct Filled {
    std::uint32_t bytes = 0, flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC, sequence = 0;
    microseconds stamp{};
  };
  std::deque<Filled> filled;
  std::vector<bool> queued;
  bool streaming = false;
  bool gone = false;
  int opens = 0, maps = 0;
};

class ModelKernel final : public drivers::Kernel {
 public:
  std::map<std::string, Device> devices;
  std::map<std::string, int> refusals;   // of open: errno
  std::map<unsigned long, int> refused;  // of ioctl: errno
  int polled_ms = -1;

  Device& add_camera(const std::string& path) {
    Device& device = devices[path];
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
    Device& d = device(one->fd);
    one->revents = 0;
    if (d.gone) one->revents = POLLERR | POLLHUP;
    if (!d.filled.empty()) one->revents = static_cast<short>(one->revents | POLLIN);
    return one->revents != 0 ? 1 : 0;
  }
  void* map(int fd, std::size_t, off_t offset) override {
    Device& d = device(fd);
    ++d.maps;
    return offset == 7 ? MAP_FAILED : reinterpret_cast<void*>(static_cast<std::uintptr_t>(0x10000 + offset));
  }
  void unmap(void*, std::size_t) override { --devices.begin()->second.maps; }
  int ioctl(int fd, unsigned long request, void* argument) override {
    Device& d = device(fd);
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
        const Device::Filled& next = d.filled.front();
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
  [[nodiscard]] Device& device(int fd) { return devices.at(name(fd)); }

  std::vector<std::string> names_;
  int open_ = 0;
};

}  // namespace

TEST_GROUP(LinuxCamera) {
  test::SysfsTree sys;
  std::string sysfs = sys.root();
  ModelKernel kernel;
  std::unique_ptr<V4l2Camera> camera;
  Device* device = nullptr;
  hal::Frame frame;

  void setup() override {
    plug("1-1", 0);
    device = &kernel.add_camera("/dev/video0");
    make({});
  }
  void teardown() override {
    camera.reset();
    LONGS_EQUAL(0, kernel.open_files());
    LONGS_EQUAL(0, device->maps);
  }
  void plug(const std::string& port, int node) {
    sys.plug({.path = port, .product = "GelSight Mini R0B 2BNN-4ZE7", .serial = "2BNN4ZE7", .first_node = node});
  }
  void make(V4l2Camera::Config config) {
    config.sysfs = sysfs.c_str();
    camera = std::make_unique<V4l2Camera>(config, kernel);
  }
  void fill(std::uint32_t sequence, microseconds stamp = 1s, std::uint32_t bytes = 100, std::uint32_t flags = 0) {
    device->filled.push_back({bytes, V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | flags, sequence, stamp});
  }
  void fails(const char* what) {
    CHECK_FALSE(camera->start());
    STRCMP_CONTAINS(what, std::string(camera->problem()).c_str());
    STRCMP_CONTAINS("Likely cause: ", std::string(camera->problem()).c_str());
    STRCMP_CONTAINS("Next: ", std::string(camera->problem()).c_str());
    LONGS_EQUAL(0, kernel.open_files());
    LONGS_EQUAL(0, device->maps);
    kernel.refused.clear();
    kernel.refusals.clear();
  }
  std::size_t with_driver() const {
    return static_cast<std::size_t>(std::ranges::count(device->queued, true));
  }
};

TEST(LinuxCamera, HandsOutWhatTheKernelFilledAndGivesItBack) {
  CHECK_TRUE(camera->start());
  STRCMP_EQUAL("2BNN4ZE7", std::string(camera->identity()).c_str());
  LONGS_EQUAL(4, with_driver());
  CHECK_TRUE(camera->next(frame, 5ms) == Capture::kTimeout);
  LONGS_EQUAL(5, kernel.polled_ms);
  fill(7, 12'345'678us, 4096);
  fill(9, 12'400'000us, 50);
  CHECK_TRUE(camera->next(frame, 5ms) == Capture::kFrame);
  LONGS_EQUAL(4096, frame.bytes.size());
  LONGS_EQUAL(7, frame.sequence);
  LONGS_EQUAL(12'345'678, frame.timestamp.count());
  CHECK_TRUE(frame.format == hal::PixelFormat::kMjpeg);
  LONGS_EQUAL(3280, frame.width);
  LONGS_EQUAL(2464, frame.height);
  POINTERS_EQUAL(reinterpret_cast<void*>(0x10000), frame.bytes.data());  // the buffer itself
  LONGS_EQUAL(3, with_driver());
  camera->release(frame);
  LONGS_EQUAL(4, with_driver());
  CHECK_TRUE(camera->next(frame, 5ms) == Capture::kFrame);
  LONGS_EQUAL(9, frame.sequence);
  camera->release(frame);
  // Not given back: the next one takes its place all the same.
  fill(10);
  fill(11);
  CHECK_TRUE(camera->next(frame, 5ms) == Capture::kFrame);
  CHECK_TRUE(camera->next(frame, 5ms) == Capture::kFrame);
  LONGS_EQUAL(3, with_driver());
  LONGS_EQUAL(4, camera->counts().frames);
  camera->stop();
  CHECK_FALSE(device->streaming);
  CHECK_TRUE(camera->next(frame, 5ms) == Capture::kGone);
}

TEST(LinuxCamera, DamagedFramesGoBackAtOnce) {
  CHECK_TRUE(camera->start());
  fill(1, 1s, 100, V4L2_BUF_FLAG_ERROR);
  fill(2, 1s, 0);
  fill(3, 1s, 4097);
  for (int i = 0; i < 3; ++i) {
    CHECK_TRUE(camera->next(frame, 5ms) == Capture::kBad);
    LONGS_EQUAL(4, with_driver());
  }
  LONGS_EQUAL(1, camera->counts().damaged);
  LONGS_EQUAL(2, camera->counts().empty);
  kernel.refused[VIDIOC_DQBUF] = EIO;
  fill(4);
  CHECK_TRUE(camera->next(frame, 5ms) == Capture::kBad);
  kernel.refused.clear();
  CHECK_TRUE(camera->next(frame, 5ms) == Capture::kFrame);
  LONGS_EQUAL(4, frame.sequence);
}

TEST(LinuxCamera, UnpluggedIsGoneAndComesBackUnderAnotherNumber) {
  CHECK_TRUE(camera->start());
  fill(1);
  CHECK_TRUE(camera->next(frame, 5ms) == Capture::kFrame);
  device->gone = true;
  camera->release(frame);
  CHECK_TRUE(camera->next(frame, 5ms) == Capture::kGone);
  LONGS_EQUAL(0, kernel.open_files());
  sys.unplug("1-1");
  CHECK_FALSE(camera->start());
  STRCMP_CONTAINS("no GelSight Mini", std::string(camera->problem()).c_str());
  plug("1-2", 1);
  (void)kernel.add_camera("/dev/video1");
  CHECK_TRUE(camera->start());
  CHECK_TRUE(camera->problem().empty());
  LONGS_EQUAL(2, camera->counts().starts);
  LONGS_EQUAL(1, kernel.devices["/dev/video1"].opens);
  camera->stop();
  device->maps = 0;  // the model counts all under the first
}

TEST(LinuxCamera, SetsTheVendorsControlsAndReadsThemBack) {
  CHECK_TRUE(camera->start());
  for (const drivers::CameraControl& control : drivers::camera_controls()) {
    LONGS_EQUAL_TEXT(control.value, device->controls[control.id], std::string(control.name).c_str());
  }
  LONGS_EQUAL(V4L2_EXPOSURE_MANUAL, device->controls[V4L2_CID_EXPOSURE_AUTO]);
  LONGS_EQUAL(180, device->controls[V4L2_CID_EXPOSURE_ABSOLUTE]);
  LONGS_EQUAL(0, camera->counts().controls_off);
  camera->stop();
  device->controls.erase(V4L2_CID_GAMMA);  // the seventh
  CHECK_TRUE(camera->start());
  LONGS_EQUAL(1 << 6, camera->counts().controls_off);
}

TEST(LinuxCamera, SaysWhyItDoesNotStart) {
  kernel.refusals["/dev/video0"] = EACCES;
  fails(
      "/dev/video0: cannot be opened (Permission denied). Likely cause: no right to it. Next: add the user to the "
      "group "
      "video");
  kernel.refusals["/dev/video0"] = ENOENT;
  fails("just being unplugged");
  device->caps = V4L2_CAP_META_CAPTURE;
  fails("gives no pictures");
  device->caps = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
  kernel.refused[VIDIOC_QUERYCAP] = ENOTTY;
  fails("is no camera");
  kernel.refused[VIDIOC_S_FMT] = EBUSY;
  fails("another program has it open");
  device->width = 640, device->height = 480;
  fails("offers 640x480, not MJPG 3280x2464");
  device->width = 3280, device->height = 2464;
  kernel.refused[VIDIOC_REQBUFS] = ENOMEM;
  fails("gives no buffers");
  device->most_buffers = 1;
  fails("gives no buffers");
  device->most_buffers = 32;
  kernel.refused[VIDIOC_QUERYBUF] = ENODEV;
  fails("tells nothing of a buffer");
  kernel.refused[VIDIOC_QBUF] = EIO;
  fails("a buffer is refused");
  kernel.refused[VIDIOC_STREAMON] = ENOSPC;
  fails("too little USB bandwidth");
  CHECK_TRUE(camera->start());
}

TEST(LinuxCamera, TakesTheBuffersItGets) {
  device->most_buffers = 2;
  CHECK_TRUE(camera->start());
  LONGS_EQUAL(2, with_driver());
  fill(1);
  CHECK_TRUE(camera->next(frame, 5ms) == Capture::kFrame);
  camera->stop();
  make({.buffers = 100});
  device->most_buffers = 100;
  CHECK_TRUE(camera->start());
  LONGS_EQUAL(V4l2Camera::kMostBuffers, with_driver());
}

TEST(LinuxCamera, TimeOfAnEmulatedBoardGoesSlower) {
  make({.time_scale = 20});
  CHECK_TRUE(camera->start());
  CHECK_TRUE(camera->next(frame, 5ms) == Capture::kTimeout);
  LONGS_EQUAL(100, kernel.polled_ms);
  fill(1, 40s);
  CHECK_TRUE(camera->next(frame, 5ms) == Capture::kFrame);
  LONGS_EQUAL(2'000'000, frame.timestamp.count());
}

TEST(LinuxCamera, OtherClocksAreNotBelieved) {
  CHECK_TRUE(camera->start());
  device->filled.push_back({100, V4L2_BUF_FLAG_TIMESTAMP_UNKNOWN, 1, 5s});
  timespec before{}, after{};
  ::clock_gettime(CLOCK_MONOTONIC, &before);
  CHECK_TRUE(camera->next(frame, 5ms) == Capture::kFrame);
  ::clock_gettime(CLOCK_MONOTONIC, &after);
  CHECK_TRUE(frame.timestamp >= std::chrono::seconds{before.tv_sec});
  CHECK_TRUE(frame.timestamp <= std::chrono::seconds{after.tv_sec + 1});
  LONGS_EQUAL(1, camera->counts().unstamped);
}
