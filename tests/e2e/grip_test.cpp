// SPDX-License-Identifier: Apache-2.0
// The closed loop: physics, pictures, firmware, regulator and gripper. HOLDFAST_GRIP_PULLS=200 pulls as many books.
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string_view>

#include "toolchain/play/grasp.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::tool;

namespace {

struct Pulled {
  LeastForce least;
  Grasp grasp;
  double allowed_n = 0.0;
};

Pulled pulled(const Pull& pull, Prevention prevention) {
  const regulator::Config config;
  Pulled out;
  out.least = least_forces(pull);
  LagGripper gripper;
  out.grasp = play_pull(pull, out.least.pull_n, Params{}, config, prevention, gripper);
  out.allowed_n = most_allowed_n(out.least, out.grasp, config);
  return out;
}

Pull pull_named(std::string_view name) {
  for (const Pull& pull : named_pulls()) {
    if (pull.name == name) return pull;
  }
  FAIL("no such pull");
  return {};
}

void check_never_lowered(const Grasp& grasp) {
  for (std::size_t i = 1; i < grasp.frames.size() && grasp.frames[i].t_s < kReleaseAt; ++i) {
    CHECK_TRUE(grasp.frames[i].force_counts >= grasp.frames[i - 1].force_counts);
  }
}

}  // namespace

TEST_GROUP(Grip){};

TEST(Grip, TheBookIsLostWithoutPreventionAndTheTaskEndsWithIt) {
  const Pulled without = pulled(pull_named("book"), Prevention::kOff);
  CHECK_TRUE(without.grasp.lost);
  CHECK_EQUAL(0, without.grasp.steps);
  const Pulled with = pulled(pull_named("book"), Prevention::kOn);
  CHECK_FALSE(with.grasp.lost);
  CHECK_TRUE(with.grasp.steps > 0);
  CHECK_TRUE(with.grasp.final_n <= with.allowed_n);
  check_never_lowered(with.grasp);
  // Put down on command, gradually: the gripper is open at the end, and no step was larger than a release step.
  CHECK_FALSE(with.grasp.frames.empty());
  CHECK_EQUAL(0, with.grasp.frames.back().position_counts);
  for (std::size_t i = 1; i < with.grasp.frames.size(); ++i) {
    const int fell = with.grasp.frames[i - 1].force_counts - with.grasp.frames[i].force_counts;
    CHECK_TRUE(fell <= regulator::Config{}.release_step);
  }
}

TEST(Grip, FrictionThatHalvesIsMetWithForce) {
  CHECK_TRUE(pulled(pull_named("friction_halves"), Prevention::kOff).grasp.lost);
  const Pulled with = pulled(pull_named("friction_halves"), Prevention::kOn);
  CHECK_FALSE(with.grasp.lost);
  check_never_lowered(with.grasp);
}

TEST(Grip, ALoadThatIsAddedIsMetWithForce) {
  CHECK_TRUE(pulled(pull_named("load_added"), Prevention::kOff).grasp.lost);
  const Pulled with = pulled(pull_named("load_added"), Prevention::kOn);
  CHECK_FALSE(with.grasp.lost);
  check_never_lowered(with.grasp);
}

TEST(Grip, ABumpDoesNotTrigger) {
  const Pull bump = pull_named("bump");
  const Grasp grasp = pulled(bump, Prevention::kOn).grasp;
  CHECK_FALSE(grasp.lost);
  double least_load_n = 1e9;
  double most_load_n = 0.0;
  int before = -1;
  for (const GraspFrame& frame : grasp.frames) {
    if (frame.t_s < bump.event_s || frame.t_s >= kReleaseAt) continue;
    if (before < 0) before = frame.force_counts;
    CHECK_EQUAL(before, frame.force_counts);
    least_load_n = std::min(least_load_n, frame.load_n);
    most_load_n = std::max(most_load_n, frame.load_n);
  }
  CHECK_TRUE(most_load_n > 1.2 * least_load_n);  // there was a bump
}

// Seeds from 1001 on: 1 to 60 were used for tuning. At 1001 to 1024 none is lost and 22 of 24 are good. Aim: 97 %.
TEST(Grip, RandomPullsEndWithLittleMoreForceThanNeeded) {
  const char* const asked = std::getenv("HOLDFAST_GRIP_PULLS");
  const int pulls = asked != nullptr ? std::atoi(asked) : 12;
  int good = 0;
  int lost = 0;
  for (int i = 0; i < pulls; ++i) {
    Pull pull = random_pull(1001 + static_cast<std::uint64_t>(i));
    pull.inject = scene::Inject::kGrey;
    const Pulled with = pulled(pull, Prevention::kOn);
    check_never_lowered(with.grasp);
    lost += with.grasp.lost ? 1 : 0;
    good += !with.grasp.lost && with.grasp.final_n <= with.allowed_n ? 1 : 0;
  }
  std::printf("%d of %d pulls end within the bound\n", good, pulls);
  LONGS_EQUAL(0, lost);
  CHECK_TRUE(good * 100 >= pulls * 85);
}
