// SPDX-License-Identifier: Apache-2.0
// holdfast faults: what the appliance does when something around it fails, in virtual time, judged from another
// process.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "toolchain/faults/scenarios.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/support/atomic_file.hpp"
#include "toolchain/support/json_text.hpp"
#include "toolchain/support/progress.hpp"

namespace holdfast::tool {
namespace {

using faults::Run;
using faults::Trouble;

struct FaultsOptions {
  bool pairs = false;
  bool hand = false;
  std::uint64_t soak = 0;
  std::uint64_t seed = 1;
  std::string csv;
  bool json = false;
};

double ms(Micros time) {
  return static_cast<double>(time.count()) / 1e3;
}

std::string recovered(const Run& run) {
  return run.judgement.to_recover ? fmt::format("{:.0f}", ms(*run.judgement.to_recover)) : "-";
}

std::string reasons(const Run& run) {
  std::string text;
  for (const Reason reason : run.judgement.fault_reasons) {
    text += (text.empty() ? "" : " ") + std::string(info(reason).name);
  }
  return text;
}

std::string verdict(const Run& run) {
  if (run.crashed) return "CRASHED";
  if (run.judgement.unsafe_fine > Micros{0}) return fmt::format("UNSAFE for {:.1f} ms", ms(run.judgement.unsafe_fine));
  return run.passed() ? "ok"
                      : fmt::format("ends in {}{}", info(run.judgement.last_state).name,
                                    run.judgement.fine_at_end ? "" : ", lines not fine");
}

// Longest time to safe and to recover of both situations; the worse verdict.
struct Both {
  Run held, empty;
  [[nodiscard]] std::string cell() const {
    const Micros safe = std::max(held.judgement.to_safe, empty.judgement.to_safe);
    std::string back = "-";
    if (held.judgement.to_recover && empty.judgement.to_recover) {
      back = fmt::format("{:.0f}", ms(std::max(*held.judgement.to_recover, *empty.judgement.to_recover)));
    }
    const bool good = held.passed() && empty.passed();
    return good ? fmt::format("{:.0f} / {}", ms(safe), back) : "FAILED";
  }
};

void print_row(const Run& run) {
  fmt::print("  {:34} {:>8.0f} {:>8} {:>7.2f} {:20} {}\n", run.name, ms(run.judgement.to_safe), recovered(run),
             ms(run.judgement.fine) / 1e3, verdict(run), reasons(run));
}

class Suite {
 public:
  explicit Suite(long total) : progress_("faults", total) {}

  // False: interrupted.
  bool add(Run run) {
    progress_.update(++done_);
    runs_.push_back(std::move(run));
    return !interrupted();
  }
  void done() { progress_.clear(); }
  [[nodiscard]] const std::vector<Run>& runs() const { return runs_; }
  [[nodiscard]] long failed() const {
    return std::count_if(runs_.begin(), runs_.end(), [](const Run& run) { return !run.passed(); });
  }

