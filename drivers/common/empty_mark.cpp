// SPDX-License-Identifier: Apache-2.0
#include "drivers/common/empty_mark.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

namespace holdfast::drivers {

EmptyMark::EmptyMark(const std::filesystem::path& path) : path_(path.string()) {
  if (!path_.empty()) (void)::unlink(path_.c_str());
}

void EmptyMark::tell(bool empty, std::uint64_t frames) {
  if (path_.empty()) return;
  if (!empty) {
    if (made_) (void)::unlink(path_.c_str());
    made_ = false;
    return;
  }
  if (made_ && frames - marked_ < kEvery) return;
  marked_ = frames;
  if (made_ && ::utimensat(AT_FDCWD, path_.c_str(), nullptr, AT_SYMLINK_NOFOLLOW) == 0) return;
  const int fd = ::open(path_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0644);
  made_ = fd >= 0;
  if (made_) ::close(fd);
}

}  // namespace holdfast::drivers
