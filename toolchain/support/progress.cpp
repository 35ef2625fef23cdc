// SPDX-License-Identifier: Apache-2.0
#include "toolchain/support/progress.hpp"

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

void Progress::clear() {
  if (width_ == 0) return;
  show("");
  fmt::print(stderr, "\r");
  width_ = 0;
}

void Progress::update(long done) {
  if (!terminal_) return;
  const double now = now_s();
  const double elapsed = now - start_s_;
  if (elapsed < 1.0 || now - last_s_ < 0.1) return;
  last_s_ = now;
  if (total_ <= 0) return show(fmt::format("{} {} frames", what_, done));
  const double share = std::clamp(static_cast<double>(done) / static_cast<double>(total_), 0.0, 1.0);
  const auto filled = static_cast<int>(share * 30);
  show(fmt::format("{} [{:#<{}}{:.<{}}] {}/{} {:.0f} s left", what_, "", filled, "", 30 - filled, done, total_,
                   share > 0 ? elapsed * (1 - share) / share : 0.0));
}

void Progress::show(const std::string& text) {
  fmt::print(stderr, "\r{:<{}}", text, width_);
  width_ = std::max(width_, text.size());
}

}  // namespace holdfast::tool
