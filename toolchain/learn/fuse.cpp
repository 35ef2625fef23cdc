// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/fuse.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <utility>
#include <vector>

#include "base/math.hpp"
#include "slip/decision.hpp"

namespace holdfast::learn {
namespace {

constexpr int kRaise = 1;  // the imprint needs no second frame
constexpr std::string_view kSet = "grasp";
constexpr std::string_view kFlow = "flow_residual_um_s";
constexpr std::string_view kGrowth = "imprint_growth_log2_q8";

void read_threshold(const Samples& recordings, Fused& out) {
  std::vector<int> all(recordings.trials.size());
  std::iota(all.begin(), all.end(), 0);
  const std::vector<double> motions = imprint_motions(recordings);
  out.silence_min = held_minutes(recordings, all);
  out.threshold = static_cast<int>(
      std::lround(threshold_of(recordings, motions, all, {kMinutesPerAlarm, kThresholdMargin}, kRaise)));
  out.known = out.silence_min < kLeastSilence_min && out.threshold < kKnownThreshold;
  if (out.known) out.threshold = kKnownThreshold;
  const bool several = std::ranges::any_of(
      recordings.trials, [&](const Trial& trial) { return trial.object != recordings.trials.front().object; });
  if (several) out.unseen = leave_one_out(recordings, {kMinutesPerAlarm, kThresholdMargin}, kRaise);
}

int index_of(const treec::Model& model, std::string_view feature) {
  const auto at = std::ranges::find(model.features, feature, &treec::Feature::name);
  return at == model.features.end() ? -1 : static_cast<int>(at - model.features.begin());
}

class Builder {
 public:
  explicit Builder(treec::Model& model) : model_(model) {}

  int leaf(Verdict verdict) {
    const int id = add();
    treec::Node& node = model_.nodes[idx(id)];
    node.is_leaf = true;
    node.verdict = verdict;
    return id;
  }
  // Its children come next: set them with children().
  int split(std::string_view feature, int threshold) {
    const int id = add();
    model_.nodes[idx(id)].feature = index_of(model_, feature);
    model_.nodes[idx(id)].threshold = threshold;
    return id;
  }
  void children(int id, int child_true, int child_false) {
    model_.nodes[idx(id)].child_true = child_true;
    model_.nodes[idx(id)].child_false = child_false;
  }
  // The subtree of `from` in another model, whose features are all here; below a flow of kLeastFlow_um_s it is not
  // asked.
  int graft(const treec::Model& other, int from) {
    const treec::Node& node = other.nodes[idx(from)];
    if (node.is_leaf) return leaf(node.verdict);
    const bool decided = other.features[idx(node.feature)].name == kFlow && node.threshold <= kLeastFlow_um_s;
    if (decided) return graft(other, node.child_false);
    const int id = split(other.features[idx(node.feature)].name, node.threshold);
    const int child_true = graft(other, node.child_true);
    const int child_false = graft(other, node.child_false);
    children(id, child_true, child_false);
    return id;
  }

 private:
  int add() {
    const int id = static_cast<int>(model_.nodes.size());
    model_.nodes.emplace_back().id = id;
    return id;
  }
  treec::Model& model_;
};

}  // namespace

std::optional<std::string> fuse(const Samples& recordings, const treec::Model& markers, const std::string& name,
                                Fused& out) {
  out = {};
  const bool recorded =
      std::ranges::any_of(recordings.trials, [](const Trial& t) { return t.source == Source::kRecorded; });
  const auto labelled = [&](Label label) { return std::ranges::count(recordings.rows, label, &Row::label); };
  if (!recorded || labelled(Label::kHold) == 0 || labelled(Label::kSlip) == 0) {
    return "the samples have no recordings with frames that hold and frames that slip. Likely cause: simulated samples "
           "were given. Next: make them with holdfast dataset --recordings";
  }
  read_threshold(recordings, out);

  treec::Model& model = out.model;
  const FeatureSet& set = *find_feature_set(kSet);
  model.name = name;
  model.feature_set = set.name;
  for (int i = 0; i < set.size(); ++i) {
    model.features.push_back({std::string(set[i].name), std::string(set[i].unit), set[i].q, 0});
  }
  for (const treec::Feature& feature : markers.features) {
    if (index_of(model, feature.name) >= 0) continue;
    return fmt::format(
        "the model {} reads {}, which the set {} has not. Likely cause: a model of another experiment. Next: give a "
        "tree of the set field",
        markers.name, feature.name, kSet);
  }

  Builder build(model);
  const auto holds = [&] { return build.leaf(Verdict::kHold); };
  // Slip where the relief is another, while its shading neither comes nor goes; else what `stays` builds.
  const auto slips = [&] { return build.leaf(Verdict::kSlipNow); };
  const auto slips_unless_fading = [&] {
    const int fades = build.split(kGrowth, -kMostTurnoverGrowth - 1);
    const int faded = holds();
    const int replaced = slips();
    build.children(fades, faded, replaced);
    return fades;
  };
  const auto unless_replaced = [&](const auto& stays, const auto& replaced_by) {
    const int turns = build.split("imprint_turnover_q10", kTurnover);
    const int same = stays();
    const int grows = build.split(kGrowth, kMostTurnoverGrowth);
    const int replaced = replaced_by();
    const int grown = holds();
    build.children(grows, replaced, grown);
    build.children(turns, same, grows);
    return turns;
  };
  const int moves = build.split("imprint_log2_um_q8", out.threshold);
  const int shifts = build.split("imprint_coarse_log2_um_q8", kCoarse);
  const int steady = unless_replaced(
      [&] {
        const int relief = build.split("imprint_patches", kMostPatches);
        const int flows = build.split(kFlow, kLeastFlow_um_s);
        const int still = holds();
        const int markers_say = build.graft(markers, 0);
        build.children(flows, still, markers_say);
        const int held = holds();
        build.children(relief, flows, held);
        return relief;
      },
      slips_unless_fading);
  const int spreads = build.split(kGrowth, kMostCoarseGrowth);
  const int drags = build.split(kFlow, kLeastCoarseFlow_um_s);
  const int pressed = unless_replaced(holds, slips_unless_fading);
  const int shifted = slips();
  build.children(drags, pressed, shifted);
  const int spread = holds();
  build.children(spreads, drags, spread);
  build.children(shifts, steady, spreads);
  const int grows = build.split(kGrowth, kMostGrowth);
  const int slides = slips();
  const int touches = unless_replaced(holds, slips);  // its shading grows: it does not fade
  build.children(grows, slides, touches);
  build.children(moves, shifts, grows);
  if (const auto problem = treec::check(model)) {
    return fmt::format(
        "the two do not make a model: {}. Likely cause: recordings without a slip that stands out. Next: {}",
        problem->what, problem->next);
  }
  return std::nullopt;
}

}  // namespace holdfast::learn
