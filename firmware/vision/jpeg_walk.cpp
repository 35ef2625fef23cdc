// SPDX-License-Identifier: Apache-2.0
#include "vision/jpeg_walk.hpp"

#include <algorithm>
#include <cstring>

namespace holdfast::jpeg_fast {
namespace {

using jpeg_dc::Error;
using jpeg_dc::kEnded;
using jpeg_dc::kIndexBits;
using jpeg_dc::kMaxSkip;
using jpeg_dc::kSlow;
using jpeg_dc::Symbol;

struct SlowStep {
  std::uint32_t bits;
  std::uint32_t k;  // plus kBad where a bad symbol counts
};
constexpr std::uint32_t kBad = 256;

// One symbol by the canonical rule. A bad one ends the block: a walk that began with a guess must get over it.
[[gnu::noinline]] SlowStep slow_step(const Phase& phase, const std::uint16_t* table, const std::uint8_t* bytes,
                                     std::uint64_t position, std::uint64_t known, std::uint32_t k) {
  const std::uint32_t ends_bad = position + 16 <= known ? kEnded | kBad : kEnded;
  const std::uint64_t window = jpeg_dc::next_eight(bytes + (position >> 3)) << (position & 7);
  const auto window16 = static_cast<std::uint32_t>(window >> 48);
  if (table != phase.ac) {
    const Symbol symbol = find(*phase.dc_code, window16);
    if (symbol.length == 0) return {16, ends_bad};
    return {symbol.length + symbol.value, 1};
  }
  const jpeg_dc::AcStep step = jpeg_dc::ac_step(*phase.ac_code, window16, k);
  if (step.error != Error::kNone) return {std::max(step.bits, 16U), ends_bad};
  return {step.bits, step.k};
}

// The walk in registers. Five of them change with every look-up, so that two lanes fit x86-64 and three aarch64.
// kPairs: an entry may have kPair set.
template <bool kPairs>
struct Lane {
  explicit Lane(const Walk& walk)
      : bytes(walk.bytes),
        start(walk.position),
        end(walk.end),
        known(walk.known),
        bad(walk.bad),
        sum(walk.k << 8),
        table(walk.table),
        phase(walk.phase),
        list(reinterpret_cast<std::uint8_t*>(walk.list)) {}

  void leave(Walk& walk) const {
    walk.position = start;
    walk.list = reinterpret_cast<std::uint32_t*>(list);
    walk.table = table;
    walk.phase = phase;
    walk.k = sum >> 8;
    walk.bad = bad;
  }

  // Range: at most 54 bits since the last time.
  [[gnu::always_inline]] bool goes_on() {
    start += sum & 0xFF;
    sum &= 0xFF00;
    return start < end;
  }

  [[gnu::always_inline]] void fill() { window = jpeg_dc::next_eight(bytes + (start >> 3)) << (start & 7); }

  [[gnu::always_inline]] void step() {
    const std::uint32_t entry = table[window >> (64 - kIndexBits)];
    std::uint32_t next = sum + entry;
    if ((next & kSlow << 8) == 0) [[likely]] {
      window <<= entry & 63;
    } else if ((next & 0xFF00) == kSlow << 8) {  // the last coefficient ends its block without a symbol for it
      window <<= entry & 63;
      next += (kEnded - kSlow) << 8;
    } else {
      const std::uint64_t position = start + (sum & 0xFF);
      const SlowStep slow = slow_step(*phase, table, bytes, position, known, sum >> 8);
      if ((slow.k & kBad) != 0) bad = static_cast<std::uint32_t>(position) + 1;
      next = (slow.k & 0xFF) << 8;
      start = position + slow.bits;
      fill();
    }
    const std::uint32_t used = next & (kPairs ? kPair - 1 : 0xFF);
    const auto place = static_cast<std::uint32_t>(start) + used;
    std::memcpy(list, &place, sizeof place);
    turn(next, used, after(kPairs ? entry & kPair : 0));
  }

 private:
  // The block that follows; `pair`, 0 or kPair, is the way to the one after it. An address, because a branch here is
  // not predicted either: it takes up to a fifth from a sparse camera picture (measured).
  [[nodiscard, gnu::always_inline]] const Phase::After& after(std::uint64_t pair) const {
    return *reinterpret_cast<const Phase::After*>(reinterpret_cast<const std::uint8_t*>(phase) + pair);
  }

