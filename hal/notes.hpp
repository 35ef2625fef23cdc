// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

namespace holdfast::hal {

// A line each that other programs of the board leave for whoever sits at the console, because nobody can log in to read
// the journal: which release runs, from which slot of the card, what came of the last update.
class Notes {
 public:
  enum class Of : std::uint8_t { kRelease, kSlot, kUpdate };
  static constexpr std::array<std::string_view, 3> kNames{"release", "slot", "update"};
  static constexpr std::size_t kMostBytes = 256;

  virtual ~Notes() = default;
  // What is told now, in `room`; longer lines are cut. Empty: nothing. Whoever shows it trusts no byte of it: the name
  // of a file on a stick may be in it. Waits for no medium, takes no memory.
  [[nodiscard]] std::string_view read(Of of, std::span<char, kMostBytes> room) { return do_read(of, room); }

 private:
  [[nodiscard]] virtual std::string_view do_read(Of of, std::span<char, kMostBytes> room) = 0;
};

}  // namespace holdfast::hal
