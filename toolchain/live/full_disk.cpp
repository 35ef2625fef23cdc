// SPDX-License-Identifier: Apache-2.0
#include "toolchain/live/full_disk.hpp"

#include <fmt/format.h>

#include "drivers/common/trouble.hpp"

namespace holdfast::live {
namespace {

std::string ended(std::string_view path, std::uint64_t kept) {
  const std::string what =
      kept == 0 ? fmt::format("{}: could not be written, and nothing of it was kept", path)
                : fmt::format("{}: the recording ended early, because a write failed; its first {} {} kept", path, kept,
                              kept == 1 ? "frame is" : "frames are");
  return trouble(what, tool::AtomicFile::kFullCause, "free some space and record again");
}

}  // namespace

std::string keep_what_fits(tool::AtomicFile& file, log::FrameLog& log, std::string_view path) {
  while (const auto length = log.step_back()) {
    // A picture can fill a chunk by itself, before its frame is decided.
    if (log.frames() == 0 || !file.cut(*length)) break;
    log.finish();
    if (!file.stream().flush()) continue;
    std::string error = file.commit();
    return error.empty() ? ended(path, log.frames()) : error;
  }
  return ended(path, 0);
}

std::string keep_what_fits(tool::AtomicFile& file, std::uint64_t end, std::uint64_t rows, std::string_view path) {
  if (rows == 0 || !file.cut(end)) return ended(path, 0);
  std::string error = file.commit();
  return error.empty() ? ended(path, rows) : error;
}

}  // namespace holdfast::live
