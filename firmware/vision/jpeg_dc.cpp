// SPDX-License-Identifier: Apache-2.0
#include "vision/jpeg_dc.hpp"

#include <algorithm>

namespace holdfast::jpeg_dc {
namespace {

using Bytes = std::span<const std::uint8_t>;

constexpr bool errors_in_order() {
  for (std::size_t i = 0; i < kErrors.size(); ++i) {
    if (kErrors[i].error != static_cast<Error>(i)) return false;
  }
  return kErrors.back().error == Error::kNoEnd;
}
static_assert(errors_in_order());

// ---- Huffman codes and the tables made of them ----

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

struct Symbol {
  std::uint32_t length = 0;  // of its code; 0: these bits are no code
  std::uint32_t value = 0;
};

// Range: window16 holds the next 16 bits.
Symbol find(const Code& code, std::uint32_t window16) {
  for (std::uint32_t length = 1; length <= 16; ++length) {
    if (window16 >= code.limit[length]) continue;
    const std::int32_t place = static_cast<std::int32_t>(window16 >> (16 - length)) + code.offset[length];
    return {length, code.definition[static_cast<std::size_t>(place)]};
  }
  return {};
}

// False: more codes of a length than there are, or one of all ones, which T.81 reserves (C.2).
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
  code.size = definition.size();
  return true;
}

bool made_of(const Code& code, Bytes definition) {
  return std::equal(definition.begin(), definition.end(), code.definition.begin(),
                    code.definition.begin() + static_cast<std::ptrdiff_t>(code.size));
}

bool make(DcTable& table, Bytes definition) {
  if (!make(table.code, definition)) return false;
  if (std::any_of(definition.begin() + 16, definition.end(), [](std::uint8_t size) { return size > 15; })) {
    table.code.size = 0;
    return false;
  }
  for (std::uint32_t index = 0; index < table.first.size(); ++index) {
    const Symbol symbol = find(table.code, index << (16 - kDcIndexBits));
    const bool settled = symbol.length <= kDcIndexBits;  // or the code goes on beyond the index
    table.first[index] = static_cast<std::uint16_t>(settled ? symbol.value << 8 | symbol.length : 0);
  }
  return true;
}

constexpr std::uint32_t kSlow = 64;    // bit 6 of the coefficient number
constexpr std::uint32_t kEnded = 128;  // bit 7

// All symbols settled by the index bits, as long as bits and coefficients fit the entry.
std::uint16_t walk_entry(const Code& code, std::uint32_t index) {
  std::uint32_t used = 0;
  std::uint32_t advance = 0;
  while (used < kIndexBits) {
    const Symbol symbol = find(code, index << (16 - kIndexBits + used) & 0xFFFF);
    const std::uint32_t run = symbol.value >> 4;
    const std::uint32_t size = symbol.value & 15;
    if (symbol.length == 0 || used + symbol.length > kIndexBits || used + symbol.length + size > kMaxSkip) break;
    if (symbol.value == 0) return static_cast<std::uint16_t>((advance | kEnded) << 8 | (used + symbol.length));
    const bool means_nothing = size == 0 && run != 15;
    if (means_nothing || advance + run + 1 >= kSlow) break;
    used += symbol.length + size;
    advance += run + 1;
  }
  return static_cast<std::uint16_t>(used == 0 ? kSlow << 8 : advance << 8 | used);
}

bool make(AcTable& table, Bytes definition) {
  if (!make(table.code, definition)) return false;
  for (std::uint32_t index = 0; index < table.walk.size(); ++index) table.walk[index] = walk_entry(table.code, index);
  return true;
}

// ---- Headers ----

struct Cursor {
  const std::uint8_t* at;
  const std::uint8_t* end;
};

// Any number of 0xFF, then the marker's code, which is neither 0 (a stuffed byte) nor 0xFF.
Error read_marker(Cursor& cursor, std::uint8_t& code) {
  if (cursor.at == cursor.end) return Error::kTruncated;
  if (*cursor.at != 0xFF) return Error::kNoMarker;
  while (cursor.at != cursor.end && *cursor.at == 0xFF) ++cursor.at;
  if (cursor.at == cursor.end) return Error::kTruncated;
  code = *cursor.at++;
  return code == 0 ? Error::kNoMarker : Error::kNone;
}

constexpr std::uint8_t kSof0 = 0xC0, kSof1 = 0xC1, kSof15 = 0xCF, kDht = 0xC4, kJpg = 0xC8, kDac = 0xCC;
constexpr std::uint8_t kRst0 = 0xD0, kSoi = 0xD8, kEoi = 0xD9, kSos = 0xDA, kDqt = 0xDB, kDri = 0xDD;
constexpr std::uint8_t kApp0 = 0xE0, kApp14 = 0xEE, kApp15 = 0xEF, kCom = 0xFE;

constexpr std::size_t kMaxComponents = 3;
constexpr std::int32_t kMaxBlocks = 10;  // in an MCU: T.81, B.2.3
constexpr std::int32_t kUnset = -1;

struct Component {
  std::uint8_t id = 0;
  std::int32_t across = 0;  // sampling factors
  std::int32_t down = 0;
  std::size_t quant = 0;
  std::size_t dc = 0;
  std::size_t ac = 0;
};

// What the headers of one picture say. Huffman definitions point into the picture's bytes or to the standard ones.
struct Headers {
  std::int32_t width = 0;  // pixels of the whole picture; 0: no frame header yet
  std::int32_t height = 0;
  std::size_t components = 0;
  std::array<Component, kMaxComponents> component;
  std::array<std::int32_t, kTableIds> quant{kUnset, kUnset, kUnset, kUnset};  // divisor of DC
  std::array<Bytes, kTableIds> dc{kDcLuma, kDcChroma, {}, {}};
  std::array<Bytes, kTableIds> ac{kAcLuma, kAcChroma, {}, {}};
  std::int32_t restart_interval = 0;  // MCUs; 0: none
  bool jfif = false;
  std::int32_t adobe_transform = kUnset;
};

std::int32_t word(Bytes bytes, std::size_t at) {
  return bytes[at] << 8 | bytes[at + 1];
}

bool begins_with(Bytes segment, std::string_view tag) {
  return segment.size() >= tag.size() &&
         std::equal(tag.begin(), tag.end(), segment.begin(),
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

// From SOI to the end of the scan header; leaves the cursor at the first byte of entropy-coded data.
Error read_headers(Headers& headers, Cursor& cursor) {
  if (cursor.end - cursor.at < 2 || cursor.at[0] != 0xFF || cursor.at[1] != kSoi) return Error::kNoPicture;
  cursor.at += 2;
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

// ---- Bits ----

// Spelled out, because gcc makes one load and one swap of this at -O2, but not of a loop.
std::uint64_t next_eight(const std::uint8_t* at) {
  return std::uint64_t{at[0]} << 56 | std::uint64_t{at[1]} << 48 | std::uint64_t{at[2]} << 40 |
         std::uint64_t{at[3]} << 32 | std::uint64_t{at[4]} << 24 | std::uint64_t{at[5]} << 16 |
         std::uint64_t{at[6]} << 8 | std::uint64_t{at[7]};
}

// The next bits of the entropy-coded data, left-aligned in a 64-bit window. Stuffed zeros are taken out on the way;
// filling stops at a marker or at the end and then reads zeros. left() below 0 says that more was taken than there
// was: it is looked at once per MCU, which is soon enough, because a block takes at most 64 symbols whatever it reads.
class Bits {
 public:
  explicit Bits(Cursor data) : data_(data) {}

  // After it, at least 56 bits unless the data stopped.
  // Range: left_ is in [0, 63] wherever a byte is added, because it goes below 0 only after the data stopped.
  void fill() {
    if (data_.end - data_.at >= 8) {
      const std::uint64_t bytes = next_eight(data_.at);
      const std::uint64_t any_ff = (~bytes - 0x0101010101010101U) & bytes & 0x8080808080808080U;
      if (any_ff == 0) {
        window_ |= bytes >> left_;  // what goes beyond the whole bytes comes again, the same, with the next fill
        data_.at += (63 - left_) >> 3;
        left_ |= 56;
        return;
      }
    }
    *this = filled_by_bytes(*this);
  }

  // Range: bits 1..32.
  [[nodiscard]] std::uint32_t peek(int bits) const { return static_cast<std::uint32_t>(window_ >> (64 - bits)); }
  [[nodiscard]] std::uint64_t window() const { return window_; }
  void skip(std::uint32_t bits) {
    window_ <<= bits;
    left_ -= static_cast<std::int32_t>(bits);
  }
  [[nodiscard]] std::int32_t left() const { return left_; }
  // The first byte not yet in the window.
  [[nodiscard]] Cursor rest() const { return data_; }

 private:
  // By value and out of line: the window then stays in registers where it is used.
  [[gnu::noinline]] static Bits filled_by_bytes(Bits bits) {
    Cursor& data = bits.data_;
    while (bits.left_ < 56 && data.at != data.end) {
      const std::uint8_t byte = *data.at;
      if (byte == 0xFF) {
        if (data.end - data.at < 2 || data.at[1] != 0) break;
        ++data.at;
      }
      ++data.at;
      bits.window_ |= std::uint64_t{byte} << (56 - bits.left_);
      bits.left_ += 8;
    }
    return bits;
  }

  Cursor data_;
  std::uint64_t window_ = 0;
  std::int32_t left_ = 0;
};

// The marker that must follow the block just taken: what is left are the bits that fill up its last byte.
Error take_marker(Bits& bits, Cursor& cursor, std::uint8_t& code) {
  bits.fill();
  if (bits.left() >= 8) return Error::kSpareData;
  cursor = bits.rest();
  return read_marker(cursor, code);
}

// Why the data stopped.
Error shortage(const Bits& bits) {
  Cursor cursor = bits.rest();
  std::uint8_t code = 0;
  const Error error = read_marker(cursor, code);
  return error == Error::kTruncated ? Error::kTruncated : Error::kMarkerInData;
}

// ---- The scan ----

struct Block {
  const DcTable* dc = nullptr;
  const AcTable* ac = nullptr;
  bool luma = false;
  std::int32_t x = 0;  // place in the MCU, blocks
  std::int32_t y = 0;
};

struct Scan {
  std::array<Block, kMaxBlocks> block;
  std::size_t blocks = 0;   // in an MCU
  std::int32_t across = 1;  // luma blocks of an MCU
  std::int32_t down = 1;
  std::int32_t luma_quant = 1;
  std::int32_t restart_interval = 0;
};

struct SlowStep {
  Bits bits;
  std::uint32_t k = 0;
  Error error = Error::kNone;
};

// One AC symbol by the canonical rule.
[[gnu::noinline]] SlowStep slow_step(Bits bits, const Code& code, std::uint32_t k) {
  bits.fill();
  const Symbol symbol = find(code, bits.peek(16));
  const std::uint32_t run = symbol.value >> 4;
  const std::uint32_t size = symbol.value & 15;
  const bool means_nothing = size == 0 && run != 0 && run != 15;
  if (symbol.length == 0 || means_nothing) return {bits, kEnded, Error::kBadCode};
  bits.skip(symbol.length + size);
  bits.fill();
  if (symbol.value == 0) return {bits, kEnded};
  k += run + 1;
  if (k > 64) return {bits, kEnded, Error::kPastLastCoefficient};
  return {bits, k == 64 ? kEnded : k};
}

// From the first AC coefficient to the end of the block.
[[gnu::always_inline]] inline Error skip_coefficients(Bits& bits, const AcTable& table) {
  std::uint32_t k = 1;
  Error error = Error::kNone;
  const auto look_up = [&]() {
    const std::uint32_t entry = table.walk[bits.peek(kIndexBits)];
    const std::uint32_t next = k + (entry >> 8);
    if ((next & kSlow) == 0) [[likely]] {
      bits.skip(entry & 0xFF);
      k = next;
    } else {
      const SlowStep step = slow_step(bits, table.code, k);
      bits = step.bits;
      k = step.k;
      error = step.error;
    }
    return k < kEnded;
  };
  while (true) {
    if (bits.left() < 3 * kMaxSkip) bits.fill();
    if (!look_up()) return error;
    if (!look_up()) return error;
    if (!look_up()) return error;
  }
}

// The value whose `size` bits lead the window (T.81, F.2.2.1): a leading 0 is negative.
// Range: size 0..15, result within +-32767; size 0 gives 0.
std::int32_t difference(std::uint64_t window, std::uint32_t size) {
  const auto bits = static_cast<std::int32_t>(window >> 1 >> (63 - size));
  return bits < (1 << size) >> 1 ? bits - (1 << size) + 1 : bits;
}

// DC of 8-bit samples is within +-1024 even with divisor 1; twice that leaves room for encoders that round badly.
constexpr std::int32_t kMaxDc = 2047;

// libjpeg's 1x1 inverse transform: the mean to the nearest, halves up, modulo 1024 as its range table has it, then
// the level shift and the limits of a sample.
// Range: dc within kMaxDc, quant 1..32767: the product is below 2^26.
std::uint8_t pixel(std::int32_t dc, std::int32_t quant) {
  const std::int32_t mean = (((dc * quant + 4) >> 3) + 512) & 1023;  // 512 more than it is
  return static_cast<std::uint8_t>(std::clamp(mean - 512 + 128, 0, 255));
}

// Takes all MCUs of the scan. `out` has its size.
Error read_mcus(const Scan& scan, Cursor& cursor, LumaBuffer& out) {
  const std::int32_t mcus_across = (out.width + scan.across - 1) / scan.across;
  const std::int32_t mcus_down = (out.height + scan.down - 1) / scan.down;
  Bits bits(cursor);
  std::int32_t dc = 0;
  std::int32_t to_restart = scan.restart_interval;
  std::uint8_t restart = kRst0;
  for (std::int32_t row = 0; row < mcus_down; ++row) {
    for (std::int32_t column = 0; column < mcus_across; ++column) {
      if (scan.restart_interval != 0 && to_restart-- == 0) {
        std::uint8_t marker = 0;
        if (const Error error = take_marker(bits, cursor, marker); error != Error::kNone) return error;
        if (marker != restart) return Error::kRestartOrder;
        restart = static_cast<std::uint8_t>(kRst0 + (restart - kRst0 + 1) % 8);
        to_restart = scan.restart_interval - 1;
        bits = Bits(cursor);
        dc = 0;
      }
      for (std::size_t i = 0; i < scan.blocks; ++i) {
        const Block& block = scan.block[i];
        bits.fill();
        const std::uint32_t entry = block.dc->first[bits.peek(kDcIndexBits)];
        Symbol symbol{entry & 0xFF, entry >> 8};
        if (symbol.length == 0) [[unlikely]] {
          symbol = find(block.dc->code, bits.peek(16));
          if (symbol.length == 0) return bits.left() < 16 ? shortage(bits) : Error::kBadCode;
        }
        const auto taken = static_cast<std::int32_t>(symbol.length + symbol.value);
        if (block.luma) {
          dc += difference(bits.window() << symbol.length, symbol.value);
          if (dc < -kMaxDc || dc > kMaxDc) return taken > bits.left() ? shortage(bits) : Error::kDcRange;
          const std::int32_t x = column * scan.across + block.x;
          const std::int32_t y = row * scan.down + block.y;
          if (x < out.width && y < out.height) {
            std::uint8_t* line = out.pixels.data() + static_cast<std::ptrdiff_t>(y) * out.width;
            line[x] = pixel(dc, scan.luma_quant);
          }
        }
        bits.skip(symbol.length + symbol.value);
        if (const Error error = skip_coefficients(bits, *block.ac); error != Error::kNone) {
          return bits.left() < 0 ? shortage(bits) : error;
        }
      }
      if (bits.left() < 0) return shortage(bits);
    }
  }
  std::uint8_t marker = 0;
  if (const Error error = take_marker(bits, cursor, marker); error != Error::kNone) return error;
  return marker == kEoi ? Error::kNone : Error::kNoEnd;
}

// Makes the table unless it was made of the same definition.
template <typename Table>
Error prepare(Table& table, Bytes definition, std::uint32_t& tables_made) {
  if (definition.empty()) return Error::kNoHuffmanTable;
  if (made_of(table.code, definition)) return Error::kNone;
  ++tables_made;
  return make(table, definition) ? Error::kNone : Error::kHuffmanTable;
}

// The order of blocks in an MCU (T.81, A.2). A single component is never interleaved: its MCU is one block.
Error prepare_scan(State& state, const Headers& headers, Scan& scan) {
  for (std::size_t i = 0; i < headers.components; ++i) {
    const Component& component = headers.component[i];
    DcTable& dc = state.dc[component.dc];
    AcTable& ac = state.ac[component.ac];
    Error error = prepare(dc, headers.dc[component.dc], state.tables_made);
    if (error == Error::kNone) error = prepare(ac, headers.ac[component.ac], state.tables_made);
    if (error != Error::kNone) return error;
    const std::int32_t across = headers.components == 1 ? 1 : component.across;
    const std::int32_t down = headers.components == 1 ? 1 : component.down;
    for (std::int32_t block = 0; block < across * down; ++block) {
      scan.block[scan.blocks++] = {&dc, &ac, i == 0, block % across, block / across};
    }
    if (i == 0) {
      scan.across = across;
      scan.down = down;
      scan.luma_quant = headers.quant[component.quant];
    }
  }
  scan.restart_interval = headers.restart_interval;
  return Error::kNone;
}

Error decode_picture(State& state, Bytes bytes, const Limits& limits, LumaBuffer& out) {
  Cursor cursor{bytes.data(), bytes.data() + bytes.size()};
  Headers headers;
  if (const Error error = read_headers(headers, cursor); error != Error::kNone) return error;
  out.width = (headers.width + 7) / 8;
  out.height = (headers.height + 7) / 8;
  if (out.width > kMaxLumaWidth || out.height > kMaxLumaHeight) return Error::kTooLarge;
  if (out.width < limits.min_width || out.height < limits.min_height) return Error::kTooSmall;
  Scan scan;
  if (const Error error = prepare_scan(state, headers, scan); error != Error::kNone) return error;
  return read_mcus(scan, cursor, out);
}

}  // namespace

Status decode(State& state, std::span<const std::uint8_t> bytes, LumaBuffer& out, Limits limits) {
  state.error = decode_picture(state, bytes, limits, out);
  return {info(state.error).reason};
}

}  // namespace holdfast::jpeg_dc
