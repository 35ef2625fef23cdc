// SPDX-License-Identifier: Apache-2.0
#include "params/params.hpp"

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <limits>
#include <string>
#include <string_view>

#include "params/modes.hpp"

#include <CppUTest/TestHarness.h>

using holdfast::kModes;
using holdfast::kParams;
using holdfast::ParamInfo;
using holdfast::ParamProblem;
using holdfast::Params;
using holdfast::Reason;

TEST_GROUP(Params) {
  Params params;
  ParamProblem problem;

  [[nodiscard]] std::string_view failed_name() const {
    return problem.row == nullptr ? "" : problem.row->name;
  }
};

TEST(Params, TheDefaultsAreTheSpecifiedOnes) {
  struct Row {
    std::string_view name;
    std::int32_t value;
  };
  const Row want[] = {{"histogram_range_um", 1900},
                      {"pitch_um", 2020},
                      {"raise_frames", 2},
                      {"hold_ms", 200},
                      {"max_gap_ms", 250},
                      {"degraded_markers_pct", 87},
                      {"fault_markers_pct", 71},
                      {"reference_frames", 10},
                      {"grid_rows", 7},
                      {"grid_cols", 9},
                      {"mode", 0},
                      {"jpeg_threads", 1},
                      {"jpeg_lanes", 3},
                      {"all_features", 0},
                      {"latch", 0},
                      {"opening_max_ms", 5000},
                      {"gripper", 0},
                      {"start_force", 20},
                      {"force_step", 3},
                      {"grow_pct", 3},
                      {"max_force", 255},
                      {"closed_counts", 226},
                      {"release_step", 6},
                      {"grip_speed", 128},
                      {"left_sensor", 0},
                      {"right_sensor", 0},
                      {"lost_finger", 0},
                      {"status_version", 1},
                      {"shear_scale", 0},
                      {"normal_scale", 0}};
  LONGS_EQUAL(std::size(want), kParams.size());
  for (const Row& row : want) {
    const auto* const info =
        std::find_if(kParams.begin(), kParams.end(), [&](const ParamInfo& p) { return p.name == row.name; });
    CHECK_TEXT(info != kParams.end(), row.name.data());
    POINTERS_EQUAL(&*info, holdfast::find_param(row.name));
    LONGS_EQUAL_TEXT(row.value, info->default_value, row.name.data());
    LONGS_EQUAL_TEXT(row.value, params.*info->member, row.name.data());
  }
}

TEST(Params, EveryRowIsComplete) {
  for (std::size_t i = 0; i < kParams.size(); ++i) {
    const ParamInfo& row = kParams[i];
    CHECK_TEXT(!row.help.empty() && !row.price.empty(), row.name.data());
    CHECK_TEXT(row.min < row.max, row.name.data());
    for (std::size_t other = 0; other < i; ++other) {
      CHECK_TRUE(row.name != kParams[other].name);
      CHECK_TRUE(row.member != kParams[other].member);
    }
  }
}

TEST(Params, EachEndOfEachRangeIsAcceptedAndOneBeyondIsNamed) {
  for (const ParamInfo& row : kParams) {
    for (const bool low : {true, false}) {
      params = {};
      // Room for the rules between parameters while one of them stands at its end.
      params.fault_markers_pct = 1;
      params.degraded_markers_pct = 100;
      params.grid_rows = params.grid_cols = 8;
      params.start_force = 0;
      params.*row.member = low ? row.min : row.max;
      CHECK_TEXT(holdfast::validate(params, &problem).ok(), row.name.data());
      params.*row.member += low ? -1 : 1;
      CHECK_TRUE(holdfast::validate(params, &problem).reason == Reason::kConfig);
      CHECK_TRUE(failed_name() == row.name);
      params.*row.member = low ? std::numeric_limits<std::int32_t>::min() : std::numeric_limits<std::int32_t>::max();
      CHECK_FALSE(holdfast::validate(params).ok());
    }
  }
}

TEST(Params, ContradictionsAreNamed) {
  params.start_force = params.max_force = 100;
  CHECK_TRUE(holdfast::validate(params).ok());
  params.max_force = 99;
  CHECK_FALSE(holdfast::validate(params, &problem).ok());
  CHECK_TRUE(failed_name() == "start_force");
  params = {};
  params.fault_markers_pct = 88;
  CHECK_FALSE(holdfast::validate(params, &problem).ok());
  CHECK_TRUE(failed_name() == "fault_markers_pct");
  params = {};
  params.grid_rows = 8;
  params.grid_cols = 16;
  CHECK_TRUE(holdfast::validate(params).ok());
  params.grid_rows = 9;
  CHECK_FALSE(holdfast::validate(params, &problem).ok());
  CHECK_TRUE(failed_name() == "grid_cols");
}

TEST(Params, ParseSetsTheNamedOneAndNothingElse) {
  for (const ParamInfo& row : kParams) {
    Params changed;
    CHECK_TRUE(holdfast::parse(row.name, std::to_string(row.min), changed).ok());
    for (const ParamInfo& other : kParams) {
      LONGS_EQUAL(&other == &row ? row.min : other.default_value, changed.*other.member);
    }
  }
}

TEST(Params, ParseRefusesWhatIsNotAnIntegerInRangeAndChangesNothing) {
  for (const std::string_view text :
       {"", " 3", "3 ", "+3", "3.0", "0x3", "three", "fast", "0", "11", "-1", "2147483648", "99999999999999999999"}) {
    CHECK_TEXT(holdfast::parse("raise_frames", text, params, &problem).reason == Reason::kConfig, text.data());
    CHECK_TRUE(failed_name() == "raise_frames");
    CHECK_TRUE(params == Params{});
  }
  CHECK_FALSE(holdfast::parse("raise_frame", "3", params, &problem).ok());
  POINTERS_EQUAL(nullptr, problem.row);
}

TEST(Params, ModesHaveNamesAndGrowMorePrecise) {
  for (std::size_t i = 0; i < kModes.size(); ++i) {
    CHECK_TRUE(holdfast::find_mode(kModes[i].name) == static_cast<std::int32_t>(i));
    CHECK_TRUE(holdfast::parse("mode", kModes[i].name, params).ok());
    LONGS_EQUAL(i, params.mode);
    if (i > 0) CHECK_TRUE(kModes[i].scale < kModes[i - 1].scale);
  }
  CHECK_FALSE(holdfast::find_mode("Fast").has_value());
  CHECK_FALSE(holdfast::parse("raise_frames", "fast", params).ok());
}

// What may be set at the console of a device with an owner, and nothing else: a new row is safety until somebody has
// written it down here.
TEST(Params, AreSafetyUnlessTheyCannotTurnAFaultIntoFine) {
  const std::string_view tuning[] = {"jpeg_threads", "jpeg_lanes",   "start_force", "force_step",
                                     "grow_pct",     "release_step", "grip_speed"};
  const std::string_view display[] = {"all_features", "status_version", "shear_scale", "normal_scale"};
  for (const ParamInfo& row : kParams) {
    const bool tunes = std::find(std::begin(tuning), std::end(tuning), row.name) != std::end(tuning);
    const bool shows = std::find(std::begin(display), std::end(display), row.name) != std::end(display);
    const auto wanted = tunes   ? holdfast::ParamClass::kTuning
                        : shows ? holdfast::ParamClass::kDisplay
                                : holdfast::ParamClass::kSafety;
    CHECK_TEXT(row.kind == wanted, row.name.data());
    CHECK_TEXT(!row.why.empty(), row.name.data());
  }
}
