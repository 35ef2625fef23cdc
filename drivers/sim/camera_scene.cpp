// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/camera_scene.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "drivers/sim/scene/math/portable.hpp"
#include "drivers/sim/scene/picture/jpeg_encode.hpp"

namespace holdfast::sim {
namespace {

// The firmware's working size at 1/8 of the sensor's columns.
constexpr int kGreyWidth = 410;
constexpr double kPadWidth_mm = 25.25;
constexpr double kPadHeight_mm = 20.75;
// Twice the mains, a little fast as grids are at times: at exactly 100 Hz 25 frames a second see no flicker at all.
constexpr double kMainsFlicker_hz = 100.3;

}  // namespace

scene::PictureConfig picture_of(const scene::Scene& scene) {
  const bool jpeg = scene.level.inject == scene::Inject::kJpeg;
  scene::PictureConfig picture = scene::camera_3280x2464();
  int width = scene.picture.width;
  if (width == 0) width = jpeg ? picture.width : kGreyWidth;
  if (width != picture.width) picture = scene::scaled(picture, width);
  picture.background = scene.picture.background;
  picture.dot_level = scene.picture.dot_level;
  picture.shading = scene.picture.shading;
  picture.imprint_gain = scene.picture.imprint_gain;
  picture.walls = {scene.picture.wall_gain, scene.picture.specular, scene.picture.shadow};
  picture.noise_sigma = scene.effects.pixel_noise;
  picture.seed = scene.seed;
  picture.effects.exposure_ms = scene.effects.exposure_ms;
  picture.effects.rolling_shutter_ms = scene.effects.rolling_shutter_ms;
  picture.effects.dirt_specks = scene.effects.dirt_specks;
  picture.effects.worn_gel = scene.effects.worn_gel;
  picture.effects.dot_shading = scene.effects.dot_shading_levels;
  if (scene.effects.gel_margins) {
    picture.effects.gel_width_mm = kPadWidth_mm;
    picture.effects.gel_height_mm = kPadHeight_mm;
  }
  return picture;
}

std::vector<FaultSpan> faults_of(const scene::Scene& scene) {
  constexpr std::array kFaults{CameraFault::kOff,   CameraFault::kDropped,   CameraFault::kBad,
                               CameraFault::kStuck, CameraFault::kTorn,      CameraFault::kGarbage,
                               CameraFault::kLate,  CameraFault::kBackwards, CameraFault::kGone};
  static_assert(kFaults.size() == scene::kFaultNames.size());
  std::vector<FaultSpan> spans;
  for (const scene::FaultEvent& event : scene.faults) {
    FaultSpan span;
    span.first = static_cast<std::uint64_t>(std::llround(event.t_s * scene.fps));
    span.count = static_cast<std::uint64_t>(event.frames);
    span.fault = kFaults[static_cast<std::size_t>(event.fault)];
    span.by = std::chrono::microseconds(std::llround(event.by_ms * 1e3));
    spans.push_back(span);
  }
  std::stable_sort(spans.begin(), spans.end(),
                   [](const FaultSpan& a, const FaultSpan& b) { return a.first < b.first; });
  return spans;
}

std::size_t most_bytes(const scene::Scene& scene) {
  const scene::PictureConfig picture = picture_of(scene);
  return static_cast<std::size_t>(picture.width) * static_cast<std::size_t>(picture.height);
}

SceneCamera::SceneCamera(const scene::Scene& scene, Clock& clock, DriveAt drive)
    : simulation_(scene),
      clock_(clock),
      drive_(std::move(drive)),
      picture_(picture_of(scene)),
      underside_(scene.object.shape, scene.object.relief, scene.seed, scene::lens_sigma_mm(picture_)),
      luma_(scene.level.inject != scene::Inject::kJpeg) {}

bool SceneCamera::do_start() {
  if (!std::exchange(started_, true)) start_ = clock_.now();
  // What nobody filmed happened all the same.
  while (next_ < scene::frame_count(simulation_.scene()) && due() < clock_.now()) pass();
  return true;
}

std::chrono::microseconds SceneCamera::due() const {
  return start_ + std::chrono::microseconds(std::llround(next_ * 1e6 / simulation_.scene().fps));
}

void SceneCamera::pass() {
  snapshot_ = drive_ ? &simulation_.next(drive_(next_ / simulation_.scene().fps)) : &simulation_.next();
  ++next_;
}

hal::Capture SceneCamera::do_next(hal::Frame& frame, std::chrono::microseconds timeout) {
  const scene::Scene& scene = simulation_.scene();
  if (next_ >= scene::frame_count(scene)) return hal::Capture::kGone;
  const std::chrono::microseconds stamp = due();
  if (stamp > clock_.now() + timeout) {
    clock_.advance(timeout);
    return hal::Capture::kTimeout;
  }
  clock_.advance_to(stamp);
  const scene::ContactState before = snapshot_->contact;
  pass();
  film(before);

  frame.bytes = luma_ ? pixels_ : jpeg_;
  frame.format = luma_ ? hal::PixelFormat::kLuma8 : hal::PixelFormat::kMjpeg;
  frame.width = picture_.width;
  frame.height = picture_.height;
  frame.stride = luma_ ? picture_.width : 0;
  frame.timestamp = stamp;
  frame.sequence = static_cast<std::uint32_t>(snapshot_->frame);
  lent_ = frame;
  return frame.bytes.empty() ? hal::Capture::kBad : hal::Capture::kFrame;
}

void SceneCamera::film(const scene::ContactState& contact_before) {
  const scene::Scene& scene = simulation_.scene();
  scene::Imprint before = scene::imprint_px(picture_, contact_before);
  scene::see_markers(simulation_, *snapshot_, seen_);
  const auto place = [&](const scene::Dot& dot, const std::vector<scene::Vec2>& motion) {
    const scene::Vec2 u = motion[static_cast<std::size_t>(dot.marker)];
    return scene::to_px(picture_, {dot.rest_mm.x + u.x, dot.rest_mm.y + u.y});
  };
  centers_.clear();
  dots_.clear();
  dots_end_.clear();
  for (const scene::Dot& dot : simulation_.dots()) {
    const scene::PointPx end = place(dot, snapshot_->motion_mm);
    if (!dot.extra) centers_.push_back(end);
    if (!dot.printed || (!dot.extra && !seen_[static_cast<std::size_t>(dot.marker)].valid)) continue;
    dots_.push_back(place(dot, snapshot_->before_mm));
    dots_end_.push_back(end);
  }
  const scene::Effects& effects = scene.effects;
  const bool moves = effects.exposure_ms > 0.0 || effects.rolling_shutter_ms > 0.0;
  const auto at = [&](scene::Vec2 object_mm) { return scene.object.touch_mm + object_mm; };
  const scene::Imprint imprint =
      scene::imprint_px(picture_, snapshot_->contact, at(snapshot_->object_mm), snapshot_->object_rad);
  const bool there = before.radius_px > 0.0 && imprint.radius_px > 0.0;
  scene::PictureFrame frame;
  frame.dots = dots_;
  frame.contact = &imprint;
  frame.underside = &underside_;
  if (moves) {
    frame.dots_end = dots_end_;
    // The contact's outline is smooth: a straight way from the last frame's stands for its own.
    const double open_share =
        std::min((effects.exposure_ms + effects.rolling_shutter_ms) * 1e-3 * simulation_.scene().fps, 1.0);
    const auto opened = [&](double from, double to) { return to + open_share * (from - to); };
    before = {{opened(before.center.x, imprint.center.x), opened(before.center.y, imprint.center.y)},
              opened(before.radius_px, imprint.radius_px),
              opened(before.rim_slope, imprint.rim_slope),
              scene::to_px(picture_, at(snapshot_->object_before_mm)),
              snapshot_->object_before_rad,
              opened(contact_before.depth_mm, imprint.depth_mm)};
    frame.contact_end = &imprint;
    if (there) frame.contact = &before;
  }
  frame.light_levels =
      effects.light_drift_levels_per_s * snapshot_->t_s +
      effects.light_flicker_levels * scene::portable::sin(2.0 * std::numbers::pi * kMainsFlicker_hz * snapshot_->t_s);
  frame.seed = static_cast<std::uint64_t>(snapshot_->frame);
  if (luma_) {
    scene::render_luma(picture_, frame, pixels_);
    return;
  }
  scene::render_rgb(picture_, frame, pixels_);
  jpeg_ =
      scene::encode_jpeg(pixels_, picture_.width, picture_.height, scene::JpegInput::kRgb, scene.picture.jpeg_quality);
}

}  // namespace holdfast::sim
