// SPDX-License-Identifier: Apache-2.0
// OpenCV's classifiers compute with 32-bit floats, the device with integers. Where floats would round (2^24 and beyond;
// the midpoint of two values already beyond 2^23), a column gives up as many low bits as it must, by its largest
// training value: x >> shift <= t is exactly x <= (t << shift) + 2^shift - 1, so trees stay exact. With the firmware's
// features that happens only when a marker is seen at more than 8.4 m/s.
//
// Weights of rows and of classes reach OpenCV's trees as weights of samples: its "priors" weigh mistakes, they do not
// level the classes out (measured with 4.6: priors 1:1 on 160:40 rows change nothing). SVM takes weights by class only
// and k-NN none: they leave the weights of rows aside.
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

struct ClassWeights {
  double hold = 1.0;
  double slip = 1.0;
};

ClassWeights class_weights(const Settings& settings, const Matrix& rows) {
  ClassWeights weights;
  if (settings.balanced) {
    std::array<double, 2> sum{};
    for (int i = 0; i < rows.height(); ++i) {
      sum[rows.slip[idx(i)] != 0 ? 1 : 0] += rows.weight.empty() ? 1.0 : static_cast<double>(rows.weight[idx(i)]);
    }
    weights = {(sum[0] + sum[1]) / (2.0 * sum[0]), (sum[0] + sum[1]) / (2.0 * sum[1])};
  }
  weights.slip *= settings.slip_weight;
  return weights;
}

// Feature values as OpenCV takes them.
class Columns {
 public:
  // `scaled`: to zero mean and unit variance of these rows; a constant column becomes 0.
  Columns(const Matrix& rows, bool scaled) {
    const auto width = static_cast<std::size_t>(rows.width());
    std::vector<std::int64_t> largest(width);
    for (int i = 0; i < rows.height(); ++i) {
      for (std::size_t c = 0; c < width; ++c) {
        largest[c] = std::max(largest[c], std::abs(std::int64_t{rows.at(i)[c]}));
      }
    }
    scales_.resize(width);
    for (std::size_t c = 0; c < width; ++c) {
      while ((largest[c] >> scales_[c].shift) > kMostExact) ++scales_[c].shift;
    }
    if (scaled) scale(rows);
  }

  [[nodiscard]] cv::Mat of(const Matrix& rows) const {
    cv::Mat out(rows.height(), rows.width(), CV_32F);
    for (int i = 0; i < rows.height(); ++i) {
      const std::span<const std::int32_t> x = rows.at(i);
      for (int c = 0; c < rows.width(); ++c) {
        const Scale& s = scales_[idx(c)];
        out.at<float>(i, c) = static_cast<float>((static_cast<double>(x[idx(c)] >> s.shift) - s.mean) * s.factor);
      }
    }
    return out;
  }

  // The integer t for which x <= t says what OpenCV's `value <= threshold` says.
  [[nodiscard]] std::int32_t threshold(int column, float threshold) const {
    const int shift = scales_[idx(column)].shift;
    const auto t = static_cast<std::int64_t>(std::floor(threshold));
    return static_cast<std::int32_t>(((t + 1) << shift) - 1);
  }

 private:
  static constexpr std::int64_t kMostExact = std::int64_t{1} << 23;
  struct Scale {
    int shift = 0;
    double mean = 0.0;
    double factor = 1.0;
  };

  void scale(const Matrix& rows) {
    const double n = rows.height();
    for (std::size_t c = 0; c < scales_.size(); ++c) {
      Scale& s = scales_[c];
      double sum = 0.0;
      for (int i = 0; i < rows.height(); ++i) sum += rows.at(i)[c] >> s.shift;
      s.mean = sum / n;
      double squares = 0.0;
      for (int i = 0; i < rows.height(); ++i) {
        const double d = (rows.at(i)[c] >> s.shift) - s.mean;
        squares += d * d;
      }
      s.factor = squares > 0.0 ? 1.0 / std::sqrt(squares / n) : 0.0;
    }
  }

  std::vector<Scale> scales_;
};

// Shape: column vectors; 0 = hold, 1 = slip.
cv::Mat labels_of(const Matrix& rows) {
  cv::Mat out(rows.height(), 1, CV_32S);
  for (int i = 0; i < rows.height(); ++i) out.at<int>(i) = rows.slip[idx(i)] != 0 ? 1 : 0;
  return out;
}

cv::Mat weights_of(const Matrix& rows, const Settings& settings) {
  const std::vector<double> weights = row_weights(settings, rows);
  cv::Mat out(rows.height(), 1, CV_32F);
  for (int i = 0; i < rows.height(); ++i) out.at<float>(i) = static_cast<float>(weights[idx(i)]);
  return out;
}

