// SPDX-License-Identifier: Apache-2.0
// Rest noise and thresholds: figures by plain formulas, verdicts on rows made by hand, and the command on empty gels.
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <vector>

#include "slip/slip_tree.gen.hpp"
#include "tests/support/folders.hpp"
#include "tests/support/host_clips.hpp"
#include "tests/support/host_process.hpp"
#include "tests/support/picture_clip.hpp"
#include "tests/support/skip.hpp"
#include "tests/support/temp_dir.hpp"
#include "toolchain/learn/calibrate.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;
using holdfast::test::kTool;
using learn::Clearance;
using learn::ThresholdCheck;
using test::Finished;
using test::TempDir;
using test::write_file;

const std::string kEmpty = holdfast::test::source("tests/scenes/empty_gel.json");
constexpr const char* kModelHead =
    "format 1\nname test\nfeature_set paper\nfeature vx_um_s um/s Q0\nfeature vy_um_s um/s Q0\n"
    "feature entropy_nat_q16 nat Q16\nfeature entropy_rate_nat_s_q8 nat/s Q8\n";

treec::Model model_of(const std::string& nodes) {
  treec::Model model;
  const auto problem = treec::parse(kModelHead + nodes, model);
  CHECK_TEXT(!problem, problem ? problem->what.c_str() : "");
  return model;
}

// Rows of Vx, Vy, E, dE/dt; further features are 0.
learn::Features row(std::int32_t vx, std::int32_t vy, std::int32_t e, std::int32_t de) {
  learn::Features x{};
  x[0] = vx;
  x[1] = vy;
  x[2] = e;
  x[3] = de;
  return x;
}

// Vx normal with mean 0 and deviation 10, E alternating between 0 and 100, the rest constant 5.
std::vector<learn::Features> noisy_rest() {
  std::mt19937 random(7);  // the same rows always
  std::normal_distribution<double> noise(0.0, 10.0);
  std::vector<learn::Features> rest(2000);
  for (std::size_t i = 0; i < rest.size(); ++i) {
    rest[i] = row(static_cast<std::int32_t>(std::lround(noise(random))), 5, i % 2 == 0 ? 0 : 100, 5);
  }
  return rest;
}

const ThresholdCheck& at(const learn::ModelCheck& check, int node) {
  return *std::ranges::find(check.thresholds, node, &ThresholdCheck::node);
}

Clearance alone(const std::string& predicate, bool slip_above = true) {
  const std::string leaves = slip_above ? "leaf 1: hold\nleaf 2: slip\n" : "leaf 1: slip\nleaf 2: hold\n";
  return at(learn::check_rest(model_of("node 0: " + predicate + " ? 1 : 2\n" + leaves), noisy_rest()), 0).clearance;
}

Finished calibrate(const std::vector<std::string>& more) {
  std::vector<std::string> command{kTool, "calibrate"};
  command.insert(command.end(), more.begin(), more.end());
  return test::run(command);
}

void complains(const Finished& finished, const char* says) {
  LONGS_EQUAL(1, finished.status);
  CHECK_TEXT(finished.err.find(says) != std::string::npos, finished.err.c_str());
  CHECK_TEXT(finished.err.find(". Likely cause: ") != std::string::npos, finished.err.c_str());
  CHECK_TEXT(finished.err.find(". Next: ") != std::string::npos, finished.err.c_str());
  LONGS_EQUAL(1, std::ranges::count(finished.err, '\n'));
}

}  // namespace

TEST_GROUP(Calibrate){};

TEST(Calibrate, FiguresAreThoseOfAPlainFormula) {
  const std::vector<learn::Features> rest{row(1, 0, 0, 0), row(2, 0, 0, 0), row(3, 0, 0, 0), row(4, 0, 0, 0),
                                          row(100, 0, 0, 0)};
  const learn::RestFigures f = learn::figures_of(rest, 0);
  DOUBLES_EQUAL(22.0, f.mean, 1e-12);
  DOUBLES_EQUAL(std::sqrt((441.0 + 400.0 + 361.0 + 324.0 + 6084.0) / 5.0), f.deviation, 1e-9);
  DOUBLES_EQUAL(3.0, f.median, 0.0);
  DOUBLES_EQUAL(1.4826, f.robust, 1e-12);  // distances 2 1 0 1 97
  LONGS_EQUAL(1, f.least);
  LONGS_EQUAL(100, f.most);
  const learn::RestFigures even = learn::figures_of(std::span(rest).first(4), 0);
  DOUBLES_EQUAL(2.5, even.median, 0.0);
  // A normal distribution: both spreads are its deviation; of 2000 rows each is known to 3 %.
  const learn::RestFigures normal = learn::figures_of(noisy_rest(), 0);
  DOUBLES_EQUAL(10.0, normal.deviation, 0.6);
  DOUBLES_EQUAL(10.0, normal.robust, 1.0);
}

