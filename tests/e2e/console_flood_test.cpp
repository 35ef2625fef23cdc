// SPDX-License-Identifier: Apache-2.0
// The firmware as a process with somebody at its console who sends noise as fast as the port takes it and reads
// nothing: what the frames notice of it, and how soon the console answers again.
#include <fcntl.h>
#include <poll.h>

#include <termios.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>

#include "link/status_frame.hpp"
#include "tests/support/folders.hpp"
#include "tests/support/host_process.hpp"
#include "tests/support/status_receiver.hpp"
#include "tests/support/temp_dir.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace std::chrono_literals;

namespace {

using Moment = std::chrono::steady_clock::time_point;
constexpr auto kDeadline = 600s;

// 10 s at 25 fps; p99.9 is the longest of them then. HOLDFAST_FLOOD_FRAMES=5000 tells more.
int frames_wanted() {
  const char* const asked = std::getenv("HOLDFAST_FLOOD_FRAMES");
  return asked != nullptr ? std::atoi(asked) : 250;
}

// Our end of a port of the board's.
class FloodedPort {
 public:
  explicit FloodedPort(std::filesystem::path path) : path_(std::move(path)) {}
  ~FloodedPort() {
    if (fd_ >= 0) ::close(fd_);
  }
  FloodedPort(const FloodedPort&) = delete;
  FloodedPort& operator=(const FloodedPort&) = delete;

