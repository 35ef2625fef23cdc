// SPDX-License-Identifier: Apache-2.0
// The oracles: libjpeg-turbo for what is accepted, and the plain walk for everything, to the error's reason.
// Slices of a few bytes put hundreds of seams into the small pictures of the generator, which a camera's pictures
// have only every 32 KB.
#include "vision/jpeg_fast.hpp"

#include <algorithm>
#include <array>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "drivers/common/crew.hpp"
#include "drivers/sim/scene/picture/render.hpp"
#include "tests/support/host_jpeg_streams.hpp"
#include "vision/jpeg_dc.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using jpeg_dc::Error;
using test::Bytes;
using test::Random;
using test::Recipe;

namespace {

constexpr jpeg_dc::Limits kAnySize{1, 1};
constexpr std::int32_t kWhole = jpeg_fast::kMaxSlice;

// Threads x lanes of the walk, and whether it is the instance for all processors or the one for this.
struct Shape {
  std::size_t threads;
  std::int32_t lanes;
  bool baseline = false;
};
constexpr std::array<Shape, 8> kShapes{
    {{1, 1}, {1, 2}, {1, 3}, {2, 3}, {4, 2}, {1, 1, true}, {1, 2, true}, {2, 3, true}}};

struct Decoded {
  Error error;
  int width;
  int height;
  Bytes pixels;
  friend bool operator==(const Decoded&, const Decoded&) = default;
};

// One of four kinds of damage, somewhere.
Bytes damaged(const Bytes& whole, Random& random, int kind) {
  const std::size_t at = random() % whole.size();
  const std::size_t count = std::min<std::size_t>(1 + random() % 200, whole.size() - at);
  switch (kind % 4) {
    case 0:
      return test::erased(whole, at, count);
    case 1:
      return test::zeroed(whole, at, count);
    case 2:
      return test::changed(whole, at, whole[at] ^ 1 << random() % 8);
    default:
      return {whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(at)};
  }
}

}  // namespace

TEST_GROUP(JpegFast) {
  std::unique_ptr<jpeg_dc::State> plain_state = std::make_unique<jpeg_dc::State>();
  std::unique_ptr<jpeg_fast::State> state = std::make_unique<jpeg_fast::State>();
  std::vector<jpeg_fast::Worker> workers = std::vector<jpeg_fast::Worker>(hal::kMaxWorkers);
  std::unique_ptr<LumaBuffer> out = std::make_unique<LumaBuffer>();
  std::array<std::unique_ptr<drivers::Threads>, hal::kMaxWorkers + 1> crews;

  hal::Crew& crew(std::size_t threads) {
    drivers::Threads::Config config;
    config.workers = threads;
    if (!crews[threads]) crews[threads] = std::make_unique<drivers::Threads>(config);
    return *crews[threads];
  }
  Decoded result(Error error) const {
    if (error != Error::kNone) return {error, 0, 0, {}};
    const auto size = static_cast<std::ptrdiff_t>(out->width) * out->height;
    return {error, out->width, out->height, {out->pixels.begin(), out->pixels.begin() + size}};
  }
  Decoded plain(const Bytes& bytes) {
    (void)jpeg_dc::decode(*plain_state, bytes, *out, kAnySize);
    return result(plain_state->error);
  }
  Decoded fast(const Bytes& bytes, Shape shape = {1, 3}, std::int32_t slice = kWhole) {
    const jpeg_fast::Config config{shape.lanes, slice, std::min(slice, 1024),
                                   shape.baseline ? &jpeg_fast::baseline_walkers() : &jpeg_fast::fastest_walkers()};
    const Status status = jpeg_fast::decode(*state, config, workers, crew(shape.threads), bytes, *out, kAnySize);
    CHECK(status.reason == jpeg_dc::info(state->plain.error).reason);
    return result(state->plain.error);
  }
  // Same samples, or refused by both for the same reason of the seam.
  void check_as_plain(const Bytes& bytes, Shape shape, std::int32_t slice, unsigned seed = 0) {
    const Decoded wanted = plain(bytes);
    const Decoded got = fast(bytes, shape, slice);
    const bool refused =
        wanted.error != Error::kNone && jpeg_dc::info(got.error).reason == jpeg_dc::info(wanted.error).reason;
    if (refused || got == wanted) return;
    FAIL(StringFromFormat("seed %u, %u threads x %d lanes%s, slices of %d: plain %s, fast %s", seed,
                          static_cast<unsigned>(shape.threads), shape.lanes, shape.baseline ? ", baseline" : "", slice,
                          std::string(jpeg_dc::info(wanted.error).name).c_str(),
                          std::string(jpeg_dc::info(got.error).name).c_str())
             .asCharString());
  }
};

