// SPDX-License-Identifier: Apache-2.0
// Memory that outlives the firmware inside: of a test, or a mapped file that outlives the process.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "hal/keep.hpp"

namespace holdfast::sim {

class Keep final : public hal::Keep {
 public:
  explicit Keep(std::size_t bytes) : bytes_(bytes) {}

  // What a fault does to it.
  [[nodiscard]] std::span<std::uint8_t> bytes() { return bytes_; }
  void set_off(bool off) { off_ = off; }

 private:
  [[nodiscard]] std::span<std::uint8_t> do_memory() override { return off_ ? std::span<std::uint8_t>{} : bytes_; }

  std::vector<std::uint8_t> bytes_;
  bool off_ = false;
};

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

}  // namespace holdfast::sim
