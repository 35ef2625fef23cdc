// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/recording.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <optional>
#include <system_error>
#include <utility>

#include "drivers/common/input_file.hpp"
#include "drivers/sim/container.hpp"
#include "drivers/sim/media.hpp"
#include "vision/jpeg.hpp"
#include "vision/luma.hpp"

namespace holdfast::sim {

namespace fs = std::filesystem;

// One kind of input. next() fills bytes, format, size, sequence and damaged; the time stamp goes to `pts_s`.
class Recording::Source {
 public:
  virtual ~Source() = default;
  virtual Read next(RecordedFrame& frame, std::optional<double>& pts_s) = 0;
  virtual Read skip() = 0;
  // -1: unknown. For video it is what the container announces, which may be an estimate.
  [[nodiscard]] virtual long frames() const = 0;
  [[nodiscard]] virtual double fps() const { return 0; }
  [[nodiscard]] const std::string& error() const { return error_; }

 protected:
  Read fail(Error error) {
    error_ = std::move(error.line);
    return Read::kError;
  }

 private:
  std::string error_;
};

namespace {

using SourceResult = Result<std::unique_ptr<Recording::Source>>;

Error fail_line(const fs::path& path, const std::string& what, const std::string& cause, const std::string& next) {
  return {path.string() + ": " + what + ": " + cause + "; " + next};
}

std::string size_text(int width, int height) {
  return std::to_string(width) + "x" + std::to_string(height) + " pixels";
}

// libpng writes its complaints to file descriptor 2 whatever OpenCV's log level says.
class QuietStderr {
 public:
  QuietStderr() : saved_(::dup(STDERR_FILENO)) {
    const int null = ::open("/dev/null", O_WRONLY | O_CLOEXEC);
    if (null >= 0) {
      ::dup2(null, STDERR_FILENO);
      ::close(null);
    }
  }
  ~QuietStderr() {
    if (saved_ < 0) return;
    ::dup2(saved_, STDERR_FILENO);
    ::close(saved_);
  }
  QuietStderr(const QuietStderr&) = delete;
  QuietStderr& operator=(const QuietStderr&) = delete;

