// SPDX-License-Identifier: Apache-2.0
#include "toolchain/trade/learned.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <opencv2/ml.hpp>
#include <span>
#include <utility>

#include "app/app.hpp"
#include "toolchain/learn/firmware_row.hpp"
#include "toolchain/learn/learners.hpp"
#include "toolchain/treec/tree_model.hpp"

namespace holdfast::trade {
namespace {

// As train.sh has it: few false alarms are worth more than an early alarm.
constexpr double kSlipWeight = 0.1;
constexpr int kMinLeaf = 80;
constexpr double kPrune = 2e-5;
constexpr int kDeskDepth = 8;

class OpenCvTree final : public DeskTree {
 public:
  OpenCvTree(const cv::Mat& rows, const cv::Mat& slips) : trees_(cv::ml::DTrees::create()) {
    trees_->setMaxDepth(kDeskDepth);
    trees_->setMinSampleCount(2 * kMinLeaf);
    trees_->setCVFolds(0);
    trees_->setUseSurrogates(false);
    // Both classes alike, and a slip then worth kSlipWeight of a hold, as our own tree has it.
    const double slipping = cv::countNonZero(slips);
    const double holding = slips.rows - slipping;
    trees_->setPriors((cv::Mat_<double>(1, 2) << 1.0, kSlipWeight * holding / std::max(1.0, slipping)));
    trees_->train(cv::ml::TrainData::create(rows, cv::ml::ROW_SAMPLE, slips));
  }

  [[nodiscard]] bool slips(const DoubleFeatures::Values& values) const override {
    const cv::Mat row(1, static_cast<int>(values.size()), CV_32F, const_cast<float*>(values.data()));
    return trees_->predict(row) > 0.5F;
  }

