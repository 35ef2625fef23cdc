// SPDX-License-Identifier: Apache-2.0
// The firmware's Modbus master against libmodbus as the slave, over a pseudo terminal and in real time. libmodbus
// frames by silence, checks what it hears and knows no gripper: this tests the wire, drivers/hande_test the gripper.
#include <fcntl.h>
#include <modbus/modbus.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <string>
#include <thread>
#include <vector>

#include "drivers/sim/serial_pty.hpp"
#include "grip/hande.hpp"
#include "grip/modbus_rtu.hpp"
#include "tests/support/deadline.hpp"

#include <CppUTest/TestHarness.h>

namespace hande = holdfast::hande;
namespace rtu = holdfast::modbus_rtu;
using holdfast::Micros;
using holdfast::Reason;
using holdfast::sim::SerialPty;
using holdfast::test::kDeadline;
using rtu::Progress;
using namespace std::chrono_literals;

namespace {

Micros real_time() {
  return std::chrono::duration_cast<Micros>(std::chrono::steady_clock::now().time_since_epoch());
}

// Serves the registers of a Hand-E, of which it understands: activation takes five requests, the fingers are where they
// are told to be with the next one. Ends when it is told to, or when the line is gone.
class Slave {
 public:
  explicit Slave(const std::string& path) : context_(modbus_new_rtu(path.c_str(), 115200, 'N', 8, 1)) {
    // Holding registers from the outputs to the end of the status: function 3 reads both, function 4 the status alone.
    map_ = modbus_mapping_new_start_address(0, 0, 0, 0, hande::kOutputs, hande::kStatus + 8 - hande::kOutputs,
                                            hande::kStatus, 8);
    ok_ = context_ != nullptr && map_ != nullptr && modbus_set_slave(context_, 9) == 0 &&
          modbus_set_indication_timeout(context_, 0, 50'000) == 0 && modbus_connect(context_) == 0;
    if (ok_) thread_ = std::thread([this] { serve(); });
  }
  ~Slave() {
    ends_ = true;
    if (thread_.joinable()) thread_.join();
    if (context_ != nullptr) modbus_close(context_);
    modbus_free(context_);
    modbus_mapping_free(map_);
  }
  Slave(const Slave&) = delete;
  Slave& operator=(const Slave&) = delete;

  [[nodiscard]] bool ok() const { return ok_; }
  [[nodiscard]] int served() const { return served_; }
  [[nodiscard]] int refused() const { return refused_; }

 private:
  void serve() {
    const auto end = std::chrono::steady_clock::now() + kDeadline;
    std::array<std::uint8_t, MODBUS_RTU_MAX_ADU_LENGTH> request{};
    while (!ends_ && std::chrono::steady_clock::now() < end) {
      const int size = modbus_receive(context_, request.data());
      if (size > 0) {
        ++served_;  // before the reply: whoever has that may look at once
        if (modbus_reply(context_, request.data(), size, map_) < 0) break;
        live();
      } else if (size < 0 && errno != ETIMEDOUT) {
        if (errno == EIO || errno == EBADF) break;
        ++refused_;
        modbus_flush(context_);
      }
    }
  }
  void live() {
    std::uint16_t* const outputs = map_->tab_registers;
    const unsigned action = outputs[0] >> 8;
    if ((action & 1) == 0) activity_ = 0;
    if ((action & 1) != 0 && activity_ < 5) ++activity_;
    const unsigned sta = (action & 1) == 0 ? 0 : activity_ < 5 ? 1 : 3;
    const bool goes = sta == 3 && (action & 8) != 0;
    if (goes) position_ = outputs[1] & 0xFF;
    const std::uint16_t status[3] = {static_cast<std::uint16_t>(((action & 9) | sta << 4 | (goes ? 3U : 0U) << 6) << 8),
                                     static_cast<std::uint16_t>(outputs[1] & 0xFF),
                                     static_cast<std::uint16_t>(position_ << 8)};
    for (std::size_t i = 0; i < 3; ++i) {
      map_->tab_input_registers[i] = status[i];
      outputs[hande::kStatus - hande::kOutputs + i] = status[i];
    }
  }

  modbus_t* context_;
  modbus_mapping_t* map_ = nullptr;
  bool ok_ = false;
  int activity_ = 0;
  int position_ = 0;
  std::atomic<bool> ends_ = false;
  std::atomic<int> served_ = 0;
  std::atomic<int> refused_ = 0;
  std::thread thread_;
};

}  // namespace

TEST_GROUP(ModbusPeer) {
  SerialPty port;
  rtu::Config bus;
  rtu::State state;

  // One exchange to its end.
  Progress exchange() {
    Progress result = Progress::kBusy;
    for (const Micros end = real_time() + kDeadline; result == Progress::kBusy && real_time() < end;) {
      result = rtu::update(state, bus, port, real_time());
      if (result == Progress::kBusy) port.wait(1ms);
    }
    return result;
  }
};

TEST(ModbusPeer, EveryFunctionIsUnderstoodByLibmodbus) {
  bus.timeout = 2s;  // of a machine with much else to do
  const Slave slave(port.path());
  CHECK_TRUE(slave.ok());
  using Words = std::vector<std::uint16_t>;
  const auto got = [&] {
    const auto registers = rtu::registers(state);
    return Words(registers.begin(), registers.end());
  };
  const Words written{0x1234, 0x00FF, 0xFF00, 0xA5A5, 1, 2, 3, 0xFFFF};
  for (std::size_t count = 1; count <= rtu::kMaxRegisters; ++count) {
    const Words values(written.end() - static_cast<std::ptrdiff_t>(count), written.end());
    rtu::begin_write(state, bus, hande::kOutputs + 8, values);
    CHECK_TRUE(Progress::kOk == exchange());
    rtu::begin_read(state, bus, hande::kStatus, count);
    CHECK_TRUE(Progress::kOk == exchange());
    LONGS_EQUAL(count, got().size());
  }
  LONGS_EQUAL(2 * rtu::kMaxRegisters, slave.served());
  LONGS_EQUAL(0, slave.refused());
  // What libmodbus refuses comes as an exception.
  rtu::begin_read(state, bus, hande::kStatus + 1, rtu::kMaxRegisters);
  CHECK_TRUE(Progress::kException == exchange());
  LONGS_EQUAL(MODBUS_EXCEPTION_ILLEGAL_DATA_ADDRESS, state.exception);
}

TEST(ModbusPeer, AHandEOfLibmodbusIsActivatedAndMoved) {
  SerialPty line;
  const Slave slave(line.path());
  CHECK_TRUE(slave.ok());
  hande::Config config;
  config.bus.timeout = 2s;
  hande::State gripper;
  hande::Feedback seen;
  hande::Wanted wanted;
  const auto until = [&](auto condition) {
    for (const Micros end = real_time() + kDeadline; real_time() < end;) {
      seen = hande::update(gripper, config, line, wanted, real_time());
      if (condition()) return true;
      line.wait(2ms);
    }
    return false;
  };
  CHECK_TRUE(until([&] { return seen.activated; }));
  for (const std::uint8_t position : {std::uint8_t{200}, std::uint8_t{3}}) {
    wanted = {.go = true, .position = position, .speed = 10, .force = 20};
    CHECK_TRUE(until([&] { return seen.object == hande::Object::kAtPosition && seen.position == position; }));
  }
  const auto writes = seen.counters.writes;
  const auto replies = seen.bus.replies;
  CHECK_TRUE(until([&] { return seen.bus.replies >= replies + 10; }));
  LONGS_EQUAL(writes, seen.counters.writes);
  CHECK_TRUE(seen.fault_reason == Reason::kNone);
}

TEST(ModbusPeer, ComesBackWhenTheOtherSideIsOpenedAgain) {
  hande::Config config;
  config.bus.timeout = 200ms;
  hande::State gripper;
  hande::Feedback seen;
  const auto until = [&](auto condition) {
    for (const Micros end = real_time() + kDeadline; real_time() < end;) {
      seen = hande::update(gripper, config, port, {}, real_time());
      if (condition()) return true;
      port.wait(5ms);
    }
    return false;
  };
  CHECK_TRUE(until([&] { return seen.fault_reason == Reason::kGripperSilent; }));
  CHECK_TRUE(seen.bus.refused >= 3);
  LONGS_EQUAL(0, seen.bus.requests);  // nobody is there: the port refuses
  for (int round = 0; round < 2; ++round) {
    const Slave slave(port.path());
    CHECK_TRUE(slave.ok());
    CHECK_TRUE(until([&] { return seen.fresh && seen.activated; }));
  }
  CHECK_TRUE(until([&] { return seen.fault_reason == Reason::kGripperSilent; }));
}

TEST_GROUP(SerialPty){};

TEST(SerialPty, IsACableThatIsOutUntilTheOtherSideIsOpened) {
  SerialPty port;
  CHECK_TRUE(port.opened());
  std::array<std::uint8_t, 8> bytes{};
  holdfast::hal::Serial& serial = port;
  const std::array<std::uint8_t, 5> all{0x00, 0x0A, 0x0D, 0x03, 0xFF};  // what a terminal that is not raw changes
  for (int round = 0; round < 3; ++round) {
    CHECK_FALSE(port.connected());
    CHECK_FALSE(serial.write(all));
    LONGS_EQUAL(0, serial.read(bytes));
    const auto begin = std::chrono::steady_clock::now();
    port.wait(20ms);
    CHECK_TRUE(std::chrono::steady_clock::now() - begin >= 19ms);  // no spinning at a hang-up

    const int slave = open(port.path().c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC);
    CHECK_TRUE(slave >= 0);
    CHECK_TRUE(port.connected());
    CHECK_TRUE(serial.write(all));
    LONGS_EQUAL(5, read(slave, bytes.data(), bytes.size()));
    CHECK_TRUE(std::equal(all.begin(), all.end(), bytes.begin()));
    LONGS_EQUAL(5, write(slave, all.data(), all.size()));
    port.wait(kDeadline);
    LONGS_EQUAL(5, serial.read(bytes));
    CHECK_TRUE(std::equal(all.begin(), all.end(), bytes.begin()));
    LONGS_EQUAL(0, serial.read(bytes));
    close(slave);
  }
}

// Also when somebody else opens it before anybody looks, and while nobody has it open each time.
TEST(SerialPty, TellsOfEveryoneWhoLeaves) {
  SerialPty port;
  std::array<std::uint8_t, 8> bytes{};
  holdfast::hal::Serial& serial = port;
  const auto left = [&] {
    const std::uint32_t before = serial.hang_ups();
    const std::size_t count = serial.read(bytes);
    return std::pair{serial.hang_ups() - before, count};
  };
  const auto open_it = [&] { return open(port.path().c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC); };
  CHECK_TRUE(left() == std::pair(1U, std::size_t{0}));
  int slave = open_it();
  CHECK_TRUE(left() == std::pair(0U, std::size_t{0}));
  LONGS_EQUAL(1, write(slave, "a", 1));
  close(slave);
  slave = open_it();
  LONGS_EQUAL(1, write(slave, "b", 1));
  std::pair<std::uint32_t, std::size_t> both{};
  // The kernel hands over what was written when it has time to, and may hand over the one before the other.
  const auto deadline = std::chrono::steady_clock::now() + kDeadline;
  while (both.second < 2 && std::chrono::steady_clock::now() < deadline) {
    port.wait(kDeadline);
    const auto [hang_ups, count] = left();
    both.first += hang_ups;
    both.second += count;
  }
  CHECK_TRUE(both == std::pair(1U, std::size_t{2}));
  CHECK_TRUE(left() == std::pair(0U, std::size_t{0}));
  const int other = open_it();
  CHECK_TRUE(left() == std::pair(0U, std::size_t{0}));
  close(slave);
  CHECK_TRUE(left() == std::pair(1U, std::size_t{0}));
  CHECK_TRUE(left() == std::pair(0U, std::size_t{0}));
  close(other);
  for (int k = 0; k < 3; ++k) CHECK_TRUE(left() == std::pair(1U, std::size_t{0}));
}

// All of a message or nothing, also when the other side reads slowly or not at all.
TEST(SerialPty, CutsNoMessage) {
  SerialPty port;
  holdfast::hal::Serial& serial = port;
  const int slave = open(port.path().c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  CHECK_TRUE(slave >= 0);
  std::vector<std::uint8_t> message(1000);
  int taken = 0;
  std::vector<std::uint8_t> received;
  std::array<std::uint8_t, 4096> bytes{};
  const auto number = [&](int n) { std::fill(message.begin(), message.end(), static_cast<std::uint8_t>(n)); };
  bool refused = false;
  for (int i = 0; i < 500 && !refused; ++i) {
    number(taken);
    refused = !serial.write(message);
    taken += refused ? 0 : 1;
  }
  CHECK_TRUE(refused);
  for (const auto end = std::chrono::steady_clock::now() + kDeadline;
       received.size() < message.size() * static_cast<std::size_t>(taken) && std::chrono::steady_clock::now() < end;) {
    (void)serial.read(bytes);  // sends the rest on
    const auto count = read(slave, bytes.data(), bytes.size());
    if (count > 0) received.insert(received.end(), bytes.begin(), bytes.begin() + count);
  }
  LONGS_EQUAL(message.size() * static_cast<std::size_t>(taken), received.size());
  for (std::size_t i = 0; i < received.size(); ++i) {
    LONGS_EQUAL(static_cast<std::uint8_t>(i / message.size()), received[i]);
  }
  CHECK_FALSE(serial.write(std::vector<std::uint8_t>(SerialPty::kLongest + 1)));
  close(slave);
}
