// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/scene/file/scene_file.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>

#include "drivers/common/input_file.hpp"
#include "drivers/sim/scene/file/checks.hpp"
#include "drivers/sim/scene/file/schema.hpp"
#include "drivers/sim/scene/file/words.hpp"

namespace holdfast::scene {
namespace {

using file::all_records;
using file::Field;
using file::joined;
using file::Records;
using file::text_of;
using file::Type;
using Pairs = std::vector<std::string>;

std::string list_text(const Scene& scene, std::string_view path);

// `"key": value` of the fields below a section that differ from the defaults or are required.
Pairs pairs(const Records& records, const void* record, std::string_view section) {
  Pairs out;
  for (std::size_t i = 0; i < records.fields.size(); ++i) {
    const Field& field = records.fields[i];
    if (!field.path.starts_with(section)) continue;
    std::string key(field.path.substr(section.size()));
    std::string text;
    if (const auto dot = key.find('.'); dot != std::string::npos) {
      const std::string_view inner = field.path.substr(0, section.size() + dot + 1);
      if (i > 0 && records.fields[i - 1].path.starts_with(inner)) continue;  // done
      if (const Pairs inside = pairs(records, record, inner); !inside.empty()) text = "{" + joined(inside) + "}";
      key.resize(dot);
    } else if (field.type == Type::kList) {
      text = list_text(*static_cast<const Scene*>(record), field.path);
    } else if (field.more.required || differs(field, record, records.standard)) {
      text = text_of(field, record);
    }
    if (!text.empty()) out.push_back(std::string("\"").append(key).append("\": ").append(text));
  }
  return out;
}

std::string list_text(const Scene& scene, std::string_view path) {
  const Records& list = *std::ranges::find(all_records(), path, &Records::path);
  std::string out;
  for (std::size_t i = 0; i < list.size(scene); ++i) {
    out += (out.empty() ? "[\n    {" : ",\n    {") + joined(pairs(list, list.entry(scene, i), "")) + "}";
  }
  return out.empty() ? out : out + "\n  ]";
}

// "key value, key value" of a section: all that has a meaning in this record, or only what differs from the defaults.
std::string words(const Records& records, const void* record, std::string_view section, bool all) {
  Pairs out;
  for (const Field& field : records.fields) {
    if (!field.path.starts_with(section) || field.type == Type::kList) continue;
    if (field.more.idle != nullptr && !field.more.idle(record).empty()) continue;
    const std::string text = text_of(field, record);
    if (text.empty() || (!all && !differs(field, record, records.standard))) continue;
    out.push_back(std::string(field.path.substr(section.size())) + " " + text);
  }
  std::string line = joined(out);
  std::erase(line, '"');
  return line;
}

// One column for each field that a waypoint has.
std::string table(const Scene& scene) {
  const Records& points = all_records()[1];
  std::vector<Pairs> rows(points.size(scene) + 1);
  for (const Field& field : points.fields) {
    Pairs column{std::string(field.path)};
    for (std::size_t i = 0; i < points.size(scene); ++i) column.push_back(text_of(field, points.entry(scene, i)));
    if (std::all_of(column.begin() + 1, column.end(), [](const std::string& cell) { return cell.empty(); })) continue;
    const std::size_t width = std::ranges::max(column, {}, &std::string::size).size();
    for (std::size_t i = 0; i < rows.size(); ++i) {
      rows[i].push_back(std::string(width - column[i].size(), ' ') + column[i]);
    }
  }
  std::string out;
  for (const Pairs& row : rows) {
    out += "    " + joined(row, "  ");
    out.erase(out.find_last_not_of(' ') + 1);
    out += '\n';
  }
  return out;
}

constexpr auto kSpringsOmissions = std::to_array<std::string_view>({
    "shapes that are not round, textures",
    "what the layer does to the shape of pressure and stick area: both are those of a half-space",
    "how shear and twist share the friction, other than by an ellipse of their limits",
    "large strain, inertia of the gel, adhesion",
});
constexpr auto kGridOmissions = std::to_array<std::string_view>({
    "what is finer than a cell",
    "the gel's motion up and down under shear",
    "large strain, edges of the pad, inertia of the gel, adhesion",
});

}  // namespace

SceneResult read_scene(std::string_view text, std::string_view file_name) {
  SceneResult result;
  json::Problems problems;
  json::Problems warnings;
  try {
    if (const std::optional<json::Node> root = json::parse(text, problems)) {
      Scene scene;
      const file::Reading read(*root, scene, problems);
      if (root->kind == json::Node::Kind::kObject) file::check(scene, read, problems, warnings);
      if (problems.count() == 0) result.scene = std::move(scene);
    }
  } catch (const std::exception& error) {
    problems.add(1, "cannot be read (" + json::printable(error.what()) + ")", "out of memory", "close other programs");
  }
  result.errors = problems.lines(file_name);
  if (result.scene) result.warnings = warnings.lines(file_name);
  return result;
}

SceneResult read_scene_file(const std::filesystem::path& path) {
  const auto refused = [&](const std::string& what, const std::string& cause, const std::string& next) {
    SceneResult result;
    result.errors.push_back(json::shown_file(path.string()) + ": " + what + ". Likely cause: " + cause +
                            ". Next: " + next);
    return result;
  };
  std::ifstream file;
  if (const std::string wrong = drivers::open_file(path, "give a scene file (tests/scenes)", file); !wrong.empty()) {
    SceneResult result;
    result.errors.push_back(json::shown_file(wrong));
    return result;
  }
  std::string text(kMostSceneBytes + 1, '\0');
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(file.gcount()));
  if (file.bad()) return refused("cannot be read to its end", std::strerror(errno), "copy the file and try again");
  return read_scene(text, path.string());
}

