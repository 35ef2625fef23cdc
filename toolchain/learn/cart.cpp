// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/cart.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <utility>

#include "base/math.hpp"

namespace holdfast::learn {
namespace {

// Relative to the root's weight; smaller differences are rounding.
constexpr double kNothing = 1e-12;

// Weight of each class: raw sums, which are exact for weights that are small integers.
struct Mass {
  double hold = 0.0;
  double slip = 0.0;

  void add(bool is_slip, double weight) { (is_slip ? slip : hold) += weight; }
  [[nodiscard]] Mass without(const Mass& other) const { return {hold - other.hold, slip - other.slip}; }
};

double x_log_x(double x) {
  return x > 0.0 ? x * std::log2(x) : 0.0;
}

struct Cut {
  double gain = 0.0;
  int column = 0;
  std::int32_t threshold = 0;
};

class Grower {
 public:
  Grower(const Matrix& rows, const CartConfig& config) : config_(config), width_(rows.width()) {
    for (int i = 0; i < rows.height(); ++i) {
      const double weight = rows.weight.empty() ? 1.0 : static_cast<double>(rows.weight[idx(i)]);
      if (weight <= 0.0) continue;
      slip_.push_back(rows.slip[idx(i)]);
      weight_.push_back(weight);
      total_.add(slip_.back() != 0, weight);
    }
    height_ = static_cast<int>(slip_.size());
    scratch_.resize(idx(height_));
    goes_true_.resize(idx(height_));
    // Sorted once per column; splits keep the order.
    for (int column = 0; column < width_; ++column) {
      std::vector<std::int32_t>& x = x_.emplace_back();
      for (int i = 0; i < rows.height(); ++i) {
        if (rows.weight.empty() || rows.weight[idx(i)] > 0.0F) x.push_back(rows.at(i)[idx(column)]);
      }
      std::vector<int>& order = order_.emplace_back(idx(height_));
      std::iota(order.begin(), order.end(), 0);
      std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return x[idx(a)] < x[idx(b)]; });
    }
    whole_ = weighted(total_.hold, total_.slip);
  }

  BinaryTree grow() {
    visit(0, height_, total_, 0);
    return tidied(tree_);
  }

 private:
  // What a subtree costs: error as a share of the whole, plus prune per leaf.
  using Cost = double;

  [[nodiscard]] double weighted(double hold, double slip) const {
    return hold * config_.hold_weight + slip * config_.slip_weight;
  }

  // Entropy times weight, in bit.
  [[nodiscard]] double impurity(const Mass& mass) const {
    const double hold = mass.hold * config_.hold_weight;
    const double slip = mass.slip * config_.slip_weight;
    return x_log_x(hold + slip) - x_log_x(hold) - x_log_x(slip);
  }

  // Grows the rows [begin, end) of every order below a new node; the node's id is its place at the call.
  Cost visit(int begin, int end, const Mass& mass, int depth) {
    const int id = static_cast<int>(tree_.nodes.size());
    const double hold = mass.hold * config_.hold_weight;
    const double slip = mass.slip * config_.slip_weight;
    TreeNode leaf;
    leaf.slip = slip >= hold;
    tree_.nodes.push_back(leaf);
    const Cost as_leaf = std::min(hold, slip) / whole_ + config_.prune;
    if (depth == config_.max_depth || mass.hold == 0.0 || mass.slip == 0.0) return as_leaf;
    const Cut split = best_split(begin, end, mass);
    if (split.gain <= kNothing * whole_) return as_leaf;

    Mass true_mass;
    const int middle = part(begin, end, split, true_mass);
    TreeNode node;
    node.is_leaf = false;
    node.column = split.column;
    node.threshold = split.threshold;
    node.child_true = id + 1;
    Cost cost = visit(begin, middle, true_mass, depth + 1);
    node.child_false = static_cast<int>(tree_.nodes.size());
    cost += visit(middle, end, mass.without(true_mass), depth + 1);
    if (as_leaf <= cost + kNothing) {
      tree_.nodes.resize(idx(id + 1));
      return as_leaf;
    }
    tree_.nodes[idx(id)] = node;
    return cost;
  }

