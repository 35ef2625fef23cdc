// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "drivers/sim/scene/file/schema.hpp"
#include "drivers/sim/scene/file/words.hpp"

namespace holdfast::scene::file {
namespace {

using json::find;
using json::Node;
using json::printable;

// The words that may stand after `section` in a path.
Words words_below(std::string_view section, std::span<const Field> fields) {
  Words words;
  for (const Field& field : fields) {
    if (!field.path.starts_with(section)) continue;
    const std::string_view rest = field.path.substr(section.size());
    const std::string_view word = rest.substr(0, rest.find('.'));
    if (words.empty() || words.back() != word) words.push_back(word);
  }
  return words;
}

const Field* find_field(std::span<const Field> fields, std::string_view path) {
  const auto found = std::ranges::find(fields, path, &Field::path);
  return found == fields.end() ? nullptr : &*found;
}

}  // namespace

std::string pair(std::string_view path, const Node& node) {
  return "('" + std::string(path) + "': " + json::shown(node) + ")";
}

Reading::Reading(const Node& root, Scene& scene, json::Problems& problems) : root_(root), problems_(problems) {
  read_record(root, "", scene_table(), &scene);
  if (root.kind != Node::Kind::kObject) return;
  for (const Records& list : all_records().subspan(1)) {
    const Node* node = find(root, list.path);
    if (node == nullptr || !is_list(list.path, *node)) continue;
    int i = 0;
    for (const Node& entry : node->children) {
      read_record(entry, std::string(list.path) + "[" + std::to_string(i++) + "]", list.fields, list.append(scene));
    }
  }
}

int Reading::line_at(std::string_view path) const {
  for (;;) {
    if (const Node* node = find(root_, path)) return node->line;
    const auto dot = path.rfind('.');
    if (dot == std::string_view::npos) return root_.line;
    path = path.substr(0, dot);
  }
}

bool Reading::sound(std::initializer_list<std::string_view> paths) const {
  return std::ranges::none_of(bad_, [&](std::string_view bad) {
    return std::ranges::any_of(paths, [&](std::string_view path) { return bad.starts_with(path); });
  });
}

bool Reading::is_list(std::string_view path, const Node& node) {
  if (node.kind == Node::Kind::kList) return true;
  problems_.add(node.line, "wrong kind of value " + pair(path, node) + ", allowed a list [...]",
                "brackets of another kind, or none", "put the entries between [ and ]");
  return false;
}

void Reading::read_record(const Node& node, const std::string& at, std::span<const Field> fields, void* record) {
  if (node.kind != Node::Kind::kObject) {
    problems_.add(node.line,
                  "wrong kind of value (" + (at.empty() ? "" : "'" + at + "': ") + json::shown(node) +
                      "), allowed an object {...}",
                  "brackets of another kind, or none", "put the keys between { and }");
    return;
  }
  const Place place{at.empty() ? "" : at + ".", fields};
  check_keys(node, place, "");
  for (const Field& field : fields) {
    const Node* value = find(node, field.path);
    const std::string path = place.prefix + std::string(field.path);
    if (value != nullptr) {
      if (field.type != Type::kList) read_field(*value, path, field, record);
    } else if (field.more.required) {
      problems_.add(node.line, "no '" + path + "', required: " + allowed(field), "it was forgotten, or is misspelt",
                    "add \"" + std::string(field.path) + "\"");
    }
  }
  check_idle(node, place, record);
}

// Keys that are no field, and sections that are no object.
void Reading::check_keys(const Node& node, const Place& place, const std::string& section) {
  const Words words = words_below(section, place.fields);
  for (const Node& child : node.children) {
    const std::string path = section + child.key;
    const std::string shown_path = place.prefix + section + printable(child.key);
    const bool known = std::ranges::find(words, child.key) != words.end();
    if (shown_path == kGoneKey) continue;
    if (known && find_field(place.fields, path) != nullptr) continue;
    if (known && child.kind == Node::Kind::kObject) {
      check_keys(child, place, path + ".");
      continue;
    }
    if (known) {
      problems_.add(child.line, "wrong kind of value " + pair(shown_path, child) + ", allowed an object {...}",
                    "a value in the place of a section",
                    "give the keys of this section: " + joined(words_below(path + ".", place.fields)));
      continue;
    }
    const std::string what = "unknown key " + pair(shown_path, child);
    const std::string near(nearest(child.key, words));
    const auto elsewhere =
        std::ranges::find_if(place.fields, [&](const Field& field) { return field.path.ends_with("." + child.key); });
    if (elsewhere != place.fields.end()) {
      const std::string home(elsewhere->path.substr(0, elsewhere->path.rfind('.')));
      problems_.add(child.key_line, what, "it belongs into another section", "move it into '" + home + "'");
    } else if (!near.empty()) {
      problems_.add(child.key_line, std::string(what).append(", nearest is '").append(near).append("'"), kTypo,
                    "write '" + near + "', or leave the key out");
    } else {
      problems_.add(child.key_line, what + ", allowed here: " + joined(words), "a key of another version or tool",
                    "leave it out");
    }
  }
}

void Reading::read_field(const Node& node, const std::string& path, const Field& field, void* record) {
  const std::string may = ", allowed " + allowed(field);
  const Node* told = &node;
  const auto refuse = [&](std::string_view what, std::string_view cause, const std::string& next,
                          const std::string& more) {
    problems_.add(node.line, std::string(what) + " " + pair(path, *told) + more, cause, next);
    bad_.push_back(path);
  };
  const auto wrong_kind = [&] {
    refuse("wrong kind of value", "quotes too many or too few, or another key was meant", "give a value of that kind",
           may);
  };
  const auto in_range = [&](const Node& number) {
    if (number.number >= field.least && number.number <= field.most) return true;
    told = &number;
    if (field.least == field.most) {
      refuse("unknown version", "a scene for another build",
             "take a build that knows it, or write the scene anew (tests/scenes/README.md)",
             ", allowed " + shown(field.most));
    } else {
      refuse("out of range", "another unit, or a typing error", "give a value in that range", may);
    }
    return false;
  };
  switch (field.type) {
    case Type::kNumber:
      if (node.kind != Node::Kind::kNumber) return wrong_kind();
      if (in_range(node)) field.set(record, node.number / field.more.per_member);
      return;
    case Type::kWhole:
    case Type::kSeed:
      if (node.kind != Node::Kind::kNumber) return wrong_kind();
      if (node.number != std::trunc(node.number)) return refuse("not a whole number", kTypo, "round it", may);
      if (!in_range(node)) return;
      // Beyond 2^53 but written as a fraction, or 2^64 itself.
      if (!node.whole) return refuse("out of range", kTypo, "give a value in that range", may);
      if (field.type == Type::kSeed) return field.set(record, node.seed);
      return field.set(record, static_cast<std::int64_t>(node.seed));
    case Type::kFlag:
      if (node.kind != Node::Kind::kFlag) return wrong_kind();
      return field.set(record, node.flag);
    case Type::kName:
    case Type::kText: {
      if (node.kind != Node::Kind::kText) return wrong_kind();
      const bool name = field.type == Type::kName;
      const auto fits = [&](char c) {
        const bool word = (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_';
        return name ? word : c >= ' ' && c <= '~';
      };
      const auto size = static_cast<double>(node.text.size());
      if (size >= field.least && size <= field.most && std::ranges::all_of(node.text, fits)) {
        return field.set(record, node.text);
      }
      return refuse("cannot be used", name ? "capitals, blanks or signs" : "too long, or not plain ASCII",
                    "write it in that form", may);
    }
    case Type::kChoice: {
      if (node.kind != Node::Kind::kText) return wrong_kind();
      const auto found = std::ranges::find(field.names, node.text);
      if (found != field.names.end()) return field.set(record, std::int64_t{found - field.names.begin()});
      const std::string near(nearest(node.text, {field.names.begin(), field.names.end()}));
      return refuse("unknown value", kTypo, near.empty() ? "choose one of them" : "write \"" + near + "\"",
                    may + (near.empty() ? "" : "; nearest is \"" + near + "\""));
    }
    case Type::kTwoNumbers: {
      const auto is_number = [](const Node& child) { return child.kind == Node::Kind::kNumber; };
      const auto& both = node.children;
      if (node.kind != Node::Kind::kList || both.size() != 2 || !std::ranges::all_of(both, is_number)) {
        return wrong_kind();
      }
      if (in_range(both[0]) && in_range(both[1])) field.set(record, std::array{both[0].number, both[1].number});
      return;
    }
    case Type::kList:
      return;
  }
}

// Keys that mean nothing beside the others.
void Reading::check_idle(const Node& object, const Place& place, const void* record) {
  for (const Field& field : place.fields) {
    const Node* node = field.more.idle != nullptr ? find(object, field.path) : nullptr;
    const std::string whose(node != nullptr ? field.more.idle(record) : "");
    if (whose.empty()) continue;
    if (!sound({place.prefix + std::string(field.path.substr(0, field.path.find('.'))), "object.mass_g"})) continue;
    const std::string_view section = field.path.substr(0, field.path.rfind('.') + 1);
    Words used;
    for (const Field& other : place.fields) {
      const bool sibling =
          other.path.starts_with(section) && other.path.find('.', section.size()) == std::string_view::npos;
      if (sibling && other.more.idle != nullptr && other.more.idle(record).empty()) {
        used.push_back(other.path.substr(section.size()));
      }
    }
    const bool of_shape = field.path.starts_with("object.") && !used.empty();
    problems_.add(node->key_line,
                  "not used by " + whose + " " + pair(place.prefix + std::string(field.path), *node) +
                      (of_shape ? "; keys of " + whose + ": " + joined(used) : ""),
                  "it is left from another scene", "leave it out");
  }
}

}  // namespace holdfast::scene::file
