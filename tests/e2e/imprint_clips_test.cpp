// SPDX-License-Identifier: Apache-2.0
// The imprint score on every real recording: the firmware's integers beside the definitions in double.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <variant>
#include <vector>

#include "app/app.hpp"
#include "drivers/sim/recording.hpp"
#include "tests/support/host_clips.hpp"
#include "tests/support/imprint_reference.hpp"
#include "tests/support/skip.hpp"
#include "toolchain/play/rig.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;

// The time in which objects are gripped and shaken; the reference takes some ms a frame.
constexpr long kFrom = 90, kTo = 210;
constexpr int kEmptyFrames = 12;

}  // namespace

TEST_GROUP(ImprintClips){};

// Bounds. Samples are rounded to 1/16 level and logarithms to 1/256: of the same patches 99 motions in 100 agree to
// 0.05 of log2 (3.5 %), the weakest reliefs, which change by a level or two, to 0.12. Rounding is 1 to 2 % of G where G
// is near its threshold, and a frame may have four of five patches within a factor of 3 of it: so a few are counted on
// one side only, none further than 15 % from the threshold.
TEST(ImprintClips, EqualsTheReferenceInDoubleOnEveryClip) {
  const auto folder = test::clips_folder();
  if (folder.empty()) {
    test::skip("the real recordings are not beside the clone (../shared/data/real)");
    return;
  }
  std::vector<double> off;
  double disputed = 0.0;
  int clips = 0;
  for (const test::Clip& clip : test::clips_in(folder)) {
    auto opened = sim::Recording::open(clip.path);
    CHECK(!std::holds_alternative<sim::Error>(opened));
    auto& recording = std::get<sim::Recording>(opened);
    auto end = recording.at("last");
    CHECK(!std::holds_alternative<sim::Error>(end));
    const auto& last = std::get<sim::RecordedFrame>(end);
    const pipeline::Config config = pipeline_config(Params{});
    tool::OneThreadDecoder jpeg{Params{}};
    const auto state = std::make_unique<pipeline::State>();
    CHECK(pipeline::learn(*state, config, jpeg.get(), sim::as_frame(last)).ok());

    const auto imprint = std::make_unique<imprint::State>();
    const auto reference = std::make_unique<test::ImprintReference>(config.imprint);
    Saturations saturations;
    // The last frame is the empty gel of most clips; for the comparison it does not matter that some end loaded.
    const auto both = [&](const hal::Frame& frame, const MarkerField& markers, bool empty, Micros now) {
      const LumaView luma{frame.bytes.data(), frame.width, frame.height, frame.stride};
      const reference::State& rest = state->reference;
      const ImprintFeatures seen =
          imprint::update(*imprint, config.imprint, luma, markers, rest.rest, rest.pitch, empty, now, saturations);
      // The empty frames are all the same, so there is no noise above the floor.
      const std::uint32_t threshold = std::uint32_t{imprint::kPairs} * std::uint32_t(config.imprint.contact_floor_q8);
      const auto counted = [&](std::size_t patch, double then_s) {
        const auto* const kept = std::ranges::find_if(imprint->kept, [&](const imprint::Kept& k) {
          return std::abs(1e-6 * double(k.at.count()) - then_s) < 1e-7;
        });
        CHECK(kept != imprint->kept.end());
        return imprint->last.relief[patch] + kept->relief[patch] > 2 * threshold;
      };
      const auto expected =
          reference->update(luma, markers, rest.rest, rest.pitch, empty, 1e-6 * double(now.count()), counted);
      if (empty) return;
      CHECK_TEXT(std::abs(seen.patches.raw() - expected.patches) <= 8, clip.name.c_str());
      disputed = std::max(disputed, expected.disputed);
      const Log2Q8 motions[] = {seen.motion_short, seen.motion, seen.motion_long};
      for (int k = 0; k < 3; ++k) {
        if (expected.close[k]) continue;
        if (expected.motion_um[k] < 10.0) continue;  // below a tenth of a sample it is rounding that is measured
        off.push_back(std::abs(motions[k].raw() / 256.0 - std::log2(expected.motion_um[k])));
      }
    };
    for (int k = 0; k < kEmptyFrames; ++k) {
      both(sim::as_frame(last), state->tracker.field, true, Micros{40'000 * (k - 2 * kEmptyFrames)});
    }
    sim::RecordedFrame frame;
    while (recording.next(frame) == sim::Read::kFrame && frame.index < kTo) {
      if (!pipeline::update(*state, config, jpeg.get(), sim::as_frame(frame)).quality.ok()) continue;
      if (frame.index >= kFrom) both(sim::as_frame(frame), state->tracker.field, false, frame.time);
    }
    ++clips;
  }
  LONGS_EQUAL(27, clips);
  std::sort(off.begin(), off.end());
  const double p99 = off[off.size() * 99 / 100];
  std::printf("\nimprint against double on 27 clips: %zu motions, median %.4f, p99 %.3f, worst %.3f of log2, ",
              off.size(), off[off.size() / 2], p99, off.back());
  std::printf("disputed patches within %.1f %% of the threshold\n", 100.0 * disputed);
  CHECK(off.size() > 3000);
  CHECK(p99 <= 0.05);
  CHECK(off.back() <= 0.12);
  CHECK(disputed <= 0.15);
}
