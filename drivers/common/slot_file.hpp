// SPDX-License-Identifier: Apache-2.0
// Two slots in a file, whose bytes outlive a power cut once write() has said so.
//
// The slots lie kApart bytes or a multiple of it from each other: no sector, block or page is shared, so that a write
// that the power cuts harms the slot that it is meant for and nothing else. The file has its full size from the first
// start on: a later write changes no metadata, and a full card cannot refuse it where the file system writes in place.
//
// Before anything is read, all that an earlier process may have left in the page cache, and the file's name, are made
// durable: a record that is believed now may not be lost by the power, because the next write goes over the other slot.
//
// A file of somebody else's is refused as it is: neither padded nor written.
//
// Limits: the medium must not harm what it does not write (a card that loses whole erase blocks does); and after an
// error of the medium Linux may go on showing bytes that are not on it, until the machine starts anew.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "drivers/common/file_calls.hpp"

namespace holdfast::drivers {

class SlotFile {
 public:
  static constexpr std::size_t kApart = 4096;

  // Uses the heap; afterwards nothing does. `calls` outlives it. `magic`: what a slot begins with (is_foreign()).
  SlotFile(const std::filesystem::path& path, std::size_t slot_bytes, FileCalls& calls,
           std::span<const std::uint8_t> magic = {});
  ~SlotFile();
  SlotFile(const SlotFile&) = delete;
  SlotFile& operator=(const SlotFile&) = delete;

  // Why nothing can be written; what could be read is there all the same. Empty: it can.
  [[nodiscard]] const std::string& error() const { return error_; }
  [[nodiscard]] std::size_t slot_bytes() const { return slot_bytes_; }
  // As it was at the start; zeros where the file was shorter.
  [[nodiscard]] std::span<const std::uint8_t> found(std::size_t slot) const { return found_[slot]; }
  // False: the file cannot be opened, or its medium did not give the slot's bytes.
  [[nodiscard]] bool readable(std::size_t slot) const { return readable_[slot]; }
  // Over the beginning of a slot. 0: the bytes are durable; otherwise errno. Range: slot 0 or 1, up to slot_bytes().
  [[nodiscard]] int write(std::size_t slot, std::span<const std::uint8_t> bytes);

 private:
  [[nodiscard]] int make_durable(const std::filesystem::path& path);
  [[nodiscard]] int write_at(std::size_t at, std::span<const std::uint8_t> bytes);
  [[nodiscard]] int read();

  FileCalls& calls_;
  std::size_t slot_bytes_;
  std::size_t apart_;
  int fd_ = -1;
  std::array<std::vector<std::uint8_t>, 2> found_;
  std::array<bool, 2> readable_{};
  std::string error_;
};

}  // namespace holdfast::drivers
