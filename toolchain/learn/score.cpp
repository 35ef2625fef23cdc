// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/score.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <numeric>

#include "base/math.hpp"
#include "toolchain/learn/evaluate.hpp"

namespace holdfast::learn {
namespace {

constexpr std::uint8_t kColumn = score::index_of("marker_score_log2_q8");
static_assert(kColumn < kFeatureCount && kFeatures[kColumn].stage == Stage::kScore);

// ln(1 + e^z) without overflow.
double softplus(double z) {
  return std::max(z, 0.0) + std::log1p(std::exp(-std::abs(z)));
}

// The regression on columns of zero mean and unit deviation; coefficient `width` is the bias.
class Newton {
 public:
  Newton(std::span<const double> x, int width, std::span<const std::uint8_t> slip, std::span<const double> weight,
         double ridge)
      : x_(x), width_(idx(width)), slip_(slip), weight_(weight), ridge_(ridge), mean_(width_), deviation_(width_) {
    sum_ = std::accumulate(weight.begin(), weight.end(), 0.0);
    for (std::size_t c = 0; c < width_; ++c) {
      for (std::size_t r = 0; r < slip.size(); ++r) mean_[c] += weight[r] * x[r * width_ + c] / sum_;
      for (std::size_t r = 0; r < slip.size(); ++r) {
        const double d = x[r * width_ + c] - mean_[c];
        deviation_[c] += weight[r] * d * d / sum_;
      }
      // Less than rounding leaves of a constant is no deviation.
      deviation_[c] = std::sqrt(deviation_[c]);
      if (deviation_[c] <= 1e-12 * (1.0 + std::abs(mean_[c]))) deviation_[c] = 0.0;
    }
  }

  [[nodiscard]] Logistic run() const {
    std::vector<double> at(width_ + 1);
    double loss = loss_of(at);
    int steps = 0;
    for (bool goes_on = true; goes_on && steps < kMostSteps; ++steps) {
      const std::vector<double> step = step_from(at);
      goes_on = false;
      for (double share = 1.0; share > 1e-6; share *= 0.5) {
        std::vector<double> next = at;
        for (std::size_t c = 0; c <= width_; ++c) next[c] -= share * step[c];
        const double less = loss_of(next);
        if (!(less < loss)) continue;
        goes_on = loss - less > 1e-13 * loss;
        at = std::move(next);
        loss = less;
        break;
      }
    }
    Logistic out{at[width_], std::vector<double>(width_), steps};
    for (std::size_t c = 0; c < width_; ++c) {
      if (deviation_[c] == 0.0) continue;
      out.weights[c] = at[c] / deviation_[c];
      out.bias -= out.weights[c] * mean_[c];
    }
    return out;
  }

 private:
  static constexpr int kMostSteps = 200;

  [[nodiscard]] double scaled(std::size_t row, std::size_t column) const {
    if (column == width_) return 1.0;
    return deviation_[column] == 0.0 ? 0.0 : (x_[row * width_ + column] - mean_[column]) / deviation_[column];
  }

  [[nodiscard]] double log_odds(std::size_t row, const std::vector<double>& at) const {
    double sum = 0.0;
    for (std::size_t c = 0; c <= width_; ++c) sum += at[c] * scaled(row, c);
    return sum;
  }

  [[nodiscard]] double loss_of(const std::vector<double>& at) const {
    double loss = 0.0;
    for (std::size_t r = 0; r < slip_.size(); ++r) {
      const double z = log_odds(r, at);
      loss += weight_[r] / sum_ * softplus(slip_[r] != 0 ? -z : z);
    }
    for (std::size_t c = 0; c < width_; ++c) loss += 0.5 * ridge_ * at[c] * at[c];
    return loss;
  }

  // Hessian^-1 gradient, by Cholesky's factors of the Hessian. A constant column has only the ridge; the bias keeps a
  // hundred-millionth of it, for rows that are all certain.
  [[nodiscard]] std::vector<double> step_from(const std::vector<double>& at) const {
    const std::size_t n = width_ + 1;
    std::vector<double> gradient(n);
    std::vector<double> hessian(n * n);
    std::vector<double> row(n);
    for (std::size_t r = 0; r < slip_.size(); ++r) {
      for (std::size_t c = 0; c < n; ++c) row[c] = scaled(r, c);
      const double p = 1.0 / (1.0 + std::exp(-std::inner_product(row.begin(), row.end(), at.begin(), 0.0)));
      const double off = weight_[r] / sum_ * (p - (slip_[r] != 0 ? 1.0 : 0.0));
      const double curve = weight_[r] / sum_ * p * (1.0 - p);
      for (std::size_t a = 0; a < n; ++a) {
        gradient[a] += off * row[a];
        for (std::size_t b = 0; b <= a; ++b) hessian[a * n + b] += curve * row[a] * row[b];
      }
    }
    for (std::size_t c = 0; c < width_; ++c) {
      gradient[c] += ridge_ * at[c];
      hessian[c * n + c] += ridge_;
    }
    hessian[width_ * n + width_] += 1e-12;
    for (std::size_t a = 0; a < n; ++a) {
      for (std::size_t b = 0; b <= a; ++b) {
        double rest = hessian[a * n + b];
        for (std::size_t k = 0; k < b; ++k) rest -= hessian[a * n + k] * hessian[b * n + k];
        hessian[a * n + b] = a == b ? std::sqrt(std::max(rest, 1e-15)) : rest / hessian[b * n + b];
      }
    }
    for (std::size_t a = 0; a < n; ++a) {
      for (std::size_t k = 0; k < a; ++k) gradient[a] -= hessian[a * n + k] * gradient[k];
      gradient[a] /= hessian[a * n + a];
    }
    for (std::size_t a = n; a-- > 0;) {
      for (std::size_t k = a + 1; k < n; ++k) gradient[a] -= hessian[k * n + a] * gradient[k];
      gradient[a] /= hessian[a * n + a];
    }
    return gradient;
  }

