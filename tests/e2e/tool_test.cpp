// SPDX-License-Identifier: Apache-2.0
// The program `holdfast` as a user meets it: right words and no files when something is wrong, right files when not.
// Inputs are rendered grasps of known truth, written by OpenCV and libjpeg.
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <set>
#include <sstream>

#include "drivers/sim/scene/file/scene_file.hpp"
#include "drivers/sim/scene/picture/jpeg_encode.hpp"
#include "drivers/sim/scene/picture/render.hpp"
#include "drivers/sim/scene/simulation.hpp"
#include "slip/model_file.hpp"
#include "slip/slip_tree.gen.hpp"
#include "slip/tree_io.hpp"
#include "tests/support/folders.hpp"
#include "tests/support/host_process.hpp"
#include "tests/support/pictures.hpp"
#include "tests/support/temp_dir.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

namespace {

using namespace holdfast;
using holdfast::test::kTool;
namespace fs = std::filesystem;
using test::Finished;
using test::HostProcess;
using test::read_file;
using test::TempDir;
using test::write_file;

using Words = std::vector<std::string>;

const std::string kScene = holdfast::test::source("tests/scenes/sphere_slip.json");
const std::string kGreyScene = holdfast::test::source("tests/scenes/relief_slip_20_mm_s.json");
const std::string kFirstSet(kFeatureSets.front().name);
constexpr const char* kFeaturesHeader =
    "frame,t_s,state,reason,markers,vx_mm_s,vy_mm_s,entropy_nat,entropy_rate_nat_s,slip,grip_ok,contact,"
    "imprint_patches,imprint_um,coarse_um,contact_phase,evidence,evidence_value,evidence_threshold,evidence_unit,"
    "evidence_frames,shear_x_n,shear_y_n,normal_n,friction_use,load_within,load_basis";
constexpr const char* kMarkersHeader = "frame,row,col,valid,x_px,y_px,dx_px,dy_px";

// A grasp seen by one camera. Frame 0 shows the empty gel, the others the object being pulled.
struct Film {
  scene::PictureConfig picture = scene::cropped_320x240();
  scene::MarkerGrid grid{};

  [[nodiscard]] std::vector<scene::PointPx> dots(int frame) const {
    constexpr double kStep_s = 0.03;
    scene::Scene scene;
    scene.fps = 1.0 / kStep_s;
    scene.gel = {.shear_modulus_mpa = 0.1};
    scene.markers = grid;
    scene.trajectory = {{.t_s = 0.0, .force_n = 3.0, .x_mm = 0.0, .y_mm = 0.0},
                        {.t_s = 1.0, .force_n = 3.0, .x_mm = 7.5, .y_mm = 2.7}};
    scene::Simulation simulation(scene);
    const scene::Snapshot* snapshot = nullptr;
    for (int k = 0; k <= frame; ++k) snapshot = &simulation.next();
    std::vector<scene::PointPx> dots;
    for (std::size_t i = 0; i < simulation.markers().size(); ++i) {
      const scene::Vec2 rest = simulation.markers()[i];
      const scene::Vec2 u = frame == 0 ? scene::Vec2{} : snapshot->motion_mm[i];
      dots.push_back(scene::to_px(picture, {rest.x + u.x, rest.y + u.y}));
    }
    return dots;
  }
  [[nodiscard]] cv::Mat grey(int frame) const {
    std::vector<std::uint8_t> out;
    scene::render_luma(picture, dots(frame), nullptr, static_cast<std::uint64_t>(frame), out);
    return cv::Mat(out, true).reshape(1, picture.height);
  }
  // 4:2:2 as the sensor sends it.
  [[nodiscard]] std::string jpeg(int frame) const {
    std::vector<std::uint8_t> rgb;
    scene::render_rgb(picture, dots(frame), nullptr, static_cast<std::uint64_t>(frame), rgb);
    const auto bytes = scene::encode_jpeg(rgb, picture.width, picture.height, scene::JpegInput::kRgb, 85);
    return {bytes.begin(), bytes.end()};
  }
  [[nodiscard]] std::string stream(int frames) const {
    std::string out;
    for (int i = 0; i < frames; ++i) out += jpeg(i);
    return out;
  }
};

Film vga() {
  return {scene::scaled(scene::cropped_320x240(), 640), {}};
}

// The gel with 8 columns and 10 rows, seen whole.
Film tall_gel() {
  Film film;
  film.grid = {10, 8, 2.02};
  film.picture.height = 320;
  film.picture.center_y_px = 159.5;
  film.picture.px_per_mm *= 0.85;
  return film;
}

void write_frames(const fs::path& folder, int frames, const Film& film = {}) {
  fs::create_directory(folder);
  for (int i = 0; i < frames; ++i) test::write_picture(folder / (std::to_string(i) + ".png"), film.grey(i));
}

template <typename Picture>
void write_video(const fs::path& path, const char* fourcc, int frames, Picture picture, double fps = 25) {
  const cv::Mat first = picture(0);
  const auto writer = test::film_writer(path, fourcc, fps, first.size());
  CHECK_TEXT(frames == 0 || writer->isOpened(), "OpenCV cannot write this video here");
  for (int i = 0; i < frames; ++i) {
    cv::Mat colour = picture(i);
    if (colour.channels() == 1) cv::cvtColor(colour, colour, cv::COLOR_GRAY2BGR);
    writer->write(colour);
  }
}

void write_gel_video(const fs::path& path, const char* fourcc, int frames, double fps = 25) {
  write_video(
      path, fourcc, frames, [](int i) { return Film{}.grey(i); }, fps);
}

cv::Mat noise(int seed, double blur_px) {
  cv::Mat image(240, 320, CV_8U);
  cv::RNG(static_cast<std::uint64_t>(seed) + 1).fill(image, cv::RNG::UNIFORM, 0, 255);
  if (blur_px > 0) {
    cv::GaussianBlur(image, image, cv::Size(), blur_px);
    cv::normalize(image, image, 0, 255, cv::NORM_MINMAX);
  }
  return image;
}

struct Table {
  std::string header;
  std::vector<Words> rows;
};

Table read_csv(const fs::path& path) {
  Table table;
  std::ifstream file(path);
  std::getline(file, table.header);
  for (std::string line; std::getline(file, line);) {
    Words cells;
    std::istringstream in(line + ",");
    for (std::string cell; std::getline(in, cell, ',');) cells.push_back(cell);
    table.rows.push_back(cells);
  }
  return table;
}

std::string joined(const Words& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : " ") + word;
  return text;
}

}  // namespace

// clang-format off
TEST_GROUP(Tool) {
  TempDir dir;
  // clang-format on

  [[nodiscard]] std::string in(std::string_view name) const {
    return (dir / name).string();
  }

  Finished ask(const Words& arguments) {
    Words command{kTool};
    command.insert(command.end(), arguments.begin(), arguments.end());
    Finished done = test::run(command);
    CHECK_TEXT(done.in_time, (joined(arguments) + ": did not end").c_str());
    CHECK_TEXT((done.out + done.err).find('\033') == std::string::npos, "an escape code on something not a terminal");
    return done;
  }

  Finished succeed(const Words& arguments) {
    Finished done = ask(arguments);
    LONGS_EQUAL_TEXT(0, done.status, (joined(arguments) + ": " + done.err).c_str());
    return done;
  }

  // One line on stderr that names `named` and says `said`; no word on stdout, no file made or changed.
  void check_line(const Finished& done, const std::string& about, const std::string& named, const std::string& said) {
    const std::string text = about + " -> " + done.err;
    CHECK_TEXT(done.status > 0 && done.status < 128, text.c_str());
    STRCMP_EQUAL_TEXT("", done.out.c_str(), text.c_str());
    LONGS_EQUAL_TEXT(1, std::count(done.err.begin(), done.err.end(), '\n'), text.c_str());
    CHECK_TEXT(done.err.starts_with("holdfast: ") && done.err.ends_with("\n"), text.c_str());
    STRCMP_CONTAINS_TEXT(named.c_str(), done.err.c_str(), text.c_str());
    STRCMP_CONTAINS_TEXT(said.c_str(), done.err.c_str(), text.c_str());
    const bool by_words =
        done.err.find(". Likely cause: ") < done.err.find(". Next: ") && done.err.find(". Next: ") != std::string::npos;
    const bool by_marks = done.err.find("; ", done.err.find(": ", 10)) != std::string::npos;
    CHECK_TEXT(by_words || by_marks, (text + "says no cause or no next step").c_str());
  }

  // With every output asked for: two that are there already, two that are not.
  void refused(Words arguments, const std::string& named, const std::string& said) {
    const fs::path out = dir / "out";
    fs::create_directory(out);
    write_file(out / "f.csv", "older");
    write_file(out / "r.html", "older");
    const std::string about = joined(arguments);
    for (const auto& [option, name] :
         {std::pair{"--features", "f.csv"}, {"--markers", "m.csv"}, {"--overlay", "o.png"}, {"--report", "r.html"}}) {
      arguments.insert(arguments.end(), {option, (out / name).string()});
    }
    check_line(ask(arguments), about, named, said);
    LONGS_EQUAL_TEXT(2, std::distance(fs::directory_iterator(out), {}), about.c_str());
    STRCMP_EQUAL_TEXT("older", read_file(out / "f.csv").c_str(), about.c_str());
    STRCMP_EQUAL_TEXT("older", read_file(out / "r.html").c_str(), about.c_str());
  }
};

