// SPDX-License-Identifier: Apache-2.0
#include "toolchain/console/record.hpp"

#include <fmt/format.h>

#include <chrono>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>

#include "base/math.hpp"
#include "drivers/common/trouble.hpp"
#include "tactile/features.hpp"
#include "toolchain/console/watching.hpp"
#include "toolchain/live/full_disk.hpp"
#include "toolchain/log/csv_log.hpp"
#include "toolchain/log/frame_log.hpp"
#include "toolchain/support/atomic_file.hpp"
#include "toolchain/support/progress.hpp"

namespace holdfast::console_tool {
namespace {

using Clock = std::chrono::steady_clock;

// Where frames go. The markers of a picture come behind its status frame, so that one frame waits for the next.
class Sink {
 public:
  Sink(std::ostream& out, bool mcap, std::int32_t histogram_range_um) : out_(out), range_um_(histogram_range_um) {
    if (mcap) {
      mcap_.emplace(out);
    } else {
      add(log::csv_header());
    }
  }

  void add(const Telemetry::Received& frame) {
    flush();
    const status_frame::StatusFrame& status = frame.status;
    const bool follows = waiting_.features_valid && frame.lost == 0 && frames_ > 0;
    waiting_ = {};
    arrows_.clear();
    waiting_.frame = static_cast<std::uint32_t>(frame.number);
    waiting_.set_time(static_cast<double>(frame.time_us) * 1e-6);
    waiting_.set_state(status.state, status.reason);
    waiting_.alive = status.alive;
    waiting_.accepted = frame.accepted;
    waiting_.features_valid = status.features_valid;
    waiting_.rates_valid = status.features_valid && follows;
    waiting_.markers = static_cast<std::uint32_t>(status.markers);
    waiting_.vx_mm_s = status.vx_um_s * 1e-3;
    waiting_.vy_mm_s = status.vy_um_s * 1e-3;
    waiting_.entropy_nat = status.entropy_nat_q16 / 65536.0;
    waiting_.entropy_rate_nat_s = status.entropy_rate_nat_s_q8 / 256.0;
    waiting_.slip = status.slip;
    waiting_.grip_ok = status.grip_ok;
    sequence_ = status.sequence;
    waits_ = true;
    ++frames_;
  }

  void add(const Telemetry& telemetry, double px_per_um) {
    if (!waits_ || !telemetry.field() || !telemetry.rest() || telemetry.field_sequence() != sequence_) return;
    const DisplacementField& field = *telemetry.field();
    const DisplacementField& rest = *telemetry.rest();
    const auto histogram = features::histogram_of(field, range_um_);
    std::copy(histogram.begin(), histogram.end(), waiting_.histogram.begin());
    if (px_per_um <= 0 || rest.grid != field.grid) return;
    cols_ = field.grid.cols;
    for (std::int32_t i = 0; i < field.grid.count(); ++i) {
      const MarkerDisplacement& d = field.markers[idx(i)];
      const MarkerDisplacement& r = rest.markers[idx(i)];
      arrows_.push_back({(r.dx.raw() + d.dx.raw()) * px_per_um, (r.dy.raw() + d.dy.raw()) * px_per_um,
                         d.dx.raw() * px_per_um, d.dy.raw() * px_per_um, d.valid && r.valid});
    }
    ++fields_;
  }

  void finish() {
    flush();
    if (mcap_) mcap_->finish();
  }

  [[nodiscard]] long frames() const { return frames_; }
  [[nodiscard]] long fields() const { return fields_; }
  [[nodiscard]] double seconds() const { return waiting_.t_s(); }
  [[nodiscard]] bool good() const { return out_.good(); }
  [[nodiscard]] std::string keep_what_fits(tool::AtomicFile& file, const std::string& path) {
    return mcap_ ? live::keep_what_fits(file, *mcap_, path) : live::keep_what_fits(file, table_end_, rows_, path);
  }

 private:
  bool add(const std::string& line) {
    if (!(out_ << line << std::flush)) return false;
    table_end_ += line.size();
    return true;
  }

  void flush() {
    if (!std::exchange(waits_, false)) return;
    if (mcap_) {
      mcap_->add(waiting_, arrows_, cols_, hal::Frame{});
    } else {
      if (add(log::csv_row(waiting_))) ++rows_;
    }
  }

  std::ostream& out_;
  std::optional<log::FrameLog> mcap_;
  std::int32_t range_um_;
  log::FrameRecord waiting_;
  std::vector<log::Arrow> arrows_;
  std::uint64_t table_end_ = 0, rows_ = 0;  // bytes and rows that the disk took
  int cols_ = 0;
  std::uint16_t sequence_ = 0;
  bool waits_ = false;
  long frames_ = 0, fields_ = 0;
};

}  // namespace

std::string check_record_path(const std::string& path) {
  if (path.ends_with(".csv") || path.ends_with(".mcap")) return {};
  return trouble(path + ": is neither .csv nor .mcap", "another ending", "end its name in .csv or .mcap");
}

std::string record(Device& device, const RecordOptions& options, const std::function<void(const std::string&)>& note,
                   std::vector<std::string>& report) {
  if (std::string error = check_record_path(options.path); !error.empty()) return error;
  tool::AtomicFile file(options.path);
  if (!file.error().empty()) return file.error();
  const Answer range = device.say("get histogram_range_um json");
  if (!range.ok()) return range.error;
  const auto json = nlohmann::json::parse(range.lines.empty() ? "" : range.lines.back(), nullptr, false);
  const auto place = "/parameters/0/value"_json_pointer;
  const features::Config bins;
  Sink sink(file.stream(), options.path.ends_with(".mcap"),
            json.contains(place) && json[place].is_number_integer() ? json[place].get<std::int32_t>()
                                                                    : bins.histogram_range_um);
  tool::Progress progress("recording (Ctrl-C ends it)", 0);
  Watching watching(device, [&](const std::string& line) {
    progress.clear();
    note(line);
  });
  watching.on_frame = [&](const Telemetry::Received& frame) { sink.add(frame); };
  watching.on_field = [&] { sink.add(watching.telemetry(), watching.px_per_um()); };
  if (std::string error = watching.begin(); !error.empty()) return error;
  const Clock::time_point begun = Clock::now();
  const auto over = [&] {
    return options.seconds && std::chrono::duration<double>(Clock::now() - begun).count() >= *options.seconds;
  };
  while (!over() && sink.good()) {
    const Signals::What what = watching.turn(Millis(50));
    if (what == Signals::What::kInterrupt || what == Signals::What::kEnd) break;
    progress.update(sink.frames());
  }
  progress.clear();
  const bool lost = watching.lost();
  if (!sink.good()) return sink.keep_what_fits(file, options.path);
  if (sink.frames() == 0) {
    return trouble("no frame came, and nothing was written", "the camera does not deliver",
                   "status says what the device is doing");
  }
  sink.finish();
  if (!file.stream().flush()) return sink.keep_what_fits(file, options.path);
  if (std::string error = file.commit(); !error.empty()) return error;
  if (lost) {
    return trouble(fmt::format("{}: its {} frames end before the recording did: {} did not answer any more",
                               options.path, sink.frames(), device.port_name()),
                   "unplugged, or the firmware hangs", "look at what the board does, and record again");
  }
  report.push_back(fmt::format("{}: {} frames in {:.1f} s, {} with markers, {} lost", options.path, sink.frames(),
                               sink.seconds(), sink.fields(), watching.telemetry().lost()));
  return {};
}

}  // namespace holdfast::console_tool
