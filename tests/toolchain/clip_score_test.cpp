// SPDX-License-Identifier: Apache-2.0
// The two tallies of labelled clips, counted by hand; and the command, whose alarms are those of `holdfast replay`.
#include "toolchain/learn/clip_score.hpp"

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "base/math.hpp"
#include "tests/support/folders.hpp"
#include "tests/support/host_clips.hpp"
#include "tests/support/host_process.hpp"
#include "tests/support/picture_clip.hpp"
#include "tests/support/skip.hpp"
#include "tests/support/temp_dir.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;
using namespace holdfast::learn;
using holdfast::test::kTool;
namespace fs = std::filesystem;
using test::Finished;

// 450 frames: silent 2-100 and 160-280, slip 110-120, a load step 300-310, low confidence 320-340, empty from 400.
ClipLabels shaken_clip() {
  ClipLabels clip;
  clip.name = "mug__exp_num_1__camera_0";
  clip.object = "mug";
  clip.contact = Frames{0, 390};
  clip.slip = Frames{110, 120};
  clip.onset_recorded = true;
  clip.event = Frames{300, 310};
  clip.event_kind = "load_step_contact_persists";
  clip.silent = {{{2, 100}, Confidence::kHigh}, {{160, 280}, Confidence::kMedium}, {{320, 340}, Confidence::kLow}};
  clip.empty = {{400, 449}};
  return clip;
}

// Empty 0-39, touched at 40, slips at once in 46-50, again in 90-95.
ClipLabels short_grasp() {
  ClipLabels clip;
  clip.name = "cup__exp_num_1__camera_0";
  clip.object = "cup";
  clip.contact = Frames{40, 95};
  clip.slip = Frames{46, 50};
  clip.onset_recorded = true;
  clip.event = Frames{90, 95};
  clip.event_kind = "second_slip_loss";
  clip.silent = {{{60, 84}, Confidence::kHigh}};
  clip.empty = {{14, 38}, {100, 119}};
  return clip;
}

// Slip that is raised in these frames, for two frames each.
std::vector<std::uint8_t> alarms_at(int frames, const std::vector<int>& at) {
  std::vector<std::uint8_t> slip(idx(frames));
  for (const int t : at) slip[idx(t)] = slip[idx(t + 1)] = 1;
  return slip;
}

ClipScore score_of(const ClipLabels& clip, std::span<const std::uint8_t> slip) {
  ClipScore score;
  add_clip(score, clip, slip, nullptr);
  return score;
}

int within_10(const ClipLabels& clip, int frames, const std::vector<int>& alarms) {
  return score_of(clip, alarms_at(frames, alarms)).onsets.within[1];
}

}  // namespace

TEST_GROUP(ClipScore){};

TEST(ClipScore, SilenceIsCountedByHand) {
  //                                           silent  shaken  low  unlabelled  empty  slip  load step
  const auto slip = alarms_at(450, {50, 170, 260, 325, 390, 420, 112, 303});
  const ClipScore score = score_of(shaken_clip(), slip);
  LONGS_EQUAL(3, score.silent.count);
  LONGS_EQUAL(99 + 121, score.silent.frames);
  LONGS_EQUAL(1, score.shaken.count);  // 170; 50 and 260 are outside of frames 100 to 250
  LONGS_EQUAL(1 + 91, score.shaken.frames);
  LONGS_EQUAL(1, score.empty.count);
  LONGS_EQUAL(50, score.empty.frames);
  DOUBLES_EQUAL(1500.0 / 50.0, score.empty.per_minute().value(), 1e-9);
  ClipLabels still = shaken_clip();
  still.object = "artificial_strawberry";
  LONGS_EQUAL(0, score_of(still, slip).shaken.frames);
}

