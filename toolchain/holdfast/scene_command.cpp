// SPDX-License-Identifier: Apache-2.0
// holdfast scene: looks at scenes without running the firmware on them.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <memory>
#include <vector>

#include "drivers/sim/scene/file/scene_file.hpp"
#include "drivers/sim/scene/file/words.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/play/paper.hpp"
#include "toolchain/play/play.hpp"

namespace holdfast::tool {
namespace {

namespace fs = std::filesystem;

struct CheckOptions {
  std::vector<std::string> files;
  bool strict = false;  // an effect that changes nothing is an error
};

struct MakeOptions {
  std::string object;
  std::string primitive;
  std::string outcome;
  std::uint64_t seed = 1;
};

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

int scene_check(const CheckOptions& options) {
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

int scene_make(const MakeOptions& options) {
  const auto* object = find(scene::kPaperObjects, options.object);
  const auto* primitive = find(scene::kPrimitives, options.primitive);
  if (object == nullptr || primitive == nullptr) {
    const std::string names =
        object == nullptr ? scene::file::names_of(scene::kPaperObjects) : scene::file::names_of(scene::kPrimitives);
    return fail(fmt::format("'{}': not known. Likely cause: a typing error. Next: give one of {}",
                            object == nullptr ? options.object : options.primitive, names));
  }
  const auto* kind = find(scene::kGraspKinds, options.outcome);
  if (kind == nullptr) {
    return fail(fmt::format("'{}': no such outcome. Likely cause: a typing error. Next: give one of {}",
                            options.outcome, scene::file::names_of(scene::kGraspKinds)));
  }
  const auto index = static_cast<scene::GraspKind>(kind - scene::kGraspKinds.begin());
  fmt::print("{}", scene::write_scene(scene::grasp_trial(*object, *primitive, index, options.seed)));
  return 0;
}

}  // namespace

void add_scene(CLI::App& app, std::vector<Command>& commands) {
  CLI::App* const scene = app.add_subcommand("scene", "look at scene files");
  scene->require_subcommand(1);
  scene->footer("Example:\n  holdfast scene describe tests/scenes/sphere_slip.json");

  const auto to_check = std::make_shared<CheckOptions>();
  CLI::App* const check =
      scene->add_subcommand("check", "read scenes, and report effects that are switched on and change nothing");
  check->add_option("SCENE", to_check->files, "scene files")->required()->check(not_empty);
  check->add_flag("--strict", to_check->strict, "an effect that changes nothing is an error");
  check->footer("Example:\n  holdfast scene check tests/scenes/*.json");
  commands.push_back({check, [to_check] { return scene_check(*to_check); }});

  const auto folder = std::make_shared<std::string>("tests/scenes");
  CLI::App* const list = scene->add_subcommand("list", "list the scenes of a folder");
  list->add_option("FOLDER", *folder, "where to look")->check(not_empty)->capture_default_str();
  list->footer("Example:\n  holdfast scene list tests/scenes");
  commands.push_back({list, [folder] { return scene_list(*folder); }});

  const auto file = std::make_shared<std::string>();
  CLI::App* const describe = scene->add_subcommand("describe", "say what a scene does, models and leaves out");
  describe->add_option("SCENE", *file, "scene file")->required()->check(not_empty);
  describe->footer("Example:\n  holdfast scene describe tests/scenes/sphere_slip.json");
  commands.push_back({describe, [file] { return scene_describe(*file); }});

  const auto to_make = std::make_shared<MakeOptions>();
  CLI::App* const make = scene->add_subcommand("make", "print a trial of the paper's objects as a scene");
  make->add_option("OBJECT", to_make->object, "ball, box, sponge ...")->required()->check(not_empty);
  make->add_option("PRIMITIVE", to_make->primitive, "one of the twelve motions")->required()->check(not_empty);
  make->add_option("OUTCOME", to_make->outcome, "static, slip, matched, shaken or slow")->required()->check(not_empty);
  make->add_option("--seed", to_make->seed, "which trial")->capture_default_str();
  make->footer("Example:\n  holdfast scene make ball translate_x slip --seed 7 > ball.json");
  commands.push_back({make, [to_make] { return scene_make(*to_make); }});
}

}  // namespace holdfast::tool
