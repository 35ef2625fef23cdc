// SPDX-License-Identifier: Apache-2.0
// jpeg_bench: JPEG bytes to luma at 1/8, each form of our decoder against libjpeg-turbo, by pairs of blocks
// (paired.hpp).
//
// A table of medians with their 95 % intervals, then a line for each claim of tests/checks/claims.txt, with its worst
// picture. Two threads count along the critical path: the caller's CPU time outside of the parallel part, plus the
// longer of the two workers' inside.
//
// Every picture that we decode is compared with libjpeg-turbo's; one that differs ends the run with status 1. A goal
// that is not met does not: a benchmark is no test.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <random>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <jpeglib.h>

#include "drivers/common/crew.hpp"
#include "drivers/sim/scene/scenes.hpp"
#include "tests/bench/paired.hpp"
#include "tests/support/host_clips.hpp"
#include "tests/support/pictures.hpp"
#include "tests/support/scene_pictures.hpp"
#include "toolchain/play/timed_crew.hpp"
#include "vision/jpeg_decoder.hpp"

namespace {

using namespace holdfast;
using Bytes = std::vector<std::uint8_t>;

// ---- Pictures ----

struct Rgb {
  int width = 0;
  int height = 0;
  Bytes pixels;
};

struct Coding {
  int quality = 85;
  int down = 1;  // luma blocks of an MCU, downwards; 1: 4:2:2, 2: 4:2:0
  bool optimised = false;
  int restart_rows = 0;  // of MCUs, per restart marker; 0: none
};

struct Picture {
  std::string name;
  int width = 0;
  int height = 0;
  Bytes bytes;
};

constexpr int kSensorWidth = 3280;
constexpr int kSensorHeight = 2464;
// From here on a picture at full size counts as a large one: what the goals speak of.
constexpr std::size_t kLarge = 500'000;

// Errors: none is expected of pictures made here; libjpeg itself would end the process with its own words.
Picture encoded(std::string name, const Rgb& rgb, const Coding& coding) {
  jpeg_compress_struct info{};
  jpeg_error_mgr errors{};
  info.err = jpeg_std_error(&errors);
  jpeg_create_compress(&info);
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&info, &bytes, &size);
  info.image_width = static_cast<JDIMENSION>(rgb.width);
  info.image_height = static_cast<JDIMENSION>(rgb.height);
  info.input_components = 3;
  info.in_color_space = JCS_RGB;
  jpeg_set_defaults(&info);
  jpeg_set_quality(&info, coding.quality, TRUE);
  info.comp_info[0].h_samp_factor = 2;
  info.comp_info[0].v_samp_factor = coding.down;
  info.optimize_coding = coding.optimised ? TRUE : FALSE;
  info.restart_in_rows = coding.restart_rows;
  jpeg_start_compress(&info, TRUE);
  while (info.next_scanline < info.image_height) {
    const std::size_t at = std::size_t{info.next_scanline} * static_cast<std::size_t>(rgb.width) * 3;
    JSAMPROW row = const_cast<JSAMPROW>(rgb.pixels.data() + at);
    jpeg_write_scanlines(&info, &row, 1);
  }
  jpeg_finish_compress(&info);
  Picture picture{std::move(name), rgb.width, rgb.height, Bytes(bytes, bytes + size)};
  jpeg_destroy_compress(&info);
  std::free(bytes);
  return picture;
}

// What the sensor sees while the gripper holds.
Rgb sensor_picture(int width, double sigma) {
  scene::PictureConfig config = scene::scaled(scene::camera_3280x2464(), width);
  if (width == 640) config.height = 480;
  config.noise_sigma = sigma;
  const test::SceneView held = test::views_of(scene::sphere_slip(), config)[32];  // at 1.28 s
  Rgb rgb{config.width, config.height, {}};
  scene::render_rgb(config, held.dots, &held.imprint, 1, rgb.pixels);
  return rgb;
}

Rgb filled(int width, int height, const std::function<int(int x, int y)>& level) {
  Rgb rgb{width, height, {}};
  rgb.pixels.reserve(static_cast<std::size_t>(width) * static_cast<std::size_t>(height) * 3);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) rgb.pixels.insert(rgb.pixels.end(), 3, static_cast<std::uint8_t>(level(x, y)));
  }
  return rgb;
}

