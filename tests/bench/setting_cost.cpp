// SPDX-License-Identifier: Apache-2.0
// setting_cost FILM SETTINGS N: N frames of the film through the pipeline of one setting, from the JPEG's bytes to the
// decision; for the instruction counter, which takes the difference of two runs. SETTINGS as `holdfast trade settings`
// prints them: parameters as name=value, passes=, window_pct=, imprint_lag_ms=, decoder=library, features=paper.
// setting_cost FILM: writes the film (film_file.hpp). setting_cost --data FOLDER: writes the small ones of tests/data.
//
// Prints the mean CPU time of the second half of the frames. One thread, whatever jpeg_threads says: what the work of
// all threads comes to. features=paper computes the paper's four and still walks the compiled tree, some 50
// instructions that no count here can see.
//
// Exit status: 0 done, 1 a file failed, 2 wrong arguments, 3 the setting refused a frame: there is nothing to count.
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <sstream>
#include <string>
#include <string_view>

#include "app/app.hpp"
#include "drivers/common/jpeg_turbo.hpp"
#include "hal/crew.hpp"
#include "tests/support/film_file.hpp"
#include "toolchain/play/thread_time.hpp"

namespace {

using namespace holdfast;

struct Setting {
  Params params;
  int passes = tracker::Config{}.passes;
  std::int32_t window_pct = tracker::Config{}.window_pct;
  Micros imprint_lag = imprint::Config{}.lag;
  bool library = false;
  bool paper = false;
};

bool parse_setting(const std::string& text, Setting& out) {
  std::istringstream words(text);
  for (std::string word; words >> word;) {
    const std::size_t equals = word.find('=');
    if (equals == std::string::npos) return false;
    const std::string name = word.substr(0, equals);
    const std::string value = word.substr(equals + 1);
    if (name == "passes") {
      out.passes = std::atoi(value.c_str());
    } else if (name == "window_pct") {
      out.window_pct = std::atoi(value.c_str());
    } else if (name == "imprint_lag_ms") {
      out.imprint_lag = Micros{1000} * std::atoi(value.c_str());
    } else if (word == "decoder=library") {
      out.library = true;
    } else if (word == "features=paper") {
      out.paper = true;
    } else if (!parse(name, value, out.params).ok()) {
      return false;
    }
  }
  return true;
}

int write_pictures(const std::string& path, const std::vector<std::vector<std::uint8_t>>& pictures) {
  std::ofstream out(path, std::ios::binary);
  for (const std::vector<std::uint8_t>& picture : pictures) {
    out.write(reinterpret_cast<const char*>(picture.data()), static_cast<std::streamsize>(picture.size()));
  }
  out.close();
  if (out) return 0;
  std::fprintf(stderr, "error: %s: cannot be written (no such folder, or the disk is full). Next: give another place\n",
               path.c_str());
  return 1;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 2) return write_pictures(argv[1], test::make_film(test::kFilm));
  if (argc == 3 && std::string_view(argv[1]) == "--data") {
    const std::string folder = argv[2];
    return write_pictures(folder + "/slip.mjpg", test::make_film(test::kSmallFilm)) |
           write_pictures(folder + "/slip.y8", test::make_luma(240));
  }
  Setting setting;
  if (argc != 4 || !parse_setting(argv[2], setting)) {
    std::fputs("usage: setting_cost FILM SETTINGS N; setting_cost FILM writes it\n", stderr);
    return 2;
  }
  const std::vector<test::Jpeg> film = test::read_mjpg(argv[1]);
  const auto frames = static_cast<std::size_t>(std::atol(argv[3]));
  if (film.size() < frames) {
    std::fprintf(stderr, "error: %s: %zu pictures (not there, or cut off). Next: write it with setting_cost FILM\n",
                 argv[1], film.size());
    return 1;
  }
  // Few, so that a short film shows the whole of the work.
  setting.params.reference_frames = 2;
  pipeline::Config config = pipeline_config(setting.params);
  config.tracker.passes = setting.passes;
  config.tracker.window_pct = setting.window_pct;
  config.imprint.lag = setting.imprint_lag;
  if (setting.paper) config.with_field = config.with_imprint = false;
  drivers::TurboJpegDecoder library;
  const auto worker = std::make_unique<jpeg_fast::Worker>();
  hal::Alone crew;
  const auto ours =
      std::make_unique<EighthDecoder>(jpeg_config(setting.params), library, std::span(worker.get(), 1), crew);
  JpegDecoder& decoder = setting.library ? static_cast<JpegDecoder&>(library) : *ours;
  const auto state = std::make_unique<pipeline::State>();
  double start = 0;
  for (std::size_t i = 0; i < frames; ++i) {
    if (i == frames / 2) start = tool::thread_us();
    hal::Frame frame{};
    frame.bytes = film[i];
    frame.format = hal::PixelFormat::kMjpeg;
    frame.width = 3280;
    frame.height = 2464;
    frame.timestamp = Micros{(static_cast<std::int64_t>(i) + 1) * 40'000};
    frame.sequence = static_cast<std::uint32_t>(i);
    const Status quality = pipeline::update(*state, config, decoder, frame).quality;
    if (quality.ok()) continue;
    std::fprintf(stderr, "'%s': frame %zu refused (%s)\n", argv[2], i, std::string(info(quality.reason).what).c_str());
    return 3;
  }
  const std::size_t timed = frames - frames / 2;
  std::printf("%.1f us each\n", (tool::thread_us() - start) / static_cast<double>(timed));
  return 0;
}
