// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/recording.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cstdlib>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <random>

#include "drivers/sim/camera_replay.hpp"
#include "drivers/sim/container.hpp"
#include "tests/support/pictures.hpp"
#include "tests/support/temp_dir.hpp"
#include "vision/luma.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using namespace std::chrono_literals;
using sim::Error;
using sim::Read;
using sim::RecordedFrame;
using sim::Recording;
using sim::Result;
using test::read_file;
using test::TempDir;
using test::write_file;

namespace {

// Smooth coloured noise: each picture differs from all others, and codecs keep it close.
cv::Mat picture(int number, int width = 320, int height = 240, int channels = 3) {
  cv::Mat image(height, width, CV_MAKETYPE(CV_8U, channels));
  cv::RNG rng(static_cast<std::uint64_t>(number) + 1);
  rng.fill(image, cv::RNG::UNIFORM, 0, 255);
  cv::GaussianBlur(image, image, cv::Size(15, 15), 5);
  cv::normalize(image, image, 0, 255, cv::NORM_MINMAX);
  return image;
}

std::string jpeg(int number, int width = 320, int height = 240) {
  std::vector<std::uint8_t> bytes;
  (void)sim::media().encode(".jpg", picture(number, width, height), bytes, {cv::IMWRITE_JPEG_RST_INTERVAL, number % 3});
  return {bytes.begin(), bytes.end()};
}

std::string text(const RecordedFrame& frame) {
  return {frame.bytes.begin(), frame.bytes.end()};
}

std::string little_endian(std::uint32_t value) {
  std::string out;
  for (int i = 0; i < 4; ++i) out += static_cast<char>(value >> (8 * i) & 0xFF);
  return out;
}

std::string chunk(const std::string& tag, const std::string& body) {
  return tag + little_endian(static_cast<std::uint32_t>(body.size())) + body + std::string(body.size() & 1, '\0');
}

// An AVI written by the book (Microsoft's AVI RIFF reference): audio stream first, video second, so "01dc".
std::string avi(const std::vector<std::string>& frames, std::uint32_t rate, std::uint32_t scale, bool in_rec = false) {
  const auto count = static_cast<std::uint32_t>(frames.size());
  const auto stream = [&](const std::string& kind, const std::string& codec, const std::string& format) {
    std::string strh = kind + codec;
    for (std::uint32_t v : {0u, 0u, 0u, scale, rate, 0u, count, 0u, 0u, 0u}) strh += little_endian(v);
    return chunk("LIST", "strl" + chunk("strh", strh + std::string(8, '\0')) + chunk("strf", format));
  };
  std::string bitmap;
  for (std::uint32_t v : {40u, 320u, 240u, 0x180001u}) bitmap += little_endian(v);
  bitmap += "MJPG" + std::string(20, '\0');
  std::string pcm;
  for (std::uint32_t v : {0x10001u, 8000u, 8000u, 0x80001u}) pcm += little_endian(v);
  const std::string header =
      chunk("LIST", "hdrl" + chunk("avih", std::string(56, '\0')) + stream("auds", std::string(4, '\0'), pcm) +
                        stream("vids", "MJPG", bitmap));
  std::string movi = "movi";
  for (const std::string& frame : frames) {
    const std::string pair = chunk("00wb", "abc") + chunk("01dc", frame);
    movi += in_rec ? chunk("LIST", "rec " + pair) : pair;
  }
  return chunk("RIFF", "AVI " + header + chunk("JUNK", "xyz") + chunk("LIST", movi));
}

void write_video(const std::filesystem::path& path, const char* fourcc, int frames, int api = cv::CAP_FFMPEG,
                 cv::Size size = {320, 240}, double fps = 25) {
  const auto writer = test::film_writer(path, fourcc, fps, size, api);
  CHECK_TEXT(writer->isOpened(), "OpenCV cannot write this video here");
  for (int i = 0; i < frames; ++i) writer->write(picture(i, size.width, size.height));
}

Recording opened(const std::filesystem::path& path, sim::RecordingOptions options = {}) {
  Result<Recording> result = Recording::open(path, options);
  if (auto* error = std::get_if<Error>(&result)) FAIL(error->line.c_str());
  return std::move(std::get<Recording>(result));
}

std::vector<RecordedFrame> all_frames(Recording& recording) {
  std::vector<RecordedFrame> frames;
  RecordedFrame frame;
  while (recording.next(frame) == Read::kFrame) frames.push_back(frame);
  STRCMP_EQUAL("", recording.error().c_str());
  return frames;
}

template <typename T>
std::string line_of(const Result<T>& result) {
  const auto* error = std::get_if<Error>(&result);
  return error != nullptr ? error->line : "";
}

// What the error contract asks of a line: one line that starts with the file and gives cause and next step.
template <typename T>
void check_refused(const Result<T>& result, const std::filesystem::path& path, const char* what) {
  const std::string line = line_of(result);
  CHECK_TEXT(!line.empty(), (path.string() + " was not refused").c_str());
  STRCMP_CONTAINS(path.string().c_str(), line.c_str());
  STRCMP_CONTAINS(what, line.c_str());
  STRCMP_CONTAINS(": ", line.substr(path.string().size() + 2).c_str());
  STRCMP_CONTAINS("; ", line.c_str());
  CHECK(line.find('\n') == std::string::npos);
}

}  // namespace