// The first frame of a recording, enlarged to the sensor's full size, with the noise that enlarging took. Empty: not
// readable.
Rgb enlarged(const std::filesystem::path& clip) {
  cv::Mat bgr;
  if (!test::film_reader(clip)->read(bgr)) return {};
  cv::Mat rgb, large, noise(kSensorHeight, kSensorWidth, CV_16SC3), noisy;
  cv::cvtColor(bgr, rgb, cv::COLOR_BGR2RGB);
  cv::resize(rgb, large, {kSensorWidth, kSensorHeight}, 0, 0, cv::INTER_CUBIC);
  cv::RNG(1).fill(noise, cv::RNG::NORMAL, 0, 3);
  cv::add(large, noise, noisy, {}, CV_8UC3);
  return {kSensorWidth, kSensorHeight, Bytes(noisy.datastart, noisy.dataend)};
}

std::vector<Picture> pictures() {
  std::vector<Picture> out;
  const auto add = [&out](const std::string& name, const Rgb& rgb, Coding coding) {
    coding.down = 1;
    out.push_back(encoded(name + " 4:2:2", rgb, coding));
    coding.down = 2;
    out.push_back(encoded(name + " 4:2:0", rgb, coding));
  };
  struct Shot {
    int width;
    int sigma;
    int quality;
  };
  constexpr std::array<Shot, 11> kShots{{{640, 1, 85},
                                         {640, 3, 85},
                                         {640, 8, 85},
                                         {1640, 1, 85},
                                         {1640, 3, 85},
                                         {1640, 8, 85},
                                         {3280, 1, 75},
                                         {3280, 1, 85},
                                         {3280, 3, 85},
                                         {3280, 5, 92},
                                         {3280, 8, 85}}};
  for (const Shot& shot : kShots) {
    const std::string name = fmt::format("{} s{} q{}", shot.width, shot.sigma, shot.quality);
    add(name, sensor_picture(shot.width, shot.sigma), {.quality = shot.quality});
  }
  out.push_back(encoded("3280 s3 q85 4:2:2 restarts", sensor_picture(3280, 3), {.restart_rows = 1}));

  const std::vector<test::Clip> clips = test::clips_in(test::clips_folder());
  const std::size_t made = out.size();
  for (std::size_t i = 0; i < clips.size() && i < 2; ++i) {  // the first and the last
    const Rgb rgb = enlarged(clips[i * (clips.size() - 1)].path);
    if (rgb.pixels.empty()) continue;
    add(fmt::format("3280 real {} s3 q90", i + 1), rgb, {.quality = 90});
    add(fmt::format("3280 real {} s3 q90 opt", i + 1), rgb, {.quality = 90, .optimised = true});
  }
  if (out.size() == made) {
    fmt::print("skipped: pictures of a real sensor (no recordings here). Next: HOLDFAST_CLIPS names their folder\n");
  }

  out.push_back(encoded("3280 flat grey 4:2:2", filled(3280, 2464, [](int, int) { return 128; }), {}));
  out.push_back(encoded("3280 ramp 4:2:2", filled(3280, 2464, [](int x, int y) { return (x + y) * 255 / 5744; }), {}));
  Rgb noise{1640, 1232, Bytes(std::size_t{1640} * 1232 * 3)};
  std::mt19937 random(1);
  std::generate(noise.pixels.begin(), noise.pixels.end(), [&] { return static_cast<std::uint8_t>(random() >> 24); });
  out.push_back(encoded("1640 white noise 4:2:2", noise, {}));
  return out;
}

// ---- The decoders compared ----

// libjpeg-turbo as one would use it who wants luma fast: one decompressor for all pictures, no colour, nothing
// smoothed. Errors as in encoded().
class Library {
 public:
  Library() {
    info_.err = jpeg_std_error(&errors_);
    jpeg_create_decompress(&info_);
  }
  ~Library() { jpeg_destroy_decompress(&info_); }
  Library(const Library&) = delete;
  Library& operator=(const Library&) = delete;

