// SPDX-License-Identifier: Apache-2.0
#include "toolchain/session/report.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <sstream>

#include "drivers/sim/media.hpp"
#include "tests/support/temp_dir.hpp"
#include "toolchain/support/atomic_file.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace holdfast::tool;
using test::read_file;
using test::TempDir;
using test::write_file;

namespace {

// Walks tags as an XML parser does and returns what is wrong, or an empty text: every element is closed in
// order, attributes are quoted, names are names, text has no bare '<' or '&'. A script is text to its end, as in HTML.
std::string xml_fault(std::string_view html) {
  std::vector<std::string> open;
  std::size_t at = html.starts_with("<!doctype html>") ? 15 : 0;
  const auto near = [&] { return " near: " + std::string(html.substr(at, 60)); };
  while (at < html.size()) {
    if (html[at] == '&') {
      const std::size_t end = html.find(';', at);
      if (end == std::string_view::npos || end - at > 7) return "bare ampersand" + near();
      at = end + 1;
    } else if (html[at] != '<') {
      if (static_cast<unsigned char>(html[at]) < 0x20 && html[at] != '\n' && html[at] != '\t')
        return "control" + near();
      ++at;
    } else if (html.substr(at, 2) == "</") {
      const std::size_t end = html.find('>', at);
      const std::string name(html.substr(at + 2, end - at - 2));
      if (open.empty() || open.back() != name) return "closes " + name + near();
      open.pop_back();
      at = end + 1;
    } else {
      std::size_t i = at + 1;
      while (i < html.size() && std::isalnum(static_cast<unsigned char>(html[i])) != 0) ++i;
      const std::string name(html.substr(at + 1, i - at - 1));
      if (name.empty()) return "no name" + near();
      bool self_closed = false;
      for (;;) {
        while (i < html.size() && std::isspace(static_cast<unsigned char>(html[i])) != 0) ++i;
        if (i >= html.size()) return "unfinished tag" + near();
        if (html[i] == '>') break;
        if (html.substr(i, 2) == "/>") {
          self_closed = true;
          ++i;
          break;
        }
        const std::size_t equals = html.find('=', i);
        if (equals == std::string_view::npos || html.substr(equals, 2) != "=\"") return "unquoted" + near();
        const std::size_t end = html.find('"', equals + 2);
        if (end == std::string_view::npos) return "open quote" + near();
        if (html.substr(equals + 2, end - equals - 2).find('<') != std::string_view::npos) return "< in value" + near();
        i = end + 1;
      }
      if (!self_closed) open.push_back(name);
      at = i + 1;
      if (name == "script") at = std::min(html.find("</script", at), html.size());
    }
  }
  return open.empty() ? "" : "left open: " + open.back();
}

// The page as a reader without a script has it.
std::string without_script_parts(const std::string& html) {
  const std::size_t from = html.find(R"(<section class="session" id="session")");
  const std::size_t to = html.find("</section>", from);
  CHECK(from != std::string::npos && to != std::string::npos);
  return html.substr(0, from) + html.substr(to, html.find("<script") - to);
}

std::size_t count(std::string_view text, std::string_view what) {
  std::size_t n = 0;
  for (std::size_t at = text.find(what); at != std::string_view::npos; at = text.find(what, at + 1)) ++n;
  return n;
}

std::vector<Arrow> arrows(double dx_px, bool all_valid = true) {
  std::vector<Arrow> out;
  for (int row = 0; row < 7; ++row) {
    for (int col = 0; col < 9; ++col) {
      out.push_back({30.0 + 32 * col + dx_px, 24.0 + 32 * row, dx_px, 0, all_valid || col != 3});
    }
  }
  return out;
}

// 25 fps; slips from frame `slip_from` for 50 frames.
FrameRecord frame(long number, long slip_from) {
  FrameRecord f;
  f.frame = static_cast<std::uint32_t>(number);
  f.set_time(0.04 * static_cast<double>(number));
  f.accepted = f.features_valid = f.rates_valid = number > 4;
  f.slip = number >= slip_from && number < slip_from + 50;
  f.state = number <= 4 ? DeviceState::kReference : f.slip ? DeviceState::kSlip : DeviceState::kOk;
  f.reason = f.slip ? Reason::kSlipDetected : Reason::kNone;
  f.grip_ok = f.state == DeviceState::kOk;
  f.markers = number == 30 ? 59U : 63U;
  f.entropy_nat = 1 + std::sin(0.01 * static_cast<double>(number));
  f.entropy_rate_nat_s = std::cos(0.37 * static_cast<double>(number));
  f.vx_mm_s = std::sin(0.11 * static_cast<double>(number));
  f.histogram[1] = f.markers;
  return f;
}

Report report_of(long frames, long slip_from) {
  Report report;
  for (long i = 0; i < frames; ++i) report.add(frame(i, slip_from), arrows(0.01 * static_cast<double>(i)));
  return report;
}

void check_well_formed(const std::string& html) {
  STRCMP_EQUAL("", xml_fault(html).c_str());
}

}  // namespace

