// SPDX-License-Identifier: Apache-2.0
// Recordings with labels: rows as the label file says, features as `holdfast replay` writes them, and a clear word
// about every label file that is wrong.
#include <algorithm>
#include <filesystem>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "tests/support/folders.hpp"
#include "tests/support/host_clips.hpp"
#include "tests/support/host_process.hpp"
#include "tests/support/picture_clip.hpp"
#include "tests/support/skip.hpp"
#include "tests/support/temp_dir.hpp"
#include "toolchain/learn/dataset.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;
using holdfast::test::kTool;
namespace fs = std::filesystem;
using learn::Label;
using learn::Row;
using learn::Samples;
using test::Finished;
using test::read_file;
using test::TempDir;
using test::write_file;

constexpr const char* kLabelsHeader = "clip,slip_start,slip_end,onset_recorded,silent_intervals,empty_intervals,note\n";
constexpr const char* kClip = "mug__exp_num_12__camera_9";
constexpr int kFrames = 31;

// A clip of 31 pictures: empty, pressed from 0.4 to 0.9 s, empty.
struct Studio {
  TempDir dir;
  Studio() { LONGS_EQUAL(kFrames, test::write_clip(test::press_scene(1.2, 0.4, 0.9), dir / kClip)); }

  std::optional<std::string> read(const std::string& labels, Samples& samples) const {
    write_file(dir / "labels.csv", labels);
    return learn::read_recordings(dir / "labels.csv", Params{}, samples);
  }
  void refuses(const std::string& labels, const char* says) const {
    Samples samples;
    samples.rows.resize(3);
    const auto error = read(labels, samples);
    CHECK_TEXT(error.has_value(), says);
    CHECK_TEXT(error->find(says) != std::string::npos, error->c_str());
    CHECK_TEXT(error->find("labels.csv") != std::string::npos, error->c_str());
    CHECK_TEXT(error->find(". Likely cause: ") != std::string::npos, error->c_str());
    CHECK_TEXT(error->find(". Next: ") != std::string::npos, error->c_str());
    CHECK(error->find('\n') == std::string::npos);
    CHECK(samples.rows.empty() && samples.trials.empty());
  }
};

// One letter a frame: h, s or o.
std::string spelled(const Samples& samples) {
  std::string out;
  for (const Row& row : samples.rows) out += learn::name_of(row.label)[0];
  return out;
}

}  // namespace

TEST_GROUP(Recordings){};

TEST(Recordings, RowsAreAsTheLabelFileSays) {
  const Studio studio;
  Samples samples;
  // Other columns, another order, quotes, and a line end from another system.
  const auto error = studio.read(
      "note,clip,empty_intervals,silent_intervals,slip_start,slip_end,onset_recorded\r\n"
      "\"turned, not lost; "
      "\"\"odd\"\"\",mug__exp_num_12__camera_9,0-8;24-30,10-12:high;13-14:low;15-17:medium,18,20,1\r\n",
      samples);
  STRCMP_EQUAL("", error.value_or("").c_str());
  STRCMP_EQUAL("eeeeeeeeeohhhoohhhsssoooeeeeeee", spelled(samples).c_str());
  LONGS_EQUAL(1, samples.trials.size());
  const learn::Trial& trial = samples.trials[0];
  CHECK(trial.source == learn::Source::kRecorded);
  STRCMP_EQUAL("mug", trial.object.c_str());
  STRCMP_EQUAL("clip", trial.kind.c_str());
  STRCMP_EQUAL("", trial.primitive.c_str());
  LONGS_EQUAL(12, trial.seed);
  LONGS_EQUAL(kFrames, trial.count);
  for (const Row& row : samples.rows) {
    DOUBLES_EQUAL(row.frame / 25.0, row.t_s, 1e-9);
    DOUBLES_EQUAL(row.label == Label::kSlip ? 1.0 : 0.0, row.slip_fraction, 0.0);
    CHECK(row.accepted);
  }
}

TEST(Recordings, ALabelFileMayBeginWithAByteOrderMark) {
  const Studio studio;
  Samples samples;
  STRCMP_EQUAL(
      "", studio.read("\xEF\xBB\xBF" + std::string(kLabelsHeader) + kClip + ",,,0,,,\n", samples).value_or("").c_str());
  LONGS_EQUAL(kFrames, samples.rows.size());
}

