// SPDX-License-Identifier: Apache-2.0
// `holdfast replay` without --reference: which frames it takes for the empty gel, when it refuses, and what it makes of
// a contact that ends. Recordings are rendered grasps whose truth is known: an object that is there in these frames
// only.
#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/support/folders.hpp"
#include "tests/support/host_process.hpp"
#include "tests/support/temp_dir.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;
using holdfast::test::kTool;
using test::Finished;
using test::read_file;
using test::TempDir;
using test::write_file;
using Words = std::vector<std::string>;

constexpr double kFps = 25;

}  // namespace

TEST_GROUP(ReplayReference) {
  TempDir dir;
  [[nodiscard]] std::string in(const std::string& name) const {
    return (dir / name).string();
  }
  static Finished run(const Words& words) {
    Words command{kTool};
    command.insert(command.end(), words.begin(), words.end());
    return test::run(command);
  }
  // The sensor's JPEG pictures of a knurled ball: 1.5 N or nothing, by time.
  void film(const std::string& name, double seconds, const std::string& trajectory) const {
    write_file(dir / "scene.json", fmt::format(R"({{"schema_version": 1, "name": "ball", "help": "a ball with a knurl",
      "duration_s": {}, "fps": {},
      "level": {{"inject": "jpeg", "contact": "springs"}},
      "object": {{"name": "knurled_sphere", "yaw_deg": 20, "relief": {{"kind": "bumps", "height_um": 40, "pitch_mm": 0.8}}}},
      "trajectory": [{}], "effects": {{"pixel_noise": 2}}, "expect": {{}}}})",
                                               seconds, kFps, trajectory));
    const Finished made = run({"sim", in("scene.json"), "--mcap", in(name)});
    CHECK_TEXT(made.status == 0, made.err.c_str());
  }
  nlohmann::json replay(const std::string& name) const {
    const Finished done = run({"replay", in(name), "--json"});
    CHECK_TEXT(done.status == 0, done.err.c_str());
    STRCMP_EQUAL("", done.err.c_str());
    return nlohmann::json::parse(done.out)["reference"];
  }
  // Frames of the features file whose reason is this.
  static int count(const std::string& csv, const std::string& reason) {
    int found = 0;
    for (std::size_t at = 0; (at = csv.find("," + reason + ",", at)) != std::string::npos; ++at) ++found;
    return found;
  }
};

TEST(ReplayReference, IsTheEmptyBeginning) {
  film("a.mcap", 1.4, R"({"t_s": 0.7, "force_n": 0}, {"t_s": 0.8, "force_n": 1.5})");
  const auto found = replay("a.mcap");
  CHECK_TRUE(found["clear"].get<bool>() && found["at_rest"].get<bool>());
  CHECK(found["last"].get<long>() <= static_cast<long>(0.72 * kFps));
  CHECK(found["first"].get<long>() <= found["frame"].get<long>());
  CHECK(found["frame"].get<long>() <= found["last"].get<long>());
}

TEST(ReplayReference, IsTheEmptyEnd) {
  film("b.mcap", 1.4, R"({"t_s": 0, "force_n": 1.5}, {"t_s": 0.7, "force_n": 1.5}, {"t_s": 0.8, "force_n": 0})");
  const auto found = replay("b.mcap");
  CHECK_TRUE(found["clear"].get<bool>());
  CHECK(found["first"].get<long>() >= static_cast<long>(0.8 * kFps));
}

TEST(ReplayReference, IsRefusedWhereTheGelIsNeverEmpty) {
  film("c.mcap", 0.8, R"({"t_s": 0, "force_n": 1.5}, {"t_s": 0.8, "force_n": 1.5})");
  const Finished done = run({"replay", in("c.mcap"), "--features", in("f.csv")});
  CHECK_TRUE(done.status == 1);
  STRCMP_CONTAINS("presses on the gel in every frame at rest", done.err.c_str());
  STRCMP_CONTAINS("--reference FILE", done.err.c_str());
  CHECK_FALSE(std::filesystem::exists(dir / "f.csv"));
}

TEST(ReplayReference, SaysWhenNothingIsEverTouched) {
  film("d.mcap", 0.8, R"({"t_s": 0.8, "force_n": 0})");
  const Finished done = run({"replay", in("d.mcap")});
  CHECK_TRUE(done.status == 0);
  STRCMP_CONTAINS("note      No other frames are clearly loaded", done.out.c_str());
  STRCMP_EQUAL("", done.err.c_str());
}

// What the device says on its lines, a recording says too.
TEST(ReplayReference, AContactThatEndsIsLostUnlessSomebodyOpens) {
  film("e.mcap", 2.0, R"({"t_s": 0.5, "force_n": 0}, {"t_s": 0.6, "force_n": 1.5}, {"t_s": 1.2, "force_n": 1.5},
                         {"t_s": 1.3, "force_n": 0})");
  CHECK_TRUE(run({"replay", in("e.mcap"), "--features", in("f.csv")}).status == 0);
  const std::string lost = read_file(dir / "f.csv");
  // 200 ms of frames every 40 ms.
  LONGS_EQUAL(5, count(lost, "contact_lost"));
  STRCMP_CONTAINS(",contact,", lost.c_str());  // its evidence
  CHECK_TRUE(run({"replay", in("e.mcap"), "--features", in("f.csv"), "--opening", "28-49"}).status == 0);
  const std::string opened = read_file(dir / "f.csv");
  LONGS_EQUAL(0, count(opened, "contact_lost"));
  CHECK(count(opened, "opening") > 0);
  // Longer than opening_max_ms it ends by itself, as on the device: 400 ms are the frames 12 to 21.
  std::ofstream(dir / "short.toml") << "opening_max_ms = 400\nleft_sensor = 7\n";  // of a device; no recording says so
  const Finished held = run({"replay", in("e.mcap"), "--features", in("f.csv"), "--opening", "12-20", "--opening",
                             "21-49", "--settings", in("short.toml")});
  CHECK_TRUE(held.status == 0);
  const std::string ended = read_file(dir / "f.csv");
  LONGS_EQUAL(10, count(ended, "opening"));
  LONGS_EQUAL(5, count(ended, "contact_lost"));
  STRCMP_CONTAINS("--opening lasts longer than opening_max_ms (400 ms)", held.out.c_str());
  const Finished behind = run({"replay", in("e.mcap"), "--opening", "50-60", "--opening", "51-60"});
  CHECK_TRUE(behind.status == 0);
  STRCMP_CONTAINS("--opening 51-60 lies behind the last frame, 50", behind.out.c_str());
  CHECK(behind.out.find("--opening 50-60") == std::string::npos);
  for (const char* wrong : {"x", "5", "9-5", "-1-4", "1-2-3", "1-"}) {
    const Finished done = run({"replay", in("e.mcap"), "--opening", wrong});
    CHECK_FALSE_TEXT(done.status == 0, wrong);
    STRCMP_CONTAINS("not an interval of frames", done.err.c_str());
  }
}