std::string write_scene(const Scene& scene) {
  return "{\n  " + joined(pairs(all_records().front(), &scene, ""), ",\n  ") + "\n}\n";
}

std::span<const std::string_view> omissions(ContactLevel level) {
  if (level == ContactLevel::kSprings) return kSpringsOmissions;
  return kGridOmissions;
}

std::string describe(const Scene& scene) {
  std::string out = scene.name + (scene.help.empty() ? "" : ": " + scene.help) + "\n";
  const auto line = [&](const std::string& title, const std::string& text) {
    if (!text.empty()) out += "  " + title + std::string(11 - title.size(), ' ') + text + "\n";
  };
  const auto section = [&](const std::string& title, const std::string& name, bool all) {
    line(title, words(all_records().front(), &scene, name + ".", all));
  };
  line("time", file::shown(scene.duration_s) + " s at " + file::shown(scene.fps) + " frames per second; seed " +
                   std::to_string(scene.seed));
  for (const std::string name : {"level", "gel", "markers", "object"}) section(name, name, true);
  out += "  left out by level " + std::string(kContactLevelNames[static_cast<std::size_t>(scene.level.contact)]) + "\n";
  for (const std::string_view omission : omissions(scene.level.contact)) out += "    " + std::string(omission) + "\n";
  out += "  trajectory, " + std::string(kProfileNames[static_cast<std::size_t>(scene.profile)]) + "\n" + table(scene);
  section("effects", "effects", false);
  for (const FaultEvent& fault : scene.faults) line("fault", words(all_records()[2], &fault, "", true));
  section("picture", "picture", false);
  section("expected", "expect", false);
  for (const Expect::Entropy& entropy : scene.expect.entropy) {
    line("expected", "entropy " + file::shown(entropy.least_nat) + " .. " + file::shown(entropy.most_nat) +
                         " nat from " + file::shown(entropy.from_s) + " s to " + file::shown(entropy.to_s) + " s");
  }
  section("goal", "goal", false);
  return out;
}

std::vector<FieldInfo> scene_fields() {
  std::vector<FieldInfo> all;
  const auto add = [&](const Records& records, const auto& self) -> void {
    for (const Field& field : records.fields) {
      all.push_back({.path = std::string(records.path) + (records.path.empty() ? "" : "[].") + std::string(field.path),
                     .type = std::string(file::kTypeNames[static_cast<std::size_t>(field.type)]),
                     .unit = field.unit,
                     .least = field.least,
                     .most = field.most,
                     .allowed = file::allowed(field),
                     .standard = field.get != nullptr && !field.more.required ? text_of(field, records.standard) : "",
                     .required = field.more.required,
                     .help = field.help});
      if (!records.path.empty() || field.type != Type::kList) continue;
      const auto list = std::ranges::find(all_records(), field.path, &Records::path);
      if (list != all_records().end()) self(*list, self);
    }
  };
  add(all_records().front(), add);
  return all;
}

}  // namespace holdfast::scene
