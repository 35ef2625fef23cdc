// SPDX-License-Identifier: Apache-2.0
// holdfast train, through its command function: a model that the firmware takes, or one clear line and no file.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "base/crc32.hpp"
#include "slip/model.hpp"
#include "tests/support/learn_data.hpp"
#include "tests/support/temp_dir.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/learn/samples.hpp"
#include "toolchain/treec/tree_model.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;

namespace {

// What goes to a stream of this process meanwhile goes to a file.
class Capture {
 public:
  Capture(std::FILE* stream, const std::filesystem::path& path) : stream_(stream), path_(path) {
    std::fflush(stream_);
    kept_ = ::dup(::fileno(stream_));
    std::FILE* const file = std::fopen(path.c_str(), "w");
    ::dup2(::fileno(file), ::fileno(stream_));
    std::fclose(file);
  }
  ~Capture() { (void)end(); }
  Capture(const Capture&) = delete;
  Capture& operator=(const Capture&) = delete;

  std::string end() {
    if (kept_ >= 0) {
      std::fflush(stream_);
      ::dup2(kept_, ::fileno(stream_));
      ::close(kept_);
      kept_ = -1;
    }
    return test::read_file(path_);
  }

 private:
  std::FILE* stream_;
  std::filesystem::path path_;
  int kept_ = -1;
};

struct Outcome {
  int status = -1;
  std::string out;
  std::string err;
};

learn::Samples only(learn::Label label) {
  learn::Samples samples = test::grasps(20, 1);
  for (learn::Row& row : samples.rows) {
    if (learn::judged(row) && row.label != label) row.label = learn::Label::kOpen;
  }
  return samples;
}

}  // namespace

TEST_GROUP(Train) {
  test::TempDir dir;

  std::string write(const std::string& name, const learn::Samples& samples) {
    std::ofstream out(dir / name, std::ios::binary);
    learn::write_csv(out, samples);
    return (dir / name).string();
  }

  std::string at(const std::string& name) const {
    return (dir / name).string();
  }

  Outcome train(std::vector<std::string> arguments) const {
    CLI::App app;
    std::vector<tool::Command> commands;
    tool::add_train(app, commands);
    arguments.insert(arguments.begin(), "train");
    std::reverse(arguments.begin(), arguments.end());  // as CLI11 takes them
    Outcome outcome;
    try {
      app.parse(arguments);
    } catch (const CLI::ParseError& error) {
      outcome.status = 2;
      outcome.err = error.what();
      return outcome;
    }
    Capture out(stdout, dir / "stdout");
    Capture err(stderr, dir / "stderr");
    outcome.status = commands.at(0).run();
    outcome.out = out.end();
    outcome.err = err.end();
    return outcome;
  }

  // Fails with one line that says `what`, and leaves no model.
  void check_fails(const std::vector<std::string>& arguments, const std::string& what) {
    const Outcome outcome = train(arguments);
    CHECK_TRUE(outcome.status != 0);
    STRCMP_CONTAINS(what.c_str(), outcome.err.c_str());
    if (outcome.status == 1) {
      LONGS_EQUAL(1, std::count(outcome.err.begin(), outcome.err.end(), '\n'));
      STRCMP_EQUAL("", outcome.out.c_str());
    }
    for (const auto& entry : std::filesystem::directory_iterator(dir.path())) {
      CHECK_TRUE(entry.path().string().find(".tree") == std::string::npos);
    }
  }
};

