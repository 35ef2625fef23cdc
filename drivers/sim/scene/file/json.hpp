// SPDX-License-Identifier: Apache-2.0
// JSON text as a tree in which every key and value knows its line, for files that people write.
//
// Strict JSON in UTF-8 within the limits of scene_file.hpp; no NUL, no byte-order mark, no comments. A key that is
// given twice is a problem; the tree has both, the first of them first.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace holdfast::scene::json {

struct Node {
  enum class Kind { kNull, kFlag, kNumber, kText, kObject, kList };
  Kind kind = Kind::kNull;
  int line = 0;
  int key_line = 0;
  std::string key;   // in an object
  std::string text;  // of a text; of a number as it is written
  double number = 0.0;
  std::uint64_t seed = 0;
  bool whole = false;  // seed holds the number
  bool flag = false;
  std::vector<Node> children;
};

// Nothing that a terminal takes for an order: printable ASCII, one line.
inline constexpr std::size_t kMostShown = 60;
[[nodiscard]] std::string printable(std::string_view text, std::size_t most = kMostShown);
[[nodiscard]] std::string shown(const Node& node);
// File names may be of any script: only control characters go.
[[nodiscard]] std::string shown_file(std::string_view name);

// What is wrong with a text, in any order.
class Problems {
 public:
  void add(int line, const std::string& what, std::string_view cause, const std::string& next);
  [[nodiscard]] std::size_t count() const { return all_.size(); }
  // By line, at most kMostSceneErrors.
  [[nodiscard]] std::vector<std::string> lines(std::string_view file) const;

 private:
  struct Problem {
    int line = 0;
    std::string text;
  };
  std::vector<Problem> all_;
};

// None when the text is no JSON. May throw std::bad_alloc.
[[nodiscard]] std::optional<Node> parse(std::string_view text, Problems& problems);

// The node at a dotted path below an object; null if there is none.
[[nodiscard]] const Node* find(const Node& object, std::string_view path);

}  // namespace holdfast::scene::json
