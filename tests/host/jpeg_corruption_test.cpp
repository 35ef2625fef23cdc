// SPDX-License-Identifier: Apache-2.0
// A short run of the corruption campaign (bench/jpeg_corruption.cpp): no frame with lost payload passes for a whole
// one.
#include "tests/support/host_jpeg_damage.hpp"

#include <algorithm>
#include <array>
#include <string>
#include <variant>
#include <vector>

#include "drivers/sim/recording.hpp"
#include "tests/support/host_clips.hpp"
#include "tests/support/skip.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::test;

TEST_GROUP(JpegCorruption){
    static void check_sums(const DamageFigures& figures, long frames){LONGS_EQUAL(frames, figures.frames);
for (const Tally& tally : {figures.ours, figures.checked, figures.library, figures.both}) {
  CHECK(tally.harmful <= tally.different);
}
LONGS_EQUAL(frames, figures.ours.rejected + figures.ours.identical + figures.ours.different);
}
static DamagedFilm tracked_film(int width, int restart_interval, int shots) {
  DamagedFilm out = film(width, restart_interval, shots);
  STRCMP_EQUAL("", out.error.c_str());
  return out;
}
}
;

TEST(JpegCorruption, DamageIsWhatItsNameSays) {
  const DamagedFilm shots = tracked_film(640, 0, 1);
  const Bytes& whole = shots.shots[0].bytes;
  Random random(1);
  for (int round = 0; round < 50; ++round) {
    for (const Damage damage : kDamages) {
      const Bytes bytes = damaged(whole, damage, random);
      const auto begin = static_cast<std::ptrdiff_t>(data_begin(whole));
      CHECK(std::equal(whole.begin(), whole.begin() + begin, bytes.begin()));  // the headers stay
      const bool has_end = bytes[bytes.size() - 2] == 0xFF && bytes.back() == 0xD9;
      if (damage == Damage::kLost512) LONGS_EQUAL(whole.size() - 512, bytes.size());
      if (damage == Damage::kLost3072) LONGS_EQUAL(whole.size() - 3072, bytes.size());
      if (damage == Damage::kTruncated) CHECK(bytes.size() < whole.size() - 2);
      CHECK(has_end == (damage != Damage::kTruncated));
      if (damage != Damage::kZeroed512 && damage != Damage::kBitFlipped && damage != Damage::kByteChanged) continue;
      LONGS_EQUAL(whole.size(), bytes.size());
      int others = 0;
      for (std::size_t i = 0; i < whole.size(); ++i) others += whole[i] != bytes[i] ? 1 : 0;
      CHECK(others >= 1 && others <= (damage == Damage::kZeroed512 ? 512 : 1));
    }
  }
}

TEST(JpegCorruption, NoLostPayloadPasses) {
  for (const int restart_interval : {0, 4}) {
    const DamagedFilm at_640 = tracked_film(640, restart_interval, 4);
    const DamagedFilm at_3280 = tracked_film(3280, restart_interval, 1);
    for (const Damage damage : kDamages) {
      if (!is_loss(damage)) continue;
      const DamageFigures small = judge(at_640, damage, 0, 100, 1, 2);
      check_sums(small, 100);
      LONGS_EQUAL(0, small.losses_passed);
      LONGS_EQUAL(0, small.ours.different);
      LONGS_EQUAL(0, small.both.harmful);
      const DamageFigures large = judge(at_3280, damage, 0, 10, 1, 2);
      check_sums(large, 10);
      LONGS_EQUAL(0, large.losses_passed);
      LONGS_EQUAL(0, large.ours.different);
    }
  }
}

// The campaign is able to see harm.
TEST(JpegCorruption, SeesWhatFlippedBitsDo) {
  const DamagedFilm shots = tracked_film(640, 0, 4);
  const DamageFigures figures = judge(shots, Damage::kBitFlipped, 0, 600, 1, 2);
  check_sums(figures, 600);
  CHECK(figures.library.different > 300);
  CHECK(figures.library.harmful > 0);
  CHECK(figures.both.different <= figures.library.different);
  CHECK(figures.both.harmful <= figures.library.harmful);
  LONGS_EQUAL(0, figures.losses_passed);
}

// The check takes nothing away but damage. In the campaign's 10 000 frames it leaves none that is harmful.
TEST(JpegCorruption, PictureCheckFindsWhatMisleadsTheTracking) {
  const DamagedFilm shots = tracked_film(3280, 0, 4);
  DamageFigures figures = judge(shots, Damage::kBitFlipped, 0, 400, 1, 2);
  figures += judge(shots, Damage::kByteChanged, 0, 400, 1, 2);
  check_sums(figures, 800);
  LONGS_EQUAL(800, figures.checked.rejected + figures.checked.identical + figures.checked.different);
  CHECK(figures.ours.harmful >= 5);
  LONGS_EQUAL(0, figures.checked.harmful);
  CHECK(figures.checked.different < figures.ours.different);
  LONGS_EQUAL(figures.ours.identical, figures.checked.identical);
}

TEST(JpegCorruption, DoesNotDependOnThreads) {
  const DamagedFilm shots = tracked_film(640, 4, 2);
  const DamageFigures alone = judge(shots, Damage::kByteChanged, 5, 60, 3, 1);
  const DamageFigures three = judge(shots, Damage::kByteChanged, 5, 60, 3, 3);
  LONGS_EQUAL(alone.ours.rejected, three.ours.rejected);
  LONGS_EQUAL(alone.library.harmful, three.library.harmful);
  LONGS_EQUAL(alone.both.different, three.both.different);
}

TEST_GROUP(PictureCheckOnClips){};

// The clips' 320x240 stand for working images at every decode scale: the 410x308 of the camera at 1/8 (blocks of one
// pixel, though their detail is finer than a block's mean) to themselves (blocks of eight).
TEST(PictureCheckOnClips, NoFrameIsRefused) {
  const auto folder = clips_folder();
  if (folder.empty()) {
    skip("the real recordings are not beside the clone (../shared/data/real)");
    return;
  }
  constexpr std::array<std::int32_t, 4> kBlocks{1, 2, 4, 8};
  std::vector<picture_check::State> states(kBlocks.size());
  for (const Clip& clip : clips_in(folder)) {
    for (picture_check::State& state : states) state = {};
    auto opened = sim::Recording::open(clip.path);
    CHECK_TEXT(std::holds_alternative<sim::Recording>(opened), clip.name.c_str());
    auto& recording = std::get<sim::Recording>(opened);
    sim::RecordedFrame frame;
    int frames = 0;
    for (; recording.next(frame) == sim::Read::kFrame; ++frames) {
      const LumaView luma{frame.bytes.data(), frame.width, frame.height, frame.width};
      for (std::size_t i = 0; i < kBlocks.size(); ++i) {
        CHECK_TEXT(picture_check::update(states[i], {}, luma, kBlocks[i]).ok(), clip.name.c_str());
      }
    }
    LONGS_EQUAL(450, frames);
  }
}
