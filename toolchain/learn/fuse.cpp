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

using Error = std::optional<std::string>;

constexpr int kRaise = decision::Config{}.raise_frames;
constexpr std::string_view kSet = "touch";

Error points_of(const Samples& recordings, std::array<Point, 3>& points) {
  const Detector& detector = imprint_detector();
  std::vector<int> all(recordings.trials.size());
  std::iota(all.begin(), all.end(), 0);
  std::vector<double> values;
  if (auto error = detector.values(recordings, all, values)) return error;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double threshold = threshold_of(recordings, detector, all, values, kPointBudgets[i], kRaise);
    points[i].threshold = static_cast<int>(std::lround(threshold));
    if (auto error = leave_one_out(recordings, detector, kPointBudgets[i], kRaise, points[i].unseen)) return error;
  }
  return std::nullopt;
}

int index_of(const treec::Model& model, std::string_view feature) {
  const auto at = std::ranges::find(model.features, feature, &treec::Feature::name);
  return at == model.features.end() ? -1 : static_cast<int>(at - model.features.begin());
}

class Builder {
 public:
  explicit Builder(treec::Model& model) : model_(model) {}

  int leaf(Verdict verdict, Sensitivity least = Sensitivity::kQuiet) {
    const int id = add();
    treec::Node& node = model_.nodes[idx(id)];
    node.is_leaf = true;
    node.verdict = verdict;
    node.least = least;
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
  // The subtree of `from` in another model, whose features are all here. It is not heard when quiet is asked for.
  int graft(const treec::Model& other, int from) {
    const treec::Node& node = other.nodes[idx(from)];
    if (node.is_leaf) return leaf(node.verdict, node.verdict == Verdict::kSlip ? Sensitivity::kNormal : node.least);
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
  if (markers.score.bias_q8) {
    return fmt::format(
        "the model {} reads a score, which the set {} has not. Likely cause: a model of another experiment. Next: give "
        "a tree of the set field",
        markers.name, kSet);
  }
  if (auto error = points_of(recordings, out.points)) return error;

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

  const auto threshold = [&](Sensitivity s) { return out.points[static_cast<std::size_t>(s)].threshold; };
  const std::string motion = "imprint_short_log2_um_q8";
  Builder build(model);
  const int moves = build.split(motion, threshold(Sensitivity::kSensitive));
  const int texture = build.split("imprint_patches", kLeastPatches - 1);
  const int told = build.graft(markers, 0);
  const int still = build.leaf(Verdict::kHold);
  build.children(texture, told, still);
  const int more = build.split(motion, threshold(Sensitivity::kNormal));
  const int a_little = build.leaf(Verdict::kSlip, Sensitivity::kSensitive);
  const int most = build.split(motion, threshold(Sensitivity::kQuiet));
  const int much = build.leaf(Verdict::kSlip, Sensitivity::kNormal);
  const int very_much = build.leaf(Verdict::kSlip);
  build.children(most, much, very_much);
  build.children(more, a_little, most);
  build.children(moves, texture, more);
  if (const auto problem = treec::check(model)) {
    return fmt::format(
        "the two do not make a model: {}. Likely cause: recordings without a slip that stands out. Next: {}",
        problem->what, problem->next);
  }
  return std::nullopt;
}

}  // namespace holdfast::learn
