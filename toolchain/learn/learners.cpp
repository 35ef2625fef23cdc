// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/learners.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/ml.hpp>
#include <utility>

#include "base/math.hpp"
#include "toolchain/learn/cart.hpp"

namespace holdfast::learn {
namespace {

using Error = std::optional<std::string>;

// What a row of hold and of slip weighs, so that both classes weigh the same but for settings.slip_weight.
std::array<double, 2> class_weights(const Settings& settings, const Matrix& rows) {
  std::array<double, 2> sum{};
  for (int i = 0; i < rows.height(); ++i) {
    sum[rows.slip[idx(i)] != 0 ? 1 : 0] += rows.weight.empty() ? 1.0 : static_cast<double>(rows.weight[idx(i)]);
  }
  const double all = sum[0] + sum[1];
  return {all / (2.0 * sum[0]), all / (2.0 * sum[1]) * settings.slip_weight};
}

class Knn final : public Learner {
 public:
  [[nodiscard]] Error fit(const Matrix& rows) override {
    if (Error error = unfit(rows)) return error;
    const cv::Mat x = matrix(rows);
    mean_.create(1, rows.width(), CV_32F);
    factor_.create(1, rows.width(), CV_32F);
    for (int c = 0; c < rows.width(); ++c) {
      cv::Scalar mean, deviation;
      cv::meanStdDev(x.col(c), mean, deviation);
      mean_.at<float>(c) = static_cast<float>(mean[0]);
      factor_.at<float>(c) = deviation[0] > 0.0 ? static_cast<float>(1.0 / deviation[0]) : 0.0F;
    }
    cv::Mat slips(rows.height(), 1, CV_32S);
    for (int i = 0; i < rows.height(); ++i) slips.at<int>(i) = rows.slip[idx(i)] != 0 ? 1 : 0;
    model_->setIsClassifier(true);
    model_->setDefaultK(1);
    model_->train(scaled(x), cv::ml::ROW_SAMPLE, slips);
    return std::nullopt;
  }

  [[nodiscard]] std::vector<std::uint8_t> predict(const Matrix& rows) const override {
    std::vector<std::uint8_t> out(idx(rows.height()));
    if (out.empty()) return out;
    cv::Mat answers;
    model_->predict(scaled(matrix(rows)), answers);
    for (int i = 0; i < answers.rows; ++i) out[idx(i)] = answers.at<float>(i) > 0.5F ? 1 : 0;
    return out;
  }

 private:
  static cv::Mat matrix(const Matrix& rows) {
    cv::Mat out;
    cv::Mat(rows.height(), rows.width(), CV_32S, const_cast<std::int32_t*>(rows.x.data())).convertTo(out, CV_32F);
    return out;
  }
  // A constant column becomes 0.
  [[nodiscard]] cv::Mat scaled(const cv::Mat& x) const {
    return (x - cv::repeat(mean_, x.rows, 1)).mul(cv::repeat(factor_, x.rows, 1));
  }

  cv::Ptr<cv::ml::KNearest> model_ = cv::ml::KNearest::create();
  cv::Mat mean_, factor_;
};

class Cart final : public Learner {
 public:
  explicit Cart(const Settings& settings) : settings_(settings) {}

  [[nodiscard]] Error fit(const Matrix& rows) override {
    if (Error error = unfit(rows)) return error;
    const auto [hold, slip] = class_weights(settings_, rows);
    tree_ = grow_cart(rows, {settings_.max_depth, settings_.min_leaf, settings_.prune, hold, slip});
    set_ = rows.set;
    return std::nullopt;
  }

  [[nodiscard]] std::vector<std::uint8_t> predict(const Matrix& rows) const override {
    std::vector<std::uint8_t> out(rows.slip.size());
    for (int i = 0; i < rows.height(); ++i) out[idx(i)] = tree_.slips(rows.at(i)) ? 1 : 0;
    return out;
  }

  [[nodiscard]] std::optional<treec::Model> tree() const override {
    return set_ == nullptr ? std::nullopt : model_of(tree_, *set_);
  }

 private:
  Settings settings_;
  BinaryTree tree_;
  const FeatureSet* set_ = nullptr;
};

}  // namespace

std::optional<std::string> unfit(const Matrix& rows) {
  if (rows.height() == 0) return "there are no rows to learn from";
  if (!rows.weight.empty() && rows.weight.size() != rows.slip.size()) return "not every row has a weight";
  std::array<double, 2> weight{};
  for (int i = 0; i < rows.height(); ++i) {
    const double w = rows.weight.empty() ? 1.0 : static_cast<double>(rows.weight[idx(i)]);
    if (!std::isfinite(w) || w < 0.0) return "a row's weight is negative or not finite";
    weight[rows.slip[idx(i)] != 0 ? 1 : 0] += w;
  }
  if (weight[0] > 0.0 && weight[1] > 0.0) return std::nullopt;
  return weight[1] > 0.0   ? "all rows are slip: there is no other class"
         : weight[0] > 0.0 ? "all rows are hold: there is no other class"
                           : "all rows weigh nothing";
}

bool may_slip(const FeatureSet& set, const Row& row) {
  static const std::uint8_t contact = feature_index("contact");
  return !reads(set, Stage::kImprint) || row.x[contact] != 0;
}

Matrix matrix_of(const Samples& samples, const FeatureSet& set, std::span<const int> trials, double recorded_weight,
                 bool with_empty) {
  Matrix matrix;
  matrix.set = &set;
  for (const int trial : trials) {
    const Trial& t = samples.trials[idx(trial)];
    for (int i = t.first; i < t.first + t.count; ++i) {
      const Row& row = samples.rows[idx(i)];
      if (!judged(row) && !(with_empty && row.accepted && row.label == Label::kEmpty)) continue;
      for (const std::uint8_t member : set.members) matrix.x.push_back(row.x[member]);
      matrix.slip.push_back(row.label == Label::kSlip ? 1 : 0);
      matrix.row.push_back(i);
      if (recorded_weight != 1.0) {
        matrix.weight.push_back(t.source == Source::kRecorded ? static_cast<float>(recorded_weight) : 1.0F);
      }
    }
  }
  return matrix;
}

std::string_view name_of(Kind kind) {
  return kind == Kind::kTree ? "tree" : "knn";
}

std::unique_ptr<Learner> make_learner(const Settings& settings) {
  if (settings.kind == Kind::kKnn) return std::make_unique<Knn>();
  return std::make_unique<Cart>(settings);
}

}  // namespace holdfast::learn
