// SPDX-License-Identifier: Apache-2.0
// jpeg_bench: JPEG bytes to luma, and JPEG bytes to decision; ours against libjpeg-turbo and OpenCV in one run.
//
// Two tables, then the goals, each `ok` or `short` with its worst figure. Figures are thread CPU time, methods by
// turns, medians over the rounds; ratios are what may be compared between machines. A virtual core that shares a real
// one with another machine, or with our own second thread, makes everything dense slower (seen: two threads spend up
// to 1.7 times the CPU time of one): the goals are therefore also given for each method's fastest round, and the load
// is printed.
//
// Two threads. Wall time says more of who else is on the machine than of the decoder, so what counts is the critical
// path: the caller's CPU time outside of the parallel part, plus the longer of the two workers' inside. Runs in which
// the helper came too late to work are left out of it and counted (`alone`); wall time is printed beside it. What two
// cores that share nothing would make of it is computed (`cores`): one thread's time, times the critical path's share
// of the CPU time of both, which a slow neighbour changes little.
//
// Four parts. What cutting the work for four workers costs in all: each takes its quarter of the slices, one after the
// other on one thread, against one worker that takes them all.
//
// Every picture that we decode, in every round, is compared with libjpeg-turbo's; one that differs ends the run with
// status 1. A goal that is not met does not: a benchmark is no test.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <exception>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <numeric>
#include <opencv2/features2d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <random>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <jpeglib.h>

#include "app/app.hpp"
#include "base/math.hpp"
#include "drivers/common/crew.hpp"
#include "drivers/common/jpeg_turbo.hpp"
#include "drivers/sim/camera_scene.hpp"
#include "drivers/sim/scene/scenes.hpp"
#include "tests/support/host_clips.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/scene_pictures.hpp"
#include "toolchain/play/thread_time.hpp"
#include "toolchain/play/timed_crew.hpp"
#include "vision/jpeg_decoder.hpp"

