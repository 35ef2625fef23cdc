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
constexpr int kFramesBefore = 12;

}  // namespace

TEST_GROUP(ImprintClips){};

// Bounds. Patches and the noise's rank: see ImprintReference::kRanks. Logarithms are rounded down to 1/256: 2/256 for a
// motion, of which one is that of the pitch, and 1/256 for growth; another 1/256 is for samples rounded to 1/16 level.
TEST(ImprintClips, EqualsTheReferenceInDoubleOnEveryClip) {
  const auto folder = test::clips_folder();
  if (folder.empty()) {
    test::skip("the real recordings are not beside the clone (../shared/data/real)");
    return;
  }
  std::vector<double> off, plain, grown, counted, turned;
  int coarse = 0;
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
          imprint::update(*imprint, config.imprint, luma, markers, rest.rest, rest.pitch, now, saturations);
      if (empty) imprint::learn_empty(*imprint, config.imprint);
      const auto expected = reference->update(luma, markers, rest.rest, rest.pitch, empty, 1e-6 * double(now.count()));
      if (empty) return;
      const char* const name = clip.name.c_str();
      CHECK_TEXT(seen.patches.raw() >= expected.least_patches && seen.patches.raw() <= expected.most_patches, name);
      counted.push_back(std::abs(seen.patches.raw() - expected.patches));
      grown.push_back(std::abs(seen.growth.raw() / 256.0 - expected.growth));
      if (expected.tells_turnover()) turned.push_back(std::abs(seen.turnover.raw() / 1024.0 - expected.turnover));
      if (expected.tells_coarse()) {
        CHECK_EQUAL_TEXT(expected.coarse_um > 1.0, seen.coarse.raw() > 0, name);
        ++coarse;
      }
      CHECK_TEXT(test::ImprintReference::may_move(expected, seen.motion.raw()), name);
      if (seen.motion.raw() == 0 || expected.motion_um < 10.0) return;  // less is rounding, too
      off.push_back(test::ImprintReference::off(expected, seen.motion.raw()));
      plain.push_back(std::abs(seen.motion.raw() / 256.0 - std::log2(expected.motion_um)));
    };
    for (int k = 0; k < kFramesBefore; ++k) {
      both(sim::as_frame(last), state->tracker.field, true, Micros{40'000 * (k - 2 * kFramesBefore)});
    }
    sim::RecordedFrame frame;
    while (recording.next(frame) == sim::Read::kFrame && frame.index < kTo) {
      if (!pipeline::update(*state, config, jpeg.get(), sim::as_frame(frame)).quality.ok()) continue;
      if (frame.index >= kFrom) both(sim::as_frame(frame), state->tracker.field, false, frame.time);
    }
    ++clips;
  }
  LONGS_EQUAL(27, clips);
  for (std::vector<double>* const all : {&off, &plain, &grown, &counted, &turned}) std::sort(all->begin(), all->end());
  const auto p50 = [](const std::vector<double>& sorted) { return sorted[sorted.size() / 2]; };
  const auto p99 = [](const std::vector<double>& sorted) { return sorted[sorted.size() * 99 / 100]; };
  std::printf("\nimprint against double on 27 clips: %zu motions, median %.4f of log2, ", off.size(), p50(plain));
  std::printf("worst %.4f beyond other ranks of the noise; growth p99 %.4f, worst %.4f; ", off.back(), p99(grown),
              grown.back());
  std::printf("turnover p99 %.4f, worst %.4f of %zu; ", p99(turned), turned.back(), turned.size());
  std::printf("patches median %.0f, worst %.0f; %d frames without coarse motion\n", p50(counted), counted.back(),
              coarse);
  CHECK(off.size() > 1000);
  CHECK(coarse > 1000);
  CHECK(off.back() <= 3.0 / 256);
  CHECK(p50(plain) <= 0.01);
  CHECK(p99(grown) <= 2.0 / 256);
  CHECK(grown.back() <= 4.0 / 256);
  CHECK(turned.size() > 1000);
  CHECK(p99(turned) <= 0.01);
  CHECK(turned.back() <= 0.05);  // its noise is of one patch, whose rank rounding may change
  CHECK(p50(counted) <= 1.0);
}
