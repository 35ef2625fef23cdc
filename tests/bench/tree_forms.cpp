// SPDX-License-Identifier: Apache-2.0
// tree_forms MODEL_FOLDER: prints the C++ that tree_bench measures, a struct per tree in namespace
// holdfast::bench. Trees: the committed one, and valid random ones of depth 4, 6, 8 and 10 over the paper's features,
// every predicate near the middle of what its path leaves, sibling leaves of different classes, leaves about as many as
// 14 000 rows gave (notes of the project: 16, 62, 167, 358), cut to what a table holds.
// Of each the text, the branching form as the product emits it, and the same tree in the form of emlearn 0.23.2's
// "inline" code, written anew from its shape.
#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#include "base/math.hpp"
#include "slip/slip_tree.gen.hpp"
#include "toolchain/treec/tree_model.hpp"

namespace {

using namespace holdfast;

class RandomModel {
 public:
  // A path ends at `depth`, or with a probability of stop/16 below its third predicate.
  RandomModel(int depth, unsigned stop) : depth_(depth), stop_(stop) {
    const FeatureSet& set = *find_feature_set("paper");
    model_.name = "depth_" + std::to_string(depth);
    model_.feature_set = set.name;
    std::vector<std::array<std::int32_t, 2>> ranges;
    for (int i = 0; i < set.size(); ++i) {
      model_.features.push_back({std::string(set[i].name), std::string(set[i].unit), set[i].q, 0});
      ranges.push_back({set[i].min, set[i].max});
    }
    grow(0, 0, ranges);
  }
  [[nodiscard]] const treec::Model& model() const { return model_; }

 private:
  int grow(int level, int promised, const std::vector<std::array<std::int32_t, 2>>& ranges) {
    const int id = static_cast<int>(model_.nodes.size());
    treec::Node& node = model_.nodes.emplace_back();
    node.id = id;
    if (level == depth_ || id + promised + 3 > treec::kMaxNodes || (level > 2 && random_() % 16 < stop_)) {
      node.is_leaf = true;
      node.verdict = static_cast<Verdict>(leaves_++ % 2);
      return id;
    }
    const std::size_t feature = random_() % ranges.size();
    const auto [min, max] = ranges[feature];
    const std::int32_t width = max - min;
    const std::int32_t threshold =
        min + width / 4 + static_cast<std::int32_t>(random_() % (1U + static_cast<unsigned>(width / 2)));
    node.feature = static_cast<int>(feature);
    node.threshold = threshold;
    auto rest = ranges;
    rest[feature] = {min, threshold};
    const int child_true = grow(level + 1, promised + 1, rest);
    rest[feature] = {threshold + 1, max};
    const int child_false = grow(level + 1, promised, rest);
    model_.nodes[idx(id)].child_true = child_true;
    model_.nodes[idx(id)].child_false = child_false;
    return id;
  }

