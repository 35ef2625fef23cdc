// SPDX-License-Identifier: Apache-2.0
// frame_cost N: N frames of a moving gel through the pipeline, from luma to decision; for the instruction
// counter. The pictures are rendered before the first frame and shown in turn, so N changes nothing but the
// number of frames.
#include <cstdio>
#include <cstdlib>
#include <memory>

#include "app/app.hpp"
#include "drivers/sim/scene/scenes.hpp"
#include "tests/support/grasp_pictures.hpp"

namespace {

class NoJpeg final : public holdfast::JpegDecoder {
 private:
  [[nodiscard]] holdfast::Status do_decode(std::span<const std::uint8_t>, holdfast::DecodeScale,
                                           holdfast::LumaBuffer&) override {
    return {holdfast::Reason::kJpegDamaged};
  }
};

}  // namespace

int main(int argc, char** argv) {
  using namespace holdfast;
  if (argc != 2) return 2;
  const long frames = std::atol(argv[1]);
  // The working image of the camera in mode fast: 410 pixels wide. Shaken, so that every frame moves.
  scene::GraspConfig grasp = scene::shaken(scene::sphere_slip());
  const test::GraspPictures film = test::film(grasp, scene::scaled(scene::camera_3280x2464(), 410));
  NoJpeg jpeg;
  const auto state = std::make_unique<pipeline::State>();
  const pipeline::Config config = pipeline_config(Params{});
  long accepted = 0;
  for (long i = 0; i < frames; ++i) {
    const LumaView& view = film.views[static_cast<std::size_t>(i) % film.views.size()];
    hal::Frame frame{};
    frame.bytes = {view.data, static_cast<std::size_t>(view.width) * static_cast<std::size_t>(view.height)};
    frame.format = hal::PixelFormat::kLuma8;
    frame.width = view.width;
    frame.height = view.height;
    frame.stride = view.stride;
    frame.timestamp = Micros{(i + 1) * 40'000};
    accepted += pipeline::update(*state, config, jpeg, frame).quality.ok() ? 1 : 0;
  }
  std::printf("%ld of %ld accepted, %u searches\n", accepted, frames, state->tracker.searches);
  return accepted == frames ? 0 : 1;
}
