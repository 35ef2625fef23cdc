// SPDX-License-Identifier: Apache-2.0
// Integers with a unit, a Q format and a proven range.
//
// A value that crosses a stage has one of these types. `from_raw` is for values that are in range by
// argument (checked in debug builds), `saturate` for values that may not be: it clamps on purpose and counts.
#pragma once

#include <cassert>
#include <chrono>
#include <compare>
#include <cstdint>

#include "base/math.hpp"

namespace holdfast {

using Micros = std::chrono::microseconds;

inline constexpr int kMaxFingers = 2;  // of a hand

// How often a stage had to clamp since start, at most UINT32_MAX: 128 markers at 25 fps would wrap it in eight days.
// Shown in telemetry; a healthy grasp keeps it at 0.
struct Saturations {
  std::uint32_t count = 0;
};

template <typename Unit>
class Quantity {
 public:
  static constexpr std::int32_t kMin = Unit::kMin;
  static constexpr std::int32_t kMax = Unit::kMax;
  // The difference of two values must fit int32 without widening.
  static_assert(std::int64_t{kMax} - std::int64_t{kMin} <= INT32_MAX);

  constexpr Quantity() = default;

  // Range: raw in [kMin, kMax]; anything else is a bug of the caller.
  [[nodiscard]] static constexpr Quantity from_raw(std::int32_t raw) {
    assert(raw >= kMin && raw <= kMax);
    return Quantity(raw);
  }

  // Range: any int64. Clamps to [kMin, kMax] and counts each clamp.
  [[nodiscard]] static constexpr Quantity saturate(std::int64_t raw, Saturations& saturations) {
    if (raw < kMin) {
      count_up(saturations.count);
      return Quantity(kMin);
    }
    if (raw > kMax) {
      count_up(saturations.count);
      return Quantity(kMax);
    }
    return Quantity(static_cast<std::int32_t>(raw));
  }

  [[nodiscard]] constexpr std::int32_t raw() const { return raw_; }

  friend constexpr auto operator<=>(Quantity, Quantity) = default;

 private:
  explicit constexpr Quantity(std::int32_t raw) : raw_(raw) {}
  std::int32_t raw_ = 0;
};

namespace unit {

// Image position or offset in pixels of the working image, 1/256 px; centre of the top-left pixel = 0.
// +-4096 px: twice the largest working image (1640 px wide) plus room for a lost marker's prediction.
struct PixelsQ8 {
  static constexpr std::int32_t kMin = -(4096 << 8), kMax = 4096 << 8;
};
// Displacement of a marker in micrometres on the gel. The gel is 18.6 mm wide: +-65.5 mm cannot be reached
// by a marker that is still in the picture.
struct Micrometres {
  static constexpr std::int32_t kMin = -65535, kMax = 65535;
};
// Mean marker speed. 1 m/s is 25 pitches in a frame of 40 ms; tracking ends long before +-10 m/s.
struct MicrometresPerSec {
  static constexpr std::int32_t kMin = -10'000'000, kMax = 10'000'000;
};
// A length that is a mean over markers: finer than one of them. 1/16 um; the range of Micrometres and sqrt 2 of it.
struct MicrometresQ4 {
  static constexpr std::int32_t kMin = 0, kMax = 131'070 * 16;
};
// Strain of the gel's surface per second, 1e-6/s. The gel is 18.6 mm wide: +-1e7 is all of it ten times in a second.
struct StrainPpmPerSec {
  static constexpr std::int32_t kMin = -10'000'000, kMax = 10'000'000;
};
// A share of one, or a cosine: 1/1024.
struct ShareQ10 {
  static constexpr std::int32_t kMin = -1024, kMax = 1024;
};
// Binary logarithm of a ratio, 1/256. +-32: what the ratio of two lengths in 32 bits can be.
struct Log2Q8 {
  static constexpr std::int32_t kMin = -(32 << 8), kMax = 32 << 8;
};
// Patches of the gel, or a yes (1) or no (0). Four patches lie around each of kMaxMarkers.
struct Count {
  static constexpr std::int32_t kMin = 0, kMax = 512;
};
// Entropy in nat, 1/65536. 15 bins allow at most ln 15 = 2.708 nat; 0..4 leaves room for the sum's rounding.
struct NatsQ16 {
  static constexpr std::int32_t kMin = 0, kMax = 4 << 16;
};
// Rate of entropy in nat/s, 1/256. ln 15 within the smallest accepted dt of 1 ms is 2708 nat/s.
struct NatsPerSecQ8 {
  static constexpr std::int32_t kMin = -(4096 << 8), kMax = 4096 << 8;
};
// Force that the object lays on the gel, in millinewtons. A gel of this size is used up to some 20 N.
struct Millinewtons {
  static constexpr std::int32_t kMin = -32'767, kMax = 32'767;
};
// A ratio in thousandths; friction on silicone stays below 5.
struct Permille {
  static constexpr std::int32_t kMin = 0, kMax = 9'999;
};

}  // namespace unit

using PixelsQ8 = Quantity<unit::PixelsQ8>;
using Micrometres = Quantity<unit::Micrometres>;
using MicrometresPerSec = Quantity<unit::MicrometresPerSec>;
using MicrometresQ4 = Quantity<unit::MicrometresQ4>;
using StrainPpmPerSec = Quantity<unit::StrainPpmPerSec>;
using ShareQ10 = Quantity<unit::ShareQ10>;
using Log2Q8 = Quantity<unit::Log2Q8>;
using Count = Quantity<unit::Count>;
using NatsQ16 = Quantity<unit::NatsQ16>;
using NatsPerSecQ8 = Quantity<unit::NatsPerSecQ8>;
using Millinewtons = Quantity<unit::Millinewtons>;
using Permille = Quantity<unit::Permille>;

}  // namespace holdfast
