// SPDX-License-Identifier: Apache-2.0
// Scene files: every field by hand and by its table, every refusal with its line, hostile text, and scenes that come
// back as they were written. The judge of tests/fuzz runs here, too, on seeds and on damaged seeds.
#include "drivers/sim/scene/file/scene_file.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include "params/params.hpp"
#include "tests/fuzz/scene_check.hpp"
#include "tests/support/folders.hpp"
#include "tests/support/temp_dir.hpp"
#include "vision/luma.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::scene;
using Json = nlohmann::ordered_json;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

bool same(const Scene& a, const Scene& b) {
  const auto bits = [](double x) { return std::bit_cast<std::uint64_t>(x); };
  return a.schema_version == b.schema_version && a.name == b.name && a.help == b.help && a.seed == b.seed &&
         a.fps == b.fps && a.duration_s == b.duration_s && a.level == b.level &&
         bits(a.gel.shear_modulus_mpa) == bits(b.gel.shear_modulus_mpa) && a.gel.poisson == b.gel.poisson &&
         a.gel.thickness_mm == b.gel.thickness_mm && a.markers.rows == b.markers.rows &&
         a.markers.cols == b.markers.cols && a.markers.pitch_mm == b.markers.pitch_mm && a.object == b.object &&
         a.profile == b.profile && a.trajectory == b.trajectory && a.effects == b.effects && a.faults == b.faults &&
         a.picture == b.picture && a.expect == b.expect && a.goal == b.goal;
}

// Valid, and nothing touches.
Json bare() {
  return {{"schema_version", 1}, {"name", "n"}, {"duration_s", 10}, {"trajectory", Json::array({{{"t_s", 0}}})}};
}

// "a.b" and "list[].c" (of the first entry).
Json::json_pointer pointer_to(std::string path) {
  for (auto dot = path.find("[]."); dot != std::string::npos; dot = path.find("[].")) path.replace(dot, 3, ".0.");
  std::ranges::replace(path, '.', '/');
  return Json::json_pointer("/" + path);
}

// What else has to be there for a field to mean something.
Json home_of(const std::string& path) {
  Json text = bare();
  const auto at = [&](const std::string& where) -> Json& { return text[pointer_to(where)]; };
  if (path == "level.springs") at("level.contact") = "springs";
  if (path == "level.cell_mm") at("level.contact") = "grid";
  if (path == "object.radius_y_mm" || path == "object.yaw_deg") at("object.shape") = "ellipsoid";
  if (path.starts_with("object.half_") || path == "object.rim_mm" || path == "object.tilt_deg")
    at("object.shape") = "box";
  if (path == "object.flank_deg") at("object.shape") = "cone";
  if (path.starts_with("object.texture.")) at("object.texture.kind") = "bumps";
  if (path.starts_with("object.relief.")) at("object.relief.kind") = "grain";
  if (path == "effects.creep_tau_s") at("effects.creep_gain") = 0.1;
  if (path.starts_with("effects.drive_") || path.starts_with("effects.damping_")) at("object.mass_g") = 10;
  if (path.starts_with("faults[].")) at("faults") = Json::array({{{"t_s", 0}, {"fault", "late"}}});
  if (path.starts_with("expect.entropy[].")) {
    at("expect.entropy") = Json::array({{{"from_s", 0}, {"to_s", 1}, {"least_nat", 0}, {"most_nat", 1}}});
  }
  return text;
}

bool tells(const std::vector<std::string>& messages, std::string_view what) {
  return std::ranges::any_of(messages, [&](const std::string& line) { return line.find(what) != std::string::npos; });
}

std::string all(const std::vector<std::string>& messages) {
  std::string out;
  for (const std::string& message : messages) out += message + "\n";
  return out;
}

// A scene in the middle of things: pressed, dragged and slipping on springs; one line each.
constexpr std::string_view kSlip = R"({
"schema_version": 1,
"name": "slip",
"duration_s": 4,
"level": {"contact": "springs"},
"object": {"radius_mm": 15},
"trajectory": [
{"t_s": 0, "force_n": 0},
{"t_s": 1, "force_n": 3, "x_mm": 0},
{"t_s": 3, "force_n": 3, "x_mm": 4}
],
"effects": {},
"expect": {}
})";

std::string with(std::string_view from, std::string_view to) {
  std::string text(kSlip);
  const auto found = text.find(from);
  if (found == std::string::npos) FAIL("the text of the test has changed");
  return text.replace(found, from.size(), to);
}

}  // namespace

TEST_GROUP(SceneFile){// One error, of that line, that says all of these.
                      void refused(std::string_view text, int line, const std::vector<std::string>& words){
                          const SceneResult result = read_scene(text, "s.json");
CHECK_FALSE(result.scene.has_value());
const std::string start = "s.json:" + std::to_string(line) + ": ";
for (const std::string& error : result.errors) {
  const bool fits = error.starts_with(start) && std::ranges::all_of(words, [&](const std::string& word) {
                      return error.find(word) != std::string::npos;
                    });
  if (fits && error.find(". Likely cause: ") != std::string::npos && error.find(". Next: ") != std::string::npos)
    return;
}
FAIL(("expected " + start + words.front() + "\n" + all(result.errors)).c_str());
}
void refused_edit(std::string_view from, std::string_view to, int line, const std::vector<std::string>& words) {
  refused(with(from, to), line, words);
}
Scene accepted(std::string_view text) {
  SceneResult result = read_scene(text, "s.json");
  if (!result.scene) FAIL(all(result.errors).c_str());
  return std::move(*result.scene);
}
}
;

