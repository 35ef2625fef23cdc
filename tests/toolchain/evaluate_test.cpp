// SPDX-License-Identifier: Apache-2.0
// The evaluation on made-up samples whose answers are known, its statistics against closed forms, and the command.
#include "toolchain/learn/evaluate.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>
#include <sstream>

#include "drivers/sim/scene/math/random.hpp"
#include "tests/support/folders.hpp"
#include "tests/support/host_process.hpp"
#include "tests/support/temp_dir.hpp"
#include "toolchain/learn/evaluate_report.hpp"
#include "toolchain/learn/paper_figures.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::learn;
using holdfast::test::kTool;

namespace {

// What a row's Vx and Vy are; all other features stay 0.
using Paint = std::function<std::int32_t(const Trial&, int trial, bool slip)>;

void add_trial(Samples& samples, const std::string& object, bool slips, const Paint& vx, int rows = 30) {
  Trial trial;
  trial.object = object;
  trial.primitive = "translate_x";
  trial.kind = slips ? "slip" : "static";
  trial.seed = samples.trials.size();
  trial.first = static_cast<int>(samples.rows.size());
  trial.count = rows;
  const int number = static_cast<int>(samples.trials.size());
  samples.trials.push_back(trial);
  for (int k = 0; k < rows; ++k) {
    Row row;
    row.trial = number;
    row.frame = k;
    row.t_s = 0.04 * k;
    row.label = slips && k >= rows / 2 ? Label::kSlip : Label::kHold;
    row.x[0] = vx(trial, number, row.label == Label::kSlip);
    row.x[1] = row.x[0] / 2;
    samples.rows.push_back(row);
  }
}

Samples objects(const std::vector<std::string>& names, int trials_each, const Paint& vx) {
  Samples samples;
  for (const std::string& name : names) {
    for (int i = 0; i < trials_each; ++i) add_trial(samples, name, i % 2 == 0, vx);
  }
  return samples;
}

const std::vector<std::string> kThree{"ball", "box", "duck"};

std::int32_t told_apart(const Trial&, int trial, bool slip) {
  return (slip ? 1000 : -1000) + trial;
}

Options fast() {
  Options options;
  options.sets = {find_feature_set("velocity")};
  options.tree.min_leaf = 5;
  options.seeds = 2;
  options.unseen = false;
  return options;
}

Evaluation evaluated(const Samples& samples, const Options& options) {
  Evaluation out;
  const auto error = evaluate(samples, options, out);
  CHECK_TEXT(!error, error ? error->c_str() : "");
  return out;
}

std::string refusal(const Samples& samples, const Options& options) {
  Evaluation out;
  return evaluate(samples, options, out).value_or("");
}

// P(X <= count), X Poisson with this mean, term by term.
double poisson_at_most(long count, double mean) {
  double sum = 0.0;
  for (long k = 0; k <= count; ++k) {
    sum += std::exp(static_cast<double>(k) * std::log(mean) - mean - std::lgamma(static_cast<double>(k) + 1.0));
  }
  return sum;
}

}  // namespace

TEST_GROUP(Evaluate) {
  test::TempDir folder;

  std::string file(const std::string& name, const Samples& samples) {
    std::ostringstream out;
    write_csv(out, samples);
    test::write_file(folder / name, out.str());
    return (folder / name).string();
  }
  // Runs the tool, which must refuse in one line and leave nothing behind.
  std::string refused(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), {kTool, "evaluate"});
    arguments.insert(arguments.end(), {"--out", (folder / "out").string(), "--json", (folder / "out.json").string()});
    const test::Finished run = test::run(arguments);
    LONGS_EQUAL(1, run.status);
    LONGS_EQUAL(1, std::count(run.err.begin(), run.err.end(), '\n'));
    CHECK(run.err.find("Likely cause: ") != std::string::npos && run.err.find("Next: ") != std::string::npos);
    CHECK(!std::filesystem::exists(folder / "out"));
    CHECK(!std::filesystem::exists(folder / "out.json"));
    return run.err;
  }
};

TEST(Evaluate, GammaTailHasItsClosedForms) {
  for (const double x : {1e-3, 0.1, 0.9, 1.0, 2.5, 10.0, 40.0}) {
    DOUBLES_EQUAL(-std::expm1(-x), gamma_p(1.0, x), 1e-12);
    DOUBLES_EQUAL(std::erf(std::sqrt(x)), gamma_p(0.5, x), 1e-12);
    DOUBLES_EQUAL(1.0 - std::exp(-x) * (1.0 + x + x * x / 2.0), gamma_p(3.0, x), 1e-12);
  }
  DOUBLES_EQUAL(0.0, gamma_p(2.0, 0.0), 0.0);
}

