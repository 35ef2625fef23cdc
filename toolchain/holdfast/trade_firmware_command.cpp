// SPDX-License-Identifier: Apache-2.0
// holdfast trade firmware: what each setting costs and leaves wrong; holdfast trade show: the same from its tables.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <numeric>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "drivers/common/input_file.hpp"
#include "drivers/sim/scene/math/random.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/learn/dataset.hpp"
#include "toolchain/support/atomic_file.hpp"
#include "toolchain/support/progress.hpp"
#include "toolchain/trade/film.hpp"
#include "toolchain/trade/price.hpp"
#include "toolchain/trade/table.hpp"

namespace holdfast::tool {
namespace {

struct FirmwareOptions {
  std::string csv;
  std::string modes;
  std::string shard = "1/1";
  int films = 6;
  std::vector<std::string> recordings;
};

struct ShowOptions {
  std::vector<std::string> tables;
  std::string csv;
  std::string modes;
  std::string counts;
};

template <typename Options>
std::vector<OutputFiles::Asked> asked(const Options& options) {
  return {{"--csv", options.csv}, {"--modes", options.modes}};
}

int put_out(const std::vector<trade::Line>& lines, bool whole, OutputFiles& outputs) {
  if (std::ostream* const csv = outputs.stream("--csv")) *csv << trade::csv(lines);
  if (std::ostream* const modes = outputs.stream("--modes")) *modes << trade::modes_markdown(lines);
  if (const std::string error = outputs.commit(); !error.empty()) return fail(error);
  fmt::print("{}", trade::text(lines, whole));
  fmt::print(
      "a frame: thread CPU time on this machine, from the bytes of a 3280x2464 JPEG to the decision; px of a picture "
      "320 wide\n");
  return 0;
}

int trade_firmware(const FirmwareOptions& options) {
  int shard = 1;
  int shards = 1;
  if (const std::string error = parse_shard(options.shard, shard, shards); !error.empty()) return fail(error);
  OutputFiles outputs(asked(options), {options.recordings.begin(), options.recordings.end()}, "a label file");
  if (!outputs.error().empty()) return fail(outputs.error());
  if (shards > 1 && !options.modes.empty()) {
    return fail(
        "--shard: a piece has no table of modes. Likely cause: --modes given to a piece. Next: give it to holdfast "
        "trade "
        "show with all the pieces");
  }
  std::vector<learn::ClipLabels> clips;
  for (const std::string& labels : options.recordings) {
    if (const auto error = learn::read_labels(labels, clips)) return fail(*error);
  }
  const std::vector<trade::Point> points = trade::points();
  std::vector<long> mine;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (static_cast<int>(i % static_cast<std::size_t>(shards)) + 1 != shard) continue;
    mine.push_back(static_cast<long>(i));
  }
  std::vector<trade::Trialled> trialled;
  trialled.reserve(mine.size());
  for (const long i : mine) trialled.emplace_back(points[static_cast<std::size_t>(i)]);
  std::set<int, std::greater<>> widths;
  for (const long i : mine) widths.insert(points[static_cast<std::size_t>(i)].tuning.picture_width);
  constexpr long kParts = 100;  // of a film, for the progress
  Progress progress("trade", kParts * options.films * static_cast<long>(widths.size()));
  long done = 0;
  std::vector<std::size_t> turns(trialled.size());
  std::iota(turns.begin(), turns.end(), 0);
  scene::Random random(1);
  // False: interrupted.
  const auto show = [&](const trade::Film& film) {
    const auto frames = static_cast<long>(film.shots.size());
    for (long k = 0; k < frames && !interrupted(); ++k) {
      // What is in the cache is what the one before left there: another one each time.
      for (std::size_t i = turns.size(); i > 1; --i) {
        std::swap(turns[i - 1], turns[static_cast<std::size_t>(random.below(static_cast<int>(i)))]);
      }
      for (const std::size_t turn : turns) trialled[turn].show(film, static_cast<std::size_t>(k));
      progress.update(done + kParts * k / frames);
    }
    done += kParts;
    return !interrupted();
  };
  for (int which = 0; which < options.films; ++which) {
    for (const int width : widths) {
      if (!show(trade::shoot(which, width, [] { return !interrupted(); }))) return fail(interrupted_line());
    }
  }
  const auto play = [&](const learn::RecordedClip& clip) {
    for (trade::Trialled& one : trialled) one.show(clip);
    return std::optional<std::string>();
  };
  const auto luma = trade::config_of(points.front(), nullptr).luma;
  if (const auto error = learn::load_recordings(clips, luma, play, [](int, int) { return !interrupted(); })) {
    return fail(interrupted() ? interrupted_line() : *error);
  }
  progress.clear();
  std::vector<trade::Line> lines;
  for (std::size_t i = 0; i < trialled.size(); ++i) {
    lines.push_back(trade::line_of(mine[i], points[static_cast<std::size_t>(mine[i])], trialled[i].price()));
  }
  return put_out(lines, shards == 1, outputs);
}

// Each setting that can be shown pictures, a line of words each.
int trade_settings() {
  std::set<std::string> known;
  for (const trade::Point& point : trade::points()) {
    const auto settings = trade::settings_of(point);
    if (settings && known.insert(*settings).second) fmt::print("{}\n", *settings);
  }
  return 0;
}

int trade_show(const ShowOptions& options) {
  std::vector<std::filesystem::path> inputs(options.tables.begin(), options.tables.end());
  inputs.emplace_back(options.counts);
  OutputFiles outputs(asked(options), inputs, "a table");
  if (!outputs.error().empty()) return fail(outputs.error());
  std::vector<trade::Line> lines;
  for (const std::string& path : options.tables) {
    constexpr std::string_view kGive = "give what holdfast trade firmware --csv wrote";
    std::ifstream in;
    if (const std::string wrong = drivers::open_file(path, kGive, in); !wrong.empty()) return fail(wrong);
    if (const auto error = trade::read_csv(in, path, lines)) return fail(*error);
  }
  if (const auto error = trade::put_together(lines)) return fail(*error);
  if (!options.counts.empty()) {
    constexpr std::string_view kCount = "count the instructions with tests/bench/count_settings.sh";
    std::ifstream in;
    if (const std::string wrong = drivers::open_file(options.counts, kCount, in); !wrong.empty()) return fail(wrong);
    if (const auto error = trade::read_counts(in, options.counts, lines)) return fail(*error);
  }
  return put_out(lines, true, outputs);
}

}  // namespace

