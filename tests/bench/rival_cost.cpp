// SPDX-License-Identifier: Apache-2.0
// rival_cost FILM WHICH N: as setting_cost, for what others do with the same pictures (trade/knobs.hpp, Rival), WHICH
// as `holdfast trade settings` names it. Host only.
#include <cstdio>
#include <cstdlib>
#include <string_view>

#include "tests/support/film_file.hpp"
#include "toolchain/trade/rival.hpp"

int main(int argc, char** argv) {
  using namespace holdfast;
  const auto which = argc == 4 ? trade::find_rival(argv[2]) : std::nullopt;
  if (!which) {
    std::fputs("usage: rival_cost FILM WHICH N\n", stderr);
    return 2;
  }
  const std::vector<test::Jpeg> pictures = test::read_mjpg(argv[1]);
  const auto frames = static_cast<std::size_t>(std::atol(argv[3]));
  if (pictures.size() < frames) {
    std::fprintf(stderr, "error: %s: %zu pictures (not there, or cut off). Next: write it with setting_cost FILM\n",
                 argv[1], pictures.size());
    return 1;
  }
  const scene::PictureConfig camera = scene::camera_3280x2464();
  trade::Film film;
  trade::Shot& shot = film.shots.emplace_back();
  shot.markers = scene::dot_centers_px(camera, scene::Simulation(scene::sphere_slip()).markers());
  trade::RivalTracker rival(*which);
  rival.begin(film);
  for (std::size_t i = 0; i < frames; ++i) rival.update(pictures[i]);
  return 0;
}