TEST(SceneFile, ReadsEveryField) {
  const std::string text = R"({"schema_version": 1, "name": "every_1", "help": "a b", "seed": 18446744073709551615,
 "fps": 18.75, "duration_s": 3.5,
 "level": {"inject": "jpeg", "contact": "grid", "cell_mm": 0.35},
 "gel": {"shear_modulus_kpa": 50.5, "poisson": 0.45, "thickness_mm": 4},
 "markers": {"rows": 8, "cols": 10, "pitch_mm": 1.9},
 "object": {"name": "brick", "shape": "box", "half_x_mm": 3, "half_y_mm": 4, "rim_mm": 0.5, "yaw_deg": 90,
   "tilt_deg": -45, "texture": {"kind": "bumps", "height_mm": 0.1, "pitch_mm": 0.8},
   "relief": {"kind": "grain", "height_um": 25, "pitch_mm": 0.6}, "friction": 0.7,
   "kinetic_friction": 0.6, "bonded": false, "compliance_mm_per_n": 0.02, "mass_g": 120, "touch_x_mm": 1.5,
   "touch_y_mm": -2.5},
 "profile": "minimum_jerk",
 "trajectory": [{"t_s": 0.25, "closing_mm": 0}, {"t_s": 1, "closing_mm": 2, "x_mm": 0, "y_mm": 0.5, "twist_deg": 1,
   "pull_x_n": 0.25, "pull_y_n": -0.5}, {"t_s": 2, "x_mm": 3, "twist_deg": 10}, {"t_s": 3, "closing_mm": 1}],
 "effects": {"press_dilation": 0.06, "creep_gain": 0.1, "creep_tau_s": 2, "drive_stiffness_n_per_mm": 5,
   "damping_n_s_per_mm": 0.01, "marker_noise_um": 3, "marker_loss": 0.02, "marker_missing": 2,
   "marker_duplicates": 4, "fabrication_um": 30, "fabrication_turn_deg": 1.5, "pixel_noise": 2.5, "dirt_specks": 6,
   "light_drift_levels_per_s": -1.25, "light_flicker_levels": 2, "exposure_ms": 20, "rolling_shutter_ms": 30,
   "worn_gel": 0.25, "dot_shading_levels": 10, "gel_margins": true},
 "faults": [{"t_s": 1, "frames": 3, "fault": "torn"}, {"t_s": 2, "fault": "backwards", "by_ms": 75}],
 "picture": {"width": 820, "background": 110, "dot_level": 40, "shading": 15, "imprint_gain": 50,
  "wall_gain": 200, "specular": 40, "shadow": 30, "jpeg_quality": 90},
 "expect": {"onset_s": [1.25, 2.5], "no_onset": false, "max_delay_ms": 120, "false_alarms": 1, "final_state": "SLIP",
   "entropy": [{"from_s": 0, "to_s": 0.5, "least_nat": 0.25, "most_nat": 0.75}]},
 "goal": {"max_delay_ms": 80, "false_alarms": 0}})";
  const SceneResult result = read_scene(text, "s.json");
  if (!result.scene) FAIL(all(result.errors).c_str());
  // A scene with a picture has its noise there.
  CHECK(result.warnings.size() == 1 && result.warnings[0].find("marker_noise_um") != std::string::npos);
  Scene expected;
  expected.name = "every_1";
  expected.help = "a b";
  expected.seed = 18446744073709551615U;
  expected.fps = 18.75;
  expected.duration_s = 3.5;
  expected.level = {.inject = Inject::kJpeg, .contact = ContactLevel::kGrid, .cell_mm = 0.35};
  expected.gel = {.shear_modulus_mpa = 0.0505, .poisson = 0.45, .thickness_mm = 4.0};
  expected.markers = {8, 10, 1.9};
  Object& object = expected.object;
  object.name = "brick";
  object.shape.kind = ShapeKind::kBox;
  object.shape.half_x_mm = 3;
  object.shape.half_y_mm = 4;
  object.shape.rim_mm = 0.5;
  object.shape.yaw_rad = std::numbers::pi / 2;
  object.shape.tilt_rad = -std::numbers::pi / 4;
  object.shape.texture = TextureKind::kBumps;
  object.shape.texture_height_mm = 0.1;
  object.shape.texture_pitch_mm = 0.8;
  object.relief = {ReliefKind::kGrain, 25, 0.6};
  object.friction = 0.7;
  object.kinetic_friction = 0.6;
  object.compliance_mm_per_n = 0.02;
  object.mass_g = 120;
  object.touch_mm = {1.5, -2.5};
  expected.profile = Profile::kMinimumJerk;
  expected.trajectory.resize(4);
  expected.trajectory[0].t_s = 0.25;
  expected.trajectory[0].closing_mm = 0;
  expected.trajectory[1] = {.t_s = 1,
                            .depth_mm = {},
                            .force_n = {},
                            .closing_mm = 2,
                            .x_mm = 0,
                            .y_mm = 0.5,
                            .twist_deg = 1,
                            .pull_x_n = 0.25,
                            .pull_y_n = -0.5};
  expected.trajectory[2].t_s = 2;
  expected.trajectory[2].x_mm = 3;
  expected.trajectory[2].twist_deg = 10;
  expected.trajectory[3].t_s = 3;
  expected.trajectory[3].closing_mm = 1;
  expected.effects = {.press_dilation = 0.06,
                      .creep_gain = 0.1,
                      .creep_tau_s = 2,
                      .drive_stiffness_n_per_mm = 5,
                      .damping_n_s_per_mm = 0.01,
                      .marker_noise_um = 3,
                      .marker_loss = 0.02,
                      .marker_missing = 2,
                      .marker_duplicates = 4,
                      .fabrication_um = 30,
                      .fabrication_turn_deg = 1.5,
                      .pixel_noise = 2.5,
                      .dirt_specks = 6,
                      .light_drift_levels_per_s = -1.25,
                      .light_flicker_levels = 2,
                      .exposure_ms = 20,
                      .rolling_shutter_ms = 30,
                      .worn_gel = 0.25,
                      .dot_shading_levels = 10,
                      .gel_margins = true};
  expected.faults = {{1, 3, Fault::kTorn, 50}, {2, 1, Fault::kBackwards, 75}};
  expected.picture = {820, 110, 40, 15, 50, 200, 40, 30, 90};
  expected.expect.onset_s = {1.25, 2.5};
  expected.expect.max_delay_ms = 120;
  expected.expect.false_alarms = 1;
  expected.expect.final_state = "SLIP";
  expected.expect.entropy = {{0, 0.5, 0.25, 0.75}};
  expected.goal.max_delay_ms = 80;
  expected.goal.false_alarms = 0;
  CHECK(same(expected, *result.scene));
  CHECK(same(expected, accepted(write_scene(expected))));
}