TEST_GROUP(Report) {
  ReportInfo info;
  void setup() override {
    info.title = "Run";
  }
};

TEST(Report, TheCheckerOfTheseTestsSeesFaults) {
  for (const char* bad : {"<a><b></a></b>", "<a>", "a & b", "<a x=1/>", "<a x=\"1/>", "a < b", "</a>", "\x01"}) {
    CHECK_TEXT(!xml_fault(bad).empty(), bad);
  }
  STRCMP_EQUAL("", xml_fault("<a x=\"1\"><b/>&amp;</a>").c_str());
}

TEST(Report, IsOneWellFormedFileThatNeedsNothingElse) {
  info.marks = {{3.9, "shear", false}, {7.96, "gross slip", true}};
  info.series = TruthSeries{"slipping share", "1", {{0, 0}, {8, 0.5}, {11, 1}}};
  const std::string html = report_of(300, 200).html(info);
  check_well_formed(html);
  for (const char* outside : {"http:", "https:", "src=", "href=", "@import", "url("}) {
    CHECK_TEXT(html.find(outside) == std::string::npos, outside);
  }
  STRCMP_CONTAINS("default-src 'none'", html.c_str());  // and the browser is told so
  for (const char* needed : {"Entropy E", "GRIP_OK", "ALIVE", "slipping share", "shear", "prefers-color-scheme:dark"}) {
    CHECK_TEXT(html.find(needed) != std::string::npos, needed);
  }
  const std::string plain = without_script_parts(html);
  LONGS_EQUAL(1, count(plain, "<svg"));  // the plots
  CHECK(plain.find("nan") == std::string::npos && plain.find("inf\"") == std::string::npos);
}

TEST(Report, SaysHowLongAfterTheOnsetSlipWasRaised) {
  info.marks = {{7.93, "gross slip", true}};  // between frames 198 and 199
  STRCMP_CONTAINS("Slip raised 1 frame (70 ms) after gross slip", report_of(300, 200).html(info).c_str());
  STRCMP_CONTAINS("No alarm before it", report_of(300, 200).html(info).c_str());
  info.marks[0].t_s = 8.0;
  STRCMP_CONTAINS("in the first frame of gross slip", report_of(300, 200).html(info).c_str());
  STRCMP_CONTAINS("already raised at gross slip", report_of(300, 180).html(info).c_str());
  STRCMP_CONTAINS("1 alarm before it", report_of(300, 180).html(info).c_str());
  STRCMP_CONTAINS("not raised after gross slip", report_of(300, 1000).html(info).c_str());
  info.marks.clear();
  STRCMP_CONTAINS("Slip raised once, first at 8.000 s", report_of(300, 200).html(info).c_str());
  STRCMP_CONTAINS("No slip raised", report_of(300, 1000).html(info).c_str());
}