std::vector<std::uint8_t> verdicts_of(const cv::Mat& answers) {
  cv::Mat numbers;
  answers.convertTo(numbers, CV_32F);  // SVM answers in integers, the others in floats
  std::vector<std::uint8_t> out(static_cast<std::size_t>(numbers.rows));
  for (int i = 0; i < numbers.rows; ++i) out[idx(i)] = numbers.at<float>(i) > 0.5F ? 1 : 0;
  return out;
}

// What the four have in common: the checks, the way of the features, and OpenCV's exceptions, which end here.
class OpenCvLearner : public Learner {
 public:
  OpenCvLearner(const Settings& settings, bool scaled) : settings_(settings), scaled_(scaled) {}

  [[nodiscard]] Error fit(const Matrix& rows) override {
    if (Error error = unfit(rows)) return error;
    set_ = rows.set;
    columns_.emplace(rows, scaled_);
    try {
      model_ = train(rows);
    } catch (const cv::Exception& error) {
      model_.release();
      return "OpenCV refuses: " + error.err;
    }
    return std::nullopt;
  }

  [[nodiscard]] std::vector<std::uint8_t> predict(const Matrix& rows) const override {
    if (rows.height() == 0) return {};
    cv::Mat answers;
    model_->predict(columns_->of(rows), answers);
    return verdicts_of(answers);
  }

 protected:
  [[nodiscard]] virtual cv::Ptr<cv::ml::StatModel> train(const Matrix& rows) const = 0;
  [[nodiscard]] const Settings& settings() const { return settings_; }
  [[nodiscard]] const FeatureSet& set() const { return *set_; }
  [[nodiscard]] const Columns& columns() const { return *columns_; }
  [[nodiscard]] const cv::Ptr<cv::ml::StatModel>& model() const { return model_; }
  // Rows with their weights; not for SVM and k-NN.
  [[nodiscard]] cv::Ptr<cv::ml::TrainData> sample_of(const Matrix& rows) const {
    return cv::ml::TrainData::create(columns().of(rows), cv::ml::ROW_SAMPLE, labels_of(rows), cv::noArray(),
                                     cv::noArray(), weights_of(rows, settings_));
  }

 private:
  Settings settings_;
  bool scaled_;
  const FeatureSet* set_ = nullptr;
  std::optional<Columns> columns_;
  cv::Ptr<cv::ml::StatModel> model_;
};

// OpenCV knows no least leaf: a node that could not give two leaves of `min_leaf` rows is not split, but it may be
// split unevenly.
void set_up(cv::ml::DTrees& trees, const Settings& settings) {
  trees.setMaxDepth(settings.max_depth);
  trees.setMinSampleCount(2 * settings.min_leaf);
  trees.setCVFolds(0);
  trees.setUse1SERule(false);
  trees.setTruncatePrunedTree(false);
  trees.setUseSurrogates(false);
}

class TreeCv final : public OpenCvLearner {
 public:
  explicit TreeCv(const Settings& settings) : OpenCvLearner(settings, false) {}

  [[nodiscard]] std::optional<treec::Model> tree() const override {
    const auto trees = model().dynamicCast<cv::ml::DTrees>();
    if (trees.empty()) return std::nullopt;
    BinaryTree tree;
    for (const cv::ml::DTrees::Node& from : trees->getNodes()) {
      TreeNode node;
      node.is_leaf = from.split < 0;
      node.slip = from.value > 0.5;
      if (!node.is_leaf) {
        const cv::ml::DTrees::Split& split = trees->getSplits()[idx(from.split)];
        node.column = split.varIdx;
        node.threshold = columns().threshold(split.varIdx, split.c);
        node.child_true = from.left;
        node.child_false = from.right;
      }
      tree.nodes.push_back(node);
    }
    return model_of(tidied(tree), set());
  }

 private:
  [[nodiscard]] cv::Ptr<cv::ml::StatModel> train(const Matrix& rows) const override {
    auto trees = cv::ml::DTrees::create();
    set_up(*trees, settings());
    trees->train(sample_of(rows));
    return trees;
  }
};

class Forest final : public OpenCvLearner {
 public:
  explicit Forest(const Settings& settings) : OpenCvLearner(settings, false) {}

