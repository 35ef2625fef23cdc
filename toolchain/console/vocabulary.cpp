// SPDX-License-Identifier: Apache-2.0
#include "toolchain/console/vocabulary.hpp"

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>

namespace holdfast::console_tool {
namespace {

bool is_word(char c) {
  return (c >= 'a' && c <= 'z') || c == '_' || c == '-';
}

nlohmann::json rows_of(Device& device, const char* question, const char* key) {
  const Answer answer = device.say(question);
  if (!answer.ok() || answer.lines.empty()) return nlohmann::json::array();
  auto json = nlohmann::json::parse(answer.lines.back(), nullptr, false);
  return json.is_object() ? json.value(key, nlohmann::json::array()) : nlohmann::json::array();
}

std::string text_of(const nlohmann::json& row, const char* key) {
  return row.is_object() && row.contains(key) && row[key].is_string() ? row[key].get<std::string>() : std::string{};
}

// Names of files that begin so; folders end in a slash.
void add_files(std::string_view typed, std::set<std::string>& out) {
  namespace fs = std::filesystem;
  const std::size_t slash = typed.rfind('/');
  const std::string folder(slash == std::string_view::npos ? "" : typed.substr(0, slash + 1));
  std::error_code error;
  for (fs::directory_iterator at(folder.empty() ? "." : folder, error), end; !error && at != end; at.increment(error)) {
    std::string name = folder + at->path().filename().string();
    if (!name.starts_with(typed) || name.find(' ') != std::string::npos) continue;
    std::error_code ignored;
    out.insert(at->is_directory(ignored) ? name + "/" : name);
  }
}

}  // namespace

const std::array<Word, 5>& local_words() {
  static const std::array<Word, 5> words{{
      {"backup", "FILE", "write the device's parameters into a file"},
      {"restore", "FILE", "set and store what backup wrote; all or nothing"},
      {"record", "FILE", "stream telemetry into a .csv or .mcap until Ctrl-C"},
      {"quit", "", "leave; so does Ctrl-D"},
  }};
  return words;
}

Vocabulary learn_vocabulary(Device& device) {
  Vocabulary out;
  for (const auto& row : rows_of(device, "help json", "commands")) {
    out.commands.push_back({text_of(row, "name"), text_of(row, "arguments"), text_of(row, "help")});
  }
  for (const auto& row : rows_of(device, "get json", "parameters")) out.parameters.push_back(text_of(row, "name"));
  return out;
}

Completion complete(const Vocabulary& vocabulary, std::string_view before) {
  std::vector<std::string_view> words;
  std::string_view typed;
  for (std::string_view rest = before;;) {
    const std::size_t end = rest.find_first_of(" \t=");
    const std::string_view word = rest.substr(0, end);
    if (end == std::string_view::npos) {
      typed = word;
      break;
    }
    if (!word.empty()) words.push_back(word);
    rest.remove_prefix(end + 1);
  }

  std::set<std::string> fits;
  const auto offer = [&](std::string_view word) {
    if (word.starts_with(typed)) fits.emplace(word);
  };
  if (words.empty()) {
    for (const Word& command : vocabulary.commands) offer(command.name);
    for (const Word& word : local_words()) offer(word.name);
  } else {
    const Word* known = nullptr;
    for (const Word& word : local_words()) known = word.name == words[0] ? &word : known;
    for (const Word& command : vocabulary.commands) known = command.name == words[0] ? &command : known;
    const std::string_view arguments = known == nullptr ? std::string_view{} : known->arguments;
    for (std::size_t at = 0; at < arguments.size();) {
      std::size_t size = 0;
      while (at + size < arguments.size() && is_word(arguments[at + size])) ++size;
      if (size > 0) offer(arguments.substr(at, size));
      at += size + 1;
    }
    if (words.size() == 1 && arguments.find("PARAMETER") != std::string_view::npos) {
      for (const std::string& name : vocabulary.parameters) offer(name);
    }
    if (words.size() == 1 && arguments.find("COMMAND") != std::string_view::npos) {
      for (const Word& command : vocabulary.commands) offer(command.name);
    }
    if (words.size() == 1 && arguments.find("FILE") != std::string_view::npos) add_files(typed, fits);
  }

  Completion out;
  if (fits.empty()) return out;
  std::string common = *fits.begin();
  for (const std::string& one : fits) {
    const auto stop = std::mismatch(common.begin(), common.end(), one.begin(), one.end()).first;
    common.erase(stop, common.end());
  }
  out.insert = common.substr(typed.size());
  if (fits.size() == 1 && !common.ends_with('/')) out.insert += ' ';
  if (out.insert.empty()) out.choices.assign(fits.begin(), fits.end());
  return out;
}

}  // namespace holdfast::console_tool
