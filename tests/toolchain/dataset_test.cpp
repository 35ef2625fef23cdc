// SPDX-License-Identifier: Apache-2.0
// Simulated datasets: the same bytes always and from shards, labels that are the scene's truth, features that are the
// ones `holdfast sim` writes.
#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <sstream>
#include <string>
#include <tuple>
#include <vector>

#include "drivers/sim/scene/file/scene_file.hpp"
#include "drivers/sim/scene/simulation.hpp"
#include "tests/support/cells.hpp"
#include "tests/support/folders.hpp"
#include "tests/support/host_process.hpp"
#include "tests/support/temp_dir.hpp"
#include "toolchain/learn/plan.hpp"
#include "toolchain/play/paper.hpp"
#include "toolchain/play/play.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;
using holdfast::test::kTool;
using learn::Label;
using learn::Planned;
using learn::PlannedGrasp;
using learn::PlanOptions;
using learn::Row;
using learn::Samples;
using test::Finished;
using test::read_file;
using test::TempDir;
using test::write_file;

using Grasp = std::tuple<std::string, std::string, int, std::uint64_t>;

std::vector<Grasp> grasps_of(const PlanOptions& options) {
  learn::Plan plan;
  const auto error = learn::make_plan(options, plan);
  STRCMP_EQUAL("", error.value_or("").c_str());
  std::vector<Grasp> out;
  for (const PlannedGrasp& g : plan.grasps) {
    out.emplace_back(g.object->name, g.primitive->name, static_cast<int>(g.kind), g.seed);
  }
  return out;
}

Planned grasp(std::string_view object, std::string_view primitive, scene::GraspKind kind, std::uint64_t seed) {
  PlannedGrasp out;
  out.object = std::ranges::find(scene::kPaperObjects, object, &scene::PaperObject::name);
  out.primitive = std::ranges::find(scene::kPrimitives, primitive, &scene::Primitive::name);
  out.kind = kind;
  out.seed = seed;
  return out.make();
}

// Round and smooth: the cheap contact level.
const std::vector<Planned>& few() {
  static const std::vector<Planned> all{
      grasp("ball", "translate_x", scene::GraspKind::kSlip, 3),
      grasp("mouse", "planar_xz", scene::GraspKind::kSlip, 5),
      grasp("ball", "rotate_z", scene::GraspKind::kStatic, 4),
      grasp("mouse", "translate_y", scene::GraspKind::kShaken, 2),
  };
  return all;
}

}  // namespace

TEST_GROUP(Dataset){};

TEST(Dataset, ThePlanHasEveryGraspOnce) {
  PlanOptions options;
  options.repeats = 2;
  options.seed = 7;
  const std::vector<Grasp> all = grasps_of(options);
  LONGS_EQUAL(10 * 12 * scene::kGraspKinds.size() * 2, all.size());
  const std::set<Grasp> once(all.begin(), all.end());
  LONGS_EQUAL(all.size(), once.size());
  for (const Grasp& one : all) CHECK(std::get<3>(one) == 7 || std::get<3>(one) == 8);

  options.unseen = true;
  options.repeats = 1;
  options.kinds = {"slip", "static"};
  std::set<std::string> names;
  for (const Grasp& one : grasps_of(options)) names.insert(std::get<0>(one));
  LONGS_EQUAL(3 * 12 * 2, grasps_of(options).size());
  CHECK(names == std::set<std::string>({"book", "raccoon", "contact_solution"}));
}

TEST(Dataset, ShardsPartThePlan) {
  PlanOptions options;
  options.objects = {"ball", "box"};
  const std::vector<Grasp> whole = grasps_of(options);
  for (const int shards : {1, 2, 7, 500}) {
    std::vector<Grasp> joined;
    for (int shard = 1; shard <= shards; ++shard) {
      PlanOptions piece = options;
      piece.shard = shard;
      piece.shards = shards;
      learn::Plan plan;
      CHECK(!learn::make_plan(piece, plan));
      LONGS_EQUAL(joined.size(), plan.before);
      for (const Grasp& one : grasps_of(piece)) joined.push_back(one);
    }
    CHECK(joined == whole);
  }
}

TEST(Dataset, ASelectionIsThoseGraspsOfTheWhole) {
  PlanOptions options;
  options.objects = {"mouse"};
  options.kinds = {"slow"};
  const std::vector<Grasp> some = grasps_of(options);
  LONGS_EQUAL(12, some.size());
  const std::vector<Grasp> whole = grasps_of({});
  for (const Grasp& one : some) CHECK(std::ranges::find(whole, one) != whole.end());
}

