// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/scene/file/schema.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <type_traits>

#include "base/status.hpp"
#include "drivers/sim/scene/contact/springs.hpp"
#include "drivers/sim/scene/file/scene_file.hpp"
#include "drivers/sim/scene/file/words.hpp"
#include "vision/markers.hpp"

namespace holdfast::scene::file {
namespace {

// --- Members ---

template <typename T>
constexpr bool kOptional = false;
template <typename T>
constexpr bool kOptional<std::optional<T>> = true;

template <typename T>
constexpr Names names_of() {
  if constexpr (std::is_same_v<T, Inject>) return kInjectNames;
  if constexpr (std::is_same_v<T, ContactLevel>) return kContactLevelNames;
  if constexpr (std::is_same_v<T, ShapeKind>) return kShapeNames;
  if constexpr (std::is_same_v<T, TextureKind>) return kTextureNames;
  if constexpr (std::is_same_v<T, ReliefKind>) return kReliefNames;
  if constexpr (std::is_same_v<T, Profile>) return kProfileNames;
  if constexpr (std::is_same_v<T, Fault>) return kFaultNames;
  return {};
}

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
    typename T::value_type known{};
    assign(known, value);
    member = known;
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

// A field without its key: called with the rest, it is the row.
struct Kind {
  Type type = Type::kList;
  Names names{};
  Value (*get)(const void*) = nullptr;
  void (*set)(void*, const Value&) = nullptr;

