// SPDX-License-Identifier: Apache-2.0
// Recordings from disk, as a camera would have sent them.
//
// Inputs: any video file that libavformat or OpenCV's videoio opens, a folder of images in natural order (img2 before
// img10), a single image, a raw concatenated MJPEG stream, or JPEG pictures at known places of any file.
// MJPEG content (a stream, AVI or another container, a folder of JPEG files) comes out as the original JPEG
// bytes; everything else as 8-bit BT.601 luma, reduced by the smallest integer box mean that fits the working
// image (kMaxLumaWidth x kMaxLumaHeight). Errors are one line: file, what, likely cause, next step. No exception leaves
// this file. Not for live streams or pipes: the size of the file must be known.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "base/units.hpp"
#include "hal/camera.hpp"

namespace holdfast::sim {

struct Error {
  std::string line;
};

template <typename T>
using Result = std::variant<T, Error>;

// Where a JPEG picture lies in its file, and when it was taken.
struct StampedPicture {
  std::size_t offset = 0;
  std::size_t size = 0;
  Micros time{};
};

struct RecordingOptions {
  // Time base of inputs that carry none; 0: kDefaultFps. Of a container that carries one, instead of it: a frame keeps
  // its place, gaps with it. The stamps of `pictures` stay.
  double fps = 0;
  // For files that the caller can read and this one cannot (logs): the pictures in them. Null: the file is looked at.
  std::shared_ptr<const std::vector<StampedPicture>> pictures = nullptr;
};

inline constexpr double kDefaultFps = 25;  // the sensor's nominal rate

struct RecordingInfo {
  int width = 0;                       // pixels of the input
  int height = 0;                      // pixels of the input
  long frames = -1;                    // as far as known without reading to the end; -1: unknown
  double fps = 0;                      // carried by the container, whatever was asked for; 0: none
  double time_base_fps = kDefaultFps;  // at which it is played: asked for, the container's, or the nominal one
  bool mjpeg = false;                  // frames are JPEG bytes
  bool stamped = false;                // each frame has a time of its own, whatever rate was asked for
  double scale = 1;  // input pixels per delivered pixel: x_in = (x + 0.5) * scale - 0.5; 1 for JPEG bytes
};

struct RecordedFrame {
  hal::PixelFormat format = hal::PixelFormat::kLuma8;
  std::vector<std::uint8_t> bytes;  // one JPEG stream, or height rows of width luma bytes
  int width = 0;                    // delivered pixels; JPEG: from its header, 0 when that is damaged
  int height = 0;
  int input_width = 0;  // pixels of the input, before reduction
  int input_height = 0;
  long index = 0;              // counts the frames of the recording from 0
  std::uint32_t sequence = 0;  // counts what the camera sent: jumps where the container marks a dropped frame
  Micros time{};               // since the first frame, as stamped: it may stand still, run backwards or jump
  bool damaged = false;        // the JPEG bytes have no end: cut off by the end of the file or by the next picture
};

// The same as the HAL hands it out; borrows the bytes. Stamped with the recording's own time.
[[nodiscard]] inline hal::Frame as_frame(const RecordedFrame& recorded) {
  const bool luma = recorded.format == hal::PixelFormat::kLuma8;
  return {recorded.bytes, recorded.format,  recorded.width, recorded.height, luma ? recorded.width : 0,
          recorded.time,  recorded.sequence};
}

enum class Read : std::uint8_t {
  kFrame,
  kEnd,    // the recording was read to its announced end
  kError,  // it was not: see error()
};

class Recording {
 public:
  [[nodiscard]] static Result<Recording> open(const std::filesystem::path& path, RecordingOptions options = {});
  Recording(const Recording&) = delete;
  Recording& operator=(const Recording&) = delete;
  Recording(Recording&&) noexcept;
  Recording& operator=(Recording&&) noexcept;
  ~Recording();

  [[nodiscard]] const RecordingInfo& info() const { return info_; }
  [[nodiscard]] double scale() const { return info_.scale; }
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

  // The next frame in order; `frame`'s memory is reused.
  [[nodiscard]] Read next(RecordedFrame& frame);
  // Why next() said kError: one line.
  [[nodiscard]] const std::string& error() const { return error_; }
  // Starts again at the first frame; false: the file is no longer what it was (see error()).
  [[nodiscard]] bool rewind();
  // The frame named "first", "last" or by its number from 0. Leaves the order of next() alone.
  // Price: reads from the start, because seeking in compressed video lands on key frames.
  [[nodiscard]] Result<RecordedFrame> at(std::string_view which) const;

  class Source;

 private:
  Recording(std::filesystem::path path, RecordingOptions options, RecordingInfo info, std::unique_ptr<Source> source);

  std::filesystem::path path_;
  RecordingOptions options_;
  RecordingInfo info_;
  std::unique_ptr<Source> source_;
  std::string error_;
  long count_ = 0;
  Micros last_time_{};
  double first_pts_s_ = 0;
};

// One image file, for instance as the reference of the empty gel. JPEG files come as bytes, unless `jpeg_as` asks for
// luma; all others as luma reduced by `reduce` (0: the smallest factor that fits the working image).
[[nodiscard]] Result<RecordedFrame> read_picture(const std::filesystem::path& path, int reduce = 0,
                                                 hal::PixelFormat jpeg_as = hal::PixelFormat::kMjpeg);

}  // namespace holdfast::sim
