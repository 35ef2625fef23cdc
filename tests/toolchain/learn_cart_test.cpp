// SPDX-License-Identifier: Apache-2.0
// Our own decision tree against exhaustive search, figures worked out by hand, and what must not change it.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "tests/support/learn_data.hpp"
#include "toolchain/learn/cart.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::learn;

namespace {

// Entropy of one node in bit, by definition.
double impurity(double hold, double slip) {
  const double n = hold + slip;
  if (n == 0.0) return 0.0;
  const double p = hold / n;
  const double q = slip / n;
  return -(p > 0.0 ? p * std::log2(p) : 0.0) - (q > 0.0 ? q * std::log2(q) : 0.0);
}

struct Cut {
  int column = -1;
  std::int32_t threshold = 0;
  double gain = 0.0;
  bool lessens_error = false;
};

// Every integer threshold of every column.
std::vector<Cut> every_cut(const Matrix& m, const CartConfig& config) {
  std::vector<Cut> cuts;
  for (int column = 0; column < m.width(); ++column) {
    std::int32_t least = INT32_MAX;
    std::int32_t most = INT32_MIN;
    for (int i = 0; i < m.height(); ++i) {
      least = std::min(least, m.at(i)[idx(column)]);
      most = std::max(most, m.at(i)[idx(column)]);
    }
    for (std::int32_t t = least; t < most; ++t) {
      double w[2][2] = {};
      int rows[2] = {};
      for (int i = 0; i < m.height(); ++i) {
        const int side = m.at(i)[idx(column)] <= t ? 0 : 1;
        ++rows[side];
        w[side][m.slip[idx(i)]] += m.slip[idx(i)] != 0 ? config.slip_weight : config.hold_weight;
      }
      if (std::min(rows[0], rows[1]) < config.min_leaf) continue;
      const double below = w[0][0] + w[0][1];
      const double above = w[1][0] + w[1][1];
      const double whole = below + above;
      const double gain = impurity(w[0][0] + w[1][0], w[0][1] + w[1][1]) - below / whole * impurity(w[0][0], w[0][1]) -
                          above / whole * impurity(w[1][0], w[1][1]);
      const double error = std::min(w[0][0] + w[1][0], w[0][1] + w[1][1]);
      const double left = std::min(w[0][0], w[0][1]) + std::min(w[1][0], w[1][1]);
      cuts.push_back({column, t, gain, left < error - 1e-9});
    }
  }
  return cuts;
}

Matrix random_matrix(std::mt19937_64& random, const FeatureSet& set, int rows, int values) {
  Matrix m;
  m.set = &set;
  for (int i = 0; i < rows; ++i) {
    for (int c = 0; c < set.size(); ++c) {
      m.x.push_back(static_cast<std::int32_t>(random() % static_cast<std::uint64_t>(values)) - values / 2);
    }
    m.slip.push_back(static_cast<std::uint8_t>(random() % 2));
    m.row.push_back(i);
  }
  return m;
}

bool same(const BinaryTree& a, const BinaryTree& b) {
  return std::equal(
      a.nodes.begin(), a.nodes.end(), b.nodes.begin(), b.nodes.end(), [](const TreeNode& x, const TreeNode& y) {
        return x.is_leaf == y.is_leaf && x.slip == y.slip && x.column == y.column && x.threshold == y.threshold &&
               x.child_true == y.child_true && x.child_false == y.child_false;
      });
}

int depth_of(const BinaryTree& tree, int id = 0) {
  const TreeNode& node = tree.nodes[idx(id)];
  return node.is_leaf ? 0 : 1 + std::max(depth_of(tree, node.child_true), depth_of(tree, node.child_false));
}

int errors_of(const BinaryTree& tree, const Matrix& m) {
  int errors = 0;
  for (int i = 0; i < m.height(); ++i) errors += tree.slips(m.at(i)) != (m.slip[idx(i)] != 0) ? 1 : 0;
  return errors;
}

// Noise with a signal: 400 rows that a deep tree learns by heart.
Matrix noisy(const FeatureSet& set, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  Matrix m = random_matrix(random, set, 400, 60);
  for (int i = 0; i < m.height(); ++i) {
    if (random() % 3 != 0) m.slip[idx(i)] = m.at(i)[0] + m.at(i)[1] > 5 ? 1 : 0;
  }
  return m;
}

}  // namespace

TEST_GROUP(Cart) {
  test::WideSet one{1};
  test::WideSet two{2};
  test::WideSet three{3};
};

