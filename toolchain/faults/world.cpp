// SPDX-License-Identifier: Apache-2.0
#include "toolchain/faults/world.hpp"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "app/daemon.hpp"
#include "console/console.hpp"
#include "drivers/common/gpio_wiring.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/film.hpp"
#include "drivers/sim/hande.hpp"
#include "drivers/sim/keep.hpp"
#include "drivers/sim/scene/math/random.hpp"
#include "drivers/sim/scene/picture/jpeg_encode.hpp"
#include "drivers/sim/serial.hpp"
#include "link/command_frame.hpp"
#include "store/models.hpp"
#include "store/settings.hpp"
#include "toolchain/play/rig.hpp"
#include "toolchain/treec/tree_model.hpp"

namespace holdfast::faults {
namespace {

using namespace std::chrono_literals;
using hal::Level;
using hal::Line;

constexpr Micros kTouch = 1200ms;  // the object is there from then on
constexpr Micros kGripAt = 300ms;  // GRIP is commanded, long before: the Hand-E takes 1.5 s to be activated
constexpr Micros kLatency = 40ms;

// clang-format off
constexpr std::array<TroubleInfo, kTroubles> kInfos{{
    {Trouble::kCameraOff, Component::kCamera, "camera_off", true},
    {Trouble::kCameraGone, Component::kCamera, "camera_gone", true},
    {Trouble::kCameraRefused, Component::kCamera, "camera_refused", true},
    {Trouble::kCameraHangs, Component::kCamera, "camera_hangs", true},
    {Trouble::kCameraStuck, Component::kCamera, "camera_stuck", true},
    {Trouble::kCameraRing2, Component::kCamera, "camera_ring_2", true},
    {Trouble::kCameraRing3, Component::kCamera, "camera_ring_3", true},
    {Trouble::kCameraRing32, Component::kCamera, "camera_ring_32", true},
    {Trouble::kCameraComment, Component::kCamera, "camera_comment", true},
    {Trouble::kCameraGarbage, Component::kCamera, "camera_garbage", true},
    {Trouble::kCameraBad, Component::kCamera, "camera_bad", true},
    {Trouble::kCameraTorn, Component::kCamera, "camera_torn", false},
    {Trouble::kCameraTruncated, Component::kCamera, "camera_truncated", true},
    {Trouble::kCameraOther, Component::kCamera, "camera_other", true},
    {Trouble::kCameraNoGel, Component::kCamera, "camera_no_gel", true},
    {Trouble::kCameraSlow, Component::kCamera, "camera_slow", true, kLatency},
    {Trouble::kCameraHalfRate, Component::kCamera, "camera_half_rate", false},
    {Trouble::kCameraLate, Component::kCamera, "camera_late", false},
    {Trouble::kCameraStale, Component::kCamera, "camera_stale", true},
    {Trouble::kCameraComesAndGoes, Component::kCamera, "camera_comes_and_goes", false},
    {Trouble::kCameraTwoOfThree, Component::kCamera, "camera_two_of_three", false},
    {Trouble::kStampsBack, Component::kCamera, "stamps_back", true},
    {Trouble::kStampsAhead, Component::kCamera, "stamps_ahead", true},
    {Trouble::kStampsEqual, Component::kCamera, "stamps_equal", true, kLatency},
    {Trouble::kDark, Component::kCamera, "dark", true},
    {Trouble::kBright, Component::kCamera, "bright", true},
    {Trouble::kFewMarkers, Component::kCamera, "few_markers", false},
    {Trouble::kLostMarkers, Component::kCamera, "lost_markers", true},
    {Trouble::kClockStuck, Component::kClock, "clock_stuck", true, kLatency + App::kClockSlack},
    {Trouble::kClockAhead, Component::kClock, "clock_ahead", true},
    {Trouble::kClockBack, Component::kClock, "clock_back", true},
    {Trouble::kClockSlow, Component::kClock, "clock_slow", true, Micros{90'000}},
    {Trouble::kClockJumps, Component::kClock, "clock_jumps", false},
    {Trouble::kLinesRefuse, Component::kGpio, "lines_refuse", true},
    {Trouble::kLinesStuck, Component::kGpio, "lines_stuck", true},
    {Trouble::kLinesRandom, Component::kGpio, "lines_random", true},
    {Trouble::kLinesSlow, Component::kGpio, "lines_slow", false},
    {Trouble::kLinesDelayed, Component::kGpio, "lines_delayed", true, Micros{50'000}},
    {Trouble::kLinesNowAndThen, Component::kGpio, "lines_now_and_then", true},
    {Trouble::kLinkOff, Component::kSerial, "link_off", false},
    {Trouble::kLinkFull, Component::kSerial, "link_full", false},
    {Trouble::kLinkFlood, Component::kSerial, "link_flood", false},
    {Trouble::kLinkText, Component::kSerial, "link_text", false},
    {Trouble::kLinkSlow, Component::kSerial, "link_slow", false},
    {Trouble::kLinkNowAndThen, Component::kSerial, "link_now_and_then", false},
    {Trouble::kGripperPortOff, Component::kGripper, "gripper_port_off", true},
    {Trouble::kGripperSilent, Component::kGripper, "gripper_silent", true},
    {Trouble::kGripperDeaf, Component::kGripper, "gripper_deaf", true},
    {Trouble::kGripperGarbage, Component::kGripper, "gripper_garbage", true},
    {Trouble::kGripperWrongCrc, Component::kGripper, "gripper_wrong_crc", true},
    {Trouble::kGripperWrongSlave, Component::kGripper, "gripper_wrong_slave", true},
    {Trouble::kGripperLate, Component::kGripper, "gripper_late", true},
    {Trouble::kGripperSlow, Component::kGripper, "gripper_slow", false},
    {Trouble::kGripperNowAndThen, Component::kGripper, "gripper_now_and_then", false},
    {Trouble::kGripperMajorFault, Component::kGripper, "gripper_overcurrent", true},
    {Trouble::kGripperHot, Component::kGripper, "gripper_hot", false},
    {Trouble::kGripperUndervoltage, Component::kGripper, "gripper_undervoltage", true},
    {Trouble::kObjectLost, Component::kGripper, "object_lost", true},
    {Trouble::kKeepOff, Component::kStorage, "keep_off", false},
    {Trouble::kKeepStuck, Component::kStorage, "keep_stuck", false},
    {Trouble::kKeepGarbage, Component::kStorage, "keep_garbage", false},
    {Trouble::kKeepWrong, Component::kStorage, "keep_wrong", false},
    {Trouble::kKeepTorn, Component::kStorage, "keep_torn", false},
    {Trouble::kKilled, Component::kProcess, "killed", true},
    {Trouble::kStopped, Component::kProcess, "stopped", true},
    {Trouble::kDiskFull, Component::kStorage, "disk_full", false},
    {Trouble::kCardTorn, Component::kStorage, "card_torn", true},
    {Trouble::kModelDamaged, Component::kModel, "model_damaged", false},
    {Trouble::kRecordsDamaged, Component::kStorage, "records_damaged", true},
    {Trouble::kSupplyLow, Component::kBoard, "supply_low", true, Micros{1'000'000}},
    {Trouble::kChipsRenumbered, Component::kGpio, "chips_renumbered", false},
    {Trouble::kUsbDead, Component::kBoard, "usb_dead", true},
}};
// clang-format on

// One gel, as luma and as JPEG of the same size. No JPEG is shown twice in a run of two faults.
struct Films {
  sim::Film luma, jpeg;
};
constexpr std::size_t kJpegs = 370;

const Films& films() {
  static const Films films = [] {
    Films made;
    made.luma = sim::shoot(hal::PixelFormat::kLuma8, 100);
    const auto encode = [&](bool is_held) {
      std::vector<sim::Film::Picture> to;
      sim::Film::Picture room;
      for (std::size_t k = 0; k < kJpegs; ++k) {
        const hal::Frame frame = made.luma.frame(is_held, k, room);
        to.push_back(scene::encode_jpeg(frame.bytes, frame.width, frame.height, scene::JpegInput::kGrey, 90));
      }
      return to;
    };
    made.jpeg = {.format = hal::PixelFormat::kMjpeg,
                 .width = made.luma.width,
                 .height = made.luma.height,
                 .empty = encode(false),
                 .held = encode(true),
                 .markers = {}};
    return made;
  }();
  return films;
}

long resident_kb() {
  long pages = 0, resident = 0;
  std::FILE* const file = std::fopen("/proc/self/statm", "r");
  if (file == nullptr) return 0;
  if (std::fscanf(file, "%ld %ld", &pages, &resident) != 2) resident = 0;
  (void)std::fclose(file);
  return resident * (::sysconf(_SC_PAGESIZE) / 1024);
}

int open_files() {
  int count = 0;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd", error)) {
    (void)entry;
    ++count;
  }
  return count;
}

}  // namespace

const TroubleInfo& info(Trouble trouble) {
  return kInfos[static_cast<std::size_t>(trouble)];
}

// What all devices share: the true time, and which windows are open.
class Situation {
 public:
  explicit Situation(const Setup& setup) : setup_(setup) {}

  sim::Clock clock;
  std::function<void()> watch;  // the second thread's turn

  [[nodiscard]] const Window* open(Trouble trouble, Micros at, int finger = Window::kEveryFinger) const {
    for (std::size_t k = past(); k < setup_.windows.size() && setup_.windows[k].from <= at; ++k) {
      const Window& window = setup_.windows[k];
      if (window.trouble == trouble && at < window.to && meets(window, finger)) return &window;
    }
    return nullptr;
  }
  [[nodiscard]] bool is(Trouble trouble) const { return open(trouble, clock.now()) != nullptr; }
  [[nodiscard]] bool was(Trouble trouble, Micros at) const { return open(trouble, at) != nullptr; }

  // The next moment at which a window of this kind begins; far away without one.
  [[nodiscard]] Micros next(Trouble trouble, int finger = Window::kEveryFinger) const {
    for (std::size_t k = past(); k < setup_.windows.size(); ++k) {
      const Window& window = setup_.windows[k];
      if (window.trouble == trouble && window.from > clock.now() && meets(window, finger)) return window.from;
    }
    return Micros::max();
  }

  // Time passes for the first thread; the second one runs beside it.
  void pass_until(Micros time) {
    while (clock.now() < time) {
      if (const Window* w = open(Trouble::kStopped, clock.now())) {  // in the middle of whatever it was doing
        stand_until(w->to);
        continue;
      }
      const Micros tick = (clock.now() / 10ms + 1) * 10ms;
      clock.advance_to(std::min({time, tick, next(Trouble::kStopped)}));
      if (clock.now() == tick && watch && !is(Trouble::kStopped)) watch();
    }
  }
  // Time passes, and nobody runs.
  void stand_until(Micros time) { clock.advance_to(time); }

 private:
  [[nodiscard]] static bool meets(const Window& window, int finger) {
    return finger == Window::kEveryFinger || window.finger == Window::kEveryFinger || window.finger == finger;
  }
  // A run of a day has thousands of windows; those that ended more than a second ago, before any frame that is still
  // under way, are asked about no more.
  [[nodiscard]] std::size_t past() const {
    while (past_ < setup_.windows.size() && setup_.windows[past_].to + Micros{1'000'000} < clock.now()) ++past_;
    return past_;
  }

  const Setup& setup_;
  mutable std::size_t past_ = 0;
};

namespace {

class WorldClock final : public hal::Clock {
 public:
  explicit WorldClock(Situation& situation) : situation_(situation) {}

 private:
  [[nodiscard]] Micros do_now() const override {
    const Micros now = situation_.clock.now();
    if (const Window* w = situation_.open(Trouble::kClockStuck, now)) return w->from;
    if (situation_.was(Trouble::kClockAhead, now)) return now + 10s;
    if (situation_.was(Trouble::kClockBack, now)) return now - 10s;
    if (const Window* w = situation_.open(Trouble::kClockSlow, now)) return w->from + (now - w->from) / 2;
    if (situation_.was(Trouble::kClockJumps, now) && (now / 100ms) % 2 == 1) return now + 1s;
    return now;
  }
  void do_wait(Micros time) override { situation_.pass_until(situation_.clock.now() + time); }

  Situation& situation_;
};

// A fault of the camera takes the frames that would arrive while it lasts: what is under way is hit as well.
class WorldCamera final : public hal::Camera {
 public:
  WorldCamera(Situation& situation, const Setup& setup, int finger)
      : situation_(situation),
        setup_(setup),
        finger_(finger),
        random_(setup.seed + static_cast<std::uint64_t>(finger)) {}

 private:
  static constexpr Micros kPhase = 17ms;  // of the right finger's

  [[nodiscard]] const Window* open(Trouble trouble, Micros at) const { return situation_.open(trouble, at, finger_); }
  [[nodiscard]] bool was(Trouble trouble, Micros at) const { return open(trouble, at) != nullptr; }
  [[nodiscard]] bool is(Trouble trouble) const { return was(trouble, situation_.clock.now()); }
  [[nodiscard]] Micros next_of(Trouble trouble) const { return situation_.next(trouble, finger_); }
  [[nodiscard]] Micros phase() const { return finger_ * kPhase; }

  [[nodiscard]] bool do_start() override {
    const Micros now = situation_.clock.now();
    if (is_absent()) return false;
    identity_ = is(Trouble::kCameraOther) ? "ABCD-1234" : finger_ == 0 ? "28D1-D7C6" : "28D3-K2R9";
    next_ = (now - phase() + setup_.period - 1us) / setup_.period;
    return true;
  }
  [[nodiscard]] std::string_view do_identity() const override { return identity_; }
  [[nodiscard]] bool do_live() const override { return true; }
  void do_release(const hal::Frame&) override {}
  void do_stop() override {}

  [[nodiscard]] hal::Capture do_next(hal::Frame& frame, Micros timeout) override {
    const Micros deadline = situation_.clock.now() + timeout;
    while (true) {
      if (is_unplugged()) return hal::Capture::kGone;
      if (const Window* w = open(Trouble::kCameraHangs, situation_.clock.now())) {
        situation_.pass_until(w->to);
        return hal::Capture::kTimeout;
      }
      const Micros exposure = next_ * setup_.period + phase();
      const Micros arrival = exposure + kLatency;
      if (is_missing(arrival)) {
        ++next_;
        if (!dropped_) ++never_sent_;
        continue;
      }
      const Micros due = arrival + lateness(arrival);
      const Micros unplugged =
          std::min({next_of(Trouble::kCameraGone), next_of(Trouble::kCameraRefused), next_of(Trouble::kUsbDead),
                    next_of(Trouble::kCameraOther), next_of(Trouble::kCameraHangs)});
      if (unplugged < std::min(due, deadline)) {
        situation_.pass_until(unplugged);
        continue;
      }
      if (due > deadline) {
        situation_.pass_until(deadline);
        return hal::Capture::kTimeout;
      }
      situation_.pass_until(due);
      return hand_out(frame, exposure);
    }
  }

  // Another sensor in its place is a replug: this stream ends when the window opens, and when it closes.
  [[nodiscard]] bool is_unplugged() const {
    const bool other = is(Trouble::kCameraOther);
    return is_absent() || other != (identity_ == "ABCD-1234");
  }
  [[nodiscard]] bool is_absent() const {
    return is(Trouble::kCameraGone) || is(Trouble::kCameraRefused) || is(Trouble::kUsbDead);
  }

  [[nodiscard]] bool is_missing(Micros arrival) {
    dropped_ = setup_.drop_every > 0 && next_ % setup_.drop_every == setup_.drop_every - 1;
    if (dropped_ || was(Trouble::kCameraOff, arrival)) return true;
    const auto since = [&](Trouble trouble) {
      const Window* const w = open(trouble, arrival);
      return w == nullptr ? Micros{-1} : arrival - w->from;
    };
    if (since(Trouble::kCameraSlow) % 200ms >= setup_.period) return true;
    if (since(Trouble::kCameraHalfRate) % 120ms >= setup_.period) return true;
    return since(Trouble::kCameraComesAndGoes) % 500ms >= 200ms;
  }

  [[nodiscard]] Micros lateness(Micros arrival) const {
    if (was(Trouble::kCameraStale, arrival)) return 200ms;
    return was(Trouble::kCameraLate, arrival) ? Micros{60ms} : Micros{0};
  }

  [[nodiscard]] hal::Capture hand_out(hal::Frame& frame, Micros exposure) {
    const Micros arrival = exposure + kLatency;
    const auto index = static_cast<std::size_t>(next_++);
    const auto sequence = static_cast<std::uint32_t>(index - never_sent_);
    if (was(Trouble::kCameraBad, arrival)) return hal::Capture::kBad;
    if (was(Trouble::kCameraTwoOfThree, arrival) && index % 3 != 0) return hal::Capture::kBad;
    const bool fell = setup_.falls_at != Micros{} && exposure >= setup_.falls_at;
    const bool held = setup_.held && exposure >= kTouch && !fell;
    const sim::Film& film = setup_.jpeg ? films().jpeg : films().luma;
    const auto& pictures = held ? film.held : film.empty;
    frame = film.frame(held, in_ring(index, arrival), room_);
    if (was(Trouble::kCameraStuck, arrival) && !shown_.empty()) {
      frame.bytes = shown_;
    } else if (was(Trouble::kCameraComment, arrival) && !shown_.empty()) {
      frame.bytes = comment(index);
    } else {
      frame.bytes = spoil(frame.bytes, pictures[(index + 1) % pictures.size()], arrival);
      shown_.assign(frame.bytes.begin(), frame.bytes.end());
    }
    frame.sequence = sequence;
    frame.timestamp = exposure;
    if (was(Trouble::kStampsBack, arrival)) frame.timestamp -= 5s;
    if (was(Trouble::kStampsAhead, arrival)) frame.timestamp += 10s;
    if (const Window* w = open(Trouble::kStampsEqual, arrival)) frame.timestamp = w->from;
    return hal::Capture::kFrame;
  }

  // Which picture is shown: `index`, or one of the last that were shown before the ring began.
  [[nodiscard]] std::size_t in_ring(std::size_t index, Micros arrival) {
    for (const auto& [trouble, size] : {std::pair{Trouble::kCameraRing2, std::size_t{2}},
                                        {Trouble::kCameraRing3, std::size_t{3}},
                                        {Trouble::kCameraRing32, std::size_t{32}}}) {
      const Window* const w = open(trouble, arrival);
      if (w == nullptr) continue;
      if (std::exchange(ring_, w) != w) ring_from_ = index;
      return ring_from_ - size + (index - ring_from_) % size;
    }
    return index;
  }

  // What was shown last, with a comment of its own behind SOI.
  [[nodiscard]] std::span<const std::uint8_t> comment(std::size_t index) {
    const std::array<std::uint8_t, 8> segment{0xff,
                                              0xfe,
                                              0,
                                              6,
                                              static_cast<std::uint8_t>(index >> 24),
                                              static_cast<std::uint8_t>(index >> 16),
                                              static_cast<std::uint8_t>(index >> 8),
                                              static_cast<std::uint8_t>(index)};
    made_.assign(shown_.begin(), shown_.end());
    made_.insert(made_.begin() + std::min<std::ptrdiff_t>(2, std::ssize(made_)), segment.begin(), segment.end());
    return made_;
  }

  // Every fault of the picture that is in force, one after the other: two may be.
  [[nodiscard]] std::span<const std::uint8_t> spoil(std::span<const std::uint8_t> bytes,
                                                    const std::vector<std::uint8_t>& other, Micros arrival) {
    made_.assign(bytes.begin(), bytes.end());
    bool changed = false;
    const auto when = [&](Trouble trouble, auto&& change) {
      if (!was(trouble, arrival)) return;
      change();
      changed = true;
    };
    const auto level = [&](std::uint8_t value) {
      for (std::uint8_t& byte : made_) byte = static_cast<std::uint8_t>(value + (random_.next() >> 62));
    };
    const auto hide = [&](std::size_t some, std::size_t of) {  // so many of so many, under dirt of the gel's level
      const sim::Film& film = films().luma;
      for (std::size_t k = 0; k < film.markers.size(); ++k) {
        if (k % of >= some) continue;
        const scene::PointPx& at = film.markers[k];
        for (int y = -16; y <= 16; ++y) {
          for (int x = -16; x <= 16; ++x) {
            const int row = std::clamp(static_cast<int>(at.y) + y, 0, film.height - 1);
            const int col = std::clamp(static_cast<int>(at.x) + x, 0, film.width - 1);
            made_[static_cast<std::size_t>(row) * static_cast<std::size_t>(film.width) +
                  static_cast<std::size_t>(col)] = 120;
          }
        }
      }
    };
    when(Trouble::kCameraGarbage, [&] {
      for (std::uint8_t& byte : made_) byte = static_cast<std::uint8_t>(random_.next() >> 56);
    });
    when(Trouble::kCameraTorn, [&] {
      const std::size_t half = std::min(made_.size(), other.size()) / 2;
      std::copy(other.begin() + static_cast<std::ptrdiff_t>(half),
                other.begin() + static_cast<std::ptrdiff_t>(std::min(made_.size(), other.size())),
                made_.begin() + static_cast<std::ptrdiff_t>(half));
    });
    when(Trouble::kCameraTruncated, [&] { made_.resize(made_.size() / 2); });
    when(Trouble::kCameraNoGel, [&] { level(120); });
    when(Trouble::kDark, [&] { level(2); });
    when(Trouble::kBright, [&] { level(252); });
    if (!setup_.jpeg) {
      when(Trouble::kFewMarkers, [&] { hide(1, 5); });
      when(Trouble::kLostMarkers, [&] { hide(3, 7); });
    } else if (was(Trouble::kLostMarkers, arrival)) {
      made_.resize(made_.size() / 2);
      changed = true;
    }
    return changed ? std::span<const std::uint8_t>(made_) : bytes;
  }

  Situation& situation_;
  const Setup& setup_;
  int finger_;
  scene::Random random_;
  std::string_view identity_;
  std::int64_t next_ = 0;
  std::size_t never_sent_ = 0;
  bool dropped_ = false;
  const Window* ring_ = nullptr;
  std::size_t ring_from_ = 0;  // the frame with which it began
  std::vector<std::uint8_t> shown_, made_, room_;
};

// Lines whose levels outlive the process, on the tape.
class WorldGpio final : public hal::Gpio {
 public:
  WorldGpio(Situation& situation, sim::Tape& tape, std::uint64_t seed)
      : situation_(situation), tape_(tape), random_(seed) {}

  // What a process that starts finds: the board's header beside an expander, in either order. False: not its lines.
  [[nodiscard]] bool open() {
    using drivers::ChipInfo;
    using drivers::LineInfo;
    const auto named = [](std::string_view name) { return LineInfo{name, false, {}}; };
    const std::array<LineInfo, 6> header{named("GPIO4"), named("GPIO17"), named("GPIO22"),
                                         named(""),      named("GPIO23"), named("GPIO27")};
    const std::array<LineInfo, 4> expander{named("BT_ON"), named("WL_ON"), named(""), named("PWR_LED_OFF")};
    static constexpr std::array<drivers::Wiring, hal::kLineCount> kWiring{
        {{.role = Line::kGripOk, .line = "GPIO17", .chip = {}},
         {.role = Line::kAlive, .line = "GPIO27", .chip = {}},
         {.role = Line::kIncrease, .line = "GPIO22", .chip = {}},
         {.role = Line::kDecrease, .line = "GPIO23", .chip = {}}}};
    const bool other = situation_.is(Trouble::kChipsRenumbered);
    std::array<ChipInfo, 2> chips{{{other ? "gpiochip4" : "gpiochip0", "pinctrl-bcm2711", header},
                                   {other ? "gpiochip0" : "gpiochip1", "raspberrypi-exp-gpio", expander}}};
    if (other) std::swap(chips[0], chips[1]);
    std::array<drivers::Place, hal::kLineCount> places{};
    if (!drivers::find_all(chips, kWiring, places).empty()) return false;
    for (std::size_t k = 0; k < places.size(); ++k) {
      const LineInfo& found = chips[places[k].chip].lines[places[k].offset];
      const auto* const wire = std::find_if(kWiring.begin(), kWiring.end(),
                                            [&](const drivers::Wiring& row) { return row.line == found.name; });
      wired_[k] = wire == kWiring.end() ? std::nullopt : std::optional(std::get<Line>(wire->role));
    }
    return true;
  }

  void settle() {
    for (Pending& pending : pending_) {
      if (!pending.level || situation_.clock.now() < pending.at) continue;
      take(pending.line, *pending.level, pending.at);
      pending.level.reset();
    }
  }

 private:
  struct Pending {
    Line line{};
    std::optional<Level> level;
    Micros at{};
  };

  void take(Line line, Level level, Micros at) {
    Level& now = levels_[static_cast<std::size_t>(line)];
    if (now == level) return;
    now = level;
    const std::optional<Line> wire = wired_[static_cast<std::size_t>(line)];
    if (!wire) return;  // a pin of somebody else's
    tape_.write({at.count(), sim::TapeKind::kLine, static_cast<std::uint8_t>(*wire),
                 static_cast<std::uint8_t>(level == Level::kHigh ? 1 : 0)});
  }

  [[nodiscard]] bool do_set(Line line, Level level) override {
    settle();
    const Micros now = situation_.clock.now();
    const Level& is = levels_[static_cast<std::size_t>(line)];
    ++calls_;
    if (situation_.is(Trouble::kLinesRefuse)) return false;
    if (situation_.is(Trouble::kLinesNowAndThen) && calls_ % 3 == 0) return false;
    if (situation_.is(Trouble::kLinesStuck)) return is == level;
    if (situation_.is(Trouble::kLinesSlow)) situation_.pass_until(now + 30ms);
    if (situation_.is(Trouble::kLinesDelayed)) {
      Pending& pending = pending_[static_cast<std::size_t>(line)];
      if (pending.level != level) pending = {line, level, now + 50ms};
      return is == level;
    }
    // Somebody else drives the line as well, mostly against what was told. Until it does, the line is what it should
    // be.
    const Window* const shared = situation_.open(Trouble::kLinesRandom, now);
    const bool against = shared != nullptr && (random_.next() >> 61) != 0;
    if (against && std::exchange(fought_, shared) != shared) {
      constexpr auto kWhich = static_cast<std::uint8_t>(Trouble::kLinesRandom);
      tape_.write({now.count(), sim::TapeKind::kUnsafe, kWhich, 1});
      tape_.write({shared->to.count(), sim::TapeKind::kUnsafe, kWhich, 0});
    }
    take(line, against != (level == Level::kHigh) ? Level::kHigh : Level::kLow, situation_.clock.now());
    return is == level;
  }
  [[nodiscard]] std::optional<Level> do_read(hal::Input) override { return std::nullopt; }

  Situation& situation_;
  sim::Tape& tape_;
  scene::Random random_;
  std::array<Level, hal::kLineCount> levels_{};
  std::array<std::optional<Line>, hal::kLineCount> wired_{};  // what the process takes for each line
  std::array<Pending, hal::kLineCount> pending_{};
  std::uint64_t calls_ = 0;
  const Window* fought_ = nullptr;  // the window in which the line first did not obey
};

// The robot's end of the link: commands, and what may come in their place.
class WorldLink final : public hal::Serial {
 public:
  WorldLink(Situation& situation, std::uint64_t seed) : situation_(situation), random_(seed) {}

  void send(command_frame::Command command, std::uint8_t argument) {
    std::array<std::uint8_t, command_frame::kCommandBytes> wire{};
    (void)command_frame::encode(command_frame::CommandFrame{++sequence_, command, argument}, wire);
    waiting_.push_back(0);  // ends what a flood or a cut cable has left half
    waiting_.insert(waiting_.end(), wire.begin(), wire.end());
  }

 private:
  [[nodiscard]] bool is_off() const {
    return situation_.is(Trouble::kLinkOff) ||
           (situation_.is(Trouble::kLinkNowAndThen) && (situation_.clock.now() / 100ms) % 2 == 0);
  }
  [[nodiscard]] bool do_write(std::span<const std::uint8_t>) override {
    return !is_off() && !situation_.is(Trouble::kLinkFull);
  }
  [[nodiscard]] std::size_t do_read(std::span<std::uint8_t> bytes) override {
    if (is_off()) return 0;
    if (situation_.is(Trouble::kLinkFlood)) {
      for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random_.next() >> 56);
      return bytes.size();
    }
    if (situation_.is(Trouble::kLinkText)) {
      static constexpr std::string_view kText = "status\r\nset mode fast\r\n";
      for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<std::uint8_t>(kText[i % kText.size()]);
      return bytes.size();
    }
    std::size_t count = std::min(bytes.size(), waiting_.size());
    if (situation_.is(Trouble::kLinkSlow)) {
      if (waiting_.empty()) send(command_frame::Command::kArm, 0);
      const bool due = situation_.clock.now() >= next_byte_;
      if (due) next_byte_ = situation_.clock.now() + 50ms;
      count = due ? 1 : 0;
    }
    std::copy_n(waiting_.begin(), count, bytes.begin());
    waiting_.erase(waiting_.begin(), waiting_.begin() + static_cast<std::ptrdiff_t>(count));
    return count;
  }

  Situation& situation_;
  scene::Random random_;
  std::vector<std::uint8_t> waiting_;
  std::uint16_t sequence_ = 0;
  Micros next_byte_{};
};

class WorldKeep final : public hal::Keep {
 public:
  WorldKeep(Situation& situation, bool hand)
      : situation_(situation), bytes_(hand ? checkpoint::kHandBytes : checkpoint::kBytes), lost_(bytes_.size()) {}

  // What the process that starts now will find.
  void before_start(std::uint64_t seed) {
    scene::Random random(seed);
    checkpoint::Slot newest, other;
    std::memcpy(&newest, bytes_.data(), sizeof newest);
    std::memcpy(&other, bytes_.data() + sizeof newest, sizeof other);
    if (situation_.is(Trouble::kKeepGarbage)) {
      for (int k = 0; k < 64; ++k)
        bytes_[random.next() % bytes_.size()] ^= static_cast<std::uint8_t>(random.next() | 1U);
      for (const std::size_t slot : {std::size_t{0}, sizeof newest}) bytes_[slot + 100] ^= 0x10;
    }
    if (situation_.is(Trouble::kKeepWrong)) {
      for (checkpoint::Slot* slot : {&newest, &other}) {
        if (slot->magic != checkpoint::kMagic) continue;
        slot->contents.sensor = checkpoint::identity_of("ABCD-1234");
        slot->crc = checkpoint::detail::crc_of(*slot);
      }
      std::memcpy(bytes_.data(), &newest, sizeof newest);
      std::memcpy(bytes_.data() + sizeof newest, &other, sizeof other);
    }
    if (situation_.is(Trouble::kKeepTorn)) {
      const std::size_t at = newest.sequence > other.sequence ? 0 : sizeof newest;
      std::copy_n(bytes_.begin() + static_cast<std::ptrdiff_t>(sizeof newest - at) + 400, 4000,
                  bytes_.begin() + static_cast<std::ptrdiff_t>(at) + 400);
    }
  }

 private:
  [[nodiscard]] std::size_t do_size() const override { return situation_.is(Trouble::kKeepOff) ? 0 : bytes_.size(); }
  [[nodiscard]] bool do_read(std::size_t at, std::span<std::uint8_t> bytes) override {
    std::copy_n(memory().begin() + static_cast<std::ptrdiff_t>(at), bytes.size(), bytes.begin());
    return true;
  }
  [[nodiscard]] bool do_write(std::size_t at, std::span<const std::uint8_t> bytes) override {
    std::copy(bytes.begin(), bytes.end(), memory().begin() + static_cast<std::ptrdiff_t>(at));
    return true;
  }
  [[nodiscard]] std::vector<std::uint8_t>& memory() { return situation_.is(Trouble::kKeepStuck) ? lost_ : bytes_; }

  Situation& situation_;
  std::vector<std::uint8_t> bytes_, lost_;
};

// One file of the card: it outlives every process.
struct Card {
  explicit Card(std::size_t slot_bytes) { slots.fill(std::vector<std::uint8_t>(slot_bytes)); }

  void put(sealed::Kind kind, std::span<const std::uint8_t> payload) {
    for (std::vector<std::uint8_t>& slot : slots) (void)sealed::write(kind, 1, payload, slot);  // as the first save
  }
  // A bit of every record that is there; once, until it is written anew.
  void damage() {
    for (std::size_t k = 0; k < slots.size(); ++k) {
      if (slots[k][0] == 0 || std::exchange(damaged[k], true)) continue;
      slots[k][sealed::kSequenceAt] ^= 0x10;
    }
  }
  [[nodiscard]] bool is_damaged() const { return damaged[0] || damaged[1]; }

  std::array<std::vector<std::uint8_t>, hal::Store::kSlots> slots;
  std::array<bool, hal::Store::kSlots> damaged{};
  std::uint32_t saves = 0, failed = 0;
};

// A process's view of it. What is on its way when the process ends is not written.
class WorldStore final : public hal::Store {
 public:
  WorldStore(Situation& situation, Card& card) : situation_(situation), card_(card), found_(card.slots) {}

 private:
  static constexpr Micros kTakes = 30ms;  // a write and a flush of a card

  [[nodiscard]] std::size_t do_slot_bytes() const override { return found_[0].size(); }
  [[nodiscard]] std::span<const std::uint8_t> do_found(std::size_t slot) const override { return found_[slot]; }
  [[nodiscard]] bool do_readable(std::size_t /*slot*/) const override { return true; }
  void do_begin(std::size_t slot, std::span<const std::uint8_t> bytes, bool both) override {
    asked_.assign(bytes.begin(), bytes.end());
    into_ = slot;
    both_ = both;
    due_ = situation_.clock.now() + kTakes;
    state_ = State::kBusy;
  }
  [[nodiscard]] State do_state() const override {
    if (state_ == State::kBusy && situation_.clock.now() >= due_) end();
    return state_;
  }
  [[nodiscard]] int do_error() const override { return error_; }

  void end() const {
    const bool full = situation_.is(Trouble::kDiskFull);
    const bool torn = !full && situation_.is(Trouble::kCardTorn);
    error_ = full ? ENOSPC : torn ? EIO : 0;
    state_ = error_ == 0 ? State::kDone : State::kFailed;
    ++(error_ == 0 ? card_.saves : card_.failed);
    if (full) return;
    const auto count = static_cast<std::ptrdiff_t>(torn ? asked_.size() / 2 : asked_.size());
    for (std::size_t k = 0; k < kSlots; ++k) {
      if (k != into_ && (!both_ || torn)) continue;
      std::copy(asked_.begin(), asked_.begin() + count, card_.slots[k].begin());
      card_.damaged[k] = torn;
    }
  }

  Situation& situation_;
  Card& card_;
  const std::array<std::vector<std::uint8_t>, kSlots> found_;
  std::vector<std::uint8_t> asked_;
  std::size_t into_ = 0;
  bool both_ = false;
  Micros due_{};
  mutable State state_ = State::kIdle;
  mutable int error_ = 0;
};

// The console's port: what somebody types waits until a process reads it. Answers are not kept.
class WorldHost final : public hal::Serial {
 public:
  void type(std::string_view lines) { typed_ += lines; }

 private:
  [[nodiscard]] bool do_write(std::span<const std::uint8_t>) override { return true; }
  [[nodiscard]] std::size_t do_read(std::span<std::uint8_t> bytes) override {
    const std::size_t count = typed_.copy(reinterpret_cast<char*>(bytes.data()), bytes.size());
    typed_.erase(0, count);
    return count;
  }

  std::string typed_;
};

// Read once a second, as on a board (drivers/common/sysfs_supply.hpp).
class WorldSupply final : public hal::Supply {
 public:
  explicit WorldSupply(const Situation& situation) : situation_(situation) {}

 private:
  [[nodiscard]] State do_state() const override {
    const Micros read_at = situation_.clock.now() / 1s * 1s;
    return situation_.was(Trouble::kSupplyLow, read_at) ? State::kLow : State::kGood;
  }

  const Situation& situation_;
};

// A stored model: no slip below 3 mm of the imprint's motion against the gel. (The compiled tree decides in all worlds
// where none is damaged.)
treec::Binary stored_model() {
  treec::Model model;
  model.name = "stored";
  model.feature_set = "touch";
  const FeatureSet& set = *find_feature_set(model.feature_set);
  int motion = 0;
  for (int i = 0; i < set.size(); ++i) {
    model.features.push_back({std::string(set[i].name), std::string(set[i].unit), set[i].q, 0});
    if (set[i].name == "imprint_log2_um_q8") motion = i;
  }
  model.nodes = {{.id = 0, .feature = motion, .threshold = 2957, .child_true = 1, .child_false = 2},
                 {.id = 1, .is_leaf = true, .verdict = Verdict::kHold},
                 {.id = 2, .is_leaf = true, .verdict = Verdict::kSlip}};
  return treec::to_binary(model);
}

constexpr std::string_view kCode = "world";

// Met by a process that is started in the middle of the window.
constexpr std::array kMet{Trouble::kKeepOff,      Trouble::kKeepStuck,      Trouble::kKeepGarbage,
                          Trouble::kKeepWrong,    Trouble::kKeepTorn,       Trouble::kCardTorn,
                          Trouble::kModelDamaged, Trouble::kRecordsDamaged, Trouble::kChipsRenumbered};
constexpr bool meets(Trouble trouble) {
  return std::find(kMet.begin(), kMet.end(), trouble) != kMet.end();
}
constexpr Micros middle(const Window& window) {
  return window.from + (window.to - window.from) / 2;
}

}  // namespace

struct World::Parts {
  Parts(Setup given, sim::Tape& out)
      : setup(std::move(given)),
        tape(out),
        situation(setup),
        clock(situation),
        camera(situation, setup, 0),
        right_camera(situation, setup, 1),
        gpio(situation, out, setup.seed + 1),
        link(situation, setup.seed + 2),
        keep(situation, setup.hand),
        supply(situation),
        hand(situation.clock),
        jpeg(Params{}) {
    Params params;
    params.gripper = setup.gripper ? 1 : 0;
    std::array<std::uint8_t, settings::kMostPayload> payload{};
    settings_card.put(sealed::Kind::kSettings, std::span(payload).first(settings::write(params, payload)));
    const auto damages_model = [](const Window& window) {
      return window.trouble == Trouble::kModelDamaged || window.trouble == Trouble::kRecordsDamaged;
    };
    if (std::any_of(setup.windows.begin(), setup.windows.end(), damages_model)) {
      models_card.put(sealed::Kind::kModel, stored_model());
    }
    hand.put_object({.width_mm = 20.0});
    situation.watch = [this] {
      gpio.settle();
      if (daemon) (void)daemon->app().watchdog().watch(gpio, clock.now());
    };
  }

  void tell_truth() const {
    for (const Window& window : setup.windows) {
      const bool told_later = window.trouble == Trouble::kObjectLost || window.trouble == Trouble::kLinesRandom ||
                              window.trouble == Trouble::kCardTorn || window.trouble == Trouble::kRecordsDamaged;
      if (info(window.trouble).unsafe && !told_later) tell_truth(window);
    }
  }
  void tell_truth(const Window& window) const {
    const auto which = static_cast<std::uint8_t>(window.trouble);
    const Micros from = window.from + info(window.trouble).honest;
    Micros to = window.to;
    if (window.trouble == Trouble::kCameraOther) {  // a process that begins with it measures with it
      for (const Window& other : setup.windows) {
        if (meets(other.trouble) && middle(other) > from) to = std::min(to, middle(other));
      }
    }
    if (from >= to) return;
    tape.write({from.count(), sim::TapeKind::kUnsafe, which, 1});
    tape.write({to.count(), sim::TapeKind::kUnsafe, which, 0});
  }

  [[nodiscard]] Devices devices() {
    right = setup.hand ? std::make_unique<Finger>(right_camera) : nullptr;  // a process begins with nothing
    return {camera, gpio, link, clock, jpeg.get(), false, right.get()};
  }

  void start() {
    keep.before_start(setup.seed + static_cast<std::uint64_t>(situation.clock.now().count()));
    camera.stop();
    right_camera.stop();
    meet_records();
    if (!gpio.open()) return;
    settings_store.emplace(situation, settings_card);
    models_store.emplace(situation, models_card);
    Params params;
    (void)settings::take({sealed::Kind::kSettings, settings::good, &*settings_store, nullptr}, params);
    const model::Tree* const tree =
        models::in_force({sealed::Kind::kModel, models::good, &*models_store, nullptr}, loaded_tree);
    daemon = std::make_unique<Daemon>(devices(), Periphery{hand, keep, &supply}, tree);
    console = std::make_unique<console::Console>(
        host, *daemon, clock,
        console::Place{
            .board = "world", .code = kCode, .settings = &*settings_store, .models = &*models_store, .prompts = false});
    if (!daemon->start(params).ok()) return end_process();
    console->start(params);
    if (daemon->resumed()) ++outcome.resumed;
    if (tree != nullptr) ++outcome.loaded;
    said = {};
  }

  // Whatever a process then goes by, it is not what was stored: "fine" is untrue.
  void meet_records() {
    if (situation.is(Trouble::kModelDamaged) || situation.is(Trouble::kRecordsDamaged)) models_card.damage();
    if (situation.is(Trouble::kRecordsDamaged)) settings_card.damage();
    if (!settings_card.is_damaged()) return;
    for (const Trouble trouble : {Trouble::kCardTorn, Trouble::kRecordsDamaged}) {
      const Window* const w = situation.open(trouble, situation.clock.now());
      if (w != nullptr) tell_truth({trouble, situation.clock.now(), w->to});
    }
  }

  void end_process() {
    console.reset();
    daemon.reset();
  }

  // Kills and stops first: nobody runs in them.
  void process_fault() {
    const Micros now = situation.clock.now();
    if (const Window* w = situation.open(Trouble::kStopped, now)) {
      situation.stand_until(w->to);
      gpio.settle();
      return;
    }
    // No call can be left in its middle here: the last one before a kill is not made.
    if (const Micros kill = situation.next(Trouble::kKilled); kill - now < Daemon::kSlice) situation.stand_until(kill);
    const Window* killed = situation.open(Trouble::kKilled, situation.clock.now());
    if (killed == nullptr) {  // what lasts is met by a process that starts in the middle of its fault
      for (const Trouble trouble : kMet) {
        const Window* w = situation.open(trouble, now);
        if (w == nullptr || now < middle(*w) || met[trouble] == w) continue;
        met[trouble] = w;
        end_process();
        start();
      }
      return;
    }
    end_process();
    situation.stand_until(killed->to);
    gpio.settle();
    start();
  }

  void gripper_faults() {
    using sim::LineTrouble;
    LineTrouble trouble = LineTrouble::kNone;
    std::uint32_t one_in = 1;
    Micros delay{};
    if (situation.is(Trouble::kGripperSilent)) trouble = LineTrouble::kMute;
    if (situation.is(Trouble::kGripperDeaf)) trouble = LineTrouble::kDeaf;
    if (situation.is(Trouble::kGripperGarbage)) trouble = LineTrouble::kGarbage;
    if (situation.is(Trouble::kGripperWrongCrc)) trouble = LineTrouble::kWrongCrc;
    if (situation.is(Trouble::kGripperWrongSlave)) trouble = LineTrouble::kWrongSlave;
    if (situation.is(Trouble::kGripperLate)) {
      trouble = LineTrouble::kLate;
      delay = 60ms;
    }
    if (situation.is(Trouble::kGripperSlow)) {
      trouble = LineTrouble::kLate;
      delay = 15ms;
    }
    if (situation.is(Trouble::kGripperNowAndThen)) {
      trouble = LineTrouble::kMute;
      one_in = 2;
    }
    if (std::exchange(trouble_now, trouble) != trouble) hand.trouble(trouble, one_in, delay);
    const bool off = situation.is(Trouble::kGripperPortOff) || situation.is(Trouble::kUsbDead);
    if (std::exchange(port_off, off) != off) hand.unplug(off);
    once(
        Trouble::kGripperMajorFault, [&] { hand.set_fault(0xE); }, [&] { send_arm(); });
    once(
        Trouble::kGripperUndervoltage, [&] { hand.set_fault(0xA); }, [&] { send_arm(); });
    once(
        Trouble::kGripperHot, [&] { hand.set_fault(8); }, [&] { hand.set_fault(0); });
    once(
        Trouble::kObjectLost,
        [&] {
          if (hand.object_held()) tell_truth(*situation.open(Trouble::kObjectLost, situation.clock.now()));
          hand.remove_object();
        },
        [&] {
          hand.put_object({.width_mm = 20.0});
          link.send(command_frame::Command::kRelease, 0);
          grip_again = situation.clock.now() + 3s;
        });
  }

  template <typename Begin, typename End>
  void once(Trouble which, Begin begin, End end) {
    const Window* w = situation.open(which, situation.clock.now());
    const Window*& in = in_window[which];
    if (w != nullptr && in == nullptr) begin();
    if (w == nullptr && in != nullptr) end();
    in = w;
  }

  // Somebody saves while the card fails, and again when it does not. Settings that are lost are typed in and saved,
  // once a second until the device has them: who types sees no OK of a process that is gone.
  void person() {
    const Micros now = situation.clock.now();
    const Reason why = daemon->app().outputs().reason;
    const auto save = [&](std::string_view hold_ms) {
      host.type("unlock " + std::string(kCode) + "\rset hold_ms " + std::string(hold_ms) + "\rsave\r");
    };
    once(
        Trouble::kDiskFull, [&] { save("210"); },
        [&] {
          if (why != Reason::kConfig) save("200");
        });
    once(
        Trouble::kCardTorn, [&] { save("210"); }, [] {});
    // The sensor that is there again is not the one that this process began with: it has to be restarted.
    if (why != Reason::kCameraWrong || situation.is(Trouble::kCameraOther)) wrong_since = now;
    if (now - wrong_since > 2s) {
      wrong_since = now;
      host.type("unlock " + std::string(kCode) + "\rreboot\r");
    }
    const bool fails =
        situation.is(Trouble::kDiskFull) || situation.is(Trouble::kCardTorn) || situation.is(Trouble::kRecordsDamaged);
    if (why != Reason::kConfig || fails || now < types_at) return;
    types_at = now + 1s;
    if (models_card.is_damaged()) {  // the slot stays as it is: said again after each start
      host.type("unlock " + std::string(kCode) + "\rstored accept\r");
      if (!settings_card.is_damaged()) return;
    }
    host.type("unlock " + std::string(kCode) + "\rset gripper " + std::to_string(setup.gripper ? 1 : 0) + "\r");
    save("200");
    host.type("reboot\r");
  }

  void send_arm() {
    link.send(command_frame::Command::kArm, 0);
    link.send(command_frame::Command::kGrip, 1);
  }

  void script() {
    const Micros now = situation.clock.now();
    if (setup.gripper && !gripped && now >= kGripAt) {
      gripped = true;
      link.send(command_frame::Command::kGrip, 1);
    }
    if (grip_again != Micros{} && now >= grip_again) {
      grip_again = Micros{};
      link.send(command_frame::Command::kGrip, 1);
    }
  }

  void tell_state() {
    const supervisor::Outputs& outputs = daemon->app().outputs();
    const std::pair now{outputs.state, outputs.reason};
    if (said && *said == now) return;
    said = now;
    tape.write({situation.clock.now().count(), sim::TapeKind::kState, static_cast<std::uint8_t>(outputs.state),
                static_cast<std::uint8_t>(outputs.reason)});
  }

  void step() {
    process_fault();
    if (!daemon) {
      situation.pass_until(situation.clock.now() + 100ms);
      start();
      return;
    }
    gripper_faults();
    script();
    person();
    const std::uint32_t before = daemon->app().result().sequence;
    daemon->poll();
    console->poll();
    gpio.settle();
    if (console->asked_to_restart()) {
      daemon->stop();
      end_process();
      start();
      gripped = false;  // and the robot says GRIP again
      return;
    }
    if (daemon->app().outputs().accepted && daemon->app().result().sequence != before) ++outcome.frames;
    tell_state();
  }

  Setup setup;
  sim::Tape& tape;
  Situation situation;
  WorldClock clock;
  WorldCamera camera, right_camera;
  WorldGpio gpio;
  WorldLink link;
  WorldKeep keep;
  WorldSupply supply;
  WorldHost host;
  Card settings_card{settings::kMostBytes}, models_card{models::kMostBytes};
  sim::HandE hand;
  tool::OneThreadDecoder jpeg;
  std::optional<WorldStore> settings_store, models_store;
  model::Tree loaded_tree;
  std::unique_ptr<Finger> right;
  std::unique_ptr<Daemon> daemon;
  std::unique_ptr<console::Console> console;
  bool gripped = false;
  bool port_off = false;
  Micros grip_again{};
  Micros types_at{}, wrong_since{};
  std::map<Trouble, const Window*> met;
  std::map<Trouble, const Window*> in_window;
  sim::LineTrouble trouble_now = sim::LineTrouble::kNone;
  std::optional<std::pair<DeviceState, Reason>> said;
  Outcome outcome;
};

void prepare() {
  (void)films();
}

World::World(Setup setup, sim::Tape& tape) : parts_(std::make_unique<Parts>(std::move(setup), tape)) {}
World::~World() = default;

Outcome World::run() {
  Parts& p = *parts_;
  p.tell_truth();
  p.start();
  long before_kb = 0;
  int before_files = 0;
  while (p.situation.clock.now() < p.setup.end) {
    p.step();
    if (before_kb == 0 && p.situation.clock.now() >= 1s) {
      before_kb = resident_kb();
      before_files = open_files();
    }
  }
  p.outcome.saves = p.settings_card.saves;
  p.outcome.saves_failed = p.settings_card.failed;
  p.outcome.growth_kb = resident_kb() - before_kb;
  p.outcome.open_files = open_files() - before_files;
  p.end_process();
  p.tape.write({p.situation.clock.now().count(), sim::TapeKind::kEnd, 0, 0});
  return p.outcome;
}

}  // namespace holdfast::faults
