// SPDX-License-Identifier: Apache-2.0
// A known weight: readings made by hand, whose steady stretch is known, and the command on simulated gels of another
// stiffness, against the stiffness of the scene.
#include "toolchain/learn/weigh.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <variant>
#include <vector>

#include "drivers/sim/scene/file/scene_file.hpp"
#include "drivers/sim/scene/simulation.hpp"
#include "tests/support/folders.hpp"
#include "tests/support/host_process.hpp"
#include "tests/support/temp_dir.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;
using holdfast::test::kTool;
using learn::Force;
using learn::Weighing;
using test::Finished;
using test::read_file;
using test::TempDir;
using test::write_file;

// A frame each 40 ms.
class Recording {
 public:
  explicit Recording(Force force) : weighing_(force) {}

  // `frames` of them; `reading(k)` in mN along x (or into the gel) in the k-th.
  template <typename Reading>
  Recording& add(int frames, Reading reading, bool touching = true, bool slips = false, bool strained = false) {
    for (int k = 0; k < frames; ++k) {
      pipeline::Result result;
      result.timestamp = Micros{40'000} * frame_;
      result.referenced = true;
      result.contact = {.judged = true, .touching = touching};
      result.request = slips ? GripRequest::kTighten : GripRequest::kHold;
      result.load.basis = load::Basis::kNominal;
      result.load.strained = strained;
      result.load.within = touching;
      result.load.shear_x = result.load.normal = Millinewtons::from_raw(static_cast<int>(std::lround(reading(k))));
      weighing_.add(frame_++, result);
    }
    return *this;
  }
  Recording& empty(int frames) {
    return add(
        frames, [](int k) { return k % 2 == 0 ? 2.0 : -2.0; }, false);
  }
  Recording& still(int frames, double mn) {
    return add(frames, [mn](int) { return mn; });
  }
  [[nodiscard]] Weighing::Found found(double true_mn) const {
    const auto result = weighing_.find(true_mn);
    if (const auto* wrong = std::get_if<std::string>(&result)) FAIL(wrong->c_str());
    return std::get<Weighing::Found>(result);
  }
  void refuses(double true_mn, const char* says) const {
    const auto result = weighing_.find(true_mn);
    CHECK(std::holds_alternative<std::string>(result));
    const auto& line = std::get<std::string>(result);
    STRCMP_CONTAINS(says, line.c_str());
    STRCMP_CONTAINS(". Likely cause: ", line.c_str());
    STRCMP_CONTAINS(". Next: ", line.c_str());
  }

 private:
  Weighing weighing_;
  int frame_ = 0;
};

// A ball that is pressed on, pulled aside and held from 2 s on, on a gel of this stiffness.
scene::Scene hanging(double shear_modulus_kpa) {
  scene::Scene scene;
  scene.name = "hanging";
  scene.help = "a weight hangs on the gel";
  scene.duration_s = 4.0;
  scene.level.inject = scene::Inject::kGrey;
  scene.gel.shear_modulus_mpa = 1e-3 * shear_modulus_kpa;
  scene.object.shape.radius_mm = 6.0;
  scene.object.friction = 1.0;
  scene.trajectory = {{.t_s = 0.8, .force_n = 0.0, .x_mm = 0.0, .y_mm = 0.0},
                      {.t_s = 1.3, .force_n = 1.5, .y_mm = 0.0},
                      {.t_s = 1.5, .y_mm = 0.0},
                      {.t_s = 2.0, .force_n = 1.5, .y_mm = 30.0 / shear_modulus_kpa},
                      {.t_s = 4.0, .force_n = 1.5, .x_mm = 0.0, .y_mm = 30.0 / shear_modulus_kpa}};
  scene.effects.pixel_noise = 2.0;
  return scene;
}

struct Forces {
  double shear_n = 0, normal_n = 0;
};
Forces at_the_end(const scene::Scene& scene) {
  scene::Simulation simulation(scene);
  Forces out;
  for (int k = 0; k < scene::frame_count(scene); ++k) {
    const scene::ContactState& truth = simulation.next().contact;
    out = {std::hypot(truth.shear_n.x, truth.shear_n.y), truth.normal_n};
  }
  return out;
}

Finished calibrate(const std::vector<std::string>& more) {
  std::vector<std::string> command{kTool, "calibrate"};
  command.insert(command.end(), more.begin(), more.end());
  return test::run(command);
}

}  // namespace

