// SPDX-License-Identifier: Apache-2.0
// Plays a scene frame by frame: moves the object as the script says, or as a caller says while it runs, asks the
// scene's contact level what the gel does, and keeps the truth of every frame.
//
// Modelled (each only if the scene asks for it)
//   * depth, force, or a gripper that closes on an object with a compliance of its own
//   * an object with mass that an arm moves through a spring, or that is pulled: stick-slip (semi-implicit Euler)
//   * creep of the gel as a standard linear solid, u = u_e (1 + g (1 - exp(-t/tau))) for a held load
//   * dots printed off their place, missing, doubled; noise and loss of marker places
//   * where markers and object were at the start of exposure and readout, for the picture
//
// Not modelled
//   * rotation of an object with mass (its twist follows the script); waves in gel or arm
//   * creep in the contact's own forces (it moves the markers only); the compliance of an object sideways
//   * what the contact level leaves out (omissions())
//
// Units: mm, N, s. One Simulation plays one scene once.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "drivers/sim/scene/contact/contact.hpp"
#include "drivers/sim/scene/scene.hpp"

namespace holdfast::scene {

// What moves the object at one instant. The normal direction is one of depth, force and closing; none is no contact.
struct Drive {
  std::optional<double> depth_mm{};
  std::optional<double> force_n{};
  std::optional<double> closing_mm{};
  Vec2 at_mm{};  // of the object, or of the arm that moves it through a spring; 0 = where it touches first
  double twist_rad = 0.0;
  Vec2 pull_n{};          // on an object with mass
  double friction = 1.0;  // times the object's; level `grid`
};

// What the script says at a time.
[[nodiscard]] Drive drive_at(const Scene& scene, double t_s);
[[nodiscard]] int frame_count(const Scene& scene);

struct Snapshot {
  int frame = 0;
  double t_s = 0.0;
  ContactState contact;
  Vec2 object_mm;            // where the object is, from its place of first touch
  double object_rad = 0.0;   // its twist
  double slide_mm_s = 0.0;   // speed of the object against the gel under it, mean since the frame before
  double slide_deg_s = 0.0;  // likewise, turning
  SlipLevel level = SlipLevel::kNone;
  std::vector<Vec2> motion_mm;  // of each marker, true
  // When exposure or readout began; as at the frame's end unless the scene has them.
  std::vector<Vec2> before_mm;
  Vec2 object_before_mm;
  double object_before_rad = 0.0;
};

// Dots as the sensor has them.
struct Dot {
  Vec2 rest_mm;         // where it was printed
  int marker = 0;       // that it moves with
  bool printed = true;  // false: missing for ever
  bool extra = false;   // a double: never the marker itself
};

class Simulation {
 public:
  // Range: a scene that read_scene() accepts, or one like it.
  explicit Simulation(const Scene& scene);
  Simulation(const Simulation&) = delete;
  Simulation& operator=(const Simulation&) = delete;
  Simulation(Simulation&&) noexcept;
  Simulation& operator=(Simulation&&) noexcept;
  ~Simulation();

  [[nodiscard]] const Scene& scene() const;
  // Rest places of the markers as designed, index = row * cols + col.
  [[nodiscard]] std::span<const Vec2> markers() const;
  // First the markers in their order, then the doubles.
  [[nodiscard]] std::span<const Dot> dots() const;

  // The next frame of the script, from frame 0 on. Beyond frame_count() the last drive holds.
  const Snapshot& next();
  // The next frame with `drive` at its end instead of the script's; between frames the drive goes in a straight line.
  const Snapshot& next(const Drive& drive);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

// Places of the markers as a perfect tracker would report them in this frame: printed off their place, noisy, lost now
// and then. Index as markers().
struct SeenMarker {
  Vec2 at_mm;
  bool valid = false;
};
void see_markers(const Simulation& simulation, const Snapshot& snapshot, std::vector<SeenMarker>& out);

// The contact level that the scene asks for, over these markers.
[[nodiscard]] std::unique_ptr<Contact> make_contact(const Scene& scene, std::span<const Vec2> markers_mm);

}  // namespace holdfast::scene
