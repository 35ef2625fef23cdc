// SPDX-License-Identifier: Apache-2.0
// What every backend of the HAL owes the firmware, run on each of them. A new backend adds a row to its table.
// Real cameras and lines join where there are some: HOLDFAST_REAL_DEVICES=virt says that this is tests/system's
// machine.
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <string_view>
#include <vector>

#include "board/linux/appliance.hpp"
#include "drivers/common/monotonic_clock.hpp"
#include "drivers/linux/camera_libcamera.hpp"
#include "drivers/linux/camera_v4l2.hpp"
#include "drivers/linux/gpio_gpiod.hpp"
#include "drivers/linux/serial_tty.hpp"
#include "drivers/sim/camera_faults.hpp"
#include "drivers/sim/camera_memory.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/gpio.hpp"
#include "drivers/sim/serial.hpp"
#include "hal/camera.hpp"
#include "hal/clock.hpp"
#include "hal/gpio.hpp"
#include "hal/serial.hpp"
#include "tests/support/pty.hpp"

#include <CppUTest/TestHarness.h>

namespace drivers = holdfast::drivers;
namespace sim = holdfast::sim;
namespace hal = holdfast::hal;
using hal::Capture;
using hal::Level;
using hal::Line;
using std::chrono::microseconds;
using namespace std::chrono_literals;

namespace {

// A device with all that keeps it alive.
template <typename Device>
struct Rig {
  virtual ~Rig() = default;
  virtual Device& device() = 0;
};

template <typename Device>
struct Backend {
  const char* name;
  std::unique_ptr<Rig<Device>> (*make)();
};

template <typename Concrete, typename Device>
std::unique_ptr<Rig<Device>> make_rig() {
  return std::make_unique<Concrete>();
}

struct SimClockRig final : Rig<hal::Clock> {
  sim::Clock clock;
  hal::Clock& device() override { return clock; }
};

struct SimGpioRig final : Rig<hal::Gpio> {
  sim::Clock clock;
  sim::Gpio gpio{clock};
  hal::Gpio& device() override { return gpio; }
};

struct SimSerialRig final : Rig<hal::Serial> {
  sim::Serial serial;
  hal::Serial& device() override { return serial; }
};

struct TtySerialRig final : Rig<hal::Serial> {
  holdfast::test::Pty pty;
  sim::Clock clock;
  drivers::SerialTty serial{clock};
  TtySerialRig() { STRCMP_EQUAL("", serial.open({.path = pty.path()}).c_str()); }
  hal::Serial& device() override { return serial; }
};

// A stream of at least five frames that ends, and the clock of its time stamps.
struct CameraRig : Rig<hal::Camera> {
  virtual hal::Clock& clock() = 0;
};

struct SimCameraRig : CameraRig {
  std::array<std::uint8_t, 64 * 48> pixels{};
  sim::Clock sim_clock;
  sim::CameraMemory camera{sim_clock, {{pixels.data(), 64, 48, 64}, {pixels.data(), 64, 48, 64}}, {.cycles = 5}};
  hal::Clock& clock() override { return sim_clock; }
  hal::Camera& device() override { return camera; }
};

struct SimFaultyCameraRig final : SimCameraRig {
  sim::FaultyCamera faulty{camera, sim_clock, {}, pixels.size()};
  hal::Camera& device() override { return faulty; }
};

struct CameraBackend {
  const char* name;
  std::unique_ptr<CameraRig> (*make)();
  bool real = false;  // never ends, and loses frames when the machine is slow
};

struct MonotonicClockRig final : Rig<hal::Clock> {
  drivers::MonotonicClock clock;
  hal::Clock& device() override { return clock; }
};

struct GpiodRig final : Rig<hal::Gpio> {
  GpiodRig() { STRCMP_EQUAL("", gpio.open({.wiring = holdfast::board::hardware().wiring}).c_str()); }
  drivers::GpiodGpio gpio;
  hal::Gpio& device() override { return gpio; }
};

template <typename Camera>
struct RealCameraRig final : CameraRig {
  drivers::MonotonicClock monotonic;
  Camera camera{drivers::V4l2Camera::Config{}};
  hal::Clock& clock() override { return monotonic; }
  hal::Camera& device() override { return camera; }
};

bool on_the_emulated_machine() {
  const char* const asked = std::getenv("HOLDFAST_REAL_DEVICES");
  return asked != nullptr && std::string_view(asked) == "virt";
}

constexpr Backend<hal::Clock> kClocks[] = {{"sim::Clock", make_rig<SimClockRig, hal::Clock>},
                                           {"MonotonicClock", make_rig<MonotonicClockRig, hal::Clock>}};
std::vector<Backend<hal::Gpio>> gpios() {
  std::vector<Backend<hal::Gpio>> all{{"sim::Gpio", make_rig<SimGpioRig, hal::Gpio>}};
  if (on_the_emulated_machine()) all.push_back({"GpiodGpio", make_rig<GpiodRig, hal::Gpio>});
  return all;
}
constexpr Backend<hal::Serial> kSerials[] = {{"sim::Serial", make_rig<SimSerialRig, hal::Serial>},
                                             {"SerialTty", make_rig<TtySerialRig, hal::Serial>}};
template <typename Concrete>
std::unique_ptr<CameraRig> make_camera() {
  return std::make_unique<Concrete>();
}
std::vector<CameraBackend> cameras() {
  std::vector<CameraBackend> all{{"sim::CameraMemory", make_camera<SimCameraRig>},
                                 {"sim::FaultyCamera", make_camera<SimFaultyCameraRig>}};
  if (on_the_emulated_machine()) {
    all.push_back({"V4l2Camera", make_camera<RealCameraRig<drivers::V4l2Camera>>, true});
    all.push_back({"LibcameraCamera", make_camera<RealCameraRig<drivers::LibcameraCamera>>, true});
  }
  return all;
}

constexpr microseconds kPatience = 2s;  // more than any camera needs for a frame

}  // namespace