TEST(Calibrate, EachThresholdIsHeldAgainstTheNoiseOfItsFeature) {
  // 10 um/s a sigma; the largest of 2000 lies near 3.5 sigmas.
  CHECK(alone("vx_um_s <= 70") == Clearance::kClear);
  CHECK(alone("vx_um_s <= 50") == Clearance::kClose);
  CHECK(alone("vx_um_s <= 20") == Clearance::kInside);  // frames on both sides
  CHECK(alone("vx_um_s <= -70", false) == Clearance::kClear);
  CHECK(alone("vx_um_s <= -50", false) == Clearance::kClose);
  // No noise: only a threshold one step away is close.
  CHECK(alone("vy_um_s <= 4", false) == Clearance::kClose);
  CHECK(alone("vy_um_s <= 5") == Clearance::kClose);
  CHECK(alone("vy_um_s <= 3", false) == Clearance::kClear);
  CHECK(alone("vy_um_s <= 6") == Clearance::kClear);
  // E: deviation 50, mean 50; the distances of half of the rows from the median are 50, so the robust one is 74.
  CHECK(alone("entropy_nat_q16 <= 400") == Clearance::kClose);
  CHECK(alone("entropy_nat_q16 <= 500") == Clearance::kClear);
}

TEST(Calibrate, MarginsAreStepsUntilTheFirstFrameFlips) {
  const std::vector<learn::Features> rest(10, row(0, 5, 0, 0));
  const auto margin = [&](const std::string& predicate) {
    const auto check =
        learn::check_rest(model_of("node 0: " + predicate + " ? 1 : 2\nleaf 1: hold\nleaf 2: slip\n"), rest);
    return at(check, 0).margin;
  };
  LONGS_EQUAL(1, margin("vy_um_s <= 5"));
  LONGS_EQUAL(6, margin("vy_um_s <= 10"));
  LONGS_EQUAL(1, margin("vy_um_s <= 4"));
  LONGS_EQUAL(15, margin("vy_um_s <= -10"));
}

TEST(Calibrate, OnlyThresholdsThatRestFramesComeToMatter) {
  const learn::ModelCheck check = learn::check_rest(model_of("node 0: entropy_nat_q16 <= 60000 ? 1 : 2\n"
                                                             "leaf 1: hold\n"
                                                             "node 2: vx_um_s <= 0 ? 3 : 4\n"
                                                             "leaf 3: hold\n"
                                                             "leaf 4: slip\n"),
                                                    noisy_rest());
  CHECK(at(check, 0).clearance == Clearance::kClear);
  CHECK(at(check, 2).clearance == Clearance::kNoMatter);
  CHECK(check.worst() == Clearance::kClear);
  LONGS_EQUAL(0, check.slip_frames());
}

TEST(Calibrate, NoiseAboutAThresholdIsNoHarmWhenBothWaysHold) {
  // The root parts the rest frames; behind it E stands far off on either side.
  const learn::ModelCheck check =
      learn::check_rest(model_of("node 0: vx_um_s <= 0 ? 1 : 2\n"
                                 "node 1: entropy_nat_q16 <= 60000 ? 3 : 4\n"
                                 "node 2: entropy_nat_q16 <= 300 ? 5 : 6\n"
                                 "leaf 3: hold\nleaf 4: slip\nleaf 5: hold\nleaf 6: slip\n"),
                        noisy_rest());
  CHECK(at(check, 0).clearance == Clearance::kNoMatter);
  CHECK(at(check, 1).clearance == Clearance::kClear);
  CHECK(at(check, 2).clearance == Clearance::kClose);
  CHECK(check.worst() == Clearance::kClose);
  LONGS_EQUAL(2000, at(check, 0).below + at(check, 0).above);
  LONGS_EQUAL(at(check, 0).below, at(check, 1).below);
}

TEST(Calibrate, FramesThatEndInSlipAreCounted) {
  const learn::ModelCheck check =
      learn::check_rest(model_of("node 0: entropy_nat_q16 <= 50 ? 1 : 2\nleaf 1: hold\nleaf 2: slip\n"), noisy_rest());
  LONGS_EQUAL(1000, check.slip_frames());
  CHECK(check.worst() == Clearance::kInside);
}