TEST(Train, WritesAModelWithItsOrigin) {
  const std::string data = write("grasps.csv", test::grasps(40, 1));
  const std::string more = write("more.csv", test::grasps(20, 500));
  const std::vector<std::string> arguments{data,         more, "--set",   "paper",
                                           "--min-leaf", "10", "--model", at("slip_v9.tree")};
  const Outcome outcome = train(arguments);
  STRCMP_EQUAL("", outcome.err.c_str());
  LONGS_EQUAL(0, outcome.status);
  const std::string text = test::read_file(dir / "slip_v9.tree");
  treec::Model model;
  CHECK_FALSE(treec::parse(text, model).has_value());
  CHECK_FALSE(treec::check(model).has_value());
  STRCMP_EQUAL("slip_v9", model.name.c_str());
  STRCMP_EQUAL("paper", model.feature_set.c_str());

  // 20 and 10 trials of 25 rows, as many of 37; the first three and the last two of each are open.
  const std::string bytes = test::read_file(data);
  char crc[9];
  std::snprintf(crc, sizeof crc, "%08X", crc32({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()}));
  const std::string origin =
      "grasps.csv: 1240 rows of 40 trials, 1040 of them judged, 240 slip; CRC-32 " + std::string(crc);
  for (const std::string& part : {origin, std::string("more.csv: 620 rows of 20 trials, 520 of them judged, 120 slip"),
                                  std::string("Feature set paper; tree: depth 8, min_leaf 10, prune 0"),
                                  std::string("balanced accuracy"), std::string("precision"), std::string("recall"),
                                  std::string("F1"), std::string("30 onsets: "), std::string("per hour")}) {
    STRCMP_CONTAINS(part.c_str(), text.c_str());
  }
  // Nothing of this machine or this day; the same again.
  CHECK_TRUE(text.find(dir.path().string()) == std::string::npos);
  LONGS_EQUAL(0, train(arguments).status);
  CHECK_TRUE(test::read_file(dir / "slip_v9.tree") == text);

  // Two deviations in each of four features: most rows of the fitted trials must come out right.
  const learn::Samples samples = test::grasps(40, 1);
  const FeatureSet& set = *find_feature_set("paper");
  const learn::Matrix rows = learn::matrix_of(samples, set, test::all_trials(samples));
  const model::Tree table = treec::to_table(model);
  int right = 0;
  for (int i = 0; i < rows.height(); ++i) {
    right += (model::evaluate(table, rows.at(i)) == Verdict::kSlip) == (rows.slip[idx(i)] != 0) ? 1 : 0;
  }
  CHECK_TRUE(right > rows.height() * 9 / 10);
}

TEST(Train, TellsPrograms) {
  const std::string data = write("grasps.csv", test::grasps(40, 1, 2.7));
  const Outcome outcome = train({data, "--set", "paper", "--folds", "4", "--json", "--seed", "3"});
  STRCMP_EQUAL("", outcome.err.c_str());
  const nlohmann::json out = nlohmann::json::parse(outcome.out);
  LONGS_EQUAL(4, out["folds"].get<int>());
  CHECK_TRUE(out["balanced_accuracy"]["mean"].get<double>() > 0.9);
  CHECK_TRUE(out["balanced_accuracy"]["half"].get<double>() > 0.0);
  LONGS_EQUAL(20, out["onsets"].get<int>());
  CHECK_TRUE(out["within_2"].get<int>() <= out["within_5"].get<int>());
  CHECK_TRUE(out["within_5"].get<int>() >= 15);
  // 800 hold rows of 40 ms.
  DOUBLES_EQUAL(32.0, out["held_s"].get<double>(), 1e-6);
  LONGS_EQUAL(1040, out["data"][0]["judged"].get<int>());
  CHECK_FALSE(out.contains("model"));
}

TEST(Train, RefusesDamagedData) {
  std::string text = test::read_file(write("good.csv", test::grasps(20, 1)));
  const auto refuses = [&](const std::string& bytes, const std::string& what) {
    test::write_file(dir / "bad.csv", bytes);
    check_fails({at("bad.csv"), "--set", "paper", "--model", at("m.tree")}, what);
    check_fails({at("good.csv"), at("bad.csv"), "--set", "paper", "--model", at("m.tree")}, what);
  };
  refuses("", "bad.csv:1: there are no rows");
  refuses(text.substr(0, text.size() / 2), "bad.csv:");
  refuses("x" + text, "'xsource' where 'source' is due");
  std::string out_of_range = text;
  out_of_range.insert(out_of_range.size() - 1, "99999999");
  refuses(out_of_range, "bad.csv:621: ");
  check_fails({at("none.csv"), "--set", "paper", "--model", at("m.tree")}, "none.csv: cannot be read");
  check_fails({dir.path().string(), "--set", "paper", "--model", at("m.tree")},
              "is not a regular file. Likely cause: a folder,");
}

