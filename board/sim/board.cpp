// SPDX-License-Identifier: Apache-2.0
// The board of a desk without hardware. Text goes to standard output.
//
//   without options   the camera films the scene sphere_slip through the sensor's own format (3280x2464 JPEG). Time is
//                     virtual: the run is over when the scene is
//   --real-time       a process as on a robot: this machine's clock, a camera with its own rate, an output watchdog,
//                     lines that another process can look at, and memory that outlives it
//   --play            likewise, with a recording or a scene before the camera
//   --hand, --right   with a second finger: the same gel beside --real-time, a recording beside --play
//   --sensor          likewise, with the real sensor on this computer's USB
#include "board/board.hpp"

#include <CLI/CLI.hpp>
#include <array>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <system_error>
#include <utility>
#include <variant>
#include <vector>

#include "board/common/process.hpp"
#include "drivers/common/crew.hpp"
#include "drivers/common/empty_mark.hpp"
#include "drivers/common/jpeg_turbo.hpp"
#include "drivers/common/monotonic_clock.hpp"
#include "drivers/common/number_range.hpp"
#include "drivers/common/watchdog_thread.hpp"
#include "drivers/linux/camera_v4l2.hpp"
#include "drivers/sim/camera_paced.hpp"
#include "drivers/sim/camera_played.hpp"
#include "drivers/sim/camera_scene.hpp"
#include "drivers/sim/camera_switched.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/film.hpp"
#include "drivers/sim/gpio.hpp"
#include "drivers/sim/hande.hpp"
#include "drivers/sim/scene/scenes.hpp"
#include "drivers/sim/serial.hpp"
#include "drivers/sim/serial_pty.hpp"
#include "drivers/sim/shared_gpio.hpp"
#include "drivers/sim/tape.hpp"
#include "vision/jpeg_decoder.hpp"

namespace holdfast::board {
namespace {

// A desk has no secrets.
constexpr const char* kDeskCode = "desk";

struct Options {
  bool real_time = false;
  bool hand = false;
  std::filesystem::path play, right;
  std::string sensor;  // any, or a serial number
  bool held = false;
  bool empty = false;
  double fps = 25.0;
  double seconds = 0.0;  // 0: until asked to end
  std::filesystem::path tape, keep, link, gripper, host, code_file, empty_file;
  bool host_commands = false;
  std::string code;
  Settings settings;
  std::string problem;  // of --play
};

// What the console's `fault` can do here.
class DeskFaults final : public hal::Faults {
 public:
  // `right`: a second finger's camera; null: there is none.
  DeskFaults(sim::SwitchedCamera& camera, sim::SwitchedCamera* right, sim::HandE& hand, sim::Serial& link)
      : camera_(camera), right_(right), hand_(hand), link_(link) {}

 private:
  static constexpr std::array<hal::Faults::Row, 13> kRows{{
      {"camera", "off", "no frames come"},
      {"camera", "stuck", "the same picture again and again"},
      {"camera", "bad", "every transfer is damaged"},
      {"camera", "garbage", "random bytes for a picture"},
      {"camera", "dark", "no light"},
      {"camera", "gone", "unplugged"},
      {"gripper", "off", "it does not hear"},
      {"gripper", "mute", "it obeys and does not answer"},
      {"gripper", "garbage", "noise for an answer"},
      {"gripper", "wrong", "answers with a wrong check sum"},
      {"link", "full", "nobody reads the status frames"},
      {"right", "off", "of the right finger no frames come"},
      {"right", "gone", "the right finger's camera is unplugged"},
  }};
  [[nodiscard]] std::span<const Row> do_rows() const override {
    return std::span(kRows).first(right_ == nullptr ? kRows.size() - 2 : kRows.size());
  }
  void do_begin(std::size_t index) override {
    using Camera = sim::CameraSwitch;
    using Hand = sim::LineTrouble;
    constexpr std::array<Camera, 6> kCamera{Camera::kOff,     Camera::kStuck, Camera::kBad,
                                            Camera::kGarbage, Camera::kDark,  Camera::kGone};
    constexpr std::array<Hand, 4> kHand{Hand::kDeaf, Hand::kMute, Hand::kGarbage, Hand::kWrongCrc};
    if (index < kCamera.size()) return camera_.set(kCamera[index]);
    if (index < kCamera.size() + kHand.size()) return hand_.trouble(kHand[index - kCamera.size()]);
    if (index == kRows.size() - 2) return right_->set(Camera::kOff);
    if (index == kRows.size() - 1) return right_->set(Camera::kGone);
    link_.set_full(true);
  }
  void do_end_all() override {
    camera_.set(sim::CameraSwitch::kNone);
    if (right_ != nullptr) right_->set(sim::CameraSwitch::kNone);
    hand_.trouble(sim::LineTrouble::kNone);
    link_.set_full(false);
  }

