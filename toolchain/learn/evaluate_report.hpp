// SPDX-License-Identifier: Apache-2.0
// An evaluation as tables: CSV for programs, text for the terminal. Shares are in percent, as the paper prints them.
// Whose figures they are stands over the columns: simulated, recorded, or the paper's.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "toolchain/learn/evaluate.hpp"

namespace holdfast::learn {

struct Column {
  std::string id;     // in CSV; an interval's half goes to id_ci95
  std::string title;  // for people
  std::string group;  // over neighbours of the same group
  int decimals = 1;
  bool brief = true;  // also at the terminal
  bool interval = false;
};

struct Cell {
  std::string text;
  std::optional<double> number;
  double half = 0.0;  // of the interval; 0: none known

  Cell() = default;
  Cell(std::string words) : text(std::move(words)) {}   // NOLINT(google-explicit-constructor): rows read as lists
  Cell(std::string_view words) : text(words) {}         // NOLINT(google-explicit-constructor)
  Cell(const char* words) : text(words) {}              // NOLINT(google-explicit-constructor)
  Cell(double value) : number(value) {}                 // NOLINT(google-explicit-constructor)
  Cell(int value) : number(value) {}                    // NOLINT(google-explicit-constructor)
  Cell(std::optional<double> value) : number(value) {}  // NOLINT(google-explicit-constructor)
  Cell(const Interval& interval)                        // NOLINT(google-explicit-constructor): in percent
      : number(100.0 * interval.mean), half(100.0 * interval.half) {}
};

struct Table {
  std::string id;  // file name without .csv
  std::string title{};
  std::string note{};
  bool brief = false;  // at the terminal, there only the rows whose cell `brief_id` shows `brief_value`
  std::string brief_id{};
  std::string brief_value{};
  std::vector<Column> columns{};
  std::vector<std::vector<Cell>> rows{};
};

struct ReportFacts {
  std::string source;                                      // "simulated", "recorded", or both
  std::vector<std::pair<std::string, std::string>> facts;  // what was judged, in order
  std::vector<std::string> warnings;
};

[[nodiscard]] std::vector<Table> tables_of(const Evaluation& evaluation, const ReportFacts& facts);
[[nodiscard]] std::string csv(const Table& table);
[[nodiscard]] std::string text(const Table& table);  // brief columns
}  // namespace holdfast::learn