TEST(ClipScore, AnAlarmIsARiseAndNothingElse) {
  std::vector<std::uint8_t> slip(450, 1);  // up from the first frame on
  const ClipScore score = score_of(shaken_clip(), slip);
  LONGS_EQUAL(0, score.silent.count);  // frame 0 has no label
  LONGS_EQUAL(0, score.onsets.within.back());
  LONGS_EQUAL(1, score.whole().count);
}

TEST(ClipScore, AnOnsetIsDetectedFromTheLastSilentFrameOn) {
  ClipLabels clip = shaken_clip();
  LONGS_EQUAL(1, score_of(clip, alarms_at(450, {115})).onsets.within[0]);
  LONGS_EQUAL(0, score_of(clip, alarms_at(450, {116})).onsets.within[0]);
  LONGS_EQUAL(1, within_10(clip, 450, {120}));
  LONGS_EQUAL(0, within_10(clip, 450, {121}));
  LONGS_EQUAL(1, score_of(clip, alarms_at(450, {125})).onsets.within[2]);
  LONGS_EQUAL(0, score_of(clip, alarms_at(450, {126})).onsets.within[2]);
  LONGS_EQUAL(1, within_10(clip, 450, {104}));  // 6 frames early
  LONGS_EQUAL(0, within_10(clip, 450, {103}));
  clip.silent[0].to = 106;
  LONGS_EQUAL(0, within_10(clip, 450, {106}));
  LONGS_EQUAL(1, within_10(clip, 450, {107}));
  clip.silent[0].confidence = Confidence::kLow;  // silence all the same, as far as onsets go
  LONGS_EQUAL(0, within_10(clip, 450, {106}));
  // Up since before: no alarm comes at the onset.
  auto slip = alarms_at(450, {});
  std::fill(slip.begin() + 90, slip.begin() + 140, std::uint8_t{1});
  LONGS_EQUAL(0, score_of(clip, slip).onsets.within.back());
  CHECK(score_of(clip, alarms_at(450, {105, 130})).onsets.delays.empty());  // 105 is silent, and 130 too late
  CHECK(std::vector{0} == score_of(clip, alarms_at(450, {108, 112})).onsets.delays);
}

TEST(ClipScore, OnlyRecordedOnsetsOfSomeConfidenceCount) {
  ClipLabels clip = shaken_clip();
  clip.onset_recorded = false;
  LONGS_EQUAL(0, score_of(clip, alarms_at(450, {})).onsets.count);
  clip = shaken_clip();
  clip.confidence = Confidence::kLow;
  const ClipScore score = score_of(clip, alarms_at(450, {50, 111}));
  LONGS_EQUAL(0, score.onsets.count);
  LONGS_EQUAL(1, score.silent.count);  // an interval's own confidence decides
  LONGS_EQUAL(0, score.whole().frames);
  LONGS_EQUAL(0, score.trials);
}

TEST(ClipScore, AClipThatWasNotReplayedHasDetectedNothing) {
  std::vector<Finding> findings;
  ClipScore score;
  const ClipLabels clip = shaken_clip();
  add_clip(score, clip, {}, &findings);
  LONGS_EQUAL(1, score.onsets.count);
  LONGS_EQUAL(0, score.onsets.within.back());
  LONGS_EQUAL(0, score.silent.frames);
  LONGS_EQUAL(0, score.trials);
  STRCMP_EQUAL("missed onset 110: the clip was not replayed", findings.at(0).what.c_str());
}

