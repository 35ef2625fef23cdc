// SPDX-License-Identifier: Apache-2.0
// What a log says of a frame, as ROS 2 messages: the camera's picture, what was decided, and where the markers are.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <string_view>
#include <tuple>
#include <vector>

#include "base/status.hpp"
#include "slip/evidence.hpp"
#include "tactile/contact.hpp"
#include "tactile/load.hpp"
#include "tactile/types.hpp"
#include "toolchain/log/ros_message.hpp"

namespace holdfast::log {

// builtin_interfaces and std_msgs, as ROS 2 has them.
struct Time {
  std::int32_t sec = 0;
  std::uint32_t nanosec = 0;
};
struct Header {
  Time stamp;  // since the first frame of the run
  std::string_view frame_id = "gel";
};

// sensor_msgs
struct CompressedImage {
  Header header;
  std::string_view format = "jpeg";
  std::span<const std::uint8_t> data;
};

// A frame's facts, wherever the host keeps or shows them: report, page, logs, telemetry of a device. On the wire it is
// the message SlipState; the columns of --log are its fields.
struct FrameRecord {
  Header header;
  std::uint32_t frame = 0;
  DeviceState state = DeviceState::kBoot;
  std::string_view state_name;
  Reason reason = Reason::kNone;
  std::string_view reason_name;
  bool slip = false;
  bool grip_ok = false;
  bool alive = false;           // level of the line ALIVE
  bool accepted = false;        // ALIVE toggled
  bool features_valid = false;  // markers, entropy and histogram mean something
  bool rates_valid = false;     // so do the speeds and the rate of entropy
  std::uint32_t markers = 0;
  double vx_mm_s = 0;
  double vy_mm_s = 0;
  double entropy_nat = 0;
  double entropy_rate_nat_s = 0;
  double decided_us = 0;  // arrival to edge; 0: not known (virtual time)
  // What the verdict stands on; 0 all, where nobody knows (a device's frames on serial).
  contact::Phase contact = contact::Phase::kEmpty;
  bool contact_known = false;
  Evidence evidence = Evidence::kNone;
  std::string_view evidence_name;
  double evidence_value = 0;
  double evidence_threshold = 0;
  std::string_view evidence_unit;
  std::uint32_t evidence_frames = 0;
  double imprint_um = 0;
  double coarse_um = 0;
  std::array<std::uint32_t, kHistogramBins> histogram{};
  // The load on the gel; 0 all, where nobody knows.
  load::Basis load_basis = load::Basis::kNone;
  bool load_within = false;
  bool load_strained = false;
  double shear_x_n = 0;
  double shear_y_n = 0;
  double normal_n = 0;
  double friction_use = 0;

