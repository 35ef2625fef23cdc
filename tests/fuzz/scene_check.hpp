// SPDX-License-Identifier: Apache-2.0
// What must hold for any text that is given as a scene, for libFuzzer (scene_fuzz.cpp) and for the host tests; and the
// texts that the fuzzer starts from.
#pragma once

#include <algorithm>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/sim/scene/file/scene_file.hpp"

namespace holdfast::test {

// A finding in words; empty: nothing to say.
//   * a scene, or errors, never both or neither; as many messages as promised
//   * every message is one line of printable ASCII that begins with the file, a line of the text, a cause and a next
//   step
//   * the same text gives the same messages
//   * a scene that was read is written as a text that gives the same text again, and can be described
inline std::string check_scene_text(std::string_view text) {
  const scene::SceneResult result = scene::read_scene(text, "f");
  if (result.scene.has_value() == !result.errors.empty()) return "neither scene nor error, or both";
  if (!result.scene && !result.warnings.empty()) return "a warning beside errors";
  if (result.errors.size() > scene::kMostSceneErrors) return "too many errors";
  const long lines = 1 + std::ranges::count(text, '\n');
  for (const auto* messages : {&result.errors, &result.warnings}) {
    for (const std::string& message : *messages) {
      if (!std::ranges::all_of(message, [](char c) { return c >= ' ' && c <= '~'; }))
        return "not printable: " + message;
      const long line = message.starts_with("f:") ? std::atol(message.c_str() + 2) : 0;
      if (line < 1 || line > lines) return "no line of the text: " + message;
      if (message.find(". Likely cause: ") == std::string::npos || message.find(". Next: ") == std::string::npos) {
        return "no cause or no next step: " + message;
      }
    }
  }
  const scene::SceneResult again = scene::read_scene(text, "f");
  if (again.errors != result.errors || again.warnings != result.warnings) return "other messages the second time";
  if (!result.scene) return "";
  if (scene::describe(*result.scene).empty()) return "no description";
  const std::string written = scene::write_scene(*result.scene);
  const scene::SceneResult reread = scene::read_scene(written, "f");
  if (!reread.scene) return "written, and refused: " + reread.errors.front() + "\n" + written;
  if (scene::write_scene(*reread.scene) != written) return "written otherwise the second time:\n" + written;
  return "";
}

inline std::vector<std::string> scene_seeds() {
  return {
      R"({"schema_version": 1, "name": "empty", "duration_s": 1, "trajectory": [{"t_s": 0}]})",
      R"({"schema_version": 1, "name": "slip", "seed": 7, "fps": 25, "duration_s": 4, "profile": "minimum_jerk",
 "level": {"inject": "markers", "contact": "springs", "springs": 64},
 "gel": {"thickness_mm": 4.25, "shear_modulus_kpa": 35, "poisson": 0.49},
 "markers": {"rows": 7, "cols": 9, "pitch_mm": 2.02},
 "object": {"name": "ball", "shape": "sphere", "radius_mm": 15, "friction": 0.5, "kinetic_friction": 0.4},
 "trajectory": [{"t_s": 0, "force_n": 0}, {"t_s": 1, "force_n": 6, "x_mm": 0}, {"t_s": 2, "x_mm": 4, "y_mm": 0},
                {"t_s": 3, "x_mm": 2, "y_mm": 1}, {"t_s": 4, "force_n": 0}],
 "expect": {"onset_s": [1.2, 2], "max_delay_ms": 120, "false_alarms": 0, "final_state": "OK",
            "entropy": [{"from_s": 0, "to_s": 0.5, "least_nat": 0, "most_nat": 0.5}]},
 "goal": {"max_delay_ms": 80}})",
      R"({"schema_version": 1, "name": "box", "duration_s": 2.5,
 "level": {"inject": "jpeg", "contact": "grid", "cell_mm": 0.5}, "gel": {"half_space": true},
 "object": {"shape": "box", "half_x_mm": 4, "half_y_mm": 3, "rim_mm": 0.5, "yaw_deg": 30, "tilt_deg": 2, "mass_g": 80,
            "bonded": true, "touch_x_mm": 0, "texture": {"kind": "bumps", "height_mm": 0.1, "pitch_mm": 0.8},
            "relief": {"kind": "grain", "height_um": 30, "pitch_mm": 0.6}},
 "trajectory": [{"t_s": 0, "depth_mm": 0}, {"t_s": 1, "depth_mm": 0.8, "twist_deg": 0, "pull_x_n": 0},
                {"t_s": 2, "twist_deg": 20, "pull_x_n": 1.5}],
 "effects": {"creep_gain": 0.1, "creep_tau_s": 2, "marker_loss": 0.01, "marker_noise_um": 5, "pixel_noise": 2.5,
             "light_drift_levels_per_s": -1},
 "faults": [{"t_s": 1, "fault": "late", "by_ms": 80}, {"t_s": 2, "frames": 3, "fault": "dropped"}],
 "picture": {"width": 820, "jpeg_quality": 85}})",
      R"({"schema_version": 1, "name": "wrong", "name": "twice", "durations": 4, "level": {"contact": "closd"}, "gel": 3,
 "trajectory": [{"t_s": 1, "force_n": 1}, {"t_s": 0, "depth_mm": 1e9}], "seed": 1.5,
 "object": {"radius_mm": null, "half_x_mm": [1, [2, {"a": true}]]}})",
  };
}

}  // namespace holdfast::test
