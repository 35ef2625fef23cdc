// SPDX-License-Identifier: Apache-2.0
#include "board/linux/appliance.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "board/board.hpp"
#include "board/common/process.hpp"
#include "drivers/common/crew.hpp"
#include "drivers/common/empty_mark.hpp"
#include "drivers/common/jpeg_turbo.hpp"
#include "drivers/common/monotonic_clock.hpp"
#include "drivers/common/sysfs_supply.hpp"
#include "drivers/common/watchdog_thread.hpp"
#include "drivers/linux/bridge_mcp2221.hpp"
#include "drivers/linux/camera_libcamera.hpp"
#include "drivers/linux/camera_v4l2.hpp"
#include "drivers/linux/fixed_text.hpp"
#include "drivers/linux/gpio_gpiod.hpp"
#include "drivers/linux/hid_hidapi.hpp"
#include "drivers/linux/notify.hpp"
#include "drivers/linux/serial_tty.hpp"
#include "vision/jpeg_decoder.hpp"

namespace holdfast::board {
namespace {

struct Options {
  std::string sensor, right;
  std::string backend = "v4l2";
  std::string gpio = "header";
  std::string host, link, gripper;
  bool host_commands = false;
  std::filesystem::path keep, code_file, ok_file, empty_file;
  std::uint64_t ok_frames = 250;  // 10 s at 25 fps
  std::string code;
  std::int32_t time_scale = hardware().time_scale;
  Settings settings;
};

// A port that is not wired.
class NoPort final : public hal::Serial {
 private:
  [[nodiscard]] bool do_write(std::span<const std::uint8_t>) override { return true; }
  [[nodiscard]] std::size_t do_read(std::span<std::uint8_t>) override { return 0; }
};

// A computer without lines: whoever listens to `link` is told, and nobody else.
class NoLines final : public hal::Gpio {
 private:
  [[nodiscard]] bool do_set(hal::Line, hal::Level) override { return true; }
  [[nodiscard]] std::optional<hal::Level> do_read(hal::Input) override { return hal::Level::kLow; }
};

class Appliance {
 public:
  explicit Appliance(Options&& given) : options(std::move(given)) {
    if (options.gpio == "header") {
      problem = header_.open({.wiring = hardware().wiring, .consumer = "holdfastd", .devices = "/dev"});
    } else if (options.gpio == "mcp2221") {
      problem = usb_.open(drivers::kMcp2221Vendor, drivers::kMcp2221Product, {});
      if (problem.empty()) problem = bridge_.open({.wiring = drivers::kMcp2221Desk});
    }
    if (supply_) supply_->start();
  }

  [[nodiscard]] bool watch(OutputWatchdog& watchdog) {
    watchdog_ = std::make_unique<drivers::WatchdogThread>(watchdog, gpio_, clock_);
    return watchdog_->running();
  }
  void started() { notify_.ready(); }
  [[nodiscard]] bool over() {
    notify_.alive(clock_.now());
    tell_of_camera(*camera_, right_ ? "left finger: " : "", told_);
    if (right_) tell_of_camera(*right_camera_, "right finger: ", told_of_right_);
    return asked_to_end();
  }
  void tell(const App& app) {
    prove(app);
    tell_of_first_frame(app);
    tell_of_supply();
    kept_.tell();
    empty_.tell(app.holds_nothing(), app.ok_frames());
  }
  // Whoever has to know that this release works on this board - an update is kept by it - looks for the file.
  void prove(const App& app) {
    // Again after as many more: a file system that is full may have room then.
    const std::uint64_t frames = app.ok_frames();
    if (proved_ || options.ok_file.empty() || frames == 0 || frames % options.ok_frames != 0) return;
    const int fd = ::open(options.ok_file.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0644);
    proved_ = fd >= 0;
    if (proved_) ::close(fd);
  }
  // Into the log, once, without memory: the kernel's clock begins with it, and one of the firmware's seconds is
  // `time_scale` of its.
  void tell_of_first_frame(const App& app) {
    if (told_first_ || !app.first_confirmed()) return;
    told_first_ = true;
    const std::int64_t tenths = *app.first_confirmed() * options.time_scale / std::chrono::milliseconds{100};
    drivers::FixedText<120> line;
    line << "holdfastd: first frame fine " << tenths / 10 << "." << tenths % 10 << " s after the kernel started\n";
    (void)(::write(STDERR_FILENO, line.c_str(), line.view().size()) >= 0);
  }
  // Once: its driver may come later than this program, but not by ten seconds.
  void tell_of_supply() {
    if (told_supply_ || !supply_ || supply_->missed() < 10) return;
    told_supply_ = true;
    constexpr std::string_view kLine =
        "holdfastd: under-voltage of the board is not reported: its kernel has no sensor for it "
        "(raspberrypi-hwmon)\n";
    (void)(::write(STDERR_FILENO, kLine.data(), kLine.size()) >= 0);
  }
  [[nodiscard]] hal::Serial& host() { return host_ ? static_cast<hal::Serial&>(*host_) : standard_output_; }