TEST(Recordings, AnOnsetThatWasNotSeenHasNoHoldBeforeIt) {
  const Studio studio;
  const std::string tail = ",2-8:high;12-14:high,24-30,\n";
  Samples seen, unseen;
  CHECK(!studio.read(kLabelsHeader + std::string(kClip) + ",9,11,1" + tail, seen));
  CHECK(!studio.read(kLabelsHeader + std::string(kClip) + ",9,11,0" + tail, unseen));
  STRCMP_EQUAL("oohhhhhhhssshhhoooooooooeeeeeee", spelled(seen).c_str());
  STRCMP_EQUAL("ooooooooosssHHHoooooooooeeeeeee",
               [&] {
                 std::string text = spelled(unseen);
                 std::replace(text.begin(), text.end(), 'h', 'H');
                 return text;
               }()
                   .c_str());
}

TEST(Recordings, TheRestPositionIsTheOneThatTheFileSays) {
  const Studio studio;
  // In frame 15 the ball presses. E of the empty frame 2 against it is the press's; against empty frames it is 0.
  fs::copy(studio.dir / kClip / "15.png", studio.dir / "empty_camera_9.png");
  const auto entropy_at_2 = [&](const std::string& name, const std::string& empty) {
    Samples samples;
    const auto error = studio.read(kLabelsHeader + name + ",,,0,," + empty + ",\n", samples);
    STRCMP_EQUAL("", error.value_or("").c_str());
    const auto* const index = std::ranges::find(kFeatures, std::string_view("entropy_nat_q16"), &FeatureInfo::name);
    return samples.rows[2].x[static_cast<std::size_t>(index - kFeatures.begin())];
  };
  const std::string clip = kClip;
  LONGS_EQUAL(0, entropy_at_2(clip, "0-8;24-30"));  // its last frame
  LONGS_EQUAL(0, entropy_at_2(clip, "0-8"));        // its first
  CHECK(entropy_at_2(clip, "") > 10'000);           // the camera's picture, here of a press
  fs::rename(studio.dir / "empty_camera_9.png", studio.dir / "other.png");
  LONGS_EQUAL(0, entropy_at_2(clip, ""));  // the first, whatever it shows
}

TEST(Recordings, AWrongLabelFileIsRefusedInOneLine) {
  const Studio studio;
  fs::copy(studio.dir / kClip, studio.dir / "second");
  const std::string clip = kClip;
  const std::string header = kLabelsHeader;
  studio.refuses("", "no clips");
  studio.refuses(header, "no clips");
  studio.refuses("clip,slip_start,slip_end,onset_recorded,silent_intervals\n", "'empty_intervals' is missing");
  studio.refuses(header + clip + ",,,0,\n", "labels.csv:2: 5 cells where 7 are due");
  studio.refuses(header + "cup__exp_num_1__camera_9,,,0,,,\n", "clip 'cup__exp_num_1__camera_9' is not beside");
  studio.refuses(header + ",,,0,,,\n", "clip ''");
  studio.refuses(header + clip + ",,,2,,,\n", "onset_recorded '2'");
  studio.refuses("clip,slip_start,slip_end,onset_recorded,silent_intervals,empty_intervals,slip_start\n",
                 "labels.csv:1: column 'slip_start' is there twice");
  studio.refuses("clip;slip_start;slip_end\n", "labels.csv:1: its cells are parted by semicolons");
  studio.refuses("clip\tslip_start\tslip_end\n", "labels.csv:1: its cells are parted by tabs");
  studio.refuses("\xFF\xFE" + header, "labels.csv:1: it is UTF-16");
  studio.refuses(header + clip + ",5,,1,,,\n", "'5-'");
  studio.refuses(header + clip + ",,5,1,,,\n", "'-5'");
  studio.refuses(header + clip + ",9,5,1,,,\n", "'9-5'");
  studio.refuses(header + clip + ",5,7x,1,,,\n", "'5-7x'");
  studio.refuses(header + clip + ",,,0,2-8,,\n", "'2-8' has no confidence");
  studio.refuses(header + clip + ",,,0,2-8:sure,,\n", "'2-8:sure'");
  studio.refuses(header + clip + ",,,0,8-2:high,,\n", "'8-2'");
  studio.refuses(header + clip + ",,,0,,8,\n", "'8'");
  studio.refuses(header + clip + ",5,31,1,,,\n", "labels.csv:2: interval 5-31 ends after the last frame 30");
  studio.refuses(header + clip + ",5,7,1,,,\nsecond,5,31,1,,,\n", "labels.csv:3:");
  studio.refuses(header + clip + ",5,7,1,0-2:low;0-5:medium,,\n",
                 "labels.csv:2: silent interval 0-5 overlaps the slip 5-7 of mug__exp_num_12__camera_9");
  studio.refuses(header + clip + ",5,7,1,0-4:high;7-9:high,,\n", "silent interval 7-9 overlaps the slip 5-7");
  studio.refuses(header + clip + ",5,7,1,,6-6,\n", "labels.csv:2: empty interval 6-6 overlaps the slip 5-7");
  write_file(studio.dir / "text.avi", "no film");
  Samples samples;
  // What is of low confidence does not count.
  CHECK_FALSE(studio.read(header + clip + ",5,7,1,0-6:low,,\n", samples).has_value());
  const auto broken = studio.read(header + "text,,,0,,,\n", samples);
  CHECK(broken && broken->find("text.avi") != std::string::npos);
}

// Labels that cannot all be true are named, and count as they stand.
TEST(Recordings, LabelsThatContradictEachOtherAreNamed) {
  learn::ClipLabels clip;
  clip.file = "labels.csv";
  clip.line = 2;
  clip.name = "cup";
  clip.contact = {20, 60};
  clip.slip = {40, 50};
  clip.empty = {{0, 19}, {61, 80}};
  clip.silent.push_back({{22, 30}, learn::Confidence::kHigh});
  clip.silent.push_back({{28, 36}, learn::Confidence::kHigh});
  CHECK(learn::contradictions(clip).empty());
  clip.empty[0].to = 20;
  clip.slip = {61, 70};
  clip.silent.push_back({{36, 38}, learn::Confidence::kLow});
  const std::vector<std::string> found = learn::contradictions(clip);
  LONGS_EQUAL(3, found.size());
  STRCMP_EQUAL("labels.csv:2: cup: empty 0-20 and in contact 20-60", found[0].c_str());
  STRCMP_EQUAL("labels.csv:2: cup: slip 61-70 and in contact 20-60", found[1].c_str());
  STRCMP_EQUAL("labels.csv:2: cup: silent 28-36 and silent with another confidence 36-38", found[2].c_str());
  clip.contact->to = learn::kUnknownEnd;
  STRCMP_EQUAL("labels.csv:2: cup: empty 0-20 and in contact 20-", learn::contradictions(clip)[0].c_str());
  clip.contact.reset();
  LONGS_EQUAL(1, learn::contradictions(clip).size());
}

// Twice the same frames would be twice the minutes, the onsets and the weight.
TEST(Recordings, ARecordingIsLabelledOnce) {
  const Studio studio;
  const std::string clip = kClip;
  const std::string labels = (studio.dir / "labels.csv").string();
  studio.refuses(kLabelsHeader + clip + ",,,0,,,\n\n" + clip + ",5,7,1,,,\n",
                 (labels + ":4: " + clip + " is labelled in " + labels + ":2 too").c_str());
  fs::create_directory_symlink(studio.dir / clip, studio.dir / "same");
  studio.refuses(kLabelsHeader + clip + ",,,0,,,\nsame,5,7,1,,,\n", "labels.csv:3: same is labelled in");
}

TEST(Recordings, ItStopsWhenAsked) {
  const Studio studio;
  Samples samples;
  fs::copy(studio.dir / kClip, studio.dir / "second");
  write_file(studio.dir / "labels.csv", kLabelsHeader + std::string(kClip) + ",,,0,,,\nsecond,,,0,,,\n");
  int asked = 0;
  const auto error = learn::read_recordings(studio.dir / "labels.csv", Params{}, samples, [&](int done, int all) {
    LONGS_EQUAL(++asked, done);
    LONGS_EQUAL(2, all);
    return false;
  });
  CHECK(error && samples.trials.empty());
  LONGS_EQUAL(1, asked);
}

TEST(Recordings, TheCommandWritesNothingWhenAClipIsMissing) {
  const Studio studio;
  write_file(studio.dir / "labels.csv", kLabelsHeader + std::string(kClip) + ",,,0,,,\nother,,,0,,,\n");
  const Finished finished =
      test::run({kTool, "dataset", "--recordings", studio.dir / "labels.csv", "--out", studio.dir / "out.csv"});
  LONGS_EQUAL(1, finished.status);
  CHECK(finished.err.find("other") != std::string::npos);
  CHECK(!fs::exists(studio.dir / "out.csv"));
}

TEST(Recordings, TheCommandChangesNoInput) {
  const Studio studio;
  const std::string labels = studio.dir / "labels.csv";
  write_file(labels, kLabelsHeader + std::string(kClip) + ",,,0,,,\nc.mcap,,,0,,,\n");
  write_file(studio.dir / "c.mcap", "mine");
  write_file(studio.dir / "empty_camera_9.png", "mine");
  for (const char* const name : {"labels.csv", "c.mcap", "empty_camera_9.png"}) {
    const std::string before = read_file(studio.dir / name);
    const Finished finished = test::run({kTool, "dataset", "--recordings", labels, "--out", studio.dir / name});
    LONGS_EQUAL(1, finished.status);
    CHECK_TEXT(finished.err.find("--out would change") != std::string::npos, finished.err.c_str());
    STRCMP_EQUAL(before.c_str(), read_file(studio.dir / name).c_str());
  }
}

namespace {

// Of the real clips, by what the label file says of their empty frames.
struct Chosen {
  const char* clip;
  const char* reference;  // as `holdfast replay` takes it; a name of a file: beside the clips
};
constexpr Chosen kChosen[] = {
    {"avocado_real__exp_num_6__camera_2", "448"},
    {"blue_box__exp_num_4__camera_2", "empty_camera_2.png"},
    {"artificial_strawberry__exp_num_1__camera_0", "last"},
};

}  // namespace

TEST(Recordings, TheRealClipsAreReadAsReplayReadsThem) {
  const fs::path folder = test::clips_folder();
  if (folder.empty()) {
    test::skip("the real recordings are not beside the clone (../shared/data/real)");
    return;
  }
  const TempDir dir;
  const Finished made =
      test::run({kTool, "dataset", "--recordings", folder / "labels.csv", "--out", dir / "clips.csv", "--json"});
  LONGS_EQUAL_TEXT(0, made.status, made.err.c_str());
  std::istringstream in(read_file(dir / "clips.csv"));
  Samples samples;
  STRCMP_EQUAL("", learn::read_csv(in, "clips.csv", samples).value_or("").c_str());
  LONGS_EQUAL(27, samples.trials.size());
  LONGS_EQUAL(27 * 450, samples.rows.size());
  // Counted from labels.csv by another program (Python's csv), 2026-11-21.
  long hold = 0, slip = 0, onsets = 0;
  for (const learn::Trial& trial : samples.trials) {
    bool held = false, counted = false;
    for (const Row& row : samples.of(trial)) {
      hold += row.label == Label::kHold ? 1 : 0;
      slip += row.label == Label::kSlip ? 1 : 0;
      held = held || row.label == Label::kHold;
      counted = counted || (held && row.label == Label::kSlip);
    }
    onsets += counted ? 1 : 0;
  }
  LONGS_EQUAL(3904, hold);
  LONGS_EQUAL(258, slip);
  LONGS_EQUAL(13, onsets);

  for (const auto& [clip, reference] : kChosen) {
    const std::string name = clip;
    const std::string object = name.substr(0, name.find("__"));
    const auto trial = std::ranges::find_if(samples.trials, [&](const learn::Trial& t) {
      return t.object == object && name.find("num_" + std::to_string(t.seed) + "_") != std::string::npos;
    });
    CHECK(trial != samples.trials.end());
    const std::string which = fs::exists(folder / reference) ? (folder / reference).string() : reference;
    const Finished replayed = test::run(
        {kTool, "replay", folder / (name + ".avi"), "--reference", which, "--features", dir / "features.csv"});
    LONGS_EQUAL_TEXT(0, replayed.status, replayed.err.c_str());
    std::istringstream lines(read_file(dir / "features.csv"));
    std::string line;
    std::getline(lines, line);
    std::size_t k = 0;
    for (; std::getline(lines, line); ++k) {
      const Row& row = samples.of(*trial)[k];
      std::vector<std::string> cells;
      std::stringstream cut(line);
      for (std::string cell; std::getline(cut, cell, ',');) cells.push_back(cell);
      DOUBLES_EQUAL(std::stod(cells[1]), row.t_s, 1e-6);
      CHECK_EQUAL(!cells[5].empty(), row.accepted);
      if (!row.accepted) continue;
      // The first four of kFeatures, with half of the last digit that replay prints.
      DOUBLES_EQUAL(std::stod(cells[5]), row.x[0] / 1000.0, 0.00051);
      DOUBLES_EQUAL(std::stod(cells[6]), row.x[1] / 1000.0, 0.00051);
      DOUBLES_EQUAL(std::stod(cells[7]), row.x[2] / 65536.0, 0.00000051);
      DOUBLES_EQUAL(std::stod(cells[8]), row.x[3] / 256.0, 0.00000051);
    }
    LONGS_EQUAL(450, k);
  }
}