  sim::SwitchedCamera& camera_;
  sim::SwitchedCamera* right_;
  sim::HandE& hand_;
  sim::Serial& link_;
};

// Time, and what the camera sees in it.
class World {
 public:
  World() = default;
  virtual ~World() = default;
  World(const World&) = delete;
  World& operator=(const World&) = delete;
  [[nodiscard]] virtual hal::Clock& clock() = 0;
  [[nodiscard]] virtual hal::Camera& camera() = 0;
  // Of the right finger of a hand; null: there is one finger.
  [[nodiscard]] virtual hal::Camera* right() { return nullptr; }
  [[nodiscard]] virtual bool over() const = 0;
};

class Scene final : public World {
 public:
  [[nodiscard]] hal::Clock& clock() override { return clock_; }
  [[nodiscard]] hal::Camera& camera() override { return camera_; }
  [[nodiscard]] bool over() const override { return !camera_.lent().bytes.empty() && camera_.lent().sequence >= last_; }

 private:
  sim::Clock clock_;
  sim::SceneCamera camera_{scene::sphere_slip(), clock_};
  std::uint32_t last_ = static_cast<std::uint32_t>(scene::frame_count(scene::sphere_slip())) - 1;
};

sim::PacedCamera::Config paced(const Options& options, std::string identity) {
  sim::PacedCamera::Config config;
  config.identity = std::move(identity);
  config.period = std::chrono::microseconds(std::llround(1e6 / options.fps));
  if (options.held) config.touch = {};
  if (options.empty) config.touch = std::chrono::microseconds::max();
  return config;
}

class RealTime final : public World {
 public:
  explicit RealTime(const Options& options) : camera_(film_, clock_, paced(options, "28D1-D7C6")) {
    if (options.hand) right_.emplace(film_, clock_, paced(options, "28D3-K2R9"));
  }
  [[nodiscard]] hal::Clock& clock() override { return clock_; }
  [[nodiscard]] hal::Camera& camera() override { return camera_; }
  [[nodiscard]] hal::Camera* right() override { return right_ ? &*right_ : nullptr; }
  [[nodiscard]] bool over() const override { return false; }

 private:
  // None comes again within half a second; more would make the start longer.
  static constexpr std::size_t kPictures = 12;
  drivers::MonotonicClock clock_;
  sim::Film film_ = sim::shoot(hal::PixelFormat::kLuma8, kPictures);
  sim::PacedCamera camera_;
  std::optional<sim::PacedCamera> right_;
};

class Played final : public World {
 public:
  explicit Played(const Options& options) : opened_(sim::PlayedCamera::open(options.play, clock_, {})) {
    if (!options.right.empty()) right_.emplace(sim::PlayedCamera::open(options.right, clock_, {}));
  }
  // Why there is no camera; empty: there is.
  [[nodiscard]] std::string problem() const {
    for (const Opened* const one : {&opened_, right_ ? &*right_ : nullptr}) {
      const auto* error = one == nullptr ? nullptr : std::get_if<sim::Error>(one);
      if (error != nullptr) return error->line;
    }
    return {};
  }
  [[nodiscard]] hal::Clock& clock() override { return clock_; }
  [[nodiscard]] hal::Camera& camera() override { return *std::get<0>(opened_); }
  [[nodiscard]] hal::Camera* right() override { return right_ ? std::get<0>(*right_).get() : nullptr; }
  [[nodiscard]] bool over() const override { return false; }

