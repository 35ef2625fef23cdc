// SPDX-License-Identifier: Apache-2.0
#include "drivers/common/folder_notes.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cstddef>

namespace holdfast::drivers {

FolderNotes::FolderNotes(const std::filesystem::path& folder) {
  for (std::size_t k = 0; k < kNames.size(); ++k) paths_[k] = folder / kNames[k];
}

std::string_view FolderNotes::do_read(Of of, std::span<char, kMostBytes> room) {
  // Not through a link, and not for what would keep it waiting.
  const int fd = ::open(paths_[static_cast<std::size_t>(of)].c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
  if (fd < 0) return {};
  const ssize_t size = ::read(fd, room.data(), room.size());
  ::close(fd);
  const std::string_view text(room.data(), size > 0 ? static_cast<std::size_t>(size) : 0);
  return text.substr(0, text.find('\n'));
}

}  // namespace holdfast::drivers
