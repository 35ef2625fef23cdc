// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/clip_score.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "base/math.hpp"

namespace holdfast::learn {
namespace {

constexpr int kHoldFrames = 5;
constexpr int kStaleStart = 13;       // frames that may still show an earlier grip, where contact begins later
constexpr int kBeginsLater = 3;       // contact from a later frame on begins inside the clip
constexpr int kTouchFrames = 12;      // after the first contact
constexpr int kShortestShaken = 400;  // clips of fewer frames are short grasps

bool touches(const ClipLabels& clip) {
  return clip.contact && clip.contact->from > kBeginsLater;
}

bool within(const std::optional<Frames>& frames, int before, int frame, int after) {
  return frames && frame >= frames->from - before && frame <= frames->to + after;
}

bool is_second_slip(const ClipLabels& clip) {
  return clip.event && clip.event_kind == "second_slip_loss";
}

bool rises(std::span<const std::uint8_t> slip, int frame) {
  return slip[idx(frame)] != 0 && (frame == 0 || slip[idx(frame - 1)] == 0);
}

// What came of an onset, for people; empty when it was detected.
std::string judge_onset(Onsets& onsets, const ClipLabels& clip, int onset, std::span<const std::uint8_t> slip) {
  const int frames = static_cast<int>(slip.size());
  int from = std::max(0, onset - kEarly);
  for (int t = from; t < onset; ++t) {
    if (std::ranges::any_of(clip.silent, [&](const SilentFrames& one) { return one.has(t); })) from = t + 1;
  }
  int first = from;
  while (first < frames && !rises(slip, first)) ++first;
  const int delay = std::max(0, first - onset);
  ++onsets.count;
  for (std::size_t k = 0; k < kWithin.size(); ++k) onsets.within[k] += first < frames && delay <= kWithin[k] ? 1 : 0;
  if (first < frames && delay <= kWithin.back()) {
    onsets.delays.push_back(delay);
    return {};
  }
  if (frames == 0) return "the clip was not replayed";
  int since = std::min(onset, frames - 1);
  if (slip[idx(since)] != 0) {
    while (since > 0 && slip[idx(since - 1)] != 0) --since;
    return fmt::format("slip was raised already, in frame {}", since);
  }
  return first < frames ? fmt::format("next alarm {} frames after it", delay) : "no alarm after it";
}

Alarms& operator+=(Alarms& sum, const Alarms& other) {
  sum.count += other.count;
  sum.frames += other.frames;
  return sum;
}

void add_frame(Alarms& alarms, bool alarm) {
  ++alarms.frames;
  alarms.count += alarm ? 1 : 0;
}

}  // namespace

std::optional<double> Alarms::per_minute() const {
  if (frames == 0) return std::nullopt;
  return count / minutes();
}

Alarms ClipScore::whole() const {
  Alarms sum;
  for (const Phase phase : {Phase::kEmpty, Phase::kTouch, Phase::kHold, Phase::kShake}) sum += phases[idx(int(phase))];
  return sum;
}

bool is_shaken(const ClipLabels& clip, int frame) {
  return frame >= 100 && frame <= 250 && clip.object != "artificial_strawberry";
}

Phase phase_of(const ClipLabels& clip, int frame, int frames) {
  if (clip.confidence == Confidence::kLow) return Phase::kUnscored;
  if (touches(clip) && frame < kStaleStart) return Phase::kUnscored;
  if (within(clip.slip, 3, frame, 15)) return Phase::kSlip;
  if (is_second_slip(clip) && within(clip.event, 5, frame, 15)) return Phase::kSlip;
  if (within(clip.release, 5, frame, 5)) return Phase::kRelease;
  if (within(clip.event, 5, frame, 5)) return clip.event_kind == "contact_lost" ? Phase::kRelease : Phase::kLoadStep;
  if (touches(clip) && frame >= clip.contact->from - 1 && frame <= clip.contact->from + kTouchFrames) {
    return Phase::kTouch;
  }
  if (clip.is_empty(frame)) return Phase::kEmpty;
  return frames >= kShortestShaken && is_shaken(clip, frame) ? Phase::kShake : Phase::kHold;
}

void add_clip(ClipScore& score, const ClipLabels& clip, std::span<const std::uint8_t> slip,
              std::vector<Finding>* findings) {
  const int frames = static_cast<int>(slip.size());
  const auto onset = [&](Onsets& onsets, int frame, std::string_view name) {
    std::string missed = judge_onset(onsets, clip, frame, slip);
    if (missed.empty() || findings == nullptr) return;
    missed = fmt::format("missed {} {}: {}", name, frame, missed);
    findings->push_back({&clip, frame, true, false, Phase::kSlip, std::move(missed)});
  };
  if (clip.confidence != Confidence::kLow) {
    if (clip.slip && clip.onset_recorded) onset(score.onsets, clip.slip->from, "onset");
    if (is_second_slip(clip)) onset(score.seconds, clip.event->from, "second slip");
  }
  bool at_touch = false;
  for (int t = 0; t < frames; ++t) {
    const bool alarm = rises(slip, t);
    const bool silent = clip.is_silent(t);
    const bool empty = clip.is_empty(t);
    const Phase phase = phase_of(clip, t, frames);
    if (silent) add_frame(score.silent, alarm);
    if (silent && is_shaken(clip, t)) add_frame(score.shaken, alarm);
    if (empty) add_frame(score.empty, alarm);
    if (phase != Phase::kSlip && phase != Phase::kUnscored) add_frame(score.phases[idx(int(phase))], alarm);
    at_touch = at_touch || (alarm && phase == Phase::kTouch);
    if (alarm && findings != nullptr) {
      findings->push_back({&clip, t, false, silent || empty, phase, "alarm " + nearest_label(clip, t)});
    }
  }
  if (clip.confidence == Confidence::kLow || frames == 0) return;
  ++score.trials;
  score.touches += touches(clip) ? 1 : 0;
  score.touches_alarmed += at_touch ? 1 : 0;
}

std::string nearest_label(const ClipLabels& clip, int frame) {
  struct Named {
    std::string name;
    Frames frames;
  };
  std::vector<Named> all;
  for (const SilentFrames& one : clip.silent) {
    all.push_back({one.sure() ? "silent" : "silent (low confidence)", {one.from, one.to}});
  }
  for (const Frames& one : clip.empty) all.push_back({"empty", one});
  if (clip.slip) all.push_back({"slip", *clip.slip});
  if (clip.event) all.push_back({clip.event_kind.empty() ? "event" : clip.event_kind, *clip.event});
  if (clip.release) all.push_back({"release", *clip.release});
  if (touches(clip)) all.push_back({"first contact", {clip.contact->from, clip.contact->from}});
  const auto away = [&](const Named& one) { return std::max({0, one.frames.from - frame, frame - one.frames.to}); };
  const auto nearest = std::ranges::min_element(all, {}, away);
  if (nearest == all.end()) return "without a label";
  const std::string name = nearest->frames.from == nearest->frames.to
                               ? fmt::format("{} {}", nearest->name, nearest->frames.from)
                               : fmt::format("{} {}-{}", nearest->name, nearest->frames.from, nearest->frames.to);
  if (away(*nearest) == 0) return "in " + name;
  const int frames = away(*nearest);
  return fmt::format("{} {} {} {}", frames, frames == 1 ? "frame" : "frames",
                     frame < nearest->frames.from ? "before" : "after", name);
}

std::vector<std::uint8_t> held_above(std::span<const double> values, double threshold) {
  std::vector<std::uint8_t> slip(values.size());
  int hold = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    hold = values[i] > threshold ? kHoldFrames : std::max(0, hold - 1);
    slip[i] = hold > 0 ? 1 : 0;
  }
  return slip;
}

