// SPDX-License-Identifier: Apache-2.0
// Runs the whole firmware between the two marks of the preloaded heap counter (heap_marks.hpp):
//   heap_free luma FRAMES     luma pictures of a sphere that presses, slips, releases and now and then jumps: must be 0
//   heap_free hand PAIRS      the same, shown to both fingers of a hand: must be 0
//   heap_free jpeg FRAMES     8-megapixel JPEG in mode fast, by the firmware's own decoder: must be 0
//   heap_free library FRAMES  the same in mode balanced, which libjpeg-turbo decodes in memory of ours: must be 0
//   heap_free crew RUNS       tasks of four workers, and now and then a pause in which the helpers sleep: must be 0
// Exit status 77: started without the counter.
#include <sched.h>

#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>

#include "app/app.hpp"
#include "app/fingers.hpp"
#include "drivers/common/crew.hpp"
#include "drivers/common/jpeg_turbo.hpp"
#include "drivers/sim/camera_memory.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/gpio.hpp"
#include "drivers/sim/scene/picture/jpeg_encode.hpp"
#include "drivers/sim/scene/scenes.hpp"
#include "drivers/sim/serial.hpp"
#include "tests/checks/heap_marks.hpp"
#include "tests/support/frames.hpp"
#include "tests/support/scene_pictures.hpp"
#include "vision/jpeg_decoder.hpp"

namespace {

using namespace holdfast;

// The same JPEG bytes again and again, without the encoder in between.
class JpegLoop final : public hal::Camera {
 public:
  JpegLoop(sim::Clock& clock, std::vector<std::vector<std::uint8_t>> pictures, long frames)
      : clock_(clock), pictures_(std::move(pictures)), frames_(frames) {}