TEST_GROUP(Recording) {
  TempDir dir;
};

TEST(Recording, GivesMjpegInAviByteForByteForBothOfOpenCvsWriters) {
  for (const int api : {cv::CAP_FFMPEG, cv::CAP_OPENCV_MJPEG}) {
    const auto path = dir / (std::to_string(api) + ".avi");
    write_video(path, "MJPG", 12, api);
    Recording recording = opened(path);
    CHECK(recording.info().mjpeg);
    LONGS_EQUAL(12, recording.info().frames);
    LONGS_EQUAL(320, recording.info().width);
    LONGS_EQUAL(240, recording.info().height);
    DOUBLES_EQUAL(25, recording.info().fps, 0);
    const auto frames = all_frames(recording);
    LONGS_EQUAL(12, frames.size());

    const auto raw = test::film_reader(path);  // the independent reader
    CHECK(raw->set(cv::CAP_PROP_FORMAT, -1));
    for (const RecordedFrame& frame : frames) {
      cv::Mat packet;
      CHECK(raw->read(packet));
      CHECK(frame.bytes == std::vector<std::uint8_t>(packet.datastart, packet.dataend));
      CHECK_FALSE(frame.damaged);
      CHECK(frame.time == frame.index * 40ms);
    }
  }
}

TEST(Recording, KeepsThePlaceInTimeOfDroppedAviFrames) {
  for (const bool in_rec : {false, true}) {
    const auto path = dir / "dropped.avi";
    write_file(path, avi({"", jpeg(1), "", "", jpeg(2), jpeg(3)}, 75, 4, in_rec));  // 18.75 fps
    Recording recording = opened(path);
    DOUBLES_EQUAL(18.75, recording.info().fps, 1e-12);
    const auto frames = all_frames(recording);
    LONGS_EQUAL(3, frames.size());
    CHECK(text(frames[0]) == jpeg(1) && text(frames[1]) == jpeg(2) && text(frames[2]) == jpeg(3));
    LONGS_EQUAL(0, frames[0].time.count());
    LONGS_EQUAL(160000, frames[1].time.count());  // three places later
    LONGS_EQUAL(213333, frames[2].time.count());
    LONGS_EQUAL(1, frames[0].sequence);
    LONGS_EQUAL(4, frames[1].sequence);
    // Another rate than the container's: the gap stays three places long.
    Recording faster = opened(path, {.fps = 25});
    DOUBLES_EQUAL(18.75, faster.info().fps, 1e-12);
    DOUBLES_EQUAL(25, faster.info().time_base_fps, 0);
    const auto again = all_frames(faster);
    LONGS_EQUAL(120000, again[1].time.count());
    LONGS_EQUAL(160000, again[2].time.count());
    LONGS_EQUAL(1, frames[1].index);
  }
}

TEST(Recording, GivesMjpegInMatroskaByteForByteWithTheContainersTimes) {
  const auto path = dir / "clip.mkv";
  write_video(path, "MJPG", 8, cv::CAP_FFMPEG, {320, 240}, 20);
  Recording recording = opened(path);
  CHECK(recording.info().mjpeg);
  const auto frames = all_frames(recording);
  LONGS_EQUAL(8, frames.size());
  const std::string file = read_file(path);
  for (const RecordedFrame& frame : frames) {
    CHECK(file.find(text(frame)) != std::string::npos);  // each packet lies in the file as it is
    CHECK(frame.time == frame.index * 50ms);
  }
}

