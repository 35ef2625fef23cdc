// SPDX-License-Identifier: Apache-2.0
// Messages of a log: schema texts and bytes as written down by hand after the definitions of ROS 2 and CDR.
#include "toolchain/log/messages.hpp"

#include <charconv>
#include <cmath>

#include "base/status.hpp"
#include "tests/support/cells.hpp"
#include "toolchain/log/csv_log.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast::log;

namespace {

// Counts how many were made.
struct Counted {
  Counted() { ++made; }
  Counted(const Counted& other) : text(other.text), numbers(other.numbers), more(other.more) { ++made; }
  Counted& operator=(const Counted&) = default;
  ~Counted() = default;
  std::string_view text;
  std::array<double, 3> numbers{};
  std::vector<double> more;
  static inline std::size_t made = 0;
};
struct ManyCounted {
  std::vector<Counted> all;
};

}  // namespace

template <>
struct holdfast::log::Message<Counted> {
  static constexpr std::string_view kPackage = "test", kType = "Counted";
  static constexpr std::tuple kFields{field("text", &Counted::text), field("numbers", &Counted::numbers),
                                      field("more", &Counted::more)};
};
template <>
struct holdfast::log::Message<ManyCounted> {
  static constexpr std::string_view kPackage = "test", kType = "ManyCounted";
  static constexpr std::tuple kFields{field("all", &ManyCounted::all)};
};

namespace {

using Bytes = std::vector<std::uint8_t>;

const std::string kHeaderTypes = std::string(80, '=') +
                                 "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n" +
                                 std::string(80, '=') + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n";

FrameRecord some_state() {
  FrameRecord state;
  state.header.stamp = {3, 40'000'000};
  state.frame = 76;
  state.state = holdfast::DeviceState::kSlip;
  state.state_name = "SLIP";
  state.reason = holdfast::Reason{98};
  state.reason_name = "slip";
  state.slip = state.alive = state.accepted = state.features_valid = state.rates_valid = true;
  state.markers = 63;
  state.vx_mm_s = -2.125;
  state.entropy_nat = 1.0 / 65536;
  state.histogram = {60, 1, 2};
  return state;
}

MarkerField some_field(std::size_t count) {
  MarkerField field;
  for (std::size_t i = 0; i < count; ++i) {
    const auto x = static_cast<double>(i);
    field.row.push_back(static_cast<std::uint8_t>(i / 9));
    field.col.push_back(static_cast<std::uint8_t>(i % 9));
    field.valid.push_back(1);
    field.x_px.push_back(x);
    field.y_px.push_back(-x);
    field.dx_px.push_back(x / 256);
    field.dy_px.push_back(0);
  }
  return field;
}

// A strict reader of numbers: digits, one point, digits; nothing else.
bool is_plain_number(std::string_view cell) {
  if (cell.starts_with('-')) cell.remove_prefix(1);
  const std::size_t digits = cell.find_first_not_of("0123456789");
  if (digits == 0 || cell.empty()) return false;
  if (digits == std::string_view::npos) return true;
  if (cell[digits] != '.') return false;
  cell.remove_prefix(digits + 1);
  return !cell.empty() && cell.find_first_not_of("0123456789") == std::string_view::npos;
}

// Of a line that needs no quotes.
std::vector<std::string> checked_cells(std::string_view line) {
  CHECK(line.ends_with('\n'));
  line.remove_suffix(1);
  CHECK(line.find_first_of("\n\r\" ") == std::string_view::npos);
  return holdfast::test::cells_of(line);
}

}  // namespace

TEST_GROUP(LogMessage){};

TEST(LogMessage, SchemasAreRosDefinitionsWithTheTypesInside) {
  STRCMP_EQUAL("sensor_msgs/msg/CompressedImage", schema_name<CompressedImage>().c_str());
  STRCMP_EQUAL(("std_msgs/Header header\nstring format\nuint8[] data\n" + kHeaderTypes).c_str(),
               schema_text<CompressedImage>().c_str());
  STRCMP_EQUAL("holdfast_msgs/msg/MarkerField", schema_name<MarkerField>().c_str());
  STRCMP_EQUAL(("std_msgs/Header header\n"
                "uint32 frame  # counted from 0\n"
                "uint8[] row\nuint8[] col\n"
                "uint8[] valid  # 0: lost, its figures mean nothing\n"
                "float64[] x_px  # where it is, pixels of the picture\n"
                "float64[] y_px\n"
                "float64[] dx_px  # how far from rest, pixels of the picture\n"
                "float64[] dy_px\n" +
                kHeaderTypes)
                   .c_str(),
               schema_text<MarkerField>().c_str());
  STRCMP_CONTAINS("uint32[15] histogram", schema_text<FrameRecord>().c_str());
  STRCMP_CONTAINS("\nbool slip\n", schema_text<FrameRecord>().c_str());
  // The states that its comment lists are those of the firmware.
  std::string states;
  for (const holdfast::StateInfo& state : holdfast::kStates) {
    states +=
        (states.empty() ? "" : ", ") + std::to_string(static_cast<int>(state.state)) + " " + std::string(state.name);
  }
  STRCMP_CONTAINS(("uint8 state  # " + states + "\n").c_str(), schema_text<FrameRecord>().c_str());
}

