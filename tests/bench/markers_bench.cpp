// SPDX-License-Identifier: Apache-2.0
// markers_bench [centres|decision]: from a JPEG to the decision, and from luma to the marker centres, ours against the
// paper's Canny + SimpleBlobDetector, by pairs of blocks (paired.hpp); and how far off both are from the renderer's
// truth.
//
// The rival of the decision is OpenCV's own decoding at 1/8, then Canny and SimpleBlobDetector, tuned to the size of
// the dots (toolchain/trade/rival.hpp): it ends at the blobs, ours at the decision. Two threads count along the
// critical path. Ends with a line for each claim of tests/checks/claims.txt.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "app/app.hpp"
#include "base/math.hpp"
#include "drivers/common/crew.hpp"
#include "drivers/common/jpeg_turbo.hpp"
#include "drivers/sim/camera_scene.hpp"
#include "drivers/sim/scene/scenes.hpp"
#include "tests/bench/paired.hpp"
#include "tests/support/reference.hpp"
#include "toolchain/trade/rival.hpp"
#include "vision/tracker.hpp"

namespace {

using namespace holdfast;
using reference_model::Point;

// ---- Luma to marker centres ----

struct Error {
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
  [[nodiscard]] double rms() const { return std::sqrt(square_sum / static_cast<double>(found)); }
};

void compare_centres(int width, double sigma, bool claimed) {
  constexpr int kFrames = 96;
  scene::PictureConfig config = scene::scaled(scene::cropped_320x240(), width);
  config.noise_sigma = sigma;
  const double scale = width / 320.0;
  const double radius_px = config.dot_diameter_mm * config.px_per_mm / 2;
  cv::SimpleBlobDetector::Params params;
  params.minArea = static_cast<float>(0.3 * M_PI * radius_px * radius_px);
  params.maxArea = static_cast<float>(3.0 * M_PI * radius_px * radius_px);
  params.minDistBetweenBlobs = static_cast<float>(0.4 * 2.02 * config.px_per_mm);
  const auto detector = cv::SimpleBlobDetector::create(params);

  std::vector<std::vector<Point>> truths;
  std::vector<reference_model::Picture> pictures;
  for (int t = 0; t < kFrames; ++t) {
    const auto warp = reference_model::chained(
        reference_model::gaussian({0, 0}, 4.4, 0.32 * std::sin(t * 0.18), 0.25 * std::sin(t * 0.13)),
        reference_model::rotated(1.5 * std::sin(t * 0.11)));
    truths.push_back(reference_model::lattice_px({}, config, warp));
    pictures.push_back(reference_model::picture_of(config, truths.back(), static_cast<std::uint64_t>(t) + 1));
  }
  const auto state = std::make_unique<tracker::State>();
  const tracker::Config tracker_config{};
  reference_model::Picture shown;
  const auto track = [&] { (void)tracker::update(*state, tracker_config, shown.view()); };
  std::vector<cv::KeyPoint> blobs;
  const auto detect = [&] {
    const cv::Mat luma(shown.height, shown.width, CV_8UC1, shown.pixels.data());
    cv::Mat edges;
    cv::Canny(luma, edges, 50, 150);
    blobs.clear();
    detector->detect(luma, blobs);
  };

  Error our_error, rivals_error;
  std::vector<Point> seen;
  for (int t = 0; t < kFrames; ++t) {
    shown = pictures[idx(t)];
    track();
    seen.clear();
    for (int i = 0; i < state->field.grid.count(); ++i) {
      const Marker& marker = state->field.markers[idx(i)];
      if (marker.valid) seen.push_back({marker.x.raw() / 256.0, marker.y.raw() / 256.0});
    }
    our_error.judge(truths[idx(t)], seen, 10 * scale);
    detect();
    seen.clear();
    for (const cv::KeyPoint& b : blobs) seen.push_back({b.pt.x, b.pt.y});
    rivals_error.judge(truths[idx(t)], seen, 10 * scale);
  }

  // Each pair shows both the next frame, forwards and backwards through the film, as a gel moves. A decoder has just
  // written the picture, so it is in the cache.
  int at = kFrames;
  const auto show = [&] {
    const int n = at % (2 * kFrames);
    shown.pixels = pictures[idx(n < kFrames ? n : 2 * kFrames - 1 - n)].pixels;
  };
  bench::Pairs pairs(bench::Pairs::Runs::kOne);
  for (; !pairs.enough(); ++at) pairs.add({detect, nullptr, show}, {track, nullptr, show});
  const bench::Figure ratio = pairs.ratio();
  fmt::print(
      "{}x{}, sigma {}: {} times as fast, {}/{} pairs; {:.1f} and {:.1f} us; rms {:.4f} and {:.4f} px of 320; missed "
      "{} and {}\n",
      config.width, config.height, sigma, ratio.text(), ratio.kept, ratio.tried, pairs.rival_us().median,
      pairs.our_us().median, rivals_error.rms() / scale, our_error.rms() / scale, rivals_error.missed,
      our_error.missed);
  if (!claimed) return;
  fmt::print("markers_speed: {}\nmarkers_error: {:.4f}\nmarkers_rival: {:.2f}\n", ratio.text(), our_error.rms() / scale,
             our_error.rms() / rivals_error.rms());
}

// ---- From JPEG to decision ----

struct Claims {
  bench::Worst one{"decision"}, two{"decision_two_threads"};
  double error = 0;  // the largest
};

// One scene, each frame by all. Empty: done. Otherwise what went wrong, one line.
std::string compare_decisions(double sigma, Claims& claims) {
  sim::Clock clock;
  scene::Scene scene = scene::sphere_slip();
  scene.effects.pixel_noise = sigma;
  drivers::TurboJpegDecoder library;
  hal::Alone alone;
  drivers::Threads threads({.workers = 2});
  tool::TimedCrew two(threads);
  std::vector<jpeg_fast::Worker> workers(3);
  const auto one_thread =
      std::make_unique<EighthDecoder>(EighthDecoder::Config{}, library, std::span(workers).first(1), alone);
  const auto two_threads =
      std::make_unique<EighthDecoder>(EighthDecoder::Config{}, library, std::span(workers).last(2), two);
  struct Ours {
    std::string_view name;
    JpegDecoder& decoder;
    tool::TimedCrew* crew;
    bench::Worst& worst;
    std::unique_ptr<pipeline::State> state = std::make_unique<pipeline::State>();
    bench::Pairs pairs{bench::Pairs::Runs::kOne};
  };
  std::array<Ours, 2> all{
      {{"one thread", *one_thread, nullptr, claims.one}, {"two threads", *two_threads, &two, claims.two}}};
  const pipeline::Config config = pipeline_config(Params{});
  trade::RivalTracker rival(trade::Rival::kBlobs);
  trade::MarkerError rivals_error, our_error;

  hal::Frame frame;
  std::size_t frames = 0, bytes = 0;
  int width = 0, height = 0;
  // The film begins anew until enough pairs count: one in which somebody else took a core does not.
  do {
    sim::SceneCamera camera(scene, clock);
    width = camera.picture().width;
    height = camera.picture().height;
    if (!camera.start()) return "error: the simulated camera does not start (a bug). Next: run the tests";
    for (Ours& ours : all) ours.state = std::make_unique<pipeline::State>();
    for (bool first = true; camera.next(frame, std::chrono::seconds(1)) == hal::Capture::kFrame; first = false) {
      std::vector<scene::PointPx> truth;
      for (const Point& p : camera.marker_centers()) truth.push_back({p.x, p.y});
      if (first) {
        trade::Film film;
        film.shots.emplace_back().markers = truth;
        rival.begin(film);
      }
      ++frames;
      bytes += frame.bytes.size();
      for (Ours& ours : all) {
        pipeline::Result result;
        ours.pairs.add({[&] { rival.update(frame.bytes); }},
                       {[&] { result = pipeline::update(*ours.state, config, ours.decoder, frame); }, ours.crew});
        if (!result.quality.ok()) {
          return fmt::format("error: {}: frame {} is refused: {} (a bug). Next: run the tests", ours.name, frames - 1,
                             info(result.quality.reason).what);
        }
      }
      rival.judge(truth, width, rivals_error);
      our_error.add(all[0].state->tracker.field, truth, 8.0, width);
      camera.release(frame);
    }
  } while (frames > 0 && !std::ranges::all_of(all, [](const Ours& ours) { return ours.pairs.enough(); }));
  if (frames == 0) return "error: the simulated camera gives no frame (no memory?). Next: run the tests";

  const std::string name = fmt::format("s{} q{}", sigma, scene.picture.jpeg_quality);
  fmt::print("JPEG to decision, {}x{} {}, {} kB, {} frames; rms {:.4f} and {:.4f} px of 320; missed {} and {}\n", width,
             height, name, bytes / frames / 1000, frames, rivals_error.rms(), our_error.rms(), rivals_error.missed,
             our_error.missed);
  for (Ours& ours : all) {
    const bench::Figure ratio = ours.pairs.ratio();
    fmt::print("  {:11}: {} times as fast, {}/{} pairs; {:.3f} and {:.3f} ms\n", ours.name, ratio.text(), ratio.kept,
               ratio.tried, ours.pairs.rival_us().median / 1000, ours.pairs.our_us().median / 1000);
    ours.worst.see(ratio, name);
  }
  claims.error = std::max(claims.error, our_error.rms() / rivals_error.rms());
  return {};
}

}  // namespace

int main(int argc, char** argv) {
  const std::string_view part = argc > 1 ? argv[1] : "";
  cv::setNumThreads(1);
  fmt::print("theirs and ours; {}\n", bench::prepare());
  if (part != "centres") {
    Claims claims;
    for (const double sigma : {3.0, 8.0}) {
      if (const std::string error = compare_decisions(sigma, claims); !error.empty()) {
        fmt::print(stderr, "{}\n", error);
        return 1;
      }
    }
    claims.one.print();
    claims.two.print();
    fmt::print("decision_error: {:.3f}\n", claims.error);
  }
  if (part != "decision") {
    compare_centres(320, 2.5, true);
    compare_centres(640, 2.5, false);
    compare_centres(320, 6.0, false);
  }
  return 0;
}
