// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>

#include "toolchain/holdfast/commands.hpp"

namespace holdfast::tool {
namespace {

// CLI11's own range check lets "nan" pass.
std::string frame_rate(const std::string& text) {
  double fps = 0;
  if (CLI::detail::lexical_cast(text, fps) && fps >= 0.1 && fps <= 1000) return {};
  return fmt::format("'{}' is no rate of frames from 0.1 to 1000", text);
}

// What is wrong with the command line, in one line instead of CLI11's two.
std::string usage_error(const CLI::App& app, const CLI::ParseError& error) {
  const auto chosen = app.get_subcommands();
  if (chosen.empty()) {
    const auto rest = app.remaining();
    return fmt::format(
        "{}. Likely cause: a typing error, or something left out. Next: give replay or sim; holdfast --help shows how",
        rest.empty() ? "no command given" : fmt::format("'{}' is no command of holdfast", rest.front()));
  }
  const std::string command = "holdfast " + chosen.front()->get_name();
  const auto rest = app.remaining(true);
  const std::string what = rest.empty() ? error.what() : fmt::format("'{}' is not known to {}", rest.front(), command);
  return fmt::format("{}. Likely cause: a typing error, or something left out. Next: {} --help shows how", what,
                     command);
}

int run(int argc, char** argv) {
  CLI::App app{"holdfast: the host side of the slip sensor", "holdfast"};
  app.set_version_flag("--version", HOLDFAST_VERSION);
  app.require_subcommand(1);
  app.footer("Example:\n  holdfast replay grasp.avi --report grasp.html");

  ReplayOptions replay_options;
  CLI::App* replay_command = app.add_subcommand("replay", "run a recording through the firmware");
  replay_command->add_option("INPUT", replay_options.input, "video file, folder of images, or raw .mjpg stream")
      ->required()
      ->check(not_empty);
  replay_command
      ->add_option("--reference", replay_options.reference,
                   "which frame shows the empty gel: first, last, its number from 0, or another image file")
      ->check(not_empty)
      ->capture_default_str();
  replay_command
      ->add_option("--fps", replay_options.fps,
                   "frames per second, 0.1 to 1000, of inputs that carry no time (else 25)")
      ->check(frame_rate);
  add_common_options(*replay_command, replay_options.common);
  replay_command->footer(
      "Example:\n  holdfast replay grasp.avi --reference last --report grasp.html --features grasp.csv");

  SimOptions sim_options;
  CLI::App* sim_command = app.add_subcommand("sim", "run a simulated grasp through the firmware and check it");
  sim_command->add_option("SCENE", sim_options.scene, "name of a scene; --list shows them");
  sim_command->add_flag("--list", sim_options.list, "list the scenes");
  sim_command->add_option("--camera", sim_options.camera, "3280x2464 (JPEG, as the sensor) or 320x240 (luma)")
      ->capture_default_str();
  sim_command
      ->add_option("--truth", sim_options.common.paths.truth, "write the simulated truth, one row per frame: CSV")
      ->check(not_empty);
  add_common_options(*sim_command, sim_options.common);
  sim_command->footer("Example:\n  holdfast sim sphere_slip --report slip.html --truth truth.csv");

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return error.get_exit_code() == 0 ? app.exit(error) : fail(usage_error(app, error));
  }
  heed_interrupts();
  const int status = *replay_command ? replay(replay_options) : sim_grasp(sim_options);
  if (std::fflush(stdout) == 0) return status;
  return fail("the summary could not be printed. Likely cause: the disk behind stdout is full. Next: free some space");
}

}  // namespace
}  // namespace holdfast::tool

int main(int argc, char** argv) {
  try {
    return holdfast::tool::run(argc, argv);
  } catch (const std::exception& error) {
    return holdfast::tool::fail(std::string(error.what()) +
                                ". Likely cause: out of memory, or a fault of the tool. Next: report it");
  }
}
