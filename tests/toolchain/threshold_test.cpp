// SPDX-License-Identifier: Apache-2.0
// Thresholds, and the model that is made of them, on made-up recordings whose answers are known.
#include "toolchain/learn/threshold.hpp"

#include <algorithm>
#include <string>
#include <vector>

#include "slip/model.hpp"
#include "slip/tree_io.hpp"
#include "tests/support/folders.hpp"
#include "tests/support/temp_dir.hpp"
#include "toolchain/learn/fuse.hpp"
#include "toolchain/treec/tree_model.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::learn;

namespace {

const std::size_t kMotion = feature_index("imprint_log2_um_q8");
const std::size_t kPatches = feature_index("imprint_patches");
const std::size_t kContact = feature_index("contact");
constexpr int kRaise = 2;

// A clip of 100 frames: empty to 20, held to 60, slip to 80, open; the imprint moves by `still` and by `slips`.
void add_clip(Samples& samples, const std::string& object, int still, int slips) {
  Trial trial;
  trial.source = Source::kRecorded;
  trial.object = object;
  trial.kind = "clip";
  trial.seed = samples.trials.size();
  trial.first = static_cast<int>(samples.rows.size());
  trial.count = 100;
  for (int k = 0; k < trial.count; ++k) {
    Row row;
    row.trial = static_cast<int>(samples.trials.size());
    row.frame = k;
    row.t_s = 0.04 * k;
    row.label = k < 20 ? Label::kEmpty : k < 60 ? Label::kHold : k < 80 ? Label::kSlip : Label::kOpen;
    row.x[kContact] = k < 20 ? 0 : 1;
    row.x[kPatches] = k < 20 ? 0 : 40;
    // The empty gel's noise is larger than any motion, a single held frame is larger still.
    row.x[kMotion] = k < 20 ? 3000 : k == 40 ? 2500 : k < 60 ? still - (k % 10 == 1 ? 0 : 300) : slips;
    if (k % 10 == 2 && k > 20 && k < 60) row.x[kMotion] = still;  // two in a row: 31 and 32, and so on
    samples.rows.push_back(row);
  }
  samples.trials.push_back(trial);
}

Samples three() {
  Samples samples;
  add_clip(samples, "cup", 1500, 1800);
  add_clip(samples, "pen", 1600, 1800);
  add_clip(samples, "box", 1400, 1550);
  return samples;
}

double lowest(const Samples& samples, const Budget& budget, const std::vector<int>& trials = {0, 1, 2}) {
  return threshold_of(samples, imprint_motions(samples), trials, budget, kRaise);
}

treec::Model marker_tree() {
  treec::Model model;
  model.name = "markers";
  model.feature_set = "field";
  const FeatureSet& set = *find_feature_set("field");
  for (int i = 0; i < set.size(); ++i) {
    model.features.push_back({std::string(set[i].name), std::string(set[i].unit), set[i].q, 0});
  }
  model.nodes.resize(3);
  model.nodes[0] = {.id = 0, .feature = 0, .threshold = 500, .child_true = 1, .child_false = 2};
  model.nodes[1] = {.id = 1, .is_leaf = true, .verdict = Verdict::kHold};
  model.nodes[2] = {.id = 2, .is_leaf = true, .verdict = Verdict::kSlip};
  CHECK(!treec::check(model));
  return model;
}

}  // namespace

TEST_GROUP(Threshold){};

// R: binom.test(12, 14), (0, 10), (10, 10).
TEST(Threshold, ShareIntervalIsClopperAndPearsons) {
  DOUBLES_EQUAL(0.5718709, share_interval(12, 14).low, 1e-6);
  DOUBLES_EQUAL(0.9822055, share_interval(12, 14).high, 1e-6);
  DOUBLES_EQUAL(0.0, share_interval(0, 10).low, 0.0);
  DOUBLES_EQUAL(0.3084971, share_interval(0, 10).high, 1e-6);
  DOUBLES_EQUAL(0.6915029, share_interval(10, 10).low, 1e-6);
  DOUBLES_EQUAL(1.0, share_interval(10, 10).high, 0.0);
}

// Of three clips with 1.6 s of silence each.
constexpr double kNever = 1.0;
constexpr double kFourTimes = 4.8 / 60.0 / 4.0;

// A single frame raises nothing, the empty gel is not in contact: the largest value that comes twice in a row decides.
TEST(Threshold, IsTheLowestThatStaysSilent) {
  const Samples samples = three();
  DOUBLES_EQUAL(1600, lowest(samples, {kNever, 0.0}), 0.0);
  DOUBLES_EQUAL(1616, lowest(samples, {kNever, 16.0}), 0.0);
  DOUBLES_EQUAL(1500, lowest(samples, {kNever, 0.0}, {0, 2}), 0.0);
  // The pen alarms at 22, 32, 41 and 52, which is as often as it may; the cup would add four.
  DOUBLES_EQUAL(1500, lowest(samples, {kFourTimes, 0.0}), 0.0);
}

