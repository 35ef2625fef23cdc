// SPDX-License-Identifier: Apache-2.0
// A device on this computer: the whole firmware with its console, over a camera in real time, without lines.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "drivers/sim/recording.hpp"
#include "hal/camera.hpp"
#include "hal/clock.hpp"
#include "params/params.hpp"
#include "slip/model.hpp"
#include "toolchain/live/hub.hpp"
#include "toolchain/live/recorder.hpp"
#include "toolchain/log/messages.hpp"

namespace holdfast::live {

class Desk {
 public:
  struct Config {
    Params params;
    const model::Tree* tree = nullptr;  // outlives the desk; null: the compiled one decides
    bool as_device = false;             // Devices::as_device
    std::string code;                   // that unlocks its console
  };
  // All outlive it. The hub is its console's port, and has the pictures that are asked for.
  Desk(hal::Camera& camera, hal::Clock& clock, Hub& hub, const Config& config);
  ~Desk();
  Desk(const Desk&) = delete;
  Desk& operator=(const Desk&) = delete;

  // The picture of the empty gel, before start(); without it the first still ones are. Empty, or why it is none.
  [[nodiscard]] std::string learn(const sim::RecordedFrame& rest);
  // Empty, or an error line. Without a camera it goes on looking for one.
  [[nodiscard]] std::string start();
  // Once around: at most some milliseconds. What the frame says, when one came.
  [[nodiscard]] std::optional<log::FrameRecord> turn();
  void record_to(Recorder* recorder);
  void stop();

  // Why there is no camera, one line; empty: there is.
  [[nodiscard]] std::string camera_problem() const;

 private:
  struct Parts;
  void show();

  Hub& hub_;
  std::unique_ptr<Parts> parts_;
};

}  // namespace holdfast::live