 private:
  int saved_;
};

bool starts_like_jpeg(std::span<const std::uint8_t> bytes) {
  return bytes.size() >= 3 && bytes[0] == 0xFF && bytes[1] == 0xD8 && bytes[2] == 0xFF;
}

std::string lower_extension(const fs::path& path) {
  std::string text = path.extension().string();
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

bool has_extension(const fs::path& path, std::initializer_list<std::string_view> list) {
  const std::string text = lower_extension(path);
  return std::find(list.begin(), list.end(), text) != list.end();
}

bool is_image_name(const fs::path& path) {
  return path.filename().string().front() != '.' &&
         has_extension(path, {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".pnm", ".webp"});
}

// Numbers inside names count as numbers: img2 < img10; img02 and img2 are then told apart by their text.
bool natural_less(const std::string& a, const std::string& b) {
  const auto digit = [](char c) { return c >= '0' && c <= '9'; };
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (!digit(a[i]) || !digit(b[j])) {
      if (a[i] != b[j]) return static_cast<unsigned char>(a[i]) < static_cast<unsigned char>(b[j]);
      ++i, ++j;
      continue;
    }
    while (i < a.size() && a[i] == '0') ++i;
    while (j < b.size() && b[j] == '0') ++j;
    std::size_t i_end = i, j_end = j;
    while (i_end < a.size() && digit(a[i_end])) ++i_end;
    while (j_end < b.size() && digit(b[j_end])) ++j_end;
    if (i_end - i != j_end - j) return i_end - i < j_end - j;
    if (const int order = a.compare(i, i_end - i, b, j, j_end - j); order != 0) return order < 0;
    i = i_end, j = j_end;
  }
  if ((i < a.size()) != (j < b.size())) return j < b.size();
  return a < b;
}

constexpr int kCoarsestDecode = static_cast<int>(DecodeScale::kEighth);

int smallest_fitting_factor(int width, int height) {
  int factor = 1;
  while (width / factor > kMaxLumaWidth || height / factor > kMaxLumaHeight) ++factor;
  return factor;
}

// Mean over whole factor x factor boxes, rounded to nearest; the incomplete boxes at the right and at the
// bottom are left out, so that x_in = (x + 0.5) * factor - 0.5 holds for all.
void reduce_to(const cv::Mat& grey, int factor, RecordedFrame& frame) {
  frame.format = hal::PixelFormat::kLuma8;
  frame.input_width = grey.cols;
  frame.input_height = grey.rows;
  frame.width = grey.cols / factor;
  frame.height = grey.rows / factor;
  frame.damaged = false;
  frame.bytes.resize(static_cast<std::size_t>(frame.width) * static_cast<std::size_t>(frame.height));
  const auto area = static_cast<unsigned>(factor) * static_cast<unsigned>(factor);
  std::uint8_t* out = frame.bytes.data();
  for (int y = 0; y < frame.height; ++y) {
    if (factor == 1) {
      out = std::copy_n(grey.ptr<std::uint8_t>(y), frame.width, out);
      continue;
    }
    for (int x = 0; x < frame.width; ++x) {
      unsigned sum = area / 2;
      for (int v = 0; v < factor; ++v) {
        const std::uint8_t* row = grey.ptr<std::uint8_t>(y * factor + v) + x * factor;
        for (int u = 0; u < factor; ++u) sum += row[u];
      }
      *out++ = static_cast<std::uint8_t>(sum / area);
    }
  }
}

// 8-bit grey of a picture of one or three 8-bit channels; grey inputs are not touched.
cv::Mat to_grey(const cv::Mat& picture) {
  if (picture.channels() == 1) return picture;
  cv::Mat grey;
  cv::cvtColor(picture, grey, cv::COLOR_BGR2GRAY);
  return grey;
}

void take_jpeg(std::span<const std::uint8_t> bytes, RecordedFrame& frame) {
  const std::optional<JpegExtent> picture = find_jpeg(bytes, 0);
  frame.format = hal::PixelFormat::kMjpeg;
  frame.bytes.assign(bytes.begin(), bytes.end());
  frame.width = picture ? picture->width : 0;
  frame.height = picture ? picture->height : 0;
  frame.input_width = frame.width;
  frame.input_height = frame.height;
  frame.damaged = !picture || !picture->complete;
}

std::optional<Error> refuse_small(const fs::path& path, int width, int height) {
  if (width >= kMinLumaWidth && height >= kMinLumaHeight) return std::nullopt;
  return fail_line(path, "the picture is too small (" + size_text(width, height) + ")",
                   "not a GelSight recording, or scaled down too far",
                   "use one of at least " + size_text(kMinLumaWidth, kMinLumaHeight));
}

// Reads an image as JPEG bytes or luma. `reduce` as in read_picture().
std::optional<Error> load_image(const fs::path& path, int reduce, hal::PixelFormat jpeg_as, RecordedFrame& frame) {
  std::array<std::uint8_t, 3> head{};
  std::ifstream file;
  if (const std::string wrong = drivers::open_file(path, "give one image file", file); !wrong.empty()) {
    return Error{wrong};
  }
  file.read(reinterpret_cast<char*>(head.data()), head.size());
  if (file.gcount() == 0) {
    return fail_line(path, "holds no picture", "the file is empty (0 bytes)", "write or copy it again");
  }
  if (starts_like_jpeg(head)) {
    const MappedFile mapped(path);
    take_jpeg(mapped.bytes(), frame);
    if (jpeg_as == hal::PixelFormat::kMjpeg || frame.damaged) return std::nullopt;
  }
  cv::Mat picture;
  try {
    const Media& libraries = media();
    const QuietStderr quiet;
    picture = libraries.read(path, cv::IMREAD_UNCHANGED);
  } catch (const cv::Exception&) {
    picture.release();
  } catch (const MediaMissing& problem) {
    return Error{path.string() + ": " + problem.what()};
  }
  if (picture.empty()) {
    return fail_line(path, "cannot be decoded", "not an image, or the file is damaged",
                     "open it in a picture viewer; use PNG, JPEG, BMP, TIFF, PNM or WebP");
  }
  if (picture.depth() != CV_8U) {
    return fail_line(path, "has more than 8 bits per channel", "written as a 16-bit or floating-point image",
                     "convert it to 8 bit without alpha");
  }
  if (picture.channels() != 1 && picture.channels() != 3) {
    return fail_line(path, "has an alpha channel", "transparency has no meaning for a camera picture",
                     "convert it to 8 bit without alpha");
  }
  if (auto error = refuse_small(path, picture.cols, picture.rows)) return error;
  const int factor = reduce > 0 ? reduce : smallest_fitting_factor(picture.cols, picture.rows);
  try {
    reduce_to(to_grey(picture), factor, frame);
  } catch (const cv::Exception& problem) {
    return fail_line(path, "cannot be converted to grey", problem.err, "convert it to 8-bit grey PNG");
  }
  return std::nullopt;
}

class ImageSource final : public Recording::Source {
 public:
  explicit ImageSource(std::vector<fs::path> files) : files_(std::move(files)) {}