  // Shape of `out`: at least all pixels at the scale.
  std::size_t decode(const Bytes& bytes, unsigned denominator, Bytes& out) {
    jpeg_mem_src(&info_, bytes.data(), static_cast<unsigned long>(bytes.size()));
    jpeg_read_header(&info_, TRUE);
    info_.out_color_space = JCS_GRAYSCALE;
    info_.scale_num = 1;
    info_.scale_denom = denominator;
    info_.dct_method = JDCT_ISLOW;
    info_.do_fancy_upsampling = FALSE;
    jpeg_start_decompress(&info_);
    while (info_.output_scanline < info_.output_height) {
      JSAMPROW row = out.data() + std::size_t{info_.output_scanline} * info_.output_width;
      jpeg_read_scanlines(&info_, &row, 1);
    }
    jpeg_finish_decompress(&info_);
    return std::size_t{info_.output_width} * info_.output_height;
  }

 private:
  jpeg_error_mgr errors_{};
  jpeg_decompress_struct info_{};
};

struct Fast {
  Fast(std::int32_t lanes, std::size_t workers) : memory(workers) { config.lanes = lanes; }

  [[nodiscard]] Status decode(hal::Crew& crew, const Bytes& bytes, LumaBuffer& out) {
    return jpeg_fast::decode(*state, config, memory, crew, bytes, out);
  }

  jpeg_fast::Config config;
  std::vector<jpeg_fast::Worker> memory;
  std::unique_ptr<jpeg_fast::State> state = std::make_unique<jpeg_fast::State>();
};

// The forms of our decoder, each with memory of its own: none must find it warm from another one's work.
class Decoders {
 public:
  enum : std::size_t { kPlain, kOneLane, kTwoLanes, kThreeLanes, kTwoThreads, kMethods };
  static constexpr std::array<std::string_view, kMethods> kNames{"plain walk", "1 lane", "2 lanes", "3 lanes",
                                                                 "2 threads"};

  // Empty: done. Otherwise what went wrong, one line.
  std::string run(const Picture& picture, bool all) {
    const std::size_t pixels = library_.decode(picture.bytes, 8, pixels_);
    const bench::Side rival{[&] { library_.decode(picture.bytes, 8, pixels_); }};
    const Bytes& bytes = picture.bytes;
    const std::array<bench::Side, kMethods> sides{
        {{[&] { status_ = jpeg_dc::decode(*plain_, bytes, *out_); }},
         {[&] { status_ = one_lane_.decode(alone_, bytes, *out_); }},
         {[&] { status_ = two_lanes_.decode(alone_, bytes, *out_); }},
         {[&] { status_ = three_lanes_.decode(alone_, bytes, *out_); }},
         {[&] { status_ = two_threads_.decode(crew_, bytes, *out_); }, &crew_}}};
    for (std::size_t m = 0; m < kMethods; ++m) {
      figures_[m] = {};
      if (!all && m < kThreeLanes) continue;
      std::fill_n(out_->pixels.begin(), pixels, std::uint8_t{0xA5});
      // A frame of several threads is a run of its own: one late helper among many would spoil the block.
      bench::Pairs pairs(m == kTwoThreads ? bench::Pairs::Runs::kOne : bench::Pairs::Runs::kBlocks);
      pairs.run(rival, sides[m]);
      figures_[m] = pairs.ratio();
      if (m == kThreeLanes) {
        rival_us_ = pairs.rival_us().median;
        our_us_ = pairs.our_us().median;
      }
      if (!status_.ok() || !std::equal(out_->pixels.begin(), out_->pixels.begin() + static_cast<std::ptrdiff_t>(pixels),
                                       pixels_.begin())) {
        return fmt::format("error: {}: {} differs from libjpeg-turbo (our decoder is wrong). Next: run the tests",
                           picture.name, kNames[m]);
      }
    }
    return {};
  }
  // Times libjpeg-turbo.
  [[nodiscard]] const bench::Figure& figure(std::size_t method) const { return figures_[method]; }
  [[nodiscard]] double rival_us() const { return rival_us_; }
  [[nodiscard]] double our_us() const { return our_us_; }

