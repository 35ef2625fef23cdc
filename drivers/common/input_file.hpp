// SPDX-License-Identifier: Apache-2.0
// Files that a user names to be read. To open a pipe waits for a writer, perhaps for ever, and a device may have no
// end: neither is opened.
#pragma once

#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>

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

// As above; empty, or an error line with `next`.
[[nodiscard]] inline std::string open_file(const std::filesystem::path& path, std::string_view next,
                                           std::ifstream& in) {
  if (open_file(path, in)) return {};
  return trouble(path.string() + ": is not a regular file", "a folder, a device or a pipe was given", next);
}

}  // namespace holdfast::drivers