 private:
  cv::Ptr<cv::ml::DTrees> trees_;
};

}  // namespace

std::optional<DoubleFeatures::Values> DoubleFeatures::update(const MarkerField& field, Micros time) {
  const Params defaults;
  const auto count = static_cast<std::size_t>(field.grid.count());
  std::vector<Place> now(count);
  for (std::size_t i = 0; i < count; ++i) {
    now[i] = {field.markers[i].x.raw() / 256.0, field.markers[i].y.raw() / 256.0};
  }
  if (learned_ < defaults.reference_frames) {
    rest_px_.resize(count);
    for (std::size_t i = 0; i < count; ++i) {
      rest_px_[i].x += now[i].x / defaults.reference_frames;
      rest_px_[i].y += now[i].y / defaults.reference_frames;
    }
    if (++learned_ < defaults.reference_frames) return std::nullopt;
    double links_px = 0.0;
    int links = 0;
    for (std::size_t i = 0; i < count; ++i) {
      if ((i + 1) % field.grid.cols == 0) continue;
      links_px += std::hypot(rest_px_[i + 1].x - rest_px_[i].x, rest_px_[i + 1].y - rest_px_[i].y);
      ++links;
    }
    um_per_px_ = defaults.pitch_um * links / links_px;
  }
  std::vector<Place> moved(count);
  std::vector<double> lengths;
  Place sum;
  int both = 0;
  const bool has_before = !before_um_.empty();
  for (std::size_t i = 0; i < count; ++i) {
    if (!field.markers[i].valid) continue;
    moved[i] = {(now[i].x - rest_px_[i].x) * um_per_px_, (now[i].y - rest_px_[i].y) * um_per_px_};
    lengths.push_back(std::hypot(moved[i].x, moved[i].y));
    if (!has_before) continue;
    sum.x += moved[i].x - before_um_[i].x;
    sum.y += moved[i].y - before_um_[i].y;
    ++both;
  }
  const double entropy = entropy_nat(lengths);
  Values out{0.0F, 0.0F, static_cast<float>(entropy), 0.0F};
  const double dt_s = static_cast<double>((time - time_before_).count()) * 1e-6;
  if (both > 0 && dt_s > 0.0) {
    out[0] = static_cast<float>(sum.x / both / dt_s);
    out[1] = static_cast<float>(sum.y / both / dt_s);
    out[3] = static_cast<float>((entropy - entropy_before_) / dt_s);
  }
  before_um_ = std::move(moved);
  entropy_before_ = entropy;
  time_before_ = time;
  return out;
}

double DoubleFeatures::entropy_nat(const std::vector<double>& lengths_um) const {
  std::vector<double> bins(static_cast<std::size_t>(form_.count));
  const double last = form_.count - 1;
  for (const double length_um : lengths_um) {
    const double place = length_um * form_.count / form_.range_um;
    if (form_.bins == learn::Bins::kHard) {
      bins[static_cast<std::size_t>(std::min(place, last))] += 1.0;
      continue;
    }
    const double centred = std::clamp(place - 0.5, 0.0, last);
    const auto below = static_cast<std::size_t>(centred);
    const double above = centred - static_cast<double>(below);
    bins[below] += 1.0 - above;
    if (above > 0.0) bins[below + 1] += above;
  }
  double out = 0.0;
  for (const double weight : bins) {
    const double share = weight / static_cast<double>(lengths_um.size());
    if (share > 0.0) out -= share * std::log(share);
  }
  return out;
}

Lessons::Lessons(int every, const std::function<bool(long)>& go_on) {
  if (every == 0) return;
  const pipeline::Config config = pipeline_config(learn::with_all_features(Params{}));
  for (const learn::PlannedGrasp& planned : grasps_to_learn_from(every)) {
    if (go_on && !go_on(static_cast<long>(grasps_.size()))) return;
    Grasp& grasp = grasps_.emplace_back(play(planned));
    const auto state = std::make_unique<pipeline::State>();
    grasp.trial.first = static_cast<int>(samples_.rows.size());
    for (std::size_t k = 0; k < grasp.sights.size(); ++k) {
      learn::Row row = learn::firmware_row(pipeline::update_markers(
          *state, config, grasp.sights[k].markers, grasp.sights[k].time, static_cast<std::uint32_t>(k)));
      row.trial = static_cast<int>(samples_.trials.size());
      row.frame = static_cast<int>(k);
      row.label = grasp.labels[k];
      samples_.rows.push_back(row);
    }
    samples_.trials.push_back(grasp.trial);
  }
}

model::Tree Lessons::tree(std::string_view set, int depth) const {
  std::vector<int> trials(samples_.trials.size());
  std::iota(trials.begin(), trials.end(), 0);
  learn::Settings settings;
  settings.slip_weight = kSlipWeight;
  settings.max_depth = depth;
  settings.min_leaf = kMinLeaf;
  settings.prune = kPrune;
  const auto learner = learn::make_learner(settings);
  (void)learner->fit(learn::matrix_of(samples_, *find_feature_set(set), trials, 1.0, true));
  if (const auto learned = learner->tree()) return treec::to_table(*learned);
  model::Tree never;
  never.nodes.front().kind = model::Kind::kHold;
  return never;
}

std::unique_ptr<DeskTree> Lessons::desk_tree(const learn::EntropyForm& form) const {
  cv::Mat rows, slips;
  for (const Grasp& grasp : grasps_) {
    DoubleFeatures features(form);
    for (std::size_t k = 0; k < grasp.sights.size(); ++k) {
      const auto values = features.update(grasp.sights[k].markers, grasp.sights[k].time);
      if (!values || grasp.labels[k] == learn::Label::kOpen) continue;
      rows.push_back(cv::Mat(1, static_cast<int>(values->size()), CV_32F, const_cast<float*>(values->data())));
      slips.push_back(grasp.labels[k] == learn::Label::kSlip ? 1 : 0);
    }
  }
  return std::make_unique<OpenCvTree>(rows, slips);
}

}  // namespace holdfast::trade
