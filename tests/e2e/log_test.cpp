// SPDX-License-Identifier: Apache-2.0
// Logs that `holdfast` writes and reads, as a user meets them. The oracles are the tables that it wrote before there
// were logs, the pictures that went in, and a reader of CSV that takes nothing but numbers.
#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "base/status.hpp"
#include "tests/fuzz/mcap_check.hpp"
#include "tests/support/cells.hpp"
#include "tests/support/folders.hpp"
#include "tests/support/host_process.hpp"
#include "tests/support/mjpg_file.hpp"
#include "tests/support/temp_dir.hpp"
#include "toolchain/log/frame_reader.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;
using holdfast::test::kFilm;
using holdfast::test::kTool;
namespace fs = std::filesystem;
using test::cells_of;
using test::Finished;
using test::read_file;
using test::TempDir;
using test::write_file;

using Words = std::vector<std::string>;

const std::string kScenes = holdfast::test::source("tests/scenes/");

std::vector<Words> table_of(const fs::path& path) {
  const std::string text = read_file(path);
  CHECK_TEXT(text.ends_with('\n'), path.c_str());
  std::vector<Words> rows;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = text.find('\n', at);
    rows.push_back(cells_of(text.substr(at, end - at)));
    at = end + 1;
  }
  return rows;
}

// By column name; fails unless each cell is a number, each row as long as the header, and time runs.
std::vector<std::map<std::string, double>> strict_table(const fs::path& path) {
  const std::vector<Words> rows = table_of(path);
  const Words& names = rows.front();
  STRCMP_EQUAL("t_s", names.front().c_str());
  LONGS_EQUAL(names.size(), std::set<std::string>(names.begin(), names.end()).size());
  std::vector<std::map<std::string, double>> out;
  for (std::size_t i = 1; i < rows.size(); ++i) {
    LONGS_EQUAL(names.size(), rows[i].size());
    std::map<std::string, double> row;
    for (std::size_t k = 0; k < names.size(); ++k) {
      const std::string& cell = rows[i][k];
      double value = 0;
      const auto [end, error] =
          std::from_chars(cell.data(), cell.data() + cell.size(), value, std::chars_format::fixed);
      CHECK_TEXT(error == std::errc{} && end == cell.data() + cell.size() && std::isfinite(value), cell.c_str());
      row[names[k]] = value;
    }
    CHECK_TEXT(out.empty() || row["t_s"] > out.back()["t_s"], "time stands still");
    out.push_back(row);
  }
  return out;
}

double state_number(const std::string& name) {
  const auto* const found = std::ranges::find(kStates, name, [](const StateInfo& s) { return std::string(s.name); });
  return found == kStates.end() ? -1 : static_cast<double>(found->state);
}
double reason_number(const std::string& name) {
  const auto* const found = std::ranges::find(kReasons, name, [](const ReasonInfo& r) { return std::string(r.name); });
  return found == kReasons.end() ? -1 : static_cast<double>(found->reason);
}

// What the table of --log says against the table of --features of the same run.
void check_against_features(const fs::path& log, const fs::path& features) {
  const auto rows = strict_table(log);
  const auto told = table_of(features);
  LONGS_EQUAL(told.size() - 1, rows.size());
  double alive = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    auto row = rows[i];
    const Words& f = told[i + 1];
    const auto same = [&](const char* column, const std::string& cell, double tolerance) {
      DOUBLES_EQUAL_TEXT(cell.empty() ? 0 : std::stod(cell), row[column], tolerance, column);
    };
    same("frame", f[0], 0);
    same("t_s", f[1], 0);
    DOUBLES_EQUAL(state_number(f[2]), row["state"], 0);
    DOUBLES_EQUAL(reason_number(f[3]), row["reason"], 0);
    LONGS_EQUAL(!f[7].empty(), row["features_valid"]);
    if (row["features_valid"] != 0) same("markers", f[4], 0);
    same("vx_mm_s", f[5], 5e-4);
    same("vy_mm_s", f[6], 5e-4);
    same("entropy_nat", f[7], 0);
    same("entropy_rate_nat_s", f[8], 0);
    same("slip", f[9], 0);
    same("grip_ok", f[10], 0);
    CHECK_EQUAL(row["accepted"] != 0, row["alive"] != alive);  // ALIVE toggles once per accepted frame
    alive = row["alive"];
    double counted = 0;
    for (int bin = 0; bin < 15; ++bin) counted += row[(bin < 10 ? "histogram_0" : "histogram_") + std::to_string(bin)];
    DOUBLES_EQUAL(row["markers"], counted, 0);
  }
}

