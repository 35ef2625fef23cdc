// SPDX-License-Identifier: Apache-2.0
// Pictures and films in the formats of others: OpenCV's imgcodecs and videoio, and libavformat.
//
// They are behind an interface because they are loaded when the first file asks for them. On Debian bookworm they bring
// 200 shared libraries, which cost every start of a process 0.25 s (2026-11-28). Videos in containers, images, reports
// and overlays take them; scenes, logs and raw MJPEG do not.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>
#include <optional>
#include <span>
#include <stdexcept>
#include <vector>

namespace holdfast::sim {

// The packets of a container's best video stream, in order.
class Packets {
 public:
  struct Facts {
    bool mjpeg = false;          // a packet is a JPEG picture
    double frames = 0;           // announced, or estimated from the duration
    double fps = 0;              // 0: none
    bool counts_places = false;  // times are places (AVI): a frame that the recorder dropped leaves a gap
  };
  enum class Take : std::uint8_t { kPacket, kCut, kEnd };  // kCut: the packet is not whole

  virtual ~Packets() = default;
  [[nodiscard]] virtual Facts facts() const = 0;
  virtual Take take() = 0;
  // Of the packet taken last; the bytes stay until the next take().
  [[nodiscard]] virtual std::span<const std::uint8_t> bytes() const = 0;
  [[nodiscard]] virtual std::optional<std::int64_t> place() const = 0;  // in the stream's own time base
  [[nodiscard]] virtual std::optional<double> time_s() const = 0;
};

class Media {
 public:
  virtual ~Media() = default;
  // As cv::imread(), imdecode(), imencode() with their flags; an empty picture or false: not an image. May throw
  // cv::Exception, as those.
  [[nodiscard]] virtual cv::Mat read(const std::filesystem::path& path, int flags) const = 0;
  [[nodiscard]] virtual cv::Mat decode(std::span<const std::uint8_t> bytes, int flags) const = 0;
  [[nodiscard]] virtual bool encode(const char* extension, const cv::Mat& picture, std::vector<std::uint8_t>& bytes,
                                    const std::vector<int>& options = {}) const = 0;
  // A reader of films that is not open yet. Its methods are virtual: who calls them links no videoio.
  [[nodiscard]] virtual std::unique_ptr<cv::VideoCapture> capture() const = 0;
  // As the constructor of cv::VideoWriter, for tests of the reader.
  [[nodiscard]] virtual std::unique_ptr<cv::VideoWriter> writer(const std::filesystem::path& path, int backend,
                                                                int codec, double fps, cv::Size size) const = 0;
  // Null: no file that libavformat opens, or it holds no video.
  [[nodiscard]] virtual std::unique_ptr<Packets> packets(const std::filesystem::path& path) const = 0;
};

// The module or a library of it cannot be loaded. what(): one line, with cause and next step.
class MediaMissing : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Loads libholdfast_media.so at the first call, from beside the program or from ../lib/holdfast/modules. Of any thread;
// the first call sets an environment variable. The libraries are silent then, since stderr carries our one line. Throws
// MediaMissing.
[[nodiscard]] const Media& media();

}  // namespace holdfast::sim
