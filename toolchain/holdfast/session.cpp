// SPDX-License-Identifier: Apache-2.0
#include "toolchain/holdfast/session.hpp"

#include <fmt/format.h>
#include <fmt/ostream.h>

#include <algorithm>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "app/modes.hpp"
#include "base/math.hpp"

namespace holdfast::tool {
namespace {

constexpr double kQ8 = 256.0;

double nat(NatsQ16 value) {
  return value.raw() / 65536.0;
}
double nat_per_s(NatsPerSecQ8 value) {
  return value.raw() / kQ8;
}
double mm_per_s(MicrometresPerSec value) {
  return value.raw() / 1000.0;
}

std::unique_ptr<AtomicFile> open_output(const std::filesystem::path& path, const std::filesystem::path& input) {
  return path.empty() ? nullptr : std::make_unique<AtomicFile>(path, input);
}

// Working pixel to input pixel: pixel centres are whole numbers in both.
double to_input(PixelsQ8 value, double scale) {
  return (value.raw() / kQ8 + 0.5) * scale - 0.5;
}

}  // namespace

std::string grid_text(GridSize grid) {
  return fmt::format("{}x{}", grid.cols, grid.rows);
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

Session::Session(SessionInfo info, const OutputPaths& paths)
    : info_(std::move(info)),
      paths_(paths),
      features_(open_output(paths.features, info_.input)),
      markers_(open_output(paths.markers, info_.input)),
      truth_(open_output(paths.truth, info_.input)),
      gpio_(clock_, 1 << 20) {
  if (features_) {
    features_->stream()
        << "frame,t_s,state,reason,markers,vx_mm_s,vy_mm_s,entropy_nat,entropy_rate_nat_s,slip,grip_ok\n";
  }
  if (markers_) markers_->stream() << "frame,row,col,valid,x_px,y_px,dx_px,dy_px\n";
}

std::string Session::output_error() const {
  for (const auto* file : {&features_, &markers_, &truth_}) {
    if (*file && !(*file)->error().empty()) return (*file)->error();
  }
  return {};
}

void Session::connect(hal::Camera& camera, const model::Tree* tree) {
  app_ = std::make_unique<App>(Devices{camera, gpio_, link_, clock_, jpeg_}, tree);
}

void Session::record(long frame, double t_s, double scale, const hal::Frame& given) {
  const pipeline::Result& result = app_->result();
  const supervisor::Outputs& outputs = app_->outputs();
  const bool accepted = result.quality.ok();
  const bool has_features = accepted && result.referenced;
  const Features& f = result.features;

  ++summary_.frames;
  if (accepted) {
    ++summary_.accepted;
    marker_sum_ += result.markers;
    summary_.least_markers = summary_.accepted == 1 ? result.markers : std::min(summary_.least_markers, result.markers);
  } else {
    summary_.last_rejection = result.quality.reason;
  }
  if (outputs.slip && !slip_before_) {
    if (summary_.slip_times_s.empty()) {
      summary_.grip_ok_fell_with_first_slip = gpio_.level(hal::Line::kGripOk) == hal::Level::kLow;
    }
    summary_.slip_times_s.push_back(t_s);
    summary_.slip_frames.push_back(frame);
  }
  slip_before_ = outputs.slip;

  if (features_) {
    const Reason reason = accepted ? outputs.reason : result.quality.reason;
    fmt::print(features_->stream(), "{},{:.6f},{},{},", frame, t_s, info(outputs.state).name, info(reason).name);
    if (has_features) {
      fmt::print(features_->stream(), "{},{:.3f},{:.3f},{:.6f},{:.6f}", f.markers, mm_per_s(f.vx), mm_per_s(f.vy),
                 nat(f.entropy), nat_per_s(f.entropy_rate));
    } else if (accepted) {
      fmt::print(features_->stream(), "{},,,,", result.markers);
    } else {
      fmt::print(features_->stream(), ",,,,");
    }
    fmt::print(features_->stream(), ",{},{}\n", outputs.slip ? 1 : 0, outputs.grip_ok ? 1 : 0);
  }

  arrows_.clear();
  const MarkerField& field = app_->state().tracker.field;
  const MarkerField& rest = app_->state().reference.rest;
  if (accepted) {
    for (int i = 0; i < field.grid.count(); ++i) {
      const Marker& marker = field.markers[idx(i)];
      Arrow arrow{to_input(marker.x, scale), to_input(marker.y, scale), 0, 0, marker.valid};
      if (result.referenced && rest.markers[idx(i)].valid) {
        arrow.dx_px = (marker.x.raw() - rest.markers[idx(i)].x.raw()) / kQ8 * scale;
        arrow.dy_px = (marker.y.raw() - rest.markers[idx(i)].y.raw()) / kQ8 * scale;
      } else {
        arrow.valid = arrow.valid && !result.referenced;
      }
      arrows_.push_back(arrow);
      if (!markers_) continue;
      fmt::print(markers_->stream(), "{},{},{},{},{:.4f},{:.4f},{:.4f},{:.4f}\n", frame, i / field.grid.cols,
                 i % field.grid.cols, arrow.valid ? 1 : 0, arrow.x_px, arrow.y_px, arrow.dx_px, arrow.dy_px);
    }
  }

  ReportFrame row{};
  row.frame = frame;
  row.t_s = t_s;
  row.state = outputs.state;
  row.reason = outputs.reason;
  row.accepted = accepted;
  row.features_valid = has_features;
  row.rates_valid = has_features && f.rates_valid;
  row.slip = outputs.slip;
  row.grip_ok = outputs.grip_ok;
  if (has_features) {
    row.markers = f.markers;
    row.vx_mm_s = mm_per_s(f.vx);
    row.vy_mm_s = mm_per_s(f.vy);
    row.entropy_nat = nat(f.entropy);
    row.entropy_rate_nat_s = nat_per_s(f.entropy_rate);
    std::copy(f.histogram.begin(), f.histogram.end(), row.histogram.begin());
  }
  if (!paths_.report.empty()) report_.add(row, arrows_);
  if (!paths_.overlay.empty() && has_features) keep_for_overlay(scale, given);
}

// The overlay shows the frame that raised slip first; without one, the frame of the largest entropy.
void Session::keep_for_overlay(double scale, const hal::Frame& given) {
  const double entropy = nat(app_->result().features.entropy);
  const bool slip = app_->outputs().slip;
  if (slip_kept_ || (!slip && entropy <= best_entropy_)) return;
  slip_kept_ = slip;
  best_entropy_ = entropy;
  picture_format_ = given.format;
  picture_bytes_.assign(given.bytes.begin(), given.bytes.end());
  picture_width_ = given.width;
  picture_height_ = given.height;
  picture_scale_ = given.format == hal::PixelFormat::kLuma8 ? scale : 1.0;
  picture_arrows_ = arrows_;
}

void Session::record_truth(const std::string& header, const std::string& line) {
  if (!truth_) return;
  if (summary_.frames <= 1) truth_->stream() << header << '\n';
  truth_->stream() << line << '\n';
}

Summary Session::summary() const {
  Summary out = summary_;
  out.mean_markers = out.accepted > 0 ? static_cast<double>(marker_sum_) / static_cast<double>(out.accepted) : 0.0;
  out.searches = app_->state().tracker.searches;
  out.saturations = app_->state().saturations.count;
  return out;
}

std::string Session::commit(std::vector<TruthMark> marks, std::optional<TruthSeries> series,
                            std::vector<std::string> notes) {
  // What may still fail is done first: pictures and report are written whole, the CSV files only renamed
  // after.
  if (!paths_.report.empty()) {
    ReportInfo report{};
    const GridSize grid = app_->state().tracker.field.grid;
    report.title = info_.title;
    report.input = info_.input_text;
    report.grid = grid_text(grid);
    report.grid_markers = grid.count();
    report.mode = kModes[idx(info_.params.mode)].name;
    report.model = info_.model_text;
    report.reference = info_.reference_text;
    report.marks = std::move(marks);
    report.series = std::move(series);
    report.notes = std::move(notes);
    report.histogram_range_mm = info_.params.histogram_range_um / 1000.0;
    report.saturations = app_->state().saturations.count;
    if (std::string error = report_.write(paths_.report, report, info_.input); !error.empty()) return error;
  }
  if (!paths_.overlay.empty()) {
    cv::Mat picture;
    std::vector<Arrow> arrows = picture_arrows_;
    if (picture_format_ == hal::PixelFormat::kMjpeg) {
      picture = cv::imdecode(picture_bytes_, cv::IMREAD_COLOR);
    } else {
      picture = cv::Mat(picture_height_, picture_width_, CV_8UC1, picture_bytes_.data());
      for (Arrow& a : arrows) {
        a = {(a.x_px + 0.5) / picture_scale_ - 0.5, (a.y_px + 0.5) / picture_scale_ - 0.5, a.dx_px / picture_scale_,
             a.dy_px / picture_scale_, a.valid};
      }
    }
    constexpr double kArrowFactor = 3.0;  // displacements are a few pixels of 320; longer arrows can be read
    if (std::string error = write_overlay(paths_.overlay, picture, arrows, kArrowFactor, info_.input); !error.empty()) {
      return error;
    }
  }
  for (const auto* file : {&features_, &markers_, &truth_}) {
    if (!*file) continue;
    if (std::string error = (*file)->commit(); !error.empty()) return error;
  }
  return {};
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