TEST(Report, SumsUpTheRun) {
  info.saturations = 17;
  const std::string html = report_of(300, 200).html(info);
  STRCMP_CONTAINS("295 (98.3 %)", html.c_str());
  STRCMP_CONTAINS("mean 62.99 of 63, worst 59 in frame 30", html.c_str());
  STRCMP_CONTAINS("8.000 s (frame 200)", html.c_str());
  STRCMP_CONTAINS("<th>Saturated values</th><td>17</td>", html.c_str());
  STRCMP_CONTAINS("the object slips", html.c_str());  // the table of reasons
}

TEST(Report, EscapesEveryText) {
  const std::string evil = "<b>\"x\" & 'y'</b>\x01";
  for (auto field : {&ReportInfo::title, &ReportInfo::input, &ReportInfo::grid, &ReportInfo::mode, &ReportInfo::model,
                     &ReportInfo::reference})
    info.*field = evil;
  info.notes = {evil};
  info.marks = {{1, evil, true}};
  info.series = TruthSeries{evil, evil, {{0, 0}, {1, 1}}};
  const std::string html = report_of(60, 30).html(info);
  check_well_formed(html);
  CHECK(html.find("<b>\"x\"") == std::string::npos);
  STRCMP_CONTAINS("&lt;b&gt;&quot;x&quot; &amp; &#39;y&#39;", html.c_str());
}

