// SPDX-License-Identifier: Apache-2.0
// digest [TABLE [RECORDING]]: what the firmware makes of a fixed set of recordings, as digest.hpp says. Compares with
// TABLE (digest.txt) when one is given; RECORDING leaves the others out. The product of one source is the same integers
// with every compiler, at every level of optimisation and on every processor; this is what shows it.
//
// Most recordings are drawn here with integers only. drivers/sim/scene draws better, but with doubles, so that a
// difference could be either side's: what it drew, a sphere that is pressed and slips, is committed as
// files in tests/data (setting_cost --data FOLDER writes them anew).
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

#include "drivers/sim/scene/picture/jpeg_encode.hpp"
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

// --- Pictures ---

struct Gel {
  std::int32_t width = 320;
  std::int32_t height = 240;
  int rows = 7;
  int cols = 9;
  std::int32_t pitch_px_q8 = 28 << 8;
};

// What is done to the gel. Lengths in 1/256 pitch.
struct Pose {
  std::int32_t press_q8 = 0;  // 0 nothing touches .. 256
  std::int32_t gel_x = 0;     // of the gel in the middle of the contact
  std::int32_t gel_y = 0;
  std::int32_t object_x = 0;  // of the object: the same while it sticks
  std::int32_t object_y = 0;
  std::int32_t twist_q8 = 0;  // of the gel about the middle, 1/256 rad
  std::int32_t jump_x = 0;    // of the whole picture
  std::int32_t light_q8 = 256;
};

constexpr std::int64_t blend(std::int64_t from, std::int64_t to, std::int64_t share_q8) {
  return from + ((to - from) * share_q8 >> 8);
}

// A height of 0..255 for each point of the object's skin: random at the corners of a mesh, blended between.
std::int32_t skin(std::int64_t x_q8, std::int64_t y_q8) {
  const auto corner = [](std::int64_t x, std::int64_t y) {
    const auto mixed =
        (static_cast<std::uint64_t>(x) * 0x9E3779B97F4A7C15u) ^ (static_cast<std::uint64_t>(y) * 0xC2B2AE3D27D4EB4Fu);
    return static_cast<std::int64_t>((mixed ^ mixed >> 29) * 0xBF58476D1CE4E5B9u >> 56);
  };
  const std::int64_t x = x_q8 >> 8, y = y_q8 >> 8;
  const std::int64_t above = blend(corner(x, y), corner(x + 1, y), x_q8 & 255);
  const std::int64_t below = blend(corner(x, y + 1), corner(x + 1, y + 1), x_q8 & 255);
  return static_cast<std::int32_t>(blend(above, below, y_q8 & 255));
}

class Painter {
 public:
  explicit Painter(const Gel& gel) : gel_(gel) {}

  void draw(const Pose& pose, Random& noise, Bytes& luma) const {
    luma.resize(static_cast<std::size_t>(gel_.width) * static_cast<std::size_t>(gel_.height));
    for (std::int32_t y = 0; y < gel_.height; ++y) {
      for (std::int32_t x = 0; x < gel_.width; ++x) luma[at(x, y)] = gel_at(pose, x, y);
    }
    for (int row = 0; row < gel_.rows; ++row) {
      for (int col = 0; col < gel_.cols; ++col) draw_dot(pose, row, col, luma);
    }
    for (std::uint8_t& pixel : luma) {
      const std::uint32_t bits = noise.bits();
      const auto level = static_cast<std::int32_t>(pixel + (bits >> 28 & 7) + (bits >> 24 & 7)) - 7;
      pixel = static_cast<std::uint8_t>(std::clamp(level, 0, 255));
    }
  }

 private:
  [[nodiscard]] std::size_t at(std::int32_t x, std::int32_t y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(gel_.width) + static_cast<std::size_t>(x);
  }
  [[nodiscard]] std::int64_t px_q8(std::int64_t pitches_q8) const { return pitches_q8 * gel_.pitch_px_q8 / 256; }

  // How firmly the object touches there: 256 in the middle, nothing from three pitches on. Of places from the middle.
  [[nodiscard]] std::int64_t firmness_q8(std::int64_t x_q8, std::int64_t y_q8) const {
    const std::int64_t radius_q8 = std::int64_t{3} * gel_.pitch_px_q8;
    const std::int64_t left = radius_q8 * radius_q8 - x_q8 * x_q8 - y_q8 * y_q8;
    return left <= 0 ? 0 : left * 256 / (radius_q8 * radius_q8);
  }