  constexpr Field operator()(std::string_view path, std::string_view unit, double least, double most,
                             std::string_view help, Field::More more = {}) const {
    return {path, type, names, get, set, unit, least, most, help, more};
  }
  constexpr Field operator()(std::string_view path, std::string_view help, Field::More more = {}) const {
    return {path, type, names, get, set, "", 0.0, 0.0, help, more};
  }
};

template <typename Record, typename Member>
Record record_of(Member Record::*);
template <auto kFirst, auto...>
struct Path {
  using Record = decltype(record_of(kFirst));
};
template <auto... kPath>
constexpr auto& follow(auto& record) {
  return (record.*....*kPath);
}
template <auto... kPath>
constexpr auto& member_of(const void* record) {
  return follow<kPath...>(*static_cast<const typename Path<kPath...>::Record*>(record));
}
template <auto... kPath>
constexpr auto& member_of(void* record) {
  return follow<kPath...>(*static_cast<typename Path<kPath...>::Record*>(record));
}

// The words that the table below is written in.
// NOLINTBEGIN(readability-identifier-naming)
template <auto... kPath>
constexpr Kind of = [] {
  using T = std::remove_cvref_t<decltype(member_of<kPath...>(std::declval<void*>()))>;
  return Kind{type_of<T>(), names_of<T>(), [](const void* record) { return value_of(member_of<kPath...>(record)); },
              [](void* record, const Value& value) { assign(member_of<kPath...>(record), value); }};
}();
template <auto kMember>
constexpr Kind object = of<&Scene::object, kMember>;
template <auto kMember>
constexpr Kind shape = of<&Scene::object, &Object::shape, kMember>;
template <auto kMember>
constexpr Kind effect = of<&Scene::effects, kMember>;
template <auto kMember>
constexpr Kind picture = of<&Scene::picture, kMember>;
template <auto kMember>
constexpr Kind expect = of<&Scene::expect, kMember>;
// NOLINTEND(readability-identifier-naming)

// Members that are not spelled as they are kept.
constexpr Kind kList{};
constexpr Kind kHelp{Type::kText, {}, of<&Scene::help>.get, of<&Scene::help>.set};
constexpr double kHalfSpace_mm = std::numeric_limits<double>::infinity();
constexpr Kind kThickness{Type::kNumber,
                          {},
                          [](const void* scene) {
                            const double mm = member_of<&Scene::gel, &Gel::thickness_mm>(scene);
                            return mm == kHalfSpace_mm ? Value{} : Value{mm};
                          },
                          of<&Scene::gel, &Gel::thickness_mm>.set};
constexpr Kind kHalfSpace{
    Type::kFlag,
    {},
    [](const void* scene) { return Value{member_of<&Scene::gel, &Gel::thickness_mm>(scene) == kHalfSpace_mm}; },
    [](void* scene, const Value& value) {
      if (std::get<bool>(value)) member_of<&Scene::gel, &Gel::thickness_mm>(scene) = kHalfSpace_mm;
    }};
// 0 is the width of the injection level.
constexpr Kind kWidth{Type::kWhole,
                      {},
                      [](const void* scene) {
                        const std::int64_t width = member_of<&Scene::picture, &Picture::width>(scene);
                        return width == 0 ? Value{} : Value{width};
                      },
                      picture<&Picture::width>.set};
constexpr auto kStateNames = [] {
  std::array<std::string_view, kStates.size()> names;
  for (std::size_t i = 0; i < names.size(); ++i) names[i] = kStates[i].name;
  return names;
}();
// The name of a state; empty = not given.
template <auto... kPath>
constexpr Kind kState{Type::kChoice, kStateNames,
                      [](const void* scene) {
                        const auto* found = std::ranges::find(kStateNames, member_of<kPath...>(scene));
                        return found == kStateNames.end() ? Value{} : Value{std::int64_t{found - kStateNames.begin()}};
                      },
                      [](void* scene, const Value& value) {
                        member_of<kPath...>(scene) =
                            kStateNames[static_cast<std::size_t>(std::get<std::int64_t>(value))];
                      }};

// --- What a field has no use for ---

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
  const bool turns = shape.texture != TextureKind::kNone || scene.object.relief.kind != ReliefKind::kNone ||
                     (shape.kind == kDisc && shape.tilt_rad != 0.0);
  return turns ? "" : unless_shape<kEllipsoid, kCylinder, kBox, kEdge>(scene);
}
std::string_view unless_textured(const Scene& scene) {
  return scene.object.shape.texture == TextureKind::kNone ? "an object without texture" : "";
}
std::string_view unless_relieved(const Scene& scene) {
  return scene.object.relief.kind == ReliefKind::kNone ? "an object without relief" : "";
}
template <ContactLevel kLevel>
std::string_view unless_level(const Scene& scene) {
  if (scene.level.contact == kLevel) return "";
  return kLevel == ContactLevel::kGrid ? "level springs" : "level grid";
}
std::string_view unless_layer(const Scene& scene) {
  return scene.gel.thickness_mm == kHalfSpace_mm ? "a half-space" : "";
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

template <typename Record>
Record argument_of(std::string_view (*)(const Record&));
template <auto kUnless>
std::string_view idle(const void* record) {
  return kUnless(*static_cast<const decltype(argument_of(kUnless))*>(record));
}

// --- The table ---

constexpr Field::More kRequired{.required = true};
template <auto kUnless>
constexpr Field::More unused{.idle = idle<kUnless>};  // NOLINT(readability-identifier-naming): a word of the table
constexpr Field::More kSeen{.picture = true};

constexpr double kDegreesPerRadian = 180.0 / std::numbers::pi;
constexpr double kMostSeconds = 100'000.0;

using enum ShapeKind;

// In the order of the file. Bounds leave room for experiments; what the models hold up to is written at each model.
// clang-format off
constexpr auto kSceneFields = std::to_array<Field>({
    of<&Scene::schema_version>("schema_version", "", 1, 1, "of this table", kRequired),
    of<&Scene::name>("name", "", 1, 64, "as the file without .json", kRequired),
    kHelp("help", "", 0, 200, "one line for lists"),
    of<&Scene::seed>("seed", "", 0, 1.8446744073709552e19, "of everything random"),
    of<&Scene::fps>("fps", "1/s", 1, 1000, "frames per second"),
    of<&Scene::duration_s>("duration_s", "s", 0.001, kMostSeconds, "of the scene; at most 1000000 frames", kRequired),

    of<&Scene::level, &Level::inject>("level.inject", "where the simulation enters the firmware"),
    of<&Scene::level, &Level::contact>("level.contact", "how the contact is computed"),
    of<&Scene::level, &Level::springs>("level.springs", "", 1, kMostSprings, "springs from centre to rim", unused<unless_level<ContactLevel::kSprings>>),
    of<&Scene::level, &Level::cell_mm>("level.cell_mm", "mm", 0.1, 5, "side of a cell", unused<unless_level<ContactLevel::kGrid>>),

    of<&Scene::gel, &Gel::shear_modulus_mpa>("gel.shear_modulus_kpa", "kPa", 0.01, 1e6, "30 to 115 are reported for this gel", {.per_member = 1000}),
    of<&Scene::gel, &Gel::poisson>("gel.poisson", "", 0, 0.5, "Poisson's ratio"),
    kThickness("gel.thickness_mm", "mm", 0.5, 1000, "of the layer, whose base does not move", unused<unless_layer>),
    kHalfSpace("gel.half_space", "a gel without end, instead of a thickness"),

    of<&Scene::markers, &MarkerGrid::rows>("markers.rows", "", 3, 16, "of printed dots; rows x cols at most 128"),
    of<&Scene::markers, &MarkerGrid::cols>("markers.cols", "", 3, 16, "of printed dots"),
    of<&Scene::markers, &MarkerGrid::pitch_mm>("markers.pitch_mm", "mm", 0.2, 20, "between dots"),

    object<&Object::name>("object.name", "", 1, 64, "for reports"),
    shape<&Shape::kind>("object.shape", "of the side that touches; level springs takes a smooth sphere or cone alone"),
    shape<&Shape::radius_mm>("object.radius_mm", "mm", 0.01, 10'000, "sphere, cylinder, disc; ellipsoid along x; crest of an edge", unused<unless_shape<kSphere, kEllipsoid, kCylinder, kDisc, kEdge>>),
    shape<&Shape::radius_y_mm>("object.radius_y_mm", "mm", 0.01, 10'000, "ellipsoid along y", unused<unless_shape<kEllipsoid>>),
    shape<&Shape::half_x_mm>("object.half_x_mm", "mm", 0.05, 1000, "half a box along x", unused<unless_shape<kBox>>),
    shape<&Shape::half_y_mm>("object.half_y_mm", "mm", 0.05, 1000, "half a box along y", unused<unless_shape<kBox>>),
    shape<&Shape::rim_mm>("object.rim_mm", "mm", 0, 1000, "disc, box: radius of the rounded rim, inside the outline", unused<unless_shape<kDisc, kBox>>),
    shape<&Shape::flank_deg>("object.flank_deg", "deg", 0.1, 89, "cone, edge: slope of the flank against the gel", unused<unless_shape<kCone, kEdge>>),
    shape<&Shape::yaw_rad>("object.yaw_deg", "deg", -360, 360, "about the normal, before any twist", {.per_member = kDegreesPerRadian, .idle = idle<unless_turnable>}),
    shape<&Shape::tilt_rad>("object.tilt_deg", "deg", -45, 45, "disc, box: towards the object's +y", {.per_member = kDegreesPerRadian, .idle = idle<unless_shape<kDisc, kBox>>}),
    shape<&Shape::texture>("object.texture.kind", "ridges along the object's y, or bumps on a square lattice"),
    shape<&Shape::texture_height_mm>("object.texture.height_mm", "mm", 0, 10, "from valley to crest", unused<unless_textured>),
    shape<&Shape::texture_pitch_mm>("object.texture.pitch_mm", "mm", 0.01, 100, "from crest to crest", unused<unless_textured>),
    of<&Scene::object, &Object::relief, &Relief::kind>("object.relief.kind", "seen in the picture, of no matter to the contact: ridges and bumps as a texture, or random grain"),
    of<&Scene::object, &Object::relief, &Relief::height_um>("object.relief.height_um", "um", 0, 500, "from valley to crest; of grain 4 times its rms", unused<unless_relieved>),
    of<&Scene::object, &Object::relief, &Relief::pitch_mm>("object.relief.pitch_mm", "mm", 0.05, 20, "from crest to crest; of grain its mean period", unused<unless_relieved>),
    object<&Object::friction>("object.friction", "", 0, 100, "static; 0.2 to 1.2 are reported for this gel"),
    object<&Object::kinetic_friction>("object.kinetic_friction", "", 0, 100, "at most the static one, which it is unless given"),
    object<&Object::bonded>("object.bonded", "nothing ever slips"),
    object<&Object::compliance_mm_per_n>("object.compliance_mm_per_n", "mm/N", 0, 1000, "of the object, in series with the gel; for closing_mm"),
    object<&Object::mass_g>("object.mass_g", "g", 0, 1e5, "0: follows its drive; else it needs a drive stiffness or a pull"),
    of<&Scene::object, &Object::touch_mm, &Vec2::x>("object.touch_x_mm", "mm", -100, 100, "where it touches first"),
    of<&Scene::object, &Object::touch_mm, &Vec2::y>("object.touch_y_mm", "mm", -100, 100, "where it touches first"),

    of<&Scene::profile>("profile", "between waypoints; minimum jerk is how people move"),
    kList("trajectory", "", 1, kMostSceneItems, "what moves the object: waypoints, times rising", kRequired),

    effect<&Effects::press_dilation>("effects.press_dilation", "", 0, 10, "FOTS's outward motion under a press, as a share of the depth"),
    effect<&Effects::creep_gain>("effects.creep_gain", "", 0, 10, "share by which a held load goes on deforming the gel"),
    effect<&Effects::creep_tau_s>("effects.creep_tau_s", "s", 0.001, 10'000, "its time constant", unused<unless_creeping>),
    effect<&Effects::drive_stiffness_n_per_mm>("effects.drive_stiffness_n_per_mm", "N/mm", 0, 1e4, "of the arm that moves an object with mass; 0: pull alone", unused<unless_massive>),
    effect<&Effects::damping_n_s_per_mm>("effects.damping_n_s_per_mm", "N s/mm", 0, 1e4, "of the motion of an object with mass", unused<unless_massive>),
    effect<&Effects::marker_noise_um>("effects.marker_noise_um", "um", 0, 1000, "sigma of each coordinate, every frame"),
    effect<&Effects::marker_loss>("effects.marker_loss", "", 0, 1, "chance of each marker to be missing, every frame"),
    effect<&Effects::marker_missing>("effects.marker_missing", "", 0, kMaxMarkers, "dots that were never printed or have worn off"),
    effect<&Effects::marker_duplicates>("effects.marker_duplicates", "", 0, 64, "dots beside a printed one", kSeen),
    effect<&Effects::fabrication_um>("effects.fabrication_um", "um", 0, 1000, "sigma of where each dot was printed"),
    effect<&Effects::fabrication_turn_deg>("effects.fabrication_turn_deg", "deg", -45, 45, "of the whole print"),
    effect<&Effects::pixel_noise>("effects.pixel_noise", "levels", 0, 64, "sigma", kSeen),
    effect<&Effects::dirt_specks>("effects.dirt_specks", "", 0, 1000, "dark specks that stay where they are", kSeen),
    effect<&Effects::light_drift_levels_per_s>("effects.light_drift_levels_per_s", "levels/s", -255, 255, "of the whole picture", kSeen),
    effect<&Effects::light_flicker_levels>("effects.light_flicker_levels", "levels", 0, 255, "amplitude at 100 Hz, as the frame rate aliases it", kSeen),
    effect<&Effects::exposure_ms>("effects.exposure_ms", "ms", 0, 1000, "motion blur", kSeen),
    effect<&Effects::rolling_shutter_ms>("effects.rolling_shutter_ms", "ms", 0, 1000, "from the first row to the last", kSeen),
    effect<&Effects::worn_gel>("effects.worn_gel", "", 0, 1, "0 new .. 1: dots lose contrast in patches", kSeen),
    effect<&Effects::dot_shading_levels>("effects.dot_shading_levels", "levels", 0, 60, "of a dot's rim that faces a lamp", kSeen),
    effect<&Effects::gel_margins>("effects.gel_margins", "dark frame around the pad of 25.25 x 20.75 mm", kSeen),

    kList("faults", "", 0, kMostSceneItems, "of the camera"),

    kWidth("picture.width", "px", 64, 3280, "410 for grey and 3280 for jpeg unless given"),
    picture<&Picture::background>("picture.background", "levels", 0, 255, "luma of the middle"),
    picture<&Picture::dot_level>("picture.dot_level", "levels", 0, 255, "luma of a dot"),
    picture<&Picture::shading>("picture.shading", "levels", 0, 255, "from the middle to the side"),
    picture<&Picture::imprint_gain>("picture.imprint_gain", "levels", 0, 1000, "per unit of slope of the gel's surface"),
    picture<&Picture::wall_gain>("picture.wall_gain", "levels", 0, 1000, "each lamp's, per unit of slope that faces it; nothing for slopes that face away"),
    picture<&Picture::specular>("picture.specular", "levels", 0, 255, "highlight where a wall mirrors a lamp: a slope of about 0.3 towards it"),
    picture<&Picture::shadow>("picture.shadow", "levels", 0, 255, "less light, with a sharp edge, where a wall faces away from a lamp by more than 0.1"),
    picture<&Picture::jpeg_quality>("picture.jpeg_quality", "", 1, 100, "as libjpeg counts"),

    expect<&Expect::onset_s>("expect.onset_s", "s", 0, kMostSeconds, "[from, to] of the truth's onset: when more than half of the contact slips"),
    expect<&Expect::no_onset>("expect.no_onset", "the truth has no onset"),
    expect<&Expect::max_delay_ms>("expect.max_delay_ms", "ms", 0, 1e6, "firmware: slip after the truth's onset"),
    expect<&Expect::false_alarms>("expect.false_alarms", "", 0, 1e6, "firmware: most rises of slip before the onset, or at all without one"),
    kState<&Scene::expect, &Expect::final_state>("expect.final_state", "firmware: state after the last frame"),
    kList("expect.entropy", "", 0, kMostSceneItems, "firmware: mean of E over times"),

    of<&Scene::goal, &Goal::max_delay_ms>("goal.max_delay_ms", "ms", 0, 1e6, "not reached yet; below the promise of that name"),
    of<&Scene::goal, &Goal::false_alarms>("goal.false_alarms", "", 0, 1e6, "not reached yet; below the promise of that name"),
    kState<&Scene::goal, &Goal::final_state>("goal.final_state", "not reached yet; instead of a promise of that name"),
});

constexpr auto kWaypointFields = std::to_array<Field>({
    of<&Waypoint::t_s>("t_s", "s", 0, kMostSeconds, "rising", kRequired),
    of<&Waypoint::depth_mm>("depth_mm", "mm", -100, 100, "of the lowest point below the gel's surface; 0 and less: no contact"),
    of<&Waypoint::force_n>("force_n", "N", 0, 10'000, "normal, instead of depth"),
    of<&Waypoint::closing_mm>("closing_mm", "mm", -100, 100, "of the gripper since first touch, instead of depth: object and gel in series"),
    of<&Waypoint::x_mm>("x_mm", "mm", -1000, 1000, "from the place of first touch"),
    of<&Waypoint::y_mm>("y_mm", "mm", -1000, 1000, "from the place of first touch"),
    of<&Waypoint::twist_deg>("twist_deg", "deg", -3600, 3600, "about the normal, +x towards +y"),
    of<&Waypoint::pull_x_n>("pull_x_n", "N", -10'000, 10'000, "on an object with mass"),
    of<&Waypoint::pull_y_n>("pull_y_n", "N", -10'000, 10'000, "on an object with mass"),
});

constexpr auto kFaultFields = std::to_array<Field>({
    of<&FaultEvent::t_s>("t_s", "s", 0, kMostSeconds, "of the first frame that it takes", kRequired),
    of<&FaultEvent::frames>("frames", "", 1, 1e6, "how many it takes"),
    of<&FaultEvent::fault>("fault", "off: the sensor sends nothing", kRequired),
    of<&FaultEvent::by_ms>("by_ms", "ms", 0, 60'000, "late, backwards", unused<unless_shifted>),
});

constexpr auto kEntropyFields = std::to_array<Field>({
    of<&Expect::Entropy::from_s>("from_s", "s", 0, kMostSeconds, "of the time", kRequired),
    of<&Expect::Entropy::to_s>("to_s", "s", 0, kMostSeconds, "of the time", kRequired),
    of<&Expect::Entropy::least_nat>("least_nat", "nat", 0, 3, "of the mean of E", kRequired),
    of<&Expect::Entropy::most_nat>("most_nat", "nat", 0, 3, "of the mean of E", kRequired),
});
// clang-format on

template <typename Record>
const Record kStandard{};

template <auto... kPath>
constexpr Records records(std::string_view path, std::span<const Field> fields) {
  using List = std::remove_cvref_t<decltype(follow<kPath...>(std::declval<Scene&>()))>;
  return {path,
          fields,
          &kStandard<typename List::value_type>,
          [](const Scene& scene) { return follow<kPath...>(scene).size(); },
          [](const Scene& scene, std::size_t i) -> const void* { return &follow<kPath...>(scene)[i]; },
          [](Scene& scene) -> void* { return &follow<kPath...>(scene).emplace_back(); }};
}

const std::array<Records, 4> kRecords{{
    {"", kSceneFields, &kStandard<Scene>, [](const Scene& /*scene*/) { return std::size_t{1}; },
     [](const Scene& scene, std::size_t /*i*/) -> const void* { return &scene; }, nullptr},
    records<&Scene::trajectory>("trajectory", kWaypointFields),
    records<&Scene::faults>("faults", kFaultFields),
    records<&Scene::expect, &Expect::entropy>("expect.entropy", kEntropyFields),
}};

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

}  // namespace

std::span<const Records> all_records() {
  return kRecords;
}
std::span<const Field> scene_table() {
  return kSceneFields;
}

std::string allowed(const Field& field) {
  const std::string unit = field.unit.empty() ? "" : " " + std::string(field.unit);
  const std::string range = shown(field.least) + " .. " + shown(field.most);
  switch (field.type) {
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
      return "\"" + joined(field.names, "\", \"") + "\"";
    case Type::kTwoNumbers:
      return "[from, to], each a number " + range + unit;
    case Type::kList:
      return "a list of " + range + " entries";
  }
  return "";
}

std::string text_of(const Field& field, const void* record) {
  const Value value = field.get(record);
  if (const auto* number = std::get_if<double>(&value)) return shown(in_file(*number, field.more.per_member));
  if (const auto* whole = std::get_if<std::int64_t>(&value)) {
    if (field.type != Type::kChoice) return std::to_string(*whole);
    return "\"" + std::string(field.names[static_cast<std::size_t>(*whole)]) + "\"";
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

bool differs(const Field& field, const void* record, const void* standard) {
  return field.get != nullptr && field.get(record) != field.get(standard);
}

}  // namespace holdfast::scene::file
