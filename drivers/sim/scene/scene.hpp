// SPDX-License-Identifier: Apache-2.0
// A scene as data: gel, object, what moves it, what goes wrong, how much of it is modelled and what is expected of it.
// scene_file.hpp reads it from JSON, simulation.hpp plays it. Everything costs nothing unless the scene asks for it.
//
// Units are in the names; angles that people write are degrees. Axes of the picture (contact.hpp).
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/sim/scene/contact/contact.hpp"
#include "drivers/sim/scene/contact/shape.hpp"

namespace holdfast::scene {

// Where the simulation enters the firmware, cheapest first.
enum class Inject { kFeatures, kMarkers, kGrey, kJpeg };
inline constexpr std::array<std::string_view, 4> kInjectNames{"features", "markers", "grey", "jpeg"};

// How the contact is computed, cheapest first.
enum class ContactLevel { kSprings, kGrid };
inline constexpr std::array<std::string_view, 2> kContactLevelNames{"springs", "grid"};

struct Level {
  Inject inject = Inject::kMarkers;
  ContactLevel contact = ContactLevel::kSprings;
  int springs = 64;      // level `springs`
  double cell_mm = 0.7;  // level `grid`
  friend bool operator==(const Level&, const Level&) = default;
};

struct Object {
  std::string name = "object";
  Shape shape;
  Relief relief;                           // in the picture alone
  double friction = 0.5;                   // static
  std::optional<double> kinetic_friction;  // the static one unless given
  bool bonded = false;                     // nothing ever slips
  double compliance_mm_per_n = 0.0;        // of the object, in series with the gel; for `closing`
  double mass_g = 0.0;                     // 0 = follows its drive; else see Effects::drive_stiffness
  Vec2 touch_mm{0.4, -0.3};                // where it touches first; off the grid's symmetry on purpose
  friend bool operator==(const Object&, const Object&) = default;
};

// What moves the object at one time. A value that is left out lies on the curve between its neighbours that have it.
// The normal direction is given by one of depth, force and closing.
struct Waypoint {
  double t_s = 0.0;
  std::optional<double> depth_mm{};
  std::optional<double> force_n{};
  std::optional<double> closing_mm{};  // of the gripper since first touch: object and gel in series
  std::optional<double> x_mm{};
  std::optional<double> y_mm{};
  std::optional<double> twist_deg{};
  std::optional<double> pull_x_n{};  // force on the object from outside; needs a mass
  std::optional<double> pull_y_n{};
  friend bool operator==(const Waypoint&, const Waypoint&) = default;
};

enum class Profile { kLinear, kMinimumJerk };  // between waypoints; minimum jerk is how people move
inline constexpr std::array<std::string_view, 2> kProfileNames{"linear", "minimum_jerk"};

// All off.
struct Effects {
  // --- the gel ---
  double press_dilation = 0.0;  // FOTS's outward motion under a press, for levels that have none of their own
  double creep_gain = 0.0;      // share by which a held load goes on deforming the gel; standard linear solid
  double creep_tau_s = 1.0;
  // --- the object ---
  double drive_stiffness_n_per_mm = 0.0;  // of the arm that moves an object with mass; 0 = only pull_x_n, pull_y_n
  double damping_n_s_per_mm = 0.0;        // of the object's motion
  // --- the markers ---
  double marker_noise_um = 0.0;       // sigma of each coordinate, every frame
  double marker_loss = 0.0;           // chance of each marker to be missing, every frame
  int marker_missing = 0;             // dots that were never printed or have worn off
  int marker_duplicates = 0;          // dots beside a printed one
  double fabrication_um = 0.0;        // sigma of where each dot was printed
  double fabrication_turn_deg = 0.0;  // of the whole print
  // --- the picture ---
  double pixel_noise = 0.0;               // sigma in levels
  int dirt_specks = 0;                    // dark specks that stay where they are
  double light_drift_levels_per_s = 0.0;  // of the whole picture
  double light_flicker_levels = 0.0;  // amplitude at twice the mains frequency (100 Hz), as the frame rate aliases it
  double exposure_ms = 0.0;           // motion blur
  double rolling_shutter_ms = 0.0;    // from the first row to the last
  double worn_gel = 0.0;              // 0 new .. 1: dots lose contrast in patches
  double dot_shading_levels = 0.0;    // of a dot's rim that faces a lamp; moves its centre by 0.07 px at 10 levels
  bool gel_margins = false;           // the camera sees the dark frame around the pad of 25.25 x 20.75 mm
  friend bool operator==(const Effects&, const Effects&) = default;
};

enum class Fault { kOff, kDropped, kBad, kFrozen, kTorn, kGarbage, kLate, kBackwards, kUnplugged };
inline constexpr std::array<std::string_view, 9> kFaultNames{"off",     "dropped", "bad",       "frozen",   "torn",
                                                             "garbage", "late",    "backwards", "unplugged"};

struct FaultEvent {
  double t_s = 0.0;
  int frames = 1;
  Fault fault = Fault::kDropped;
  double by_ms = 50.0;  // late, backwards
  friend bool operator==(const FaultEvent&, const FaultEvent&) = default;
};

// Picture of the camera for levels `grey` and `jpeg`.
struct Picture {
  int width = 0;  // 0: 410 for grey (the firmware's working size), 3280 for jpeg
  double background = 120.0;
  double dot_level = 45.0;
  double shading = 20.0;
  double imprint_gain = 60.0;
  double wall_gain = 0.0;  // scene::Walls
  double specular = 0.0;
  double shadow = 0.0;
  int jpeg_quality = 85;
  friend bool operator==(const Picture&, const Picture&) = default;
};

// What a scene promises. Checked by `holdfast sim` and by the tests of the gallery; what is absent is not promised.
struct Expect {
  struct Window {
    double from_s = 0.0;
    double to_s = 0.0;
    friend bool operator==(const Window&, const Window&) = default;
  };
  struct Entropy {
    double from_s = 0.0;
    double to_s = 0.0;
    double least_nat = 0.0;  // of the mean of E over the time
    double most_nat = 0.0;
    friend bool operator==(const Entropy&, const Entropy&) = default;
  };
  std::optional<Window> onset_s;       // truth: when more than half of the contact slips
  bool no_onset = false;               // truth: it never does
  std::optional<double> max_delay_ms;  // firmware: slip after the onset
  std::optional<int> false_alarms;     // firmware: rises of `slip` before the onset, or at all without one
  std::string final_state;             // firmware: state after the last frame; empty = not promised
  std::vector<Entropy> entropy;        // firmware
  friend bool operator==(const Expect&, const Expect&) = default;
};

// What the firmware aims at in a scene and does not reach yet, of what can be promised there. Said in every run, so
// that no one takes the promise for the aim; the tests of the gallery refuse one that is reached: it is a promise then.
struct Goal {
  std::optional<double> max_delay_ms;
  std::optional<int> false_alarms;
  std::string final_state;
  friend bool operator==(const Goal&, const Goal&) = default;
};

struct Scene {
  int schema_version = 1;
  std::string name;
  std::string help;
  std::uint64_t seed = 1;
  double fps = 25.0;
  double duration_s = 0.0;
  Level level;
  Gel gel{.shear_modulus_mpa = 0.035, .poisson = 0.49, .thickness_mm = 4.25};
  MarkerGrid markers;
  Object object;
  Profile profile = Profile::kLinear;
  std::vector<Waypoint> trajectory;
  Effects effects;
  std::vector<FaultEvent> faults;
  Picture picture;
  Expect expect;
  Goal goal;
};

}  // namespace holdfast::scene