TEST(ClipScore, PhasesCoverTheWholeTrial) {
  const auto spelled = [](const ClipLabels& clip, int frames) {
    std::string text;
    int count = 0;
    for (int t = 0; t <= frames; ++t) {
      if (t > 0 && (t == frames || phase_of(clip, t, frames) != phase_of(clip, t - 1, frames))) {
        text += kPhaseNames[idx(static_cast<int>(phase_of(clip, t - 1, frames)))];
        text += " " + std::to_string(count) + ", ";
        count = 0;
      }
      ++count;
    }
    return text;
  };
  STRCMP_EQUAL(
      // 0-99, 100-106, 107-135 (3 before, 15 after), 136-250, 251-294, 295-315 (5 beyond), 316-399, 400-449
      "hold 100, shake 7, slip 29, shake 115, hold 44, load step 21, hold 84, empty 50, ",
      spelled(shaken_clip(), 450).c_str());
  STRCMP_EQUAL(
      // 0-12 may be stale, 13 has no label, 14-38, 39-42, 43-65, 66-84, 85-110 (second slip, 5 before to 15 after),
      // 111-119
      "unscored 13, hold 1, empty 25, touch 4, slip 23, hold 19, slip 26, empty 9, ",
      spelled(short_grasp(), 120).c_str());
  ClipLabels lost = shaken_clip();
  lost.event_kind = "contact_lost";
  lost.release = Frames{306, 312};
  CHECK(phase_of(lost, 296, 450) == Phase::kRelease);
  CHECK(phase_of(lost, 317, 450) == Phase::kRelease);
  CHECK(phase_of(lost, 318, 450) == Phase::kHold);
  CHECK(phase_of(shaken_clip(), 200, 399) == Phase::kHold);  // a clip too short to be one of those that shake
}

TEST(ClipScore, TouchesAreCountedInClips) {
  ClipScore score;
  std::vector<Finding> findings;
  const ClipLabels clip = short_grasp();
  const auto slip = alarms_at(120, {39, 42, 91});
  add_clip(score, clip, slip, &findings);
  add_clip(score, clip, alarms_at(120, {5, 48, 70}), nullptr);
  LONGS_EQUAL(2, score.trials);
  LONGS_EQUAL(2, score.touches);
  LONGS_EQUAL(1, score.touches_alarmed);
  LONGS_EQUAL(2, score.phases[idx(static_cast<int>(Phase::kTouch))].count);
  LONGS_EQUAL(3, score.whole().count);  // 39, 42 and 70
  LONGS_EQUAL(2, score.onsets.count);
  LONGS_EQUAL(2, score.onsets.within[0]);  // 42 is 4 frames early
  LONGS_EQUAL(2, score.seconds.count);
  LONGS_EQUAL(1, score.seconds.within[0]);
  LONGS_EQUAL(0, score.phases[idx(static_cast<int>(Phase::kLoadStep))].frames);
  STRCMP_EQUAL("alarm 1 frame after empty 14-38", findings.at(0).what.c_str());
  STRCMP_EQUAL("alarm 2 frames after first contact 40", findings.at(1).what.c_str());
}

TEST(ClipScore, EveryFindingSaysWhereItIs) {
  std::vector<Finding> findings;
  ClipScore score;
  const ClipLabels clip = shaken_clip();
  add_clip(score, clip, alarms_at(450, {50, 105, 150, 420}), &findings);
  LONGS_EQUAL(4, findings.size());
  STRCMP_EQUAL("alarm in silent 2-100", findings[0].what.c_str());
  CHECK(findings[0].silent && findings[0].phase == Phase::kHold && findings[0].frame == 50);
  STRCMP_EQUAL("alarm 5 frames after silent 2-100", findings[1].what.c_str());
  STRCMP_EQUAL("alarm 10 frames before silent 160-280", findings[2].what.c_str());
  STRCMP_EQUAL("alarm in empty 400-449", findings[3].what.c_str());
  findings.clear();
  add_clip(score, clip, alarms_at(450, {140}), &findings);
  CHECK(findings[0].missed && findings[0].frame == 110);
  STRCMP_EQUAL("missed onset 110: next alarm 30 frames after it", findings[0].what.c_str());
}

