// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "hal/supply.hpp"

namespace holdfast::sim {

// A supply that says what it is told to.
class Supply final : public hal::Supply {
 public:
  State now = State::kGood;

 private:
  [[nodiscard]] State do_state() const override { return now; }
};

}  // namespace holdfast::sim