// What is played all the same, and should not be taken for more than it is.
TEST(Tool, SimSaysWhatToDoubt) {
  const auto note_of = [&](const char* object, const char* more) {
    test::write_file(in("odd.json"),
                     std::string(R"({"schema_version": 1, "name": "odd", "duration_s": 1.6, "level": {)") +
                         R"("inject": "grey", "contact": "grid"}, "object": {"radius_mm": 15)" + object +
                         R"(}, "trajectory": [{"t_s": 0.4, "force_n": 0}, {"t_s": 0.8, "force_n": 3}])" + more + "}");
    const Finished sim = succeed({"sim", in("odd.json")});
    const std::size_t at = sim.out.find("\nnote ");
    return at == std::string::npos ? std::string() : sim.out.substr(at + 1);
  };
  STRCMP_EQUAL("", note_of("", "").c_str());
  STRCMP_CONTAINS("mm deep in a gel of 4.25 mm", note_of(R"(, "touch_x_mm": 100)", "").c_str());
  STRCMP_CONTAINS("the last frame came at 0.",
                  note_of("", R"(, "faults": [{"t_s": 1, "frames": 3, "fault": "late", "by_ms": 60000}])").c_str());
}

TEST(Tool, RefusesWhatIsNoRecording) {
  refused({"replay", in("absent.avi")}, in("absent.avi"), "No such file");
  write_file(dir / "text.avi", "not a video\n");
  refused({"replay", in("text.avi")}, in("text.avi"), "not a video");
  fs::create_directory(dir / "folder");
  refused({"replay", in("folder")}, in("folder"), "the folder is empty");
  write_frames(dir / "mixed", 3);
  test::write_picture(in("mixed/3.png"), vga().grey(3));
  refused({"replay", in("mixed")}, in("mixed/3.png"), "640x480");
  if (::geteuid() == 0) return;  // root may read everything
  write_frames(dir / "secret", 1);
  fs::permissions(dir / "secret/0.png", fs::perms::none);
  refused({"replay", in("secret/0.png")}, in("secret/0.png"), "ermission");
}

// What cannot be written is refused before a run of hours, not behind it.
TEST(Tool, RefusesOutputsBeforeALongRun) {
  const auto refuse = [&](const Words& arguments, const std::string& named, const std::string& said) {
    check_line(ask(arguments), joined(arguments), named, said);
  };
  refuse({"trials", "closing", "--count", "100000", "--csv", in("absent/t.csv")}, in("absent/t.csv"), "No such file");
  refuse({"evaluate", "--recorded", in("labels.csv"), "--json", in("absent/j.json")}, in("absent/j.json"),
         "No such file");
  write_file(dir / "labels.csv", "clip\n");
  refuse({"trade", "firmware", "--recordings", in("labels.csv"), "--csv", in("labels.csv")}, in("labels.csv"),
         "would change a label file");
}

// To open a pipe waits for whoever writes into it: nobody does.
TEST(Tool, WaitsForNoPipe) {
  for (const char* name : {"pipe", "pipe.json"}) LONGS_EQUAL(0, ::mkfifo(in(name).c_str(), 0600));
  const std::string pipe = in("pipe"), gel = in("gel.avi"),
                    model = holdfast::test::source("toolchain/model/slip_v2.tree");
  write_gel_video(dir / "gel.avi", "MJPG", 3);
  write_file(dir / "robot.toml", "hold_ms = 444\n");
  succeed({"settings", "compile", in("robot.toml"), "-o", in("robot.settings")});
  write_file(dir / "labels.csv",
             "clip,slip_start,slip_end,onset_recorded,silent_intervals,empty_intervals\ngel.avi,,,0,,\n");
  for (const Words& arguments : {
           Words{"replay", pipe},
           {"replay", gel, "--right", pipe},
           {"replay", gel, "--reference", pipe},
           {"replay", gel, "--model", pipe},
           {"replay", gel, "--settings", pipe},
           {"sim", in("pipe.json")},
           {"scene", "check", in("pipe.json")},
           {"calibrate", pipe},
           {"calibrate", in("pipe.json")},
           {"calibrate", gel, "--reference", pipe},
           {"evaluate", pipe, "--json", in("x")},
           {"evaluate", "--recorded", pipe},
           {"evaluate", "--recorded", in("labels.csv"), "--model", pipe},
           {"dataset", "--recordings", pipe, "--out", in("x")},
           {"train", pipe, "--set", "paper"},
           {"fuse", pipe, "--markers", model, "--model", in("x")},
           {"fuse", in("labels.csv"), "--markers", pipe, "--model", in("x")},
           {"compile", pipe},
           {"compile", model, "--check", "--header", pipe},
           {"model", "seal", pipe, "-o", in("x")},
           {"model", "show", pipe},
           {"settings", "compile", pipe, "-o", in("x")},
           {"settings", "compile", in("robot.toml"), "-o", in("x"), "--sign", pipe},
           {"settings", "show", pipe},
           {"settings", "show", in("robot.settings"), "--owner-key", pipe},
           {"trials", "closing", "--model", pipe},
           {"trade", "show", pipe},
           {"trade", "firmware", "--films", "0", "--recordings", pipe},
           {"log", "info", pipe},
           {"log", "export", pipe, "--csv", in("x")},
           {"live", "--play", pipe, "--port", "0"},
           {"live", "--play", in("pipe.json"), "--port", "0"},
           {"record", in("x"), "--play", pipe},
       }) {
    const std::string named = std::ranges::find(arguments, pipe) != arguments.end() ? pipe : in("pipe.json");
    check_line(ask(arguments), joined(arguments), named, "pipe");
    CHECK_FALSE_TEXT(fs::exists(dir / "x"), joined(arguments).c_str());
  }
}

// A board goes on with what is compiled in; on the desk nothing starts.
TEST(Tool, TheFirmwareWaitsForNoPipe) {
  const std::string pipe = in("pipe");
  LONGS_EQUAL(0, ::mkfifo(pipe.c_str(), 0600));
  for (const char* option : {"--code-file", "--owner-key", "--play"}) {
    const Finished done = test::run({holdfast::test::kFirmware, option, pipe});
    CHECK_TEXT(done.in_time, option);
    CHECK_TEXT(done.status > 0 && done.status < 128, (option + done.err).c_str());
    STRCMP_CONTAINS_TEXT(pipe.c_str(), done.err.c_str(), option);
  }
}

