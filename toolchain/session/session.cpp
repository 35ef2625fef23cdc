// SPDX-License-Identifier: Apache-2.0
#include "toolchain/session/session.hpp"

#include <fmt/format.h>
#include <fmt/ostream.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "base/math.hpp"
#include "drivers/common/trouble.hpp"
#include "drivers/sim/media.hpp"
#include "params/modes.hpp"
#include "toolchain/log/csv_log.hpp"
#include "toolchain/log/facts.hpp"

namespace holdfast::tool {
namespace {

std::vector<OutputFiles::Asked> asked(const OutputPaths& paths) {
  std::vector<OutputFiles::Asked> files;
  for (const auto& [option, path] : paths.named()) files.push_back({option, *path, Dash::kStandardOutput});
  return files;
}

// A report, a picture or an MCAP file that is asked for on standard output. Empty: none is.
std::string not_printed(const OutputPaths& paths) {
  for (const auto& [option, path] : paths.named()) {
    if (*path != "-" || (path != &paths.report && path != &paths.overlay && path != &paths.mcap)) continue;
    return fmt::format(
        "{} -: standard output takes a table. Likely cause: a report, a picture or an MCAP file was meant for a pipe. "
        "Next: give it a file, or a path such as ./-",
        option);
  }
  return {};
}

std::uint32_t saturated(const pipeline::State& state) {
  return state.saturations.count + state.load_saturations.count;
}

}  // namespace

std::string grid_text(GridSize grid) {
  return fmt::format("{}x{}", grid.cols, grid.rows);
}

std::string cut_text(const grid::Cut& cut) {
  std::vector<std::string> parts;
  const auto add = [&](int lines, std::string_view side, std::string_view line) {
    if (lines == 1) parts.push_back(fmt::format("the {} {}", side, line));
    if (lines > 1) parts.push_back(fmt::format("{} {} {}s", lines, side, line));
  };
  add(cut.top, "top", "row");
  add(cut.bottom, "bottom", "row");
  add(cut.left, "left", "column");
  add(cut.right, "right", "column");
  std::string text;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    text += i == 0 ? "" : i + 1 == parts.size() ? " and " : ", ";
    text += parts[i];
  }
  return text;
}

std::string explain(Reason reason, const App& app) {
  const ReasonInfo& row = info(reason);
  const GridSize found = app.state().tracker.found;
  std::string what{row.what};
  if (reason == Reason::kGridMismatch || reason == Reason::kGridAmbiguous) {
    what += fmt::format(" (found {})", grid_text(found));
  } else if (reason == Reason::kTooFewDots) {
    what += fmt::format(" (found {})", app.state().tracker.dots.count);
  }
  return fmt::format("{}. Likely cause: {}. Next: {}", what, row.cause, row.next);
}

std::string explain_none(const Summary& summary, const App& app, std::string_view cause, std::string_view next) {
  if (summary.frames == 0) return trouble("no frame came", cause, next);
  return fmt::format("none of {} frames could be used: {}", summary.frames, explain(summary.last_rejection, app));
}

Session::Session(SessionInfo info, OutputPaths paths)
    : info_(std::move(info)),
      paths_(std::move(paths)),
      error_(not_printed(paths_)),
      files_(asked(paths_), info_.inputs),
      gpio_(clock_, 1 << 20) {
  if (error_.empty()) error_ = files_.error();
  if (error_.empty() && !(paths_.overlay.empty() && paths_.report.empty())) {  // both hold pictures
    try {
      (void)sim::media();
    } catch (const sim::MediaMissing& problem) {
      error_ = problem.what();
    }
  }
  if (!error_.empty()) return;
  features_ = files_.stream("--features");
  markers_ = files_.stream("--markers");
  truth_ = files_.stream("--truth");
  truth_markers_ = files_.stream("--truth-markers");
  log_ = files_.stream("--log");
  if (markers_ != nullptr) *markers_ << "frame,row,col,valid,x_px,y_px,dx_px,dy_px\n";
  if (log_ != nullptr) *log_ << log::csv_header();
  if (std::ostream* const mcap = files_.stream("--mcap")) frame_log_ = std::make_unique<log::FrameLog>(*mcap);
}

