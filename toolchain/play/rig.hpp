// SPDX-License-Identifier: Apache-2.0
// The firmware on simulated lines, in virtual time: what every host program needs that runs it without a board and
// keeps none of its pins' history. Host code: it allocates once, when it is made.
#pragma once

#include <memory>
#include <span>

#include "app/app.hpp"
#include "drivers/common/jpeg_turbo.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/gpio.hpp"
#include "drivers/sim/serial.hpp"
#include "hal/crew.hpp"
#include "vision/jpeg_decoder.hpp"

namespace holdfast::tool {

// The board's JPEG decoder with one thread.
class OneThreadDecoder {
 public:
  explicit OneThreadDecoder(const Params& params)
      : worker_(std::make_unique<jpeg_fast::Worker>()),
        decoder_(
            std::make_unique<EighthDecoder>(jpeg_config(params), other_scales_, std::span(worker_.get(), 1), crew_)) {}
  ~OneThreadDecoder() = default;
  OneThreadDecoder(const OneThreadDecoder&) = delete;
  OneThreadDecoder& operator=(const OneThreadDecoder&) = delete;

  [[nodiscard]] JpegDecoder& get() { return *decoder_; }

 private:
  drivers::TurboJpegDecoder other_scales_;
  std::unique_ptr<jpeg_fast::Worker> worker_;
  hal::Alone crew_;
  std::unique_ptr<EighthDecoder> decoder_;
};

class Rig {
 public:
  explicit Rig(const Params& params) : jpeg_(params) {}
  ~Rig() = default;
  Rig(const Rig&) = delete;
  Rig& operator=(const Rig&) = delete;

  [[nodiscard]] sim::Clock& clock() { return clock_; }
  // The firmware over a camera that shares clock() and outlives the rig's use. `tree` null: the compiled one.
  [[nodiscard]] App& connect(hal::Camera& camera, const model::Tree* tree = nullptr) {
    app_ = std::make_unique<App>(Devices{camera, gpio_, link_, clock_, jpeg_.get()}, tree);
    return *app_;
  }

 private:
  sim::Clock clock_;
  sim::Gpio gpio_{clock_};
  sim::Serial link_;
  OneThreadDecoder jpeg_;
  std::unique_ptr<App> app_;
};

}  // namespace holdfast::tool