TEST(Evaluate, PoissonIntervalsAreExact) {
  DOUBLES_EQUAL(0.0, poisson_interval(0).low, 0.0);
  DOUBLES_EQUAL(-std::log(0.025), poisson_interval(0).high, 1e-9);  // 3.689
  DOUBLES_EQUAL(-std::log(0.975), poisson_interval(1).low, 1e-9);
  DOUBLES_EQUAL(-std::log(0.05), poisson_interval(0, 0.9).high, 1e-9);
  for (const long count : {1L, 2L, 10L, 77L, 400L}) {
    const PoissonInterval interval = poisson_interval(count);
    DOUBLES_EQUAL(0.025, 1.0 - poisson_at_most(count - 1, interval.low), 1e-9);
    DOUBLES_EQUAL(0.025, poisson_at_most(count, interval.high), 1e-9);
  }
}

TEST(Evaluate, QuantilesAreValuesThatOccurred) {
  CHECK(!quantile({}, 0.5));
  DOUBLES_EQUAL(3.0, *quantile({5.0, 1.0, 3.0}, 0.5), 0.0);
  DOUBLES_EQUAL(2.0, *quantile({1.0, 2.0, 3.0, 4.0}, 0.5), 0.0);
  DOUBLES_EQUAL(9.0, *quantile({1, 2, 3, 4, 5, 6, 7, 8, 9, 10}, 0.9), 0.0);
  DOUBLES_EQUAL(7.0, *quantile({7.0}, 0.95), 0.0);
  DOUBLES_EQUAL(1.0, *quantile({1.0, 2.0}, 0.0), 0.0);
}

TEST(Evaluate, WhatIsToldApartIsToldApartByAll) {
  const Evaluation e = evaluated(objects(kThree, 10, told_apart), fast());
  LONGS_EQUAL(2, e.five_fold.size());
  for (const FiveFoldScore& score : e.five_fold) {
    for (const Scores& scores : {score.by_trial, score.by_frame}) {
      LONGS_EQUAL(2, scores.accuracy.count);
      DOUBLES_EQUAL(1.0, scores.accuracy.mean, 0.0);
      DOUBLES_EQUAL(1.0, scores.f1.mean, 0.0);
      DOUBLES_EQUAL(0.0, scores.accuracy.half, 0.0);
    }
  }
  for (const ObjectsScore& score : e.left_out) DOUBLES_EQUAL(1.0, score.worst().frames.accuracy(), 0.0);
  const EventGroup& all = e.events[0].groups.front();
  LONGS_EQUAL(15, all.onsets);
  LONGS_EQUAL(15, all.frames.size());
  DOUBLES_EQUAL(1.0, *quantile(all.frames, 0.5), 0.0);  // the second slip in a row
  DOUBLES_EQUAL(40.0, *quantile(all.ms, 0.5), 1e-6);
  LONGS_EQUAL(0, all.false_alarms);
}

TEST(Evaluate, NoiseIsWorthNothing) {
  scene::Random random(9);
  const auto noise = [&](const Trial&, int, bool) { return static_cast<std::int32_t>(1000.0 * random.normal()); };
  const Evaluation e = evaluated(objects(kThree, 40, noise), fast());
  // 900 slip and 2700 hold rows: the standard deviation of a coin's balanced accuracy is 0.01.
  for (const FiveFoldScore& score : e.five_fold) {
    DOUBLES_EQUAL(0.5, score.by_trial.balanced.mean, 0.04);
    DOUBLES_EQUAL(0.5, score.by_frame.balanced.mean, 0.04);
  }
}

// Each grasp has a speed of its own, which says nothing about slip: half of the grasps slip from their first frame on.
TEST(Evaluate, FramesOfOneGraspOnBothSidesLeakItsIdentity) {
  scene::Random random(21);
  Samples samples;
  for (int t = 0; t < 120; ++t) {
    const auto own = static_cast<std::int32_t>(random.below(2'000'000) - 1'000'000);
    add_trial(
        samples, kThree[static_cast<std::size_t>(t % 3)], false, [&](const Trial&, int, bool) { return own; }, 20);
    if (random.below(2) == 0) continue;
    const Trial& trial = samples.trials.back();
    for (int r = 0; r < trial.count; ++r) samples.rows[static_cast<std::size_t>(trial.first + r)].label = Label::kSlip;
  }
  Options options = fast();
  options.seeds = 3;
  const FiveFoldScore score = evaluated(samples, options).five_fold.back();  // k-NN
  DOUBLES_EQUAL(1.0, score.by_frame.accuracy.mean, 1e-3);
  // 120 grasps, each one coin: standard deviation 0.046.
  DOUBLES_EQUAL(0.5, score.by_trial.accuracy.mean, 0.15);
}