// A tool that was copied without its module still plays what takes none.
TEST(Tool, SaysWhatIsMissingForAPicture) {
  fs::copy_file(kTool, dir / "alone");
  write_frames(dir / "png", 1);
  write_file(dir / "gel.mjpg", Film{}.stream(2));
  const Finished without = test::run({in("alone"), "replay", in("png")});
  LONGS_EQUAL(1, without.status);
  STRCMP_CONTAINS((in("png") + "/0.png: pictures and videos can be neither read nor written: no ").c_str(),
                  without.err.c_str());
  STRCMP_CONTAINS("/libholdfast_media.so; copy it beside the program, or build again", without.err.c_str());
  LONGS_EQUAL(0, test::run({in("alone"), "replay", in("gel.mjpg")}).status);
  // Said before the scene is played, not after it.
  const Finished report = test::run({in("alone"), "sim", kScene, "--report", in("r.html")});
  LONGS_EQUAL(1, report.status);
  STRCMP_EQUAL("", report.out.c_str());
  STRCMP_CONTAINS("pictures and videos can be neither read nor written: no ", report.err.c_str());
  CHECK_FALSE(fs::exists(dir / "r.html"));
}

TEST(Tool, RefusesPicturesWithoutAGrid) {
  write_video(dir / "noise.avi", "MJPG", 2, [](int i) { return noise(i, 0); });
  refused({"replay", in("noise.avi")}, in("noise.avi"), "too many blobs");
  write_video(dir / "black.avi", "MJPG", 2, [](int) { return cv::Mat(240, 320, CV_8U, cv::Scalar(0)); });
  refused({"replay", in("black.avi")}, in("black.avi"), "too few dark dots");
  write_video(dir / "leaves.avi", "MJPG", 2, [](int i) { return noise(i, 6); });
  refused({"replay", in("leaves.avi"), "--grid", "auto"}, in("leaves.avi"), "Likely cause: ");
  write_video(dir / "wide.avi", "MJPG", 2, [](int) { return cv::Mat(100, 20000, CV_8U, cv::Scalar(99)); });
  refused({"replay", in("wide.avi")}, in("wide.avi"), "20000x100");
  test::write_picture(in("wide.png"), cv::Mat(100, 20000, CV_8U, cv::Scalar(99)));
  refused({"replay", in("wide.png")}, in("wide.png"), "20000x100");
}

TEST(Tool, RefusesAGridThatIsNotThere) {
  write_gel_video(dir / "gel.avi", "MJPG", 2);
  for (const char* grid : {"8x7", "9x8", "5x5", "10x7", "7x9"}) {
    refused({"replay", in("gel.avi"), "--grid", grid}, in("gel.avi"), "found 9x7");
  }
  refused({"replay", in("gel.avi"), "--grid", "7x9"}, in("gel.avi"), "turned by a quarter: --grid 9x7");
  for (const char* grid : {"9", "9x", "0x0", "99x99", "axb", "", "9x7x", " 9x7", "-9x7", "99999999999x7", "16x16"}) {
    refused({"replay", in("gel.avi"), "--grid", grid}, "--grid '" + std::string(grid) + "'", "9x7, or auto");
  }
}

TEST(Tool, RefusesAReferenceThatIsNone) {
  write_gel_video(dir / "gel.avi", "MJPG", 3);
  const auto refuse = [&](const std::string& reference, const std::string& named, const char* said) {
    refused({"replay", in("gel.avi"), "--reference", reference}, named, said);
  };
  for (const char* number : {"3", "450", "-1", "99999999999", "99999999999999999999"}) {
    refuse(number, in("gel.avi"), "from 0 to 2");
  }
  refuse("", "--reference", "empty");
  refuse(in("absent.png"), in("absent.png"), "no such file");
  refuse(dir.path().string(), dir.path().string(), "is not a regular file. Likely cause: a folder,");
  refuse(in("gel.avi"), in("gel.avi"), "not an image");
  const auto image = [&](const char* name, const cv::Mat& picture) {
    test::write_picture(in(name), picture);
    return in(name);
  };
  // A JPEG of twice the size comes out of the decoder at the same working size: it must not slip through.
  for (const char* name : {"big.png", "big.jpg"}) refuse(image(name, vga().grey(0)), in(name), "is 640x480 pixels");
  refuse(image("blank.png", cv::Mat(240, 320, CV_8U, cv::Scalar(99))), in("blank.png"), "too few dark dots");
  write_file(dir / "cut.mjpg", Film{}.jpeg(0) + Film{}.jpeg(1).substr(0, 5000));
  refused({"replay", in("cut.mjpg"), "--reference", "last"}, in("cut.mjpg"), "give another frame");
}

TEST(Tool, PlaysAStreamThatBreaksOffInAPicture) {
  const std::string whole = Film{}.stream(5);
  write_file(dir / "cut.mjpg", whole.substr(0, whole.size() - 3000));
  const Finished done = succeed({"replay", in("cut.mjpg"), "--features", in("f.csv")});
  STRCMP_CONTAINS("5 read, 4 accepted, 1 rejected", done.out.c_str());
  STRCMP_CONTAINS("the JPEG picture is damaged", done.out.c_str());
  const Table table = read_csv(dir / "f.csv");
  LONGS_EQUAL(5, table.rows.size());
  STRCMP_EQUAL("none", table.rows[3][3].c_str());
  STRCMP_EQUAL("jpeg_damaged", table.rows[4][3].c_str());
}

TEST(Tool, RefusesSettingsThatItDoesNotKnow) {
  write_frames(dir / "gel", 2);
  refused({"replay", in("gel"), "--mode", "warp"}, "--mode 'warp'", "fast, balanced, precise");
  refused({"replay", in("gel"), "--feature-set", "none"}, "--feature-set 'none'", "give one of " + kFirstSet);
  const std::string other(slip_tree::kFeatureSet == kFirstSet ? kFeatureSets[1].name : kFirstSet);
  refused({"replay", in("gel"), "--feature-set", other}, "--feature-set '" + other + "'",
          "give a model of the set " + other + " with --model");
  for (const char* fps : {"0", "-1", "abc", "nan", "inf", "1e9", ""}) {
    refused({"replay", in("gel"), "--fps", fps}, "--fps: '" + std::string(fps) + "'", "0.1 to 1000");
  }
  const std::string model =
      read_file(holdfast::test::source("toolchain/model/") + std::string(slip_tree::kName) + ".tree");
  const auto changed = [&](const std::string& from, const std::string& to) {
    const std::size_t at = model.find(from);
    CHECK_TEXT(at != std::string::npos, from.c_str());
    write_file(dir / "m.tree", std::string(model).replace(at, from.size(), to));
  };
  const auto refuse = [&](const std::string& path, const char* said) {
    refused({"replay", in("gel"), "--model", path}, path, said);
  };
  refuse(in("absent.tree"), "No such file");
  refuse(in("gel"), "is not a regular file. Likely cause: a folder,");
  write_file(dir / "m.tree", "");
  refuse(in("m.tree"), "has 0 bytes");
  write_file(dir / "m.tree", model.substr(0, model.size() - 20));
  refuse(in("m.tree"), "m.tree:");
  changed("\nformat 1", "\nformat 7");
  refuse(in("m.tree"), "m.tree:");
  changed("? 1 : ", "? 0 : ");  // every line can be read, but it is no tree
  refuse(in("m.tree"), "child");
  fs::resize_file(dir / "m.tree", 3'000'000);
  refuse(in("m.tree"), "larger than any model");
}