void Session::use(const EmptyGel& gel) {
  empty_gel_ = gel;
  info_.reference_text =
      gel.at_rest ? fmt::format("frame {}, of frames {} to {} at rest (auto)", gel.frame, gel.first, gel.last)
                  : fmt::format("frame {}, because nothing rests in this recording (auto)", gel.frame);
  if (gel.clear) return;
  note(
      fmt::format("{}. Next: look at the report, and give another frame or a picture of the empty gel with --reference "
                  "if these are not empty",
                  gel.at_rest ? "No other frames are clearly loaded beside those of the reference, so either nothing "
                                "presses on the gel or something does all the time"
                              : "The reference may be loaded: nothing rests in this recording"));
}

void Session::connect(hal::Camera& camera, const model::Tree* tree, bool as_device) {
  if (frame_log_) tap_ = std::make_unique<CameraTap>(camera);
  app_ = std::make_unique<App>(Devices{tap_ ? *tap_ : camera, gpio_, link_, clock_, jpeg_, as_device}, tree);
}

void Session::record(long frame, double t_s, double scale, const hal::Frame& given) {
  const pipeline::Result& result = app_->result();
  const Hand hand = hand_ ? hand_() : Hand{.outputs = app_->outputs(), .names = {}, .cells = {}};
  const supervisor::Outputs& outputs = hand.outputs;
  const bool accepted = result.quality.ok();
  const bool has_features = accepted && result.referenced;

  ++summary_.frames;
  if (accepted) {
    ++summary_.accepted;
    marker_sum_ += result.markers;
    summary_.least_markers = summary_.accepted == 1 ? result.markers : std::min(summary_.least_markers, result.markers);
    const bool lost = outputs.reason == Reason::kContactLost;
    if (lost && !lost_before_) summary_.lost_frames.push_back(frame);
    lost_before_ = lost;
  } else {
    summary_.last_rejection = result.quality.reason;
  }
  if (outputs.grip_ok) {
    ++summary_.grip_ok;
  } else {
    ++summary_.others[{outputs.state, outputs.reason}];
  }
  if (outputs.slip && !slip_before_) {
    if (summary_.slip_times_s.empty()) {
      summary_.grip_ok_fell_with_first_slip = hand_ || gpio_.level(hal::Line::kGripOk) == hal::Level::kLow;
    }
    summary_.slip_times_s.push_back(t_s);
    summary_.slip_frames.push_back(frame);
  }
  slip_before_ = outputs.slip;

  FrameRecord row = log::facts_of(*app_, frame, t_s, gpio_.level(hal::Line::kAlive) == hal::Level::kHigh);
  if (hand_) {
    row.set_state(outputs.state, outputs.reason);
    row.slip = outputs.slip;
    row.grip_ok = outputs.grip_ok;
  }
  if (features_ != nullptr) write_features(row, hand);

  const MarkerField& field = app_->state().tracker.field;
  const MarkerField& rest = app_->state().reference.rest;
  log::arrows_of(*app_, scale, arrows_);
  for (std::size_t i = 0; markers_ != nullptr && i < arrows_.size(); ++i) {
    const Arrow& arrow = arrows_[i];
    const int k = static_cast<int>(i);
    fmt::print(*markers_, "{},{},{},{},{:.4f},{:.4f},{:.4f},{:.4f}\n", frame, k / field.grid.cols, k % field.grid.cols,
               arrow.valid ? 1 : 0, arrow.x_px, arrow.y_px, arrow.dx_px, arrow.dy_px);
  }
  if (!accepted && markers_ != nullptr && app_->state().reference.known) {
    // A rejected frame tells nothing, but keeps its rows: frames times markers is a full table.
    for (int i = 0; i < rest.grid.count(); ++i) {
      fmt::print(*markers_, "{},{},{},0,,,,\n", frame, i / rest.grid.cols, i % rest.grid.cols);
    }
  }

  if (!paths_.report.empty()) report_.add(row, arrows_, picture_of(scale, given));
  if (log_ != nullptr) *log_ << log::csv_row(row);
  if (frame_log_) {
    // A grey picture is the working picture; arrows are in pixels of the input.
    const bool grey = given.format == hal::PixelFormat::kLuma8;
    frame_log_->add(row, arrows_, field.grid.cols, tap_->given(), grey ? scale : 1.0);
  }
  if (!paths_.overlay.empty() && has_features) keep_for_overlay(scale, given);
}

