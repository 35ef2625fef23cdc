// SPDX-License-Identifier: Apache-2.0
#include "toolchain/play/play.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <functional>
#include <utility>

#include "base/math.hpp"
#include "toolchain/play/rig.hpp"

namespace holdfast::tool {
namespace {

// How often a camera that is gone is looked for.
constexpr std::chrono::milliseconds kReplug{100};

bool has_pictures(const scene::Scene& scene) {
  return scene.level.inject == scene::Inject::kGrey || scene.level.inject == scene::Inject::kJpeg;
}

Micros stamp_of(const scene::Snapshot& snapshot) {
  return Micros(std::llround(snapshot.t_s * 1e6));
}

PixelsQ8 to_q8(double px, Saturations& saturations) {
  return PixelsQ8::saturate(std::llround(px * 256.0), saturations);
}

}  // namespace

MarkerField field_of(const scene::Scene& scene, const scene::PictureConfig& picture,
                     std::span<const scene::SeenMarker> seen, Saturations& saturations) {
  MarkerField field;
  field.grid = {static_cast<std::uint8_t>(scene.markers.rows), static_cast<std::uint8_t>(scene.markers.cols)};
  for (std::size_t i = 0; i < seen.size(); ++i) {
    const scene::PointPx at = scene::to_px(picture, seen[i].at_mm);
    field.markers[i] = {to_q8(at.x, saturations), to_q8(at.y, saturations), seen[i].valid};
  }
  return field;
}

Player::Player(const scene::Scene& scene, sim::Clock& clock)
    : scene_(scene),
      clock_(clock),
      camera_(scene, clock),
      faulty_(camera_, clock, sim::faults_of(scene), has_pictures(scene) ? sim::most_bytes(scene) : 0) {}

hal::Camera& Player::camera() {
  return faulty_;
}

hal::Frame Player::lent() const {
  if (has_pictures(scene_)) return camera_.lent();
  hal::Frame frame;
  frame.format = hal::PixelFormat::kLuma8;
  frame.width = frame.stride = picture().width;
  frame.height = picture().height;
  return frame;
}

bool Player::step(App& app, const Params& params, bool auto_grid) {
  if (has_pictures(scene_)) return step_picture(app, params, auto_grid);
  if (std::exchange(began_, true) && snapshot().frame + 1 >= scene::frame_count(scene_)) return false;
  camera_.pass();
  clock_.advance_to(stamp_of(snapshot()));
  scene::see_markers(camera_.simulation(), snapshot(), seen_);
  if (scene_.level.inject == scene::Inject::kMarkers) {
    step_markers(app);
  } else {
    step_features(app, params);
  }
  return true;
}

bool Player::step_picture(App& app, const Params& params, bool auto_grid) {
  const Micros end{std::llround(scene_.duration_s * 1e6)};
  while (true) {
    if (app.step()) {
      if (app.result().quality.reason == Reason::kNoFrame && clock_.now() <= end) continue;
      return app.result().quality.reason != Reason::kNoFrame;
    }
    do {
      if (clock_.now() + kReplug > end) return false;
      clock_.advance(kReplug);
    } while (!app.start(params, auto_grid).ok());
  }
}

void Player::step_markers(App& app) {
  const MarkerField field = field_of(scene_, picture(), seen_, saturations_);
  app.step_markers(field, clock_.now(), static_cast<std::uint32_t>(snapshot().frame));
}

// As if tracking and reference were perfect; the features are the firmware's own.
void Player::step_features(App& app, const Params& params) {
  DisplacementField field;
  field.grid = {static_cast<std::uint8_t>(scene_.markers.rows), static_cast<std::uint8_t>(scene_.markers.cols)};
  const auto micrometres = [&](double mm) { return Micrometres::saturate(std::llround(mm * 1e3), saturations_); };
  for (std::size_t i = 0; i < seen_.size(); ++i) {
    const scene::Vec2 rest = camera_.simulation().markers()[i];
    field.markers[i] = {micrometres(seen_[i].at_mm.x - rest.x), micrometres(seen_[i].at_mm.y - rest.y), seen_[i].valid};
  }
  const pipeline::Config config = pipeline_config(params);
  Features now = features::update(features_, config.features, field, clock_.now(), saturations_);
  now.field = field_features::update(field_features_, config.field, field, clock_.now(), saturations_);
  app.step_features(now, field.grid, clock_.now(), static_cast<std::uint32_t>(snapshot().frame));
}

PlayedFrame played(const Player& player, const App& app) {
  const scene::Snapshot& snapshot = player.snapshot();
  const pipeline::Result& result = app.result();
  return {snapshot.frame,     snapshot.t_s,          snapshot.level,      result.quality.ok(), result.referenced,
          app.outputs().slip, app.outputs().grip_ok, app.outputs().state, result.features};
}

std::optional<double> onset_s(const std::vector<PlayedFrame>& frames, scene::SlipLevel level) {
  const auto first = std::find_if(frames.begin(), frames.end(), [&](const PlayedFrame& f) { return f.level >= level; });
  return first == frames.end() ? std::nullopt : std::optional(first->t_s);
}

std::vector<Promise> check_promises(const scene::Expect& expect, const std::vector<PlayedFrame>& frames) {
  constexpr double kSameTime_s = 1e-6;
  std::vector<Promise> promises;
  const std::optional<double> onset = onset_s(frames, scene::SlipLevel::kHalf);
  const std::string began = onset ? fmt::format("at {:.3f} s", *onset) : "never";
  if (expect.onset_s) {
    promises.push_back(
        {fmt::format("half of the contact slips between {:.3f} and {:.3f} s", expect.onset_s->from_s,
                     expect.onset_s->to_s),
         began,
         onset && *onset >= expect.onset_s->from_s - kSameTime_s && *onset <= expect.onset_s->to_s + kSameTime_s});
  }
  if (expect.no_onset) promises.push_back({"half of the contact never slips", began, !onset});

  // A rise before the onset, or any without one.
  int alarms = 0;
  bool before = false;
  std::optional<double> raised;
  for (const PlayedFrame& f : frames) {
    const bool after = onset && f.t_s >= *onset - kSameTime_s;
    if (f.slip && !before && !after) ++alarms;
    if (f.slip && after && !raised) raised = f.t_s;
    before = f.slip;
  }
  if (expect.max_delay_ms) {
    const double delay_ms = raised ? (*raised - *onset) * 1e3 : 0.0;
    promises.push_back({fmt::format("slip within {:.0f} ms of the onset", *expect.max_delay_ms),
                        raised ? fmt::format("after {:.0f} ms", delay_ms) : "never raised",
                        raised && delay_ms <= *expect.max_delay_ms + 1e-3});
  }
  if (expect.false_alarms) {
    promises.push_back({fmt::format("at most {} false alarms", *expect.false_alarms), fmt::format("{}", alarms),
                        alarms <= *expect.false_alarms});
  }
  if (!expect.final_state.empty()) {
    const std::string_view state = frames.empty() ? "" : info(frames.back().state).name;
    promises.push_back(
        {fmt::format("state {} at the end", expect.final_state), std::string(state), state == expect.final_state});
  }
  for (const scene::Expect::Entropy& window : expect.entropy) {
    double sum = 0.0;
    int count = 0;
    for (const PlayedFrame& f : frames) {
      if (f.t_s < window.from_s - kSameTime_s || f.t_s > window.to_s + kSameTime_s) continue;
      if (!f.accepted || !f.referenced) continue;
      sum += f.features.entropy.raw() / 65536.0;
      ++count;
    }
    const double mean = count > 0 ? sum / count : 0.0;
    promises.push_back({fmt::format("E between {:.3f} and {:.3f} nat from {:.2f} to {:.2f} s", window.least_nat,
                                    window.most_nat, window.from_s, window.to_s),
                        count > 0 ? fmt::format("{:.3f} nat", mean) : "no frame",
                        count > 0 && mean >= window.least_nat && mean <= window.most_nat});
  }
  return promises;
}

std::vector<Promise> check_goals(const scene::Goal& goal, const std::vector<PlayedFrame>& frames) {
  scene::Expect wanted;
  wanted.max_delay_ms = goal.max_delay_ms;
  wanted.false_alarms = goal.false_alarms;
  wanted.final_state = goal.final_state;
  return check_promises(wanted, frames);
}

std::string goal_line(const Promise& goal, bool committed) {
  const char* const reached = committed ? "reached: make it a promise" : "reached";
  return fmt::format("{}: {}, {}", goal.what, goal.result, goal.met ? reached : "not reached yet");
}

std::vector<PlayedFrame> play(const scene::Scene& scene, const Params& params) {
  Rig rig(params);
  Player player(scene, rig.clock());
  App& app = rig.connect(player.camera());
  std::vector<PlayedFrame> frames;
  if (!app.start(params).ok()) return frames;
  while (player.step(app, params, false)) frames.push_back(played(player, app));
  return frames;
}

// --- effects that do nothing ---

namespace {

// FNV-1a over whatever a scene puts out.
class Hash {
 public:
  void add(std::uint64_t word) {
    for (int i = 0; i < 8; ++i) {
      value_ = (value_ ^ ((word >> (8 * i)) & 0xff)) * 0x100000001b3u;
    }
  }
  void add(double number) { add(std::bit_cast<std::uint64_t>(number)); }
  [[nodiscard]] std::uint64_t value() const { return value_; }

