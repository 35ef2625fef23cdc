// SPDX-License-Identifier: Apache-2.0
// One answer in two forms from one description: lines for people, or one line of JSON with the same keys.
//
// Fields first, then lists; a list has columns, a row a cell for each of them, in order. Fields of a part of the device
// are one line with its name before them, or an object of its name.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "base/units.hpp"
#include "console/output.hpp"

namespace holdfast::console {

struct Column {
  std::string_view key;
  std::uint8_t width = 0;  // of the lines for people
};

class Page {
 public:
  explicit Page(Output& out) : out_(out) {}

  void open(bool json);
  void close();
  [[nodiscard]] bool json() const { return json_; }

  void text(std::string_view name, std::string_view value);
  void integer(std::string_view name, std::int64_t value, std::string_view unit = {});
  // value / denominator.
  void decimal(std::string_view name, std::int64_t value, std::int64_t denominator, int decimals);
  // Nothing to say: null.
  void nothing(std::string_view name);
  void yes_no(std::string_view name, bool value);

  void part(std::string_view name);
  void end_part();

  void list(std::string_view name, std::span<const Column> columns);
  void end_list();
  void row();
  void end_row();
  void cell(std::string_view value);
  void cell(std::int64_t value);
  void cell(std::int64_t value, std::int64_t denominator, int decimals);
  // Nothing to say: null.
  void no_cell();

 private:
  void key(std::string_view key);
  void end_field(std::string_view unit);
  void begin_cell();
  void pad(std::size_t size);

  Output& out_;
  bool json_ = false;
  bool first_ = true;  // of the object, array or part that is open
  bool in_part_ = false;
  std::span<const Column> columns_;
  std::size_t cell_ = 0;
};

}  // namespace holdfast::console
