// SPDX-License-Identifier: Apache-2.0
// holdfast-ros2: a board's link, or an MCAP file, on DDS as ROS 2 has it, without an installation of ROS. A process of
// its own, beside the firmware.
#include <poll.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <charconv>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <exception>
#include <fstream>
#include <iterator>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

#include "drivers/common/input_file.hpp"
#include "drivers/common/trouble.hpp"
#include "toolchain/console/board_port.hpp"
#include "toolchain/console/signals.hpp"
#include "toolchain/log/mcap_reader.hpp"
#include "toolchain/robot/holdfast_link.h"
#include "toolchain/ros2/dds.hpp"
#include "toolchain/support/cli.hpp"

namespace holdfast::ros2 {
namespace {

using console_tool::kMostLost;
using console_tool::Signals;
using std::chrono::steady_clock, std::chrono::milliseconds;

constexpr int kTurnMs = 5;
constexpr std::uint16_t kUnknownAge = 65535;
constexpr milliseconds kSilent{1000}, kDiagnoseEvery{1000};
// An answer comes within a turn of the board; the same frame again within a second is executed once (LINK.md).
constexpr milliseconds kAnswerWithin{100};
constexpr int kMostTries = 5;
constexpr std::uint32_t kLastDomain = 232;  // the ports of a higher one are none
constexpr std::size_t kMostCommands = 10;
constexpr std::uint8_t kNoAnswer = 255;

struct Options {
  std::string link, mcap, hardware = "holdfast";
  bool console = false, commands = false, again = false;
  std::uint32_t domain = 0;
};

log::Time stamp(std::chrono::system_clock::duration since_epoch) {
  const auto ns = std::chrono::duration_cast<std::chrono::nanoseconds>(since_epoch).count();
  return {static_cast<std::int32_t>(ns / 1'000'000'000), static_cast<std::uint32_t>(ns % 1'000'000'000)};
}

log::Time wall_clock() {
  return stamp(std::chrono::system_clock::now().time_since_epoch());
}

class Bridge {
 public:
  Bridge(Dds& dds, const Options& options) : dds_(dds), options_(options), port_(options.link, options.console) {}

  void turn(bool readable) {
    const steady_clock::time_point at = steady_clock::now();
    const auto ms = std::chrono::duration_cast<milliseconds>(at.time_since_epoch()).count();
    read(port_.turn(readable, static_cast<std::uint64_t>(ms)));
    while (const auto command = dds_.take_command()) {
      if (waiting_.size() < kMostCommands) {
        waiting_.push_back(*command);
      } else {
        dds_.write_answer(*command, kNoAnswer, "too many");
      }
    }
    command_turn(at);
    if (at >= diagnose_at_) diagnose(at);
  }
  [[nodiscard]] int fd() const { return port_.fd(); }

 private:
  void read(const console_tool::BoardPort::Came& came) {
    for (const std::uint8_t byte : came.bytes) {
      holdfast_status status{};
      holdfast_answer answer{};
      switch (holdfast_link_push(&receiver_, byte)) {
        case HOLDFAST_KIND_STATUS:
          if (holdfast_link_status(&receiver_, &status) != 0) take(status, came.old);
          break;
        case HOLDFAST_KIND_ANSWER:
          holdfast_link_answer(&receiver_, &answer);
          if (asked_ && holdfast_link_answers(&answer, &*asked_) != 0) {
            dds_.write_answer(waiting_.front(), answer.result, holdfast_result_name(answer.result));
            waiting_.pop_front();
            asked_.reset();
          }
          break;
        default:
          break;
      }
    }
  }

