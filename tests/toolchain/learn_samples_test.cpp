// SPDX-License-Identifier: Apache-2.0
// Samples as CSV: what is written is read back, and no damaged file is learned from.
#include <sstream>
#include <string>
#include <vector>

#include "tests/support/cells.hpp"
#include "tests/support/learn_data.hpp"
#include "toolchain/learn/samples.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::learn;

namespace {

std::string written(const Samples& samples) {
  std::ostringstream out;
  write_csv(out, samples);
  return out.str();
}

std::string error_of(const std::string& text) {
  std::istringstream in(text);
  Samples samples;
  return read_csv(in, "data.csv", samples).value_or("");
}

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  return lines;
}

std::string joined(const std::vector<std::string>& parts, const char* between) {
  std::string text;
  for (const std::string& part : parts) text += (text.empty() ? "" : between) + part;
  return text;
}

// A good file of two trials, with one cell of one line (from 1) replaced.
std::string with_cell(std::size_t line, std::size_t column, const std::string& cell) {
  std::vector<std::string> lines = lines_of(written(test::grasps(2, 1)));
  std::vector<std::string> cells = test::cells_of(lines.at(line - 1));
  cells.at(column) = cell;
  lines[line - 1] = joined(cells, ",");
  return joined(lines, "\n") + "\n";
}

void check_error(const std::string& text, const std::string& where, const std::string& what) {
  const std::string error = error_of(text);
  for (const std::string& part :
       {"data.csv:" + where + ": ", what, std::string(". Likely cause: "), std::string(". Next: ")}) {
    STRCMP_CONTAINS(part.c_str(), error.c_str());
  }
  CHECK_TRUE(error.find('\n') == std::string::npos);
}

enum { kSource, kObject, kPrimitive, kKind, kSeed, kTrial, kFrame, kTime, kLabel, kFraction, kSlide, kAccepted, kX };

}  // namespace

TEST_GROUP(LearnSamples){};

TEST(LearnSamples, ReadsBackWhatItWrote) {
  Samples samples = test::grasps(7, 3);
  samples.trials[1].source = Source::kRecorded;
  samples.trials[1].primitive.clear();
  samples.trials[2].seed = UINT64_MAX;
  samples.rows[9].t_s = 0.359999;
  samples.rows[9].slip_fraction = 0.123456;
  samples.rows[9].slide_mm_s = -1.25e-7;
  for (std::size_t i = 0; i < kFeatures.size(); ++i) {
    samples.rows[10].x[i] = kFeatures[i].min;
    samples.rows[11].x[i] = kFeatures[i].max;
  }
  const std::string text = written(samples);
  std::istringstream in(text);
  Samples read;
  CHECK_FALSE(read_csv(in, "data.csv", read).has_value());
  LONGS_EQUAL(samples.trials.size(), read.trials.size());
  LONGS_EQUAL(samples.rows.size(), read.rows.size());
  for (std::size_t i = 0; i < samples.trials.size(); ++i) {
    const Trial& want = samples.trials[i];
    const Trial& have = read.trials[i];
    CHECK_TRUE(want.source == have.source && want.object == have.object && want.primitive == have.primitive &&
               want.kind == have.kind && want.seed == have.seed && want.first == have.first &&
               want.count == have.count);
  }
  for (std::size_t i = 0; i < samples.rows.size(); ++i) {
    const Row& want = samples.rows[i];
    const Row& have = read.rows[i];
    CHECK_TRUE(want.trial == have.trial && want.frame == have.frame && want.label == have.label &&
               want.accepted == have.accepted && want.x == have.x);
    DOUBLES_EQUAL(want.t_s, have.t_s, 1e-9);
    DOUBLES_EQUAL(want.slip_fraction, have.slip_fraction, 1e-9);
    DOUBLES_EQUAL(want.slide_mm_s, have.slide_mm_s, 1e-12);
  }
  CHECK_TRUE(written(read) == text);
}

TEST(LearnSamples, ColumnsAreTheTablesOwn) {
  std::string want = "source,object,primitive,kind,seed,trial,frame,t_s,label,slip_fraction,slide_mm_s,accepted";
  for (const FeatureInfo& info : kFeatures) want += "," + std::string(info.name);
  STRCMP_EQUAL(want.c_str(), lines_of(written({})).at(0).c_str());
}

TEST(LearnSamples, NamesCannotBreakTheTable) {
  Samples samples = test::grasps(1, 1);
  samples.trials[0].object = "a,\"b\"\nc";
  std::istringstream in(written(samples));
  Samples read;
  CHECK_FALSE(read_csv(in, "data.csv", read).has_value());
  STRCMP_EQUAL("a__b__c", read.trials[0].object.c_str());
}

// Pieces of one set, as shards write them, keep their numbers: gaps are no fault.
TEST(LearnSamples, TrialNumbersMayHaveGaps) {
  Samples samples = test::grasps(3, 1);
  samples.trials[1].count = 0;
  std::istringstream in(written(samples));
  Samples read;
  CHECK_FALSE(read_csv(in, "data.csv", read).has_value());
  LONGS_EQUAL(2, read.trials.size());
  LONGS_EQUAL(1, read.rows.back().trial);
}

