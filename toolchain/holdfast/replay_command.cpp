// SPDX-License-Identifier: Apache-2.0
// holdfast replay: a recording through the firmware.
#include "toolchain/session/replay.hpp"

#include <CLI/CLI.hpp>
#include <memory>

#include "toolchain/holdfast/commands.hpp"

namespace holdfast::tool {

void add_replay(CLI::App& app, std::vector<Command>& commands) {
  const auto options = std::make_shared<ReplayOptions>();
  CLI::App* const command = app.add_subcommand("replay", "run a recording through the firmware");
  command->add_option("INPUT", options->input, "video file, folder of images, raw .mjpg stream, or what --mcap wrote")
      ->required()
      ->check(not_empty);
  command
      ->add_option("--reference", options->reference,
                   "which frame shows the empty gel: auto (find it), first, last, its number from 0, or another image "
                   "file")
      ->check(not_empty)
      ->capture_default_str();
  command
      ->add_option("--opening", options->opening,
                   "frames A-B in which the gripper opens and says so, counted from 0; may be given again. Without it "
                   "the end of a contact is a loss: SLIP (contact_lost)")
      ->check(not_empty);
  command
      ->add_option("--fps", options->fps,
                   "frames per second, 0.1 to 1000, of inputs that carry no time (else 25), or instead of a wrong one")
      ->check(number_from_to(0.1, 1000));
  CLI::Option* const right =
      command
          ->add_option(
              "--right", options->right,
              "recording of the right finger of the same grasp; INPUT is the left's. Slip, state and lines are "
              "the hand's, all else the left's; the table of features ends with the evidence of both")
          ->check(not_empty);
  command->add_option("--right-reference", options->right_reference, "as --reference, for the right recording")
      ->needs(right)
      ->check(not_empty)
      ->capture_default_str();
  command
      ->add_option(
          "--offset", options->offset,
          "the right recording's frame at the left's frame 0, below 0 where it begins later; else found by how "
          "the markers move")
      ->needs(right)
      ->check(CLI::Range(-100'000, 100'000));
  add_common_options(*command, options->common);
  command->footer(
      "Example:\n"
      "  holdfast replay grasp.avi --report grasp.html --features grasp.csv\n"
      "  holdfast replay grasp__camera_0.avi --right grasp__camera_2.avi --grid auto --features hand.csv");
  commands.push_back({command, [options] { return replay(*options); }});
}

}  // namespace holdfast::tool
