// SPDX-License-Identifier: Apache-2.0
#include "toolchain/sealed/settings_toml.hpp"

#include <fmt/format.h>

#include <toml++/toml.h>
#include <algorithm>
#include <cstddef>
#include <vector>

namespace holdfast::tool {
namespace {

std::string complain(const std::string& path, const toml::source_position& at, const std::string& what,
                     std::string_view cause, std::string_view next) {
  return fmt::format("{}:{}: {}. Likely cause: {}. Next: {}", path, at.line, what, cause, next);
}

// Insertions, deletions and replacements that lead from one word to the other.
std::size_t distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t above = row[j];
      row[j] = std::min({above + 1, row[j - 1] + 1, diagonal + (a[i - 1] == b[j - 1] ? 0 : 1)});
      diagonal = above;
    }
  }
  return row.back();
}

std::string_view nearest(std::string_view name) {
  return std::ranges::min_element(kParams, {}, [name](const ParamInfo& row) { return distance(name, row.name); })->name;
}

std::string range_of(const ParamInfo& row) {
  return fmt::format("{} to {}{}{}", row.min, row.max, row.unit.empty() ? "" : " ", row.unit);
}

// A number, or one of the words that the console takes as well. Empty: neither.
std::string text_of(const toml::node& value) {
  if (const auto number = value.value_exact<std::int64_t>()) return std::to_string(*number);
  const auto word = value.value_exact<std::string>();
  return word && !word->empty() && std::ranges::all_of(*word, [](char c) { return c >= 'a' && c <= 'z'; })
             ? *word
             : std::string();
}

}  // namespace

std::string settings_of_toml(std::string_view text, const std::string& path, Params& params) {
  toml::table table;
  try {
    table = toml::parse(text, path);
  } catch (const toml::parse_error& error) {
    std::string what(error.description());
    for (char& c : what) {
      if (c < ' ' || c > '~') c = ' ';
    }
    return complain(path, error.source().begin, "is no TOML: " + what, "a typing error, or another file",
                    "write one name = value a line");
  }
  Params read;
  for (const auto& [key, value] : table) {
    const auto& at = key.source().begin;
    std::string name(key.str().substr(0, 40));
    for (char& c : name) {
      if (c < ' ' || c > '~') c = '?';
    }
    const ParamInfo* const row = find_param(key.str());
    if (row == nullptr) {
      return complain(path, at, fmt::format("there is no parameter '{}'", name), "a typing error, or another version",
                      fmt::format("the nearest name is {}; holdfast settings list shows all", nearest(name)));
    }
    const std::string given = text_of(value);
    ParamProblem problem;
    if (given.empty() || !parse(row->name, given, read, &problem).ok()) {
      const bool no_number = given.empty() || problem.rule == "not an integer";
      return complain(path, at,
                      no_number ? fmt::format("{} is no whole number", row->name)
                                : fmt::format("{} = {} is outside its range, {}", row->name, given, range_of(*row)),
                      no_number ? "quotes, a decimal point, or a unit behind it" : "another unit, or a typing error",
                      fmt::format("give {} a value of {}", row->name, range_of(*row)));
    }
  }
  if (ParamProblem problem; !validate(read, &problem).ok()) {
    const toml::node* const node = table.get(problem.row->name);
    return complain(path, node != nullptr ? node->source().begin : toml::source_position{1, 1},
                    fmt::format("{} is {}", problem.row->name, problem.rule), "one was changed without the other",
                    "change the other one, too");
  }
  params = read;
  return {};
}

std::string toml_of_settings(const Params& params) {
  std::string text;
  for (const ParamInfo& row : kParams) {
    if (params.*row.member == row.default_value) continue;
    text += fmt::format("{} = {}  # {}; default {}\n", row.name, params.*row.member, range_of(row), row.default_value);
  }
  return text;
}

}  // namespace holdfast::tool