TEST_GROUP(Weigh){};

TEST(Weigh, FindsTheSteadyStretchWithTheLargestReading) {
  Recording recording(Force::kShear);
  recording.empty(25).still(20, 300).add(10, [](int k) { return 300.0 + 30 * k; }).still(30, 600).still(20, 400);
  const Weighing::Found found = recording.found(1200.0);
  LONGS_EQUAL(55, found.first);
  LONGS_EQUAL(84, found.last);
  LONGS_EQUAL(30, found.frames);
  LONGS_EQUAL(30, found.within);
  DOUBLES_EQUAL(600.0, found.reading_mn, 1e-9);
  DOUBLES_EQUAL(0.0, found.spread_mn, 1e-6);
  LONGS_EQUAL(2000, found.scale_permille);
  // Half a second: 13 frames reach from the first to the last of one, 14 to half a second.
  Recording shorter(Force::kNormal);
  shorter.empty(25).still(13, 900).still(14, 500);
  LONGS_EQUAL(2400, shorter.found(1200.0).scale_permille);
}

TEST(Weigh, FramesThatSlipDoNotWeigh) {
  Recording recording(Force::kShear);
  recording.empty(25).still(20, 500).add(
      50, [](int) { return 800.0; }, true, true);
  DOUBLES_EQUAL(500.0, recording.found(1000.0).reading_mn, 1e-9);
  Recording sliding(Force::kShear);
  sliding.empty(25).add(
      50, [](int) { return 800.0; }, true, true);
  sliding.refuses(1000.0, "slips or is moved all the time");
}

