// SPDX-License-Identifier: Apache-2.0
#include "tests/system/machine.hpp"
#include "tests/support/folders.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <span>
#include <system_error>
#include <utility>

#include <nlohmann/json.hpp>

namespace holdfast::test {
namespace {

using namespace std::chrono_literals;

constexpr Span kToConnect = 30s;
constexpr Span kLook = 50ms;         // how long nothing may happen before conditions are looked at again
constexpr Span kGripperLook = 2ms;   // the same while the gripper has an answer under way
constexpr Span kRequestGap = 500ms;  // a request that goes on later is another one
constexpr std::string_view kGreeting = "@@SHELL";
constexpr std::array<std::string_view, 2> kUsb{"usb", "right"};  // sockets and logs of the cameras

Moment now() {
  return std::chrono::steady_clock::now();
}

// Cuts the first line off `text`, without its end; none: it is not complete.
std::optional<std::string> take_line(std::string& text) {
  const std::size_t end = text.find('\n');
  if (end == std::string::npos) return std::nullopt;
  std::string line = text.substr(0, end);
  text.erase(0, end + 1);
  if (!line.empty() && line.back() == '\r') line.pop_back();
  return line;
}

// How long a Modbus request is, by its function; 0: not to be known yet.
std::size_t request_size(std::string_view bytes) {
  if (bytes.size() < 2) return 0;
  const auto at = [bytes](std::size_t k) { return static_cast<std::size_t>(static_cast<unsigned char>(bytes[k])); };
  if (at(1) == 16) return bytes.size() < 7 ? 0 : 9 + at(6);
  if (at(1) == 23) return bytes.size() < 11 ? 0 : 13 + at(10);
  return 8;
}

}  // namespace

// ---- Child

void Child::start(const std::vector<std::string>& command, int in_out, const std::filesystem::path& log) {
  std::vector<char*> arguments;
  arguments.reserve(command.size() + 1);
  for (const std::string& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  const int null = ::open("/dev/null", O_RDWR | O_CLOEXEC);
  const int err = ::open(log.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  const pid_t parent = ::getpid();
  pid_ = ::fork();
  if (pid_ == 0) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (::getppid() != parent) ::_exit(127);
    ::dup2(in_out >= 0 ? in_out : null, STDIN_FILENO);
    ::dup2(in_out >= 0 ? in_out : err, STDOUT_FILENO);
    ::dup2(err, STDERR_FILENO);
    ::execvp(arguments[0], arguments.data());
    ::dprintf(STDERR_FILENO, "%s: %s\n", arguments[0], std::strerror(errno));
    ::_exit(127);
  }
  ::close(null);
  ::close(err);
}

void Child::kill() {
  if (pid_ <= 0) return;
  ::kill(pid_, SIGKILL);
  ::waitpid(pid_, nullptr, 0);
  pid_ = -1;
}

bool Child::running() {
  if (pid_ > 0 && ::waitpid(pid_, nullptr, WNOHANG) == pid_) pid_ = -1;
  return pid_ > 0;
}

// ---- Line

void Line::call(const std::filesystem::path& path) {
  path_ = path;
  serve();
}

void Line::take(int fd) {
  close();
  fd_ = fd;
}

void Line::close() {
  if (fd_ >= 0) ::close(fd_);
  fd_ = -1;
}

void Line::serve() {
  if (fd_ < 0 && !path_.empty()) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    const std::string path = path_.string();
    std::copy_n(path.begin(), std::min(path.size(), sizeof address.sun_path - 1), address.sun_path);
    fd_ = ::socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (::connect(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) close();
  }
  if (fd_ < 0) return;
  std::array<char, 65536> bytes;
  for (ssize_t count = 0; (count = ::read(fd_, bytes.data(), bytes.size())) != 0;) {
    if (count < 0) {
      if (errno == EAGAIN || errno == EINTR) break;
      return close();
    }
    in.append(bytes.data(), static_cast<std::size_t>(count));
  }
  if (out.empty()) return;
  const ssize_t count = ::send(fd_, out.data(), out.size(), MSG_NOSIGNAL);
  if (count > 0) out.erase(0, static_cast<std::size_t>(count));
}

// ---- Machine

Machine::Machine(const Config& config)
    : config_(config),
      logs_(std::filesystem::path(holdfast::test::source("build/test-logs/system")) / config.name),
      gripper_clock_(config.gripper_time) {
  std::error_code trouble;
  std::filesystem::remove_all(logs_, trouble);
  std::filesystem::create_directories(logs_, trouble);
  events_.open(logs_ / "events.log");
  std::vector<std::filesystem::path> files{config.image / "vmlinuz", config.image / "initrd.gz",
                                           config.image / "root.ext4", config.film};
  if (!config.card.empty()) files = {config.image / "u-boot.bin", config.card, config.film};
  if (!config.right_film.empty()) files.push_back(config.right_film);
  for (const std::filesystem::path& file : files) {
    if (std::filesystem::exists(file, trouble)) continue;
    problem_ = "there is no " + file.string() + " (not built). Next: tests/run.sh --only system";
    return;
  }

  start_camera(0, config.film, config.plugged);
  if (!config.right_film.empty()) start_camera(1, config.right_film, false);
  if (!problem_.empty()) return;
  emulator_.start(command_line(config), -1, logs_ / "qemu.log");
  if (!connect()) {
    problem_ = "the emulated machine does not start (qemu-system-arm is not installed, or see " +
               (logs_ / "qemu.log").string() + "). Next: tests/run.sh --only packages";
  } else if (!config.right_film.empty()) {
    (void)camera("as GelSight Mini R0B 28D3-K2R9 28D3K2R9 0c45:636d", 1);
  }
}

void Machine::start_camera(std::size_t which, const std::filesystem::path& film, bool plugged) {
  std::array<int, 2> ends{-1, -1};
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0) {
    problem_ = "no socket is to be had (too many files are open). Next: ulimit -n";
    return;
  }
  ::fcntl(ends[0], F_SETFL, O_NONBLOCK);
  camera_lines_[which].take(ends[0]);
  std::vector<std::string> command{holdfast::test::program("usb_camera"), (sockets_ / kUsb[which]).string(),
                                   film.string(), "--period", std::to_string(config_.period.count())};
  if (!plugged) command.emplace_back("--unplugged");
  cameras_[which].start(command, ends[1], logs_ / (std::string("camera-") + std::string(kUsb[which]) + ".log"));
  ::close(ends[1]);
}

Machine::~Machine() {
  note("machine", "ends");
  std::ofstream(logs_ / "diagnostics.log", std::ios::binary) << diagnostics_.in;
}

std::vector<std::string> Machine::command_line(const Config& config) const {
  const auto path = [this](std::string_view name) { return (sockets_ / name).string(); };
  const auto socket = [&path](std::string_view name) {
    return std::string("socket,id=").append(name) + ",path=" + path(name) + ",server=on,wait=off";
  };
  const auto image = [&config](std::string_view name) { return (config.image / name).string(); };
  const auto log = [this](std::string_view name) { return (logs_ / name).string(); };
  std::vector<std::string> command{"qemu-system-aarch64", "-S"};
  const auto add = [&command](std::string_view option, std::string value) {
    command.emplace_back(option);
    command.push_back(std::move(value));
  };
  add("-machine", "virt,acpi=off");  // with ACPI and a boot loader the machine has no PL061
  add("-cpu", "cortex-a72");
  add("-smp", "2");
  add("-m", "768");
  add("-accel", "tcg,thread=multi");
  command.emplace_back("-nodefaults");
  add("-display", "none");
  if (!config.card.empty()) {
    add("-bios", image("u-boot.bin"));
    add("-drive", "file=" + config.card.string() + ",format=raw,if=none,id=root,snapshot=on");
  } else {
    add("-kernel", image("vmlinuz"));
    add("-initrd", image("initrd.gz"));
    // Page tables of its own for the kernel, against an attack that this is no place for: with them every system call
    // makes the emulator forget all translations, and the machine takes three times as long to start.
    add("-append", "console=ttyAMA0 loglevel=4 systemd.show_status=0 nokaslr kpti=off mitigations=off root=/dev/vda " +
                       config.words);
    add("-drive", "file=" + image("root.ext4") + ",format=raw,if=none,id=root,snapshot=on");
  }
  add("-device", "virtio-blk-device,drive=root");
  add("-serial", "file:" + log("console.log"));
  add("-device", "virtio-serial-device");
  add("-chardev", socket("shell") + ",logfile=" + log("shell.log"));
  add("-device", "virtconsole,chardev=shell");
  add("-device", "qemu-xhci,addr=2");
  for (std::size_t which = 0; which < (config.right_film.empty() ? 1 : 2); ++which) {
    add("-chardev", socket(kUsb[which]));
    add("-device", std::string("usb-redir,chardev=").append(kUsb[which]));
  }
  add("-chardev", socket("gripper"));
  add("-device", "pci-serial,chardev=gripper,addr=3");  // /dev/ttyS0
  add("-chardev", socket("diagnostics"));
  add("-device", "pci-serial,chardev=diagnostics,addr=4");  // /dev/ttyS1
  add("-device", "i6300esb,addr=5");
  if (config.server != 0) {
    // Not tcp:, which calls once for all connections. What ends, ends both ways, as a connection does.
    add("-netdev", "user,id=net,restrict=on,guestfwd=tcp:10.0.2.100:8443-cmd:bash -c 'exec 3<>/dev/tcp/127.0.0.1/" +
                       std::to_string(config.server) + "; cat <&0 >&3 & cat <&3; kill $!'");
    add("-device", "virtio-net-device,netdev=net");
  }
  add("-action", "watchdog=reset");
  add("-chardev", socket("monitor"));
  add("-mon", "chardev=monitor,mode=control");
  add("-qtest", "unix:" + path("test") + ",server=on,wait=off");
  add("-qtest-log", "/dev/null");
  return command;
}

bool Machine::connect() {
  shell_.call(sockets_ / "shell");
  test_port_.call(sockets_ / "test");
  monitor_.call(sockets_ / "monitor");
  gripper_line_.call(sockets_ / "gripper");
  diagnostics_.call(sockets_ / "diagnostics");
  const auto all = {&shell_, &test_port_, &monitor_, &gripper_line_, &diagnostics_};
  const auto connected = [&all] {
    return std::all_of(all.begin(), all.end(), [](const Line* line) { return line->fd() >= 0; });
  };
  if (!wait(connected, kToConnect) || !ask_monitor(R"({"execute":"qmp_capabilities"})")) return false;
  const std::optional<std::string> tree =
      ask_monitor(R"({"execute":"human-monitor-command","arguments":{"command-line":"info qom-tree"}})");
  // A line of the tree: "    /device[7] (pl061)".
  const std::size_t found = tree ? tree->find(" (pl061)") : std::string::npos;
  if (found == std::string::npos) return false;
  const std::size_t begin = tree->rfind('/', found);
  gpio_path_ = "/machine/unattached" + tree->substr(begin, found - begin);
  return ask_test_port("irq_intercept_out " + gpio_path_) && ask_monitor(R"({"execute":"cont"})");
}

void Machine::note(std::string_view what, std::string_view text) {
  const double seconds = std::chrono::duration<double>(now() - started_).count();
  std::array<char, 32> stamp{};
  (void)std::snprintf(stamp.data(), stamp.size(), "%9.3f ", seconds);
  events_ << stamp.data() << what << ": " << text << '\n' << std::flush;
}

bool Machine::wait(const std::function<bool()>& condition, Span deadline) {
  const Moment until = now() + deadline;
  serve(0ms);
  while (!condition()) {
    const Moment present = now();
    if (present >= until || !emulator_.running()) return false;
    serve(std::min(kLook, std::chrono::ceil<Span>(until - present)));
  }
  return true;
}

void Machine::serve(Span at_most) {
  const std::array<Line*, 7> lines{
      &shell_, &test_port_, &monitor_, &gripper_line_, &diagnostics_, &camera_lines_.front(), &camera_lines_.back()};
  std::array<pollfd, 7> ends{};
  for (std::size_t k = 0; k < lines.size(); ++k) {
    ends[k] = {lines[k]->fd(), static_cast<short>(lines[k]->wants_to_send() ? POLLIN | POLLOUT : POLLIN), 0};
  }
  const bool gripper_answers = now() - request_at_ < 1s;
  ::poll(ends.data(), ends.size(),
         static_cast<int>((gripper_answers ? std::min(kGripperLook, at_most) : at_most).count()));
  for (Line* const line : lines) line->serve();
  hear_test_port();
  hear_monitor();
  hear_shell();
  serve_gripper();
  for (Line* const line : lines) line->serve();
}

// ---- What comes in

void Machine::hear_test_port() {
  while (const std::optional<std::string> line = take_line(test_port_.in)) {
    const bool raised = line->starts_with("IRQ raise ");
    if (!raised && !line->starts_with("IRQ lower ")) {
      test_answers_.push_back(*line);
      continue;
    }
    const int number = std::atoi(line->c_str() + std::string_view("IRQ raise ").size());
    const std::uint32_t bit = 1U << number;
    if (number < 0 || number > 7 || ((levels_ & bit) != 0) == raised) continue;
    levels_ ^= bit;
    edges_.push_back({now(), number, raised});
    note("gpio", std::to_string(number) + (raised ? " high" : " low"));
  }
}

void Machine::hear_monitor() {
  while (const std::optional<std::string> line = take_line(monitor_.in)) {
    const nlohmann::json message = nlohmann::json::parse(*line, nullptr, false);
    if (message.is_discarded() || message.contains("QMP")) continue;
    if (message.contains("event")) {
      const std::string event = message["event"];
      resets_ += event == "RESET" ? 1 : 0;
      bites_ += event == "WATCHDOG" ? 1 : 0;
      stick_gone_ = stick_gone_ || (event == "DEVICE_DELETED" && message["data"].value("device", "") == "stick-port");
      note("machine", *line);
    } else if (message.contains("return")) {
      monitor_answers_.push_back(message["return"].is_string() ? message["return"].get<std::string>() : *line);
    } else {
      note("machine", *line);
    }
  }
}

void Machine::hear_shell() {
  while (const std::optional<std::string> line = take_line(shell_.in)) {
    note("shell", *line);
    if (line->find(kGreeting) != std::string::npos) {
      ++greetings_;
      shell_text_.clear();
    } else {
      shell_text_.append(*line).append("\n");
    }
  }
}

void Machine::serve_gripper() {
  if (!gripper_line_.in.empty()) {
    if (now() - request_at_ > kRequestGap) request_.clear();
    request_ += std::exchange(gripper_line_.in, {});
    request_at_ = now();
  }
  for (std::size_t size = 0; (size = request_size(request_)) != 0 && request_.size() >= size;) {
    const std::vector<std::uint8_t> bytes(request_.begin(), request_.begin() + static_cast<std::ptrdiff_t>(size));
    request_.erase(0, size);
    (void)gripper_.write(bytes);
  }
  std::array<std::uint8_t, 64> answer{};
  const std::size_t count = gripper_.read(answer);
  gripper_line_.out.append(answer.begin(), answer.begin() + static_cast<std::ptrdiff_t>(count));
}

// ---- What goes out

std::optional<std::string> Machine::ask_test_port(const std::string& command) {
  test_answers_.clear();
  test_port_.out += command + "\n";
  if (!wait([this] { return !test_answers_.empty(); }, kToConnect)) return std::nullopt;
  note("test port", command + ": " + test_answers_.front());
  return test_answers_.front().starts_with("OK") ? std::optional(test_answers_.front()) : std::nullopt;
}

std::optional<std::string> Machine::ask_monitor(const std::string& command) {
  monitor_answers_.clear();
  monitor_.out += command + "\n";
  if (!wait([this] { return !monitor_answers_.empty(); }, kToConnect)) return std::nullopt;
  return monitor_answers_.front();
}

void Machine::drive(int line, bool high) {
  note("gpio", "drive " + std::to_string(line) + (high ? " high" : " low"));
  (void)ask_test_port("set_irq_in " + gpio_path_ + " unnamed-gpio-in " + std::to_string(line) + (high ? " 1" : " 0"));
}

bool Machine::boots(Span deadline) {
  if (!wait([this] { return greetings_ > greeted_; }, deadline)) return false;
  greeted_ = greetings_;
  silent_ = false;
  return true;
}

void Machine::await_boot(Span deadline) {
  if (boots(deadline)) return;
  problem_ = "the emulated machine does not come up (see " + (logs_ / "console.log").string() +
             "). Next: board/image/build.sh, and look at the log's end";
}

Machine::Said Machine::run(const std::string& command, Span deadline) {
  const std::string end = "@@END" + std::to_string(++asked_) + " ";
  note("run", command);
  shell_text_.clear();
  shell_.out += "{ " + command + "\n} </dev/null 2>&1; status=$?; echo; echo " + end + "$status\n";
  std::size_t found = std::string::npos;
  const bool answered = wait(
      [&] {
        found = shell_text_.find(end);
        return found != std::string::npos;
      },
      deadline);
  silent_ = !answered;
  if (!answered) return {-1, shell_text_};
  const int status = std::atoi(shell_text_.c_str() + found + end.size());
  std::string text = shell_text_.substr(0, found);
  while (!text.empty() && text.back() == '\n') text.pop_back();  // as $(...) does
  return {status, text};
}

bool Machine::run_until(const std::string& command, Span deadline) {
  // The loop is inside, so that a look costs no exchange of lines.
  const std::string seconds = std::to_string(std::chrono::ceil<std::chrono::seconds>(deadline).count());
  return run("end=$((SECONDS + " + seconds + ")) met=1; while ((met != 0 && SECONDS < end)); do if " + command +
                 "; then met=0; else sleep 0.1; fi; done; ((met == 0))",
             deadline + kToAnswer)
             .status == 0;
}

void Machine::plug_stick(const std::filesystem::path& bytes) {
  (void)ask_monitor(R"({"execute":"blockdev-add","arguments":{"driver":"raw","node-name":"stick","read-only":true,)"
                    R"("file":{"driver":"file","filename":")" +
                    bytes.string() + R"("}}})");
  (void)ask_monitor(
      R"({"execute":"device_add","arguments":{"driver":"usb-storage","id":"stick-port","drive":"stick"}})");
}

void Machine::unplug_stick() {
  (void)ask_monitor(R"({"execute":"device_del","arguments":{"id":"stick-port"}})");
  // It is gone when the system has let it go.
  (void)wait([this] { return std::exchange(stick_gone_, false); }, kToConnect);
  (void)ask_monitor(R"({"execute":"blockdev-del","arguments":{"node-name":"stick"}})");
}

void Machine::cut_power() {
  (void)ask_monitor(R"({"execute":"system_reset"})");
}

std::string Machine::camera(std::string_view command, std::size_t which) {
  Line& line = camera_lines_[which];
  line.in.clear();
  line.out.append(command).append("\n");
  std::optional<std::string> answer;
  (void)wait(
      [&] {
        answer = take_line(line.in);
        return answer.has_value();
      },
      kToConnect);
  note(which == 0 ? "camera" : "right camera", std::string(command) + ": " + answer.value_or("no answer"));
  return answer.value_or("");
}

}  // namespace holdfast::test
