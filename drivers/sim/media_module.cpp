// SPDX-License-Identifier: Apache-2.0
// The module behind media.hpp: the only code that is linked to the libraries of foreign formats.
extern "C" {
#include <libavformat/avformat.h>
}

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/imgcodecs.hpp>

#include "drivers/sim/media.hpp"

namespace holdfast::sim {

namespace {

namespace fs = std::filesystem;

class Container final : public Packets {
 public:
  explicit Container(const fs::path& path) {
    AVFormatContext* file = nullptr;
    // An absolute path cannot be taken for a protocol ("a:b.avi").
    if (::avformat_open_input(&file, fs::absolute(path).c_str(), nullptr, nullptr) < 0) return;
    file_.reset(file);
    if (::avformat_find_stream_info(file, nullptr) < 0) return;
    const int best = ::av_find_best_stream(file, AVMEDIA_TYPE_VIDEO, -1, -1, nullptr, 0);
    if (best >= 0 && packet_ != nullptr) video_ = file->streams[best];
  }

  [[nodiscard]] bool is_open() const { return video_ != nullptr; }

  [[nodiscard]] Facts facts() const override {
    const AVRational rate = ::av_guess_frame_rate(file_.get(), video_, nullptr);
    const double fps = rate.den > 0 ? ::av_q2d(rate) : 0;
    return {.mjpeg = video_->codecpar->codec_id == AV_CODEC_ID_MJPEG,
            .frames = video_->nb_frames > 0 ? static_cast<double>(video_->nb_frames) : duration_s() * fps,
            .fps = fps,
            .counts_places = ::av_cmp_q(::av_inv_q(rate), video_->time_base) == 0};
  }

  Take take() override {
    do {
      ::av_packet_unref(packet_.get());
      if (::av_read_frame(file_.get(), packet_.get()) < 0) return Take::kEnd;
    } while (packet_->stream_index != video_->index);
    return (packet_->flags & AV_PKT_FLAG_CORRUPT) != 0 ? Take::kCut : Take::kPacket;
  }

  [[nodiscard]] std::span<const std::uint8_t> bytes() const override {
    return {packet_->data, static_cast<std::size_t>(packet_->size)};
  }

  [[nodiscard]] std::optional<std::int64_t> place() const override {
    const std::int64_t time = packet_->pts != AV_NOPTS_VALUE ? packet_->pts : packet_->dts;
    return time != AV_NOPTS_VALUE ? std::optional(time) : std::nullopt;
  }

  [[nodiscard]] std::optional<double> time_s() const override {
    const std::optional<std::int64_t> time = place();
    return time ? std::optional(static_cast<double>(*time) * ::av_q2d(video_->time_base)) : std::nullopt;
  }

 private:
  // Of the film alone. Matroska counts from 0 to the end of the longest track; each track's own end is in its tags.
  [[nodiscard]] double duration_s() const {
    double end_s = static_cast<double>(file_->duration) / AV_TIME_BASE;
    int hours = 0, minutes = 0;
    double seconds = 0;
    const AVDictionaryEntry* const own = ::av_dict_get(video_->metadata, "DURATION", nullptr, 0);
    if (own != nullptr && std::sscanf(own->value, "%d:%d:%lf", &hours, &minutes, &seconds) == 3) {
      end_s = hours * 3600.0 + minutes * 60.0 + seconds;
    }
    const double start_s = static_cast<double>(video_->start_time) * ::av_q2d(video_->time_base);
    return video_->start_time != AV_NOPTS_VALUE && start_s > 0 ? end_s - start_s : end_s;
  }

  struct Free {
    void operator()(AVFormatContext* file) const { ::avformat_close_input(&file); }
    void operator()(AVPacket* packet) const { ::av_packet_free(&packet); }
  };

  std::unique_ptr<AVFormatContext, Free> file_;
  std::unique_ptr<AVPacket, Free> packet_{::av_packet_alloc()};
  AVStream* video_ = nullptr;
};

class Libraries final : public Media {
 public:
  Libraries() {
    ::setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", 0);
    cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
    ::av_log_set_level(AV_LOG_QUIET);
  }

  [[nodiscard]] cv::Mat read(const fs::path& path, int flags) const override {
    return cv::imread(path.string(), flags);
  }

  [[nodiscard]] cv::Mat decode(std::span<const std::uint8_t> bytes, int flags) const override {
    // OpenCV takes no pointer to constant bytes; these are not written to.
    return cv::imdecode(cv::Mat(1, static_cast<int>(bytes.size()), CV_8UC1, const_cast<std::uint8_t*>(bytes.data())),
                        flags);
  }

  [[nodiscard]] bool encode(const char* extension, const cv::Mat& picture, std::vector<std::uint8_t>& bytes,
                            const std::vector<int>& options) const override {
    return cv::imencode(extension, picture, bytes, options);
  }

  [[nodiscard]] std::unique_ptr<cv::VideoCapture> capture() const override {
    return std::make_unique<cv::VideoCapture>();
  }
  [[nodiscard]] std::unique_ptr<cv::VideoWriter> writer(const fs::path& path, int backend, int codec, double fps,
                                                        cv::Size size) const override {
    return std::make_unique<cv::VideoWriter>(path.string(), backend, codec, fps, size);
  }

  [[nodiscard]] std::unique_ptr<Packets> packets(const fs::path& path) const override {
    auto opened = std::make_unique<Container>(path);
    return opened->is_open() ? std::move(opened) : nullptr;
  }
};

}  // namespace

// Not a name of C++, which dlsym() would have to spell in the compiler's way.
extern "C" __attribute__((visibility("default"))) const Media& holdfast_media() {
  static const Libraries libraries;
  return libraries;
}

}  // namespace holdfast::sim