  Read next(RecordedFrame& frame, std::optional<double>& pts_s) override {
    pts_s.reset();
    if (position_ >= files_.size()) return Read::kEnd;
    const fs::path& path = files_[position_];
    frame.sequence = static_cast<std::uint32_t>(position_++);
    if (auto error = load_image(path, 0, hal::PixelFormat::kMjpeg, frame)) return fail(*error);
    return check_alike(path, frame);
  }
  Read skip() override { return position_ < files_.size() ? (++position_, Read::kFrame) : Read::kEnd; }
  [[nodiscard]] long frames() const override { return static_cast<long>(files_.size()); }

 private:
  Read check_alike(const fs::path& path, const RecordedFrame& frame) {
    if (frame.input_width == 0) return Read::kFrame;  // damaged header: the decoder says so
    if (like_.empty()) {
      like_ = path;
      format_ = frame.format;
      width_ = frame.input_width, height_ = frame.input_height;
    }
    if (frame.format != format_) {
      return fail(fail_line(path, "is of another kind than " + like_.filename().string(),
                            "the folder mixes JPEG files with other images", "keep one kind in a folder"));
    }
    if (frame.input_width != width_ || frame.input_height != height_) {
      return fail(fail_line(path,
                            "is " + size_text(frame.input_width, frame.input_height) + ", but " +
                                like_.filename().string() + " is " + size_text(width_, height_),
                            "the folder mixes pictures of several recordings",
                            "keep pictures of one size in a folder"));
    }
    return Read::kFrame;
  }

  std::vector<fs::path> files_;
  std::size_t position_ = 0;
  fs::path like_;  // the first picture, which the others must resemble
  hal::PixelFormat format_{};
  int width_ = 0, height_ = 0;
};

class StreamSource final : public Recording::Source {
 public:
  explicit StreamSource(std::unique_ptr<MappedFile> file) : file_(std::move(file)) {}

  Read next(RecordedFrame& frame, std::optional<double>& pts_s) override {
    pts_s.reset();
    const std::optional<JpegExtent> picture = find_jpeg(file_->bytes(), position_);
    if (!picture) return Read::kEnd;
    take_jpeg(file_->bytes().subspan(picture->begin, picture->end - picture->begin), frame);
    frame.sequence = count_++;
    position_ = picture->end;
    return Read::kFrame;
  }
  Read skip() override {
    const std::optional<JpegExtent> picture = find_jpeg(file_->bytes(), position_);
    if (!picture) return Read::kEnd;
    ++count_;
    position_ = picture->end;
    return Read::kFrame;
  }
  [[nodiscard]] long frames() const override { return -1; }

 private:
  std::unique_ptr<MappedFile> file_;
  std::size_t position_ = 0;
  std::uint32_t count_ = 0;
};

class PictureSource final : public Recording::Source {
 public:
  PictureSource(std::unique_ptr<MappedFile> file, std::shared_ptr<const std::vector<StampedPicture>> pictures)
      : file_(std::move(file)), pictures_(std::move(pictures)) {}