TEST(SceneFile, LeavesOutWhatTheFileLeavesOut) {
  Scene expected;
  expected.name = "n";
  expected.duration_s = 10;
  expected.trajectory.resize(1);
  CHECK(same(expected, accepted(bare().dump())));
  const Scene half_space = accepted(R"({"schema_version": 1, "name": "n", "duration_s": 10, "gel": {"half_space": true},
    "trajectory": [{"t_s": 0}], "object": {"shape": "edge", "radius_mm": 1, "flank_deg": 30},
    "level": {"contact": "grid"}})");
  CHECK_EQUAL(kInfinity, half_space.gel.thickness_mm);
  CHECK_EQUAL(1.0, half_space.object.shape.radius_mm);
  CHECK_EQUAL(30.0, half_space.object.shape.flank_deg);
}

// By the table: the ends of each range are taken, the next number beyond is refused in its line.
TEST(SceneFile, KeepsToEveryRange) {
  int ranges = 0;
  for (const FieldInfo& field : scene_fields()) {
    const bool whole = field.type == "whole number";
    if (!whole && field.type != "number") continue;
    ++ranges;
    std::string shown_path = field.path;
    if (const auto entry = shown_path.find("[]"); entry != std::string::npos) shown_path.insert(entry + 1, "0");
    const auto errors = [&](const Json& value, int& line) {
      Json text = home_of(field.path);
      text[pointer_to(field.path)] = value;
      const std::string dump = text.dump(1);
      const std::string key = "\"" + field.path.substr(field.path.find_last_of('.') + 1) + "\": " + value.dump();
      const auto found = dump.find(key);
      CHECK(found != std::string::npos);
      line = 1 + static_cast<int>(std::count(dump.begin(), dump.begin() + static_cast<long>(found), '\n'));
      return read_scene(dump, "s").errors;
    };
    const bool seed = field.path == "seed";
    const Json most = seed ? Json(std::numeric_limits<std::uint64_t>::max()) : Json(field.most);
    const Json above = whole ? (seed ? Json::parse("18446744073709551616") : Json(static_cast<long>(field.most) + 1))
                             : Json(std::nextafter(field.most, kInfinity));
    const Json below = whole ? Json(static_cast<long>(field.least) - 1) : Json(std::nextafter(field.least, -kInfinity));
    int line = 0;
    for (const Json& end : {Json(field.least), most}) {
      const auto said = errors(end, line);
      if (tells(said, "out of range ('" + shown_path + "'") || tells(said, "kind of value") ||
          tells(said, "not used by")) {
        FAIL((field.path + " refuses " + end.dump() + "\n" + all(said)).c_str());
      }
    }
    const std::string what =
        (field.path == "schema_version" ? "unknown version ('" : "out of range ('") + shown_path + "': ";
    for (const Json& beyond : {below, above}) {
      const auto said = errors(beyond, line);
      if (!tells(said, ("s:" + std::to_string(line)).append(": ").append(what))) {
        FAIL((field.path + " takes " + beyond.dump() + " in line " + std::to_string(line) + "\n" + all(said)).c_str());
      }
    }
  }
  CHECK_EQUAL(78, ranges);
}

