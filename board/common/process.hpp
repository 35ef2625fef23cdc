// SPDX-License-Identifier: Apache-2.0
// What holdfastd is on every board: a process with a command line, signals that end it in order, and an output that
// nobody has to read.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "drivers/common/file_keep.hpp"
#include "drivers/common/file_store.hpp"
#include "drivers/common/folder_notes.hpp"
#include "hal/serial.hpp"
#include "hal/verifier.hpp"
#include "params/params.hpp"
#include "slip/model.hpp"

namespace CLI {
class App;
}

namespace holdfast::board {

// Says on standard error what went wrong and returns `status`.
int fail(int status, const std::string& what, const char* likely, const char* next);

// Says a line on standard error: the board's log.
void say(const std::string& line);

// What is kept for the next process, and whether: into the log, each time that this changes. No heap after it was made.
class KeptFile {
 public:
  // Empty path: nothing is kept, and nothing said.
  KeptFile(const std::filesystem::path& path, bool hand);
  [[nodiscard]] hal::Keep& keep();
  void tell();

 private:
  std::string path_;
  std::unique_ptr<drivers::FileKeep> file_;
  hal::NoKeep none_;
  int told_ = 0;
};

// The parameters of a process: those that are stored, and over them those of the command line. And what decides slip.
struct Settings {
  std::filesystem::path path;       // --settings; empty: nothing is stored
  std::vector<std::string> given;   // --set, each name=value
  Params params;                    // after read_settings()
  std::filesystem::path owner_key;  // --owner-key; empty: development mode. Unreadable: nothing is taken
  bool development = false;         // --development
  // After read_settings() as well:
  std::string trouble;                        // why nothing can be stored, or nothing is taken; empty: all is well
  std::unique_ptr<hal::Verifier> owner;       // null: development mode
  bool key_unreadable = false;                // then the owner is nobody
  std::unique_ptr<drivers::FileStore> store;  // null: there is no place

  std::filesystem::path models_path;           // --models; empty: none is stored
  std::unique_ptr<drivers::FileStore> models;  // as `store`
  bool model_loaded = false;
  model::Tree loaded_model;       // when it is
  std::vector<std::string> told;  // what the log is to say of both, a line each
  [[nodiscard]] const model::Tree* model() const { return model_loaded ? &loaded_model : nullptr; }

  std::filesystem::path notes_path;             // --notes; empty: nobody leaves any
  std::unique_ptr<drivers::FolderNotes> notes;  // null: as that
};

// The options --set, --settings, --models, --owner-key, --development and --notes.
void add_settings(CLI::App& cli, Settings& settings);
// Of --empty-file, which all boards have (drivers/common/empty_mark.hpp).
[[nodiscard]] inline const char* empty_file_help() {
  return "make this file, and update its time, while frames are OK and nothing touches the gel";
}
// After the command line was parsed. Empty, or what is wrong.
[[nodiscard]] std::string read_settings(Settings& settings);

// The code that unlocks the console, from a file: its first line. Empty, or what is wrong.
[[nodiscard]] std::string read_code(const std::filesystem::path& path, std::string& code);

// A status to leave with: 0 help was asked for, 2 the command line is wrong.
[[nodiscard]] std::optional<int> parse_command_line(CLI::App& cli, int argc, char** argv);

// From now on SIGTERM, SIGINT and SIGHUP ask the process to end, and neither a reader that has gone nor a file that may
// not grow is a reason to let go.
void heed_signals();
[[nodiscard]] bool asked_to_end();

// A pipe that is full takes the rest of it nowhere.
class StandardOutput final : public hal::Serial {
 private:
  [[nodiscard]] bool do_write(std::span<const std::uint8_t> bytes) override;
  [[nodiscard]] std::size_t do_read(std::span<std::uint8_t>) override { return 0; }
};

}  // namespace holdfast::board