  Read next(RecordedFrame& frame, std::optional<double>& pts_s) override {
    const std::size_t at = position_;
    if (skip() == Read::kEnd) return Read::kEnd;
    const StampedPicture& picture = (*pictures_)[at];
    pts_s = static_cast<double>(picture.time.count()) * 1e-6;
    take_jpeg(file_->bytes().subspan(picture.offset, picture.size), frame);
    frame.sequence = static_cast<std::uint32_t>(at);
    return Read::kFrame;
  }
  Read skip() override { return position_ < pictures_->size() ? (++position_, Read::kFrame) : Read::kEnd; }
  [[nodiscard]] long frames() const override { return static_cast<long>(pictures_->size()); }
  [[nodiscard]] double fps() const override {
    std::vector<Micros> steps;  // forward; the median of them, since one gap or another clock's stamp says nothing
    for (std::size_t i = 1; i < pictures_->size(); ++i) {
      const Micros step = (*pictures_)[i].time - (*pictures_)[i - 1].time;
      if (step > Micros{0}) steps.push_back(step);
    }
    if (steps.empty()) return 0;
    const auto middle = steps.begin() + std::ssize(steps) / 2;
    std::ranges::nth_element(steps, middle);
    return 1e6 / static_cast<double>(middle->count());
  }

 private:
  std::unique_ptr<MappedFile> file_;
  std::shared_ptr<const std::vector<StampedPicture>> pictures_;
  std::size_t position_ = 0;
};

// A film in a container, which announces how long it is.
class VideoSource : public Recording::Source {
 public:
  [[nodiscard]] long frames() const override { return announced_; }
  [[nodiscard]] double fps() const override { return fps_; }

 protected:
  explicit VideoSource(fs::path path) : path_(std::move(path)) {}

  void announce(double frames, double fps) {
    announced_ = frames >= 1 && frames < 1e9 ? std::lround(frames) : -1;
    fps_ = fps;
  }
  void took(double time_s) {
    last_s_ = time_s;
    if (count_ == 1) first_s_ = time_s;
  }
  Read cut_off() {
    return stops(announced_ < count_ ? "" : " of " + std::to_string(announced_) + " announced",
                 "truncated or damaged by an interrupted copy, a full disk or a recorder that was killed",
                 "copy or record it again, or save the rest with 'ffmpeg -i IN -c copy OUT'");
  }
  Read stops(const std::string& of, const std::string& cause, const std::string& next) {
    return fail(fail_line(path_, "stops after " + std::to_string(count_) + of + " frames", cause, next));
  }
  // Some containers announce an estimate (duration x rate), so the time covered is compared, not the count;
  // two frames and 1 % are left for rounding and for frames that the codec holds back.
  Read check_end() {
    if (announced_ < 0 || count_ == 0) return Read::kEnd;
    const double by_time = (last_s_ - first_s_) * fps_ + 1;
    const double covered = std::max(static_cast<double>(count_), by_time);
    return covered >= static_cast<double>(announced_) * 0.99 - 2 ? Read::kEnd : cut_off();
  }

  void came() { ++count_; }
  [[nodiscard]] long count() const { return count_; }
  [[nodiscard]] const fs::path& path() const { return path_; }

 private:
  fs::path path_;
  long count_ = 0;
  long announced_ = -1;
  double fps_ = 0;
  double first_s_ = 0;
  double last_s_ = 0;
};

// Whether an AVI ends where its own sizes say, which libavformat leaves open; none: not an AVI. A size of 0 was to be
// filled in when the recorder closed the file.
std::optional<bool> avi_is_whole(std::span<const std::uint8_t> bytes) {
  const auto tag_is = [&](std::size_t at, std::string_view tag) {
    return at + 12 <= bytes.size() &&
           std::equal(tag.begin(), tag.end(), bytes.begin() + static_cast<std::ptrdiff_t>(at));
  };
  if (!tag_is(0, "RIFF") || !tag_is(8, "AVI ")) return std::nullopt;
  for (std::size_t at = 0; tag_is(at, "RIFF");) {
    std::size_t size = 0;
    for (std::size_t k = 4; k-- > 0;) size = size << 8 | bytes[at + 4 + k];
    if (size < 4 || size > bytes.size() - at - 8) return false;
    at += 8 + size + (size & 1);
  }
  return true;
}

// MJPEG in AVI, Matroska, MP4 ...: the packets as they are.
class PacketSource final : public VideoSource {
 public:
  // `packets`: null when the file cannot be opened. `whole`: known to be, so that frames which are announced and do not
  // come were dropped by the recorder.
  PacketSource(const fs::path& path, std::unique_ptr<Packets> packets, bool whole)
      : VideoSource(path), packets_(std::move(packets)), whole_(whole) {
    if (packets_ == nullptr) return;
    facts_ = packets_->facts();
    announce(facts_.frames, facts_.fps);
  }

