// SPDX-License-Identifier: Apache-2.0
#include "toolchain/session/track.hpp"

#include <sodium.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string_view>
#include <utility>

#include "drivers/sim/media.hpp"
#include "link/status_frame.hpp"
#include "toolchain/session/report.hpp"

namespace holdfast::tool {
namespace {

// The working image of an 8-megapixel camera at 1/8. At this quality one takes 5 to 12 kB, by its noise.
constexpr int kPictureWidth = 410;
constexpr int kJpegQuality = 60;
// Of a picture's width: 1/64 px of one 320 wide, an eighth of the trembling at rest.
constexpr double kMarkerUnits = 20'480;
constexpr int kLost = -32'768;  // in place of a displacement
constexpr unsigned kContactUnknown = 255;
constexpr std::size_t kLatencyBins = 30;
constexpr std::size_t kMostTruth = 5000;  // points of a curve 1000 wide
constexpr double kFresh_s = static_cast<double>(status_frame::kFreshFor.count()) * 1e-6;

// toolchain/page/model.js reads what this writes.
class Bytes {
 public:
  template <typename Value>
  Bytes& put(Value value) {
    static_assert(std::endian::native == std::endian::little);
    const auto raw = std::bit_cast<std::array<std::uint8_t, sizeof(Value)>>(value);
    bytes_.insert(bytes_.end(), raw.begin(), raw.end());
    return *this;
  }
  Bytes& put(double value, bool known) { return put(known ? static_cast<float>(value) : 0.0F); }
  std::vector<std::uint8_t> take() { return std::move(bytes_); }

