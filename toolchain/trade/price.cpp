// SPDX-License-Identifier: Apache-2.0
#include "toolchain/trade/price.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <span>
#include <utility>

#include "app/app.hpp"
#include "base/math.hpp"
#include "drivers/common/crew.hpp"
#include "drivers/common/jpeg_turbo.hpp"
#include "hal/crew.hpp"
#include "tactile/entropy.hpp"
#include "toolchain/learn/calibrate.hpp"
#include "toolchain/learn/metrics.hpp"
#include "toolchain/play/thread_time.hpp"
#include "toolchain/play/timed_crew.hpp"
#include "toolchain/trade/rival.hpp"
#include "toolchain/treec/tree_model.hpp"

namespace holdfast::trade {
namespace {

// Notes what decoding takes of the frame's time: of several threads, along the critical path (timed_crew.hpp).
class TimedDecoder final : public JpegDecoder {
 public:
  TimedDecoder(JpegDecoder& decoder, tool::TimedCrew& crew) : decoder_(decoder), crew_(crew) {}

  [[nodiscard]] double us() const { return us_; }

 private:
  [[nodiscard]] Status do_decode(std::span<const std::uint8_t> bytes, DecodeScale scale, LumaBuffer& out) override {
    crew_.reset();
    const double start = tool::thread_us();
    const Status status = decoder_.decode(bytes, scale, out);
    us_ = crew_.path_us(tool::thread_us() - start);
    return status;
  }

  JpegDecoder& decoder_;
  tool::TimedCrew& crew_;
  double us_ = 0.0;
};

struct Firmware {
  explicit Firmware(const Point& point) {
    if (point.tuning.model == ModelChoice::kPaper) {
      treec::Model model;
      (void)treec::parse(learn::paper_model_text(), model);
      tree = std::make_unique<model::Tree>(treec::to_table(model));
    }
    config = config_of(point, tree.get());
    const auto threads = static_cast<std::size_t>(point.params.jpeg_threads);
    workers = std::vector<jpeg_fast::Worker>(threads);
    if (threads > 1) helpers = std::make_unique<drivers::Threads>(drivers::Threads::Config{.workers = threads});
    hal::Crew& working = helpers ? static_cast<hal::Crew&>(*helpers) : alone;
    crew = std::make_unique<tool::TimedCrew>(working);
    ours = std::make_unique<EighthDecoder>(jpeg_config(point.params), library, workers, *crew);
    timed =
        std::make_unique<TimedDecoder>(point.tuning.library_jpeg ? static_cast<JpegDecoder&>(library) : *ours, *crew);
  }

  std::unique_ptr<model::Tree> tree;
  pipeline::Config config;
  drivers::TurboJpegDecoder library;
  std::vector<jpeg_fast::Worker> workers;
  hal::Alone alone;
  std::unique_ptr<drivers::Threads> helpers;  // of settings with several threads
  std::unique_ptr<tool::TimedCrew> crew;
  std::unique_ptr<EighthDecoder> ours;
  std::unique_ptr<TimedDecoder> timed;
};

// Mean of |E - E of the truth|.
struct EntropyError {
  void add(const features::Config& config, const DisplacementField& truth, const pipeline::Result& result) {
    if (!result.quality.ok() || !result.referenced) return;
    const std::int32_t q24 = entropy::of_counts_q24(features::histogram_of(truth, config.histogram_range_um));
    sum += std::abs(result.features.entropy.raw() / 65536.0 - q24 / 16777216.0);
    ++count;
  }
  [[nodiscard]] std::optional<double> mean() const {
    return count > 0 ? std::optional(sum / static_cast<double>(count)) : std::nullopt;
  }

  double sum = 0.0;
  long count = 0;
};

double percentile(std::vector<double> values, double share) {
  return learn::quantile(std::move(values), share).value_or(0.0);
}

hal::Frame frame_of(const Film& film, std::size_t k) {
  hal::Frame frame{};
  frame.bytes = film.shots[k].jpeg;
  frame.format = hal::PixelFormat::kMjpeg;
  frame.width = film.width;
  frame.height = film.height;
  frame.timestamp = film.shots[k].time + Micros{1};
  frame.sequence = static_cast<std::uint32_t>(k);
  return frame;
}

// What is left of a picture when two kilobytes are lost in this share of it: they are zero, as a frame of which a
// packet is missing has them.
std::vector<std::uint8_t> damaged(const std::vector<std::uint8_t>& jpeg, double share) {
  constexpr double kLost = 2048.0;
  std::vector<std::uint8_t> out = jpeg;
  const auto from = static_cast<std::ptrdiff_t>(share * (static_cast<double>(out.size()) - kLost));
  std::fill_n(out.begin() + from, static_cast<std::ptrdiff_t>(kLost), std::uint8_t{0});
  return out;
}
// Every so many-th frame is damaged, in these places.
constexpr std::size_t kDamageEvery = 25;
constexpr std::array<double, 5> kDamagedAt{0.1, 0.3, 0.5, 0.7, 0.9};

// Of the pipeline and the decoder, with the pictures that this setting works on: what a firmware built for it alone
// would take. Ours is built for all modes.
std::int64_t memory_bytes(const Point& point) {
  const Params& params = point.params;
  const std::int32_t width = point.tuning.picture_width;
  const auto scale =
      static_cast<std::int32_t>(luma_input::scale_for(kModes[static_cast<std::size_t>(params.mode)].scale, width));
  const std::int64_t picture = std::int64_t{width / scale} * (picture_height(width) / scale);
  const std::int64_t pipeline = static_cast<std::int64_t>(sizeof(App) - sizeof(LumaBuffer));
  const bool library = point.tuning.library_jpeg || scale != 8;
  const auto walk = params.jpeg_lanes == 0 ? sizeof(jpeg_dc::State)
                                           : sizeof(EighthDecoder) + static_cast<std::size_t>(params.jpeg_threads) *
                                                                         sizeof(jpeg_fast::Worker);
  constexpr auto kLibrary = drivers::TurboJpegDecoder::kMemory.tables + drivers::TurboJpegDecoder::kMemory.picture;
  return pipeline + picture + static_cast<std::int64_t>(library ? kLibrary : walk);
}

struct Times {
  std::vector<double> all_us;
  std::vector<double> decode_us;
};

}  // namespace

struct Trialled::State {
  explicit State(Point asked) : point(std::move(asked)) {
    if (point.tuning.rival == Rival::kNone) {
      firmware = std::make_unique<Firmware>(point);
    } else {
      rival = std::make_unique<RivalTracker>(point.tuning.rival);
    }
  }