TEST(SceneFile, RefusesOtherKindsForEveryField) {
  for (const FieldInfo& field : scene_fields()) {
    std::string shown_path = field.path;
    if (const auto entry = shown_path.find("[]"); entry != std::string::npos) shown_path.insert(entry + 1, "0");
    for (const char* other : {"\"x\"", "7.5", "true", "null", "{}", "[]", "[1]", "[1, \"a\"]"}) {
      const Json value = Json::parse(other);
      const bool text = field.type == "name" || field.type == "text" || field.type == "choice";
      if (field.type == "list" ? value.is_array() : text ? value.is_string() : false) continue;
      if ((field.type == "number" && value.is_number()) || (field.type == "true or false" && value.is_boolean()))
        continue;
      Json json = home_of(field.path);
      json[pointer_to(field.path)] = value;
      const auto said = read_scene(json.dump(), "s").errors;
      const std::string_view what =
          field.type == "whole number" && value.is_number() ? "not a whole number ('" : "wrong kind of value ('";
      if (!tells(said, std::string(what).append(shown_path).append("': ")))
        FAIL((field.path + " takes " + other + "\n" + all(said)).c_str());
    }
  }
}

TEST(SceneFile, TakesOnlyTheNamesOfAChoice) {
  for (const FieldInfo& field : scene_fields()) {
    if (field.type != "choice") continue;
    Json json = home_of(field.path);
    json[pointer_to(field.path)] = "nonsense";
    CHECK(tells(read_scene(json.dump(), "s").errors, "unknown value ('"));
    const Json names = Json::parse("[" + field.allowed + "]");
    CHECK(names.size() >= 2);
    for (const Json& name : names) {
      json[pointer_to(field.path)] = name;
      CHECK_FALSE(tells(read_scene(json.dump(), "s").errors, "unknown value"));
      std::string typo = name.get<std::string>();
      typo.insert(typo.size() / 2, "x");
      json[pointer_to(field.path)] = typo;
      CHECK(tells(read_scene(json.dump(), "s").errors, "nearest is \"" + name.get<std::string>() + "\""));
    }
  }
}

TEST(SceneFile, WantsWhatIsRequired) {
  for (const char* key : {"schema_version", "name", "duration_s", "trajectory"}) {
    Json text = bare();
    text.erase(key);
    refused(text.dump(), 1, {"no '" + std::string(key) + "', required: "});
  }
  refused_edit(R"({"t_s": 0, "force_n": 0})", R"({"force_n": 0})", 8, {"no 'trajectory[0].t_s'"});
  refused_edit(R"("effects": {})", R"("faults": [{"t_s": 1}])", 12, {"no 'faults[0].fault'", "\"dropped\""});
}

TEST(SceneFile, NamesTheNearestKey) {
  refused_edit("radius_mm", "radus_mm", 6, {"unknown key ('object.radus_mm': 15)", "nearest is 'radius_mm'"});
  refused_edit("radius_mm", "radius", 6, {"nearest is 'radius_mm'"});
  refused_edit("force_n\": 3, \"x", "froce_n\": 3, \"x", 9, {"('trajectory[1].froce_n': 3)", "nearest is 'force_n'"});
  refused_edit("duration_s", "duration", 4, {"nearest is 'duration_s'"});
  refused_edit("\"effects\": {}", "\"marker_loss\": 0.1", 12, {"unknown key ('marker_loss'", "move it into 'effects'"});
  refused_edit("\"effects\": {}", "\"qqqqqqq\": 0.1", 12, {"allowed here: schema_version, name"});
  refused_edit("springs", "spring", 5, {"unknown value ('level.contact': \"spring\")", "nearest is \"springs\""});
}

