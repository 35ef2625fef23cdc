// SPDX-License-Identifier: Apache-2.0
#include "toolchain/session/report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <span>
#include <string_view>

#include "slip/evidence.hpp"
#include "toolchain/session/page.hpp"
#include "toolchain/support/escape.hpp"

namespace holdfast::tool {
namespace {

constexpr long kMaxAliveEdges = 400;  // more would run together into a block (charts.js)

// The shown states by severity; colours from Okabe and Ito's palette, told apart also by the colour-blind.
struct StateLook {
  DeviceState state;
  std::string_view css;
};
constexpr std::array<StateLook, 6> kBySeverity{{{DeviceState::kOk, "ok"},
                                                {DeviceState::kReference, "reference"},
                                                {DeviceState::kBoot, "boot"},
                                                {DeviceState::kDegraded, "degraded"},
                                                {DeviceState::kSlip, "slip"},
                                                {DeviceState::kFault, "fault"}}};

int severity(DeviceState state) {
  for (std::size_t i = 0; i < kBySeverity.size(); ++i) {
    if (kBySeverity[i].state == state) return static_cast<int>(i);
  }
  return 0;
}

std::string plural(long n, std::string_view what) {
  return fmt::format("{} {}{}", n, what, n == 1 ? "" : "s");
}

// Frames in which `slip` begins.
std::vector<std::size_t> slip_starts(const std::vector<FrameRecord>& frames) {
  std::vector<std::size_t> starts;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (frames[i].slip && (i == 0 || !frames[i - 1].slip)) starts.push_back(i);
  }
  return starts;
}

// Why a frame says slip, in a sentence.
std::string why_text(const FrameRecord& frame) {
  constexpr std::array<std::string_view, kEvidenceNames.size()> kWords{
      "",
      "the imprint moved against the gel by",
      "the imprint's coarse shape moved against the gel by",
      "the markers' flow is",
      "",
      "another imprint has taken the place of"};
  const std::string_view words = kWords[static_cast<std::size_t>(frame.evidence)];
  if (words.empty()) return "";
  std::string out = fmt::format("{} {:.3g} {} (threshold {:.3g})", words, frame.evidence_value, frame.evidence_unit,
                                frame.evidence_threshold);
  if (frame.evidence_frames > 1) out += fmt::format(", {} frames in a row", frame.evidence_frames);
  return out;
}

struct Delay {
  bool raised = false;
  bool early = false;  // raised already when the onset came
  long frames = 0;
  double ms = 0;
  std::size_t at = 0;
};

// Frames keep whole microseconds, marks do not.
bool is_before(const FrameRecord& frame, double t_s) {
  return frame.t_s() < t_s - 0.5e-6;
}

// From the first frame that could show the onset to the first frame that says slip.
Delay delay_from(const std::vector<FrameRecord>& frames, double onset_s) {
  Delay delay;
  const auto first = std::find_if(frames.begin(), frames.end(), [&](const auto& f) { return !is_before(f, onset_s); });
  const auto raised = std::find_if(first, frames.end(), [](const FrameRecord& f) { return f.slip; });
  if (raised == frames.end()) return delay;
  delay.raised = true;
  delay.early = raised == first && first != frames.begin() && std::prev(first)->slip;
  delay.frames = static_cast<long>(raised - first);
  delay.ms = std::max(raised->t_s() - onset_s, 0.0) * 1000;
  delay.at = static_cast<std::size_t>(raised - frames.begin());
  return delay;
}

std::string delay_text(const Delay& delay, const std::string& mark) {
  if (!delay.raised) return fmt::format("Slip was not raised after {}", mark);
  if (delay.early) return fmt::format("Slip was already raised at {}", mark);
  if (delay.frames == 0) return fmt::format("Slip raised in the first frame of {} ({:.0f} ms)", mark, delay.ms);
  return fmt::format("Slip raised {} ({:.0f} ms) after {}", plural(delay.frames, "frame"), delay.ms, mark);
}

struct Totals {
  long accepted = 0, with_features = 0, grip_ok = 0;
  double mean_markers = 0;
  std::uint32_t worst_markers = 0;
  long worst_markers_frame = 0;
  std::map<Reason, long> reasons;
};

Totals summarise(const std::vector<FrameRecord>& frames) {
  Totals s;
  s.worst_markers = std::numeric_limits<std::uint32_t>::max();
  for (const FrameRecord& f : frames) {
    s.accepted += f.accepted ? 1 : 0;
    s.grip_ok += f.grip_ok ? 1 : 0;
    if (f.reason != Reason::kNone) ++s.reasons[f.reason];
    if (!f.features_valid) continue;
    ++s.with_features;
    s.mean_markers += f.markers;
    if (f.markers < s.worst_markers) s.worst_markers = f.markers, s.worst_markers_frame = f.frame;
  }
  if (s.with_features > 0) s.mean_markers /= static_cast<double>(s.with_features);
  return s;
}

std::string percent(long part, std::size_t whole) {
  const double value = 100.0 * static_cast<double>(part) / static_cast<double>(whole);
  // "100 %" is said only when it is true.
  return part == static_cast<long>(whole) ? "100 %" : fmt::format("{:.1f} %", std::min(value, 99.9));
}

std::string verdict(const std::vector<FrameRecord>& frames, const ReportInfo& info,
                    const std::vector<std::size_t>& starts) {
  std::string text, small;
  std::string_view css = starts.empty() ? "ok" : "slip";
  const auto onset = std::find_if(info.marks.begin(), info.marks.end(), [](const auto& m) { return m.onset; });
  if (onset != info.marks.end()) {
    const Delay delay = delay_from(frames, onset->t_s);
    text = delay_text(delay, onset->name);
    small = fmt::format("Truth: {} at {:.3f} s.", onset->name, onset->t_s);
    if (delay.raised)
      small += fmt::format(" Raised in frame {}, {:.3f} s.", frames[delay.at].frame, frames[delay.at].t_s());
    const auto before =
        std::count_if(starts.begin(), starts.end(), [&](std::size_t i) { return is_before(frames[i], onset->t_s); });
    small += fmt::format(" {} before it.", before == 0 ? "No alarm" : plural(before, "alarm"));
    if (!delay.raised) css = "fault";
  } else if (starts.empty()) {
    text = "No slip raised";
    small = fmt::format("{} over {:.2f} s.", plural(static_cast<long>(frames.size()), "frame"),
                        frames.back().t_s() - frames.front().t_s());
  } else {
    const FrameRecord& first = frames[starts.front()];
    text = fmt::format("Slip raised {}, first at {:.3f} s",
                       starts.size() == 1 ? "once" : plural(static_cast<long>(starts.size()), "time"), first.t_s());
    small = fmt::format("First in frame {}.", first.frame);
    if (const std::string why = why_text(first); !why.empty()) small += " Why: " + why + ".";
  }
  return fmt::format(R"(<div class="verdict {}">{}<small>{}</small></div>)", css, escape(text), escape(small));
}

std::string row(const std::string& name, const std::string& value) {
  return value.empty() ? "" : fmt::format("<tr><th>{}</th><td>{}</td></tr>\n", escape(name), escape(value));
}

std::string summary_table(const std::vector<FrameRecord>& frames, const ReportInfo& info, const Totals& s,
                          const std::vector<std::size_t>& starts) {
  std::string out = "<table>";
  out += row("Input", info.input) + row("Grid", info.grid) + row("Mode", info.mode) + row("Model", info.model) +
         row("Reference", info.reference);
  out += row("Frames", fmt::format("{} over {:.3f} s", frames.size(), frames.back().t_s() - frames.front().t_s()));
  out += row("Accepted frames", fmt::format("{} ({})", s.accepted, percent(s.accepted, frames.size())));
  if (s.with_features > 0) {
    out += row("Markers", fmt::format("mean {:.2f} of {}, worst {} in frame {}", s.mean_markers, info.grid_markers,
                                      s.worst_markers, s.worst_markers_frame));
  }
  std::string times;
  constexpr std::size_t kListed = 12;
  for (std::size_t i = 0; i < std::min(starts.size(), kListed); ++i) {
    times += fmt::format("{}{:.3f} s (frame {})", i == 0 ? "" : ", ", frames[starts[i]].t_s(), frames[starts[i]].frame);
  }
  if (starts.size() > kListed) times += fmt::format(" and {} more", starts.size() - kListed);
  out += row("Slip raised", starts.empty() ? "never" : times);
  for (const TruthMark& mark : info.marks) {
    out +=
        row("Truth: " + mark.name, fmt::format("{:.3f} s", mark.t_s) +
                                       (mark.onset ? ". " + delay_text(delay_from(frames, mark.t_s), mark.name) : ""));
  }
  out += row("GRIP_OK HIGH", fmt::format("{} frames ({})", s.grip_ok, percent(s.grip_ok, frames.size())));
  out += row("Saturated values", std::to_string(info.saturations));
  return out + "</table>";
}

std::string reason_table(const Totals& s) {
  if (s.reasons.empty()) return "";
  std::string out = "<h2>Reasons given</h2>\n<table class=\"wide\">";
  out +=
      "<tr><th>Reason</th><th style=\"text-align:right\">Frames</th><th>What</th><th>Likely "
      "cause</th><th>Next step</th></tr>\n";
  for (const auto& [reason, count] : s.reasons) {
    const ReasonInfo& r = holdfast::info(reason);
    out += fmt::format("<tr><td>{}</td><td class=\"n\">{}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n", escape(r.name),
                       count, escape(r.what), escape(r.cause), escape(r.next));
  }
  return out + "</table>\n";
}

// Each alarm with what it stands on, and each loss of the contact.
std::string alarm_table(const std::vector<FrameRecord>& frames, const std::vector<std::size_t>& starts) {
  constexpr std::size_t kListed = 40;
  struct Event {
    const FrameRecord* frame;
    std::string what, why;
  };
  std::vector<Event> events;
  events.reserve(starts.size());
  for (const std::size_t i : starts) events.push_back({&frames[i], "slip raised", why_text(frames[i])});
  for (std::size_t i = 1; i < frames.size(); ++i) {
    if (frames[i].reason != Reason::kContactLost || frames[i - 1].reason == Reason::kContactLost) continue;
    events.push_back({&frames[i], "contact lost", "the contact ended, and nobody said that the gripper opens"});
  }
  if (events.empty()) return "";
  std::stable_sort(events.begin(), events.end(),
                   [](const Event& a, const Event& b) { return a.frame->frame < b.frame->frame; });
  std::string out =
      "<h2>Alarms, and why</h2>\n<table class=\"wide\"><tr><th>Frame</th><th>Time (s)</th><th>What</th>"
      "<th>Why</th><th>Contact</th></tr>\n";
  for (const Event& event : std::span(events).first(std::min(events.size(), kListed))) {
    out += fmt::format("<tr><td class=\"n\">{}</td><td class=\"n\">{:.3f}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n",
                       event.frame->frame, event.frame->t_s(), event.what, escape(event.why),
                       event.frame->contact_known ? contact::kPhaseNames[static_cast<std::size_t>(event.frame->contact)]
                                                  : std::string_view("not known"));
  }
  out += "</table>\n";
  if (events.size() > kListed) out += fmt::format("<p class=\"note\">and {} more</p>\n", events.size() - kListed);
  return out;
}

std::string state_legend(const std::vector<FrameRecord>& frames, bool shaded) {
  const auto accepted = std::count_if(frames.begin(), frames.end(), [](const FrameRecord& f) { return f.accepted; });
  std::array<bool, kBySeverity.size()> seen{};
  for (const FrameRecord& f : frames) seen[static_cast<std::size_t>(severity(f.state))] = true;
  std::string out = "<div class=\"legend\">";
  for (std::size_t i = 0; i < seen.size(); ++i) {
    if (!seen[i]) continue;
    const StateInfo& state = holdfast::info(kBySeverity[i].state);
    out += fmt::format(R"(<span class="{}"><i class="chip"></i><b>{}</b> {}</span>)", kBySeverity[i].css,
                       escape(state.name), escape(state.meaning));
  }
  if (shaded) out += R"(<span class="slip"><i class="chip" style="opacity:.3"></i>shaded: slip decision raised</span>)";
  if (accepted > kMaxAliveEdges) out += "<span><b>ALIVE</b> filled while its last edge is younger than 150 ms</span>";
  return out + "</div>";
}

}  // namespace

