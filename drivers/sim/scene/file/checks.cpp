// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/scene/file/checks.hpp"

#include <algorithm>

#include "drivers/sim/scene/file/scene_file.hpp"
#include "drivers/sim/scene/file/words.hpp"
#include "vision/luma.hpp"
#include "vision/markers.hpp"

namespace holdfast::scene::file {
namespace {

using json::find;
using json::Node;

constexpr std::string_view kTwoScenes = "parts of two scenes";
constexpr std::string_view kShortened = "the scene was made shorter";

// Fields that only a picture shows.
bool needs_picture(const Field& field) {
  return field.more.picture || field.path.starts_with("picture.") || field.path.starts_with("object.relief.");
}

bool pressed(const Scene& scene) {
  return std::ranges::any_of(scene.trajectory, [](const Waypoint& point) {
    return std::max({point.depth_mm.value_or(0.0), point.force_n.value_or(0.0), point.closing_mm.value_or(0.0)}) > 0.0;
  });
}

bool pulled(const Scene& scene) {
  return std::ranges::any_of(scene.trajectory, [](const Waypoint& point) {
    return point.pull_x_n.value_or(0.0) != 0.0 || point.pull_y_n.value_or(0.0) != 0.0;
  });
}

// Along the gel or about the normal, by its script.
bool moves(const Scene& scene) {
  const auto varies = [&](std::optional<double> Waypoint::*channel) {
    std::optional<double> first;
    return std::ranges::any_of(scene.trajectory, [&](const Waypoint& point) {
      if (!first) first = point.*channel;
      return point.*channel && point.*channel != first;
    });
  };
  return varies(&Waypoint::x_mm) || varies(&Waypoint::y_mm) || varies(&Waypoint::twist_deg);
}

class Checks {
 public:
  Checks(const Scene& scene, const Reading& read, json::Problems& problems, json::Problems& warnings)
      : scene_(scene), read_(read), problems_(problems), warnings_(warnings) {}

  void run() {
    sizes();
    trajectory();
    mass();
    expectations();
    goals();
    // A value that could not be read would make a scene that nobody wrote.
    if (problems_.count() == 0) level();
    if (problems_.count() == 0) idle();
  }

 private:
  // "what ('path': value), allowed ..." in the line of the path.
  void add(std::string_view path, std::string_view what, const std::string& value, const std::string& allowed,
           std::string_view cause, const std::string& next) {
    problems_.add(read_.line_at(path),
                  std::string(what) + " ('" + std::string(path) + "'" + (value.empty() ? "" : ": " + value) + ")" +
                      (allowed.empty() ? "" : ", allowed " + allowed),
                  cause, next);
  }
  [[nodiscard]] std::string end_s() const { return "up to duration_s, " + shown(scene_.duration_s) + " s"; }

  void sizes() {
    if (scene_.duration_s * scene_.fps > kMostSceneFrames) {
      problems_.add(read_.line_at("duration_s"),
                    "too many frames ('duration_s' x 'fps' = " + shown(scene_.duration_s * scene_.fps) + "), allowed " +
                        shown(kMostSceneFrames),
                    "another unit, or a typing error", "make the scene shorter");
    }
    const int count = scene_.markers.rows * scene_.markers.cols;
    if (count > kMaxMarkers) {
      problems_.add(read_.line_at("markers"),
                    "too many markers ('rows' x 'cols' = " + shown(count) + "), allowed " + shown(kMaxMarkers), kTypo,
                    "give a smaller grid");
    }
    const int missing = scene_.effects.marker_missing;
    if (missing > count && read_.sound({"markers"})) {
      add("effects.marker_missing", "more dots are missing than there are", shown(missing), "0 .. " + shown(count),
          kTypo, "give a smaller number");
    }
    if (scene_.level.inject == Inject::kGrey && scene_.picture.width > kMaxLumaWidth &&
        read_.sound({"level.inject", "picture.width"})) {
      add("picture.width", "too large for the firmware's working picture", shown(scene_.picture.width),
          "64 .. " + shown(kMaxLumaWidth) + R"( px with inject "grey")", "a width of inject \"jpeg\", which is reduced",
          R"(give a smaller width, or inject "jpeg")");
    }
    const Object& object = scene_.object;
    const Shape& shape = object.shape;
    const bool disc = shape.kind == ShapeKind::kDisc;
    const double half = disc ? shape.radius_mm : std::min(shape.half_x_mm, shape.half_y_mm);
    if ((disc || shape.kind == ShapeKind::kBox) && shape.rim_mm > half && read_.sound({"object"})) {
      add("object.rim_mm", "the rim is wider than the object", shown(shape.rim_mm), "0 .. " + shown(half) + " mm here",
          "a small object with the default rim", "give a smaller rim_mm");
    }
    if (!object.kinetic_friction) return;
    const std::string kinetic = shown(*object.kinetic_friction);
    if (object.bonded) {
      add("object.kinetic_friction", "not used by a bonded object", kinetic, "", "it is left from another scene",
          "leave it out");
    } else if (*object.kinetic_friction > object.friction && read_.sound({"object.friction"})) {
      add("object.kinetic_friction", "kinetic friction is above the static one", kinetic,
          "0 .. " + shown(object.friction), "the two were exchanged", "exchange friction and kinetic_friction");
    }
  }