  std::span<const double> x_;
  std::size_t width_;
  std::span<const std::uint8_t> slip_;
  std::span<const double> weight_;
  double ridge_;
  double sum_ = 0.0;
  std::vector<double> mean_;
  std::vector<double> deviation_;
};

// As the device has it.
double octaves(std::int32_t x, std::uint16_t offset) {
  return log2_q8(static_cast<std::uint64_t>(std::abs(std::int64_t{x}) + offset)) / 256.0;
}

}  // namespace

Logistic fit_logistic(std::span<const double> x, int width, std::span<const std::uint8_t> slip,
                      std::span<const double> weight, double ridge) {
  return Newton(x, width, slip, weight, ridge).run();
}

double auc_of(std::span<const double> values, std::span<const std::uint8_t> slip) {
  std::vector<std::size_t> order(values.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return values[a] < values[b]; });
  double holds_below = 0.0;
  double slips = 0.0;
  double won = 0.0;
  for (std::size_t i = 0; i < order.size();) {
    double equal_holds = 0.0;
    double equal_slips = 0.0;
    const double value = values[order[i]];
    for (; i < order.size() && values[order[i]] == value; ++i) {
      (slip[order[i]] != 0 ? equal_slips : equal_holds) += 1.0;
    }
    won += equal_slips * (holds_below + 0.5 * equal_holds);
    holds_below += equal_holds;
    slips += equal_slips;
  }
  return slips > 0.0 && holds_below > 0.0 ? won / (slips * holds_below) : 0.5;
}

std::optional<std::string> fit_score(const Samples& samples, const Matrix& train, const Settings& settings,
                                     score::Score& score, std::span<const ScoreInput> inputs) {
  score = {};
  if (auto error = unfit(train)) return error;
  std::vector<double> x;
  x.reserve(train.slip.size() * inputs.size());
  for (const int r : train.row) {
    for (const ScoreInput& input : inputs) {
      x.push_back(octaves(samples.rows[idx(r)].x[score::index_of(input.feature)], input.offset));
    }
  }
  const std::vector<double> weight = row_weights(settings, train);
  const Logistic fit = fit_logistic(x, static_cast<int>(inputs.size()), train.slip, weight);

  // ln to log2. What a weight loses by rounding, the bias takes at the column's mean.
  constexpr double kQ8 = 256.0;
  const double sum = std::accumulate(weight.begin(), weight.end(), 0.0);
  double bias_q8 = fit.bias / std::numbers::ln2 * kQ8;
  for (std::size_t i = 0; i < inputs.size(); ++i) {
    const double exact_q8 = fit.weights[i] / std::numbers::ln2 * kQ8;
    const double rounded_q8 = std::clamp(std::round(exact_q8), -32767.0, 32767.0);
    double mean = 0.0;
    for (std::size_t r = 0; r < weight.size(); ++r) mean += weight[r] / sum * x[r * inputs.size() + i];
    bias_q8 += (exact_q8 - rounded_q8) * mean;
    if (rounded_q8 == 0.0) continue;
    score.terms[idx(score.count++)] = {score::index_of(inputs[i].feature), static_cast<std::int16_t>(rounded_q8),
                                       inputs[i].offset};
  }
  if (score.count == 0) return "no feature of the markers tells anything about slip";
  score.bias_q8 = static_cast<std::int32_t>(std::lround(bias_q8));
  return std::nullopt;
}

std::int32_t score_of(const score::Score& score, const Features& x) {
  std::array<std::int32_t, score::kMaxTerms> read{};
  for (int i = 0; i < score.count; ++i) read[idx(i)] = x[score.terms[idx(i)].feature];
  Saturations unused;
  return score::of(score, read, unused).raw();
}

void fill_score(const Samples& samples, const score::Score& score, Matrix& matrix) {
  const auto& members = matrix.set->members;
  const auto at = std::ranges::find(members, kColumn);
  if (at == members.end()) return;
  const auto column = static_cast<std::size_t>(at - members.begin());
  for (std::size_t i = 0; i < matrix.row.size(); ++i) {
    matrix.x[i * members.size() + column] = score_of(score, samples.rows[idx(matrix.row[i])].x);
  }
}

std::optional<std::string> fit_and_fill(const Samples& samples, const Settings& settings, Matrix& train,
                                        score::Score& score) {
  score = {};
  if (!reads(*train.set, Stage::kScore)) return std::nullopt;
  if (auto error = fit_score(samples, train, settings, score)) return error;
  fill_score(samples, score, train);
  return std::nullopt;
}

ScoreFigures figures_of(const Samples& samples, const score::Score& score, const Matrix& rows) {
  std::vector<double> values;
  values.reserve(rows.row.size());
  for (const int r : rows.row) values.push_back(score_of(score, samples.rows[idx(r)].x));
  return {auc_of(values, rows.slip), best_threshold(values, rows.slip).balanced_accuracy};
}

Features seen_by(const score::Score& score, Features x) {
  if (score.count > 0) x[kColumn] = score_of(score, x);
  return x;
}

}  // namespace holdfast::learn