 private:
  [[nodiscard]] cv::Ptr<cv::ml::StatModel> train(const Matrix& rows) const override {
    cv::theRNG() = cv::RNG(settings().seed);  // this thread's, from which the forest draws
    auto forest = cv::ml::RTrees::create();
    set_up(*forest, settings());
    forest->setActiveVarCount(0);  // the square root of their number
    forest->setTermCriteria(cv::TermCriteria(cv::TermCriteria::MAX_ITER, settings().trees, 0.0));
    forest->train(sample_of(rows));
    return forest;
  }
};

class Svm final : public OpenCvLearner {
 public:
  explicit Svm(const Settings& settings) : OpenCvLearner(settings, true) {}

 private:
  [[nodiscard]] cv::Ptr<cv::ml::StatModel> train(const Matrix& rows) const override {
    auto svm = cv::ml::SVM::create();
    svm->setType(cv::ml::SVM::C_SVC);
    svm->setKernel(cv::ml::SVM::RBF);
    svm->setC(settings().svm_c);
    svm->setGamma(settings().svm_gamma > 0.0 ? settings().svm_gamma : 1.0 / rows.width());
    const ClassWeights weights = class_weights(settings(), rows);
    svm->setClassWeights((cv::Mat_<double>(1, 2) << weights.hold, weights.slip));
    // OpenCV's own limit of 1000 steps says nearly always the same class (12 292 simulated rows: 10 702 errors, with
    // this limit 2359 and the optimum in 1.1 s). 76 373 rows end at the limit, after 27 s, with as many errors as the
    // optimum has after 53 s. 1e-3 is the tolerance that libsvm takes.
    svm->setTermCriteria(cv::TermCriteria(cv::TermCriteria::MAX_ITER + cv::TermCriteria::EPS, kMostSteps, 1e-3));
    svm->train(columns().of(rows), cv::ml::ROW_SAMPLE, labels_of(rows));
    return svm;
  }

  static constexpr int kMostSteps = 100'000;
};

class Knn final : public OpenCvLearner {
 public:
  explicit Knn(const Settings& settings) : OpenCvLearner(settings, true) {}

 private:
  [[nodiscard]] cv::Ptr<cv::ml::StatModel> train(const Matrix& rows) const override {
    auto knn = cv::ml::KNearest::create();
    knn->setIsClassifier(true);
    knn->setAlgorithmType(cv::ml::KNearest::BRUTE_FORCE);
    knn->setDefaultK(settings().neighbours);
    knn->train(columns().of(rows), cv::ml::ROW_SAMPLE, labels_of(rows));
    return knn;
  }
};

class Cart final : public Learner {
 public:
  explicit Cart(const Settings& settings) : settings_(settings) {}

  [[nodiscard]] Error fit(const Matrix& rows) override {
    if (Error error = unfit(rows)) return error;
    const ClassWeights weights = class_weights(settings_, rows);
    tree_ = grow_cart(rows, {settings_.max_depth, settings_.min_leaf, settings_.prune, settings_.criterion,
                             weights.hold, weights.slip});
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

constexpr std::array<std::pair<Kind, std::string_view>, 5> kKinds{{{Kind::kTreeCv, "tree_cv"},
                                                                   {Kind::kForest, "forest"},
                                                                   {Kind::kSvm, "svm"},
                                                                   {Kind::kKnn, "knn"},
                                                                   {Kind::kTree, "tree"}}};

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

std::vector<double> row_weights(const Settings& settings, const Matrix& rows) {
  const ClassWeights weights = class_weights(settings, rows);
  std::vector<double> out(rows.slip.size());
  for (std::size_t i = 0; i < out.size(); ++i) {
    const double of_class = rows.slip[i] != 0 ? weights.slip : weights.hold;
    out[i] = of_class * (rows.weight.empty() ? 1.0 : static_cast<double>(rows.weight[i]));
  }
  return out;
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
  return std::find_if(kKinds.begin(), kKinds.end(), [&](const auto& k) { return k.first == kind; })->second;
}

std::optional<Kind> find_kind(std::string_view name) {
  const auto* const found = std::find_if(kKinds.begin(), kKinds.end(), [&](const auto& k) { return k.second == name; });
  return found == kKinds.end() ? std::nullopt : std::optional(found->first);
}

std::unique_ptr<Learner> make_learner(const Settings& settings) {
  switch (settings.kind) {
    case Kind::kTreeCv:
      return std::make_unique<TreeCv>(settings);
    case Kind::kForest:
      return std::make_unique<Forest>(settings);
    case Kind::kSvm:
      return std::make_unique<Svm>(settings);
    case Kind::kKnn:
      return std::make_unique<Knn>(settings);
    case Kind::kTree:
      break;
  }
  return std::make_unique<Cart>(settings);
}

}  // namespace holdfast::learn
