// SPDX-License-Identifier: Apache-2.0
#include "console/page.hpp"

namespace holdfast::console {
namespace {

constexpr std::size_t kKeyWidth = 22;
constexpr std::string_view kBlanks = "                                ";

}  // namespace

void Page::open(bool json) {
  json_ = json;
  first_ = true;
  in_part_ = false;
  columns_ = {};
  cell_ = 0;
  if (json_) out_.put("{");
}

void Page::close() {
  if (json_) out_.put("}\r\n");
}

void Page::key(std::string_view key) {
  if (json_) {
    out_.put(first_ ? "\"" : ",\"");
    out_.put(key);
    out_.put("\":");
  } else if (in_part_) {
    out_.put(first_ ? "" : ", ");
    out_.put(key);
    out_.put(" ");
  } else {
    out_.put(key);
    pad(key.size() < kKeyWidth ? kKeyWidth - key.size() : 1);
  }
  first_ = false;
}

void Page::end_field(std::string_view unit) {
  if (json_) return;
  if (!unit.empty()) out_.put(" ");
  out_.put(unit);
  if (!in_part_) out_.put("\r\n");
}

void Page::pad(std::size_t size) {
  if (!json_) out_.put(kBlanks.substr(0, size < kBlanks.size() ? size : kBlanks.size()));
}

void Page::text(std::string_view name, std::string_view value) {
  key(name);
  if (json_) {
    out_.put("\"");
    out_.escaped(value);
    out_.put("\"");
  } else {
    out_.put(value);
  }
  end_field({});
}

void Page::integer(std::string_view name, std::int64_t value, std::string_view unit) {
  key(name);
  out_.integer(value);
  end_field(unit);
}

void Page::decimal(std::string_view name, std::int64_t value, std::int64_t denominator, int decimals) {
  key(name);
  out_.decimal(value, denominator, decimals);
  end_field({});
}

void Page::yes_no(std::string_view name, bool value) {
  key(name);
  if (json_) {
    out_.put(value ? "true" : "false");
  } else {
    out_.put(value ? "yes" : "no");
  }
  end_field({});
}

void Page::nothing(std::string_view name) {
  key(name);
  out_.put(json_ ? "null" : "-");
  end_field({});
}

void Page::part(std::string_view name) {
  key(name);
  if (json_) out_.put("{");
  first_ = true;
  in_part_ = true;
}

void Page::end_part() {
  in_part_ = false;
  first_ = false;
  out_.put(json_ ? "}" : "\r\n");
}

void Page::list(std::string_view name, std::span<const Column> columns) {
  columns_ = columns;
  if (json_) {
    key(name);
    out_.put("[");
    first_ = true;
    return;
  }
  for (std::size_t k = 0; k < columns.size(); ++k) {
    const std::size_t begin = out_.column();
    out_.put(columns[k].key);
    const std::size_t used = out_.column() - begin;
    if (k + 1 < columns.size()) pad(used < columns[k].width ? columns[k].width - used : 1);
  }
  out_.put("\r\n");
}

void Page::end_list() {
  if (json_) out_.put("]");
  first_ = false;
  columns_ = {};
}

void Page::row() {
  cell_ = 0;
  if (!json_) return;
  out_.put(first_ ? "{" : ",{");
  first_ = false;
}

void Page::end_row() {
  out_.put(json_ ? "}" : "\r\n");
}

// The cells before it are padded only now: nothing trails behind the last one.
void Page::begin_cell() {
  if (json_) {
    out_.put(cell_ == 0 ? "\"" : ",\"");
    out_.put(columns_[cell_].key);
    out_.put("\":");
  } else if (cell_ > 0) {
    std::size_t begin = 0;
    for (std::size_t k = 0; k < cell_; ++k) begin += columns_[k].width;
    const std::size_t at = out_.column();
    pad(at < begin ? begin - at : 1);
  }
  ++cell_;
}

void Page::cell(std::string_view value) {
  begin_cell();
  if (json_) out_.put("\"");
  if (json_) {
    out_.escaped(value);
  } else {
    out_.put(value);
  }
  if (json_) out_.put("\"");
}

void Page::cell(std::int64_t value) {
  begin_cell();
  out_.integer(value);
}

void Page::cell(std::int64_t value, std::int64_t denominator, int decimals) {
  begin_cell();
  out_.decimal(value, denominator, decimals);
}

void Page::no_cell() {
  begin_cell();
  out_.put(json_ ? "null" : "-");
}

}  // namespace holdfast::console
