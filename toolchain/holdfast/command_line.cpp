// SPDX-License-Identifier: Apache-2.0
#include "toolchain/holdfast/command_line.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <exception>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/sim/media.hpp"
#include "drivers/sim/scene/file/words.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/holdfast/devices_command.hpp"

namespace holdfast::tool {
namespace {

// What is wrong with the command line, in one line instead of CLI11's two.
std::string usage_error(const CLI::App& app, const CLI::ParseError& error) {
  const auto chosen = app.get_subcommands();
  if (chosen.empty()) {
    const auto rest = app.remaining();
    std::vector<std::string> names;
    for (const CLI::App* command : app.get_subcommands({})) names.push_back(command->get_name());
    const std::string_view meant = rest.empty() ? "" : scene::file::nearest(rest.front(), {names.begin(), names.end()});
    return fmt::format(
        "{}. Likely cause: a typing error, or something left out. Next: {}give one of {}; holdfast --help shows how",
        rest.empty() ? "no command given" : fmt::format("'{}' is no command of holdfast", rest.front()),
        meant.empty() ? "" : fmt::format("did you mean {}? Else ", meant), scene::file::joined(names));
  }
  std::string command = "holdfast";
  const CLI::App* last = &app;
  while (!last->get_subcommands().empty()) {
    last = last->get_subcommands().front();
    command += " " + last->get_name();
  }
  const auto rest = app.remaining(true);
  const std::string what = rest.empty() ? error.what() : fmt::format("'{}' is not known to {}", rest.front(), command);
  std::vector<std::string> names;
  for (const CLI::Option* option : last->get_options()) {
    for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
  }
  for (const CLI::App* one : last->get_subcommands({})) names.push_back(one->get_name());
  const std::string_view meant = rest.empty() ? "" : scene::file::nearest(rest.front(), {names.begin(), names.end()});
  return fmt::format("{}. Likely cause: a typing error, or something left out. Next: {}{} --help shows how", what,
                     meant.empty() ? "" : fmt::format("did you mean {}? ", meant), command);
}

int run(int argc, char** argv, const char* version) {
  CLI::App app{"holdfast: the host side of the slip sensor", "holdfast"};
  app.set_version_flag("--version", version);
  app.require_subcommand(1);
  app.footer("Example:\n  holdfast replay grasp.avi --report grasp.html");

  std::vector<Command> commands;
  add_replay(app, commands);
  add_sim(app, commands);
  add_scene(app, commands);
  add_trade(app, commands);
  add_dataset(app, commands);
  add_train(app, commands);
  add_evaluate(app, commands);
  add_compile(app, commands);
  add_model(app, commands);
  add_settings(app, commands);
  add_fuse(app, commands);
  add_calibrate(app, commands);
  add_trials(app, commands);
  add_grip(app, commands);
  add_faults(app, commands);
  add_log(app, commands);
  add_live(app, commands);
  add_record(app, commands);
  add_page(app, commands);
  add_console(app, commands);
  add_devices(app, commands);

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return error.get_exit_code() == 0 ? printed(app.exit(error)) : fail(usage_error(app, error));
  }
  heed_interrupts();
  const auto chosen = std::ranges::find_if(commands, [](const Command& c) { return bool{*c.app}; });
  return printed(chosen->run());  // CLI11 accepts no line without one
}

}  // namespace

int command_line(int argc, char** argv, const char* version) {
  try {
    return run(argc, argv, version);
  } catch (const sim::MediaMissing& error) {
    return fail(error.what());
  } catch (const std::exception& error) {
    if (std::ferror(stdout) != 0) return printed(1);  // fmt throws where a text is larger than the buffer
    return fail(std::string(error.what()) + ". Likely cause: out of memory, or a fault of the tool. Next: report it");
  }
}

}  // namespace holdfast::tool