TEST(ClipScore, ThresholdsComeFromOtherObjectsAtTheSameAlarms) {
  // Slip shows 9 on every object. In silence the mug shows 4, the cup 6 and the pen 2, each once.
  std::vector<ClipLabels> clips(3, shaken_clip());
  std::vector<ClipValues> values;
  const std::array silence{4.0, 6.0, 2.0};
  for (std::size_t c = 0; c < clips.size(); ++c) {
    clips[c].object = std::array{"mug", "cup", "pen"}[c];
    values.push_back({&clips[c], alarms_at(450, {}), std::vector<double>(450)});
    values[c].values[50] = silence[c];
    values[c].values[111] = 9.0;
  }
  const auto quiet = leave_one_object_out(values);
  // No alarm is allowed elsewhere: the cup's own 6 lies above the mug's 4, which is its threshold; nobody else alarms.
  LONGS_EQUAL(0, score_of(clips[0], quiet[0]).silent.count);
  LONGS_EQUAL(1, score_of(clips[1], quiet[1]).silent.count);
  LONGS_EQUAL(0, score_of(clips[2], quiet[2]).silent.count);
  for (std::size_t c = 0; c < clips.size(); ++c) LONGS_EQUAL(1, score_of(clips[c], quiet[c]).onsets.within[0]);
  // With an alarm of the other detector on the cup, the mug's and the pen's may raise one there.
  values[1].budget = alarms_at(450, {200});
  const auto louder = leave_one_object_out(values);
  LONGS_EQUAL(1, score_of(clips[0], louder[0]).silent.count);  // above the pen's 2
  LONGS_EQUAL(0, score_of(clips[2], louder[2]).silent.count);  // above the mug's 4
}

TEST(ClipScore, ADecisionIsHeldForFiveFrames) {
  std::vector<double> values(12);
  values[2] = values[4] = 1.0;
  const std::vector<std::uint8_t> expected{0, 0, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0};
  CHECK(expected == held_above(values, 0.5));
  CHECK(std::vector<std::uint8_t>(12) == held_above(values, 1.0));
}

namespace {

// Slip while the markers move to the right, whatever they do otherwise.
constexpr const char* kRightwards =
    "format 1\nname right\nfeature_set velocity\nfeature vx_um_s um/s Q0\nfeature vy_um_s um/s Q0\n"
    "node 0: vx_um_s <= 0 ? 1 : 2\nleaf 1: hold\nleaf 2: slip\n";

std::vector<int> replayed_alarms(const std::string& clip, const std::string& reference, const std::string& model) {
  const Finished run =
      test::run({kTool, "replay", clip, "--grid", "auto", "--reference", reference, "--model", model, "--json"});
  STRCMP_EQUAL("", run.err.c_str());
  return nlohmann::json::parse(run.out)["slip_frames"];
}

std::vector<int> evaluated_alarms(const nlohmann::json& report, const std::string& clip) {
  std::vector<int> frames;
  for (const auto& row : report["tables"]["findings"]) {
    if (row["detector"] == "holdfast" && row["clip"] == clip && row["counts_as"] != "missed") {
      frames.push_back(row["frame"]);
    }
  }
  return frames;
}

constexpr const char* kHeader =
    "clip,contact_start,contact_end,slip_start,slip_end,onset_recorded,silent_intervals,empty_intervals,confidence\n";

}  // namespace

TEST_GROUP(EvaluateRecorded) {
  test::TempDir dir;

  std::string refused(const std::vector<std::string>& arguments) {
    std::vector<std::string> all{kTool, "evaluate", "--json", (dir / "out.json").string()};
    all.insert(all.end(), arguments.begin(), arguments.end());
    const Finished run = test::run(all);
    LONGS_EQUAL(1, run.status);
    LONGS_EQUAL(1, std::count(run.err.begin(), run.err.end(), '\n'));
    CHECK(run.err.find("Likely cause: ") != std::string::npos && run.err.find("Next: ") != std::string::npos);
    CHECK(!fs::exists(dir / "out.json"));
    return run.err;
  }
};

