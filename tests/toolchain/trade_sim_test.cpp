// SPDX-License-Identifier: Apache-2.0
// The prices of the simulator's levels: what each way into the firmware must and must not change.
#include "toolchain/trade/trade_sim.hpp"

#include "drivers/sim/scene/scenes.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

using namespace holdfast;

TEST_GROUP(TradeSim){};

TEST(TradeSim, EveryWayInTellsTheSameStory) {
  scene::Scene scene = scene::sphere_slip();
  scene.duration_s = 1.6;
  const auto prices = tool::price_entries(scene);
  LONGS_EQUAL(scene::kInjectNames.size(), prices.size());
  for (std::size_t i = 0; i < prices.size(); ++i) {
    const tool::EntryPrice& price = prices[i];
    CHECK_TRUE(price.entry == scene::kInjectNames[i]);
    CHECK_TRUE(price.frames > 10);
    LONGS_EQUAL(0, price.refused);
    // What pictures and tracking add: measured 0.006 nat.
    CHECK_TRUE(price.entropy_nat < 0.02);
    CHECK_EQUAL(i >= 2, price.rms_px.has_value());
    if (i >= 2) CHECK_TRUE(*price.rms_px > 0.001 && *price.rms_px < 0.03);
  }
  // Places in micrometres are the same to the unit, pictures are not.
  DOUBLES_EQUAL(0.0, prices[0].entropy_nat, 0.0);
  CHECK_TRUE(prices[2].entropy_nat > 0.0);
  // Rendering and coding eight million pixels is dear: nothing that noise of the clock could turn round.
  CHECK_TRUE(prices[3].us_p50 > 10.0 * prices[2].us_p50);
}

TEST(TradeSim, TheFinestGridIsTheReference) {
  scene::Scene scene = scene::sphere_slip();
  scene.duration_s = 1.0;
  tool::TradeSimConfig config;
  config.reference_cell_mm = 0.7;
  config.repeats = 1;
  const auto prices = tool::price_levels(scene, config);
  DOUBLES_EQUAL(0.0, prices.back().rms_px, 0.0);
  CHECK_TRUE(prices.front().level == "springs 8");
}