 private:
  using Opened = sim::Result<std::unique_ptr<sim::PlayedCamera>>;
  drivers::MonotonicClock clock_;
  Opened opened_;
  std::optional<Opened> right_;
};

// The sensor on this computer's USB.
class Sensor final : public World {
 public:
  explicit Sensor(const Options& options) : serial_(options.sensor == "any" ? "" : options.sensor) {}
  [[nodiscard]] hal::Clock& clock() override { return clock_; }
  [[nodiscard]] hal::Camera& camera() override { return camera_; }
  [[nodiscard]] bool over() const override { return false; }

 private:
  [[nodiscard]] drivers::V4l2Camera::Config config() const {
    drivers::V4l2Camera::Config config;
    config.serial = serial_;
    return config;
  }
  std::string serial_;
  drivers::MonotonicClock clock_;
  drivers::V4l2Camera camera_{config()};
};

// A serial port at a path that stays the same, whatever number the system gives to the pseudo terminal.
class NamedPty {
 public:
  explicit NamedPty(std::filesystem::path name) : name_(std::move(name)) {
    std::error_code error;
    if (!pty_.opened()) {
      problem_ = "cannot open a pseudo terminal";
      return;
    }
    // Of a run that was killed; another link is somebody's.
    if (std::filesystem::read_symlink(name_, error).string().starts_with("/dev/pts/")) {
      std::filesystem::remove(name_, error);
    }
    std::filesystem::create_symlink(pty_.path(), name_, error);
    if (error) problem_ = "cannot make the link " + name_.string() + ": " + error.message();
  }
  ~NamedPty() {
    std::error_code error;
    if (problem_.empty() && std::filesystem::read_symlink(name_, error) == pty_.path()) {
      std::filesystem::remove(name_, error);
    }
  }
  NamedPty(const NamedPty&) = delete;
  NamedPty& operator=(const NamedPty&) = delete;

  [[nodiscard]] const std::string& problem() const { return problem_; }
  [[nodiscard]] hal::Serial& port() { return pty_; }

 private:
  sim::SerialPty pty_;
  std::filesystem::path name_;
  std::string problem_;
};

drivers::Threads::Config threads(const Params& params) {
  drivers::Threads::Config config;
  config.workers = static_cast<std::size_t>(params.jpeg_threads);
  return config;
}

std::unique_ptr<World> world_of(Options& options) {
  if (!options.play.empty()) {
    auto played = std::make_unique<Played>(options);
    options.problem = played->problem();
    if (options.problem.empty()) return played;
  }
  if (!options.sensor.empty()) return std::make_unique<Sensor>(options);
  if (options.real_time) return std::make_unique<RealTime>(options);
  return std::make_unique<Scene>();
}

class Desk {
 public:
  explicit Desk(Options&& given) : options(std::move(given)) {
    hand_.put_object({.width_mm = 20.0});
    if (tape_) lines_.record(*tape_);
    for (const NamedPty* const port : {link_.get(), gripper_.get(), host_.get()}) {
      if (port != nullptr) note(port->problem());
    }
  }

  [[nodiscard]] bool watch(OutputWatchdog& watchdog) {
    if (!options.real_time && options.play.empty() && options.sensor.empty()) return true;
    watchdog_ = std::make_unique<drivers::WatchdogThread>(watchdog, gpio_, world_->clock());
    return watchdog_->running();
  }

  [[nodiscard]] bool over() const {
    const bool long_enough = options.seconds > 0.0 && world_->clock().now() - began_ >= lasts_;
    return asked_to_end() || long_enough || world_->over();
  }

  Options options;
  std::string problem;  // the first of those that it was made with
  KeptFile kept{options.keep, options.hand || !options.right.empty()};
  drivers::EmptyMark empty{options.empty_file};

