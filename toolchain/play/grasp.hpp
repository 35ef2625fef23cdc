// SPDX-License-Identifier: Apache-2.0
// A book pulled out of a shelf, with the loop closed: the scene's physics move the markers, the firmware decides on
// them, the regulator asks for force, a gripper gives it, and the gel is pressed with what it gives.
//
// Modelled
//   * one finger's share: the book's mass behind it, and what the shelf holds it with (Coulomb; break-away above
//     sliding). In a straight line, at 4 ms: while the shelf holds, the arm moves and the book does not; once it moves
//     its inertia adds to the load; when it is out, the shelf is gone
//   * the book's cover on the gel: contact level `grid` - partial slip, static and kinetic friction, the layer, a cover
//     that is not parallel; the gel's damping while the book sticks
//   * a pull upwards: the book's weight hangs on the gel
//   * friction that changes, a load that is added to the shelf's, a bump: the arm shaken to and fro
// Not modelled
//   * the second finger; weight across the pull; a book that turns or bends; what gripper and arm give way
//
// Units: mm, N, s; N and kg of one finger.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "base/status.hpp"
#include "drivers/sim/scene/scene.hpp"
#include "grip/regulator.hpp"
#include "params/params.hpp"

namespace holdfast::tool {

// A gripper as the closed loop sees it.
class Gripper {
 public:
  Gripper() = default;
  Gripper(const Gripper&) = delete;
  Gripper& operator=(const Gripper&) = delete;
  virtual ~Gripper() = default;
  virtual void tell(const regulator::Command& command) = 0;
  // Force of one finger after `dt_s` more.
  [[nodiscard]] virtual double force_n(double dt_s) = 0;
};

// Force follows the command with a delay of the first order and at a limited rate; 0 counts are `least_n`, as with the
// Hand-E, whose 20 .. 185 N these are a tenth of: what a soft gel bears. Opens when it is told position 0.
struct LagGripperConfig {
  double least_n = 2.0;
  double most_n = 18.5;
  double lag_s = 0.06;
  double rate_n_s = 40.0;
};
class LagGripper final : public Gripper {
 public:
  explicit LagGripper(const LagGripperConfig& config = {}) : config_(config) {}
  void tell(const regulator::Command& command) override;
  [[nodiscard]] double force_n(double dt_s) override;

 private:
  LagGripperConfig config_;
  double wanted_n_ = 0.0;
  double force_n_ = 0.0;
};
[[nodiscard]] double force_of(int counts, const LagGripperConfig& config = {});
// The most counts that give no more than this.
[[nodiscard]] int counts_of(double force_n, const LagGripperConfig& config = {});

struct Pull {
  std::string name;
  std::string help;
  std::uint64_t seed = 1;
  scene::Inject inject = scene::Inject::kMarkers;  // or kGrey
  scene::Gel gel{.shear_modulus_mpa = 0.085, .poisson = 0.49, .thickness_mm = 4.25};
  scene::Shape shape{
      .kind = scene::ShapeKind::kBox, .half_x_mm = 7.5, .half_y_mm = 5.0, .rim_mm = 0.8, .tilt_rad = 0.015};
  scene::Relief relief;
  double friction = 0.4;
  double kinetic_share = 0.85;
  double mass_kg = 0.25;
  double shelf_n = 2.0;  // that the shelf holds the book with until it moves
  double shelf_kinetic_share = 0.85;
  double hang_n = 0.0;     // weight along the pull, which goes upwards then; a floor bears it at first
  double angle_rad = 0.0;  // of the pull on the gel
  double speed_mm_s = 12.0;
  double accel_mm_s2 = 100.0;
  double start_share = 0.7;  // of the least force that holds: what the grasp starts with
  double marker_noise_um = 1.5;
  double fabrication_um = 40.0;
  // What happens at event_s: in the pull, or when the arm has stopped with the book.
  double event_s = 6.6;
  std::optional<double> friction_drops_to;  // times itself
  double added_n = 0.0;                     // that the shelf holds it with more, as when a book falls on it
  double bump_mm = 0.0;                     // amplitude of three cycles
  double bump_hz = 5.0;
  double ends_s = 11.0;
};

// Times of every pull, s.
inline constexpr double kGripAt = 0.6;  // on the empty gel before it, the firmware learns its rest
inline constexpr double kPullAt = 1.8;
inline constexpr double kPullFor = 4.0;  // of which the last fifth is outside the shelf
inline constexpr double kReleaseAt = 9.4;
// The book is lost once it has slid so far on the gel, half the height of its pad of 25.25 x 20.75 mm, or has left it.
inline constexpr double kLost_mm = 10.0;

struct GraspFrame {
  double t_s = 0.0;
  DeviceState state = DeviceState::kBoot;
  bool slip = false;     // the firmware's request
  bool verdict = false;  // of this frame alone
  bool rates_valid = false;
  double entropy_nat = 0.0;
  double entropy_rate_nat_s = 0.0;
  regulator::Phase phase = regulator::Phase::kIdle;
  int force_counts = 0;
  int position_counts = 0;
  int steps = 0;
  // Truth.
  double commanded_n = 0.0;
  double force_n = 0.0;
  double load_n = 0.0;  // that the gel carries along it
  double slid_mm = 0.0;
  double share = 0.0;  // of the contact that slips
  double book_mm = 0.0;
};

struct Grasp {
  std::vector<GraspFrame> frames;
  bool lost = false;
  double lost_at_s = 0.0;
  double slid_mm = 0.0;  // at most, before the release
  double start_n = 0.0;
  double final_n = 0.0;  // commanded, before the release
  int start_counts = 0;
  int steps = 0;
  std::optional<double> first_slip_s;  // truth, in the pull: more than half of the contact slips
  std::optional<double> first_alarm_s;
};

enum class Prevention : bool { kOff, kOn };

// `least_n`: the least force that holds this pull until the event (least_force()); sets what the grasp starts with.
[[nodiscard]] Grasp play_pull(const Pull& pull, double least_n, const Params& params, const regulator::Config& config,
                              Prevention prevention, Gripper& gripper);

// The least constant force with which the book is not lost, by bisection to `accuracy`, without firmware and without
// delay in the gripper. `until_s`: of the pull; what happens later does not count.
[[nodiscard]] double least_force(const Pull& pull, double until_s, double accuracy = 0.02);
// Of the pull itself, and of all of it with its event.
struct LeastForce {
  double pull_n = 0.0;
  double all_n = 0.0;
};
[[nodiscard]] LeastForce least_forces(const Pull& pull);
// What the final force may be: the larger of 1.3 times the least that holds and two steps above the start.
[[nodiscard]] double most_allowed_n(const LeastForce& least, const Grasp& grasp, const regulator::Config& config);

// A pull with everything that can vary drawn at random.
[[nodiscard]] Pull random_pull(std::uint64_t seed);

// The book of the paper's figure; friction that halves and a load that is added in the pull; a bump.
[[nodiscard]] std::vector<Pull> named_pulls();

}  // namespace holdfast::tool
