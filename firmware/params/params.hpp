// SPDX-License-Identifier: Apache-2.0
// The parameters: one table that settings, command line, console and documentation read.
//
// Each row points at its member of Params and takes the default from there, so that table and struct cannot
// drift apart. All values are int32 in the unit of the row; validate() runs once at start.
#pragma once

#include <algorithm>
#include <array>
#include <charconv>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>
#include <system_error>

#include "base/status.hpp"
#include "hal/crew.hpp"
#include "params/modes.hpp"
#include "slip/tree_io.hpp"
#include "tactile/load.hpp"
#include "vision/jpeg_fast.hpp"
#include "vision/markers.hpp"

namespace holdfast {

struct Params {
  std::int32_t histogram_range_um = 1900;
  std::int32_t pitch_um = 2020;
  std::int32_t raise_frames = 2;
  std::int32_t hold_ms = 200;
  std::int32_t max_gap_ms = 250;
  std::int32_t degraded_markers_pct = 87;
  std::int32_t fault_markers_pct = 71;
  std::int32_t reference_frames = 10;
  std::int32_t grid_rows = 7;
  std::int32_t grid_cols = 9;
  std::int32_t mode = 0;
  std::int32_t jpeg_threads = 1;
  std::int32_t jpeg_lanes = 3;
  std::int32_t all_features = 0;
  std::int32_t latch = 0;
  std::int32_t opening_max_ms = 5000;
  std::int32_t gripper = 0;
  std::int32_t start_force = 20;
  std::int32_t force_step = 3;
  std::int32_t grow_pct = 3;
  std::int32_t max_force = 255;
  std::int32_t closed_counts = 226;
  std::int32_t release_step = 6;
  std::int32_t grip_speed = 128;
  std::int32_t left_sensor = 0;
  std::int32_t right_sensor = 0;
  std::int32_t lost_finger = 0;
  std::int32_t status_version = 1;
  std::int32_t shear_scale = 0;
  std::int32_t normal_scale = 0;
  friend constexpr bool operator==(const Params&, const Params&) = default;
};

// When a new value counts.
enum class Applies : std::uint8_t {
  kAtOnce,     // with the next frame
  kRelearned,  // with the next frame, and the rest position is learned anew
  kAtRestart,  // what the board is made with
};
inline constexpr std::array<std::string_view, 3> kAppliesNames{"at once", "relearned", "at restart"};

// What a wrong value can do, and so who may change it where the device has an owner (sealed.hpp).
enum class ParamClass : std::uint8_t {
  kSafety,   // GRIP_OK is HIGH though it should not be, or what is held is harmed: only what the owner signed
  kTuning,   // speed, or the way to a grip: whoever unlocks the console
  kDisplay,  // what is shown and recorded: likewise
};
inline constexpr std::array<std::string_view, 3> kParamClassNames{"safety", "tuning", "display"};

inline constexpr std::int32_t kMostSensor = 0x3FFFFFFF;  // a number is 30 bits of a check sum (camera_keeper.hpp)

struct ParamInfo {
  std::int32_t Params::*member;
  std::string_view name;
  std::string_view unit;
  std::int32_t min;
  std::int32_t max;
  ParamClass kind;
  std::string_view why;  // it is of that class
  std::string_view help;
  std::string_view price;  // what a larger or smaller value costs
  Applies applies = Applies::kAtOnce;
  std::int32_t default_value = Params{}.*member;
};

inline constexpr std::array<ParamInfo, 30> kParams{{
    {&Params::histogram_range_um, "histogram_range_um", "um", 500, 10'000, ParamClass::kSafety,
     "larger: a slip stays in one bin, and its entropy shows nothing",
     "displacement at which the last of the 15 histogram bins begins to overflow",
     "larger: small slips share one bin; smaller: strong grips saturate the last bin. Belongs to the model"},
    {&Params::pitch_um, "pitch_um", "um", 1000, 5000, ParamClass::kSafety,
     "smaller: all speeds are too small for the model to see a slip", "distance of neighbouring markers on the gel",
     "all lengths and speeds scale with it; give the printed pitch", Applies::kRelearned},
    {&Params::raise_frames, "raise_frames", "frames", 1, 10, ParamClass::kSafety,
     "more: GRIP_OK stays HIGH for that many frames of a slip",
     "slips in a row until the request is raised; clear ones raise it at once",
     "one frame of delay each (40 ms at 25 fps); 1 passes every flicker on"},
    {&Params::hold_ms, "hold_ms", "ms", 0, 5000, ParamClass::kSafety,
     "0: GRIP_OK is HIGH again between two frames of a slide", "how long the request stays raised after the last slip",
     "longer: a false alarm keeps GRIP_OK low longer; shorter: the request flickers during a slide"},
    {&Params::max_gap_ms, "max_gap_ms", "ms", 200, 2000, ParamClass::kSafety,
     "longer: a slip within a gap is averaged away", "time between frames above which rates start again",
     "longer: a slip within the gap is averaged away; shorter: dropped frames at 15 fps blind one frame"},
    {&Params::degraded_markers_pct, "degraded_markers_pct", "%", 1, 100, ParamClass::kSafety,
     "lower: GRIP_OK is HIGH on a few markers", "below this share of tracked markers the state is DEGRADED",
     "higher: a little dirt lowers GRIP_OK; lower: features stand on fewer markers"},
    {&Params::fault_markers_pct, "fault_markers_pct", "%", 1, 100, ParamClass::kSafety,
     "lower: a lost or covered gel goes on being judged", "below this share of tracked markers the state is FAULT",
     "higher: strong shear at the edge stops the grasp; lower: features stand on fewer markers"},
    {&Params::reference_frames, "reference_frames", "frames", 1, 100, ParamClass::kSafety,
     "1: the noise of one frame becomes the rest position of all that follow",
     "frames of the empty gel that are averaged to the rest position",
     "one frame of start-up each; noise of the rest position falls with the root"},
    {&Params::grid_rows, "grid_rows", "", 3, 16, ParamClass::kSafety, "fewer: whole rows may be lost without a word",
     "rows of the printed grid", "none: give the printed number", Applies::kRelearned},
    {&Params::grid_cols, "grid_cols", "", 3, 16, ParamClass::kSafety, "as grid_rows", "columns of the printed grid",
     "none: give the printed number", Applies::kRelearned},
    {&Params::mode, "mode", "", 0, static_cast<std::int32_t>(kModes.size()) - 1, ParamClass::kSafety,
     "each detects another share of slips, after another delay", "speed setting: 0 fast, 1 balanced, 2 precise",
     "see the modes table", Applies::kRelearned},
    {&Params::jpeg_threads, "jpeg_threads", "", 1, static_cast<std::int32_t>(hal::kMaxWorkers), ParamClass::kTuning,
     "the same bytes; what comes late is rejected", "cores that decode one picture together (mode fast)",
     "half a megabyte each, and a core taken from USB and others", Applies::kAtRestart},
    {&Params::jpeg_lanes, "jpeg_lanes", "", 0, static_cast<std::int32_t>(jpeg_fast::kMaxLanes), ParamClass::kTuning,
     "the same bytes; what comes late is rejected",
     "places of the picture that a core decodes by turns (mode fast); 0: the plain walk",
     "3 suits x86-64, 2 Cortex-A72; 0 takes about twice as long and no memory of its own", Applies::kAtRestart},
    {&Params::all_features, "all_features", "", 0, 1, ParamClass::kDisplay, "the model decides by the same features",
     "1: compute every feature, also those that the model does not read",
     "instructions; with a model that reads no picture the rest position is learned anew; for recording data"},
    {&Params::latch, "latch", "", 0, 1, ParamClass::kSafety,
     "0: GRIP_OK is HIGH again after a FAULT that nobody looked at", "1: after a FAULT wait for the command ARM",
     "1: a cable that was loose for a moment stops the robot until somebody has looked"},
    {&Params::opening_max_ms, "opening_max_ms", "ms", 100, 60'000, ParamClass::kSafety,
     "longer: a forgotten OPENING hides the loss of the object", "OPENING and RELEASE mask slip for so long at most",
     "longer: a forgotten OPENING hides slip for longer; shorter: a slow release ends in a false slip"},
    {&Params::gripper, "gripper", "", 0, 2, ParamClass::kSafety, "0: a gripper's faults are no longer seen",
     "what holds: 0 the robot itself, 1 Robotiq Hand-E, 2 a pair of step lines",
     "1 and 2: a gripper that does not answer is a FAULT", Applies::kAtRestart},
    {&Params::start_force, "start_force", "counts", 0, 255, ParamClass::kTuning,
     "up to max_force; a slip is reported whatever the force", "force of GRIP before anything slips",
     "higher: fewer slips, and soft objects suffer; lower: more is left to the regulator"},
    {&Params::force_step, "force_step", "counts", 1, 64, ParamClass::kTuning, "as start_force",
     "force added per step while the object slips", "larger: stops a slip sooner and overshoots further"},
    {&Params::grow_pct, "grow_pct", "%", 0, 50, ParamClass::kTuning, "as start_force",
     "and this share of the present force", "larger: heavy objects are held sooner and squeezed harder"},
    {&Params::max_force, "max_force", "counts", 0, 255, ParamClass::kSafety, "the one limit that keeps an object whole",
     "force that is never exceeded", "higher: heavier objects are held, weaker ones crushed"},
    {&Params::closed_counts, "closed_counts", "counts", 1, 255, ParamClass::kSafety,
     "higher than the fingertips need: closed on nothing counts as holding",
     "position that the Hand-E shows when its fingertips meet",
     "belongs to the fingertips: measure it; lower than they need: thin objects count as lost"},
    {&Params::release_step, "release_step", "counts", 1, 64, ParamClass::kTuning, "acts on RELEASE alone",
     "force taken off per 40 ms by RELEASE", "larger: lets go sooner, and less gently"},
    {&Params::grip_speed, "grip_speed", "counts", 0, 255, ParamClass::kTuning, "as start_force",
     "speed of the fingers (Hand-E's rSP)", "higher: hits the object harder"},
    {&Params::left_sensor, "left_sensor", "", 0, kMostSensor, ParamClass::kSafety,
     "another number: the sensor of another finger, or gel, is taken for this one",
     "number of the sensor on the left or only finger, as `devices` says it; 0: any",
     "0: swapped sensors are not noticed", Applies::kAtRestart},
    {&Params::right_sensor, "right_sensor", "", 0, kMostSensor, ParamClass::kSafety, "as left_sensor",
     "number of the sensor on the right finger; 0: any", "as left_sensor", Applies::kAtRestart},
    {&Params::lost_finger, "lost_finger", "", 0, 1, ParamClass::kSafety,
     "1: GRIP_OK is HIGH though one side of the object is not watched",
     "of two fingers one is at FAULT: 0 that is the hand's FAULT, 1 go on with the other",
     "1: a slip that only the lost finger would have seen is not told"},
    {&Params::status_version, "status_version", "", 1, 2, ParamClass::kDisplay,
     "a receiver that does not know the version hears nothing, and takes nothing for fine",
     "of the status frames of a device of two fingers: 1, or 2, which tells of each finger",
     "2: 3 bytes more a frame, and a receiver that knows it"},
    {&Params::shear_scale, "shear_scale", "1/1000", 0, load::kMostScalePermille, ParamClass::kDisplay,
     "forces are shown and recorded; none decides",
     "shear that the gel carries, over that of a gel of 35 kPa; 0: not calibrated",
     "none: give what `holdfast calibrate --weight` measured on this gel"},
    {&Params::normal_scale, "normal_scale", "1/1000", 0, load::kMostScalePermille, ParamClass::kDisplay,
     "as shear_scale", "the same of the normal load", "as shear_scale"},
}};

static_assert(sizeof(Params) == kParams.size() * sizeof(std::int32_t), "every member of Params has a row");

struct ParamProblem {
  const ParamInfo* row = nullptr;  // null: there is no parameter of that name
  std::string_view rule;           // which rule it breaks
};

[[nodiscard]] constexpr const ParamInfo* find_param(std::string_view name) {
  for (const ParamInfo& row : kParams) {
    if (row.name == name) return &row;
  }
  return nullptr;
}

namespace params_detail {

constexpr Status refuse(ParamProblem* problem, const ParamInfo* row, std::string_view rule) {
  if (problem != nullptr) *problem = {row, rule};
  return {Reason::kConfig};
}

}  // namespace params_detail

// kConfig with the first row that is out of its range or contradicts another. Range: any values.
constexpr Status validate(const Params& params, ParamProblem* problem = nullptr) {
  using params_detail::refuse;
  for (const ParamInfo& row : kParams) {
    const std::int32_t value = params.*row.member;
    if (value < row.min || value > row.max) return refuse(problem, &row, "outside its range");
  }
  if (params.fault_markers_pct > params.degraded_markers_pct) {
    return refuse(problem, find_param("fault_markers_pct"), "above degraded_markers_pct");
  }
  if (params.start_force > params.max_force) {
    return refuse(problem, find_param("start_force"), "above max_force");
  }
  if (params.left_sensor != 0 && params.left_sensor == params.right_sensor) {
    return refuse(problem, find_param("right_sensor"), "the same sensor as left_sensor");
  }
  if (params.grid_rows * params.grid_cols > kMaxMarkers) {
    return refuse(problem, find_param("grid_cols"),
                  "too large: times grid_rows it exceeds the 128 markers of the fixed memory");
  }
  return kOkStatus;
}

// Two that validate() judges together: of some values, neither can be changed before the other is.
struct ParamPair {
  std::int32_t Params::*first;
  std::int32_t Params::*second;
};
inline constexpr std::array<ParamPair, 4> kParamPairs{{{&Params::degraded_markers_pct, &Params::fault_markers_pct},
                                                       {&Params::grid_rows, &Params::grid_cols},
                                                       {&Params::start_force, &Params::max_force},
                                                       {&Params::left_sensor, &Params::right_sensor}}};

static_assert(validate(Params{}).ok(), "the defaults are valid");
static_assert(kMaxMarkers == 128, "named in validate()");

// Sets one parameter from its text, a decimal integer (or a name for `mode`). Checks the row's own
// range only; validate() judges the whole. `params` changes only on success.
inline Status parse(std::string_view name, std::string_view text, Params& params, ParamProblem* problem = nullptr) {
  using params_detail::refuse;
  const ParamInfo* row = find_param(name);
  if (row == nullptr) return refuse(problem, nullptr, "no parameter of that name");
  std::int32_t value = 0;
  if (const auto mode = find_mode(text); row->member == &Params::mode && mode) {
    value = *mode;
  } else {
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error == std::errc::result_out_of_range) return refuse(problem, row, "outside its range");
    if (error != std::errc{} || end != text.data() + text.size()) return refuse(problem, row, "not an integer");
  }
  if (value < row->min || value > row->max) return refuse(problem, row, "outside its range");
  params.*row->member = value;
  return kOkStatus;
}

}  // namespace holdfast
