// SPDX-License-Identifier: Apache-2.0
// Each system call of the Linux drivers fails once, whichever it is and with whatever errno: the camera under the whole
// firmware, a serial port, and files. (Lines: gpio_gpiod_test.cpp and drivers/linux_bridge_test.cpp.)
//
// The oracle of the camera is the receiver's rule (DESIGN.md): "fine" counts while the last edge of ALIVE is younger
// than 150 ms, and an edge needs a frame that the kernel filled, younger than 150 ms, which no edge has told of.
#include "tests/linux/failing_calls.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "app/daemon.hpp"
#include "drivers/common/file_keep.hpp"
#include "drivers/common/file_store.hpp"
#include "drivers/linux/camera_v4l2.hpp"
#include "drivers/linux/serial_tty.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/gpio.hpp"
#include "drivers/sim/serial.hpp"
#include "tests/support/deadline.hpp"
#include "tests/support/pty.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/sysfs_tree.hpp"
#include "tests/support/temp_dir.hpp"
#include "tests/support/video_model.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace std::chrono_literals;
using test::Armed;
using test::failing_calls;
using Bytes = std::vector<std::uint8_t>;

namespace {

constexpr std::array kOfDevices{EIO, ENODEV, EAGAIN, EINTR, ENOMEM};
constexpr std::array kOfFiles{EIO, ENOSPC, EINTR};

// n = 1, 2, ... until a run has fewer calls than n. How many calls the longest run had.
template <typename Run>
int each_call_fails(std::span<const int> errors, const Run& run) {
  int calls = 0;
  for (const int error : errors) {
    for (int at = 1;; ++at) {
      failing_calls().plan(at, error);
      run(("call " + std::to_string(at) + ": " + std::strerror(error)).c_str());
      if (!failing_calls().failed()) break;
      calls = std::max(calls, at);
    }
  }
  failing_calls().plan(0, 0);
  return calls;
}

// A sensor of 25 fps: it exposes every 40 ms, and the frame is there 40 ms later. What is in a buffer is which picture
// it is, and the frame's number.
class Sensor final : public test::VideoModel {
 public:
  explicit Sensor(sim::Clock& clock) : clock_(clock), memory_(kBuffers * kLength) {}

  Micros taken{-1h};  // exposure of the newest frame that the driver was given

  int open(const char* path, int flags) override {
    return failing_calls().fails() ? -1 : VideoModel::open(path, flags);
  }
  int close(int fd) override {
    const bool failed = failing_calls().fails();
    (void)VideoModel::close(fd);
    return failed ? -1 : 0;
  }
  void* map(int fd, std::size_t length, off_t offset) override {
    if (failing_calls().fails()) return MAP_FAILED;
    (void)VideoModel::map(fd, length, offset);
    return &memory_[static_cast<std::size_t>(offset)];
  }
  int poll(pollfd* one, int timeout_ms) override {
    if (failing_calls().fails()) return -1;
    const Micros until = clock_.now() + std::chrono::milliseconds(timeout_ms);
    while (device().filled.empty() && due_ <= until) {
      clock_.advance(std::max(due_ - clock_.now(), Micros{0}));
      fill();
    }
    if (device().filled.empty()) clock_.advance(until - clock_.now());
    return VideoModel::poll(one, timeout_ms);
  }
  int ioctl(int fd, unsigned long request, void* argument) override {
    if (failing_calls().fails()) return -1;
    const Micros stamp = device().filled.empty() ? Micros{} : device().filled.front().stamp;
    const int result = VideoModel::ioctl(fd, request, argument);
    if (result == 0 && request == VIDIOC_STREAMON) {
      device().filled.clear();
      due_ = clock_.now() + 40ms;
    }
    if (result == 0 && request == VIDIOC_DQBUF) {
      const auto* const buffer = static_cast<v4l2_buffer*>(argument);
      std::memcpy(&memory_[buffer->index * kLength], &buffer->sequence, sizeof buffer->sequence);
      taken = stamp;
    }
    return result;
  }

 private:
  static constexpr std::size_t kBuffers = 8, kLength = 4096;
  [[nodiscard]] test::VideoDevice& device() { return devices.begin()->second; }
  void fill() {
    ++sequence_;
    const auto busy = device().filled.size();
    const auto queued = static_cast<std::size_t>(std::ranges::count(device().queued, true));
    if (busy < queued) {
      device().filled.push_back({100, V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC, sequence_, due_ - 40ms});
    }
    due_ += 40ms;
  }

  sim::Clock& clock_;
  Bytes memory_;
  Micros due_{};
  std::uint32_t sequence_ = 0;
};

// By the number in the buffer.
class Gallery final : public JpegDecoder {
 public:
  explicit Gallery(const std::vector<reference_model::Picture>& pictures) : pictures_(pictures) {}

