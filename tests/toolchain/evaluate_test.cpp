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
#include "tests/support/host_process.hpp"
#include "tests/support/temp_dir.hpp"
#include "toolchain/learn/charts.hpp"
#include "toolchain/learn/evaluate_report.hpp"
#include "toolchain/learn/paper_figures.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::learn;

namespace {

constexpr const char* kTool = HOLDFAST_BIN_DIR "/holdfast";
constexpr const char* kOnPositiveVx =
    "format 1\nname sign\nfeature_set velocity\nfeature vx_um_s um/s Q0\nfeature vy_um_s um/s Q0\n"
    "node 0: vx_um_s <= 0 ? 1 : 2\nleaf 1: hold\nleaf 2: slip\n";

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

Options fast(std::vector<Kind> kinds) {
  Options options;
  options.sets = {find_feature_set("velocity")};
  options.kinds = kinds;
  options.left_out_kinds = std::move(kinds);
  options.tree.min_leaf = 5;
  options.seeds = 2;
  options.unseen = false;
  options.slip_weights = {1.0};
  options.tsne_points = 0;
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

TEST(Evaluate, OneThresholdIsTheBestOfAll) {
  scene::Random random(5);
  for (int round = 0; round < 20; ++round) {
    std::vector<double> values;
    std::vector<std::uint8_t> slip;
    for (int i = 0; i < 60; ++i) {
      slip.push_back(static_cast<std::uint8_t>(random.below(3) == 0 ? 1 : 0));
      values.push_back(random.below(12) + (round % 2 == 0 ? 3 : -3) * slip.back());  // ties on purpose
    }
    slip[0] = 1, slip[1] = 0;
    double best = 0.5;
    for (const double threshold : values) {
      Confusion above;
      for (std::size_t i = 0; i < values.size(); ++i) above.add(slip[i] != 0, values[i] > threshold);
      best = std::max({best, above.balanced_accuracy(), 1.0 - above.balanced_accuracy()});
    }
    const OneThreshold found = best_threshold(values, slip);
    DOUBLES_EQUAL(best, found.balanced_accuracy, 1e-12);
    Confusion applied;
    for (std::size_t i = 0; i < values.size(); ++i) {
      applied.add(slip[i] != 0, (values[i] > found.threshold) == found.slip_above);
    }
    DOUBLES_EQUAL(best, applied.balanced_accuracy(), 1e-12);
  }
  const std::vector<std::uint8_t> same{1, 1};
  DOUBLES_EQUAL(0.5, best_threshold(std::vector<double>{1.0, 2.0}, same).balanced_accuracy, 0.0);
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
  Options options = fast({Kind::kTree, Kind::kTreeCv, Kind::kForest, Kind::kSvm, Kind::kKnn});
  const Evaluation e = evaluated(objects(kThree, 10, told_apart), options);
  LONGS_EQUAL(5, e.five_fold.size());
  for (const FiveFoldScore& score : e.five_fold) {
    for (const Scores& scores : {score.by_trial, score.by_frame}) {
      LONGS_EQUAL(2, scores.accuracy.count);
      DOUBLES_EQUAL(1.0, scores.accuracy.mean, 0.0);
      DOUBLES_EQUAL(1.0, scores.f1.mean, 0.0);
      DOUBLES_EQUAL(0.0, scores.accuracy.half, 0.0);
    }
    LONGS_EQUAL(3, score.objects.size());
  }
  for (const ObjectsScore& score : e.left_out) DOUBLES_EQUAL(1.0, score.worst().frames.accuracy(), 0.0);
  CHECK(e.single.front().name == "|V|");
  // Both signs are as fast as each other: |V| of -1000 + trial and 1000 + trial differ by the trial alone.
  const auto signed_vx =
      std::find_if(e.single.begin(), e.single.end(), [](const auto& s) { return s.name == "vx_um_s"; });
  DOUBLES_EQUAL(1.0, signed_vx->best.balanced_accuracy, 0.0);
  LONGS_EQUAL(6, e.timing.size());
  CHECK(e.timing[0].us > e.timing[1].us);  // the firmware's walk copies nothing
  const EventGroup& all = e.events[1].groups.front();
  LONGS_EQUAL(2, e.events[1].raise_frames);
  LONGS_EQUAL(15, all.onsets);
  LONGS_EQUAL(15, all.frames.size());
  DOUBLES_EQUAL(1.0, *quantile(all.frames, 0.5), 0.0);  // the second slip in a row
  DOUBLES_EQUAL(40.0, *quantile(all.ms, 0.5), 1e-6);
  LONGS_EQUAL(0, all.false_alarms);
}

TEST(Evaluate, NoiseIsWorthNothing) {
  scene::Random random(9);
  const auto noise = [&](const Trial&, int, bool) { return static_cast<std::int32_t>(1000.0 * random.normal()); };
  const Evaluation e = evaluated(objects(kThree, 40, noise), fast({Kind::kTree, Kind::kKnn}));
  // 900 slip and 2700 hold rows: the standard deviation of a coin's balanced accuracy is 0.01.
  for (const FiveFoldScore& score : e.five_fold) {
    DOUBLES_EQUAL(0.5, score.by_trial.balanced.mean, 0.04);
    DOUBLES_EQUAL(0.5, score.by_frame.balanced.mean, 0.04);
  }
  for (const SingleScore& score : e.single) CHECK(score.best.balanced_accuracy < 0.56);
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
  Options options = fast({Kind::kKnn});
  options.seeds = 3;
  const FiveFoldScore score = evaluated(samples, options).five_fold.front();
  DOUBLES_EQUAL(1.0, score.by_frame.accuracy.mean, 1e-3);
  // 120 grasps, each one coin: standard deviation 0.046.
  DOUBLES_EQUAL(0.5, score.by_trial.accuracy.mean, 0.15);
}

TEST(Evaluate, TheObjectLeftOutIsNotLearned) {
  // The liar's speeds are its own: whoever saw it once would know it.
  const auto one_lies = [](const Trial& trial, int, bool slip) {
    return trial.object == "duck" ? (slip ? -900 : 900) : (slip ? 500 : -500);
  };
  const Evaluation e = evaluated(objects({"ball", "box", "duck", "mouse"}, 10, one_lies), fast({Kind::kTree}));
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
  Options options = fast({Kind::kTree});
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

TEST(Evaluate, RequestsAreTheFirmwaresDecision) {
  Samples samples;
  add_trial(samples, "ball", true, told_apart, 20);
  samples.rows[12].accepted = false;
  //                                     0  1  2  3  4  5  6  7  8  9 10 11 12 13 14 15 16 17 18 19
  const std::vector<std::uint8_t> said{0, 1, 0, 1, 1, 0, 0, 0, 0, 0, 0, 1, 0, 1, 1, 0, 0, 0, 0, 0};
  // Two in a row raise; 0.2 s (five frames) after the last slip it drops. Row 12 was rejected: the run goes on over it.
  const std::vector<std::uint8_t> up{0, 0, 0, 0, 1, 1, 1, 1, 1, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 0};
  const std::vector<std::uint8_t> raised = requests_of(samples, samples.trials[0], said, {});
  CHECK(up == raised);
  const GraspEvent event = event_of(samples, 0, said, {});
  LONGS_EQUAL(1, event.false_alarms);
  LONGS_EQUAL(3, *event.raised_frames);
}

TEST(Evaluate, SaysWhatIsWrongWithTheData) {
  const Samples good = objects(kThree, 10, told_apart);
  STRCMP_EQUAL("", refusal(good, fast({Kind::kTree})).c_str());
  STRCMP_CONTAINS("1 known object:", refusal(objects({"ball"}, 10, told_apart), fast({Kind::kTree})).c_str());
  STRCMP_CONTAINS("0 known objects:", refusal(objects({"book"}, 10, told_apart), fast({Kind::kTree})).c_str());
  STRCMP_CONTAINS("into 5 folds", refusal(objects({"ball", "box"}, 2, told_apart), fast({Kind::kTree})).c_str());
  Options unseen = fast({Kind::kTree});
  unseen.unseen = true;
  STRCMP_CONTAINS("no unseen objects", refusal(good, unseen).c_str());
  Samples still = good;
  for (Row& row : still.rows) row.label = Label::kHold;
  STRCMP_CONTAINS("all rows are hold", refusal(still, fast({Kind::kTree})).c_str());
}

TEST(Evaluate, StopsWhenTold) {
  Options options = fast({Kind::kTree});
  options.tsne_points = 40;
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
  for (const double share : {0.0, 0.3, 0.95}) {
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
  DOUBLES_EQUAL(11.7, accuracy("entropy", "tree_cv") - accuracy("velocity", "tree_cv"), 0.05);
  DOUBLES_EQUAL(4.9, accuracy("entropy", "svm") - accuracy("velocity", "svm"), 0.05);
  DOUBLES_EQUAL(15.37, accuracy("paper", "knn") - accuracy("velocity", "knn"), 0.015);
  DOUBLES_EQUAL(8.36, accuracy("paper", "forest") - accuracy("velocity", "forest"), 0.015);
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
  for (const paper::Inference& row : paper::kInference) CHECK(find_kind(row.classifier).has_value());
  for (const paper::LeftOut& row : paper::kLeftOut)
    CHECK(find_feature_set(row.set) != nullptr && !is_unseen(row.object));
  for (const paper::Unseen& row : paper::kUnseen) CHECK(is_unseen(row.object));
}

TEST(Evaluate, TablesSayTheSameAsCsvTextAndPage) {
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
  ReportFacts facts;
  facts.source = "simulated";
  facts.facts = {{"data", "<b>&.csv"}};
  const std::string page = html(facts, {table}, {});
  STRCMP_CONTAINS("A &lt;title&gt;", page.c_str());
  STRCMP_CONTAINS("&lt;b&gt;&amp;.csv", page.c_str());
  STRCMP_CONTAINS("50.0 ± 1.0", page.c_str());
  STRCMP_CONTAINS(">0.0<", page.c_str());  // not -0.0
  CHECK(page.find("<script") == std::string::npos && page.find("http") == std::string::npos);
}

TEST(Evaluate, PicturesStandAnyData) {
  const Evaluation nothing;
  ReportFacts facts;
  LONGS_EQUAL(0, charts_of({}, nothing, facts).size());
  charts::Curves curves{.title = "t", .axis = "x", .panels = {{"p", 0, 1}}, .series = {{"s", {{{0.0, 0.5}}}}}};
  const std::string zero_only = draw(curves);
  charts::Clouds clouds{
      .title = "t", .first_class = "a", .second_class = "b", .panels = {{"p", {{1.0, 1.0, false}}}, {"q", {}}}};
  charts::Bars bars{.title = "a & b", .unit = "%", .groups = {"g"}, .series = {{"s", {std::nullopt}, false}}};
  charts::Histograms histograms{.title = "t", .axis = "x", .panels = {{"p", "", {-1.0, 1e9}}}};
  for (const std::string& svg : {zero_only, draw(clouds), draw(bars), draw(histograms)}) {
    CHECK(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"));
    CHECK(svg.find("nan") == std::string::npos && svg.find("inf") == std::string::npos);
  }
  STRCMP_CONTAINS("a &amp; b", draw(bars).c_str());
}

TEST(Evaluate, CommandWritesEverythingTwiceTheSame) {
  const std::string data = file("data.csv", objects({"ball", "box", "duck"}, 10, told_apart));
  const std::string unseen = file("unseen.csv", objects({"book"}, 4, told_apart));
  test::write_file(folder / "sign.tree", kOnPositiveVx);
  const auto evaluated_with = [&](const std::vector<std::string>& more) {
    std::vector<std::string> arguments{kTool, "evaluate", data, unseen, "--model", (folder / "sign.tree").string()};
    arguments.insert(arguments.end(), {"--seeds", "2", "--quick", "--min-leaf", "5"});
    arguments.insert(arguments.end(), {"--sets", "velocity,paper", "--kinds", "tree,knn"});
    arguments.insert(arguments.end(), more.begin(), more.end());
    return test::run(arguments);
  };
  std::vector<std::string> pieces{"--pieces"};
  for (const char* piece : {"1/3", "2/3", "3/3"}) {
    pieces.push_back((folder / ("piece" + std::string(piece, 1))).string());
    const test::Finished run = evaluated_with({"--shard", piece, "--piece", pieces.back()});
    STRCMP_EQUAL("", run.err.c_str());
    LONGS_EQUAL(0, run.status);
  }
  std::vector<std::string> seen;
  for (const std::string_view name : {"one", "two", "pieces"}) {
    const std::string out = (folder / name).string();
    std::vector<std::string> more{"--out", out, "--json", out + ".json", "--report", out + ".html"};
    if (name == "pieces") more.insert(more.end(), pieces.begin(), pieces.end());
    const test::Finished run = evaluated_with(more);
    STRCMP_EQUAL("", run.err.c_str());
    LONGS_EQUAL(0, run.status);
    STRCMP_CONTAINS("Table II", run.out.c_str());
    std::string all;
    int count = 0;
    for (const char* name_of_file :
         {"goals.csv", "single.csv", "table1.csv", "table2.csv", "table2_accuracy.csv", "table2_summary.csv",
          "table3.csv", "events.csv", "events_all.csv", "events_by_kind.csv", "curve.csv", "models.csv",
          "model_events.csv", "objects.svg", "delays.svg", "curve.svg", "tsne.svg"}) {
      const std::string bytes = test::read_file(folder.path() / name / name_of_file);
      CHECK_TEXT(!bytes.empty(), name_of_file);
      all += bytes;
      ++count;
    }
    const std::filesystem::directory_iterator entries(folder.path() / name);
    LONGS_EQUAL(count + 2, std::distance(begin(entries), end(entries)));  // and timing.csv, report.html
    seen.push_back(all);
    const auto json = nlohmann::json::parse(test::read_file(out + ".json"));
    CHECK(json["source"] == "simulated");
    DOUBLES_EQUAL(100.0, json["tables"]["table1"][0]["accuracy"].get<double>(), 0.0);
    DOUBLES_EQUAL(82.2, json["tables"]["table1"][0]["paper_accuracy"].get<double>(), 0.0);
    const std::string page = test::read_file(out + ".html");
    CHECK(page == test::read_file(folder.path() / name / "report.html"));
    STRCMP_CONTAINS("may have been trained on these very rows", page.c_str());
  }
  CHECK(seen[0] == seen[1]);
  CHECK(seen[0] == seen[2]);  // and learned in three pieces
}

TEST(Evaluate, PiecesAreThoseOfOneRun) {
  const Samples samples = objects(kThree, 10, told_apart);
  const auto learned = [&](int shard, const Options& asked) {
    Piece piece;
    Options options = asked;
    options.piece = &piece;
    options.shard = shard;
    options.shards = 2;
    (void)evaluated(samples, options);
    std::ostringstream out;
    write_piece(out, piece);
    return out.str();
  };
  const Options options = fast({Kind::kTree});
  const std::string first = learned(1, options);
  const std::string second = learned(2, options);
  const auto put = [](const std::vector<std::string>& texts, Piece& all) -> std::string {
    for (const std::string& text : texts) {
      std::istringstream in(text);
      if (auto error = read_piece(in, "piece", all)) return *error;
    }
    return {};
  };
  const auto whole_of = [&](const std::vector<std::string>& texts, Options whole) {
    Piece all;
    STRCMP_EQUAL("", put(texts, all).c_str());
    whole.pieces = &all;
    return refusal(samples, whole);
  };
  STRCMP_EQUAL("", whole_of({second, first}, options).c_str());
  STRCMP_CONTAINS("classifier 1 said is in none of the pieces", whole_of({first}, options).c_str());
  Options others = options;
  others.seeds = 3;
  STRCMP_CONTAINS("of another run", whole_of({first, second}, others).c_str());
  Piece all;
  STRCMP_CONTAINS("classifier 0 is there twice", put({first, first}, all).c_str());
  all = {};
  STRCMP_CONTAINS("another run than the pieces before", put({first, learned(2, others)}, all).c_str());
  for (const auto& [text, what] : std::vector<std::pair<std::string, const char*>>{
           {"", "piece:1: no piece of an evaluation"},
           {"holdfast evaluation piece,1,xyz\n", "piece:1: no run"},
           {first.substr(0, first.size() - 4), "no end"},
           {"holdfast evaluation piece,1,00000000\n0,5,f\n", "piece:2: no verdicts"},
           {"holdfast evaluation piece,1,00000000\n0,4294967295,f\n", "piece:2: no verdicts"},
           {"holdfast evaluation piece,1,00000000\n0,4,g\n", "piece:2: no verdicts"}}) {
    all = {};
    STRCMP_CONTAINS(what, put({text}, all).c_str());
  }
}

TEST(Evaluate, UnlessAskedItLooksAtTheMarkersAlone) {
  const std::string data = file("data.csv", objects(kThree, 10, told_apart));
  const std::string json = (folder / "all.json").string();
  const test::Finished run = test::run({kTool, "evaluate", data, "--json", json, "--seeds", "1", "--quick", "--kinds",
                                        "tree", "--min-leaf", "5", "--without", "unseen,events,curve,tsne"});
  STRCMP_EQUAL("", run.err.c_str());
  std::vector<std::string> sets;
  const auto tables = nlohmann::json::parse(test::read_file(json))["tables"];
  for (const auto& row : tables["table1"]) sets.push_back(row["set"].get<std::string>());
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
  STRCMP_CONTAINS("no such classifier", refused({good, "--kinds", "oracle"}).c_str());
  STRCMP_CONTAINS("is in", refused({good, one}).c_str());  // the ball's grasps twice
  STRCMP_CONTAINS("none.tree", refused({good, "--model", (folder / "none.tree").string()}).c_str());
  STRCMP_CONTAINS("overwrite an input", refused({good, "--report", good}).c_str());
  STRCMP_CONTAINS("nan", refused({good, "--slip-weight", "nan"}).c_str());
  STRCMP_CONTAINS("belong together", refused({good, "--shard", "1/2"}).c_str());
  STRCMP_CONTAINS("a piece has no tables", refused({good, "--shard", "1/2", "--piece", "p"}).c_str());
  STRCMP_CONTAINS("bad.csv:1: no piece", refused({good, "--pieces", (folder / "bad.csv").string()}).c_str());
  CHECK(test::run({kTool, "evaluate", good}).err.find("no output") != std::string::npos);
  const test::Finished own_folder = test::run({kTool, "evaluate", good, "--out", folder.path().string()});
  STRCMP_CONTAINS("lies in the folder of the outputs", own_folder.err.c_str());
  const test::Finished no_folder = test::run({kTool, "evaluate", good, "--out", (folder / "a/b").string()});
  STRCMP_CONTAINS("the folder above it is not there", no_folder.err.c_str());
}
