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

namespace fs = std::filesystem;

// Which output would destroy another one or something that the run reads, or cannot be where it was asked for. Empty:
// none. A folder of images is read as a whole: a file more in it may be a frame more at the next run.
std::string collision(const OutputPaths& paths, const std::vector<fs::path>& inputs) {
  const auto outputs = paths.named();
  for (const auto* one = outputs.begin(); one != outputs.end(); ++one) {
    const auto& [name, path] = *one;
    if (path->empty()) continue;
    if (*path == "-" && (path == &paths.report || path == &paths.overlay || path == &paths.mcap)) {
      return fmt::format(
          "--{} -: standard output takes a table. Likely cause: a report, a picture or an MCAP file was meant for a "
          "pipe. Next: give it a file, or a path such as ./-",
          name);
    }
    for (const fs::path& input : inputs) {
      if (input.empty()) continue;
      std::error_code ignored;
      const bool inside = fs::is_directory(input, ignored) && same_place(fs::absolute(*path).parent_path(), input);
      if (!inside && !same_place(*path, input)) continue;
      return fmt::format(
          "{}: --{} would change {} input of this run. Likely cause: the same name given twice, or an output beside "
          "the pictures. Next: give another place for the output",
          path->string(), name, inside ? "the folder that is an" : "an");
    }
    for (const auto* other = std::next(one); other != outputs.end(); ++other) {
      if (other->second->empty() || !same_place(*path, *other->second)) continue;
      return fmt::format(
          "{}: given for both --{} and --{}. Likely cause: a typing error. Next: give each output a file of its own",
          path->string(), name, other->first);
    }
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
      error_(collision(paths_, info_.inputs)),
      gpio_(clock_, 1 << 20) {
  if (!error_.empty()) return;
  features_ = open(paths_.features);
  markers_ = open(paths_.markers);
  truth_ = open(paths_.truth);
  truth_markers_ = open(paths_.truth_markers);
  report_file_ = open(paths_.report);
  log_ = open(paths_.log);
  mcap_ = open(paths_.mcap);
  (void)open(paths_.overlay);  // write_overlay() opens it for itself; whether it can is known now
  if (error_.empty() && !(paths_.overlay.empty() && paths_.report.empty())) {  // both hold pictures
    try {
      (void)sim::media();
    } catch (const sim::MediaMissing& problem) {
      error_ = problem.what();
    }
  }
  if (markers_) markers_->stream() << "frame,row,col,valid,x_px,y_px,dx_px,dy_px\n";
  if (log_) log_->stream() << log::csv_header();
  if (mcap_) frame_log_ = std::make_unique<log::FrameLog>(mcap_->stream());
}

std::unique_ptr<AtomicFile> Session::open(const std::filesystem::path& path) {
  if (path.empty()) return nullptr;
  auto file = std::make_unique<AtomicFile>(path, fs::path(), Dash::kStandardOutput);
  if (error_.empty()) error_ = file->error();
  return file;
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
  if (features_) write_features(row, hand);

  const MarkerField& field = app_->state().tracker.field;
  const MarkerField& rest = app_->state().reference.rest;
  log::arrows_of(*app_, scale, arrows_);
  for (std::size_t i = 0; markers_ && i < arrows_.size(); ++i) {
    const Arrow& arrow = arrows_[i];
    const int k = static_cast<int>(i);
    fmt::print(markers_->stream(), "{},{},{},{},{:.4f},{:.4f},{:.4f},{:.4f}\n", frame, k / field.grid.cols,
               k % field.grid.cols, arrow.valid ? 1 : 0, arrow.x_px, arrow.y_px, arrow.dx_px, arrow.dy_px);
  }
  if (!accepted && markers_ && app_->state().reference.known) {
    // A rejected frame tells nothing, but keeps its rows: frames times markers is a full table.
    for (int i = 0; i < rest.grid.count(); ++i) {
      fmt::print(markers_->stream(), "{},{},{},0,,,,\n", frame, i / rest.grid.cols, i % rest.grid.cols);
    }
  }

  if (!paths_.report.empty()) report_.add(row, arrows_, picture_of(scale, given));
  if (log_) log_->stream() << log::csv_row(row);
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
  if (summary_.frames <= 1) features_->stream() << names << hand.names << '\n';
  features_->stream() << cells << hand.cells << '\n';
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
  if (!truth_) return;
  if (summary_.frames <= 1) truth_->stream() << header << '\n';
  truth_->stream() << line << '\n';
}

void Session::record_truth_markers(const std::string& header, const std::string& lines) {
  if (!truth_markers_) return;
  if (summary_.frames <= 1) truth_markers_->stream() << header << '\n';
  truth_markers_->stream() << lines;
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
  if (report_file_) {
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
    report_file_->stream() << report_.html(report);
  }
  if (frame_log_) frame_log_->finish();
  // What may still fail comes first: every byte is written, then the overlay, and only then files are renamed.
  std::array files{features_.get(),    markers_.get(), truth_.get(), truth_markers_.get(),
                   report_file_.get(), log_.get(),     mcap_.get()};
  std::partition(files.begin(), files.end(), [](const AtomicFile* file) { return file != nullptr && file->prints(); });
  for (AtomicFile* file : files) {
    if (file != nullptr && !file->stream().flush()) return file->commit();
  }
  if (!paths_.overlay.empty()) {
    if (std::string error = draw_overlay(); !error.empty()) return error;
  }
  for (AtomicFile* file : files) {
    if (file == nullptr) continue;
    if (std::string error = file->commit(); !error.empty()) return error;
  }
  return {};
}

std::string Session::draw_overlay() const {
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
  return write_overlay(paths_.overlay, picture, arrows, kArrowFactor);
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
