// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/scene/file/json.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <nlohmann/json.hpp>
#include <utility>

#include "drivers/sim/scene/file/scene_file.hpp"

namespace holdfast::scene::json {
namespace {

constexpr std::size_t kMostShownReason = 200;

// Reads characters for the library and knows the line of the last one that it read. The library reads one past the end
// of a number: a line break there must not count yet.
struct Place {
  int line = 1;
  bool after_break = false;
};
class CountingIterator {
 public:
  // NOLINTBEGIN(readability-identifier-naming): the names are the standard's
  using iterator_category = std::input_iterator_tag;
  using value_type = char;
  using difference_type = std::ptrdiff_t;
  using pointer = const char*;
  using reference = const char&;
  // NOLINTEND(readability-identifier-naming)

  CountingIterator(const char* at, Place& place) : at_(at), place_(&place) {}
  reference operator*() const { return *at_; }
  CountingIterator& operator++() {
    if (place_->after_break) ++place_->line;
    place_->after_break = *at_ == '\n';
    ++at_;
    return *this;
  }
  CountingIterator operator++(int) {
    CountingIterator before = *this;
    ++*this;
    return before;
  }
  friend bool operator==(const CountingIterator& a, const CountingIterator& b) { return a.at_ == b.at_; }

 private:
  const char* at_;
  Place* place_;
};

// The library's events, to a tree; false stops it.
class TreeBuilder {
 public:
  TreeBuilder(const Place& place, Problems& problems) : place_(place), problems_(problems) {}

  [[nodiscard]] const Node& root() const { return root_; }

  bool null() { return put({}); }
  bool boolean(bool flag) {
    Node node;
    node.kind = Node::Kind::kFlag;
    node.flag = flag;
    return put(std::move(node));
  }
  bool number_integer(std::int64_t number) { return put_number(static_cast<double>(number), std::to_string(number)); }
  bool number_unsigned(std::uint64_t number) {
    Node node;
    node.kind = Node::Kind::kNumber;
    node.number = static_cast<double>(number);
    node.seed = number;
    node.whole = true;
    node.text = std::to_string(number);
    return put(std::move(node));
  }
  bool number_float(double number, const std::string& written) { return put_number(number, written); }
  bool string(std::string& text) {
    Node node;
    node.kind = Node::Kind::kText;
    node.text = std::move(text);
    return put(std::move(node));
  }
  bool binary(nlohmann::json::binary_t& /*bytes*/) { return false; }  // JSON has none
  bool start_object(std::size_t /*size*/) { return open(Node::Kind::kObject); }
  bool start_array(std::size_t /*size*/) { return open(Node::Kind::kList); }
  bool end_object() { return close(); }
  bool end_array() { return close(); }

  bool key(std::string& name) {
    const auto& siblings = open_.back()->children;
    if (siblings.size() == kMostSceneKeys) {
      problems_.add(place_.line, "too many keys in one object, allowed " + std::to_string(kMostSceneKeys),
                    "not a scene file", "give a scene file (tests/scenes)");
      return false;
    }
    const auto first = std::ranges::find(siblings, name, &Node::key);
    if (first != siblings.end()) {
      problems_.add(
          place_.line,
          "key given twice ('" + printable(name) + "', first in line " + std::to_string(first->key_line) + ")",
          "an edit that left the old line", "remove one of the two");
    }
    key_ = std::move(name);
    key_line_ = place_.line;
    return true;
  }

  bool parse_error(std::size_t /*position*/, const std::string& /*token*/, const nlohmann::json::exception& error) {
    // "[json.exception.parse_error.101] parse error at line 1, column 2: syntax error while ...": our own place is
    // told.
    std::string_view reason = error.what();
    const auto drop_through = [&](std::string_view mark) {
      if (const auto found = reason.find(mark); found != std::string_view::npos) {
        reason.remove_prefix(found + mark.size());
      }
    };
    drop_through("] ");
    if (reason.starts_with("parse error at")) drop_through(": ");
    if (reason.starts_with("syntax error ")) drop_through("syntax error ");
    problems_.add(place_.line, "not JSON (" + printable(reason, kMostShownReason) + ")",
                  "a comma, quote or bracket too many or too few, a comment, or a number that no double holds",
                  "correct the text at this line or just before it");
    return false;
  }

 private:
  bool put_number(double number, std::string written) {
    Node node;
    node.kind = Node::Kind::kNumber;
    node.number = number;
    node.text = std::move(written);
    constexpr double kMostWhole = 9007199254740992.0;  // 2^53: beyond it doubles skip whole numbers
    node.whole = number >= 0.0 && number <= kMostWhole && number == std::trunc(number);
    if (node.whole) node.seed = static_cast<std::uint64_t>(number);
    return put(std::move(node));
  }

  bool put(Node node) { return place_node(std::move(node)) != nullptr; }