  [[nodiscard]] std::uint8_t gel_at(const Pose& pose, std::int32_t x, std::int32_t y) const {
    const std::int64_t from_left_q8 = (std::int64_t{x} << 8) - (std::int64_t{gel_.width - 1} << 7);
    const std::int64_t from_top_q8 = (std::int64_t{y} << 8) - (std::int64_t{gel_.height - 1} << 7);
    std::int64_t level = 140 + 30 * x / gel_.width - 20 * y / gel_.height;
    const std::int64_t firm_q8 = pose.press_q8 == 0 ? 0 : firmness_q8(from_left_q8, from_top_q8) * pose.press_q8 >> 8;
    if (firm_q8 > 0) {  // the skin's mesh is two fifths of a pitch wide
      const std::int64_t u = (from_left_q8 - px_q8(pose.object_x)) * 640 / gel_.pitch_px_q8;
      const std::int64_t v = (from_top_q8 - px_q8(pose.object_y)) * 640 / gel_.pitch_px_q8;
      level += (skin(u + (1 << 20), v + (1 << 20)) - 128) * firm_q8 >> 10;
    }
    return static_cast<std::uint8_t>(std::clamp<std::int64_t>(level * pose.light_q8 >> 8, 0, 255));
  }

  void draw_dot(const Pose& pose, int row, int col, Bytes& luma) const {
    const std::int64_t rest_x_q8 = std::int64_t{2 * col - gel_.cols + 1} * gel_.pitch_px_q8 / 2;
    const std::int64_t rest_y_q8 = std::int64_t{2 * row - gel_.rows + 1} * gel_.pitch_px_q8 / 2;
    const std::int64_t firm_q8 = firmness_q8(rest_x_q8, rest_y_q8);
    const std::int64_t move_x_q8 = px_q8(pose.gel_x) - (rest_y_q8 * pose.twist_q8 >> 8);
    const std::int64_t move_y_q8 = px_q8(pose.gel_y) + (rest_x_q8 * pose.twist_q8 >> 8);
    const std::int64_t x_q8 =
        rest_x_q8 + (move_x_q8 * firm_q8 >> 8) + px_q8(pose.jump_x) + (std::int64_t{gel_.width - 1} << 7);
    const std::int64_t y_q8 = rest_y_q8 + (move_y_q8 * firm_q8 >> 8) + (std::int64_t{gel_.height - 1} << 7);

    // A disc of 0.26 pitch. Near its rim (r^2 - d^2) / 2r is the distance to it, so no root is needed.
    const std::int64_t radius_q8 = std::int64_t{gel_.pitch_px_q8} * 67 / 256;
    const auto reach = static_cast<std::int32_t>((radius_q8 >> 8) + 2);
    const auto middle_x = static_cast<std::int32_t>(x_q8 >> 8), middle_y = static_cast<std::int32_t>(y_q8 >> 8);
    for (std::int32_t y = std::max(middle_y - reach, 0); y <= std::min(middle_y + reach + 1, gel_.height - 1); ++y) {
      for (std::int32_t x = std::max(middle_x - reach, 0); x <= std::min(middle_x + reach + 1, gel_.width - 1); ++x) {
        const std::int64_t dx_q8 = (std::int64_t{x} << 8) - x_q8, dy_q8 = (std::int64_t{y} << 8) - y_q8;
        const std::int64_t inside_q8 = (radius_q8 * radius_q8 - dx_q8 * dx_q8 - dy_q8 * dy_q8) / (2 * radius_q8);
        const std::int64_t covered_q8 = std::clamp<std::int64_t>(inside_q8 + 128, 0, 256);
        std::uint8_t& pixel = luma[at(x, y)];
        pixel = static_cast<std::uint8_t>(blend(pixel, 40 * pose.light_q8 >> 8, covered_q8));
      }
    }
  }

  Gel gel_;
};

// The grasp of all pictures: `still` frames of the empty gel, then in each `step` frames: pressed on, dragged with the
// object, held, slid on with the gel where it is, dragged back and released.
Pose grasp(int frame, int still, int step) {
  const auto share_q8 = [&](int phase) { return std::clamp((frame - still - phase * step) * 256 / step, 0, 256); };
  Pose pose;
  pose.press_q8 = share_q8(0) - share_q8(5);
  pose.gel_x = (share_q8(1) - share_q8(4)) * 110 / 256;
  pose.gel_y = (share_q8(1) - share_q8(4)) * 40 / 256;
  pose.object_x = pose.gel_x + share_q8(3) * 3;
  pose.object_y = pose.gel_y + share_q8(3);
  return pose;
}

