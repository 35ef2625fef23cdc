// SPDX-License-Identifier: Apache-2.0
// Scenes as JSON text: reads, writes and describes them, from one table of fields (schema.hpp: key, unit, range,
// default, help, member). tests/scenes/README.md is that table, printed.
//
// A scene is read as a whole: every problem comes out with its line, not only the first. Refused are unknown and
// doubled keys, values of another kind or out of range, keys that mean nothing beside the others (a radius on a box),
// contradictions (times that do not rise, a pull without a mass), and shapes that the contact level cannot do. What is
// allowed but changes nothing is a warning.
//
// Hostile text ends in an error, too: at most 1 MB, 8 levels deep, 100 keys in an object and 10000 entries in a list;
// strict JSON in UTF-8 without NUL, byte-order mark or comments.
// Messages are one line each of printable text:
//   FILE:LINE: what ('key': value), what is allowed, nearest valid word. Likely cause: ... Next: ...
// No exception leaves this file. The same text gives the same scene and the same messages.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/sim/scene/scene.hpp"

namespace holdfast::scene {

inline constexpr std::size_t kMostSceneErrors = 20;
inline constexpr std::size_t kMostSceneBytes = 1'000'000;
inline constexpr std::size_t kMostSceneDepth = 8;
inline constexpr std::size_t kMostSceneKeys = 100;      // in one object
inline constexpr std::size_t kMostSceneItems = 10'000;  // in one list
inline constexpr double kMostSceneFrames = 1e6;

struct SceneResult {
  std::optional<Scene> scene;         // none when there are errors
  std::vector<std::string> errors;    // by line, the first kMostSceneErrors
  std::vector<std::string> warnings;  // by line; only of a scene without errors, at most kMostSceneErrors
};

// `file_name` is only shown.
[[nodiscard]] SceneResult read_scene(std::string_view text, std::string_view file_name);
[[nodiscard]] SceneResult read_scene_file(const std::filesystem::path& path);

// The scene as canonical JSON: what differs from the defaults, in the order of the table, shortest numbers.
// read_scene() gives the same scene again, to the last bit for every scene that came from a file; a modulus or an angle
// that no number of the file stands for (they are kept in other units) comes back as its neighbour.
[[nodiscard]] std::string write_scene(const Scene& scene);

// What a person wants to know before running it; several lines.
[[nodiscard]] std::string describe(const Scene& scene);

// What a contact level leaves out, one phrase each.
[[nodiscard]] std::span<const std::string_view> omissions(ContactLevel level);

// The table, for documentation and tests.
struct FieldInfo {
  std::string path;       // "object.radius_mm"; entries of lists as "trajectory[].depth_mm"
  std::string type;       // "number", "whole number", "true or false", "name", "text", "choice", "two numbers", "list"
  std::string_view unit;  // empty: none
  double least = 0.0;     // allowed, inclusive; of text its length. Both 0 where there is no such thing
  double most = 0.0;
  std::string allowed;   // the same in words
  std::string standard;  // default; empty: not given
  bool required = false;
  std::string_view help;
};
[[nodiscard]] std::vector<FieldInfo> scene_fields();

}  // namespace holdfast::scene
