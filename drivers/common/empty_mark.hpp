// SPDX-License-Identifier: Apache-2.0
// A file that says that nothing is held: for other programs of the board, which must not begin an update while
// something is. It is there while frames are OK and the gel is empty, and its time is set anew every kEvery frames of
// these. Who looks at it believes it only while that time is young: a process that was killed, hangs or has no frames
// cannot remove it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace holdfast::drivers {

class EmptyMark {
 public:
  static constexpr std::uint64_t kEvery = 10;  // 0.4 s at 25 fps

  // Empty path: no file. What an earlier process left is removed: a regular file without a byte. Anything else that is
  // there stays as it is, and none is made; problem() is then an error line.
  explicit EmptyMark(const std::filesystem::path& path);
  [[nodiscard]] const std::string& problem() const { return problem_; }

  // After each step. `frames` counts those that were OK. At most one system call, and none while something is held;
  // takes no memory. A file that cannot be made or removed is left alone: an old one is not believed.
  void tell(bool empty, std::uint64_t frames);

 private:
  std::string path_, problem_;
  bool made_ = false;
  std::uint64_t marked_ = 0;  // the frame of the last mark
};

}  // namespace holdfast::drivers