 private:
  [[nodiscard]] Status do_decode(std::span<const std::uint8_t> bytes, DecodeScale, LumaBuffer& out) override {
    std::uint32_t number = 0;
    std::memcpy(&number, bytes.data(), sizeof number);
    const reference_model::Picture& picture = pictures_[number % pictures_.size()];
    out.width = picture.width;
    out.height = picture.height;
    // No two pictures of a sensor are alike.
    std::uint32_t random = number;
    std::transform(picture.pixels.begin(), picture.pixels.end(), out.pixels.begin(), [&](std::uint8_t pixel) {
      random = random * 1664525 + 1013904223;
      return static_cast<std::uint8_t>(pixel ^ (random >> 31));
    });
    return kOkStatus;
  }
  const std::vector<reference_model::Picture>& pictures_;
};

}  // namespace

TEST_GROUP(FailingCalls) {
  test::TempDir dir;
  void teardown() override {
    failing_calls().plan(0, 0);
  }
};

TEST(FailingCalls, TheCameraIsNeverFineWithoutFramesAndComesBack) {
  std::vector<reference_model::Picture> pictures;
  const scene::PictureConfig view = scene::cropped_320x240();
  for (std::uint64_t k = 0; k < 16; ++k) {
    pictures.push_back(reference_model::picture_of(view, reference_model::lattice_px({}, view, {}), 300 + k));
  }
  test::SysfsTree sys;
  const std::string sysfs = sys.root();
  sys.plug({.path = "1-1", .product = "GelSight Mini R0B 2BNN-4ZE7", .serial = "2BNN4ZE7", .first_node = 0});
  Micros longest{};

  const int calls = each_call_fails(kOfDevices, [&](const char* what) {
    sim::Clock clock;
    clock.advance(1s);
    Sensor kernel(clock);
    (void)kernel.add_camera("/dev/video0");
    drivers::V4l2Camera camera({.sysfs = sysfs.c_str()}, kernel);
    sim::Gpio lines(clock);
    sim::Serial link, gripper;
    hal::NoKeep keep;
    Gallery gallery(pictures);
    const auto daemon =
        std::make_unique<Daemon>(Devices{camera, lines, link, clock, gallery}, Periphery{gripper, keep});
    {
      const Armed armed;
      CHECK_TRUE_TEXT(daemon->start({}).ok(), what);
    }
    Micros edge{-1h}, told_of{-1h}, fine_since{};
    std::uint64_t edges = lines.edges(hal::Line::kAlive);
    // Fine for 300 ms on end, after the failure if there is one; 10 s would be for ever.
    while (clock.now() < 11s && (fine_since == Micros{} || clock.now() - fine_since < 300ms)) {
      {
        const Armed armed;
        daemon->poll();
      }
      const bool moved = lines.edges(hal::Line::kAlive) != edges;
      edges = lines.edges(hal::Line::kAlive);
      if (moved) {
        edge = clock.now();
        CHECK_TRUE_TEXT(kernel.taken > told_of && edge - kernel.taken <= 150ms, what);
        told_of = kernel.taken;
      }
      const bool high = lines.level(hal::Line::kGripOk) == hal::Level::kHigh;
      if (high && clock.now() - edge < 150ms) {
        CHECK_TRUE_TEXT(clock.now() - kernel.taken <= 300ms, what);
        if (fine_since == Micros{}) fine_since = clock.now();
      } else {
        fine_since = {};
      }
      if (daemon->app().outputs().state == DeviceState::kFault) {
        CHECK_TRUE_TEXT(daemon->app().outputs().reason != Reason::kNone, what);
      }
    }
    CHECK_TRUE_TEXT(fine_since != Micros{}, what);
    CHECK_TRUE_TEXT(camera.steady() && camera.unset().empty(), what);  // a transfer that was lost is no refusal
    longest = std::max(longest, fine_since - 1s);
    daemon->stop();
    LONGS_EQUAL_TEXT(0, kernel.open_files(), what);
    LONGS_EQUAL_TEXT(0, kernel.maps, what);
  });
  std::printf("\n%d calls x %zu errors: fine again within %.2f s of the start", calls, kOfDevices.size(),
              static_cast<double>(longest.count()) * 1e-6);
  CHECK_TRUE(calls > 100);
  CHECK_TRUE(longest < 2s);
}