TEST(Recording, SplitsAStreamWithGarbageBetweenAndATruncatedEnd) {
  const std::string last = jpeg(4);
  const std::string cut = last.substr(0, last.size() * 2 / 3);
  const std::string thumbnail = jpeg(9, 80, 60);  // a picture inside an APP1 segment is not a picture of its own
  const std::string app1 = "\xFF\xE1" + std::string(1, static_cast<char>((thumbnail.size() + 2) >> 8)) +
                           std::string(1, static_cast<char>((thumbnail.size() + 2) & 0xFF)) + thumbnail;
  const std::string second = "\xFF\xD8" + app1 + jpeg(2).substr(2);
  const auto path = dir / "stream.mjpg";
  write_file(path, "garbage\xFF\xD8 \xFF" + jpeg(1) + std::string("\0\xFF\0\r\n--frame", 12) + second + jpeg(3) + cut);
  Recording recording = opened(path, {.fps = 15});
  CHECK(recording.info().mjpeg);
  LONGS_EQUAL(-1, recording.info().frames);
  DOUBLES_EQUAL(0, recording.info().fps, 0);
  const auto frames = all_frames(recording);
  LONGS_EQUAL(4, frames.size());
  CHECK(text(frames[0]) == jpeg(1));
  CHECK(text(frames[1]) == second);
  CHECK(text(frames[2]) == jpeg(3));
  CHECK(text(frames[3]) == cut);
  LONGS_EQUAL(320, frames[1].width);
  CHECK(!frames[0].damaged && !frames[1].damaged && !frames[2].damaged && frames[3].damaged);
  LONGS_EQUAL(200000, frames[3].time.count());  // 3 / 15 fps
}

// Pictures that carry stamps, one behind the other in a file that somebody else can read.
Recording stamped(const std::filesystem::path& path, const std::vector<std::chrono::microseconds>& times) {
  std::string bytes;
  std::vector<sim::StampedPicture> pictures;
  for (std::size_t i = 0; i < times.size(); ++i) {
    const std::string one = jpeg(static_cast<int>(i), 100, 80);
    pictures.push_back({bytes.size(), one.size(), times[i]});
    bytes += one;
  }
  write_file(path, bytes);
  return opened(path, {.pictures = std::make_shared<const std::vector<sim::StampedPicture>>(std::move(pictures))});
}

// A stamp that runs backwards, stands still or jumps is what the camera or the recorder did. Times count from the
// first.
TEST(Recording, KeepsEveryStampAsItIs) {
  const std::vector<std::chrono::microseconds> times{7s,        7s + 40ms, 7s + 80ms, 7s + 60ms,
                                                     7s + 60ms, 6s + 10ms, 9h,        7s + 120ms};
  Recording recording = stamped(dir / "log", times);
  const auto frames = all_frames(recording);
  LONGS_EQUAL(times.size(), frames.size());
  for (std::size_t i = 0; i < times.size(); ++i) CHECK(frames[i].time == times[i] - 7s);
}

TEST(Recording, ALostMiddleDamagesOnePictureAndNotTheNext) {
  for (std::size_t eighth = 1; eighth < 8; ++eighth) {
    const std::string whole = jpeg(1);
    const std::string torn = whole.substr(0, whole.size() * eighth / 8);
    write_file(dir / "torn.mjpg", jpeg(0) + torn + jpeg(2));
    Recording recording = opened(dir / "torn.mjpg");
    const auto frames = all_frames(recording);
    CHECK(frames.size() >= 3);  // a torn APPn or table segment may fall into pieces
    CHECK(text(frames.front()) == jpeg(0));
    CHECK(text(frames.back()) == jpeg(2));
    CHECK(frames[1].damaged);
  }
}

