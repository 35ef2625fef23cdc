// SPDX-License-Identifier: Apache-2.0
// Keeps `watch on` going for whoever looks on for long: begins it, begins it again when the device was away, and says
// what is happening meanwhile.
#pragma once

#include <chrono>
#include <functional>
#include <string>
#include <string_view>

#include "toolchain/console/device.hpp"
#include "toolchain/console/telemetry.hpp"

namespace holdfast::console_tool {

[[nodiscard]] std::string gone_line(const Device& device);

class Watching {
 public:
  using Moment = Telemetry::Moment;

  // `note`: what a person should know.
  Watching(Device& device, std::function<void(const std::string&)> note);
  ~Watching();
  Watching(const Watching&) = delete;
  Watching& operator=(const Watching&) = delete;

  // Called from turn(), for each.
  std::function<void(const Telemetry::Received&)> on_frame;
  std::function<void()> on_field;  // telemetry().field() is a new one

  // Empty, or the error line.
  [[nodiscard]] std::string begin();
  // Waits at most so long, and takes what came. What the signals said.
  [[nodiscard]] Signals::What turn(Millis at_most);

  // At the end: whether the device has gone, or stands still. Asks it where nothing came of late.
  [[nodiscard]] bool lost();

  [[nodiscard]] const Telemetry& telemetry() const { return telemetry_; }
  // Pixels of the working image per um; 0: not known yet.
  [[nodiscard]] double px_per_um() const { return px_per_um_; }

 private:
  void come_back();
  void ask_scale();
  void answers();

  Device& device_;
  std::function<void(const std::string&)> note_;
  Device::Heard before_;
  Telemetry telemetry_;
  double px_per_um_ = 0;
  bool scale_wanted_ = true;
  bool away_ = false;
  bool silent_ = false;  // it is there, and does not answer
  Moment heard_at_{};
  Moment try_at_{};
};

}  // namespace holdfast::console_tool
