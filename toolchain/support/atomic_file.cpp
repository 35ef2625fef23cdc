// SPDX-License-Identifier: Apache-2.0
#include "toolchain/support/atomic_file.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <memory>
#include <system_error>
#include <utility>

namespace holdfast::tool {

namespace fs = std::filesystem;

bool same_place(const std::filesystem::path& a, const std::filesystem::path& b) {
  std::error_code ignored;
  if (std::filesystem::equivalent(a, b, ignored)) return true;
  const std::filesystem::path place = std::filesystem::weakly_canonical(std::filesystem::absolute(a, ignored), ignored);
  return !place.empty() && place == std::filesystem::weakly_canonical(std::filesystem::absolute(b, ignored), ignored);
}

AtomicFile::AtomicFile(fs::path path, Dash dash) : path_(std::move(path)) {
  if (dash == Dash::kStandardOutput && path_ == "-") {
    printed_ = std::make_unique<std::ostringstream>();
    return;
  }
  std::error_code ignored;
  const fs::file_status status = fs::status(path_, ignored);
  if (fs::exists(status) && !fs::is_regular_file(status)) {
    fail("cannot be written", fs::is_directory(status) ? "it is a folder" : "it is a device or pipe",
         "give the name of a file");
    return;
  }
  // A link stays a link: its target is replaced, or made where it is not there yet.
  if (fs::is_symlink(fs::symlink_status(path_, ignored))) {
    const fs::path target =
        fs::exists(status) ? fs::canonical(path_, ignored) : path_.parent_path() / fs::read_symlink(path_, ignored);
    if (!ignored) path_ = target;
  }
  temp_ = path_;
  temp_ += ".tmp-" + std::to_string(::getpid());
  stream_.open(temp_, std::ios::binary | std::ios::trunc);
  if (!stream_) {
    const std::string cause = std::generic_category().message(errno);
    temp_.clear();
    fail("cannot be written", cause, "check the folder and its permissions");
  }
}

AtomicFile::~AtomicFile() {
  stream_.close();
  std::error_code ignored;
  if (!temp_.empty()) fs::remove(temp_, ignored);
}

bool AtomicFile::cut(std::uint64_t length) {
  if (printed_ || temp_.empty()) return false;
  stream_.close();
  stream_.clear();
  std::error_code failed;
  fs::resize_file(temp_, length, failed);
  stream_.open(temp_, std::ios::binary | std::ios::in | std::ios::out | std::ios::ate);
  if (failed) stream_.setstate(std::ios::badbit);
  return stream_.good();
}

std::string AtomicFile::commit() {
  if (!error_.empty()) return error_;
  if (printed_) {
    const std::string text = printed_->str();
    if (std::fwrite(text.data(), 1, text.size(), stdout) == text.size() && std::fflush(stdout) == 0) return {};
    fail("could not be written to its end", "who reads it went away, or the disk is full", "look at what reads it");
    std::clearerr(stdout);  // said here, and not again at the command's end
    return error_;
  }
  stream_.close();
  if (!stream_) {
    fail("could not be written to its end", std::string(kFullCause), "free some space and run again");
    return error_;
  }
  std::error_code ec;
  fs::rename(temp_, path_, ec);
  if (ec) {
    fail("cannot be put in its place", ec.message(), "check the folder and its permissions");
    return error_;
  }
  temp_.clear();
  return {};
}

void AtomicFile::fail(const std::string& what, const std::string& cause, const std::string& next) {
  error_ = path_.string() + ": " + what + ": " + cause + "; " + next;
}

OutputFiles::OutputFiles(const std::vector<Asked>& asked, const std::vector<fs::path>& inputs, std::string_view kind) {
  std::error_code ignored;
  for (auto one = asked.begin(); one != asked.end() && error_.empty(); ++one) {
    const auto& [option, path, dash] = *one;
    if (path.empty()) continue;
    for (const fs::path& input : inputs) {
      if (input.empty()) continue;
      const bool inside =
          fs::is_directory(input, ignored) && same_place(fs::absolute(path, ignored).parent_path(), input);
      if (!inside && !same_place(path, input)) continue;
      error_ = fmt::format(
          "{}: {} would change {}{} of this run. Likely cause: the same name given twice, or an output beside the "
          "pictures. Next: give another place for the output",
          path.string(), option, inside ? "the folder that is " : "", kind);
      return;
    }
    const auto twin = std::find_if(asked.begin(), one, [one](const Asked& other) {
      return !other.path.empty() && same_place(one->path, other.path);
    });
    if (twin != one) {
      error_ = fmt::format(
          "{}: given for both {} and {}. Likely cause: a typing error. Next: give each output a file of its own",
          twin->path.string(), twin->option, option);
      return;
    }
    files_.push_back({option, std::make_unique<AtomicFile>(path, dash)});
    error_ = files_.back().file->error();
  }
}

std::ostream* OutputFiles::stream(std::string_view option) const {
  const auto found = std::ranges::find(files_, option, &Open::option);
  return found == files_.end() ? nullptr : &found->file->stream();
}

std::string OutputFiles::commit() {
  if (!error_.empty()) return error_;
  for (const Open& open : files_) {
    if (!open.file->stream().flush()) return open.file->commit();
  }
  // What is printed goes first: it cannot be taken back, and may fail.
  std::stable_partition(files_.begin(), files_.end(), [](const Open& open) { return open.file->prints(); });
  for (const Open& open : files_) {
    if (std::string error = open.file->commit(); !error.empty()) return error;
  }
  return {};
}

std::string refuse_folder(const std::string& folder) {
  std::error_code ignored;
  fs::path path = fs::absolute(folder);
  if (!path.has_filename()) path = path.parent_path();  // "results/" is a name in the folder that "results" is in
  const bool there = fs::exists(path, ignored);
  if (there ? fs::is_directory(path, ignored) : fs::is_directory(path.parent_path(), ignored)) return {};
  return folder + ": cannot be a folder for the outputs. Likely cause: " +
         (there ? "a file has that name" : "the folder above it is not there") + ". Next: give another place";
}

}  // namespace holdfast::tool