TEST(Recording, SplitterEndsAndStaysInsideForRandomBytes) {
  std::mt19937 random(1);
  const std::string good = jpeg(1, 64, 48);
  for (int round = 0; round < 2000; ++round) {
    std::string bytes = good + good;
    for (unsigned i = 0; i < 1 + random() % 8; ++i) bytes[random() % bytes.size()] = static_cast<char>(random());
    bytes.resize(random() % (bytes.size() + 1));
    const std::vector<std::uint8_t> exact(bytes.begin(), bytes.end());  // exact size: ASan sees any overrun
    std::size_t at = 0;
    while (const auto extent = sim::find_jpeg(exact, at)) {
      CHECK(extent->begin >= at && extent->end > extent->begin && extent->end <= exact.size());
      at = extent->end;
    }
  }
}

// Each of the pictures that hide in the segments leads through all that follow it. Walked to the end again for each of
// them, these files take a minute.
TEST(Recording, SplitterWalksNoBytesAgainAndAgain) {
  const auto pictures_of = [](const std::vector<std::uint8_t>& bytes) {
    std::size_t count = 0;
    std::size_t at = 0;
    while (const auto extent = sim::find_jpeg(bytes, at)) {
      CHECK(!extent->complete);
      at = extent->end;
      ++count;
    }
    return count;
  };
  constexpr std::size_t kHidden = 100'000;
  std::vector<std::uint8_t> bytes{0xFF, 0xD8};
  const auto add = [&](std::initializer_list<int> more) { bytes.insert(bytes.end(), more.begin(), more.end()); };
  for (std::size_t k = 0; k < kHidden; ++k) add({0xFF, 0xE0, 0, 8, 0xFF, 0xD8, 0xFF, 0xE0, 0, 2});
  for (const auto& end : {std::initializer_list<int>{0xFF, 0}, {0xFF, 0xE0, 0, 2}, {}}) {
    const std::size_t size = bytes.size();
    add(end);
    LONGS_EQUAL(kHidden + 1, pictures_of(bytes));
    bytes.resize(size);
  }
  // Each leads to the same coded data, whose end is none.
  bytes.assign({0xFF, 0xD8});
  constexpr std::size_t kMost = 65'528;
  add({0xFF, 0xE0, (kMost + 2) >> 8, (kMost + 2) & 255});
  for (std::size_t left = kMost; left > 0; left -= 8) {
    const std::size_t length = left - 4;
    add({0xFF, 0xD8, 0xFF, 0xE0, static_cast<int>(length >> 8), static_cast<int>(length & 255), 0, 0});
  }
  add({0xFF, 0xDA, 0, 8, 1, 1, 0, 0, 63, 0});
  bytes.resize(bytes.size() + 3'000'000, 0x55);
  add({0xFF, 0xE0, 0, 0});
  LONGS_EQUAL(1, pictures_of(bytes));
}

TEST(Recording, GivesOtherCodecsAsLuma) {
  const auto path = dir / "clip.avi";
  write_video(path, "FFV1", 5);  // lossless up to its colour conversion
  Recording recording = opened(path);
  CHECK_FALSE(recording.info().mjpeg);
  LONGS_EQUAL(5, recording.info().frames);
  const auto frames = all_frames(recording);
  LONGS_EQUAL(5, frames.size());
  const auto capture = test::film_reader(path);
  for (const RecordedFrame& frame : frames) {
    cv::Mat bgr;
    CHECK(capture->read(bgr));
    LONGS_EQUAL(320 * 240, frame.bytes.size());
    for (int i = 0; i < 320 * 240; i += 97) {
      const cv::Vec3b p = bgr.at<cv::Vec3b>(i / 320, i % 320);
      const double luma = 0.114 * p[0] + 0.587 * p[1] + 0.299 * p[2];  // ITU-R BT.601
      DOUBLES_EQUAL(luma, frame.bytes[static_cast<std::size_t>(i)],
                    0.51);  // rounding, with 14-bit coefficients
    }
    CHECK(frame.time == frame.index * 40ms);
  }
}