  [[nodiscard]] const std::string& empty_problem() const { return empty_.problem(); }

  const Options options;
  std::string problem;

 private:
  using Port = std::unique_ptr<drivers::SerialTty>;

  // A port that is not there goes on being tried: its adapter may be plugged in later.
  // `backlog`: what is late is no news on the link; text on the host's port is read whenever.
  [[nodiscard]] Port port_of(const std::string& path, std::chrono::microseconds backlog) {
    if (path.empty()) return nullptr;
    Port port = std::make_unique<drivers::SerialTty>(clock_);
    if (const std::string trouble = port->open({.path = path, .backlog = backlog}); !trouble.empty()) say(trouble);
    return port;
  }
  [[nodiscard]] hal::Serial& port_or_none(const Port& port) {
    return port ? static_cast<hal::Serial&>(*port) : no_port_;
  }
  [[nodiscard]] std::unique_ptr<hal::Camera> camera_of(const std::string& serial) const {
    drivers::V4l2Camera::Config config;
    config.serial = serial;
    config.time_scale = options.time_scale;
    if (options.backend == "libcamera") return std::make_unique<drivers::LibcameraCamera>(config);
    return std::make_unique<drivers::V4l2Camera>(config);
  }
  [[nodiscard]] static std::unique_ptr<drivers::SysfsSupply> supply_of() {
    if (hardware().supply.empty()) return nullptr;
    return std::make_unique<drivers::SysfsSupply>(
        drivers::SysfsSupply::Config{.sensor = std::string(hardware().supply)});
  }
  // Into the log, once each, without memory. (A camera that is missing is looked for again several times a second.)
  static void tell_of_camera(const hal::Camera& camera, std::string_view whose, drivers::FixedText<511>& told) {
    const std::string_view now = camera.problem().empty() ? camera.unset() : camera.problem();
    if (now == told.view()) return;
    told = now;
    drivers::FixedText<600> line;
    line << "holdfastd: " << whose << (now.empty() ? "the camera is there" : now) << "\n";
    (void)(::write(STDERR_FILENO, line.c_str(), line.view().size()) >= 0);
  }