namespace {

using namespace holdfast;
using reference_model::Point;
using Bytes = std::vector<std::uint8_t>;

// ---- Time ----

double clock_us(clockid_t clock) {
  timespec now{};
  clock_gettime(clock, &now);
  return static_cast<double>(now.tv_sec) * 1e6 + static_cast<double>(now.tv_nsec) * 1e-3;
}

double median(std::vector<double> values) {
  if (values.empty()) return std::nan("");
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

std::string load() {
  std::array<double, 3> average{};
  if (getloadavg(average.data(), 3) != 3) return "load unknown";
  return fmt::format("load {:.1f} {:.1f} {:.1f}", average[0], average[1], average[2]);
}

// ---- Crews that measure ----

// Four workers on the caller's thread, one after the other, a quarter of the slices for each. The first would take them
// all, so it is shown no more than its own. That leaves the last slice of a quarter without the bytes of the next one,
// which its seam needs: afterwards the task is done once more in one piece, and that is not counted.
class FourInTurn final : public hal::Crew {
 public:
  explicit FourInTurn(jpeg_fast::State& state) : state_(state) {}

  // CPU time of what is not to be counted, since the last call.
  [[nodiscard]] double take_uncounted_us() { return std::exchange(uncounted_us_, 0.0); }

 private:
  [[nodiscard]] std::size_t do_size() const override { return hal::kMaxWorkers; }
  void do_run(hal::Job& task) override {
    const std::size_t slices = state_.slices;
    for (std::size_t i = 0; i < hal::kMaxWorkers; ++i) {
      state_.claimed = static_cast<std::uint32_t>(slices * i / hal::kMaxWorkers);
      state_.slices = slices * (i + 1) / hal::kMaxWorkers;
      task.work(i);
    }
    const double start = tool::thread_us();
    state_.slices = slices;
    state_.claimed = 0;
    state_.valued = 0;
    task.work(0);
    uncounted_us_ += tool::thread_us() - start;
  }

  jpeg_fast::State& state_;
  double uncounted_us_ = 0;
};

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
  int down = 1;
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
  Picture picture{std::move(name), rgb.width, rgb.height, coding.down, Bytes(bytes, bytes + size)};
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
  if (!cv::VideoCapture(clip.string()).read(bgr)) return {};
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

struct Spent {
  double us = 0;      // CPU time of one thread, or of the critical path of several
  double all_us = 0;  // CPU time of all threads
  double wall_us = 0;
  bool alone = false;  // several threads were asked for, and one did it all
};

enum class Take : std::uint8_t { kMedian, kFastest };

struct Method {
  std::string_view name;
  std::function<Spent(const Picture&)> decode = {};
  std::vector<Spent> spent = {};

  // Of the rounds in which all threads worked; not a number when there was none.
  [[nodiscard]] double us(Take take) const {
    std::vector<double> values;
    for (const Spent& s : spent) {
      if (!s.alone) values.push_back(s.us);
    }
    if (values.empty() || take == Take::kMedian) return median(std::move(values));
    return *std::min_element(values.begin(), values.end());
  }
  [[nodiscard]] double median_of(double Spent::*part) const {
    std::vector<double> values;
    for (const Spent& s : spent) values.push_back(s.*part);
    return median(std::move(values));
  }
  // Of the critical path in the CPU time of all threads: usual, or in the round in which they shared best.
  [[nodiscard]] double path_share(Take take) const {
    std::vector<double> values;
    for (const Spent& s : spent) values.push_back(s.us / s.all_us);
    return take == Take::kMedian ? median(std::move(values)) : *std::min_element(values.begin(), values.end());
  }
  [[nodiscard]] long alone() const {
    return std::count_if(spent.begin(), spent.end(), [](const Spent& s) { return s.alone; });
  }
};

template <typename Work>
Spent timed(Work&& work) {
  const double wall = clock_us(CLOCK_MONOTONIC);
  const double start = tool::thread_us();
  work();
  const double us = tool::thread_us() - start;
  return {us, us, clock_us(CLOCK_MONOTONIC) - wall, false};
}

// The same with helpers, who are to be found in `crew`.
template <typename Work>
Spent timed(tool::TimedCrew& crew, Work&& work) {
  crew.reset();
  Spent spent = timed(work);
  const double caller_us = spent.us;
  spent.us = crew.path_us(caller_us);
  spent.all_us = crew.all_us(caller_us);
  spent.alone = crew.alone();
  return spent;
}

class Decoders {
 public:
  enum : std::size_t {
    kTurbo8,
    kTurbo4,
    kTurbo2,
    kTurbo1,
    kOpenCv8,
    kOpenCv4,
    kOpenCv2,
    kPlain,
    kOneLane,
    kTwoLanes,
    kThreeLanes,
    kTwoThreads,
    kFourOfTwo,
    kFourOfThree,
    kMethods
  };

  Decoders() {
    const auto turbo = [this](unsigned denominator) {
      return [this, denominator](const Picture& p) {
        return timed([&] { library_.decode(p.bytes, denominator, pixels_); });
      };
    };
    const auto opencv = [](int mode) {
      return [mode](const Picture& p) { return timed([&] { const cv::Mat luma = cv::imdecode(p.bytes, mode); }); };
    };
    const auto lanes = [this](Fast& fast) {
      return [this, &fast](const Picture& p) { return timed([&] { status_ = fast.decode(alone_, p.bytes, *out_); }); };
    };
    const auto four = [this](Fast& fast) {
      return [this, &fast](const Picture& p) {
        FourInTurn crew(*fast.state);
        Spent spent = timed([&] { status_ = fast.decode(crew, p.bytes, *out_); });
        spent.us -= crew.take_uncounted_us();
        return spent;
      };
    };
    methods_ = {{
        {"turbo 1/8", turbo(8)},
        {"turbo 1/4", turbo(4)},
        {"turbo 1/2", turbo(2)},
        {"turbo 1/1", turbo(1)},
        {"opencv 1/8", opencv(cv::IMREAD_REDUCED_GRAYSCALE_8)},
        {"opencv 1/4", opencv(cv::IMREAD_REDUCED_GRAYSCALE_4)},
        {"opencv 1/2", opencv(cv::IMREAD_REDUCED_GRAYSCALE_2)},
        {"plain",
         [this](const Picture& p) { return timed([&] { status_ = jpeg_dc::decode(*plain_, p.bytes, *out_); }); }},
        {"1 lane", lanes(one_lane_)},
        {"2 lanes", lanes(two_lanes_)},
        {"3 lanes", lanes(three_lanes_)},
        {"2 threads",
         [this](const Picture& p) {
           return timed(crew_, [&] { status_ = two_threads_.decode(crew_, p.bytes, *out_); });
         }},
        {"4 parts of 2 lanes", four(four_of_two_)},
        {"4 parts of 3 lanes", four(four_of_three_)},
    }};
  }

  // Empty: done. Otherwise what went wrong, one line.
  std::string run(const Picture& picture, int rounds) {
    const std::size_t pixels = library_.decode(picture.bytes, 8, pixels_);
    const Bytes expected(pixels_.begin(), pixels_.begin() + static_cast<std::ptrdiff_t>(pixels));
    for (Method& method : methods_) method.spent.clear();
    fallbacks_ = 0;
    for (int round = -1; round < rounds; ++round) {  // the first one warms up
      // By other steps in each round, so that none always comes after the same one. They have no divisor with the
      // number of methods, so each comes once.
      constexpr std::array<std::size_t, 6> kSteps{1, 3, 5, 9, 11, 13};
      static_assert(kMethods == 14);
      const std::size_t step = kSteps[static_cast<std::size_t>(round + 1) % kSteps.size()];
      for (std::size_t i = 0; i < kMethods; ++i) {
        const std::size_t turn = i * step % kMethods;
        Method& method = methods_[turn];
        std::fill_n(out_->pixels.begin(), pixels, std::uint8_t{0xA5});
        const std::uint32_t before = fallbacks_now();
        const Spent spent = method.decode(picture);
        if (round >= 0) method.spent.push_back(spent);
        if (turn < kPlain) continue;  // not ours
        fallbacks_ += fallbacks_now() - before;
        if (!status_.ok() || !std::equal(expected.begin(), expected.end(), out_->pixels.begin())) {
          return fmt::format("error: {}: {} differs from libjpeg-turbo (our decoder is wrong). Next: run the tests",
                             picture.name, method.name);
        }
      }
    }
    return {};
  }

  [[nodiscard]] std::span<const Method> methods() const { return methods_; }
  [[nodiscard]] double us(std::size_t method, Take take = Take::kMedian) const { return methods_[method].us(take); }
  // Times libjpeg-turbo 1/8.
  [[nodiscard]] double ratio(std::size_t method, Take take = Take::kMedian) const {
    return us(kTurbo8, take) / us(method, take);
  }
  // The same for two threads on cores that share nothing: computed.
  [[nodiscard]] double ratio_on_cores(Take take = Take::kMedian) const {
    return ratio(kThreeLanes, take) / methods_[kTwoThreads].path_share(take);
  }
  // What four parts cost more than one, percent.
  [[nodiscard]] double extra_of_two(Take take = Take::kMedian) const {
    return 100 * (us(kFourOfTwo, take) / us(kTwoLanes, take) - 1);
  }
  [[nodiscard]] double extra_of_three(Take take = Take::kMedian) const {
    return 100 * (us(kFourOfThree, take) / us(kThreeLanes, take) - 1);
  }
  // Decodings of the last picture that were left to the plain walk.
  [[nodiscard]] std::uint32_t fallbacks() const { return fallbacks_; }

 private:
  [[nodiscard]] std::uint32_t fallbacks_now() const {
    std::uint32_t sum = 0;
    for (const Fast* fast : {&one_lane_, &two_lanes_, &three_lanes_, &two_threads_, &four_of_two_, &four_of_three_}) {
      sum += fast->state->counts.by_plain_walk;
    }
    return sum;
  }

  Library library_;
  Bytes pixels_ = Bytes(std::size_t{kSensorWidth} * kSensorHeight);
  std::unique_ptr<LumaBuffer> out_ = std::make_unique<LumaBuffer>();
  Status status_;
  std::unique_ptr<jpeg_dc::State> plain_ = std::make_unique<jpeg_dc::State>();
  hal::Alone alone_;
  drivers::Threads threads_{{.workers = 2}};
  tool::TimedCrew crew_{threads_};
  // Each its own memory, as none must find it warm from another one's work.
  Fast one_lane_{1, 1};
  Fast two_lanes_{2, 1};
  Fast three_lanes_{3, 1};
  Fast two_threads_{3, 2};
  Fast four_of_two_{2, hal::kMaxWorkers};
  Fast four_of_three_{3, hal::kMaxWorkers};
  std::array<Method, kMethods> methods_;
  std::uint32_t fallbacks_ = 0;
};

// ---- Goals ----

class Goal {
 public:
  enum class Is : std::uint8_t { kAtLeast, kAtMost };
  Goal(std::string what, Is is, double limit) : what_(std::move(what)), is_(is), limit_(limit) {}

  // Figures of one picture by medians and by fastest rounds; those that are not numbers are not seen.
  void see(double by_median, double by_fastest, const std::string& where) {
    if (std::isnan(by_median)) return;
    by_median_.see(is_, by_median, where);
    by_fastest_.see(is_, by_fastest, where);
  }
  void print() const {
    const bool met = is_ == Is::kAtLeast ? by_median_.figure >= limit_ : by_median_.figure <= limit_;
    fmt::print("  {:5} {}, {} {:g}",
               by_median_.where.empty() ? "-"
               : met                    ? "ok"
                                        : "short",
               what_, is_ == Is::kAtLeast ? "at least" : "at most", limit_);
    if (by_median_.where.empty()) {
      fmt::print(": not measured\n");
      return;
    }
    fmt::print(": {:.2f} ({}); fastest {:.2f} ({})\n", by_median_.figure, by_median_.where, by_fastest_.figure,
               by_fastest_.where);
  }

 private:
  struct Worst {
    double figure = 0;
    std::string where;  // empty: none

    void see(Is is, double seen, const std::string& at) {
      if (!where.empty() && (is == Is::kAtLeast ? seen >= figure : seen <= figure)) return;
      figure = seen;
      where = at;
    }
  };
  std::string what_;
  Is is_;
  double limit_;
  Worst by_median_;
  Worst by_fastest_;
};

struct Goals {
  using Is = Goal::Is;
  Goal large_422{"one thread, 3280x2464 4:2:2 from 500 kB, times libjpeg-turbo 1/8", Is::kAtLeast, 5.0};
  Goal large_420{"one thread, 3280x2464 4:2:0 from 500 kB", Is::kAtLeast, 4.7};
  Goal any{"one thread, any picture", Is::kAtLeast, 2.5};
  Goal two_threads{"two threads, critical path, 3280x2464 from 500 kB", Is::kAtLeast, 9.0};
  Goal two_cores{"two threads, computed for cores that share nothing", Is::kAtLeast, 9.0};
  Goal four_of_two{"extra work of four parts, 2 lanes, 3280x2464 from 500 kB, percent", Is::kAtMost, 3.0};
  Goal four_of_three{"extra work of four parts, 3 lanes", Is::kAtMost, 3.0};
  Goal decision{"JPEG to decision, one thread, times OpenCV", Is::kAtLeast, 6.0};
  Goal decision_two{"JPEG to decision, two threads, critical path", Is::kAtLeast, 10.0};
  Goal decision_cores{"JPEG to decision, two threads, computed for cores that share nothing", Is::kAtLeast, 10.0};
  Goal error{"error of the markers, times OpenCV's", Is::kAtMost, 0.6};

  void print() const {
    fmt::print("goals, by medians; worst figure of each\n");
    for (const Goal* goal : {&large_422, &large_420, &any, &two_threads, &two_cores, &four_of_two, &four_of_three,
                             &decision, &decision_two, &decision_cores, &error}) {
      goal->print();
    }
  }
};

// ---- Table A: decoders ----

class Csv {
 public:
  explicit Csv(const std::string& path) : wanted_(!path.empty()) {
    if (!wanted_) return;
    out_.open(path);
    out_ << "picture,bytes,method,cpu_us,fastest_cpu_us,all_cpu_us,wall_us,alone\n";
  }
  void add(const std::string& picture, std::size_t bytes, const Method& method) {
    if (!wanted_) return;
    out_ << fmt::format("{},{},{},{:.2f},{:.2f},{:.2f},{:.2f},{}\n", picture, bytes, method.name,
                        method.us(Take::kMedian), method.us(Take::kFastest), method.median_of(&Spent::all_us),
                        method.median_of(&Spent::wall_us), method.alone());
  }
  [[nodiscard]] bool ok() { return !wanted_ || out_.flush().good(); }

 private:
  bool wanted_;
  std::ofstream out_;
};

void print_heading() {
  fmt::print(
      "JPEG to luma: times libjpeg-turbo 1/8, by thread CPU time\n"
      "{:30} {:>5} {:>7} | {:^17} | {:^17} | {:^23} | {:^36} | {:^11} | plain\n"
      "{:30} {:>5} {:>7} | {:>5} {:>5} {:>5} | {:>5} {:>5} {:>5} | {:>5} {:>5} {:>5} {:>5} | {:>6} {:>6} {:>6} {:>6} "
      "{:>8} | "
      "{:>5} {:>5} | walks\n",
      "", "", "turbo", "turbo", "OpenCV", "ours, lanes:", "ours, two threads:", "4 parts, %", "picture", "kB", "1/8 ms",
      "1/4", "1/2", "1/1", "1/8", "1/4", "1/2", "plain", "1", "2", "3", "path", "cores", "wall", "work %", "alone", "2",
      "3");
}

void print_row(const Picture& picture, const Decoders& d) {
  using D = Decoders;
  const Method& two = d.methods()[D::kTwoThreads];
  fmt::print(
      "{:30} {:5} {:7.3f} | {:5.2f} {:5.2f} {:5.2f} | {:5.2f} {:5.2f} {:5.2f} | {:5.2f} {:5.2f} {:5.2f} {:5.2f} | ",
      picture.name, (picture.bytes.size() + 500) / 1000, d.us(D::kTurbo8) / 1000, d.ratio(D::kTurbo4),
      d.ratio(D::kTurbo2), d.ratio(D::kTurbo1), d.ratio(D::kOpenCv8), d.ratio(D::kOpenCv4), d.ratio(D::kOpenCv2),
      d.ratio(D::kPlain), d.ratio(D::kOneLane), d.ratio(D::kTwoLanes), d.ratio(D::kThreeLanes));
  fmt::print("{:6.2f} {:6.2f} {:6.2f} {:+6.1f} {:>8} | {:+5.1f} {:+5.1f} | {:5}\n", d.ratio(D::kTwoThreads),
             d.ratio_on_cores(), d.us(D::kTurbo8) / two.median_of(&Spent::wall_us),
             100 * (two.median_of(&Spent::all_us) / d.us(D::kThreeLanes) - 1),
             fmt::format("{}/{}", two.alone(), two.spent.size()), d.extra_of_two(), d.extra_of_three(), d.fallbacks());
  std::fflush(stdout);
}

void judge(const Picture& picture, const Decoders& d, Goals& goals) {
  const auto see = [&](Goal& goal, std::size_t method) {
    goal.see(d.ratio(method), d.ratio(method, Take::kFastest), picture.name);
  };
  see(goals.any, Decoders::kThreeLanes);
  if (picture.width != kSensorWidth || picture.bytes.size() < kLarge) return;
  see(picture.down == 1 ? goals.large_422 : goals.large_420, Decoders::kThreeLanes);
  see(goals.two_threads, Decoders::kTwoThreads);
  goals.two_cores.see(d.ratio_on_cores(), d.ratio_on_cores(Take::kFastest), picture.name);
  goals.four_of_two.see(d.extra_of_two(), d.extra_of_two(Take::kFastest), picture.name);
  goals.four_of_three.see(d.extra_of_three(), d.extra_of_three(Take::kFastest), picture.name);
}

// ---- Table B: from JPEG to decision ----

struct Error {
  double square_sum = 0;
  long found = 0;
  long missed = 0;

  // Range: px of the working image; a marker further off than `reach_px` is missed.
  void judge(const std::vector<Point>& truth, const std::vector<Point>& seen, double reach_px) {
    for (const Point& dot : truth) {
      double nearest = reach_px;
      for (const Point& p : seen) nearest = std::min(nearest, reference_model::distance(dot, p));
      if (nearest >= reach_px) {
        ++missed;
        continue;
      }
      square_sum += nearest * nearest;
      ++found;
    }
  }
  [[nodiscard]] double rms() const { return std::sqrt(square_sum / static_cast<double>(found)); }
};

// The strongest rival that takes the paper's method: OpenCV's own decoding at 1/8, then Canny and SimpleBlobDetector,
// tuned to the size of the dots, then the features in floating point. Told where the markers lie at first.
class Rival {
 public:
  Rival(const scene::PictureConfig& working, const std::vector<Point>& first)
      : pitch_px_(reference_model::Grid{}.pitch_mm * working.px_per_mm) {
    const double radius_px = working.dot_diameter_mm * working.px_per_mm / 2;
    const double area = M_PI * radius_px * radius_px;
    cv::SimpleBlobDetector::Params params;
    params.minArea = static_cast<float>(0.3 * area);
    params.maxArea = static_cast<float>(3.0 * area);
    params.minDistBetweenBlobs = static_cast<float>(0.4 * pitch_px_);
    detector_ = cv::SimpleBlobDetector::create(params);
    for (const Point& p : first) last_.emplace_back(p);
  }

  void update(std::span<const std::uint8_t> bytes, std::int64_t timestamp_us) {
    const cv::Mat whole(1, static_cast<int>(bytes.size()), CV_8UC1, const_cast<std::uint8_t*>(bytes.data()));
    const cv::Mat luma = cv::imdecode(whole, cv::IMREAD_REDUCED_GRAYSCALE_8);
    cv::Mat edges;
    cv::Canny(luma, edges, 50, 150);
    blobs_.clear();
    detector_->detect(luma, blobs_);
    reference_model::Positions now(last_.size());
    for (std::size_t i = 0; i < last_.size(); ++i) {
      double nearest = pitch_px_ / 2;
      for (const cv::KeyPoint& blob : blobs_) {
        const Point p{blob.pt.x, blob.pt.y};
        const double away = reference_model::distance(*last_[i], p);
        if (away >= nearest) continue;
        nearest = away;
        now[i] = p;
      }
    }
    if (rest_.empty()) rest_ = now;
    features_ = model_.update(now, rest_, pitch_px_, timestamp_us);
    for (std::size_t i = 0; i < last_.size(); ++i) {
      if (now[i]) last_[i] = now[i];
    }
  }
  [[nodiscard]] std::vector<Point> seen() const {
    std::vector<Point> out;
    for (const cv::KeyPoint& blob : blobs_) out.push_back({blob.pt.x, blob.pt.y});
    return out;
  }

 private:
  double pitch_px_;
  cv::Ptr<cv::SimpleBlobDetector> detector_;
  std::vector<cv::KeyPoint> blobs_;
  reference_model::Positions last_;  // all known
  reference_model::Positions rest_;
  reference_model::Model model_;
  reference_model::Features features_;
};

std::vector<Point> seen(const MarkerField& field) {
  std::vector<Point> out;
  for (int i = 0; i < field.grid.count(); ++i) {
    const Marker& marker = field.markers[idx(i)];
    if (marker.valid) out.push_back({marker.x.raw() / 256.0, marker.y.raw() / 256.0});
  }
  return out;
}

// One scene, each frame by all methods. Empty: done. Otherwise what went wrong, one line.
std::string run_to_decision(double sigma, Csv& csv, Goals& goals) {
  sim::Clock clock;
  scene::Scene scene = scene::sphere_slip();
  scene.effects.pixel_noise = sigma;
  sim::SceneCamera camera(scene, clock);
  const scene::PictureConfig working = scene::scaled(camera.picture(), kSensorWidth / 8);
  const auto truth = [&camera] {
    std::vector<Point> out;
    for (const Point& p : camera.marker_centers()) out.push_back({(p.x + 0.5) / 8 - 0.5, (p.y + 0.5) / 8 - 0.5});
    return out;
  };

  enum : std::size_t { kRival, kByLibrary, kOneThread, kTwoThreads, kMethods };
  std::vector<Method> methods(kMethods);
  methods[kRival].name = "OpenCV 1/8, Canny, SimpleBlobDetector";
  methods[kByLibrary].name = "ours, decoded by libjpeg-turbo";
  methods[kOneThread].name = "ours, one thread";
  methods[kTwoThreads].name = "ours, two threads";
  std::array<Error, kMethods> errors;

  drivers::TurboJpegDecoder library;
  hal::Alone alone;
  drivers::Threads threads({.workers = 2});
  tool::TimedCrew two(threads);
  std::vector<jpeg_fast::Worker> workers(3);
  const auto one_thread =
      std::make_unique<EighthDecoder>(EighthDecoder::Config{}, library, std::span(workers).first(1), alone);
  const auto two_threads =
      std::make_unique<EighthDecoder>(EighthDecoder::Config{}, library, std::span(workers).last(2), two);
  const std::array<JpegDecoder*, kMethods> decoders{nullptr, &library, one_thread.get(), two_threads.get()};
  std::array<std::unique_ptr<pipeline::State>, kMethods> states;
  for (auto& state : states) state = std::make_unique<pipeline::State>();
  const pipeline::Config pipeline_of_app = pipeline_config(Params{});
  std::unique_ptr<Rival> rival;

  if (!camera.start()) return "error: the simulated camera does not start (a bug). Next: run the tests";
  hal::Frame frame;
  int frames = 0;
  double bytes = 0;
  for (; camera.next(frame, std::chrono::seconds(1)) == hal::Capture::kFrame; ++frames) {
    const std::vector<Point> dots = truth();
    if (!rival) rival = std::make_unique<Rival>(working, dots);
    bytes += static_cast<double>(frame.bytes.size());
    for (std::size_t turn = 0; turn < kMethods; ++turn) {
      const std::size_t m = (turn + static_cast<std::size_t>(frames)) % kMethods;
      if (m == kRival) {
        methods[m].spent.push_back(timed([&] { rival->update(frame.bytes, frame.timestamp.count()); }));
        errors[m].judge(dots, rival->seen(), 0.3 * working.px_per_mm * scene.markers.pitch_mm);
        continue;
      }
      pipeline::Result result;
      const auto work = [&] { result = pipeline::update(*states[m], pipeline_of_app, *decoders[m], frame); };
      methods[m].spent.push_back(m == kTwoThreads ? timed(two, work) : timed(work));
      if (!result.quality.ok()) {
        return fmt::format("error: {}: frame {} is refused: {} (a bug). Next: run the tests", methods[m].name, frames,
                           info(result.quality.reason).what);
      }
      errors[m].judge(dots, seen(states[m]->tracker.field), 0.3 * working.px_per_mm * scene.markers.pitch_mm);
    }
    camera.release(frame);
  }
  if (frames == 0) return "error: the simulated camera gives no frame (no memory?). Next: run the tests";

  const auto mean_bytes = static_cast<std::size_t>(bytes / frames);
  const std::string name =
      fmt::format("{}x{} s{} q{}", camera.picture().width, camera.picture().height, sigma, scene.picture.jpeg_quality);
  fmt::print("{}, {} kB, {} frames of a scene\n", name, (mean_bytes + 500) / 1000, frames);
  const double scale = 320.0 / working.width;
  const auto ratio = [&](std::size_t m, Take take) { return methods[kRival].us(take) / methods[m].us(take); };
  for (std::size_t m = 0; m < kMethods; ++m) {
    fmt::print("  {:38} {:8.3f} ms {:6.2f}x   wall {:8.3f} ms   rms {:.4f} px of 320 ({:.2f}x)   missed {}",
               methods[m].name, methods[m].us(Take::kMedian) / 1000, ratio(m, Take::kMedian),
               methods[m].median_of(&Spent::wall_us) / 1000, errors[m].rms() * scale,
               errors[m].rms() / errors[kRival].rms(), errors[m].missed);
    if (m == kTwoThreads) fmt::print("   alone {}/{}", methods[m].alone(), methods[m].spent.size());
    fmt::print("\n");
    csv.add("decision " + name, mean_bytes, methods[m]);
  }
  std::fflush(stdout);
  goals.decision.see(ratio(kOneThread, Take::kMedian), ratio(kOneThread, Take::kFastest), name);
  goals.decision_two.see(ratio(kTwoThreads, Take::kMedian), ratio(kTwoThreads, Take::kFastest), name);
  const auto on_cores = [&](Take take) { return ratio(kOneThread, take) / methods[kTwoThreads].path_share(take); };
  goals.decision_cores.see(on_cores(Take::kMedian), on_cores(Take::kFastest), name);
  const double error = errors[kOneThread].rms() / errors[kRival].rms();
  goals.error.see(error, error, name);
  return {};
}

// ---- Program ----

struct Options {
  int rounds = 31;
  std::string only;
  std::string csv;
  std::string write;
};

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
  Options options;
  CLI::App app{"JPEG to luma and to decision: ours against libjpeg-turbo and OpenCV", "jpeg_bench"};
  app.add_option("--rounds", options.rounds, "times that each picture is decoded by each method")
      ->check(CLI::Range(3, 10'000))
      ->capture_default_str();
  app.add_option("--only", options.only, "pictures with this in their name, or 'decision' for the second table");
  app.add_option("--csv", options.csv, "file for all figures, a line for each picture and method");
  app.add_option("--write", options.write, "folder for the pictures as files; nothing is measured")
      ->check(CLI::ExistingDirectory);
  CLI11_PARSE(app, argc, argv);
  cv::setNumThreads(1);

  const auto chosen = [&](std::string_view name) { return name.find(options.only) != std::string_view::npos; };
  std::vector<Picture> all;
  if (options.only != "decision") all = pictures();
  all.erase(std::remove_if(all.begin(), all.end(), [&](const Picture& p) { return !chosen(p.name); }), all.end());
  if (!options.write.empty()) return write_all(all, options.write);

  if (all.empty() && !chosen("decision")) {
    fmt::print(stderr, "error: no picture has '{}' in its name. Next: run without --only to see the names\n",
               options.only);
    return 1;
  }
  Csv csv(options.csv);
  const auto complain_of_csv = [&] {
    fmt::print(stderr, "error: cannot write {} (no space, or no permission). Next: give another file\n", options.csv);
    return 1;
  };
  if (!csv.ok()) return complain_of_csv();
  Goals goals;
  fmt::print("{} rounds, {}\n", options.rounds, load());
  if (!all.empty()) {
    print_heading();
    const auto decoders = std::make_unique<Decoders>();
    for (const Picture& picture : all) {
      if (const std::string error = decoders->run(picture, options.rounds); !error.empty()) {
        fmt::print(stderr, "{}\n", error);
        return 1;
      }
      print_row(picture, *decoders);
      judge(picture, *decoders, goals);
      for (const Method& method : decoders->methods()) csv.add(picture.name, picture.bytes.size(), method);
    }
  }
  if (chosen("decision")) {
    fmt::print("JPEG to decision, by thread CPU time\n");
    for (const double sigma : {3.0, 8.0}) {
      if (const std::string error = run_to_decision(sigma, csv, goals); !error.empty()) {
        fmt::print(stderr, "{}\n", error);
        return 1;
      }
    }
  }
  goals.print();
  fmt::print("{} at the end\n", load());
  if (!csv.ok()) return complain_of_csv();
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