TEST(Recording, SortsAFolderNaturallyAndLeavesGreyUntouched) {
  const char* const order[] = {"img2.png", "img10.png", "img010b.png", "img100.png"};
  for (int i = 0; i < 4; ++i) test::write_picture(dir / order[i], picture(i, 100, 80, 1));
  write_file(dir / "labels.csv", "not an image");
  write_file(dir / ".img3.png", "hidden");
  Recording recording = opened(dir.path(), {.fps = 18.75});
  LONGS_EQUAL(4, recording.info().frames);
  const auto frames = all_frames(recording);
  LONGS_EQUAL(4, frames.size());
  for (int i = 0; i < 4; ++i) {
    const cv::Mat expected = picture(i, 100, 80, 1);
    const RecordedFrame& frame = frames[static_cast<std::size_t>(i)];
    CHECK(frame.bytes == std::vector<std::uint8_t>(expected.datastart, expected.dataend));
  }
  LONGS_EQUAL(160000, frames[3].time.count());
}

TEST(Recording, GivesAFolderOfJpegsByteForByte) {
  for (int i = 0; i < 11; ++i) write_file(dir / ("f" + std::to_string(i) + ".jpg"), jpeg(i));
  Recording recording = opened(dir.path());
  CHECK(recording.info().mjpeg);
  const auto frames = all_frames(recording);
  LONGS_EQUAL(11, frames.size());
  for (int i = 0; i < 11; ++i) CHECK(text(frames[static_cast<std::size_t>(i)]) == jpeg(i));
}

TEST(Recording, ReducesBigPicturesByTheSmallestBoxMeanThatFits) {
  const cv::Mat big = picture(1, 3283, 2464, 1);  // 3283 is not a multiple: the last column is left out
  test::write_picture(dir / "big.png", big);
  Recording recording = opened(dir / "big.png");
  DOUBLES_EQUAL(3, recording.scale(), 0);  // 3283 / 2 = 1641 is one too many
  LONGS_EQUAL(3283, recording.info().width);
  const auto frames = all_frames(recording);
  LONGS_EQUAL(1094, frames[0].width);
  LONGS_EQUAL(821, frames[0].height);
  for (int y = 0; y < 821; y += 41) {
    for (int x = 0; x < 1094; x += 37) {
      const double mean = cv::mean(big(cv::Rect(3 * x, 3 * y, 3, 3)))[0];
      DOUBLES_EQUAL(mean, frames[0].bytes[static_cast<std::size_t>(y * 1094 + x)], 0.5);  // rounding to 8 bit
    }
  }
  const auto eighth = sim::read_picture(dir / "big.png", 8);  // as the JPEG path decodes the same camera
  LONGS_EQUAL(410, std::get<RecordedFrame>(eighth).width);
}

TEST(Recording, FindsTheReferenceFrameAndLeavesTheOrderAlone) {
  write_video(dir / "clip.avi", "XVID", 30);
  write_file(dir / "clip.mjpg", jpeg(0) + jpeg(1) + jpeg(2));
  for (const char* name : {"clip.avi", "clip.mjpg"}) {
    Recording recording = opened(dir / name);
    RecordedFrame frame;
    CHECK(recording.next(frame) == Read::kFrame);
    const std::string first = text(frame);
    const auto at_first = std::get<RecordedFrame>(recording.at("first"));
    const auto at_last = std::get<RecordedFrame>(recording.at("last"));
    const auto at_two = std::get<RecordedFrame>(recording.at("2"));
    std::string two;
    while (recording.next(frame) == Read::kFrame) {
      if (frame.index == 2) two = text(frame);
    }
    CHECK(text(at_first) == first);
    CHECK(text(at_two) == two);
    CHECK(text(at_last) == text(frame));
    LONGS_EQUAL(frame.index, at_last.index);
    for (const char* wrong : {"-1", "1000", "", "2x", "middle", "99999999999999999999"}) {
      check_refused(recording.at(wrong), dir / name, "give first, last or a number from 0");
    }
    const std::string range = " to " + std::to_string(frame.index);
    STRCMP_CONTAINS(range.c_str(), line_of(recording.at("1000")).c_str());
  }
}