 private:
  Library library_;
  Bytes pixels_ = Bytes(std::size_t{kSensorWidth} * kSensorHeight);
  std::unique_ptr<LumaBuffer> out_ = std::make_unique<LumaBuffer>();
  Status status_;
  std::unique_ptr<jpeg_dc::State> plain_ = std::make_unique<jpeg_dc::State>();
  hal::Alone alone_;
  drivers::Threads threads_{{.workers = 2}};
  tool::TimedCrew crew_{threads_};
  Fast one_lane_{1, 1};
  Fast two_lanes_{2, 1};
  Fast three_lanes_{3, 1};
  Fast two_threads_{3, 2};
  std::array<bench::Figure, kMethods> figures_{};
  double rival_us_ = 0;
  double our_us_ = 0;
};

void print_row(const Picture& picture, const Decoders& decoders) {
  fmt::print("{:30} {:5} {:7.3f} {:7.3f}", picture.name, (picture.bytes.size() + 500) / 1000,
             decoders.rival_us() / 1000, decoders.our_us() / 1000);
  for (std::size_t m = 0; m < Decoders::kMethods; ++m) {
    const bench::Figure& figure = decoders.figure(m);
    if (figure.tried > 0) fmt::print(" | {} {:>7}", figure.text(), fmt::format("{}/{}", figure.kept, figure.tried));
  }
  fmt::print("\n");
  std::fflush(stdout);
}

// ---- Program ----

int write_all(const std::vector<Picture>& all, const std::filesystem::path& folder) {
  for (const Picture& picture : all) {
    std::string file = picture.name + ".jpg";
    std::replace(file.begin(), file.end(), ' ', '_');
    file.erase(std::remove(file.begin(), file.end(), ':'), file.end());
    std::ofstream out(folder / file, std::ios::binary);
    out.write(reinterpret_cast<const char*>(picture.bytes.data()), static_cast<std::streamsize>(picture.bytes.size()));
    if (!out.flush()) {
      fmt::print(stderr, "error: cannot write {} (no space, or no permission). Next: give another folder\n",
                 (folder / file).string());
      return 1;
    }
  }
  return 0;
}

int run(int argc, char** argv) {
  bool all_forms = false;
  std::string only, write;
  CLI::App app{"JPEG to luma at 1/8: ours against libjpeg-turbo", "jpeg_bench"};
  app.add_flag("--all", all_forms, "all forms of our decoder, not only the default and two threads");
  app.add_option("--only", only, "pictures with this in their name");
  app.add_option("--write", write, "folder for the pictures as files; nothing is measured")
      ->check(CLI::ExistingDirectory);
  CLI11_PARSE(app, argc, argv);

  std::vector<Picture> all = pictures();
  std::erase_if(all, [&](const Picture& p) { return p.name.find(only) == std::string::npos; });
  if (!write.empty()) return write_all(all, write);
  if (all.empty()) {
    fmt::print(stderr, "error: no picture has '{}' in its name. Next: run without --only to see the names\n", only);
    return 1;
  }
  fmt::print("times as fast as libjpeg-turbo 1/8: median (95 % interval) pairs kept/tried; {}\n{:30} {:>5} {:>7} {:>7}",
             bench::prepare(), "picture", "kB", "turbo", "ours ms");
  for (std::size_t m = all_forms ? Decoders::kPlain : Decoders::kThreeLanes; m < Decoders::kMethods; ++m) {
    fmt::print(" | {:27}", Decoders::kNames[m]);
  }
  fmt::print("\n");
  bench::Worst large("jpeg_one_thread"), any("jpeg_any"), two("jpeg_two_threads");
  const auto decoders = std::make_unique<Decoders>();
  for (const Picture& picture : all) {
    if (const std::string error = decoders->run(picture, all_forms); !error.empty()) {
      fmt::print(stderr, "{}\n", error);
      return 1;
    }
    print_row(picture, *decoders);
    any.see(decoders->figure(Decoders::kThreeLanes), picture.name);
    if (picture.width != kSensorWidth || picture.bytes.size() < kLarge) continue;
    large.see(decoders->figure(Decoders::kThreeLanes), picture.name);
    two.see(decoders->figure(Decoders::kTwoThreads), picture.name);
  }
  for (const bench::Worst* worst : {&large, &any, &two}) worst->print();
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "error: %s (no memory?). Next: try --only 640\n", error.what());
    return 1;
  }
}
