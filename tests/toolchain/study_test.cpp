// SPDX-License-Identifier: Apache-2.0
// The study: entropies against closed forms and against the firmware's own, the tree's events against counting by hand.
#include "toolchain/learn/study.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>
#include <string>
#include <tuple>
#include <vector>

#include "base/math.hpp"
#include "tests/support/host_process.hpp"
#include "tests/support/temp_dir.hpp"
#include "toolchain/learn/calibrate.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;
using learn::Bins;
using learn::EntropyForm;
using learn::Label;
using learn::Row;
using test::Finished;
using test::TempDir;

constexpr const char* kTool = HOLDFAST_BIN_DIR "/holdfast";
// Of doubles near 3, after a few additions.
constexpr double kRounding = 1e-12;

// Markers displaced by these lengths, in turns along x and along y.
DisplacementField field_of(const std::vector<int>& lengths_um) {
  DisplacementField field;
  field.grid = {7, 9};
  for (std::size_t i = 0; i < lengths_um.size(); ++i) {
    const Micrometres length = Micrometres::from_raw(lengths_um[i]);
    const Micrometres none = Micrometres::from_raw(0);
    field.markers[i] = i % 2 == 0 ? MarkerDisplacement{length, none, true} : MarkerDisplacement{none, length, true};
  }
  return field;
}

std::vector<int> times(int count, int length_um) {
  std::vector<int> all;
  all.assign(static_cast<std::size_t>(count), length_um);
  return all;
}

learn::Planned grasp(std::string_view object, std::string_view primitive, scene::GraspKind kind, std::uint64_t seed) {
  learn::PlannedGrasp out;
  out.object = std::ranges::find(scene::kPaperObjects, object, &scene::PaperObject::name);
  out.primitive = std::ranges::find(scene::kPrimitives, primitive, &scene::Primitive::name);
  out.kind = kind;
  out.seed = seed;
  return out.make();
}

// Of two round objects, which are cheap: each slips once and holds once.
const learn::EntropyRows& short_rows() {
  static const learn::EntropyRows rows = [] {
    learn::EntropyRows all;
    for (const std::string_view object : {"ball", "mouse"}) {
      learn::play_entropies(all, grasp(object, "translate_x", scene::GraspKind::kSlip, 3), Params{});
      learn::play_entropies(all, grasp(object, "translate_y", scene::GraspKind::kStatic, 4), Params{});
    }
    return all;
  }();
  return rows;
}

bool in_contact(const Row& row) {
  return row.label == Label::kHold || row.label == Label::kSlip;
}

std::size_t index_of(const EntropyForm& form) {
  const auto& forms = learn::entropy_forms();
  const auto* const at = std::ranges::find(forms, form);
  CHECK(at != forms.end());
  return static_cast<std::size_t>(at - forms.begin());
}

}  // namespace

TEST_GROUP(Study){};

TEST(Study, OneBinHasNoEntropy) {
  for (const EntropyForm& form : learn::entropy_forms()) {
    DOUBLES_EQUAL(0.0, learn::entropy_nat(form, field_of({})), 0.0);
    DOUBLES_EQUAL(0.0, learn::entropy_nat(form, field_of(times(63, 0))), kRounding);
    if (form.bins != Bins::kSoft) DOUBLES_EQUAL(0.0, learn::entropy_nat(form, field_of(times(63, 137))), kRounding);
    // Beyond every range: the last bin alone.
    DOUBLES_EQUAL(0.0, learn::entropy_nat(form, field_of(times(63, 9000))), kRounding);
  }
}

TEST(Study, EvenOverKBinsIsLnK) {
  for (const EntropyForm& form : learn::entropy_forms()) {
    if (form.bins == Bins::kOctaves) continue;
    // At each bin's centre, where hard and soft agree; twice 30 bins fit in 63 markers.
    for (const int used : {2, 7, form.count}) {
      std::vector<int> lengths;
      for (int bin = 0; bin < used; ++bin) {
        const double centre_um = (bin + 0.5) * form.range_um / form.count;
        lengths.insert(lengths.end(), 2, static_cast<int>(std::lround(centre_um)));
      }
      // Centres are rounded to 1 um: of a soft bin of 250 / 15 um that moves 6 % at most.
      const double tolerance = form.bins == Bins::kSoft ? 0.06 : kRounding;
      DOUBLES_EQUAL(std::log(used), learn::entropy_nat(form, field_of(lengths)), tolerance);
    }
  }
  std::vector<int> octaves{7};
  for (int k = 0; k < 14; ++k) octaves.push_back(static_cast<int>(std::ceil(8.0 * std::pow(2.0, k / 2.0))));
  DOUBLES_EQUAL(std::log(15.0), learn::entropy_nat({Bins::kOctaves, 0, 15}, field_of(octaves)), kRounding);
}

