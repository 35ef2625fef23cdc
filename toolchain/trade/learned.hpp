// SPDX-License-Identifier: Apache-2.0
// Judges that a run teaches itself, on grasps that nothing else of it sees: our own tree with less depth or on other
// features, and what a desk computer would take in its place, features in double precision and OpenCV's DTrees.
//
// What they are for is the comparison among themselves. The committed trees have learned from far more grasps
// (toolchain/model/train.sh).
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

#include "slip/model.hpp"
#include "tactile/types.hpp"
#include "toolchain/learn/samples.hpp"
#include "toolchain/learn/study.hpp"
#include "toolchain/trade/film.hpp"
#include "vision/markers.hpp"

namespace holdfast::trade {

// The paper's four, written with roots and logarithms: Vx, Vy in um/s, E in nat, dE/dt in nat/s. Learns the rest
// position from the first frames, as the firmware does, and has no features meanwhile. E is written out here, although
// learn::entropy_nat() has it: that one is exact and portable, this one is timed. Range: forms of hard or soft bins.
class DoubleFeatures {
 public:
  explicit DoubleFeatures(const learn::EntropyForm& form) : form_(form) {}
  using Values = std::array<float, 4>;
  [[nodiscard]] std::optional<Values> update(const MarkerField& field, Micros time);

 private:
  [[nodiscard]] double entropy_nat(const std::vector<double>& lengths_um) const;

  struct Place {
    double x = 0.0, y = 0.0;
  };
  learn::EntropyForm form_;
  int learned_ = 0;
  double um_per_px_ = 0.0;
  std::vector<Place> rest_px_;
  std::vector<Place> before_um_;
  double entropy_before_ = 0.0;
  Micros time_before_{};
};

class DeskTree {
 public:
  virtual ~DeskTree() = default;
  [[nodiscard]] virtual bool slips(const DoubleFeatures::Values& values) const = 0;
};

class Lessons {
 public:
  // Plays every so many-th of the grasps that are there to learn from; 0: none. `go_on` hears how many are played;
  // false ends it, and what was learned is worth nothing.
  explicit Lessons(int every, const std::function<bool(long)>& go_on = {});

  // There must be some. Range: the name of a feature set of the markers alone; depth 1 to 16. One that these grasps
  // teach nothing says hold.
  [[nodiscard]] model::Tree tree(std::string_view set, int depth) const;
  [[nodiscard]] std::unique_ptr<DeskTree> desk_tree(const learn::EntropyForm& form) const;

 private:
  std::vector<Grasp> grasps_;
  learn::Samples samples_;
};

}  // namespace holdfast::trade
