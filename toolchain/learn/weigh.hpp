// SPDX-License-Identifier: Apache-2.0
// A known weight on a recorded gel, and the scale of its forces that follows: what the load stage (tactile/load.hpp)
// reads while the weight rests on the gel, against what it weighs.
//
// Where the weight rests: of all stretches of half a second and more in which the reading stays within 4 % and nothing
// slips, the one with the largest reading. What is too light for the noise is never so steady.
#pragma once

#include <cstdint>
#include <string>
#include <variant>
#include <vector>

#include "app/pipeline.hpp"

namespace holdfast::learn {

enum class Force : std::uint8_t { kShear, kNormal };

class Weighing {
 public:
  static constexpr double kSteady = 0.04;  // of the mean: from the least reading of a stretch to the most
  static constexpr Micros kLong{500'000};
  static constexpr double kLeast_mn = 100.0;  // of a gel of 35 kPa
  static constexpr double kFaint_mn = 300.0;  // below it noise may be all that is unsteady

  explicit Weighing(Force force) : force_(force) {}

  // `result`: of a pipeline without scales, so that it reads as a gel of 35 kPa.
  void add(long frame, const pipeline::Result& result);

  struct Found {
    long first = 0, last = 0;  // frames
    int frames = 0;
    double reading_mn = 0;  // mean
    double spread_mn = 0;   // standard deviation
    int within = 0;         // frames whose contact lies within the lattice
    std::int32_t scale_permille = 0;
  };
  // Of a force of `true_mn` on the gel. Otherwise what is wrong: what, likely cause and next step, without the file.
  [[nodiscard]] std::variant<Found, std::string> find(double true_mn) const;

 private:
  struct Row {
    long frame = 0;
    Micros at{};
    bool usable = false;  // a reading, and nothing slips
    bool slips = false;
    bool empty = false;
    bool strained = false;
    bool within = false;
    double reading_mn = 0;
  };
  [[nodiscard]] Found steadiest() const;

  Force force_;
  std::vector<Row> rows_;
};

}  // namespace holdfast::learn
