// SPDX-License-Identifier: Apache-2.0
// Writes what a running device sees and decides into an MCAP file, beside the loop that must not wait for a disk.
//
// Pictures are the camera's bytes, untouched where they are JPEG; grey ones are encoded, and the file says so
// (log/frame_log.hpp). Times are the wall clock's: that of the first frame, and the camera's own steps from there.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "hal/camera.hpp"
#include "toolchain/log/frame_log.hpp"
#include "toolchain/log/messages.hpp"
#include "toolchain/support/atomic_file.hpp"

namespace holdfast::live {

class Recorder {
 public:
  // Of pictures that wait for the disk: two seconds of the sensor's.
  static constexpr std::size_t kMostWaiting = 64U << 20U;

  // `about`: what the file is to say of itself.
  Recorder(const std::string& path, std::map<std::string, std::string> about);
  ~Recorder();
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  // Why there can be no file; empty: there can.
  [[nodiscard]] const std::string& error() const { return file_.error(); }
  // `given`: of the camera, with its bytes.
  void add(const log::FrameRecord& record, std::vector<log::Arrow> arrows, int cols, const hal::Frame& given);
  // A write failed, and no frame is taken any more: for finish() to say, now.
  [[nodiscard]] bool failed() const { return failed_; }
  // Writes what waits and puts the file in its place; of one whose disk is full, what fits. Empty, or the error line.
  [[nodiscard]] std::string finish();

  [[nodiscard]] long frames() const { return frames_; }
  // That found no room, because the disk is slower than the camera.
  [[nodiscard]] long left_out() const { return left_out_; }

 private:
  struct Entry {
    log::FrameRecord record;
    std::vector<log::Arrow> arrows;
    int cols = 0;
    std::vector<std::uint8_t> bytes;
    hal::Frame given;
  };
  void write();
  void put(const Entry& entry);

  std::string path_;
  tool::AtomicFile file_;
  std::map<std::string, std::string> about_;
  std::unique_ptr<log::FrameLog> log_;
  std::mutex mutex_;
  std::condition_variable more_;
  std::deque<Entry> waiting_;
  std::size_t bytes_ = 0;
  bool over_ = false;
  std::atomic<bool> failed_ = false;
  long frames_ = 0, left_out_ = 0;
  std::thread thread_;
};

}  // namespace holdfast::live