TEST(Recording, RefusesWhatIsNoRecordingInOneLine) {
  check_refused(Recording::open(dir / "absent.avi"), dir / "absent.avi", "cannot be read");
  write_file(dir / "empty.avi", "");
  check_refused(Recording::open(dir / "empty.avi"), dir / "empty.avi", "0 bytes");
  write_file(dir / "notes.txt", "hello\nworld\n");
  check_refused(Recording::open(dir / "notes.txt"), dir / "notes.txt", "not a video");
  write_file(dir / "log.mcap", "\x89MCAP0\r\n" + jpeg(1));
  check_refused(Recording::open(dir / "log.mcap"), dir / "log.mcap", "an MCAP log");
  write_file(dir / "noise.mjpg", std::string(10000, 'x'));
  check_refused(Recording::open(dir / "noise.mjpg"), dir / "noise.mjpg", "no frames");
  write_file(dir / "cut.mjpg", jpeg(1).substr(0, 3000));
  check_refused(Recording::open(dir / "cut.mjpg"), dir / "cut.mjpg", "no whole JPEG");
  write_file(dir / "none.avi", avi({}, 25, 1));
  check_refused(Recording::open(dir / "none.avi"), dir / "none.avi", "");
  check_refused(Recording::open("/dev/null"), "/dev/null", "neither a file nor a folder");
  std::filesystem::create_directory(dir / "folder");
  check_refused(Recording::open(dir / "folder"), dir / "folder", "folder is empty");
  write_file(dir / "folder/a.txt", "x");
  check_refused(Recording::open(dir / "folder"), dir / "folder", "holds no images");
}

TEST(Recording, RefusesATruncatedAviAndSaysHowMuchIsLeft) {
  for (const char* fourcc : {"MJPG", "XVID"}) {
    write_video(dir / "whole.avi", fourcc, 60);
    const std::string whole = read_file(dir / "whole.avi");
    for (const double part : {0.001, 0.02, 0.5, 0.9, 0.999}) {
      write_file(dir / "cut.avi", whole.substr(0, static_cast<std::size_t>(static_cast<double>(whole.size()) * part)));
      check_refused(Recording::open(dir / "cut.avi"), dir / "cut.avi", "truncated");
    }
  }
  std::string film = avi({jpeg(1), jpeg(2), "", jpeg(3)}, 25, 1);
  const auto left = [&](std::size_t size) {
    write_file(dir / "cut.avi", film.substr(0, size));
    return line_of(Recording::open(dir / "cut.avi"));
  };
  STRCMP_EQUAL("", left(film.size()).c_str());
  STRCMP_CONTAINS("stops after 2 of 4 announced frames", left(film.size() - 100).c_str());
  STRCMP_CONTAINS("stops after 1 of 4 announced frames", left(film.find(jpeg(2)) - 3).c_str());
  STRCMP_CONTAINS("stops after 0 frames", left(100).c_str());
  film.replace(4, 4, 4, '\0');  // as a recorder leaves it that is killed
  STRCMP_CONTAINS("stops after 3 of 4 announced frames", left(film.size()).c_str());
}

// Whoever counts the frames that came takes a recorder that dropped the last or most of them for a cut.
TEST(Recording, AFileThatIsWholeEndsWithoutAWordHoweverManyFramesWereDropped) {
  for (const std::size_t kept : {std::size_t{0}, std::size_t{10}, std::size_t{19}}) {
    std::vector<std::string> frames(20);
    frames[kept] = jpeg(1);
    write_file(dir / "dropped.avi", avi(frames, 25, 1));
    Recording recording = opened(dir / "dropped.avi");
    const auto came = all_frames(recording);
    LONGS_EQUAL(1, came.size());
    LONGS_EQUAL(kept, came[0].sequence);
    LONGS_EQUAL(kept, std::get<RecordedFrame>(recording.at("last")).sequence);
  }
}

TEST(Recording, SaysHowManyFramesATruncatedVideoGave) {
  for (const char* fourcc : {"MJPG", "XVID"}) {
    write_video(dir / "whole.mkv", fourcc, 100);
    const std::string whole = read_file(dir / "whole.mkv");
    write_file(dir / "cut.mkv", whole.substr(0, whole.size() * 6 / 10));
    Recording recording = opened(dir / "cut.mkv");
    RecordedFrame frame;
    Read read = Read::kFrame;
    while (read == Read::kFrame) read = recording.next(frame);
    CHECK(read == Read::kError);
    STRCMP_CONTAINS(" of 100 announced frames", recording.error().c_str());
    CHECK(recording.next(frame) == Read::kError);  // stays
  }
}