TEST(Tool, DecidesWithAModelOfAnySetInEitherForm) {
  write_gel_video(dir / "gel.avi", "MJPG", 4);
  // One predicate of the last feature, which says slip to all but its very largest value.
  for (const FeatureSet& set : kFeatureSets) {
    const std::string name = "always_" + std::string(set.name);
    std::string text = "format 1\nname " + name + "\nfeature_set " + std::string(set.name) + "\n";
    for (int i = 0; i < set.size(); ++i) {
      text += "feature " + std::string(set[i].name) + " " + std::string(set[i].unit) + " Q" + std::to_string(set[i].q) +
              "\n";
    }
    text += "node 0: " + std::string(set[set.size() - 1].name) + " <= " + std::to_string(set[set.size() - 1].max - 1) +
            " ? 1 : 2\nleaf 1: slip\nleaf 2: hold\n";
    write_file(dir / (name + ".tree"), text);
    (void)succeed({"compile", in(name + ".tree"), "--binary", in(name + ".model")});
    for (const char* form : {".tree", ".model"}) {
      const Words words{"replay", in("gel.avi"), "--model", in(name + form), "--features", in("f.csv")};
      STRCMP_CONTAINS("slip      raised", succeed(words).out.c_str());
      Words named = words;
      named.insert(named.end(), {"--feature-set", std::string(set.name)});
      (void)succeed(named);
    }
  }
  // The paper's tree needs no file.
  (void)succeed({"replay", in("gel.avi"), "--feature-set", "paper", "--features", in("f.csv")});
  CHECK(read_csv(dir / "f.csv").rows.back()[11].empty());  // which does not read the picture
  const std::string model = in("always_" + kFirstSet + ".model");
  refused({"replay", in("gel.avi"), "--model", model, "--feature-set", std::string(kFeatureSets[1].name)}, model,
          "reads the set " + kFirstSet);
  const std::string bytes = read_file(model);
  const auto refuse = [&](std::string changed, const char* said) {
    write_file(dir / "bad.model", changed);
    refused({"replay", in("gel.avi"), "--model", in("bad.model")}, in("bad.model"), said);
  };
  refuse(bytes.substr(0, bytes.size() - 1), "too short or too long");
  refuse(bytes.substr(0, 6), "is no compiled model");
  std::string flipped = bytes;
  flipped[700] = static_cast<char>(flipped[700] ^ 4);
  refuse(flipped, "check sum is wrong");
}

TEST(Tool, CompilesAModel) {
  const std::string model = holdfast::test::source("toolchain/model/") + std::string(slip_tree::kName) + ".tree";
  const std::string header = read_file(holdfast::test::source("firmware/slip/slip_tree.gen.hpp"));
  const Finished done = succeed({"compile", model, "--header", in("t.hpp"), "--binary", in("t.model"), "--json"});
  CHECK(read_file(dir / "t.hpp") == header);
  LONGS_EQUAL(model_file::kBytes, fs::file_size(dir / "t.model"));
  const auto summary = nlohmann::json::parse(done.out);
  CHECK(summary["name"] == slip_tree::kName);
  CHECK(summary["feature_set"] == slip_tree::kFeatureSet);
  CHECK(summary["nodes"] == slip_tree::kNodes);
  CHECK(summary["depth"] == slip_tree::kDepth);
  CHECK(summary["leaves"] == (slip_tree::kNodes + 1) / 2);
  CHECK(summary["header"] == in("t.hpp"));
  STRCMP_CONTAINS(std::string(slip_tree::kName).c_str(), succeed({"compile", model}).out.c_str());
  STRCMP_CONTAINS(
      "checked",
      succeed({"compile", model, "--header", in("t.hpp"), "--binary", in("t.model"), "--check"}).out.c_str());
  LONGS_EQUAL(2, std::distance(fs::directory_iterator(dir.path()), {}));
}

TEST(Tool, RefusesToCompileWhatItMayNot) {
  const std::string name(slip_tree::kName);
  const std::string model = in(name + ".tree");
  fs::copy_file(holdfast::test::source("toolchain/model/") + name + ".tree", model);
  (void)succeed({"compile", model, "--header", in("t.hpp"), "--binary", in("t.model")});
  const std::string text = read_file(model);
  const std::string header = read_file(dir / "t.hpp");
  const auto refuse = [&](Words arguments, const std::string& named, const char* said) {
    arguments.insert(arguments.begin(), "compile");
    check_line(ask(arguments), joined(arguments), named, said);
  };
  refuse({model, "--header", model}, model, "would change the model");
  refuse({model, "--header", in("f"), "--binary", in("./f")}, in("f"), "given for both");
  refuse({model, "--check"}, "--check", "nothing to compare with");
  refuse({model, "--header", in("absent/t.hpp")}, in("absent/t.hpp"), "No such file");
  refuse({model, "--header", in("other.hpp"), "--binary", in("absent/t.model")}, in("absent/t.model"), "No such file");
  refuse({model, "--header", in("other.hpp"), "--check"}, in("other.hpp"), "is not what");
  refuse({in("absent.tree")}, in("absent.tree"), "No such file");
  refuse({in("t.model")}, in("t.model"), "is a compiled model");
  (void)succeed({"model", "seal", in("t.model"), "-o", in("t.sealed")});
  refuse({in("t.sealed")}, in("t.sealed"), "is a sealed record");
  check_line(ask({"replay", in("gel.avi"), "--model", in("t.sealed")}), "replay --model", in("t.sealed"),
             "is a sealed record. Likely cause: what holdfast model seal wrote");
  write_file(dir / "t.hpp", header + "\n");
  refuse({model, "--header", in("t.hpp"), "--check"}, in("t.hpp"), "is not what");
  write_file(dir / "t.hpp", header.substr(0, header.size() - 1));
  refuse({model, "--header", in("t.hpp"), "--check"}, in("t.hpp"), "is not what");
  fs::copy_file(model, dir / "renamed.tree");
  refuse({in("renamed.tree"), "--header", in("r.hpp")}, in("renamed.tree"), "the model inside is named");
  write_file(model, text.substr(0, text.size() - 20));
  refuse({model, "--header", in("t.hpp")}, model, "Likely cause");
  CHECK(read_file(dir / "t.hpp") == header.substr(0, header.size() - 1));
  for (const char* absent : {"r.hpp", "other.hpp", "f"}) CHECK_FALSE(fs::exists(dir / absent));
}

TEST(Tool, RefusesOutputsThatCannotBe) {
  write_gel_video(dir / "gel.avi", "MJPG", 2);
  write_frames(dir / "gel", 2);
  test::write_picture(in("rest.png"), Film{}.grey(0));
  fs::copy_file(holdfast::test::source("toolchain/model/") + std::string(slip_tree::kName) + ".tree", dir / "m.tree");
  const std::string recording = read_file(dir / "gel.avi");
  const auto files = [&] {
    std::set<std::string> names;
    for (const auto& entry : fs::recursive_directory_iterator(dir.path())) names.insert(entry.path().string());
    return names;
  };
  const auto before = files();
  const auto refuse = [&](Words arguments, const std::string& named, const char* said) {
    arguments.insert(arguments.begin(), "replay");
    check_line(ask(arguments), joined(arguments), named, said);
  };
  for (const char* option : {"--features", "--markers", "--overlay", "--report"}) {
    refuse({in("gel.avi"), option, in("absent/f")}, in("absent/f"), "No such file");
    refuse({in("gel.avi"), option, in("gel")}, in("gel"), "it is a folder");
    refuse({in("gel.avi"), option, in("gel/../gel.avi")}, "gel.avi", "would change an input");
    refuse({in("gel.avi"), option, ""}, option, "empty");
  }
  refuse({in("gel"), "--overlay", in("gel/2.png")}, in("gel/2.png"), "would change the folder");
  refuse({in("gel.avi"), "--reference", in("rest.png"), "--overlay", in("rest.png")}, in("rest.png"), "an input");
  refuse({in("gel.avi"), "--model", in("m.tree"), "--report", in("m.tree")}, in("m.tree"), "an input");
  refuse({in("gel.avi"), "--features", in("f"), "--report", in("gel/../f")}, in("f"), "--features and --report");
  check_line(ask({"sim", kScene, "--truth", in("f"), "--markers", in("f")}), "sim", in("f"), "given for both");
  // The table can be made and the picture can not: none of them may appear.
  const Finished full = test::run({"sh", "-c", "trap '' XFSZ; ulimit -f 32; exec \"$@\"", "sh", kTool, "replay",
                                   in("gel"), "--features", in("f"), "--report", in("r"), "--overlay", in("o")});
  check_line(full, "full disk", in("o"), "could not be written to its end");
  CHECK(files() == before);
  CHECK(read_file(dir / "gel.avi") == recording);
  if (::geteuid() == 0) return;  // root may write everywhere
  fs::permissions(dir / "gel", fs::perms::owner_read | fs::perms::owner_exec);
  refuse({in("gel.avi"), "--features", in("gel/f")}, in("gel/f"), "ermission");
  fs::permissions(dir / "gel", fs::perms::owner_all);
}

