// SPDX-License-Identifier: Apache-2.0
#include "board/common/process.hpp"

#include <poll.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cerrno>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <vector>

#include "drivers/common/ed25519.hpp"
#include "drivers/common/end_signals.hpp"
#include "drivers/common/input_file.hpp"
#include "store/checkpoint.hpp"
#include "store/models.hpp"
#include "store/settings.hpp"
#include "store/slot_store.hpp"

namespace holdfast::board {
namespace {

// Any thread may take the signal.
std::atomic<bool> stop_requested{false};
static_assert(std::atomic<bool>::is_always_lock_free, "a handler may touch no other");

constexpr auto kCheckpointMagic = std::bit_cast<std::array<std::uint8_t, 4>>(checkpoint::kMagic);

// What --set refuses, for CLI11; empty: it was taken.
std::string set(Params& params, const std::string& setting) {
  const std::size_t equals = setting.find('=');
  if (equals == std::string::npos) return "'" + setting + "' is not of the form NAME=VALUE";
  ParamProblem problem;
  if (parse(setting.substr(0, equals), setting.substr(equals + 1), params, &problem).ok()) return {};
  std::string text = "'" + setting + "': " + std::string(problem.rule);
  if (problem.row != nullptr) {
    text += " (" + std::to_string(problem.row->min) + " to " + std::to_string(problem.row->max);
    text += problem.row->unit.empty() ? ")" : " " + std::string(problem.row->unit) + ")";
  }
  return text;
}

// A key that was asked for and is not there, or cannot be read, must not open the device: nothing stored is taken then.
// Empty, or what is wrong.
std::string read_owner(Settings& settings) {
  settings.owner.reset();
  settings.key_unreadable = false;
  if (settings.development || settings.owner_key.empty()) return {};
  drivers::Ed25519::Key key{};
  std::string wrong = drivers::read_public_key(settings.owner_key, key);
  if (wrong.empty()) {
    settings.owner = std::make_unique<drivers::Ed25519>(key);
  } else {
    settings.owner = std::make_unique<hal::NoOwner>();
    settings.key_unreadable = true;
    wrong += "; no stored settings and no stored model are taken";
  }
  return wrong;
}

void add_trouble(Settings& settings, const drivers::FileStore& store) {
  if (store.trouble().empty()) return;
  settings.trouble += (settings.trouble.empty() ? "cannot use " : "; cannot use ") + store.trouble();
}

template <typename Info>
std::string words(const Info& why) {
  std::string text(why.what);
  return text.append(". Likely cause: ").append(why.cause).append(". Next: ").append(why.next);
}

// Why a slot has no model; empty: it has one, or nothing was ever stored there.
std::string look_at(std::span<const std::uint8_t> slot, const hal::Verifier* owner) {
  if (std::all_of(slot.begin(), slot.end(), [](std::uint8_t byte) { return byte == 0; })) return {};
  sealed::Record record;
  if (const sealed::Refusal why = sealed::read(slot, sealed::Kind::kModel, owner, record);
      why != sealed::Refusal::kNone) {
    return words(sealed::info(why));
  }
  const model_file::Refusal why = models::refusal_of(record.payload);
  return why == model_file::Refusal::kNone ? std::string{} : words(model_file::info(why));
}

// For the log: which settings count, and why not all that were stored.
void tell_of_settings(Settings& settings, const SlotStore& slots, settings::Found found) {
  const std::string path = settings.path.string();
  for (std::size_t k = 0; k < hal::Store::kSlots && !settings.key_unreadable; ++k) {
    const SlotStore::Slot& slot = slots.slot(k);
    if (slot.damaged())
      settings.told.push_back("slot " + std::to_string(k + 1) + " of " + path + ": " + std::string(words(slot)));
  }
  if (found == settings::Found::kWhole) return;
  const std::string from = "the settings in force are " + std::string(settings::info(found).from);
  settings.told.push_back(settings::lost(found) ? from + ": FAULT is held. " + words(info(Reason::kConfig)) : from);
}

// The newest model that is good; the device starts without one, too, and holds FAULT where one is damaged.
void read_models(Settings& settings) {
  if (settings.models_path.empty()) return;
  settings.models = std::make_unique<drivers::FileStore>(settings.models_path, models::kMostBytes,
                                                         drivers::system_calls(), sealed::kMagic);
  add_trouble(settings, *settings.models);
  const SlotStore slots(sealed::Kind::kModel, models::good, settings.models.get(), settings.owner.get());
  settings.model_loaded = models::in_force(slots, settings.loaded_model) != nullptr;
  bool told = false;
  // Without the key every signature would be told as a stranger's.
  for (std::size_t slot = 0; slot < hal::Store::kSlots && !settings.key_unreadable; ++slot) {
    const std::string wrong = look_at(settings.models->found(slot), settings.owner.get());
    if (wrong.empty()) continue;
    settings.told.push_back("slot " + std::to_string(slot + 1) + " of " + settings.models_path.string() + ": " + wrong);
    told = true;
  }
  if (settings.model_loaded) {
    settings.told.push_back("the loaded model " + std::string(model::name_of(settings.loaded_model)) +
                            " decides, number " + std::to_string(slots.sequence()));
  } else if (told || slots.sequence() != 0) {
    settings.told.emplace_back("the model that is compiled in decides");
  }
  if (slots.damaged())
    settings.told.push_back("a stored model is damaged: FAULT is held. " + words(info(Reason::kConfig)));
}

}  // namespace

void say(const std::string& line) {
  (void)std::fputs(("holdfastd: " + line + "\n").c_str(), stderr);
}

int fail(int status, const std::string& what, const char* likely, const char* next) {
  const std::string line = "holdfastd: " + what + ". Likely cause: " + likely + ". Next: " + next + "\n";
  (void)std::fputs(line.c_str(), stderr);
  return status;
}

KeptFile::KeptFile(const std::filesystem::path& path, bool hand)
    : path_(path.string()),
      file_(path.empty() ? nullptr
                         : std::make_unique<drivers::FileKeep>(path, hand ? checkpoint::kHandBytes : checkpoint::kBytes,
                                                               drivers::system_calls(), kCheckpointMagic)) {}

hal::Keep& KeptFile::keep() {
  if (file_) return *file_;
  return none_;
}

void KeptFile::tell() {
  if (!file_ || file_->error() == told_) return;
  told_ = file_->error();
  std::array<char, 600> line{};
  const char* const format =
      told_ == EEXIST
          ? "holdfastd: %s: is another file, and stays as it is: the rest position and the grip are not kept. Likely "
            "cause: a typing error. Next: give --keep another path\n"
      : told_ == 0
          ? "holdfastd: %s: the rest position and the grip are kept again\n"
          : "holdfastd: %s: %s: the rest position and the grip are not kept; the next process learns the gel "
            "anew. Likely cause: the file system is full, or the folder is not there or not this user's. Next: "
            "free some space there (df shows it), or give --keep another path\n";
  (void)std::snprintf(line.data(), line.size(), format, path_.c_str(), std::strerror(told_));
  (void)(::write(STDERR_FILENO, line.data(), std::strlen(line.data())) >= 0);
}

void add_settings(CLI::App& cli, Settings& settings) {
  cli.add_option_function<std::vector<std::string>>(
         "--set",
         [&settings](const std::vector<std::string>& all) {
           for (const std::string& setting : all) {
             Params tried;
             if (const std::string wrong = set(tried, setting); !wrong.empty()) {
               throw CLI::ValidationError("--set " + wrong);
             }
             settings.given.push_back(setting);
           }
         },
         "set a parameter: name=value; may be given again. Goes before what is stored")
      ->allow_extra_args(false);
  cli.add_option("--settings", settings.path, "keep the parameters that the console saves in this file");
  cli.add_option("--models", settings.models_path,
                 "keep the model that the console loads in this file, and decide by it from the next start on");
  cli.add_option("--owner-key", settings.owner_key,
                 "take only what is signed with the other half of this key (holdfast settings keygen), and nothing "
                 "when it cannot be read; without this option the device is in development mode");
  cli.add_flag("--development", settings.development, "development mode: take unsigned settings and models, too");
  cli.add_option("--notes", settings.notes_path, "the folder from which the console reports release and updates");
}

std::string read_settings(Settings& settings) {
  settings.params = {};
  const auto place = [](const std::filesystem::path& path) {
    return std::filesystem::absolute(path).lexically_normal();
  };
  if (!settings.path.empty() && !settings.models_path.empty() && place(settings.path) == place(settings.models_path)) {
    return "--models: names the file of --settings, and each needs one of its own";
  }
  settings.trouble = read_owner(settings);
  if (!settings.path.empty()) {
    settings.store = std::make_unique<drivers::FileStore>(settings.path, settings::kMostBytes, drivers::system_calls(),
                                                          sealed::kMagic);
    add_trouble(settings, *settings.store);
    const SlotStore slots(sealed::Kind::kSettings, settings::good, settings.store.get(), settings.owner.get());
    tell_of_settings(settings, slots, settings::take(slots, settings.params));
  }
  read_models(settings);
  if (!settings.notes_path.empty()) settings.notes = std::make_unique<drivers::FolderNotes>(settings.notes_path);
  for (const std::string& setting : settings.given) (void)set(settings.params, setting);
  if (ParamProblem problem; !validate(settings.params, &problem).ok()) {
    return "--set: " + std::string(problem.row->name) + " is " + std::string(problem.rule);
  }
  return {};
}

std::string read_code(const std::filesystem::path& path, std::string& code) {
  constexpr std::size_t kShortest = 6, kLongest = 64;
  std::ifstream in;
  if (!drivers::open_file(path, in)) return "the code " + path.string() + " is not a regular file";
  if (!in || !std::getline(in, code)) return "cannot read the code from " + path.string();
  while (!code.empty() && (code.back() == '\r' || code.back() == ' ')) code.pop_back();
  const bool plain = std::all_of(code.begin(), code.end(), [](char c) { return c > ' ' && c < 0x7F; });
  if (plain && code.size() >= kShortest && code.size() <= kLongest) return {};
  return "the code in " + path.string() + " is not 6 to 64 characters without blanks";
}

std::optional<int> parse_command_line(CLI::App& cli, int argc, char** argv) {
  cli.set_version_flag("--version", "holdfastd " HOLDFAST_VERSION);
  try {
    cli.parse(argc, argv);
  } catch (const CLI::Success& help) {
    return cli.exit(help);
  } catch (const CLI::ParseError& error) {
    const auto rest = cli.remaining();
    return fail(2, rest.empty() ? error.what() : "'" + rest.front() + "' is not known to holdfastd", "a typing error",
                "holdfastd --help shows the options");
  }
  return std::nullopt;
}

void heed_signals() {
  heed_end_signals([](int) { stop_requested = true; });
  struct sigaction never {};
  never.sa_handler = SIG_IGN;
  ::sigaction(SIGPIPE, &never, nullptr);
}

bool asked_to_end() {
  return stop_requested;
}

bool StandardOutput::do_write(std::span<const std::uint8_t> bytes) {
  pollfd out{STDOUT_FILENO, POLLOUT, 0};
  if (::poll(&out, 1, 0) != 1 || (out.revents & POLLOUT) == 0) return false;
  return ::write(STDOUT_FILENO, bytes.data(), bytes.size()) == static_cast<ssize_t>(bytes.size());
}

}  // namespace holdfast::board