std::span<const std::uint8_t> bytes_of(const std::string& text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

// The film with one picture whose payload was lost on the way.
std::string damaged_film(std::size_t which) {
  std::string out;
  const std::vector<test::Jpeg> film = test::read_mjpg(kFilm);
  for (std::size_t i = 0; i < film.size(); ++i) {
    std::string picture(film[i].begin(), film[i].end());
    if (i == which) picture.replace(picture.size() / 2, 600, 600, '\x55');
    out += picture;
  }
  return out;
}

}  // namespace

// clang-format off
TEST_GROUP(LogFiles) {
  TempDir dir;
  // clang-format on

  [[nodiscard]] std::string in(std::string_view name) const {
    return (dir / name).string();
  }

  Finished ask(const Words& arguments) {
    Words command{kTool};
    command.insert(command.end(), arguments.begin(), arguments.end());
    return test::run(command);
  }

  Finished succeed(const Words& arguments) {
    Finished done = ask(arguments);
    LONGS_EQUAL_TEXT(0, done.status, (arguments.front() + ": " + done.err).c_str());
    return done;
  }

  // One line that says what, why and what next; no file made or changed.
  void refuse(const Words& arguments, const char* said) {
    std::map<std::string, std::string> before, after;
    for (const auto& entry : fs::directory_iterator(dir.path())) before[entry.path()] = read_file(entry.path());
    const Finished done = ask(arguments);
    for (const auto& entry : fs::directory_iterator(dir.path())) after[entry.path()] = read_file(entry.path());
    CHECK_TEXT(before == after, said);
    LONGS_EQUAL_TEXT(1, done.status, said);
    LONGS_EQUAL_TEXT(1, std::count(done.err.begin(), done.err.end(), '\n'), done.err.c_str());
    STRCMP_CONTAINS(said, done.err.c_str());
  }
};

TEST(LogFiles, SayWhatTheOtherTablesSay) {
  write_file(dir / "in.mjpg", damaged_film(5));
  succeed({"replay", in("in.mjpg"), "--features", in("f.csv"), "--markers", in("m.csv"), "--log", in("l.csv"), "--mcap",
           in("l.mcap")});
  check_against_features(dir / "l.csv", dir / "f.csv");
  const auto rows = strict_table(dir / "l.csv");
  DOUBLES_EQUAL(reason_number("jpeg_damaged"), rows.at(5).at("reason"), 0);
  DOUBLES_EQUAL(0, rows.at(5).at("accepted"), 0);

  const std::string bytes = read_file(dir / "l.mcap");
  std::string pictures;
  std::size_t marker_rows = 0, states = 0;
  const auto markers = table_of(dir / "m.csv");
  const log::McapFile file = log::read_mcap(bytes_of(bytes), [&](const log::McapFile& f, const log::McapMessage& m) {
    const std::string_view topic = f.channels.at(m.channel).topic;
    const double t_s = static_cast<double>(m.logged_ns) * 1e-9;
    if (topic == "/holdfast/camera") {
      const auto picture = log::decode<log::CompressedImage>(m.data);
      pictures.append(picture->data.begin(), picture->data.end());
    } else if (topic == "/holdfast/annotations") {
      return;  // HaveGreyPicturesEncoded looks at them
    } else if (topic == "/holdfast/slip") {
      const auto state = log::decode<log::FrameRecord>(m.data);
      DOUBLES_EQUAL(rows.at(states).at("t_s"), t_s, 1e-9);
      DOUBLES_EQUAL(rows.at(states).at("entropy_nat"), state->entropy_nat, 5e-7);
      LONGS_EQUAL(rows.at(states).at("reason"), state->reason);
      STRCMP_EQUAL(table_of(dir / "f.csv").at(states + 1).at(2).c_str(), std::string(state->state_name).c_str());
      STRCMP_EQUAL(table_of(dir / "f.csv").at(states + 1).at(3).c_str(), std::string(state->reason_name).c_str());
      LONGS_EQUAL(states++, m.sequence);
    } else {
      const auto field = log::decode<log::MarkerField>(m.data);
      for (std::size_t i = 0; i < field->row.size(); ++i) {
        Words row = markers.at(++marker_rows);
        while (row[4].empty()) row = markers.at(++marker_rows);  // of the refused frame, which has no message
        LONGS_EQUAL(std::stol(row[0]), field->frame);
        LONGS_EQUAL(std::stol(row[1]), field->row[i]);
        LONGS_EQUAL(std::stol(row[2]), field->col[i]);
        LONGS_EQUAL(std::stol(row[3]), field->valid[i]);
        DOUBLES_EQUAL(std::stod(row[4]), field->x_px[i], 1e-4);
        DOUBLES_EQUAL(std::stod(row[5]), field->y_px[i], 1e-4);
        DOUBLES_EQUAL(std::stod(row[6]), field->dx_px[i], 1e-4);
        DOUBLES_EQUAL(std::stod(row[7]), field->dy_px[i], 1e-4);
      }
    }
  });
  LONGS_EQUAL(0, file.faults.size());
  LONGS_EQUAL(rows.size(), states);
  LONGS_EQUAL(markers.size() - 1, marker_rows);
  CHECK(pictures == read_file(dir / "in.mjpg"));  // the damaged one too
}

