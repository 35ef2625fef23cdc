// SPDX-License-Identifier: Apache-2.0
// session_bytes SCENE BYTES VALUES: what a board would send on its port `host` while SCENE is played, and what the
// firmware's own decoder makes of it: the oracle of the page's live mode.
//
// The status frames are the firmware's. The marker frames are encoded here, from its state, until it sends them by
// itself. Between frames there are lines of text; one status frame and one marker frame are damaged on the way.
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "app/app.hpp"
#include "app/link.hpp"
#include "app/status_frame.hpp"
#include "base/math.hpp"
#include "drivers/common/jpeg_turbo.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/gpio.hpp"
#include "drivers/sim/scene/scene_file.hpp"
#include "drivers/sim/serial.hpp"
#include "toolchain/play/play.hpp"

namespace {

using namespace holdfast;
using nlohmann::json;

constexpr int kMarkersPerFrame = 5;
constexpr int kFieldEvery = 5;  // pictures
constexpr int kDamagedStatus = 40, kDamagedField = 9;

struct Xy {
  std::int32_t x = 0, y = 0;
  bool valid = false;
};

class Board {
 public:
  explicit Board(const scene::Scene& scene) : scene_(scene), player_(scene, clock_) {
    params_.grid_cols = static_cast<std::int32_t>(scene.markers.cols);
    params_.grid_rows = static_cast<std::int32_t>(scene.markers.rows);
    app_ = std::make_unique<App>(Devices{player_.camera(), gpio_, link_, clock_, jpeg_});
  }

  [[nodiscard]] bool play() {
    if (!app_->start(params_).ok()) return false;
    text("holdfastd: port host, 115200 8N1\r\nslip> watch on\r\nOK\r\n");
    for (int frame = 0; player_.step(*app_, params_, false); ++frame) {
      status(frame);
      if (frame % kFieldEvery == 0) markers(frame);
      if (frame % 20 == 10) text("temp 48.2 C, late 0 of " + std::to_string(frame) + "\r\n");
    }
    app_->stop();
    return true;
  }

  [[nodiscard]] const std::vector<std::uint8_t>& bytes() const { return bytes_; }
  [[nodiscard]] const json& fields() const { return fields_; }
  [[nodiscard]] const json& texts() const { return texts_; }

 private:
  void text(const std::string& lines) {
    bytes_.insert(bytes_.end(), lines.begin(), lines.end());
    std::string line;
    for (const char c : lines) {
      if (c == '\n') texts_.push_back(line), line.clear();
      if (c != '\n' && c != '\r') line += c;
    }
  }

  // Everything that the firmware wrote in this step.
  void status(int frame) {
    std::vector<std::uint8_t> wire = link_.output_bytes();
    link_.clear_output();
    if (frame == kDamagedStatus) wire[11] = static_cast<std::uint8_t>(wire[11] ^ 0x40);
    bytes_.push_back(0);
    bytes_.insert(bytes_.end(), wire.begin(), wire.end());
  }

  void markers(int frame) {
    const pipeline::State& state = app_->state();
    if (!app_->result().quality.ok() || !app_->result().referenced) return;
    // The status frame of this step is the newest one.
    const std::uint16_t sequence = sequence_of_last();
    const GridSize grid = state.tracker.field.grid;
    std::vector<Xy> moved, rest;
    for (int i = 0; i < grid.count(); ++i) {
      const MarkerDisplacement& d = state.displacement.markers[idx(i)];
      moved.push_back({d.dx.raw(), d.dy.raw(), d.valid});
    }
    if (!rest_sent_) rest = resting(state, grid);
    rest_sent_ = true;
    if (!rest.empty()) send(5, sequence, grid, rest, false);
    const bool damaged = fields_.size() == kDamagedField;
    send(4, sequence, grid, moved, damaged);
    json values = json::array();
    for (const Xy& m : moved) values.push_back(m.valid ? json{m.x, m.y} : json(nullptr));
    fields_.push_back({{"frame", frame}, {"sequence", sequence}, {"damaged", damaged}, {"um", values}});
  }

  // About the centre of the lattice: the mean of the rest positions.
  std::vector<Xy> resting(const pipeline::State& state, GridSize grid) const {
    const auto& markers = state.reference.rest.markers;
    std::int64_t x = 0, y = 0, count = 0;
    for (int i = 0; i < grid.count(); ++i) {
      if (!markers[idx(i)].valid) continue;
      x += markers[idx(i)].x.raw(), y += markers[idx(i)].y.raw(), ++count;
    }
    std::vector<Xy> out;
    const auto um = [&](std::int64_t px_q8) {
      return static_cast<std::int32_t>(px_q8 * params_.pitch_um / state.reference.pitch.raw());
    };
    for (int i = 0; i < grid.count(); ++i) {
      const Marker& m = markers[idx(i)];
      out.push_back({um(m.x.raw() - x / count), um(m.y.raw() - y / count), m.valid});
    }
    return out;
  }