 private:
  void note(const std::string& what) {
    if (problem.empty()) problem = what;
  }
  [[nodiscard]] std::optional<sim::Tape> tape_of(const std::filesystem::path& path) {
    std::string error;
    if (path.empty()) return std::nullopt;
    std::optional<sim::Tape> tape = sim::Tape::file(path, sim::Tape::Full::kDrop, true, error);
    note(error);
    return tape;
  }
  [[nodiscard]] static std::unique_ptr<NamedPty> pty_of(const std::filesystem::path& path) {
    return path.empty() ? nullptr : std::make_unique<NamedPty>(path);
  }
  [[nodiscard]] static hal::Serial& port_or(const std::unique_ptr<NamedPty>& port, hal::Serial& other) {
    return port ? port->port() : other;
  }

  std::unique_ptr<World> world_ = world_of(options);
  std::chrono::microseconds began_ = world_->clock().now();
  std::chrono::microseconds lasts_{std::llround(options.seconds * 1e6)};
  std::optional<sim::Tape> tape_ = tape_of(options.tape);
  sim::Gpio lines_{world_->clock()};
  sim::SharedGpio gpio_{lines_};
  sim::Serial recorded_;
  sim::HandE hand_{world_->clock()};
  std::unique_ptr<NamedPty> link_ = pty_of(options.link);
  std::unique_ptr<NamedPty> gripper_ = pty_of(options.gripper);
  drivers::TurboJpegDecoder other_scales_;
  std::array<jpeg_fast::Worker, hal::kMaxWorkers> workers_;
  drivers::Threads crew_{threads(options.settings.params)};
  EighthDecoder jpeg_{jpeg_config(options.settings.params), other_scales_, workers_, crew_};
  std::unique_ptr<drivers::WatchdogThread> watchdog_;
  StandardOutput standard_output_;
  std::unique_ptr<NamedPty> host_ = pty_of(options.host);
  static constexpr std::size_t kLongestFrame = 4'000'000;  // a raw picture of mode precise; JPEG is far below
  sim::SwitchedCamera camera_{world_->camera(), kLongestFrame};
  std::unique_ptr<sim::SwitchedCamera> right_camera_ =
      world_->right() == nullptr ? nullptr : std::make_unique<sim::SwitchedCamera>(*world_->right(), kLongestFrame);
  std::unique_ptr<Finger> right_ = right_camera_ ? std::make_unique<Finger>(*right_camera_) : nullptr;
  DeskFaults faults_{camera_, right_camera_.get(), hand_, recorded_};