  [[nodiscard]] bool is_mjpeg() const { return facts_.mjpeg; }
  [[nodiscard]] double announced() const { return facts_.frames; }
  // Of a file that is cut off: how much is left of it.
  [[nodiscard]] Error refusal() {
    while (packets_ != nullptr && skip() == Read::kFrame) continue;
    (void)cut_off();
    return Error{error()};
  }

  Read next(RecordedFrame& frame, std::optional<double>& pts_s) override {
    pts_s.reset();
    if (skip() == Read::kEnd) return cut_ ? cut_off() : whole_ ? Read::kEnd : check_end();
    pts_s = packets_->time_s();
    took(pts_s.value_or(0));
    take_jpeg(packets_->bytes(), frame);
    frame.sequence =
        static_cast<std::uint32_t>(facts_.counts_places ? packets_->place().value_or(count() - 1) : count() - 1);
    return Read::kFrame;
  }
  Read skip() override {
    const Packets::Take took = packets_->take();
    cut_ = took == Packets::Take::kCut;
    if (took != Packets::Take::kPacket) return Read::kEnd;
    came();
    return Read::kFrame;
  }

 private:
  std::unique_ptr<Packets> packets_;
  Packets::Facts facts_;
  bool whole_;
  bool cut_ = false;
};

// Everything else is decoded.
class DecodedSource final : public VideoSource {
 public:
  // `frames`: announced; 0: ask the decoder.
  DecodedSource(const fs::path& path, double frames) : VideoSource(path), capture_(media().capture()) {
    try {
      // Absolute: as above. Not CAP_ANY: it also looks for USB photo cameras (gphoto2), slowly and with leaks.
      for (const int backend : {cv::CAP_FFMPEG, cv::CAP_GSTREAMER}) {
        if (capture_->open(fs::absolute(path).string(), backend)) break;
      }
      if (is_open()) {
        announce(frames > 0 ? frames : capture_->get(cv::CAP_PROP_FRAME_COUNT), capture_->get(cv::CAP_PROP_FPS));
      }
    } catch (const cv::Exception&) {
      capture_->release();
    }
  }

  [[nodiscard]] bool is_open() const { return capture_->isOpened(); }

  Read next(RecordedFrame& frame, std::optional<double>& pts_s) override {
    try {
      pts_s.reset();
      if (skip() == Read::kEnd) return check_end();
      const double pts_ms = capture_->get(cv::CAP_PROP_POS_MSEC);
      if (pts_ms != 0 || count() == 1) pts_s = pts_ms / 1000;  // 0: the frame has no stamp
      cv::Mat picture;
      if (!capture_->retrieve(picture) || picture.empty()) return check_end();
      frame.sequence = static_cast<std::uint32_t>(count() - 1);
      took(pts_s.value_or(0));
      if (picture.depth() != CV_8U || (picture.channels() != 1 && picture.channels() != 3)) {
        return fail(fail_line(path(), "has more than 8 bits per channel, or alpha", "a scientific or edited video",
                              "convert it to 8 bit, for instance to MJPEG"));
      }
      reduce_to(to_grey(picture), smallest_fitting_factor(picture.cols, picture.rows), frame);
      return Read::kFrame;
    } catch (const cv::Exception& problem) {
      return stops("", problem.err, "play it in a video player; convert it to MJPEG");
    }
  }
  Read skip() override {
    try {
      if (!capture_->grab()) return Read::kEnd;
    } catch (const cv::Exception&) {
      return Read::kEnd;
    }
    came();
    return Read::kFrame;
  }

