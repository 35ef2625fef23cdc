// SPDX-License-Identifier: Apache-2.0
// A board's clock that is set back, against its contract.
#pragma once

#include "drivers/sim/clock.hpp"
#include "hal/clock.hpp"

namespace holdfast::test {

class SetBack final : public hal::Clock {
 public:
  explicit SetBack(sim::Clock& true_time) : true_time_(true_time) {}
  Micros by{};

 private:
  [[nodiscard]] Micros do_now() const override { return true_time_.now() - by; }
  void do_wait(Micros time) override { true_time_.wait(time); }
  sim::Clock& true_time_;
};

}  // namespace holdfast::test