 public:
  hal::Serial& host = port_or(host_, standard_output_);
  Devices devices{camera_,     gpio_, port_or(link_, recorded_), world_->clock(), jpeg_, !options.play.empty(),
                  right_.get()};
  Periphery periphery{port_or(gripper_, hand_), kept.keep()};
  console::Place place{.board = "sim",
                       .code = options.code,
                       .settings = options.settings.store.get(),
                       .models = options.settings.models.get(),
                       .owner = options.settings.owner.get(),
                       .notes = options.settings.notes.get(),
                       .faults = &faults_,
                       .prompts = host_ != nullptr,
                       .host_commands = options.host_commands};
};

std::unique_ptr<Desk> desk;

}  // namespace

std::optional<int> make(int argc, char** argv) {
  Options options;
  CLI::App cli{"The firmware on a simulated board: without options a simulated grasp in virtual time, to its end",
               "holdfastd"};
  auto* const real_time = cli.add_flag("--real-time", options.real_time,
                                       "run in real time with a camera that never ends: an empty gel, and from 1.2 s "
                                       "on an object that is held");
  cli.add_option("--fps", options.fps, "frames per second, 1 to 100")
      ->needs(real_time)
      ->check(number_from_to(1.0, 100.0))
      ->capture_default_str();
  auto* const held =
      cli.add_flag("--held", options.held, "the object is held from the first frame on")->needs(real_time);
  cli.add_flag("--empty", options.empty, "the gel stays empty")->needs(real_time)->excludes(held);
  cli.add_flag("--hand", options.hand, "two fingers, each with its own sensor")->needs(real_time);
  auto* const play =
      cli.add_option(
             "--play", options.play,
             "run in real time with this recording or scene before the camera, again and again. It begins with an "
             "empty gel; where it begins anew, what was held is gone: SLIP (contact_lost)")
          ->check(CLI::ExistingPath)
          ->excludes(real_time);
  cli.add_option("--right", options.right, "of a second finger, what --play is of the first: the right one's")
      ->check(CLI::ExistingPath)
      ->needs(play);
  cli.add_option("--sensor", options.sensor,
                 "run in real time with the GelSight Mini on this computer's USB: its serial, as 2BNN4ZE7, or any. "
                 "The lines are simulated: nothing is driven")
      ->excludes(real_time)
      ->excludes("--play");
  cli.add_option("--seconds", options.seconds, "end after so many seconds of the board's time")
      ->check(number_from_to(0.001, 1e7));
  cli.add_option("--tape", options.tape, "show the output lines in this file (drivers/sim/tape.hpp)");
  cli.add_option("--keep", options.keep, "keep the reference in this file, and go on with what it holds");
  cli.add_option("--empty-file", options.empty_file, empty_file_help());
  cli.add_option("--link", options.link, "make this path a serial port with status and command frames");
  cli.add_option("--gripper", options.gripper,
                 "make this path the gripper's serial port; without it a simulated Hand-E answers");
  cli.add_option("--host", options.host,
                 "make this path the console's serial port; without it text on standard output");
  cli.add_flag("--host-commands", options.host_commands,
               "obey command frames (TARE, OPENING, RELEASE, ARM, GRIP) on the console's port without its unlock");
  cli.add_option("--code-file", options.code_file, "the code that unlocks the console; without it `desk`");
  add_settings(cli, options.settings);
  cli.footer(
      "SIGTERM, SIGINT and SIGHUP end it in order: GRIP_OK goes LOW.\n\nExample:\n"
      "  holdfastd --real-time --keep /tmp/grasp.keep --link /tmp/holdfast.link --set gripper=1\n"
      "  holdfastd --real-time --host /tmp/holdfast.console, and beside it: holdfast console /tmp/holdfast.console\n"
      "  holdfastd --play grasp.avi --link /tmp/holdfast.link");
  if (const std::optional<int> status = parse_command_line(cli, argc, argv)) return status;
  if (const std::string wrong = read_settings(options.settings); !wrong.empty()) {
    return fail(2, wrong, "two settings that contradict each other, or a file that is not yours", "change one of them");
  }
  if (!options.settings.trouble.empty()) {
    return fail(1, options.settings.trouble, "a folder that is not there or not yours, or another file was meant",
                "give another path");
  }
  for (const std::string& line : options.settings.told) say(line);
  options.code = kDeskCode;
  if (!options.code_file.empty()) {
    if (const std::string wrong = read_code(options.code_file, options.code); !wrong.empty()) {
      return fail(2, wrong, "another file was meant", "write the code into it, one line of 6 to 64 characters");
    }
  }
  desk = std::make_unique<Desk>(std::move(options));
  if (!desk->options.problem.empty()) {
    say(desk->options.problem);
    return 1;
  }
  if (!desk->empty.problem().empty()) say(desk->empty.problem());
  if (!desk->problem.empty()) {
    return fail(1, desk->problem, "a folder that is not there or not yours, or a file in its place",
                "give another path");
  }
  heed_signals();
  return std::nullopt;
}

Devices& devices() {
  return desk->devices;
}
Periphery& periphery() {
  return desk->periphery;
}
hal::Serial& host() {
  return desk->host;
}
console::Place place() {
  return desk->place;
}
Params params() {
  return desk->options.settings.params;
}
const model::Tree* model() {
  return desk->options.settings.model();
}
bool watch(OutputWatchdog& watchdog) {
  return desk->watch(watchdog);
}
void started() {}
void tell(const App& app) {  // nothing of the first frame: virtual time begins with the program
  desk->kept.tell();
  desk->empty.tell(app.holds_nothing(), app.ok_frames());
}
bool over() {
  return desk->over();
}

}  // namespace holdfast::board