TEST(Threshold, EachObjectIsJudgedByTheOthers) {
  const Samples samples = three();
  const RecordedScore score = leave_one_out(samples, {kNever, 0.0}, kRaise);
  LONGS_EQUAL(3, score.onsets);
  LONGS_EQUAL(2, score.within_10.fresh);  // the box moves by 1550, the others hold at 1600
  LONGS_EQUAL(1, score.hits);             // the pen's last false alarm is up until just before its slip
  LONGS_EQUAL(4, score.held.alarms);      // the pen by the threshold of the cup
  LONGS_EQUAL(0, score.empty.alarms);
  DOUBLES_EQUAL(3 * 19 * 0.04, score.empty.s, 1e-9);
}

TEST_GROUP(Fuse){};

TEST(Fuse, ImprintDecidesWhereThereIsReliefAndMarkersWhereThereIsNone) {
  Samples samples = three();
  for (Row& row : samples.rows) {
    if (row.x[kMotion] == 2500) row.x[kMotion] = 1000;
  }
  Fused fused;
  CHECK(!fuse(samples, marker_tree(), "both", fused));
  LONGS_EQUAL(1608, fused.threshold);
  const model::Tree tree = treec::to_table(fused.model);
  struct Seen {
    int motion, growth, patches, flow, reach, coarse = 0;
  };
  const auto says = [&](const Seen& seen) {
    std::vector<std::int32_t> x(static_cast<std::size_t>(tree.set->size()));
    for (int i = 0; i < tree.set->size(); ++i) {
      const std::string_view name = (*tree.set)[i].name;
      if (name == "imprint_log2_um_q8") x[static_cast<std::size_t>(i)] = seen.motion;
      if (name == "imprint_growth_log2_q8") x[static_cast<std::size_t>(i)] = seen.growth;
      if (name == "imprint_coarse_log2_um_q8") x[static_cast<std::size_t>(i)] = seen.coarse;
      if (name == "imprint_patches") x[static_cast<std::size_t>(i)] = seen.patches;
      if (name == "flow_residual_um_s") x[static_cast<std::size_t>(i)] = seen.flow;
      if (name == "reach_um") x[static_cast<std::size_t>(i)] = seen.reach;
    }
    return model::evaluate(tree, x);
  };
  CHECK(says({1609, kMostGrowth, 40, 0, 0}) == Verdict::kSlipNow);
  CHECK(says({1609, kMostGrowth + 1, 40, 0, 0}) == Verdict::kHold);  // a contact that is being made
  CHECK(says({1608, 0, 40, 0, 0}) == Verdict::kHold);
  const int flows = kLeastFlow_um_s + 1;
  CHECK(says({1000, 0, kMostPatches + 1, flows, 2000}) == Verdict::kHold);  // relief that stands still
  CHECK(says({0, 0, kMostPatches, flows, 501}) == Verdict::kSlip);
  CHECK(says({0, 0, kMostPatches, flows, 500}) == Verdict::kHold);
  CHECK(says({0, 0, kMostPatches, flows - 1, 501}) == Verdict::kHold);  // where nothing moves, nothing is raised
  // Coarse motion of what the markers feel, but not while the contact is made.
  constexpr int kDrags = kLeastCoarseFlow_um_s + 1;
  CHECK(says({0, kMostCoarseGrowth, 0, kDrags, 0, kCoarse + 1}) == Verdict::kSlipNow);
  CHECK(says({0, 0, 0, kDrags, 0, kCoarse}) == Verdict::kHold);
  CHECK(says({0, 0, 0, kDrags - 1, 0, kCoarse + 1}) == Verdict::kHold);
  CHECK(says({0, kMostCoarseGrowth + 1, 0, kDrags, 0, kCoarse + 1}) == Verdict::kHold);
}

// Seconds of silence: a threshold below the known one is not believed. Of one object nothing is said of others.
TEST(Fuse, LittleSilenceKeepsTheKnownThreshold) {
  Samples samples;
  add_clip(samples, "cup", 1200, 1300);
  for (Row& row : samples.rows) {
    if (row.x[kMotion] == 2500) row.x[kMotion] = 1000;
  }
  Fused fused;
  CHECK(!fuse(samples, marker_tree(), "own", fused));
  LONGS_EQUAL(kKnownThreshold, fused.threshold);
  CHECK_TRUE(fused.known);
  CHECK_FALSE(fused.unseen.has_value());
  treec::Model shipped;
  CHECK(!treec::parse(test::read_file(test::source("toolchain/model/slip_v6.tree")), shipped));
  LONGS_EQUAL(kKnownThreshold, shipped.nodes[0].threshold);
  // Enough of it is: the same clip again and again.
  const Samples once = samples;
  while (fused.silence_min < kLeastSilence_min) {
    for (int i = 0; i < 100; ++i) append(samples, Samples(once));
    CHECK(!fuse(samples, marker_tree(), "own", fused));
  }
  LONGS_EQUAL(1208, fused.threshold);
  CHECK_FALSE(fused.known);
}

TEST(Fuse, WhatCannotBePutTogetherIsRefusedInOneLine) {
  Fused fused;
  Samples simulated = three();
  for (Trial& trial : simulated.trials) trial.source = Source::kSimulated;
  STRCMP_CONTAINS("no recordings", fuse(simulated, marker_tree(), "x", fused).value_or("").c_str());
  treec::Model paper = marker_tree();
  paper.features[0].name = "vx_um_s";
  STRCMP_CONTAINS("reads vx_um_s", fuse(three(), paper, "x", fused).value_or("").c_str());
}
