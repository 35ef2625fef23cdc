// SPDX-License-Identifier: Apache-2.0
// Serial ports by termios, on pseudo terminals. Not to be had here: baud rates on a wire, a UART's overruns, and
// TIOCOUTQ, which is always 0 on a pseudo terminal.
#include <sys/file.h>
#include <sys/ioctl.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <numeric>
#include <optional>

#include <random>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "drivers/linux/serial_tty.hpp"
#include "drivers/sim/clock.hpp"
#include "tests/support/pty.hpp"
#include "tests/support/temp_dir.hpp"
// last: it redefines new
#include "tests/support/allocations.hpp"
#include "tests/support/error_line.hpp"

using namespace holdfast;
using drivers::SerialTty;
using test::check_says;
using test::Pty;
using namespace std::chrono_literals;
using Bytes = std::vector<std::uint8_t>;

namespace {

// The mark of TIOCEXCL; nothing under qemu-user, which does not pass this question on.
std::optional<bool> exclusive(int fd) {
  int mark = 0;
  if (::ioctl(fd, TIOCGEXCL, &mark) != 0) return std::nullopt;
  return mark != 0;
}

Bytes all_bytes() {
  Bytes bytes(256);
  std::iota(bytes.begin(), bytes.end(), std::uint8_t{0});
  return bytes;
}

}  // namespace

TEST_GROUP(LinuxSerial) {
  sim::Clock clock;
  test::TempDir dir;
  std::string name = (dir / "usb-adapter").string();  // stands for a name in /dev/serial/by-id
  SerialTty port{clock};

  // The adapter appears under its name, whatever the kernel calls it now.
  void plug(const Pty& pty) {
    std::filesystem::remove(name);
    std::filesystem::create_symlink(pty.path(), name);
  }
  void open(const Pty& pty, std::uint32_t baud = 115200) {
    plug(pty);
    STRCMP_EQUAL("", port.open({.path = name, .baud = baud}).c_str());
  }
  // Everything that arrives until `count` bytes have.
  Bytes read(std::size_t count) {
    Bytes bytes;
    const auto until = std::chrono::steady_clock::now() + 10s;
    while (bytes.size() < count && std::chrono::steady_clock::now() < until) {
      std::array<std::uint8_t, 100> buffer{};
      const std::size_t got = port.read(buffer);
      bytes.insert(bytes.end(), buffer.begin(), buffer.begin() + static_cast<std::ptrdiff_t>(got));
    }
    return bytes;
  }
  // The port has noticed that the cable is out.
  bool hung_up() {
    std::array<std::uint8_t, 16> buffer{};
    const auto until = std::chrono::steady_clock::now() + 10s;
    while (port.connected() && std::chrono::steady_clock::now() < until) {
      errno = EAGAIN;  // as an empty port left it: an end is no error
      (void)port.read(buffer);
    }
    return !port.connected();
  }
};

TEST(LinuxSerial, EveryByteArrivesAsItWasInBothDirections) {
  Pty pty;
  termios cooked = pty.settings();  // a new one echoes, waits for lines, and stops at ^S
  CHECK_TRUE((cooked.c_lflag & (ICANON | ECHO)) != 0);
  open(pty);
  const Bytes bytes = all_bytes();
  CHECK_TRUE(port.write(bytes));
  CHECK_TRUE(pty.expect(bytes.size()) == bytes);
  CHECK_TRUE(pty.send(bytes));
  CHECK_TRUE(read(bytes.size()) == bytes);
  CHECK_TRUE(pty.take().empty());  // no echo
  LONGS_EQUAL(256, port.counters().read);
  LONGS_EQUAL(256, port.counters().written);
}

