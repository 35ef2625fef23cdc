// SPDX-License-Identifier: Apache-2.0
// The loadable model: what is whole is read as the table of its bytes says, what is not is refused, each fault with its
// own reason. The oracle (tests/fuzz/model_check.hpp) reads the same bytes by other means.
#include "slip/model_file.hpp"

#include <algorithm>
#include <random>
#include <span>
#include <string>
#include <vector>

#include "tests/fuzz/model_check.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;
using model::Kind;
using model::Node;
using model_file::Refusal;
using test::model_bytes;
using test::ModelBytes;
using test::RandomNodes;
using test::repaired;

constexpr const FeatureSet& kSet = kFeatureSets.front();
constexpr Node kHold{.kind = Kind::kHold};
constexpr Node kSlip{.kind = Kind::kSlip};

Node split(std::int32_t threshold, int child_false, int feature = 0) {
  return {threshold, static_cast<std::uint16_t>(child_false), static_cast<std::uint8_t>(feature), Kind::kSplit};
}

std::vector<Node> small() {
  return {split(5, 2), kHold, kSlip};
}

Refusal read(const ModelBytes& bytes) {
  model::Tree tree;
  return model_file::read(bytes, tree);
}

void refused(Refusal want, const ModelBytes& bytes) {
  STRCMP_EQUAL(std::string(info(want).what).c_str(), std::string(info(read(bytes)).what).c_str());
  STRCMP_EQUAL("", test::check_model_bytes(bytes).c_str());
}

void refused(Refusal want, const std::vector<Node>& nodes) {
  refused(want, model_bytes(kSet, nodes));
}

// The small model with one byte changed and the check sum made right again.
ModelBytes with_byte(std::size_t at, std::uint8_t value) {
  ModelBytes bytes = model_bytes(kSet, small());
  bytes[at] = value;
  return repaired(bytes);
}

ModelBytes with_name(std::size_t at, std::string_view name) {
  ModelBytes bytes = model_bytes(kSet, small());
  std::fill_n(bytes.begin() + static_cast<std::ptrdiff_t>(at), 32, std::uint8_t{0});
  test::put_name(bytes, at, name);
  return repaired(bytes);
}

// `depth` predicates under each other, each with a leaf as its second child.
std::vector<Node> chain(int depth) {
  std::vector<Node> nodes;
  nodes.reserve(2 * idx(depth) + 1);
  for (int i = 0; i < depth; ++i) nodes.push_back(split(100 - i, 2 * depth - i));
  nodes.push_back(kHold);
  nodes.insert(nodes.end(), static_cast<std::size_t>(depth), kSlip);
  return nodes;
}

}  // namespace

// clang-format off
TEST_GROUP(ModelFile) {};
// clang-format on

TEST(ModelFile, ReadsWhatTheTableSays) {
  model::Tree tree;
  CHECK(Refusal::kNone == model_file::read(model_bytes(kSet, small(), "a_name_of_32_small_letters_12345"), tree));
  STRCMP_EQUAL("a_name_of_32_small_letters_12345", std::string(name_of(tree)).c_str());
  POINTERS_EQUAL(&kSet, tree.set);
  UNSIGNED_LONGS_EQUAL(0x01020304, tree.text_crc32);
  LONGS_EQUAL(3, tree.count);
  CHECK(std::ranges::equal(small(), std::span(tree.nodes).first(3)));
  CHECK(Node{} == tree.nodes[3]);
}

TEST(ModelFile, NamesMayHoldTheFirstAndTheLastOfLettersAndDigits) {
  for (const char* name : {"a", "z", "za_09"}) {
    model::Tree tree;
    CHECK(Refusal::kNone == model_file::read(model_bytes(kSet, small(), name), tree));
    STRCMP_EQUAL(name, std::string(name_of(tree)).c_str());
  }
}

TEST(ModelFile, TreesOfEverySetUpToTheLimitsAnswerAsTheOracle) {
  for (const FeatureSet& set : kFeatureSets) {
    for (std::uint32_t seed = 0; seed < 12; ++seed) {
      const int depth = seed % 3 == 0 ? 24 : static_cast<int>(seed);
      const ModelBytes bytes = model_bytes(set, RandomNodes(seed, set, std::max(1, depth), 511).nodes());
      CHECK(Refusal::kNone == read(bytes));
      STRCMP_EQUAL("", test::check_model_bytes(bytes).c_str());
    }
  }
}