 private:
  std::unique_ptr<cv::VideoCapture> capture_;
};

SourceResult open_folder(const fs::path& path) {
  std::vector<fs::path> files;
  std::error_code ec;
  bool any = false;
  for (fs::directory_iterator it(path, ec), end; !ec && it != end; it.increment(ec)) {
    any = true;
    std::error_code ignored;
    if (is_image_name(it->path()) && it->is_regular_file(ignored)) files.push_back(it->path());
  }
  if (ec) return fail_line(path, "the folder cannot be read", ec.message(), "check its permissions");
  if (files.empty()) {
    return fail_line(path, any ? "the folder holds no images" : "the folder is empty",
                     any ? "its files are of other kinds" : "wrong folder, or the export failed",
                     "give a folder of PNG, JPEG, BMP, TIFF, PNM or WebP files");
  }
  std::sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
    return natural_less(a.filename().string(), b.filename().string());
  });
  return std::make_unique<ImageSource>(std::move(files));
}

SourceResult open_video(const fs::path& path, std::span<const std::uint8_t> bytes) try {
  const std::optional<bool> whole = avi_is_whole(bytes);
  auto packets = std::make_unique<PacketSource>(path, media().packets(path), whole.value_or(false));
  if (whole == false) return packets->refusal();
  if (packets->is_mjpeg()) return packets;
  auto decoded = std::make_unique<DecodedSource>(path, packets->announced());
  if (decoded->is_open()) return decoded;
  return fail_line(path, "is not a video that can be opened", "not a video, cut off or damaged, or an unknown codec",
                   "play it in a video player; use AVI, MP4, Matroska, .mjpg or a folder of images");
} catch (const MediaMissing& problem) {
  return Error{path.string() + ": " + problem.what()};
}

SourceResult open_pictures(const fs::path& path, std::unique_ptr<MappedFile> file,
                           const std::shared_ptr<const std::vector<StampedPicture>>& pictures) {
  const std::size_t size = file->bytes().size();
  const auto inside = [&](const StampedPicture& p) { return p.offset <= size && p.size <= size - p.offset; };
  if (std::all_of(pictures->begin(), pictures->end(), inside)) {
    return std::make_unique<PictureSource>(std::move(file), pictures);
  }
  return fail_line(path, "is shorter than it was", "another program writes it now", "wait until it is written");
}

SourceResult open_source(const fs::path& path, const RecordingOptions& options) {
  std::error_code ec;
  const fs::file_status status = fs::status(path, ec);
  if (!fs::exists(status)) {
    return fail_line(path, "cannot be read", ec ? ec.message() : "no such file", "check the path");
  }
  if (fs::is_directory(status)) return open_folder(path);
  if (!fs::is_regular_file(status)) {
    return fail_line(path, "cannot be read", "neither a file nor a folder", "save the stream to a file first");
  }
  if (fs::file_size(path, ec) == 0 && !ec) {
    return fail_line(path, "holds no frames", "the file is empty (0 bytes)", "copy or record it again");
  }
  auto file = std::make_unique<MappedFile>(path);
  if (file->bytes().empty()) return fail_line(path, "cannot be read", "no permission", "check its permissions");
  if (options.pictures) return open_pictures(path, std::move(file), options.pictures);
  constexpr std::array<std::uint8_t, 8> kMcap{0x89, 'M', 'C', 'A', 'P', '0', '\r', '\n'};
  if (file->bytes().size() >= kMcap.size() && std::ranges::equal(file->bytes().first(kMcap.size()), kMcap)) {
    return fail_line(path, "is an MCAP log, which is not played here", "a file that holdfast record or --mcap wrote",
                     "holdfast replay, or holdfast live --play, reads it");
  }
  if (starts_like_jpeg(file->bytes()) || has_extension(path, {".mjpg", ".mjpeg"})) {
    if (!find_jpeg(file->bytes(), 0)) {
      return fail_line(path, "holds no frames", "there is no JPEG picture in it: not an MJPEG stream",
                       "give a raw stream of JPEG pictures, a video file or a folder of images");
    }
    return std::make_unique<StreamSource>(std::move(file));
  }
  if (is_image_name(path)) return std::make_unique<ImageSource>(std::vector<fs::path>{path});
  return open_video(path, file->bytes());
}

