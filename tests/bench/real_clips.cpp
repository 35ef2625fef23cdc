// SPDX-License-Identifier: Apache-2.0
// real_clips [STRIDE]: the tracking table of the real recordings; every STRIDE-th frame is judged by OpenCV's
// blob detector (default 1: all). The tests assert the same figures.
#include <fmt/format.h>

#include <cstdlib>

#include "tests/support/host_clips.hpp"

int main(int argc, char** argv) {
  using namespace holdfast::test;
  const int stride = argc > 1 ? std::max(1, std::atoi(argv[1])) : 1;
  const auto folder = clips_folder();
  if (folder.empty()) {
    fmt::print("SKIPPED: the recordings are not here (../shared/data/real beside the clone, or HOLDFAST_CLIPS)\n");
    return 77;
  }
  fmt::print("{:44} {:>6} {:>9} {:>9} {:>9} {:>7} {:>5} {:>8} {:>7} {:>7} {:>8}\n", "clip", "frames", "all found",
             "confirmed", "markers", "worst", "order", "not home", "jit. x", "jit. y", "searches");
  std::vector<ClipFigures> all;
  int bad = 0;
  for (const Clip& clip : clips_in(folder)) {
    const ClipFigures f = follow(clip, stride);
    if (!f.error.empty()) {
      fmt::print("{:44} {}\n", f.name, f.error);
      ++bad;
      continue;
    }
    all.push_back(f);
    fmt::print("{:44} {:6} {:8.2f}% {:8.2f}% {:8.3f}% {:7.2f} {:5} {:8} {:7.3f} {:7.3f} {:8}\n", f.name, f.frames,
               100.0 * f.frames_all_valid / f.frames, 100.0 * f.frames_all_confirmed / f.frames_judged,
               100.0 * static_cast<double>(f.markers_confirmed) / static_cast<double>(f.markers_judged),
               f.worst_confirmed_px, f.order_inversions, f.not_home, jitter_x_px({f}), jitter_y_px({f}), f.searches);
  }
  long frames = 0, found = 0, judged = 0, confirmed = 0;
  for (const ClipFigures& f : all) {
    frames += f.frames;
    found += f.frames_all_valid;
    judged += f.frames_judged;
    confirmed += f.frames_all_confirmed;
  }
  if (all.empty()) return 1;
  fmt::print("{:44} {:6} {:8.2f}% {:8.2f}% {:>9} {:>7} {:>5} {:>8} {:7.3f} {:7.3f}\n", "all", frames,
             100.0 * static_cast<double>(found) / static_cast<double>(frames),
             100.0 * static_cast<double>(confirmed) / static_cast<double>(judged), "", "", "", "", jitter_x_px(all),
             jitter_y_px(all));
  fmt::print(
      "all found: frames with every marker valid. confirmed: of the judged frames, those with a dark blob of "
      "OpenCV's\n"
      "within 1 px of every valid marker. worst: largest such distance, px. order: inversions of neighbours. not "
      "home:\n"
      "markers over 0.3 pitch from rest on the empty gel. jitter: standard deviation on the empty gel, px at "
      "320x240.\n");
  return bad == 0 ? 0 : 1;
}
