// SPDX-License-Identifier: Apache-2.0
#include "toolchain/live/hub.hpp"

#include <algorithm>
#include <utility>

namespace holdfast::live {
namespace {

constexpr std::string_view kLock = "lock\r\n";
constexpr std::string_view kPrompt = "\x1B[K";  // the end of each, where the console echoes

bool begins(std::string_view line, std::string_view word) {
  line.remove_prefix(std::min(line.find_first_not_of(' '), line.size()));
  return line.starts_with(word);
}

}  // namespace

std::shared_ptr<Hub::Listener> Hub::listen(bool controls) {
  auto listener = std::make_shared<Listener>();
  listener->controls_ = controls;
  const std::lock_guard lock(mutex_);
  listeners_.push_back(listener);
  return listener;
}

void Hub::leave(const std::shared_ptr<Listener>& listener) {
  const std::lock_guard lock(mutex_);
  const auto gone = std::remove(listeners_.begin(), listeners_.end(), listener);
  if (gone == listeners_.end()) return;
  listeners_.erase(gone, listeners_.end());
  const bool controlled =
      std::any_of(listeners_.begin(), listeners_.end(), [](const auto& one) { return one->controls_; });
  if (listener->controls_ && !controlled) to_device_ += kLock;
}

bool Hub::hear(Listener& listener, std::string& bytes, Millis at_most) {
  bytes.clear();
  std::unique_lock lock(mutex_);
  heard_.wait_for(lock, at_most, [&] { return ended_ || !listener.waiting_.empty(); });
  std::swap(bytes, listener.waiting_);
  return !ended_;
}

bool Hub::unlocks(std::string_view line) {
  return begins(line, "unlock");
}

bool Hub::say(std::string_view lines) {
  const std::lock_guard lock(mutex_);
  const std::string_view before = unlocks(lines) ? kQuiet : std::string_view{};
  const std::string_view behind = begins(lines, "echo") ? kQuiet : std::string_view{};
  if (to_device_.size() + before.size() + lines.size() + behind.size() > kMostSaid) return false;
  to_device_ += before;
  to_device_ += lines;
  to_device_ += behind;
  return true;
}

std::size_t Hub::listeners() const {
  const std::lock_guard lock(mutex_);
  return listeners_.size();
}

bool Hub::picture_wanted() const {
  const std::lock_guard lock(mutex_);
  return std::chrono::steady_clock::now() - wanted_at_ < std::chrono::seconds{1};
}

void Hub::show(std::uint16_t sequence, std::vector<std::uint8_t> jpeg) {
  {
    const std::lock_guard lock(mutex_);
    picture_ = {sequence, picture_.number + 1, std::move(jpeg)};
  }
  shown_.notify_all();
}

std::optional<Picture> Hub::picture(std::uint64_t after, Millis at_most) {
  std::unique_lock lock(mutex_);
  wanted_at_ = std::chrono::steady_clock::now();
  shown_.wait_for(lock, at_most, [&] { return ended_ || picture_.number > after; });
  wanted_at_ = std::chrono::steady_clock::now();
  if (picture_.number <= after) return std::nullopt;
  return picture_;
}

void Hub::spread(std::span<const std::uint8_t> bytes) {
  {
    const std::lock_guard lock(mutex_);
    for (const auto& listener : listeners_) {
      if (listener->waiting_.size() + bytes.size() > kMostWaiting) listener->waiting_.clear();
      listener->waiting_.append(bytes.begin(), bytes.end());
    }
    for (const std::uint8_t byte : bytes) {
      const auto next = static_cast<std::uint8_t>(kPrompt[prompt_seen_]);
      prompt_seen_ = byte == next ? prompt_seen_ + 1 : static_cast<std::size_t>(byte == kPrompt.front());
      if (prompt_seen_ < kPrompt.size()) continue;
      prompt_seen_ = 0;
      if (!to_device_.ends_with(kQuiet) && to_device_.size() < kMostSaid) to_device_ += kQuiet;
    }
  }
  heard_.notify_all();
}

std::size_t Hub::said(std::span<std::uint8_t> bytes) {
  const std::lock_guard lock(mutex_);
  const std::size_t count = std::min(bytes.size(), to_device_.size());
  std::copy_n(to_device_.begin(), count, bytes.begin());
  to_device_.erase(0, count);
  return count;
}

void Hub::end() {
  {
    const std::lock_guard lock(mutex_);
    ended_ = true;
  }
  heard_.notify_all();
  shown_.notify_all();
}

}  // namespace holdfast::live