TEST(Report, StaysSmallForLongRuns) {
  Report report;
  for (long i = 0; i < 100'000; ++i) {
    FrameRecord f = frame(i, 1'000'000);
    f.entropy_nat = i == 54'321 ? 2.7 : 0.1;
    f.slip = i == 77'777;
    f.grip_ok = i % 2 == 0;  // the worst case for runs of equal columns
    f.state = i == 77'777 ? DeviceState::kSlip : i / 100 % 2 == 0 ? DeviceState::kOk : DeviceState::kDegraded;
    report.add(f, arrows(1));
  }
  const std::string html = report.html(info);
  check_well_formed(html);
  CHECK(html.size() < 4'000'000);
  CHECK(without_script_parts(html).size() < 20'000);
}

TEST(Report, BoundsPicturesAndMarkersAndKeepsTheFramesOfEvents) {
  // Noise: the dearest picture there is.
  std::vector<std::uint8_t> pixels(410U * 308U);
  std::uint32_t state = 1;
  for (std::uint8_t& pixel : pixels)
    pixel = static_cast<std::uint8_t>((state = state * 1'664'525 + 1'013'904'223) >> 24);
  Report report;
  for (long i = 0; i < 3000; ++i) {
    report.add(frame(i, 1111), arrows(1), {{pixels.data(), 410, 308, 410}, 3280, 2464});
  }
  const std::string html = report.html(info);
  check_well_formed(html);
  CHECK(html.size() < 4'000'000);
}

TEST(Report, NoNameEndsTheScript) {
  info.marks = {{1, "</script><b>", true}};
  const std::string html = report_of(60, 30).html(info);
  check_well_formed(html);
  LONGS_EQUAL(2, count(html, "</script>"));
}

TEST(Report, SurvivesExtremes) {
  check_well_formed(Report().html(info));
  check_well_formed(report_of(1, 0).html(info));
  check_well_formed(report_of(2, 1).html(info));
  Report bare;  // nothing valid, no arrows, time stands still
  for (int i = 0; i < 5; ++i) {
    FrameRecord f;
    f.state = DeviceState::kFault;
    f.reason = Reason::kNoLattice;
    bare.add(f, {});
  }
  info.marks = {{-1, "before", true}, {1e9, "after", true}};
  const std::string html = bare.html(info);
  check_well_formed(html);
  CHECK(without_script_parts(html).find("nan") == std::string::npos);
  Report constant;
  for (long i = 0; i < 5; ++i) {
    FrameRecord f = frame(i + 5, 100);
    f.entropy_nat = f.entropy_rate_nat_s = f.vx_mm_s = -1e-12;
    f.histogram.fill(0);
    constant.add(f, arrows(1e-9, false));
  }
  check_well_formed(constant.html(info));
}

TEST_GROUP(AtomicFile) {
  TempDir dir;
  [[nodiscard]] std::size_t files() const {
    return static_cast<std::size_t>(std::distance(std::filesystem::directory_iterator(dir.path()), {}));
  }
};

TEST(AtomicFile, AppearsOnCommitOnly) {
  const auto path = dir / "out.csv";
  write_file(path, "old");
  {
    AtomicFile file(path);
    STRCMP_EQUAL("", file.error().c_str());
    file.stream() << "new";
    file.stream().flush();
    STRCMP_EQUAL("old", read_file(path).c_str());
    LONGS_EQUAL(2, files());
  }
  LONGS_EQUAL(1, files());
  STRCMP_EQUAL("old", read_file(path).c_str());
  {
    AtomicFile file(path);
    file.stream() << "new";
    STRCMP_EQUAL("", file.commit().c_str());
  }
  LONGS_EQUAL(1, files());
  STRCMP_EQUAL("new", read_file(path).c_str());
}

TEST(AtomicFile, RefusesInOneLineAndLeavesNothing) {
  write_file(dir / "input.avi", "frames");
  struct Case {
    std::filesystem::path path;
    const char* what;
  };
  const Case cases[] = {{dir / "absent/out.html", "No such file"},
                        {dir / "input.avi/out.html", "Not a directory"},
                        {dir.path(), "folder"},
                        {"/dev/null", "device"}};
  for (const Case& c : cases) {
    AtomicFile file(c.path);
    STRCMP_CONTAINS(c.what, file.error().c_str());
    STRCMP_CONTAINS(c.path.string().c_str(), file.error().c_str());
    file.stream() << "x";
    STRCMP_EQUAL(file.error().c_str(), file.commit().c_str());
    CHECK(file.error().find('\n') == std::string::npos);
    LONGS_EQUAL(1, files());
  }
  STRCMP_EQUAL("frames", read_file(dir / "input.avi").c_str());
  CHECK(std::filesystem::is_character_file("/dev/null"));
}

TEST(AtomicFile, ALinkStaysALink) {
  namespace fs = std::filesystem;
  for (const fs::path& target : {fs::path(dir / "there.csv"), fs::path("not_yet.csv")}) {
    const fs::path link = dir / ("to_" + target.filename().string());
    if (target.is_absolute()) write_file(target, "old");
    fs::create_symlink(target, link);
    AtomicFile file(link);
    file.stream() << "new";
    STRCMP_EQUAL("", file.commit().c_str());
    CHECK(fs::is_symlink(link));
    STRCMP_EQUAL("new", read_file(dir / target.filename().string()).c_str());
  }
  LONGS_EQUAL(4, files());
}

TEST(AtomicFile, AFullDiskIsAnErrorAndLeavesNothing) {
  AtomicFile file(dir / "out.csv");
  file.stream().setstate(std::ios::badbit);  // what a failed write leaves
  STRCMP_CONTAINS("disk is full", file.commit().c_str());
  CHECK_FALSE(std::filesystem::exists(dir / "out.csv"));
}

TEST(AtomicFile, GoesOnFromWhereItIsCut) {
  AtomicFile file(dir / "out.csv");
  file.stream() << "kept and lost" << std::flush;
  file.stream().setstate(std::ios::badbit);
  CHECK(file.cut(5));
  file.stream() << "more";
  STRCMP_EQUAL("", file.commit().c_str());
  STRCMP_EQUAL("kept more", read_file(dir / "out.csv").c_str());
}

TEST(AtomicFile, OfSeveralNoneIsAnInputOrAnother) {
  namespace fs = std::filesystem;
  write_file(dir / "input.avi", "frames");
  fs::create_symlink(dir / "input.avi", dir / "link.avi");
  fs::create_directory(dir / "pictures");
  struct Case {
    fs::path path;
    const char* what;
  };
  const Case cases[] = {{dir / "input.avi", "--csv would change an input of this run"},
                        {dir / "link.avi", "--csv would change an input of this run"},
                        {dir / "pictures/new.csv", "--csv would change the folder that is an input of this run"},
                        {dir / "first.csv", "given for both --first and --csv"},
                        {dir / "absent/out.csv", "No such file"}};
  for (const Case& c : cases) {
    OutputFiles outputs({{"--first", dir / "first.csv"}, {"--csv", c.path}}, {dir / "pictures", "", dir / "input.avi"});
    STRCMP_CONTAINS(c.what, outputs.error().c_str());
    STRCMP_CONTAINS(c.path.string().c_str(), outputs.error().c_str());
    CHECK(outputs.error().find('\n') == std::string::npos);
    STRCMP_EQUAL(outputs.error().c_str(), outputs.commit().c_str());
  }
  LONGS_EQUAL(3, files());
  STRCMP_EQUAL("frames", read_file(dir / "input.avi").c_str());
}

TEST(AtomicFile, OfSeveralAllAppearOrNone) {
  const auto write = [&](std::ios::iostate second) {
    OutputFiles outputs({{"--a", dir / "a"}, {"--b", dir / "b"}, {"--c", ""}});
    *outputs.stream("--a") << "whole";
    outputs.stream("--b")->setstate(second);
    POINTERS_EQUAL(nullptr, outputs.stream("--c"));
    return outputs.commit();
  };
  STRCMP_CONTAINS("disk is full", write(std::ios::badbit).c_str());
  LONGS_EQUAL(0, files());
  STRCMP_EQUAL("", write(std::ios::goodbit).c_str());
  LONGS_EQUAL(2, files());
  STRCMP_EQUAL("whole", read_file(dir / "a").c_str());
}

TEST_GROUP(Overlay) {
  TempDir dir;
};

TEST(Overlay, DrawsYellowArrowsFromRestAndRedCrosses) {
  for (const int type : {CV_8UC1, CV_8UC3}) {
    const cv::Mat grey(240, 320, type, cv::Scalar::all(128));
    const Arrow list[] = {{100, 100, 20, 0, true}, {200, 100, 20, 0, false}};
    std::ostringstream png;
    STRCMP_EQUAL("", write_overlay(png, grey, list, 2).c_str());
    write_file(dir / "o.png", png.str());
    const cv::Mat drawn = sim::media().read(dir / "o.png", cv::IMREAD_COLOR);
    LONGS_EQUAL(960, drawn.cols);
    LONGS_EQUAL(720, drawn.rows);
    // Rest at x = 80, tip at 80 + 2 * 20 = 120: on the shaft there is yellow, beyond the tip there is the picture.
    const auto at = [&](double x, double y) {
      return drawn.at<cv::Vec3b>(static_cast<int>(3 * y + 1), static_cast<int>(3 * x + 1));
    };
    for (const double x : {82.0, 90.0, 110.0, 118.0}) {
      CHECK(at(x, 100)[2] > 200 && at(x, 100)[1] > 180 && at(x, 100)[0] < 100);
    }
    CHECK(at(124, 100) == cv::Vec3b(128, 128, 128));
    CHECK(at(76, 100) == cv::Vec3b(128, 128, 128));
    CHECK(at(200, 100)[2] > 180 && at(200, 100)[1] < 100);  // the cross, where the marker should be
    CHECK(at(190, 100) == cv::Vec3b(128, 128, 128));        // and no arrow
  }
}

TEST(Overlay, SaysWhatIsWrongAndWritesNothing) {
  std::ostringstream png;
  CHECK(!write_overlay(png, cv::Mat(), {}, 1).empty());
  CHECK(png.str().empty());
}
