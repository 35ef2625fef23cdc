// SPDX-License-Identifier: Apache-2.0
// The report of one run: a single HTML file that needs nothing else to be read.
//
// Verdict, alarms and summary are readable without a script. With one (page.hpp) there are time plots on one axis (E,
// dE/dt, Vx and Vy, optional truth, state, GRIP_OK, ALIVE), each frame, and a live session as well.
// Light and dark by the reader's preference. Long runs are thinned: the file stays below 4 MB whatever the number of
// frames. Times in s of the recording, lengths in pixels of the input, speeds in mm/s, entropy in nat (natural
// logarithm).
#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "toolchain/session/overlay.hpp"
#include "toolchain/session/track.hpp"

namespace holdfast::tool {

using log::FrameRecord;

struct TruthMark {
  double t_s = 0;
  std::string name;
  bool onset = false;  // the summary counts the delay of the slip decision from here
};

struct TruthSeries {
  std::string name;
  std::string unit;
  std::vector<std::pair<double, double>> points;  // t_s, value
};

struct ReportInfo {
  std::string title;
  std::string input;
  std::string clip;  // as SessionInfo::clip
  std::string grid;
  std::string mode;
  std::string model;
  std::string reference;
  std::vector<std::string> notes;
  std::vector<TruthMark> marks;
  std::optional<TruthSeries> series;
  int grid_markers = 63;          // of the grid: what "all" means
  double histogram_range_mm = 0;  // R; 0: the axis counts bins
  long saturations = 0;
};

class Report {
 public:
  // In order of time. `arrows` may be empty.
  void add(const FrameRecord& frame, std::span<const Arrow> arrows, const TrackPicture& picture = {});

  [[nodiscard]] std::string html(const ReportInfo& info) const;

 private:
  std::vector<FrameRecord> frames_;
  Track track_;
};

}  // namespace holdfast::tool
