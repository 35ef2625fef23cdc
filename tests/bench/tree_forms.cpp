// SPDX-License-Identifier: Apache-2.0
// tree_forms MODEL: prints the committed tree in the form of emlearn 0.23.2's "inline" code, written anew from its
// shape, for tree_bench: features as int16 (ours, shifted right until they fit), `<` thresholds, an array of votes by
// class, a loop for the largest. And from which range of each feature the bench draws: around the thresholds that the
// tree holds for it, half their span beyond on each side.
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "base/math.hpp"
#include "toolchain/treec/tree_model.hpp"

namespace {

using namespace holdfast;

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
void print_node(const treec::Model& model, const std::vector<Drawn>& drawn, int id) {
  const treec::Node& node = model.nodes[idx(id)];
  if (node.is_leaf) {
    std::printf("return %d;\n", node.verdict != Verdict::kHold ? 1 : 0);
    return;
  }
  const int threshold = (node.threshold >> drawn[idx(node.feature)].shift) + 1;
  std::printf("if (features[%d] < %d) {\n", node.feature, threshold);
  print_node(model, drawn, node.child_true);
  std::puts("} else {");
  print_node(model, drawn, node.child_false);
  std::puts("}");
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fputs("usage: tree_forms MODEL\n", stderr);
    return 2;
  }
  std::ifstream in(argv[1], std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  treec::Model model;
  auto problem = treec::parse(text, model);
  if (!problem) problem = treec::check(model);
  if (problem) {
    std::fprintf(stderr, "error: %s\n", treec::describe(*problem, argv[1]).c_str());
    return 1;
  }
  const std::vector<Drawn> drawn = drawn_around(model);
  std::puts("// NOLINTBEGIN: in the form of another tool");
  std::printf("inline constexpr std::size_t kWidth = %zu;\n", drawn.size());
  std::puts("struct Drawn { std::int64_t low, high; int shift; };");
  std::puts("inline constexpr std::array<Drawn, kWidth> kDrawn{{");
  for (const Drawn& d : drawn) {
    std::printf("{%lld, %lld, %d},\n", static_cast<long long>(d.low), static_cast<long long>(d.high), d.shift);
  }
  std::puts("}};\ninline std::int32_t emlearn_tree_0(const std::int16_t* features) {");
  print_node(model, drawn, 0);
  std::puts(
      "}\ninline std::int32_t emlearn_form(const std::int16_t* features) {\n"
      "std::int32_t votes[2] = {0,};\nstd::int32_t voted = -1;\n"
      "voted = emlearn_tree_0(features); votes[voted] += 1;\n"
      "std::int32_t best = -1;\nstd::int32_t most = 0;\n"
      "for (std::int32_t i = 0; i < 2; i++) {\nif (votes[i] > most) {\nbest = i;\nmost = votes[i];\n}\n}\nreturn "
      "best;\n}\n// NOLINTEND");
  return 0;
}
