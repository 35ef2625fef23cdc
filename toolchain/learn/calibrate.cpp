// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/calibrate.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "base/math.hpp"
#include "toolchain/learn/firmware_row.hpp"

namespace holdfast::learn {
namespace {

constexpr Micros kSettling{250'000};
// Of a normal distribution: standard deviation over median distance from the median.
constexpr double kNormal = 1.4826;

double median_of(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  if (values.size() % 2 == 1) return *middle;
  return 0.5 * (*middle + *std::max_element(values.begin(), middle));
}

// One threshold that rest frames reach from one side only.
Clearance judge(const ThresholdCheck& check) {
  if (!check.sigmas) return check.margin > 1 ? Clearance::kClear : Clearance::kClose;
  if (*check.sigmas >= kClearSigmas) return Clearance::kClear;
  return *check.sigmas >= kCloseSigmas ? Clearance::kClose : Clearance::kInside;
}

class ModelWalk {
 public:
  ModelWalk(const treec::Model& model, std::span<const Features> rest)
      : model_(model), set_(*find_feature_set(model.feature_set)) {
    for (std::size_t i = 0; i < sigma_.size(); ++i) sigma_[i] = figures_of(rest, static_cast<int>(i)).sigma();
    std::vector<const Features*> all;
    for (const Features& x : rest) all.push_back(&x);
    visit(0, all);
    std::ranges::sort(check_.thresholds, {}, &ThresholdCheck::node);
    std::ranges::sort(check_.leaves, {}, &LeafCheck::node);
  }

  [[nodiscard]] ModelCheck take() { return std::move(check_); }

 private:
  [[nodiscard]] const treec::Node& node(int id) const { return *std::ranges::find(model_.nodes, id, &treec::Node::id); }

  [[nodiscard]] bool is_slip_leaf(int id) const { return node(id).is_leaf && node(id).verdict != Verdict::kHold; }

  [[nodiscard]] bool can_slip(int id) const {
    const treec::Node& at = node(id);
    return at.is_leaf ? is_slip_leaf(id) : can_slip(at.child_true) || can_slip(at.child_false);
  }

  void visit(int id, const std::vector<const Features*>& frames) {
    const treec::Node& at = node(id);
    if (at.is_leaf) {
      check_.leaves.push_back({id, at.verdict, static_cast<long>(frames.size())});
      return;
    }
    ThresholdCheck check;
    check.node = id;
    check.feature = set_.members[idx(at.feature)];
    check.threshold = at.threshold;
    std::vector<const Features*> below, above;
    double sum = 0.0;
    std::int64_t nearest = std::numeric_limits<std::int64_t>::max();
    for (const Features* x : frames) {
      const std::int64_t value = (*x)[idx(check.feature)];
      sum += static_cast<double>(value);
      const bool is_below = value <= at.threshold;
      (is_below ? below : above).push_back(x);
      nearest = std::min(nearest, is_below ? at.threshold + 1 - value : value - at.threshold);
    }
    check.below = static_cast<long>(below.size());
    check.above = static_cast<long>(above.size());
    if (!frames.empty()) {
      const double off = std::abs(at.threshold + 0.5 - sum / static_cast<double>(frames.size()));
      if (sigma_[idx(check.feature)] > 0.0) check.sigmas = off / sigma_[idx(check.feature)];
      if (below.empty() || above.empty()) {
        check.margin = nearest;
        if (can_slip(below.empty() ? at.child_true : at.child_false)) check.clearance = judge(check);
      } else if (is_slip_leaf(at.child_true) || is_slip_leaf(at.child_false)) {
        check.clearance = Clearance::kInside;
      }
    }
    check_.thresholds.push_back(check);
    visit(at.child_true, below);
    visit(at.child_false, above);
  }

  const treec::Model& model_;
  const FeatureSet& set_;
  std::array<double, kFeatureCount> sigma_{};
  ModelCheck check_;
};

}  // namespace

RestFigures figures_of(std::span<const Features> rest, int feature) {
  RestFigures out;
  if (rest.empty()) return out;
  std::vector<double> values;
  for (const Features& x : rest) values.push_back(x[idx(feature)]);
  const auto n = static_cast<double>(values.size());
  // Sums of whole numbers are exact: the mean of a constant is that constant, and its deviation 0.
  for (const double value : values) out.mean += value;
  out.mean /= n;
  for (const double value : values) out.deviation += (value - out.mean) * (value - out.mean);
  out.deviation = std::sqrt(out.deviation / n);
  const auto [least, most] = std::ranges::minmax(values);
  out.least = static_cast<std::int32_t>(least);
  out.most = static_cast<std::int32_t>(most);
  out.median = median_of(values);
  for (double& value : values) value = std::abs(value - out.median);
  out.robust = kNormal * median_of(values);
  return out;
}

void RestStudy::add(long frame, const pipeline::Result& result, const pipeline::State& state,
                    const pipeline::Config& config) {
  ++frames_;
  const Row row = firmware_row(result);
  if (!row.accepted) return;
  if (!first_) first_ = result.timestamp;
  if (result.timestamp - *first_ < kSettling) return;
  rest_.push_back(row.x);
  const double um_per_px_q8 = config.displacement.pitch_um / static_cast<double>(state.reference.pitch.raw());
  const double still_um = config.reference.still.raw() * um_per_px_q8;
  int valid = 0;
  int off = 0;
  for (int i = 0; i < state.displacement.grid.count(); ++i) {
    const MarkerDisplacement& d = state.displacement.markers[idx(i)];
    if (!d.valid) continue;
    const double x = d.dx.raw();
    const double y = d.dy.raw();
    ++valid;
    if (std::max(std::abs(x), std::abs(y)) > still_um) ++off;
    Sums& sums = sums_[idx(i)];
    ++sums.count;
    sums.x += x;
    sums.y += y;
    sums.xx += x * x;
    sums.yy += y * y;
  }
  if (off * 10 > valid) moved_.push_back(frame);
}

RestStudy::Jitter RestStudy::jitter() const {
  Jitter out;
  double xx = 0.0;
  double yy = 0.0;
  double worst = 0.0;
  long count = 0;
  for (const Sums& sums : sums_) {
    if (sums.count == 0) continue;
    const auto n = static_cast<double>(sums.count);
    const double x = std::max(sums.xx - sums.x * sums.x / n, 0.0);
    const double y = std::max(sums.yy - sums.y * sums.y / n, 0.0);
    xx += x;
    yy += y;
    worst = std::max({worst, x / n, y / n});
    count += sums.count;
  }
  if (count == 0) return out;
  out.x_um = std::sqrt(xx / static_cast<double>(count));
  out.y_um = std::sqrt(yy / static_cast<double>(count));
  out.worst_um = std::sqrt(worst);
  return out;
}

std::string_view name_of(Clearance clearance) {
  switch (clearance) {
    case Clearance::kClear:
      return "stands clear";
    case Clearance::kClose:
      return "close";
    case Clearance::kInside:
      return "inside the noise";
    case Clearance::kNoMatter:
      break;
  }
  return "no matter";
}

Clearance ModelCheck::worst() const {
  Clearance worst = Clearance::kClear;
  for (const ThresholdCheck& check : thresholds) {
    if (check.clearance != Clearance::kNoMatter) worst = std::max(worst, check.clearance);
  }
  return worst;
}

long ModelCheck::slip_frames() const {
  long count = 0;
  for (const LeafCheck& leaf : leaves) count += leaf.verdict != Verdict::kHold ? leaf.frames : 0;
  return count;
}

ModelCheck check_rest(const treec::Model& model, std::span<const Features> rest) {
  return ModelWalk(model, rest).take();
}

}  // namespace holdfast::learn
