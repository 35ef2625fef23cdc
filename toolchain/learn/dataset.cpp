// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/dataset.hpp"

#include <algorithm>

#include "slip/classifier.hpp"
#include "toolchain/learn/firmware_row.hpp"
#include "toolchain/play/play.hpp"
#include "toolchain/play/rig.hpp"

namespace holdfast::learn {
namespace {

// Of the trial's largest force. Whoever presses with less is letting go: what slides then, is meant to.
constexpr double kReleaseShare = 0.5;

}  // namespace

std::vector<Label> labels_of(std::span<const Truth> truth) {
  std::vector<Label> labels;
  double most_n = 0.0;
  for (const Truth& now : truth) {
    const bool touches = now.normal_n >= kTouch_n;
    labels.push_back(!touches ? Label::kEmpty : now.level >= scene::SlipLevel::kHalf ? Label::kSlip : Label::kHold);
    most_n = std::max(most_n, now.normal_n);
  }
  for (std::size_t k = truth.size(); k-- > 0 && truth[k].normal_n < kReleaseShare * most_n;) {
    if (labels[k] != Label::kEmpty) labels[k] = Label::kOpen;
  }
  return labels;
}

void play_into(Samples& samples, const Planned& planned, scene::Inject inject) {
  const Params all = with_all_features(Params{});
  scene::Scene scene = planned.scene;
  scene.level.inject = inject;
  tool::Rig rig(all);
  tool::Player player(scene, rig.clock());
  App& app = rig.connect(player.camera());
  Trial trial = planned.trial;
  trial.first = static_cast<int>(samples.rows.size());
  std::vector<Truth> truths;
  if (app.start(all).ok()) {
    while (player.step(app, all, false)) {
      const scene::Snapshot& truth = player.snapshot();
      Row row = firmware_row(app.result());
      row.trial = static_cast<int>(samples.trials.size());
      row.frame = truth.frame;
      row.t_s = truth.t_s;
      row.slip_fraction = truth.contact.slip_fraction;
      row.slide_mm_s = truth.slide_mm_s;
      samples.rows.push_back(row);
      truths.push_back({truth.contact.normal_n, truth.level});
    }
  }
  trial.count = static_cast<int>(truths.size());
  const std::vector<Label> labels = labels_of(truths);
  for (std::size_t k = 0; k < labels.size(); ++k) {
    samples.rows[static_cast<std::size_t>(trial.first) + k].label = labels[k];
  }
  samples.trials.push_back(trial);
}

}  // namespace holdfast::learn
