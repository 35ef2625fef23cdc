// SPDX-License-Identifier: Apache-2.0
// How exact the forces are that the firmware reads (tactile/load.hpp): simulated grasps drawn by a seed, filmed as
// pictures with their noise, against the simulator's own truth. Nothing of the weights was fitted on a simulated grasp.
//
//   loads [COUNT [SEED]]    the first COUNT grasps (240) of each kind of that seed (1): closing_slip, grasp
//
// A reading is scaled by the stiffness of the scene's gel over 35 kPa, which is what a known weight measures. Judged is
// every accepted frame with at least 0.3 N of that force on a gel within its linear range; error = reading / truth - 1.
// A frame in which the force changes by more than 5 % is counted apart: its picture is older than the truth by half of
// the exposure.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <map>
#include <string>
#include <vector>

#include "app/app.hpp"
#include "toolchain/play/play.hpp"
#include "toolchain/play/rig.hpp"
#include "toolchain/play/trials.hpp"

namespace {

using namespace holdfast;

constexpr double kLeast_n = 0.3;

struct Errors {
  std::vector<double> all;
  int grasps = 0;
  int last_grasp = -1;

  void add(int grasp, double error) {
    all.push_back(error);
    grasps += grasp != last_grasp ? 1 : 0;
    last_grasp = grasp;
  }
  [[nodiscard]] double quantile(double share) const {
    std::vector<double> sizes;
    for (const double e : all) sizes.push_back(std::abs(e));
    std::ranges::sort(sizes);
    return sizes.empty() ? 0.0 : sizes[static_cast<std::size_t>(share * static_cast<double>(sizes.size() - 1))];
  }
  [[nodiscard]] double mean() const {
    double sum = 0;
    for (const double e : all) sum += e;
    return all.empty() ? 0.0 : sum / static_cast<double>(all.size());
  }
  [[nodiscard]] double within(double limit) const {
    const auto good = std::ranges::count_if(all, [&](double e) { return std::abs(e) <= limit; });
    return all.empty() ? 0.0 : static_cast<double>(good) / static_cast<double>(all.size());
  }
};

using Table = std::map<std::string, Errors>;

std::string_view body_of(scene::ShapeKind kind) {
  switch (kind) {
    case scene::ShapeKind::kDisc:
    case scene::ShapeKind::kBox:
      return "flat";
    default:
      return scene::kShapeNames[static_cast<std::size_t>(kind)];
  }
}

void play_one(const tool::Trial& trial, int number, const Params& params, Table& shear, Table& normal) {
  const std::string body(body_of(trial.scene.object.shape.kind));
  const double stiffness = trial.scene.gel.shear_modulus_mpa / 0.035;
  tool::Rig rig(params);
  tool::Player player(trial.scene, rig.clock());
  App& app = rig.connect(player.camera());
  if (!app.start(params).ok()) return;
  double shear_before = 0, normal_before = 0;
  while (player.step(app, params, false)) {
    const scene::ContactState& truth = player.snapshot().contact;
    const double shear_n = std::hypot(truth.shear_n.x, truth.shear_n.y);
    const auto changes = [](double now, double before) { return std::abs(now - before) > 0.05 * now; };
    const bool shear_changes = changes(shear_n, shear_before), normal_changes = changes(truth.normal_n, normal_before);
    shear_before = shear_n;
    normal_before = truth.normal_n;
    const load::Load& load = app.result().load;
    if (!app.result().quality.ok() || load.basis == load::Basis::kNone || load.strained) continue;
    const auto put = [&](Table& table, double reading_mn, double true_n, bool moves) {
      if (true_n < kLeast_n) return;
      const double error = stiffness * reading_mn * 1e-3 / true_n - 1.0;
      if (moves) return table["changing"].add(number, error);
      table[body].add(number, error);
      table[body + (load.within ? ", within" : ", beyond")].add(number, error);
      table[load.within ? "within" : "beyond"].add(number, error);
      table[true_n < 1.0 ? "0.3 to 1 N" : true_n < 3.0 ? "1 to 3 N" : "3 N and more"].add(number, error);
      table["all"].add(number, error);
    };
    put(shear, std::hypot(load.shear_x.raw(), load.shear_y.raw()), shear_n, shear_changes);
    put(normal, load.normal.raw(), truth.normal_n, normal_changes);
  }
}

void print(std::string_view force, const Table& table) {
  fmt::print("{:20} {:>7} {:>8} {:>7} {:>7} {:>7} {:>7} {:>12}\n", force, "grasps", "frames", "mean", "median", "p90",
             "p99", "within 10 %");
  for (const auto& [name, errors] : table) {
    fmt::print("{:20} {:7} {:8} {:+6.1f}% {:6.1f}% {:6.1f}% {:6.1f}% {:11.0f}%\n", name, errors.grasps,
               errors.all.size(), 100 * errors.mean(), 100 * errors.quantile(0.5), 100 * errors.quantile(0.9),
               100 * errors.quantile(0.99), 100 * errors.within(0.1));
  }
}

// For tests/checks/claims.txt.
std::string line(Table& table) {
  const Errors& errors = table["within"];
  std::string out = fmt::format("{:.1f} %; {:.1f} %; {:.0f} %", 100 * errors.quantile(0.5), 100 * errors.quantile(0.9),
                                100 * errors.within(0.1));
  for (const char* const name : {"sphere", "ellipsoid", "flat", "cylinder", "edge"}) {
    out += fmt::format("; {:.0f} %", 100 * table[name].quantile(0.9));
  }
  return out;
}

}  // namespace

int main(int argc, char** argv) {
  const int count = argc > 1 ? std::atoi(argv[1]) : 240;
  const auto seed = static_cast<std::uint64_t>(argc > 2 ? std::atoi(argv[2]) : 1);
  const Params params;
  Table shear, normal;
  int number = 0;
  for (const tool::TrialKind kind : {tool::TrialKind::kClosingSlip, tool::TrialKind::kGrasp}) {
    for (int k = 0; k < count; ++k) play_one(tool::make_trial(kind, seed, k), number++, params, shear, normal);
  }
  print("shear", shear);
  fmt::print("\n");
  print("normal load", normal);
  fmt::print("\nshear: {}\nnormal: {}\n", line(shear), line(normal));
  return 0;
}
