// SPDX-License-Identifier: Apache-2.0
// A real serial port by termios: raw, 8N1, no flow control, ours alone, never blocking.
//
// A cable that is pulled out is a normal event. The port then refuses writes, reads nothing, and is opened again by the
// calls of read() and write() themselves, at most once per waiting time, which grows from kFirstWait to kLongestWait:
// there is no thread, nothing is waited for, and a call makes one attempt at most. An attempt on a USB adapter costs a
// few control transfers (milliseconds). Give the port by the name of its adapter, /dev/serial/by-id/...: ttyUSB0 may
// come back as ttyUSB1.
//
// A process that is killed while its output is stuck (a wedged adapter; a UART without flow control never is) stays for
// 30 s in the kernel, which waits for the output (31 s on an emulated 16550, Linux 6.1); open() by root switches that
// off (then 0.06 s), others need `setserial PORT closing_wait none` before the start.
//
// RS-485, half duplex (Hand-E): use an adapter that switches its driver by itself (FTDI chips with TXDEN on CBUS, or an
// automatic one); this driver does not turn RTS, and a UART of the header with a transceiver needs TIOCSRS485, which is
// not set here. One that echoes what is sent (RE tied to ground) is not supported: nobody skips the echo. FTDI adapters
// collect input for 16 ms by default, more than the 5 ms between two commands that the gripper allows; open() asks for
// ASYNC_LOW_LATENCY, which makes that 1 ms, where the driver knows it.
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "hal/clock.hpp"
#include "hal/serial.hpp"

namespace holdfast::drivers {

class SerialTty final : public hal::Serial {
 public:
  // A message that is longer is refused. So much of one is kept when the kernel takes only a part of it.
  static constexpr std::size_t kLongest = 4096;
  static constexpr std::chrono::milliseconds kFirstWait{100};
  static constexpr std::chrono::milliseconds kLongestWait{2000};

  struct Config {
    std::string path;
    std::uint32_t baud = 115200;  // 1200 to 4000000, of those that termios names
    // A message is refused while what waits before it would take longer to leave the port, zero: never. Price: a
    // kernel keeps up to 4 kB, 355 ms at 115200 baud, and a status frame that late would still look fresh.
    std::chrono::microseconds backlog{100'000};
  };

  struct Counters {
    std::uint64_t read = 0;     // bytes
    std::uint64_t written = 0;  // bytes of messages taken; those that a hang-up lost included
    std::uint64_t refused = 0;  // messages
    std::uint64_t split = 0;    // messages that the kernel took in part at first
    std::uint64_t overruns =
        0;  // input lost: in the UART, or because it was not read in time; 0 where no driver counts
    std::uint32_t hang_ups = 0;
    std::uint32_t attempts = 0;  // to open it, the first one included
    std::uint32_t reopenings = 0;
  };

  explicit SerialTty(const hal::Clock& clock) : clock_(clock) {}
  ~SerialTty() override { close(); }
  SerialTty(const SerialTty&) = delete;
  SerialTty& operator=(const SerialTty&) = delete;

  // Empty: it is open. Otherwise one line: what, likely cause, next step; unless the configuration is wrong (a baud
  // rate that there is not), the port goes on trying. Uses the heap, the other calls do not.
  [[nodiscard]] std::string open(Config config);
  // Lets out what waits, for as long as that takes at this rate and a second at most; the rest is thrown away.
  void close();

  [[nodiscard]] bool connected() const { return fd_ >= 0; }
  [[nodiscard]] Counters counters() const;

  // Whether a message may follow on so much that waits: the rule of Config::backlog.
  [[nodiscard]] static bool in_time(std::size_t waiting, std::uint32_t baud, std::chrono::microseconds backlog);

 private:
  enum class Step : std::uint8_t { kOpen, kKind, kLock, kSettings };  // what failed
  struct Failure {
    Step step = Step::kOpen;
    int error = 0;  // errno
  };

  [[nodiscard]] bool do_write(std::span<const std::uint8_t> bytes) override;
  [[nodiscard]] std::size_t do_read(std::span<std::uint8_t> bytes) override;
  [[nodiscard]] std::uint32_t do_hang_ups() const override { return counters_.hang_ups; }

  [[nodiscard]] bool try_open();
  [[nodiscard]] bool open_or_retry();
  void put_off();
  void hang_up();
  [[nodiscard]] bool let_out();  // whether nothing waits any more
  void free_port(bool all_out);
  // Sends on what did not fit. True: nothing is left.
  [[nodiscard]] bool flush();
  [[nodiscard]] std::string told() const;

  const hal::Clock& clock_;
  Config config_;
  bool wanted_ = false;  // open() was called with a configuration that can be right
  int fd_ = -1;
  Failure failure_;
  std::chrono::microseconds next_try_{};
  std::chrono::microseconds wait_{kFirstWait};
  Counters counters_;
  std::uint64_t overruns_before_ = 0;  // what the driver's counter showed when the port was opened
  // The rest of a message that the kernel took in part: it has to follow, whatever comes next.
  std::array<std::uint8_t, kLongest> rest_{};
  std::size_t rest_begin_ = 0;
  std::size_t rest_end_ = 0;
};

}  // namespace holdfast::drivers
