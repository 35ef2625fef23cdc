// SPDX-License-Identifier: Apache-2.0
// What is tried: the faults known from the field (rows), every kind of trouble of every component (cells),
// and all pairs of the rows, each row with itself among them. What cannot happen in this world says why.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "toolchain/faults/judge.hpp"
#include "toolchain/faults/world.hpp"

namespace holdfast::faults {

enum class Type : std::uint8_t { kOff, kStuck, kGarbage, kWrong, kSlow, kDelayed, kIntermittent };
inline constexpr std::array<std::string_view, 7> kTypeNames{"off",  "stuck",   "garbage",     "wrong",
                                                            "slow", "delayed", "intermittent"};

// One cell of the matrix of components and types: a trouble, or the reason why there is none.
struct Cell {
  Component component;
  Type type;
  std::optional<Trouble> trouble;
  std::string_view why_not;
};
[[nodiscard]] const std::array<Cell, 49>& cells();

// One fault from the field. Sources: issue trackers of cameras, robots and boards, as far as they are public.
struct Row {
  int number;
  std::string_view fault;
  std::optional<Trouble> trouble;
  std::string_view why_not;
};
[[nodiscard]] const std::array<Row, 26>& rows();

// One run of the world, and how it went.
struct Run {
  std::string name;
  Setup setup;
  Judgement judgement;
  Outcome outcome;
  bool crashed = false;
  // Nothing unsafe, no crash, and well again at the end where that can be; FAULT where the fault lasts.
  [[nodiscard]] bool passed() const;
  bool expect_fine = false;  // told "fine" all through: a fault that must not disturb
};

// How often FAULT was entered while nothing was wrong, nor had been in the last 6 s: a gripper that is activated anew
// and told to grip takes so long.
[[nodiscard]] int false_faults(const Run& run);

// Plays `setup` in a child process; this one observes. `expect_fine` as in Run.
[[nodiscard]] Run play(std::string name, Setup setup, bool expect_fine = false);

// A fault that nobody should notice.
[[nodiscard]] bool must_stay_fine(Trouble trouble);

// One fault, or two at once, by setup_of().
[[nodiscard]] Run play(Trouble trouble, bool held);
[[nodiscard]] Run play(Trouble first, Trouble second, bool held);

// Windows of 2 s from about 4 s on; the second of a pair begins 0.4 s later, or, of the same fault, 0.4 s after its
// end. What dies for good lasts to the end.
[[nodiscard]] Setup setup_of(Trouble trouble, bool held);
[[nodiscard]] Setup setup_of(Trouble first, Trouble second, bool held);

// The same of a hand of two fingers: faults of a camera are those of this finger's, and of a pair the second one's.
[[nodiscard]] Setup on_hand(Setup setup, int finger, int second_finger = 1);
[[nodiscard]] constexpr bool is_camera(Trouble trouble) {
  return trouble <= Trouble::kLostMarkers;
}
[[nodiscard]] Run play_hand(Trouble trouble, int finger, bool held);
// `first` on the left finger, `second` on the right one.
[[nodiscard]] Run play_hand(Trouble first, Trouble second, bool held);

// Random rows about every 500 frames, for a long run.
[[nodiscard]] Setup soak_setup(std::uint64_t frames, std::uint64_t seed);

}  // namespace holdfast::faults
