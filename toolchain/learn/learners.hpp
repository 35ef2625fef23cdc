// SPDX-License-Identifier: Apache-2.0
// The classifiers: our own tree (cart.hpp), which the device runs, and k-NN, the paper's best, to compare with.
//
// The tree splits by information gain at integer thresholds and weighs each row. k-NN is OpenCV's, with one neighbour,
// on features scaled to zero mean and unit variance of the training rows; it has no weights and cannot be deployed.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "slip/tree_io.hpp"
#include "toolchain/learn/samples.hpp"
#include "toolchain/treec/tree_model.hpp"

namespace holdfast::learn {

// Rows to learn from or to judge, by features of one set: x[row * width + column], columns as the set's members.
struct Matrix {
  const FeatureSet* set = nullptr;
  std::vector<std::int32_t> x;
  std::vector<std::uint8_t> slip;  // 1 = slip
  std::vector<float> weight;       // of each row in training; empty: all 1
  std::vector<int> row;            // index of Samples::rows

  [[nodiscard]] int width() const { return set->size(); }
  [[nodiscard]] int height() const { return static_cast<int>(slip.size()); }
  [[nodiscard]] std::span<const std::int32_t> at(int i) const {
    return std::span(x).subspan(static_cast<std::size_t>(i) * static_cast<std::size_t>(width()),
                                static_cast<std::size_t>(width()));
  }
};

// The judged rows of these trials (indices of Samples::trials). `recorded_weight`: of a row of a recording beside a
// simulated one; there are hundreds of simulated rows for one recorded. `with_empty`: and those of the empty gel, as
// hold.
[[nodiscard]] Matrix matrix_of(const Samples& samples, const FeatureSet& set, std::span<const int> trials,
                               double recorded_weight = 1.0, bool with_empty = false);

// As judge() of pipeline.cpp: where the picture is read, nothing slips without contact.
[[nodiscard]] bool may_slip(const FeatureSet& set, const Row& row);

enum class Kind : std::uint8_t { kTree, kKnn };
[[nodiscard]] std::string_view name_of(Kind kind);

struct Settings {
  Kind kind = Kind::kTree;
  std::uint64_t seed = 1;  // of the folds
  // Of the tree. Both classes weigh the same, whatever their numbers.
  double slip_weight = 1.0;      // of a slip row on top of that; below 1: fewer false alarms, later detection
  double recorded_weight = 1.0;  // of a recorded row (matrix_of)
  int max_depth = 8;
  int min_leaf = 40;   // rows
  double prune = 0.0;  // cost-complexity alpha, share of the total weight that a leaf must pay
};

// Nothing, or why no classifier can learn from these rows: no rows, one class only, weights that are none.
[[nodiscard]] std::optional<std::string> unfit(const Matrix& rows);

class Learner {
 public:
  Learner() = default;
  Learner(const Learner&) = delete;
  Learner& operator=(const Learner&) = delete;
  virtual ~Learner() = default;

  // Nothing, or why it cannot learn: no rows, one class only, not finite.
  [[nodiscard]] virtual std::optional<std::string> fit(const Matrix& rows) = 0;
  // After fit(). One verdict a row, 1 = slip.
  [[nodiscard]] virtual std::vector<std::uint8_t> predict(const Matrix& rows) const = 0;
  // The tree as a model's nodes (treec); empty when the classifier is none.
  [[nodiscard]] virtual std::optional<treec::Model> tree() const { return std::nullopt; }
};

[[nodiscard]] std::unique_ptr<Learner> make_learner(const Settings& settings);

}  // namespace holdfast::learn
