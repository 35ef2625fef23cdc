// SPDX-License-Identifier: Apache-2.0
// The last N things that happened: memory taken once, so that a run of a million frames does not allocate.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace holdfast::sim {

template <typename T>
class Ring {
 public:
  explicit Ring(std::size_t capacity) : items_(std::max<std::size_t>(capacity, 1)) {}

  void push(const T& item) { items_[static_cast<std::size_t>(total_++ % items_.size())] = item; }
  void clear() { total_ = 0; }

  // How many were pushed, those already overwritten included.
  [[nodiscard]] std::uint64_t total() const { return total_; }
  // How many are still there; operator[] takes 0 (the oldest) to size() - 1 (the newest).
  [[nodiscard]] std::size_t size() const {
    return static_cast<std::size_t>(std::min<std::uint64_t>(total_, items_.size()));
  }
  [[nodiscard]] const T& operator[](std::size_t i) const {
    return items_[static_cast<std::size_t>((total_ - size() + i) % items_.size())];
  }

 private:
  std::vector<T> items_;
  std::uint64_t total_ = 0;
};

}  // namespace holdfast::sim