  // `old`: counted, and not published, whose stamp would be of now.
  void take(const holdfast_status& status, bool old) {
    const auto step = static_cast<std::uint16_t>(status.sequence - last_.sequence);
    const bool follows = frames_ > 0 && step > 0 && step <= kMostLost;
    const bool next = follows && step == 1 && (last_.flags & HOLDFAST_FLAG_FEATURES_VALID) != 0;
    frame_ += follows ? step : frames_ > 0 ? 1U : 0U;
    lost_ += follows ? step - 1U : 0U;
    ++frames_;
    if (old) {
      last_ = status;
      return;
    }
    log::FrameRecord record;
    const std::chrono::microseconds age{status.age_100us == kUnknownAge ? 0 : std::int64_t{status.age_100us} * 100};
    record.header.stamp = stamp(std::chrono::system_clock::now().time_since_epoch() - age);
    record.frame = frame_;
    record.state = static_cast<DeviceState>(status.state);
    record.state_name = holdfast_state_name(status.state);
    record.reason = static_cast<Reason>(status.reason);
    record.reason_name = holdfast_reason_name(status.reason);
    record.slip = (status.flags & HOLDFAST_FLAG_SLIP) != 0;
    record.grip_ok = (status.flags & HOLDFAST_FLAG_GRIP_OK) != 0;
    record.alive = (status.flags & HOLDFAST_FLAG_ALIVE) != 0;
    record.accepted = frames_ > 1 && ((status.flags ^ last_.flags) & HOLDFAST_FLAG_ALIVE) != 0;
    record.features_valid = (status.flags & HOLDFAST_FLAG_FEATURES_VALID) != 0;
    record.rates_valid = record.features_valid && next;  // the link has no bit for it
    record.markers = status.markers;
    record.vx_mm_s = status.vx_um_s / 1000.0;
    record.vy_mm_s = status.vy_um_s / 1000.0;
    record.entropy_nat = status.entropy_nat_q16 / 65536.0;
    record.entropy_rate_nat_s = status.entropy_rate_nat_s_q8 / 256.0;
    dds_.write(record);
    const bool news = frames_ == 1 || status.state != last_.state || status.reason != last_.reason;
    last_ = status;
    heard_at_ = steady_clock::now();
    if (news) diagnose(heard_at_);
  }

  void diagnose(steady_clock::time_point at) {
    using Level = Diagnosis::Level;
    diagnose_at_ = at + kDiagnoseEvery;
    const bool heard = frames_ > 0 && at - heard_at_ < kSilent;
    Diagnosis d;
    d.name = "holdfast: grip";
    d.hardware = options_.hardware;
    d.level = !heard                                ? Level::kStale
              : last_.state == HOLDFAST_STATE_OK    ? Level::kOk
              : last_.state == HOLDFAST_STATE_FAULT ? Level::kError
                                                    : Level::kWarn;
    d.message = heard ? std::string(holdfast_state_name(last_.state)) + " (" + holdfast_reason_name(last_.reason) + ")"
                      : "no status frame for a second";
    d.values = {{"frames", std::to_string(frames_)},
                {"lost", std::to_string(lost_)},
                {"damaged", std::to_string(receiver_.damaged)},
                {"refused", std::to_string(dds_.refused())}};
    dds_.write(wall_clock(), d);
  }

  // One at a time, repeated until it is answered.
  void command_turn(steady_clock::time_point at) {
    if (waiting_.empty() || (asked_ && at < ask_at_)) return;
    if (!asked_) {
      asked_ = holdfast_command{++sequence_, waiting_.front().command, waiting_.front().argument};
      tries_ = 0;
    }
    if (tries_++ == kMostTries || !port_.is_open()) {
      dds_.write_answer(waiting_.front(), kNoAnswer, "silent");
      waiting_.pop_front();
      asked_.reset();
      return;
    }
    std::array<std::uint8_t, HOLDFAST_COMMAND_WIRE> wire{};
    holdfast_link_command(&*asked_, wire.data());
    (void)port_.write({reinterpret_cast<const char*>(wire.data()), wire.size()});
    ask_at_ = at + kAnswerWithin;
  }