TEST(SceneFile, RefusesNamesAndTexts) {
  for (const char* name :
       {"\"\"", "\"Slip\"", "\"a b\"", "\"a-b\"", "\"../a\"", R"("\u00e9")", R"("a\u0000")", R"("a\n")"}) {
    refused_edit("\"slip\"", name, 3, {"cannot be used ('name': "});
  }
  refused_edit("\"slip\"", "\"" + std::string(65, 'a') + "\"", 3, {"1 .. 64 characters"});
  CHECK_EQUAL(64U, accepted(with("\"slip\"", "\"" + std::string(64, 'a') + "\"")).name.size());
  refused_edit("\"slip\"", R"("slip", "help": "a\u001b[31m")", 3, {"cannot be used ('help': \"a?[31m\")"});
  CHECK_EQUAL(200U, accepted(with("\"slip\"", "\"slip\", \"help\": \"" + std::string(200, '~') + "\"")).help.size());
}

TEST(SceneFile, ChecksTheTrajectory) {
  refused_edit("\"t_s\": 3", "\"t_s\": 1", 10, {"times do not rise ('trajectory[2].t_s': 1)", "above 1"});
  refused_edit("\"t_s\": 3", "\"t_s\": 4.001", 10, {"after the end ('trajectory[2].t_s': 4.001)", "4 s"});
  refused_edit(R"("force_n": 3, "x_mm": 4)", "\"depth_mm\": 1", 10, {"two ways to press", "line 8 has 'force_n'"});
  refused_edit(R"("force_n": 3, "x_mm": 4)", "\"closing_mm\": 1", 10, {"two ways to press"});
  refused_edit(R"({"t_s": 0, "force_n": 0})", "7", 8, {"wrong kind of value ('trajectory[0]': 7)", "an object"});
  refused(R"({"schema_version": 1, "name": "n", "duration_s": 1, "trajectory": []})", 1, {"no waypoint"});
  refused(R"({"schema_version": 1, "name": "n", "duration_s": 1, "trajectory": {}})", 1, {"allowed a list"});
  refused_edit("\"effects\": {}", R"("faults": [{"t_s": 5, "fault": "bad"}])", 12, {"a fault after the end"});
  CHECK_EQUAL(4.0, accepted(with("\"t_s\": 3", "\"t_s\": 4")).trajectory[2].t_s);
}

TEST(SceneFile, ChecksSizes) {
  refused_edit("\"duration_s\": 4", R"("duration_s": 1000.001, "fps": 1000)", 4,
               {"too many frames", "allowed 1000000"});
  accepted(with("\"duration_s\": 4", R"("duration_s": 1000, "fps": 1000)"));
  refused_edit("\"effects\": {}", R"("markers": {"rows": 16})", 12, {"too many markers", "144", "allowed 128"});
  refused_edit("\"effects\": {}", R"("effects": {"marker_missing": 64})", 12, {"than there are", "0 .. 63"});
  refused_edit("\"radius_mm\": 15", R"("shape": "disc", "radius_mm": 0.5)", 6, {"the rim is wider", "0 .. 0.5"});
}

// What no firmware plays is no good scene: its own limits are asked.
TEST(SceneFile, ChecksTheFirmwaresLimits) {
  for (const auto& [name, parameter] : {std::pair{"rows", "grid_rows"}, {"cols", "grid_cols"}}) {
    const ParamInfo& limits = *find_param(parameter);
    Json scene = bare();
    for (const std::int32_t beyond : {limits.min - 1, limits.max + 1}) {
      scene["markers"][name] = beyond;
      refused(scene.dump(), 1,
              {"('markers." + std::string(name) + "': " + std::to_string(beyond) + ")",
               "allowed a whole number " + std::to_string(limits.min) + " .. " + std::to_string(limits.max)});
    }
    scene["markers"][name] = limits.min;
    accepted(scene.dump());
  }
  const auto wide = [](const char* inject, int width) {
    Json scene = bare();
    scene["level"]["inject"] = inject;
    scene["picture"]["width"] = width;
    return scene.dump();
  };
  refused(wide("grey", kMaxLumaWidth + 1), 1,
          {"('picture.width': 1641)", "allowed 64 .. 1640 px with inject \"grey\"", "or inject \"jpeg\""});
  accepted(wide("grey", kMaxLumaWidth));
  accepted(wide("jpeg", 3280));
}

TEST(SceneFile, RefusesKeysThatMeanNothing) {
  refused_edit(
      "\"radius_mm\": 15", R"("shape": "box", "radius_mm": 15)", 6,
      {"not used by a box ('object.radius_mm': 15)", "keys of a box: half_x_mm, half_y_mm, rim_mm, yaw_deg, tilt_deg"});
  refused_edit("\"radius_mm\": 15", "\"yaw_deg\": 15", 6, {"not used by a sphere", "keys of a sphere: radius_mm"});
  refused_edit("\"radius_mm\": 15", "\"rim_mm\": 15", 6, {"not used by a sphere"});
  refused_edit("\"radius_mm\": 15", R"("texture": {"height_mm": 1})", 6, {"not used by an object without texture"});
  refused_edit("\"radius_mm\": 15", R"("relief": {"pitch_mm": 1})", 6, {"not used by an object without relief"});
  refused_edit("\"springs\"", R"("springs", "cell_mm": 1)", 5, {"not used by level springs ('level.cell_mm': 1)"});
  refused_edit("\"effects\": {}", R"("gel": {"thickness_mm": 4, "half_space": true})", 12,
               {"not used by a half-space"});
  refused_edit("\"effects\": {}", R"("effects": {"creep_tau_s": 2})", 12, {"not used by a gel without creep_gain"});
  refused_edit("\"effects\": {}", R"("effects": {"damping_n_s_per_mm": 2})", 12, {"without mass_g"});
  refused_edit("\"effects\": {}", R"("effects": {"drive_stiffness_n_per_mm": 2})", 12, {"without mass_g"});
  refused_edit("\"effects\": {}", R"("faults": [{"t_s": 1, "fault": "bad", "by_ms": 1}])", 12,
               {"not used by this fault ('faults[0].by_ms': 1)"});
  refused_edit("\"radius_mm\": 15", R"("bonded": true, "kinetic_friction": 0.1)", 6, {"not used by a bonded object"});
}

TEST(SceneFile, RefusesContradictions) {
  refused_edit("\"radius_mm\": 15", R"("friction": 0.3, "kinetic_friction": 0.31)", 6,
               {"above the static one", "0 .. 0.3"});
  refused_edit("\"radius_mm\": 15", "\"mass_g\": 50", 6,
               {"nothing moves an object with mass", "drive_stiffness_n_per_mm"});
  refused_edit("\"x_mm\": 4", "\"pull_x_n\": 4", 7, {"needs a mass"});
  refused_edit("\"expect\": {}", R"("expect": {"onset_s": [2, 2]})", 13, {"not a time of the scene", "2 .. 2"});
  refused_edit("\"expect\": {}", R"("expect": {"onset_s": [2, 4.5]})", 13, {"up to duration_s, 4 s"});
  refused_edit("\"expect\": {}", "\"expect\": {\"onset_s\": [2, 3],\n\"no_onset\": true}", 13, {"contradicts"});
  refused_edit("\"expect\": {}", R"("expect": {"max_delay_ms": 3, "no_onset": true})", 13, {"contradicts"});
  refused_edit("\"expect\": {}", R"("expect": {"entropy": [{"from_s": 1, "to_s": 0, "least_nat": 2, "most_nat": 1}]})",
               13, {"not a time of the scene ('expect.entropy[0]'"});
  refused_edit("\"expect\": {}", R"("expect": {"entropy": [{"from_s": 0, "to_s": 1, "least_nat": 2, "most_nat": 1}]})",
               13, {"least is above most"});
}

TEST(SceneFile, RefusesGoalsThatAskNoMoreThanThePromises) {
  const auto both = [](std::string_view promise, std::string_view goal) {
    return with(R"("expect": {})",
                R"("expect": {)" + std::string(promise) + "},\n\"goal\": {" + std::string(goal) + "}");
  };
  const std::string delay = R"("max_delay_ms": 120)";
  const std::string alarms = R"("false_alarms": 1)";
  const std::string state = R"("final_state": "OK")";
  for (const auto* no_more : {R"("max_delay_ms": 120)", R"("max_delay_ms": 120.5)"}) {
    refused(both(delay, no_more), 14,
            {"asks no more than the promise ('goal.max_delay_ms': 12", "below 'expect.max_delay_ms', 120 ms"});
  }
  for (const auto* no_more : {R"("false_alarms": 1)", R"("false_alarms": 2)"}) {
    refused(both(alarms, no_more), 14,
            {"asks no more than the promise ('goal.false_alarms': ", "below 'expect.false_alarms', 1"});
  }
  refused(both(state, state), 14, {"a state is promised already", R"('expect.final_state': "OK")"});
  refused(both(state, R"("final_state": "SLIP")"), 14, {R"(('goal.final_state': "SLIP")", "keep one of the two"});
  refused(both(R"("no_onset": true)", delay), 14, {"contradicts 'expect.no_onset'", "('goal.max_delay_ms')"});
  refused(both("", R"("onset_s": [1, 2])"), 14, {"unknown key ('goal.onset_s': [...])", "move it into 'expect'"});

  const Scene stricter = accepted(both(delay + ", " + alarms, R"("max_delay_ms": 119.5, "false_alarms": 0)"));
  CHECK_EQUAL(119.5, *stricter.goal.max_delay_ms);
  CHECK_EQUAL(0, *stricter.goal.false_alarms);
  // What is not promised at all may be aimed at.
  const Scene alone = accepted(both("", delay + ", " + alarms + ", " + state));
  CHECK_EQUAL(120.0, *alone.goal.max_delay_ms);
  STRCMP_EQUAL("OK", alone.goal.final_state.c_str());
}

TEST(SceneFile, TellsAllProblemsInOrderAndAtMostTwenty) {
  std::string text = R"({"schema_version": 1, "name": "n", "duration_s": 9, "trajectory": [{"t_s": 0}], "effects": {)";
  for (int i = 0; i < 30; ++i) text += "\n\"key_" + std::to_string(i) + "\": 1,";
  text += "\n\"marker_loss\": 2}}";
  const auto errors = read_scene(text, "s.json").errors;
  CHECK_EQUAL(kMostSceneErrors, errors.size());
  for (std::size_t i = 0; i < errors.size(); ++i) {
    CHECK(
        errors[i].starts_with("s.json:" + std::to_string(i + 2) + ": unknown key ('effects.key_" + std::to_string(i)));
  }
}

TEST(SceneFile, WarnsOfWhatChangesNothing) {
  const auto warned = [](std::string_view from, std::string_view to, int line, std::string_view what) {
    const SceneResult result = read_scene(with(from, to), "s.json");
    if (!result.scene) FAIL(all(result.errors).c_str());
    CHECK_EQUAL(1U, result.warnings.size());
    CHECK(result.warnings[0].starts_with("s.json:" + std::to_string(line) + ": unused: "));
    CHECK(tells(result.warnings, what));
  };
  CHECK(read_scene(kSlip, "s.json").warnings.empty());
  warned("\"effects\": {}", R"("requires": ["press"])", 12, "'requires' is gone");
  warned("\"effects\": {}", R"("picture": {"shading": 3})", 12, "'picture.shading' needs a picture");
  const SceneResult relief = read_scene(R"({"schema_version": 1, "name": "n", "duration_s": 9,
    "object": {"yaw_deg": 20, "relief": {"kind": "ridges", "height_um": 30}},
    "trajectory": [{"t_s": 0}]})",
                                        "s");
  CHECK(relief.scene.has_value());
  CHECK(tells(relief.warnings, "s:2: unused: 'object.relief.kind' needs a picture"));
  CHECK(tells(relief.warnings, "s:2: unused: 'object.relief.height_um' needs a picture"));
  warned("\"effects\": {}", R"("effects": {"dirt_specks": 3})", 12, "'effects.dirt_specks' needs a picture");
  const SceneResult moved = read_scene(R"({"schema_version": 1, "name": "n", "duration_s": 9,
    "object": {"compliance_mm_per_n": 1},
    "trajectory": [{"t_s": 0, "x_mm": 0}, {"t_s": 1, "x_mm": 1}]})",
                                       "s");
  CHECK(moved.scene.has_value());
  CHECK(tells(moved.warnings, "s:3: unused: the object moves but never touches"));
  CHECK(tells(moved.warnings, "s:2: unused: 'object.compliance_mm_per_n'"));
}

