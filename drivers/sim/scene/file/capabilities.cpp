// SPDX-License-Identifier: Apache-2.0
// From a scene to the names of kCapabilities that it uses; the rules are written at used_capabilities().
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

#include "drivers/sim/scene/file/checks.hpp"
#include "drivers/sim/scene/file/scene_file.hpp"
#include "drivers/sim/scene/file/schema.hpp"

namespace holdfast::scene {
namespace file {
namespace {

struct Knot {
  double t_s = 0.0;
  double value = 0.0;
};
using Channel = std::vector<Knot>;

Channel channel(const Scene& scene, std::optional<double> Waypoint::*what) {
  Channel knots;
  for (const Waypoint& point : scene.trajectory) {
    if (point.*what) knots.push_back({point.t_s, *(point.*what)});
  }
  return knots;
}

bool varies(const Scene& scene, std::optional<double> Waypoint::*what) {
  const Channel knots = channel(scene, what);
  return std::ranges::any_of(knots, [&](const Knot& knot) { return knot.value != knots.front().value; });
}

double at(const Channel& knots, double t_s) {
  if (knots.empty()) return 0.0;
  const auto after = std::ranges::upper_bound(knots, t_s, {}, &Knot::t_s);
  if (after == knots.begin()) return knots.front().value;
  const Knot& from = *std::prev(after);
  if (after == knots.end()) return from.value;
  return from.value + (t_s - from.t_s) / (after->t_s - from.t_s) * (after->value - from.value);
}

// The normal direction, by whichever of its channels the scene has.
Channel normal_channel(const Scene& scene) {
  for (const auto normal : {&Waypoint::depth_mm, &Waypoint::force_n, &Waypoint::closing_mm}) {
    if (Channel knots = channel(scene, normal); !knots.empty()) return knots;
  }
  return {};
}

bool sheared(const Scene& scene) {
  return pressed(scene) && (varies(scene, &Waypoint::x_mm) || varies(scene, &Waypoint::y_mm) || pulled(scene));
}
bool twisted(const Scene& scene) {
  return pressed(scene) && varies(scene, &Waypoint::twist_deg);
}
bool may_slip(const Scene& scene) {
  return !scene.object.bonded && (sheared(scene) || twisted(scene));
}

// One contact, from touch to release.
struct Episode {
  double from_s = 0.0;
  double to_s = std::numeric_limits<double>::infinity();
};

std::vector<Episode> episodes(const Channel& normal) {
  std::vector<Episode> all;
  bool touching = false;
  for (std::size_t i = 0; i < normal.size(); ++i) {
    if (normal[i].value > 0.0 && !touching) all.push_back({i > 0 ? normal[i - 1].t_s : 0.0});
    if (!(normal[i].value > 0.0) && touching) all.back().to_s = normal[i].t_s;
    touching = normal[i].value > 0.0;
  }
  return all;
}

bool has_history(const Scene& scene) {
  struct Step {
    double x, y, twist;
  };
  const Channel normal = normal_channel(scene);
  const Channel x = channel(scene, &Waypoint::x_mm);
  const Channel y = channel(scene, &Waypoint::y_mm);
  const Channel twist = channel(scene, &Waypoint::twist_deg);
  for (const Episode& episode : episodes(normal)) {
    std::vector<Step> steps;
    double moves_from_s = std::numeric_limits<double>::infinity();
    for (std::size_t i = 1; i < scene.trajectory.size(); ++i) {
      const double from = scene.trajectory[i - 1].t_s;
      const double to = scene.trajectory[i].t_s;
      if (to <= episode.from_s || from >= episode.to_s) continue;
      const Step step{at(x, to) - at(x, from), at(y, to) - at(y, from), at(twist, to) - at(twist, from)};
      if (step.x == 0.0 && step.y == 0.0 && step.twist == 0.0) continue;
      for (const Step& before : steps) {
        if (step.x * before.x + step.y * before.y < 0.0 || step.twist * before.twist < 0.0) return true;
      }
      moves_from_s = std::min(moves_from_s, from);
      steps.push_back(step);
    }
    for (std::size_t i = 1; i < normal.size(); ++i) {
      const bool inside = normal[i].t_s > episode.from_s && normal[i].t_s < episode.to_s;
      if (inside && normal[i].value != normal[i - 1].value && normal[i].t_s > moves_from_s) return true;
    }
  }
  return false;
}

struct Rule {
  std::string_view capability;
  bool (*used)(const Scene&);
};
constexpr auto kRules = std::to_array<Rule>({
    {"press", pressed},
    {"shear", sheared},
    {"twist", twisted},
    {"partial_slip", may_slip},
    {"gross_slip", may_slip},
    {"layer", [](const Scene& s) { return pressed(s) && std::isfinite(s.gel.thickness_mm); }},
    {"load_history", has_history},
    {"cone",
     [](const Scene& s) {
       const auto round = as_round(s.object.shape);
       return round && round->exponent != 2;
     }},
    {"shapes", [](const Scene& s) { return !as_round(s.object.shape); }},
    {"pull", pulled},
    {"camera_faults", [](const Scene& s) { return !s.faults.empty(); }},
});

bool uses(const Scene& scene, std::string_view capability) {
  const auto* rule = std::ranges::find(kRules, capability, &Rule::capability);
  if (rule != kRules.end()) return rule->used(scene);
  const Records& whole = all_records().front();
  return std::ranges::any_of(whole.fields, [&](const Field& field) {
    return field.more.capability == capability && differs(field, &scene, whole.standard);
  });
}

}  // namespace

bool pressed(const Scene& scene) {
  return std::ranges::any_of(normal_channel(scene), [](const Knot& knot) { return knot.value > 0.0; });
}

bool pulled(const Scene& scene) {
  return std::ranges::any_of(scene.trajectory, [](const Waypoint& point) {
    return point.pull_x_n.value_or(0.0) != 0.0 || point.pull_y_n.value_or(0.0) != 0.0;
  });
}

bool moves(const Scene& scene) {
  return varies(scene, &Waypoint::x_mm) || varies(scene, &Waypoint::y_mm) || varies(scene, &Waypoint::twist_deg);
}

}  // namespace file

std::vector<std::string_view> used_capabilities(const Scene& scene) {
  std::vector<std::string_view> used;
  for (const Capability& capability : kCapabilities) {
    if (file::uses(scene, capability.name)) used.push_back(capability.name);
  }
  return used;
}

}  // namespace holdfast::scene