TEST(LinuxSerial, ThePortIsSetAsAsked) {
  for (const auto& [baud, speed] :
       std::vector<std::pair<std::uint32_t, speed_t>>{{115200, B115200}, {9600, B9600}, {230400, B230400}}) {
    Pty pty;
    termios odd = pty.settings();  // as another program left it
    odd.c_cflag |= CSTOPB | CRTSCTS | HUPCL;
    LONGS_EQUAL(0, ::tcsetattr(pty.master(), TCSANOW, &odd));
    open(pty, baud);
    const termios settings = pty.settings();
    CHECK_TRUE(cfgetospeed(&settings) == speed && cfgetispeed(&settings) == speed);
    CHECK_TRUE((settings.c_cflag & (CSIZE | PARENB | CSTOPB | CRTSCTS | HUPCL | CLOCAL | CREAD)) ==
               (CS8 | CLOCAL | CREAD));
    CHECK_TRUE((settings.c_iflag & (IXON | IXOFF | ICRNL | ISTRIP | PARMRK)) == 0);
    CHECK_TRUE((settings.c_oflag & OPOST) == 0);
    port.close();
  }
}

TEST(LinuxSerial, WhatCameBeforeIsForSomebodyElse) {
  Pty pty;
  const int before = ::open(pty.path().c_str(), O_RDWR | O_NOCTTY);
  termios raw = pty.settings();
  cfmakeraw(&raw);
  LONGS_EQUAL(0, ::tcsetattr(before, TCSANOW, &raw));
  CHECK_TRUE(pty.send({1, 2, 3}));
  pollfd entry{before, POLLIN, 0};
  LONGS_EQUAL(1, ::poll(&entry, 1, 10'000));
  open(pty);
  ::close(before);
  CHECK_TRUE(pty.send({4}));
  CHECK_TRUE(read(1) == Bytes{4});
}

TEST(LinuxSerial, MessagesArriveWholeAndInOrderHoweverFullThePortIs) {
  Pty pty;
  open(pty);
  std::mt19937 random(7);
  Bytes sent, arrived;
  int refused = 0;
  for (int i = 0; i < 2000; ++i) {
    Bytes message(1 + random() % (random() % 8 == 0 ? SerialTty::kLongest : 60));
    for (std::uint8_t& byte : message) byte = static_cast<std::uint8_t>(random());
    if (port.write(message)) {
      sent.insert(sent.end(), message.begin(), message.end());
    } else {
      ++refused;
    }
    if (random() % 16 == 0) {
      const Bytes some = pty.take(random() % 8000);
      arrived.insert(arrived.end(), some.begin(), some.end());
    }
  }
  // What the port kept for itself goes out with the calls that follow.
  std::array<std::uint8_t, 16> buffer{};
  const auto until = std::chrono::steady_clock::now() + 10s;
  while (arrived.size() < sent.size() && std::chrono::steady_clock::now() < until) {
    LONGS_EQUAL(0, port.read(buffer));
    const Bytes some = pty.take();
    arrived.insert(arrived.end(), some.begin(), some.end());
  }
  CHECK_TRUE(arrived == sent);
  CHECK_TRUE(refused > 100);  // it was full
  LONGS_EQUAL(refused, port.counters().refused);
  LONGS_EQUAL(sent.size(), port.counters().written);
  CHECK_TRUE(port.counters().split > 0);  // and messages were taken in part
}

TEST(LinuxSerial, AnEndLetsOutWhatWaitsAndIsNotHeldByAFarEndThatDoesNotRead) {
  Pty pty;
  open(pty);
  std::size_t sent = 0;
  const auto fill = [&] {
    while (port.write(Bytes(SerialTty::kLongest, 'e'))) sent += SerialTty::kLongest;
    CHECK_TRUE(port.counters().split > 0);
  };
  fill();
  const std::size_t before = pty.take(3 * SerialTty::kLongest).size();
  port.close();
  LONGS_EQUAL(sent, before + pty.take().size());

  open(pty);
  fill();
  const auto begin = std::chrono::steady_clock::now();
  port.close();
  CHECK_TRUE(std::chrono::steady_clock::now() - begin < 20s);  // less than a second, on a machine that is not busy
}

TEST(LinuxSerial, AMessageThatIsTooLongIsRefusedAsAWhole) {
  Pty pty;
  open(pty);
  CHECK_FALSE(port.write(Bytes(SerialTty::kLongest + 1, 1)));
  CHECK_TRUE(port.write(Bytes(SerialTty::kLongest, 2)));
  CHECK_TRUE(pty.expect(SerialTty::kLongest) == Bytes(SerialTty::kLongest, 2));
  CHECK_TRUE(pty.take().empty());
}

TEST(LinuxSerial, AfterAHangUpItComesBackUnderItsNameAndBringsNothingOld) {
  auto first = std::make_unique<Pty>();
  open(*first);
  while (port.write(Bytes(SerialTty::kLongest, 'o'))) {
  }
  CHECK_TRUE(port.counters().split > 0);  // the rest of a message waits inside
  const hal::Serial& serial = port;
  LONGS_EQUAL(0, serial.hang_ups());
  first.reset();
  CHECK_TRUE(hung_up());
  for (int i = 0; i < 10; ++i) CHECK_FALSE(port.write(Bytes{'x'}));
  LONGS_EQUAL(1, port.counters().hang_ups);
  LONGS_EQUAL(1, serial.hang_ups());  // once: whoever comes next is another

  Pty second;
  plug(second);
  CHECK_FALSE(port.connected());  // it waits first
  clock.advance(SerialTty::kFirstWait);
  CHECK_TRUE(port.write(Bytes{'n', 'e', 'w'}));
  CHECK_TRUE(port.connected());
  CHECK_TRUE(second.expect(3) == (Bytes{'n', 'e', 'w'}));
  CHECK_TRUE(second.take().empty());
  CHECK_TRUE(second.send({1, 2, 3}));
  CHECK_TRUE(read(3) == (Bytes{1, 2, 3}));
  CHECK_TRUE((second.settings().c_lflag & (ICANON | ECHO)) == 0);
  LONGS_EQUAL(1, port.counters().reopenings);
}

TEST(LinuxSerial, AHangUpIsNoticedByWritingToo) {
  for (int round = 0; round < 100; ++round) {
    auto pty = std::make_unique<Pty>();
    open(*pty);
    CHECK_TRUE(port.write(Bytes{'a'}));
    pty.reset();
    CHECK_FALSE(port.write(Bytes{'b'}));
    CHECK_FALSE(port.connected());
  }
  LONGS_EQUAL(1, port.counters().hang_ups);  // counters begin with open()
}

TEST(LinuxSerial, APortThatIsOutIsTriedLessAndLessOftenButNeverGivenUp) {
  {
    Pty pty;
    open(pty);
  }
  std::filesystem::remove(name);
  CHECK_TRUE(hung_up());
  const std::uint32_t before = port.counters().attempts;
  std::array<std::uint8_t, 16> buffer{};
  std::vector<long> tried;  // ms since the hang-up
  for (long ms = 1; ms <= 60'000; ++ms) {
    clock.advance(1ms);
    const std::uint32_t attempts = port.counters().attempts;
    (void)port.read(buffer);
    CHECK_FALSE(port.write(Bytes{'x'}));
    if (port.counters().attempts != attempts) tried.push_back(ms);
    CHECK_TRUE(port.counters().attempts <= attempts + 1);
  }
  CHECK_TRUE(tried.size() == port.counters().attempts - before);
  for (std::size_t i = 0; i < 6; ++i) {  // 100, 200, 400, 800, 1600, 2000 ms apart, worked out by hand
    constexpr long kTimes[] = {100, 300, 700, 1500, 3100, 5100};
    LONGS_EQUAL(kTimes[i], tried.at(i));
  }
  for (std::size_t i = 6; i < tried.size(); ++i) LONGS_EQUAL(2000, tried[i] - tried[i - 1]);
  Pty again;
  plug(again);
  clock.advance(SerialTty::kLongestWait);
  CHECK_TRUE(port.write(Bytes{'x'}));
}

TEST(LinuxSerial, AfterTheStartNoHeapIsTakenNotEvenToOpenItAgain) {
  auto first = std::make_unique<Pty>();
  Pty second;
  open(*first);
  Bytes message(SerialTty::kLongest, 'x');
  std::array<std::uint8_t, 64> buffer{};
  const unsigned before = test::allocations();
  while (port.write(message)) {
  }
  (void)port.read(buffer);
  LONGS_EQUAL(before, test::allocations());
  first.reset();
  plug(second);
  const unsigned out = test::allocations();
  CHECK_TRUE(hung_up());
  CHECK_FALSE(port.write(message));
  clock.advance(SerialTty::kFirstWait);
  CHECK_TRUE(port.write(message));
  LONGS_EQUAL(1, port.counters().reopenings);
  LONGS_EQUAL(out, test::allocations());
}

TEST(LinuxSerial, ThereIsOneUserOfAPort) {
  Pty pty;
  open(pty);
  const int other = ::open(name.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK);  // root may, others get EBUSY
  if (other >= 0) {
    CHECK_TRUE(exclusive(other).value_or(true));
    CHECK_TRUE(::flock(other, LOCK_EX | LOCK_NB) != 0);
  }
  SerialTty second(clock);
  check_says(second.open({.path = pty.path()}), {pty.path(), "in use", "fuser -v"});
  CHECK_FALSE(second.connected());
  CHECK_TRUE(port.write(Bytes{'a'}));  // and the first one is not disturbed
  CHECK_TRUE(pty.expect(1) == Bytes{'a'});

  port.close();
  if (other >= 0) {  // somebody holds it still: the mark must not stay with him
    CHECK_FALSE(exclusive(other).value_or(false));
    ::close(other);
  }
  clock.advance(SerialTty::kFirstWait);
  CHECK_TRUE(second.write(Bytes{'b'}));  // its turn, without a new open()
}

TEST(LinuxSerial, APortThatComesAfterTheStartIsTaken) {
  check_says(port.open({.path = name}), {"usb-adapter", "No such file", "no serial adapter", "plug it in"});
  Pty pty;
  plug(pty);
  CHECK_FALSE(port.write(Bytes{'x'}));
  clock.advance(SerialTty::kFirstWait);
  CHECK_TRUE(port.write(Bytes{'x'}));
  CHECK_TRUE(pty.expect(1) == Bytes{'x'});
}

TEST(LinuxSerial, WhatCannotBeAPortIsToldWithWhatThereIs) {
  test::write_file(dir / "usb-FTDI_A", "");
  check_says(port.open({.path = name}), {"there is 'usb-FTDI_A'"});
  check_says(port.open({.path = (dir / "usb-FTDI_A").string()}), {"usb-FTDI_A", "not a serial port"});
  check_says(port.open({.path = name, .baud = 115201}), {"115201 baud", "115200", "4000000"});
  CHECK_FALSE(port.write(Bytes{'x'}));
  LONGS_EQUAL(0, port.counters().attempts);  // that will not become right by trying
}

TEST(LinuxSerial, NothingIsTakenThatWouldLeaveTooLate) {
  // 8N1 is ten bits a byte: 115200 baud are 11.52 bytes a millisecond, worked out by hand.
  CHECK_TRUE(SerialTty::in_time(0, 9600, 1us));
  CHECK_FALSE(SerialTty::in_time(1, 9600, 1ms));
  CHECK_TRUE(SerialTty::in_time(1152, 115200, 100ms));
  CHECK_FALSE(SerialTty::in_time(1153, 115200, 100ms));
  CHECK_TRUE(SerialTty::in_time(96, 9600, 100ms));
  CHECK_FALSE(SerialTty::in_time(97, 9600, 100ms));
  CHECK_TRUE(SerialTty::in_time(4096, 4'000'000, 100ms));
  CHECK_TRUE(SerialTty::in_time(0x7FFFFFFF, 1200, 0us));  // no limit
  CHECK_FALSE(SerialTty::in_time(0x7FFFFFFF, 1200, 1h));
}