TEST(LogFiles, CanBePlayedAgainAndTakenOut) {
  write_file(dir / "in.mjpg", damaged_film(5));
  const auto outputs = [&](const std::string& name) {
    return Words{"--features",      in(name + ".f"), "--markers",        in(name + ".m"), "--log",
                 in(name + ".csv"), "--mcap",        in(name + ".mcap"), "--fps",         "18.75"};
  };
  const auto replay = [&](const std::string& input, const std::string& name) {
    Words words{"replay", in(input)};
    const Words more = outputs(name);
    words.insert(words.end(), more.begin(), more.end());
    return succeed(words);
  };
  STRCMP_EQUAL("", replay("in.mjpg", "a").err.c_str());
  // Its time is that of the first run, whatever --fps says.
  STRCMP_CONTAINS("--fps was not used", replay("a.mcap", "b").err.c_str());
  for (const char* suffix : {".f", ".m", ".csv", ".mcap"}) {
    CHECK_TEXT(read_file(dir / (std::string("a") + suffix)) == read_file(dir / (std::string("b") + suffix)), suffix);
  }
  DOUBLES_EQUAL(15 / 18.75, strict_table(dir / "a.csv").back().at("t_s"), 1e-6);
  succeed({"replay", in("a.mcap"), "--reference", "last"});
  succeed({"log", "export", in("a.mcap"), "--csv", in("c.csv"), "--mjpg", in("c.mjpg")});
  CHECK(read_file(dir / "c.csv") == read_file(dir / "a.csv"));
  CHECK(read_file(dir / "c.mjpg") == read_file(dir / "in.mjpg"));

  const auto info = nlohmann::json::parse(succeed({"log", "info", in("a.mcap"), "--json"}).out);
  std::map<std::string, long> counts;
  for (const auto& channel : info["channels"]) counts[channel["topic"]] = channel["messages"].get<long>();
  const std::map<std::string, long> expected{
      {"/holdfast/annotations", 16}, {"/holdfast/camera", 16}, {"/holdfast/markers", 15}, {"/holdfast/slip", 16}};
  CHECK(counts == expected);
  CHECK(info["wrong"].empty());
  LONGS_EQUAL(63, info["messages"].get<long>());
  CHECK_EQUAL(800'000'000, info["last_ns"].get<long>());
  STRCMP_CONTAINS("/holdfast/slip holdfast_msgs/msg/SlipState: 16 messages",
                  succeed({"log", "info", in("a.mcap")}).out.c_str());
}

TEST(LogFiles, OfASceneHaveThePicturesThatTheFirmwareGot) {
  // Its plan tears four pictures on their way from the camera.
  succeed({"sim", kScenes + std::string("fault_torn.json"), "--inject", "jpeg", "--features", in("f.csv"), "--log",
           in("l.csv"), "--mcap", in("l.mcap")});
  check_against_features(dir / "l.csv", dir / "f.csv");
  succeed({"replay", in("l.mcap"), "--log", in("again.csv")});
  const auto first = strict_table(dir / "l.csv"), again = strict_table(dir / "again.csv");
  const auto refused = [](const auto& rows) {
    std::vector<double> frames;
    for (const auto& row : rows) {
      if (row.at("accepted") == 0) frames.push_back(row.at("frame"));
    }
    return frames;
  };
  LONGS_EQUAL(4, refused(first).size());
  CHECK(refused(first) == refused(again));
}

