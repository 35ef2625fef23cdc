// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/evaluate_report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string_view>

#include "toolchain/learn/paper_figures.hpp"
#include "toolchain/support/printable.hpp"

namespace holdfast::learn {
namespace {

using Cells = std::vector<Cell>;
double percent(double share) {
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

Confusion all_of(const std::vector<ObjectScore>& objects) {
  Confusion sum;
  for (const ObjectScore& object : objects) sum += object.frames;
  return sum;
}

// --- tables ---

Table table_1(const Evaluation& e, const ReportFacts& facts) {
  Table table{
      .id = "table1",
      .title = "Table I: five-fold cross-validation",
      .note =
          "Folds of whole grasps; each figure pooled over the five folds, mean and 95 % interval (Student) over the "
          "seeds of folds and classifiers. An interval says how repeatable a figure is on these grasps, not how far "
          "other grasps would move it. By frame: frames of one grasp on both sides, as a random split of samples has "
          "it: what the paper's figures are to be compared with, and what it flatters. Both classes weigh the same in "
          "the tree's training.",
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
    append(row, paper::five_fold(score.set->name, name_of(score.kind)));
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

Table objects_table(std::string id, std::string title, const std::vector<ObjectsScore>& scores,
                    const ReportFacts& facts, bool unseen) {
  Table table{.id = std::move(id), .title = std::move(title), .brief = unseen};
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

constexpr std::string_view kEventsNote =
    "Onset: first frame in which more than half of the contact's area slips. Delay: from there until the request to "
    "tighten is raised, by the firmware's own decision stage. A request that was up already when the onset came is no "
    "detection and stands in its own column. False alarms: times that it rose in held contact, after a slip too; "
    "interval exact (Poisson).";

Table events_table(const std::vector<EventScore>& scores, const ReportFacts& facts) {
  const std::string delay = "delay from the true onset (" + facts.source + ")";
  const std::string share = "share of onsets, %";
  const std::string alarm = "false alarms in held contact";
  Table table{.id = "events",
              .title = "Detection and false alarms, object left out",
              .note = std::string(kEventsNote),
              .brief = true,
              .brief_id = "kind",
              .brief_value = "all",
              .columns = {{"name", "features", ""},
                          {"kind", "grasps", ""},
                          {"trials", "trials", "", 0, false},
                          {"onsets", "onsets", "", 0},
                          {"median_ms", "median ms", delay, 0},
                          {"p90_ms", "p90 ms", delay, 0},
                          {"median_frames", "median frames", delay, 0},
                          {"p90_frames", "p90 frames", delay, 0, false},
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
    for (const EventGroup& group : score.groups) {
      const PoissonInterval alarms = group.alarms_per_hour_interval();
      const auto of_onsets = [&](double count) {
        return group.onsets > 0 ? std::optional(100.0 * count / group.onsets) : std::nullopt;
      };
      const auto within = [&](int count) {
        return group.onsets > 0 ? std::optional(percent(group.within(count))) : std::nullopt;
      };
      const auto exposed = [&](double value) { return group.held_s > 0.0 ? std::optional(value) : std::nullopt; };
      table.rows.push_back({score.name,
                            group.kind,
                            group.trials,
                            group.onsets,
                            quantile(group.ms, 0.5),
                            quantile(group.ms, 0.9),
                            quantile(group.frames, 0.5),
                            quantile(group.frames, 0.9),
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

}  // namespace

std::vector<Table> tables_of(const Evaluation& e, const ReportFacts& facts) {
  std::vector<Table> tables{table_1(e, facts), table_2_summary(e, facts)};
  tables.push_back(objects_table("table2", "Table II in full", e.left_out, facts, false));
  if (!e.unseen.empty()) {
    tables.push_back(objects_table(
        "table3", "Table III: unseen objects; the paper names neither features nor classifier", e.unseen, facts, true));
  }
  tables.push_back(events_table(e.events, facts));
  return tables;
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
      lines[r + 2].push_back(tool::printable(shown((*rows[r])[c], column, "-", "+-")));
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
  return table.note.empty() ? out : out + table.note + '\n';
}

}  // namespace holdfast::learn