TEST(Train, RefusesOneClass) {
  const std::string hold = write("hold.csv", only(learn::Label::kHold));
  const std::string slip = write("slip.csv", only(learn::Label::kSlip));
  const std::string open = write("open.csv", only(learn::Label::kOpen));
  check_fails({hold, "--set", "paper", "--model", at("m.tree")}, "hold.csv: no slip rows to learn from");
  check_fails({slip, "--set", "paper", "--model", at("m.tree")}, "slip.csv: no hold rows to learn from");
  check_fails({open, "--set", "paper", "--model", at("m.tree")}, "open.csv: no rows to learn from");
  check_fails({open, hold, "--set", "paper", "--model", at("m.tree")}, "open.csv and 1 more: no slip rows");
}

TEST(Train, RefusesEmptyFolds) {
  const std::string data = write("grasps.csv", test::grasps(8, 1));
  check_fails({data, "--set", "paper", "--folds", "9", "--model", at("m.tree")}, "has no slip rows to be judged by");
  check_fails({data, "--set", "paper", "--folds", "5", "--model", at("m.tree")}, "has no slip rows to be judged by");
  learn::Samples three = test::grasps(6, 1);  // the three that slip hold first
  for (learn::Row& row : three.rows) row.label = row.trial % 2 == 0 ? learn::Label::kOpen : row.label;
  const std::string few = write("three.csv", three);
  check_fails({few, "--set", "paper", "--folds", "5", "--model", at("m.tree")},
              "fold 4 of 5 has no rows to be judged by");
  learn::Samples one_slips = test::grasps(4, 1);
  for (learn::Row& row : one_slips.rows) {
    if (row.trial == 3 && row.label == learn::Label::kSlip) row.label = learn::Label::kOpen;
  }
  check_fails({write("one.csv", one_slips), "--set", "paper", "--folds", "2", "--model", at("m.tree")}, "no slip rows");
}

TEST(Train, RefusesAModelThatSaysOneThing) {
  // Features that tell nothing, and leaves too large to tell any two rows apart.
  const std::string data = write("noise.csv", test::grasps(20, 1, 0.0));
  check_fails({data, "--set", "paper", "--min-leaf", "1000", "--model", at("m.tree")}, "says the same of every row");
  check_fails({data, "--set", "paper", "--prune", "1", "--model", at("m.tree")}, "says the same of every row");
}

TEST(Train, RefusesAModelThatIsTooLarge) {
  const std::string data = write("noise.csv", test::grasps(2500, 1, 0.0));
  check_fails({data, "--set", "paper", "--folds", "2", "--min-leaf", "1", "--depth", "16", "--model", at("m.tree")},
              "no model was written: the tree has more than");
}

TEST(Train, RefusesPlacesThatCannotBeWritten) {
  const std::string data = write("grasps.csv", test::grasps(20, 1));
  check_fails({data, "--set", "paper", "--model", at("none/m.tree")}, "cannot be written");
  check_fails({data, "--set", "paper", "--name", "m", "--model", dir.path().string()}, "it is a folder");
  const std::string bytes = test::read_file(data);
  check_fails({data, "--set", "paper", "--model", data}, "--model would change the data");
  CHECK_TRUE(test::read_file(data) == bytes);
  check_fails({data, "--set", "paper", "--model", at("No Name.tree")}, "not a model name");
  check_fails({data, "--set", "paper", "--model", at("m.tree"), "--name", "a#b"}, "not a model name");
}

TEST(Train, KeepsTheModelThatWasThere) {
  const std::string hold = write("hold.csv", only(learn::Label::kHold));
  test::write_file(dir / "kept.model", "the one before");
  CHECK_EQUAL(1, train({hold, "--set", "paper", "--model", at("kept.model")}).status);
  STRCMP_EQUAL("the one before", test::read_file(dir / "kept.model").c_str());
}

TEST(Train, RefusesWhatMakesNoSense) {
  const std::string data = write("grasps.csv", test::grasps(20, 1));
  write("copy.csv", test::grasps(20, 1));
  check_fails({data, at("copy.csv"), "--set", "paper"}, "copy.csv: holds the same bytes as grasps.csv");
  check_fails({data, "--set", "papers"}, "no such set");
  check_fails({data, "--set", "paper", "--depth", "25"}, "25");
  check_fails({data, "--set", "paper", "--prune", "nan"}, "nan");
  check_fails({data, "--set", "paper", "--slip-weight", "0"}, "0");
  check_fails({data, "--set", "paper", "--folds", "1"}, "1");
  check_fails({data, "--set", "paper", "--name", "a"}, "--model");
  check_fails({"--set", "paper"}, "DATA");
}