  bool open() {
    if (fd_ >= 0) return true;
    fd_ = ::open(path_.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    termios settings{};
    if (fd_ < 0 || ::tcgetattr(fd_, &settings) != 0) return false;
    ::cfmakeraw(&settings);
    return ::tcsetattr(fd_, TCSANOW, &settings) == 0;
  }
  // How many bytes of it were taken.
  std::size_t send(std::string_view text) const {
    const ssize_t taken = ::write(fd_, text.data(), text.size());
    return taken > 0 ? static_cast<std::size_t>(taken) : 0;
  }
  [[nodiscard]] std::string take() const {
    std::array<char, 4096> bytes;
    const ssize_t count = ::read(fd_, bytes.data(), bytes.size());
    return count > 0 ? std::string(bytes.data(), static_cast<std::size_t>(count)) : std::string();
  }
  void wait(std::chrono::milliseconds at_most) const {
    pollfd entry{fd_, POLLIN, 0};
    (void)::poll(&entry, 1, static_cast<int>(at_most.count()));
  }

 private:
  std::filesystem::path path_;
  int fd_ = -1;
};

}  // namespace

TEST_GROUP(ConsoleFlood) {
  test::TempDir dir;
  std::filesystem::path console_path = dir / "console";
  std::filesystem::path link_path = dir / "link";
  test::HostProcess board{
      {test::kFirmware, "--real-time", "--empty", "--host", console_path.string(), "--link", link_path.string()}};
  FloodedPort console{console_path}, link{link_path};
  test::StatusReceiver receiver;

  static bool until(const std::function<bool()>& condition) {
    const Moment deadline = std::chrono::steady_clock::now() + kDeadline;
    while (!condition()) {
      if (std::chrono::steady_clock::now() > deadline) return false;
    }
    return true;
  }
  // The line of the answer that begins with `key`; empty: none came in time. Answers to earlier questions, of which a
  // busy machine may leave several, stand before it.
  std::string ask(std::string_view line, std::string_view key) {
    std::string said;
    (void)console.send(line);
    const std::string start = "{\"" + std::string(key) + "\"";
    const bool answered = until([&] {
      console.wait(20ms);
      said += console.take();
      const std::size_t begin = said.find(start);
      return begin != std::string::npos && said.find("\nOK\r\n", begin) != std::string::npos;
    });
    const std::size_t begin = said.find(start);
    return answered ? said.substr(begin, said.find('\n', begin) - begin) : std::string();
  }
  // Status frames that have come, each of them fine.
  int fine_frames() {
    int seen = 0, poor = 0;
    for (const char byte : link.take()) {
      const auto frame = receiver.push(static_cast<std::uint8_t>(byte));
      if (!frame || !frame->ok()) continue;
      ++seen;
      if (frame->frame.state != DeviceState::kOk) ++poor;
    }
    LONGS_EQUAL(0, poor);
    return seen;
  }
  void clear() {
    std::string said;
    (void)console.send("tasks clear\r");
    CHECK(until([&] {
      console.wait(20ms);
      said += console.take();
      return said.find("tasks clear\r\nOK\r\n") != std::string::npos;
    }));
    (void)fine_frames();
  }
  // Of the task `frame`, and how many there were.
  std::pair<long, long> frame_p999_us() {
    const nlohmann::json tasks = nlohmann::json::parse(ask("\rtasks json\r", "first_frame_ms"), nullptr, false);
    CHECK(tasks.contains("tasks"));
    for (const nlohmann::json& task : tasks["tasks"]) {
      if (task["task"] == "frame") return {task["p99_9_us"], task["count"]};
    }
    return {};
  }
  // Minor and major ones of the process so far; fields 10 and 12 of its stat, behind the name in brackets.
  std::pair<long, long> page_faults() {
    std::ifstream file("/proc/" + std::to_string(board.pid()) + "/stat");
    std::string skipped;
    std::getline(file, skipped, ')');
    for (int field = 3; field < 10; ++field) file >> skipped;
    long minor = -1, of_children = 0, major = -1;
    file >> minor >> of_children >> major;
    CHECK(minor > 0 && major >= 0);
    return {minor, major};
  }
  // So many status frames come and one more; `beside` is done between them.
  bool frames_pass(int count, const std::function<void()>& beside) {
    int seen = 0;
    return until([&] {
      beside();
      link.wait(5ms);
      seen += fine_frames();
      return seen > count;  // the first may be of a frame before the tasks were cleared
    });
  }
};

TEST(ConsoleFlood, IsNotNoticedByTheFrames) {
  CHECK(until([this] { return console.open() && link.open(); }));
  CHECK(until([this] { return ask("\rstatus json\r", "state").find("\"state\":\"OK\"") != std::string::npos; }));
  (void)link.take();
  clear();
  const auto [minor_before, major_before] = page_faults();
  CHECK(frames_pass(frames_wanted(), [] {}));
  const auto [minor, major] = page_faults();
  const auto [quiet, quiet_frames] = frame_p999_us();

  clear();
  std::uint32_t random = 9;
  std::size_t taken = 0;
  CHECK(frames_pass(frames_wanted(), [&] {  // a megabyte a second is 5 kB each time around
    std::string noise(5000, '\0');
    for (char& byte : noise) {
      random = random * 1664525 + 1013904223;
      byte = static_cast<char>(random >> 24);
    }
    taken += console.send(noise);
  }));

  const Moment ended = std::chrono::steady_clock::now();
  // As somebody does it: Ctrl-C and a question, and again when nothing comes.
  std::string said;
  Moment asked{};
  CHECK(until([&] {
    if (std::chrono::steady_clock::now() - asked > 400ms) {
      (void)console.send("\x03\rversion json\r");
      asked = std::chrono::steady_clock::now();
    }
    console.wait(20ms);
    said += console.take();
    return said.find("{\"firmware\"") != std::string::npos;
  }));
  const double back = std::chrono::duration<double>(std::chrono::steady_clock::now() - ended).count();
  const auto [flooded, flooded_frames] = frame_p999_us();
  std::printf(
      " page faults in %d frames: %ld minor, %ld major; frame p99.9 %ld us quiet (%ld frames), %ld us under noise (%ld "
      "frames, %zu kB taken); back after %.2f s;",
      frames_wanted(), minor - minor_before, major - major_before, quiet, quiet_frames, flooded, flooded_frames,
      taken / 1000, back);
  CHECK(quiet_frames >= frames_wanted() && flooded_frames >= frames_wanted());
}