// --- The recordings ---

hal::Frame frame_of(const Bytes& luma, const Gel& gel) {
  hal::Frame frame;
  frame.format = hal::PixelFormat::kLuma8;
  frame.bytes = luma;
  frame.width = frame.stride = gel.width;
  frame.height = gel.height;
  return frame;
}

Params params_of(const Gel& gel) {
  Params params;
  params.grid_rows = gel.rows;
  params.grid_cols = gel.cols;
  return params;
}

std::string grasp_of(std::string_view name, const Gel& gel, Params params) {
  Recorder recorder(params);
  const Painter painter(gel);
  Random noise(1);
  Bytes luma;
  for (int frame = 0; frame < 120; ++frame) {
    painter.draw(grasp(frame, 40, 12), noise, luma);
    recorder.show(frame_of(luma, gel));
  }
  return recorder.line(name);
}

std::string luma_9x7(std::string_view name) {
  const Gel gel;
  return grasp_of(name, gel, params_of(gel));
}

// The camera's picture in mode fast, and all features.
std::string luma_410(std::string_view name) {
  const Gel gel{.width = 410, .height = 308, .pitch_px_q8 = 35 << 8};
  Params params = params_of(gel);
  params.all_features = 1;
  return grasp_of(name, gel, params);
}

std::string luma_820(std::string_view name) {
  const Gel gel{.width = 820, .height = 616, .pitch_px_q8 = 17'777};
  return grasp_of(name, gel, params_of(gel));
}

// The largest printed grid sold, twisted to and fro.
std::string luma_10x8(std::string_view name) {
  const Gel gel{.rows = 8, .cols = 10, .pitch_px_q8 = 6'500};
  Params params = params_of(gel);
  params.all_features = 1;
  Recorder recorder(params);
  const Painter painter(gel);
  Random noise(2);
  Bytes luma;
  for (int frame = 0; frame < 100; ++frame) {
    Pose pose = grasp(frame, 30, 1000);
    const int swing = std::max(frame - 40, 0) % 40;
    pose.press_q8 = frame < 30 ? 0 : 256;
    pose.twist_q8 = std::min(swing, 40 - swing) * 3;
    painter.draw(pose, noise, luma);
    recorder.show(frame_of(luma, gel));
  }
  return recorder.line(name);
}

// What ends in searches, rejections and faults: jumps, light that goes, frames that are old, the same or no pictures.
std::string luma_faults(std::string_view name) {
  const Gel gel;
  Recorder recorder(params_of(gel));
  const Painter painter(gel);
  Random noise(3);
  Bytes luma;
  for (int frame = 0; frame < 160; ++frame) {
    Pose pose = grasp(frame, 20, 12);
    if (frame % 50 == 33) pose.jump_x = 180;
    if (frame >= 60 && frame < 68) pose.light_q8 = 8;
    if (frame >= 100 && frame < 106) pose.light_q8 = 700;
    if (frame != 45 && frame != 46) painter.draw(pose, noise, luma);  // else: the same picture again
    if (frame >= 110 && frame < 114) {                                // a smear over a corner
      for (std::size_t i = 0; i < luma.size() / 3; ++i) luma[i] = 120;
    }
    if (frame >= 120 && frame < 128)
      std::generate(luma.begin(), luma.end(), [&] { return static_cast<std::uint8_t>(noise.bits()); });
    recorder.show(frame_of(luma, gel), frame == 80 ? Micros{120'000} : Micros{0});
    if (frame == 130) recorder.tare();
  }
  return recorder.line(name);
}

// A camera's picture in 4:2:2, at the least size that mode fast decodes at 1/8. Drawn once for all modes.
const std::vector<Bytes>& jpeg_pictures(Gel& gel) {
  static std::vector<Bytes> pictures;
  gel = {.width = 2400, .height = 1800, .pitch_px_q8 = 205 << 8};
  const Painter painter(gel);
  Random noise(4);
  Bytes luma;
  Bytes rgb;
  for (int frame = 0; pictures.size() < 22; ++frame) {
    painter.draw(grasp(frame, 5, 4), noise, luma);
    rgb.resize(3 * luma.size());
    for (std::size_t i = 0; i < luma.size(); ++i) {
      rgb[3 * i] = static_cast<std::uint8_t>(std::min(luma[i] + 12, 255));
      rgb[3 * i + 1] = luma[i];
      rgb[3 * i + 2] = static_cast<std::uint8_t>(luma[i] - luma[i] / 8);
    }
    pictures.push_back(scene::encode_jpeg(rgb, gel.width, gel.height, scene::JpegInput::kRgb, 85));
  }
  return pictures;
}

// The last picture comes three times: whole, torn, and with bytes changed.
std::string jpeg(std::string_view name, std::string_view mode, std::int32_t lanes) {
  Gel gel;
  const std::vector<Bytes>& pictures = jpeg_pictures(gel);
  Params params = params_of(gel);
  params.reference_frames = 3;
  params.jpeg_lanes = lanes;
  params.mode = find_mode(mode).value_or(0);
  Recorder recorder(params);
  hal::Frame frame;
  frame.width = gel.width;
  frame.height = gel.height;
  for (const Bytes& picture : pictures) {
    frame.bytes = picture;
    recorder.show(frame);
  }
  Bytes damaged = pictures.back();
  frame.bytes = std::span(damaged).first(damaged.size() / 2);
  recorder.show(frame);
  frame.bytes = damaged;
  for (std::size_t i = damaged.size() / 3; i < damaged.size() / 3 + 400; ++i) damaged[i] ^= 0x55;
  recorder.show(frame);
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
             field.evenness, field.octave_entropy, field.residual_rate, field.flow_spread, field.flow_residual,
             field.flow_evenness, field.flow_along, field.flow_steady, field.dilation_rate, field.easing,
             f.imprint.motion, f.imprint.growth, f.imprint.coarse, f.imprint.patches);
    f.markers = random.within(45, 63);
    f.rates_valid = random.within(0, 9) != 0;
    f.gap = random.within(0, 99) == 0;
    recorder.show(f, {7, 9});
  }
  return recorder.line(name);
}

// --- What the simulator drew (tests/data) ---

constexpr const char* kFilmFile = "slip.mjpg";  // 2400x1800, the least size that mode fast decodes at 1/8
constexpr const char* kLumaFile = "slip.y8";    // kLumaWidth x kLumaHeight bytes a frame
constexpr std::int32_t kFilmWidth = 2400, kFilmHeight = 1800, kLumaWidth = 240, kLumaHeight = 180;
std::string data_folder = "tests/data";

// The rest position is learned from three frames, and the same press and slip come three times.
template <typename Show>
std::string slip_of(std::string_view name, std::size_t frames, const Show& show) {
  Params params;
  params.reference_frames = 3;
  params.all_features = 1;
  Recorder recorder(params);
  for (int round = 0; round < 3; ++round) {
    for (std::size_t i = 0; i < frames; ++i) recorder.show(show(i));
  }
  return recorder.line(name);
}

std::string scene_mjpg(std::string_view name) {
  const std::vector<test::Jpeg> film = test::read_mjpg(data_folder + "/" + kFilmFile);
  return slip_of(name, film.size(), [&](std::size_t i) {
    hal::Frame frame;
    frame.bytes = film[i];
    frame.width = kFilmWidth;
    frame.height = kFilmHeight;
    return frame;
  });
}

std::string scene_luma(std::string_view name) {
  std::ifstream file(data_folder + "/" + kLumaFile, std::ios::binary);
  const Bytes all{std::istreambuf_iterator<char>(file), {}};
  constexpr std::size_t kBytes = std::size_t{kLumaWidth} * kLumaHeight;
  return slip_of(name, all.size() / kBytes, [&](std::size_t i) {
    hal::Frame frame;
    frame.format = hal::PixelFormat::kLuma8;
    frame.bytes = std::span(all).subspan(i * kBytes, kBytes);
    frame.width = frame.stride = kLumaWidth;
    frame.height = kLumaHeight;
    return frame;
  });
}

struct Recording {
  std::string_view name;
  std::string (*digest)(std::string_view name);
};

constexpr std::array<Recording, 14> kRecordings{{
    {"scene_mjpg", scene_mjpg},
    {"scene_luma", scene_luma},
    {"luma_9x7", luma_9x7},
    {"luma_10x8", luma_10x8},
    {"luma_410", luma_410},
    {"luma_820", luma_820},
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