// As with a sound track that is longer than the film: the file's length is not the film's.
TEST(Recording, TakesTheFilmsOwnLengthInMatroska) {
  for (const char* fourcc : {"MJPG", "FFV1"}) {
    write_video(dir / "whole.mkv", fourcc, 50, cv::CAP_FFMPEG);
    std::string bytes = read_file(dir / "whole.mkv");
    const std::size_t duration = bytes.find("\x44\x89\x88");  // an element of 8 bytes, a double
    CHECK(duration != std::string::npos);
    bytes[duration + 3 + 1] = static_cast<char>(bytes[duration + 3 + 1] + 0x10);  // twice as long
    write_file(dir / "sound.mkv", bytes);
    Recording recording = opened(dir / "sound.mkv");
    LONGS_EQUAL(50, all_frames(recording).size());
    STRCMP_EQUAL("", recording.error().c_str());
  }
}

TEST(Recording, RefusesPicturesThatAreTooSmall) {
  test::write_picture(dir / "one.png", picture(1, 1, 1, 1));
  check_refused(Recording::open(dir / "one.png"), dir / "one.png", "too small");
  write_file(dir / "one.avi", avi({jpeg(1, 1, 1)}, 25, 1));
  check_refused(Recording::open(dir / "one.avi"), dir / "one.avi", "too small");
  STRCMP_CONTAINS("64x48", line_of(Recording::open(dir / "one.avi")).c_str());
  write_video(dir / "ffv1.avi", "FFV1", 3, cv::CAP_FFMPEG, {2, 2});
  check_refused(Recording::open(dir / "ffv1.avi"), dir / "ffv1.avi", "too small");
  write_file(dir / "small.mjpg", jpeg(1, 63, 48));
  check_refused(Recording::open(dir / "small.mjpg"), dir / "small.mjpg", "too small");
}

TEST(Recording, RefusesImagesOfOtherDepthsAndAlpha) {
  cv::Mat deep(100, 100, CV_16UC1, cv::Scalar(1000));
  test::write_picture(dir / "deep.png", deep);
  cv::Mat alpha(100, 100, CV_8UC4, cv::Scalar(1, 2, 3, 4));
  test::write_picture(dir / "alpha.png", alpha);
  for (const char* name : {"deep.png", "alpha.png"}) {
    check_refused(sim::read_picture(dir / name), dir / name, "convert it to 8 bit without alpha");
    check_refused(Recording::open(dir / name), dir / name, "convert it to 8 bit without alpha");
  }
  write_file(dir / "broken.png", read_file(dir / "deep.png").substr(0, 60));
  check_refused(sim::read_picture(dir / "broken.png"), dir / "broken.png", "cannot be decoded");
  write_file(dir / "cut.jpg", jpeg(1).substr(0, 4000));
  check_refused(sim::read_picture(dir / "cut.jpg"), dir / "cut.jpg", "cut off");
}

TEST(Recording, RefusesAFolderThatMixesSizesOrKindsWhenItMeetsThem) {
  std::filesystem::create_directory(dir / "sizes");
  test::write_picture(dir / "sizes/a1.png", picture(1, 100, 80));
  test::write_picture(dir / "sizes/a2.png", picture(1, 100, 81));
  std::filesystem::create_directory(dir / "kinds");
  test::write_picture(dir / "kinds/a1.png", picture(1, 100, 80));
  write_file(dir / "kinds/a2.jpg", jpeg(1, 100, 80));
  for (const char* name : {"sizes", "kinds"}) {
    Recording recording = opened(dir / name);
    RecordedFrame frame;
    CHECK(recording.next(frame) == Read::kFrame);
    CHECK(recording.next(frame) == Read::kError);
    STRCMP_CONTAINS("a2.", recording.error().c_str());
    STRCMP_CONTAINS("a1.png", recording.error().c_str());
    STRCMP_CONTAINS("mixes", recording.error().c_str());
  }
}