TEST(Study, ALengthOnAnEdgeBelongsAboveIt) {
  const EntropyForm hard{Bins::kHard, 3000, 15};  // edges at multiples of 200 um
  DOUBLES_EQUAL(0.0, learn::entropy_nat(hard, field_of({200, 399})), kRounding);
  DOUBLES_EQUAL(std::log(2.0), learn::entropy_nat(hard, field_of({199, 200})), kRounding);
}

TEST(Study, SoftBinsSplitAMarkerByItsPlace) {
  const EntropyForm soft{Bins::kSoft, 3000, 15};  // centres at 100, 300, ... 2900 um
  DOUBLES_EQUAL(std::log(2.0), learn::entropy_nat(soft, field_of({200})), kRounding);
  const double quarter = -(0.25 * std::log(0.25) + 0.75 * std::log(0.75));
  DOUBLES_EQUAL(quarter, learn::entropy_nat(soft, field_of({150})), kRounding);
  DOUBLES_EQUAL(quarter, learn::entropy_nat(soft, field_of({1850})), kRounding);
  // 200 um: halves of bins 0 and 1; 400 um: of bins 1 and 2. Shares 1/4, 1/2, 1/4.
  DOUBLES_EQUAL(1.5 * std::log(2.0), learn::entropy_nat(soft, field_of({200, 400})), kRounding);
  // Outside of the outer centres nothing is split.
  DOUBLES_EQUAL(0.0, learn::entropy_nat(soft, field_of({60})), kRounding);
  DOUBLES_EQUAL(0.0, learn::entropy_nat(soft, field_of({2901, 2950, 8000})), kRounding);
}

TEST(Study, LostMarkersDoNotCount) {
  DisplacementField field = field_of({10, 10, 10, 1000});
  CHECK(learn::entropy_nat(learn::kPaperForm, field) > 0.5);
  field.markers[3].valid = false;
  DOUBLES_EQUAL(0.0, learn::entropy_nat(learn::kPaperForm, field), kRounding);
}

TEST(Study, ThePapersFormAndTheOctavesAreTheFirmwaresOwn) {
  const learn::EntropyRows& rows = short_rows();
  const std::size_t paper = index_of(learn::kPaperForm);
  const std::size_t octaves = index_of({Bins::kOctaves, 0, 15});
  LONGS_EQUAL(rows.samples.rows.size(), rows.frames.size());
  const auto column = [](std::string_view name) {
    return static_cast<std::size_t>(std::ranges::find(kFeatures, name, &FeatureInfo::name) - kFeatures.begin());
  };
  std::set<std::int32_t> levels;
  int rates = 0;
  for (std::size_t i = 0; i < rows.frames.size(); ++i) {
    const Row& row = rows.samples.rows[i];
    if (!row.accepted) continue;
    const learn::EntropyFrame& frame = rows.frames[i];
    // The firmware's table in Q24 errs by up to 1.1 LSB of Q24, 0.004 of Q16, before both round to Q16: so the values
    // within half an LSB of Q16, and the rounded ones equal unless they straddle a rounding's edge.
    LONGS_EQUAL(row.x[column("entropy_nat_q16")], frame.of[paper].nat_q16);
    LONGS_EQUAL(row.x[column("octave_entropy_nat_q16")], frame.of[octaves].nat_q16);
    LONGS_EQUAL(row.x[column("entropy_rate_nat_s_q8")], frame.of[paper].nat_s_q8);
    levels.insert(frame.of[paper].nat_q16);
    rates += frame.of[paper].nat_s_q8 != 0 ? 1 : 0;
  }
  CHECK(levels.size() > 20);  // equal, but not idle
  CHECK(rates > 20);
}

