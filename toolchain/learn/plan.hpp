// SPDX-License-Identifier: Apache-2.0
// Which grasps a simulated dataset has, in which order, and which of them are this shard's.
//
// Order: by seed, then primitive, object and kind, so that a shard is a piece of every object and the shards take
// about the same time. Each grasp is its own four names' business alone: a selection gives the same grasps as the
// whole.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "toolchain/learn/dataset.hpp"
#include "toolchain/play/paper.hpp"

namespace holdfast::learn {

struct PlanOptions {
  std::uint64_t seed = 1;            // of the first repeat; each further one takes the next
  int repeats = 1;                   // at least 1
  bool unseen = false;               // the paper's three objects that training never sees, instead of its ten
  std::vector<std::string> objects;  // empty: all of those
  std::vector<std::string> kinds;    // of scene::kGraspKinds; empty: all
  int shard = 1;                     // 1 .. shards
  int shards = 1;
};

// A grasp by its names: its scene is made when its turn comes.
struct PlannedGrasp {
  const scene::PaperObject* object = nullptr;
  const scene::Primitive* primitive = nullptr;
  scene::GraspKind kind = scene::GraspKind::kStatic;
  std::uint64_t seed = 0;

  [[nodiscard]] Planned make() const;
};

struct Plan {
  std::vector<PlannedGrasp> grasps;  // this shard's, in order
  int before = 0;                    // grasps of the shards before it
};

// Nothing, or one line: an object or a kind that there is not.
[[nodiscard]] std::optional<std::string> make_plan(const PlanOptions& options, Plan& plan);

}  // namespace holdfast::learn
