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
#include <set>
#include <string>
#include <vector>

#include "tests/support/sysfs_tree.hpp"
#include "tests/support/video_model.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;
using drivers::V4l2Camera;
using hal::Capture;
using std::chrono::microseconds;
using namespace std::chrono_literals;

}  // namespace

TEST_GROUP(LinuxCamera) {
  test::SysfsTree sys;
  std::string sysfs = sys.root();
  test::VideoModel kernel;
  std::unique_ptr<V4l2Camera> camera;
  test::VideoDevice* device = nullptr;
  hal::Frame frame;

  void setup() override {
    plug("1-1", 0);
    device = &kernel.add_camera("/dev/video0");
    make({});
  }
  void teardown() override {
    camera.reset();
    LONGS_EQUAL(0, kernel.open_files());
    LONGS_EQUAL(0, kernel.maps);
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
    LONGS_EQUAL(0, kernel.maps);
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
}

TEST(LinuxCamera, SetsTheVendorsControlsAndReadsThemBack) {
  CHECK_TRUE(camera->start());
  for (const drivers::CameraControl& control : drivers::camera_controls()) {
    LONGS_EQUAL_TEXT(control.value, device->controls[control.id], std::string(control.name).c_str());
  }
  LONGS_EQUAL(V4L2_EXPOSURE_MANUAL, device->controls[V4L2_CID_EXPOSURE_AUTO]);
  LONGS_EQUAL(180, device->controls[V4L2_CID_EXPOSURE_ABSOLUTE]);
  CHECK_TRUE(camera->unset().empty() && camera->steady());
}

// What the camera does not have it cannot refuse: the picture is as this sensor makes it. It is said all the same.
TEST(LinuxCamera, NamesTheControlsThatTheCameraDoesNotHave) {
  device->controls.erase(V4L2_CID_GAMMA);
  device->controls.erase(V4L2_CID_HUE);
  CHECK_TRUE(camera->start());
  CHECK_TRUE(camera->steady());
  const std::string said(camera->unset());
  STRCMP_CONTAINS("the camera does not have hue=0 gamma=140. Likely cause: ", said.c_str());
  STRCMP_CONTAINS("Next: ", said.c_str());
  LONGS_EQUAL(1 << 3 | 1 << 6, camera->counts().controls_off.missing);
  LONGS_EQUAL(0, camera->counts().controls_off.refused);
}

// Refused, or taken and not kept: brightness or rate are not what the firmware was measured with.
TEST(LinuxCamera, TellsWhatTheCameraDoesNotTake) {
  device->stubborn = {V4L2_CID_EXPOSURE_ABSOLUTE, V4L2_CID_SHARPNESS};
  CHECK_TRUE(camera->start());
  CHECK_FALSE(camera->steady());
  STRCMP_CONTAINS("the camera does not take sharpness=3 exposure_time_absolute=180. Likely cause: ",
                  std::string(camera->unset()).c_str());
  camera->stop();
  for (auto& [id, value] : device->controls) value = -77;
  device->stubborn = {V4L2_CID_SHARPNESS, V4L2_CID_HUE, V4L2_CID_SATURATION, V4L2_CID_WHITE_BALANCE_TEMPERATURE,
                      V4L2_CID_POWER_LINE_FREQUENCY};
  CHECK_TRUE(camera->start());
  CHECK_TRUE(camera->steady());  // said, and no reason to stop
  STRCMP_CONTAINS("does not take saturation=64 hue=0", std::string(camera->unset()).c_str());
  for (const drivers::CameraControl& control : drivers::camera_controls()) {
    camera->stop();
    device->stubborn = {control.id};
    device->controls[control.id] = -77;
    CHECK_TRUE(camera->start());
    CHECK_EQUAL(control.steadies, !camera->steady());
  }
  camera->stop();
  device->stubborn.clear();
  CHECK_TRUE(camera->start());
  CHECK_TRUE(camera->unset().empty() && camera->steady());
}

TEST(LinuxCamera, SaysWhyItDoesNotStart) {
  kernel.refusals["/dev/video0"] = EACCES;
  fails(
      "/dev/video0: cannot be opened (Permission denied). Likely cause: no right to it. Next: add the user to the "
      "group "
      "video");
  kernel.refusals["/dev/video0"] = ENOENT;
  fails("the sensor is being unplugged");
  device->caps = V4L2_CAP_META_CAPTURE;
  fails("does not capture video");
  device->caps = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
  kernel.refused[VIDIOC_QUERYCAP] = ENOTTY;
  fails("is not a V4L2 device");
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
  fails("does not describe its buffers");
  kernel.refused[VIDIOC_QBUF] = EIO;
  fails("a buffer is refused");
  kernel.refused[VIDIOC_STREAMON] = EIO;
  fails("the stream does not start (Input/output error). Likely cause: a fault of the sensor");
  CHECK_TRUE(camera->start());
}

// Two sensors on one bus: whichever comes second is refused, until the first one has gone.
TEST(LinuxCamera, TheSecondStreamOnAFullBusIsRefused) {
  sys.plug({.path = "1-2", .product = "GelSight Mini R0B 28D3-K2R9", .serial = "28D3K2R9", .first_node = 2});
  const test::VideoDevice& other = kernel.add_camera("/dev/video2");
  make({.serial = "2BNN4ZE7"});
  V4l2Camera right({.serial = "28D3K2R9", .sysfs = sysfs.c_str()}, kernel);
  kernel.streams_at_most = 1;
  CHECK_TRUE(camera->start());
  for (int tries = 0; tries < 3; ++tries) CHECK_FALSE(right.start());
  STRCMP_EQUAL(
      "/dev/video2: the stream does not start (No space left on device). Likely cause: another camera has reserved the "
      "USB bandwidth. Next: use another controller (lsusb -t; a Pi 4 has one for all ports)",
      std::string(right.problem()).c_str());
  CHECK(right.problem().size() <= 200);  // what `devices` shows at the console
  CHECK_TRUE(device->streaming);
  CHECK_FALSE(other.streaming);
  LONGS_EQUAL(1, kernel.open_files());
  camera->stop();
  CHECK_TRUE(right.start());
  STRCMP_EQUAL("", std::string(right.problem()).c_str());
  CHECK_FALSE(camera->start());
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
  CHECK_FALSE(frame.stamped);
  LONGS_EQUAL(1, camera->counts().unstamped);
  fill(2);
  CHECK_TRUE(camera->next(frame, 5ms) == Capture::kFrame);
  CHECK_TRUE(frame.stamped);
}