TEST(Dataset, LabelsAreTheTruthOfTheScene) {
  int slips = 0;
  int after_release = 0;
  for (const Planned& planned : few()) {
    Samples samples;
    learn::play_into(samples, planned);
    LONGS_EQUAL(1, samples.trials.size());
    LONGS_EQUAL(samples.rows.size(), samples.trials[0].count);

    // Again, from the scene alone.
    scene::Simulation simulation(planned.scene);
    std::vector<scene::Snapshot> truth(static_cast<std::size_t>(scene::frame_count(planned.scene)));
    for (scene::Snapshot& s : truth) s = simulation.next();
    LONGS_EQUAL(truth.size(), samples.rows.size());
    double most_n = 0.0;
    for (const scene::Snapshot& s : truth) most_n = std::max(most_n, s.contact.normal_n);
    std::size_t last_firm = 0;
    for (std::size_t k = 0; k < truth.size(); ++k) {
      if (truth[k].contact.normal_n >= 0.5 * most_n) last_firm = k;
    }
    const std::optional<double> onset = tool::onset_s(tool::play(planned.scene, Params{}), scene::SlipLevel::kHalf);
    std::optional<double> first_slip;
    for (std::size_t k = 0; k < truth.size(); ++k) {
      const scene::ContactState& c = truth[k].contact;
      const Row& row = samples.rows[k];
      const bool slides = c.gross || c.slip_fraction > 0.5;
      const Label held = slides ? Label::kSlip : Label::kHold;
      const Label due = c.normal_n < 0.02 ? Label::kEmpty : k > last_firm ? Label::kOpen : held;
      LONGS_EQUAL(static_cast<int>(due), static_cast<int>(row.label));
      LONGS_EQUAL(k, row.frame);
      // The frame's time is a whole number of microseconds on the firmware's clock only.
      DOUBLES_EQUAL(static_cast<double>(k) / planned.scene.fps, row.t_s, 1e-9);
      DOUBLES_EQUAL(c.slip_fraction, row.slip_fraction, 0.0);
      DOUBLES_EQUAL(truth[k].slide_mm_s, row.slide_mm_s, 0.0);
      // The rest position is the mean of the first ten frames.
      CHECK_EQUAL(k >= 9, row.accepted);
      if (row.label == Label::kSlip && !first_slip) first_slip = row.t_s;
      slips += row.label == Label::kSlip ? 1 : 0;
      after_release += slides && k > last_firm ? 1 : 0;
    }
    // The onset that a scene's promises are held against, unless it is a part of letting go.
    const bool judged = onset && *onset <= samples.rows[last_firm].t_s;
    CHECK_EQUAL(judged, first_slip.has_value());
    if (judged) DOUBLES_EQUAL(*onset, *first_slip, 0.0);
    if (planned.trial.kind == "slip") CHECK(judged);
  }
  CHECK(slips > 20);
  CHECK(after_release > 0);  // the rule about the release is not idle here
}

TEST(Dataset, FeaturesAreTheOnesThatSimWrites) {
  const TempDir dir;
  const std::string scene_file = dir / "grasp.json";
  const std::string features_file = dir / "features.csv";
  for (Planned planned : few()) {
    // Once through the file: a modulus may come back as its neighbour.
    const std::string text = scene::write_scene(planned.scene);
    write_file(scene_file, text);
    const scene::SceneResult read = scene::read_scene(text, "grasp.json");
    CHECK(read.scene.has_value());
    planned.scene = *read.scene;
    Samples samples;
    learn::play_into(samples, planned);
    const Finished sim = test::run({kTool, "sim", scene_file, "--features", features_file});
    LONGS_EQUAL_TEXT(0, sim.status, sim.err.c_str());
    std::istringstream lines(read_file(features_file));
    std::string line;
    std::getline(lines, line);
    const std::vector<std::string> names = test::cells_of(line);
    std::size_t k = 0;
    int compared = 0;
    for (; std::getline(lines, line); ++k) {
      const std::vector<std::string> cells = test::cells_of(line);
      const Row& row = samples.rows.at(k);
      LONGS_EQUAL(std::stoi(cells[0]), row.frame);
      CHECK_EQUAL(!cells[5].empty(), row.accepted);
      if (!row.accepted) continue;
      // Name in the dataset, name there, raw per unit, half of the last digit printed.
      const std::tuple<const char*, const char*, double, double> pairs[] = {
          {"vx_um_s", "vx_mm_s", 1000.0, 0.0005},
          {"vy_um_s", "vy_mm_s", 1000.0, 0.0005},
          {"entropy_nat_q16", "entropy_nat", 65536.0, 0.0000005},
          {"entropy_rate_nat_s_q8", "entropy_rate_nat_s", 256.0, 0.0000005},
      };
      for (const auto& [ours, theirs, per_unit, half] : pairs) {
        const auto* const feature = std::ranges::find(kFeatures, std::string_view(ours), &FeatureInfo::name);
        const auto column = static_cast<std::size_t>(std::ranges::find(names, theirs) - names.begin());
        const std::int32_t raw = row.x[static_cast<std::size_t>(feature - kFeatures.begin())];
        DOUBLES_EQUAL(std::stod(cells.at(column)), raw / per_unit, half * 1.001);
        compared += raw != 0 ? 1 : 0;
      }
    }
    LONGS_EQUAL(samples.rows.size(), k);
    CHECK(compared > 50);
  }
}