TEST(EvaluateRecorded, AlarmsAreThoseOfReplay) {
  // A ball that comes, goes and comes again, in pictures; empty until 0.4 s and after 0.9 s.
  LONGS_EQUAL(31, test::write_clip(test::press_scene(1.2, 0.4, 0.9), dir / "ball__exp_num_1__camera_0"));
  fs::copy(dir / "ball__exp_num_1__camera_0", dir / "ball__exp_num_2__camera_0");
  test::write_file(dir / "right.tree", kRightwards);
  std::string header = kHeader;
  header.insert(header.size() - 1, ",note");
  test::write_file(dir / "labels.csv",
                   header +
                       "ball__exp_num_1__camera_0,10,23,,,0,12-20:high,0-8;25-30,high,\"rolls, then rests\"\n"
                       "ball__exp_num_2__camera_0,0,23,12,20,1,2-5:high,25-30,medium,\n");
  const std::string model = (dir / "right.tree").string();
  const Finished run = test::run({kTool, "evaluate", "--recorded", (dir / "labels.csv").string(), "--model", model,
                                  "--json", (dir / "out.json").string(), "--out", (dir / "out").string()});
  STRCMP_EQUAL("", run.err.c_str());
  LONGS_EQUAL(0, run.status);
  const auto report = nlohmann::json::parse(test::read_file(dir / "out.json"));
  // The rest position is the middle of the empty frames before the contact, or the end of the last ones.
  const auto& clips = report["tables"]["clips"];
  STRCMP_EQUAL("4", clips[0]["reference"].get<std::string>().c_str());
  STRCMP_EQUAL("29", clips[1]["reference"].get<std::string>().c_str());
  const std::string clip = (dir / "ball__exp_num_1__camera_0").string();
  const std::vector<int> expected = replayed_alarms(clip, "4", model);
  CHECK(!expected.empty());
  CHECK(expected == evaluated_alarms(report, "ball__exp_num_1__camera_0"));
  CHECK(replayed_alarms(clip, "29", model) == evaluated_alarms(report, "ball__exp_num_2__camera_0"));
  LONGS_EQUAL(4, report["tables"]["silence"].size());  // ours, the paper's, imprint alone, motion start
  LONGS_EQUAL(1, report["tables"]["silence"][0]["onsets"].get<int>());
  CHECK(fs::exists(dir / "out" / "trials.csv"));
  STRCMP_CONTAINS(",\"rolls, then rests\"\n", test::read_file(dir / "out" / "findings.csv").c_str());
  STRCMP_CONTAINS("Whole trials by phase", run.out.c_str());
}

TEST(EvaluateRecorded, AClipThatNeverShowsTheEmptyGelSaysHowItWasReplayed) {
  const fs::path clip = dir / "ball__exp_num_1__camera_9";
  (void)test::write_clip(test::press_scene(1.2, 0.4, 0.9), clip);
  test::write_file(dir / "labels.csv", std::string(kHeader) + "ball__exp_num_1__camera_9,0,30,,,0,,,high\n");
  const auto reference_with = [&](const std::vector<std::string>& more) {
    std::vector<std::string> all{kTool, "evaluate", "--recorded", (dir / "labels.csv").string()};
    all.insert(all.end(), {"--json", (dir / "out.json").string()});
    all.insert(all.end(), more.begin(), more.end());
    const Finished run = test::run(all);
    STRCMP_EQUAL("", run.err.c_str());
    const auto report = nlohmann::json::parse(test::read_file(dir / "out.json"));
    const auto& row = report["tables"]["clips"][0];
    const bool noted = run.out.find("rest in contact") != std::string::npos;
    CHECK_EQUAL(noted, row["rest"] == "in contact");
    return row["reference"].get<std::string>();
  };
  STRCMP_EQUAL("last", reference_with({}).c_str());
  const std::string picture = (clip / "2.png").string();
  STRCMP_EQUAL(picture.c_str(), reference_with({"--empty", picture}).c_str());
  fs::copy(clip / "2.png", dir / "empty_camera_9.png");
  STRCMP_EQUAL((dir / "empty_camera_9.png").c_str(), reference_with({}).c_str());
}

