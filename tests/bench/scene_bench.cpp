// SPDX-License-Identifier: Apache-2.0
// What a frame of the simulator costs: each contact level with the motion of 63 markers, and the pictures. Median of
// thread CPU time over the frames of one drag, repeated; the machine's load shows in the largest.
#include <fmt/format.h>

#include <algorithm>
#include <ctime>
#include <functional>
#include <string>
#include <vector>

#include "drivers/sim/camera_scene.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/scene/simulation.hpp"

namespace {

using namespace holdfast;

double thread_us() {
  timespec now{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) * 1e6 + static_cast<double>(now.tv_nsec) * 1e-3;
}

void report(const std::string& what, std::vector<double> us, double goal_us) {
  std::sort(us.begin(), us.end());
  const double median = us[us.size() / 2];
  fmt::print("{:44} {:10.2f} us  (p99 {:.2f})", what, median, us[us.size() * 99 / 100]);
  if (goal_us > 0.0) fmt::print("   goal {:.0f}: {}", goal_us, median <= goal_us ? "ok" : "short");
  fmt::print("\n");
}

// A sphere held with 3 N on the default gel and dragged at 8 mm/s through partial into gross slip.
scene::Scene drag(scene::ContactLevel level, bool twist) {
  scene::Scene scene;
  scene.name = "drag";
  scene.duration_s = 1.4;
  scene.level.contact = level;
  scene.trajectory = {{.t_s = 0.0, .force_n = 0.0, .x_mm = 0.0, .y_mm = 0.0, .twist_deg = 0.0},
                      {.t_s = 0.2, .force_n = 3.0, .x_mm = 0.0, .y_mm = 0.0, .twist_deg = 0.0},
                      {.t_s = 1.4, .force_n = 3.0, .x_mm = 2.4, .y_mm = 1.0, .twist_deg = twist ? 12.0 : 0.0}};
  return scene;
}

void bench_level(scene::ContactLevel level, bool twist, double goal_us) {
  std::vector<double> us;
  for (int repeat = 0; repeat < 20; ++repeat) {
    const scene::Scene scene = drag(level, twist);
    scene::Simulation simulation(scene);
    for (int k = 0; k < scene::frame_count(scene); ++k) {
      const double start = thread_us();
      (void)simulation.next();
      const double end = thread_us();
      if (k > 6) us.push_back(end - start);
    }
    if (level == scene::ContactLevel::kGrid && repeat == 4) break;
  }
  report(fmt::format("{}, {}", scene::kContactLevelNames[static_cast<std::size_t>(level)],
                     twist ? "drag and twist" : "drag"),
         us, goal_us);
}

void bench_picture(scene::Inject inject, double goal_us) {
  scene::Scene scene = drag(scene::ContactLevel::kSprings, false);
  scene.level.inject = inject;
  scene.effects.pixel_noise = 3.0;
  std::vector<double> us;
  for (int repeat = 0; repeat < (inject == scene::Inject::kGrey ? 8 : 1); ++repeat) {
    sim::Clock clock;
    sim::SceneCamera camera(scene, clock);
    hal::Frame frame;
    if (!camera.start()) return;
    while (true) {
      const double start = thread_us();
      if (camera.next(frame, std::chrono::milliseconds(100)) != hal::Capture::kFrame) break;
      us.push_back(thread_us() - start);
      camera.release(frame);
    }
  }
  report(inject == scene::Inject::kGrey ? "grey picture 410x308, 63 dots, noise" : "JPEG 3280x2464, quality 85", us,
         goal_us);
}

}  // namespace

int main() {
  fmt::print("one frame, 63 markers, default gel (4.25 mm)\n");
  bench_level(scene::ContactLevel::kSprings, false, 10.0);
  bench_level(scene::ContactLevel::kGrid, false, 1000.0);
  bench_level(scene::ContactLevel::kSprings, true, 0.0);
  bench_level(scene::ContactLevel::kGrid, true, 0.0);
  bench_picture(scene::Inject::kGrey, 1000.0);
  bench_picture(scene::Inject::kJpeg, 0.0);
}
