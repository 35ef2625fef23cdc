// SPDX-License-Identifier: Apache-2.0
// Two recordings as the fingers of a hand, through the tool.
#include <algorithm>
#include <filesystem>
#include <sstream>
#include <string>
#include <vector>

#include "tests/support/cells.hpp"
#include "tests/support/folders.hpp"
#include "tests/support/host_process.hpp"
#include "tests/support/picture_clip.hpp"
#include "tests/support/temp_dir.hpp"
#include "toolchain/play/trials.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;
using namespace holdfast::tool;
using holdfast::test::kTool;
namespace fs = std::filesystem;

struct Table {
  std::vector<std::string> names;
  std::vector<std::vector<std::string>> rows;

  [[nodiscard]] std::size_t column(const std::string& name) const {
    return static_cast<std::size_t>(std::find(names.begin(), names.end(), name) - names.begin());
  }
  // The first row in which the column says so.
  [[nodiscard]] std::size_t first(const std::string& name, const std::string& what) const {
    std::size_t row = 0;
    while (row < rows.size() && rows[row][column(name)] != what) ++row;
    return row;
  }
};

Table read_table(const fs::path& file) {
  Table table;
  std::istringstream lines(test::read_file(file.string()));
  for (std::string line; std::getline(lines, line);) {
    const std::vector<std::string> cells = test::cells_of(line);
    if (table.names.empty()) {
      table.names = cells;
    } else {
      table.rows.push_back(cells);
    }
  }
  return table;
}

}  // namespace

TEST_GROUP(Hand) {
  test::TempDir dir;
  static test::Finished replay(std::vector<std::string> options) {
    options.insert(options.begin(), {kTool, "replay"});
    return test::run(options);
  }
};

// A ball slides at 20 mm/s. The right recording is the same film without its first two frames.
TEST(Hand, ReplaysTwoRecordings) {
  const std::string left = (dir / "grasp__left").string();
  const std::string right = (dir / "grasp__right").string();
  const int frames = test::write_clip(make_trial(TrialKind::kSlide, 1, 16).scene, left);
  fs::create_directories(right);
  for (int k = 2; k < frames; ++k) {
    fs::copy_file(fs::path(left) / (std::to_string(k) + ".png"), fs::path(right) / (std::to_string(k - 2) + ".png"));
  }
  const std::string one = (dir / "one.csv").string();
  const std::string two = (dir / "two.csv").string();
  LONGS_EQUAL(0, replay({left, "--reference", "first", "--features", one}).status);
  const test::Finished run =
      replay({left, "--reference", "first", "--right", right, "--right-reference", "first", "--features", two});
  STRCMP_EQUAL("", run.err.c_str());
  CHECK_TEXT(run.out.find("its frame 0 is the left's frame 2") != std::string::npos, run.out.c_str());

  const Table alone = read_table(one);
  const Table hand = read_table(two);
  LONGS_EQUAL(frames, hand.rows.size());
  CHECK_TRUE(hand.names.size() == alone.names.size() + 12);
  CHECK_TRUE(std::equal(alone.names.begin(), alone.names.end(), hand.names.begin()));
  for (const auto& row : hand.rows) LONGS_EQUAL(hand.names.size(), row.size());
  // Both see it: no later than one of them.
  const std::size_t slip = hand.first("slip", "1");
  CHECK_TRUE(alone.first("slip", "1") < alone.rows.size());
  CHECK_TRUE(slip <= alone.first("slip", "1"));
  CHECK_TRUE(hand.rows[slip][hand.column("right_strength")] != "none");
  STRCMP_EQUAL("SLIP", hand.rows[slip][hand.column("state")].c_str());
  // Both frames are of the same time. The markers' features stay the left's own.
  STRCMP_EQUAL("0.0", hand.rows[slip][hand.column("right_age_ms")].c_str());
  for (std::size_t row = 0; row < hand.rows.size(); ++row) {
    CHECK_TRUE(alone.rows[row][alone.column("vx_mm_s")] == hand.rows[row][hand.column("vx_mm_s")]);
  }
  // Before the right recording begins nothing is known of that finger, and the hand is not OK.
  STRCMP_EQUAL("", hand.rows[1][hand.column("right_age_ms")].c_str());
  STRCMP_EQUAL("0", hand.rows[1][hand.column("grip_ok")].c_str());
  STRCMP_EQUAL("1", hand.rows[2][hand.column("grip_ok")].c_str());

  // The last place where the recordings meet, and one frame further, on either side.
  const auto placed = [&](int offset) {
    return replay({left, "--reference", "first", "--right", right, "--right-reference", "first", "--offset",
                   std::to_string(offset)});
  };
  for (const int offset : {-(frames - 1), frames - 3}) LONGS_EQUAL(0, placed(offset).status);
  for (const int offset : {-frames, frames - 2}) {
    const test::Finished apart = placed(offset);
    LONGS_EQUAL(1, apart.status);
    CHECK_TEXT(apart.err.find("no frame in common") != std::string::npos, apart.err.c_str());
  }
}