// What the port took arrives whole and in order, what it refused does not; and it goes on.
TEST(FailingCalls, ASerialPortCutsNothingAndComesBack) {
  const int calls = each_call_fails(kOfDevices, [&](const char* what) {
    sim::Clock clock;
    test::Pty pty;
    termios plain = pty.settings();
    ::cfmakeraw(&plain);  // or it would send back what comes before the port has opened
    CHECK_TRUE(::tcsetattr(pty.master(), TCSANOW, &plain) == 0);
    std::string arrived;
    std::vector<std::string> taken;
    std::string heard;
    drivers::SerialTty port(clock);
    {
      const Armed armed;
      (void)port.open({.path = pty.path()});
    }
    for (int k = 0; k < 12; ++k) {
      std::string message = "message " + std::to_string(k) + "\n";
      const Bytes bytes(message.begin(), message.end());
      bool took = false;
      std::array<std::uint8_t, 64> room{};
      const bool sent = pty.send({static_cast<std::uint8_t>('a' + k)});
      CHECK_TRUE_TEXT(sent, what);
      {
        std::optional<Armed> armed;
        if (k < 9) armed.emplace();  // it has three rounds to come back
        took = port.write(bytes);
        const std::size_t count = port.read(room);
        heard.append(room.begin(), room.begin() + static_cast<std::ptrdiff_t>(count));
      }
      if (took) taken.push_back(message);
      const Bytes got = took && port.connected() ? pty.expect(bytes.size()) : pty.take();
      arrived.append(got.begin(), got.end());
      clock.advance(300ms);
    }
    const Bytes rest = pty.take();
    arrived.append(rest.begin(), rest.end());
    // A hang-up loses what is on its way.
    std::string expected, lost;
    for (const std::string& message : taken) {
      const bool there = arrived.compare(expected.size(), message.size(), message) == 0;
      (there ? expected : lost) += message;
    }
    STRCMP_EQUAL_TEXT(expected.c_str(), arrived.c_str(), what);
    CHECK_TRUE_TEXT(lost.empty() || (port.counters().hang_ups == 1 && lost.find('\n') == lost.size() - 1), what);
    CHECK_TRUE_TEXT(port.connected(), what);
    CHECK_TRUE_TEXT(taken.size() >= 9, what);  // back after one waiting time, 100 ms
    const auto deadline = std::chrono::steady_clock::now() + test::kDeadline;
    while (!heard.ends_with("kl") && std::chrono::steady_clock::now() < deadline) {
      std::array<std::uint8_t, 64> room{};
      const std::size_t count = port.read(room);
      heard.append(room.begin(), room.begin() + static_cast<std::ptrdiff_t>(count));
    }
    CHECK_TRUE_TEXT(heard.ends_with("kl"), what);  // what came before it was open again is another's
    const Armed armed;
    port.close();
  });
  CHECK_TRUE(calls > 40);
}

// What it says is stored is found by the next one; what was there stays whatever happens.
TEST(FailingCalls, AStoreLosesNothing) {
  const Bytes old(600, 11), young(600, 22), latest(600, 33);
  int round = 0;
  const auto begins_with = [](std::span<const std::uint8_t> slot, const Bytes& bytes) {
    return std::equal(bytes.begin(), bytes.end(), slot.begin());
  };
  const auto put = [](drivers::FileStore& store, std::size_t slot, const Bytes& bytes) {
    if (!store.begin(slot, bytes)) return false;
    const auto deadline = std::chrono::steady_clock::now() + 60s;
    while (store.state() == hal::Store::State::kBusy && std::chrono::steady_clock::now() < deadline) {
      std::this_thread::yield();
    }
    return store.state() == hal::Store::State::kDone;
  };
  const int calls = each_call_fails(kOfFiles, [&](const char* what) {
    const std::filesystem::path path = dir / std::to_string(++round);
    {
      drivers::FileStore store(path, 600);
      CHECK_TRUE(put(store, 0, old));
    }
    bool stored = false, stored_again = false;
    {
      const Armed armed;
      drivers::FileStore store(path, 600);
      if (store.trouble().empty()) {
        CHECK_TRUE_TEXT(begins_with(store.found(0), old), what);
        stored = put(store, 1, young);
        CHECK_TRUE_TEXT(stored || store.error() != 0, what);
        stored_again = put(store, 1, latest);
        CHECK_TRUE_TEXT(stored || stored_again, what);
      }
    }
    drivers::FileStore next(path, 600);
    STRCMP_EQUAL_TEXT("", next.trouble().c_str(), what);
    CHECK_TRUE_TEXT(begins_with(next.found(0), old), what);
    if (stored_again) CHECK_TRUE_TEXT(begins_with(next.found(1), latest), what);
    if (stored && !stored_again) {
      CHECK_TRUE_TEXT(begins_with(next.found(1), young) || begins_with(next.found(1), latest), what);
    }
  });
  CHECK_TRUE(calls >= 10);
}

TEST(FailingCalls, ACheckpointIsKeptOrRefused) {
  const Bytes old(40'000, 11), young(40'000, 22);
  const int calls = each_call_fails(kOfFiles, [&](const char* what) {
    const std::filesystem::path path = dir / "keep";
    {
      drivers::FileKeep keep(path, old.size());
      CHECK_TRUE(keep.write(0, old));
    }
    bool kept = false;
    Bytes found(old.size());
    {
      const Armed armed;
      drivers::FileKeep keep(path, old.size());
      if (keep.read(0, found)) CHECK_TRUE_TEXT(found == old, what);
      const bool first = keep.write(0, young), second = keep.write(0, young);
      kept = first || second;
      CHECK_TRUE_TEXT(kept || keep.size() == 0, what);
      CHECK_EQUAL_TEXT(!second, keep.error() != 0, what);
    }
    drivers::FileKeep next(path, old.size());
    CHECK_TRUE_TEXT(next.read(0, found) && found == (kept ? young : old), what);
  });
  CHECK_TRUE(calls >= 6);
}
