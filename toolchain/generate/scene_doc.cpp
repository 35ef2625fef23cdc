// SPDX-License-Identifier: Apache-2.0
#include "toolchain/generate/scene_doc.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <vector>

#include "drivers/sim/scene/file/scene_file.hpp"

namespace holdfast::scene_doc {
namespace {

using scene::Scene;

// A sphere that is pressed on, dragged until it slides, and let go.
Scene example() {
  Scene example;
  example.name = "sphere_slide";
  example.help = "a sphere is pressed on and dragged until it slides";
  example.duration_s = 4.0;
  example.level.contact = scene::ContactLevel::kSprings;
  example.object.kinetic_friction = 0.4;
  scene::Waypoint empty;
  empty.t_s = 0.4;
  empty.force_n = 0.0;
  scene::Waypoint pressed;
  pressed.t_s = 1.0;
  pressed.force_n = 3.0;
  pressed.x_mm = 0.0;
  scene::Waypoint dragged;
  dragged.t_s = 3.0;
  dragged.x_mm = 6.0;
  dragged.force_n = 3.0;
  scene::Waypoint released;
  released.t_s = 3.5;
  released.force_n = 0.0;
  example.trajectory = {empty, pressed, dragged, released};
  example.expect.onset_s = {1.0, 2.5};
  example.expect.max_delay_ms = 120.0;
  return example;
}

std::string section_of(const scene::FieldInfo& field) {
  if (const auto list = field.path.find("[]."); list != std::string::npos) return field.path.substr(0, list) + "[]";
  const auto dot = field.path.find('.');
  return dot == std::string::npos ? "" : field.path.substr(0, dot);
}

std::string fields() {
  const std::vector<scene::FieldInfo> all = scene::scene_fields();
  std::vector<std::string> sections;
  for (const scene::FieldInfo& field : all) {
    if (std::ranges::find(sections, section_of(field)) == sections.end()) sections.push_back(section_of(field));
  }
  std::string out;
  for (const std::string& section : sections) {
    out += fmt::format("\n### {}\n\n| key | allowed | default | meaning |\n|---|---|---|---|\n",
                       section.empty() ? "Top" : "`" + section + "`");
    for (const scene::FieldInfo& field : all) {
      if (section_of(field) != section) continue;
      const std::string key = section.empty() ? field.path : field.path.substr(section.size() + 1);
      const std::string standard = field.standard.empty() ? "" : "`" + field.standard + "`";
      out += fmt::format("| `{}` | {} | {} | {} |\n", key, field.allowed, field.required ? "required" : standard,
                         field.help);
    }
  }
  return out;
}

std::string levels() {
  std::string out;
  for (std::size_t level = 0; level < scene::kContactLevelNames.size(); ++level) {
    out += fmt::format("\n`{}` leaves out\n\n", scene::kContactLevelNames[level]);
    for (const std::string_view omission : scene::omissions(static_cast<scene::ContactLevel>(level))) {
      out += fmt::format("* {}\n", omission);
    }
  }
  return out;
}

}  // namespace

std::string scene_markdown() {
  return fmt::format(
      "<!-- SPDX-License-Identifier: Apache-2.0 -->\n"
      "<!-- Written by scene_doc from drivers/sim/scene/file/schema.cpp and scene.hpp; do not edit. -->\n"
      "# Scene files\n\n"
      "A scene is gel, object, what moves it, what goes wrong, how much of it is modelled and what is expected. JSON; "
      "units are in the names of the keys; x to the right, y down, a positive twist turns x towards y. What is left "
      "out has its default.\n\n"
      "```json\n{}```\n\n"
      "Between waypoints a value lies on the curve of `profile` between its neighbours that have it, before the "
      "first and after the last it stays. One of `depth_mm`, `force_n` and `closing_mm` presses, the same in the whole "
      "scene; none of them is an empty gel. What `expect` says is promised and checked by every run; `goal` is what "
      "the firmware aims at there and does not reach yet: every run says so, and once it is reached it has to become "
      "the promise.\n\n"
      "Limits: {} bytes, {} levels of brackets, {} keys in an object, {} entries in a list, {} frames.\n\n"
      "## Fields\n{}\n"
      "## Contact levels\n{}",
      scene::write_scene(example()), scene::kMostSceneBytes, scene::kMostSceneDepth, scene::kMostSceneKeys,
      scene::kMostSceneItems, static_cast<long>(scene::kMostSceneFrames), fields(), levels());
}

}  // namespace holdfast::scene_doc
