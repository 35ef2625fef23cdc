// SPDX-License-Identifier: Apache-2.0
#include "toolchain/log/facts.hpp"

#include <algorithm>
#include <cmath>

#include "base/math.hpp"

namespace holdfast::log {
namespace {

constexpr double kQ8 = 256.0;

// 0: nothing moved that stands out of the noise.
double um_of(Log2Q8 value) {
  return value.raw() > 0 ? std::exp2(value.raw() / kQ8) : 0;
}

// Working pixel to the camera's: pixel centres are whole numbers in both.
double to_input(PixelsQ8 value, double scale) {
  return (value.raw() / kQ8 + 0.5) * scale - 0.5;
}

}  // namespace

FrameRecord facts_of(const App& app, long frame, double t_s, bool alive) {
  const pipeline::Result& result = app.result();
  const supervisor::Outputs& outputs = app.outputs();
  const Features& f = result.features;
  FrameRecord row;
  row.frame = static_cast<std::uint32_t>(frame);
  row.set_time(t_s);
  row.set_state(outputs.state, outputs.reason);
  row.alive = alive;
  row.accepted = result.quality.ok();
  row.features_valid = row.accepted && result.referenced;
  row.rates_valid = row.features_valid && f.rates_valid;
  row.slip = outputs.slip;
  row.grip_ok = outputs.grip_ok;
  if (!row.features_valid) return row;
  row.markers = static_cast<std::uint32_t>(f.markers);
  row.vx_mm_s = f.vx.raw() / 1000.0;
  row.vy_mm_s = f.vy.raw() / 1000.0;
  row.entropy_nat = f.entropy.raw() / 65536.0;
  row.entropy_rate_nat_s = f.entropy_rate.raw() / kQ8;
  std::copy(f.histogram.begin(), f.histogram.end(), row.histogram.begin());
  const evidence::Shown shown =
      evidence::show({app.tree()}, f, result.evidence, outputs.reason == Reason::kContactLost);
  row.evidence = shown.evidence;
  row.evidence_name = kEvidenceNames[static_cast<std::size_t>(shown.evidence)];
  row.evidence_value = static_cast<double>(shown.value_milli) / 1000;
  row.evidence_threshold = static_cast<double>(shown.threshold_milli) / 1000;
  row.evidence_unit = shown.unit;
  row.evidence_frames = static_cast<std::uint32_t>(result.run);
  row.contact_known = result.contact.judged;
  row.contact = contact::phase_of(result.contact, f.imprint.growth);
  row.imprint_um = um_of(f.imprint.motion);
  row.coarse_um = um_of(f.imprint.coarse);
  const load::Load& load = result.load;
  row.load_basis = load.basis;
  row.load_within = load.within;
  row.load_strained = load.strained;
  row.shear_x_n = load.shear_x.raw() / 1000.0;
  row.shear_y_n = load.shear_y.raw() / 1000.0;
  row.normal_n = load.normal.raw() / 1000.0;
  row.friction_use = load.friction_use.raw() / 1000.0;
  return row;
}

void arrows_of(const App& app, double scale, std::vector<Arrow>& arrows) {
  arrows.clear();
  const pipeline::Result& result = app.result();
  if (!result.quality.ok()) return;
  const holdfast::MarkerField& field = app.state().tracker.field;
  const holdfast::MarkerField& rest = app.state().reference.rest;
  for (int i = 0; i < field.grid.count(); ++i) {
    const Marker& marker = field.markers[idx(i)];
    Arrow arrow{to_input(marker.x, scale), to_input(marker.y, scale), 0, 0, marker.valid};
    if (result.referenced && rest.markers[idx(i)].valid) {
      arrow.dx_px = (marker.x.raw() - rest.markers[idx(i)].x.raw()) / kQ8 * scale;
      arrow.dy_px = (marker.y.raw() - rest.markers[idx(i)].y.raw()) / kQ8 * scale;
    } else {
      arrow.valid = arrow.valid && !result.referenced;
    }
    arrows.push_back(arrow);
  }
}

}  // namespace holdfast::log
