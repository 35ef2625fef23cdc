// SPDX-License-Identifier: Apache-2.0
// The board of a desk without hardware: the camera films the scene sphere_slip through the sensor's own format
// (3280x2464 JPEG), lines and link are recorded in memory, text goes to standard output. Time is virtual: the run is
// over when the scene is.
#include "board/board.hpp"

#include <unistd.h>

#include <array>

#include "drivers/common/crew.hpp"
#include "drivers/common/jpeg_turbo.hpp"
#include "drivers/sim/camera_scene.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/gpio.hpp"
#include "drivers/sim/scene/scenes.hpp"
#include "drivers/sim/serial.hpp"
#include "vision/jpeg_decoder.hpp"

namespace holdfast::board {
namespace {

class StandardOutput final : public hal::Serial {
 private:
  [[nodiscard]] bool do_write(std::span<const std::uint8_t> bytes) override {
    return ::write(STDOUT_FILENO, bytes.data(), bytes.size()) == static_cast<ssize_t>(bytes.size());
  }
  [[nodiscard]] std::size_t do_read(std::span<std::uint8_t>) override { return 0; }
};

drivers::Threads::Config threads(const Params& params) {
  drivers::Threads::Config config;
  config.workers = static_cast<std::size_t>(params.jpeg_threads);
  return config;
}

struct Desk {
  sim::Clock clock;
  sim::SceneCamera camera{scene::sphere_slip(), clock};
  sim::Gpio gpio{clock};
  sim::Serial link;
  drivers::TurboJpegDecoder other_scales;
  std::array<jpeg_fast::Worker, hal::kMaxWorkers> workers;
  drivers::Threads crew{threads(params())};
  EighthDecoder jpeg{jpeg_config(params()), other_scales, workers, crew};
  StandardOutput host;
  Devices devices{camera, gpio, link, clock, jpeg};
};

Desk& desk() {
  static Desk desk;
  return desk;
}

}  // namespace

Devices& devices() {
  return desk().devices;
}
hal::Serial& host() {
  return desk().host;
}
Params params() {
  return {};
}

}  // namespace holdfast::board
