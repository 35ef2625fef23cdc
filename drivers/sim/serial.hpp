// SPDX-License-Identifier: Apache-2.0
// A serial port with a script on one end and a tape on the other: what is fed can be read, what is written is
// kept. Bytes pass at once; baud rate and line noise are not modelled.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "drivers/sim/ring.hpp"
#include "hal/serial.hpp"

namespace holdfast::sim {

class Serial final : public hal::Serial {
 public:
  static constexpr std::size_t kDefaultOutput = 65536;  // bytes kept of what was written
  static constexpr std::size_t kDefaultInput = 4096;    // bytes that may wait to be read, as in a tty

  explicit Serial(std::size_t output = kDefaultOutput, std::size_t input = kDefaultInput)
      : output_(output), input_(input) {}

  // The peer does not read: writes are refused until it does again.
  void set_full(bool full) { full_ = full; }
  // The cable is out: writes are refused, nothing can be read, and what waited is lost.
  void hang_up();
  // Another program has the other end now, without a moment between the two.
  void change_hands() { ++hang_ups_; }
  void reconnect() { hung_up_ = false; }

  // Input for the firmware. False when the cable is out or the bytes do not fit: then none are taken.
  [[nodiscard]] bool feed(std::span<const std::uint8_t> bytes);

  // Everything written and taken, the newest kept; total() counts all bytes.
  [[nodiscard]] const Ring<std::uint8_t>& output() const { return output_; }
  // The same as one piece, for tests. Allocates.
  [[nodiscard]] std::vector<std::uint8_t> output_bytes() const;
  void clear_output() { output_.clear(); }
  [[nodiscard]] std::uint64_t writes_taken() const { return taken_; }
  [[nodiscard]] std::uint64_t writes_refused() const { return refused_; }
  [[nodiscard]] std::size_t waiting() const { return waiting_; }

 private:
  [[nodiscard]] bool do_write(std::span<const std::uint8_t> bytes) override;
  [[nodiscard]] std::size_t do_read(std::span<std::uint8_t> bytes) override;
  [[nodiscard]] std::uint32_t do_hang_ups() const override { return hang_ups_; }

  Ring<std::uint8_t> output_;
  std::vector<std::uint8_t> input_;
  std::size_t first_ = 0;  // index of the oldest byte that waits
  std::size_t waiting_ = 0;
  std::uint64_t taken_ = 0;
  std::uint64_t refused_ = 0;
  std::uint32_t hang_ups_ = 0;
  bool full_ = false;
  bool hung_up_ = false;
};

}  // namespace holdfast::sim