 private:
  Progress progress_;
  long done_ = 0;
  std::vector<Run> runs_;
};

const Run* find(const std::vector<Run>& runs, Trouble trouble, bool held) {
  const auto it = std::find_if(runs.begin(), runs.end(), [&](const Run& run) {
    return run.setup.windows.size() == 1 && run.setup.windows[0].trouble == trouble && run.setup.held == held;
  });
  return it == runs.end() ? nullptr : &*it;
}

void print_matrix(const std::vector<Run>& runs) {
  fmt::print("time to safe / time to recover, ms; - : was never unsafe. The worse of object held and empty gel\n{:9}",
             "");
  for (const std::string_view type : faults::kTypeNames) fmt::print(" {:>13}", type);
  fmt::print("\n");
  std::vector<std::string> notes;
  for (std::size_t k = 0; k < faults::cells().size(); ++k) {
    const faults::Cell& cell = faults::cells()[k];
    const std::string_view component = faults::kComponentNames[static_cast<std::size_t>(cell.component)];
    if (k % 7 == 0) fmt::print("{}{:9}", k > 0 ? "\n" : "", component);
    if (!cell.trouble) {
      fmt::print(" {:>13}", "n/a");
      notes.push_back(
          fmt::format("{}/{}: {}", component, faults::kTypeNames[static_cast<std::size_t>(cell.type)], cell.why_not));
      continue;
    }
    const Run* const held = find(runs, *cell.trouble, true);
    const Run* const empty = find(runs, *cell.trouble, false);
    fmt::print(" {:>13}", held != nullptr && empty != nullptr ? Both{*held, *empty}.cell() : "not run");
  }
  fmt::print("\nn/a, not applicable:\n");
  for (const std::string& line : notes) fmt::print("  {}\n", line);
}

void print_rows(const std::vector<Run>& runs) {
  fmt::print("\nfaults from the field\n  {:34} {:>8} {:>8} {:>7} {:20} {}\n", "", "safe ms", "back ms", "fine s", "",
             "reasons");
  for (const faults::Row& row : faults::rows()) {
    fmt::print("{:2} {}\n", row.number, row.fault);
    if (!row.trouble) fmt::print("  n/a: {}\n", row.why_not);
    for (const bool held : {true, false}) {
      const Run* const run = row.trouble ? find(runs, *row.trouble, held) : nullptr;
      if (run != nullptr) print_row(*run);
    }
  }
}

long faults_from_the_field() {
  return std::count_if(faults::rows().begin(), faults::rows().end(),
                       [](const faults::Row& row) { return row.trouble.has_value(); });
}

void print_pairs(const std::vector<Run>& runs) {
  long pairs = 0, failed = 0;
  Micros safe{}, back{};
  for (const Run& run : runs) {
    if (run.setup.windows.size() != 2) continue;
    ++pairs;
    safe = std::max(safe, run.judgement.to_safe);
    back = std::max(back, run.judgement.to_recover.value_or(Micros{0}));
    if (run.passed()) continue;
    ++failed;
    print_row(run);
  }
  fmt::print(
      "\npairs: {} runs ({} pairs of {} faults, each fault with itself among them; with object held and empty gel), {} "
      "failed, longest time to safe {:.0f} ms, to recover {:.0f} ms\n",
      pairs, pairs / 2, faults_from_the_field(), failed, ms(safe), ms(back));
}

// Two fingers: each fault of a camera on either and every other fault, and for a pair each fault of the left one's
// camera with each of the right one's.
bool play_hand(Suite& suite, const FaultsOptions& options) {
  for (int k = 0; k < 2 * faults::kTroubles; ++k) {
    const auto trouble = static_cast<Trouble>(k / 2);
    if (k % 2 == 1 && !faults::is_camera(trouble)) continue;
    for (const bool held : {true, false}) {
      if (!suite.add(faults::play_hand(trouble, k % 2, held))) return false;
    }
  }
  for (const faults::Row& a : faults::rows()) {
    for (const faults::Row& b : faults::rows()) {
      const bool both = options.pairs && a.trouble && b.trouble;
      if (!both || !faults::is_camera(*a.trouble) || !faults::is_camera(*b.trouble)) continue;
      for (const bool held : {true, false}) {
        if (!suite.add(faults::play_hand(*a.trouble, *b.trouble, held))) return false;
      }
    }
  }
  return true;
}

void print_hand(const std::vector<Run>& runs) {
  Micros unsafe{}, safe{}, back{};
  long single = 0;
  for (const Run& run : runs) {
    unsafe += run.judgement.unsafe_fine;
    safe = std::max(safe, run.judgement.to_safe);
    back = std::max(back, run.judgement.to_recover.value_or(Micros{0}));
    const bool is_single = run.setup.windows.size() == 1;
    single += is_single ? 1 : 0;
    if (is_single || !run.passed()) print_row(run);
  }
  fmt::print(
      "two fingers: {} runs of one fault, {} of one on each finger; told \"fine\" against the rule: {:.3f} ms; longest "
      "time to safe {:.0f} ms, to recover {:.0f} ms\n",
      single, static_cast<long>(runs.size()) - single, ms(unsafe), ms(safe), ms(back));
}

bool play_all(Suite& suite, const FaultsOptions& options) {
  if (options.hand) return play_hand(suite, options);
  for (int k = 0; k < faults::kTroubles; ++k) {
    for (const bool held : {true, false}) {
      if (!suite.add(faults::play(static_cast<Trouble>(k), held))) return false;
    }
  }
  if (!options.pairs) return true;
  for (const faults::Row& a : faults::rows()) {
    for (const faults::Row& b : faults::rows()) {
      if (b.number < a.number || !a.trouble || !b.trouble) continue;
      for (const bool held : {true, false}) {
        if (!suite.add(faults::play(*a.trouble, *b.trouble, held))) return false;
      }
    }
  }
  return true;
}

std::string csv_of(const std::vector<Run>& runs) {
  std::string text = "name,unsafe_fine_ms,to_safe_ms,to_recover_ms,fine_s,faults,state,reason,frames,crashed,passed\n";
  for (const Run& run : runs) {
    const faults::Judgement& j = run.judgement;
    text += fmt::format("\"{}\",{:.3f},{:.3f},{},{:.3f},{},{},{},{},{},{}\n", run.name, ms(j.unsafe_fine),
                        ms(j.to_safe), j.to_recover ? fmt::format("{:.3f}", ms(*j.to_recover)) : "", ms(j.fine) / 1e3,
                        j.faults, info(j.last_state).name, info(j.last_reason).name, run.outcome.frames,
                        run.crashed ? 1 : 0, run.passed() ? 1 : 0);
  }
  return text;
}

void print_json(const std::vector<Run>& runs) {
  nlohmann::json out = nlohmann::json::array();
  for (const Run& run : runs) {
    const faults::Judgement& j = run.judgement;
    nlohmann::json row{{"name", run.name},
                       {"unsafe_fine_ms", ms(j.unsafe_fine)},
                       {"to_safe_ms", ms(j.to_safe)},
                       {"to_recover_ms", nullptr},
                       {"fine_s", ms(j.fine) / 1e3},
                       {"faults", j.faults},
                       {"state", info(j.last_state).name},
                       {"frames", run.outcome.frames},
                       {"growth_kb", run.outcome.growth_kb},
                       {"open_files", run.outcome.open_files},
                       {"crashed", run.crashed},
                       {"passed", run.passed()}};
    if (j.to_recover) row["to_recover_ms"] = ms(*j.to_recover);
    for (const Reason reason : j.fault_reasons) row["reasons"].push_back(info(reason).name);
    out.push_back(std::move(row));
  }
  fmt::print("{}\n", text_of_json(out));
}

int soak(const FaultsOptions& options) {
  const faults::Setup setup = faults::soak_setup(options.soak, options.seed);
  const std::size_t troubles = setup.windows.size();
  const Run run = faults::play(fmt::format("soak, seed {}", options.seed), setup);
  if (interrupted()) return fail(interrupted_line());
  const bool leak = run.outcome.growth_kb > 4096 || run.outcome.open_files > 0;
  const bool good = run.passed() && !leak && faults::false_faults(run) <= 1;
  if (options.json) {
    print_json({run});
  } else {
    fmt::print(
        "{} frames of virtual time, {} faults of {} kinds: {}\n"
        "  told \"fine\" against the rule: {:.3f} ms; longest time to safe {:.0f} ms, to recover {:.0f} ms\n"
        "  accepted {} frames; FAULT entered {} times, {} of them without a cause; resident set grew by {} kB, {} "
        "files left open\n",
        options.soak, troubles, faults::kTroubles - 1, good ? "ok" : verdict(run), ms(run.judgement.unsafe_fine),
        ms(run.judgement.to_safe), ms(run.judgement.slowest_recovery), run.outcome.frames, run.judgement.faults,
        faults::false_faults(run), run.outcome.growth_kb, run.outcome.open_files);
  }
  return good ? 0
              : fail(
                    "the soak did not end well. Likely cause: a change of the supervisor or of a driver. "
                    "Next: the same seed plays the same faults again");
}

int run_faults(const FaultsOptions& options) {
  if (options.soak > 0) return soak(options);
  OutputFiles files({{"--csv", options.csv}});
  if (!files.error().empty()) return fail(files.error());
  const long active = faults_from_the_field();
  const auto cameras = std::count_if(faults::rows().begin(), faults::rows().end(), [](const faults::Row& row) {
    return row.trouble && faults::is_camera(*row.trouble);
  });
  constexpr long kOfCamera = static_cast<long>(Trouble::kLostMarkers) + 1;
  Suite suite(options.hand ? 2 * (faults::kTroubles + kOfCamera) + (options.pairs ? 2 * cameras * cameras : 0)
                           : 2L * faults::kTroubles + (options.pairs ? active * (active + 1) : 0));
  if (!play_all(suite, options)) return fail(interrupted_line());
  suite.done();
  if (options.json) {
    print_json(suite.runs());
  } else if (options.hand) {
    print_hand(suite.runs());
    fmt::print("{} runs, {} failed\n", suite.runs().size(), suite.failed());
  } else {
    print_matrix(suite.runs());
    print_rows(suite.runs());
    fmt::print("\nall kinds\n");
    for (const Run& run : suite.runs()) {
      if (run.setup.windows.size() == 1) print_row(run);
    }
    if (options.pairs) print_pairs(suite.runs());
    fmt::print("{} runs, {} failed\n", suite.runs().size(), suite.failed());
  }
  if (std::ostream* const csv = files.stream("--csv")) *csv << csv_of(suite.runs());
  if (const std::string error = files.commit(); !error.empty()) return fail(error);
  if (suite.failed() == 0) return 0;
  return fail(
      fmt::format("{} of {} faults did not end well. Likely cause: a change of the supervisor or of a driver. "
                  "Next: look at the lines that do not end in ok",
                  suite.failed(), suite.runs().size()));
}

}  // namespace

void add_faults(CLI::App& app, std::vector<Command>& commands) {
  const auto options = std::make_shared<FaultsOptions>();
  CLI::App* command = app.add_subcommand(
      "faults", "let everything around the firmware fail, and measure the time to safe and to recover");
  CLI::Option* const pairs = command->add_flag(
      "--pairs", options->pairs, "also every two of the faults from the field at once, and each of them twice");
  CLI::Option* const hand = command->add_flag(
      "--hand", options->hand,
      "of a device of two fingers: each fault of a camera on either finger; with --pairs also each of the "
      "left one's camera with each of the right one's");
  CLI::Option* const csv =
      command->add_option("--csv", options->csv, "write a row per run: CSV; of the soak there is none")
          ->check(not_empty);
  command
      ->add_option("--soak", options->soak,
                   "instead: so many frames with a random fault about every 500; the soak of a release is 2160000")
      ->check(CLI::Range(std::uint64_t{1000}, std::uint64_t{1'000'000'000}))
      ->excludes(pairs)
      ->excludes(hand)
      ->excludes(csv);
  command->add_option("--seed", options->seed, "of the soak")->capture_default_str();
  command->add_flag("--json", options->json, "print a row per run as JSON");
  command->footer(
      "Everything is in virtual time; the judge is another process that reads the lines from shared memory.\n"
      "Example:\n  holdfast faults --pairs --csv faults.csv\n  holdfast faults --soak 100000");
  commands.push_back({command, [options] { return run_faults(*options); }});
}

}  // namespace holdfast::tool