TEST(Recording, LibrariesStaySilentOnStderr) {
  write_video(dir / "whole.avi", "XVID", 10);
  std::string torn = read_file(dir / "whole.avi");
  for (std::size_t i = torn.size() / 2; i < torn.size() / 2 + 3000; ++i) torn[i] = static_cast<char>(i * 7);
  write_file(dir / "torn.avi", torn);
  write_file(dir / "notes.avi", "RIFFxxxxAVI nothing");
  test::write_picture(dir / "a.png", picture(1, 100, 80));
  write_file(dir / "broken.png", read_file(dir / "a.png").substr(0, 500));

  const auto log = dir / "stderr.txt";
  const int saved = ::dup(STDERR_FILENO);
  const int file = ::open(log.c_str(), O_CREAT | O_WRONLY, 0600);
  ::dup2(file, STDERR_FILENO);
  for (const char* name : {"torn.avi", "notes.avi", "broken.png", "absent.mp4"}) {
    Result<Recording> result = Recording::open(dir / name);
    RecordedFrame frame;
    if (auto* recording = std::get_if<Recording>(&result)) {
      while (recording->next(frame) == Read::kFrame) {
      }
    }
  }
  ::dup2(saved, STDERR_FILENO);
  ::close(saved);
  ::close(file);
  STRCMP_EQUAL("", read_file(log).c_str());
}

TEST_GROUP(CameraReplay) {
  TempDir dir;
  sim::Clock clock;
};

TEST(CameraReplay, MovesTheClockToEachFrameAndEndsWithGone) {
  write_file(dir / "a.mjpg", jpeg(1) + jpeg(2));
  clock.advance_to(5s);
  sim::CameraReplay camera(opened(dir / "a.mjpg", {.fps = 20}), clock);
  hal::Frame frame;
  CHECK(camera.next(frame, 1s) == hal::Capture::kGone);  // not started
  for (int run = 0; run < 2; ++run) {                    // a second start plays it again, later
    const std::chrono::microseconds start = clock.now();
    CHECK(camera.start());
    CHECK(camera.next(frame, 1s) == hal::Capture::kFrame);
    CHECK(frame.format == hal::PixelFormat::kMjpeg);
    CHECK(frame.timestamp == start);
    LONGS_EQUAL(0, frame.sequence);
    CHECK(std::string(frame.bytes.begin(), frame.bytes.end()) == jpeg(1));
    camera.release(frame);
    CHECK(camera.next(frame, 1s) == hal::Capture::kFrame);
    CHECK(frame.timestamp == start + 50ms);
    CHECK(clock.now() == start + 50ms);
    LONGS_EQUAL(1, frame.sequence);
    camera.release(frame);
    CHECK(camera.next(frame, 1s) == hal::Capture::kGone);
    STRCMP_EQUAL("", camera.error().c_str());
    camera.stop();
  }
}

TEST(CameraReplay, TimesOutInVirtualTimeWhenTheNextFrameIsFar) {
  test::write_picture(dir / "a1.png", picture(1, 100, 80));
  test::write_picture(dir / "a2.png", picture(2, 100, 80));
  sim::CameraReplay camera(opened(dir.path(), {.fps = 4}), clock);
  CHECK(camera.start());
  hal::Frame frame;
  CHECK(camera.next(frame, 100ms) == hal::Capture::kFrame);
  LONGS_EQUAL(100, frame.stride);
  CHECK(camera.next(frame, 100ms) == hal::Capture::kTimeout);
  CHECK(clock.now() == 100ms);
  CHECK(camera.next(frame, 100ms) == hal::Capture::kTimeout);
  CHECK(camera.next(frame, 100ms) == hal::Capture::kFrame);
  CHECK(clock.now() == 250ms);
  LONGS_EQUAL(1, camera.current().index);
}

// As a live camera whose driver stamps wrongly: the frame comes a frame's time later, and says another time.
TEST(CameraReplay, AStampOfAnotherTimeComesWhenAFrameIsDue) {
  const std::vector<std::chrono::microseconds> times{0s, 40ms, 20ms, 5h, -3h, 80ms, 80ms, 200ms};
  sim::CameraReplay camera(stamped(dir / "log", times), clock);
  clock.advance_to(5s);
  CHECK(camera.start());
  const std::vector<std::chrono::microseconds> now{5s,         5s + 40ms,  5s + 80ms,  5s + 120ms,
                                                   5s + 160ms, 5s + 160ms, 5s + 200ms, 5s + 200ms};
  for (std::size_t i = 0; i < times.size(); ++i) {
    hal::Frame frame;
    CHECK(camera.next(frame, 100ms) == hal::Capture::kFrame);
    CHECK(frame.timestamp == 5s + times[i]);
    CHECK(clock.now() == now[i]);
  }
}
