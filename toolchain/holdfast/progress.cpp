// SPDX-License-Identifier: Apache-2.0
#include "toolchain/holdfast/progress.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <utility>

namespace holdfast::tool {
namespace {

double now_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace

Progress::Progress(std::string what, long total)
    : what_(std::move(what)), total_(total), terminal_(isatty(STDERR_FILENO) == 1), start_s_(now_s()) {}

Progress::~Progress() {
  if (shown_) fmt::print(stderr, "\r\033[K");
}

void Progress::update(long done) {
  if (!terminal_) return;
  const double now = now_s();
  const double elapsed = now - start_s_;
  if (elapsed < 1.0 || now - last_s_ < 0.1) return;
  last_s_ = now;
  shown_ = true;
  if (total_ <= 0) {
    fmt::print(stderr, "\r{} {} frames \033[K", what_, done);
    return;
  }
  const double share = std::clamp(static_cast<double>(done) / static_cast<double>(total_), 0.0, 1.0);
  const auto filled = static_cast<int>(share * 30);
  fmt::print(stderr, "\r{} [{:#<{}}{:.<{}}] {}/{} {:.0f} s left \033[K", what_, "", filled, "", 30 - filled, done,
             total_, share > 0 ? elapsed * (1 - share) / share : 0.0);
}

}  // namespace holdfast::tool