TEST(JpegFast, EqualsTheLibraryOnGeneratedStreamsHoweverTheyAreCut) {
  test::Oracle oracle;
  for (unsigned seed = 1; seed <= 6000; ++seed) {
    const Bytes bytes = test::any_stream(seed);
    CHECK(oracle.decode(bytes));
    const Shape shape = kShapes[seed % kShapes.size()];
    const std::int32_t slice = std::array{100, 250, 700, kWhole}[seed / kShapes.size() % 4];
    const Decoded got = fast(bytes, shape, slice);
    if (got == Decoded{Error::kNone, oracle.width, oracle.height, oracle.pixels}) continue;
    FAIL(StringFromFormat("seed %u, %u threads x %d lanes%s, slices of %d: %s", seed,
                          static_cast<unsigned>(shape.threads), shape.lanes, shape.baseline ? ", baseline" : "", slice,
                          std::string(jpeg_dc::info(got.error).name).c_str())
             .asCharString());
  }
  // What the plain walk did again would prove nothing of this one. Random codes and coefficients in slices of a few
  // hundred bytes often find no match before the next slice ends (a third of these pictures); a camera's always do.
  CHECK(state->counts.seams > 2000);
  CHECK(state->counts.by_plain_walk < state->counts.pictures * 2 / 5);
}

TEST(JpegFast, NeverDisagreesWithItselfOrThePlainWalkOnCameraPictures) {
  Bytes rgb;
  const auto check = [&](const scene::PictureConfig& config, int quality, int interval) {
    scene::render_rgb(config, {}, nullptr, static_cast<std::uint64_t>(quality), rgb);
    const Bytes bytes = test::encode_rgb(rgb, config.width, config.height, quality, interval);
    const Decoded wanted = plain(bytes);
    CHECK(wanted.error == Error::kNone);
    const std::uint32_t by_plain = state->counts.by_plain_walk;
    for (const Shape shape : kShapes) CHECK(fast(bytes, shape, kWhole) == wanted);
    LONGS_EQUAL(by_plain, state->counts.by_plain_walk);
  };
  scene::PictureConfig config = scene::camera_3280x2464();
  for (const int quality : {50, 85, 92}) check(config, quality, 0);
  check(config, 85, 205);       // a restart marker for each row of MCUs
  check(config, 85, 205 * 77);  // for each quarter
  config.width = 640;
  config.height = 480;
  check(config, 85, 0);
  check(config, 85, 7);
}

TEST(JpegFast, TakesThePicturesThatHoldTheMostAndTheFewestBits) {
  // Flat: 10 bits a block. White noise: 1 KB an MCU, more than memory holds slices for in a large picture.
  for (const test::Content content : {test::Content::kFlat, test::Content::kNoise}) {
    Recipe recipe;
    recipe.content = content;
    recipe.width = 1640;
    recipe.height = 1232;
    recipe.quality = 95;
    for (const test::Tables tables : {test::Tables::kStandard, test::Tables::kOptimised}) {
      recipe.tables = tables;
      const Bytes bytes = test::encode(recipe);
      const Decoded wanted = plain(bytes);
      CHECK(wanted.error == Error::kNone);
      for (const Shape shape : kShapes) CHECK(fast(bytes, shape, kWhole) == wanted);
    }
  }
}

TEST(JpegFast, RefusesWhatThePlainWalkRefuses) {
  for (unsigned seed = 1; seed <= 1500; ++seed) {
    Random random(seed);
    const Bytes whole = test::any_stream(seed);
    const Shape shape = kShapes[seed % kShapes.size()];
    const std::int32_t slice = std::array{50, 200, kWhole}[seed % 3];
    for (int round = 0; round < 8; ++round) check_as_plain(damaged(whole, random, round), shape, slice, seed);
  }
}