void add_trade_firmware(CLI::App& trade, std::vector<Command>& commands) {
  const auto measured = std::make_shared<FirmwareOptions>();
  CLI::App* const firmware = trade.add_subcommand(
      "firmware", "settings of the firmware: time and memory against markers, entropy and decisions");
  const auto add_outputs = [](CLI::App* command, std::string& csv, std::string& modes) {
    command->add_option("--csv", csv, "write the table: CSV")->check(not_empty);
    command->add_option("--modes", modes, "write the shipped modes as a table: Markdown")->check(not_empty);
  };
  add_outputs(firmware, measured->csv, measured->modes);
  firmware->add_option("--shard", measured->shard, "piece I of N of the settings, for N runs side by side")
      ->capture_default_str();
  firmware->add_option("--films", measured->films, "grasps filmed by the camera, 11 s and more each; 0: none")
      ->check(CLI::Range(0, 6))
      ->capture_default_str();
  firmware
      ->add_option("--recordings", measured->recordings,
                   "label files of recorded clips, to be judged as well: CSV (holdfast dataset --help)")
      ->check(not_empty);
  firmware->footer(
      "Example:\n"
      "  holdfast trade firmware --recordings clips/labels.csv more/labels.csv --csv trade.csv\n"
      "Side by side with GNU parallel, then merged into the whole:\n"
      "  parallel holdfast trade firmware --shard {}/8 --csv part_{}.csv ::: {1..8}\n"
      "  holdfast trade show part_{1..8}.csv --csv trade.csv\n"
      "The same as a Slurm array:\n"
      "  sbatch --array=1-8 --wrap='holdfast trade firmware --shard $SLURM_ARRAY_TASK_ID/8 "
      "--csv part_$SLURM_ARRAY_TASK_ID.csv'");
  commands.push_back({firmware, [measured] { return trade_firmware(*measured); }});

  const auto shown = std::make_shared<ShowOptions>();
  CLI::App* const show = trade.add_subcommand("show", "put pieces of `trade firmware` together, and read them off");
  show->add_option("CSV", shown->tables, "the pieces, in any order")->required()->check(not_empty);
  add_outputs(show, shown->csv, shown->modes);
  show->add_option("--counts", shown->counts,
                   "the instruction counts of tests/bench/count_settings.sh, to be put in as well: CSV")
      ->check(not_empty);
  show->footer("Example:\n  holdfast trade show part_{1..8}.csv --csv trade.csv");
  commands.push_back({show, [shown] { return trade_show(*shown); }});

  CLI::App* const settings = trade.add_subcommand(
      "settings", "the settings that `trade firmware` shows pictures to, as programs understand them that count");
  settings->footer("Example:\n  holdfast trade settings");
  commands.push_back({settings, trade_settings});
}

}  // namespace holdfast::tool
