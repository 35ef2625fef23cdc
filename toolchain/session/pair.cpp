// SPDX-License-Identifier: Apache-2.0
#include "toolchain/session/pair.hpp"

#include <fmt/format.h>

#include <cmath>
#include <optional>
#include <string_view>

#include "base/math.hpp"
#include "slip/evidence.hpp"

namespace holdfast::tool {

std::string play_finger(const ReplayOptions& options, FingerTrack& track) {
  return replay_quietly(options, [&](const App& app) {
    track.frames.push_back(app.result());
    track.slip.push_back(app.outputs().slip ? 1 : 0);
  });
}

std::vector<double> speeds_of(std::span<const pipeline::Result> frames) {
  std::vector<double> speeds;
  for (const pipeline::Result& frame : frames) {
    const bool known = frame.quality.ok() && frame.referenced;
    speeds.push_back(known ? std::hypot(frame.features.vx.raw(), frame.features.vy.raw()) : 0.0);
  }
  return speeds;
}

std::vector<std::uint8_t> fused_slip(const fingers::Config& config, const FingerTrack& left, const FingerTrack& right,
                                     int offset) {
  HandPlayer player(config, right.frames, offset);
  std::vector<std::uint8_t> slip;
  for (const pipeline::Result& frame : left.frames) slip.push_back(player.step(frame).result.hand.slip ? 1 : 0);
  return slip;
}

std::string hand_columns() {
  std::string out;
  for (const std::string_view name : fingers::kNames) {
    out += fmt::format(
        ",{0}_age_ms,{0}_strength,{0}_evidence,{0}_evidence_value,{0}_evidence_threshold,{0}_evidence_unit", name);
  }
  return out;
}

std::string hand_cells(const HandFrame& frame, const classifier::Config& model) {
  std::string out;
  for (std::size_t i = 0; i < kMaxFingers; ++i) {
    const std::optional<pipeline::Result>& last = frame.last[i];
    if (!last) {
      out += ",,,,,,";
      continue;
    }
    out += fmt::format(",{:.1f}", static_cast<double>((frame.now - last->timestamp).count()) / 1000.0);
    if (!last->referenced) {
      out += ",,,,,";
      continue;
    }
    const fusion::Seen& seen = frame.seen[i];
    const std::string_view strength =
        seen.waits ? "waiting" : fusion::kStrengthNames[idx(static_cast<int>(seen.strength))];
    const evidence::Shown shown = evidence::show(model, last->features, last->evidence, false);
    out += fmt::format(",{},{},{:.1f},{:.1f},{}", strength, kEvidenceNames[idx(static_cast<int>(shown.evidence))],
                       static_cast<double>(shown.value_milli) / 1000, static_cast<double>(shown.threshold_milli) / 1000,
                       shown.unit);
  }
  return out;
}

}  // namespace holdfast::tool