TEST(Calibrate, TheTextInTheToolIsTheCompiledTree) {
  treec::Model model;
  CHECK(!treec::parse(learn::compiled_model_text(), model));
  CHECK(!treec::check(model));
  LONGS_EQUAL(slip_tree::kModelCrc32, model.text_crc32);
  STRCMP_EQUAL(std::string(slip_tree::kName).c_str(), model.name.c_str());
}

TEST(Calibrate, TheEmptyGelIsClearOfTheCompiledTree) {
  const Finished finished = calibrate({kEmpty, "--json"});
  LONGS_EQUAL_TEXT(0, finished.status, finished.err.c_str());
  const auto out = nlohmann::json::parse(finished.out);
  STRCMP_EQUAL("stands clear", out["verdict"].get<std::string>().c_str());
  LONGS_EQUAL(0, out["slip_frames"].get<int>());
  const Finished text = calibrate({kEmpty});
  CHECK(text.out.starts_with("verdict   the model's thresholds stand clear"));
  // The scene's markers tremble by 2 um: 35 frames of 63 markers know it to 2 %; rounding to 1 um adds 2 %.
  DOUBLES_EQUAL(2.0, out["jitter_um"]["x"].get<double>(), 0.1);
  DOUBLES_EQUAL(2.0, out["jitter_um"]["y"].get<double>(), 0.1);
  // Vx: the difference of two means over 63 markers in 40 ms, sqrt(2 / 63) * 2 um / 0.04 s; to 20 %.
  DOUBLES_EQUAL(std::sqrt(2.0 / 63.0) * 2.0 / 0.04, out["features"]["vx_um_s"]["deviation"].get<double>(), 1.8);
  const Finished told = calibrate({kEmpty});
  LONGS_EQUAL(0, told.status);
  CHECK(told.out.find("stand clear of this gel's noise") != std::string::npos);
}

TEST(Calibrate, AThresholdInTheNoiseIsNamed) {
  const TempDir dir;
  const std::string model = dir / "test.tree";
  const auto judge = [&](const char* threshold) {
    write_file(model, kModelHead + ("node 0: vx_um_s <= " + std::string(threshold)) +
                          " ? 1 : 2\nleaf 1: hold\nleaf 2: slip\n");
    return calibrate({kEmpty, "--model", model});
  };
  complains(judge("3"), "says slip in");
  complains(judge("40"), "close to the noise of the gel");
  LONGS_EQUAL(0, judge("100").status);
  write_file(model, "format 1\nname test\n");
  complains(calibrate({kEmpty, "--model", model}), "test.tree");
}

TEST(Calibrate, AGelThatIsTouchedIsToldSo) {
  const TempDir dir;
  test::write_clip(test::press_scene(3.0, 2.0, 2.8), dir / "touched");
  complains(calibrate({dir / "touched"}), "the gel is not at rest");
  LONGS_EQUAL(0, calibrate({dir / "touched", "--to", "49"}).status);
  complains(calibrate({dir / "touched", "--to", "20"}), "too short");
  complains(calibrate({dir / "touched", "--from", "900"}), "frame 900 was asked for, and 75 is the last");
  // A picture of a press as reference: every frame is off.
  complains(calibrate({dir / "touched", "--to", "49", "--reference", "60"}), "something touches the gel all the time");
  complains(calibrate({holdfast::test::source("tests/scenes/sphere_slip.json")}), "not empty");
  LONGS_EQUAL(1, calibrate({dir / "nowhere"}).status);
  complains(calibrate({dir / "nowhere.json"}), "nowhere.json");
}

TEST(Calibrate, TheRealGelIsClearOfTheCompiledTree) {
  const auto folder = test::clips_folder();
  if (folder.empty()) {
    test::skip("the real recordings are not beside the clone (../shared/data/real)");
    return;
  }
  const std::string clip = folder / "avocado_real__exp_num_6__camera_2.avi";
  const Finished empty = calibrate({clip, "--from", "305", "--to", "449", "--json"});
  LONGS_EQUAL_TEXT(0, empty.status, empty.err.c_str());
  const auto out = nlohmann::json::parse(empty.out);
  // real_clips: 0.06 px at most over all clips, a pixel being 2020 um over 29 px.
  CHECK(out["jitter_um"]["x"].get<double>() < 6.0);
  CHECK(out["jitter_um"]["x"].get<double>() > 0.5);
  complains(calibrate({clip}), "the gel is not at rest");
}
