// SPDX-License-Identifier: Apache-2.0
#include "toolchain/live/desk.hpp"

#include <array>
#include <utility>

#include "app/daemon.hpp"
#include "console/console.hpp"
#include "drivers/common/crew.hpp"
#include "drivers/common/jpeg_turbo.hpp"
#include "drivers/common/trouble.hpp"
#include "drivers/common/watchdog_thread.hpp"
#include "drivers/sim/gpio.hpp"
#include "drivers/sim/hande.hpp"
#include "drivers/sim/scene/picture/jpeg_encode.hpp"
#include "drivers/sim/serial.hpp"
#include "drivers/sim/shared_gpio.hpp"
#include "hal/keep.hpp"
#include "toolchain/log/facts.hpp"
#include "toolchain/session/camera_tap.hpp"
#include "toolchain/session/session.hpp"
#include "vision/jpeg_decoder.hpp"
#include "vision/luma_input.hpp"

namespace holdfast::live {
namespace {

constexpr int kViewQuality = 85;
constexpr std::chrono::milliseconds kAskEvery{500};

drivers::Threads::Config threads(const Params& params) {
  drivers::Threads::Config config;
  config.workers = static_cast<std::size_t>(params.jpeg_threads);
  return config;
}

}  // namespace

struct Desk::Parts {
  Parts(hal::Camera& camera, hal::Clock& the_clock, Hub& hub, Config the_config)
      : config(std::move(the_config)), clock(the_clock), tap(camera), console(hub, daemon, clock, place()) {}

  [[nodiscard]] console::Place place() const {
    console::Place place;
    place.board = "desk";
    place.code = config.code;
    place.prompts = false;
    return place;
  }

  Config config;
  hal::Clock& clock;
  tool::CameraTap tap;
  sim::Gpio lines{clock};
  sim::SharedGpio gpio{lines};
  sim::Serial link;  // nobody listens
  sim::HandE hand{clock};
  hal::NoKeep keep;
  drivers::TurboJpegDecoder other_scales;
  std::array<jpeg_fast::Worker, hal::kMaxWorkers> workers;
  drivers::Threads crew{threads(config.params)};
  EighthDecoder jpeg{jpeg_config(config.params), other_scales, workers, crew};
  Daemon daemon{{tap, gpio, link, clock, jpeg, config.as_device}, {hand, keep}, config.tree};
  console::Console console;
  std::unique_ptr<drivers::WatchdogThread> watchdog;

  Recorder* recorder = nullptr;
  std::uint64_t seen = 0;
  long frame = 0;
  std::uint16_t sequence = 0;  // of the status frame of `frame`
  std::chrono::microseconds first{}, asked_at{};
  std::vector<log::Arrow> arrows;
};

Desk::Desk(hal::Camera& camera, hal::Clock& clock, Hub& hub, const Config& config)
    : hub_(hub), parts_(std::make_unique<Parts>(camera, clock, hub, config)) {}
Desk::~Desk() = default;

std::string Desk::learn(const sim::RecordedFrame& rest) {
  const Status status = parts_->daemon.app().learn(parts_->config.params, sim::as_frame(rest));
  return status.ok() ? std::string() : tool::explain(status.reason, parts_->daemon.app());
}

std::string Desk::start() {
  Parts& p = *parts_;
  p.watchdog = std::make_unique<drivers::WatchdogThread>(p.daemon.app().watchdog(), p.gpio, p.clock);
  if (!p.watchdog->running()) {
    return trouble("no thread for the output watchdog", "too many processes", "end some, and start anew");
  }
  if (const Status status = p.daemon.start(p.config.params); !status.ok()) {
    return tool::explain(status.reason, p.daemon.app());
  }
  p.console.start(p.config.params);
  return {};
}

void Desk::record_to(Recorder* recorder) {
  parts_->recorder = recorder;
}

std::optional<log::FrameRecord> Desk::turn() {
  Parts& p = *parts_;
  p.daemon.poll();
  p.console.poll();
  if (hub_.listeners() > 0 && p.clock.now() - p.asked_at >= kAskEvery) {
    p.asked_at = p.clock.now();
    // What no frame carries: the page reads it among the lines of text.
    (void)hub_.say("reference json\r\n");
  }
  if (p.tap.count() == p.seen) return std::nullopt;
  p.seen = p.tap.count();
  const hal::Frame& given = p.tap.given();
  if (p.seen == 1) p.first = given.timestamp;
  const App& app = p.daemon.app();
  // By the number of its status frame: one more is sent whenever a picture is overdue.
  p.frame += static_cast<std::uint16_t>(app.last_status().sequence - p.sequence);
  p.sequence = app.last_status().sequence;
  const double t_s = static_cast<double>((given.timestamp - p.first).count()) * 1e-6;
  log::FrameRecord record = log::facts_of(app, p.frame, t_s, app.last_status().alive);
  if (p.recorder != nullptr) {
    const double scale = luma_input::reduction(pipeline_config(p.config.params).luma, given);
    log::arrows_of(app, scale, p.arrows);
    p.recorder->add(record, p.arrows, app.state().tracker.field.grid.cols, given);
  }
  if (hub_.picture_wanted()) show();
  return record;
}

// The working picture: what the firmware sees, with the markers where it has them.
void Desk::show() {
  Parts& p = *parts_;
  const App& app = p.daemon.app();
  const hal::Frame& given = p.tap.given();
  if (!app.result().quality.ok() && given.format == hal::PixelFormat::kMjpeg) return;
  LumaView view{given.bytes.data(), given.width, given.height, given.stride};
  if (given.format == hal::PixelFormat::kMjpeg) view = app.state().luma.decoded.view();
  if (view.width <= 0 || view.stride != view.width) return;
  const std::span<const std::uint8_t> pixels(
      view.data, static_cast<std::size_t>(view.width) * static_cast<std::size_t>(view.height));
  hub_.show(app.last_status().sequence,
            scene::encode_jpeg(pixels, view.width, view.height, scene::JpegInput::kGrey, kViewQuality));
}

std::string Desk::camera_problem() const {
  if (parts_->daemon.streaming()) return std::string(parts_->tap.unset());
  return std::string(parts_->tap.problem());
}

void Desk::stop() {
  parts_->daemon.stop();
  parts_->console.end();
}

}  // namespace holdfast::live
