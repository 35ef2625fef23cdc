// SPDX-License-Identifier: Apache-2.0
// Memory that outlives the process: a mapped file. On a board it lies under /run, which ends with the power.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>

#include "hal/keep.hpp"

namespace holdfast::drivers {

// A file of a fixed size, made if it is not there. Empty memory when that fails; error() then says why.
class FileKeep final : public hal::Keep {
 public:
  FileKeep(const std::filesystem::path& path, std::size_t bytes);
  ~FileKeep() override;
  FileKeep(const FileKeep&) = delete;
  FileKeep& operator=(const FileKeep&) = delete;

  [[nodiscard]] const std::string& error() const { return error_; }

 private:
  [[nodiscard]] std::span<std::uint8_t> do_memory() override { return memory_; }

  std::span<std::uint8_t> memory_;
  std::string error_;
};

}  // namespace holdfast::drivers
