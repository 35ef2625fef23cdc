// SPDX-License-Identifier: Apache-2.0
// latency_bench: from a frame that arrives to the edge of ALIVE that confirms it, inside the process; then from that
// edge back to the camera, which is the longest that the next frame may have to wait. Microseconds of wall and of
// thread CPU time, with a silent link, with random bytes and with commands on it, as many as the firmware asks for.
//
// The camera hands out pictures at once; the firmware's clock is virtual and shows 25 frames a second, so that it finds
// its world in order. The three links take turns, in blocks of frames: what the machine does meanwhile meets all.
// CPU time is read by a system call at each end (0.2 us each), which the wall times do not contain.
//
// latency_bench [LUMA_FRAMES [JPEG_FRAMES]]. Exit status: 0; 1 when the firmware was not in order; 2 wrong arguments.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <memory>
#include <random>
#include <string_view>
#include <vector>

#include "app/daemon.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/film.hpp"
#include "drivers/sim/serial.hpp"
#include "link/command_frame.hpp"
#include "toolchain/play/rig.hpp"

namespace {

using namespace holdfast;

constexpr Micros kPeriod{40'000};
constexpr int kBlock = 100;  // frames between two changes of the link
constexpr std::size_t kWarm = 200;

enum class Flood { kSilent, kRandom, kCommands };
constexpr std::array<std::string_view, 3> kFloods{"silent", "random", "commands"};

struct Moment {
  double wall_us = 0.0, cpu_us = 0.0;
};

double read_us(clockid_t clock) {
  timespec now{};
  clock_gettime(clock, &now);
  return static_cast<double>(now.tv_sec) * 1e6 + static_cast<double>(now.tv_nsec) * 1e-3;
}

// The wall's clock is the inner one: nothing of the reading is between the two.
Moment begin() {
  Moment at;
  at.cpu_us = read_us(CLOCK_THREAD_CPUTIME_ID);
  at.wall_us = read_us(CLOCK_MONOTONIC);
  return at;
}
Moment end() {
  Moment at;
  at.wall_us = read_us(CLOCK_MONOTONIC);
  at.cpu_us = read_us(CLOCK_THREAD_CPUTIME_ID);
  return at;
}

// Of one link: each a list of microseconds.
struct Times {
  std::vector<double> to_edge, to_edge_cpu;  // the camera hands a frame out -> ALIVE moves
  std::vector<double> beside, beside_cpu;    // ALIVE has moved -> the camera is looked at again
};

struct Probe {
  Times* times = nullptr;  // null: warming up
  Moment handed, edge;
  bool decided = false;
};

class Camera final : public hal::Camera {
 public:
  Camera(const sim::Film& film, sim::Clock& clock, Probe& probe) : film_(film), clock_(clock), probe_(probe) {}
  void touch() { held_ = true; }

 private:
  [[nodiscard]] bool do_start() override { return true; }
  [[nodiscard]] hal::Capture do_next(hal::Frame& frame, Micros) override {
    if (std::exchange(probe_.decided, false) && probe_.times != nullptr) {
      const Moment back = end();
      probe_.times->beside.push_back(back.wall_us - probe_.edge.wall_us);
      probe_.times->beside_cpu.push_back(back.cpu_us - probe_.edge.cpu_us);
    }
    clock_.advance(kPeriod);
    frame = film_.frame(held_, next_, room_);
    frame.timestamp = clock_.now() - kPeriod;
    frame.sequence = static_cast<std::uint32_t>(next_++);
    probe_.handed = begin();
    return hal::Capture::kFrame;
  }
  void do_release(const hal::Frame&) override {}
  void do_stop() override {}
  [[nodiscard]] std::string_view do_identity() const override { return "bench"; }
  // The few JPEG pictures there are come again and again.
  [[nodiscard]] bool do_live() const override { return film_.format == hal::PixelFormat::kLuma8; }

  const sim::Film& film_;
  sim::Clock& clock_;
  Probe& probe_;
  bool held_ = false;
  std::size_t next_ = 0;
  sim::Film::Picture room_;
};

class Lines final : public hal::Gpio {
 public:
  explicit Lines(Probe& probe) : probe_(probe) {}
  [[nodiscard]] bool fine() const { return fine_; }

 private:
  [[nodiscard]] bool do_set(hal::Line line, hal::Level level) override {
    if (line == hal::Line::kGripOk) fine_ = level == hal::Level::kHigh;
    if (line != hal::Line::kAlive) return true;
    const Moment at = end();
    if (probe_.times != nullptr) {
      probe_.times->to_edge.push_back(at.wall_us - probe_.handed.wall_us);
      probe_.times->to_edge_cpu.push_back(at.cpu_us - probe_.handed.cpu_us);
    }
    probe_.decided = true;
    probe_.edge = begin();
    return true;
  }
  [[nodiscard]] std::optional<hal::Level> do_read(hal::Input) override { return std::nullopt; }

  Probe& probe_;
  bool fine_ = false;
};

// Gives as many bytes as are asked for, and takes all that is written.
class Link final : public hal::Serial {
 public:
  Link() {
    std::mt19937 random(1);
    for (std::uint8_t& byte : noise_) byte = static_cast<std::uint8_t>(random());
    for (std::uint16_t k = 0; k < kCommands; ++k) {  // OPENING ends: nothing changes, and each is answered
      std::array<std::uint8_t, command_frame::kCommandBytes> wire{};
      (void)command_frame::encode({k, command_frame::Command::kOpening, 0}, wire);
      commands_.insert(commands_.end(), wire.begin(), wire.end());
    }
  }
  void flood(Flood flood) { flood_ = flood; }
  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }

 private:
  static constexpr std::uint16_t kCommands = 1000;

  [[nodiscard]] bool do_write(std::span<const std::uint8_t>) override { return true; }
  [[nodiscard]] std::size_t do_read(std::span<std::uint8_t> bytes) override {
    if (flood_ == Flood::kSilent) return 0;
    const std::vector<std::uint8_t>& from = flood_ == Flood::kRandom ? noise_ : commands_;
    for (std::uint8_t& byte : bytes) byte = from[at_++ % from.size()];
    bytes_ += bytes.size();
    return bytes.size();
  }

  std::vector<std::uint8_t> noise_ = std::vector<std::uint8_t>(65'521);  // a prime: no block begins as another did
  std::vector<std::uint8_t> commands_;
  std::size_t at_ = 0;
  Flood flood_ = Flood::kSilent;
  std::uint64_t bytes_ = 0;
};

struct Percentiles {
  double p50, p99, p99_9, most;
};

Percentiles percentiles(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const auto at = [&](double share) {
    return values[std::min(values.size() - 1, static_cast<std::size_t>(share * static_cast<double>(values.size())))];
  };
  return {at(0.5), at(0.99), at(0.999), values.back()};
}

// Whether all was in order.
bool bench(std::string_view name, hal::PixelFormat format, std::size_t pictures, std::size_t frames) {
  const sim::Film film = sim::shoot(format, pictures);
  sim::Clock clock;
  Probe probe;
  Camera camera(film, clock, probe);
  Lines lines(probe);
  Link link;
  sim::Serial gripper;
  hal::NoKeep keep;
  const Params params;
  tool::OneThreadDecoder jpeg(params);
  const auto daemon =
      std::make_unique<Daemon>(Devices{camera, lines, link, clock, jpeg.get()}, Periphery{gripper, keep});
  if (!daemon->start(params).ok()) return false;
  for (std::size_t k = 0; k < kWarm; ++k) {
    if (k == kWarm / 2) camera.touch();
    daemon->poll();
  }
  if (!lines.fine()) {
    const supervisor::Outputs& outputs = daemon->app().outputs();
    fmt::print(stderr,
               "latency_bench: {} {} instead of OK. Likely cause: a change of the firmware. Next: "
               "run the tests\n",
               info(outputs.state).name, info(outputs.reason).name);
    return false;
  }
  std::array<Times, kFloods.size()> times;
  for (std::size_t done = 0; done < frames * kFloods.size();) {
    const std::size_t which = done / kBlock % kFloods.size();
    probe.decided = false;
    probe.times = &times[which];
    link.flood(static_cast<Flood>(which));
    for (int k = 0; k < kBlock; ++k, ++done) daemon->poll();
  }
  fmt::print("{}: {} frames with each link, {} bytes of flood\n", name, frames, link.bytes());
  fmt::print("  {:<10}{:<24}{:>10}{:>10}{:>10}{:>10}   {:>10}\n", "link", "us", "p50", "p99", "p99.9", "max",
             "p99.9 / silent");
  const auto row = [&](std::string_view what, std::vector<double> Times::*member) {
    const double silent = percentiles(times[0].*member).p99_9;
    for (std::size_t k = 0; k < times.size(); ++k) {
      const Percentiles p = percentiles(times[k].*member);
      fmt::print("  {:<10}{:<24}{:>10.1f}{:>10.1f}{:>10.1f}{:>10.1f}   {:>10.3f}\n", kFloods[k], what, p.p50, p.p99,
                 p.p99_9, p.most, p.p99_9 / silent);
    }
  };
  row("frame to edge, wall", &Times::to_edge);
  row("frame to edge, CPU", &Times::to_edge_cpu);
  row("edge to camera, wall", &Times::beside);
  row("edge to camera, CPU", &Times::beside_cpu);
  return lines.fine();
}

bool number(const char* text, std::size_t& value) {
  const char* const end = text + std::strlen(text);
  const auto [at, error] = std::from_chars(text, end, value);
  return error == std::errc{} && at == end && value > 0;
}

}  // namespace

int main(int argc, char** argv) {
  std::size_t luma = 20'000, jpeg = 300;
  if (argc > 3 || (argc > 1 && !number(argv[1], luma)) || (argc > 2 && !number(argv[2], jpeg))) {
    fmt::print(stderr, "latency_bench: wrong arguments. Next: latency_bench [LUMA_FRAMES [JPEG_FRAMES]]\n");
    return 2;
  }
  const bool in_order = bench("luma 410x308", hal::PixelFormat::kLuma8, 30, luma);
  return bench("JPEG 3280x2464", hal::PixelFormat::kMjpeg, 8, jpeg) && in_order ? 0 : 1;
}