  [[nodiscard]] Cut best_split(int begin, int end, const Mass& mass) const {
    const double before = impurity(mass);
    const int first = begin + std::max(config_.min_leaf, 1) - 1;  // last row of the smallest true side
    const int last = end - 1 - std::max(config_.min_leaf, 1);     // likewise of the largest
    Cut best;
    for (int column = 0; column < width_; ++column) {
      const std::vector<int>& order = order_[idx(column)];
      const std::vector<std::int32_t>& x = x_[idx(column)];
      const auto value = [&](int i) { return x[idx(order[idx(i)])]; };
      Mass below;
      for (int i = begin; i <= last; ++i) {
        const int row = order[idx(i)];
        const bool is_slip = slip_[idx(row)] != 0;
        below.add(is_slip, weight_[idx(row)]);
        if (i < first || value(i) == value(i + 1)) continue;
        // Between two rows of one class that both stand alone the gain is no larger than at one of the two cuts beside
        // this one: impurity is concave, and the three masses lie on a line (Fayyad and Irani 1992).
        if (i > first && i < last && is_slip == (slip_[idx(order[idx(i + 1)])] != 0) && value(i - 1) != value(i) &&
            value(i + 1) != value(i + 2)) {
          continue;
        }
        const double gain = before - (impurity(below) + impurity(mass.without(below)));
        if (gain > best.gain) {
          best = {gain, column, static_cast<std::int32_t>((std::int64_t{value(i)} + value(i + 1)) >> 1)};
        }
      }
    }
    return best;
  }

  // Parts every order at the split and keeps it sorted. Returns where the false side begins.
  int part(int begin, int end, const Cut& split, Mass& true_mass) {
    const std::vector<std::int32_t>& x = x_[idx(split.column)];
    for (int i = begin; i < end; ++i) {
      const int row = order_[0][idx(i)];
      const bool goes_true = x[idx(row)] <= split.threshold;
      goes_true_[idx(row)] = goes_true ? 1 : 0;
      if (goes_true) true_mass.add(slip_[idx(row)] != 0, weight_[idx(row)]);
    }
    int middle = begin;
    for (std::vector<int>& order : order_) {
      middle = begin;
      int rest = 0;
      for (int i = begin; i < end; ++i) {
        const int row = order[idx(i)];
        if (goes_true_[idx(row)] != 0) {
          order[idx(middle++)] = row;
        } else {
          scratch_[idx(rest++)] = row;
        }
      }
      std::copy_n(scratch_.begin(), rest, order.begin() + middle);
    }
    return middle;
  }

  const CartConfig& config_;
  int width_;
  int height_ = 0;
  std::vector<std::uint8_t> slip_;
  std::vector<double> weight_;
  std::vector<std::vector<std::int32_t>> x_;  // by column
  std::vector<std::vector<int>> order_;       // by column: rows by value
  std::vector<int> scratch_;
  std::vector<std::uint8_t> goes_true_;
  Mass total_;
  double whole_ = 0.0;
  BinaryTree tree_;
};

// Verdict of a subtree that says the same everywhere.
std::optional<bool> only_verdict(const BinaryTree& tree, int id) {
  const TreeNode& node = tree.nodes[idx(id)];
  if (node.is_leaf) return node.slip;
  const std::optional<bool> verdict = only_verdict(tree, node.child_true);
  return verdict && verdict == only_verdict(tree, node.child_false) ? verdict : std::nullopt;
}

}  // namespace

bool BinaryTree::slips(std::span<const std::int32_t> x) const {
  const TreeNode* node = nodes.data();
  while (!node->is_leaf) {
    node = &nodes[idx(x[idx(node->column)] <= node->threshold ? node->child_true : node->child_false)];
  }
  return node->slip;
}

int BinaryTree::leaves() const {
  return static_cast<int>(std::count_if(nodes.begin(), nodes.end(), [](const TreeNode& n) { return n.is_leaf; }));
}

BinaryTree grow_cart(const Matrix& rows, const CartConfig& config) {
  return Grower(rows, config).grow();
}

BinaryTree tidied(const BinaryTree& tree) {
  BinaryTree out;
  std::vector<int> from{0};  // of out's nodes: the node of `tree` that each one stands for
  for (std::size_t i = 0; i < from.size(); ++i) {
    TreeNode node = tree.nodes[idx(from[i])];
    if (const std::optional<bool> verdict = only_verdict(tree, from[i])) {
      node = TreeNode{};
      node.slip = *verdict;
    } else {
      for (int* const child : {&node.child_true, &node.child_false}) {
        from.push_back(*child);
        *child = static_cast<int>(from.size()) - 1;
      }
    }
    out.nodes.push_back(node);
  }
  return out;
}

std::optional<treec::Model> model_of(const BinaryTree& tree, const FeatureSet& set) {
  if (tree.nodes.size() < 2) return std::nullopt;
  treec::Model model;
  model.feature_set = set.name;
  for (int i = 0; i < set.size(); ++i) {
    model.features.push_back({std::string(set[i].name), std::string(set[i].unit), set[i].q, 0});
  }
  for (const TreeNode& from : tree.nodes) {
    treec::Node node;
    node.id = static_cast<int>(model.nodes.size());
    node.is_leaf = from.is_leaf;
    node.verdict = from.slip ? Verdict::kSlip : Verdict::kHold;
    node.feature = from.column;
    node.threshold = from.threshold;
    node.child_true = from.child_true;
    node.child_false = from.child_false;
    model.nodes.push_back(node);
  }
  return model;
}

}  // namespace holdfast::learn
