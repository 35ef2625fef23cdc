// SPDX-License-Identifier: Apache-2.0
#include "toolchain/session/overlay.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "drivers/sim/media.hpp"

namespace holdfast::tool {
namespace {

const cv::Scalar kYellow{40, 225, 255}, kRed{50, 50, 235}, kBlack{0, 0, 0}, kWhite{255, 255, 255};
constexpr int kShift = 6;  // OpenCV draws in fixed point: 1/64 px

class Canvas {
 public:
  Canvas(const cv::Mat& picture, int zoom) : zoom_(zoom), line_(std::max(2, picture.cols * zoom / 480)) {
    cv::resize(picture, image_, cv::Size(), zoom, zoom, zoom > 1 ? cv::INTER_CUBIC : cv::INTER_NEAREST);
    if (image_.channels() == 1) cv::cvtColor(image_, image_, cv::COLOR_GRAY2BGR);
  }

  // Dark edges keep the yellow readable on bright gel.
  void arrow(double x, double y, double dx, double dy) {
    const double length = std::hypot(dx, dy) * zoom_;
    if (length < 1) return;
    const double head = std::min(0.35 * length, 6.0 * line_) / length;
    for (const auto& [colour, width] : {std::pair{kBlack, line_ + 2}, std::pair{kYellow, line_}}) {
      const double tip_x = x + dx, tip_y = y + dy;
      line(x, y, tip_x, tip_y, colour, width);
      for (const double side : {-0.5, 0.5}) {
        line(tip_x, tip_y, tip_x - head * (dx + side * dy), tip_y - head * (dy - side * dx), colour, width);
      }
    }
  }

  void dot(double x, double y) {
    cv::circle(image_, point(x, y), (2 * line_) << kShift, kBlack, cv::FILLED, cv::LINE_AA, kShift);
    cv::circle(image_, point(x, y), (2 * line_ - 2) << kShift, kYellow, cv::FILLED, cv::LINE_AA, kShift);
  }

  void cross(double x, double y) {
    const double arm = 4.0 * line_ / zoom_;
    for (const auto& [colour, width] : {std::pair{kBlack, line_ + 3}, std::pair{kRed, line_ + 1}}) {
      line(x - arm, y - arm, x + arm, y + arm, colour, width);
      line(x - arm, y + arm, x + arm, y - arm, colour, width);
    }
  }

  void caption(const std::string& text) {
    const double size = 0.4 * line_;
    const cv::Point at(6 * line_, image_.rows - 6 * line_);
    cv::putText(image_, text, at, cv::FONT_HERSHEY_SIMPLEX, size, kBlack, line_ + 3, cv::LINE_AA);
    cv::putText(image_, text, at, cv::FONT_HERSHEY_SIMPLEX, size, kWhite, line_, cv::LINE_AA);
  }

  [[nodiscard]] const cv::Mat& image() const { return image_; }

 private:
  [[nodiscard]] cv::Point point(double x, double y) const {
    const auto fixed = [&](double v) { return cv::saturate_cast<int>(((v + 0.5) * zoom_ - 0.5) * (1 << kShift)); };
    return {fixed(x), fixed(y)};
  }
  void line(double x0, double y0, double x1, double y1, const cv::Scalar& colour, int width) {
    cv::line(image_, point(x0, y0), point(x1, y1), colour, width, cv::LINE_AA, kShift);
  }

  int zoom_;
  int line_;  // width of a line in pixels of the output
  cv::Mat image_;
};

}  // namespace

std::string write_overlay(std::ostream& out, const cv::Mat& picture, std::span<const Arrow> arrows, double factor) {
  try {
    Canvas canvas(picture, std::max(1, (kOverlayWidth + picture.cols - 1) / std::max(1, picture.cols)));
    for (const Arrow& a : arrows) {
      if (a.valid) canvas.arrow(a.x_px - a.dx_px, a.y_px - a.dy_px, factor * a.dx_px, factor * a.dy_px);
    }
    for (const Arrow& a : arrows) a.valid ? canvas.dot(a.x_px, a.y_px) : canvas.cross(a.x_px, a.y_px);
    const auto lost = std::count_if(arrows.begin(), arrows.end(), [](const Arrow& a) { return !a.valid; });
    canvas.caption(fmt::format("displacement x {:g}", factor) + (lost > 0 ? fmt::format(", {} lost", lost) : ""));
    std::vector<unsigned char> bytes;
    (void)sim::media().encode(".png", canvas.image(), bytes);
    out.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  } catch (const cv::Exception& problem) {
    return fmt::format("the picture cannot be drawn: {}; report it with the input", problem.err);
  }
  return {};
}

}  // namespace holdfast::tool
