// SPDX-License-Identifier: Apache-2.0
// Runs the firmware over a camera in virtual time and keeps what came out: CSV files, report, overlay,
// logs, summary.
//
// Outputs appear together, after the last frame, or not at all. Host code: it may allocate; the firmware
// inside does not.
#pragma once

#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "app/app.hpp"
#include "drivers/common/jpeg_turbo.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/gpio.hpp"
#include "drivers/sim/serial.hpp"
#include "toolchain/log/frame_log.hpp"
#include "toolchain/play/empty_gel.hpp"
#include "toolchain/session/camera_tap.hpp"
#include "toolchain/session/report.hpp"
#include "toolchain/support/atomic_file.hpp"
#include "vision/jpeg_decoder.hpp"

namespace holdfast::tool {

struct OutputPaths {
  std::filesystem::path features;
  std::filesystem::path markers;
  std::filesystem::path overlay;
  std::filesystem::path report;
  std::filesystem::path log;
  std::filesystem::path mcap;
  std::filesystem::path truth;          // simulated grasps only
  std::filesystem::path truth_markers;  // likewise

  // With their options; a path may be empty.
  [[nodiscard]] std::array<std::pair<std::string_view, const std::filesystem::path*>, 8> named() const {
    return {{{"--features", &features},
             {"--markers", &markers},
             {"--truth", &truth},
             {"--truth-markers", &truth_markers},
             {"--overlay", &overlay},
             {"--log", &log},
             {"--mcap", &mcap},
             {"--report", &report}}};
  }
  // Where what is said to people goes: not where a table goes.
  [[nodiscard]] std::FILE* people() const {
    return std::ranges::any_of(named(), [](const auto& one) { return *one.second == "-"; }) ? stderr : stdout;
  }
};

// What the run was, in words; goes into report and summary.
struct SessionInfo {
  std::string title;
  std::vector<std::filesystem::path> inputs;  // files and folders that this run reads: no output may touch them
  std::string input_text;
  std::string clip;  // name of the recording, for a label file; empty: it is none
  std::string reference_text;
  std::string model_text;
  std::vector<std::string> notes;
  Params params;
  bool auto_grid = false;
};

struct Summary {
  long frames = 0;
  long accepted = 0;
  int least_markers = 0;
  double mean_markers = 0;
  std::vector<double> slip_times_s;  // of each rising edge of `slip`
  std::vector<long> slip_frames;
  long grip_ok = 0;                                       // frames
  std::map<std::pair<DeviceState, Reason>, long> others;  // frames in which it was not, by what was said
  std::vector<long> lost_frames;  // where the contact was lost: SLIP (contact_lost), though `slip` does not rise
  bool grip_ok_fell_with_first_slip = true;  // within the frame that raised it
  Reason last_rejection = Reason::kNone;
  long searches = 0;
  std::uint32_t saturations = 0;
};

class Session {
 public:
  Session(SessionInfo info, OutputPaths paths);

  // Why an output cannot be written, as far as known before the run. Empty: good.
  [[nodiscard]] const std::string& output_error() const { return error_; }

  // What --reference auto found; before connect().
  void use(const EmptyGel& gel);
  [[nodiscard]] const std::string& reference_text() const { return info_.reference_text; }
  // For summary and report.
  void note(std::string text) { info_.notes.push_back(std::move(text)); }
  [[nodiscard]] const std::vector<std::string>& notes() const { return info_.notes; }
  [[nodiscard]] const std::optional<EmptyGel>& empty_gel() const { return empty_gel_; }

  // The firmware, over `camera`. The camera shares clock().
  // `tree`: decides instead of the compiled one; outlives the session. May be null. `as_device`: see Devices.
  void connect(hal::Camera& camera, const model::Tree* tree, bool as_device = false);
  [[nodiscard]] sim::Clock& clock() { return clock_; }
  [[nodiscard]] App& app() { return *app_; }
  [[nodiscard]] const App& app() const { return *app_; }

  // What a hand decides in place of this app, and what the table of features says of its fingers at the end of a row;
  // asked once a frame, in record().
  struct Hand {
    supervisor::Outputs outputs;
    std::string names, cells;
  };
  void decided_by(std::function<Hand()> hand) { hand_ = std::move(hand); }

  // After each step() that brought a frame. `scale`: pixels of the input per pixel of the working image.
  // `given`: the camera's frame, for the overlay's picture.
  void record(long frame, double t_s, double scale, const hal::Frame& given);
  // A line of the truth file; the first call writes the header before it.
  void record_truth(const std::string& header, const std::string& line);
  // The same for the file of the markers' truth: lines of one frame, each with its newline.
  void record_truth_markers(const std::string& header, const std::string& lines);

  [[nodiscard]] Summary summary() const;
  // Writes everything. Empty, or one line that says what is wrong; then nothing was written.
  [[nodiscard]] std::string commit(std::vector<TruthMark> marks, std::optional<TruthSeries> series,
                                   std::vector<std::string> notes);

  // The MCAP file that was asked for; null: none was.
  [[nodiscard]] const log::FrameLog* frame_log() const { return frame_log_.get(); }

  // The lines' edges as text: GRIP_OK one by one, ALIVE counted between them.
  [[nodiscard]] std::string gpio_timeline() const;

 private:
  void write_features(const FrameRecord& row, const Hand& hand);
  [[nodiscard]] TrackPicture picture_of(double scale, const hal::Frame& given) const;
  void keep_for_overlay(double scale, const hal::Frame& given);
  [[nodiscard]] std::string draw_overlay(std::ostream& out) const;

  SessionInfo info_;
  std::optional<EmptyGel> empty_gel_;
  OutputPaths paths_;
  std::string error_;
  OutputFiles files_;
  std::ostream *features_ = nullptr, *markers_ = nullptr, *truth_ = nullptr, *truth_markers_ = nullptr,
               *log_ = nullptr;  // null: not asked for
  sim::Clock clock_;
  sim::Gpio gpio_;
  sim::Serial link_;
  drivers::TurboJpegDecoder other_scales_;
  jpeg_fast::Worker worker_;
  hal::Alone crew_;
  EighthDecoder jpeg_{{}, other_scales_, {&worker_, 1}, crew_};
  std::unique_ptr<CameraTap> tap_;  // for the MCAP file only
  std::unique_ptr<App> app_;
  std::function<Hand()> hand_;
  std::unique_ptr<log::FrameLog> frame_log_;
  Report report_;
  Summary summary_;
  long marker_sum_ = 0;
  bool slip_before_ = false;
  bool lost_before_ = false;  // in the last accepted frame
  std::vector<Arrow> arrows_;
  double best_entropy_ = -1;
  bool slip_kept_ = false;
  hal::PixelFormat picture_format_ = hal::PixelFormat::kLuma8;
  std::vector<std::uint8_t> picture_bytes_;
  int picture_height_ = 0;
  double picture_scale_ = 1;
  std::vector<Arrow> picture_arrows_;
};

// "what: cause; next" of the firmware's table, for messages; with the lattice that was found where the reason is of the
// grid.
[[nodiscard]] std::string explain(Reason reason, const App& app);

// Why no frame was accepted; `cause` and `next` are for a session in which none came at all.
[[nodiscard]] std::string explain_none(const Summary& summary, const App& app, std::string_view cause,
                                       std::string_view next);

// "9x7"
[[nodiscard]] std::string grid_text(GridSize grid);

// "the top row and 2 right columns"; empty when nothing is cut.
[[nodiscard]] std::string cut_text(const grid::Cut& cut);

}  // namespace holdfast::tool
