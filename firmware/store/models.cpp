// SPDX-License-Identifier: Apache-2.0
#include "store/models.hpp"

namespace holdfast::models {

model_file::Refusal refusal_of(std::span<const std::uint8_t> payload) {
  model::Tree tree;
  return payload.empty() ? model_file::Refusal::kNone : model_file::read(payload, tree);
}

bool good(std::span<const std::uint8_t> payload) {
  return refusal_of(payload) == model_file::Refusal::kNone;
}

const model::Tree* in_force(const SlotStore& slots, model::Tree& tree) {
  const bool loaded = slots.counts() && model_file::read(slots.payload(), tree) == model_file::Refusal::kNone;
  return loaded ? &tree : nullptr;
}

}  // namespace holdfast::models
