// SPDX-License-Identifier: Apache-2.0
// digest [TABLE [RECORDING]]: what the firmware makes of a fixed set of recordings, as digest.hpp says. Compares with
// TABLE (digest.txt) when one is given; RECORDING leaves the others out. The product of one source is the same integers
// with every compiler, at every level of optimisation and on every processor; this is what shows it.
//
// Pictures are those that drivers/sim/scene drew, a sphere that is pressed and slips: it draws with doubles, so that a
// difference could be either side's, and they are committed as files in tests/data (setting_cost --data FOLDER writes
// them anew). Markers and features are drawn here, with integers only.
//
// Exit status: 0 the table's, or none was given; 1 another; 2 wrong arguments.
#include "tests/checks/digest.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "tests/support/mjpg_file.hpp"

namespace {

using namespace holdfast;
using test::Recorder;

using Bytes = std::vector<std::uint8_t>;

// Knuth's MMIX generator; its upper half is good.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  std::uint32_t bits() {
    state_ = state_ * 6364136223846793005u + 1442695040888963407u;
    return static_cast<std::uint32_t>(state_ >> 32);
  }
  // Range: low <= high, both int32.
  std::int32_t within(std::int64_t low, std::int64_t high) {
    return static_cast<std::int32_t>(
        low + static_cast<std::int64_t>(bits() * static_cast<std::uint64_t>(high - low + 1) >> 32));
  }

 private:
  std::uint64_t state_;
};

// --- What the simulator drew: a press and a slip (tests/data) ---

std::string data_folder = "tests/data";

struct Film {
  hal::PixelFormat format = hal::PixelFormat::kMjpeg;
  std::int32_t width = 2400, height = 1800;  // the least size that mode fast decodes at 1/8
  std::vector<Bytes> pictures;

  [[nodiscard]] hal::Frame frame(std::span<const std::uint8_t> bytes) const {
    hal::Frame frame;
    frame.format = format;
    frame.bytes = bytes;
    frame.width = width;
    frame.height = height;
    if (format == hal::PixelFormat::kLuma8) frame.stride = width;
    return frame;
  }
};

Film jpeg_film() {
  Film film;
  film.pictures = test::read_mjpg(data_folder + "/slip.mjpg");
  return film;
}

Film luma_film() {
  Film film{hal::PixelFormat::kLuma8, 240, 180, {}};
  std::ifstream file(data_folder + "/slip.y8", std::ios::binary);
  const Bytes all{std::istreambuf_iterator<char>(file), {}};
  const auto bytes = static_cast<std::ptrdiff_t>(film.width) * film.height;
  for (auto at = all.begin(); all.end() - at >= bytes; at += bytes) film.pictures.emplace_back(at, at + bytes);
  return film;
}

Params film_params() {
  Params params;
  params.reference_frames = 3;
  return params;
}

// The same press and slip three times.
std::string slip_of(std::string_view name, const Film& film) {
  Params params = film_params();
  params.all_features = 1;
  Recorder recorder(params);
  for (int round = 0; round < 3; ++round) {
    for (const Bytes& picture : film.pictures) recorder.show(film.frame(picture));
  }
  return recorder.line(name);
}

std::string scene_mjpg(std::string_view name) {
  return slip_of(name, jpeg_film());
}
std::string scene_luma(std::string_view name) {
  return slip_of(name, luma_film());
}

