// SPDX-License-Identifier: Apache-2.0
// The slip tree compiler: parse a model's text, check it, emit the header that the firmware compiles or the file that
// it loads.
//
// Text, format 1 (comments from # to the end of the line; see toolchain/model/slip_v2.tree):
//   format 1 | name NAME | feature_set SET | feature NAME UNIT Qn (one line each, in the set's order)
//   node ID: FEATURE <= T ? ID_TRUE : ID_FALSE | leaf ID: hold|slip|slip_now
// The first problem found ends the work; it says where, what and what to do next.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

#include "slip/model.hpp"
#include "slip/model_file.hpp"
#include "slip/tree_io.hpp"

namespace holdfast::treec {

inline constexpr int kFormat = 1;
using model::kMaxDepth;
using model::kMaxNodes;

struct Node {
  int id = 0;
  int line = 0;  // of the text, from 1
  bool is_leaf = false;
  Verdict verdict = Verdict::kHold;  // leaf
  int feature = 0;                   // index into Model::features
  std::int32_t threshold = 0;        // x <= threshold goes to child_true
  int child_true = 0;
  int child_false = 0;

  friend bool operator==(const Node& a, const Node& b) {
    const auto said = [](const Node& n) {
      return std::tuple(n.id, n.is_leaf, n.verdict, n.feature, n.threshold, n.child_true, n.child_false);
    };
    return said(a) == said(b);
  }
};

struct Feature {
  std::string name;
  std::string unit;
  int q = 0;
  int line = 0;

  friend bool operator==(const Feature& a, const Feature& b) {
    return std::tie(a.name, a.unit, a.q) == std::tie(b.name, b.unit, b.q);
  }
};

struct Model {
  std::string name;
  std::string feature_set;
  int feature_set_line = 0;
  std::vector<Feature> features;
  std::vector<Node> nodes;  // in the order of the file
  std::uint32_t text_crc32 = 0;

  friend bool operator==(const Model& a, const Model& b) {
    return std::tie(a.name, a.feature_set, a.features, a.nodes) == std::tie(b.name, b.feature_set, b.features, b.nodes);
  }
};

struct Problem {
  int line = 0;
  std::string what;
  std::string next;
};

// Shape of a checked model: the longest path in predicates.
[[nodiscard]] int depth(const Model& model);

// Syntax. `model` is complete only when nothing is returned.
[[nodiscard]] std::optional<Problem> parse(std::string_view text, Model& model);

// Meaning: features are those of a known set; ids are dense, node 0 is the root, children exist, every node is
// reached exactly once, depth is bounded, every predicate can still go both ways where it stands (which keeps its
// threshold inside the feature's range), and both verdicts occur. The functions below trust this.
[[nodiscard]] std::optional<Problem> check(const Model& model);

// The header in branching form, formatted as the project's .clang-format would, in the namespace holdfast::`space`.
[[nodiscard]] std::string emit(const Model& model, std::string_view space = "slip_tree");

// The text that parses to this model, with `comment` above it (its lines without #). The CRC of that text is another
// matter: parse it again before emit() or to_binary() put it down.
[[nodiscard]] std::string to_text(const Model& model, std::string_view comment = {});

// The same tree as the table that the firmware can load in place of the compiled form, and as the file of that table.
[[nodiscard]] model::Tree to_table(const Model& model);
using Binary = std::array<std::uint8_t, model_file::kBytes>;
[[nodiscard]] Binary to_binary(const Model& model);

// "file:line: what. Likely cause: ... Next: ..."
[[nodiscard]] std::string describe(const Problem& problem, std::string_view file);

}  // namespace holdfast::treec
