// SPDX-License-Identifier: Apache-2.0
// The one table of a scene file's fields (key, unit, range, default, help, member), and what follows from a
// row alone: reading, refusing, writing and documenting it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "drivers/sim/scene/file/json.hpp"
#include "drivers/sim/scene/scene.hpp"

namespace holdfast::scene::file {

using Names = std::span<const std::string_view>;
// Of a member, or of a key in the units of the member; nothing = not given.
using Value =
    std::variant<std::monostate, double, std::int64_t, std::uint64_t, bool, std::string, std::array<double, 2>>;

enum class Type { kNumber, kWhole, kSeed, kFlag, kName, kText, kChoice, kTwoNumbers, kList };
inline constexpr std::array<std::string_view, 9> kTypeNames{
    "number", "whole number", "whole number", "true or false", "name", "text", "choice", "two numbers", "list"};

// Of a record: the scene, or an entry of one of its lists.
struct Field {
  struct More {
    double per_member = 1.0;  // units of the file in one unit of the member
    bool required = false;
    bool picture = false;                                    // only a picture shows it
    std::string_view (*idle)(const void* record) = nullptr;  // what has no use for it in this record; empty = used
  };

  std::string_view path;  // from the record on
  Type type = Type::kList;
  Names names;  // of a choice
  Value (*get)(const void* record) = nullptr;
  void (*set)(void* record, const Value& value) = nullptr;
  std::string_view unit;
  double least = 0.0;
  double most = 0.0;
  std::string_view help;
  More more{};
};

// All records of one kind, below the path of their list; the scene itself is the only one at "".
struct Records {
  std::string_view path;
  std::span<const Field> fields;
  const void* standard = nullptr;  // with every default
  std::size_t (*size)(const Scene&) = nullptr;
  const void* (*entry)(const Scene&, std::size_t) = nullptr;
  void* (*append)(Scene&) = nullptr;
};
// The scene first.
[[nodiscard]] std::span<const Records> all_records();
[[nodiscard]] std::span<const Field> scene_table();

// The range in words.
[[nodiscard]] std::string allowed(const Field& field);
// The value as JSON; empty: not given.
[[nodiscard]] std::string text_of(const Field& field, const void* record);
[[nodiscard]] bool differs(const Field& field, const void* record, const void* standard);

// A tree read by the table, and what checks of several values ask about it.
class Reading {
 public:
  // Everything that a row refuses becomes a problem.
  Reading(const json::Node& root, Scene& scene, json::Problems& problems);

  [[nodiscard]] const json::Node& root() const { return root_; }
  // Of this key, or of the nearest section that is there.
  [[nodiscard]] int line_at(std::string_view path) const;
  [[nodiscard]] bool given(std::string_view path) const { return json::find(root_, path) != nullptr; }
  // No value at or below these paths was refused: what is said about them together would be about other values.
  [[nodiscard]] bool sound(std::initializer_list<std::string_view> paths) const;

 private:
  struct Place {
    std::string prefix;  // as it is shown: "trajectory[3]."
    std::span<const Field> fields;
  };
  void read_record(const json::Node& node, const std::string& at, std::span<const Field> fields, void* record);
  void read_field(const json::Node& node, const std::string& path, const Field& field, void* record);
  void check_keys(const json::Node& node, const Place& place, const std::string& section);
  void check_idle(const json::Node& object, const Place& place, const void* record);
  bool is_list(std::string_view path, const json::Node& node);

  const json::Node& root_;
  json::Problems& problems_;
  std::vector<std::string> bad_;  // paths of refused values
};

// "('path': value)".
[[nodiscard]] std::string pair(std::string_view path, const json::Node& node);

inline constexpr std::string_view kTypo = "a typing error";
// Of earlier versions: read over, with a warning.
inline constexpr std::string_view kGoneKey = "requires";

}  // namespace holdfast::scene::file
