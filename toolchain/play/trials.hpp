// SPDX-License-Identifier: Apache-2.0
// Grasps drawn by a seed, filmed as grey pictures and shown to the firmware one after the other: how many slips it
// detects, how late, and how often it alarms while nothing slips. Seed 7 chose constants (learn/fuse.hpp); judge by
// others.
//
// What is drawn
//   closing       a gripper closes on a smooth body, or one with relief, at 5 to 100 mm/s, half of them in two strokes,
//                 and holds it still; half are then shaken within what the grip holds. Nothing slips
//   closing_slip  the same grasps; 100 ms after the grip has closed the object is dragged away at 10 to 60 mm/s
//   easing        the same grasps, their surfaces bonded to the gel; the grip is eased to 0.3 to 0.8 of its way within
//                 0.2 to 2 s. Nothing slips
//   turn          a held object turns about the contact's normal at 15, 40 or 90 degrees a second
//   turn_held     the same grasps, turned as fast, but by less than brings half-slip, and back 0.6 s later
//   slide         a sphere slides at 2 to 100 mm/s under five reliefs
//   shaken        a bonded sphere with relief is shaken at 1 to 6 Hz for 15 s
//   smooth        trials of the paper's objects (play/paper.hpp), all of them without relief
//   grasp         the same trials as they are
//   hand          an object between two fingers: by turns a slide and a closing of the above for the left one, and for
//                 the right one its mirror, without relief in every other pair of them; its frames come at another time
// The gripper of the last two says OPENING when it opens, as a robot does.
//
// Lights of closing, closing_slip, easing and turn reach from a picture that shows hardly any walls to walls as strong
// as in the strongest of 78 recorded closings: see light() in trials.cpp.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/units.hpp"
#include "drivers/sim/scene/scene.hpp"
#include "params/params.hpp"
#include "slip/model.hpp"

namespace holdfast::tool {

enum class TrialKind : std::uint8_t {
  kClosing,
  kClosingSlip,
  kTurn,
  kSlide,
  kShaken,
  kSmooth,
  kGrasp,
  kHand,
  kTurnHeld,
  kEasing
};
inline constexpr std::array<std::string_view, 10> kTrialNames{"closing", "closing_slip", "turn", "slide",     "shaken",
                                                              "smooth",  "grasp",        "hand", "turn_held", "easing"};

struct Trial {
  scene::Scene scene;
  std::string group;      // what it counts under
  bool slips = false;     // meant to; else it is judged up to its first slip, which a release may bring
  double closed_s = 0.0;  // from here on the grip only holds; 0: unknown
  double moved_s = 0.0;   // from here on the object is shaken, dragged or turned; 0: never
  double opens_s = 0.0;   // from here on the gripper says that it opens; 0: never
  int within_frames = 6;  // a detection counts up to here
  // What the right finger feels, and how much later its frames come. None: one finger.
  std::optional<scene::Scene> right{};
  Micros right_later{};
};
// Range: number >= 0. Trial `number` of a seed does not depend on the others.
[[nodiscard]] Trial make_trial(TrialKind kind, std::uint64_t seed, int number);

struct TrialResult {
  double contact_s = 0.0;           // in contact, before the onset
  bool referenced = false;          // the firmware learned a rest position
  std::optional<double> onset_s{};  // more than half of the contact slips
  // From the onset to the rise of `slip`, at most two frames early; or, where `slip` is up at the onset, since when:
  // below 0, and that rise is an alarm as well.
  std::optional<int> delay_frames{};
  // Rises of `slip` before the onset: while the grip closes (and 120 ms after it), while it holds still,
  // while the object is moved.
  std::array<int, 3> alarms{};
  int partial_alarms = 0;  // of them, while a part of the contact slips
};
// `tree` null: the compiled one. A right finger is left out.
[[nodiscard]] TrialResult run_trial(const Trial& trial, const Params& params, const model::Tree* tree = nullptr);

// Of a trial with a right finger: the hand, and the left finger alone on the same frames. Truth is the left's.
struct HandResult {
  TrialResult hand;
  TrialResult left;
};
[[nodiscard]] HandResult run_hand(const Trial& trial, const Params& params, const model::Tree* tree = nullptr);

struct TrialTally {
  std::string group;
  int trials = 0;
  int unreferenced = 0;
  int onsets = 0;
  int detected = 0;  // within the trial's frames
  std::array<int, 3> alarms{};
  int partial_alarms = 0;
  int alarmed = 0;  // trials with an alarm
  double contact_s = 0.0;
  std::vector<int> delays{};  // of all detections, in order

  void add(const Trial& trial, const TrialResult& result);
  [[nodiscard]] int all_alarms() const { return alarms[0] + alarms[1] + alarms[2]; }
  [[nodiscard]] double alarms_per_hour() const { return contact_s > 0.0 ? all_alarms() * 3600.0 / contact_s : 0.0; }
  [[nodiscard]] std::optional<double> median_delay() const;
};

// Groups in order of name, then "all".
class TrialTable {
 public:
  void add(const Trial& trial, const TrialResult& result);
  [[nodiscard]] const std::vector<TrialTally>& groups() const { return groups_; }
  [[nodiscard]] const TrialTally& all() const { return all_; }

 private:
  std::vector<TrialTally> groups_;
  TrialTally all_{.group = "all"};
};
// As lines for people.
[[nodiscard]] std::string table_text(const TrialTable& table);

}  // namespace holdfast::tool