TEST(Hand, TellsWhatIsMissing) {
  const test::Finished no_right = replay({"left.avi", "--offset", "3"});
  LONGS_EQUAL(1, no_right.status);
  CHECK_TEXT(no_right.err.find("--right") != std::string::npos, no_right.err.c_str());
  const test::Finished no_file = replay({"left.avi", "--right", "right.avi", "--offset", "3"});
  LONGS_EQUAL(1, no_file.status);
  CHECK_TEXT(no_file.err.find("right.avi") != std::string::npos, no_file.err.c_str());
}

// The right finger of a trial is its left one's mirror, by the simulation's own truth: what goes left for one goes
// right for the other, and both slip from the same frame on.
TEST(Hand, TrialsHaveAMirroredRightFinger) {
  const Trial trial = make_trial(TrialKind::kHand, 1, 0);
  CHECK_TRUE(trial.right.has_value());
  CHECK_TRUE(trial.scene.object.relief.kind != scene::ReliefKind::kNone);
  CHECK_TRUE(trial.right->object.relief.kind == scene::ReliefKind::kNone);
  CHECK_TRUE(make_trial(TrialKind::kHand, 1, 2).right->object.relief.kind != scene::ReliefKind::kNone);
  scene::Simulation left(trial.scene);
  scene::Simulation right(*trial.right);
  for (int frame = 0; frame < scene::frame_count(trial.scene); ++frame) {
    const scene::Snapshot& a = left.next();
    const scene::Snapshot& b = right.next();
    DOUBLES_EQUAL(a.contact.slid_mm.x, -b.contact.slid_mm.x, 0.02);  // mm: the springs' places are not mirrored
    DOUBLES_EQUAL(a.contact.slid_mm.y, b.contact.slid_mm.y, 0.02);
    DOUBLES_EQUAL(a.contact.depth_mm, b.contact.depth_mm, 0.002);
  }
}

// A few of each; HOLDFAST_TRIALS=500 plays so many. Slides that the left finger alone can see: the hand is no later.
TEST(Hand, IsAsFastAsTheFingerThatSees) {
  const char* const asked = std::getenv("HOLDFAST_TRIALS");
  const int count = asked != nullptr ? std::atoi(asked) : 8;
  TrialTable hand, left;
  for (int number = 0; number < count; ++number) {
    const Trial trial = make_trial(TrialKind::kHand, 1, number);
    const HandResult both = run_hand(trial, Params{});
    hand.add(trial, both.hand);
    left.add(trial, both.left);
    if (!trial.slips || trial.right->object.relief.kind != scene::ReliefKind::kNone) continue;
    CHECK_TRUE_TEXT(both.hand.delay_frames.has_value() || !both.left.delay_frames, trial.scene.name.c_str());
  }
  CHECK_TRUE(hand.all().unreferenced == 0 && hand.all().onsets > 0);
  CHECK_TRUE(hand.all().delays.size() >= left.all().delays.size());
  CHECK_TRUE(hand.all().all_alarms() <= left.all().all_alarms());
}
