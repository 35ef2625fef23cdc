// SPDX-License-Identifier: Apache-2.0
#include "vision/jpeg_decoder.hpp"

#include <array>
#include <memory>

#include "drivers/common/jpeg_turbo.hpp"
#include "tests/support/host_jpeg_streams.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using jpeg_dc::Error;
using test::Bytes;
using test::encode;
using test::Recipe;

TEST_GROUP(EighthDecoder){};

TEST(EighthDecoder, ServesOneEighthByEitherWalkAndPassesOtherScalesOn) {
  auto turbo = std::make_unique<drivers::TurboJpegDecoder>();
  const auto worker = std::make_unique<jpeg_fast::Worker>();
  hal::Alone crew;
  const auto out = std::make_unique<LumaBuffer>();
  const auto expected = std::make_unique<LumaBuffer>();
  for (const auto walk : {EighthDecoder::Walk::kPlain, EighthDecoder::Walk::kFast}) {
    const auto ours =
        std::make_unique<EighthDecoder>(EighthDecoder::Config{walk, {}, {}}, *turbo, std::span(worker.get(), 1), crew);
    Recipe recipe;
    recipe.width = 1000;
    recipe.height = 700;
    const Bytes bytes = encode(recipe);
    for (const auto scale : {DecodeScale::kFull, DecodeScale::kHalf, DecodeScale::kQuarter, DecodeScale::kEighth}) {
      CHECK(turbo->decode(bytes, scale, *expected).ok());
      CHECK(ours->decode(bytes, scale, *out).ok());
      LONGS_EQUAL(expected->width, out->width);
      LONGS_EQUAL(expected->height, out->height);
      MEMCMP_EQUAL(expected->pixels.data(), out->pixels.data(), static_cast<std::size_t>(out->width * out->height));
    }
    LONGS_EQUAL(walk == EighthDecoder::Walk::kFast ? 1 : 0, ours->counts().pictures);
    recipe.colours = test::Colours::kRgb;  // the library takes these, we do not: so it is seen who decodes
    const Bytes rgb = encode(recipe);
    CHECK(ours->decode(rgb, DecodeScale::kQuarter, *out).ok());
    CHECK(ours->decode(rgb, DecodeScale::kEighth, *out).reason == Reason::kFrameFormat);
    CHECK(ours->last_error() == Error::kColourSpace);
  }
}
