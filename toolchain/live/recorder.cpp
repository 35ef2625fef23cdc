// SPDX-License-Identifier: Apache-2.0
#include "toolchain/live/recorder.hpp"

#include <chrono>
#include <utility>

#include "drivers/common/trouble.hpp"
#include "toolchain/live/full_disk.hpp"

namespace holdfast::live {
namespace {

std::uint64_t wall_ns() {
  using std::chrono::nanoseconds;
  const auto since = std::chrono::system_clock::now().time_since_epoch();
  return static_cast<std::uint64_t>(std::chrono::duration_cast<nanoseconds>(since).count());
}

}  // namespace

Recorder::Recorder(const std::string& path, std::map<std::string, std::string> about)
    : path_(path), file_(path), about_(std::move(about)) {
  if (error().empty()) thread_ = std::thread([this] { write(); });
}

Recorder::~Recorder() {
  {
    const std::lock_guard lock(mutex_);
    over_ = true;
    waiting_.clear();
  }
  more_.notify_all();
  if (thread_.joinable()) thread_.join();
}

void Recorder::add(const log::FrameRecord& record, std::vector<log::Arrow> arrows, int cols, const hal::Frame& given) {
  if (failed_) return;
  if (log_ == nullptr) {
    const std::uint64_t now_ns = wall_ns();
    log_ = std::make_unique<log::FrameLog>(file_.stream(), now_ns);
    about_["started_unix_ns"] = std::to_string(now_ns);
    about_["started_monotonic_us"] = std::to_string(given.timestamp.count());
  }
  {
    const std::lock_guard lock(mutex_);
    if (bytes_ + given.bytes.size() > kMostWaiting) {
      ++left_out_;
      return;
    }
    Entry entry{record, std::move(arrows), cols, {given.bytes.begin(), given.bytes.end()}, given};
    bytes_ += entry.bytes.size();
    waiting_.push_back(std::move(entry));
    ++frames_;
  }
  more_.notify_all();
}

void Recorder::write() {
  std::unique_lock lock(mutex_);
  while (true) {
    more_.wait(lock, [&] { return over_ || !waiting_.empty(); });
    if (waiting_.empty()) return;
    const Entry entry = std::move(waiting_.front());
    waiting_.pop_front();
    lock.unlock();
    put(entry);
    lock.lock();
    bytes_ -= entry.bytes.size();
    if (!failed_) continue;
    waiting_.clear();
    return;
  }
}

void Recorder::put(const Entry& entry) {
  hal::Frame given = entry.given;
  given.bytes = entry.bytes;
  log_->add(entry.record, entry.arrows, entry.cols, given);
  failed_ = !file_.stream();
}

std::string Recorder::finish() {
  {
    const std::lock_guard lock(mutex_);
    over_ = true;
  }
  more_.notify_all();
  if (thread_.joinable()) thread_.join();
  if (log_ == nullptr) {
    return trouble("no frame came, and nothing was recorded", "the camera does not deliver",
                   "holdfast doctor says what is wrong with it");
  }
  about_["frames_left_out"] = std::to_string(left_out_);
  log_->about(about_);
  if (!failed_) log_->finish();
  if (failed_ || !file_.stream().flush()) return keep_what_fits(file_, *log_, path_);
  return file_.commit();
}

}  // namespace holdfast::live