TEST(Evaluate, TheObjectLeftOutIsNotLearned) {
  // The liar's speeds are its own: whoever saw it once would know it.
  const auto one_lies = [](const Trial& trial, int, bool slip) {
    return trial.object == "duck" ? (slip ? -900 : 900) : (slip ? 500 : -500);
  };
  const Evaluation e = evaluated(objects({"ball", "box", "duck", "mouse"}, 10, one_lies), fast());
  const ObjectsScore& score = e.left_out.front();
  CHECK(score.worst().object == "duck");
  DOUBLES_EQUAL(0.0, score.worst().frames.accuracy(), 0.0);
  DOUBLES_EQUAL(0.75, score.mean_accuracy(), 1e-12);
  // Five-fold has seen each object.
  DOUBLES_EQUAL(1.0, e.five_fold.front().by_trial.accuracy.mean, 0.0);
}

TEST(Evaluate, UnseenObjectsAreOnlyTestedOn) {
  const auto book_lies = [](const Trial& trial, int, bool slip) {
    return trial.object == "book" ? (slip ? -900 : 900) : (slip ? 500 : -500);
  };
  Options options = fast();
  options.unseen = true;
  const Evaluation e = evaluated(objects({"ball", "box", "book", "raccoon"}, 10, book_lies), options);
  DOUBLES_EQUAL(1.0, e.five_fold.front().by_trial.accuracy.mean, 0.0);
  LONGS_EQUAL(2, e.left_out.front().objects.size());
  LONGS_EQUAL(2, e.unseen.front().objects.size());
  CHECK(e.unseen.front().worst().object == "book");
  DOUBLES_EQUAL(0.0, e.unseen.front().worst().frames.accuracy(), 0.0);
  DOUBLES_EQUAL(0.5, e.unseen.front().mean_accuracy(), 0.0);
}

TEST(Evaluate, AnAlarmThatWasUpBeforeIsNoDetection) {
  EventGroup group;
  GraspEvent event;
  event.slips = true;
  event.onset_s = 1.0;
  event.raised_s = 1.0;
  event.raised_frames = 0;
  event.raised_before = true;
  event.false_alarms = 1;
  event.held_s = 30.0;
  group.add(event);
  event.raised_before = false;
  event.false_alarms = 0;
  for (const int frames : {2, 7, 3}) {
    event.raised_frames = frames;
    event.raised_s = 1.0 + 0.04 * frames;
    group.add(event);
  }
  event.raised_s.reset();
  event.raised_frames.reset();
  group.add(event);
  LONGS_EQUAL(5, group.onsets);
  LONGS_EQUAL(1, group.before);
  LONGS_EQUAL(1, group.missed);
  LONGS_EQUAL(3, group.frames.size());
  DOUBLES_EQUAL(3.0, *quantile(group.frames, 0.5), 0.0);
  DOUBLES_EQUAL(0.2, group.within(2), 1e-12);
  DOUBLES_EQUAL(0.4, group.within(5), 1e-12);
  DOUBLES_EQUAL(0.6, group.within(10), 1e-12);
  DOUBLES_EQUAL(1.0 * 3600 / 150, group.alarms_per_hour(), 1e-9);
  DOUBLES_EQUAL(poisson_interval(1).high * 24.0, group.alarms_per_hour_interval().high, 1e-9);
  CHECK(std::isinf(EventGroup{}.alarms_per_hour_interval().high));
}

TEST(Evaluate, SaysWhatIsWrongWithTheData) {
  const Samples good = objects(kThree, 10, told_apart);
  STRCMP_EQUAL("", refusal(good, fast()).c_str());
  STRCMP_CONTAINS("1 known object:", refusal(objects({"ball"}, 10, told_apart), fast()).c_str());
  STRCMP_CONTAINS("0 known objects:", refusal(objects({"book"}, 10, told_apart), fast()).c_str());
  STRCMP_CONTAINS("into 5 folds", refusal(objects({"ball", "box"}, 2, told_apart), fast()).c_str());
  Options unseen = fast();
  unseen.unseen = true;
  STRCMP_CONTAINS("no unseen objects", refusal(good, unseen).c_str());
  Samples still = good;
  for (Row& row : still.rows) row.label = Label::kHold;
  STRCMP_CONTAINS("all rows are hold", refusal(still, fast()).c_str());
}

