// SPDX-License-Identifier: Apache-2.0
// jpeg_corruption: how many damaged frames get past the decoders, and how many of those mislead the tracking
// (support/host_jpeg_damage.hpp). Exit status 1 when one frame with lost, zeroed or truncated payload was taken for a
// whole one and was not. The test asserts the same of a short run.
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <string>
#include <system_error>
#include <thread>

#include "tests/support/host_jpeg_damage.hpp"

namespace {

using namespace holdfast::test;

constexpr int kShots = 24;
constexpr int kRestartInterval = 4;  // MCUs, as in the measurement that this repeats
constexpr int kSteps = 20;           // of progress per cell

struct Options {
  long frames_640 = 100'000;
  long frames_3280 = 1'000;
  long flips = 10'000;
  std::uint32_t seed = 1;
  int threads = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  bool csv = false;
  std::string keep;
};

void print_header(bool csv) {
  if (csv) {
    fmt::print("width,restart_interval,damage,frames,judge,rejected,identical,different,harmful\n");
    return;
  }
  fmt::print("{:18} {:>5} {:>4} {:>8}  {:22} {:>10} {:>10} {:>10} {:>10}\n", "damage", "width", "RST", "frames",
             "judge", "rejected", "identical", "different", "harmful");
}

void print_row(bool csv, const DamagedFilm& film, Damage damage, long frames, const char* judge, const Tally& tally,
               bool tracked) {
  const std::string harmful = tracked ? fmt::format("{}", tally.harmful) : csv ? "" : "-";
  if (csv) {
    fmt::print("{},{},{},{},{},{},{},{},{}\n", film.width, film.restart_interval, name(damage), frames, judge,
               tally.rejected, tally.identical, tally.different, harmful);
    return;
  }
  fmt::print("{:18} {:5} {:>4} {:8}  {:22} {:9.3f}% {:10} {:10} {:>10}\n", name(damage), film.width,
             film.restart_interval, frames, judge,
             100.0 * static_cast<double>(tally.rejected) / static_cast<double>(frames), tally.identical,
             tally.different, harmful);
}

// Returns the losses that passed.
long run_cell(const Options& options, const DamagedFilm& film, Damage damage, long frames) {
  const bool tell = isatty(STDERR_FILENO) != 0;
  DamageFigures sum;
  for (long first = 0; first < frames; first = sum.frames) {
    const long count = std::min(frames - first, frames / kSteps + 1);
    sum += judge(film, damage, first, count, options.seed, options.threads, options.keep);
    if (tell) fmt::print(stderr, "\r{} at {}: {:3} % \r", name(damage), film.width, 100 * sum.frames / frames);
  }
  if (film.scale == holdfast::DecodeScale::kEighth) {
    print_row(options.csv, film, damage, frames, "ours", sum.ours, true);
    print_row(options.csv, film, damage, frames, "ours + picture check", sum.checked, true);
  } else {
    print_row(options.csv, film, damage, frames, "ours at 1/8", sum.ours, false);
    print_row(options.csv, film, damage, frames, "library at 1/2", sum.library, true);
    print_row(options.csv, film, damage, frames, "library + ours as gate", sum.both, true);
    print_row(options.csv, film, damage, frames, "library + picture check", sum.checked, true);
  }
  std::fflush(stdout);
  return sum.losses_passed;
}

int run(int argc, char** argv) {
  Options options;
  CLI::App app{"what damaged JPEG frames do to the tracking", "jpeg_corruption"};
  app.add_option("--frames-640", options.frames_640, "frames with lost payload at 640x480, over all ten cells; 0: none")
      ->check(CLI::Range(0L, 1'000'000'000L))
      ->capture_default_str();
  app.add_option("--frames-3280", options.frames_3280, "the same at 3280x2464")
      ->check(CLI::Range(0L, 1'000'000'000L))
      ->capture_default_str();
  app.add_option("--flips", options.flips, "frames with a changed bit or byte, in each cell")
      ->check(CLI::Range(0L, 1'000'000'000L))
      ->capture_default_str();
  app.add_option("--seed", options.seed, "another one gives other damage")->capture_default_str();
  app.add_option("--threads", options.threads, "1 to 64; the figures do not depend on it")->check(CLI::Range(1, 64));
  app.add_flag("--csv", options.csv, "a line per row, with a header");
  app.add_option("--keep", options.keep, "folder for the frames with lost payload that passed")
      ->check(CLI::ExistingDirectory);
  CLI11_PARSE(app, argc, argv);

  print_header(options.csv);
  long passed = 0;
  for (const int width : {640, 3280}) {
    const long losses = width == 640 ? options.frames_640 : options.frames_3280;
    if (losses == 0) continue;
    for (const int restart_interval : {0, kRestartInterval}) {
      const DamagedFilm shots = film(width, restart_interval, kShots);
      if (!shots.error.empty()) {
        fmt::print(stderr, "error: {} at {} (the undamaged film is not tracked). Next: run the tests\n", shots.error,
                   width);
        return 1;
      }
      for (const Damage damage : kDamages) {
        const long frames = is_loss(damage) ? (losses + 9) / 10 : options.flips;
        if (frames > 0) passed += run_cell(options, shots, damage, frames);
      }
    }
  }
  if (!options.csv) {
    fmt::print(
        "rejected: refused or warned of. identical: accepted, every pixel as undamaged. different: accepted, and not.\n"
        "harmful: of these, the firmware goes on with them and a valid marker is off by more than {} px of its "
        "working\nimage. RST: MCUs per restart marker.\n",
        kHarmPx);
  }
  if (passed != 0) fmt::print(stderr, "{} frames with lost payload passed and were not whole\n", passed);
  return passed == 0 ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "error: %s (no memory, or no thread). Next: try --threads 1\n", error.what());
    return 1;
  }
}
