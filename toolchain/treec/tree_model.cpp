// SPDX-License-Identifier: Apache-2.0
#include "toolchain/treec/tree_model.hpp"

#include <algorithm>
#include <charconv>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <iterator>
#include <span>
#include <utility>

#include "base/crc32.hpp"

namespace holdfast::treec {
namespace {

constexpr std::size_t kMaxNameLength = model::kNameBytes;
constexpr std::string_view kNodeForm = "write `node ID: FEATURE <= INTEGER ? ID : ID`";
constexpr std::string_view kLeafForm = "write `leaf ID: hold`, `leaf ID: slip` or `leaf ID: slip_now`";

// What a leaf may say: in a model text, and in the header that is made of it.
struct Leaf {
  std::string_view text;
  Verdict verdict;
  std::string_view literal;
};
constexpr std::array<Leaf, 3> kLeaves{{
    {"hold", Verdict::kHold, "Verdict::kHold"},
    {"slip", Verdict::kSlip, "Verdict::kSlip"},
    {"slip_now", Verdict::kSlipNow, "Verdict::kSlipNow"},
}};

std::string in_quotes(std::string_view text) {
  return "'" + std::string(text) + "'";
}

// Words of one line without its comment; ':' and '?' stand alone wherever they touch a word.
std::vector<std::string_view> split(std::string_view line) {
  line = line.substr(0, line.find('#'));
  std::vector<std::string_view> words;
  for (std::size_t i = 0; i < line.size();) {
    const std::size_t end = line.find_first_of(" \t:?", i);
    const std::size_t length = std::min(end, line.size()) - i;
    if (length > 0) words.push_back(line.substr(i, length));
    i += length;
    if (i < line.size() && (line[i] == ':' || line[i] == '?')) words.push_back(line.substr(i, 1));
    ++i;
  }
  return words;
}

template <typename Integer>
std::optional<Integer> to_integer(std::string_view word) {
  Integer value{};
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc{} || end != word.data() + word.size()) return std::nullopt;
  return value;
}

// Names go into C++ source as they are.
bool is_name(std::string_view word) {
  if (word.empty() || word.size() > kMaxNameLength || word[0] < 'a' || word[0] > 'z') return false;
  return std::all_of(word.begin(), word.end(),
                     [](char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_'; });
}

// One pass over the lines; each `on_` method takes the words of one line.
class Parser {
 public:
  explicit Parser(Model& model) : model_(model) {}

  std::optional<Problem> line(std::string_view text) {
    ++line_;
    if (text.find('\r') != std::string_view::npos) {
      return problem("the line ends with a carriage return", "save the file with Unix line ends");
    }
    const std::vector<std::string_view> words = split(text);
    if (words.empty()) return std::nullopt;
    const std::string_view key = words[0];
    if (!has_format_) return on_format(words);
    if (key == "name") return on_name(words);
    if (key == "feature_set") return on_feature_set(words);
    if (key == "feature") return on_feature(words);
    if (key == "node" || key == "leaf") return on_node(words);
    return problem("unknown word " + in_quotes(key), "use name, feature_set, feature, node, leaf or a # comment");
  }

  std::optional<Problem> end() {
    if (!has_format_) return problem("the file holds no model", "start with the line `format 1`");
    if (model_.name.empty()) return problem("the model has no name", "add the line `name NAME`");
    if (model_.feature_set.empty()) {
      return problem("the model names no feature set", "add the line `feature_set paper`");
    }
    if (model_.nodes.empty()) {
      return problem("the model has no nodes", "the file may be cut off; add `node` and `leaf` lines");
    }
    return std::nullopt;
  }

 private:
  using Words = std::vector<std::string_view>;

  [[nodiscard]] Problem problem(std::string what, std::string_view next) const {
    return {std::max(line_, 1), std::move(what), std::string(next)};
  }

  std::optional<Problem> on_format(const Words& words) {
    if (words.size() != 2 || words[0] != "format") {
      return problem("the file does not start with its format", "start with the line `format 1`");
    }
    if (to_integer<int>(words[1]) != kFormat) {
      return problem("format " + in_quotes(words[1]) + " is not known here",
                     "use the holdfast that belongs to this model, or write it as format 1");
    }
    has_format_ = true;
    return std::nullopt;
  }

  std::optional<Problem> on_name(const Words& words) {
    if (!model_.name.empty()) return problem("the model has two names", "keep one `name` line");
    if (words.size() != 2 || !is_name(words[1])) {
      return problem("this is not a model name", "write `name NAME` with at most 32 of a-z, 0-9 and _, a letter first");
    }
    model_.name = words[1];
    return std::nullopt;
  }

  std::optional<Problem> on_feature_set(const Words& words) {
    if (!model_.feature_set.empty()) {
      return problem("the model names two feature sets", "keep one `feature_set` line");
    }
    if (words.size() != 2) return problem("this is not a feature set", "write `feature_set NAME`");
    model_.feature_set = words[1];
    model_.feature_set_line = line_;
    return std::nullopt;
  }

  std::optional<Problem> on_feature(const Words& words) {
    if (!model_.nodes.empty()) {
      return problem("a feature follows the first node", "list all features before the nodes");
    }
    std::optional<int> q;
    if (words.size() == 4 && words[3].starts_with('Q')) q = to_integer<int>(words[3].substr(1));
    if (!q) return problem("this is not a feature", "write `feature NAME UNIT Qn`");
    model_.features.push_back({std::string(words[1]), std::string(words[2]), *q, line_});
    return std::nullopt;
  }

  std::optional<Problem> on_node(const Words& words) {
    if (model_.nodes.size() == kMaxNodes) {
      return problem("the tree has more than " + std::to_string(kMaxNodes) + " nodes",
                     "prune it: fewer leaves or less depth");
    }
    Node node;
    node.line = line_;
    node.is_leaf = words[0] == "leaf";
    const std::string_view form = node.is_leaf ? kLeafForm : kNodeForm;
    const std::optional<int> id = words.size() > 1 ? to_integer<int>(words[1]) : std::nullopt;
    if (!id) return problem("the node has no id", form);
    node.id = *id;
    if (words.size() < 3 || words[2] != ":") return problem("there is no ':' behind the id", form);
    if (auto found = node.is_leaf ? leaf_body(words, node) : node_body(words, node)) return found;
    model_.nodes.push_back(node);
    return std::nullopt;
  }

  std::optional<Problem> leaf_body(const Words& words, Node& node) const {
    const auto* const found = words.size() == 4 ? std::ranges::find(kLeaves, words[3], &Leaf::text) : kLeaves.end();
    if (found == kLeaves.end()) return problem("the leaf's class is neither hold nor slip", kLeafForm);
    node.verdict = found->verdict;
    return std::nullopt;
  }

  std::optional<Problem> node_body(const Words& words, Node& node) const {
    if (words.size() != 10 || words[6] != "?" || words[8] != ":") {
      return problem("the node is not complete", kNodeForm);
    }
    const auto feature = std::find_if(model_.features.begin(), model_.features.end(),
                                      [&](const Feature& f) { return f.name == words[3]; });
    if (feature == model_.features.end()) {
      return problem("the node reads " + in_quotes(words[3]) + ", which no `feature` line lists",
                     "use a listed feature");
    }
    node.feature = static_cast<int>(feature - model_.features.begin());
    if (words[4] != "<=") {
      return problem("the predicate " + in_quotes(words[4]) + " is not known", "the only one is `x <= t`");
    }
    const auto threshold = to_integer<std::int32_t>(words[5]);
    if (!threshold) {
      return problem("the threshold " + in_quotes(words[5]) + " is not a 32-bit integer",
                     "round the trained value down: x <= t and x <= floor(t) agree on integers");
    }
    node.threshold = *threshold;
    const auto child_true = to_integer<int>(words[7]);
    const auto child_false = to_integer<int>(words[9]);
    if (!child_true || !child_false) return problem("a child is not a node id", kNodeForm);
    node.child_true = *child_true;
    node.child_false = *child_false;
    return std::nullopt;
  }

  Model& model_;
  int line_ = 0;
  bool has_format_ = false;
};

std::optional<Problem> check_features(const Model& model) {
  const FeatureSet* const set = find_feature_set(model.feature_set);
  if (set == nullptr) {
    std::string known;
    for (const FeatureSet& s : kFeatureSets) known += (known.empty() ? "" : ", ") + std::string(s.name);
    return Problem{model.feature_set_line, "feature set " + in_quotes(model.feature_set) + " is not known",
                   "this firmware has: " + known};
  }
  for (std::size_t i = 0; i < std::max(model.features.size(), set->members.size()); ++i) {
    if (i == set->members.size()) {
      return Problem{model.features[i].line, "the set " + model.feature_set + " ends before this feature",
                     "remove the line"};
    }
    const FeatureInfo& want = (*set)[static_cast<int>(i)];
    const std::string form =
        "`feature " + std::string(want.name) + " " + std::string(want.unit) + " Q" + std::to_string(want.q) + "`";
    if (i == model.features.size()) {
      return Problem{model.feature_set_line, "a feature of the set " + model.feature_set + " is missing",
                     "add the line " + form};
    }
    const Feature& have = model.features[i];
    if (have.name != want.name || have.unit != want.unit || have.q != want.q) {
      return Problem{have.line,
                     "feature " + std::to_string(i + 1) + " of the set " + model.feature_set +
                         " has another name, unit or Q format",
                     "write " + form};
    }
  }
  return std::nullopt;
}

std::optional<Problem> check_ids(const Model& model) {
  for (std::size_t i = 0; i < model.nodes.size(); ++i) {
    const Node& node = model.nodes[i];
    const int want = static_cast<int>(i);
    if (node.id == want) continue;
    const bool seen = node.id >= 0 && node.id < want;
    return Problem{node.line,
                   seen ? "node " + std::to_string(node.id) + " is there twice"
                        : "node " + std::to_string(node.id) + " follows where node " + std::to_string(want) + " is due",
                   "number the nodes 0, 1, 2, ... in the order of the file"};
  }
  return std::nullopt;
}

struct Interval {
  std::int32_t min;
  std::int32_t max;
};

// Walks the tree from the root with the interval that the predicates above leave to each feature.
class Walk {
 public:
  explicit Walk(const Model& model) : model_(model), reached_from_(model.nodes.size(), kNobody) {}

  std::optional<Problem> run() {
    std::vector<Interval> intervals;
    const FeatureSet& set = *find_feature_set(model_.feature_set);
    intervals.reserve(set.members.size());
    for (int i = 0; i < set.size(); ++i) intervals.push_back({set[i].min, set[i].max});
    if (auto found = visit(0, kRoot, 0, intervals)) return found;
    for (const Node& node : model_.nodes) {
      if (reached_from_[static_cast<std::size_t>(node.id)] == kNobody) {
        return Problem{node.line, "no path leads to node " + std::to_string(node.id),
                       "remove the node or name it as a child"};
      }
    }
    return std::nullopt;
  }

 private:
  static constexpr int kNobody = -1;
  static constexpr int kRoot = -2;

  std::optional<Problem> visit(int id, int parent, int level, const std::vector<Interval>& intervals) {
    const Node& node = model_.nodes[static_cast<std::size_t>(id)];
    const std::string name = "node " + std::to_string(id);
    reached_from_[static_cast<std::size_t>(id)] = parent;
    if (node.is_leaf) return std::nullopt;
    if (level == kMaxDepth) {
      return Problem{node.line, name + " stands deeper than " + std::to_string(kMaxDepth) + " predicates",
                     "prune the tree"};
    }
    const Interval& interval = intervals[static_cast<std::size_t>(node.feature)];
    if (node.threshold < interval.min || node.threshold >= interval.max) {
      const Feature& feature = model_.features[static_cast<std::size_t>(node.feature)];
      return Problem{node.line,
                     "the threshold " + std::to_string(node.threshold) + " decides nothing: " + feature.name +
                         " lies in " + std::to_string(interval.min) + ".." + std::to_string(interval.max) + " here",
                     "give a threshold from " + std::to_string(interval.min) + " to " +
                         std::to_string(std::int64_t{interval.max} - 1) + ", or remove the node"};
    }
    for (const bool side : {true, false}) {
      const int child = side ? node.child_true : node.child_false;
      if (child < 0 || child >= static_cast<int>(model_.nodes.size())) {
        return Problem{node.line, "child " + std::to_string(child) + " does not exist",
                       "name a node or leaf of this file"};
      }
      const int other_parent = reached_from_[static_cast<std::size_t>(child)];
      if (other_parent != kNobody) {
        return Problem{
            node.line,
            is_above(child, id)
                ? "child " + std::to_string(child) + " stands above " + name + ": the tree runs in a circle"
                : "child " + std::to_string(child) + " is also a child of node " + std::to_string(other_parent),
            "give each node one parent"};
      }
      std::vector<Interval> rest = intervals;
      Interval& narrowed = rest[static_cast<std::size_t>(node.feature)];
      if (side) {
        narrowed.max = node.threshold;
      } else {
        narrowed.min = node.threshold + 1;
      }
      if (auto found = visit(child, id, level + 1, rest)) return found;
    }
    return std::nullopt;
  }

  // Whether `ancestor` is on the path from the root to `id`, both included.
  [[nodiscard]] bool is_above(int ancestor, int id) const {
    while (id != ancestor && id != kRoot) id = reached_from_[static_cast<std::size_t>(id)];
    return id == ancestor;
  }

  const Model& model_;
  std::vector<int> reached_from_;  // parent of each node, by id
};

int depth_below(const Model& model, int id) {
  const Node& node = model.nodes[static_cast<std::size_t>(id)];
  if (node.is_leaf) return 0;
  return 1 + std::max(depth_below(model, node.child_true), depth_below(model, node.child_false));
}

// Appends the subtree of `id` in preorder.
void fill_table(const Model& model, int id, model::Tree& table) {
  const Node& from = model.nodes[static_cast<std::size_t>(id)];
  model::Node& to = table.nodes[static_cast<std::size_t>(table.count++)];
  if (from.is_leaf) {
    to.kind = from.verdict == Verdict::kHold      ? model::Kind::kHold
              : from.verdict == Verdict::kSlipNow ? model::Kind::kSlipNow
                                                  : model::Kind::kSlip;
    return;
  }
  to.kind = model::Kind::kSplit;
  to.threshold = from.threshold;
  to.feature = static_cast<std::uint8_t>(from.feature);
  fill_table(model, from.child_true, table);
  to.child_false = static_cast<std::uint16_t>(table.count);
  fill_table(model, from.child_false, table);
}

const Leaf& leaf_of(const Node& node) {
  return *std::ranges::find(kLeaves, node.verdict, &Leaf::verdict);
}

// Each branch returns, so the false side needs no else and no further indent.
void emit_node(const Model& model, int id, int level, std::string& out) {
  const Node& node = model.nodes[static_cast<std::size_t>(id)];
  const std::string indent(static_cast<std::size_t>(2 * level), ' ');
  const std::string return_word = "return ";
  if (node.is_leaf) {
    out += indent + return_word + std::string(leaf_of(node).literal) + ";\n";
    return;
  }
  out += indent + "if (" + model.features[static_cast<std::size_t>(node.feature)].name +
         " <= " + std::to_string(node.threshold) + ") ";
  const Node& low = model.nodes[static_cast<std::size_t>(node.child_true)];
  if (low.is_leaf) {
    out += return_word + std::string(leaf_of(low).literal) + ";\n";
  } else {
    out += "{\n";
    emit_node(model, node.child_true, level + 1, out);
    out += indent + "}\n";
  }
  emit_node(model, node.child_false, level, out);
}

}  // namespace

int depth(const Model& model) {
  return depth_below(model, 0);
}

std::optional<Problem> parse(std::string_view text, Model& model) {
  model = {};
  model.text_crc32 = crc32({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  Parser parser(model);
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    if (auto found = parser.line(text.substr(0, end))) return found;
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return parser.end();
}

std::optional<Problem> check(const Model& model) {
  if (auto found = check_features(model)) return found;
  if (auto found = check_ids(model)) return found;
  if (auto found = Walk(model).run()) return found;
  for (const bool slip : {false, true}) {
    const bool occurs = std::any_of(model.nodes.begin(), model.nodes.end(), [&](const Node& node) {
      return node.is_leaf && (node.verdict != Verdict::kHold) == slip;
    });
    if (!occurs) {
      return Problem{model.nodes.front().line, slip ? "the tree never answers slip" : "the tree never answers hold",
                     "train on both classes"};
    }
  }
  return std::nullopt;
}

std::string emit(const Model& model, std::string_view space) {
  char crc[16];
  std::snprintf(crc, sizeof crc, "0x%08X", static_cast<unsigned>(model.text_crc32));
  std::string out;
  out += "// SPDX-License-Identifier: Apache-2.0\n";
  out += "// Generated from toolchain/model/" + model.name + ".tree; do not edit. holdfast compile writes it.\n";
  out += "#pragma once\n\n";
  out += "#include <array>\n#include <cstdint>\n#include <string_view>\n\n";
  out += "#include \"slip/tree_io.hpp\"\n\n";
  out += "namespace holdfast::" + std::string(space) + " {\n\n";
  out += "inline constexpr std::string_view kName = \"" + model.name + "\";\n";
  out += "inline constexpr std::string_view kFeatureSet = \"" + model.feature_set + "\";\n";
  out += "inline constexpr int kDepth = " + std::to_string(depth(model)) + ";\n";
  out += "inline constexpr int kNodes = " + std::to_string(model.nodes.size()) + ";\n";
  out += "inline constexpr std::uint32_t kModelCrc32 = " + std::string(crc) + ";  // of the model's text\n\n";
  // In preorder, as the nodes of a loaded tree lie (slip/evidence.hpp).
  std::vector<const Node*> first;
  const auto visit = [&](const auto& self, int at) -> void {
    const Node& node = model.nodes[static_cast<std::size_t>(at)];
    if (node.is_leaf) return;
    const bool is_new =
        std::none_of(first.begin(), first.end(), [&](const Node* other) { return other->feature == node.feature; });
    if (is_new) first.push_back(&node);
    self(self, node.child_true);
    self(self, node.child_false);
  };
  visit(visit, 0);
  out += "// The first predicate on each feature.\n// clang-format off\n";
  out += "inline constexpr std::array<Predicate, " + std::to_string(first.size()) + "> kFirst{{\n";
  for (const Node* node : first) {
    out += "    {" + std::to_string(node->feature) + ", " + std::to_string(node->threshold) + "},  // " +
           model.features[static_cast<std::size_t>(node->feature)].name + "\n";
  }
  out += "}};\n// clang-format on\n\n";
  out += "[[nodiscard]] constexpr Verdict evaluate(const std::array<std::int32_t, " +
         std::to_string(model.features.size()) + ">& x) {\n";
  for (std::size_t i = 0; i < model.features.size(); ++i) {
    const bool is_read = std::any_of(model.nodes.begin(), model.nodes.end(), [&](const Node& node) {
      return !node.is_leaf && node.feature == static_cast<int>(i);
    });
    if (is_read) {
      out += "  const std::int32_t& " + model.features[i].name + " = x[" + std::to_string(i) + "];\n";
    }
  }
  emit_node(model, 0, 1, out);
  out += "}\n\n}  // namespace holdfast::" + std::string(space) + "\n";
  return out;
}

std::string to_text(const Model& model, std::string_view comment) {
  std::string out;
  while (!comment.empty()) {
    const std::size_t end = std::min(comment.find('\n'), comment.size());
    out += end == 0 ? "#" : "# ";
    std::replace_copy_if(
        comment.begin(), comment.begin() + static_cast<std::ptrdiff_t>(end), std::back_inserter(out),
        [](unsigned char c) { return c < 0x20 || c == 0x7F; }, '?');
    out += "\n";
    comment.remove_prefix(std::min(end + 1, comment.size()));
  }
  if (!out.empty()) out += "\n";
  out += "format " + std::to_string(kFormat) + "\n";
  out += "name " + model.name + "\n";
  out += "feature_set " + model.feature_set + "\n";
  for (const Feature& f : model.features) out += "feature " + f.name + " " + f.unit + " Q" + std::to_string(f.q) + "\n";
  out += "\n";
  for (const Node& node : model.nodes) {
    const std::string id = std::to_string(node.id);
    if (node.is_leaf) {
      out += "leaf " + id + ": " + std::string(leaf_of(node).text) + "\n";
    } else {
      out += "node " + id + ": " + model.features[static_cast<std::size_t>(node.feature)].name +
             " <= " + std::to_string(node.threshold) + " ? " + std::to_string(node.child_true) + " : " +
             std::to_string(node.child_false) + "\n";
    }
  }
  return out;
}

model::Tree to_table(const Model& model) {
  model::Tree table;
  std::copy(model.name.begin(), model.name.end(), table.name.begin());
  table.text_crc32 = model.text_crc32;
  table.set = find_feature_set(model.feature_set);
  table.count = 0;
  fill_table(model, 0, table);
  return table;
}

Binary to_binary(const Model& model) {
  const model::Tree table = to_table(model);
  Binary out{};
  const auto put = [&out](std::size_t at, std::uint32_t value, int bytes) {
    for (int i = 0; i < bytes; ++i) out[at++] = static_cast<std::uint8_t>(value >> (8 * i));
  };
  const auto put_name = [&out](std::size_t at, std::string_view name) {
    std::copy(name.begin(), name.end(), out.begin() + static_cast<std::ptrdiff_t>(at));
  };
  std::copy(model_file::kMagic.begin(), model_file::kMagic.end(), out.begin());
  put(model_file::kVersionAt, model_file::kVersion, 2);
  put(model_file::kNodeCountAt, static_cast<std::uint32_t>(table.count), 2);
  put(model_file::kFeatureCountAt, static_cast<std::uint32_t>(model.features.size()), 1);
  put(model_file::kTextCrcAt, table.text_crc32, 4);
  put_name(model_file::kNameAt, model.name);
  put_name(model_file::kSetAt, model.feature_set);
  for (std::size_t i = 0; i < model.features.size(); ++i) {
    put_name(model_file::kFeaturesAt + i * model::kNameBytes, model.features[i].name);
    put(model_file::kQAt + i, static_cast<std::uint32_t>(model.features[i].q), 1);
  }
  for (std::size_t i = 0; i < static_cast<std::size_t>(table.count); ++i) {
    const model::Node& node = table.nodes[i];
    const std::size_t at = model_file::kNodesAt + i * model_file::kNodeBytes;
    put(at, static_cast<std::uint32_t>(node.threshold), 4);
    put(at + 4, node.child_false, 2);
    put(at + 6, node.feature, 1);
    put(at + 7, static_cast<std::uint32_t>(node.kind), 1);
  }
  put(model_file::kCrcAt, crc32(std::span(out).first(model_file::kCrcAt)), 4);
  return out;
}

std::string describe(const Problem& problem, std::string_view file) {
  return std::string(file) + ":" + std::to_string(problem.line) + ": " + problem.what +
         ". Likely cause: not a model text, or changed by hand. Next: " + problem.next;
}

}  // namespace holdfast::treec