TEST(Evaluate, StopsWhenTold) {
  Options options = fast();
  long last = 0;
  long all = 0;
  options.progress = [&](long done, long total) {
    CHECK(done >= last && done <= total);
    last = done;
    all = total;
    return true;
  };
  const Samples good = objects(kThree, 10, told_apart);
  STRCMP_EQUAL("", refusal(good, options).c_str());
  CHECK(all > 0);
  for (const double share : {0.0, 0.3, 0.8}) {
    options.progress = [&](long done, long total) {
      return static_cast<double>(done) < share * static_cast<double>(total);
    };
    STRCMP_EQUAL("stopped", refusal(good, options).c_str());
  }
}

TEST(Evaluate, PaperFiguresAreThoseOfItsText) {
  const auto accuracy = [](std::string_view set, std::string_view kind) {
    return paper::five_fold(set, kind)->accuracy;
  };
  // Section V.C: gains of E and dE/dt over V. The text rounds to a tenth.
  DOUBLES_EQUAL(11.7, accuracy("entropy", "tree") - accuracy("velocity", "tree"), 0.05);
  DOUBLES_EQUAL(15.37, accuracy("paper", "knn") - accuracy("velocity", "knn"), 0.015);
  // Abstract and section V.D.
  DOUBLES_EQUAL(95.61, accuracy("paper", "knn"), 0.0);
  DOUBLES_EQUAL(38.46, paper::left_out("velocity", "sponge")->accuracy, 0.0);
  DOUBLES_EQUAL(42.69, paper::left_out("velocity", "mouse")->accuracy, 0.0);
  DOUBLES_EQUAL(71.69, paper::unseen("book")->accuracy, 0.0);
  POINTERS_EQUAL(nullptr, paper::left_out("entropy", "book"));
  // F1 follows from precision and recall; a slip of the pen in either would show. Table I averages folds: 1 %.
  const auto f1 = [](const paper::Scores& s) { return 2.0 * s.precision * s.recall / (s.precision + s.recall); };
  for (const paper::FiveFold& row : paper::kFiveFold) DOUBLES_EQUAL(f1(row.scores), row.scores.f1, 1.0);
  for (const paper::LeftOut& row : paper::kLeftOut) DOUBLES_EQUAL(f1(row.scores), row.scores.f1, 0.02);
  for (const paper::Unseen& row : paper::kUnseen) DOUBLES_EQUAL(f1(row.scores), row.scores.f1, 0.02);
  double mean = 0.0;
  for (const paper::LeftOut& row : paper::kLeftOut) mean += row.set == "entropy" ? row.scores.accuracy / 10.0 : 0.0;
  DOUBLES_EQUAL(91.7, mean, 0.05);
  for (const paper::LeftOut& row : paper::kLeftOut)
    CHECK(find_feature_set(row.set) != nullptr && !is_unseen(row.object));
  for (const paper::Unseen& row : paper::kUnseen) CHECK(is_unseen(row.object));
}

TEST(Evaluate, TablesSayTheSameAsCsvAndText) {
  Table table{.id = "t", .title = "A <title>", .brief_id = "show", .brief_value = "1"};
  table.columns = {{"name", "name", ""},
                   {"show", "show", "", 0},
                   {"share", "share", "group", 1, true, true},
                   {"hidden", "hidden", "group", 1, false}};
  table.rows = {{"a,\"b\"", 1, Interval{0.5, 0.01, 3}, -0.01},
                {"c", 2, Interval{0.25, 0.0, 1}, {}},
                {"d", 1, {}, std::numeric_limits<double>::infinity()}};
  STRCMP_EQUAL("name,show,share,share_ci95,hidden\n\"a,\"\"b\"\"\",1,50.000,1.000,-0.010\nc,2,25.000,,\nd,1,,,\n",
               csv(table).c_str());
  const std::string brief = text(table);
  STRCMP_CONTAINS("50.0 +- 1.0", brief.c_str());
  CHECK(brief.find("25.0") == std::string::npos);
  CHECK(brief.find("hidden") == std::string::npos);
}

// Names of clips and objects are anybody's, and a terminal would obey them.
TEST(Evaluate, TextHoldsNoControlCharacters) {
  const std::string said = learn::text({.id = "clips",
                                        .title = "Clips",
                                        .columns = {{"clip", "clip", ""}},
                                        .rows = {{"a\x1B]0;b\x07\n\x7F\xC2\x9Bm \xC3\xA4"}}});
  STRCMP_CONTAINS("\n  a?]0;b?????m \xC3\xA4\n", said.c_str());
}

