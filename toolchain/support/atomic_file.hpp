// SPDX-License-Identifier: Apache-2.0
// An output file that appears only when it is complete.
//
// Written as `path.tmp-PID` beside its place and renamed by commit(); without commit() nothing is left
// behind. Refuses what a rename would destroy: a folder, a device (`/dev/null`).
// A Dash::kStandardOutput is not a file named `-`: it is kept in memory and printed by commit(), all of it or nothing.
// Errors are one line: file, what, likely cause, next step. Not for several writers of one path in one process.
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <memory>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

namespace holdfast::tool {

// Whether both names are one file or folder; also for those that do not exist yet, and through links.
[[nodiscard]] bool same_place(const std::filesystem::path& a, const std::filesystem::path& b);

// What the path `-` is.
enum class Dash : std::uint8_t { kFile, kStandardOutput };

class AtomicFile {
 public:
  explicit AtomicFile(std::filesystem::path path, Dash dash = Dash::kFile);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  // Why the file cannot be written, as far as known; empty: good. Ask early, before a long run.
  [[nodiscard]] const std::string& error() const { return error_; }
  [[nodiscard]] std::ostream& stream() { return printed_ ? static_cast<std::ostream&>(*printed_) : stream_; }
  // It is no file.
  [[nodiscard]] bool prints() const { return printed_ != nullptr; }
  // After a write that failed: gives what stands behind the first `length` bytes back to the disk, and the stream goes
  // on from there. Whether it can.
  [[nodiscard]] bool cut(std::uint64_t length);
  // Puts the file in its place. Empty, or the error line.
  [[nodiscard]] std::string commit();

  // Why a write fails, for people.
  static constexpr std::string_view kFullCause = "the disk is full, was taken away, or ulimit -f forbids it";

 private:
  void fail(const std::string& what, const std::string& cause, const std::string& next);

  std::filesystem::path path_;
  std::filesystem::path temp_;
  std::ofstream stream_;
  std::unique_ptr<std::ostringstream> printed_;
  std::string error_;
};

// The files that a command was asked for, open from before a long run to its end: all of them appear, or none.
class OutputFiles {
 public:
  struct Asked {
    std::string_view option;
    std::filesystem::path path;  // empty: not asked for
    Dash dash = Dash::kFile;
  };
  // None may be another one, or one of `inputs`, each of which is `kind` for people. An input that is a folder is read
  // as a whole: a file more in it may be a picture more at the next run.
  explicit OutputFiles(const std::vector<Asked>& asked, const std::vector<std::filesystem::path>& inputs = {},
                       std::string_view kind = "an input");

  // Why they cannot be written, as far as known; empty: good.
  [[nodiscard]] const std::string& error() const { return error_; }
  // Null: not asked for.
  [[nodiscard]] std::ostream* stream(std::string_view option) const;
  // Every byte is written before the first file appears. Empty, or the error line.
  [[nodiscard]] std::string commit();

 private:
  struct Open {
    std::string_view option;
    std::unique_ptr<AtomicFile> file;
  };
  std::vector<Open> files_;
  std::string error_;
};

// Why no folder of outputs can be there, as far as known before a long run; empty: good. It need not exist, the one
// above it must.
[[nodiscard]] std::string refuse_folder(const std::string& folder);

}  // namespace holdfast::tool