std::vector<std::vector<std::uint8_t>> leave_one_object_out(std::span<const ClipValues> clips) {
  constexpr double kStep = 0.98;
  constexpr int kSteps = 600;  // down to 5 millionths of the largest value
  double largest = 0.0;
  std::map<std::string, double> thresholds;  // by object
  for (const ClipValues& one : clips) {
    for (const double value : one.values) largest = std::max(largest, value);
    thresholds[one.clip->object] = 0.0;
  }
  // Alarms of each clip at each threshold, so that an object costs no more than a sum.
  std::vector<std::vector<int>> counts(clips.size());
  std::vector<int> budgets(clips.size());
  for (std::size_t c = 0; c < clips.size(); ++c) {
    const ClipLabels& clip = *clips[c].clip;
    std::vector<int> quiet;
    for (int t = 0; t < static_cast<int>(clips[c].values.size()); ++t) {
      if (clip.is_silent(t) || clip.is_empty(t)) quiet.push_back(t);
    }
    const auto alarms = [&](std::span<const std::uint8_t> slip) {
      return static_cast<int>(std::ranges::count_if(quiet, [&](int t) { return rises(slip, t); }));
    };
    budgets[c] = alarms(clips[c].budget);
    double threshold = largest;
    for (int step = 0; step < kSteps; ++step, threshold *= kStep) {
      counts[c].push_back(alarms(held_above(clips[c].values, threshold)));
    }
  }
  for (auto& [object, chosen] : thresholds) {
    const auto others = [&, &without = object](const auto& count) {
      int sum = 0;
      for (std::size_t c = 0; c < clips.size(); ++c) sum += clips[c].clip->object == without ? 0 : count(c);
      return sum;
    };
    const int budget = others([&](std::size_t c) { return budgets[c]; });
    double threshold = largest;
    chosen = largest;
    for (int step = 0; step < kSteps; ++step, threshold *= kStep) {
      if (others([&](std::size_t c) { return counts[c][idx(step)]; }) > budget) break;
      chosen = threshold;
    }
  }
  std::vector<std::vector<std::uint8_t>> decisions;
  for (const ClipValues& one : clips) decisions.push_back(held_above(one.values, thresholds.at(one.clip->object)));
  return decisions;
}

}  // namespace holdfast::learn