TEST(LogMessage, BytesAreCdr) {
  const Bytes jpeg{0xFF, 0xD8, 0xFF};
  CompressedImage picture;
  picture.header.stamp = {1, 2};
  picture.data = jpeg;
  const Bytes expected{0, 1, 0, 0,                                         // CDR, little endian
                       1, 0, 0, 0, 2,    0,    0,   0,                     // stamp
                       4, 0, 0, 0, 'g',  'e',  'l', 0,                     // length with the zero
                       5, 0, 0, 0, 'j',  'p',  'e', 'g', 0, /**/ 0, 0, 0,  // aligned to 4
                       3, 0, 0, 0, 0xFF, 0xD8, 0xFF};
  CHECK(expected == encode(picture));
  const MarkerField field = some_field(1);
  const Bytes one{0, 1, 0, 0, 0, 0,      0, 0, 0, 0, 0, 0,    4, 0, 0, 0, 'g', 'e', 'l', 0, 0, 0, 0, 0,
                  1, 0, 0, 0, 0, /**/ 0, 0, 0,                 // row
                  1, 0, 0, 0, 0, /**/ 0, 0, 0,                 // col
                  1, 0, 0, 0, 1, /**/ 0, 0, 0,                 // valid
                  1, 0, 0, 0, 0, 0,      0, 0, 0, 0, 0, 0,     // x: 8 bytes at 48, which 8 divides
                  1, 0, 0, 0, 0, 0,      0, 0, 0, 0, 0, 0x80,  // y: -0; and so on without a gap
                  1, 0, 0, 0, 0, 0,      0, 0, 0, 0, 0, 0,    1, 0, 0, 0, 0,   0,   0,   0, 0, 0, 0, 0};
  // Counted by hand: the content of x begins at 4+8+8+4+3*8+4 = 52-4 = 48 behind the head, y's count at 56, its content
  // at 60, which 8 does not divide: four bytes of padding.
  Bytes padded = one;
  std::size_t at = 4 + 60;
  for (int array = 0; array < 3; ++array, at += 16) padded.insert(padded.begin() + static_cast<long>(at), 4, 0);
  CHECK(padded == encode(field));
}

// Messages in a sequence: the count, then one behind the other, each aligned by its own members.
TEST(LogMessage, SequencesOfMessages) {
  STRCMP_EQUAL("foxglove_msgs/msg/ImageAnnotations", schema_name<ImageAnnotations>().c_str());
  const std::string text = schema_text<ImageAnnotations>();
  CHECK(
      text.starts_with("foxglove_msgs/CircleAnnotation[] circles\nfoxglove_msgs/PointsAnnotation[] points\n"
                       "foxglove_msgs/TextAnnotation[] texts\n"));
  const std::string point = "\nMSG: foxglove_msgs/Point2\nfloat64 x\nfloat64 y\n";
  STRCMP_CONTAINS(point.c_str(), text.c_str());
  CHECK(text.find(point) == text.rfind(point));  // each definition once
  ImageAnnotations drawn;
  drawn.texts = {{{1, 2}, {3, 4}, "hi", 5, {}, {}}, {{}, {}, "", 0, {}, {}}};
  const Bytes bytes = encode(drawn);
  const Bytes head{0, 1, 0, 0, 0, 0, 0, 0,   0,      0, 0, 0, 2, 0, 0, 0,  // no circles, no points, two texts
                   1, 0, 0, 0, 2, 0, 0, 0,   /**/ 0, 0, 0, 0,              // stamp; x at 24, which 8 divides
                   0, 0, 0, 0, 0, 0, 8, 0x40};
  CHECK(std::equal(head.begin(), head.end(), bytes.begin()));
  const auto again = decode<ImageAnnotations>(bytes);
  CHECK(again && again->texts.size() == 2 && again->texts[0].text == "hi" && again->texts[0].font_size == 5);
  CHECK(encode(*again) == bytes);
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    CHECK(!decode<ImageAnnotations>(std::span(bytes).first(size)));
  }
  Bytes many = bytes;
  many[12] = many[13] = many[14] = many[15] = 0xFF;  // a count of four billion is not believed
  CHECK(!decode<ImageAnnotations>(many));
}