// min_leaf 1 to 3 so that the best cut is often not allowed; few values, so many cuts are equally good.
TEST(Cart, FirstSplitIsTheBestOfAll) {
  std::mt19937_64 random(11);
  int split = 0;
  for (int n = 0; n < 3000; ++n) {
    const Matrix m = random_matrix(random, three.set(), 4 + n % 14, 2 + n % 17);
    CartConfig config;
    config.max_depth = 1;
    config.min_leaf = 1 + n % 3;
    config.slip_weight = n % 5 == 0 ? 2.5 : 1.0;
    const BinaryTree tree = grow_cart(m, config);
    double best = 0.0;
    const std::vector<Cut> cuts = every_cut(m, config);
    for (const Cut& cut : cuts) best = std::max(best, cut.gain);
    if (tree.nodes[0].is_leaf) {
      // No cut gains, or one of the best does not lessen the error.
      CHECK_TRUE(best < 1e-9 || std::any_of(cuts.begin(), cuts.end(), [&](const Cut& cut) {
                   return cut.gain > best - 1e-9 && !cut.lessens_error;
                 }));
      continue;
    }
    ++split;
    const TreeNode& root = tree.nodes[0];
    const auto chosen = std::find_if(cuts.begin(), cuts.end(), [&](const Cut& cut) {
      return cut.column == root.column && cut.threshold == root.threshold;
    });
    CHECK_TRUE(chosen != cuts.end());
    DOUBLES_EQUAL(best, chosen->gain, 1e-9);
  }
  CHECK_TRUE(split > 1000);
}

TEST(Cart, ThresholdIsTheMidpointRoundedDown) {
  struct Case {
    std::int32_t low;
    std::int32_t high;
    std::int32_t threshold;
  };
  const Case cases[] = {{0, 1, 0},
                        {1, 4, 2},
                        {-3, 2, -1},
                        {-4, -1, -3},
                        {-1, 0, -1},
                        {INT32_MIN, INT32_MAX, -1},
                        {INT32_MAX - 1, INT32_MAX, INT32_MAX - 1},
                        {INT32_MIN, INT32_MIN + 1, INT32_MIN}};
  for (const Case& c : cases) {
    Matrix m;
    m.set = &one.set();
    test::add_row(m, {c.low}, 0, 2);
    test::add_row(m, {c.high}, 1, 2);
    CartConfig config;
    config.min_leaf = 1;
    const BinaryTree tree = grow_cart(m, config);
    LONGS_EQUAL(c.threshold, tree.nodes.at(0).threshold);
    LONGS_EQUAL(0, errors_of(tree, m));
  }
}

TEST(Cart, WeightsAreRepeatedRows) {
  std::mt19937_64 random(3);
  for (int n = 0; n < 200; ++n) {
    Matrix weighted = random_matrix(random, three.set(), 30, 12);
    Matrix repeated;
    repeated.set = weighted.set;
    for (int i = 0; i < weighted.height(); ++i) {
      const int times = static_cast<int>(random() % 4);
      weighted.weight.push_back(static_cast<float>(times));
      test::add_row(repeated, {weighted.at(i)[0], weighted.at(i)[1], weighted.at(i)[2]}, weighted.slip[idx(i)], times);
    }
    CartConfig config;
    config.min_leaf = 1;
    config.hold_weight = 0.7;
    config.slip_weight = 1.9;
    CHECK_TRUE(same(grow_cart(weighted, config), grow_cart(repeated, config)));
  }
}

TEST(Cart, OrderOfRowsDoesNotMatter) {
  const Matrix m = noisy(three.set(), 8);
  CartConfig config;
  config.min_leaf = 2;
  config.hold_weight = 0.7;
  const BinaryTree want = grow_cart(m, config);
  CHECK_TRUE(same(want, grow_cart(m, config)));
  Matrix reversed;
  reversed.set = m.set;
  for (int i = m.height() - 1; i >= 0; --i) {
    test::add_row(reversed, {m.at(i)[0], m.at(i)[1], m.at(i)[2]}, m.slip[idx(i)]);
  }
  CHECK_TRUE(same(want, grow_cart(reversed, config)));
}

// Twin columns gain the same: the first one is taken, and of two thresholds the lower.
TEST(Cart, TiesGoToTheFirst) {
  Matrix m;
  m.set = &two.set();
  for (const int x : {0, 1, 2, 3}) test::add_row(m, {x, x}, x == 1 || x == 2 ? 1 : 0, 3);
  CartConfig config;
  config.min_leaf = 1;
  const BinaryTree tree = grow_cart(m, config);
  LONGS_EQUAL(0, errors_of(tree, m));
  for (const TreeNode& node : tree.nodes) LONGS_EQUAL(0, node.column);
  LONGS_EQUAL(0, tree.nodes[0].threshold);
}

