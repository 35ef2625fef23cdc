// SPDX-License-Identifier: Apache-2.0
// session_bytes SCENE BYTES VALUES: what a board sends on its port `host` while SCENE is played and somebody has said
// `watch on`, and what the firmware's own decoder makes of it: the oracle of the page's live mode.
//
// The bytes are the console's. Somebody asks it things between the frames, so that there are lines of text; one status
// frame and one marker frame are damaged on the way.
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

#include "app/daemon.hpp"
#include "base/math.hpp"
#include "console/console.hpp"
#include "drivers/common/jpeg_turbo.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/gpio.hpp"
#include "drivers/sim/hande.hpp"
#include "drivers/sim/scene/file/scene_file.hpp"
#include "drivers/sim/serial.hpp"
#include "link/evidence_frame.hpp"
#include "link/link.hpp"
#include "link/load_frame.hpp"
#include "link/marker_frame.hpp"
#include "link/status_frame.hpp"
#include "toolchain/play/play.hpp"

namespace {

using namespace holdfast;
using nlohmann::json;

constexpr int kDamagedStatus = 40, kDamagedField = 9;

class Board {
 public:
  explicit Board(const scene::Scene& scene) : player_(scene, clock_) {
    params_.grid_cols = static_cast<std::int32_t>(scene.markers.cols);
    params_.grid_rows = static_cast<std::int32_t>(scene.markers.rows);
    daemon_ = std::make_unique<Daemon>(Devices{player_.camera(), gpio_, link_, clock_, jpeg_}, Periphery{hand_, keep_});
    console_ = std::make_unique<console::Console>(host_, *daemon_, clock_, console::Place{.board = "sim"});
  }

  [[nodiscard]] bool play() {
    if (!daemon_->start(params_).ok()) return false;
    console_->start(params_);
    type("watch on\r\n");
    for (int frame = 0; player_.step(daemon_->app(), params_, false); ++frame) {
      if (frame % 20 == 10) type("version json\r\n");
      for (int turn = 0; turn < 20; ++turn) console_->poll();
    }
    daemon_->stop();
    return console_->frames_lost() == 0;
  }

  [[nodiscard]] std::vector<std::uint8_t> bytes() const { return host_.output_bytes(); }

 private:
  void type(std::string_view text) {
    (void)host_.feed({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  }

  sim::Clock clock_;
  sim::Gpio gpio_{clock_};
  sim::Serial link_, host_{1 << 20};
  sim::HandE hand_{clock_};
  hal::NoKeep keep_;
  drivers::TurboJpegDecoder other_scales_;
  jpeg_fast::Worker worker_;
  hal::Alone crew_;
  EighthDecoder jpeg_{{}, other_scales_, {&worker_, 1}, crew_};
  tool::Player player_;
  Params params_;
  std::unique_ptr<Daemon> daemon_;
  std::unique_ptr<console::Console> console_;
};

// The fields of the session, as they were sent. Damages one frame of each kind; a field is a run of frames that begins
// with marker 0.
json damage(std::vector<std::uint8_t>& bytes) {
  link::Receiver receiver;
  json fields = json::array();
  int statuses = 0;
  std::size_t begin = 0;
  std::vector<std::size_t> broken;
  for (std::size_t k = 0; k < bytes.size(); ++k) {
    const link::Event event = receiver.push(bytes[k]);
    if (bytes[k] == 0 && event != link::Event::kFrame) begin = k + 1;
    if (event != link::Event::kFrame) continue;
    if (status_frame::read(receiver.payload()).ok() && statuses++ == kDamagedStatus) broken.push_back(begin + 11);
    if (const auto piece = marker_frame::read(link::Kind::kDisplacement, receiver.payload()); piece) {
      if (piece->first == 0)
        fields.push_back({{"sequence", piece->sequence}, {"damaged", false}, {"um", json::array()}});
      json& field = fields.back();
      for (std::int32_t m = 0; m < marker_frame::kPerFrame && piece->first + m < piece->rows * piece->cols; ++m) {
        const marker_frame::Point& point = piece->points[idx(m)];
        const bool valid = (piece->valid >> m & 1) != 0;
        field["um"].push_back(valid ? json{point.x_um, point.y_um} : json(nullptr));
      }
      if (fields.size() == kDamagedField + 1 && piece->first == 2 * marker_frame::kPerFrame) {
        field["damaged"] = true;
        broken.push_back(begin + 12);
      }
    }
    begin = k + 1;
  }
  for (const std::size_t at : broken)
    bytes[at] = static_cast<std::uint8_t>(bytes[at] ^ (bytes[at] == 0x40 ? 0x20 : 0x40));
  return fields;
}

template <typename Rows>
std::string name_in(const Rows& rows, std::uint8_t number) {
  for (const evidence_frame::Row& row : rows) {
    if (row.number == number) return std::string(row.name);
  }
  return {};
}

json evidence_of(const evidence_frame::EvidenceFrame& e) {
  return {{"sequence", e.sequence},
          {"finger", e.finger},
          {"contact", name_in(evidence_frame::kContacts, e.contact)},
          {"evidence", name_in(evidence_frame::kEvidences, e.evidence)},
          {"unit", evidence_frame::kUnits[e.unit]},
          {"run", e.run},
          {"patches", e.patches},
          {"value_milli", e.value_milli},
          {"threshold_milli", e.threshold_milli},
          {"motion_log2_um_q8", e.motion_log2_um_q8},
          {"coarse_log2_um_q8", e.coarse_log2_um_q8},
          {"growth_log2_q8", e.growth_log2_q8}};
}

json load_of(const load_frame::LoadFrame& l) {
  return {{"sequence", l.sequence},
          {"finger", l.finger},
          {"basis", name_in(load_frame::kBases, l.basis)},
          {"flags", l.flags},
          {"shear_x_mn", l.shear_x_mn},
          {"shear_y_mn", l.shear_y_mn},
          {"normal_mn", l.normal_mn},
          {"friction_use_permille", l.friction_use_permille}};
}

// What the firmware's decoder makes of the bytes.
json decoded(std::span<const std::uint8_t> bytes) {
  link::Receiver receiver;
  json frames = json::array();
  json evidence = json::array();
  json loads = json::array();
  json texts = json::array();
  std::string line;
  for (const std::uint8_t byte : bytes) {
    const link::Event event = receiver.push(byte);
    if (event == link::Event::kText) {
      for (const std::uint8_t letter : receiver.text()) {
        if (letter == '\n') texts.push_back(line), line.clear();
        if (letter != '\n' && letter != '\r') line += static_cast<char>(letter);
      }
    }
    if (event != link::Event::kFrame) continue;
    if (const auto e = evidence_frame::read(receiver.payload())) evidence.push_back(evidence_of(*e));
    if (const auto l = load_frame::read(receiver.payload())) loads.push_back(load_of(*l));
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
  return {{"status", frames}, {"evidence", evidence},          {"loads", loads},
          {"texts", texts},   {"damaged", receiver.damaged()}, {"frames", receiver.frames()}};
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
  std::vector<std::uint8_t> bytes = board->bytes();
  const json fields = damage(bytes);
  json values = decoded(bytes);
  values["fields"] = fields;
  std::ofstream(argv[2], std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
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