// What ends in searches, rejections and faults: jumps, light that goes, frames that are old, the same or no pictures.
std::string luma_faults(std::string_view name) {
  const Film film = luma_film();
  Recorder recorder(film_params());
  Random noise(3);
  Bytes luma;
  for (std::size_t frame = 0; frame < 160; ++frame) {
    const auto lit = [&](unsigned level_q8) {
      for (std::uint8_t& pixel : luma) pixel = static_cast<std::uint8_t>(std::min(pixel * level_q8 >> 8, 255U));
    };
    if (frame != 45 && frame != 46) luma = film.pictures.at(frame % film.pictures.size());  // else: the same again
    for (std::uint8_t& pixel : luma) pixel = static_cast<std::uint8_t>(std::min(pixel + (noise.bits() >> 30), 255U));
    if (frame % 50 == 33) std::rotate(luma.begin(), luma.begin() + 17, luma.end());
    if (frame >= 60 && frame < 68) lit(8);
    if (frame >= 100 && frame < 106) lit(700);
    if (frame >= 110 && frame < 114) std::fill_n(luma.begin(), luma.size() / 3, std::uint8_t{120});  // a smear
    if (frame >= 120 && frame < 128) {
      std::generate(luma.begin(), luma.end(), [&] { return static_cast<std::uint8_t>(noise.bits()); });
    }
    recorder.show(film.frame(luma), frame == 80 ? Micros{120'000} : Micros{0});
    if (frame == 130) recorder.tare();
  }
  return recorder.line(name);
}

// The last picture comes three times: whole, torn, and with bytes changed.
std::string jpeg(std::string_view name, std::string_view mode, std::int32_t lanes) {
  const Film film = jpeg_film();
  Params params = film_params();
  params.jpeg_lanes = lanes;
  params.mode = find_mode(mode).value_or(0);
  Recorder recorder(params);
  for (const Bytes& picture : film.pictures) recorder.show(film.frame(picture));
  Bytes damaged = film.pictures.back();
  recorder.show(film.frame(std::span(damaged).first(damaged.size() / 2)));
  for (std::size_t i = damaged.size() / 3; i < damaged.size() / 3 + 400; ++i) damaged[i] ^= 0x55;
  recorder.show(film.frame(damaged));
  return recorder.line(name);
}

std::string jpeg_plain(std::string_view name) {
  return jpeg(name, "fast", 0);
}
std::string jpeg_fast(std::string_view name) {
  return jpeg(name, "fast", 3);
}
std::string jpeg_balanced(std::string_view name) {
  return jpeg(name, "balanced", 3);
}
std::string jpeg_precise(std::string_view name) {
  return jpeg(name, "precise", 3);
}

// --- What is drawn here, with integers only ---

// Still for 20 frames, then a walk of the whole field, with noise on every marker and some of them missing; now and
// then a marker is thrown to the end of what a place can be.
std::string markers(std::string_view name, int rows, int cols) {
  Params params;
  params.grid_rows = rows;
  params.grid_cols = cols;
  params.all_features = 1;
  Recorder recorder(params);
  Random random(5);
  std::int32_t x_px_q8 = 0, y_px_q8 = 0;
  for (int frame = 0; frame < 600; ++frame) {
    MarkerField field;
    field.grid = {static_cast<std::uint8_t>(rows), static_cast<std::uint8_t>(cols)};
    const bool moves = frame >= 20;
    if (moves) {
      x_px_q8 = std::clamp(x_px_q8 + random.within(-1'200, 1'300), -8'000, 8'000);
      y_px_q8 = std::clamp(y_px_q8 + random.within(-700, 680), -8'000, 8'000);
    }
    for (int i = 0; i < field.grid.count(); ++i) {
      Marker& marker = field.markers[static_cast<std::size_t>(i)];
      const std::int32_t row = i / cols, col = i % cols, share = moves ? std::min(row, rows - 1 - row) + 1 : 0;
      const bool thrown = moves && random.within(0, 2'000) == 0;
      marker.x = PixelsQ8::from_raw(thrown ? PixelsQ8::kMax
                                           : 9'000 + col * 7'000 + share * x_px_q8 / 4 + random.within(-8, 8));
      marker.y = PixelsQ8::from_raw(thrown ? PixelsQ8::kMin
                                           : 9'000 + row * 7'000 + share * y_px_q8 / 4 + random.within(-8, 8));
      marker.valid = !moves || random.within(0, 25) != 0;
    }
    recorder.show(field);
  }
  return recorder.line(name);
}

std::string markers_9x7(std::string_view name) {
  return markers(name, 7, 9);
}
std::string markers_8x16(std::string_view name) {
  return markers(name, 16, 8);
}

// Every feature anywhere in its range, each power of two as likely as the next: so the tree's inner branches are taken,
// too, and the range's ends come.
template <typename Quantity>
void roll(Random& random, Quantity& value) {
  const std::int64_t end = std::int64_t{1} << random.within(0, 31);
  const std::int64_t rolled =
      random.within(std::max<std::int64_t>(-end, INT32_MIN), std::min<std::int64_t>(end, INT32_MAX));
  value =
      Quantity::from_raw(static_cast<std::int32_t>(std::clamp<std::int64_t>(rolled, Quantity::kMin, Quantity::kMax)));
}

std::string features(std::string_view name) {
  Recorder recorder(Params{});
  Random random(6);
  for (int frame = 0; frame < 20'000; ++frame) {
    Features f;
    FieldFeatures& field = f.field;
    const auto roll_all = [&](auto&... values) { (roll(random, values), ...); };
    roll_all(f.vx, f.vy, f.entropy, f.entropy_rate, field.shift, field.reach, field.residual, field.unevenness,
             field.evenness, field.octave_entropy, field.residual_rate, field.flow_shift, field.flow_spread,
             field.flow_residual, field.flow_evenness, field.flow_along, field.flow_steady, field.dilation_rate,
             field.easing, f.imprint.motion, f.imprint.growth, f.imprint.coarse, f.imprint.patches);
    f.markers = random.within(45, 63);
    f.rates_valid = random.within(0, 9) != 0;
    f.gap = random.within(0, 99) == 0;
    recorder.show(f, {7, 9});
  }
  return recorder.line(name);
}

struct Recording {
  std::string_view name;
  std::string (*digest)(std::string_view name);
};

constexpr std::array<Recording, 10> kRecordings{{
    {"scene_mjpg", scene_mjpg},
    {"scene_luma", scene_luma},
    {"luma_faults", luma_faults},
    {"jpeg_fast", jpeg_fast},
    {"jpeg_plain", jpeg_plain},
    {"jpeg_balanced", jpeg_balanced},
    {"jpeg_precise", jpeg_precise},
    {"markers_9x7", markers_9x7},
    {"markers_8x16", markers_8x16},
    {"features", features},
}};

}  // namespace

int main(int argc, char** argv) {
  const test::Table table(argc > 1 ? argv[1] : nullptr);
  if (argc > 3 || !table.readable()) {
    std::fputs("usage: digest [TABLE [RECORDING]], TABLE as tests/checks/digest.txt\n", stderr);
    return 2;
  }
  if (argc > 1) {
    const std::string path = argv[1];
    const std::size_t folder = path.find("tests/checks");
    if (folder != std::string::npos) data_folder = path.substr(0, folder) + "tests/data";
  }
  std::puts("# recording         frames, accepted, slips, hashes of input, markers, features, signals");
  bool same = true;
  for (const Recording& recording : kRecordings) {
    if (argc == 3 && recording.name != argv[2]) continue;
    same = table.agrees(recording.name, recording.digest(recording.name)) && same;
  }
  return same ? 0 : 1;
}