  void send(std::uint8_t kind, std::uint16_t sequence, GridSize grid, const std::vector<Xy>& list, bool damaged) {
    for (std::size_t first = 0; first < list.size(); first += kMarkersPerFrame) {
      link::Payload payload;
      payload.size = 30;
      auto& b = payload.bytes;
      b[0] = link::kVersion, b[1] = kind;
      link::detail::store(payload, 2, 2, sequence);
      b[4] = grid.rows, b[5] = grid.cols, b[6] = static_cast<std::uint8_t>(first);
      for (std::size_t k = 0; k < kMarkersPerFrame && first + k < list.size(); ++k) {
        const Xy& m = list[first + k];
        const auto wire = [](std::int32_t v) { return static_cast<std::uint32_t>(std::clamp(v, -32'768, 32'767)); };
        if (m.valid) b[7] = static_cast<std::uint8_t>(b[7] | 1U << k);
        link::detail::store(payload, 8 + 4 * k, 2, m.valid ? wire(m.x) : 0);
        link::detail::store(payload, 10 + 4 * k, 2, m.valid ? wire(m.y) : 0);
      }
      std::array<std::uint8_t, link::kMaxWireBytes> wire{};
      const std::size_t size = link::seal(payload, wire);
      if (damaged && first == 10) wire[12] = static_cast<std::uint8_t>(wire[12] ^ 0x01);
      bytes_.push_back(0);
      bytes_.insert(bytes_.end(), wire.begin(), wire.begin() + static_cast<std::ptrdiff_t>(size));
    }
  }

  [[nodiscard]] std::uint16_t sequence_of_last() const {
    link::Receiver receiver;
    std::uint16_t sequence = 0;
    for (const std::uint8_t byte : bytes_) {
      if (receiver.push(byte) != link::Event::kFrame) continue;
      if (const auto decoded = status_frame::read(receiver.payload()); decoded.ok()) sequence = decoded.frame.sequence;
    }
    return sequence;
  }

  const scene::Scene& scene_;
  sim::Clock clock_;
  sim::Gpio gpio_{clock_};
  sim::Serial link_;
  drivers::TurboJpegDecoder other_scales_;
  jpeg_fast::Worker worker_;
  hal::Alone crew_;
  EighthDecoder jpeg_{{}, other_scales_, {&worker_, 1}, crew_};
  tool::Player player_;
  Params params_;
  std::unique_ptr<App> app_;
  std::vector<std::uint8_t> bytes_;
  json fields_ = json::array();
  json texts_ = json::array();
  bool rest_sent_ = false;
};

// What the firmware's decoder makes of the bytes.
json decoded(std::span<const std::uint8_t> bytes) {
  link::Receiver receiver;
  json frames = json::array();
  for (const std::uint8_t byte : bytes) {
    if (receiver.push(byte) != link::Event::kFrame) continue;
    const auto [error, f] = status_frame::read(receiver.payload());
    if (error != link::DecodeError::kNone) continue;
    frames.push_back({{"sequence", f.sequence},
                      {"timestamp_us", f.timestamp_us},
                      {"age_100us", f.age_100us},
                      {"state", info(f.state).name},
                      {"reason", info(f.reason).name},
                      {"slip", f.slip},
                      {"grip_ok", f.grip_ok},
                      {"features_valid", f.features_valid},
                      {"alive", f.alive},
                      {"markers", f.markers},
                      {"vx_um_s", f.vx_um_s},
                      {"vy_um_s", f.vy_um_s},
                      {"entropy_nat_q16", f.entropy_nat_q16},
                      {"entropy_rate_nat_s_q8", f.entropy_rate_nat_s_q8}});
  }
  return {{"status", frames}, {"damaged", receiver.damaged()}, {"frames", receiver.frames()}};
}

int run(int argc, char** argv) {
  if (argc != 4) {
    std::fprintf(stderr, "usage: session_bytes SCENE BYTES VALUES\n");
    return 2;
  }
  const scene::SceneResult read = scene::read_scene_file(argv[1]);
  if (!read.scene) {
    std::fprintf(stderr, "%s: no such scene. Next: give one of tests/scenes\n", argv[1]);
    return 1;
  }
  const auto board = std::make_unique<Board>(*read.scene);
  if (!board->play()) {
    std::fprintf(stderr, "%s: the firmware did not start. Next: holdfast scene check\n", argv[1]);
    return 1;
  }
  json values = decoded(board->bytes());
  values["fields"] = board->fields();
  values["texts"] = board->texts();
  std::ofstream(argv[2], std::ios::binary)
      .write(reinterpret_cast<const char*>(board->bytes().data()), static_cast<std::streamsize>(board->bytes().size()));
  std::ofstream out(argv[3]);
  out << values.dump();
  return out.flush() ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
