// SPDX-License-Identifier: Apache-2.0
// An emulated machine with everything that holdfastd has around it: one or two sensors on USB, GPIO lines that are
// watched and driven from outside, a Hand-E on one serial port, the text console on another, a hardware watchdog, a
// root shell. Disks are thrown away: every machine starts from the same image (board/image/build.sh), either as an
// appliance does, from the card by U-Boot, or sooner, from a flat disk by the emulator itself.
//
// One thread: the machine's surroundings live while wait() or one of the calls that wait runs. Every wait is on a
// condition and ends at its deadline. What it starts ends with it, also when this program is killed.
// Logs of a machine are in build/test-logs/system/NAME: console (kernel), shell, diagnostics, cameras, qemu, and
// events, which has everything with its time.
#pragma once

#include <sys/types.h>

#include <array>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/common/monotonic_clock.hpp"
#include "drivers/sim/hande.hpp"
#include "tests/support/temp_dir.hpp"

namespace holdfast::test {

using Moment = std::chrono::steady_clock::time_point;
using Span = std::chrono::milliseconds;

// A program that ends with this object, or with the program that made it.
class Child {
 public:
  Child() = default;
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  ~Child() { kill(); }

  // stdin and stdout are `in_out`, or nothing when it is -1; stderr goes to `log`.
  void start(const std::vector<std::string>& command, int in_out, const std::filesystem::path& log);
  void kill();
  [[nodiscard]] bool running();

 private:
  pid_t pid_ = -1;
};

// One end of a stream socket, and what came and has yet to go.
class Line {
 public:
  Line() = default;
  explicit Line(int fd) : fd_(fd) {}
  Line(const Line&) = delete;
  Line& operator=(const Line&) = delete;
  ~Line() { close(); }

  void call(const std::filesystem::path& path);  // calls until it is heard
  void take(int fd);
  void close();
  [[nodiscard]] int fd() const { return fd_; }
  [[nodiscard]] bool wants_to_send() const { return fd_ >= 0 && !out.empty(); }
  void serve();  // connects, reads, writes: whatever goes without waiting

  std::string in;
  std::string out;

 private:
  int fd_ = -1;
  std::filesystem::path path_;
};

class Machine {
 public:
  struct Config {
    std::string name{};                     // of its logs
    std::filesystem::path image{};          // has vmlinuz, initrd.gz, root.ext4; or u-boot.bin and the card
    std::filesystem::path card{};           // starts from this one by U-Boot; empty: from the flat disk
    std::filesystem::path film{};           // what the camera shows
    std::filesystem::path right_film{};     // what a second one does, serial 28D3K2R9; empty: there is none
    std::string words{};                    // more of the kernel's command line
    bool plugged = true;                    // the camera, from the start; the second one is plugged in by command
    std::chrono::milliseconds period{800};  // of its frames: 25 fps at board/virt's time scale
    std::int32_t gripper_time = 20;         // the Hand-E's time scale: that of board/virt
    int server = 0;  // port of this machine that it has as 10.0.2.100:8443, and nothing else; 0: it has no network
  };
  struct Said {
    int status = -1;  // -1: no answer before the deadline
    std::string text;
  };
  struct Edge {
    Moment at;
    int line = 0;
    bool high = false;
  };

  // Starts it; problem() says why not.
  explicit Machine(const Config& config);
  ~Machine();
  Machine(const Machine&) = delete;
  Machine& operator=(const Machine&) = delete;

  [[nodiscard]] const std::string& problem() const { return problem_; }
  // True as soon as `condition` holds; false at the deadline, or when the machine has ended.
  [[nodiscard]] bool wait(const std::function<bool()>& condition, Span deadline);

  // ---- The shell
  // A shell is there that was not there at the last call.
  [[nodiscard]] bool boots(Span deadline = kToBoot);
  // The same; when it does not, problem() says so.
  void await_boot(Span deadline = kToBoot);
  // stdout and stderr of `command`, run by bash as root without stdin.
  [[nodiscard]] Said run(const std::string& command, Span deadline = kToAnswer);
  // Runs it again and again until it succeeds: for what only the inside knows.
  [[nodiscard]] bool run_until(const std::string& command, Span deadline);

  // ---- GPIO: lines 0 to 7 of its PL061
  [[nodiscard]] const std::vector<Edge>& edges() const { return edges_; }  // of outputs, as seen from outside
  void forget_edges() { edges_.clear(); }
  [[nodiscard]] bool level(int line) const { return (levels_ >> line & 1U) != 0; }
  void drive(int line, bool high);

  // ---- The rest of its surroundings
  // The answer of tests/system/camera_commands.hpp; empty: none came.
  [[nodiscard]] std::string camera(std::string_view command, std::size_t which = 0);
  [[nodiscard]] sim::HandE& gripper() { return gripper_; }
  [[nodiscard]] std::string& diagnostics() { return diagnostics_.in; }
  void type(std::string_view text) { diagnostics_.out += text; }
  // A USB stick with these bytes; one at a time.
  void plug_stick(const std::filesystem::path& bytes);
  void unplug_stick();
  // The power goes and comes back: what was not on the card yet is lost.
  void cut_power();
  [[nodiscard]] int resets() const { return resets_; }
  [[nodiscard]] int watchdog_bites() const { return bites_; }
  // It runs, and its shell has answered whatever it was asked.
  [[nodiscard]] bool usable() { return problem_.empty() && emulator_.running() && !silent_; }

  static constexpr Span kToBoot = std::chrono::minutes(4);  // 12 s on a quiet machine, 50 s on one with six jobs more
  static constexpr Span kToAnswer = std::chrono::minutes(2);

 private:
  [[nodiscard]] std::vector<std::string> command_line(const Config& config) const;
  void start_camera(std::size_t which, const std::filesystem::path& film, bool plugged);
  [[nodiscard]] bool connect();
  void serve(Span at_most);
  void serve_gripper();
  void hear_test_port();
  void hear_monitor();
  void hear_shell();
  [[nodiscard]] std::optional<std::string> ask_test_port(const std::string& command);
  [[nodiscard]] std::optional<std::string> ask_monitor(const std::string& command);
  void note(std::string_view what, std::string_view text);

  std::string problem_;
  Config config_;
  Moment started_ = std::chrono::steady_clock::now();
  std::filesystem::path logs_;
  std::ofstream events_;
  TempDir sockets_;
  std::string gpio_path_;

  std::vector<std::string> test_answers_, monitor_answers_;
  std::string shell_text_;
  int greetings_ = 0, greeted_ = 0;
  int asked_ = 0;
  bool silent_ = false;
  std::vector<Edge> edges_;
  std::uint32_t levels_ = 0;
  int resets_ = 0, bites_ = 0;
  bool stick_gone_ = false;

  drivers::MonotonicClock gripper_clock_;
  sim::HandE gripper_{gripper_clock_};
  std::string request_;  // to the gripper, as far as it has come
  Moment request_at_{};

  // Last: programs end before the lines that they hold.
  Line shell_, test_port_, monitor_, gripper_line_, diagnostics_;
  std::array<Line, 2> camera_lines_;
  Child emulator_;
  std::array<Child, 2> cameras_;
};

}  // namespace holdfast::test
