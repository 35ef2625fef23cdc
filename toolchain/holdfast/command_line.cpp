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

  ReplayOptions replay_options;
  CLI::App* replay_command = app.add_subcommand("replay", "run a recording through the firmware");
  replay_command
      ->add_option("INPUT", replay_options.input,
                   "video file, folder of images, raw .mjpg stream, or what --mcap wrote")
      ->required()
      ->check(not_empty);
  replay_command
      ->add_option("--reference", replay_options.reference,
                   "which frame shows the empty gel: auto (find it), first, last, its number from 0, or another image "
                   "file")
      ->check(not_empty)
      ->capture_default_str();
  replay_command
      ->add_option("--opening", replay_options.opening,
                   "frames A-B in which the gripper opens and says so, counted from 0; may be given again. Without it "
                   "the end of a contact is a loss: SLIP (contact_lost)")
      ->check(not_empty);
  replay_command
      ->add_option("--fps", replay_options.fps,
                   "frames per second, 0.1 to 1000, of inputs that carry no time (else 25), or instead of a wrong one")
      ->check(number_from_to(0.1, 1000));
  CLI::Option* const right =
      replay_command
          ->add_option(
              "--right", replay_options.right,
              "recording of the right finger of the same grasp; INPUT is the left's. Slip, state and lines are "
              "the hand's, all else the left's; the table of features ends with the evidence of both")
          ->check(not_empty);
  replay_command
      ->add_option("--right-reference", replay_options.right_reference, "as --reference, for the right recording")
      ->needs(right)
      ->check(not_empty)
      ->capture_default_str();
  replay_command
      ->add_option(
          "--offset", replay_options.offset,
          "the right recording's frame at the left's frame 0, below 0 where it begins later; else found by how "
          "the markers move")
      ->needs(right)
      ->check(CLI::Range(-100'000, 100'000));
  add_common_options(*replay_command, replay_options.common);
  replay_command->footer(
      "Example:\n"
      "  holdfast replay grasp.avi --report grasp.html --features grasp.csv\n"
      "  holdfast replay grasp__camera_0.avi --right grasp__camera_2.avi --grid auto --features hand.csv");

  SimOptions sim_options;
  sim_options.common.grid.clear();  // the scene says
  CLI::App* sim_command = app.add_subcommand("sim", "play a scene through the firmware and check what it expects");
  sim_command->add_option("SCENE", sim_options.scene, "scene file; tests/scenes has a gallery")
      ->required()
      ->check(not_empty);
  sim_command->add_option("--inject", sim_options.inject, "enter here instead: features, markers, grey or jpeg");
  sim_command->add_option("--contact", sim_options.contact, "with this contact level instead: springs or grid");
  sim_command
      ->add_option("--truth", sim_options.common.paths.truth, "write the simulated truth, one row per frame: CSV")
      ->check(not_empty);
  sim_command
      ->add_option("--truth-markers", sim_options.common.paths.truth_markers,
                   "write where the markers really are, one row per marker and frame: CSV")
      ->check(not_empty);
  add_common_options(*sim_command, sim_options.common);
  sim_command->footer("Example:\n  holdfast sim tests/scenes/sphere_slip.json --report slip.html --truth truth.csv");

  CLI::App* scene_command = app.add_subcommand("scene", "look at scene files");
  scene_command->require_subcommand(1);
  scene_command->footer("Example:\n  holdfast scene describe tests/scenes/sphere_slip.json");
  SceneCheckOptions check_options;
  CLI::App* check_command =
      scene_command->add_subcommand("check", "read scenes, and report effects that are switched on and change nothing");
  check_command->add_option("SCENE", check_options.files, "scene files")->required()->check(not_empty);
  check_command->add_flag("--strict", check_options.strict, "an effect that changes nothing is an error");
  check_command->footer("Example:\n  holdfast scene check tests/scenes/*.json");
  std::string list_folder = "tests/scenes";
  CLI::App* list_command = scene_command->add_subcommand("list", "list the scenes of a folder");
  list_command->add_option("FOLDER", list_folder, "where to look")->check(not_empty)->capture_default_str();
  list_command->footer("Example:\n  holdfast scene list tests/scenes");
  std::string described;
  CLI::App* describe_command =
      scene_command->add_subcommand("describe", "say what a scene does, models and leaves out");
  describe_command->add_option("SCENE", described, "scene file")->required()->check(not_empty);
  describe_command->footer("Example:\n  holdfast scene describe tests/scenes/sphere_slip.json");
  SceneMakeOptions make_options;
  CLI::App* make_command = scene_command->add_subcommand("make", "print a trial of the paper's objects as a scene");
  make_command->add_option("OBJECT", make_options.object, "ball, box, sponge ...")->required()->check(not_empty);
  make_command->add_option("PRIMITIVE", make_options.primitive, "one of the twelve motions")
      ->required()
      ->check(not_empty);
  make_command->add_option("OUTCOME", make_options.outcome, "static, slip, matched, shaken or slow")
      ->required()
      ->check(not_empty);
  make_command->add_option("--seed", make_options.seed, "which trial")->capture_default_str();
  make_command->footer("Example:\n  holdfast scene make ball translate_x slip --seed 7 > ball.json");

  CLI::App* trade_command = app.add_subcommand("trade", "measure speed against accuracy");
  trade_command->require_subcommand(1);
  trade_command->footer("Example:\n  holdfast trade sim tests/scenes/sphere_slip.json");
  TradeSimOptions trade_options;
  CLI::App* trade_sim_command = trade_command->add_subcommand(
      "sim", "levels of the simulator: time, and error against the finest grid; ways into the firmware");
  trade_sim_command->add_option("SCENE", trade_options.scenes, "scene files")->required()->check(not_empty);
  trade_sim_command
      ->add_option("--reference-cell", trade_options.reference_cell_mm,
                   "cell of the finest grid, mm; time goes as its "
                   "fourth power")
      ->check(number_from_to(0.2, 1.0))
      ->capture_default_str();
  trade_sim_command->add_option("--repeats", trade_options.repeats, "of the timing")
      ->check(CLI::Range(1, 100))
      ->capture_default_str();
  trade_sim_command->footer("Example:\n  holdfast trade sim tests/scenes/sphere_slip.json");

  TradeFirmwareOptions firmware_options;
  CLI::App* trade_firmware_command = trade_command->add_subcommand(
      "firmware", "settings of the firmware: time and memory against markers, entropy and decisions");
  const auto add_outputs = [](CLI::App* command, std::string& csv, std::string& modes) {
    command->add_option("--csv", csv, "write the table: CSV")->check(not_empty);
    command->add_option("--modes", modes, "write the shipped modes as a table: Markdown")->check(not_empty);
  };
  add_outputs(trade_firmware_command, firmware_options.csv, firmware_options.modes);
  trade_firmware_command
      ->add_option("--shard", firmware_options.shard, "piece I of N of the settings, for N runs side by side")
      ->capture_default_str();
  trade_firmware_command
      ->add_option("--films", firmware_options.films, "grasps filmed by the camera, 11 s and more each; 0: none")
      ->check(CLI::Range(0, 6))
      ->capture_default_str();
  trade_firmware_command
      ->add_option("--recordings", firmware_options.recordings,
                   "label files of recorded clips, to be judged as well: CSV (holdfast dataset --help)")
      ->check(not_empty);
  trade_firmware_command->footer(
      "Example:\n"
      "  holdfast trade firmware --recordings clips/labels.csv more/labels.csv --csv trade.csv\n"
      "Side by side with GNU parallel, then merged into the whole:\n"
      "  parallel holdfast trade firmware --shard {}/8 --csv part_{}.csv ::: {1..8}\n"
      "  holdfast trade show part_{1..8}.csv --csv trade.csv\n"
      "The same as a Slurm array:\n"
      "  sbatch --array=1-8 --wrap='holdfast trade firmware --shard $SLURM_ARRAY_TASK_ID/8 "
      "--csv part_$SLURM_ARRAY_TASK_ID.csv'");
  TradeShowOptions show_options;
  CLI::App* trade_show_command =
      trade_command->add_subcommand("show", "put pieces of `trade firmware` together, and read them off");
  trade_show_command->add_option("CSV", show_options.tables, "the pieces, in any order")->required()->check(not_empty);
  add_outputs(trade_show_command, show_options.csv, show_options.modes);
  trade_show_command
      ->add_option("--counts", show_options.counts,
                   "the instruction counts of tests/bench/count_settings.sh, to be put in as well: CSV")
      ->check(not_empty);
  trade_show_command->footer("Example:\n  holdfast trade show part_{1..8}.csv --csv trade.csv");
  CLI::App* trade_settings_command = trade_command->add_subcommand(
      "settings", "the settings that `trade firmware` shows pictures to, as programs understand them that count");
  trade_settings_command->footer("Example:\n  holdfast trade settings");

  std::vector<Command> commands;
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
  int status = 0;
  const auto chosen = std::find_if(commands.begin(), commands.end(), [](const Command& c) { return bool{*c.app}; });
  if (chosen != commands.end()) {
    status = chosen->run();
  } else if (*replay_command) {
    status = replay(replay_options);
  } else if (*sim_command) {
    status = sim_grasp(sim_options);
  } else if (*check_command) {
    status = scene_check(check_options);
  } else if (*list_command) {
    status = scene_list(list_folder);
  } else if (*describe_command) {
    status = scene_describe(described);
  } else if (*make_command) {
    status = scene_make(make_options);
  } else if (*trade_settings_command) {
    status = trade_settings();
  } else if (*trade_firmware_command) {
    status = trade_firmware(firmware_options);
  } else if (*trade_show_command) {
    status = trade_show(show_options);
  } else {
    status = trade_sim(trade_options);
  }
  return printed(status);
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