 private:
  std::uint64_t value_ = 0xcbf29ce484222325u;
};

std::uint64_t output_hash(scene::Scene scene) {
  Hash hash;
  if (!has_pictures(scene)) {
    scene::Simulation simulation(scene);
    std::vector<scene::SeenMarker> seen;
    for (int k = 0; k < scene::frame_count(scene); ++k) {
      scene::see_markers(simulation, simulation.next(), seen);
      for (const scene::SeenMarker& marker : seen) {
        hash.add(static_cast<std::uint64_t>(marker.valid));
        if (!marker.valid) continue;
        hash.add(marker.at_mm.x);
        hash.add(marker.at_mm.y);
      }
    }
    return hash.value();
  }
  // What changes the big picture changes the small one.
  scene.level.inject = scene::Inject::kGrey;
  scene.picture.width = 0;
  sim::Clock clock;
  Player player(scene, clock);
  hal::Frame frame;
  if (!player.camera().start()) return 0;
  const Micros end{std::llround(scene.duration_s * 1e6)};
  while (clock.now() <= end) {
    const hal::Capture capture = player.camera().next(frame, std::chrono::milliseconds(100));
    hash.add(static_cast<std::uint64_t>(capture));
    if (capture == hal::Capture::kGone) {
      clock.advance(kReplug);
      if (clock.now() > end || scene.faults.empty()) break;
      (void)player.camera().start();
      continue;
    }
    if (capture != hal::Capture::kFrame) continue;
    hash.add(static_cast<std::uint64_t>(frame.timestamp.count()));
    hash.add(static_cast<std::uint64_t>(clock.now().count()));
    for (const std::uint8_t byte : frame.bytes) hash.add(std::uint64_t{byte});
    player.camera().release(frame);
  }
  return hash.value();
}

struct Switch {
  std::string_view name;
  bool (*on)(const scene::Scene&);
  void (*off)(scene::Scene&);
};

template <auto kMember>
Switch effect(std::string_view name) {
  return {name, [](const scene::Scene& s) { return s.effects.*kMember != scene::Effects{}.*kMember; },
          [](scene::Scene& s) { s.effects.*kMember = scene::Effects{}.*kMember; }};
}

std::vector<Switch> switches() {
  using E = scene::Effects;
  return {
      effect<&E::press_dilation>("press_dilation"),
      effect<&E::creep_gain>("creep_gain"),
      effect<&E::drive_stiffness_n_per_mm>("drive_stiffness_n_per_mm"),
      effect<&E::damping_n_s_per_mm>("damping_n_s_per_mm"),
      effect<&E::marker_noise_um>("marker_noise_um"),
      effect<&E::marker_loss>("marker_loss"),
      effect<&E::marker_missing>("marker_missing"),
      effect<&E::marker_duplicates>("marker_duplicates"),
      effect<&E::fabrication_um>("fabrication_um"),
      effect<&E::fabrication_turn_deg>("fabrication_turn_deg"),
      effect<&E::pixel_noise>("pixel_noise"),
      effect<&E::dirt_specks>("dirt_specks"),
      effect<&E::light_drift_levels_per_s>("light_drift_levels_per_s"),
      effect<&E::light_flicker_levels>("light_flicker_levels"),
      effect<&E::exposure_ms>("exposure_ms"),
      effect<&E::rolling_shutter_ms>("rolling_shutter_ms"),
      effect<&E::worn_gel>("worn_gel"),
      effect<&E::dot_shading_levels>("dot_shading_levels"),
      effect<&E::gel_margins>("gel_margins"),
      {"kinetic_friction", [](const scene::Scene& s) { return s.object.kinetic_friction.has_value(); },
       [](scene::Scene& s) { s.object.kinetic_friction.reset(); }},
      {"compliance_mm_per_n", [](const scene::Scene& s) { return s.object.compliance_mm_per_n > 0.0; },
       [](scene::Scene& s) { s.object.compliance_mm_per_n = 0.0; }},
      {"mass_g", [](const scene::Scene& s) { return s.object.mass_g > 0.0; },
       [](scene::Scene& s) { s.object.mass_g = 0.0; }},
      {"texture", [](const scene::Scene& s) { return s.object.shape.texture != scene::TextureKind::kNone; },
       [](scene::Scene& s) { s.object.shape.texture = scene::TextureKind::kNone; }},
      {"relief", [](const scene::Scene& s) { return s.object.relief.kind != scene::ReliefKind::kNone; },
       [](scene::Scene& s) { s.object.relief.kind = scene::ReliefKind::kNone; }},
      {"faults", [](const scene::Scene& s) { return !s.faults.empty(); }, [](scene::Scene& s) { s.faults.clear(); }},
  };
}

}  // namespace

std::vector<std::string> unused_effects(const scene::Scene& scene) {
  std::vector<std::string> unused;
  std::optional<std::uint64_t> with;
  for (const Switch& effect : switches()) {
    if (!effect.on(scene)) continue;
    if (!with) with = output_hash(scene);
    scene::Scene without = scene;
    effect.off(without);
    if (output_hash(without) == *with) unused.emplace_back(effect.name);
  }
  return unused;
}

}  // namespace holdfast::tool