TEST(Evaluate, CommandWritesEverythingTwiceTheSame) {
  const std::string data = file("data.csv", objects({"ball", "box", "duck"}, 10, told_apart));
  const std::string unseen = file("unseen.csv", objects({"book"}, 4, told_apart));
  std::vector<std::string> seen;
  for (const std::string_view name : {"one", "two"}) {
    const std::string out = (folder / name).string();
    const test::Finished run = test::run({kTool, "evaluate", data, unseen, "--seeds", "2", "--min-leaf", "5", "--sets",
                                          "velocity,paper", "--out", out, "--json", out + ".json"});
    STRCMP_EQUAL("", run.err.c_str());
    LONGS_EQUAL(0, run.status);
    STRCMP_CONTAINS("Table II", run.out.c_str());
    std::string all;
    int count = 0;
    for (const char* name_of_file : {"table1.csv", "table2.csv", "table2_summary.csv", "table3.csv", "events.csv"}) {
      const std::string bytes = test::read_file(folder.path() / name / name_of_file);
      CHECK_TEXT(!bytes.empty(), name_of_file);
      all += bytes;
      ++count;
    }
    const std::filesystem::directory_iterator entries(folder.path() / name);
    LONGS_EQUAL(count, std::distance(begin(entries), end(entries)));
    seen.push_back(all);
    const auto json = nlohmann::json::parse(test::read_file(out + ".json"));
    CHECK(json["source"] == "simulated");
    DOUBLES_EQUAL(100.0, json["tables"]["table1"][0]["accuracy"].get<double>(), 0.0);
    DOUBLES_EQUAL(82.2, json["tables"]["table1"][0]["paper_accuracy"].get<double>(), 0.0);
  }
  CHECK(seen[0] == seen[1]);
}

TEST(Evaluate, UnlessAskedItLooksAtTheMarkersAlone) {
  const std::string data = file("data.csv", objects(kThree, 10, told_apart));
  const std::string json = (folder / "all.json").string();
  const test::Finished run =
      test::run({kTool, "evaluate", data, "--json", json, "--seeds", "1", "--min-leaf", "5", "--without-unseen"});
  STRCMP_EQUAL("", run.err.c_str());
  std::vector<std::string> sets;
  const auto tables = nlohmann::json::parse(test::read_file(json))["tables"];
  for (const auto& row : tables["events"]) {
    if (row["kind"] == "all") sets.push_back(row["name"].get<std::string>());
  }
  CHECK((sets == std::vector<std::string>{"velocity", "entropy", "paper", "field"}));
}

TEST(Evaluate, CommandRefusesInOneLineAndWritesNothing) {
  const std::string good = file("good.csv", objects(kThree, 10, told_apart));
  const std::string one = file("one.csv", objects({"ball"}, 10, told_apart));
  test::write_file(folder / "bad.csv", "not,samples\n");
  STRCMP_CONTAINS("none.csv: cannot be read", refused({(folder / "none.csv").string()}).c_str());
  STRCMP_CONTAINS("bad.csv", refused({(folder / "bad.csv").string()}).c_str());
  STRCMP_CONTAINS("1 known object", refused({one}).c_str());
  STRCMP_CONTAINS("no unseen objects", refused({good}).c_str());
  STRCMP_CONTAINS("no such set", refused({good, "--sets", "velocity,nonsense"}).c_str());
  STRCMP_CONTAINS("is in", refused({good, one}).c_str());  // the ball's grasps twice
  STRCMP_CONTAINS("--model requires --recorded", refused({good, "--model", "none.tree"}).c_str());
  STRCMP_CONTAINS("--recorded", refused({"--recorded", "labels.csv", "--seeds", "2"}).c_str());
  STRCMP_CONTAINS("nan", refused({good, "--slip-weight", "nan"}).c_str());
  STRCMP_CONTAINS("--json would change an input", test::run({kTool, "evaluate", good, "--json", good}).err.c_str());
  CHECK(test::run({kTool, "evaluate", good}).err.find("no output") != std::string::npos);
  const test::Finished own_folder = test::run({kTool, "evaluate", good, "--out", folder.path().string()});
  STRCMP_CONTAINS("lies in the folder of the outputs", own_folder.err.c_str());
  const test::Finished no_folder = test::run({kTool, "evaluate", good, "--out", (folder / "a/b").string()});
  STRCMP_CONTAINS("the folder above it is not there", no_folder.err.c_str());
}
