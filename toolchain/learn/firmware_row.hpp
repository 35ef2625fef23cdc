// SPDX-License-Identifier: Apache-2.0
// One frame of the firmware as a row: every feature as a tree on the device would read it.
#pragma once

#include <cstddef>

#include "app/pipeline.hpp"
#include "params/params.hpp"
#include "slip/classifier.hpp"
#include "toolchain/learn/samples.hpp"

namespace holdfast::learn {

// With every feature computed, whichever of them the tree of this build reads.
[[nodiscard]] inline Params with_all_features(Params params) {
  params.all_features = 1;
  return params;
}

// Sets `accepted` and `x`; the rest is the caller's.
[[nodiscard]] inline Row firmware_row(const pipeline::Result& result) {
  Row row;
  row.accepted = result.quality.ok() && result.referenced;
  if (!row.accepted) return row;
  for (std::size_t i = 0; i < row.x.size(); ++i) row.x[i] = classifier::input(kFeatures[i], result.features);
  return row;
}

}  // namespace holdfast::learn
