// SPDX-License-Identifier: Apache-2.0
// The marker score of a model: what firmware/slip/score.hpp computes, learned by logistic regression.
//
// The probability of slip is 1 / (1 + 2^-score). What the score reads is settled (kScoreInputs); weights and bias are
// learned from the rows that the tree learns from, weighted alike, and rounded to the device's integers. From there on
// everything, the tree's thresholds too, sees the score that the device computes: column marker_score of a matrix comes
// from fill_score() alone, whatever a file of samples says, because it belongs to a model and not to a frame.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "slip/score.hpp"
#include "toolchain/learn/learners.hpp"
#include "toolchain/learn/samples.hpp"

namespace holdfast::learn {

// --- the regression ---

// ln of the odds of slip = bias + sum of weights[i] x[i].
struct Logistic {
  double bias = 0.0;
  std::vector<double> weights;
  int steps = 0;
};

// Least mean loss + ridge / 2 * sum of squared weights, each times its column's deviation (the bias goes free), by
// Newton's method; a step that does not help is halved, a guard that no rows tried so far have called on. The ridge
// keeps the weights of classes that a plane parts finite; a column that does not vary weighs 0. Range: x in rows of
// `width`, finite; a weight of 0 or more for each row, rows of both classes that weigh more than 0.
inline constexpr double kRidge = 1e-4;  // moves a weight by 0.1 % where a tenth of the rows is in doubt
[[nodiscard]] Logistic fit_logistic(std::span<const double> x, int width, std::span<const std::uint8_t> slip,
                                    std::span<const double> weight, double ridge = kRidge);

// Share of the pairs of a slip row and a hold row in which the slip's value is larger; equal ones count half. 1/2 when
// one class is missing.
[[nodiscard]] double auc_of(std::span<const double> values, std::span<const std::uint8_t> slip);

// --- the score ---

struct ScoreInput {
  std::string_view feature;
  std::uint16_t offset = 1;  // raw
};

// Chosen on 27 recorded clips, one object left out at a time, new alarms within 10 frames of 14 onsets at 0.8 and 2.7
// false alarms a minute: Vx, Vy, dE/dt and E 6 and 6; with the residual and its rate 9 and 11; with the spread of the
// flow 12 and 13. The length of V in place of its two parts changes none of these, nor does E as it is in place of its
// logarithm. Further features (flow_residual, dilation_rate, shift) do not help.
// Offsets: the RMS on the empty gel of these clips, to a round number; the entropies, which are 0 there, have what one
// of 63 markers in another bin makes: 0.082 nat, in 40 ms 2 nat/s. Twice or half of all of them moves one onset.
inline constexpr std::array<ScoreInput, 7> kScoreInputs{{
    {"vx_um_s", 16},
    {"vy_um_s", 16},
    {"entropy_nat_q16", 5342},
    {"entropy_rate_nat_s_q8", 512},
    {"residual_um_q4", 96},
    {"residual_rate_um_s", 8},
    {"flow_spread_um_s", 32},
}};
static_assert(kScoreInputs.size() <= score::kMaxTerms);

// Figures of the rounded score on some rows.
struct ScoreFigures {
  double auc = 0.5;
  double balanced_accuracy = 0.5;  // at the threshold that is best for these rows: an upper bound
};

// Learns from the rows of `train`, whatever its columns. Nothing, or why there is no score: as Learner::fit(), or no
// feature weighs anything.
[[nodiscard]] std::optional<std::string> fit_score(const Samples& samples, const Matrix& train,
                                                   const Settings& settings, score::Score& score,
                                                   std::span<const ScoreInput> inputs = kScoreInputs);

// The firmware's score of one row.
[[nodiscard]] std::int32_t score_of(const score::Score& score, const Features& x);

// Writes marker_score into a matrix that has this column.
void fill_score(const Samples& samples, const score::Score& score, Matrix& matrix);

// Both, when the set of `train` reads the score; otherwise `score` is none and all stays as it is. Whoever fits a
// classifier calls this with the rows that it learns from, and fill_score() with those that it judges, so that no score
// has seen what it is judged by.
[[nodiscard]] std::optional<std::string> fit_and_fill(const Samples& samples, const Settings& settings, Matrix& train,
                                                      score::Score& score);

[[nodiscard]] ScoreFigures figures_of(const Samples& samples, const score::Score& score, const Matrix& rows);

// The features of a row as a model sees them: with its own score.
[[nodiscard]] Features seen_by(const score::Score& score, Features x);

}  // namespace holdfast::learn
