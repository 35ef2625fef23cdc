// SPDX-License-Identifier: Apache-2.0
#include "toolchain/trade/rival.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/features2d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

#include "drivers/sim/media.hpp"
#include "toolchain/play/thread_time.hpp"

namespace holdfast::trade {

void MarkerError::add(scene::PointPx seen_at, scene::PointPx truth, double reduction, int width) {
  const double x = (seen_at.x + 0.5) * reduction - 0.5 - truth.x;
  const double y = (seen_at.y + 0.5) * reduction - 0.5 - truth.y;
  square += (x * x + y * y) * (320.0 / width) * (320.0 / width);
  ++seen;
}

void MarkerError::add(const MarkerField& field, std::span<const scene::PointPx> truth, double reduction, int width) {
  for (std::size_t i = 0; i < truth.size(); ++i) {
    const Marker& marker = field.markers[i];
    if (marker.valid) {
      add({marker.x.raw() / 256.0, marker.y.raw() / 256.0}, truth[i], reduction, width);
    } else {
      ++missed;
    }
  }
}

double MarkerError::rms() const {
  return seen > 0 ? std::sqrt(square / static_cast<double>(seen)) : 0.0;
}

struct RivalTracker::State {
  Rival which = Rival::kNone;
  double reduction = 8.0;
  double decode_us = 0.0;
  cv::Ptr<cv::SimpleBlobDetector> detector;
  cv::Mat before;
  std::vector<cv::Point2f> followed;
  std::vector<cv::Point2f> seen;
};

RivalTracker::RivalTracker(Rival which) : state_(std::make_unique<State>()) {
  state_->which = which;
  state_->reduction = which == Rival::kFullBlobs ? 1.0 : 8.0;
  const scene::PictureConfig camera = scene::camera_3280x2464();
  const double px_per_mm = camera.px_per_mm / state_->reduction;
  const double radius_px = camera.dot_diameter_mm * px_per_mm / 2.0;
  const double area = std::numbers::pi * radius_px * radius_px;
  cv::SimpleBlobDetector::Params params;
  params.minArea = static_cast<float>(0.3 * area);
  params.maxArea = static_cast<float>(3.0 * area);
  params.minDistBetweenBlobs = static_cast<float>(0.4 * 2.02 * px_per_mm);
  state_->detector = cv::SimpleBlobDetector::create(params);
}

RivalTracker::~RivalTracker() = default;

int RivalTracker::every() const {
  return state_->which == Rival::kFullBlobs ? 12 : 1;
}

void RivalTracker::begin(const Film& film) {
  cv::setNumThreads(1);
  state_->before.release();
  state_->followed.clear();
  for (const scene::PointPx& p : film.shots.front().markers) {
    state_->followed.emplace_back(static_cast<float>((p.x + 0.5) / state_->reduction - 0.5),
                                  static_cast<float>((p.y + 0.5) / state_->reduction - 0.5));
  }
}

void RivalTracker::update(std::span<const std::uint8_t> jpeg) {
  State& s = *state_;
  const sim::Media& media = sim::media();  // its loading is no decoding
  const double start = tool::thread_us();
  cv::Mat luma =
      media.decode(jpeg, s.which == Rival::kFullBlobs ? cv::IMREAD_GRAYSCALE : cv::IMREAD_REDUCED_GRAYSCALE_8);
  s.decode_us = tool::thread_us() - start;
  s.seen.clear();
  if (s.which == Rival::kFlow) {
    if (!s.before.empty()) {
      std::vector<cv::Point2f> next;
      std::vector<unsigned char> status;
      std::vector<float> error;
      cv::calcOpticalFlowPyrLK(s.before, luma, s.followed, next, status, error, {15, 15}, 2,
                               {cv::TermCriteria::EPS | cv::TermCriteria::COUNT, 10, 0.03});
      s.followed = next;
    }
    s.before = luma;
    s.seen = s.followed;
    return;
  }
  if (s.which == Rival::kBlurredBlobs) cv::GaussianBlur(luma, luma, {5, 5}, 0.0);
  cv::Mat edges;
  cv::Canny(luma, edges, 50, 150);
  std::vector<cv::KeyPoint> blobs;
  s.detector->detect(luma, blobs);
  for (const cv::KeyPoint& blob : blobs) s.seen.push_back(blob.pt);
}

double RivalTracker::decode_us() const {
  return state_->decode_us;
}

void RivalTracker::judge(std::span<const scene::PointPx> truth, int width, MarkerError& error) const {
  const double reach = 10.0 * width / 320.0 / state_->reduction;
  for (const scene::PointPx& at : truth) {
    const double x = (at.x + 0.5) / state_->reduction - 0.5;
    const double y = (at.y + 0.5) / state_->reduction - 0.5;
    const auto distance = [&](const cv::Point2f& p) { return std::hypot(double{p.x} - x, double{p.y} - y); };
    const auto nearest = std::ranges::min_element(state_->seen, {}, distance);
    if (nearest == state_->seen.end() || distance(*nearest) > reach) {
      ++error.missed;
    } else {
      error.add({nearest->x, nearest->y}, at, state_->reduction, width);
    }
  }
}

}  // namespace holdfast::trade