TEST(Tool, RefusesWordsThatItDoesNotKnow) {
  write_frames(dir / "gel", 1);
  const auto refuse = [&](const Words& arguments, const char* named, const char* said) {
    check_line(ask(arguments), joined(arguments), named, said);
  };
  refuse({}, "no command given", "holdfast --help");
  refuse({"frobnicate"}, "'frobnicate'", "give one of replay, sim, scene, ");
  refuse({"reply"}, "'reply'", "did you mean replay?");
  refuse({"replay", in("gel"), "--referense", "last"}, "'--referense'", "did you mean --reference?");
  refuse({"scene", "lst"}, "'lst'", "did you mean list?");
  refuse({"--frob"}, "'--frob'", "holdfast --help");
  refuse({"replay"}, "INPUT", "holdfast replay --help");
  refuse({"replay", ""}, "INPUT", "empty");
  refuse({"replay", in("gel"), "--frob", "1"}, "'--frob'", "holdfast replay --help");
  refuse({"replay", in("gel"), "more"}, "'more'", "holdfast replay --help");
  refuse({"replay", in("gel"), "--grid"}, "--grid", "holdfast replay --help");
  refuse({"replay", "no\nsuch\033[31mfile"}, "no?such?[31mfile", "check the path");
  refuse({"sim"}, "SCENE", "holdfast sim --help");
  refuse({"sim", in("sphere_slop.json")}, "sphere_slop.json", "No such file");
  refuse({"sim", kScene, "--inject", "here"}, "--inject 'here'", "jpeg");
  refuse({"sim", kScene, "--contact", "soft"}, "--contact 'soft'", "springs");
  refuse({"sim", kScene, "--inject", "markers", "--overlay", in("o.png")}, "--overlay", "--inject grey");
  refuse({"calibrate", kScene, "--fps", "25"}, "--fps", "no use to a scene");
  refuse({"calibrate", kScene, "--reference", "0"}, "--reference", "no use to a scene");
  refuse({"calibrate", in("gel"), "--fps", "25", "--to", "4490"}, "frame 4490", "the last");
  refuse({"calibrate", in("gel"), "--fps", "40"}, "'40' is no number from 12 to 32", "holdfast calibrate --help");
  refuse({"record", in("r.avi"), "--play", kScene}, "r.avi", "name end with .mcap");
  refuse(Words{"scene"}, "subcommand", "holdfast scene --help");
  refuse(Words{"scene", "frobnicate"}, "'frobnicate'", "holdfast scene --help");
  refuse({"scene", "list", in("gel")}, "gel", "tests/scenes");
  refuse({"scene", "describe", in("gel/0.png")}, "0.png", "Next:");
  refuse({"scene", "make", "bal", "translate_x", "slip"}, "'bal'", "ball");
  refuse({"scene", "make", "ball", "wave", "slip"}, "'wave'", "rotate_z");
  refuse({"scene", "make", "ball", "rotate_z", "drop"}, "'drop'", "static, slip, matched");
  const std::string markers = holdfast::test::source("toolchain/model/slip_v2.tree");
  write_file(dir / "no.csv", "source\n");
  refuse({"fuse", in("none.csv"), "--markers", markers, "--model", in("x.tree")}, "none.csv", "dataset --recordings");
  refuse({"fuse", in("no.csv"), "--markers", markers, "--model", in("x.tree")}, "no.csv", "Next:");
  refuse({"fuse", in("no.csv"), "--markers", in("none.tree"), "--model", in("x.tree")}, "none.tree", "model text");
  refuse({"fuse", in("no.csv"), "--markers", markers, "--model", in("no.csv")}, "no.csv",
         "--model would change an input");
  refuse(Words{"trade"}, "subcommand", "holdfast trade --help");
  refuse(Words{"trade", "sim"}, "SCENE", "holdfast trade sim --help");
  refuse({"trade", "sim", kScene, "--repeats", "0"}, "--repeats", "holdfast trade sim --help");
  refuse({"trade", "sim", kScene, "--reference-cell", "nan"}, "'nan' is no number from 0.2 to 1",
         "holdfast trade sim --help");
  refuse({"trade", "firmware", "--shard", "3/2"}, "'3/2'", "1/4, 2/4");
  refuse({"trade", "firmware", "--shard", "1/2", "--modes", in("x")}, "a piece has no table of modes", "trade show");
  refuse({"trade", "firmware", "--films", "7"}, "--films", "holdfast trade firmware --help");
  refuse({"trade", "firmware", "--csv", in("x"), "--modes", in("x")}, "x", "--csv and --modes");
  refuse({"trade", "firmware", "--csv", in("none/x.csv")}, "none/x.csv", "cannot be written");  // before it measures
  refuse(Words{"trade", "show"}, "CSV", "holdfast trade show --help");
  refuse({"trade", "show", in("none.csv")}, "none.csv", "trade firmware --csv");
  refuse({"trade", "show", in("no.csv")}, "no.csv:1", "no table of prices");
  refuse({"trade", "show", in("no.csv"), "--csv", in("no.csv")}, "no.csv", "would change a table");
  refuse({"sim", kScene, "--fps", "3"}, "'--fps'", "holdfast sim --help");
}

// One table on standard output, the summary beside it; a report would be in nobody's way there.
TEST(Tool, ATableCanGoToStandardOutput) {
  const std::string quick = holdfast::test::source("tests/scenes/shear_90.json");
  succeed({"sim", quick, "--inject", "markers", "--features", in("f.csv")});
  const Finished piped = succeed({"sim", quick, "--inject", "markers", "--features", "-"});
  CHECK(piped.out == read_file(dir / "f.csv"));
  STRCMP_CONTAINS("slip      raised", piped.err.c_str());
  CHECK(!fs::exists("-"));
  check_line(ask({"sim", kScene, "--features", "-", "--log", "-"}), "on standard output", "-",
             "each output a file of its own");
  check_line(ask({"sim", kScene, "--report", "-"}), "on standard output", "-", "standard output takes a table");
  check_line(ask({"sim", kScene, "--mcap", "-"}), "on standard output", "-", "standard output takes a table");
  const Finished full = test::run(
      {"sh", "-c", "exec \"$@\" > /dev/full", "sh", kTool, "sim", quick, "--inject", "markers", "--features", "-"});
  LONGS_EQUAL(1, full.status);
  check_line(full, "sim --features -", "-", "could not be written to its end");
  write_file(dir / "gel.mjpg", Film{}.stream(2));
  const Finished drawn = test::run({"sh", "-c", "exec \"$@\" > /dev/full", "sh", kTool, "replay", in("gel.mjpg"),
                                    "--overlay", in("o.png"), "--features", "-"});
  check_line(drawn, "replay --features -", "-", "could not be written to its end");
  CHECK_FALSE(fs::exists(dir / "o.png"));
}

// Whoever reads it has gone before the first line comes, as the end of a pipeline may.
TEST(Tool, AClosedPipeLeavesNothingBehind) {
  const std::string quick = holdfast::test::source("tests/scenes/shear_90.json");
  const std::string script =
      R"(gone=$1; shift; { until [ -e "$gone" ]; do sleep 0.01; done; "$@"; echo "status $?" >&2; } | )"
      R"({ exec <&-; : > "$gone"; })";
  const auto unread = [&](const Words& arguments) {
    Words command{"sh", "-c", script, "sh", in("gone"), kTool};
    command.insert(command.end(), arguments.begin(), arguments.end());
    Finished done = test::run(command);
    fs::remove(dir / "gone");
    return done;
  };
  fs::create_directory(dir / "out");
  for (const Words& table : {Words{"--features", "-"}, {"--markers", "-", "--features", in("out/f.csv")}}) {
    Words arguments{"sim", quick, "--inject", "markers", "--report", in("out/r.html"), "--mcap", in("out/a.mcap")};
    arguments.insert(arguments.end(), table.begin(), table.end());
    const Finished done = unread(arguments);
    STRCMP_CONTAINS("holdfast: -: could not be written to its end: who reads it went away", done.err.c_str());
    CHECK_TEXT(done.err.ends_with("\nstatus 1\n"), done.err.c_str());
    CHECK_TEXT(fs::is_empty(dir / "out"), joined(table).c_str());
  }
  // Of a plain table nobody needs to be told, and a file beside it is whole.
  STRCMP_EQUAL("status 1\n", unread({"trials", "closing", "--scene", "1"}).err.c_str());
  STRCMP_EQUAL("status 1\n", unread({"trials", "closing", "--count", "1", "--csv", in("out/t.csv")}).err.c_str());
  LONGS_EQUAL(1, std::distance(fs::directory_iterator(dir / "out"), {}));
  LONGS_EQUAL(1, read_csv(dir / "out/t.csv").rows.size());
}

