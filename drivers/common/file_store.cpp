// SPDX-License-Identifier: Apache-2.0
#include "drivers/common/file_store.hpp"

#include <algorithm>
#include <system_error>

namespace holdfast::drivers {

FileStore::FileStore(const std::filesystem::path& path, std::size_t slot_bytes, FileCalls& calls,
                     std::span<const std::uint8_t> magic)
    : file_(path, slot_bytes, calls, magic), trouble_(file_.error()), bytes_(slot_bytes) {
  if (!trouble_.empty()) return;
  try {
    thread_ = std::thread([this] { work(); });
  } catch (const std::system_error&) {
    trouble_ =
        path.string() + ": the system gives no thread to write it; nothing can be stored there; end other programs";
  }
}

FileStore::~FileStore() {
  if (!thread_.joinable()) return;
  turn_.fetch_or(kEnd, std::memory_order_release);
  turn_.notify_one();
  thread_.join();
}

void FileStore::do_begin(std::size_t slot, std::span<const std::uint8_t> bytes, bool both) {
  std::copy(bytes.begin(), bytes.end(), bytes_.begin());
  size_ = bytes.size();
  slot_ = slot;
  both_ = both;
  turn_.store(static_cast<std::uint32_t>(State::kBusy), std::memory_order_release);
  turn_.notify_one();
}

hal::Store::State FileStore::do_state() const {
  return static_cast<State>(turn_.load(std::memory_order_acquire) & ~kEnd);
}

// What was begun before the end is written first.
void FileStore::work() {
  while (true) {
    const std::uint32_t turn = turn_.load(std::memory_order_acquire);
    if (static_cast<State>(turn & ~kEnd) == State::kBusy) {
      error_ = file_.write(slot_, std::span(bytes_).first(size_));
      if (error_ == 0 && both_) error_ = file_.write(1 - slot_, std::span(bytes_).first(size_));
      const State now = error_ == 0 ? State::kDone : State::kFailed;
      // kEnd stays, should it have come meanwhile.
      turn_.fetch_xor(static_cast<std::uint32_t>(State::kBusy) ^ static_cast<std::uint32_t>(now),
                      std::memory_order_release);
    } else if ((turn & kEnd) != 0) {
      return;
    } else {
      turn_.wait(turn, std::memory_order_acquire);
    }
  }
}

}  // namespace holdfast::drivers
