// SPDX-License-Identifier: Apache-2.0
// A device with somebody at its console: camera, lines, gripper and port simulated, time virtual.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "app/daemon.hpp"
#include "console/console.hpp"
#include "drivers/sim/camera_memory.hpp"
#include "drivers/sim/camera_switched.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/gpio.hpp"
#include "drivers/sim/hande.hpp"
#include "drivers/sim/keep.hpp"
#include "drivers/sim/serial.hpp"
#include "drivers/sim/store.hpp"
#include "drivers/sim/supply.hpp"
#include "store/models.hpp"
#include "store/settings.hpp"
#include "tests/support/frames.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/set_back.hpp"

namespace holdfast::test {

// Records what is asked of it.
class NotedFaults final : public hal::Faults {
 public:
  std::vector<std::size_t> begun;
  int ended = 0;

 private:
  static constexpr std::array<Row, 2> kRows{{{"camera", "off", "no frames"}, {"gripper", "mute", "no answers"}}};
  [[nodiscard]] std::span<const Row> do_rows() const override { return kRows; }
  void do_begin(std::size_t index) override { begun.push_back(index); }
  void do_end_all() override { ++ended; }
};

// Tells what a test says.
class ToldNotes final : public hal::Notes {
 public:
  std::array<std::string, kNames.size()> told{};

 private:
  [[nodiscard]] std::string_view do_read(Of of, std::span<char, kMostBytes> room) override {
    const std::string& text = told[static_cast<std::size_t>(of)];
    const std::size_t size = std::min(text.size(), room.size());
    std::copy_n(text.begin(), size, room.begin());
    return {room.data(), size};
  }
};

class ConsoleDesk {
 public:
  static constexpr std::string_view kCode = "7QX-41-red";

  sim::Clock clock;
  SetBack seen_clock{clock};  // the console's
  sim::Gpio gpio{clock};
  sim::Serial link, host{1 << 20};
  sim::Keep keep{checkpoint::kBytes};
  sim::Store stored{settings::kMostBytes};
  sim::Store stored_models{models::kMostBytes};
  sim::HandE hand{clock};
  sim::Supply supply;
  NotedFaults faults;
  ToldNotes notes;
  Params params;
  std::string_view identity = "28D1-D7C6";  // of the sensor
  const model::Tree* tree = nullptr;        // in place of the compiled one, and of what is stored
  console::Place place{
      .board = "desk", .code = kCode, .settings = &stored, .models = &stored_models, .faults = &faults};

  void film(int still = 8, int dragged = 0) { pictures_ = drag_film(still, dragged); }

  void start() {
    if (pictures_.empty()) film();
    memory_ = std::make_unique<sim::CameraMemory>(
        clock, luma_views(pictures_),
        sim::CameraMemory::Config{.cycles = 1'000'000, .live = true, .identity = identity});
    camera = std::make_unique<sim::SwitchedCamera>(*memory_, std::size_t{320 * 240});
    daemon = std::make_unique<Daemon>(Devices{*camera, gpio, link, clock, jpeg_}, Periphery{hand, keep, &supply},
                                      tree != nullptr ? tree : stored_tree());
    console = std::make_unique<console::Console>(host, *daemon, seen_clock, place);
    Params in_force = params;
    (void)settings::take({sealed::Kind::kSettings, settings::good, place.settings, place.owner}, in_force);
    started = daemon->start(in_force).ok();
    console->start(in_force);
  }
  void end() {
    console.reset();
    daemon.reset();
    camera.reset();
    memory_.reset();
    pictures_ = {};
  }

  void run(Micros time) {
    for (const Micros until = clock.now() + time; clock.now() < until;) turn();
  }
  void turn() {
    daemon->poll();
    console->poll();
  }

  void type(std::string_view text) {
    typed = host.feed({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  }
  // Everything that came since the last call.
  [[nodiscard]] std::string heard() {
    const std::vector<std::uint8_t> bytes = host.output_bytes();
    host.clear_output();
    return {bytes.begin(), bytes.end()};
  }
  // The answer to a line, up to its OK or ERR, which is included; without echo. Empty: none within a second.
  [[nodiscard]] std::string say(std::string_view line) {
    host.clear_output();
    std::string typed_line(line);
    type(typed_line += '\r');
    std::string all;
    for (const Micros until = clock.now() + Micros{1'000'000}; clock.now() < until;) {
      turn();
      all += heard();
      std::size_t begin = 0;
      for (std::size_t end = all.find('\n'); end != std::string::npos; end = all.find('\n', begin)) {
        const std::string_view one = std::string_view(all).substr(begin, end - begin);
        begin = end + 1;
        if (one.starts_with("OK\r") || one.starts_with("ERR ")) return all.substr(0, begin);
      }
    }
    return {};
  }
  [[nodiscard]] std::string unlock() { return say("unlock " + std::string(kCode)); }

  std::unique_ptr<sim::SwitchedCamera> camera;
  std::unique_ptr<Daemon> daemon;
  std::unique_ptr<console::Console> console;
  bool started = false;
  bool typed = false;

 private:
  // As a board does it.
  [[nodiscard]] const model::Tree* stored_tree() {
    return models::in_force({sealed::Kind::kModel, models::good, place.models, place.owner}, tree_);
  }

  NoJpeg jpeg_;
  model::Tree tree_;
  std::vector<reference_model::Picture> pictures_;
  std::unique_ptr<sim::CameraMemory> memory_;
};

}  // namespace holdfast::test