TEST(Cart, HoldsItsBounds) {
  const Matrix m = noisy(three.set(), 5);
  for (const int depth : {1, 2, 5, 16}) {
    for (const int min_leaf : {1, 7, 40, 200, 201}) {
      CartConfig config;
      config.max_depth = depth;
      config.min_leaf = min_leaf;
      const BinaryTree tree = grow_cart(m, config);
      CHECK_TRUE(depth_of(tree) <= depth);
      std::vector<int> rows(tree.nodes.size());
      for (int i = 0; i < m.height(); ++i) {
        int at = 0;
        while (!tree.nodes[idx(at)].is_leaf) {
          const TreeNode& node = tree.nodes[idx(at)];
          at = m.at(i)[idx(node.column)] <= node.threshold ? node.child_true : node.child_false;
        }
        ++rows[idx(at)];
      }
      for (std::size_t i = 0; i < rows.size(); ++i) {
        CHECK_TRUE(!tree.nodes[i].is_leaf || rows[i] >= std::min(min_leaf, m.height()));
      }
      if (min_leaf > 200) LONGS_EQUAL(1, tree.nodes.size());
    }
  }
}

TEST(Cart, OneClassIsOneLeaf) {
  Matrix m;
  m.set = &one.set();
  test::add_row(m, {1}, 1);
  test::add_row(m, {2}, 1);
  const BinaryTree tree = grow_cart(m, {});
  LONGS_EQUAL(1, tree.nodes.size());
  CHECK_TRUE(tree.nodes[0].slip);
  CHECK_FALSE(model_of(tree, one.set()).has_value());
}

// The more a leaf costs, the fewer there are and the more errors they make; the cost of what is kept is never above the
// cost of any other tree of the row, nor of the single leaf.
TEST(Cart, PruningIsMonotoneAndCheapest) {
  const Matrix m = noisy(three.set(), 9);
  CartConfig config;
  config.max_depth = 10;
  config.min_leaf = 1;
  std::vector<BinaryTree> trees;
  const std::vector<double> prices{0.0, 0.001, 0.003, 0.006, 0.01, 0.03, 0.1, 0.5, 1.0};
  for (const double prune : prices) {
    config.prune = prune;
    trees.push_back(grow_cart(m, config));
  }
  for (std::size_t i = 1; i < trees.size(); ++i) {
    CHECK_TRUE(trees[i].leaves() <= trees[i - 1].leaves());
    CHECK_TRUE(errors_of(trees[i], m) >= errors_of(trees[i - 1], m));
  }
  CHECK_TRUE(trees[0].leaves() > trees[4].leaves());
  LONGS_EQUAL(1, trees.back().leaves());
  const auto cost = [&](const BinaryTree& tree, double price) {
    return static_cast<double>(errors_of(tree, m)) / m.height() + price * tree.leaves();
  };
  for (std::size_t i = 0; i < trees.size(); ++i) {
    for (const BinaryTree& other : trees) CHECK_TRUE(cost(trees[i], prices[i]) <= cost(other, prices[i]) + 1e-9);
  }
}

TEST(Cart, NoNodeHasTwoLeavesOfOneVerdict) {
  for (std::uint64_t seed = 1; seed < 20; ++seed) {
    CartConfig config;
    config.min_leaf = 3;
    config.slip_weight = 1.0 / static_cast<double>(seed);
    const BinaryTree tree = grow_cart(noisy(three.set(), seed), config);
    int expected = 1;  // children follow level by level
    for (const TreeNode& node : tree.nodes) {
      if (node.is_leaf) continue;
      LONGS_EQUAL(expected++, node.child_true);
      LONGS_EQUAL(expected++, node.child_false);
      const TreeNode& a = tree.nodes[idx(node.child_true)];
      const TreeNode& b = tree.nodes[idx(node.child_false)];
      CHECK_TRUE(!a.is_leaf || !b.is_leaf || a.slip != b.slip);
    }
    LONGS_EQUAL(expected, tree.nodes.size());
  }
}

TEST(Cart, TidyingKeepsEveryVerdict) {
  // 0: x <= 5 ? (x <= 2 ? slip : slip) : hold, laid out in another order.
  BinaryTree tree;
  tree.nodes.resize(5);
  tree.nodes[0] = {false, false, 0, 5, 3, 1};
  tree.nodes[1] = {true, false, 0, 0, 0, 0};
  tree.nodes[2] = {true, true, 0, 0, 0, 0};
  tree.nodes[3] = {false, false, 0, 2, 2, 4};
  tree.nodes[4] = {true, true, 0, 0, 0, 0};
  const BinaryTree tidy = tidied(tree);
  LONGS_EQUAL(3, tidy.nodes.size());
  for (std::int32_t x = 0; x < 10; ++x) CHECK_EQUAL(tree.slips(std::vector{x}), tidy.slips(std::vector{x}));
}