void Report::add(const FrameRecord& frame, std::span<const Arrow> arrows, const TrackPicture& picture) {
  frames_.push_back(frame);
  track_.add(frame, arrows, picture);
}

std::string Report::html(const ReportInfo& info) const {
  std::string out = page::begin(info.title);
  out += fmt::format("<header><h1>{}</h1><p class=\"sub\">{}</p></header>\n", escape(info.title), escape(info.input));
  if (frames_.empty()) return out + "<p>The recording gave no frames.</p>\n" + page::end("null");

  const std::vector<std::size_t> starts = slip_starts(frames_);
  const Totals s = summarise(frames_);
  out += "<div class=\"recorded\">" + verdict(frames_, info, starts) + "</div>\n";
  out += "<div class=\"watch\">\n" + page::explorer();

  out += R"(<div class="recorded"><h2>Over time</h2><figure><svg id="plots" role="img" aria-label="time plots"></svg>)"
         "<noscript><p>The plots, and each frame, need this page's script.</p></noscript>\n"
         R"(<p class="readout" id="readout">&#160;</p>)" +
         state_legend(frames_, !starts.empty()) + "</figure></div></div>\n<div class=\"recorded\">" +
         alarm_table(frames_, starts);

  out += "<h2>Summary</h2>\n" + summary_table(frames_, info, s, starts) + "\n" + reason_table(s);
  if (!info.notes.empty()) {
    out += "<h2>Notes</h2>\n";
    for (const std::string& note : info.notes) out += "<p class=\"note\">" + escape(note) + "</p>\n";
  }
  out +=
      "<p class=\"note\" style=\"margin-top:28px\">GRIP_OK counts only while the last ALIVE edge is younger than 150 "
      "ms. Holdfast is not a certified safety function.</p>\n";
  return out + "</div>\n" + page::end(track_.json(info));
}

}  // namespace holdfast::tool