// One list of columns and cells; the first row writes the header before it.
void Session::write_features(const FrameRecord& row, const Hand& hand) {
  const pipeline::Result& result = app_->result();
  const Features& f = result.features;
  const Reason reason = row.accepted ? row.reason : result.quality.reason;
  const bool valid = row.features_valid;
  const std::int32_t patches = f.imprint.patches.raw();
  std::string names, cells;
  const auto add = [&](std::string_view name, bool known, std::string_view format, const auto& value) {
    const std::string_view comma = names.empty() ? "" : ",";
    names.append(comma).append(name);
    cells.append(comma).append(known ? fmt::format(fmt::runtime(format), value) : std::string());
  };
  add("frame", true, "{}", row.frame);
  add("t_s", true, "{:.6f}", row.t_s());
  add("state", true, "{}", row.state_name);
  add("reason", true, "{}", info(reason).name);
  add("markers", row.accepted, "{}", valid ? f.markers : result.markers);
  add("vx_mm_s", valid, "{:.3f}", row.vx_mm_s);
  add("vy_mm_s", valid, "{:.3f}", row.vy_mm_s);
  add("entropy_nat", valid, "{:.6f}", row.entropy_nat);
  add("entropy_rate_nat_s", valid, "{:.6f}", row.entropy_rate_nat_s);
  add("slip", true, "{:d}", row.slip);
  add("grip_ok", true, "{:d}", row.grip_ok);
  // Where the model does not read the picture, nothing of it is computed; what does not move has no figure either.
  add("contact", valid && result.contact.judged, "{:d}", result.contact.touching);
  add("imprint_patches", valid && patches > 0, "{}", patches);
  add("imprint_um", valid && patches > 0 && f.imprint.motion.raw() > 0, "{:.1f}", row.imprint_um);
  const bool decided = valid && row.evidence != Evidence::kNone;
  add("coarse_um", valid && patches > 0 && f.imprint.coarse.raw() > 0, "{:.1f}", row.coarse_um);
  add("contact_phase", valid && row.contact_known, "{}", contact::kPhaseNames[static_cast<std::size_t>(row.contact)]);
  add("evidence", decided, "{}", row.evidence_name);
  add("evidence_value", decided, "{:.1f}", row.evidence_value);
  add("evidence_threshold", decided, "{:.1f}", row.evidence_threshold);
  add("evidence_unit", decided, "{}", row.evidence_unit);
  add("evidence_frames", decided, "{}", row.evidence_frames);
  const bool loaded = valid && row.load_basis != load::Basis::kNone;
  add("shear_x_n", loaded, "{:.3f}", row.shear_x_n);
  add("shear_y_n", loaded, "{:.3f}", row.shear_y_n);
  add("normal_n", loaded, "{:.3f}", row.normal_n);
  add("friction_use", loaded && row.friction_use > 0, "{:.3f}", row.friction_use);
  add("load_within", loaded, "{:d}", row.load_within);
  add("load_basis", loaded, "{}", load::kBasisNames[static_cast<std::size_t>(row.load_basis)]);
  if (summary_.frames <= 1) *features_ << names << hand.names << '\n';
  *features_ << cells << hand.cells << '\n';
}

// The picture for the page: as the firmware saw it, at its working size. A frame that was rejected shows none: what it
// would be is not known to be a picture.
TrackPicture Session::picture_of(double scale, const hal::Frame& given) const {
  if (!app_->result().quality.ok()) return {};
  LumaView luma = given.format == hal::PixelFormat::kMjpeg
                      ? app_->state().luma.decoded.view()
                      : LumaView{given.bytes.data(), given.width, given.height, given.stride};
  if (given.bytes.empty() || luma.width <= 0) luma.data = nullptr;
  return {luma, luma.width * scale, luma.height * scale};
}

