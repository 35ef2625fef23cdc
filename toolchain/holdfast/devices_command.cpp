// SPDX-License-Identifier: Apache-2.0
#include "toolchain/holdfast/devices_command.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cstdlib>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "toolchain/devices/inventory.hpp"

namespace holdfast::tool {
namespace {

using devices::Item;
using devices::Verdict;

constexpr std::array<std::string_view, 3> kWords{"ok", "note", "wrong"};

std::string_view word(const Item& item) {
  return kWords[static_cast<std::size_t>(item.verdict)];
}

void print_text(const std::vector<Item>& items) {
  const char* const no_color = std::getenv("NO_COLOR");
  const bool color = ::isatty(STDOUT_FILENO) == 1 && (no_color == nullptr || *no_color == '\0');
  constexpr std::array<std::string_view, 3> kColors{"\x1b[32m", "\x1b[33m", "\x1b[31m"};
  std::size_t widest = 0;
  for (const Item& item : items) widest = std::max(widest, item.path.size());
  for (const Item& item : items) {
    fmt::print("{:8} {:{}}  {}{:5}{}  {}{}{}\n", item.kind, item.path, widest,
               color ? kColors[static_cast<std::size_t>(item.verdict)] : "", word(item), color ? "\x1b[0m" : "",
               item.name, item.what.empty() ? "" : ": ", item.what);
    if (!item.fix.empty()) fmt::print("{:8} {:{}}         Next: {}\n", "", "", widest, item.fix);
  }
}

void print_json(const std::vector<Item>& items) {
  nlohmann::ordered_json all = nlohmann::ordered_json::array();
  for (const Item& item : items) {
    nlohmann::ordered_json& one = all.emplace_back();
    one["kind"] = item.kind;
    one["path"] = item.path;
    one["name"] = item.name;
    one["verdict"] = word(item);
    one["what"] = item.what;
    one["fix"] = item.fix;
    for (const auto& [name, value] : item.facts) one["facts"][name] = value;
  }
  // Names of devices need not be UTF-8.
  fmt::print("{}\n", all.dump(1, ' ', false, nlohmann::json::error_handler_t::replace));
}

void print(const std::vector<Item>& items, bool json) {
  if (json) {
    print_json(items);
  } else {
    print_text(items);
  }
}

}  // namespace

void add_devices(CLI::App& app, std::vector<Command>& commands) {
  const auto json = std::make_shared<bool>(false);
  CLI::App* const list = app.add_subcommand(
      "devices", "cameras, GPIO chips, serial ports and bridges of this computer, and what is wrong");
  list->add_flag("--json", *json, "print them as JSON");
  list->footer("Nothing is changed and nothing is sent.\nExample:\n  holdfast devices");
  commands.push_back({list, [json] {
                        print(devices::inventory(devices::this_computer()), *json);
                        return 0;
                      }});
  CLI::App* const doctor =
      app.add_subcommand("doctor", "what on this computer keeps the sensor from working, and what to do about it");
  doctor->add_flag("--json", *json, "print it as JSON");
  doctor->footer("Exit status 1 when something is wrong.\nExample:\n  holdfast doctor");
  commands.push_back({doctor, [json] {
                        const devices::Places places = devices::this_computer();
                        std::vector<Item> items = devices::inventory(places);
                        const std::vector<Item> rest = devices::system_state(places);
                        items.insert(items.end(), rest.begin(), rest.end());
                        print(items, *json);
                        const auto wrong = std::ranges::count(items, Verdict::kWrong, &Item::verdict);
                        if (!*json) {
                          fmt::print("{}\n", wrong == 0 ? "nothing is wrong" : fmt::format("{} wrong", wrong));
                        }
                        return wrong == 0 ? 0 : 1;
                      }});
}

}  // namespace holdfast::tool
