// SPDX-License-Identifier: Apache-2.0
#include "vision/jpeg_stream.hpp"

#include <algorithm>

namespace holdfast::jpeg_dc {
namespace {

constexpr bool errors_in_order() {
  for (std::size_t i = 0; i < kErrors.size(); ++i) {
    if (kErrors[i].error != static_cast<Error>(i)) return false;
  }
  return kErrors.back().error == Error::kNoEnd;
}
static_assert(errors_in_order());

// T.81 annex K.3, in the form of DHT.
constexpr std::uint8_t kDcLuma[] = {0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0,  0,
                                    0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11};
constexpr std::uint8_t kDcChroma[] = {0, 3, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0,  0,
                                      0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11};
constexpr std::uint8_t kAcLuma[] = {
    0x00, 0x02, 0x01, 0x03, 0x03, 0x02, 0x04, 0x03, 0x05, 0x05, 0x04, 0x04, 0x00, 0x00, 0x01, 0x7d,  //
    0x01, 0x02, 0x03, 0x00, 0x04, 0x11, 0x05, 0x12, 0x21, 0x31, 0x41, 0x06, 0x13, 0x51, 0x61, 0x07, 0x22, 0x71,
    0x14, 0x32, 0x81, 0x91, 0xa1, 0x08, 0x23, 0x42, 0xb1, 0xc1, 0x15, 0x52, 0xd1, 0xf0, 0x24, 0x33, 0x62, 0x72,
    0x82, 0x09, 0x0a, 0x16, 0x17, 0x18, 0x19, 0x1a, 0x25, 0x26, 0x27, 0x28, 0x29, 0x2a, 0x34, 0x35, 0x36, 0x37,
    0x38, 0x39, 0x3a, 0x43, 0x44, 0x45, 0x46, 0x47, 0x48, 0x49, 0x4a, 0x53, 0x54, 0x55, 0x56, 0x57, 0x58, 0x59,
    0x5a, 0x63, 0x64, 0x65, 0x66, 0x67, 0x68, 0x69, 0x6a, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7a, 0x83,
    0x84, 0x85, 0x86, 0x87, 0x88, 0x89, 0x8a, 0x92, 0x93, 0x94, 0x95, 0x96, 0x97, 0x98, 0x99, 0x9a, 0xa2, 0xa3,
    0xa4, 0xa5, 0xa6, 0xa7, 0xa8, 0xa9, 0xaa, 0xb2, 0xb3, 0xb4, 0xb5, 0xb6, 0xb7, 0xb8, 0xb9, 0xba, 0xc2, 0xc3,
    0xc4, 0xc5, 0xc6, 0xc7, 0xc8, 0xc9, 0xca, 0xd2, 0xd3, 0xd4, 0xd5, 0xd6, 0xd7, 0xd8, 0xd9, 0xda, 0xe1, 0xe2,
    0xe3, 0xe4, 0xe5, 0xe6, 0xe7, 0xe8, 0xe9, 0xea, 0xf1, 0xf2, 0xf3, 0xf4, 0xf5, 0xf6, 0xf7, 0xf8, 0xf9, 0xfa};
constexpr std::uint8_t kAcChroma[] = {
    0x00, 0x02, 0x01, 0x02, 0x04, 0x04, 0x03, 0x04, 0x07, 0x05, 0x04, 0x04, 0x00, 0x01, 0x02, 0x77,  //
    0x00, 0x01, 0x02, 0x03, 0x11, 0x04, 0x05, 0x21, 0x31, 0x06, 0x12, 0x41, 0x51, 0x07, 0x61, 0x71, 0x13, 0x22,
    0x32, 0x81, 0x08, 0x14, 0x42, 0x91, 0xa1, 0xb1, 0xc1, 0x09, 0x23, 0x33, 0x52, 0xf0, 0x15, 0x62, 0x72, 0xd1,
    0x0a, 0x16, 0x24, 0x34, 0xe1, 0x25, 0xf1, 0x17, 0x18, 0x19, 0x1a, 0x26, 0x27, 0x28, 0x29, 0x2a, 0x35, 0x36,
    0x37, 0x38, 0x39, 0x3a, 0x43, 0x44, 0x45, 0x46, 0x47, 0x48, 0x49, 0x4a, 0x53, 0x54, 0x55, 0x56, 0x57, 0x58,
    0x59, 0x5a, 0x63, 0x64, 0x65, 0x66, 0x67, 0x68, 0x69, 0x6a, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7a,
    0x82, 0x83, 0x84, 0x85, 0x86, 0x87, 0x88, 0x89, 0x8a, 0x92, 0x93, 0x94, 0x95, 0x96, 0x97, 0x98, 0x99, 0x9a,
    0xa2, 0xa3, 0xa4, 0xa5, 0xa6, 0xa7, 0xa8, 0xa9, 0xaa, 0xb2, 0xb3, 0xb4, 0xb5, 0xb6, 0xb7, 0xb8, 0xb9, 0xba,
    0xc2, 0xc3, 0xc4, 0xc5, 0xc6, 0xc7, 0xc8, 0xc9, 0xca, 0xd2, 0xd3, 0xd4, 0xd5, 0xd6, 0xd7, 0xd8, 0xd9, 0xda,
    0xe2, 0xe3, 0xe4, 0xe5, 0xe6, 0xe7, 0xe8, 0xe9, 0xea, 0xf2, 0xf3, 0xf4, 0xf5, 0xf6, 0xf7, 0xf8, 0xf9, 0xfa};
static_assert(sizeof kDcLuma == 16 + 12 && sizeof kDcChroma == 16 + 12);
static_assert(sizeof kAcLuma == 16 + 162 && sizeof kAcChroma == 16 + 162);

std::int32_t word(Bytes bytes, std::size_t at) {
  return bytes[at] << 8 | bytes[at + 1];
}

// Range: the segment is as long as the tag at least.
bool begins_with(Bytes segment, std::string_view tag) {
  return std::equal(tag.begin(), tag.end(), segment.begin(),
                    [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; });
}

Error read_dqt(Headers& headers, Bytes segment) {
  while (!segment.empty()) {
    const std::size_t wide = segment[0] >> 4;
    const std::size_t id = segment[0] & 15;
    if (wide > 1 || id >= kTableIds) return Error::kQuantTable;
    const std::size_t size = 1 + 64 * (wide + 1);
    if (segment.size() < size) return Error::kSegmentLength;
    headers.quant[id] = wide != 0 ? word(segment, 1) : segment[1];
    segment = segment.subspan(size);
  }
  return Error::kNone;
}

Error read_dht(Headers& headers, Bytes segment) {
  while (!segment.empty()) {
    const std::size_t kind = segment[0] >> 4;
    const std::size_t id = segment[0] & 15;
    if (kind > 1 || id >= kTableIds) return Error::kHuffmanTable;
    if (segment.size() < 1 + 16) return Error::kSegmentLength;
    std::size_t symbols = 0;
    for (std::size_t i = 1; i <= 16; ++i) symbols += segment[i];
    if (symbols > 256) return Error::kHuffmanTable;
    if (segment.size() < 1 + 16 + symbols) return Error::kSegmentLength;
    (kind == 0 ? headers.dc : headers.ac)[id] = segment.subspan(1, 16 + symbols);
    segment = segment.subspan(1 + 16 + symbols);
  }
  return Error::kNone;
}

// APP0 of JFIF and APP14 of Adobe tell the colour space; lengths as libjpeg asks for them.
Error read_app(Headers& headers, std::uint8_t marker, Bytes segment) {
  if (marker == kApp0 && segment.size() >= 14 && begins_with(segment, std::string_view("JFIF\0", 5))) {
    headers.jfif = true;
    if (segment[5] != 1) return Error::kJfifVersion;
  }
  if (marker == kApp14 && segment.size() >= 12 && begins_with(segment, "Adobe")) headers.adobe_transform = segment[11];
  return Error::kNone;
}

Error read_frame(Headers& headers, Bytes segment) {
  if (headers.width != 0) return Error::kTwoFrames;
  if (segment.size() < 6) return Error::kSegmentLength;
  if (segment[0] != 8) return Error::kPrecision;
  headers.height = word(segment, 1);
  headers.width = word(segment, 3);
  if (headers.width == 0 || headers.height == 0) return Error::kEmptyPicture;
  headers.components = segment[5];
  if (segment.size() != 6 + 3 * headers.components) return Error::kSegmentLength;
  if (headers.components != 1 && headers.components != kMaxComponents) return Error::kComponents;
  std::int32_t blocks = 0;
  for (std::size_t i = 0; i < headers.components; ++i) {
    const Bytes about = segment.subspan(6 + 3 * i, 3);
    Component& component = headers.component[i];
    const Component& luma = headers.component[0];
    component.id = about[0];
    component.across = about[1] >> 4;
    component.down = about[1] & 15;
    component.quant = about[2];
    if (component.across < 1 || component.across > 4 || component.down < 1 || component.down > 4) {
      return Error::kSampling;
    }
    if (component.across > luma.across || component.down > luma.down) return Error::kSampling;
    if (component.quant >= kTableIds) return Error::kNoQuantTable;
    blocks += component.across * component.down;
  }
  return headers.components == 1 || blocks <= kMaxBlocks ? Error::kNone : Error::kSampling;
}

// As libjpeg guesses, which knows the habits of encoders: JFIF is YCbCr, then Adobe's word counts, then the names.
bool is_ycbcr(const Headers& headers) {
  if (headers.jfif) return true;
  if (headers.adobe_transform != kUnset) return headers.adobe_transform == 1;
  return !(headers.component[0].id == 'R' && headers.component[1].id == 'G' && headers.component[2].id == 'B');
}

Error read_scan(Headers& headers, Bytes segment) {
  if (headers.width == 0) return Error::kNoFrame;
  if (segment.empty() || segment.size() != 4 + 2 * std::size_t{segment[0]}) return Error::kSegmentLength;
  if (segment[0] < headers.components) return Error::kManyScans;
  if (segment[0] > headers.components) return Error::kScanHeader;
  if (headers.components == kMaxComponents && !is_ycbcr(headers)) return Error::kColourSpace;
  for (std::size_t i = 0; i < headers.components; ++i) {
    Component& component = headers.component[i];
    if (segment[1 + 2 * i] != component.id) return Error::kScanHeader;
    component.dc = segment[2 + 2 * i] >> 4;
    component.ac = segment[2 + 2 * i] & 15;
    if (component.dc >= kTableIds || component.ac >= kTableIds) return Error::kNoHuffmanTable;
    if (headers.quant[component.quant] == kUnset) return Error::kNoQuantTable;
  }
  // 0 would be a picture without luma; libjpeg never writes more than 32767 and would read it as negative.
  const std::int32_t luma_quant = headers.quant[headers.component[0].quant];
  if (luma_quant == 0 || luma_quant > 32767) return Error::kQuantTable;
  const Bytes spectrum = segment.last(3);  // all 64 coefficients at full precision: the only choice of sequential modes
  return spectrum[0] == 0 && spectrum[1] == 63 && spectrum[2] == 0 ? Error::kNone : Error::kScanHeader;
}

Error read_segment(Headers& headers, std::uint8_t marker, Bytes segment) {
  if (marker == kSof0 || marker == kSof1) return read_frame(headers, segment);
  if (marker == kDht) return read_dht(headers, segment);
  if (marker == kDqt) return read_dqt(headers, segment);
  if (marker == kSos) return read_scan(headers, segment);
  if (marker >= kApp0 && marker <= kApp15) return read_app(headers, marker, segment);
  if (marker == kCom) return Error::kNone;
  if (marker == kDri) {
    if (segment.size() != 2) return Error::kSegmentLength;
    headers.restart_interval = word(segment, 0);
    return Error::kNone;
  }
  const bool other_process = marker >= kSof0 && marker <= kSof15 && marker != kJpg;  // DAC belongs to arithmetic
  return other_process ? Error::kProcess : Error::kStrayMarker;
}
static_assert(kDac > kSof0 && kDac < kSof15);

}  // namespace

namespace {

// By the canonical rule.
Symbol search(const Code& code, std::uint32_t window16) {
  for (std::uint32_t length = 1; length <= 16; ++length) {
    if (window16 >= code.limit[length]) continue;
    const std::int32_t place = static_cast<std::int32_t>(window16 >> (16 - length)) + code.offset[length];
    return {length, code.definition[static_cast<std::size_t>(place)]};
  }
  return {};
}

}  // namespace

Symbol find(const Code& code, std::uint32_t window16) {
  if (window16 < Code::kFirstLong) return search(code, window16);
  const std::uint32_t entry = code.long_codes[window16 - Code::kFirstLong];
  return {entry >> 8, entry & 0xFF};
}

bool make(Code& code, Bytes definition) {
  code.size = 0;  // stays so on failure: a half-made table is never taken for the one of the next picture
  std::copy(definition.begin(), definition.end(), code.definition.begin());
  std::uint32_t next = 0;
  std::int32_t place = 16;
  for (std::uint32_t length = 1; length <= 16; ++length) {
    const std::uint32_t count = code.definition[length - 1];
    code.offset[length] = place - static_cast<std::int32_t>(next);
    next += count;
    place += static_cast<std::int32_t>(count);
    if (count != 0 && next >= 1U << length) return false;
    code.limit[length] = next << (16 - length);
    next <<= 1;
  }
  for (std::uint32_t i = 0; i < code.long_codes.size(); ++i) {
    const Symbol symbol = search(code, Code::kFirstLong + i);
    code.long_codes[i] = static_cast<std::uint16_t>(symbol.length << 8 | symbol.value);
  }
  code.size = definition.size();
  return true;
}

bool made_of(const Code& code, Bytes definition) {
  return std::equal(definition.begin(), definition.end(), code.definition.begin(),
                    code.definition.begin() + static_cast<std::ptrdiff_t>(code.size));
}

Error read_marker(Cursor& cursor, std::uint8_t& code) {
  if (cursor.at == cursor.end) return Error::kTruncated;
  if (*cursor.at != 0xFF) return Error::kNoMarker;
  while (cursor.at != cursor.end && *cursor.at == 0xFF) ++cursor.at;
  if (cursor.at == cursor.end) return Error::kTruncated;
  code = *cursor.at++;
  return code == 0 ? Error::kNoMarker : Error::kNone;
}

Error read_headers(Headers& headers, Cursor& cursor) {
  if (cursor.end - cursor.at < 2 || cursor.at[0] != 0xFF || cursor.at[1] != kSoi) return Error::kNoPicture;
  cursor.at += 2;
  headers.dc = {kDcLuma, kDcChroma, {}, {}};
  headers.ac = {kAcLuma, kAcChroma, {}, {}};
  for (std::uint8_t marker = 0; marker != kSos;) {
    if (const Error error = read_marker(cursor, marker); error != Error::kNone) return error;
    const bool alone = marker == 0x01 || (marker >= kRst0 && marker <= kEoi);  // TEM, RSTn, SOI, EOI have no segment
    if (alone) return Error::kStrayMarker;
    const Bytes rest(cursor.at, cursor.end);
    if (rest.size() < 2) return Error::kTruncated;
    const auto length = static_cast<std::size_t>(word(rest, 0));
    if (length < 2) return Error::kSegmentLength;
    if (length > rest.size()) return Error::kTruncated;
    if (const Error error = read_segment(headers, marker, rest.subspan(2, length - 2)); error != Error::kNone) {
      return error;
    }
    cursor.at += length;
  }
  return Error::kNone;
}

}  // namespace holdfast::jpeg_dc
