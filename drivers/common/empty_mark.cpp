// SPDX-License-Identifier: Apache-2.0
#include "drivers/common/empty_mark.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include "drivers/common/trouble.hpp"

namespace holdfast::drivers {

EmptyMark::EmptyMark(const std::filesystem::path& path) : path_(path.string()) {
  struct stat there {};
  if (path_.empty() || ::lstat(path_.c_str(), &there) != 0) return;
  if (S_ISREG(there.st_mode) && there.st_size == 0) {
    (void)::unlink(path_.c_str());
    return;
  }
  problem_ = trouble(path_ + ": is another file, and stays as it is: no file says that nothing is held",
                     "a typing error", "give --empty-file another path");
  path_.clear();
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
  const int fd = ::open(path_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644);
  made_ = fd >= 0;
  if (made_) ::close(fd);
}

}  // namespace holdfast::drivers