// A limit of the shell on the size of files, where the system's own answer is to end the program.
TEST(Tool, SaysThatAFileMayNotGrow) {
  fs::create_directory(dir / "out");
  const Finished limited =
      test::run({"sh", "-c", "ulimit -f 16; exec \"$@\"", "sh", kTool, "sim", kScene, "--mcap", in("out/a.mcap")});
  LONGS_EQUAL(1, limited.status);
  check_line(limited, "--mcap", in("out/a.mcap"), "or ulimit -f forbids it; free some space and run again");
  CHECK(fs::is_empty(dir / "out"));
}

// Help, tables and summaries alike, be they larger than a buffer or not.
TEST(Tool, SaysThatStandardOutputIsFull) {
  for (const Words& arguments : {
           Words{"--version"},
           {"replay", "--help"},
           {"scene", "list", holdfast::test::source("tests/scenes")},
           {"scene", "describe", kScene},
           {"trade", "settings"},
           {"trials", "closing", "--scene", "1"},
       }) {
    Words command{"sh", "-c", "exec \"$@\" > /dev/full", "sh", kTool};
    command.insert(command.end(), arguments.begin(), arguments.end());
    const Finished full = test::run(command);
    LONGS_EQUAL_TEXT(1, full.status, joined(arguments).c_str());
    check_line(full, joined(arguments), "standard output", "Next: free some space");
  }
  const Finished both = test::run({"sh", "-c", "exec \"$@\" > /dev/full 2>&1", "sh", kTool, "replay", "--help"});
  LONGS_EQUAL(1, both.status);
}

TEST(Tool, SaysThatNoFrameCame) {
  write_file(dir / "off.json",
             R"({"schema_version": 1, "name": "off", "duration_s": 1, "level": {"inject": "grey"},)"
             R"( "trajectory": [{"t_s": 0}], "faults": [{"t_s": 0, "fault": "off", "frames": 100}]})");
  refused({"sim", in("off.json")}, "scene off: no frame came",
          "keep the camera off the whole time. Next: let 'faults'");
}

TEST(Tool, FeaturesHaveARowForEachFrame) {
  std::string damaged = Film{}.jpeg(2);
  damaged.replace(damaged.size() / 2, 600, 600, '\x55');  // a lost USB payload
  write_file(dir / "gel.mjpg", Film{}.stream(2) + damaged + Film{}.jpeg(3) + Film{}.jpeg(4));
  succeed({"replay", in("gel.mjpg"), "--features", in("f.csv"), "--markers", in("m.csv"), "--overlay", in("o.png"),
           "--report", in("r.html")});
  const Table features = read_csv(dir / "f.csv");
  STRCMP_EQUAL(kFeaturesHeader, features.header.c_str());
  LONGS_EQUAL(5, features.rows.size());
  for (std::size_t i = 0; i < features.rows.size(); ++i) {
    const Words& row = features.rows[i];
    LONGS_EQUAL(27, row.size());
    LONGS_EQUAL(i, std::stol(row[0]));
    DOUBLES_EQUAL(static_cast<double>(i) / 25, std::stod(row[1]), 1e-6);  // no time in the stream: 25 fps
    for (const std::size_t always : {2U, 3U, 9U, 10U}) CHECK(!row[always].empty());
    for (std::size_t figure = 4; figure < 9; ++figure) LONGS_EQUAL(i == 2, row[figure].empty());
    STRCMP_EQUAL(i == 2 ? "jpeg_damaged" : row[9] == "1" ? "slip" : "none", row[3].c_str());
    for (const std::size_t bit : {9U, 10U}) CHECK(row[bit] == "0" || row[bit] == "1");
    // The dots move, which is a contact once it has lasted; there is no relief.
    CHECK(row[11] == (i == 2 ? "" : i == 0 ? "0" : "1") || (i == 1 && row[11] == "0"));
    for (const std::size_t of_the_imprint : {12U, 13U, 14U}) CHECK(row[of_the_imprint].empty());
    for (std::size_t why = 15; why < 21; ++why) LONGS_EQUAL(i == 2, row[why].empty());
    for (const std::size_t force : {21U, 22U, 23U, 25U, 26U}) LONGS_EQUAL(i == 2, row[force].empty());
    STRCMP_EQUAL(i == 2 ? "" : "uncalibrated", row[26].c_str());
  }
  // All rows of markers too; those of the rejected frame say nothing.
  const Table markers = read_csv(dir / "m.csv");
  STRCMP_EQUAL(kMarkersHeader, markers.header.c_str());
  LONGS_EQUAL(5 * 63, markers.rows.size());
  for (std::size_t i = 0; i < markers.rows.size(); ++i) {
    const Words& row = markers.rows[i];
    LONGS_EQUAL(8, row.size());
    LONGS_EQUAL(i / 63, std::stoul(row[0]));
    LONGS_EQUAL(i % 63 / 9, std::stoul(row[1]));
    LONGS_EQUAL(i % 9, std::stoul(row[2]));
    STRCMP_EQUAL(i / 63 == 2 ? "0" : "1", row[3].c_str());
    for (std::size_t figure = 4; figure < 8; ++figure) LONGS_EQUAL(i / 63 == 2, row[figure].empty());
  }
  const cv::Mat overlay = sim::media().read(in("o.png"), cv::IMREAD_COLOR);
  CHECK(overlay.cols >= 320 && overlay.channels() == 3);
  const std::string report = read_file(dir / "r.html");
  CHECK(report.starts_with("<!") && report.find("</html>") != std::string::npos);
}

TEST(Tool, TimeIsThatOfFpsOrTheContainers) {
  write_gel_video(dir / "gel.avi", "MJPG", 4, 20);
  write_gel_video(dir / "gel.mkv", "FFV1", 4, 20);
  write_frames(dir / "gel", 4);
  struct {
    const char* input;
    const char* fps;
    double period_s;
    const char* note;
  } const cases[]{{"gel.avi", "", 0.05, ""}, {"gel.avi", "50", 0.02, "says 20 fps; played at 50, as --fps says"},
                  {"gel.mkv", "", 0.05, ""}, {"gel.mkv", "10", 0.1, "says 20 fps; played at 10, as --fps says"},
                  {"gel", "", 0.04, ""},     {"gel", "18.75", 1 / 18.75, ""}};
  for (const auto& c : cases) {
    Words arguments{"replay", in(c.input), "--features", in("f.csv")};
    if (*c.fps != '\0') arguments.insert(arguments.end(), {"--fps", c.fps});
    const Finished done = succeed(arguments);
    STRCMP_CONTAINS(c.note, done.err.c_str());
    LONGS_EQUAL_TEXT(*c.note != '\0', std::count(done.err.begin(), done.err.end(), '\n'), done.err.c_str());
    const Table table = read_csv(dir / "f.csv");
    LONGS_EQUAL(4, table.rows.size());
    // Matroska counts in whole milliseconds.
    for (int i = 0; i < 4; ++i)
      DOUBLES_EQUAL(i * c.period_s, std::stod(table.rows[static_cast<std::size_t>(i)][1]), 6e-4);
  }
}

