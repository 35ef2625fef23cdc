// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/camera_played.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <variant>

#include "drivers/sim/camera_scene.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/scene/file/scene_file.hpp"

namespace holdfast::sim {
namespace {

constexpr std::chrono::hours kLongest{24};
constexpr Micros kMostStep{1'000'000};

// Grey, whatever the scene enters with: a picture of 8 megapixels takes a quarter of a second to draw.
Result<std::vector<RecordedFrame>> film_of(const std::filesystem::path& path, RecordingInfo& info,
                                           const std::function<bool(long, long)>& filmed) {
  const scene::SceneResult read = scene::read_scene_file(path.string());
  if (!read.scene) return Error{read.errors.empty() ? path.string() + ": no scene" : read.errors.front()};
  scene::Scene scene = *read.scene;
  scene.level.inject = scene::Inject::kGrey;
  Clock clock;
  SceneCamera camera(scene, clock);
  std::vector<RecordedFrame> film;
  const long all = scene::frame_count(scene);
  hal::Frame frame;
  if (!camera.start()) return Error{path.string() + ": the scene's camera does not start"};
  while (camera.next(frame, kLongest) == hal::Capture::kFrame) {
    RecordedFrame one;
    one.bytes.assign(frame.bytes.begin(), frame.bytes.end());
    one.width = one.input_width = frame.width;
    one.height = one.input_height = frame.height;
    one.index = static_cast<long>(film.size());
    one.time = frame.timestamp;
    film.push_back(std::move(one));
    if (filmed && !filmed(static_cast<long>(film.size()), all)) return Error{path.string() + ": interrupted"};
  }
  if (film.empty()) return Error{path.string() + ": the scene has no frames"};
  info.width = film.front().width;
  info.height = film.front().height;
  info.frames = static_cast<long>(film.size());
  info.fps = info.time_base_fps = scene.fps;
  return film;
}

}  // namespace

Result<std::unique_ptr<PlayedCamera>> PlayedCamera::open(const std::filesystem::path& path, hal::Clock& clock,
                                                         const Config& config) {
  if (path.extension() == ".json") {
    RecordingInfo info;
    auto film = film_of(path, info, config.filmed);
    if (auto* error = std::get_if<Error>(&film)) return std::move(*error);
    return std::unique_ptr<PlayedCamera>(
        new PlayedCamera(clock, std::nullopt, std::get<std::vector<RecordedFrame>>(std::move(film)), info));
  }
  auto opened = Recording::open(path, {config.fps});
  if (auto* error = std::get_if<Error>(&opened)) return std::move(*error);
  return of(std::get<Recording>(std::move(opened)), clock);
}

std::unique_ptr<PlayedCamera> PlayedCamera::of(Recording recording, hal::Clock& clock) {
  const RecordingInfo info = recording.info();
  return std::unique_ptr<PlayedCamera>(new PlayedCamera(clock, std::move(recording), {}, info));
}

bool PlayedCamera::do_start() {
  problem_.clear();
  return true;
}

bool PlayedCamera::read(bool& ended) {
  ended = false;
  if (!recording_) {
    ended = next_of_film_ == film_.size();
    if (!ended) frame_ = film_[next_of_film_++];
    return !ended;
  }
  switch (recording_->next(frame_)) {
    case Read::kFrame:
      return true;
    case Read::kEnd:
      ended = true;
      return false;
    case Read::kError:
      problem_ = recording_->error();
      return false;
  }
  return false;
}

bool PlayedCamera::load() {
  bool ended = false;
  if (!read(ended)) {
    if (!ended) return false;
    if (!any_) {
      problem_ = "the recording has no frames";
      return false;
    }
    if (recording_ && !recording_->rewind()) {
      problem_ = recording_->error();
      return false;
    }
    next_of_film_ = 0;
    any_ = false;
    ++rounds_;
    if (!read(ended)) return false;
  }
  const auto period = Micros{std::llround(1e6 / info_.time_base_fps)};
  const Micros step = frame_.time - last_time_;
  const bool steady = any_ && step > Micros{0} && step <= kMostStep;
  if (!began_) {
    due_ = clock_.now();
  } else {
    due_ += steady ? step : period;
  }
  began_ = any_ = true;
  last_time_ = frame_.time;
  // Whoever was late finds the recording where it was.
  due_ = std::max(due_, clock_.now() - period);
  return true;
}

hal::Capture PlayedCamera::do_next(hal::Frame& frame, std::chrono::microseconds timeout) {
  if (!pending_) {
    if (!load()) return hal::Capture::kGone;
    pending_ = true;
  }
  const Micros wait = due_ - clock_.now();
  if (wait > timeout) {
    clock_.wait(timeout);
    return hal::Capture::kTimeout;
  }
  if (wait > Micros{0}) clock_.wait(wait);
  pending_ = false;
  frame = as_frame(frame_);
  frame.timestamp = due_;
  frame.sequence = sequence_++;
  return hal::Capture::kFrame;
}

}  // namespace holdfast::sim