// Reads up to the first frame that tells the size: the first one, unless it is a damaged JPEG.
Result<RecordingInfo> probe(const fs::path& path, Recording::Source& source, const RecordingOptions& options) {
  RecordedFrame frame;
  std::optional<double> pts_s;
  bool mjpeg = false;
  for (;;) {
    const Read read = source.next(frame, pts_s);
    if (read == Read::kError) return Error{source.error()};
    if (read == Read::kEnd) {
      return mjpeg
                 ? fail_line(path, "holds no whole JPEG picture", "damaged, or not an MJPEG stream", "record it again")
                 : fail_line(path, "holds no frames", "an empty recording, or a codec that cannot be decoded",
                             "play it in a video player; convert it to MJPEG");
    }
    mjpeg = frame.format == hal::PixelFormat::kMjpeg;
    if (!mjpeg || (!frame.damaged && frame.width > 0)) break;
  }
  RecordingInfo info;
  info.mjpeg = mjpeg;
  info.frames = source.frames();
  const double fps = source.fps();
  info.fps = std::isfinite(fps) && fps >= 0.5 && fps <= 1000 ? fps : 0;
  info.stamped = options.pictures != nullptr;
  info.time_base_fps = options.fps > 0 && !info.stamped ? options.fps : info.fps > 0 ? info.fps : kDefaultFps;
  info.width = frame.input_width;
  info.height = frame.input_height;
  if (auto error = refuse_small(path, info.width, info.height)) return *error;
  const bool too_large = mjpeg && smallest_fitting_factor(info.width, info.height) > kCoarsestDecode;
  if (too_large || (!mjpeg && (frame.width < kMinLumaWidth || frame.height < kMinLumaHeight))) {
    return fail_line(path, "the picture does not fit the working image (" + size_text(info.width, info.height) + ")",
                     "not a GelSight recording, which is at most 3280x2464", "cut or scale it to the gel");
  }
  // A whole number: the box mean takes whole blocks.
  if (!mjpeg) info.scale = std::floor(static_cast<double>(info.width) / frame.width);
  return info;
}

enum class Until : std::uint8_t { kFirst, kEnd };

struct Walk {
  long frames = 0;                     // how many there were until the walk ended
  std::optional<RecordedFrame> frame;  // the last one read
};

// Skips `from` frames, then reads one, or all up to the end.
Result<Walk> walk(const fs::path& path, const RecordingOptions& options, long from, Until until) {
  SourceResult opened = open_source(path, options);
  if (auto* error = std::get_if<Error>(&opened)) return *error;
  Recording::Source& source = *std::get<0>(opened);
  Walk walked;
  RecordedFrame frame;
  std::optional<double> pts_s;
  for (;; ++walked.frames) {
    const bool fetch = walked.frames >= from;
    const Read read = fetch ? source.next(frame, pts_s) : source.skip();
    if (read == Read::kError) return Error{source.error()};
    if (read == Read::kEnd) return walked;
    if (!fetch) continue;
    frame.index = walked.frames;
    walked.frame = frame;
    if (until == Until::kFirst) return walked;
  }
}

}  // namespace

Recording::Recording(fs::path path, RecordingOptions options, RecordingInfo info, std::unique_ptr<Source> source)
    : path_(std::move(path)), options_(std::move(options)), info_(info), source_(std::move(source)) {}
Recording::Recording(Recording&&) noexcept = default;
Recording& Recording::operator=(Recording&&) noexcept = default;
Recording::~Recording() = default;

Result<Recording> Recording::open(const fs::path& path, RecordingOptions options) {
  SourceResult probed = open_source(path, options);
  if (auto* error = std::get_if<Error>(&probed)) return *error;
  Result<RecordingInfo> info = probe(path, *std::get<0>(probed), options);
  if (auto* error = std::get_if<Error>(&info)) return *error;
  Recording recording(path, std::move(options), std::get<RecordingInfo>(info), nullptr);
  if (!recording.rewind()) return Error{recording.error_};
  return recording;
}

