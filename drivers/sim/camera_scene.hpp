// SPDX-License-Identifier: Apache-2.0
// A camera that films a scene in virtual time: frame k shows the instant k / fps, is stamped start + k / fps and
// carries sequence k. The scene's own faults are not in it: faults_of() is the plan for a FaultyCamera around it.
//
// Waiting for a frame moves the clock, at most by the timeout asked for. After the last frame the camera is gone. A
// restart goes on with the scene where it stands: what is plugged in again sees the grasp go on. One frame is lent at a
// time.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "drivers/sim/camera_faults.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/scene/picture/render.hpp"
#include "drivers/sim/scene/simulation.hpp"
#include "hal/camera.hpp"

namespace holdfast::sim {

// The picture of a scene: size, dots, light and effects. Scenes that enter at markers have the picture of level grey.
[[nodiscard]] scene::PictureConfig picture_of(const scene::Scene& scene);
[[nodiscard]] std::vector<FaultSpan> faults_of(const scene::Scene& scene);
// The longest frame: what a FaultyCamera has to hold.
[[nodiscard]] std::size_t most_bytes(const scene::Scene& scene);

class SceneCamera final : public hal::Camera {
 public:
  // `drive`: what moves the object instead of the script, asked for each frame; may be empty.
  using DriveAt = std::function<scene::Drive(double t_s)>;
  SceneCamera(const scene::Scene& scene, Clock& clock, DriveAt drive = {});

  // Of the frame lent last; of nothing before the first.
  [[nodiscard]] const scene::Snapshot& snapshot() const { return *snapshot_; }
  [[nodiscard]] const hal::Frame& lent() const { return lent_; }
  // Exact centres of its markers in pixels of the picture, index = row * cols + col.
  [[nodiscard]] std::span<const scene::PointPx> marker_centers() const { return centers_; }
  [[nodiscard]] const scene::PictureConfig& picture() const { return picture_; }
  [[nodiscard]] const scene::Simulation& simulation() const { return simulation_; }

  // The next frame happens and nobody takes a picture of it; the clock stands.
  void pass();

 private:
  [[nodiscard]] bool do_start() override;
  [[nodiscard]] hal::Capture do_next(hal::Frame& frame, std::chrono::microseconds timeout) override;
  void do_release(const hal::Frame&) override {}
  void do_stop() override {}
  [[nodiscard]] bool do_live() const override { return false; }

  [[nodiscard]] std::chrono::microseconds due() const;
  void film(const scene::ContactState& contact_before);

  scene::Simulation simulation_;
  Clock& clock_;
  DriveAt drive_;
  scene::PictureConfig picture_;
  scene::Underside underside_;
  bool luma_;
  std::chrono::microseconds start_{};
  bool started_ = false;
  int next_ = 0;
  scene::Snapshot nothing_;
  const scene::Snapshot* snapshot_ = &nothing_;
  hal::Frame lent_;
  std::vector<scene::SeenMarker> seen_;
  std::vector<scene::PointPx> centers_, dots_, dots_end_;
  std::vector<std::uint8_t> pixels_;
  std::vector<std::uint8_t> jpeg_;
};

}  // namespace holdfast::sim