  std::mt19937 random_{1};
  int depth_;
  unsigned stop_;
  int leaves_ = 0;
  treec::Model model_;
};

// Rows are drawn here: around the thresholds that the tree holds for the feature, half their span beyond on each side.
struct Drawn {
  std::int64_t low = 0, high = 0;
  int shift = 0;  // that fits the feature into int16
};

std::vector<Drawn> drawn_around(const treec::Model& model) {
  const FeatureSet& set = *find_feature_set(model.feature_set);
  std::vector<Drawn> all;
  for (int i = 0; i < set.size(); ++i) {
    std::vector<std::int64_t> thresholds;
    for (const treec::Node& node : model.nodes) {
      if (!node.is_leaf && node.feature == i) thresholds.push_back(node.threshold);
    }
    Drawn drawn;
    if (!thresholds.empty()) {
      const auto [low, high] = std::ranges::minmax(thresholds);
      const std::int64_t margin = std::max<std::int64_t>((high - low) / 2, 64);
      drawn = {std::max<std::int64_t>(low - margin, set[i].min), std::min<std::int64_t>(high + margin, set[i].max), 0};
    }
    while ((drawn.low >> drawn.shift) < INT16_MIN || (drawn.high >> drawn.shift) > INT16_MAX) ++drawn.shift;
    all.push_back(drawn);
  }
  return all;
}

// emlearn compares `<`; on whole numbers x < t + 1 is our x <= t.
std::string emlearn_node(const treec::Model& model, const std::vector<Drawn>& drawn, int id) {
  const treec::Node& node = model.nodes[idx(id)];
  if (node.is_leaf) return "return " + std::to_string(static_cast<int>(node.verdict != Verdict::kHold)) + ";\n";
  const std::string feature = std::to_string(node.feature);
  const int threshold = (node.threshold >> drawn[idx(node.feature)].shift) + 1;
  return "if (features[" + feature + "] < " + std::to_string(threshold) + ") {\n" +
         emlearn_node(model, drawn, node.child_true) + "} else {\n" + emlearn_node(model, drawn, node.child_false) +
         "}\n";
}

void print(const treec::Model& model, const std::string& name, const std::string& header) {
  const std::vector<Drawn> drawn = drawn_around(model);
  const auto list = [&](auto member) {
    std::string out;
    for (const Drawn& d : drawn) out += (out.empty() ? "" : ", ") + std::to_string(d.*member);
    return out;
  };
  const std::string features = std::to_string(model.features.size());
  std::string out = header + "namespace holdfast::bench {\n";
  out += "inline std::int32_t " + name + "_tree_0(const std::int16_t* features) {\n" + emlearn_node(model, drawn, 0) +
         "}\n";
  out += "struct " + name + " {\n";
  out += "static constexpr const char* kName = \"" + name + "\";\n";
  out += "static constexpr std::string_view kText = R\"(" + treec::to_text(model) + ")\";\n";
  out += "static constexpr std::size_t kFeatures = " + features + ";\n";
  out += "static constexpr std::array<std::int64_t, kFeatures> kLow{" + list(&Drawn::low) + "};\n";
  out += "static constexpr std::array<std::int64_t, kFeatures> kHigh{" + list(&Drawn::high) + "};\n";
  out += "static constexpr std::array<int, kFeatures> kShift{" + list(&Drawn::shift) + "};\n";
  out += "static Verdict header(const std::array<std::int32_t, kFeatures>& x) { return " + name + "::evaluate(x); }\n";
  out +=
      "static std::int32_t emlearn(const std::int16_t* features) {\n"
      "std::int32_t votes[2] = {0,};\n"
      "std::int32_t voted = -1;\n"
      "voted = " +
      name +
      "_tree_0(features); votes[voted] += 1;\n"
      "std::int32_t best = -1;\n"
      "std::int32_t most = 0;\n"
      "for (std::int32_t i = 0; i < 2; i++) {\n"
      "if (votes[i] > most) {\nbest = i;\nmost = votes[i];\n}\n}\n"
      "return best;\n}\n";
  out += "};\n}  // namespace holdfast::bench\n";
  // The struct hides the namespace of the header: name it from the root.
  out.replace(out.find("return " + name + "::evaluate"), 7, "return holdfast::");
  std::fwrite(out.data(), 1, out.size(), stdout);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fputs("usage: tree_forms MODEL_FOLDER\n", stderr);
    return 2;
  }
  const std::string path = std::string(argv[1]) + "/" + std::string(slip_tree::kName) + ".tree";
  std::ifstream in(path, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  treec::Model committed;
  auto problem = treec::parse(text, committed);
  if (!problem) problem = treec::check(committed);
  if (problem) {
    std::fprintf(stderr, "error: %s\n", treec::describe(*problem, path).c_str());
    return 1;
  }
  std::puts("// NOLINTBEGIN: many headers in one, and code in another project's shape");
  print(committed, "slip_tree", "#include \"slip/slip_tree.gen.hpp\"\n");
  constexpr std::array<std::array<int, 2>, 4> kShapes{{{4, 0}, {6, 1}, {8, 2}, {10, 4}}};
  for (const auto& [depth, stop] : kShapes) {
    const RandomModel random(depth, static_cast<unsigned>(stop));
    if (const auto wrong = treec::check(random.model())) {
      std::fprintf(stderr, "error: %s\n", treec::describe(*wrong, random.model().name).c_str());
      return 1;
    }
    print(random.model(), random.model().name, treec::emit(random.model(), random.model().name));
  }
  std::puts("// NOLINTEND");
  return 0;
}