  // As the next frame, which leaves no trace.
  void damage(const hal::Frame& frame) {
    for (const double share : kDamagedAt) {
      const std::vector<std::uint8_t> jpeg = damaged({frame.bytes.begin(), frame.bytes.end()}, share);
      hal::Frame broken = frame;
      broken.bytes = jpeg;
      const auto luma = std::make_unique<luma_input::State>(pipeline->luma);
      LumaView view;
      ++seen.damaged;
      if (luma_input::update(*luma, firmware->config.luma, *firmware->timed, broken, view).ok()) ++seen.damaged_used;
    }
  }

  Point point;
  std::unique_ptr<Firmware> firmware;
  std::unique_ptr<RivalTracker> rival;
  std::unique_ptr<pipeline::State> pipeline;
  Times times;
  PictureTally seen;
  MarkerError markers;
  EntropyError entropy;
  std::optional<learn::ClipScore> recorded;
};

Trialled::Trialled(const Point& point) : state_(std::make_unique<State>(point)) {}
Trialled::~Trialled() = default;
Trialled::Trialled(Trialled&&) noexcept = default;

void Trialled::show(const Film& film, std::size_t k) {
  State& s = *state_;
  if (film.width != s.point.tuning.picture_width) return;
  const Shot& shot = film.shots[k];
  if (s.rival) {
    if (k % static_cast<std::size_t>(s.rival->every()) != 0) return;
    if (k == 0) s.rival->begin(film);
    const double start = tool::thread_us();
    s.rival->update(shot.jpeg);
    s.times.all_us.push_back(tool::thread_us() - start);
    s.times.decode_us.push_back(s.rival->decode_us());
    ++s.seen.frames;
    s.rival->judge(shot.markers, film.width, s.markers);
    return;
  }
  const pipeline::Config& config = s.firmware->config;
  if (k == 0) s.pipeline = std::make_unique<pipeline::State>();
  if (k % static_cast<std::size_t>(s.point.tuning.frame_every) == 0) {
    const hal::Frame frame = frame_of(film, k);
    const double start = tool::thread_us();
    const pipeline::Result result = pipeline::update(*s.pipeline, config, *s.firmware->timed, frame);
    const double spent_us = tool::thread_us() - start;
    const tool::TimedCrew& crew = *s.firmware->crew;
    // A frame whose helpers came too late says nothing of several threads.
    if (!s.firmware->helpers || !crew.alone()) {
      s.times.all_us.push_back(crew.path_us(spent_us));
      s.times.decode_us.push_back(s.firmware->timed->us());
    }
    ++s.seen.frames;
    if (result.quality.ok()) {
      s.markers.add(s.pipeline->tracker.field, shot.markers, luma_input::reduction(config.luma, frame), film.width);
      s.entropy.add(config.features, shot.moved, result);
    } else {
      ++s.seen.rejected;
    }
  }
  if (k % kDamageEvery == kDamageEvery - 1) s.damage(frame_of(film, k));
  if (k + 1 == film.shots.size()) s.pipeline.reset();
}

void Trialled::show(const learn::RecordedClip& clip) {
  State& s = *state_;
  if (s.rival || s.point.tuning.picture_width != kPictureWidth) return;
  pipeline::Config config = s.firmware->config;
  config.tracker.grid.auto_size = true;
  config.follow_drift = true;  // as a device does
  const auto state = std::make_unique<pipeline::State>();
  std::vector<std::uint8_t> slip;
  if (!learn::learn_rest(clip, config, *s.firmware->timed, *state)) {
    for (std::size_t k = 0; k < clip.frames.size(); ++k) {
      if (k % static_cast<std::size_t>(s.point.tuning.frame_every) != 0) {
        slip.push_back(slip.back());
        continue;
      }
      const hal::Frame frame = sim::as_frame(clip.frames[k]);
      const pipeline::Result result = pipeline::update(*state, config, *s.firmware->timed, frame);
      slip.push_back(result.referenced && result.request == GripRequest::kTighten ? 1 : 0);
    }
  }
  if (!s.recorded) s.recorded.emplace();
  learn::add_clip(*s.recorded, clip.by_frames, slip, nullptr);
}

Price Trialled::price() const {
  const State& s = *state_;
  Price price;
  if (s.firmware) price.memory_bytes = memory_bytes(s.point);
  if (s.seen.frames > 0) {
    price.seen = s.seen;
    price.seen->us_p50 = percentile(s.times.all_us, 0.5);
    price.seen->us_p99 = percentile(s.times.all_us, 0.99);
    price.seen->decode_us_p50 = percentile(s.times.decode_us, 0.5);
    price.seen->rms_px = s.markers.rms();
    price.seen->missed = s.markers.missed;
    price.seen->entropy_error_nat = s.entropy.mean();
  }
  price.recorded = s.recorded;
  return price;
}

}  // namespace holdfast::trade
