// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>
#include <exception>

#include "toolchain/holdfast/commands.hpp"

int main(int argc, char** argv) {
  using namespace holdfast::tool;
  CLI::App app{"holdfast: the host side of the slip sensor"};
  app.set_version_flag("--version", HOLDFAST_VERSION);
  app.require_subcommand(1);
  app.failure_message(CLI::FailureMessage::simple);

  ReplayOptions replay_options;
  CLI::App* replay_command = app.add_subcommand("replay", "run a recording through the firmware");
  replay_command->add_option("INPUT", replay_options.input, "video file, folder of images, or raw .mjpg stream")
      ->required();
  replay_command
      ->add_option("--reference", replay_options.reference,
                   "which frame shows the empty gel: first, last, its number from 0, or another image file")
      ->capture_default_str();
  replay_command->add_option("--fps", replay_options.fps, "time base of inputs that carry none")
      ->check(CLI::Range(0.1, 1000.0));
  add_common_options(*replay_command, replay_options.common);
  replay_command->footer(
      "Example:\n  holdfast replay grasp.avi --reference last --report grasp.html --features grasp.csv");

  SimOptions sim_options;
  CLI::App* sim_command = app.add_subcommand("sim", "run a simulated grasp through the firmware and check it");
  sim_command->add_option("SCENE", sim_options.scene, "name of a scene; --list shows them");
  sim_command->add_flag("--list", sim_options.list, "list the scenes");
  sim_command->add_option("--camera", sim_options.camera, "3280x2464 (JPEG, as the sensor) or 320x240 (luma)")
      ->capture_default_str();
  sim_command->add_option("--truth", sim_options.common.paths.truth,
                          "write the simulated truth, one row per frame: CSV");
  add_common_options(*sim_command, sim_options.common);
  sim_command->footer("Example:\n  holdfast sim sphere_slip --report slip.html --truth truth.csv");

  try {
    app.parse(argc, argv);
    if (*replay_command) return replay(replay_options);
    if (!sim_options.list && sim_options.scene.empty()) return fail("sim: no scene given. Next: holdfast sim --list");
    return sim_grasp(sim_options);
  } catch (const CLI::ParseError& error) {
    return app.exit(error);
  } catch (const std::exception& error) {
    return fail(std::string(error.what()) + ". Likely cause: out of memory, or a fault of the tool. Next: report it");
  }
}
