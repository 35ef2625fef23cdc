// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/evaluate_report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string_view>

#include "toolchain/learn/charts.hpp"
#include "toolchain/learn/paper_figures.hpp"
#include "toolchain/support/escape.hpp"

namespace holdfast::learn {
namespace {

using Cells = std::vector<Cell>;
constexpr int kDefaultRaise = decision::Config{}.raise_frames;

// The paper's decision tree stands beside both of ours.
std::string_view paper_name(Kind kind) {
  return kind == Kind::kTree ? name_of(Kind::kTreeCv) : name_of(kind);
}

std::optional<double> percent(double share) {
  return 100.0 * share;
}

void append(Cells& row, const Confusion& frames) {
  for (const double share :
       {frames.accuracy(), frames.precision(), frames.recall(), frames.f1(), frames.balanced_accuracy()}) {
    row.emplace_back(percent(share));
  }
}

void append(Cells& row, const paper::Scores* scores) {
  if (scores == nullptr) {
    row.resize(row.size() + 4);
    return;
  }
  for (const double value : {scores->accuracy, scores->precision, scores->recall, scores->f1}) row.emplace_back(value);
}

void add_scores(std::vector<Column>& columns, const std::string& group, bool interval) {
  for (const auto& [id, title] :
       {std::pair("accuracy", "accuracy"), std::pair("precision", "precision"), std::pair("recall", "recall"),
        std::pair("f1", "F1"), std::pair("balanced", "balanced accuracy")}) {
    const bool brief = std::string_view(id) == "accuracy" || std::string_view(id) == "balanced";
    columns.push_back({id, title, group, 1, brief, interval});
  }
}

void add_paper(std::vector<Column>& columns) {
  for (const auto& [id, title] : {std::pair("paper_accuracy", "accuracy"), std::pair("paper_precision", "precision"),
                                  std::pair("paper_recall", "recall"), std::pair("paper_f1", "F1")}) {
    columns.push_back({id, title, "paper, % (its own data)", 1, std::string_view(id) == "paper_accuracy"});
  }
}

struct PaperObjects {
  double mean = 0.0;
  const paper::LeftOut* worst = nullptr;  // nullptr: the paper has no such set
};

PaperObjects paper_objects(std::string_view set) {
  PaperObjects out;
  int count = 0;
  for (const paper::LeftOut& row : paper::kLeftOut) {
    if (row.set != set) continue;
    out.mean += row.scores.accuracy;
    ++count;
    if (out.worst == nullptr || row.scores.accuracy < out.worst->scores.accuracy) out.worst = &row;
  }
  if (count > 0) out.mean /= count;
  return out;
}

template <typename Score>
const Score* find(const std::vector<Score>& scores, const FeatureSet* set, Kind kind) {
  const auto at =
      std::find_if(scores.begin(), scores.end(), [&](const Score& s) { return s.set == set && s.kind == kind; });
  return at == scores.end() ? nullptr : &*at;
}

Confusion all_of(const std::vector<ObjectScore>& objects) {
  Confusion sum;
  for (const ObjectScore& object : objects) sum += object.frames;
  return sum;
}

std::vector<const FeatureSet*> sets_of(const Evaluation& e) {
  std::vector<const FeatureSet*> sets;
  for (const FiveFoldScore& score : e.five_fold) {
    if (std::find(sets.begin(), sets.end(), score.set) == sets.end()) sets.push_back(score.set);
  }
  return sets;
}

// --- tables ---

Table goals(const Evaluation& e, const ReportFacts& facts) {
  Table table{
      .id = "goals",
      .title = "Our tree against the goals",
      .note =
          "Own tree, the one that is deployed; alarms and delays with " + std::to_string(kDefaultRaise) +
          " slips in a row, object left out. The goals: the paper's k-NN (95.6 % with all features; 91.7 % and "
          "86.9 % with E and dE/dt), at most 2 frames, at most 1 alarm an hour of held contact. Always hold: what a "
          "classifier that knows nothing scores on these rows; the paper does not give its shares of the classes. "
          "Balanced: 50 % is worth nothing.",
      .brief = true,
      .columns = {{"set", "features", ""},
                  {"five_fold", "five-fold", "accuracy, %"},
                  {"left_out_mean", "left out, mean", "accuracy, %"},
                  {"left_out_worst", "left out, worst", "accuracy, %"},
                  {"five_fold_balanced", "five-fold", "balanced, %"},
                  {"left_out_balanced", "left out", "balanced, %"},
                  {"delay_frames", "delay, frames", "median", 0},
                  {"delay_ms", "delay, ms", "median", 0, false},
                  {"alarms_per_hour", "alarms an hour", facts.source},
                  {"alarms_low", "95 % from", facts.source},
                  {"alarms_high", "to", facts.source}}};
  table.rows.push_back({"goal", 95.6, 91.7, 86.9, {}, {}, 2.0, {}, 1.0, {}, {}});
  if (!e.left_out.empty()) {
    ObjectsScore idle = e.left_out.front();
    for (ObjectScore& object : idle.objects) {
      const Confusion& f = object.frames;
      object.frames = {.true_hold = f.true_hold + f.false_slip, .false_hold = f.true_slip + f.false_hold};
    }
    const Confusion all = all_of(idle.objects);
    table.rows.push_back({"always hold", percent(all.accuracy()), percent(idle.mean_accuracy()),
                          percent(idle.worst().frames.accuracy()), percent(all.balanced_accuracy()),
                          percent(all.balanced_accuracy())});
    table.rows.back().resize(table.columns.size());
  }
  for (const FeatureSet* set : sets_of(e)) {
    Cells row{set->name};
    const FiveFoldScore* fold = find(e.five_fold, set, Kind::kTree);
    row.emplace_back(fold != nullptr ? percent(fold->by_trial.accuracy.mean) : std::nullopt);
    const ObjectsScore* left = find(e.left_out, set, Kind::kTree);
    row.emplace_back(left != nullptr ? percent(left->mean_accuracy()) : std::nullopt);
    row.emplace_back(left != nullptr ? percent(left->worst().frames.accuracy()) : std::nullopt);
    row.emplace_back(fold != nullptr ? percent(fold->by_trial.balanced.mean) : std::nullopt);
    row.emplace_back(left != nullptr ? percent(all_of(left->objects).balanced_accuracy()) : std::nullopt);
    const auto at = std::find_if(e.events.begin(), e.events.end(), [&](const EventScore& score) {
      return score.name == set->name && score.raise_frames == kDefaultRaise;
    });
    if (at != e.events.end()) {
      const EventGroup& all = at->groups.front();
      const PoissonInterval alarms = all.alarms_per_hour_interval();
      row.emplace_back(quantile(all.frames, 0.5));
      row.emplace_back(quantile(all.ms, 0.5));
      for (const double value : {all.alarms_per_hour(), alarms.low, alarms.high}) row.emplace_back(value);
    }
    row.resize(table.columns.size());
    table.rows.push_back(std::move(row));
  }
  return table;
}

Table single(const Evaluation& e, const ReportFacts& facts) {
  Table table{
      .id = "single",
      .title = "How hard the data is: one quantity, one threshold",
      .note =
          "Best balanced accuracy that a single threshold reaches, chosen on the same rows: an upper bound. Asked for: "
          "at most 75 % for |V| and for the mean displacement; otherwise the data set is too easy.",
      .brief = true,
      .columns = {{"quantity", "quantity", ""},
                  {"balanced", "balanced accuracy, %", facts.source},
                  {"threshold", "threshold, raw", facts.source, 0},
                  {"side", "slip is", facts.source}}};
  std::vector<const SingleScore*> order;
  for (const SingleScore& score : e.single) order.push_back(&score);
  std::stable_sort(order.begin(), order.end(), [](const SingleScore* a, const SingleScore* b) {
    return a->best.balanced_accuracy > b->best.balanced_accuracy;
  });
  for (const SingleScore* score : order) {
    table.rows.push_back({score->name, percent(score->best.balanced_accuracy), score->best.threshold,
                          score->best.slip_above ? "above" : "at or below"});
  }
  return table;
}

Table table_1(const Evaluation& e, const ReportFacts& facts) {
  Table table{
      .id = "table1",
      .title = "Table I: five-fold cross-validation",
      .note =
          "Folds of whole grasps; each figure pooled over the five folds, mean and 95 % interval (Student) over the "
          "seeds of folds and classifiers. An interval says how repeatable a figure is on these grasps, not how far "
          "other grasps would move it. By frame: frames of one grasp on both sides, as a random split of samples has "
          "it: what the paper's figures are to be compared with, and what it flatters. tree: ours; tree_cv: OpenCV's. "
          "Both classes weigh the same in training of trees, forest and SVM.",
      .brief = true,
      .columns = {{"set", "features", ""}, {"classifier", "classifier", ""}}};
  add_scores(table.columns, facts.source + ", by trial, %", true);
  table.columns.push_back({"frame_accuracy", "accuracy", facts.source + ", by frame (leaks), %", 1, true, true});
  table.columns.push_back({"frame_f1", "F1", facts.source + ", by frame (leaks), %", 1, false, true});
  table.columns.push_back(
      {"frame_balanced", "balanced accuracy", facts.source + ", by frame (leaks), %", 1, false, true});
  add_paper(table.columns);
  for (const FiveFoldScore& score : e.five_fold) {
    const Scores& s = score.by_trial;
    Cells row{score.set->name,   name_of(score.kind),
              s.accuracy,        s.precision,
              s.recall,          s.f1,
              s.balanced,        score.by_frame.accuracy,
              score.by_frame.f1, score.by_frame.balanced};
    append(row, paper::five_fold(score.set->name, paper_name(score.kind)));
    table.rows.push_back(std::move(row));
  }
  return table;
}

Table table_2_summary(const Evaluation& e, const ReportFacts& facts) {
  const std::string ours = facts.source + ", %";
  const std::string theirs = "paper (k-NN), %";
  Table table{
      .id = "table2_summary",
      .title = "Table II: leave one object out, in short",
      .note =
          "Trained on all known objects but one, tested on that one; mean over the objects, each with the same weight.",
      .brief = true,
      .columns = {{"set", "features", ""},
                  {"classifier", "classifier", ""},
                  {"mean", "mean accuracy", ours},
                  {"worst", "worst accuracy", ours},
                  {"worst_object", "its object", ours},
                  {"balanced", "balanced, all rows", ours},
                  {"paper_mean", "mean accuracy", theirs},
                  {"paper_worst", "worst accuracy", theirs},
                  {"paper_worst_object", "its object", theirs}}};
  for (const ObjectsScore& score : e.left_out) {
    const ObjectScore& worst = score.worst();
    const PaperObjects paper = paper_objects(score.set->name);
    Cells row{score.set->name,
              name_of(score.kind),
              percent(score.mean_accuracy()),
              percent(worst.frames.accuracy()),
              worst.object,
              percent(all_of(score.objects).balanced_accuracy())};
    if (paper.worst != nullptr) {
      row.insert(row.end(), {paper.mean, paper.worst->scores.accuracy, paper.worst->object});
    }
    row.resize(table.columns.size());
    table.rows.push_back(std::move(row));
  }
  return table;
}

// As the paper prints it: objects side by side, accuracy alone; the rest is in table2.csv.
Table table_2_wide(const Evaluation& e, const ReportFacts& facts) {
  Table table{.id = "table2_accuracy",
              .title = "Table II: accuracy by the object left out, %",
              .note = "Precision, recall and F1 of each are in table2.csv.",
              .columns = {{"set", "features", ""}, {"classifier", "classifier", ""}, {"source", "data", ""}}};
  if (e.left_out.empty()) return table;
  for (const ObjectScore& object : e.left_out.front().objects) {
    table.columns.push_back({object.object, object.object, "object left out"});
  }
  table.columns.push_back({"mean", "mean", ""});
  const FeatureSet* last = nullptr;
  for (const ObjectsScore& score : e.left_out) {
    if (const PaperObjects paper = paper_objects(score.set->name); paper.worst != nullptr && score.set != last) {
      Cells row{score.set->name, "knn", "paper"};
      for (const ObjectScore& object : e.left_out.front().objects) {
        const paper::Scores* scores = paper::left_out(score.set->name, object.object);
        row.emplace_back(scores != nullptr ? std::optional(scores->accuracy) : std::nullopt);
      }
      row.emplace_back(paper.mean);
      table.rows.push_back(std::move(row));
    }
    last = score.set;
    Cells row{score.set->name, name_of(score.kind), facts.source};
    for (const ObjectScore& object : score.objects) row.emplace_back(percent(object.frames.accuracy()));
    row.emplace_back(percent(score.mean_accuracy()));
    table.rows.push_back(std::move(row));
  }
  return table;
}

Table objects_table(std::string id, std::string title, std::string note, const std::vector<ObjectsScore>& scores,
                    const ReportFacts& facts, bool unseen) {
  Table table{.id = std::move(id), .title = std::move(title), .note = std::move(note), .page = unseen, .brief = unseen};
  table.columns = {{"set", "features", ""}, {"classifier", "classifier", ""}, {"object", "object", ""}};
  add_scores(table.columns, facts.source + ", %", false);
  add_paper(table.columns);
  for (const ObjectsScore& score : scores) {
    for (const ObjectScore& object : score.objects) {
      Cells row{score.set->name, name_of(score.kind), object.object};
      append(row, object.frames);
      append(row, unseen ? paper::unseen(object.object) : paper::left_out(score.set->name, object.object));
      table.rows.push_back(std::move(row));
    }
  }
  return table;
}

Table events_table(std::string id, std::string title, std::string note, const std::vector<EventScore>& scores,
                   const ReportFacts& facts, bool all_kinds, int only_raise) {
  const std::string delay = "delay from the true onset (" + facts.source + ")";
  const std::string share = "share of onsets, %";
  const std::string alarm = "false alarms in held contact";
  Table table{.id = std::move(id),
              .title = std::move(title),
              .note = std::move(note),
              .columns = {{"name", "features or model", ""},
                          {"raise_frames", "slips in a row", "", 0},
                          {"kind", "grasps", ""},
                          {"trials", "trials", "", 0, false},
                          {"onsets", "onsets", "", 0},
                          {"median_ms", "median ms", delay, 0},
                          {"p90_ms", "p90 ms", delay, 0},
                          {"p95_ms", "p95 ms", delay, 0, false},
                          {"median_frames", "median frames", delay, 0},
                          {"p90_frames", "p90 frames", delay, 0, false},
                          {"p95_frames", "p95 frames", delay, 0, false},
                          {"within_2", "within 2", share},
                          {"within_5", "within 5", share, 1, false},
                          {"within_10", "within 10", share},
                          {"detected", "ever", share},
                          {"missed", "missed", share},
                          {"before", "alarm up before", share},
                          {"false_alarms", "alarms", alarm, 0, false},
                          {"held_min", "minutes", alarm, 1, false},
                          {"alarms_per_hour", "an hour", alarm},
                          {"alarms_per_hour_low", "95 % from", alarm},
                          {"alarms_per_hour_high", "to", alarm},
                          {"open_alarms", "alarms while not judged", "", 0, false}}};
  for (const EventScore& score : scores) {
    if (only_raise != 0 && score.raise_frames != only_raise) continue;
    for (const EventGroup& group : score.groups) {
      if (!all_kinds && &group != &score.groups.front()) continue;
      const PoissonInterval alarms = group.alarms_per_hour_interval();
      const auto of_onsets = [&](double count) {
        return group.onsets > 0 ? std::optional(100.0 * count / group.onsets) : std::nullopt;
      };
      const auto within = [&](int count) { return group.onsets > 0 ? percent(group.within(count)) : std::nullopt; };
      const auto exposed = [&](double value) { return group.held_s > 0.0 ? std::optional(value) : std::nullopt; };
      table.rows.push_back({score.name,
                            score.raise_frames,
                            group.kind,
                            group.trials,
                            group.onsets,
                            quantile(group.ms, 0.5),
                            quantile(group.ms, 0.9),
                            quantile(group.ms, 0.95),
                            quantile(group.frames, 0.5),
                            quantile(group.frames, 0.9),
                            quantile(group.frames, 0.95),
                            within(2),
                            within(5),
                            within(10),
                            of_onsets(static_cast<double>(group.frames.size())),
                            of_onsets(group.missed),
                            of_onsets(group.before),
                            group.false_alarms,
                            group.held_s / 60.0,
                            exposed(group.alarms_per_hour()),
                            exposed(alarms.low),
                            exposed(alarms.high),
                            group.open_alarms});
    }
  }
  return table;
}

constexpr std::string_view kEventsNote =
    "Onset: first frame in which more than half of the contact's area slips. Delay: from there until the request to "
    "tighten is raised, by the firmware's own decision stage. A request that was up already when the onset came is no "
    "detection and stands in its own column. False alarms: times that it rose in held contact, after a slip too; "
    "interval exact (Poisson).";

Table models_table(const Evaluation& e, const ReportFacts& facts) {
  Table table{.id = "models",
              .title = "Given models, by frame",
              .note = facts.held_out
                          ? "Declared as held out: these rows were not in the models' training."
                          : "A given model may have been trained on these very rows: then its figures are too good. "
                            "Only rows that it has not seen judge it (--held-out says so).",
              .brief = true,
              .columns = {{"model", "model", ""}, {"set", "features", ""}, {"object", "object", ""}}};
  add_scores(table.columns, facts.source + ", %", false);
  for (const ModelScore& model : e.models) {
    const auto add = [&](const std::string& object, const Confusion& frames) {
      Cells row{model.name, model.set->name, object};
      append(row, frames);
      table.rows.push_back(std::move(row));
    };
    add("all", all_of(model.objects));
    for (const ObjectScore& object : model.objects) add(object.object, object.frames);
  }
  return table;
}

Table timing_table(const Evaluation& e) {
  Table table{
      .id = "timing",
      .title = "Time of one prediction",
      .note =
          "Ours: thread CPU time of one row at a time on this machine, median of 10 repetitions of 200 rows, features "
          "of the set " +
          e.timing_set + ". The paper's: scikit-learn in Python, wall time on a Core i5-10210U. Printed, not asserted.",
      .brief = true,
      .columns = {{"classifier", "classifier", ""}, {"us", "us", "this machine", 3}, {"paper_us", "us", "paper", 0}}};
  for (const TimingScore& score : e.timing) {
    const double* ms =
        paper::inference_ms(score.name == name_of(Kind::kTree) ? name_of(Kind::kTreeCv) : std::string_view(score.name));
    table.rows.push_back({score.name, score.us, ms != nullptr ? std::optional(*ms * 1e3) : std::nullopt});
  }
  return table;
}

Table curve_table(const Evaluation& e) {
  Table table{.id = "curve",
              .title = "Alarms against delay over slip_weight",
              .note = "",
              .page = false,
              .columns = {{"set", "features", ""},
                          {"slip_weight", "slip_weight", "", 3},
                          {"alarms_per_hour", "alarms an hour", ""},
                          {"median_delay_ms", "median delay, ms", ""},
                          {"within_10", "within 10 frames, %", ""}}};
  for (const CurvePoint& point : e.curve) {
    table.rows.push_back(
        {point.set->name, point.slip_weight, point.alarms_per_hour, point.median_delay_ms, percent(point.within_10)});
  }
  return table;
}

// --- pictures ---

Chart objects_chart(const Evaluation& e, const ReportFacts& facts) {
  charts::Bars bars;
  bars.title = "Accuracy by object";
  bars.unit = "%";
  const auto add = [&](std::string name, const std::vector<ObjectScore>& objects) {
    charts::Bars::Series series{std::move(name), {}, false};
    for (const std::string& group : bars.groups) {
      const auto at =
          std::find_if(objects.begin(), objects.end(), [&](const ObjectScore& o) { return o.object == group; });
      series.values.push_back(at == objects.end() ? std::nullopt : percent(at->frames.accuracy()));
    }
    bars.series.push_back(std::move(series));
  };
  const FeatureSet* best = nullptr;  // of our tree, with an object left out
  double most = -1.0;
  for (const ObjectsScore& score : e.left_out) {
    if (score.kind != Kind::kTree || score.mean_accuracy() <= most) continue;
    most = score.mean_accuracy();
    best = score.set;
  }
  for (const FiveFoldScore& score : e.five_fold) {
    if (!bars.groups.empty()) break;
    for (const ObjectScore& object : score.objects) bars.groups.push_back(object.object);
  }
  const FeatureSet* four = find_feature_set("paper");
  if (const auto* score = find(e.five_fold, four, Kind::kKnn)) {
    add(fmt::format("k-NN, paper's four, five-fold ({})", facts.source), score->objects);
  }
  if (best != nullptr) {
    if (const auto* score = find(e.five_fold, best, Kind::kTree)) {
      add(fmt::format("tree, {}, five-fold", best->name), score->objects);
    }
    add(fmt::format("tree, {}, object left out", best->name), find(e.left_out, best, Kind::kTree)->objects);
  }
  charts::Bars::Series paper{"paper: k-NN, E and dE/dt, object left out", {}, true};
  for (const std::string& group : bars.groups) {
    const paper::Scores* scores = paper::left_out("entropy", group);
    paper.values.push_back(scores != nullptr ? std::optional(scores->accuracy) : std::nullopt);
  }
  bars.series.push_back(std::move(paper));
  return {"objects",
          "The paper's bar chart (k-NN, five-fold) has no numbers: most objects above 95 %, the owl below 90 %. Drawn "
          "beside it: our tree with the features that suit it best, and the paper's Table II.",
          draw(bars)};
}

Chart delays_chart(const Evaluation& e, const ReportFacts& facts) {
  charts::Histograms chart;
  chart.title = fmt::format("Delay from the true onset to the request ({}, object left out)", facts.source);
  chart.axis = "frames";
  chart.bins = 31;
  for (const EventScore& score : e.events) {
    if (score.raise_frames != kDefaultRaise) continue;
    const EventGroup& all = score.groups.front();
    const auto median = quantile(all.frames, 0.5);
    chart.panels.push_back(
        {score.name,
         fmt::format("{} onsets: {} detected{}, {} missed, {} with the alarm up before", all.onsets, all.frames.size(),
                     median ? fmt::format(" (median {:.0f})", *median) : "", all.missed, all.before),
         all.frames});
  }
  return {"delays", fmt::format("Own tree, {} slips in a row.", kDefaultRaise), draw(chart)};
}

Chart tsne_chart(const Samples& samples, const Evaluation& e, const ReportFacts& facts) {
  charts::Clouds chart;
  chart.title = fmt::format("t-SNE of the features ({})", facts.source);
  chart.first_class = "static";
  chart.second_class = "slip";
  std::size_t count = 0;
  for (const TsnePanel& panel : e.tsne) {
    charts::Clouds::Panel& drawn = chart.panels.emplace_back();
    drawn.name = panel.set->name == "entropy"    ? "E and dE/dt"
                 : panel.set->name == "velocity" ? "Vx and Vy"
                                                 : std::string(panel.set->name);
    for (std::size_t i = 0; i < panel.rows.size(); ++i) {
      const bool slip = samples.rows[static_cast<std::size_t>(panel.rows[i])].label == Label::kSlip;
      drawn.dots.push_back({panel.points[i].x, panel.points[i].y, slip});
    }
    count = panel.rows.size();
  }
  return {"tsne",
          fmt::format(
              "{} rows, static and slip in equal numbers as far as there are any; features scaled to unit variance, "
              "perplexity 30. Nearness is all that it shows; axes and sizes mean nothing.",
              count),
          draw(chart)};
}

Chart curve_chart(const Evaluation& e, const ReportFacts& facts) {
  charts::Curves chart;
  chart.title =
      fmt::format("Alarms against delay: what the weight of a slip row buys ({}, object left out)", facts.source);
  chart.axis = "false alarms per hour of held contact";
  double slowest = 100.0;
  for (const CurvePoint& point : e.curve) slowest = std::max(slowest, point.median_delay_ms.value_or(0.0));
  chart.panels = {{"median delay of the detections, ms", 0, 100.0 * std::ceil(slowest / 100.0)},
                  {"onsets detected within 10 frames, %", 0, 100}};
  for (const CurvePoint& point : e.curve) {
    if (chart.series.empty() || chart.series.back().name != point.set->name) {
      chart.series.push_back({std::string(point.set->name), {{}, {}}});
    }
    auto& panels = chart.series.back().panels;
    if (point.median_delay_ms) panels[0].push_back({point.alarms_per_hour, *point.median_delay_ms});
    panels[1].push_back({point.alarms_per_hour, 100.0 * point.within_10});
  }
  std::string weights;
  for (const CurvePoint& point : e.curve) {
    if (point.set != e.curve.front().set) break;
    weights += fmt::format("{}{:g}", weights.empty() ? "" : ", ", point.slip_weight);
  }
  return {
      "curve",
      fmt::format("Own tree, {} slips in a row; one point for each slip_weight ({}). Down is better on the left, up on "
                  "the right, leftwards on both.",
                  kDefaultRaise, weights),
      draw(chart)};
}

// --- as text ---

std::string number(double value, int decimals) {
  if (!std::isfinite(value)) return "-";
  std::string out = fmt::format("{:.{}f}", value, decimals);
  // No "-0.0".
  return out.find_first_of("123456789") == std::string::npos && out.front() == '-' ? out.substr(1) : out;
}

std::string shown(const Cell& cell, const Column& column, std::string_view none, std::string_view plus_minus) {
  if (!cell.number) return cell.text.empty() ? std::string(none) : cell.text;
  std::string out = number(*cell.number, column.decimals);
  if (cell.half > 0.0) out += fmt::format(" {} {}", plus_minus, number(cell.half, column.decimals));
  return out;
}

// Names of objects, trials and files come from outside.
std::string in_quotes(const std::string& cell) {
  if (cell.find_first_of(",\"\n\r") == std::string::npos) return cell;
  std::string out = "\"";
  for (const char c : cell) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + '"';
}

constexpr std::string_view kStyle = R"(
:root{color-scheme:light}
*{box-sizing:border-box}
body{margin:0;background:#fff;color:#1d2126;font:15px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,Arial,sans-serif;
font-variant-numeric:tabular-nums}
main{max-width:1240px;margin:0 auto;padding:32px 24px 48px}
h1{font-size:26px;line-height:1.2;margin:0 0 12px}
h2{font-size:18px;margin:36px 0 6px}
p{margin:0 0 10px;max-width:92ch}
.note{color:#4a525b;font-size:13.5px}
.warn{border-left:5px solid #d55e00;padding:6px 14px;background:#fff6f0}
.wide{overflow-x:auto}
table{border-collapse:collapse;font-size:13px;margin:8px 0}
th,td{padding:4px 9px;border-top:1px solid #e4e7ea;text-align:left;white-space:nowrap}
thead th{border:0;font-weight:600;vertical-align:bottom;white-space:normal}
thead tr.over th{border-bottom:2px solid #b9c0c7;color:#4a525b;font-weight:500;text-align:center}
thead tr.over th:empty{border-bottom:0}
tr.new td{border-top:1px solid #7b8590}
.dense{font-size:12px}.dense th,.dense td{padding:3px 5px}
.n{text-align:right}
.first{border-left:2px solid #e4e7ea}
figure{margin:14px 0;overflow-x:auto}
svg{max-width:100%;height:auto}
@page{size:landscape}
@media print{main{padding:0;max-width:none}body{font-size:11px}table{font-size:8.5px}th,td{padding:2px 4px}
.wide{overflow:visible}tr,figure{break-inside:avoid}h2{break-after:avoid}}
)";

std::string html_of(const Table& table) {
  std::string out = fmt::format("<h2>{}</h2>\n", tool::escape(table.title));
  if (!table.note.empty()) out += fmt::format("<p class=\"note\">{}</p>\n", tool::escape(table.note));
  out += fmt::format(R"(<div class="wide"><table{}><thead><tr class="over">)",
                     table.columns.size() > 14 ? R"( class="dense")" : "");
  for (std::size_t c = 0; c < table.columns.size();) {
    std::size_t end = c + 1;
    while (end < table.columns.size() && table.columns[end].group == table.columns[c].group) ++end;
    out += fmt::format("<th colspan=\"{}\">{}</th>", end - c, tool::escape(table.columns[c].group));
    c = end;
  }
  out += "</tr><tr>";
  const auto css = [&](std::size_t c, bool is_number) {
    const bool first = c > 0 && table.columns[c].group != table.columns[c - 1].group;
    return first && is_number ? R"( class="n first")" : first ? R"( class="first")" : is_number ? R"( class="n")" : "";
  };
  const auto numeric = [&](std::size_t c) {
    return std::any_of(table.rows.begin(), table.rows.end(),
                       [&](const Cells& row) { return row[c].number.has_value(); });
  };
  for (std::size_t c = 0; c < table.columns.size(); ++c) {
    out += fmt::format("<th{}>{}</th>", css(c, numeric(c)), tool::escape(table.columns[c].title));
  }
  out += "</tr></thead>\n<tbody>\n";
  std::string group;
  for (const Cells& row : table.rows) {
    const bool fresh = row.front().text != group;
    group = row.front().text;
    out += fresh ? R"(<tr class="new">)" : "<tr>";
    for (std::size_t c = 0; c < row.size(); ++c) {
      out += fmt::format("<td{}>{}</td>", css(c, numeric(c)), tool::escape(shown(row[c], table.columns[c], "–", "±")));
    }
    out += "</tr>\n";
  }
  return out + "</tbody></table></div>\n";
}

}  // namespace

std::vector<Table> tables_of(const Evaluation& e, const ReportFacts& facts) {
  std::vector<Table> tables{goals(e, facts), single(e, facts), table_1(e, facts), table_2_summary(e, facts),
                            table_2_wide(e, facts)};
  tables.push_back(objects_table("table2", "Table II in full", "", e.left_out, facts, false));
  if (!e.unseen.empty()) {
    tables.push_back(objects_table("table3", "Table III: unseen objects",
                                   "Trained on the known objects. The paper names neither features nor classifier.",
                                   e.unseen, facts, true));
  }
  if (!e.events.empty()) {
    tables.push_back(events_table("events", "Events in full", "", e.events, facts, true, 0));
    tables.back().page = false;
    tables.push_back(
        events_table("events_all", "Detection and false alarms", std::string(kEventsNote), e.events, facts, false, 0));
    tables.back().brief = true;
    tables.back().brief_id = "raise_frames";
    tables.back().brief_value = std::to_string(kDefaultRaise);
    tables.push_back(events_table("events_by_kind", "Detection and false alarms by kind of grasp",
                                  "Other numbers of slips in a row: events.csv.", e.events, facts, true,
                                  kDefaultRaise));
    tables.push_back(curve_table(e));
  }
  if (!e.models.empty()) {
    tables.push_back(models_table(e, facts));
    tables.back().brief_id = "object";
    tables.back().brief_value = "all";
    tables.push_back(events_table("model_events", "Given models, by event", std::string(kEventsNote), e.model_events,
                                  facts, true, 0));
  }
  if (!e.timing.empty()) tables.push_back(timing_table(e));
  return tables;
}

std::vector<Chart> charts_of(const Samples& samples, const Evaluation& e, const ReportFacts& facts) {
  std::vector<Chart> out;
  if (!e.five_fold.empty()) out.push_back(objects_chart(e, facts));
  if (!e.events.empty()) out.push_back(delays_chart(e, facts));
  if (!e.curve.empty()) out.push_back(curve_chart(e, facts));
  if (!e.tsne.empty()) out.push_back(tsne_chart(samples, e, facts));
  return out;
}

std::string csv(const Table& table) {
  std::string out;
  for (const Column& column : table.columns) {
    out += fmt::format("{}{}", out.empty() ? "" : ",", in_quotes(column.id));
    if (column.interval) out += fmt::format(",{}_ci95", column.id);
  }
  out += '\n';
  for (const Cells& row : table.rows) {
    for (std::size_t c = 0; c < row.size(); ++c) {
      const Column& column = table.columns[c];
      if (c > 0) out += ',';
      // Two digits more than for people: they can still be rounded.
      const auto digits = [&](double value) { return number(value, column.decimals == 0 ? 0 : column.decimals + 2); };
      out += row[c].number ? std::isfinite(*row[c].number) ? digits(*row[c].number) : "" : in_quotes(row[c].text);
      if (column.interval) out += ',' + (row[c].half > 0.0 ? digits(row[c].half) : std::string());
    }
    out += '\n';
  }
  return out;
}

std::string text(const Table& table) {
  std::vector<const Cells*> rows;
  for (const Cells& row : table.rows) {
    const auto at = std::find_if(table.columns.begin(), table.columns.end(),
                                 [&](const Column& column) { return column.id == table.brief_id; });
    const auto c = static_cast<std::size_t>(at - table.columns.begin());
    if (c == row.size() || shown(row[c], *at, "-", "+-") == table.brief_value) rows.push_back(&row);
  }
  std::vector<std::vector<std::string>> lines(rows.size() + 2);
  std::vector<bool> right;
  for (std::size_t c = 0; c < table.columns.size(); ++c) {
    const Column& column = table.columns[c];
    if (!column.brief) continue;
    const bool changes =
        c == 0 || table.columns[c - 1].group != column.group ||
        std::none_of(table.columns.begin(), table.columns.begin() + static_cast<std::ptrdiff_t>(c),
                     [&](const Column& earlier) { return earlier.brief && earlier.group == column.group; });
    lines[0].push_back(changes ? column.group : "");
    lines[1].push_back(column.title);
    bool any = false;
    for (std::size_t r = 0; r < rows.size(); ++r) {
      lines[r + 2].push_back(shown((*rows[r])[c], column, "-", "+-"));
      any = any || (*rows[r])[c].number.has_value();
    }
    right.push_back(any);
  }
  std::string out = table.title + '\n';
  std::vector<std::size_t> widths(right.size());
  for (std::size_t r = 1; r < lines.size(); ++r) {
    for (std::size_t c = 0; c < widths.size(); ++c) widths[c] = std::max(widths[c], lines[r][c].size());
  }
  // A group's name may run over its columns; when it is longer, its last column makes room.
  for (std::size_t c = 0; c < widths.size(); ++c) {
    if (lines[0][c].empty()) continue;
    std::size_t end = c;
    std::size_t room = widths[c];
    while (end + 1 < widths.size() && lines[0][end + 1].empty()) room += 2 + widths[++end];
    if (lines[0][c].size() > room) widths[end] += lines[0][c].size() - room;
  }
  for (std::size_t r = 0; r < lines.size(); ++r) {
    std::string line;
    std::size_t edge = 0;
    for (std::size_t c = 0; c < widths.size(); ++c) {
      const std::string& cell = lines[r][c];
      if (r == 0) {
        if (!cell.empty()) line = fmt::format("{:<{}}{}", line, edge + 2, cell);
      } else {
        line += "  " + (right[c] ? fmt::format("{:>{}}", cell, widths[c]) : fmt::format("{:<{}}", cell, widths[c]));
      }
      edge += widths[c] + 2;
    }
    line.erase(line.find_last_not_of(' ') + 1);
    if (r > 0 || !line.empty()) out += line + '\n';
  }
  return out;
}

std::string html(const ReportFacts& facts, const std::vector<Table>& tables, const std::vector<Chart>& charts) {
  std::string out = fmt::format(
      "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"/><meta name=\"viewport\" "
      "content=\"width=device-width,initial-scale=1\"/><title>Holdfast: evaluation</title><style>{}</style></head>\n"
      "<body><main>\n<h1>Slip detection on {} data, beside the paper</h1>\n",
      kStyle, tool::escape(facts.source));
  for (const std::string& warning : facts.warnings) {
    out += fmt::format("<p class=\"warn\">{}</p>\n", tool::escape(warning));
  }
  out += "<table><tbody>\n";
  for (const auto& [name, value] : facts.facts) {
    out += fmt::format("<tr><th>{}</th><td style=\"white-space:normal\">{}</td></tr>\n", tool::escape(name),
                       tool::escape(value));
  }
  out += "</tbody></table>\n";
  const auto chart = [&](std::string_view id) {
    for (const Chart& c : charts) {
      if (c.id != id) continue;
      out +=
          fmt::format("<figure>{}<figcaption class=\"note\">{}</figcaption></figure>\n", c.svg, tool::escape(c.note));
    }
  };
  for (const Table& table : tables) {
    if (!table.page) continue;
    out += html_of(table);
    if (table.id == "table2_accuracy") chart("objects");
    if (table.id == "events_by_kind") {
      chart("delays");
      chart("curve");
    }
  }
  if (std::any_of(charts.begin(), charts.end(), [](const Chart& c) { return c.id == "tsne"; })) {
    out += "<h2>The features, laid out by nearness</h2>\n";
    chart("tsne");
  }
  return out + "</main></body></html>\n";
}

}  // namespace holdfast::learn