  drivers::Notify notify_;
  drivers::MonotonicClock clock_{options.time_scale};
  std::unique_ptr<hal::Camera> camera_ = camera_of(options.sensor);
  std::unique_ptr<hal::Camera> right_camera_ = options.right.empty() ? nullptr : camera_of(options.right);
  std::unique_ptr<Finger> right_ = right_camera_ ? std::make_unique<Finger>(*right_camera_) : nullptr;
  drivers::FixedText<511> told_, told_of_right_;  // of the cameras
  bool told_first_ = false, proved_ = false, told_supply_ = false;
  drivers::GpiodGpio header_;
  drivers::HidapiPort usb_;
  drivers::Mcp2221Gpio bridge_{usb_};
  NoLines no_lines_;
  hal::Gpio& gpio_ = options.gpio == "header"    ? static_cast<hal::Gpio&>(header_)
                     : options.gpio == "mcp2221" ? static_cast<hal::Gpio&>(bridge_)
                                                 : no_lines_;
  StandardOutput standard_output_;
  NoPort no_port_;
  static constexpr std::chrono::microseconds kFresh{100'000}, kWhenever{0};
  Port host_ = port_of(options.host, kWhenever);
  Port link_ = port_of(options.link, kFresh), gripper_ = port_of(options.gripper, kFresh);
  KeptFile kept_{options.keep, right_ != nullptr};
  drivers::EmptyMark empty_{options.empty_file};
  std::unique_ptr<drivers::SysfsSupply> supply_ = supply_of();
  drivers::TurboJpegDecoder other_scales_;
  std::array<jpeg_fast::Worker, hal::kMaxWorkers> workers_;
  drivers::Threads crew_{{.workers = static_cast<std::size_t>(options.settings.params.jpeg_threads)}};
  EighthDecoder jpeg_{jpeg_config(options.settings.params), other_scales_, workers_, crew_};
  std::unique_ptr<drivers::WatchdogThread> watchdog_;

 public:
  Devices devices{*camera_, gpio_, port_or_none(link_), clock_, jpeg_, false, right_.get()};
  Periphery periphery{port_or_none(gripper_), kept_.keep(), supply_.get()};
};

std::unique_ptr<Appliance> appliance;

// After a process that did not end in order: what it drove goes LOW. With that process's own command line, of which
// only --gpio counts, and whose errors are not this one's. Nothing that is held is touched, so it may be called by
// hand. 0: no output that nobody holds is HIGH; 1: one may be.
int lower(int argc, char** argv) {
  Options options;
  CLI::App cli{"", "holdfastd"};
  bool ignored = false;
  cli.allow_extras();
  cli.add_flag("--lower", ignored);
  cli.add_option("--gpio", options.gpio);
  if (const std::optional<int> status = parse_command_line(cli, argc, argv)) return *status;
  if (options.gpio == "none") return 0;
  if (options.gpio == "mcp2221") {
    drivers::HidapiPort usb;
    drivers::Mcp2221Gpio bridge(usb);
    std::string problem = usb.open(drivers::kMcp2221Vendor, drivers::kMcp2221Product, {});
    if (problem.empty()) problem = bridge.open({.wiring = drivers::kMcp2221Desk});
    if (!problem.empty()) say(problem);
    return problem.empty() ? 0 : 1;
  }
  const drivers::GpiodGpio::Lowered lowered =
      drivers::GpiodGpio::lower({.wiring = hardware().wiring, .consumer = "holdfastd"});
  if (!lowered.problems.empty()) say("--lower: " + lowered.problems.substr(0, lowered.problems.size() - 1));
  return lowered.all ? 0 : 1;
}

}  // namespace

std::optional<int> make(int argc, char** argv) {
  constexpr std::string_view kLower = "--lower";
  if (std::find(argv + 1, argv + argc, kLower) != argv + argc) return lower(argc, argv);
  Options options;
  bool asked_to_lower = false;  // for the help alone
  CLI::App cli{"The firmware with real devices, board " + std::string(hardware().name), "holdfastd"};
  auto* const sensor = cli.add_option("--sensor", options.sensor,
                                      "serial of the GelSight Mini, as 2BNN4ZE7; without it the only one there");
  cli.add_option("--right", options.right,
                 "serial of the right finger's GelSight Mini; then --sensor is the left finger's")
      ->needs(sensor);
  cli.add_option("--backend", options.backend, "camera by v4l2 or libcamera")
      ->check(CLI::IsMember({"v4l2", "libcamera"}))
      ->capture_default_str();
  cli.add_option("--gpio", options.gpio, "lines by the board's header, by an MCP2221A on USB, or none")
      ->check(CLI::IsMember({"header", "mcp2221", "none"}))
      ->capture_default_str();
  cli.add_option("--host", options.host, "serial port of the diagnostics text; without it standard output");
  cli.add_flag(
      "--host-commands", options.host_commands,
      "obey command frames (TARE, OPENING, RELEASE, ARM, GRIP) on the port of --host without its unlock: for a "
      "robot that is wired to it");
  cli.add_option("--link", options.link, "serial port of status and command frames");
  cli.add_option("--gripper", options.gripper, "serial port of a Robotiq Hand-E, as /dev/serial/by-id/...");
  cli.add_option("--keep", options.keep, "keep the reference in this file, and go on with what it holds");
  if (hardware().time_scale > 1) {
    cli.add_option("--time-scale", options.time_scale, "seconds of the world in one of the firmware's")
        ->check(CLI::Range(1, 100))
        ->capture_default_str();
  }
  cli.add_option("--code-file", options.code_file,
                 "the code that unlocks the console, one line; without it the console changes nothing");
  cli.add_option("--ok-file", options.ok_file, "make this file after --ok-frames OK frames in a row without a FAULT");
  cli.add_option("--ok-frames", options.ok_frames, "frames for --ok-file")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  cli.add_option("--empty-file", options.empty_file, empty_file_help());
  add_settings(cli, options.settings);
  cli.add_flag("--lower", asked_to_lower,
               "drive the outputs of a holdfastd that is gone LOW, and end; of the other options --gpio counts");
  cli.footer(
      "SIGTERM, SIGINT and SIGHUP end it in order: GRIP_OK goes LOW.\n\nExample:\n"
      "  holdfastd --sensor 2BNN4ZE7 --link /dev/ttyAMA0 --keep /run/holdfast/reference --set gripper=1 "
      "--gripper /dev/serial/by-id/usb-FTDI_USB-RS485_Cable_FT1234-if00-port0");
  if (const std::optional<int> status = parse_command_line(cli, argc, argv)) return status;
  if (const std::string wrong = read_settings(options.settings); !wrong.empty()) {
    return fail(2, wrong, "two settings that contradict each other, or a file that is not this user's",
                "change one of them");
  }
  // Without a place for settings, or a code, it works all the same: nothing can be saved, or nobody can change
  // anything.
  if (!options.settings.trouble.empty()) say(options.settings.trouble);
  if (options.settings.owner == nullptr) say("development mode: settings and models are taken without a signature");
  for (const std::string& line : options.settings.told) say(line);
  if (!options.code_file.empty()) {
    if (const std::string wrong = read_code(options.code_file, options.code); !wrong.empty()) {
      say(wrong + ": the console stays locked");
      options.code.clear();
    }
  }
  if (!options.right.empty() && options.backend == "libcamera") {
    return fail(2, "--right does not go with --backend libcamera", "that library serves one camera object in a process",
                "leave --backend away: v4l2 serves both");
  }
  if (!options.right.empty() && options.right == options.sensor) {
    return fail(2, "--sensor and --right are the same sensor", "the same serial number was given twice",
                "give each finger its own: holdfast doctor lists them");
  }
  appliance = std::make_unique<Appliance>(std::move(options));
  if (!appliance->problem.empty()) {
    say(appliance->problem);
    return 1;
  }
  if (!appliance->empty_problem().empty()) say(appliance->empty_problem());
  // A page that was swapped out would cost more than a frame. Without the right to it (LimitMEMLOCK of the unit) it
  // goes on all the same: boards have no swap.
  if (::mlockall(MCL_CURRENT | MCL_FUTURE) != 0) {
    say("cannot lock memory (mlockall): page faults may delay frames. Next: raise LimitMEMLOCK");
  }
  heed_signals();
  return std::nullopt;
}

Devices& devices() {
  return appliance->devices;
}
Periphery& periphery() {
  return appliance->periphery;
}
hal::Serial& host() {
  return appliance->host();
}
console::Place place() {
  return {.board = hardware().name,
          .code = appliance->options.code,
          .settings = appliance->options.settings.store.get(),
          .models = appliance->options.settings.models.get(),
          .owner = appliance->options.settings.owner.get(),
          .notes = appliance->options.settings.notes.get(),
          .faults = nullptr,
          .prompts = !appliance->options.host.empty(),
          .host_commands = appliance->options.host_commands};
}
Params params() {
  return appliance->options.settings.params;
}
const model::Tree* model() {
  return appliance->options.settings.model();
}
bool watch(OutputWatchdog& watchdog) {
  return appliance->watch(watchdog);
}
void started() {
  appliance->started();
}
void tell(const App& app) {
  appliance->tell(app);
}
bool over() {
  return appliance->over();
}

}  // namespace holdfast::board