bool Recording::rewind() {
  SourceResult source = open_source(path_, options_);
  if (auto* error = std::get_if<Error>(&source)) {
    error_ = error->line;
    return false;
  }
  source_ = std::move(std::get<0>(source));
  error_.clear();
  count_ = 0;
  last_time_ = Micros{};
  first_pts_s_ = 0;
  return true;
}

Read Recording::next(RecordedFrame& frame) {
  if (!error_.empty()) return Read::kError;
  std::optional<double> pts_s;
  const Read read = source_->next(frame, pts_s);
  if (read == Read::kError) error_ = source_->error();
  if (read != Read::kFrame) return read;
  // What is wrong with a frame's own stamp stays wrong: the firmware rejects it, as it does with a camera. The time
  // base is for frames that have none, and stretches those of a container whose rate was replaced.
  if (count_ == 0) {
    first_pts_s_ = pts_s.value_or(0);
    frame.time = Micros{};
  } else if (pts_s && std::isfinite(*pts_s) && (info_.fps > 0 || options_.fps <= 0 || info_.stamped)) {
    constexpr double kFarthest_s = 1e9;  // 32 years: microseconds fit
    const double stretch = info_.fps > 0 ? info_.fps / info_.time_base_fps : 1.0;
    frame.time = Micros{std::llround(std::clamp((*pts_s - first_pts_s_) * stretch, -kFarthest_s, kFarthest_s) * 1e6)};
  } else {
    // n / fps is rounded once, not summed up: 18.75 fps must not drift.
    const double step_us = 1e6 / info_.time_base_fps;
    const Micros step{std::llround(step_us)};
    const Micros counted{std::llround(static_cast<double>(frame.sequence) * step_us)};
    const bool in_step = counted - last_time_ >= step - Micros{1};
    frame.time = in_step ? counted : last_time_ + step;
  }
  last_time_ = frame.time;
  frame.index = count_++;
  return Read::kFrame;
}

Result<RecordedFrame> Recording::at(std::string_view which) const {
  const auto no_frame = [&](const std::string& cause, long frames) {
    const std::string range = frames > 0 ? " to " + std::to_string(frames - 1) : "";
    return fail_line(path_, "no frame '" + std::string(which) + "'", cause,
                     "give first, last or a number from 0" + range);
  };
  if (which == "last") {
    // All but the announced end is skipped; when the end comes earlier, a second walk knows where.
    Result<Walk> walked = walk(path_, options_, std::max(info_.frames - 1, 0L), Until::kEnd);
    if (auto* walk_result = std::get_if<Walk>(&walked); walk_result != nullptr && !walk_result->frame) {
      walked = walk(path_, options_, std::max(walk_result->frames - 1, 0L), Until::kFirst);
    }
    if (auto* error = std::get_if<Error>(&walked)) return *error;
    Walk& result = std::get<Walk>(walked);
    if (!result.frame) return no_frame("the recording has no frames", 0);
    return std::move(*result.frame);
  }
  long wanted = 0;
  if (which != "first") {
    const auto [end, ec] = std::from_chars(which.data(), which.data() + which.size(), wanted);
    if (ec != std::errc{} || end != which.data() + which.size() || wanted < 0) {
      return no_frame("not a name or number of a frame", info_.frames);
    }
  }
  Result<Walk> walked = walk(path_, options_, wanted, Until::kFirst);
  if (auto* error = std::get_if<Error>(&walked)) return *error;
  Walk& result = std::get<Walk>(walked);
  if (!result.frame) {
    return no_frame("the recording has " + std::to_string(result.frames) + " frames", result.frames);
  }
  return std::move(*result.frame);
}

Result<RecordedFrame> read_picture(const fs::path& path, int reduce, hal::PixelFormat jpeg_as) {
  RecordedFrame frame;
  if (auto error = load_image(path, reduce, jpeg_as, frame)) return *error;
  if (frame.damaged) {
    return fail_line(path, "the JPEG picture is cut off", "an interrupted copy or a full disk", "save it again");
  }
  return frame;
}

}  // namespace holdfast::sim
