// SPDX-License-Identifier: Apache-2.0
// Bytes that outlive the process: a file. On a board it lies under /run, which ends with the power.
//
// Written by system calls, not mapped: the file system may be full, and whoever may write the file may cut it while the
// process runs. Through a mapping either is a SIGBUS, at every start anew; here it is a write that is refused. Price: a
// call per record, every two seconds on an empty gel and when the grip force changes, none in other frames (19 kB under
// /run: 4 us).
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>

#include "drivers/common/file_calls.hpp"
#include "hal/keep.hpp"

namespace holdfast::drivers {

// A file of a fixed size, made if it is not there; what is missing of it reads as zeros.
class FileKeep final : public hal::Keep {
 public:
  // `calls` outlives it. `magic`: what it begins with; a file of somebody else's (is_foreign()) stays as it is, and
  // nothing is kept: EEXIST.
  FileKeep(const std::filesystem::path& path, std::size_t bytes, FileCalls& calls = system_calls(),
           std::span<const std::uint8_t> magic = {});
  ~FileKeep() override;
  FileKeep(const FileKeep&) = delete;
  FileKeep& operator=(const FileKeep&) = delete;

  // errno: why nothing is kept at the moment. 0: all is well. A file that is there is tried again with each write.
  [[nodiscard]] int error() const { return error_; }

 private:
  [[nodiscard]] std::size_t do_size() const override { return fd_ >= 0 ? bytes_ : 0; }
  [[nodiscard]] bool do_read(std::size_t at, std::span<std::uint8_t> bytes) override;
  [[nodiscard]] bool do_write(std::size_t at, std::span<const std::uint8_t> bytes) override;
  [[nodiscard]] bool succeeds(std::int64_t result);

  FileCalls& calls_;
  std::size_t bytes_;
  int fd_ = -1;
  int error_ = 0;
};

}  // namespace holdfast::drivers
