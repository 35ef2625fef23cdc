// SPDX-License-Identifier: Apache-2.0
// Recordings with labels to samples, each clip through the firmware as `holdfast replay` does it, but for the rest
// position, which stays as learned.
//
// Label file: labels.hpp. Labels: slip from slip_start to slip_end, else hold in silent intervals of high or medium
// confidence, else open.
//
// Onsets: one counts when a hold row comes before it in the trial. A clip with onset_recorded = 0 keeps that rule: what
// comes before its slip is open, so its slip rows are judged as frames and never as an event. (Of the 27 real clips'
// 14 recorded onsets 13 count: in blue_box 2 nothing before the slip is sure.)
//
// Rest position: rest_of(). Lattice: the one that is printed.
//
// Object: the clip's name up to "__exp". The trial's seed is the number after "__exp_num_", to tell clips apart.
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <memory>
#include <utility>
#include <variant>

#include "app/pipeline.hpp"
#include "drivers/sim/recording.hpp"
#include "toolchain/learn/dataset.hpp"
#include "toolchain/learn/firmware_row.hpp"
#include "toolchain/learn/labels.hpp"
#include "toolchain/log/recording_file.hpp"
#include "toolchain/play/reference_picture.hpp"
#include "toolchain/play/rig.hpp"

namespace holdfast::learn {
namespace {

namespace fs = std::filesystem;

using Error = std::optional<std::string>;

Trial trial_of(const ClipLabels& clip) {
  constexpr std::string_view kNumber = "__exp_num_";
  Trial trial;
  trial.source = Source::kRecorded;
  const std::string stem = fs::path(clip.name).stem().string();
  trial.object = clip.object;
  trial.kind = "clip";
  if (const std::size_t at = stem.find(kNumber); at != std::string::npos) {
    (void)std::from_chars(stem.data() + at + kNumber.size(), stem.data() + stem.size(), trial.seed);
  }
  return trial;
}

Label label_of(const ClipLabels& clip, long frame) {
  if (clip.slip && clip.slip->has(frame)) return Label::kSlip;
  const bool before_unseen_onset = clip.slip && !clip.onset_recorded && frame < clip.slip->from;
  if (clip.is_empty(frame)) return Label::kEmpty;
  return clip.is_silent(frame) && !before_unseen_onset ? Label::kHold : Label::kOpen;
}

Error load_clip(const ClipLabels& clip, const luma_input::Config& luma, RecordedClip& out) {
  auto opened = log::open_recording(clip.path);
  if (const auto* error = std::get_if<sim::Error>(&opened)) return error->line;
  auto& recording = std::get<sim::Recording>(opened);
  auto end = recording.at("last");
  if (const auto* error = std::get_if<sim::Error>(&end)) return error->line;
  if (Error bad = check_length(clip, std::get<sim::RecordedFrame>(end).index + 1)) return bad;
  auto picture = tool::reference_picture(recording, rest_of(clip).reference, luma);
  if (const auto* error = std::get_if<sim::Error>(&picture)) return error->line;
  out.rest = std::get<sim::RecordedFrame>(std::move(picture));
  sim::RecordedFrame frame;
  sim::Read read = sim::Read::kFrame;
  while ((read = recording.next(frame)) == sim::Read::kFrame) {
    out.labels.push_back(label_of(clip, frame.index));
    out.frames.push_back(frame);
  }
  if (read == sim::Read::kError) return recording.error();
  out.trial = trial_of(clip);
  out.by_frames = clip;
  return {};
}

}  // namespace

std::optional<std::string> load_recordings(const std::vector<ClipLabels>& clips, const luma_input::Config& luma,
                                           const std::function<Error(const RecordedClip&)>& visit,
                                           const std::function<bool(int, int)>& progress) {
  const int all = static_cast<int>(clips.size());
  for (int done = 0; done < all; ++done) {
    const ClipLabels& clip = clips[idx(done)];
    RecordedClip loaded;
    if (Error bad = load_clip(clip, luma, loaded)) return bad;
    if (Error bad = visit(loaded)) {
      return fmt::format("{}:{}: {}: {}", clip.file.string(), clip.line, clip.path.string(), *bad);
    }
    if (progress && !progress(done + 1, all)) {
      return fmt::format("{}: stopped after clip {} of {}. Likely cause: you asked for it. Next: run it again",
                         clip.file.string(), done + 1, all);
    }
  }
  return {};
}

std::optional<std::string> learn_rest(const RecordedClip& clip, const pipeline::Config& config, JpegDecoder& jpeg,
                                      pipeline::State& state) {
  if (const Status s = pipeline::learn(state, config, jpeg, sim::as_frame(clip.rest)); !s.ok()) {
    const ReasonInfo& why = info(s.reason);
    return fmt::format("no rest position: {}. Likely cause: {}. Next: {}", why.what, why.cause, why.next);
  }
  return {};
}

std::optional<std::string> read_recordings(const fs::path& labels, const Params& params, Samples& samples,
                                           const std::function<bool(int, int)>& progress) {
  const pipeline::Config config = pipeline_config(with_all_features(params), true);
  tool::OneThreadDecoder jpeg(params);
  const auto play = [&](const RecordedClip& clip) -> Error {
    const auto state = std::make_unique<pipeline::State>();
    if (Error bad = learn_rest(clip, config, jpeg.get(), *state)) return bad;
    Trial trial = clip.trial;
    trial.first = static_cast<int>(samples.rows.size());
    trial.count = static_cast<int>(clip.frames.size());
    for (std::size_t k = 0; k < clip.frames.size(); ++k) {
      const sim::RecordedFrame& recorded = clip.frames[k];
      Row row = firmware_row(pipeline::update(*state, config, jpeg.get(), sim::as_frame(recorded)));
      row.trial = static_cast<int>(samples.trials.size());
      row.frame = static_cast<int>(recorded.index);
      row.t_s = static_cast<double>(recorded.time.count()) * 1e-6;
      row.label = clip.labels[k];
      row.slip_fraction = row.label == Label::kSlip ? 1.0 : 0.0;
      samples.rows.push_back(row);
    }
    samples.trials.push_back(std::move(trial));
    return {};
  };
  std::vector<ClipLabels> clips;
  Error bad = read_labels(labels, clips);
  if (!bad) bad = load_recordings(clips, config.luma, play, progress);
  if (bad) samples = {};
  return bad;
}

}  // namespace holdfast::learn