TEST(Weigh, SaysWhatIsWrong) {
  Recording nothing(Force::kShear);
  nothing.empty(100);
  nothing.refuses(1000.0, "nothing touches the gel");
  Recording none(Force::kShear);
  none.refuses(1000.0, "no frame has a reading");
  Recording swings(Force::kShear);
  swings.empty(25).add(100, [](int k) { return 500.0 + 40 * std::sin(0.5 * k); });
  swings.refuses(1000.0, "the weight swings");
  Recording light(Force::kShear);
  light.empty(25).still(50, 90);
  light.refuses(1000.0, "the weight is too small");
  // 12 mN of noise in 200: 6 %.
  Recording noisy(Force::kNormal);
  noisy.empty(25).add(50, [](int k) { return 200.0 + (k % 3 - 1) * 6.0; });
  noisy.refuses(1000.0, "the weight is too small for the noise");
  Recording soft(Force::kShear);
  soft.empty(25).add(
      50, [](int) { return 800.0; }, true, false, true);
  soft.refuses(1000.0, "the weight is too large");
  Recording other(Force::kShear);
  other.empty(25).still(50, 400);
  other.refuses(39.0, "0.10 times as stiff");
  other.refuses(8100.0, "20.25 times as stiff");
  LONGS_EQUAL(20'000, other.found(8000.0).scale_permille);
}

// The scale is the stiffness of the scene's gel over 35 kPa, to the error of a contact within the lattice: 4 % of
// shear, 15 % of normal load. Grams that are the scene's force stand for a weight.
TEST(Weigh, TheCommandMeasuresTheGelsStiffness) {
  const TempDir dir;
  for (const double kpa : {35.0, 80.0}) {
    const scene::Scene scene = hanging(kpa);
    const std::string path = dir / "hanging.json";
    write_file(path, scene::write_scene(scene));
    const Forces truth = at_the_end(scene);
    const auto grams = [](double newtons, double share) { return std::to_string(newtons / share * 1000.0 / 9.80665); };
    const Finished shear = calibrate({path, "--weight", grams(truth.shear_n, 0.5), "-o", dir / "gel.toml", "--json"});
    LONGS_EQUAL_TEXT(0, shear.status, shear.err.c_str());
    const int scale = nlohmann::json::parse(shear.out)["shear_scale"].get<int>();
    DOUBLES_EQUAL(kpa / 35.0, scale * 1e-3, 0.04 * kpa / 35.0);
    const Finished alone = calibrate({path, "--weight", grams(truth.shear_n, 1.0), "--share", "100", "--json"});
    LONGS_EQUAL(scale, nlohmann::json::parse(alone.out)["shear_scale"].get<int>());
    const Finished normal =
        calibrate({path, "--weight", grams(truth.normal_n, 1.0), "--as", "normal", "-o", dir / "gel.toml"});
    LONGS_EQUAL_TEXT(0, normal.status, normal.err.c_str());
    // Three times as much, or as little, is the weight of no gel that was reported.
    constexpr const char* kNote = "30 to 115 are reported";
    CHECK_TEXT(normal.out.find(kNote) == std::string::npos, normal.out.c_str());
    const Finished wrong = calibrate({path, "--weight", grams(truth.shear_n, 0.5 / (kpa > 50 ? 3.0 : 0.3))});
    STRCMP_CONTAINS(kNote, wrong.out.c_str());
    const std::string settings = read_file(dir / "gel.toml");
    STRCMP_CONTAINS(("shear_scale = " + std::to_string(scale)).c_str(), settings.c_str());
    const std::size_t at = settings.find("normal_scale = ");
    CHECK(at != std::string::npos);
    DOUBLES_EQUAL(kpa / 35.0, std::stoi(settings.substr(at + 15)) * 1e-3, 0.15 * kpa / 35.0);

    // And what reads by it reads the scene's newtons.
    const Finished read = test::run({kTool, "sim", path, "--settings", dir / "gel.toml", "--features", dir / "f.csv"});
    LONGS_EQUAL_TEXT(0, read.status, read.err.c_str());
    const std::string csv = read_file(dir / "f.csv");
    const std::string last = csv.substr(csv.rfind('\n', csv.size() - 2) + 1);
    STRCMP_CONTAINS("two_weights", last.c_str());
    std::istringstream row(last);
    std::vector<std::string> cells;
    for (std::string cell; std::getline(row, cell, ',');) cells.push_back(cell);
    DOUBLES_EQUAL(truth.shear_n, std::stod(cells[22]), 0.02 * truth.shear_n);
    DOUBLES_EQUAL(truth.normal_n, std::stod(cells[23]), 0.05 * truth.normal_n);
    std::filesystem::remove(std::filesystem::path(dir / "gel.toml"));
  }
}

TEST(Weigh, TheCommandKeepsWhatItCannotRead) {
  const TempDir dir;
  const std::string path = dir / "hanging.json", toml = dir / "gel.toml";
  write_file(path, scene::write_scene(hanging(50.0)));
  write_file(toml, "no settings\n");
  const Finished finished = calibrate({path, "--weight", "100", "-o", toml});
  LONGS_EQUAL(1, finished.status);
  LONGS_EQUAL(1, std::ranges::count(finished.err, '\n'));
  STRCMP_EQUAL("no settings\n", read_file(toml).c_str());
  CHECK(calibrate({path, "--as", "normal"}).status != 0);
  CHECK(calibrate({path, "--weight", "100", "--as", "mass"}).status != 0);
  CHECK(calibrate({path, "--weight", "0"}).status != 0);
  for (const char* const none : {"nan", "-nan", "inf", "0.5", "1x"}) {
    for (const std::vector<std::string>& words :
         {std::vector<std::string>{"--weight", none}, {"--weight", "100", "--share", none}}) {
      std::vector<std::string> all{path};
      all.insert(all.end(), words.begin(), words.end());
      const Finished refused = calibrate(all);
      CHECK_TEXT(refused.status != 0, none);
      STRCMP_CONTAINS(("'" + std::string(none) + "' is no number from 1 to ").c_str(), refused.err.c_str());
    }
  }
}