  // After a look-up: the same block's AC table, or, when `next` says that the block has ended, the first table of the
  // block `after` it and `restarted` instead of `next`.
  // In assembly, because gcc makes one branch of four selects on one condition, whatever it is told of its
  // probability, and that branch costs a third to a half of the speed (measured: 3 lanes 2.9 to 3.7 instead of 5.0 to
  // 6.2 times libjpeg-turbo). tests/checks/jpeg_selects.sh looks at what became of it.
  // The phase changes last, so that it needs no second register.
  [[gnu::always_inline]] void turn(std::uint32_t next, std::uint32_t restarted, const Phase::After& after) {
    table = phase->ac;
    std::uint64_t forward = 0;
#if defined(__x86_64__)
    asm("cmp $0x8000, %[sum]\n\t"
        "cmovae %[first], %[table]\n\t"
        "cmovae %[luma], %[forward]\n\t"
        "cmovae %[restarted], %[sum]\n\t"
        "cmovae %[next], %[phase]"
        : [table] "+&r"(table), [forward] "+&r"(forward), [phase] "+r"(phase), [sum] "+&r"(next)
        : [first] "m"(after.first), [luma] "m"(after.luma), [next] "m"(after.phase), [restarted] "r"(restarted)
        : "cc");
#elif defined(__aarch64__)
    const Phase* const now = phase;
    asm("tst %w[sum], #0x8000\n\t"
        "csel %[table], %[first], %[table], ne\n\t"
        "csel %[forward], %[luma], xzr, ne\n\t"
        "csel %w[sum], %w[restarted], %w[sum], ne\n\t"
        "csel %[phase], %[next], %[now], ne"
        : [table] "+&r"(table), [forward] "=&r"(forward), [phase] "=r"(phase), [sum] "+&r"(next)
        : [first] "r"(after.first), [luma] "r"(after.luma), [next] "r"(after.phase), [restarted] "r"(restarted),
          [now] "r"(now)
        : "cc");
#else
    if (next >= kEnded << 8) {
      table = after.first;
      forward = after.luma;
      phase = after.phase;
      next = restarted;
    }
#endif
    list += forward;
    sum = next;
  }

 public:
  const std::uint8_t* bytes;
  std::uint64_t start;  // bits from `bytes` to where the window was filled
  std::uint64_t end;
  std::uint64_t known;
  std::uint32_t bad;

  std::uint64_t window = 0;  // the bits from here on, left-aligned
  std::uint32_t sum;         // of entries: bits taken since `start`, and k << 8
  const std::uint16_t* table;
  const Phase* phase;
  std::uint8_t* list;
};

// Three look-ups take at most 54 of the 57 bits of a filled window. Inlined, all of it, to be compiled for the
// processor of the caller.
template <bool kPairs, typename... Walks>
[[gnu::always_inline]] inline void by_turns(Walks&... walks) {
  const auto run = [&](auto... lane) __attribute__((always_inline)) {
    while ((lane.goes_on() & ...)) {
      (lane.fill(), ...);
      (lane.step(), ...);
      (lane.step(), ...);
      (lane.step(), ...);
    }
    (lane.leave(walks), ...);
  };
  run(Lane<kPairs>(walks)...);
}
static_assert(3 * kMaxSkip <= 57);

template <bool kPairs, typename... Walks>
void walk_baseline(Walks&... walks) {
  by_turns<kPairs>(walks...);
}

#if defined(__x86_64__)
// Shifts by a number in any register and without a copy: 5 % less time (measured, dense and sparse pictures).
template <bool kPairs, typename... Walks>
[[gnu::target("bmi2")]] void walk_bmi2(Walks&... walks) {
  by_turns<kPairs>(walks...);
}
#endif

}  // namespace

const Walkers& baseline_walkers() {
  static constexpr Walkers kWalkers{
      {walk_baseline<false, Walk>, walk_baseline<false, Walk, Walk>, walk_baseline<false, Walk, Walk, Walk>},
      {walk_baseline<true, Walk>, walk_baseline<true, Walk, Walk>, walk_baseline<true, Walk, Walk, Walk>}};
  return kWalkers;
}

const Walkers& fastest_walkers() {
#if defined(__x86_64__)
  static constexpr Walkers kWalkers{
      {walk_bmi2<false, Walk>, walk_bmi2<false, Walk, Walk>, walk_bmi2<false, Walk, Walk, Walk>},
      {walk_bmi2<true, Walk>, walk_bmi2<true, Walk, Walk>, walk_bmi2<true, Walk, Walk, Walk>}};
  if (__builtin_cpu_supports("bmi2")) return kWalkers;
#endif
  return baseline_walkers();
}

std::size_t unstuff(const std::uint8_t*& at, const std::uint8_t* end, std::uint8_t* out) {
  std::uint8_t* const begin = out;
  while (at != end) {
    const void* const found = std::memchr(at, 0xFF, static_cast<std::size_t>(end - at));
    const std::uint8_t* const stop = found == nullptr ? end : static_cast<const std::uint8_t*>(found);
    out = std::copy(at, stop, out);
    at = stop;
    if (end - at < 2 || at[1] != 0) break;
    *out++ = 0xFF;
    at += 2;
  }
  return static_cast<std::size_t>(out - begin);
}

}  // namespace holdfast::jpeg_fast