// The overlay shows the frame that raised slip first; without one, the frame of the largest entropy.
void Session::keep_for_overlay(double scale, const hal::Frame& given) {
  const double entropy = app_->result().features.entropy.raw() / 65536.0;
  const bool slip = slip_before_;
  if (slip_kept_ || (!slip && entropy <= best_entropy_)) return;
  slip_kept_ = slip;
  best_entropy_ = entropy;
  picture_format_ = given.format;
  picture_bytes_.assign(given.bytes.begin(), given.bytes.end());
  picture_height_ = given.height;
  picture_scale_ = given.format == hal::PixelFormat::kLuma8 ? scale : 1.0;
  picture_arrows_ = arrows_;
}

void Session::record_truth(const std::string& header, const std::string& line) {
  if (truth_ == nullptr) return;
  if (summary_.frames <= 1) *truth_ << header << '\n';
  *truth_ << line << '\n';
}

void Session::record_truth_markers(const std::string& header, const std::string& lines) {
  if (truth_markers_ == nullptr) return;
  if (summary_.frames <= 1) *truth_markers_ << header << '\n';
  *truth_markers_ << lines;
}

Summary Session::summary() const {
  Summary out = summary_;
  out.mean_markers = out.accepted > 0 ? static_cast<double>(marker_sum_) / static_cast<double>(out.accepted) : 0.0;
  out.searches = app_->state().tracker.searches;
  out.saturations = saturated(app_->state());
  return out;
}

std::string Session::commit(std::vector<TruthMark> marks, std::optional<TruthSeries> series,
                            std::vector<std::string> notes) {
  if (std::ostream* const out = files_.stream("--report")) {
    ReportInfo report{};
    report.clip = info_.clip;
    const GridSize grid = app_->state().tracker.field.grid;
    report.title = info_.title;
    report.input = info_.input_text;
    report.grid = grid_text(grid);
    if (const auto& cut = app_->state().tracker.cut; cut.lines() > 0) {
      report.grid += fmt::format(" (left out, cut by the picture's edge: {})", cut_text(cut));
    }
    report.grid_markers = grid.count();
    report.mode = kModes[idx(info_.params.mode)].name;
    report.model = info_.model_text;
    report.reference = info_.reference_text;
    report.marks = std::move(marks);
    report.series = std::move(series);
    report.notes = info_.notes;
    report.notes.insert(report.notes.end(), notes.begin(), notes.end());
    report.histogram_range_mm = info_.params.histogram_range_um / 1000.0;
    report.saturations = saturated(app_->state());
    *out << report_.html(report);
  }
  if (frame_log_) frame_log_->finish();
  if (std::ostream* const out = files_.stream("--overlay")) {
    if (const std::string error = draw_overlay(*out); !error.empty()) return paths_.overlay.string() + ": " + error;
  }
  return files_.commit();
}

std::string Session::draw_overlay(std::ostream& out) const {
  cv::Mat picture;
  std::vector<Arrow> arrows = picture_arrows_;
  if (picture_format_ == hal::PixelFormat::kMjpeg) {
    picture = sim::media().decode(picture_bytes_, cv::IMREAD_COLOR);
  } else {
    picture = cv::Mat(picture_bytes_, true).reshape(1, picture_height_);
    for (Arrow& a : arrows) {
      a = {(a.x_px + 0.5) / picture_scale_ - 0.5, (a.y_px + 0.5) / picture_scale_ - 0.5, a.dx_px / picture_scale_,
           a.dy_px / picture_scale_, a.valid};
    }
  }
  constexpr double kArrowFactor = 3.0;  // displacements are a few pixels of 320; longer arrows can be read
  return write_overlay(out, picture, arrows, kArrowFactor);
}

std::string Session::gpio_timeline() const {
  std::string out;
  std::uint64_t alive = 0;
  bool high = false;
  for (std::size_t i = 0; i < gpio_.events().size(); ++i) {
    const sim::GpioEvent& event = gpio_.events()[i];
    if (event.line == hal::Line::kAlive) {
      ++alive;
      continue;
    }
    const bool now = event.level == hal::Level::kHigh;
    if (now == high) continue;
    high = now;
    out += fmt::format("  {:9.3f} s  GRIP_OK {:4}  (after {} edges of ALIVE)\n",
                       static_cast<double>(event.time.count()) * 1e-6, high ? "HIGH" : "LOW", alive);
  }
  return out;
}

}  // namespace holdfast::tool
