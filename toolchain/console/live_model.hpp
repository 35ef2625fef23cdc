// SPDX-License-Identifier: Apache-2.0
// What the live view shows: the device as the receiver of its frames knows it, for the last ten seconds.
// Times are the receiver's own, in seconds since the view began; bounded whatever comes.
#pragma once

#include <deque>
#include <optional>
#include <string>

#include "link/status_frame.hpp"
#include "tactile/types.hpp"
#include "toolchain/console/telemetry.hpp"

namespace holdfast::console_tool {

struct LiveSample {
  double at_s = 0;
  double speed_mm_s = 0;
  double entropy_nat = 0;
  double rate_nat_s = 0;
  bool measured = false;  // the three mean something
  bool accepted = false;
  bool slip = false;
};

struct LiveEvent {
  double at_s = 0;
  std::string text{};
};

struct LiveModel {
  static constexpr double kShownS = 10.0;
  static constexpr std::size_t kEvents = 16;

  std::string title;
  std::string port;
  double now_s = 0;
  bool away = false;  // the port is unplugged
  std::optional<status_frame::StatusFrame> status;
  double status_s = 0;
  std::optional<double> edge_s;  // when ALIVE last changed; nothing: a first frame's level confirms nothing
  std::optional<DisplacementField> rest, field;
  double field_s = 0;
  int magnified = 1;  // arrows, so that the longest of the last ten seconds spans about a pitch
  std::int64_t lost = 0;
  std::deque<LiveSample> samples;
  std::deque<LiveEvent> events;  // the newest first

  void take(const Telemetry::Frame& frame, double at_s);
  void take(const DisplacementField& new_rest, const DisplacementField& new_field, double at_s);
  void note(std::string text, double at_s);

  // Since the last frame; nothing: none came.
  [[nodiscard]] std::optional<double> silent_s() const;
  // The receiver's rule (LINK.md).
  [[nodiscard]] bool fresh() const;
  // Accepted pictures a second, over the last two seconds.
  [[nodiscard]] double fps() const;
  // Of the printed lattice, um; 0: not known.
  [[nodiscard]] double pitch_um() const;

 private:
  std::deque<std::pair<double, double>> longest_;  // when, um
};

}  // namespace holdfast::console_tool
