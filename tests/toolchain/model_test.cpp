// SPDX-License-Identifier: Apache-2.0
// The slip tree: committed text, committed header, the file that the firmware loads and the compiler between them
// agree; bad texts are refused with the line, the fault and the next step.
#include <algorithm>
#include <array>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <map>
#include <optional>
#include <random>
#include <span>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

#include "slip/classifier.hpp"
#include "slip/model_file.hpp"
#include "slip/slip_tree.gen.hpp"
#include "tests/fuzz/model_check.hpp"
#include "tests/support/folders.hpp"
#include "toolchain/treec/tree_model.hpp"

#include <CppUTest/TestHarness.h>

namespace {

using holdfast::Verdict;
namespace classifier = holdfast::classifier;
namespace model_file = holdfast::model_file;
namespace treec = holdfast::treec;
using Inputs = std::vector<std::int32_t>;  // in the order of the model's set

constexpr std::string_view kHeader =
    "format 1\n"                                 // 1
    "name test\n"                                // 2
    "feature_set paper\n"                        // 3
    "feature vx_um_s um/s Q0\n"                  // 4
    "feature vy_um_s um/s Q0\n"                  // 5
    "feature entropy_nat_q16 nat Q16\n"          // 6
    "feature entropy_rate_nat_s_q8 nat/s Q8\n";  // 7

std::string read_source(const std::string& path) {
  std::ifstream in(holdfast::test::source(path), std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

std::string with_nodes(std::string_view nodes) {
  return std::string(kHeader) + std::string(nodes);
}

std::optional<treec::Problem> compile(std::string_view text, treec::Model& model) {
  auto problem = treec::parse(text, model);
  return problem ? problem : treec::check(model);
}

treec::Model compiled(std::string_view text) {
  treec::Model model;
  const auto problem = compile(text, model);
  if (problem) FAIL(treec::describe(*problem, "test.tree").c_str());
  return model;
}

// The oracle: takes the tree from its text, line by line, with nothing but sscanf.
class TextTree {
 public:
  explicit TextTree(const std::string& text) {
    std::istringstream in(text);
    for (std::string line; std::getline(in, line);) {
      int id = 0;
      char feature[64] = "";
      if (line.starts_with("feature ") && std::sscanf(line.c_str(), "feature %63s", feature) == 1) {
        columns_.emplace(feature, columns_.size());
      }
      if (std::sscanf(line.c_str(), "node %d:", &id) == 1 || std::sscanf(line.c_str(), "leaf %d:", &id) == 1) {
        lines_[id] = line;
      }
    }
  }

  [[nodiscard]] Verdict say(const Inputs& x) const {
    int id = 0;
    for (;;) {
      const std::string& line = lines_.at(id);
      char name[64] = "";
      long long threshold = 0;
      int child_true = 0;
      int child_false = 0;
      if (std::sscanf(line.c_str(), "node %d: %63s <= %lld ? %d : %d", &id, name, &threshold, &child_true,
                      &child_false) != 5) {
        return line.ends_with(": slip_now") ? Verdict::kSlipNow
               : line.ends_with(": slip")   ? Verdict::kSlip
                                            : Verdict::kHold;
      }
      id = x.at(columns_.at(name)) <= threshold ? child_true : child_false;
    }
  }

 private:
  std::map<int, std::string> lines_;
  std::map<std::string, std::size_t> columns_;
};

// Runs emitted C++: only the statement forms that the compiler may emit are understood, all else fails the test.
Verdict run_emitted(const std::string& header, const Inputs& x) {
  const auto answer = [](std::string_view said) { return said == "Verdict::kSlip" ? Verdict::kSlip : Verdict::kHold; };
  std::istringstream in(header.substr(header.find("evaluate(")));
  std::map<std::string, std::int32_t> locals;
  int skip_depth = 0;  // open braces of a branch not taken
  std::string line;
  std::getline(in, line);  // the signature
  while (std::getline(in, line)) {
    char name[64] = "";
    char said[64] = "";
    char tail[16] = "";
    long long number = 0;
    const char* text = line.c_str();
    if (skip_depth > 0) {
      if (line.ends_with("{")) ++skip_depth;
      if (line.ends_with("}")) --skip_depth;
    } else if (std::sscanf(text, " const std::int32_t& %63s = x[%lld];", name, &number) == 2) {
      locals[name] = x.at(static_cast<std::size_t>(number));
    } else if (std::sscanf(text, " if (%63s <= %lld) return %63[^;];", name, &number, said) == 3) {
      if (locals.at(name) <= number) return answer(said);
    } else if (std::sscanf(text, " if (%63s <= %lld) %15s", name, &number, tail) == 3 && tail == std::string("{")) {
      if (locals.at(name) > number) skip_depth = 1;
    } else if (std::sscanf(text, " return %63[^;];", said) == 1) {
      return answer(said);
    } else {
      FAIL(line.c_str());
    }
  }
  FAIL("the emitted function does not return");
  return Verdict::kHold;
}

const holdfast::FeatureSet& set_of(const treec::Model& model) {
  return *holdfast::find_feature_set(model.feature_set);
}

// Every threshold -1 / 0 / +1 and the extremes of each feature with every combination of these values of the others,
// or, where those are too many, each with `partners` random choices of the others; and as many inputs at random.
std::vector<Inputs> probes(const treec::Model& model, int partners = 4) {
  const holdfast::FeatureSet& set = set_of(model);
  const auto features = static_cast<std::size_t>(set.size());
  std::vector<std::vector<std::int32_t>> values;
  values.reserve(features);
  for (int i = 0; i < set.size(); ++i) values.push_back({INT32_MIN, set[i].min, -1, 0, 1, set[i].max, INT32_MAX});
  for (const treec::Node& node : model.nodes) {
    if (node.is_leaf) continue;
    auto& list = values[static_cast<std::size_t>(node.feature)];
    for (const int step : {-1, 0, 1}) list.push_back(node.threshold + step);
  }
  std::vector<Inputs> all;
  std::size_t product = 1;
  for (const auto& list : values) product = std::min<std::size_t>(product * list.size(), 1'000'000);
  if (product <= 50'000) {
    for (std::size_t number = 0; number < product; ++number) {
      Inputs x;
      std::size_t rest = number;
      for (const auto& list : values) {
        x.push_back(list[rest % list.size()]);
        rest /= list.size();
      }
      all.push_back(x);
    }
  }
  std::mt19937 random(20);
  for (std::size_t feature = 0; feature < features; ++feature) {
    for (const auto value : values[feature]) {
      for (int i = 0; i < partners; ++i) {
        Inputs mixed;
        Inputs anywhere;
        for (std::size_t other = 0; other < features; ++other) {
          const holdfast::FeatureInfo& f = set[static_cast<int>(other)];
          mixed.push_back(values[other][random() % values[other].size()]);
          anywhere.push_back(std::uniform_int_distribution<std::int32_t>(f.min, f.max)(random));
        }
        mixed[feature] = value;
        all.push_back(mixed);
        all.push_back(anywhere);
      }
    }
  }
  return all;
}

// A random valid tree: grows from the root, splitting only where the path leaves room for a threshold.
class RandomTree {
 public:
  RandomTree(std::uint32_t seed, const holdfast::FeatureSet& set, int max_depth, int max_nodes)
      : random_(seed), set_(set), max_depth_(max_depth), max_nodes_(max_nodes) {}

  std::string text() {
    lines_.emplace_back();
    struct Open {
      int id = 0;
      int level = 0;
      std::vector<std::int32_t> min;
      std::vector<std::int32_t> max;
    };
    std::vector<Open> open(1);
    for (int i = 0; i < set_.size(); ++i) {
      open[0].min.push_back(set_[i].min);
      open[0].max.push_back(set_[i].max);
    }
    while (!open.empty()) {
      Open o = open.back();
      open.pop_back();
      const std::size_t f = random_() % o.min.size();
      const int next = static_cast<int>(lines_.size());
      const std::string id = std::to_string(o.id);
      if (o.level == max_depth_ || next + 2 > max_nodes_ || o.min[f] >= o.max[f] ||
          (o.level > 1 && random_() % 8 == 0)) {
        lines_[static_cast<std::size_t>(o.id)] = "leaf " + id + ": " + kLeaves[leaf_++ % kLeaves.size()];
        continue;
      }
      const std::int32_t t = std::uniform_int_distribution<std::int32_t>(o.min[f], o.max[f] - 1)(random_);
      lines_[static_cast<std::size_t>(o.id)] = "node " + id + ": " + std::string(set_[static_cast<int>(f)].name) +
                                               " <= " + std::to_string(t) + " ? " + std::to_string(next) + " : " +
                                               std::to_string(next + 1);
      lines_.resize(lines_.size() + 2);
      Open low = o;
      Open high = o;
      low.id = next;
      high.id = next + 1;
      low.level = high.level = o.level + 1;
      low.max[f] = t;
      high.min[f] = t + 1;
      open.push_back(random_() % 2 == 0 ? low : high);
      open.push_back(open.back().id == low.id ? high : low);
    }
    std::string out = "format 1\nname random\nfeature_set " + std::string(set_.name) + "\n";
    for (int i = 0; i < set_.size(); ++i) {
      out += "feature " + std::string(set_[i].name) + " " + std::string(set_[i].unit) + " Q" +
             std::to_string(set_[i].q) + "\n";
    }
    for (const std::string& line : lines_) out += line + "\n";
    return out;
  }

 private:
  std::mt19937 random_;
  const holdfast::FeatureSet& set_;
  int max_depth_;
  int max_nodes_;
  static constexpr std::array<const char*, 2> kLeaves{"hold", "slip"};
  std::size_t leaf_ = 0;
  std::vector<std::string> lines_;
};

// What the firmware makes of the file.
holdfast::model::Tree loaded(const treec::Model& model) {
  holdfast::model::Tree tree;
  const auto refusal = model_file::read(treec::to_binary(model), tree);
  if (refusal != model_file::Refusal::kNone) FAIL(std::string(model_file::info(refusal).what).c_str());
  return tree;
}

}  // namespace

TEST_GROUP(SlipModel) {
  const std::string text = read_source("toolchain/model/" + std::string(holdfast::slip_tree::kName) + ".tree");
  const std::string header = read_source("firmware/slip/slip_tree.gen.hpp");
};

TEST(SlipModel, CommittedHeaderIsWhatTheTextCompilesTo) {
  const treec::Model model = compiled(text);
  if (header != treec::emit(model)) FAIL("build the target slip_tree and commit firmware/slip/slip_tree.gen.hpp");
}

TEST(SlipModel, MetadataIsThatOfTheText) {
  const treec::Model model = compiled(text);
  CHECK_TRUE(holdfast::slip_tree::kName == model.name);
  CHECK_TRUE(holdfast::slip_tree::kFeatureSet == model.feature_set);
  LONGS_EQUAL(model.nodes.size(), holdfast::slip_tree::kNodes);
  LONGS_EQUAL(treec::depth(model), holdfast::slip_tree::kDepth);
  UNSIGNED_LONGS_EQUAL(model.text_crc32, holdfast::slip_tree::kModelCrc32);
}

TEST(SlipModel, HeaderTableAndFileAnswerAsTheTextSays) {
  const treec::Model model = compiled(text);
  const holdfast::model::Tree table = treec::to_table(model);
  const holdfast::model::Tree file = loaded(model);
  const TextTree oracle(text);
  for (const Inputs& x : probes(model, 100)) {
    classifier::Inputs fixed{};
    std::copy(x.begin(), x.end(), fixed.begin());
    const Verdict want = oracle.say(x);
    CHECK_TRUE(want == holdfast::slip_tree::evaluate(fixed));
    CHECK_TRUE(want == holdfast::model::evaluate(table, x));
    CHECK_TRUE(want == holdfast::model::evaluate(file, x));
  }
}

TEST(SlipModel, RandomTreesOfEverySetUpToTheLimitsAnswerAsTheirText) {
  int deepest = 0;
  std::size_t largest = 0;
  for (const holdfast::FeatureSet& set : holdfast::kFeatureSets) {
    for (std::uint32_t seed = 0; seed < 8; ++seed) {
      const std::string random_text = RandomTree(seed, set, seed < 5 ? 4 : treec::kMaxDepth, treec::kMaxNodes).text();
      const treec::Model model = compiled(random_text);
      const std::string emitted = treec::emit(model);
      const holdfast::model::Tree table = treec::to_table(model);
      const holdfast::model::Tree file = loaded(model);
      deepest = std::max(deepest, treec::depth(model));
      largest = std::max(largest, model.nodes.size());
      const std::vector<Inputs> all = probes(model);
      const TextTree oracle(random_text);
      // run_emitted reads the header anew for each input: of the many, some.
      for (std::size_t i = 0; i < all.size(); i += 1 + all.size() / 1500) {
        const Verdict want = oracle.say(all[i]);
        CHECK_TRUE(want == holdfast::model::evaluate(table, all[i]));
        CHECK_TRUE(want == holdfast::model::evaluate(file, all[i]));
        CHECK_TRUE(want == run_emitted(emitted, all[i]));
      }
    }
  }
  LONGS_EQUAL(treec::kMaxDepth, deepest);
  LONGS_EQUAL(treec::kMaxNodes, largest);
}

TEST(SlipModel, TheFileIsThatOfTheByteTable) {
  const treec::Model model = compiled(text);
  const holdfast::model::Tree table = treec::to_table(model);
  const auto nodes = std::span(table.nodes).first(model.nodes.size());
  auto want = holdfast::test::model_bytes(set_of(model), nodes, model.name);
  holdfast::test::put_number(want, 16, model.text_crc32, 4);
  want = holdfast::test::repaired(want);
  const treec::Binary file = treec::to_binary(model);
  CHECK_TRUE(std::equal(want.begin(), want.end(), file.begin(), file.end()));
}

TEST(SlipModel, OneFlippedBitOfTheFileIsRefused) {
  treec::Binary file = treec::to_binary(compiled(text));
  holdfast::model::Tree tree;
  for (std::uint8_t& byte : file) {
    for (int bit = 0; bit < 8; ++bit) {
      byte = static_cast<std::uint8_t>(byte ^ (1 << bit));
      CHECK_TRUE(model_file::read(file, tree) != model_file::Refusal::kNone);
      byte = static_cast<std::uint8_t>(byte ^ (1 << bit));
    }
  }
  CHECK_TRUE(model_file::read(file, tree) == model_file::Refusal::kNone);
}

TEST(SlipModel, WrittenAsTextItParsesToTheSame) {
  std::vector<std::string> texts{text};
  for (const holdfast::FeatureSet& set : holdfast::kFeatureSets) texts.push_back(RandomTree(1, set, 6, 99).text());
  for (const std::string& original : texts) {
    const treec::Model model = compiled(original);
    const std::string plain = treec::to_text(model);
    CHECK_TRUE(compiled(plain) == model);
    STRCMP_EQUAL(plain.c_str(), treec::to_text(compiled(plain)).c_str());
    const std::string commented = treec::to_text(model, "what it is\n\nwho: a \"name\"\r\x01 node 0: none\n");
    CHECK_TRUE(commented.starts_with("# what it is\n#\n# who: a \"name\"?? node 0: none\n\nformat 1\n"));
    CHECK_TRUE(compiled(commented) == model);
    treec::Model other = model;
    ++other.nodes[0].threshold;
    CHECK_FALSE(other == model);
  }
}

TEST(SlipModel, RangesAreThoseOfTheUnits) {
  // Written down here independently of the table: base/units.hpp.
  const holdfast::FeatureSet& paper = *holdfast::find_feature_set("paper");
  const std::int32_t least[] = {-10'000'000, -10'000'000, 0, -1'048'576};
  const std::int32_t most[] = {10'000'000, 10'000'000, 262'144, 1'048'576};
  for (int i = 0; i < 4; ++i) {
    LONGS_EQUAL(least[i], paper[i].min);
    LONGS_EQUAL(most[i], paper[i].max);
  }
}

TEST(SlipModel, BadTextsAreRefusedWithLineAndReason) {
  struct Case {
    std::string text;
    int line;
    std::string_view what;
  };
  const std::string h(kHeader);
  const std::string three = "node 0: vx_um_s <= 5 ? 1 : 2\nleaf 1: hold\nleaf 2: slip\n";
  std::string chain;  // one predicate deeper than allowed
  for (int i = 0; i <= treec::kMaxDepth; ++i) {
    chain += "node " + std::to_string(2 * i) + ": vx_um_s <= " + std::to_string(100 - i) + " ? " +
             std::to_string(2 * i + 2) + " : " + std::to_string(2 * i + 1) + "\nleaf " + std::to_string(2 * i + 1) +
             ": slip\n";
  }
  chain += "leaf " + std::to_string(2 * treec::kMaxDepth + 2) + ": hold\n";
  std::string many;
  for (int i = 0; i < 512; ++i) many += "leaf " + std::to_string(i) + ": hold\n";
  const auto replaced = [&](std::string_view from, std::string_view to) {
    std::string text = h + three;
    text.replace(text.find(from), from.size(), to);
    return text;
  };
  const std::vector<Case> cases{
      {"", 1, "holds no model"},
      {"# only a comment\n", 1, "holds no model"},
      {"name test\n", 1, "does not start with its format"},
      {replaced("format 1", "format 2"), 1, "format '2' is not known"},
      {replaced("format 1", "format 1.0"), 1, "format '1.0' is not known"},
      {replaced("name test\n", ""), 9, "no name"},
      {replaced("name test", "name Test"), 2, "not a model name"},
      {replaced("name test", "name a\";}"), 2, "not a model name"},
      {replaced("name test", "name a234567890123456789012345678901234567890"), 2, "not a model name"},
      {replaced("name test", "name test\nname test"), 3, "two names"},
      {replaced("feature_set paper\n", ""), 9, "names no feature set"},
      {replaced("feature_set paper", "feature_set none"), 3, "'none' is not known"},
      {replaced("feature_set paper", "feature_set paper\nfeature_set paper"), 4, "two feature sets"},
      {replaced("feature entropy_rate_nat_s_q8 nat/s Q8\n", ""), 3, "is missing"},
      {replaced("feature vy_um_s um/s Q0", "feature vz_um_s um/s Q0"), 5, "another name, unit or Q format"},
      {replaced("feature vy_um_s um/s Q0", "feature vy_um_s mm/s Q0"), 5, "another name, unit or Q format"},
      {replaced("nat Q16", "nat Q15"), 6, "another name, unit or Q format"},
      {replaced("nat Q16", "nat"), 6, "not a feature"},
      {replaced("node 0", "feature extra um Q0\nnode 0"), 8, "ends before this feature"},
      {replaced("leaf 1: hold", "feature extra um Q0\nleaf 1: hold"), 9, "follows the first node"},
      {h, 7, "no nodes"},
      {replaced("vx_um_s <=", "residual_um <="), 8, "no `feature` line lists"},
      {replaced("<=", "<"), 8, "predicate '<' is not known"},
      {replaced("<= 5 ", "<= 5.5 "), 8, "'5.5' is not a 32-bit integer"},
      {replaced("<= 5 ", "<= 2147483648 "), 8, "not a 32-bit integer"},
      {replaced("<= 5 ", "<= 10000000 "), 8, "decides nothing"},
      {replaced("<= 5 ", "<= -10000001 "), 8, "decides nothing"},
      {replaced("? 1 : 2", "? 1"), 8, "not complete"},
      {replaced("? 1 : 2", "? 1 : 2 : 3"), 8, "not complete"},
      {replaced("? 1 : 2", "? 1 : x"), 8, "child is not a node id"},
      {replaced("? 1 : 2", "? 1 : 3"), 8, "child 3 does not exist"},
      {replaced("? 1 : 2", "? -1 : 2"), 8, "child -1 does not exist"},
      {replaced("? 1 : 2", "? 1 : 1"), 8, "also a child of node 0"},
      {replaced("? 1 : 2", "? 0 : 2"), 8, "runs in a circle"},
      {h + "node 0: vx_um_s <= 5 ? 1 : 2\nnode 1: vy_um_s <= 5 ? 0 : 3\nleaf 2: slip\nleaf 3: hold\n", 9,
       "runs in a circle"},
      {h + three + "leaf 3: hold\n", 11, "no path leads to node 3"},
      {replaced("leaf 2", "leaf 1"), 10, "node 1 is there twice"},
      {replaced("leaf 2", "leaf 4"), 10, "node 4 follows where node 2 is due"},
      {replaced("node 0", "node 1"), 8, "node 1 follows where node 0 is due"},
      {replaced("node 0:", "node :"), 8, "no id"},
      {replaced("node 0:", "node 0"), 8, "no ':'"},
      {replaced("leaf 1: hold", "leaf 1: unknown"), 9, "neither hold nor slip"},
      {replaced("leaf 1: hold", "leaf 1:"), 9, "neither hold nor slip"},
      {replaced("leaf 1: hold", "leaf 1: slip"), 8, "never answers hold"},
      {replaced("leaf 2: slip", "leaf 2: hold"), 8, "never answers slip"},
      {replaced("leaf 2: slip", "leef 2: slip"), 10, "unknown word 'leef'"},
      {replaced("hold\n", "hold\r\n"), 9, "carriage return"},
      {h + "node 0: vx_um_s <= 5 ? 1 : 2\nnode 1: vx_um_s <= 5 ? 3 : 4\nleaf 2: slip\nleaf 3: hold\nleaf 4: "
           "slip\n",
       9, "decides nothing"},
      {h + "node 0: vx_um_s <= 5 ? 1 : 2\nleaf 1: hold\nnode 2: vx_um_s <= 5 ? 3 : 4\nleaf 3: hold\nleaf 4: "
           "slip\n",
       10, "decides nothing"},
      {h + chain, 8 + 2 * treec::kMaxDepth, "deeper than 24"},
      {h + many, 519, "more than 511 nodes"},
  };
  for (const Case& c : cases) {
    treec::Model model;
    const auto problem = compile(c.text, model);
    CHECK_TEXT(problem.has_value(), std::string(c.what).c_str());
    const std::string said = treec::describe(*problem, "bad.tree");
    LONGS_EQUAL_TEXT(c.line, problem->line, said.c_str());
    STRCMP_CONTAINS_TEXT(std::string(c.what).c_str(), problem->what.c_str(), said.c_str());
    CHECK_TEXT(!problem->next.empty(), said.c_str());
  }
}

TEST(SlipModel, CutAtAnyByteTheTextIsRefusedOrSaysTheSame) {
  // A copy that broke off may still be whole but for trailing comments; any other piece must not compile.
  for (std::size_t length = 0; length < text.size(); ++length) {
    treec::Model model;
    if (compile(std::string_view(text).substr(0, length), model)) continue;
    LONGS_EQUAL(holdfast::slip_tree::kNodes, model.nodes.size());
    const holdfast::model::Tree table = treec::to_table(model);
    for (const Inputs& x : probes(model, 1)) {
      classifier::Inputs fixed{};
      std::copy(x.begin(), x.end(), fixed.begin());
      CHECK_TRUE(holdfast::model::evaluate(table, x) == holdfast::slip_tree::evaluate(fixed));
    }
  }
}

TEST(SlipModel, AThresholdMayStandAtTheEdgeOfWhatThePathLeaves) {
  // vx in 6..10000000 at node 2: 6 and 9999999 still divide it; so do the first and the last of the whole range.
  for (const char* edge : {"<= 6", "<= 9999999"}) {
    (void)compiled(with_nodes("node 0: vx_um_s <= 5 ? 1 : 2\nleaf 1: hold\nnode 2: vx_um_s " + std::string(edge) +
                              " ? 3 : 4\nleaf 3: hold\nleaf 4: slip\n"));
  }
  for (const char* edge : {"<= -10000000", "<= 9999999"}) {
    (void)compiled(with_nodes("node 0: vx_um_s " + std::string(edge) + " ? 1 : 2\nleaf 1: hold\nleaf 2: slip\n"));
  }
}

TEST(SlipModel, CommentsAndSpacingDoNotMatter) {
  const treec::Model model =
      compiled(with_nodes("  node 0 :vx_um_s <= -5?1:2 # why\n\n\t# alone\nleaf 1:hold#x\nleaf\t2: slip"));
  LONGS_EQUAL(3, model.nodes.size());
  LONGS_EQUAL(-5, model.nodes[0].threshold);
}