TEST(Study, CalmIsWhereNothingTrulyMoves) {
  const learn::EntropyRows& rows = short_rows();
  int empty = 0;
  int held = 0;
  for (std::size_t i = 0; i < rows.frames.size(); ++i) {
    const Row& row = rows.samples.rows[i];
    if (rows.frames[i].calm == learn::Calm::kEmpty) {
      CHECK(!in_contact(row));
      ++empty;
    }
    if (rows.frames[i].calm == learn::Calm::kTouched && row.label == Label::kHold) ++held;
  }
  CHECK(empty > 40);  // each trial is empty for half a second before it touches
  CHECK(held > 0);
}

TEST(Study, ScoresEveryForm) {
  std::vector<learn::EntropyScore> scores;
  int done = 0;
  const auto error = learn::score_entropies(
      short_rows(), 1,
      [&](int forms) {
        done = forms;
        return true;
      },
      scores);
  // Five folds of four trials: one fold is empty, and is no error.
  STRCMP_EQUAL("", error.value_or("").c_str());
  LONGS_EQUAL(learn::kEntropyForms, done);
  LONGS_EQUAL(learn::kEntropyForms, scores.size());
  const long judged = std::ranges::count_if(short_rows().samples.rows, learn::judged);
  for (std::size_t i = 0; i < scores.size(); ++i) {
    const learn::EntropyScore& s = scores[i];
    CHECK(s.form == learn::entropy_forms()[i]);
    LONGS_EQUAL(judged, s.five_fold.count());
    LONGS_EQUAL(judged, s.left_out.count());
    LONGS_EQUAL(2, s.objects.size());
    CHECK(s.level.balanced_accuracy >= 0.5);
    // Coarse bins are blind more often than fine ones of the same range.
    if (i < 5) CHECK(s.blind_hold >= scores[i + 10].blind_hold);
  }
  const std::string note = learn::entropy_note(scores);
  STRCMP_CONTAINS("entropy_nat in every output stays the paper's, 15 hard, 1.9 mm", note.c_str());
  LONGS_EQUAL(learn::kEntropyForms, learn::entropy_table(scores).rows.size());
  const std::string chart = learn::entropy_chart(scores);
  STRCMP_CONTAINS("half octaves", chart.c_str());
}

TEST(Study, StopsWhenAsked) {
  std::vector<learn::EntropyScore> scores;
  const auto error = learn::score_entropies(
      short_rows(), 1, [](int) { return false; }, scores);
  STRCMP_EQUAL("stopped", error.value_or("").c_str());
}

TEST(Study, OneObjectAloneCannotBeLeftOut) {
  learn::EntropyRows one;
  learn::play_entropies(one, grasp("ball", "translate_x", scene::GraspKind::kSlip, 3), Params{});
  learn::play_entropies(one, grasp("ball", "translate_y", scene::GraspKind::kStatic, 4), Params{});
  std::vector<learn::EntropyScore> scores;
  const auto error = learn::score_entropies(
      one, 1, [](int) { return true; }, scores);
  STRCMP_CONTAINS("cannot be left out", error.value_or("").c_str());
}

TEST(Study, ThinningKeepsKindsObjectsAndPrimitivesMixed) {
  learn::Plan plan;
  STRCMP_EQUAL("", learn::make_plan({}, plan).value_or("").c_str());
  const auto some = learn::thinned(plan, 5);
  LONGS_EQUAL(plan.grasps.size() / 5, some.size());
  for (const auto& kind : scene::kGraspKinds) {
    std::set<std::string_view> objects, primitives;
    for (const learn::PlannedGrasp& g : some) {
      if (&scene::info(g.kind) != &kind) continue;
      objects.insert(g.object->name);
      primitives.insert(g.primitive->name);
    }
    LONGS_EQUAL(10, objects.size());
    LONGS_EQUAL(12, primitives.size());
  }
  LONGS_EQUAL(plan.grasps.size(), learn::thinned(plan, 1).size());
}