// Grey pictures are encoded, which the tool and the file say; nearly the same comes of playing them again.
TEST(LogFiles, HaveGreyPicturesEncoded) {
  const std::string scene = kScenes + std::string("relief_slip_20_mm_s.json");
  const Finished done = succeed({"sim", scene, "--inject", "grey", "--markers", in("m.csv"), "--mcap", in("l.mcap")});
  LONGS_EQUAL(1, std::count(done.err.begin(), done.err.end(), '\n'));
  STRCMP_CONTAINS("pictures of /holdfast/camera are encoded for this file, grey", done.err.c_str());
  std::string annotated;
  const std::string bytes = read_file(dir / "l.mcap");
  CHECK(bytes.find("grey, encoded as JPEG of quality 95 for this file") != std::string::npos);
  const auto markers = table_of(dir / "m.csv");
  std::size_t row = 1, frames = 0;
  const log::McapFile file = log::read_mcap(bytes_of(bytes), [&](const log::McapFile& f, const log::McapMessage& m) {
    if (f.channels.at(m.channel).topic != "/holdfast/annotations") return;
    const auto drawn = log::decode<log::ImageAnnotations>(m.data);
    CHECK(drawn.has_value() && drawn->points.size() == 2 && drawn->texts.size() == 1);
    annotated += std::string(drawn->texts[0].text) + "\n";
    ++frames;
    const log::PointsAnnotation& way = drawn->points[0];
    const log::PointsAnnotation& here = drawn->points[1];
    LONGS_EQUAL(2 * here.points.size(), way.points.size());
    std::size_t k = 0;
    for (; row < markers.size() && std::stoul(markers[row][0]) == m.sequence; ++row) {
      if (markers[row][3] != "1") continue;
      // This scene's camera gives pictures of the working size: the table's pixels, from the corner of the first one.
      DOUBLES_EQUAL(std::stod(markers[row][4]) + 0.5, here.points[k].x, 1e-3);
      DOUBLES_EQUAL(std::stod(markers[row][5]) + 0.5, here.points[k].y, 1e-3);
      DOUBLES_EQUAL(here.points[k].x - std::stod(markers[row][6]), way.points[2 * k].x, 1e-3);
      DOUBLES_EQUAL(here.points[k].y - std::stod(markers[row][7]), way.points[2 * k].y, 1e-3);
      ++k;
    }
    LONGS_EQUAL(k, here.points.size());
  });
  LONGS_EQUAL(markers.size(), row);
  LONGS_EQUAL(0, file.faults.size());
  STRCMP_CONTAINS("\nSLIP (slip)  imprint ", annotated.c_str());
  succeed({"replay", in("l.mcap"), "--report", in("r.html"), "--log", in("again.csv")});
  LONGS_EQUAL(frames, strict_table(dir / "again.csv").size());
  succeed({"log", "export", in("l.mcap"), "--csv", in("x.csv"), "--mjpg", in("x.mjpg")});
}

TEST(LogFiles, SayWhenThereAreNoPictures) {
  const std::string scene = kScenes + std::string("empty_gel.json");
  const Finished done = succeed(
      {"sim", scene, "--inject", "markers", "--features", in("f.csv"), "--log", in("l.csv"), "--mcap", in("l.mcap")});
  check_against_features(dir / "l.csv", dir / "f.csv");
  LONGS_EQUAL(1, std::count(done.err.begin(), done.err.end(), '\n'));
  STRCMP_CONTAINS("without /holdfast/camera, because no frame came as a picture", done.err.c_str());
  const auto info = nlohmann::json::parse(succeed({"log", "info", in("l.mcap"), "--json"}).out);
  LONGS_EQUAL(2, info["channels"].size());
  refuse({"replay", in("l.mcap"), "--report", in("r.html")}, "has no /holdfast/camera");
  refuse({"log", "export", in("l.mcap"), "--csv", in("x.csv"), "--mjpg", in("x.mjpg")}, "has no /holdfast/camera");
}

