// SPDX-License-Identifier: Apache-2.0
// The real recordings beside the project (../shared/data/real) through the firmware, judged by an independent
// eye: OpenCV's SimpleBlobDetector. Nothing here is a file of the project; without the recordings the caller skips.
#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "app/pipeline.hpp"

namespace holdfast::test {

// Inclusive frame numbers.
using Interval = std::pair<int, int>;

struct Clip {
  std::filesystem::path path;
  std::string name;
  std::vector<Interval> empty;  // the gel is empty and untouched
};

// The folder of the recordings, or empty when they are not here. HOLDFAST_CLIPS names another one.
[[nodiscard]] std::filesystem::path clips_folder();
[[nodiscard]] std::vector<Clip> clips_in(const std::filesystem::path& folder);

struct ClipFigures {
  std::string name;
  std::string error;  // not empty: the clip could not be judged
  int frames = 0;
  int frames_all_valid = 0;      // the firmware says: all markers found
  int frames_judged = 0;         // every `stride`-th frame
  int frames_all_confirmed = 0;  // of those: a dark blob of OpenCV's within 1 px of each marker that is valid
  long markers_judged = 0;
  long markers_confirmed = 0;
  double worst_confirmed_px = 0;  // largest distance among the confirmed
  int order_inversions = 0;       // neighbours along a row or column on the wrong sides of each other
  int not_home = 0;               // markers in empty frames further than 0.3 pitch from their rest position
  // Rest jitter over the empty intervals of 20 frames and more: variances summed over markers, in px^2.
  double variance_x = 0, variance_y = 0;
  long variance_count = 0;
  unsigned searches = 0;
};

// Replays the clip with its last frame as reference (for tracking it does not matter that some end loaded).
// Judges every `stride`-th frame. `each` is called after every frame with what the firmware found.
struct FrameSeen {
  int frame = 0;
  const pipeline::State* state = nullptr;
  const pipeline::Result* result = nullptr;
};
[[nodiscard]] ClipFigures follow(const Clip& clip, int stride, void (*each)(const FrameSeen&, void*) = nullptr,
                                 void* context = nullptr);

// Standard deviation in px.
[[nodiscard]] double jitter_x_px(const std::vector<ClipFigures>& all);
[[nodiscard]] double jitter_y_px(const std::vector<ClipFigures>& all);

}  // namespace holdfast::test
