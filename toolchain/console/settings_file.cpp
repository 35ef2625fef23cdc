// SPDX-License-Identifier: Apache-2.0
#include "toolchain/console/settings_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "base/crc32.hpp"
#include "toolchain/support/atomic_file.hpp"
#include "toolchain/support/trouble.hpp"

namespace holdfast::console_tool {
namespace {

constexpr std::string_view kFirst = "# holdfast backup";
constexpr std::string_view kLast = "# end of backup, crc32 ";
constexpr std::size_t kMostBytes = 1U << 20U;
constexpr std::size_t kMostNamed = 5;  // of what does not fit

std::uint32_t sum_of(std::string_view text) {
  return crc32({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

std::vector<std::string_view> words_of(std::string_view line) {
  std::vector<std::string_view> words;
  while (true) {
    const std::size_t begin = line.find_first_not_of(" \t=");
    if (begin == std::string_view::npos) return words;
    line.remove_prefix(begin);
    const std::size_t size = std::min(line.find_first_of(" \t="), line.size());
    words.push_back(line.substr(0, size));
    line.remove_prefix(size);
  }
}

// A line of a file that may be anybody's, as it may be shown.
std::string shown(std::string_view text) {
  std::string out(text.substr(0, 40));
  for (char& c : out) {
    if (c < ' ' || c > '~') c = '?';
  }
  return out;
}

// Of a backup of ours: empty, or why it is not whole.
std::string check_whole(std::string_view text) {
  if (!text.starts_with(kFirst)) return {};
  const std::size_t last = text.rfind(kLast);
  std::uint32_t sum = 0;
  const bool ended =
      last != std::string_view::npos && text[last - 1] == '\n' &&
      std::from_chars(text.data() + last + kLast.size(), text.data() + text.size(), sum, 16).ec == std::errc{};
  if (!ended) return trouble("breaks off", "it was not copied to its end", "give a whole one");
  if (sum_of(text.substr(0, last)) != sum) {
    return trouble("is not what was written: its sum is another", "damaged on the way, or edited",
                   "give a good copy; if you edited it, take its first and last line out");
  }
  return {};
}

struct Changed {
  std::string name;
  std::int64_t before = 0, after = 0;
  std::string applies;
};

enum class Way : std::uint8_t { kForth, kBack };

// Some settings contradict each other until both are set, so that one that is refused for that has another turn after
// the others. What was set is moved to `done`. The answer: of the last one that was refused, or OK.
Answer set_all(Device& device, std::vector<Changed> todo, Way way, std::vector<Changed>& done) {
  constexpr int kContradiction = 23;
  Answer answer;
  answer.kind = Answer::Kind::kOk;
  while (!todo.empty()) {
    std::vector<Changed> again;
    for (const Changed& one : todo) {
      answer = device.say(fmt::format("set {} {}", one.name, way == Way::kForth ? one.after : one.before));
      if (answer.ok()) {
        done.push_back(one);
      } else if (answer.number() == kContradiction) {
        again.push_back(one);
      } else {
        return answer;
      }
    }
    if (again.size() == todo.size())
      return device.say(fmt::format("set {} {}", again.front().name,
                                    way == Way::kForth ? again.front().after : again.front().before));
    todo = std::move(again);
  }
  answer.kind = Answer::Kind::kOk;
  return answer;
}

std::string read_text(const std::string& path, std::string& text) {
  std::ifstream in(path, std::ios::binary);
  text.resize(kMostBytes);
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(std::max<std::streamsize>(in.gcount(), 0)));
  if (!in.bad() && in.eof()) return {};
  return trouble(path + (in.eof() || text.empty() ? ": cannot be read" : ": is larger than any backup"),
                 "no such file, no right to read it, or another one was meant",
                 "give what holdfast console --backup wrote");
}

}  // namespace

SettingsText parse_settings(std::string_view text) {
  SettingsText out;
  if (out.error = check_whole(text); !out.error.empty()) return out;
  std::set<std::string_view> names;
  std::size_t number = 0;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    ++number;
    if (line.ends_with('\r')) line.remove_suffix(1);
    if (says_nothing(line)) continue;
    const std::vector<std::string_view> words = words_of(line);
    Setting setting;
    setting.line = number;
    bool good = words.size() == 3 && words[0] == "set";
    if (good) {
      const char* const last = words[2].data() + words[2].size();
      const auto [stopped, wrong] = std::from_chars(words[2].data(), last, setting.value);
      good = wrong == std::errc{} && stopped == last;
    }
    if (!good) {
      out.error = trouble(fmt::format("line {}: '{}' is no setting", number, shown(line)), "a damaged or another file",
                          "every line is a comment or set NAME NUMBER");
      return out;
    }
    if (!names.insert(words[1]).second) {
      out.error = trouble(fmt::format("line {}: '{}' is set twice", number, shown(words[1])),
                          "two files were put together", "take one of both lines out");
      return out;
    }
    setting.name = words[1];
    out.settings.push_back(std::move(setting));
  }
  if (out.settings.empty()) out.error = trouble("has no settings in it", "another file was meant", "give a backup");
  return out;
}

std::string check_settings(const std::vector<Setting>& settings, const std::vector<Parameter>& device) {
  std::vector<std::string> wrong;
  for (const Setting& setting : settings) {
    const auto known = std::ranges::find(device, setting.name, &Parameter::name);
    if (known == device.end()) {
      wrong.push_back(fmt::format("line {}: no parameter '{}'", setting.line, shown(setting.name)));
    } else if (setting.value < known->min || setting.value > known->max) {
      wrong.push_back(fmt::format("line {}: {} = {} is not in {} to {}{}{}", setting.line, setting.name, setting.value,
                                  known->min, known->max, known->unit.empty() ? "" : " ", known->unit));
    }
  }
  if (wrong.empty()) return {};
  const std::size_t count = wrong.size();
  if (count > kMostNamed) {
    wrong.resize(kMostNamed);
    wrong.push_back(fmt::format("and {} more", count - kMostNamed));
  }
  return trouble(fmt::format("does not fit this device: {}", fmt::join(wrong, "; ")),
                 "a backup of another version, or damaged", "take these lines out, or correct them");
}

std::string backup_text(std::string_view version, const std::vector<std::string>& dump) {
  std::string text(kFirst);
  const auto json = nlohmann::ordered_json::parse(version, nullptr, false);
  for (const auto& [key, value] : json.items()) {
    if (json.is_object())
      text += fmt::format("\n# {} {}", key, value.is_string() ? value.get<std::string>() : value.dump());
  }
  text += "\n";
  for (const std::string& line : dump) text += line + "\n";
  return text + fmt::format("{}{:08x}\n", kLast, sum_of(text));
}

std::string read_parameters(Device& device, std::vector<Parameter>& parameters) {
  const Answer answer = device.say("get json");
  if (!answer.ok()) return answer.error;
  parameters.clear();
  try {
    const auto json = nlohmann::json::parse(answer.lines.empty() ? "" : answer.lines.back());
    for (const auto& row : json.at("parameters")) {
      parameters.push_back({row.at("name"), row.at("value"), row.at("min"), row.at("max"), row.at("default"),
                            row.at("unit"), row.at("applies")});
    }
  } catch (const nlohmann::json::exception&) {
    parameters.clear();
  }
  if (!parameters.empty()) return {};
  return trouble(device.port().path() + ": its parameters cannot be read", "noise on the line, or another firmware",
                 "try again");
}

std::string backup(Device& device, const std::string& path, std::vector<std::string>& report) {
  tool::AtomicFile file(path);
  if (!file.error().empty()) return file.error();
  const Answer dump = device.say("dump");
  if (!dump.ok()) return dump.error;
  const SettingsText told = parse_settings(fmt::format("{}\n", fmt::join(dump.lines, "\n")));
  if (!told.error.empty()) return device.port().path() + ": what it answered " + told.error;
  file.stream() << backup_text(device.version(), dump.lines);
  if (std::string error = file.commit(); !error.empty()) return error;
  report.push_back(fmt::format("{}: {} settings", path, told.settings.size()));
  return {};
}

std::string restore(Device& device, const std::string& path, std::vector<std::string>& report) {
  std::string text;
  if (std::string error = read_text(path, text); !error.empty()) return error;
  const SettingsText file = parse_settings(text);
  if (!file.error.empty()) return path + ": " + file.error;
  std::vector<Parameter> parameters;
  if (std::string error = read_parameters(device, parameters); !error.empty()) return error;
  if (std::string error = check_settings(file.settings, parameters); !error.empty()) return path + ": " + error;

  std::vector<Changed> changes;
  for (const Setting& setting : file.settings) {
    const auto row = std::ranges::find(parameters, setting.name, &Parameter::name);
    if (row->value != setting.value) changes.push_back({row->name, row->value, setting.value, row->applies});
  }
  std::vector<Changed> done;
  Answer answer = set_all(device, changes, Way::kForth, done);
  if (answer.ok()) answer = device.say("save");
  if (!answer.ok()) {
    if (done.empty()) return answer.error + (changes.empty() ? "" : " (nothing was changed)");
    std::vector<Changed> undone;
    const std::size_t count = done.size();
    const bool back = set_all(device, std::move(done), Way::kBack, undone).ok();
    return fmt::format("{} ({})", answer.error,
                       back ? fmt::format("{} settings that had been changed have their earlier values again", count)
                            : fmt::format("of {} settings that had been changed {} have their earlier values again; "
                                          "nothing was stored, so a restart of the device brings back the rest",
                                          count, undone.size()));
  }
  bool at_restart = false;
  for (const Changed& one : changes) {
    at_restart = at_restart || one.applies == "at restart";
    report.push_back(fmt::format("{}: {} -> {}{}", one.name, one.before, one.after,
                                 one.applies == "at once" ? "" : " (" + one.applies + ")"));
  }
  report.push_back(fmt::format("{} of {} settings changed, and stored{}", changes.size(), file.settings.size(),
                               at_restart ? "; reboot the device for those that count at restart" : ""));
  if (parameters.size() > file.settings.size()) {
    report.push_back(
        fmt::format("{} parameters are not in {}: left as they are", parameters.size() - file.settings.size(), path));
  }
  return {};
}

}  // namespace holdfast::console_tool