 private:
  std::vector<std::uint8_t> bytes_;
};

std::string base64(const Thinned& thinned) {
  std::vector<std::uint8_t> bytes;
  for (const Thinned::Piece& piece : thinned.pieces())
    bytes.insert(bytes.end(), piece.bytes.begin(), piece.bytes.end());
  std::string out(sodium_base64_ENCODED_LEN(bytes.size(), sodium_base64_VARIANT_ORIGINAL), '\0');
  ::sodium_bin2base64(out.data(), out.size(), bytes.data(), bytes.size(), sodium_base64_VARIANT_ORIGINAL);
  out.pop_back();  // the terminating zero
  return out;
}

// Upper end of a scale: 1, 2 or 5 times a power of ten.
double round_up(double value) {
  const double power = std::pow(10, std::floor(std::log10(value)));
  for (const double lead : {1.0, 2.0, 5.0}) {
    if (lead * power >= value) return lead * power;
  }
  return 10 * power;
}

nlohmann::json latency_of(std::vector<float> us) {
  if (us.empty()) return nullptr;
  std::sort(us.begin(), us.end());
  const auto quantile = [&](double share) {
    return us[static_cast<std::size_t>(share * static_cast<double>(us.size() - 1))];
  };
  const double range_us = round_up(static_cast<double>(us.back()));
  std::array<long, kLatencyBins> bins{};
  for (const float value : us) {
    const auto bin = static_cast<std::size_t>(static_cast<double>(value) / range_us * kLatencyBins);
    ++bins[std::min(bin, kLatencyBins - 1)];
  }
  return {{"count", us.size()},  {"p50_us", quantile(0.5)}, {"p99_us", quantile(0.99)},
          {"max_us", us.back()}, {"range_us", range_us},    {"bins", bins}};
}

}  // namespace

void Thinned::keep(Piece piece) {
  bytes_ += piece.bytes.size();
  pieces_.push_back(std::move(piece));
  while (bytes_ > budget_ && pieces_.size() > 1) {
    std::size_t event_bytes = 0;
    for (const Piece& p : pieces_) event_bytes += p.event ? p.bytes.size() : 0;
    if (event_bytes > budget_ / 2) {  // a run that flickers: its events are thinned as well
      bool every_second = false;
      for (Piece& p : pieces_) p.event = p.event && (every_second = !every_second);
    } else {
      stride_ *= 2;
    }
    std::erase_if(pieces_, [&](const Piece& p) { return !p.event && p.index % stride_ != 0; });
    bytes_ = 0;
    for (const Piece& p : pieces_) bytes_ += p.bytes.size();
  }
}

void Track::add(const FrameRecord& frame, std::span<const Arrow> arrows, const TrackPicture& picture) {
  const bool event = static_cast<int>(frame.state) != last_state_ || frame.slip != last_slip_;
  last_state_ = static_cast<int>(frame.state);
  last_slip_ = frame.slip;
  width_px_ = std::max(width_px_, picture.width_px);
  height_px_ = std::max(height_px_, picture.height_px);
  if (width_px_ <= 0) {  // markers without a picture: whatever holds them
    for (const Arrow& a : arrows) height_px_ = std::max({height_px_, 1.1 * a.x_px, 1.1 * a.y_px});
  }
  keep_row(frame, event);
  // A simulation that enters at the features has no markers; a frame that lost all of them was rejected.
  const bool seen_any = std::any_of(arrows.begin(), arrows.end(), [](const Arrow& a) { return a.valid; });
  if (seen_any && markers_.wants(frames_, event)) keep_markers(arrows, event);
  if (picture.luma.data != nullptr && pictures_.wants(frames_, event)) keep_picture(picture.luma, event);
  ++frames_;
}

void Track::keep_row(const FrameRecord& f, bool event) {
  if (f.decided_us > 0) decided_us_.push_back(static_cast<float>(f.decided_us));
  if (f.accepted) last_edge_s_ = f.t_s();
  const bool fresh = f.t_s() - last_edge_s_ <= kFresh_s;
  if (!rows_.wants(frames_, event)) return;
  const bool bits[]{f.slip, f.grip_ok, f.accepted, f.features_valid, f.rates_valid, f.alive, fresh};
  unsigned flags = 0;
  for (std::size_t i = 0; i < std::size(bits); ++i) flags |= (bits[i] ? 1U : 0U) << i;
  Bytes row;
  row.put(frames_).put(f.frame).put(f.t_s());
  row.put(static_cast<std::uint8_t>(f.state)).put(static_cast<std::uint8_t>(f.reason));
  row.put(static_cast<std::uint8_t>(flags)).put(static_cast<std::uint8_t>(f.markers));
  row.put(f.entropy_nat, f.features_valid).put(f.entropy_rate_nat_s, f.rates_valid);
  row.put(f.vx_mm_s, f.rates_valid).put(f.vy_mm_s, f.rates_valid);
  row.put(f.decided_us, true);
  for (const std::uint32_t count : f.histogram) row.put(static_cast<std::uint8_t>(std::min(count, 255U)));
  std::size_t evidence = 0;
  if (f.evidence != Evidence::kNone) {
    const std::pair<std::string, std::string> one{f.evidence_name, f.evidence_unit};
    evidence = static_cast<std::size_t>(std::ranges::find(evidences_, one) - evidences_.begin()) + 1;
    if (evidence > evidences_.size()) evidences_.push_back(one);
  }
  row.put(static_cast<std::uint8_t>(f.contact_known ? static_cast<unsigned>(f.contact) : kContactUnknown));
  row.put(static_cast<std::uint8_t>(evidence)).put(f.evidence_value, true).put(f.evidence_threshold, true);
  row.put(static_cast<std::uint8_t>(std::min(f.evidence_frames, 255U)));
  row.put(f.imprint_um, f.features_valid).put(f.coarse_um, f.features_valid);
  row.put(static_cast<std::uint8_t>(f.load_basis)).put(static_cast<std::uint8_t>(f.load_within));
  row.put(std::hypot(f.shear_x_n, f.shear_y_n), true).put(f.normal_n, true).put(f.friction_use, true);
  rows_.keep({frames_, event, row.take()});
}

void Track::keep_markers(std::span<const Arrow> arrows, bool event) {
  // Every record is to be read alone, so the unit may not change: without a width, pixels of a picture 320 wide.
  const double unit = kMarkerUnits / (width_px_ > 0 ? width_px_ : 320.0);
  const auto units = [&](double px) {
    return static_cast<std::int16_t>(std::clamp(std::lround(px * unit), kLost + 1L, 32'767L));
  };
  Bytes record;
  record.put(frames_).put(static_cast<std::uint32_t>(arrows.size()));
  for (const Arrow& a : arrows) {
    record.put(units(a.x_px - a.dx_px)).put(units(a.y_px - a.dy_px));
    record.put(a.valid ? units(a.dx_px) : static_cast<std::int16_t>(kLost)).put(units(a.dy_px));
  }
  markers_.keep({frames_, event, record.take()});
}

void Track::keep_picture(const LumaView& picture, bool event) {
  // OpenCV takes no pointer to constant pixels; these are not written to.
  const cv::Mat whole(picture.height, picture.width, CV_8UC1, const_cast<std::uint8_t*>(picture.data),
                      static_cast<std::size_t>(picture.stride));
  cv::Mat small = whole;
  if (whole.cols > kPictureWidth) {
    const double scale = static_cast<double>(kPictureWidth) / whole.cols;
    cv::resize(whole, small, {}, scale, scale, cv::INTER_AREA);
  }
  std::vector<std::uint8_t> jpeg;
  if (!sim::media().encode(".jpg", small, jpeg, {cv::IMWRITE_JPEG_QUALITY, kJpegQuality})) return;
  Bytes head;
  head.put(frames_).put(static_cast<std::uint32_t>(jpeg.size()));
  std::vector<std::uint8_t> piece = head.take();
  piece.insert(piece.end(), jpeg.begin(), jpeg.end());
  pictures_.keep({frames_, event, std::move(piece)});
}

std::string Track::json(const ReportInfo& info) const {
  const bool sized = width_px_ > 0;
  const bool nothing = height_px_ <= 0;  // neither pictures nor markers
  nlohmann::json marks = nlohmann::json::array();
  for (const TruthMark& mark : info.marks) {
    if (std::isfinite(mark.t_s)) marks.push_back({{"t_s", mark.t_s}, {"name", mark.name}, {"onset", mark.onset}});
  }
  nlohmann::json series;
  if (info.series) {
    const auto& points = info.series->points;
    series = {{"name", info.series->name}, {"unit", info.series->unit}, {"points", nlohmann::json::array()}};
    const std::size_t step = points.size() / kMostTruth + 1;
    for (std::size_t i = 0; i < points.size(); i += step) series["points"].push_back(points[i]);
  }
  const nlohmann::json data = {{"frames", frames_},
                               {"clip", info.clip},
                               {"width_px", nothing ? 320.0
                                            : sized ? width_px_
                                                    : height_px_},
                               {"height_px", nothing ? 240.0 : height_px_},
                               {"marker_unit_px", (sized ? width_px_ : 320.0) / kMarkerUnits},
                               {"histogram_range_mm", info.histogram_range_mm},
                               {"marks", marks},
                               {"series", series},
                               {"evidences", evidences_},
                               {"contacts", contact::kPhaseNames},
                               {"latency", latency_of(decided_us_)},
                               {"every", {rows_.stride(), markers_.stride(), pictures_.stride()}},
                               {"rows", base64(rows_)},
                               {"markers", base64(markers_)},
                               {"pictures", base64(pictures_)}};
  const std::string text = data.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  std::string out;
  out.reserve(text.size());
  for (const char c : text) {  // no name in it may end the script element
    if (c == '<') {
      out += "\\u003c";
    } else {
      out += c;
    }
  }
  return out;
}

}  // namespace holdfast::tool