TEST(Study, JudgesByTheTreesOwnFeatures) {
  // Slip from E above a threshold on: by hand, as text a model and as counts.
  treec::Model parsed;
  const auto problem = treec::parse(
      "format 1\nname t\nfeature_set entropy\nfeature entropy_nat_q16 nat Q16\nfeature entropy_rate_nat_s_q8 nat/s Q8\n"
      "node 0: entropy_nat_q16 <= 50000 ? 1 : 2\nleaf 1: hold\nleaf 2: slip\n",
      parsed);
  CHECK(!problem && !treec::check(parsed));
  const model::Tree tree = treec::to_table(parsed);
  const learn::Samples& samples = short_rows().samples;
  learn::ConditionScore score;
  learn::judge(samples, tree, {.raise_frames = 1, .hold = Micros{0}}, score);
  const std::size_t level = 2;  // of kFeatures: entropy_nat_q16
  STRCMP_EQUAL("entropy_nat_q16", std::string(kFeatures[level].name).c_str());
  learn::Confusion frames;
  int onsets = 0;
  int in_200_ms = 0;
  for (const learn::Trial& trial : samples.trials) {
    std::optional<double> onset;
    std::optional<double> seen;
    bool up = false;
    bool before = false;
    for (const Row& row : samples.of(trial)) {
      const bool slip = row.x[level] > 50000;
      if (learn::judged(row)) frames.add(row.label == Label::kSlip, slip);
      if (row.label == Label::kSlip && !onset) {
        onset = row.t_s;
        before = up;
      }
      up = slip;
      if (onset && slip && !seen) seen = row.t_s;
    }
    if (!onset) continue;
    ++onsets;
    if (seen && !before && *seen - *onset < 0.2001) ++in_200_ms;
  }
  LONGS_EQUAL(frames.true_slip, score.frames.true_slip);
  LONGS_EQUAL(frames.false_slip, score.frames.false_slip);
  LONGS_EQUAL(frames.count(), score.frames.count());
  LONGS_EQUAL(2, onsets);
  LONGS_EQUAL(onsets, score.events.onsets);
  DOUBLES_EQUAL(in_200_ms / 2.0, score.within_ms(200.0), 0.0);
  LONGS_EQUAL(0, score.refused);
}

TEST(Study, FramesThatTheFirmwareRefusesAreCountedApart) {
  learn::Samples samples;
  learn::Variation variation;
  variation.marker_loss = 0.5;  // far above what it lets pass
  learn::play_into(samples, grasp("ball", "translate_x", scene::GraspKind::kSlip, 3), Params{}, variation);
  treec::Model compiled;
  CHECK(!treec::parse(learn::compiled_model_text(), compiled));
  learn::ConditionScore score;
  learn::judge(samples, treec::to_table(compiled), {}, score);
  const long contact = std::ranges::count_if(samples.rows, in_contact);
  CHECK(score.refused > contact / 2);
  LONGS_EQUAL(contact, score.refused + score.frames.count());
}

TEST(Study, EveryConditionChangesOneThing) {
  const auto conditions = learn::conditions();
  CHECK(!conditions.front().value);
  for (const learn::Condition& c : conditions) {
    const learn::Variation& v = c.variation;
    const int set =
        (v.fps ? 1 : 0) + (v.marker_noise_um ? 1 : 0) + (v.marker_loss ? 1 : 0) + (v.shear_modulus_mpa ? 1 : 0);
    LONGS_EQUAL(c.value ? 1 : 0, set);
  }
}

TEST(Study, TheCommandRefusesInOneLineAndWritesNothing) {
  const TempDir dir;
  const std::string out = dir / "study";
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases = {
      {{"--objects", "ball"}, "one object alone"},
      {{"--objects", "ball,brick"}, "--objects 'brick': not in this set"},
      {{"--model", dir / "none.tree"}, "cannot be read as a model"},
      {{"--every", "0"}, "--every"},
      {{"--repeats", "0"}, "--repeats"},
  };
  for (const auto& [more, said] : cases) {
    std::vector<std::string> command{kTool, "study", "--out", out};
    command.insert(command.end(), more.begin(), more.end());
    const Finished finished = test::run(command);
    LONGS_EQUAL_TEXT(1, finished.status, said.c_str());
    STRCMP_CONTAINS(said.c_str(), finished.err.c_str());
    STRCMP_CONTAINS("Likely cause: ", finished.err.c_str());
    LONGS_EQUAL(1, std::ranges::count(finished.err, '\n'));
    CHECK(!std::filesystem::exists(out));
  }
  const Finished nowhere = test::run({kTool, "study", "--out", dir / "no/where"});
  LONGS_EQUAL(1, nowhere.status);
  STRCMP_CONTAINS("the folder above it is not there", nowhere.err.c_str());
}