  void trajectory() {
    const Node* list = find(read_.root(), "trajectory");
    if (list == nullptr || list->kind != Node::Kind::kList) return;
    if (list->children.empty()) {
      problems_.add(list->line, "no waypoint ('trajectory': [])", "the script was forgotten",
                    "add {\"t_s\": 0} for an empty gel, or what moves the object");
    }
    const Node* first_normal = nullptr;
    double last_s = -1.0;
    for (std::size_t i = 0; i < list->children.size(); ++i) {
      const Node& point = list->children[i];
      const std::string at = "trajectory[" + std::to_string(i) + "].";
      const Node* time = find(point, "t_s");
      if (time != nullptr && time->kind == Node::Kind::kNumber) {
        if (time->number <= last_s) {
          problems_.add(time->line, "times do not rise " + pair(at + "t_s", *time) + ", allowed above " + shown(last_s),
                        "waypoints in another order, or twice", "put the waypoints in the order of time");
        } else if (time->number > scene_.duration_s && scene_.duration_s > 0.0) {
          problems_.add(time->line, "a waypoint after the end " + pair(at + "t_s", *time) + ", allowed " + end_s(),
                        kShortened, "raise duration_s, or drop the waypoint");
        }
        last_s = std::max(last_s, time->number);
      }
      for (const std::string word : {"depth_mm", "force_n", "closing_mm"}) {
        const Node* normal = find(point, word);
        if (normal == nullptr) continue;
        if (first_normal == nullptr) first_normal = normal;
        if (normal->key == first_normal->key) continue;
        problems_.add(normal->key_line,
                      "two ways to press " + pair(at + word, *normal) +
                          ", allowed one of depth_mm, force_n and closing_mm in the whole scene; line " +
                          std::to_string(first_normal->key_line) + " has '" + first_normal->key + "'",
                      kTwoScenes, "keep one of the two");
      }
    }
    for (std::size_t i = 0; i < scene_.faults.size(); ++i) {
      if (scene_.faults[i].t_s <= scene_.duration_s || !(scene_.duration_s > 0.0)) continue;
      problems_.add(read_.line_at("faults"),
                    "a fault after the end ('faults[" + std::to_string(i) + "].t_s': " + shown(scene_.faults[i].t_s) +
                        "), allowed " + end_s(),
                    kShortened, "raise duration_s, or drop the fault");
    }
  }

  void mass() {
    const bool massive = scene_.object.mass_g > 0.0;
    if (!read_.sound({"object.mass_g", "effects.drive_stiffness_n_per_mm", "trajectory"})) return;
    if (pulled(scene_) && !massive) {
      problems_.add(read_.line_at("trajectory"), "a pull (pull_x_n, pull_y_n) needs a mass", "the mass was forgotten",
                    "add \"mass_g\" to the object");
    }
    if (massive && !pulled(scene_) && !(scene_.effects.drive_stiffness_n_per_mm > 0.0)) {
      add("object.mass_g", "nothing moves an object with mass", shown(scene_.object.mass_g), "",
          "the drive was forgotten",
          "add \"drive_stiffness_n_per_mm\" to the effects, or pull_x_n or pull_y_n to a waypoint");
    }
  }

  void window(const std::string& path, int line, double from_s, double to_s) {
    if ((from_s < to_s && to_s <= scene_.duration_s) || !(scene_.duration_s > 0.0) || !read_.sound({path})) return;
    problems_.add(line,
                  "not a time of the scene ('" + path + "': " + shown(from_s) + " .. " + shown(to_s) +
                      "), allowed from < to, " + end_s(),
                  "the two were exchanged, or the scene was made shorter", "correct the times");
  }