  Dds& dds_;
  const Options& options_;
  console_tool::BoardPort port_;
  holdfast_receiver receiver_{};
  holdfast_status last_{};
  std::uint32_t frame_ = 0;
  std::uint64_t frames_ = 0, lost_ = 0;
  steady_clock::time_point diagnose_at_{}, heard_at_{}, ask_at_{};
  std::deque<Command> waiting_;
  std::optional<holdfast_command> asked_;
  // Not the last start's: a board may still remember that one.
  std::uint16_t sequence_ = static_cast<std::uint16_t>(steady_clock::now().time_since_epoch().count() / 1000);
  int tries_ = 0;
};

int bridge(Dds& dds, const Options& options, Signals& signals) {
  Bridge bridge(dds, options);
  while (!signals.over()) {
    std::array<pollfd, 2> waits{{{signals.fd(), POLLIN, 0}, {bridge.fd(), POLLIN, 0}}};
    (void)::poll(waits.data(), waits.size(), kTurnMs);
    bridge.turn(waits[1].revents != 0);
  }
  return 0;
}

// In the time of the recording, with stamps of now.
int play(Dds& dds, const Options& options, Signals& signals) {
  std::ifstream in;
  if (const std::string wrong = drivers::open_file(options.mcap, "give what holdfast replay --mcap wrote", in);
      !wrong.empty()) {
    return tool::fail(wrong);
  }
  const std::vector<std::uint8_t> bytes{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  const auto write = [&](auto message) {
    if (!message) return false;
    message->header.stamp = wall_clock();
    dds.write(*message);
    return true;
  };
  do {
    const steady_clock::time_point begun = steady_clock::now();
    std::optional<std::uint64_t> first_ns;
    std::uint64_t written = 0, not_ours = 0;
    bool ended = false;
    const log::McapFile file = log::read_mcap(bytes, [&](const log::McapFile& so_far, const log::McapMessage& message) {
      const steady_clock::time_point due =
          begun + std::chrono::nanoseconds(message.logged_ns - first_ns.value_or(message.logged_ns));
      if (!first_ns) first_ns = message.logged_ns;
      ended = ended || signals.over();  // also where nothing is waited for
      while (!ended && steady_clock::now() < due) {
        const auto left = std::chrono::ceil<milliseconds>(due - steady_clock::now()).count();
        pollfd wait{signals.fd(), POLLIN, 0};
        (void)::poll(&wait, 1, static_cast<int>(std::min<std::int64_t>(left, 1000)));
        ended = signals.over();
      }
      if (ended) return;
      const std::string_view topic = so_far.channels.at(message.channel).topic;
      const bool done = topic == log::kSlipTopic      ? write(log::decode<log::FrameRecord>(message.data))
                        : topic == log::kMarkersTopic ? write(log::decode<log::MarkerField>(message.data))
                        : topic == log::kCameraTopic  ? write(log::decode<log::CompressedImage>(message.data))
                                                      : false;
      ++(done ? written : not_ours);
    });
    if (ended) return 0;
    if (written == 0 || !file.faults.empty()) {
      return tool::fail(
          trouble(options.mcap + ": " + (file.faults.empty() ? "no message of ours" : file.faults[0].what),
                  "not of this version, or a file that broke off", "holdfast log info " + options.mcap));
    }
  } while (options.again);
  return 0;
}

int start(int argc, char** argv) {
  try {
    Options options;
    if (const char* domain = std::getenv("ROS_DOMAIN_ID"); domain != nullptr && *domain != '\0') {
      const std::string_view text(domain);
      const auto [end, wrong] = std::from_chars(text.data(), text.data() + text.size(), options.domain);
      if (wrong != std::errc{} || end != text.data() + text.size() || options.domain > kLastDomain) {
        return tool::fail(trouble("ROS_DOMAIN_ID is '" + std::string(text) + "'", "a typing error",
                                  "set it to a number from 0 to 232, or unset it"));
      }
    }
    CLI::App app{"A board's link, or a recording, on DDS as ROS 2 has it, without ROS", "holdfast-ros2"};
    auto* link = app.add_option("--link", options.link, "the serial port of the board");
    auto* mcap =
        app.add_option("--mcap", options.mcap, "play this file instead, at its own pace")->check(CLI::ExistingFile);
    link->excludes(mcap);
    app.add_flag("--again", options.again, "play it again and again")->needs(mcap);
    app.add_flag("--console", options.console, "the port is the console's: say `watch on`")->needs(link);
    app.add_flag("--commands", options.commands,
                 "take commands from /holdfast/command: anybody in the domain can send them")
        ->needs(link);
    app.add_option("--domain", options.domain, "the DDS domain; without it ROS_DOMAIN_ID, or 0")
        ->check(CLI::Range(0U, kLastDomain));
    app.add_option("--hardware", options.hardware, "the board's name in the diagnostics")->capture_default_str();
    app.footer("Example:\n  holdfast-ros2 --link /dev/ttyUSB0 --commands");
    if (const std::optional<int> status = tool::parse_command_line(app, argc, argv)) return *status;
    if (options.link.empty() == options.mcap.empty()) {
      return tool::fail(trouble("nothing to read", "neither --link nor --mcap was given", "holdfast-ros2 --help"));
    }
    Signals signals;
    Dds dds;
    if (const std::string problem = dds.open(options.domain, options.commands); !problem.empty()) {
      return tool::fail(problem);
    }
    return options.mcap.empty() ? bridge(dds, options, signals) : play(dds, options, signals);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "holdfast-ros2: %s\n", error.what());
    return 1;
  }
}

}  // namespace
}  // namespace holdfast::ros2

int main(int argc, char** argv) {
  return holdfast::ros2::start(argc, argv);
}
