// SPDX-License-Identifier: Apache-2.0
// A model for tests that are not about the model: they stay whatever the committed tree has learned.
#pragma once

#include "slip/model.hpp"

namespace holdfast::test {

// Slip is an entropy above 1 nat, and reads nothing but the markers: a drag of 1.8 mm spreads over all bins.
inline const model::Tree kSpreadTree = [] {
  model::Tree spread;
  spread.set = find_feature_set("paper");
  spread.count = 3;
  spread.nodes[0] = {.threshold = 1 << 16, .child_false = 2, .feature = 2, .kind = model::Kind::kSplit};
  spread.nodes[1] = {.kind = model::Kind::kHold};
  spread.nodes[2] = {.kind = model::Kind::kSlip};
  return spread;
}();

}  // namespace holdfast::test
