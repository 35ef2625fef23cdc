// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/dataset.hpp"

#include <algorithm>

#include "drivers/sim/scene/contact.hpp"
#include "slip/classifier.hpp"
#include "toolchain/learn/firmware_row.hpp"
#include "toolchain/play/play.hpp"
#include "toolchain/play/rig.hpp"

namespace holdfast::learn {
namespace {

// Less is a touch at most: the gel's own noise is as large.
constexpr double kTouch_n = 0.02;
// Of the trial's largest force. Whoever presses with less is letting go: what slides then, is meant to.
constexpr double kReleaseShare = 0.5;

scene::Scene varied(scene::Scene scene, const Variation& variation) {
  if (variation.fps) scene.fps = *variation.fps;
  if (variation.marker_noise_um) scene.effects.marker_noise_um = *variation.marker_noise_um;
  if (variation.marker_loss) scene.effects.marker_loss = *variation.marker_loss;
  if (variation.shear_modulus_mpa) scene.gel.shear_modulus_mpa = *variation.shear_modulus_mpa;
  scene.level.inject = variation.inject.value_or(scene::Inject::kMarkers);
  return scene;
}

Label label_of(const scene::Snapshot& truth) {
  if (truth.contact.normal_n < kTouch_n) return Label::kEmpty;
  return truth.level >= scene::SlipLevel::kHalf ? Label::kSlip : Label::kHold;
}

}  // namespace

void play_into(Samples& samples, const Planned& planned, const Params& params, const Variation& variation,
               const Watch& watch) {
  const Params all = with_all_features(params);
  const scene::Scene scene = varied(planned.scene, variation);
  tool::Rig rig(all);
  tool::Player player(scene, rig.clock());
  App& app = rig.connect(player.camera());
  Trial trial = planned.trial;
  trial.first = static_cast<int>(samples.rows.size());
  std::vector<double> press_n;
  if (app.start(all).ok()) {
    while (player.step(app, all, false)) {
      const scene::Snapshot& truth = player.snapshot();
      Row row = firmware_row(app.result());
      row.trial = static_cast<int>(samples.trials.size());
      row.frame = truth.frame;
      row.t_s = truth.t_s;
      row.label = label_of(truth);
      row.slip_fraction = truth.contact.slip_fraction;
      row.slide_mm_s = truth.slide_mm_s;
      samples.rows.push_back(row);
      press_n.push_back(truth.contact.normal_n);
      if (watch) watch(app, truth);
    }
  }
  trial.count = static_cast<int>(press_n.size());
  const double most_n = press_n.empty() ? 0.0 : std::ranges::max(press_n);
  for (std::size_t k = press_n.size(); k-- > 0 && press_n[k] < kReleaseShare * most_n;) {
    Label& label = samples.rows[static_cast<std::size_t>(trial.first) + k].label;
    if (label != Label::kEmpty) label = Label::kOpen;
  }
  samples.trials.push_back(trial);
}

}  // namespace holdfast::learn
