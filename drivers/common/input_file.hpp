// SPDX-License-Identifier: Apache-2.0
// Files that a user names to be read. To open a pipe waits for a writer, perhaps for ever, and a device may have no
// end: neither is opened.
#pragma once

#include <cerrno>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <system_error>

#include "drivers/common/trouble.hpp"

namespace holdfast::drivers {

// False: what is there is no file. True: whether it could be opened, `in` says.
[[nodiscard]] inline bool open_file(const std::filesystem::path& path, std::ifstream& in) {
  std::error_code ignored;
  const std::filesystem::file_status status = std::filesystem::status(path, ignored);
  if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status)) return false;
  in.open(path, std::ios::binary);
  return true;
}

// Empty: `in` is open; else an error line with `next`.
[[nodiscard]] inline std::string open_file(const std::filesystem::path& path, std::string_view next,
                                           std::ifstream& in) {
  if (!open_file(path, in)) {
    return trouble(path.string() + ": is not a regular file", "a folder, a device or a pipe was given", next);
  }
  if (in) return {};
  return trouble(path.string() + ": cannot be read", std::generic_category().message(errno), next);
}

inline constexpr std::size_t kMostText = 1U << 16U;

// The whole of a file that holds a `what`, which is small. Empty: `bytes` has it; else an error line with `next`.
[[nodiscard]] inline std::string read_file(const std::filesystem::path& path, std::string_view what,
                                           std::string_view next, std::string& bytes,
                                           std::size_t most_bytes = kMostText) {
  std::ifstream in;
  if (std::string wrong = open_file(path, next, in); !wrong.empty()) return wrong;
  bytes.resize(most_bytes + 1);
  in.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  bytes.resize(static_cast<std::size_t>(in.gcount()));
  if (in.bad())
    return trouble(path.string() + ": cannot be read to its end", std::generic_category().message(errno), next);
  if (bytes.size() <= most_bytes) return {};
  return trouble(path.string() + ": is larger than any " + std::string(what), "another file was meant", next);
}

}  // namespace holdfast::drivers
