// SPDX-License-Identifier: Apache-2.0
// Pictures and films on disk by OpenCV's readers and writers, which the product loads when it needs them. A test's
// program that was linked to them would wait for 200 libraries whatever test it runs.
#pragma once

#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <vector>

#include "drivers/sim/media.hpp"

namespace holdfast::test {

inline void write_picture(const std::filesystem::path& path, const cv::Mat& picture) {
  std::vector<std::uint8_t> bytes;
  (void)sim::media().encode(path.extension().c_str(), picture, bytes);
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
}

// `codec`: its four characters.
[[nodiscard]] inline std::unique_ptr<cv::VideoWriter> film_writer(const std::filesystem::path& path, const char* codec,
                                                                  double fps, cv::Size size, int api = cv::CAP_FFMPEG) {
  return sim::media().writer(path, api, codec[0] | codec[1] << 8 | codec[2] << 16 | codec[3] << 24, fps, size);
}

[[nodiscard]] inline std::unique_ptr<cv::VideoCapture> film_reader(const std::filesystem::path& path) {
  std::unique_ptr<cv::VideoCapture> reader = sim::media().capture();
  (void)reader->open(path.string(), cv::CAP_FFMPEG);
  return reader;
}

}  // namespace holdfast::test
