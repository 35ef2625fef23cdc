// SPDX-License-Identifier: Apache-2.0
// markers_bench [FRAMES]: luma to marker centres, ours against the paper's Canny + SimpleBlobDetector and against
// pyramidal Lucas-Kanade (the vendor's method), interleaved in one run. Prints the median thread CPU time and the error
// against the renderer's truth; ratios are what may be compared between machines.
#include <fmt/format.h>
#include <time.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <vector>

#include "base/math.hpp"
#include "tests/support/reference.hpp"
#include "vision/tracker.hpp"

namespace {

using namespace holdfast;
using reference_model::Point;

double cpu_us() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) * 1e6 + static_cast<double>(now.tv_nsec) * 1e-3;
}

struct Method {
  std::string name;
  std::vector<double> us;
  double square_sum = 0;
  long found = 0;
  long missed = 0;

  void judge(const std::vector<Point>& truth, const std::vector<Point>& seen, double reach_px) {
    for (const Point& dot : truth) {
      double nearest = 1e9;
      for (const Point& p : seen) nearest = std::min(nearest, reference_model::distance(dot, p));
      if (nearest > reach_px) {
        ++missed;
        continue;
      }
      square_sum += nearest * nearest;
      ++found;
    }
  }
  [[nodiscard]] double median_us() {
    std::nth_element(us.begin(), us.begin() + static_cast<std::ptrdiff_t>(us.size() / 2), us.end());
    return us[us.size() / 2];
  }
};

template <typename Work>
void timed(Method& method, Work&& work) {
  const double start = cpu_us();
  work();
  method.us.push_back(cpu_us() - start);
}

cv::Ptr<cv::SimpleBlobDetector> tuned_detector(double dot_area_px, double pitch_px) {
  cv::SimpleBlobDetector::Params params;
  params.minArea = static_cast<float>(0.3 * dot_area_px);
  params.maxArea = static_cast<float>(3.0 * dot_area_px);
  params.minDistBetweenBlobs = static_cast<float>(0.4 * pitch_px);
  return cv::SimpleBlobDetector::create(params);
}

void compare(int width, double sigma, int frames) {
  scene::PictureConfig config = scene::scaled(scene::cropped_320x240(), width);
  config.noise_sigma = sigma;
  const double scale = width / 320.0;
  const double radius_px = config.dot_diameter_mm * config.px_per_mm / 2;
  const auto detector = tuned_detector(M_PI * radius_px * radius_px, 2.02 * config.px_per_mm);

  Method ours{"ours: windows", {}, 0, 0, 0};
  Method blob{"Canny + SimpleBlobDetector", {}, 0, 0, 0};
  Method flow{"pyramidal Lucas-Kanade", {}, 0, 0, 0};
  const auto state = std::make_unique<tracker::State>();
  const tracker::Config tracker_config{};
  cv::Mat before;
  std::vector<cv::Point2f> followed;
  for (int t = 0; t < frames; ++t) {
    const auto warp = reference_model::chained(
        reference_model::gaussian({0, 0}, 4.4, 0.32 * std::sin(t * 0.18), 0.25 * std::sin(t * 0.13)),
        reference_model::rotated(1.5 * std::sin(t * 0.11)));
    const std::vector<Point> truth = reference_model::lattice_px({}, config, warp);
    reference_model::Picture picture = reference_model::picture_of(config, truth, static_cast<std::uint64_t>(t) + 1);
    const cv::Mat luma(picture.height, picture.width, CV_8UC1, picture.pixels.data());

    bool known = state->acquired;
    std::vector<Point> seen;
    timed(ours, [&] { known = tracker::update(*state, tracker_config, picture.view()).ok() && known; });
    for (int i = 0; i < state->field.grid.count(); ++i) {
      const Marker& marker = state->field.markers[idx(i)];
      if (marker.valid) seen.push_back({marker.x.raw() / 256.0, marker.y.raw() / 256.0});
    }
    if (!known) ours.us.pop_back();  // the first frame registers the lattice
    ours.judge(truth, seen, 10 * scale);

    seen.clear();
    std::vector<cv::KeyPoint> blobs;
    timed(blob, [&] {
      cv::Mat edges;
      cv::Canny(luma, edges, 50, 150);
      detector->detect(luma, blobs);
    });
    for (const cv::KeyPoint& b : blobs) seen.push_back({b.pt.x, b.pt.y});
    blob.judge(truth, seen, 10 * scale);

    if (before.empty()) {
      for (const Point& p : truth) followed.emplace_back(static_cast<float>(p.x), static_cast<float>(p.y));
    } else {
      std::vector<cv::Point2f> next;
      std::vector<unsigned char> status;
      std::vector<float> error;
      timed(flow, [&] {
        cv::calcOpticalFlowPyrLK(before, luma, followed, next, status, error, {15, 15}, 2,
                                 {cv::TermCriteria::EPS | cv::TermCriteria::COUNT, 10, 0.03});
      });
      followed = next;
      seen.clear();
      for (const cv::Point2f& p : followed) seen.push_back({p.x, p.y});
      flow.judge(truth, seen, 10 * scale);
    }
    before = luma.clone();
  }
  fmt::print("{}x{}, sigma {}, {} frames of a moving gel\n", config.width, config.height, sigma, frames);
  const double base = ours.median_us();
  const double base_rms = std::sqrt(ours.square_sum / static_cast<double>(ours.found));
  for (Method* m : {&ours, &blob, &flow}) {
    const double rms = std::sqrt(m->square_sum / static_cast<double>(m->found));
    fmt::print("  {:28} {:9.1f} us {:7.1f}x   rms {:.4f} px of 320 ({:.2f}x)   missed {}\n", m->name, m->median_us(),
               m->median_us() / base, rms / scale, rms / base_rms, m->missed);
  }
}

}  // namespace

int main(int argc, char** argv) {
  const int frames = argc > 1 ? std::max(3, std::atoi(argv[1])) : 100;
  cv::setNumThreads(1);
  for (const int width : {320, 410, 640}) compare(width, 2.5, frames);
  compare(320, 6.0, frames);
  return 0;
}