TEST(EvaluateRecorded, WhatCannotBeIsRefusedInOneLine) {
  (void)test::write_clip(test::press_scene(0.4), dir / "gel__exp_num_1__camera_0");  // 11 frames
  const std::string labels = (dir / "labels.csv").string();
  const auto refuses = [&](const std::string& row, const char* says) {
    test::write_file(dir / "labels.csv", kHeader + ("gel__exp_num_1__camera_0," + row) + "\n");
    STRCMP_CONTAINS(says, refused({"--recorded", labels}).c_str());
  };
  refuses("0,5,,,0,,,sure", "confidence 'sure'");
  refuses("0,5,,,1,,,high", "onset_recorded is 1, but there is no slip_start");
  refuses("5,2,,,0,,,high", "'5-2' is no interval");
  refuses("x,,,,0,,,high", "'x-' is no interval");
  refuses("0,11,,,0,,,high", "interval 0-11 ends after the last frame 10");
  refuses("0,9,,,0,2-11:low,,high", "interval 2-11 ends after the last frame 10");
  // Its middle is to be the reference, so that the clip cannot even be replayed.
  refuses("0,9,,,0,,20-30,high",
          "labels.csv:2: interval 20-30 ends after the last frame 10 of gel__exp_num_1__camera_0");
  refuses("0,9,3,6,1,6-8:high,,high", "silent interval 6-8 overlaps the slip 3-6");
  refuses("0,9,3,6,1,,0-3,high", "empty interval 0-3 overlaps the slip 3-6");
  STRCMP_CONTAINS("none.csv: cannot be read", refused({"--recorded", (dir / "none.csv").string()}).c_str());
  std::string misspelt = kHeader;
  misspelt.replace(misspelt.find("confidence"), 10, "confidance");
  test::write_file(dir / "labels.csv", misspelt + "gel__exp_num_1__camera_0,0,5,,,0,,,low\n");
  STRCMP_CONTAINS(
      "labels.csv:1: column 'confidance' is none that is read. Likely cause: a typing error. Next: name it confidence",
      refused({"--recorded", labels}).c_str());
  STRCMP_CONTAINS("neither or both", refused({}).c_str());
  STRCMP_CONTAINS("neither or both", refused({"data.csv", "--recorded", labels}).c_str());
  test::write_file(dir / "labels.csv", kHeader + std::string("gel__exp_num_1__camera_0,,,,,0,,0-10,high\n"));
  STRCMP_CONTAINS("none.tree", refused({"--recorded", labels, "--model", (dir / "none.tree").string()}).c_str());
  STRCMP_CONTAINS("more than one", refused({"--recorded", labels, "--model", "a", "b"}).c_str());
}

TEST(EvaluateRecorded, ARecordingIsScoredOnce) {
  const std::string left = "gel__exp_num_1__camera_0", right = "gel__exp_num_1__camera_2";
  (void)test::write_clip(test::press_scene(0.4), dir / left);
  fs::copy(dir / left, dir / right);
  const std::string row = ",,,,,0,,0-10,high\n";
  test::write_file(dir / "labels.csv", kHeader + left + row);
  test::write_file(dir / "labels_v2.csv", kHeader + right + row + left + row);
  const std::string first = (dir / "labels.csv").string(), second = (dir / "labels_v2.csv").string();
  const std::string twice = second + ":3: " + left + " is labelled in " + first + ":2 too and would count twice";
  for (const std::vector<std::string>& more : {std::vector<std::string>{}, {"--pairs"}}) {
    std::vector<std::string> arguments{"--recorded", first, second};
    arguments.insert(arguments.end(), more.begin(), more.end());
    STRCMP_CONTAINS(twice.c_str(), refused(arguments).c_str());
  }
  const Finished trade = test::run({kTool, "trade", "firmware", "--recordings", first, second});
  STRCMP_CONTAINS(twice.c_str(), trade.err.c_str());
  STRCMP_CONTAINS((first + ":2: " + left + " is labelled in " + first + ":2").c_str(),
                  refused({"--recorded", first, first}).c_str());
}