TEST(LogFiles, AppearWithTheOthersOrNotAtAll) {
  refuse({"replay", kFilm, "--log", in("x"), "--mcap", in("x")}, "given for both --log and --mcap");
  refuse({"replay", kFilm, "--log", in("l.csv"), "--mcap", in("none/x")}, "none/x");
  write_file(dir / "in.mjpg", read_file(kFilm));
  refuse({"replay", in("in.mjpg"), "--mcap", in("in.mjpg")}, "--mcap would change an input");
  refuse({"replay", in("in.mjpg"), "--reference", "99", "--log", in("l.csv"), "--mcap", in("l.mcap")}, "frame '99'");
  // The table fits and the pictures do not: none of them may appear.
  const Finished full = test::run({"sh", "-c", "trap '' XFSZ; ulimit -f 64; exec \"$@\"", "sh", kTool, "replay",
                                   in("in.mjpg"), "--log", in("l.csv"), "--mcap", in("l.mcap")});
  LONGS_EQUAL(1, full.status);
  STRCMP_CONTAINS("l.mcap: could not be written to its end", full.err.c_str());
  CHECK(!fs::exists(dir / "l.csv") && !fs::exists(dir / "l.mcap"));
  LONGS_EQUAL(1, std::distance(fs::directory_iterator(dir.path()), {}));
}

TEST(LogFiles, RefusesLogsThatAreNotWhole) {
  succeed({"replay", kFilm, "--mcap", in("good.mcap")});
  const std::string good = read_file(dir / "good.mcap");
  write_file(dir / "cut.mcap", good.substr(0, good.size() - 100));
  std::string flipped = good;
  flipped[good.size() / 2] = static_cast<char>(flipped[good.size() / 2] ^ 1);
  write_file(dir / "flipped.mcap", flipped);
  const test::McapBytes foreign = test::foreign_mcap();
  write_file(dir / "foreign.mcap", {reinterpret_cast<const char*>(foreign.data()), foreign.size()});
  write_file(dir / "text.mcap", "no log\n");
  for (const Words& command : {Words{"log", "info", "--json"}, Words{"log", "info"}, Words{"replay", "--log", in("x")},
                               Words{"log", "export", "--csv", in("x"), "--mjpg", in("y")}}) {
    const auto refuse_file = [&](const char* name, const char* said) {
      Words words = command;
      words.insert(words.begin() + (command.front() == "log" ? 2 : 1), in(name));
      refuse(words, said);
    };
    refuse_file("cut.mcap", "breaks off");
    refuse_file("flipped.mcap", "a chunk whose check sum is not that of its bytes");
    if (command.front() == "log") refuse_file("text.mcap", "no MCAP file");
    if (command.front() == "log") refuse_file("absent.mcap", "cannot be read");
  }
  STRCMP_CONTAINS("1, from", succeed({"log", "info", in("foreign.mcap")}).out.c_str());
  refuse({"log", "export", in("foreign.mcap"), "--csv", in("x")}, "has no /holdfast/slip");
  refuse({"log", "export", in("good.mcap"), "--csv", in("good.mcap")}, "--csv would change a log of this run");
  refuse({"log", "export", in("good.mcap")}, "neither --csv nor --mjpg is given");
  refuse({"replay", in("good.mcap"), "--mcap", in("good.mcap")}, "--mcap would change an input");
  // Ours by name: of another version, and with bytes that are no such message.
  const auto written = [&](std::string_view text) {
    std::ostringstream out;
    log::McapWriter writer(out);
    const std::uint16_t channel = writer.add_channel(log::kSlipTopic, log::schema_name<log::FrameRecord>(), text);
    writer.write(channel, 0, 0, test::McapBytes{0, 1, 0, 0});
    writer.finish();
    write_file(dir / "other.mcap", out.str());
  };
  written("uint8 a\n");
  refuse({"log", "info", in("other.mcap")}, "written by another version");
  written(log::schema_text<log::FrameRecord>());
  refuse({"log", "export", in("other.mcap"), "--csv", in("x")}, "a message that is not what its schema says");
  for (const Words& command : {Words{"log"}, Words{"log", "info"}, Words{"log", "export"}}) {
    Words words = command;
    words.emplace_back("--help");
    const Finished help = succeed(words);
    if (command.size() == 2) STRCMP_CONTAINS("Example:\n  holdfast log", help.out.c_str());
  }
}