TEST(LearnSamples, RefusesWhatIsNoTable) {
  check_error("", "1", "no rows");
  check_error(written({}), "1", "no rows");
  check_error("hello\n", "1", "'hello' where 'source' is due");
  check_error("source,object\n", "1", "'primitive', is missing");
  check_error(std::string(100'000, 'x') + "\n", "1", "...");
  std::string text = written(test::grasps(1, 1));
  std::string more_columns = text;
  more_columns.insert(more_columns.find('\n'), ",another");
  check_error(more_columns, "1", "columns where");
  std::string other_feature = text;
  other_feature.replace(other_feature.find(kFeatures[0].name), kFeatures[0].name.size(), "vz");
  check_error(other_feature, "1", "'vz' where '" + std::string(kFeatures[0].name) + "' is due");
  text.insert(text.find('\n'), "\r");
  check_error(text, "1", "carriage return");
}

TEST(LearnSamples, RefusesAFileThatWasCutOff) {
  const std::string text = written(test::grasps(1, 1));
  // Anywhere in the last line: even a shorter number would look like one.
  for (std::size_t cut = 1; cut < 20; ++cut) check_error(text.substr(0, text.size() - cut), "26", "does not end");
  std::istringstream bad(text);
  bad.setstate(std::ios::badbit);
  Samples samples;
  STRCMP_CONTAINS("cannot be read", read_csv(bad, "data.csv", samples).value_or("").c_str());
}

TEST(LearnSamples, RefusesDamagedCells) {
  struct Case {
    std::size_t column;
    const char* cell;
    const char* what;
  };
  const Case cases[] = {
      {kSource, "guessed", "simulated or recorded"},
      {kObject, "", "object '' is not a name"},
      {kKind, "", "kind '' is not a name"},
      {kSeed, "-1", "seed '-1' is not a number"},
      {kSeed, "18446744073709551616", "is not a number"},
      {kTrial, "x", "trial 'x' is not a number"},
      {kFrame, "-1", "frame '-1' is not a number"},
      {kFrame, "1.5", "frame '1.5' is not a number"},
      {kFrame, "", "frame '' is not a number"},
      {kTime, "nan", "t_s 'nan' is not a number"},
      {kTime, "inf", "t_s 'inf' is not a number"},
      {kTime, "-0.1", "t_s '-0.1' is not a number"},
      {kTime, "1e300", "t_s '1e300' is not a number"},
      {kLabel, "maybe", "label 'maybe' is not hold, slip, open or empty"},
      {kFraction, "1.01", "slip_fraction '1.01' is not a number"},
      {kSlide, "fast", "slide_mm_s 'fast' is not a number"},
      {kAccepted, "2", "accepted '2' is not a number"},
      {kX, "12a", "is not an integer"},
      {kX, "", "is not an integer"},
      {kX, "1.0", "is not an integer"},
      {kX, "99999999999", "is not an integer"},
      {kX, " 1", "is not an integer"},
  };
  for (const Case& c : cases) check_error(with_cell(2, c.column, c.cell), "2", c.what);
  check_error(with_cell(2, kX, "7"), "2", "not accepted");
}

TEST(LearnSamples, RefusesFeaturesOutOfRange) {
  for (std::size_t i = 0; i < kFeatures.size(); ++i) {
    const FeatureInfo& info = kFeatures[i];
    const std::string range = std::to_string(info.min) + ".." + std::to_string(info.max);
    check_error(with_cell(5, kX + i, std::to_string(std::int64_t{info.min} - 1)), "5", "outside of " + range);
    check_error(with_cell(5, kX + i, std::to_string(std::int64_t{info.max} + 1)), "5", "outside of " + range);
    STRCMP_EQUAL("", error_of(with_cell(5, kX + i, std::to_string(info.min))).c_str());
    STRCMP_EQUAL("", error_of(with_cell(5, kX + i, std::to_string(info.max))).c_str());
  }
}

TEST(LearnSamples, RefusesTrialsThatDoNotHangTogether) {
  check_error(with_cell(4, kFrame, "1"), "4", "frame 1 follows frame 1");
  check_error(with_cell(4, kTime, "0.03"), "4", "the time goes back from 0.04 to 0.03 s");
  check_error(with_cell(4, kTrial, "5"), "5", "trial 0 is there in two pieces");
  check_error(with_cell(4, kObject, "box"), "4", "object is 'box' and was 'ball' in the same trial 0");
  check_error(with_cell(4, kSeed, "77"), "4", "seed is '77'");
  std::vector<std::string> lines = lines_of(written(test::grasps(2, 1)));
  lines[3] += ",1";
  check_error(joined(lines, "\n") + "\n", "4", "cells where");
  lines[3] = "";
  check_error(joined(lines, "\n") + "\n", "4", "1 cells where");
}

// One byte changed anywhere: read or refused, but never a value that the firmware cannot produce.
TEST(LearnSamples, AnyChangedByteIsReadOrRefused) {
  const std::string good = written(test::grasps(2, 1));
  std::mt19937_64 random(5);
  for (int n = 0; n < 3000; ++n) {
    std::string text = good;
    text[random() % text.size()] = static_cast<char>(random() % 256);
    std::istringstream in(text);
    Samples samples;
    if (read_csv(in, "data.csv", samples)) continue;
    for (const Row& row : samples.rows) {
      for (std::size_t i = 0; i < kFeatures.size(); ++i) {
        CHECK_TRUE(!row.accepted || (row.x[i] >= kFeatures[i].min && row.x[i] <= kFeatures[i].max));
      }
      CHECK_TRUE(row.t_s >= 0.0 && row.t_s <= 1e6);
    }
  }
}
