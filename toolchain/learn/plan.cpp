// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/plan.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <span>
#include <string_view>

namespace holdfast::learn {
namespace {

// Those of `all` that are named, in the order of `all`; no names: all.
template <typename T>
std::optional<std::string> select(const std::vector<const T*>& all, const std::vector<std::string>& names,
                                  std::string_view option, std::vector<const T*>& chosen) {
  for (const std::string& name : names) {
    if (std::ranges::any_of(all, [&](const T* one) { return one->name == name; })) continue;
    std::string known;
    for (const T* one : all) known += fmt::format("{}{}", known.empty() ? "" : ", ", one->name);
    return fmt::format("{} '{}': not in this set. Likely cause: a typing error. Next: give one or more of {}", option,
                       name, known);
  }
  for (const T* one : all) {
    if (names.empty() || std::ranges::find(names, one->name) != names.end()) chosen.push_back(one);
  }
  return {};
}

}  // namespace

Planned PlannedGrasp::make() const {
  Trial trial;
  trial.source = Source::kSimulated;
  trial.object = object->name;
  trial.primitive = primitive->name;
  trial.kind = scene::info(kind).name;
  trial.seed = seed;
  return {trial, scene::grasp_trial(*object, *primitive, kind, seed)};
}

std::optional<std::string> make_plan(const PlanOptions& options, Plan& plan) {
  std::vector<const scene::PaperObject*> known_objects;
  for (const scene::PaperObject& object : scene::kPaperObjects) {
    if (object.unseen == options.unseen) known_objects.push_back(&object);
  }
  std::vector<const scene::GraspKindInfo*> known_kinds;
  known_kinds.reserve(scene::kGraspKinds.size());
  for (const scene::GraspKindInfo& kind : scene::kGraspKinds) known_kinds.push_back(&kind);
  std::vector<const scene::PaperObject*> objects;
  std::vector<const scene::GraspKindInfo*> kinds;
  if (auto error = select(known_objects, options.objects, "--objects", objects)) return error;
  if (auto error = select(known_kinds, options.kinds, "--kinds", kinds)) return error;

  plan = {};
  std::vector<PlannedGrasp> all;
  for (int repeat = 0; repeat < options.repeats; ++repeat) {
    for (const scene::Primitive& primitive : scene::kPrimitives) {
      for (const scene::PaperObject* object : objects) {
        for (const scene::GraspKindInfo* kind : kinds) {
          const auto index = static_cast<scene::GraspKind>(kind - scene::kGraspKinds.data());
          all.push_back({object, &primitive, index, options.seed + static_cast<std::uint64_t>(repeat)});
        }
      }
    }
  }
  const auto cut = [&](int shards) {
    return all.size() * static_cast<std::size_t>(shards) / static_cast<std::size_t>(options.shards);
  };
  const std::size_t from = cut(options.shard - 1);
  const auto mine = std::span(all).subspan(from, cut(options.shard) - from);
  plan.grasps.assign(mine.begin(), mine.end());
  plan.before = static_cast<int>(from);
  return {};
}

}  // namespace holdfast::learn