// What the memory has no room for is the plain walk's, and comes out the same.
TEST(JpegFast, LeavesWhatItHasNoMemoryForToThePlainWalk) {
  const auto by_plain = [&](const Bytes& bytes, Error error, std::int32_t slice = kWhole) {
    const std::uint32_t before = state->counts.by_plain_walk;
    const Decoded wanted = plain(bytes);
    CHECK(wanted.error == error);
    CHECK(fast(bytes, {1, 3}, slice) == wanted);
    LONGS_EQUAL(before + 1, state->counts.by_plain_walk);
  };
  Recipe recipe;
  recipe.sampling = {{1, 1}};
  recipe.content = test::Content::kFlat;
  recipe.width = 320;
  recipe.height = 240;
  recipe.restart_interval = 1;  // 1200 slices
  by_plain(test::encode(recipe), Error::kNone);
  recipe.restart_interval = 0;
  Bytes padded = test::encode(recipe);
  padded.resize(padded.size() + (jpeg_fast::kMaxGuesses + 1) * jpeg_fast::kMaxSlice, 0x55);
  padded.insert(padded.end(), {0xFF, 0xD9});
  by_plain(padded, Error::kNone);  // slices that are too long
  recipe.width = 8 * 400;
  recipe.height = 8 * 300;
  by_plain(test::encode(recipe), Error::kNone);  // blocks of a slice: six bits each
  recipe.width = 8 * 420;
  recipe.height = 8 * 310;
  by_plain(test::encode(recipe), Error::kNone);  // blocks of a picture
  // Blocks of 10 bits behind the picture: more than there are values for, though no slice lists too many. Nothing is
  // left for the seams either.
  std::string bits;
  for (std::size_t i = 0; i < jpeg_fast::kMaxValues + 100'000; ++i) bits += "0001111010";
  by_plain(test::grey_by_hand(8, bits), Error::kSpareData);
  bits.resize(10 * (jpeg_fast::kMaxValues + 4000));
  by_plain(test::grey_by_hand(1640, bits), Error::kSpareData, 2048);
}

// Blocks of three zero bits in MCUs of ten, of which eight are luma: begun elsewhere than at a multiple of 30 bits, a
// walk never falls into step. The seam goes on until it has passed all starts of the next slice, or its list is full:
// the latter only where Cr has codes of its own, because pairs of chroma end elsewhere.
TEST(JpegFast, ASeamThatNeverMatchesEnds) {
  Bytes tables(2 + 38, 0);
  const Bytes dht{0xFF, 0xC4, 0, 38, 0x00, 1};  // DC: code 0, of size 0
  std::copy(dht.begin(), dht.end(), tables.begin());
  tables[22] = 0x10;
  tables[24] = 1;  // AC: code 00, the end of the block
  Bytes again = tables;
  again[22] = 0x11;  // the same as AC table 1
  tables.insert(tables.end(), again.begin(), again.end());
  for (int shape = 0; shape < 30; ++shape) {
    const int across = 26 + shape / 2;
    const int rows = 1090 / across;  // two slices, of more than 512 MCUs each
    Recipe recipe;
    recipe.sampling = {{4, 2}, {1, 1}, {1, 1}};
    recipe.width = 32 * across;
    recipe.height = 16 * rows;
    Bytes bytes = test::without(test::encode(recipe), 0xC4);
    bytes.resize(test::data_begin(bytes));
    const std::size_t scan = test::find_segment(bytes, 0xDA);
    for (const std::size_t names : {scan + 6, scan + 8, scan + 10}) bytes[names] = 0;
    bytes[scan + 10] = static_cast<std::uint8_t>(shape % 2);
    bytes.insert(bytes.end(), (static_cast<std::size_t>(across * rows) * 30 + 7) / 8, 0);
    bytes.insert(bytes.end(), {0xFF, 0xD9});
    bytes = test::inserted(bytes, scan, tables);
    const Decoded wanted = plain(bytes);
    CHECK(wanted.error == Error::kNone);
    for (const Shape lanes : {Shape{1, 1}, Shape{1, 2}}) CHECK(fast(bytes, lanes, 2048) == wanted);
    CHECK(state->pairs == (shape % 2 == 0));
  }
  CHECK(state->counts.by_plain_walk > 0);
}

TEST(JpegFast, TakesEverySamplingOfLuma) {
  test::Oracle oracle;
  for (const test::Sampling luma : {test::Sampling{1, 2}, {2, 2}, {3, 2}, {4, 2}, {2, 3}, {2, 4}}) {
    for (const int width : {300, 301, 317}) {
      Recipe recipe;
      recipe.sampling = {luma, {1, 1}, {1, 1}};
      recipe.width = width;
      recipe.height = 203;
      const Bytes bytes = test::encode(recipe);
      CHECK(oracle.decode(bytes));
      CHECK((fast(bytes) == Decoded{Error::kNone, oracle.width, oracle.height, oracle.pixels}));
    }
  }
  LONGS_EQUAL(0, state->counts.by_plain_walk);
}

// Two empty blocks of chroma are one look-up, where there are two that have the same codes, in pictures of few bits.
TEST(JpegFast, WalksSparsePicturesInPairs) {
  test::Oracle oracle;
  std::uint32_t by_plain_walk = 0;
  const auto check = [&](const Recipe& recipe, unsigned seed, bool pairs) {
    const Bytes bytes = test::encode(recipe, seed);
    const Shape shape = kShapes[seed % kShapes.size()];
    const std::int32_t slice = std::array{100, 250, kWhole}[seed % 3];
    CHECK(oracle.decode(bytes));
    const std::uint32_t before = state->counts.by_plain_walk;
    CHECK((fast(bytes, shape, slice) == Decoded{Error::kNone, oracle.width, oracle.height, oracle.pixels}));
    CHECK(state->pairs == pairs);
    if (pairs) by_plain_walk += state->counts.by_plain_walk - before;
    Random random(seed);
    for (int round = 0; round < 8; ++round) check_as_plain(damaged(bytes, random, round), shape, slice, seed);
  };
  const std::array<std::vector<test::Sampling>, 7> samplings{{{{1, 1}, {1, 1}, {1, 1}},
                                                              {{2, 1}, {1, 1}, {1, 1}},
                                                              {{2, 2}, {1, 1}, {1, 1}},
                                                              {{2, 2}, {2, 1}, {1, 2}},
                                                              {{2, 1}, {2, 1}, {2, 1}},
                                                              {{3, 1}, {2, 1}, {1, 1}},
                                                              {{1, 1}}}};
  for (unsigned seed = 1; seed <= 400; ++seed) {
    Recipe recipe;
    recipe.sampling = samplings[seed % samplings.size()];
    recipe.width = 300;
    recipe.height = 200;
    recipe.content = test::Content::kSpecks;
    recipe.tables = seed % 2 == 0 ? test::Tables::kStandard : test::Tables::kOptimised;
    recipe.restart_interval = seed % 5 == 0 ? 37 : 0;
    const bool colour = recipe.sampling.size() == 3;
    check(recipe, seed, colour);
    if (!colour) continue;
    // Not by too many bits, nor where Cr has other codes; with standard tables Cb has the same ones as before.
    recipe.content = test::Content::kCoefficients;
    if (seed % 3 == 0) check(recipe, seed, false);
    recipe.content = test::Content::kSpecks;
    recipe.cr_as_luma = true;
    if (seed % 3 == 1) check(recipe, seed, false);
  }
  CHECK(state->counts.seams > 5000);
  CHECK(by_plain_walk < 150);
}

TEST(JpegFast, RefusesAPictureWithoutData) {
  for (const int fill : {0, 1, 20}) {
    Bytes bytes = test::encode({});
    bytes.resize(test::data_begin(bytes));
    bytes.insert(bytes.end(), static_cast<std::size_t>(fill), 0xFF);
    bytes.insert(bytes.end(), {0xFF, 0xD9});
    CHECK(plain(bytes).error == Error::kMarkerInData);
    CHECK(fast(bytes).error == Error::kMarkerInData);
  }
}

TEST(JpegFast, EveryCutOfASmallPictureIsRefused) {
  for (const int interval : {0, 3}) {
    Recipe recipe;
    recipe.width = 200;
    recipe.height = 100;
    recipe.restart_interval = interval;
    const Bytes whole = test::encode(recipe);
    for (std::size_t size = 0; size < whole.size(); ++size) {
      // A span of exactly this memory, so that a sanitizer sees a read beyond it.
      const Bytes cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
      CHECK(fast(cut, {1, 3}, 100).error != Error::kNone);
    }
    CHECK(fast(whole, {1, 3}, 100) == plain(whole));
  }
}

TEST(JpegFast, LeavesAMarkerInThePaddingToThePlainWalk) {
  Recipe recipe;
  recipe.width = recipe.height = 300;
  Bytes bytes = test::encode(recipe);
  const Decoded wanted = plain(bytes);
  bytes.resize(bytes.size() + 3000, 0x55);
  CHECK(fast(bytes) == wanted);
  LONGS_EQUAL(0, state->counts.by_plain_walk);
  bytes.insert(bytes.end(), {0xFF, 0xD9});
  CHECK(fast(bytes) == wanted);
  LONGS_EQUAL(1, state->counts.by_plain_walk);
}

TEST(JpegFast, MakesTablesOfItsOwnForEveryPairOfCodes) {
  std::vector<Bytes> streams;
  for (const test::Tables tables : {test::Tables::kStandard, test::Tables::kShuffled, test::Tables::kOptimised}) {
    for (const std::size_t components : {std::size_t{1}, std::size_t{3}}) {
      Recipe recipe;
      recipe.width = recipe.height = 120;
      recipe.tables = tables;
      recipe.sampling.assign(components, {1, 1});
      streams.push_back(test::encode(recipe, static_cast<unsigned>(streams.size())));
    }
  }
  for (int round = 0; round < 3; ++round) {
    for (const Bytes& first : streams) {
      for (const Bytes& second : streams) {
        CHECK(fast(first) == plain(first));
        CHECK(fast(second) == plain(second));
      }
    }
  }
}
