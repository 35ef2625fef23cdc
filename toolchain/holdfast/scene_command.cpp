// SPDX-License-Identifier: Apache-2.0
// holdfast scene: looks at scenes without running the firmware on them.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <vector>

#include "drivers/sim/scene/file/scene_file.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/play/paper.hpp"
#include "toolchain/play/play.hpp"

namespace holdfast::tool {
namespace {

namespace fs = std::filesystem;

std::vector<fs::path> scenes_in(const fs::path& folder) {
  std::vector<fs::path> found;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
    if (entry.path().extension() == ".json") found.push_back(entry.path());
  }
  std::sort(found.begin(), found.end());
  return found;
}

template <class Table>
auto find(const Table& table, std::string_view name) {
  const auto found = std::find_if(table.begin(), table.end(), [&](const auto& row) { return row.name == name; });
  return found == table.end() ? nullptr : &*found;
}

template <class Table>
std::string names_of(const Table& table) {
  std::string names;
  for (const auto& row : table) names += fmt::format("{}{}", names.empty() ? "" : ", ", row.name);
  return names;
}

}  // namespace

int scene_check(const SceneCheckOptions& options) {
  int bad = 0;
  for (const std::string& path : options.files) {
    const std::optional<scene::Scene> scene = load_scene(path);
    if (!scene) {
      ++bad;
      continue;
    }
    for (const std::string& effect : unused_effects(*scene)) {
      note(
          fmt::format("{}: '{}' is switched on and changes nothing that the scene puts out. Likely cause: the level "
                      "({}, {}) never shows it, or it is too small. Next: take it out, or choose another level",
                      path, effect, scene::kInjectNames[static_cast<std::size_t>(scene->level.inject)],
                      scene::kContactLevelNames[static_cast<std::size_t>(scene->level.contact)]));
      if (options.strict) ++bad;
    }
    if (interrupted()) return fail(interrupted_line());
  }
  if (bad > 0) return 1;
  fmt::print("{} scene{} checked: good\n", options.files.size(), options.files.size() == 1 ? "" : "s");
  return 0;
}

int scene_list(const std::string& folder) {
  const std::vector<fs::path> paths = scenes_in(folder);
  if (paths.empty()) {
    return fail(
        fmt::format("{}: no scenes there. Likely cause: another working directory. Next: give the folder, for "
                    "instance holdfast scene list tests/scenes",
                    folder));
  }
  int bad = 0;
  for (const fs::path& path : paths) {
    const scene::SceneResult read = scene::read_scene_file(path);
    if (!read.scene) {
      note(read.errors.empty() ? path.string() : read.errors.front());
      ++bad;
      continue;
    }
    const scene::Scene& s = *read.scene;
    fmt::print("{:40} {:8} {:9} {}\n", path.string(), scene::kInjectNames[static_cast<std::size_t>(s.level.inject)],
               scene::kContactLevelNames[static_cast<std::size_t>(s.level.contact)], s.help);
  }
  return bad > 0 ? 1 : 0;
}

int scene_describe(const std::string& path) {
  const std::optional<scene::Scene> scene = load_scene(path);
  if (!scene) return 1;
  fmt::print("{}", scene::describe(*scene));
  return 0;
}

int scene_make(const SceneMakeOptions& options) {
  const auto* object = find(scene::kPaperObjects, options.object);
  const auto* primitive = find(scene::kPrimitives, options.primitive);
  if (object == nullptr || primitive == nullptr) {
    const std::string names = object == nullptr ? names_of(scene::kPaperObjects) : names_of(scene::kPrimitives);
    return fail(fmt::format("'{}': not known. Likely cause: a typing error. Next: give one of {}",
                            object == nullptr ? options.object : options.primitive, names));
  }
  const auto* kind = find(scene::kGraspKinds, options.outcome);
  if (kind == nullptr) {
    return fail(fmt::format("'{}': no such outcome. Likely cause: a typing error. Next: give one of {}",
                            options.outcome, names_of(scene::kGraspKinds)));
  }
  const auto index = static_cast<scene::GraspKind>(kind - scene::kGraspKinds.begin());
  fmt::print("{}", scene::write_scene(scene::grasp_trial(*object, *primitive, index, options.seed)));
  return 0;
}

}  // namespace holdfast::tool