TEST(SceneFile, RefusesWhatTheLevelCannotDo) {
  refused_edit(R"("radius_mm": 15)", R"("shape": "box")", 6, {"level springs cannot do shapes ('object.shape')"});
  refused_edit(R"("radius_mm": 15)", R"("texture": {"kind": "bumps", "height_mm": 0.1})", 6,
               {"level springs cannot do shapes ('object.texture.kind')", "a smooth sphere or cone"});
}

// --- hostile text ---

TEST(SceneFile, RefusesHostileText) {
  using namespace std::string_literals;
  refused("", 1, {"not JSON"});
  refused("3", 1, {"wrong kind of value (3), allowed an object"});
  refused("\n\n[]", 3, {"allowed an object"});
  refused("{\n\"a\": 1,\n}", 3, {"not JSON", "object key"});
  refused("{\n// why\n}", 2, {"not JSON"});
  refused("{\n\"a\": 1\n}\n x", 4, {"not JSON", "end of input"});
  refused("{\n\"a\": \"\xFF\"}", 2, {"not JSON", "UTF-8"});
  refused("{\n\"a\": \"\\ud800\"}", 2, {"not JSON"});
  refused("{\n\"a\": 1e999}", 2, {"not JSON", "number overflow"});
  refused("{\n\"a\": NaN}", 2, {"not JSON"});
  refused("{\n\"a\": 0x10}", 2, {"not JSON"});
  refused("{\"a\": \n\"b", 2, {"not JSON"});
  refused("{\n}\0 {}"s, 2, {"a NUL byte"});
  refused("\xEF\xBB\xBF{}", 1, {"byte-order mark"});
  refused("\xEF\xBB", 1, {"not JSON"});
  refused("{\"a\":\n" + std::string(8, '[') + std::string(8, ']') + "}", 2, {"nested too deep", "allowed 8"});
  refused("{\"a\":\n" + std::string(500'000, '['), 2, {"nested too deep"});
  refused("{\"a\":" + std::string(7, '[') + std::string(7, ']') + "}", 1, {"unknown key ('a': [...])"});
  std::string list = "{\"trajectory\": [\n0";
  for (int i = 0; i < 10'000; ++i) list += ",0";
  refused(list + "]}", 2, {"list too long", "allowed 10000"});
  std::string keys = "{";
  for (int i = 0; i <= 100; ++i) keys += (i > 0 ? ",\n\"" : "\"") + std::to_string(i) + "\": 0";
  refused(keys + "}", 101, {"too many keys", "allowed 100"});
  refused("{" + std::string(kMostSceneBytes, ' '), 1, {"too long (1000001 bytes)"});
  refused("{\"" + std::string(900'000, 'k') + "\": \"" + std::string(90'000, 'v') + "\"}", 1,
          {"unknown key ('kkk", "..."});
  refused(with("\"effects\": {}", R"("name": "again")"), 12, {"key given twice ('name', first in line 3)"});
  refused(with("\"radius_mm\": 15", R"("radius_mm": 15, "radius_mm": 15)"), 6, {"key given twice ('radius_mm'"});
  refused(with("\"effects\": {}", R"("e\u001b\u0000\u00e9": 1)"), 12, {"unknown key ('e????"});
  // A number of the last place before a line break does not take the next line.
  refused(with("\"duration_s\": 4,", "\"duration_s\": -4\n,"), 4, {"out of range ('duration_s': -4)"});
}

TEST(SceneFile, ManyWaypointsCostLittle) {
  std::string text = R"({"schema_version": 1, "name": "n", "duration_s": 100000,
    "level": {"contact": "grid"}, "fps": 1, "trajectory": [)";
  for (int i = 0; i < 10'000; ++i) {
    text += (i > 0 ? ",\n" : "\n") + std::string("{\"t_s\": ") + std::to_string(i) + R"(, "force_n": 2, "x_mm": )" +
            (i == 9'999 ? "0" : std::to_string(i / 1000 * 2 + (i % 1000 == 0 ? 0 : 1))) + "}";
  }
  CHECK_EQUAL(10'000U, accepted(text + "]}").trajectory.size());
}

TEST(SceneFile, ShowsFileNamesWithoutControlCharacters) {
  CHECK(read_scene("", "a\x1b\nb\xC3\xA9").errors.at(0).starts_with("a??b\xC3\xA9:1: "));
}

TEST(SceneFile, ReadsFiles) {
  const test::TempDir folder;
  test::write_file(folder / "slip.json", kSlip);
  CHECK(read_scene_file(folder / "slip.json").scene.has_value());
  CHECK(tells(read_scene_file(folder / "none.json").errors, "none.json: cannot be read. Likely cause: No such file"));
  CHECK(tells(read_scene_file(folder.path()).errors, "is not a regular file"));
  test::write_file(folder / "long.json", std::string(kMostSceneBytes + 5, ' '));
  CHECK(tells(read_scene_file(folder / "long.json").errors, "long.json:1: too long"));
}

TEST(SceneFile, WritesOnlyWhatDiffersAndRoundNumbers) {
  Scene scene;
  scene.name = "n";
  scene.duration_s = 2;
  scene.gel.shear_modulus_mpa = 63.7 / 1000;  // times 1000 is another number
  scene.object.shape.kind = ShapeKind::kBox;
  scene.object.shape.yaw_rad = 30.0 / (180.0 / std::numbers::pi);
  scene.trajectory.resize(2);
  scene.trajectory[1].t_s = 0.1;
  scene.trajectory[1].x_mm = -1e-3;
  STRCMP_EQUAL(
      "{\n  \"schema_version\": 1,\n  \"name\": \"n\",\n  \"duration_s\": 2,\n  \"gel\": {\"shear_modulus_kpa\": "
      "63.7},\n"
      "  \"object\": {\"shape\": \"box\", \"yaw_deg\": 30},\n"
      "  \"trajectory\": [\n    {\"t_s\": 0},\n    {\"t_s\": 0.1, \"x_mm\": -0.001}\n  ]\n}\n",
      write_scene(scene).c_str());
}

TEST(SceneFile, DescribesInWords) {
  Scene scene = accepted(kSlip);
  scene.help = "a sphere slips";
  scene.effects.marker_loss = 0.25;
  scene.faults = {{1.5, 2, Fault::kFrozen, 50}};
  scene.expect.final_state = "SLIP";
  scene.goal.max_delay_ms = 80;
  const std::string text = describe(scene);
  for (const char* words :
       {"slip: a sphere slips\n", "contact springs, springs 64", "thickness_mm 4.25", "shape sphere, radius_mm 15",
        "left out by level springs", "t_s  force_n  x_mm\n", "  3        3     4\n", "marker_loss 0.25",
        "t_s 1.5, frames 2, fault frozen\n", "final_state SLIP", "  goal       max_delay_ms 80\n"}) {
    if (text.find(words) == std::string::npos) FAIL((std::string(words) + " is not in\n" + text).c_str());
  }
  CHECK(text.find("cell_mm") == std::string::npos);  // means nothing on springs
  for (const std::string_view omission : omissions(ContactLevel::kSprings))
    CHECK(text.find(omission) != std::string::npos);
}

TEST_GROUP(SceneFuzz){void check(const std::string& text){const std::string finding = test::check_scene_text(text);
if (!finding.empty()) FAIL((finding + "\n--- of\n" + text).c_str());
}
}
;

TEST(SceneFuzz, HoldsForTheSeeds) {
  for (const std::string& seed : test::scene_seeds()) check(seed);
}

TEST(SceneFuzz, SeedsButTheLastAreScenes) {
  const auto seeds = test::scene_seeds();
  for (std::size_t i = 0; i + 1 < seeds.size(); ++i) {
    const SceneResult result = read_scene(seeds[i], "seed");
    if (!result.scene) FAIL(all(result.errors).c_str());
  }
}

TEST(SceneFuzz, HoldsForDamagedSeeds) {
  const auto seeds = test::scene_seeds();
  std::mt19937 random(1);
  using namespace std::string_view_literals;
  constexpr std::string_view kSpice = "{}[]\",:.-+eE019 \n\\\0\x80\xFFntu"sv;
  for (int round = 0; round < 20'000; ++round) {
    std::string text = seeds[random() % seeds.size()];
    for (auto i = 1 + random() % 3; i > 0; --i) {
      const std::size_t at = random() % text.size();
      switch (random() % 3) {
        case 0:
          text[at] = kSpice[random() % kSpice.size()];
          break;
        case 1:
          text.erase(at, 1 + random() % 20);
          break;
        default:
          text.insert(at, text.substr(random() % text.size(), random() % 40));
      }
      if (text.empty()) text = "{";
    }
    check(text);
  }
}

TEST(SceneFuzz, HoldsForWhatOnceWasAFinding) {
  const std::filesystem::path folder = holdfast::test::source("tests/fuzz/regressions/scene");
  if (!std::filesystem::exists(folder)) return;
  for (const auto& file : std::filesystem::directory_iterator(folder)) check(test::read_file(file.path()));
}
