// SPDX-License-Identifier: Apache-2.0
// A durable place for a record (hal/store.hpp): two slots in a file, and a thread that waits for the card.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "drivers/common/slot_file.hpp"
#include "hal/store.hpp"

namespace holdfast::drivers {

class FileStore final : public hal::Store {
 public:
  // Makes the file unless it is there, and waits until that is durable. Uses the heap; afterwards nothing does.
  // `magic`: what a record begins with; a file that is none of ours stays as it is.
  FileStore(const std::filesystem::path& path, std::size_t slot_bytes, FileCalls& calls = system_calls(),
            std::span<const std::uint8_t> magic = {});
  // Waits for what is under way.
  ~FileStore() override;
  FileStore(const FileStore&) = delete;
  FileStore& operator=(const FileStore&) = delete;

  // Why nothing can be stored; what was stored is found all the same. Empty: it can.
  [[nodiscard]] const std::string& trouble() const { return trouble_; }

 private:
  [[nodiscard]] std::size_t do_slot_bytes() const override { return trouble_.empty() ? file_.slot_bytes() : 0; }
  [[nodiscard]] std::span<const std::uint8_t> do_found(std::size_t slot) const override { return file_.found(slot); }
  [[nodiscard]] bool do_readable(std::size_t slot) const override { return file_.readable(slot); }
  void do_begin(std::size_t slot, std::span<const std::uint8_t> bytes, bool both) override;
  [[nodiscard]] State do_state() const override;
  [[nodiscard]] int do_error() const override { return error_; }
  void work();

  // Whose turn it is: the store's owner writes what is below while it is not kBusy, the thread while it is.
  std::atomic<std::uint32_t> turn_{static_cast<std::uint32_t>(State::kIdle)};
  static constexpr std::uint32_t kEnd = 0x100;

  SlotFile file_;
  std::string trouble_;
  std::vector<std::uint8_t> bytes_;
  std::size_t size_ = 0, slot_ = 0;
  bool both_ = false;
  int error_ = 0;
  std::thread thread_;
};

}  // namespace holdfast::drivers