TEST(ModelFile, TheLargestTreeIsRead) {
  const FeatureSet& paper = *find_feature_set("paper");
  std::size_t largest = 0;
  for (std::uint32_t seed = 0; seed < 5; ++seed) {
    const std::vector<Node> nodes = RandomNodes(seed, paper, 24, 511).nodes();
    CHECK(Refusal::kNone == read(model_bytes(paper, nodes)));
    largest = std::max(largest, nodes.size());
  }
  LONGS_EQUAL(511, largest);
  CHECK(Refusal::kNone == read(model_bytes(kSet, chain(24))));
}

TEST(ModelFile, ThresholdsMayStandAtTheEdgesOfWhatThePathLeaves) {
  const std::int32_t min = kSet[0].min;
  const std::int32_t max = kSet[0].max;
  for (const std::int32_t edge : {min, max - 1}) {
    CHECK(Refusal::kNone == read(model_bytes(kSet, std::vector<Node>{split(edge, 2), kHold, kSlip})));
  }
  for (const std::int32_t edge : {6, max - 1}) {
    CHECK(Refusal::kNone ==
          read(model_bytes(kSet, std::vector<Node>{split(5, 2), kHold, split(edge, 4), kHold, kSlip})));
  }
  // What one side narrows, the other side has back: 4 divides nothing below 5's second child, but does beside it.
  CHECK(Refusal::kNone == read(model_bytes(kSet, std::vector<Node>{split(3, 4, 1), split(5, 3), kHold, kSlip,
                                                                   split(4, 6), kHold, kSlip})));
}

TEST(ModelFile, RefusesEachFaultWithItsOwnReason) {
  const std::int32_t min = kSet[0].min;
  const std::int32_t max = kSet[0].max;
  const ModelBytes good = model_bytes(kSet, small());
  refused(Refusal::kMagic, ModelBytes{});
  refused(Refusal::kMagic, ModelBytes(good.begin(), good.begin() + 7));
  refused(Refusal::kMagic, with_byte(4, '\n'));
  for (const int size : {8, 9, 10, 11, 5295}) refused(Refusal::kSize, ModelBytes(good.begin(), good.begin() + size));
  ModelBytes longer = good;
  longer.push_back(0);
  refused(Refusal::kSize, longer);
  for (const int version : {0, 1, 2, 4}) refused(Refusal::kVersion, with_byte(8, static_cast<std::uint8_t>(version)));
  refused(Refusal::kVersion, with_byte(9, 1));
  ModelBytes damaged = good;
  damaged[700] = 1;
  refused(Refusal::kCrc, damaged);
  refused(Refusal::kSigned, with_byte(5228, 1));
  refused(Refusal::kSigned, with_byte(5291, 0x80));
  refused(Refusal::kForm, with_byte(13, 1));
  for (const char* name : {"", "Test", "1st", "_x", "a b", "caf\xc3\xa9"}) refused(Refusal::kForm, with_name(20, name));
  refused(Refusal::kForm, with_byte(20 + 31, 'x'));
  refused(Refusal::kForm, with_byte(10, 2));
  refused(Refusal::kForm, with_byte(11, 2));            // 515 nodes
  refused(Refusal::kForm, with_byte(1140 + 3 * 8, 1));  // behind the last node
  refused(Refusal::kForm, with_byte(5227, 1));
  refused(Refusal::kSetUnknown, with_name(52, "none"));
  refused(Refusal::kSetUnknown, with_name(52, ""));
  refused(Refusal::kSetUnknown, with_byte(52 + 31, 'x'));
  refused(Refusal::kFeatures, with_byte(12, static_cast<std::uint8_t>(kSet.size() - 1)));
  refused(Refusal::kFeatures, with_name(84, kSet[1].name));
  refused(Refusal::kFeatures, with_name(84 + 31 * 32, "more"));
  refused(Refusal::kFeatures, with_byte(1108, static_cast<std::uint8_t>(kSet[0].q + 1)));
  refused(Refusal::kFeatures, with_byte(1108 + 31, 1));
  refused(Refusal::kNode, with_byte(1147, 3));
  refused(Refusal::kNode, with_byte(1146, static_cast<std::uint8_t>(kSet.size())));
  refused(Refusal::kNode, with_byte(1140 + 8, 1));  // a leaf with a threshold
  refused(Refusal::kNoChild, {split(5, 3), kHold, kSlip});
  refused(Refusal::kNoChild, {split(5, 65535), kHold, kSlip});
  refused(Refusal::kNoChild, {split(5, 2), kHold, split(7, 3)});
  refused(Refusal::kCircle, {split(5, 0), kHold, kSlip});
  refused(Refusal::kCircle, {split(5, 2), kHold, split(7, 0), kHold, kSlip});
  refused(Refusal::kTwoParents, {split(5, 1), kHold, kSlip});
  refused(Refusal::kTwoParents, {split(5, 3), split(3, 3), kHold, kSlip, kSlip});
  refused(Refusal::kUnreachable, {split(5, 3), kHold, kSlip, kSlip});
  refused(Refusal::kUnreachable, {split(5, 2), kHold, kSlip, kSlip});
  refused(Refusal::kUnreachable, {kHold, kSlip, kSlip});
  refused(Refusal::kTooDeep, chain(25));
  refused(Refusal::kOneWay, {split(max, 2), kHold, kSlip});
  refused(Refusal::kOneWay, {split(min - 1, 2), kHold, kSlip});
  refused(Refusal::kOneWay, {split(5, 4), split(5, 3), kHold, kSlip, kSlip});
  refused(Refusal::kOneWay, {split(5, 2), kHold, split(5, 4), kHold, kSlip});
  refused(Refusal::kOneVerdict, {split(5, 2), kHold, kHold});
  refused(Refusal::kOneVerdict, {split(5, 2), kSlip, kSlip});
}

