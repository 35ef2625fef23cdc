// SPDX-License-Identifier: Apache-2.0
// Makes samples: simulated grasps, or recordings with labels, through the firmware's own features.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "app/pipeline.hpp"
#include "drivers/sim/recording.hpp"
#include "drivers/sim/scene/contact/contact.hpp"
#include "drivers/sim/scene/scene.hpp"
#include "params/params.hpp"
#include "toolchain/learn/labels.hpp"
#include "toolchain/learn/samples.hpp"

namespace holdfast::learn {

// One grasp to play. `trial` has no rows yet.
struct Planned {
  Trial trial;
  scene::Scene scene;
};

// What the truth of one grasp says, frame by frame: empty without contact (under 0.02 N); open from the release on,
// which is after the last frame that presses with half of the largest force; else slip when more than half of the
// contact's area slips (contact.hpp, SlipLevel::kHalf), else hold.
struct Truth {
  double normal_n = 0.0;
  scene::SlipLevel level = scene::SlipLevel::kNone;
};
inline constexpr double kTouch_n = 0.02;  // less is a touch at most: the gel's own noise is as large
[[nodiscard]] std::vector<Label> labels_of(std::span<const Truth> truth);

// Plays one scene by the default parameters and appends its trial, with these labels.
void play_into(Samples& samples, const Planned& planned, scene::Inject inject = scene::Inject::kMarkers);

// One labelled clip, whole. Its rest position: recordings.cpp.
struct RecordedClip {
  Trial trial;  // no rows yet
  std::vector<sim::RecordedFrame> frames;
  std::vector<Label> labels;  // one a frame
  sim::RecordedFrame rest;    // shows the empty gel
  ClipLabels by_frames;       // as the label file has them
};
// Every one of these clips (read_labels), one at a time. Returns nothing, or an error line; so does `visit`, of which
// the clip's place need not be part. `luma`: of who plays them; a picture of the empty gel that lies beside the clips
// is read at its scale. `progress`: clips done of all; false stops.
[[nodiscard]] std::optional<std::string> load_recordings(
    const std::vector<ClipLabels>& clips, const luma_input::Config& luma,
    const std::function<std::optional<std::string>(const RecordedClip&)>& visit,
    const std::function<bool(int, int)>& progress = {});
// The rest position and the empty gel. Nothing, or why it cannot.
[[nodiscard]] std::optional<std::string> learn_rest(const RecordedClip& clip, const pipeline::Config& config,
                                                    JpegDecoder& jpeg, pipeline::State& state);

// The clips' frames as samples.
[[nodiscard]] std::optional<std::string> read_recordings(const std::filesystem::path& labels, const Params& params,
                                                         Samples& samples,
                                                         const std::function<bool(int, int)>& progress = {});

}  // namespace holdfast::learn
