// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/scene/file/scene_file.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <initializer_list>
#include <iterator>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <numeric>
#include <type_traits>
#include <utility>
#include <variant>

#include "base/status.hpp"
#include "drivers/sim/scene/contact/springs.hpp"
#include "drivers/sim/scene/file/json.hpp"
#include "vision/markers.hpp"

namespace holdfast::scene {
namespace {

using json::find;
using json::kMostShown;
using json::Node;
using json::printable;
using json::Problems;
using json::shown;

// --- Words ---

std::string shown(double number) {
  std::array<char, 32> buffer{};
  const bool whole = std::abs(number) < 1e15 && number == std::trunc(number);
  const auto end = whole ? std::to_chars(buffer.begin(), buffer.end(), static_cast<std::int64_t>(number))
                         : std::to_chars(buffer.begin(), buffer.end(), number);
  return {buffer.begin(), end.ptr};
}

template <typename Words>
std::string joined(const Words& words, std::string_view between = ", ") {
  std::string out;
  for (const auto& word : words) out.append(out.empty() ? "" : between).append(word);
  return out;
}

// Levenshtein's distance; a word that the other begins with is one step away.
std::size_t distance(std::string_view a, std::string_view b) {
  if (!a.empty() && !b.empty() && (a.starts_with(b) || b.starts_with(a))) return a.size() != b.size() ? 1 : 0;
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = std::exchange(row[0], i + 1);
    for (std::size_t k = 0; k < b.size(); ++k) {
      const std::size_t change = diagonal + (a[i] == b[k] ? 0 : 1);
      diagonal = row[k + 1];
      row[k + 1] = std::min({change, diagonal + 1, row[k] + 1});
    }
  }
  return row.back();
}

// The word that was meant, if half of it is right, in capitals or not; else empty.
template <typename Words>
std::string_view nearest(std::string_view word, const Words& words) {
  std::string_view best;
  std::size_t least = kMostShown;
  if (word.size() > kMostShown) return best;
  const auto lower = [](std::string_view text) {
    std::string out(text);
    for (char& c : out) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
    return out;
  };
  for (const std::string_view candidate : words) {
    const std::size_t away = distance(lower(word), lower(candidate));
    if (away < least && 2 * away <= std::max(word.size(), candidate.size())) {
      best = candidate;
      least = away;
    }
  }
  return best;
}

// --- The table of fields ---

using Names = std::span<const std::string_view>;
// Of a member, or of a key in the units of the member; nothing = not given.
using Value =
    std::variant<std::monostate, double, std::int64_t, std::uint64_t, bool, std::string, std::array<double, 2>>;

enum class Type { kNumber, kWhole, kSeed, kFlag, kName, kText, kChoice, kTwoNumbers, kList };
constexpr std::array<std::string_view, 9> kTypeNames{"number", "whole number", "whole number", "true or false", "name",
                                                     "text",   "choice",       "two numbers",  "list"};

template <typename Record>
struct Access {
  Type type = Type::kList;
  Names names;  // of a choice
  Value (*get)(const Record&) = nullptr;
  void (*set)(Record&, const Value&) = nullptr;
};

template <typename Record>
struct Field {
  std::string_view path;  // from the record on
  Access<Record> access;
  std::string_view unit;
  double least = 0.0;
  double most = 0.0;
  std::string_view help;
  std::string_view capability{};
  double per_member = 1.0;  // units of the file in one unit of the member
  bool required = false;
  std::string_view (*idle)(const Record&) = nullptr;  // what has no use for this field in this record; empty = used
};

template <auto... kPath>
constexpr auto& follow(auto& record) {
  return (record.*....*kPath);
}

template <typename T>
constexpr bool kOptional = false;
template <typename T>
constexpr bool kOptional<std::optional<T>> = true;

template <typename T>
constexpr Names kNamesOf{};
template <>
constexpr Names kNamesOf<Inject> = kInjectNames;
template <>
constexpr Names kNamesOf<ContactLevel> = kContactLevelNames;
template <>
constexpr Names kNamesOf<ShapeKind> = kShapeNames;
template <>
constexpr Names kNamesOf<TextureKind> = kTextureNames;
template <>
constexpr Names kNamesOf<ReliefKind> = kReliefNames;
template <>
constexpr Names kNamesOf<Profile> = kProfileNames;
template <>
constexpr Names kNamesOf<Fault> = kFaultNames;

constexpr auto kStateNames = [] {
  std::array<std::string_view, kStates.size()> names;
  for (std::size_t i = 0; i < names.size(); ++i) names[i] = kStates[i].name;
  return names;
}();

template <typename T>
Value value_of(const T& member) {
  if constexpr (kOptional<T>) {
    return member ? value_of(*member) : Value{};
  } else if constexpr (std::is_enum_v<T> || std::is_same_v<T, int>) {
    return static_cast<std::int64_t>(member);
  } else if constexpr (std::is_same_v<T, Expect::Window>) {
    return std::array{member.from_s, member.to_s};
  } else {
    return member;
  }
}

template <typename T>
void assign(T& member, const Value& value) {
  if constexpr (kOptional<T>) {
    typename T::value_type inner{};
    assign(inner, value);
    member = inner;
  } else if constexpr (std::is_enum_v<T> || std::is_same_v<T, int>) {
    member = static_cast<T>(std::get<std::int64_t>(value));
  } else if constexpr (std::is_same_v<T, Expect::Window>) {
    const auto& both = std::get<std::array<double, 2>>(value);
    member = {both[0], both[1]};
  } else {
    member = std::get<T>(value);
  }
}

template <typename T>
constexpr Type type_of() {
  if constexpr (kOptional<T>) return type_of<typename T::value_type>();
  if constexpr (std::is_same_v<T, double>) return Type::kNumber;
  if constexpr (std::is_same_v<T, int>) return Type::kWhole;
  if constexpr (std::is_same_v<T, std::uint64_t>) return Type::kSeed;
  if constexpr (std::is_same_v<T, bool>) return Type::kFlag;
  if constexpr (std::is_same_v<T, std::string>) return Type::kName;
  if constexpr (std::is_same_v<T, Expect::Window>) return Type::kTwoNumbers;
  return Type::kChoice;
}

template <typename Record, auto... kPath>
constexpr Access<Record> member() {
  using T = std::remove_cvref_t<decltype(follow<kPath...>(std::declval<Record&>()))>;
  return {type_of<T>(), kNamesOf<T>, [](const Record& record) { return value_of(follow<kPath...>(record)); },
          [](Record& record, const Value& value) { assign(follow<kPath...>(record), value); }};
}

template <auto... kPath>
constexpr Access<Scene> kOf = member<Scene, kPath...>();

constexpr Access<Scene> kOfHelp = [] {
  Access<Scene> access = kOf<&Scene::help>;
  access.type = Type::kText;
  return access;
}();

// Infinite thickness is spelled half_space.
constexpr Access<Scene> kOfThickness{Type::kNumber,
                                     {},
                                     [](const Scene& scene) {
                                       const double mm = scene.gel.thickness_mm;
                                       return std::isinf(mm) ? Value{} : Value{mm};
                                     },
                                     kOf<&Scene::gel, &Gel::thickness_mm>.set};
constexpr Access<Scene> kOfHalfSpace{Type::kFlag,
                                     {},
                                     [](const Scene& scene) { return Value{std::isinf(scene.gel.thickness_mm)}; },
                                     [](Scene& scene, const Value& value) {
                                       if (std::get<bool>(value))
                                         scene.gel.thickness_mm = std::numeric_limits<double>::infinity();
                                     }};
// Width 0 is that of the injection level.
constexpr Access<Scene> kOfWidth{Type::kWhole,
                                 {},
                                 [](const Scene& scene) {
                                   const int width = scene.picture.width;
                                   return width == 0 ? Value{} : Value{std::int64_t{width}};
                                 },
                                 kOf<&Scene::picture, &Picture::width>.set};
// The name of a state; empty = not given.
template <auto... kPath>
constexpr Access<Scene> kOfState{Type::kChoice, kStateNames,
                                 [](const Scene& scene) {
                                   const auto* found = std::ranges::find(kStateNames, follow<kPath...>(scene));
                                   if (found == kStateNames.end()) return Value{};
                                   return Value{std::int64_t{found - kStateNames.begin()}};
                                 },
                                 [](Scene& scene, const Value& value) {
                                   const auto index = static_cast<std::size_t>(std::get<std::int64_t>(value));
                                   follow<kPath...>(scene) = kStateNames[index];
                                 }};

constexpr std::array<std::string_view, kShapeNames.size()> kShapeWords{
    "a sphere", "an ellipsoid", "a cylinder", "a cone", "a disc", "a box", "an edge"};

template <ShapeKind... kKinds>
std::string_view unless_shape(const Scene& scene) {
  const ShapeKind kind = scene.object.shape.kind;
  return ((kind == kKinds) || ...) ? "" : kShapeWords[static_cast<std::size_t>(kind)];
}

// A turn of what looks the same from all sides is none.
std::string_view unless_turnable(const Scene& scene) {
  using enum ShapeKind;
  const Shape& shape = scene.object.shape;
  if (shape.texture != TextureKind::kNone || scene.object.relief.kind != ReliefKind::kNone ||
      (shape.kind == kDisc && shape.tilt_rad != 0.0)) {
    return "";
  }
  return unless_shape<kEllipsoid, kCylinder, kBox, kEdge>(scene);
}

std::string_view unless_textured(const Scene& scene) {
  return scene.object.shape.texture == TextureKind::kNone ? "an object without texture" : "";
}

std::string_view unless_relieved(const Scene& scene) {
  return scene.object.relief.kind == ReliefKind::kNone ? "an object without relief" : "";
}

template <ContactLevel kLevel>
std::string_view unless_level(const Scene& scene) {
  constexpr std::array<std::string_view, 2> kWords{"level springs", "level grid"};
  return scene.level.contact == kLevel ? "" : kWords[static_cast<std::size_t>(scene.level.contact)];
}

std::string_view unless_massive(const Scene& scene) {
  return scene.object.mass_g > 0.0 ? "" : "an object without mass_g";
}
std::string_view unless_creeping(const Scene& scene) {
  return scene.effects.creep_gain > 0.0 ? "" : "a gel without creep_gain";
}
std::string_view unless_shifted(const FaultEvent& event) {
  return event.fault == Fault::kLate || event.fault == Fault::kBackwards ? "" : "this fault";
}

constexpr double kDegreesPerRadian = 180.0 / std::numbers::pi;
constexpr double kMostSeconds = 100'000.0;

using enum ShapeKind;

// In the order of the file. Bounds leave room for experiments; what the models hold up to is written at each model.
constexpr auto kSceneFields = std::to_array<Field<Scene>>({
    {"schema_version", kOf<&Scene::schema_version>, "", 1, 1, "of this table", "", 1, true},
    {"name", kOf<&Scene::name>, "", 1, 64, "as the file without .json", "", 1, true},
    {"help", kOfHelp, "", 0, 200, "one line for lists"},
    {"seed", kOf<&Scene::seed>, "", 0, 1.8446744073709552e19, "of everything random"},
    {"fps", kOf<&Scene::fps>, "1/s", 1, 1000, "frames per second"},
    {"duration_s", kOf<&Scene::duration_s>, "s", 0.001, kMostSeconds, "of the scene; at most 1000000 frames", "", 1,
     true},
    {"requires", {}, "", 0, kCapabilities.size(), "capabilities that the scene uses: all of them, see below"},

    {"level.inject", kOf<&Scene::level, &Level::inject>, "", 0, 0, "where the simulation enters the firmware"},
    {"level.contact", kOf<&Scene::level, &Level::contact>, "", 0, 0, "how the contact is computed"},
    {"level.springs", kOf<&Scene::level, &Level::springs>, "", 1, kMostSprings, "springs from centre to rim", "", 1,
     false, unless_level<ContactLevel::kSprings>},
    {"level.cell_mm", kOf<&Scene::level, &Level::cell_mm>, "mm", 0.1, 5, "side of a cell", "", 1, false,
     unless_level<ContactLevel::kGrid>},

    {"gel.shear_modulus_kpa", kOf<&Scene::gel, &Gel::shear_modulus_mpa>, "kPa", 0.01, 1e6,
     "30 to 115 are reported for this gel", "", 1000},
    {"gel.poisson", kOf<&Scene::gel, &Gel::poisson>, "", 0, 0.5, "Poisson's ratio"},
    {"gel.thickness_mm", kOfThickness, "mm", 0.5, 1000, "of the layer, whose base does not move", "layer", 1, false,
     [](const Scene& s) -> std::string_view { return std::isinf(s.gel.thickness_mm) ? "a half-space" : ""; }},
    {"gel.half_space", kOfHalfSpace, "", 0, 0, "a gel without end, instead of a thickness"},

    {"markers.rows", kOf<&Scene::markers, &MarkerGrid::rows>, "", 2, 16, "of printed dots; rows x cols at most 128"},
    {"markers.cols", kOf<&Scene::markers, &MarkerGrid::cols>, "", 2, 16, "of printed dots"},
    {"markers.pitch_mm", kOf<&Scene::markers, &MarkerGrid::pitch_mm>, "mm", 0.2, 20, "between dots"},

    {"object.name", kOf<&Scene::object, &Object::name>, "", 1, 64, "for reports"},
    {"object.shape", kOf<&Scene::object, &Object::shape, &Shape::kind>, "", 0, 0,
     "of the side that touches; all but sphere and cone are `shapes`", "shapes"},
    {"object.radius_mm", kOf<&Scene::object, &Object::shape, &Shape::radius_mm>, "mm", 0.01, 10'000,
     "sphere, cylinder, disc; ellipsoid along x; crest of an edge", "", 1, false,
     unless_shape<kSphere, kEllipsoid, kCylinder, kDisc, kEdge>},
    {"object.radius_y_mm", kOf<&Scene::object, &Object::shape, &Shape::radius_y_mm>, "mm", 0.01, 10'000,
     "ellipsoid along y", "", 1, false, unless_shape<kEllipsoid>},
    {"object.half_x_mm", kOf<&Scene::object, &Object::shape, &Shape::half_x_mm>, "mm", 0.05, 1000, "half a box along x",
     "", 1, false, unless_shape<kBox>},
    {"object.half_y_mm", kOf<&Scene::object, &Object::shape, &Shape::half_y_mm>, "mm", 0.05, 1000, "half a box along y",
     "", 1, false, unless_shape<kBox>},
    {"object.rim_mm", kOf<&Scene::object, &Object::shape, &Shape::rim_mm>, "mm", 0, 1000,
     "disc, box: radius of the rounded rim, inside the outline", "", 1, false, unless_shape<kDisc, kBox>},
    {"object.flank_deg", kOf<&Scene::object, &Object::shape, &Shape::flank_deg>, "deg", 0.1, 89,
     "cone, edge: slope of the flank against the gel", "", 1, false, unless_shape<kCone, kEdge>},
    {"object.yaw_deg", kOf<&Scene::object, &Object::shape, &Shape::yaw_rad>, "deg", -360, 360,
     "about the normal, before any twist", "", kDegreesPerRadian, false, unless_turnable},
    {"object.tilt_deg", kOf<&Scene::object, &Object::shape, &Shape::tilt_rad>, "deg", -45, 45,
     "disc, box: towards the object's +y", "", kDegreesPerRadian, false, unless_shape<kDisc, kBox>},
    {"object.texture.kind", kOf<&Scene::object, &Object::shape, &Shape::texture>, "", 0, 0,
     "ridges along the object's y, or bumps on a square lattice", "shapes"},
    {"object.texture.height_mm", kOf<&Scene::object, &Object::shape, &Shape::texture_height_mm>, "mm", 0, 10,
     "from valley to crest", "", 1, false, unless_textured},
    {"object.texture.pitch_mm", kOf<&Scene::object, &Object::shape, &Shape::texture_pitch_mm>, "mm", 0.01, 100,
     "from crest to crest", "", 1, false, unless_textured},
    {"object.relief.kind", kOf<&Scene::object, &Object::relief, &Relief::kind>, "", 0, 0,
     "seen in the picture, of no matter to the contact: ridges and bumps as a texture, or random grain", "relief"},
    {"object.relief.height_um", kOf<&Scene::object, &Object::relief, &Relief::height_um>, "um", 0, 500,
     "from valley to crest; of grain 4 times its rms", "", 1, false, unless_relieved},
    {"object.relief.pitch_mm", kOf<&Scene::object, &Object::relief, &Relief::pitch_mm>, "mm", 0.05, 20,
     "from crest to crest; of grain its mean period", "", 1, false, unless_relieved},
    {"object.friction", kOf<&Scene::object, &Object::friction>, "", 0, 100,
     "static; 0.2 to 1.2 are reported for this gel"},
    {"object.kinetic_friction", kOf<&Scene::object, &Object::kinetic_friction>, "", 0, 100,
     "at most the static one, which it is unless given", "kinetic_friction"},
    {"object.bonded", kOf<&Scene::object, &Object::bonded>, "", 0, 0, "nothing ever slips"},
    {"object.compliance_mm_per_n", kOf<&Scene::object, &Object::compliance_mm_per_n>, "mm/N", 0, 1000,
     "of the object, in series with the gel; for closing_mm", "compliance"},
    {"object.mass_g", kOf<&Scene::object, &Object::mass_g>, "g", 0, 1e5,
     "0: follows its drive; else it needs a drive stiffness or a pull", "mass"},
    {"object.touch_x_mm", kOf<&Scene::object, &Object::touch_mm, &Vec2::x>, "mm", -100, 100, "where it touches first"},
    {"object.touch_y_mm", kOf<&Scene::object, &Object::touch_mm, &Vec2::y>, "mm", -100, 100, "where it touches first"},

    {"profile", kOf<&Scene::profile>, "", 0, 0, "between waypoints; minimum jerk is how people move"},
    {"trajectory", {}, "", 1, kMostSceneItems, "what moves the object: waypoints, times rising", "", 1, true},

    {"effects.press_dilation", kOf<&Scene::effects, &Effects::press_dilation>, "", 0, 10,
     "FOTS's outward motion under a press, as a share of the depth", "press_dilation"},
    {"effects.creep_gain", kOf<&Scene::effects, &Effects::creep_gain>, "", 0, 10,
     "share by which a held load goes on deforming the gel", "creep"},
    {"effects.creep_tau_s", kOf<&Scene::effects, &Effects::creep_tau_s>, "s", 0.001, 10'000, "its time constant", "", 1,
     false, unless_creeping},
    {"effects.drive_stiffness_n_per_mm", kOf<&Scene::effects, &Effects::drive_stiffness_n_per_mm>, "N/mm", 0, 1e4,
     "of the arm that moves an object with mass; 0: pull alone", "", 1, false, unless_massive},
    {"effects.damping_n_s_per_mm", kOf<&Scene::effects, &Effects::damping_n_s_per_mm>, "N s/mm", 0, 1e4,
     "of the motion of an object with mass", "", 1, false, unless_massive},
    {"effects.marker_noise_um", kOf<&Scene::effects, &Effects::marker_noise_um>, "um", 0, 1000,
     "sigma of each coordinate, every frame", "marker_noise"},
    {"effects.marker_loss", kOf<&Scene::effects, &Effects::marker_loss>, "", 0, 1,
     "chance of each marker to be missing, every frame", "marker_loss"},
    {"effects.marker_missing", kOf<&Scene::effects, &Effects::marker_missing>, "", 0, kMaxMarkers,
     "dots that were never printed or have worn off", "marker_loss"},
    {"effects.marker_duplicates", kOf<&Scene::effects, &Effects::marker_duplicates>, "", 0, 64,
     "dots beside a printed one", "marker_duplicates"},
    {"effects.fabrication_um", kOf<&Scene::effects, &Effects::fabrication_um>, "um", 0, 1000,
     "sigma of where each dot was printed", "fabrication"},
    {"effects.fabrication_turn_deg", kOf<&Scene::effects, &Effects::fabrication_turn_deg>, "deg", -45, 45,
     "of the whole print", "fabrication"},
    {"effects.pixel_noise", kOf<&Scene::effects, &Effects::pixel_noise>, "levels", 0, 64, "sigma", "pixel_noise"},
    {"effects.dirt_specks", kOf<&Scene::effects, &Effects::dirt_specks>, "", 0, 1000,
     "dark specks that stay where they are", "dirt"},
    {"effects.light_drift_levels_per_s", kOf<&Scene::effects, &Effects::light_drift_levels_per_s>, "levels/s", -255,
     255, "of the whole picture", "light"},
    {"effects.light_flicker_levels", kOf<&Scene::effects, &Effects::light_flicker_levels>, "levels", 0, 255,
     "amplitude at 100 Hz, as the frame rate aliases it", "light"},
    {"effects.exposure_ms", kOf<&Scene::effects, &Effects::exposure_ms>, "ms", 0, 1000, "motion blur", "exposure"},
    {"effects.rolling_shutter_ms", kOf<&Scene::effects, &Effects::rolling_shutter_ms>, "ms", 0, 1000,
     "from the first row to the last", "rolling_shutter"},
    {"effects.worn_gel", kOf<&Scene::effects, &Effects::worn_gel>, "", 0, 1,
     "0 new .. 1: dots lose contrast in patches", "worn_gel"},
    {"effects.dot_shading_levels", kOf<&Scene::effects, &Effects::dot_shading_levels>, "levels", 0, 60,
     "of a dot's rim that faces a lamp", "dot_shading"},
    {"effects.gel_margins", kOf<&Scene::effects, &Effects::gel_margins>, "", 0, 0,
     "dark frame around the pad of 25.25 x 20.75 mm", "gel_margins"},

    {"faults", {}, "", 0, kMostSceneItems, "of the camera"},

    {"picture.width", kOfWidth, "px", 64, 3280, "410 for grey and 3280 for jpeg unless given"},
    {"picture.background", kOf<&Scene::picture, &Picture::background>, "levels", 0, 255, "luma of the middle"},
    {"picture.dot_level", kOf<&Scene::picture, &Picture::dot_level>, "levels", 0, 255, "luma of a dot"},
    {"picture.shading", kOf<&Scene::picture, &Picture::shading>, "levels", 0, 255, "from the middle to the side"},
    {"picture.imprint_gain", kOf<&Scene::picture, &Picture::imprint_gain>, "levels", 0, 1000,
     "per unit of slope of the gel's surface"},
    {"picture.wall_gain", kOf<&Scene::picture, &Picture::wall_gain>, "levels", 0, 1000,
     "each lamp's, per unit of slope that faces it; nothing for slopes that face away"},
    {"picture.specular", kOf<&Scene::picture, &Picture::specular>, "levels", 0, 255,
     "highlight where a wall mirrors a lamp: a slope of about 0.3 towards it"},
    {"picture.shadow", kOf<&Scene::picture, &Picture::shadow>, "levels", 0, 255,
     "less light, with a sharp edge, where a wall faces away from a lamp by more than 0.1"},
    {"picture.jpeg_quality", kOf<&Scene::picture, &Picture::jpeg_quality>, "", 1, 100, "as libjpeg counts"},

    {"expect.onset_s", kOf<&Scene::expect, &Expect::onset_s>, "s", 0, kMostSeconds,
     "[from, to] of the truth's onset: when more than half of the contact slips"},
    {"expect.no_onset", kOf<&Scene::expect, &Expect::no_onset>, "", 0, 0, "the truth has no onset"},
    {"expect.max_delay_ms", kOf<&Scene::expect, &Expect::max_delay_ms>, "ms", 0, 1e6,
     "firmware: slip after the truth's onset"},
    {"expect.false_alarms", kOf<&Scene::expect, &Expect::false_alarms>, "", 0, 1e6,
     "firmware: most rises of slip before the onset, or at all without one"},
    {"expect.final_state", kOfState<&Scene::expect, &Expect::final_state>, "", 0, 0,
     "firmware: state after the last frame"},
    {"expect.entropy", {}, "", 0, kMostSceneItems, "firmware: mean of E over times"},

    {"goal.max_delay_ms", kOf<&Scene::goal, &Goal::max_delay_ms>, "ms", 0, 1e6,
     "not reached yet; below the promise of that name"},
    {"goal.false_alarms", kOf<&Scene::goal, &Goal::false_alarms>, "", 0, 1e6,
     "not reached yet; below the promise of that name"},
    {"goal.final_state", kOfState<&Scene::goal, &Goal::final_state>, "", 0, 0,
     "not reached yet; instead of a promise of that name"},
});

constexpr auto kWaypointFields = std::to_array<Field<Waypoint>>({
    {"t_s", member<Waypoint, &Waypoint::t_s>(), "s", 0, kMostSeconds, "rising", "", 1, true},
    {"depth_mm", member<Waypoint, &Waypoint::depth_mm>(), "mm", -100, 100,
     "of the lowest point below the gel's surface; 0 and less: no contact", "press"},
    {"force_n", member<Waypoint, &Waypoint::force_n>(), "N", 0, 10'000, "normal, instead of depth", "press"},
    {"closing_mm", member<Waypoint, &Waypoint::closing_mm>(), "mm", -100, 100,
     "of the gripper since first touch, instead of depth: object and gel in series", "press"},
    {"x_mm", member<Waypoint, &Waypoint::x_mm>(), "mm", -1000, 1000, "from the place of first touch", "shear"},
    {"y_mm", member<Waypoint, &Waypoint::y_mm>(), "mm", -1000, 1000, "from the place of first touch", "shear"},
    {"twist_deg", member<Waypoint, &Waypoint::twist_deg>(), "deg", -3600, 3600, "about the normal, +x towards +y",
     "twist"},
    {"pull_x_n", member<Waypoint, &Waypoint::pull_x_n>(), "N", -10'000, 10'000, "on an object with mass", "pull"},
    {"pull_y_n", member<Waypoint, &Waypoint::pull_y_n>(), "N", -10'000, 10'000, "on an object with mass", "pull"},
});

constexpr auto kFaultFields = std::to_array<Field<FaultEvent>>({
    {"t_s", member<FaultEvent, &FaultEvent::t_s>(), "s", 0, kMostSeconds, "of the first frame that it takes", "", 1,
     true},
    {"frames", member<FaultEvent, &FaultEvent::frames>(), "", 1, 1e6, "how many it takes"},
    {"fault", member<FaultEvent, &FaultEvent::fault>(), "", 0, 0, "off: the sensor sends nothing", "camera_faults", 1,
     true},
    {"by_ms", member<FaultEvent, &FaultEvent::by_ms>(), "ms", 0, 60'000, "late, backwards", "", 1, false,
     unless_shifted},
});

constexpr auto kEntropyFields = std::to_array<Field<Expect::Entropy>>({
    {"from_s", member<Expect::Entropy, &Expect::Entropy::from_s>(), "s", 0, kMostSeconds, "of the time", "", 1, true},
    {"to_s", member<Expect::Entropy, &Expect::Entropy::to_s>(), "s", 0, kMostSeconds, "of the time", "", 1, true},
    {"least_nat", member<Expect::Entropy, &Expect::Entropy::least_nat>(), "nat", 0, 3, "of the mean of E", "", 1, true},
    {"most_nat", member<Expect::Entropy, &Expect::Entropy::most_nat>(), "nat", 0, 3, "of the mean of E", "", 1, true},
});

// Kinds of records in lists, by the path of the list.
template <typename Visit>
void for_each_list(Visit visit) {
  visit(
      "trajectory", std::span<const Field<Waypoint>>(kWaypointFields),
      [](auto& scene) -> auto& { return scene.trajectory; });
  visit(
      "faults", std::span<const Field<FaultEvent>>(kFaultFields), [](auto& scene) -> auto& { return scene.faults; });
  visit(
      "expect.entropy", std::span<const Field<Expect::Entropy>>(kEntropyFields),
      [](auto& scene) -> auto& { return scene.expect.entropy; });
}

template <typename Record>
std::string allowed(const Field<Record>& field) {
  const std::string unit = field.unit.empty() ? "" : " " + std::string(field.unit);
  const std::string range = shown(field.least) + " .. " + shown(field.most);
  switch (field.access.type) {
    case Type::kNumber:
      return "a number " + range + unit;
    case Type::kWhole:
      return "a whole number " + range + unit;
    case Type::kSeed:
      return "a whole number 0 .. 18446744073709551615";
    case Type::kFlag:
      return "true or false";
    case Type::kName:
      return range + " characters of a-z, 0-9 and _";
    case Type::kText:
      return "a line of " + range + " characters";
    case Type::kChoice:
      return "\"" + joined(field.access.names, "\", \"") + "\"";
    case Type::kTwoNumbers:
      return "[from, to], each a number " + range + unit;
    case Type::kList:
      return "a list of " + range + " entries";
  }
  return "";
}

// The number of the file that stands for a member: the shortest that gives the member again, or its neighbour where
// there is none.
double in_file(double member, double per_member) {
  if (per_member == 1.0) return member;
  const double exact = member * per_member;
  std::array<char, 32> buffer{};
  for (int digits = 1; digits <= std::numeric_limits<double>::max_digits10; ++digits) {
    double candidate = 0.0;
    const auto end = std::to_chars(buffer.begin(), buffer.end(), exact, std::chars_format::scientific, digits - 1);
    std::from_chars(buffer.begin(), end.ptr, candidate);
    if (candidate / per_member == member) return candidate;
  }
  for (const double towards : {0.0, std::numeric_limits<double>::infinity() * exact}) {
    const double candidate = std::nextafter(exact, towards);
    if (candidate / per_member == member) return candidate;
  }
  return exact;
}

// A field's value as JSON; empty: not given.
template <typename Record>
std::string text_of(const Field<Record>& field, const Record& record) {
  const Value value = field.access.get(record);
  if (const auto* number = std::get_if<double>(&value)) return shown(in_file(*number, field.per_member));
  if (const auto* whole = std::get_if<std::int64_t>(&value)) {
    if (field.access.type != Type::kChoice) return std::to_string(*whole);
    return "\"" + std::string(field.access.names[static_cast<std::size_t>(*whole)]) + "\"";
  }
  if (const auto* seed = std::get_if<std::uint64_t>(&value)) return std::to_string(*seed);
  if (const auto* flag = std::get_if<bool>(&value)) return *flag ? "true" : "false";
  if (const auto* both = std::get_if<std::array<double, 2>>(&value)) {
    return "[" + shown((*both)[0]) + ", " + shown((*both)[1]) + "]";
  }
  if (const auto* text = std::get_if<std::string>(&value)) {
    return nlohmann::json(*text).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  }
  return "";
}

// --- What a scene uses ---

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

bool varies(const Channel& knots) {
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

constexpr std::array kNormals{&Waypoint::depth_mm, &Waypoint::force_n, &Waypoint::closing_mm};

// The normal direction, by whichever of its channels the scene has.
Channel normal_channel(const Scene& scene) {
  for (const auto normal : kNormals) {
    if (Channel knots = channel(scene, normal); !knots.empty()) return knots;
  }
  return {};
}

bool pressed(const Scene& scene) {
  return std::ranges::any_of(normal_channel(scene), [](const Knot& knot) { return knot.value > 0.0; });
}

bool pulled(const Scene& scene) {
  return std::ranges::any_of(scene.trajectory, [](const Waypoint& point) {
    return point.pull_x_n.value_or(0.0) != 0.0 || point.pull_y_n.value_or(0.0) != 0.0;
  });
}

bool sheared(const Scene& scene) {
  return pressed(scene) &&
         (varies(channel(scene, &Waypoint::x_mm)) || varies(channel(scene, &Waypoint::y_mm)) || pulled(scene));
}

bool twisted(const Scene& scene) {
  return pressed(scene) && varies(channel(scene, &Waypoint::twist_deg));
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
  const Scene standard;
  return std::ranges::any_of(kSceneFields, [&](const Field<Scene>& field) {
    return field.capability == capability && field.access.get(scene) != field.access.get(standard);
  });
}

std::vector<std::string_view> levels_that_can(const Capability& capability) {
  std::vector<std::string_view> names;
  for (std::size_t i = 0; i < kContactLevelNames.size(); ++i) {
    if (can(static_cast<ContactLevel>(i), capability)) names.push_back(kContactLevelNames[i]);
  }
  return names;
}

const Capability* find_capability(std::string_view name) {
  const auto* found = std::ranges::find(kCapabilities, name, &Capability::name);
  return found == kCapabilities.end() ? nullptr : found;
}

// Fields that only a picture shows.
bool needs_picture(std::string_view path) {
  constexpr std::array<std::string_view, 10> kEffects{
      "effects.pixel_noise",          "effects.marker_duplicates",
      "effects.dot_shading_levels",   "effects.gel_margins",
      "effects.dirt_specks",          "effects.light_drift_levels_per_s",
      "effects.light_flicker_levels", "effects.exposure_ms",
      "effects.rolling_shutter_ms",   "effects.worn_gel"};
  return path.starts_with("picture.") || path.starts_with("object.relief.") ||
         std::ranges::find(kEffects, path) != kEffects.end();
}

// --- Tree to scene ---

constexpr std::string_view kTypo = "a typing error";

class Reader {
 public:
  Reader(const Node& root, Problems& problems, Problems& warnings)
      : root_(root), problems_(problems), warnings_(warnings) {}

  Scene read() {
    Scene scene;
    read_record<Scene>(root_, "", kSceneFields, scene);
    if (root_.kind != Node::Kind::kObject) return scene;
    read_requires(scene);
    for_each_list([&](std::string_view path, auto fields, auto list) { read_list(path, fields, list(scene)); });
    check_sizes(scene);
    check_trajectory(scene);
    check_mass(scene);
    check_expect(scene);
    check_goal(scene);
    // A value that could not be read would make a scene that nobody wrote.
    if (problems_.count() == 0) check_capabilities(scene);
    if (problems_.count() == 0) warn(scene);
    return scene;
  }

 private:
  using Siblings = std::vector<std::string_view>;

  [[nodiscard]] int line_at(std::string_view path) const {
    for (;;) {
      if (const Node* node = find(root_, path)) return node->line;
      const auto dot = path.rfind('.');
      if (dot == std::string_view::npos) return root_.line;
      path = path.substr(0, dot);
    }
  }
  // No value at or below these paths was refused: what is said about them together would be about other values.
  [[nodiscard]] bool sound(std::initializer_list<std::string_view> paths) const {
    return std::ranges::none_of(bad_, [&](std::string_view bad) {
      return std::ranges::any_of(paths, [&](std::string_view path) { return bad.starts_with(path); });
    });
  }
  [[nodiscard]] bool given(std::string_view path) const { return find(root_, path) != nullptr; }

  static std::string pair(std::string_view path, const Node& node) {
    return "('" + std::string(path) + "': " + shown(node) + ")";
  }

  // The words that may stand after `prefix` in a path.
  template <typename Record>
  static Siblings words_below(std::string_view prefix, std::span<const Field<Record>> fields) {
    Siblings words;
    for (const Field<Record>& field : fields) {
      if (!field.path.starts_with(prefix)) continue;
      const std::string_view rest = field.path.substr(prefix.size());
      const std::string_view word = rest.substr(0, rest.find('.'));
      if (words.empty() || words.back() != word) words.push_back(word);
    }
    return words;
  }

  // Keys that are no field, and sections that are no object.
  template <typename Record>
  void check_keys(const Node& object, const std::string& shown_prefix, const std::string& prefix,
                  std::span<const Field<Record>> fields) {
    const Siblings words = words_below<Record>(prefix, fields);
    for (const Node& child : object.children) {
      const std::string path = prefix + child.key;
      const std::string shown_path = shown_prefix + printable(child.key);
      if (std::ranges::find(words, child.key) == words.end()) {
        unknown_key<Record>(child, shown_path, words, fields);
      } else if (std::ranges::find(fields, path, &Field<Record>::path) == fields.end()) {
        if (child.kind == Node::Kind::kObject) {
          check_keys<Record>(child, shown_path + ".", path + ".", fields);
        } else {
          problems_.add(child.line, "wrong kind of value " + pair(shown_path, child) + ", allowed an object {...}",
                        "a value in the place of a section",
                        "give the keys of this section: " + joined(words_below<Record>(path + ".", fields)));
        }
      }
    }
  }

  template <typename Record>
  void unknown_key(const Node& child, const std::string& shown_path, const Siblings& words,
                   std::span<const Field<Record>> fields) {
    std::string what = "unknown key " + pair(shown_path, child);
    const auto elsewhere =
        std::ranges::find_if(fields, [&](const Field<Record>& field) { return field.path.ends_with("." + child.key); });
    const std::string_view near = nearest(child.key, words);
    if (elsewhere != fields.end()) {
      const std::string home(elsewhere->path.substr(0, elsewhere->path.rfind('.')));
      problems_.add(child.key_line, what, "it belongs into another section", "move it into '" + home + "'");
    } else if (!near.empty()) {
      what += ", nearest is '" + std::string(near) + "'";
      problems_.add(child.key_line, what, kTypo, "write '" + std::string(near) + "', or leave the key out");
    } else {
      problems_.add(child.key_line, what + ", allowed here: " + joined(words), "a key of another version or tool",
                    "leave it out");
    }
  }

  template <typename Record>
  void read_record(const Node& object, const std::string& at,
                   std::type_identity_t<std::span<const Field<Record>>> fields, Record& record) {
    if (object.kind != Node::Kind::kObject) {
      problems_.add(
          object.line,
          "wrong kind of value (" + (at.empty() ? "" : "'" + at + "': ") + shown(object) + "), allowed an object {...}",
          "brackets of another kind, or none", "put the keys between { and }");
      return;
    }
    const std::string prefix = at.empty() ? "" : at + ".";
    check_keys<Record>(object, prefix, "", fields);
    for (const Field<Record>& field : fields) {
      const Node* node = find(object, field.path);
      if (node != nullptr) {
        if (field.access.type != Type::kList) read_field(*node, prefix + std::string(field.path), field, record);
      } else if (field.required) {
        problems_.add(object.line, "no '" + prefix + std::string(field.path) + "', required: " + allowed(field),
                      "it was forgotten, or is misspelt", "add \"" + std::string(field.path) + "\"");
      }
    }
    check_idle<Record>(object, prefix, fields, record);
  }

  template <typename Record>
  void read_field(const Node& node, const std::string& path, const Field<Record>& field, Record& record) {
    const auto refuse = [&](const std::string& what, std::string_view cause, const std::string& next) {
      problems_.add(node.line, what, cause, next);
      bad_.push_back(path);
    };
    const std::string may = ", allowed " + allowed(field);
    const auto wrong_kind = [&] {
      refuse("wrong kind of value " + pair(path, node) + may, "quotes too many or too few, or another key was meant",
             "give a value of that kind");
    };
    const auto in_range = [&](const Node& number) {
      if (number.number >= field.least && number.number <= field.most) return true;
      if (field.least == field.most) {
        refuse("unknown version " + pair(path, number) + ", allowed " + shown(field.most), "a scene for another build",
               "take a build that knows it, or write the scene anew (tests/scenes/README.md)");
        return false;
      }
      refuse("out of range " + pair(path, number) + may, "another unit, or a typing error",
             "give a value in that range");
      return false;
    };
    switch (field.access.type) {
      case Type::kNumber:
        if (node.kind != Node::Kind::kNumber) return wrong_kind();
        if (in_range(node)) field.access.set(record, node.number / field.per_member);
        return;
      case Type::kWhole:
      case Type::kSeed:
        if (node.kind != Node::Kind::kNumber) return wrong_kind();
        if (node.number != std::trunc(node.number)) {
          return refuse("not a whole number " + pair(path, node) + may, kTypo, "round it");
        }
        if (!in_range(node)) return;
        if (!node.whole) {  // beyond 2^53 but written as a fraction, or 2^64 itself
          return refuse("out of range " + pair(path, node) + may, kTypo, "give a value in that range");
        }
        if (field.access.type == Type::kSeed) return field.access.set(record, node.seed);
        return field.access.set(record, static_cast<std::int64_t>(node.seed));
      case Type::kFlag:
        if (node.kind != Node::Kind::kFlag) return wrong_kind();
        return field.access.set(record, node.flag);
      case Type::kName:
      case Type::kText: {
        if (node.kind != Node::Kind::kText) return wrong_kind();
        const bool name = field.access.type == Type::kName;
        const auto fits = [&](char c) {
          const bool word = (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_';
          return name ? word : c >= ' ' && c <= '~';
        };
        const auto size = static_cast<double>(node.text.size());
        if (size < field.least || size > field.most || !std::ranges::all_of(node.text, fits)) {
          return refuse("cannot be used " + pair(path, node) + may,
                        name ? "capitals, blanks or signs" : "too long, or not plain ASCII", "write it in that form");
        }
        return field.access.set(record, node.text);
      }
      case Type::kChoice: {
        if (node.kind != Node::Kind::kText) return wrong_kind();
        const auto found = std::ranges::find(field.access.names, node.text);
        if (found != field.access.names.end()) {
          return field.access.set(record, std::int64_t{found - field.access.names.begin()});
        }
        if (field.path == "level.contact" &&
            std::ranges::find(kGoneContactLevels, node.text) != kGoneContactLevels.end()) {
          return refuse("this level is gone " + pair(path, node) + may, "a scene of an earlier version",
                        "write \"springs\", which is as fast and models all that " + node.text + " did");
        }
        const std::string near(nearest(node.text, field.access.names));
        return refuse("unknown value " + pair(path, node) + may + (near.empty() ? "" : "; nearest is \"" + near + "\""),
                      kTypo, near.empty() ? "choose one of them" : "write \"" + near + "\"");
      }
      case Type::kTwoNumbers: {
        const auto is_number = [](const Node& child) { return child.kind == Node::Kind::kNumber; };
        if (node.kind != Node::Kind::kList || node.children.size() != 2 ||
            !std::ranges::all_of(node.children, is_number)) {
          return wrong_kind();
        }
        if (!in_range(node.children[0]) || !in_range(node.children[1])) return;
        return field.access.set(record, std::array{node.children[0].number, node.children[1].number});
      }
      case Type::kList:
        return;
    }
  }

  // Keys that mean nothing beside the others.
  template <typename Record>
  void check_idle(const Node& object, const std::string& prefix, std::span<const Field<Record>> fields,
                  const Record& record) {
    for (const Field<Record>& field : fields) {
      const Node* node = field.idle != nullptr ? find(object, field.path) : nullptr;
      if (node == nullptr) continue;
      const std::string_view whose = field.idle(record);
      if (whose.empty() ||
          !sound({prefix + std::string(field.path.substr(0, field.path.find('.'))), "object.mass_g"})) {
        continue;
      }
      const auto dot = field.path.rfind('.');
      const std::string_view section = dot == std::string_view::npos ? "" : field.path.substr(0, dot + 1);
      const bool of_shape = std::ranges::find(kShapeWords, whose) != kShapeWords.end();
      Siblings used;
      for (const Field<Record>& other : fields) {
        const bool sibling =
            other.path.starts_with(section) && other.path.find('.', section.size()) == std::string_view::npos;
        if (of_shape && sibling && other.idle != nullptr && other.idle(record).empty()) {
          used.push_back(other.path.substr(section.size()));
        }
      }
      problems_.add(node->key_line,
                    "not used by " + std::string(whose) + " " + pair(prefix + std::string(field.path), *node) +
                        (used.empty() ? "" : "; keys of " + std::string(whose) + ": " + joined(used)),
                    "it is left from another scene", "leave it out");
    }
  }

  void read_requires(Scene& scene) {
    const Node* list = find(root_, "requires");
    if (list == nullptr) return;
    if (!is_list("requires", *list)) return;
    constexpr auto kNames = [] {
      std::array<std::string_view, kCapabilities.size()> names;
      for (std::size_t i = 0; i < names.size(); ++i) names[i] = kCapabilities[i].name;
      return names;
    }();
    for (const Node& item : list->children) {
      if (item.kind != Node::Kind::kText) {
        problems_.add(item.line, "wrong kind of value " + pair("requires", item) + ", allowed the name of a capability",
                      "quotes are missing", "give names in quotes");
      } else if (find_capability(item.text) == nullptr) {
        const std::string near(nearest(item.text, kNames));
        problems_.add(item.line,
                      "this build has no such capability " + pair("requires", item) +
                          (near.empty() ? ", allowed: " + joined(kNames) : ", nearest is \"" + near + "\""),
                      "a typing error, or a scene of a later version",
                      near.empty() ? "leave it out, or take a build that has it" : "write \"" + near + "\"");
      } else if (std::ranges::find(scene.needs, item.text) != scene.needs.end()) {
        problems_.add(item.line, "capability given twice " + pair("requires", item), kTypo, "remove one of the two");
      } else {
        scene.needs.push_back(item.text);
      }
    }
  }

  bool is_list(std::string_view path, const Node& node) {
    if (node.kind == Node::Kind::kList) return true;
    problems_.add(node.line, "wrong kind of value " + pair(path, node) + ", allowed a list [...]",
                  "brackets of another kind, or none", "put the entries between [ and ]");
    return false;
  }

  template <typename Record>
  void read_list(std::string_view path, std::span<const Field<Record>> fields, std::vector<Record>& out) {
    const Node* list = find(root_, path);
    if (list == nullptr || !is_list(path, *list)) return;
    for (std::size_t i = 0; i < list->children.size(); ++i) {
      read_record<Record>(list->children[i], std::string(path) + "[" + std::to_string(i) + "]", fields,
                          out.emplace_back());
    }
  }

  // --- What no single value tells ---

  void check_sizes(const Scene& scene) {
    if (scene.duration_s * scene.fps > kMostSceneFrames) {
      problems_.add(line_at("duration_s"),
                    "too many frames ('duration_s' x 'fps' = " + shown(scene.duration_s * scene.fps) + "), allowed " +
                        shown(kMostSceneFrames),
                    "another unit, or a typing error", "make the scene shorter");
    }
    const int count = scene.markers.rows * scene.markers.cols;
    if (count > kMaxMarkers) {
      problems_.add(
          line_at("markers"),
          "too many markers ('rows' x 'cols' = " + std::to_string(count) + "), allowed " + std::to_string(kMaxMarkers),
          kTypo, "give a smaller grid");
    }
    if (scene.effects.marker_missing > count && sound({"markers"})) {
      problems_.add(line_at("effects.marker_missing"),
                    "more dots are missing ('effects.marker_missing': " + std::to_string(scene.effects.marker_missing) +
                        ") than there are, allowed 0 .. " + std::to_string(count),
                    kTypo, "give a smaller number");
    }
    const Shape& shape = scene.object.shape;
    const double half = shape.kind == kDisc ? shape.radius_mm : std::min(shape.half_x_mm, shape.half_y_mm);
    if ((shape.kind == kDisc || shape.kind == kBox) && shape.rim_mm > half && sound({"object"})) {
      problems_.add(line_at("object.rim_mm"),
                    "the rim is wider than the object ('object.rim_mm': " + shown(shape.rim_mm) + "), allowed 0 .. " +
                        shown(half) + " mm here",
                    "a small object with the default rim", "give a smaller rim_mm");
    }
    if (scene.object.kinetic_friction && scene.object.bonded) {
      problems_.add(
          line_at("object.kinetic_friction"),
          "not used by a bonded object ('object.kinetic_friction': " + shown(*scene.object.kinetic_friction) + ")",
          "it is left from another scene", "leave it out");
    } else if (scene.object.kinetic_friction.value_or(0.0) > scene.object.friction && sound({"object.friction"})) {
      problems_.add(line_at("object.kinetic_friction"),
                    "kinetic friction is above the static one ('object.kinetic_friction': " +
                        shown(*scene.object.kinetic_friction) + "), allowed 0 .. " + shown(scene.object.friction),
                    "the two were exchanged", "exchange friction and kinetic_friction");
    }
  }

  void check_trajectory(const Scene& scene) {
    const Node* list = find(root_, "trajectory");
    if (list == nullptr || list->kind != Node::Kind::kList) return;
    if (list->children.empty()) {
      problems_.add(list->line, "no waypoint ('trajectory': [])", "the script was forgotten",
                    "add {\"t_s\": 0} for an empty gel, or what moves the object");
    }
    const Node* first_normal = nullptr;
    double last_s = -1.0;
    for (std::size_t i = 0; i < list->children.size(); ++i) {
      const Node& point = list->children[i];
      const std::string at = "trajectory[" + std::to_string(i) + "]";
      const Node* time = find(point, "t_s");
      if (time != nullptr && time->kind == Node::Kind::kNumber) {
        if (time->number <= last_s) {
          problems_.add(time->line,
                        "times do not rise " + pair(at + ".t_s", *time) + ", allowed above " + shown(last_s),
                        "waypoints in another order, or twice", "put the waypoints in the order of time");
        } else if (time->number > scene.duration_s && scene.duration_s > 0.0) {
          problems_.add(time->line,
                        "a waypoint after the end " + pair(at + ".t_s", *time) + ", allowed up to duration_s, " +
                            shown(scene.duration_s) + " s",
                        "the scene was made shorter", "raise duration_s, or drop the waypoint");
        }
        last_s = std::max(last_s, time->number);
      }
      for (const std::string_view word : {"depth_mm", "force_n", "closing_mm"}) {
        const Node* normal = find(point, word);
        if (normal == nullptr) continue;
        if (first_normal == nullptr) first_normal = normal;
        if (normal->key == first_normal->key) continue;
        problems_.add(normal->key_line,
                      "two ways to press " + pair(at + "." + std::string(word), *normal) +
                          ", allowed one of depth_mm, force_n and closing_mm in the whole scene; line " +
                          std::to_string(first_normal->key_line) + " has '" + first_normal->key + "'",
                      "parts of two scenes", "keep one of the two");
      }
    }
    for (std::size_t i = 0; i < scene.faults.size(); ++i) {
      if (scene.faults[i].t_s <= scene.duration_s || !(scene.duration_s > 0.0)) continue;
      problems_.add(line_at("faults"),
                    "a fault after the end ('faults[" + std::to_string(i) + "].t_s': " + shown(scene.faults[i].t_s) +
                        "), allowed up to duration_s, " + shown(scene.duration_s) + " s",
                    "the scene was made shorter", "raise duration_s, or drop the fault");
    }
  }

  void check_mass(const Scene& scene) {
    const bool massive = scene.object.mass_g > 0.0;
    if (!sound({"object.mass_g", "effects.drive_stiffness_n_per_mm", "trajectory"})) return;
    if (pulled(scene) && !massive) {
      problems_.add(line_at("trajectory"), "a pull (pull_x_n, pull_y_n) needs a mass", "the mass was forgotten",
                    "add \"mass_g\" to the object");
    }
    if (massive && !pulled(scene) && !(scene.effects.drive_stiffness_n_per_mm > 0.0)) {
      problems_.add(line_at("object.mass_g"),
                    "nothing moves an object with mass ('object.mass_g': " + shown(scene.object.mass_g) + ")",
                    "the drive was forgotten",
                    "add \"drive_stiffness_n_per_mm\" to the effects, or pull_x_n or pull_y_n to a waypoint");
    }
  }

  void check_expect(const Scene& scene) {
    const Expect& expect = scene.expect;
    const auto window = [&](const std::string& path, int line, double from_s, double to_s) {
      if ((from_s < to_s && to_s <= scene.duration_s) || !(scene.duration_s > 0.0) || !sound({path})) return;
      problems_.add(line,
                    "not a time of the scene ('" + path + "': " + shown(from_s) + " .. " + shown(to_s) +
                        "), allowed from < to, up to duration_s, " + shown(scene.duration_s) + " s",
                    "the two were exchanged, or the scene was made shorter", "correct the times");
    };
    if (expect.onset_s) {
      window("expect.onset_s", line_at("expect.onset_s"), expect.onset_s->from_s, expect.onset_s->to_s);
    }
    if (expect.no_onset) {
      for (const std::string path : {"expect.onset_s", "expect.max_delay_ms", "goal.max_delay_ms"}) {
        if (!given(path)) continue;
        problems_.add(line_at(path), "contradicts 'expect.no_onset': true ('" + path + "')", "parts of two scenes",
                      "keep one of the two");
      }
    }
    for (std::size_t i = 0; i < expect.entropy.size(); ++i) {
      const Expect::Entropy& entropy = expect.entropy[i];
      const std::string path = "expect.entropy[" + std::to_string(i) + "]";
      const int line = find(root_, "expect.entropy")->children[i].line;
      window(path, line, entropy.from_s, entropy.to_s);
      if (entropy.least_nat > entropy.most_nat) {
        problems_.add(line,
                      "least is above most ('" + path + "': " + shown(entropy.least_nat) + " .. " +
                          shown(entropy.most_nat) + " nat)",
                      "the two were exchanged", "exchange least_nat and most_nat");
      }
    }
  }

  // A goal that is no more than what is promised is none.
  void check_goal(const Scene& scene) {
    const auto below = [&](const std::string& what, auto goal, auto promise, const std::string& unit) {
      const std::string path = "goal." + what;
      if (!goal || !promise || *goal < *promise || !sound({path, "expect." + what})) return;
      problems_.add(line_at(path),
                    "the goal asks no more than the promise ('" + path + "': " + shown(*goal) +
                        "), allowed below 'expect." + what + "', " + shown(*promise) + unit,
                    "the goal was reached, or the two were exchanged", "give a smaller goal, or leave it out");
    };
    below("max_delay_ms", scene.goal.max_delay_ms, scene.expect.max_delay_ms, " ms");
    below("false_alarms", scene.goal.false_alarms, scene.expect.false_alarms, "");
    if (!scene.goal.final_state.empty() && !scene.expect.final_state.empty()) {
      problems_.add(line_at("goal.final_state"),
                    "a state is promised already ('goal.final_state': \"" + scene.goal.final_state +
                        "\"; 'expect.final_state': \"" + scene.expect.final_state + "\")",
                    "the goal was reached, or parts of two scenes", "keep one of the two");
    }
  }

  // The line that switches a capability on, as far as one does.
  [[nodiscard]] std::pair<int, std::string> origin(std::string_view capability) const {
    for (const Field<Scene>& field : kSceneFields) {
      if (field.capability == capability && given(field.path)) return {line_at(field.path), std::string(field.path)};
    }
    std::pair<int, std::string> found{root_.line, ""};
    for_each_list([&](std::string_view path, auto fields, auto /*list*/) {
      const Node* list = find(root_, path);
      if (list == nullptr || !found.second.empty()) return;
      for (const auto& field : fields) {
        if (field.capability != capability) continue;
        for (const Node& entry : list->children) {
          const Node* node = find(entry, field.path);
          if (node == nullptr || !found.second.empty()) continue;
          found = {node->line, std::string(path) + "[]." + std::string(field.path)};
        }
      }
    });
    if (found.second.empty()) found = {line_at("trajectory"), ""};
    return found;
  }

  void check_capabilities(const Scene& scene) {
    const std::vector<std::string_view> used = used_capabilities(scene);
    const std::string_view level = kContactLevelNames[static_cast<std::size_t>(scene.level.contact)];
    Siblings unnamed;
    for (const Capability& capability : kCapabilities) {
      const bool is_used = std::ranges::find(used, capability.name) != used.end();
      const bool named = std::ranges::find(scene.needs, capability.name) != scene.needs.end();
      if ((is_used || named) && !can(scene.level.contact, capability)) {
        const auto [line, path] = origin(capability.name);
        const bool tells = is_used && !path.empty();
        problems_.add(is_used ? line : line_at("requires"),
                      "level " + std::string(level) + " cannot do " + std::string(capability.name) + " (" +
                          std::string(capability.help) + (tells ? "; '" + path + "'" : "") +
                          "), allowed levels: " + joined(levels_that_can(capability)),
                      "the scene was written for another level",
                      "choose one of these as level.contact, or leave " + std::string(capability.name) + " out");
      } else if (is_used && !named) {
        unnamed.push_back(capability.name);
      }
    }
    if (unnamed.empty()) return;
    const auto [line, path] = origin(unnamed.front());
    problems_.add(
        given("requires") ? line_at("requires") : line,
        "the scene uses " + joined(unnamed) + ": say so in 'requires'" + (path.empty() ? "" : " ('" + path + "' does)"),
        "it was changed and 'requires' was not", R"(write "requires": [")" + joined(used, "\", \"") + "\"]");
  }

  // Allowed, but without effect.
  void warn(const Scene& scene) {
    const auto idle = [&](int line, const std::string& what, std::string_view cause, const std::string& next) {
      warnings_.add(line, what, cause, next);
    };
    const std::vector<std::string_view> used = used_capabilities(scene);
    for (const std::string& need : scene.needs) {
      if (std::ranges::find(used, need) != used.end()) continue;
      idle(line_at("requires"), "unused: nothing in the scene uses \"" + need + "\"", "it was left from another scene",
           "leave it out of 'requires'");
    }
    if (scene.level.inject != Inject::kGrey && scene.level.inject != Inject::kJpeg) {
      for (const Field<Scene>& field : kSceneFields) {
        if (!needs_picture(field.path) || !given(field.path)) continue;
        idle(line_at(field.path), "unused: '" + std::string(field.path) + "' needs a picture",
             "level.inject is " + std::string(kInjectNames[static_cast<std::size_t>(scene.level.inject)]),
             R"(inject "grey" or "jpeg", or leave it out)");
      }
      if (!scene.faults.empty()) {
        idle(line_at("faults"), "unused: 'faults' are a camera's",
             "level.inject is " + std::string(kInjectNames[static_cast<std::size_t>(scene.level.inject)]),
             R"(inject "grey" or "jpeg", or leave them out)");
      }
    } else if (scene.effects.marker_noise_um > 0.0) {
      idle(line_at("effects.marker_noise_um"), "unused: 'effects.marker_noise_um' is of tracked markers",
           "a picture has pixel_noise instead", R"(inject "markers" or "features", or leave it out)");
    }
    if (scene.object.compliance_mm_per_n > 0.0 && channel(scene, &Waypoint::closing_mm).empty()) {
      idle(line_at("object.compliance_mm_per_n"), "unused: 'object.compliance_mm_per_n' acts on closing_mm alone",
           "the trajectory presses by depth or force", "press by closing_mm, or leave it out");
    }
    const bool moves = varies(channel(scene, &Waypoint::x_mm)) || varies(channel(scene, &Waypoint::y_mm)) ||
                       varies(channel(scene, &Waypoint::twist_deg));
    if (moves && !pressed(scene)) {
      idle(line_at("trajectory"), "unused: the object moves but never touches", "depth, force and closing are missing",
           "press, or leave the motion out");
    }
  }

  const Node& root_;
  Problems& problems_;
  Problems& warnings_;
  std::vector<std::string> bad_;  // paths of refused values
};

// --- Scene to text ---

std::string list_text(const Scene& scene, std::string_view path);

// `"key": value` of the fields below a prefix that differ from the defaults or are required.
template <typename Record>
std::vector<std::string> pairs(const Record& record, std::span<const Field<Record>> fields, std::string_view prefix) {
  const Record standard{};
  std::vector<std::string> out;
  for (std::size_t i = 0; i < fields.size(); ++i) {
    const Field<Record>& field = fields[i];
    if (!field.path.starts_with(prefix)) continue;
    const std::string_view rest = field.path.substr(prefix.size());
    if (const auto dot = rest.find('.'); dot != std::string_view::npos) {
      const std::string section = std::string(prefix) + std::string(rest.substr(0, dot + 1));
      if (i > 0 && fields[i - 1].path.starts_with(section)) continue;  // done
      const auto inside = pairs(record, fields, section);
      if (inside.empty()) continue;
      out.push_back("\"" + std::string(rest.substr(0, dot)) + "\": {" + joined(inside) + "}");
      continue;
    }
    if (field.access.type == Type::kList) {
      if constexpr (std::is_same_v<Record, Scene>) {
        if (std::string list = list_text(record, field.path); !list.empty()) {
          out.push_back("\"" + std::string(rest) + "\": " + list);
        }
      }
      continue;
    }
    const std::string text = text_of(field, record);
    if (text.empty() || (!field.required && text == text_of(field, standard))) continue;
    out.push_back("\"" + std::string(rest) + "\": " + text);
  }
  return out;
}

std::string list_text(const Scene& scene, std::string_view path) {
  std::string out;
  if (path == "requires") {
    return scene.needs.empty() ? "" : "[\"" + joined(scene.needs, "\", \"") + "\"]";
  }
  for_each_list([&](std::string_view which, auto fields, auto list) {
    if (which != path) return;
    for (const auto& entry : list(scene)) {
      out += (out.empty() ? "[\n    {" : ",\n    {") + joined(pairs(entry, fields, "")) + "}";
    }
    if (!out.empty()) out += "\n  ]";
  });
  return out;
}

// "key value, key value" of a section: all that has a meaning in this record, or only what differs from the defaults.
template <typename Record>
std::string words(const Record& record, std::type_identity_t<std::span<const Field<Record>>> fields,
                  std::string_view section, bool all) {
  const Record standard{};
  std::vector<std::string> out;
  for (const Field<Record>& field : fields) {
    if (!field.path.starts_with(section) || field.access.type == Type::kList) continue;
    if (field.idle != nullptr && !field.idle(record).empty()) continue;
    const std::string text = text_of(field, record);
    if (text.empty() || (!all && text == text_of(field, standard))) continue;
    out.push_back(std::string(field.path.substr(section.size())) + " " + text);
  }
  std::string line = joined(out);
  std::erase(line, '"');
  return line;
}

std::string table(const Scene& scene) {
  std::vector<std::vector<std::string>> rows(scene.trajectory.size() + 1);
  for (const Field<Waypoint>& field : kWaypointFields) {
    std::vector<std::string> column{std::string(field.path)};
    for (const Waypoint& point : scene.trajectory) column.push_back(text_of(field, point));
    if (std::all_of(column.begin() + 1, column.end(), [](const std::string& cell) { return cell.empty(); })) continue;
    const std::size_t width = std::ranges::max(column, {}, &std::string::size).size();
    for (std::size_t i = 0; i < rows.size(); ++i) {
      rows[i].push_back(std::string(width - column[i].size(), ' ') + column[i]);
    }
  }
  std::string out;
  for (const auto& row : rows) {
    out += "    " + joined(row, "  ");
    out.erase(out.find_last_not_of(' ') + 1);
    out += '\n';
  }
  return out;
}

template <typename Record>
void add_fields(std::string_view prefix, std::span<const Field<Record>> fields, std::vector<FieldInfo>& out) {
  const Record standard{};
  for (const Field<Record>& field : fields) {
    FieldInfo info;
    info.path = std::string(prefix) + std::string(field.path);
    info.type = kTypeNames[static_cast<std::size_t>(field.access.type)];
    info.unit = field.unit;
    info.least = field.least;
    info.most = field.most;
    info.allowed = allowed(field);
    if (field.access.get != nullptr && !field.required) info.standard = text_of(field, standard);
    info.required = field.required;
    info.help = field.help;
    info.capability = field.capability;
    out.push_back(std::move(info));
    if constexpr (std::is_same_v<Record, Scene>) {
      for_each_list([&](std::string_view path, auto entries, auto /*list*/) {
        if (path == field.path) add_fields(std::string(path) + "[].", entries, out);
      });
    }
  }
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
  Problems problems;
  Problems warnings;
  try {
    if (const std::optional<Node> root = parse(text, problems)) {
      Scene scene = Reader(*root, problems, warnings).read();
      if (problems.count() == 0) result.scene = std::move(scene);
    }
  } catch (const std::exception& error) {
    problems.add(1, "cannot be read (" + printable(error.what()) + ")", "out of memory", "close other programs");
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
  std::error_code status;
  if (std::filesystem::exists(path, status) && !std::filesystem::is_regular_file(path, status)) {
    return refused("is no file", "a folder or a device was given", "give a scene file (tests/scenes)");
  }
  errno = 0;
  std::ifstream file(path, std::ios::binary);
  if (!file) return refused("cannot be read", std::strerror(errno), "check the name and its permissions");
  std::string text(kMostSceneBytes + 1, '\0');
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(file.gcount()));
  if (file.bad()) return refused("cannot be read to its end", std::strerror(errno), "copy the file and try again");
  return read_scene(text, path.string());
}

std::string write_scene(const Scene& scene) {
  return "{\n  " + joined(pairs(scene, std::span<const Field<Scene>>(kSceneFields), ""), ",\n  ") + "\n}\n";
}

std::vector<std::string_view> used_capabilities(const Scene& scene) {
  std::vector<std::string_view> used;
  for (const Capability& capability : kCapabilities) {
    if (uses(scene, capability.name)) used.push_back(capability.name);
  }
  return used;
}

std::span<const std::string_view> omissions(ContactLevel level) {
  if (level == ContactLevel::kSprings) return kSpringsOmissions;
  return kGridOmissions;
}

std::string describe(const Scene& scene) {
  std::string out = scene.name + (scene.help.empty() ? "" : ": " + scene.help) + "\n";
  const auto line = [&](std::string_view title, const std::string& text) {
    if (!text.empty()) out += "  " + std::string(title) + std::string(11 - title.size(), ' ') + text + "\n";
  };
  line("time", shown(scene.duration_s) + " s at " + shown(scene.fps) + " frames per second; seed " +
                   std::to_string(scene.seed));
  line("level", words(scene, kSceneFields, "level.", true));
  line("gel", words(scene, kSceneFields, "gel.", true));
  line("markers", words(scene, kSceneFields, "markers.", true));
  line("object", words(scene, kSceneFields, "object.", true));
  out += "  modelled\n";
  for (const std::string_view name : used_capabilities(scene)) {
    out += "    " + std::string(name) + ": " + std::string(find_capability(name)->help) + "\n";
  }
  out += "  left out by level " + std::string(kContactLevelNames[static_cast<std::size_t>(scene.level.contact)]) + "\n";
  for (const std::string_view omission : omissions(scene.level.contact)) out += "    " + std::string(omission) + "\n";
  out += "  trajectory, " + std::string(kProfileNames[static_cast<std::size_t>(scene.profile)]) + "\n" + table(scene);
  line("effects", words(scene, kSceneFields, "effects.", false));
  for (const FaultEvent& fault : scene.faults) {
    line("fault", words(fault, kFaultFields, "", true));
  }
  line("picture", words(scene, kSceneFields, "picture.", false));
  line("expected", words(scene, kSceneFields, "expect.", false));
  for (const Expect::Entropy& entropy : scene.expect.entropy) {
    line("expected", "entropy " + shown(entropy.least_nat) + " .. " + shown(entropy.most_nat) + " nat from " +
                         shown(entropy.from_s) + " s to " + shown(entropy.to_s) + " s");
  }
  line("goal", words(scene, kSceneFields, "goal.", false));
  return out;
}

std::vector<FieldInfo> scene_fields() {
  std::vector<FieldInfo> fields;
  add_fields("", std::span<const Field<Scene>>(kSceneFields), fields);
  return fields;
}

}  // namespace holdfast::scene