TEST(ModelFile, OneFlippedBitIsRefused) {
  const ModelBytes good = model_bytes(kSet, RandomNodes(7, kSet, 4, 63).nodes());
  // All of the head, of the nodes in use and of the end; of the zeros between, every 13th byte (host_tests takes all).
  for (std::size_t at = 0; at < good.size(); at += at >= 1672 && at < 5216 ? 13 : 1) {
    for (int bit = 0; bit < 8; ++bit) {
      ModelBytes bytes = good;
      bytes[at] = static_cast<std::uint8_t>(bytes[at] ^ (1 << bit));
      CHECK(Refusal::kNone != read(bytes));
    }
  }
}

// Whoever makes the check sum right again meets the structure: taken only when the oracle takes it, and then equal to
// it.
TEST(ModelFile, OneFlippedBitUnderARightCheckSumIsJudgedAsTheOracleDoes) {
  for (const FeatureSet* set : {&kFeatureSets.front(), &kFeatureSets.back()}) {
    const std::vector<Node> nodes = RandomNodes(7, *set, 4, 31).nodes();
    const ModelBytes good = model_bytes(*set, nodes);
    for (std::size_t at = 0; at < 1140 + 8 * nodes.size(); ++at) {
      if (at >= 84 && at < 1108 && at % 32 > 3) continue;  // names: their first bytes tell
      for (int bit = 0; bit < 8; ++bit) {
        ModelBytes bytes = good;
        bytes[at] = static_cast<std::uint8_t>(bytes[at] ^ (1 << bit));
        STRCMP_EQUAL("", test::check_model_bytes(repaired(bytes)).c_str());
      }
    }
  }
}

TEST(ModelFile, RandomNodesUnderARightCheckSumAreJudgedAsTheOracleDoes) {
  std::mt19937 random(3);
  int taken = 0;
  for (std::uint32_t round = 0; round < 400; ++round) {
    std::vector<Node> nodes = RandomNodes(round, kSet, 5, 31).nodes();
    for (int changes = static_cast<int>(random() % 3); changes > 0; --changes) {
      Node& node = nodes[random() % nodes.size()];
      switch (random() % 4) {
        case 0:
          node.child_false = static_cast<std::uint16_t>(random() % (nodes.size() + 1));
          break;
        case 1:
          node.threshold = static_cast<std::int32_t>(random() % 64) - 32;
          break;
        case 2:
          node.kind = static_cast<Kind>(random() % 3);
          break;
        default:
          node.feature = static_cast<std::uint8_t>(random() % 3);
          break;
      }
    }
    const ModelBytes bytes = model_bytes(kSet, nodes);
    taken += read(bytes) == Refusal::kNone ? 1 : 0;
    STRCMP_EQUAL("", test::check_model_bytes(bytes).c_str());
  }
  CHECK(taken > 100 && taken < 300);  // both kinds were met
}

TEST(ModelFile, TheSeedsOfTheFuzzerStandTheirTest) {
  for (const ModelBytes& bytes : test::model_seeds()) STRCMP_EQUAL("", test::check_model_bytes(bytes).c_str());
}

TEST(ModelFile, ATreeThatNobodyFilledAnswersSlip) {
  const std::vector<std::int32_t> x(kFeatureCount);
  CHECK(Verdict::kSlip == model::evaluate(model::Tree{}, x));
}