TEST_GROUP(HalContract){};

TEST(HalContract, ClockNeverStepsBack) {
  for (const auto& backend : kClocks) {
    const auto rig = backend.make();
    microseconds last = rig->device().now();
    for (int i = 0; i < 1000; ++i) {
      const microseconds now = rig->device().now();
      CHECK_TEXT(now >= last, backend.name);
      last = now;
    }
  }
}

TEST(HalContract, ClockWaitsForTheTime) {
  for (const auto& backend : kClocks) {
    const auto rig = backend.make();
    const microseconds before = rig->device().now();
    rig->device().wait(1500us);
    CHECK_TEXT(rig->device().now() - before >= 1500us, backend.name);
  }
}

TEST(HalContract, GpioTakesBothLevelsOnEveryLineAgainAndAgain) {
  for (const auto& backend : gpios()) {
    const auto rig = backend.make();
    for (const Level level : {Level::kHigh, Level::kHigh, Level::kLow, Level::kLow, Level::kHigh}) {
      for (const Line line : {Line::kGripOk, Line::kAlive}) CHECK_TEXT(rig->device().set(line, level), backend.name);
    }
  }
}

TEST(HalContract, SerialWritesAllOrNothingAndReadsOnlyWhatIsThere) {
  for (const auto& backend : kSerials) {
    const auto rig = backend.make();
    std::array<std::uint8_t, 64> buffer{};
    CHECK_TEXT(rig->device().write({}), backend.name);
    CHECK_TEXT(rig->device().write(buffer), backend.name);
    LONGS_EQUAL_TEXT(0, rig->device().read(buffer), backend.name);  // nothing waits: returns at once
    LONGS_EQUAL_TEXT(0, rig->device().read({}), backend.name);
  }
}

TEST(HalContract, CameraIsGoneUntilStarted) {
  for (const auto& backend : cameras()) {
    const auto rig = backend.make();
    hal::Frame frame;
    CHECK_TEXT(Capture::kGone == rig->device().next(frame, kPatience), backend.name);
    rig->device().stop();  // allowed at any time
    CHECK_TEXT(Capture::kGone == rig->device().next(frame, kPatience), backend.name);
  }
}

TEST(HalContract, CameraFramesAreWholeAndMoveForward) {
  for (const auto& backend : cameras()) {
    const auto rig = backend.make();
    hal::Camera& camera = rig->device();
    CHECK_TEXT(camera.start(), backend.name);
    hal::Frame last;
    for (int i = 0; i < 5; ++i) {
      hal::Frame frame;
      CHECK_TEXT(Capture::kFrame == camera.next(frame, kPatience), backend.name);
      CHECK_TEXT(!frame.bytes.empty(), backend.name);
      if (frame.format == hal::PixelFormat::kLuma8) {
        CHECK_TEXT(frame.stride >= frame.width && frame.width > 0 && frame.height > 0, backend.name);
        CHECK_TEXT(
            frame.bytes.size() == static_cast<std::size_t>(frame.stride) * static_cast<std::size_t>(frame.height),
            backend.name);
      }
      CHECK_TEXT(frame.timestamp <= rig->clock().now(), backend.name);  // exposed before it is here
      if (i > 0) CHECK_TEXT(frame.timestamp > last.timestamp && frame.sequence != last.sequence, backend.name);
      last = frame;
      camera.release(frame);
    }
    camera.stop();
  }
}

TEST(HalContract, CameraWaitsNoLongerThanAskedAndLosesNothingByIt) {
  for (const auto& backend : cameras()) {
    const auto rig = backend.make();
    hal::Camera& camera = rig->device();
    CHECK_TEXT(camera.start(), backend.name);
    hal::Frame frame;
    int timeouts = 0;
    for (std::uint32_t frames = 0; frames < 5;) {
      const microseconds before = rig->clock().now();
      const Capture capture = camera.next(frame, 3ms);
      if (capture == Capture::kTimeout) {
        ++timeouts;
        CHECK_TEXT(rig->clock().now() >= before + 3ms, backend.name);
        CHECK_TEXT(timeouts < 1'000'000, backend.name);
        continue;
      }
      CHECK_TEXT(capture == Capture::kFrame, backend.name);
      if (!backend.real) LONGS_EQUAL_TEXT(frames, frame.sequence, backend.name);
      camera.release(frame);
      ++frames;
    }
    CHECK_TEXT(timeouts > 0, backend.name);  // no camera sends a frame every 3 ms
    camera.stop();
  }
}

TEST(HalContract, CameraEndsStaysGoneAndCanBeStartedAgain) {
  for (const auto& backend : cameras()) {
    if (backend.real) continue;  // unplugging one is tests/system's business
    const auto rig = backend.make();
    hal::Camera& camera = rig->device();
    hal::Frame frame;
    for (int round = 0; round < 2; ++round) {
      CHECK_TEXT(camera.start(), backend.name);
      int frames = 0;
      while (camera.next(frame, kPatience) == Capture::kFrame) {
        camera.release(frame);
        ++frames;
      }
      CHECK_TEXT(frames >= 5, backend.name);
      CHECK_TEXT(Capture::kGone == camera.next(frame, kPatience), backend.name);
      camera.stop();
      camera.stop();
      CHECK_TEXT(Capture::kGone == camera.next(frame, kPatience), backend.name);
    }
  }
}