  bool open(Node::Kind kind) {
    if (open_.size() == kMostSceneDepth) {
      problems_.add(place_.line, "nested too deep, allowed " + std::to_string(kMostSceneDepth) + " levels",
                    "not a scene file", "give a scene file (tests/scenes)");
      return false;
    }
    Node node;
    node.kind = kind;
    Node* const placed = place_node(std::move(node));
    if (placed != nullptr) open_.push_back(placed);
    return placed != nullptr;
  }

  bool close() {
    open_.pop_back();
    return true;
  }

  // Addresses of open nodes hold: their siblings come only after they closed.
  Node* place_node(Node node) {
    node.line = place_.line;
    node.key = std::exchange(key_, {});
    node.key_line = std::exchange(key_line_, 0);
    if (open_.empty()) {
      root_ = std::move(node);
      return &root_;
    }
    Node& parent = *open_.back();
    if (parent.kind == Node::Kind::kList && parent.children.size() == kMostSceneItems) {
      problems_.add(place_.line, "list too long, allowed " + std::to_string(kMostSceneItems) + " entries",
                    "a recording instead of a script", "thin it out: values between waypoints are interpolated");
      return nullptr;
    }
    parent.children.push_back(std::move(node));
    return &parent.children.back();
  }

  const Place& place_;
  Problems& problems_;
  Node root_;
  std::vector<Node*> open_;
  std::string key_;
  int key_line_ = 0;
};

int line_of(std::string_view text, std::size_t position) {
  return 1 + static_cast<int>(std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(position), '\n'));
}

}  // namespace

std::string printable(std::string_view text, std::size_t most) {
  std::string out(text.substr(0, most));
  for (char& c : out) c = c >= ' ' && c <= '~' ? c : '?';
  return text.size() > most ? out + "..." : out;
}

std::string shown_file(std::string_view name) {
  std::string out(name);
  for (char& c : out) {
    if (static_cast<unsigned char>(c) < ' ' || c == '\x7F') c = '?';
  }
  return out;
}

std::string shown(const Node& node) {
  switch (node.kind) {
    case Node::Kind::kNull:
      return "null";
    case Node::Kind::kFlag:
      return node.flag ? "true" : "false";
    case Node::Kind::kNumber:
      return printable(node.text);
    case Node::Kind::kText:
      return "\"" + printable(node.text) + "\"";
    case Node::Kind::kObject:
      return "{...}";
    case Node::Kind::kList:
      return "[...]";
  }
  return "";
}

void Problems::add(int line, const std::string& what, std::string_view cause, const std::string& next) {
  all_.push_back({line, what + ". Likely cause: " + std::string(cause) + ". Next: " + next});
}

std::vector<std::string> Problems::lines(std::string_view file) const {
  std::vector<Problem> sorted = all_;
  std::ranges::stable_sort(sorted, {}, &Problem::line);
  if (sorted.size() > kMostSceneErrors) sorted.resize(kMostSceneErrors);
  std::vector<std::string> out;
  out.reserve(sorted.size());
  for (const Problem& problem : sorted) {
    out.push_back(shown_file(file) + ":" + std::to_string(problem.line) + ": " + problem.text);
  }
  return out;
}

std::optional<Node> parse(std::string_view text, Problems& problems) {
  if (text.size() > kMostSceneBytes) {
    problems.add(1, "too long (" + std::to_string(text.size()) + " bytes), allowed " + std::to_string(kMostSceneBytes),
                 "not a scene file", "give a scene file (tests/scenes)");
    return std::nullopt;
  }
  // The library takes a byte-order mark, and a NUL as the end of the text.
  if (text.starts_with("\xEF\xBB\xBF")) {
    problems.add(1, "begins with a byte-order mark", "an editor that adds one", "save as UTF-8 without it");
    return std::nullopt;
  }
  if (const auto nul = text.find('\0'); nul != std::string_view::npos) {
    problems.add(line_of(text, nul), "a NUL byte", "another encoding than UTF-8, or a damaged file", "save as UTF-8");
    return std::nullopt;
  }
  Place place;
  TreeBuilder builder(place, problems);
  const bool read = nlohmann::json::sax_parse(CountingIterator(text.data(), place),
                                              CountingIterator(text.data() + text.size(), place), &builder,
                                              nlohmann::json::input_format_t::json, true, false);
  if (!read) return std::nullopt;
  return builder.root();
}

const Node* find(const Node& object, std::string_view path) {
  const auto dot = path.find('.');
  const auto found = std::ranges::find(object.children, path.substr(0, dot), &Node::key);
  if (object.kind != Node::Kind::kObject || found == object.children.end()) return nullptr;
  return dot == std::string_view::npos ? &*found : find(*found, path.substr(dot + 1));
}

}  // namespace holdfast::scene::json