TEST(LogMessage, DecodesWhatItEncodesAndNothingElse) {
  const Bytes state = encode(some_state());
  const auto again = decode<FrameRecord>(state);
  CHECK(again.has_value());
  CHECK(encode(*again) == state);
  CHECK(again->state_name == "SLIP" && again->reason == holdfast::Reason{98} && again->slip && !again->grip_ok &&
        again->markers == 63);
  CHECK(again->vx_mm_s == -2.125 && again->histogram[2] == 2 && again->header.stamp.nanosec == 40'000'000);
  const Bytes markers = encode(some_field(63));
  CHECK(decode<MarkerField>(markers)->dx_px[62] == 62.0 / 256);
  for (const Bytes& good : {state, markers}) {
    for (std::size_t size = 0; size < good.size(); ++size) {
      const std::span<const std::uint8_t> cut = std::span(good).first(size);
      CHECK(!decode<FrameRecord>(cut) && !decode<MarkerField>(cut));
    }
    Bytes longer = good;
    longer.push_back(0);
    CHECK(!decode<FrameRecord>(longer) && !decode<MarkerField>(longer));
  }
  // A count of four billion is not believed, a bool is 0 or 1, padding is 0, a text ends with its only zero.
  const auto with = [&](const Bytes& good, std::size_t at, std::uint8_t byte) {
    Bytes bytes = good;
    bytes.at(at) = byte;
    return bytes;
  };
  CHECK(!decode<MarkerField>(with(with(markers, 24, 0xFF), 27, 0xFF)));
  CHECK(decode<FrameRecord>(with(state, 16, 'x')).has_value());
  CHECK(!decode<FrameRecord>(with(state, 16, 0)));
  CHECK(!decode<FrameRecord>(with(state, 19, 'x')));
  CHECK(!decode<FrameRecord>(with(state, 25, 1)));  // between state and the length of its name
  const std::size_t slip = std::string(state.begin(), state.end()).find(std::string("slip\0\1", 6)) + 5;
  CHECK(!decode<FrameRecord>(with(state, slip, 2)));
  CHECK(!decode<FrameRecord>(with(state, 1, 0)));  // big endian
}

TEST(LogMessage, TheTableHasNumbersOnly) {
  const std::vector<std::string> names = checked_cells(csv_header());
  STRCMP_EQUAL("t_s", names.front().c_str());
  LONGS_EQUAL(46, names.size());
  STRCMP_EQUAL("friction_use", names.back().c_str());
  FrameRecord state = some_state();
  for (const double figure : {0.0, -0.0, 1e-9, -4096.0, 123456789.0, 1.0 / 3}) {
    state.vx_mm_s = state.vy_mm_s = state.entropy_nat = state.entropy_rate_nat_s = state.decided_us = figure;
    state.header.stamp = {2'000'000'000, 999'999'000};
    const std::vector<std::string> cells = checked_cells(csv_row(state));
    LONGS_EQUAL(names.size(), cells.size());
    for (const std::string& cell : cells) CHECK_TEXT(is_plain_number(cell), cell.c_str());
    STRCMP_EQUAL("2000000000.999999", cells[0].c_str());
    STRCMP_EQUAL("76", cells[1].c_str());
    STRCMP_EQUAL("3", cells[2].c_str());
    STRCMP_EQUAL("98", cells[3].c_str());
    double read = 0;
    std::from_chars(cells[11].data(), cells[11].data() + cells[11].size(), read);
    DOUBLES_EQUAL(figure, read, 5e-7);
    const auto first_bin = std::find(names.begin(), names.end(), "histogram_00") - names.begin();
    STRCMP_EQUAL("60", cells[static_cast<std::size_t>(first_bin)].c_str());
  }
}

// A count that fits for one byte each made a hundred times the message's bytes of elements, before the first was read.
TEST(LogMessage, MakesNoMoreElementsThanItsBytesCanHold) {
  const ManyCounted three{std::vector<Counted>(3)};
  const Bytes sound = encode(three);
  const auto read = decode<ManyCounted>(sound);
  CHECK_TRUE(read && read->all.size() == 3);
  Bytes filler{0, 1, 0, 0, 0, 16, 0, 0};  // 4096 of them
  filler.resize(filler.size() + 4096);
  Counted::made = 0;
  CHECK_FALSE(decode<ManyCounted>(filler).has_value());
  CHECK_TRUE(Counted::made < 4096 / 33 + 2);
}