 private:
  [[nodiscard]] bool do_start() override { return true; }
  [[nodiscard]] hal::Capture do_next(hal::Frame& frame, std::chrono::microseconds) override {
    if (shown_ == frames_) return hal::Capture::kGone;
    clock_.advance(std::chrono::microseconds{40'000});
    frame = {};
    // The gel lies still until the rest position is learned.
    const long picture = shown_ < 20 ? shown_ % 2 : shown_ % static_cast<long>(pictures_.size());
    frame.bytes = pictures_[static_cast<std::size_t>(picture)];
    frame.width = 3280;
    frame.height = 2464;
    frame.timestamp = clock_.now();
    frame.sequence = static_cast<std::uint32_t>(shown_++);
    return hal::Capture::kFrame;
  }
  void do_release(const hal::Frame&) override {}
  void do_stop() override {}
  [[nodiscard]] bool do_live() const override { return false; }

  sim::Clock& clock_;
  std::vector<std::vector<std::uint8_t>> pictures_;
  long frames_;
  long shown_ = 0;
};

std::vector<std::vector<std::uint8_t>> jpeg_pictures() {
  const scene::PictureConfig picture = scene::camera_3280x2464();
  std::vector<std::vector<std::uint8_t>> out;
  std::vector<std::uint8_t> rgb;
  const std::vector<test::SceneView> views = test::views_of(scene::sphere_slip(), picture);
  for (const std::size_t frame : {0u, 1u, 22u, 40u}) {  // twice at rest, pressed on, sliding
    scene::render_rgb(picture, views[frame].dots, &views[frame].imprint, 1, rgb);
    out.push_back(scene::encode_jpeg(rgb, picture.width, picture.height, scene::JpegInput::kRgb, 85));
  }
  return out;
}

// When `together`, nobody leaves before all of the crew have entered.
class Meeting final : public hal::Job {
 public:
  std::atomic<std::size_t> entered{0};
  std::size_t together = 0;

 private:
  void do_work(std::size_t) override {
    ++entered;
    while (entered < together) sched_yield();
  }
};

int judge(const HeapCounts& counts) {
  if (counts.allocations + counts.releases == 0) return 0;
  test::print_first_caller(counts);
  return 1;
}

int run_crew(const test::HeapMarks& marks, long runs) {
  drivers::Threads crew({});
  Meeting task;
  marks.begin();
  for (long run = 0; run < runs; ++run) {
    const bool wakes = run % 1000 == 0;
    while (wakes && crew.asleep() + 1 < crew.size()) sched_yield();
    task.entered = 0;
    task.together = wakes ? crew.size() : 0;
    crew.run(task);
  }
  const HeapCounts counts = marks.end();
  std::printf("crew: %ld runs of %zu workers, %llu by the caller alone: %lu allocations, %lu releases\n", runs,
              crew.size(), static_cast<unsigned long long>(crew.counts().alone), counts.allocations, counts.releases);
  if (crew.size() < hal::kMaxWorkers) {
    std::puts("error: the run did not exercise what it claims to");
    return 1;
  }
  return judge(counts);
}

// The whole device with two cameras, whose frames come 17 ms apart.
int run_hand(const test::HeapMarks& marks, const test::ScenePictures& film, long pairs) {
  sim::Clock clock;
  sim::Gpio gpio(clock);
  sim::Serial link;
  test::NoJpeg jpeg;
  sim::CameraMemory::Config config{};
  config.cycles = static_cast<std::uint64_t>(pairs) / film.views.size() + 1;
  sim::CameraMemory left(clock, film.views, config);
  config.latency += Micros{17'000};
  sim::CameraMemory right(clock, film.views, config);
  const auto finger = std::make_unique<Finger>(right);
  const auto app = std::make_unique<App>(Devices{left, gpio, link, clock, jpeg, false, finger.get()});
  Params params{};
  params.status_version = 2;
  const std::uint64_t edges = gpio.edges(hal::Line::kAlive);
  long frames = 0;
  long slips = 0;
  marks.begin();
  const bool started = app->start(params).ok();
  while (started && frames < 2 * pairs && app->step()) {
    frames += app->accepted() ? 1 : 0;
    slips += app->outputs().slip ? 1 : 0;
  }
  app->stop();
  const auto accepted = static_cast<long>(gpio.edges(hal::Line::kAlive) - edges);
  const HeapCounts counts = marks.end();
  std::printf(
      "hand: %ld pairs of frames, ALIVE toggled %ld times, %ld frames with slip: %lu allocations, %lu releases\n",
      pairs, accepted, slips, counts.allocations, counts.releases);
  if (accepted < pairs / 2 || slips == 0) {
    std::puts("error: the run did not exercise what it claims to");
    return 1;
  }
  return judge(counts);
}

}  // namespace

int main(int argc, char** argv) {
  const auto marks = test::HeapMarks::find();
  if (!marks) {
    std::puts("SKIPPED: started without the heap counter (ctest preloads it)");
    return 77;
  }
  const bool library = argc == 3 && std::strcmp(argv[1], "library") == 0;
  const bool jpeg_level = library || (argc == 3 && std::strcmp(argv[1], "jpeg") == 0);
  const bool crew = argc == 3 && std::strcmp(argv[1], "crew") == 0;
  const bool hand = argc == 3 && std::strcmp(argv[1], "hand") == 0;
  if (argc != 3 || (!jpeg_level && !crew && !hand && std::strcmp(argv[1], "luma") != 0)) {
    std::fputs("usage: heap_free luma|hand|jpeg|library|crew FRAMES\n", stderr);
    return 2;
  }
  const long frames = std::atol(argv[2]);
  if (crew) return run_crew(*marks, frames);

  // The scene, and then pictures moved by more than half a pitch: the search of the whole picture runs, too.
  const scene::PictureConfig picture = scene::cropped_320x240();
  test::ScenePictures film = test::film(scene::sphere_slip(), picture);
  scene::PictureConfig jumped = picture;
  jumped.center_x_px += 18.0;
  for (const auto& view : test::film(scene::sphere_slip(), jumped).pixels) {
    film.pixels.push_back(view);
    if (film.pixels.size() == film.views.size() + 3) break;
  }
  for (std::size_t i = film.views.size(); i < film.pixels.size(); ++i) {
    film.views.push_back({film.pixels[i].data(), picture.width, picture.height, picture.width});
  }

  if (hand) return run_hand(*marks, film, frames);

  sim::Clock clock;
  sim::Gpio gpio(clock);
  sim::Serial link;
  drivers::TurboJpegDecoder other_scales;
  const auto worker = std::make_unique<jpeg_fast::Worker>();
  hal::Alone alone;
  const auto decoder =
      std::make_unique<EighthDecoder>(EighthDecoder::Config{}, other_scales, std::span(worker.get(), 1), alone);
  EighthDecoder& jpeg = *decoder;
  std::unique_ptr<hal::Camera> camera;
  if (jpeg_level) {
    camera = std::make_unique<JpegLoop>(clock, jpeg_pictures(), frames);
  } else {
    sim::CameraMemory::Config config{};
    config.cycles = static_cast<std::uint64_t>(frames) / film.views.size() + 1;
    camera = std::make_unique<sim::CameraMemory>(clock, film.views, config);
  }
  const auto app = std::make_unique<App>(Devices{*camera, gpio, link, clock, jpeg});

  Params params{};
  params.mode = find_mode(library ? "balanced" : "fast").value_or(0);
  long accepted = 0, rejected = 0, slips = 0;
  marks->begin();
  const bool started = app->start(params).ok();
  while (started && app->step()) {
    ++(app->result().quality.ok() ? accepted : rejected);
    slips += app->outputs().slip ? 1 : 0;
  }
  app->stop();
  const HeapCounts counts = marks->end();

  std::printf(
      "%s level: %ld frames accepted, %ld rejected, %ld with slip, %u searches: %lu allocations, %lu "
      "releases\n",
      argv[1], accepted, rejected, slips, app->state().tracker.searches, counts.allocations, counts.releases);
  if (accepted < frames / 2 || (!jpeg_level && (slips == 0 || app->state().tracker.searches < frames / 100))) {
    std::puts("error: the run did not exercise what it claims to");
    return 1;
  }
  return judge(counts);
}