TEST(Dataset, PicturesGiveTheSameLabelsAndNearlyTheSameFeatures) {
  const Planned& planned = few()[0];
  Samples markers, pictures;
  learn::play_into(markers, planned);
  learn::play_into(pictures, planned, scene::Inject::kGrey);
  LONGS_EQUAL(markers.rows.size(), pictures.rows.size());
  double off = 0.0;
  int count = 0;
  for (std::size_t k = 0; k < markers.rows.size(); ++k) {
    CHECK(markers.rows[k].label == pictures.rows[k].label);
    CHECK_EQUAL(markers.rows[k].accepted, pictures.rows[k].accepted);
    if (!markers.rows[k].accepted) continue;
    off += std::abs(markers.rows[k].x[0] - pictures.rows[k].x[0]);
    ++count;
  }
  // Vx: the marker level's own noise is 1 to 2 um over the root of 63 in 40 ms, 10 um/s; pictures add as much.
  CHECK(off / count < 50.0);
}

TEST(Dataset, TheSameBytesTwiceAndFromShards) {
  const TempDir dir;
  const auto make = [&](const std::string& name, const std::vector<std::string>& more) {
    std::vector<std::string> command{kTool,       "dataset",    "--out",   dir / name,
                                     "--objects", "ball,mouse", "--kinds", "slip"};
    command.insert(command.end(), more.begin(), more.end());
    const Finished made = test::run(command);
    LONGS_EQUAL_TEXT(0, made.status, made.err.c_str());
    return read_file(dir / name);
  };
  const std::string whole = make("whole.csv", {"--seed", "9"});
  CHECK(whole.size() > 100'000);
  CHECK(whole == make("again.csv", {"--seed", "9"}));
  CHECK(whole != make("other.csv", {"--seed", "10"}));
  CHECK(whole != make("soft.csv", {"--seed", "9", "--shear-modulus-mpa", "0.03"}));
  // At rest the mean velocity is the markers' noise.
  const auto still = [&](const char* noise_um) {
    std::istringstream quiet(make("quiet.csv", {"--seed", "9", "--marker-noise-um", noise_um}));
    Samples samples;
    STRCMP_EQUAL("", learn::read_csv(quiet, "quiet.csv", samples).value_or("").c_str());
    return std::ranges::all_of(samples.rows,
                               [](const Row& row) { return row.frame < 11 || row.t_s > 0.5 || row.x[0] == 0; });
  };
  CHECK(still("0"));
  CHECK(!still("2"));
  std::string merged;
  for (int shard = 1; shard <= 3; ++shard) {
    const std::string piece = make("piece.csv", {"--seed", "9", "--shard", std::to_string(shard) + "/3"});
    merged += shard == 1 ? piece : piece.substr(piece.find('\n') + 1);
  }
  CHECK(merged == whole);
  std::istringstream in(whole);
  Samples samples;
  STRCMP_EQUAL("", learn::read_csv(in, "whole.csv", samples).value_or("").c_str());
  LONGS_EQUAL(24, samples.trials.size());
}

// The script that makes the committed models takes ten minutes and the recordings: here its options alone.
TEST(Dataset, TheModelsScriptGivesOptionsThatThereAre) {
  const std::string script = read_file(test::source("toolchain/model/train.sh"));
  std::string command;
  int options = 0;
  std::istringstream words(script.substr(script.find("\npart()")));
  for (std::string word; words >> word;) {
    if (word == "part") command = "dataset";
    if (word == "train" || word == "fuse" || word == "compile") command = word;
    if (!word.starts_with("--")) continue;
    const Finished help = test::run({kTool, command, "--help"});
    CHECK_TEXT(help.out.find("  " + word) != std::string::npos, word.c_str());
    ++options;
  }
  CHECK(options > 20);
}

TEST(Dataset, WhatCannotBeMadeIsSaidAndNothingIsWritten) {
  const TempDir dir;
  const std::string out = dir / "out.csv";
  const auto refused = [&](const std::vector<std::string>& more, const char* says) {
    std::vector<std::string> command{kTool, "dataset", "--out", out};
    command.insert(command.end(), more.begin(), more.end());
    const Finished finished = test::run(command);
    CHECK(finished.status != 0);
    CHECK_TEXT(finished.err.find(says) != std::string::npos, finished.err.c_str());
    CHECK_TEXT(finished.err.find("Next:") != std::string::npos, finished.err.c_str());
    LONGS_EQUAL_TEXT(1, std::ranges::count(finished.err, '\n'), finished.err.c_str());
    CHECK(std::filesystem::is_empty(dir.path()));
  };
  refused({"--objects", "ball,moon"}, "moon");
  refused({"--objects", "book"}, "book");
  refused({"--kinds", "sliding"}, "sliding");
  refused({"--shard", "0/4"}, "0/4");
  refused({"--shard", "5/4"}, "5/4");
  refused({"--shard", "1/4x"}, "1/4x");
  refused({"--inject", "features"}, "features");
  refused({"--marker-noise-um", "6.1"}, "6.1");
  refused({"--marker-noise-um", "nan"}, "nan");
  refused({"--shear-modulus-mpa", "0"}, "0");
  refused({"--repeats", "0"}, "0");
  refused({"--recordings", "labels.csv", "--seed", "2"}, "--seed");
  refused({"--recordings", dir / "labels.csv"}, "labels.csv");
}
