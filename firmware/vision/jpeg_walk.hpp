// SPDX-License-Identifier: Apache-2.0
// The heart of vision/jpeg_fast: walks over the blocks of a JPEG scan without branches, up to three by turns.
// A walk notes where luma blocks begin and what bad symbols it met; it decides nothing. Why it is made so, and who
// judges, stands at the head of vision/jpeg_fast.hpp.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "vision/jpeg_dc.hpp"

namespace holdfast::jpeg_fast {

inline constexpr std::size_t kMaxLanes = 3;

// Set in an entry of a table that begins with DC: the next block ends here, too. Neither of the two is luma. Also the
// bytes in a Phase from what follows one block to what follows two.
inline constexpr std::uint32_t kPair = 64;

// What a look-up needs to know of the block it is in.
struct Phase {
  // A block that follows.
  struct After {
    const std::uint16_t* first = nullptr;  // table that begins it
    const Phase* phase = nullptr;
    std::uint64_t luma = 0;  // bytes to advance in the list: 4 for luma, otherwise 0
  };
  After next;
  const std::uint16_t* ac = nullptr;  // table within the block
  const jpeg_dc::Code* dc_code = nullptr;
  const jpeg_dc::Code* ac_code = nullptr;
  std::array<std::uint64_t, 2> gap{};
  After next_but_one;
};
static_assert(offsetof(Phase, next) == 0 && offsetof(Phase, next_but_one) == kPair);

// An entry of a table that begins with DC, for a DC code that it does not hold. Not kSlow alone: that added to
// coefficient 0 would look like a block that ends with its last coefficient.
inline constexpr std::uint16_t kSlowDc = (jpeg_dc::kSlow | 1) << 8;

// A walk that can be left and taken up again.
struct Walk {
  const std::uint8_t* bytes = nullptr;  // unstuffed
  std::uint64_t position = 0;           // bits from `bytes`
  std::uint64_t end = 0;                // the walk is left at or after this position
  std::uint64_t known = 0;              // the bits of the picture that there are; zeros follow
  std::uint32_t* list = nullptr;        // where the next luma block's position goes
  const std::uint16_t* table = nullptr;
  const Phase* phase = nullptr;
  std::uint32_t k = 0;  // next coefficient; 0: DC
  // 1 + position of the last bad symbol; 0: none. One in the last 16 bits is not noted: it takes 16 bits itself, so
  // that the block in which it is ends beyond what is known, which is looked at anyway.
  std::uint32_t bad = 0;
};

// Copies [at, end) without stuffed zeros to `out`; returns the bytes written. `at` ends at `end`, or at the 0xFF of a
// marker or the last byte.
std::size_t unstuff(const std::uint8_t*& at, const std::uint8_t* end, std::uint8_t* out);

// Walk on by turns until one of them reaches its end.
// Range: a walk passes its end by less than 3 * 31 bits, lists three blocks at most on the way, and reads 8 bytes from
// wherever it is. Walks do not share lists.
struct Lanes {
  void (*one)(Walk& only);
  void (*two)(Walk& first, Walk& second);
  void (*three)(Walk& first, Walk& second, Walk& third);
};

struct Walkers {
  Lanes single;
  Lanes pairs;  // for tables with kPair. Price: two to three instructions of x86-64 more a look-up
};

// The same code compiled for all processors of the architecture, and for what this one has beyond them. The same bits.
[[nodiscard]] const Walkers& baseline_walkers();
[[nodiscard]] const Walkers& fastest_walkers();

}  // namespace holdfast::jpeg_fast