  [[nodiscard]] double t_s() const {
    const std::uint64_t us = time_ns() / 1000;
    return static_cast<double>(us) / 1e6;
  }
  [[nodiscard]] std::uint64_t time_ns() const {
    return static_cast<std::uint64_t>(header.stamp.sec) * 1'000'000'000 + header.stamp.nanosec;
  }
  // To the microsecond, as all times of the firmware. Range: below 2^31 s; what is negative counts as 0.
  void set_time(double t_s) {
    const auto us = static_cast<std::uint64_t>(std::llround(std::max(t_s, 0.0) * 1e6));
    header.stamp = {static_cast<std::int32_t>(us / 1'000'000), static_cast<std::uint32_t>(us % 1'000'000 * 1000)};
  }
  void set_state(DeviceState now, Reason why) {
    state = now, state_name = info(now).name;
    reason = why, reason_name = info(why).name;
  }
};

// A marker in pixels of a picture, as in the markers CSV: where it is now and how far it is from rest.
struct Arrow {
  double x_px = 0;
  double y_px = 0;
  double dx_px = 0;
  double dy_px = 0;
  bool valid = false;
};

struct MarkerField {
  Header header;
  std::uint32_t frame = 0;
  std::vector<std::uint8_t> row;
  std::vector<std::uint8_t> col;
  std::vector<std::uint8_t> valid;
  std::vector<double> x_px;
  std::vector<double> y_px;
  std::vector<double> dx_px;
  std::vector<double> dy_px;
};

// foxglove_msgs: what a viewer draws over a picture. Places are in pixels of the picture, from the top left corner of
// its first pixel.
struct Point2 {
  double x = 0;
  double y = 0;
};
struct Color {
  double r = 0;
  double g = 0;
  double b = 0;
  double a = 0;
};
struct CircleAnnotation {
  Time timestamp;
  Point2 position;
  double diameter = 0;
  double thickness = 0;
  Color fill_color, outline_color;
};
struct PointsAnnotation {
  static constexpr std::uint8_t kPoints = 1, kLineList = 4;
  Time timestamp;
  std::uint8_t type = kPoints;
  std::vector<Point2> points;
  Color outline_color;
  std::vector<Color> outline_colors;
  Color fill_color;
  double thickness = 0;
};
struct TextAnnotation {
  Time timestamp;
  Point2 position;
  std::string_view text;
  double font_size = 0;
  Color text_color, background_color;
};
struct ImageAnnotations {
  std::vector<CircleAnnotation> circles;
  std::vector<PointsAnnotation> points;
  std::vector<TextAnnotation> texts;
};

template <>
struct Message<Time> {
  static constexpr std::string_view kPackage = "builtin_interfaces", kType = "Time";
  static constexpr std::tuple kFields{field("sec", &Time::sec), field("nanosec", &Time::nanosec)};
};
template <>
struct Message<Header> {
  static constexpr std::string_view kPackage = "std_msgs", kType = "Header";
  static constexpr std::tuple kFields{field("stamp", &Header::stamp), field("frame_id", &Header::frame_id)};
};
template <>
struct Message<CompressedImage> {
  static constexpr std::string_view kPackage = "sensor_msgs", kType = "CompressedImage";
  static constexpr std::tuple kFields{field("header", &CompressedImage::header),
                                      field("format", &CompressedImage::format), field("data", &CompressedImage::data)};
};
template <>
struct Message<FrameRecord> {
  static constexpr std::string_view kPackage = "holdfast_msgs", kType = "SlipState";
  static constexpr std::tuple kFields{
      field("header", &FrameRecord::header),
      field("frame", &FrameRecord::frame, "counted from 0"),
      field("state", &FrameRecord::state, "0 BOOT, 1 REFERENCE, 2 OK, 3 SLIP, 4 DEGRADED, 5 FAULT"),
      field("state_name", &FrameRecord::state_name),
      field("reason", &FrameRecord::reason, "why; numbers and names in firmware/app/STATES.md"),
      field("reason_name", &FrameRecord::reason_name),
      field("slip", &FrameRecord::slip),
      field("grip_ok", &FrameRecord::grip_ok, "what the line GRIP_OK was told"),
      field("alive", &FrameRecord::alive, "level of the line ALIVE"),
      field("accepted", &FrameRecord::accepted, "the picture was used: ALIVE toggled"),
      field("features_valid", &FrameRecord::features_valid, "markers, entropy and histogram mean something"),
      field("rates_valid", &FrameRecord::rates_valid, "so do the speeds and the rate of entropy"),
      field("markers", &FrameRecord::markers, "found"),
      field("vx_mm_s", &FrameRecord::vx_mm_s, "mean speed of the markers, mm/s"),
      field("vy_mm_s", &FrameRecord::vy_mm_s, "mm/s"),
      field("entropy_nat", &FrameRecord::entropy_nat, "of the displacements, nat"),
      field("entropy_rate_nat_s", &FrameRecord::entropy_rate_nat_s, "nat/s"),
      field("decided_us", &FrameRecord::decided_us, "from the frame's arrival to the lines, us; 0: not known"),
      field("contact", &FrameRecord::contact, "0 EMPTY, 1 TOUCHING, 2 HELD"),
      field("contact_known", &FrameRecord::contact_known, "contact means something: the model reads the picture"),
      field("evidence", &FrameRecord::evidence,
            "the verdict's: 0 none, 1 imprint, 2 coarse, 3 markers, 4 contact, 5 turnover"),
      field("evidence_name", &FrameRecord::evidence_name),
      field("evidence_value", &FrameRecord::evidence_value, "above the threshold: slip, unless the contact grows"),
      field("evidence_threshold", &FrameRecord::evidence_threshold),
      field("evidence_unit", &FrameRecord::evidence_unit, "of both"),
      field("evidence_frames", &FrameRecord::evidence_frames, "in a row that said slip"),
      field("imprint_um", &FrameRecord::imprint_um, "how far the imprint moved against the gel within 0.16 s, um"),
      field("coarse_um", &FrameRecord::coarse_um, "the same of what is smoother than a patch, um"),
      field("histogram", &FrameRecord::histogram, "markers by the length of their displacement"),
      field("load_basis", &FrameRecord::load_basis,
            "of the forces: 0 none, 1 uncalibrated, 2 one_weight, 3 two_weights"),
      field("load_within", &FrameRecord::load_within, "the contact is known to lie within the lattice"),
      field("load_strained", &FrameRecord::load_strained, "beyond the gel's linear range"),
      field("shear_x_n", &FrameRecord::shear_x_n, "force that the object lays on the gel, N"),
      field("shear_y_n", &FrameRecord::shear_y_n, "N"),
      field("normal_n", &FrameRecord::normal_n, "N"),
      field("friction_use", &FrameRecord::friction_use, "shear over normal load; 0: too little presses to tell"),
  };
};
template <>
struct Message<MarkerField> {
  static constexpr std::string_view kPackage = "holdfast_msgs", kType = "MarkerField";
  static constexpr std::tuple kFields{
      field("header", &MarkerField::header),
      field("frame", &MarkerField::frame, "counted from 0"),
      field("row", &MarkerField::row),
      field("col", &MarkerField::col),
      field("valid", &MarkerField::valid, "0: lost, its figures mean nothing"),
      field("x_px", &MarkerField::x_px, "where it is, pixels of the picture"),
      field("y_px", &MarkerField::y_px),
      field("dx_px", &MarkerField::dx_px, "how far from rest, pixels of the picture"),
      field("dy_px", &MarkerField::dy_px),
  };
};

template <>
struct Message<Point2> {
  static constexpr std::string_view kPackage = "foxglove_msgs", kType = "Point2";
  static constexpr std::tuple kFields{field("x", &Point2::x), field("y", &Point2::y)};
};
template <>
struct Message<Color> {
  static constexpr std::string_view kPackage = "foxglove_msgs", kType = "Color";
  static constexpr std::tuple kFields{field("r", &Color::r), field("g", &Color::g), field("b", &Color::b),
                                      field("a", &Color::a)};
};
template <>
struct Message<CircleAnnotation> {
  static constexpr std::string_view kPackage = "foxglove_msgs", kType = "CircleAnnotation";
  static constexpr std::tuple kFields{
      field("timestamp", &CircleAnnotation::timestamp),   field("position", &CircleAnnotation::position),
      field("diameter", &CircleAnnotation::diameter),     field("thickness", &CircleAnnotation::thickness),
      field("fill_color", &CircleAnnotation::fill_color), field("outline_color", &CircleAnnotation::outline_color)};
};
template <>
struct Message<PointsAnnotation> {
  static constexpr std::string_view kPackage = "foxglove_msgs", kType = "PointsAnnotation";
  static constexpr std::tuple kFields{field("timestamp", &PointsAnnotation::timestamp),
                                      field("type", &PointsAnnotation::type, "1 points, 4 a list of lines"),
                                      field("points", &PointsAnnotation::points),
                                      field("outline_color", &PointsAnnotation::outline_color),
                                      field("outline_colors", &PointsAnnotation::outline_colors),
                                      field("fill_color", &PointsAnnotation::fill_color),
                                      field("thickness", &PointsAnnotation::thickness)};
};
template <>
struct Message<TextAnnotation> {
  static constexpr std::string_view kPackage = "foxglove_msgs", kType = "TextAnnotation";
  static constexpr std::tuple kFields{field("timestamp", &TextAnnotation::timestamp),
                                      field("position", &TextAnnotation::position),
                                      field("text", &TextAnnotation::text),
                                      field("font_size", &TextAnnotation::font_size),
                                      field("text_color", &TextAnnotation::text_color),
                                      field("background_color", &TextAnnotation::background_color)};
};
template <>
struct Message<ImageAnnotations> {
  static constexpr std::string_view kPackage = "foxglove_msgs", kType = "ImageAnnotations";
  static constexpr std::tuple kFields{field("circles", &ImageAnnotations::circles),
                                      field("points", &ImageAnnotations::points),
                                      field("texts", &ImageAnnotations::texts)};
};

inline constexpr std::string_view kCameraTopic = "/holdfast/camera";
inline constexpr std::string_view kSlipTopic = "/holdfast/slip";
inline constexpr std::string_view kMarkersTopic = "/holdfast/markers";
inline constexpr std::string_view kAnnotationsTopic = "/holdfast/annotations";

}  // namespace holdfast::log
