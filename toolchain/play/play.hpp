// SPDX-License-Identifier: Apache-2.0
// Plays a scene through the firmware, entering where the scene says: as JPEG or grey pictures through the camera, as
// markers, or as features; and holds what came out against what the scene expects.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "app/app.hpp"
#include "drivers/sim/camera_faults.hpp"
#include "drivers/sim/camera_scene.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/scene/scene.hpp"
#include "drivers/sim/scene/simulation.hpp"

namespace holdfast::tool {

// The markers that see_markers() saw, in pixels of such a picture.
[[nodiscard]] MarkerField field_of(const scene::Scene& scene, const scene::PictureConfig& picture,
                                   std::span<const scene::SeenMarker> seen, Saturations& saturations);

class Player {
 public:
  // The scene outlives the player.
  Player(const scene::Scene& scene, sim::Clock& clock);

  // What the App is made with; at levels without pictures it is only there to be started.
  [[nodiscard]] hal::Camera& camera();
  // One frame of the scene through `app`, which was started with these params. A camera that was unplugged is started
  // again as soon as it lets. false: the scene is over.
  [[nodiscard]] bool step(App& app, const Params& params, bool auto_grid);

  // Of the last step.
  [[nodiscard]] const scene::Snapshot& snapshot() const { return camera_.snapshot(); }
  [[nodiscard]] const scene::PictureConfig& picture() const { return camera_.picture(); }
  // Where the picture of the last step truly has the markers, in its pixels; nothing at levels without pictures.
  [[nodiscard]] std::span<const scene::PointPx> marker_centers() const { return camera_.marker_centers(); }
  // Rest places of the markers as printed, and all dots, markers first.
  [[nodiscard]] std::span<const scene::Vec2> markers() const { return camera_.simulation().markers(); }
  [[nodiscard]] std::span<const scene::Dot> dots() const { return camera_.simulation().dots(); }
  // The frame as the camera gave it; at levels without pictures an empty grey one of the picture's size.
  [[nodiscard]] hal::Frame lent() const;

 private:
  [[nodiscard]] bool step_picture(App& app, const Params& params, bool auto_grid);
  void step_markers(App& app);
  void step_features(App& app, const Params& params);

  const scene::Scene& scene_;
  sim::Clock& clock_;
  sim::SceneCamera camera_;
  sim::FaultyCamera faulty_;
  bool began_ = false;
  std::vector<scene::SeenMarker> seen_;
  features::State features_;
  field_features::State field_features_;
  Saturations saturations_;
};

// What one frame came to.
struct PlayedFrame {
  int frame = 0;
  double t_s = 0.0;
  scene::SlipLevel level = scene::SlipLevel::kNone;
  bool accepted = false;
  bool referenced = false;
  bool slip = false;
  bool grip_ok = false;
  DeviceState state = DeviceState::kBoot;
  Features features;
};
[[nodiscard]] PlayedFrame played(const Player& player, const App& app);

// First frame in which at least so much of the contact slips; none: never.
[[nodiscard]] std::optional<double> onset_s(const std::vector<PlayedFrame>& frames, scene::SlipLevel level);

// One promise of the scene, and how it went.
struct Promise {
  std::string what;
  std::string result;
  bool met = false;
};
[[nodiscard]] std::vector<Promise> check_promises(const scene::Expect& expect, const std::vector<PlayedFrame>& frames);
// The goals of the scene, and how far it got: `met` = reached.
[[nodiscard]] std::vector<Promise> check_goals(const scene::Goal& goal, const std::vector<PlayedFrame>& frames);
// "slip within 80 ms of the onset: after 560 ms, not reached yet". What another tree or level than the scene's reaches
// is no promise of the product: `committed` false.
[[nodiscard]] std::string goal_line(const Promise& goal, bool committed = true);

// The firmware with simulated lines, for whoever needs no files: `trade`, tests.
[[nodiscard]] std::vector<PlayedFrame> play(const scene::Scene& scene, const Params& params);

// Effects that the scene has switched on and that change nothing it puts out: run once with and once without each.
[[nodiscard]] std::vector<std::string> unused_effects(const scene::Scene& scene);

}  // namespace holdfast::tool