namespace {

// Largest distance of a row's centre, and of its displacement, from the truth; in pixels of a picture of 320 columns.
// `rest`: the frame that the displacements refer to.
struct Worst {
  double centre_px = 0, displacement_px = 0, largest_true_px = 0;
};

Worst against_truth(const fs::path& csv, const Film& film, int frames, int rest = 0) {
  const Table table = read_csv(csv);
  const auto count = static_cast<std::size_t>(film.grid.rows * film.grid.cols);
  LONGS_EQUAL(static_cast<std::size_t>(frames) * count, table.rows.size());
  const auto home = film.dots(rest);
  const double to_320 = 320.0 / film.picture.width;
  Worst worst;
  for (std::size_t i = 0; i < table.rows.size(); ++i) {
    const Words& row = table.rows[i];
    const scene::PointPx dot = film.dots(std::stoi(row[0]))[i % count];
    const scene::PointPx at_rest = home[i % count];
    STRCMP_EQUAL("1", row[3].c_str());
    const auto off = [&](std::size_t x, double true_x, double true_y) {
      return to_320 * std::hypot(std::stod(row[x]) - true_x, std::stod(row[x + 1]) - true_y);
    };
    const double dx = dot.x - at_rest.x, dy = dot.y - at_rest.y;
    worst.centre_px = std::max(worst.centre_px, off(4, dot.x, dot.y));
    worst.displacement_px = std::max(worst.displacement_px, off(6, dx, dy));
    worst.largest_true_px = std::max(worst.largest_true_px, to_320 * std::hypot(dx, dy));
  }
  return worst;
}

}  // namespace

// The contract's pixels: those of the input, centre of the first pixel = 0, whatever the working image is. An error of
// half a pixel in any of the conversions between the 1/8 picture and the input would be 0.2-0.5 px here.
TEST(Tool, MarkersStandWhereTheDotsAre) {
  const Film small, medium = vga(), camera{scene::camera_3280x2464(), {}};
  write_gel_video(dir / "small.avi", "FFV1", 4);
  write_frames(dir / "medium", 4, medium);
  write_file(dir / "medium.mjpg", medium.stream(4));
  write_file(dir / "camera.mjpg", camera.stream(3));
  struct {
    const char* input;
    const Film& film;
    int frames;
    const char* mode;
  } const cases[]{{"small.avi", small, 4, "fast"},        {"medium", medium, 4, "fast"},
                  {"medium.mjpg", medium, 4, "fast"},     {"camera.mjpg", camera, 3, "fast"},
                  {"camera.mjpg", camera, 3, "balanced"}, {"camera.mjpg", camera, 3, "precise"}};
  for (const auto& c : cases) {
    succeed({"replay", in(c.input), "--mode", c.mode, "--markers", in("m.csv")});
    const Worst worst = against_truth(dir / "m.csv", c.film, c.frames);
    CHECK_TEXT(worst.centre_px <= 0.3, (c.input + (" " + std::to_string(worst.centre_px)) + " px").c_str());
    CHECK_TEXT(worst.displacement_px <= 0.3, (c.input + (" " + std::to_string(worst.displacement_px)) + " px").c_str());
    CHECK(worst.largest_true_px >= 3);  // or the check above would say nothing
  }
}

TEST(Tool, FindsTheLatticeByItself) {
  write_frames(dir / "usual", 3);
  write_frames(dir / "tall", 3, tall_gel());
  for (const auto& [input, grid, film] : {std::tuple{"usual", "9x7", Film{}}, {"tall", "8x10", tall_gel()}}) {
    for (const char* option : {"auto", grid}) {
      const Finished done = succeed({"replay", in(input), "--grid", option, "--markers", in("m.csv"), "--json"});
      STRCMP_EQUAL(grid, nlohmann::json::parse(done.out)["grid"].get<std::string>().c_str());
      const double worst_px = against_truth(dir / "m.csv", film, 3).centre_px;
      CHECK_TEXT(worst_px <= 0.3, (std::string(input) + " " + std::to_string(worst_px) + " px").c_str());
    }
  }
  refused({"replay", in("tall")}, in("tall"), "found 8x10");
}

// The top row's centres a quarter of a pitch below the picture's edge, the right column's a quarter left of it: their
// dots reach the edge. What stays is 8x6, and the summary, the JSON and the report name the rest.
TEST(Tool, NamesTheLinesThatThePictureCuts) {
  Film film;
  const double pitch_px = film.grid.pitch_mm * film.picture.px_per_mm;
  const std::vector<scene::PointPx> dots = film.dots(0);
  film.picture.center_y_px += pitch_px / 4 - dots.front().y;
  film.picture.center_x_px += film.picture.width - 1 - pitch_px / 4 - dots.back().x;
  write_frames(dir / "gel", 3, film);
  const std::string said = "the top row and the right column";
  for (const char* grid : {"auto", "9x7"}) {
    const Finished done = succeed({"replay", in("gel"), "--grid", grid, "--report", in("r.html")});
    STRCMP_CONTAINS(("8x6 kept; left out, because the picture's edge cuts it: " + said).c_str(), done.out.c_str());
    STRCMP_CONTAINS(said.c_str(), read_file(dir / "r.html").c_str());
    const auto json = nlohmann::json::parse(succeed({"replay", in("gel"), "--grid", grid, "--json"}).out);
    STRCMP_EQUAL("8x6", json["grid"].get<std::string>().c_str());
    CHECK(json["cut"] == nlohmann::json({{"top", 1}, {"bottom", 0}, {"left", 0}, {"right", 1}}));
  }
  write_frames(dir / "whole", 3);
  CHECK(succeed({"replay", in("whole"), "--grid", "auto"}).out.find("left out") == std::string::npos);
}

TEST(Tool, TakesTheReferenceThatIsGiven) {
  const Film small, medium = vga(), camera{scene::camera_3280x2464(), {}};
  write_frames(dir / "small", 4);
  write_file(dir / "medium.mjpg", medium.stream(4));
  write_frames(dir / "medium", 4, medium);
  write_file(dir / "camera.mjpg", camera.stream(2));
  test::write_picture(in("small.png"), small.grey(2));
  write_file(dir / "medium.jpg", medium.jpeg(2));
  test::write_picture(in("medium.png"), medium.grey(2));
  test::write_picture(in("camera.png"), camera.grey(0));
  struct {
    const char* input;
    const Film& film;
    int frames;
    std::string reference;
    int rest;
  } const cases[]{{"small", small, 4, "first", 0},
                  {"small", small, 4, "last", 3},
                  {"small", small, 4, "2", 2},
                  {"small", small, 4, in("small.png"), 2},
                  {"medium.mjpg", medium, 4, "last", 3},
                  {"medium.mjpg", medium, 4, in("medium.jpg"), 2},
                  {"medium.mjpg", medium, 4, in("medium.png"), 2},
                  {"medium", medium, 4, in("medium.jpg"), 2},
                  {"camera.mjpg", camera, 2, in("camera.png"), 0}};
  for (const auto& c : cases) {
    succeed({"replay", in(c.input), "--reference", c.reference, "--markers", in("m.csv")});
    const Worst worst = against_truth(dir / "m.csv", c.film, c.frames, c.rest);
    CHECK_TEXT(worst.displacement_px <= 0.3,
               (c.input + (" " + c.reference) + " " + std::to_string(worst.displacement_px) + " px").c_str());
  }
}

TEST(Tool, SimulatesAGraspAndSaysItTwiceTheSame) {
  std::map<std::string, std::string> first;
  for (int round = 0; round < 2; ++round) {
    const Finished done =
        succeed({"sim", kGreyScene, "--inject", "grey", "--truth", in("t.csv"), "--features", in("f.csv"), "--markers",
                 in("m.csv"), "--report", in("r.html"), "--overlay", in("o.png"), "--truth-markers", in("tm.csv")});
    STRCMP_EQUAL("", done.err.c_str());
    STRCMP_CONTAINS("GRIP_OK", done.out.c_str());
    for (const char* name : {"t.csv", "tm.csv", "f.csv", "m.csv", "r.html", "o.png"}) {
      const std::string text = read_file(dir / name);
      CHECK_TEXT(!text.empty(), name);
      if (round == 0) first[name] = text;
      CHECK_TEXT(first[name] == text, name);
    }
  }
  const auto frames = static_cast<std::size_t>(scene::frame_count(*scene::read_scene_file(kGreyScene).scene));
  LONGS_EQUAL(frames, read_csv(dir / "t.csv").rows.size());
  LONGS_EQUAL(frames * 63, read_csv(dir / "tm.csv").rows.size());
  LONGS_EQUAL(frames, read_csv(dir / "f.csv").rows.size());
  STRCMP_EQUAL(kFeaturesHeader, read_csv(dir / "f.csv").header.c_str());
}