TEST(EvaluateRecorded, PairsRefuseAnIntervalBeyondTheEnd) {
  (void)test::write_clip(test::press_scene(0.4), dir / "gel__exp_num_1__camera_0");
  fs::copy(dir / "gel__exp_num_1__camera_0", dir / "gel__exp_num_1__camera_2");
  test::write_file(dir / "labels.csv", kHeader + std::string("gel__exp_num_1__camera_0,,,,,0,,0-10,high\n"
                                                             "gel__exp_num_1__camera_2,,,,,0,,20-30,high\n"));
  STRCMP_CONTAINS("labels.csv:3: interval 20-30 ends after the last frame 10",
                  refused({"--recorded", (dir / "labels.csv").string(), "--pairs"}).c_str());
}

TEST(EvaluateRecorded, AClipThatCannotBeReplayedIsSaid) {
  (void)test::write_clip(test::press_scene(0.4), dir / "gel__exp_num_1__camera_0");
  test::write_file(dir / "broken__exp_num_1__camera_0.avi", "no film");
  test::write_file(dir / "labels.csv", std::string(kHeader) +
                                           "gel__exp_num_1__camera_0,,,,,0,,0-10,high\n"
                                           "broken__exp_num_1__camera_0,0,9,5,9,1,,,high\n");
  const Finished run = test::run({kTool, "evaluate", "--recorded", (dir / "labels.csv").string()});
  LONGS_EQUAL(0, run.status);
  STRCMP_CONTAINS("not replayed: ", run.out.c_str());
  STRCMP_CONTAINS("missed onset 5: the clip was not replayed", run.out.c_str());
}

TEST(EvaluateRecorded, TheHelpNamesEveryColumn) {
  const Finished help = test::run({kTool, "evaluate", "--help"});
  for (const LabelColumn& column : kLabelColumns) STRCMP_CONTAINS(std::string(column.name).c_str(), help.out.c_str());
}

TEST(EvaluateRecorded, TheRealClipsAreAllReplayed) {
  const fs::path folder = test::clips_folder();
  if (folder.empty()) {
    test::skip("the real recordings are not beside the clone (../shared/data/real)");
    return;
  }
  const Finished run = test::run(
      {kTool, "evaluate", "--recorded", (folder / "labels.csv").string(), "--json", (dir / "out.json").string()});
  STRCMP_EQUAL("", run.err.c_str());
  const auto report = nlohmann::json::parse(test::read_file(dir / "out.json"));
  // Counted from labels.csv by another program (Python's csv): see recordings_test.cpp. One frame is 1/1500 min.
  DOUBLES_EQUAL(3904 / 1500.0, report["tables"]["silence"][0]["silent_min"].get<double>(), 1e-6);
  LONGS_EQUAL(12, report["tables"]["silence"][0]["onsets"].get<int>());
  for (const auto& clip : report["tables"]["clips"]) LONGS_EQUAL(450, clip["frames"].get<int>());
  const std::string name = "avocado_real__exp_num_6__camera_2";
  const auto at = std::ranges::find_if(report["tables"]["clips"], [&](const auto& row) { return row["clip"] == name; });
  const Finished replayed = test::run({kTool, "replay", (folder / (name + ".avi")).string(), "--grid", "auto",
                                       "--reference", (*at)["reference"].get<std::string>(), "--json"});
  const auto summary = nlohmann::json::parse(replayed.out);
  CHECK(summary["slip_frames"].get<std::vector<int>>() == evaluated_alarms(report, name));
}
