// SPDX-License-Identifier: Apache-2.0
// The real recordings: every marker followed, none swapped, none trembling; features as a plain double says.
#include <cmath>
#include <cstdio>

#include "base/math.hpp"
#include "tests/support/host_clips.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/skip.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;

// Every fifth frame is shown to OpenCV's detector: 5 ms each are half of the test's time. `real_clips` judges all.
constexpr int kStride = 5;

}  // namespace

TEST_GROUP(RealClips){};

TEST(RealClips, EveryMarkerIsFollowedAndNoneIsSwapped) {
  const auto folder = test::clips_folder();
  if (folder.empty()) {
    test::skip("the real recordings are not beside the clone (../shared/data/real)");
    return;
  }
  std::vector<test::ClipFigures> all;
  for (const test::Clip& clip : test::clips_in(folder)) {
    all.push_back(test::follow(clip, kStride));
    const test::ClipFigures& f = all.back();
    STRCMP_EQUAL("", f.error.c_str());
    LONGS_EQUAL(450, f.frames);
    LONGS_EQUAL_TEXT(0, f.order_inversions, f.name.c_str());
    LONGS_EQUAL_TEXT(0, f.not_home, f.name.c_str());
    CHECK_TEXT(f.frames_all_confirmed * 100 >= f.frames_judged * 97, f.name.c_str());
    // One dot beside the avocado's rim is dragged by its shadow by 2 px, and lost in 5 frames (tracker.cpp).
    CHECK_TEXT(f.frames_all_valid * 100 >= f.frames * 98, f.name.c_str());
  }
  LONGS_EQUAL(27, all.size());
  long frames = 0, found = 0, judged = 0, confirmed = 0;
  for (const test::ClipFigures& f : all) {
    frames += f.frames;
    found += f.frames_all_valid;
    judged += f.frames_judged;
    confirmed += f.frames_all_confirmed;
  }
  CHECK(confirmed * 100 >= judged * 99);
  CHECK(found * 1000 >= frames * 999);
  // px at 320x240, over all empty intervals; the recordings' key frames alone move dots by some hundredths.
  CHECK(test::jitter_x_px(all) <= 0.06);
  CHECK(test::jitter_y_px(all) <= 0.06);
}

namespace {

struct Compared {
  reference_model::Model from_micrometres;  // the stage alone: displacements as the firmware rounded them
  reference_model::Model from_pixels;       // the whole chain, from positions
  double worst_v_um_s = 0, worst_entropy_nat = 0, worst_rate_nat_s = 0;  // stage
  double worst_chain_v_um_s = 0;
  long frames = 0, other_histogram = 0, other_bin_in_chain = 0;
};

void compare(const test::FrameSeen& seen, void* context) {
  auto& to = *static_cast<Compared*>(context);
  if (!seen.result->quality.ok() || !seen.result->referenced) return;
  const Features& f = seen.result->features;
  const DisplacementField& field = seen.state->displacement;
  const MarkerField& now = seen.state->tracker.field;
  const MarkerField& rest = seen.state->reference.rest;
  reference_model::Displacements micrometres;
  reference_model::Positions at, home;
  for (int i = 0; i < field.grid.count(); ++i) {
    const MarkerDisplacement& d = field.markers[idx(i)];
    micrometres.emplace_back();
    if (d.valid) micrometres.back() = {static_cast<double>(d.dx.raw()), static_cast<double>(d.dy.raw())};
    const auto position = [](const Marker& m) -> std::optional<reference_model::Point> {
      if (!m.valid) return std::nullopt;
      return reference_model::Point{m.x.raw() / 256.0, m.y.raw() / 256.0};
    };
    at.push_back(position(now.markers[idx(i)]));
    home.push_back(position(rest.markers[idx(i)]));
  }
  const std::int64_t t_us = seen.result->timestamp.count();
  const auto stage = to.from_micrometres.update(micrometres, t_us);
  const auto chain = to.from_pixels.update(at, home, seen.state->reference.pitch.raw() / 256.0, t_us);
  ++to.frames;
  for (std::size_t bin = 0; bin < f.histogram.size(); ++bin) {
    if (stage.histogram[bin] != f.histogram[bin]) ++to.other_histogram;
  }
  to.other_bin_in_chain += chain.histogram == stage.histogram ? 0 : 1;
  const auto worse = [](double& worst, double a, double b) { worst = std::max(worst, std::fabs(a - b)); };
  worse(to.worst_entropy_nat, f.entropy.raw() / 65536.0, stage.entropy_nat);
  worse(to.worst_v_um_s, f.vx.raw(), stage.vx_um_s);
  worse(to.worst_v_um_s, f.vy.raw(), stage.vy_um_s);
  worse(to.worst_rate_nat_s, f.entropy_rate.raw() / 256.0, stage.entropy_rate_nat_s);
  worse(to.worst_chain_v_um_s, f.vx.raw(), chain.vx_um_s);
  worse(to.worst_chain_v_um_s, f.vy.raw(), chain.vy_um_s);
}

}  // namespace

TEST(RealClips, FeaturesAreThoseOfAPlainDouble) {
  const auto folder = test::clips_folder();
  if (folder.empty()) {
    test::skip("the real recordings are not beside the clone (../shared/data/real)");
    return;
  }
  Compared worst;
  for (const test::Clip& clip : test::clips_in(folder)) {
    Compared one;
    const test::ClipFigures f = test::follow(clip, 1 << 30, compare, &one);
    STRCMP_EQUAL("", f.error.c_str());
    LONGS_EQUAL(450, one.frames);
    worst.worst_v_um_s = std::max(worst.worst_v_um_s, one.worst_v_um_s);
    worst.worst_entropy_nat = std::max(worst.worst_entropy_nat, one.worst_entropy_nat);
    worst.worst_rate_nat_s = std::max(worst.worst_rate_nat_s, one.worst_rate_nat_s);
    worst.worst_chain_v_um_s = std::max(worst.worst_chain_v_um_s, one.worst_chain_v_um_s);
    worst.other_histogram += one.other_histogram;
    worst.other_bin_in_chain += one.other_bin_in_chain;
    worst.frames += one.frames;
  }
  std::printf(
      "\n%ld frames: stage V %.3f um/s, E %.2e nat, rate %.4f nat/s; chain V %.2f um/s, %ld frames with "
      "another bin\n",
      worst.frames, worst.worst_v_um_s, worst.worst_entropy_nat, worst.worst_rate_nat_s, worst.worst_chain_v_um_s,
      worst.other_bin_in_chain);
  // The stage sees the same integers: the histogram is exact; V is rounded once (0.5 um/s); E has half an LSB
  // of Q16 and 1.1 LSB of Q24; its rate half an LSB of Q8 and twice the error of E over 40 ms.
  LONGS_EQUAL(0, worst.other_histogram);
  CHECK(worst.worst_v_um_s <= 0.5 + 1e-6);
  CHECK(worst.worst_entropy_nat <= 0.5 / 65536 + 1.1 / 16777216);
  CHECK(worst.worst_rate_nat_s <= 0.5 / 256 + 2 * 1.1 / 16777216 / 0.04);
  // The chain rounds each displacement to 1 um: V is off by at most 2 * 0.5 um in 40 ms, and half an LSB.
  CHECK(worst.worst_chain_v_um_s <= 1.0 / 0.04 + 0.5);
}
