// SPDX-License-Identifier: Apache-2.0
// holdfast page: the page of a live session.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <string>
#include <vector>

#include "toolchain/holdfast/commands.hpp"
#include "toolchain/session/page.hpp"
#include "toolchain/support/atomic_file.hpp"

namespace holdfast::tool {
namespace {

int write_page(const std::string& path) {
  AtomicFile file(path);
  if (!file.error().empty()) return fail(file.error());
  file.stream() << page::live();
  if (const std::string error = file.commit(); !error.empty()) return fail(error);
  fmt::print("written   {}: open it in Chromium on the machine that the board is plugged into\n", path);
  return 0;
}

}  // namespace

void add_page(CLI::App& app, std::vector<Command>& commands) {
  const auto path = std::make_shared<std::string>();
  CLI::App* command = app.add_subcommand("page", "write the page that shows a live session in the browser");
  command->add_option("FILE", *path, "the page: HTML")->required()->check(not_empty);
  command->footer("Example:\n  holdfast page live.html");
  commands.push_back({command, [path] { return write_page(*path); }});
}

}  // namespace holdfast::tool
