// SPDX-License-Identifier: Apache-2.0
#include "toolchain/console/live_model.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "base/math.hpp"

namespace holdfast::console_tool {

void LiveModel::take(const Telemetry::Frame& frame, double at_s) {
  const status_frame::StatusFrame& now = frame.status;
  if (status && status->alive != now.alive) edge_s = at_s;
  if (!status || status->state != now.state || status->reason != now.reason) {
    note(std::string(info(now.state).name) + " " + std::string(info(now.reason).name), at_s);
  }
  status = now;
  status_s = at_s;
  lost += frame.lost;
  samples.push_back({at_s, std::hypot(now.vx_um_s, now.vy_um_s) * 1e-3, now.entropy_nat_q16 / 65536.0,
                     now.entropy_rate_nat_s_q8 / 256.0, now.features_valid, frame.accepted, now.slip});
  while (samples.front().at_s < at_s - kShownS) samples.pop_front();
}

void LiveModel::take(const DisplacementField& new_rest, const DisplacementField& new_field, double at_s) {
  rest = new_rest;
  field = new_field;
  field_s = at_s;
  double longest = 0;
  for (std::int32_t i = 0; i < new_field.grid.count(); ++i) {
    const MarkerDisplacement& d = new_field.markers[idx(i)];
    if (d.valid) longest = std::max(longest, std::hypot(d.dx.raw(), d.dy.raw()));
  }
  longest_.emplace_back(at_s, longest);
  while (longest_.front().first < at_s - kShownS) longest_.pop_front();
  for (const auto& [when, length] : longest_) longest = std::max(longest, length);
  constexpr std::array kSteps{20, 15, 10, 8, 5, 4, 3, 2, 1};
  magnified = 1;
  for (const int step : kSteps) {
    if (longest * step > pitch_um()) continue;
    magnified = step;
    break;
  }
}

void LiveModel::note(std::string text, double at_s) {
  events.push_front({at_s, std::move(text)});
  if (events.size() > kEvents) events.pop_back();
}

std::optional<double> LiveModel::silent_s() const {
  return status ? std::optional(now_s - status_s) : std::nullopt;
}

bool LiveModel::fresh() const {
  constexpr double kFreshS = static_cast<double>(status_frame::kFreshFor.count()) * 1e-6;
  return edge_s && now_s - *edge_s < kFreshS;
}

double LiveModel::fps() const {
  constexpr double kOverS = 2.0;
  int count = 0;
  double first = 0;
  double last = 0;
  for (const LiveSample& sample : samples) {
    if (!sample.accepted || sample.at_s < now_s - kOverS) continue;
    if (count++ == 0) first = sample.at_s;
    last = sample.at_s;
  }
  return count < 2 || last <= first ? 0 : (count - 1) / (last - first);
}

double LiveModel::pitch_um() const {
  if (!rest) return 0;
  double sum = 0;
  int count = 0;
  for (std::int32_t i = 0; i + 1 < rest->grid.count(); ++i) {
    const MarkerDisplacement& a = rest->markers[idx(i)];
    const MarkerDisplacement& b = rest->markers[idx(i + 1)];
    if ((i + 1) % rest->grid.cols == 0 || !a.valid || !b.valid) continue;
    sum += std::hypot(b.dx.raw() - a.dx.raw(), b.dy.raw() - a.dy.raw());
    ++count;
  }
  return count == 0 ? 0 : sum / count;
}

}  // namespace holdfast::console_tool