TEST(Tool, ReplaysTheSameFileTwiceTheSame) {
  write_gel_video(dir / "gel.mp4", "mp4v", 6);
  write_file(dir / "gel.mjpg", Film{}.stream(6));
  for (const char* input : {"gel.mp4", "gel.mjpg"}) {
    std::map<std::string, std::string> first;
    for (int round = 0; round < 2; ++round) {
      first["out"] += succeed({"replay", in(input), "--json", "--features", in("f.csv"), "--markers", in("m.csv"),
                               "--report", in("r.html"), "--overlay", in("o.png")})
                          .out;
      for (const char* name : {"f.csv", "m.csv", "r.html", "o.png"}) {
        if (round == 0) first[name] = read_file(dir / name);
        CHECK_TEXT(first[name] == read_file(dir / name), name);
      }
    }
    const std::string& out = first["out"];
    CHECK(out.substr(0, out.size() / 2) == out.substr(out.size() / 2));
  }
}

TEST(Tool, JsonKeysStayAndHelpHasAnExample) {
  write_frames(dir / "gel", 2);
  const auto summary = nlohmann::json::parse(succeed({"replay", in("gel"), "--json"}).out);
  const std::set<std::string> expected{"accepted",       "cut",         "frames",        "grid",
                                       "grip_ok_frames", "lost_frames", "markers_least", "markers_mean",
                                       "not_ok_mostly",  "notes",       "reference",     "saturations",
                                       "searches",       "slip_frames", "slip_times_s"};
  std::set<std::string> keys;
  for (const auto& item : summary.items()) keys.insert(item.key());
  CHECK(keys == expected);
  LONGS_EQUAL(2, summary["frames"].get<int>());
  LONGS_EQUAL(2, summary["accepted"].get<int>());
  LONGS_EQUAL(63, summary["markers_least"].get<int>());
  LONGS_EQUAL(2, summary["grip_ok_frames"].get<int>());
  STRCMP_EQUAL("", summary["not_ok_mostly"].get<std::string>().c_str());
  for (const char* const list : {"slip_frames", "slip_times_s", "lost_frames", "notes"}) {
    CHECK_TEXT(summary[list].is_array(), list);
  }
  for (const Words& command :
       {Words{}, Words{"replay"}, Words{"sim"}, Words{"scene"}, Words{"scene", "check"}, Words{"scene", "list"},
        Words{"scene", "describe"}, Words{"scene", "make"}, Words{"trade"}, Words{"trade", "sim"},
        Words{"trade", "firmware"}, Words{"trade", "show"}, Words{"page"}, Words{"model"}, Words{"settings"},
        Words{"log"}}) {
    Words arguments = command;
    arguments.emplace_back("--help");
    const Finished help = succeed(arguments);
    STRCMP_EQUAL("", help.err.c_str());
    STRCMP_CONTAINS(("Example:\n  holdfast " + joined(command)).c_str(), help.out.c_str());
  }
}

TEST(Tool, WritesThePageOfALiveSession) {
  succeed({"page", in("live.html")});
  const std::string page = read_file(dir / "live.html");
  STRCMP_CONTAINS("<script type=\"application/json\" id=\"data\">null</script>", page.c_str());
  CHECK(page.ends_with("</script></body></html>\n"));
  const Words nowhere{"page", in("absent/live.html")};
  const std::string place = in("absent/live.html");
  check_line(ask(nowhere), joined(nowhere), place, "check the folder");
  const Words nothing{"page"};
  check_line(ask(nothing), joined(nothing), "FILE", "holdfast page --help");
}

TEST(Tool, LooksAtScenes) {
  const std::string folder = holdfast::test::source("tests/scenes");
  STRCMP_CONTAINS("sphere_slip.json", succeed({"scene", "list", folder}).out.c_str());
  STRCMP_CONTAINS("left out by level springs", succeed({"scene", "describe", kScene}).out.c_str());
  STRCMP_CONTAINS("1 scene checked: good", succeed({"scene", "check", "--strict", kScene}).out.c_str());
  // What `make` prints can be played, and a seed is a trial.
  const Words make{"scene", "make", "ball", "translate_x", "slip", "--seed", "7"};
  const std::string trial = succeed(make).out;
  CHECK(trial == succeed(make).out);
  write_file(dir / "trial.json", trial);
  succeed({"sim", in("trial.json"), "--truth", in("t.csv")});
  CHECK(!read_csv(dir / "t.csv").rows.empty());
  // An effect that nothing shows is said, and an error if asked for.
  std::string idle = read_file(kScene);
  const auto at = idle.find("\"jpeg\"");
  CHECK(at != std::string::npos);
  idle.replace(at, 6, "\"markers\"");
  write_file(dir / "idle.json", idle);
  STRCMP_CONTAINS("pixel_noise", succeed({"scene", "check", in("idle.json")}).err.c_str());
  LONGS_EQUAL(1, ask({"scene", "check", "--strict", in("idle.json")}).status);
}

TEST(Tool, PricesTheContactLevels) {
  const std::string scene = holdfast::test::source("tests/scenes/twist_to_gross.json");
  const Finished done = succeed({"trade", "sim", scene, "--reference-cell", "0.7", "--repeats", "1"});
  STRCMP_CONTAINS("springs 64", done.out.c_str());
  STRCMP_CONTAINS("grid 0.70 mm", done.out.c_str());
  STRCMP_CONTAINS("jpeg", done.out.c_str());
}

TEST(Tool, PricesASettingAndReadsTheTableOff) {
  const Finished piece = succeed({"trade", "firmware", "--shard", "1/60", "--films", "1", "--csv", in("part.csv")});
  STRCMP_CONTAINS("million instructions", piece.out.c_str());
  LONGS_EQUAL(1, read_csv(dir / "part.csv").rows.size());
  check_line(ask({"trade", "show", in("part.csv")}), "a piece alone", "mode balanced", "missing");
  const std::string table = holdfast::test::source("toolchain/trade/trade.csv");
  const Finished shown = succeed({"trade", "show", table, "--csv", in("whole.csv"), "--modes", in("modes.md")});
  STRCMP_CONTAINS("dominated: ", shown.out.c_str());
  CHECK(read_file(table) == read_file(dir / "whole.csv"));
  STRCMP_CONTAINS("| `balanced` |", read_file(dir / "modes.md").c_str());
}

// The bar appears because eight-megapixel pictures take more than a second; then the user has had enough.
TEST(Tool, ShowsABarOnATerminalAndLeavesNothingWhenStopped) {
  fs::create_directory(dir / "out");
  HostProcess tool(
      {"env", "NO_COLOR=1", kTool, "sim", kScene, "--features", in("out/f.csv"), "--report", in("out/r.html")},
      HostProcess::Stderr::kTerminal);
  CHECK(tool.err_says(" s left"));
  CHECK(!fs::is_empty(dir / "out"));  // the temporary files
  tool.send(SIGTERM);
  const Finished done = tool.finish();
  CHECK(done.in_time);
  LONGS_EQUAL(1, done.status);
  STRCMP_EQUAL("", done.out.c_str());
  CHECK(done.err.find('\033') == std::string::npos);
  STRCMP_CONTAINS("sim [", done.err.c_str());
  CHECK(
      done.err.ends_with("\rholdfast: interrupted. Likely cause: Ctrl-C. Next: run it again; nothing was written\r\n"));
  CHECK(fs::is_empty(dir / "out"));
}