  void expectations() {
    const Expect& expect = scene_.expect;
    if (expect.onset_s) {
      window("expect.onset_s", read_.line_at("expect.onset_s"), expect.onset_s->from_s, expect.onset_s->to_s);
    }
    for (const std::string_view path : {"expect.onset_s", "expect.max_delay_ms", "goal.max_delay_ms"}) {
      if (expect.no_onset && read_.given(path)) {
        add(path, "contradicts 'expect.no_onset': true", "", "", kTwoScenes, "keep one of the two");
      }
    }
    for (std::size_t i = 0; i < expect.entropy.size(); ++i) {
      const Expect::Entropy& entropy = expect.entropy[i];
      const std::string path = "expect.entropy[" + std::to_string(i) + "]";
      const int line = find(read_.root(), "expect.entropy")->children[i].line;
      window(path, line, entropy.from_s, entropy.to_s);
      if (entropy.least_nat <= entropy.most_nat) continue;
      problems_.add(line,
                    "least is above most ('" + path + "': " + shown(entropy.least_nat) + " .. " +
                        shown(entropy.most_nat) + " nat)",
                    "the two were exchanged", "exchange least_nat and most_nat");
    }
  }

  // A goal that is no more than what is promised is none.
  void goals() {
    const Expect& promised = scene_.expect;
    const Goal& goal = scene_.goal;
    const auto below = [&](const std::string& what, auto aim, auto promise, const std::string& unit) {
      if (!aim || !promise || *aim < *promise || !read_.sound({"goal." + what, "expect." + what})) return;
      add("goal." + what, "the goal asks no more than the promise", shown(*aim),
          "below 'expect." + what + "', " + shown(*promise) + unit, "the goal was reached, or the two were exchanged",
          "give a smaller goal, or leave it out");
    };
    below("max_delay_ms", goal.max_delay_ms, promised.max_delay_ms, " ms");
    below("false_alarms", goal.false_alarms, promised.false_alarms, "");
    if (!goal.final_state.empty() && !promised.final_state.empty()) {
      add("goal.final_state", "a state is promised already",
          "\"" + goal.final_state + "\"; 'expect.final_state': \"" + promised.final_state + "\"", "",
          "the goal was reached, or parts of two scenes", "keep one of the two");
    }
  }

  void level() {
    if (scene_.level.contact == ContactLevel::kGrid || as_round(scene_.object.shape)) return;
    const bool textured = as_round({.kind = scene_.object.shape.kind}).has_value();
    add(textured ? "object.texture.kind" : "object.shape", "level springs cannot do shapes", "",
        "a smooth sphere or cone on this level", "the scene was written for another level",
        R"(write "contact": "grid", or another shape)");
  }

  // Allowed, but without effect.
  void idle() {
    const auto unused = [&](std::string_view path, const std::string& what, const std::string& cause,
                            const std::string& next) {
      warnings_.add(read_.line_at(path), "unused: " + what, cause, next);
    };
    if (read_.given(kGoneKey)) {
      unused(kGoneKey, "'" + std::string(kGoneKey) + "' is gone: the reader sees what a scene uses",
             "a scene of an earlier version", "leave it out");
    }
    const Inject inject = scene_.level.inject;
    const bool picture = inject == Inject::kGrey || inject == Inject::kJpeg;
    const std::string entry = "level.inject is " + std::string(kInjectNames[static_cast<std::size_t>(inject)]);
    for (const Field& field : scene_table()) {
      if (picture || !needs_picture(field) || !read_.given(field.path)) continue;
      unused(field.path, "'" + std::string(field.path) + "' needs a picture", entry,
             R"(inject "grey" or "jpeg", or leave it out)");
    }
    if (!picture && !scene_.faults.empty()) {
      unused("faults", "'faults' are a camera's", entry, R"(inject "grey" or "jpeg", or leave them out)");
    }
    if (picture && scene_.effects.marker_noise_um > 0.0) {
      unused("effects.marker_noise_um", "'effects.marker_noise_um' is of tracked markers",
             "a picture has pixel_noise instead", R"(inject "markers" or "features", or leave it out)");
    }
    const auto closes = [](const Waypoint& point) { return point.closing_mm.has_value(); };
    if (scene_.object.compliance_mm_per_n > 0.0 && std::ranges::none_of(scene_.trajectory, closes)) {
      unused("object.compliance_mm_per_n", "'object.compliance_mm_per_n' acts on closing_mm alone",
             "the trajectory presses by depth or force", "press by closing_mm, or leave it out");
    }
    if (moves(scene_) && !pressed(scene_)) {
      unused("trajectory", "the object moves but never touches", "depth, force and closing are missing",
             "press, or leave the motion out");
    }
  }

  const Scene& scene_;
  const Reading& read_;
  json::Problems& problems_;
  json::Problems& warnings_;
};

}  // namespace

void check(const Scene& scene, const Reading& read, json::Problems& problems, json::Problems& warnings) {
  Checks(scene, read, problems, warnings).run();
}

}  // namespace holdfast::scene::file
