// SPDX-License-Identifier: Apache-2.0
// What a JPEG stream says before its entropy-coded data: markers, headers, Huffman codes (ITU-T T.81, annex B and C).
// Shared by the decoders of this folder; a picture that gets past here is one that they can decode.
//
// Accepted: baseline and extended sequential Huffman (SOF0, SOF1) of 8 bits, one component, or YCbCr in a single
// interleaved scan in which luma has the highest sampling (4:4:4, 4:2:2, 4:2:0, 4:4:0, 4:1:1 and the like); any tables,
// restart intervals, fill bytes, APPn and COM. Tables that a picture does not bring are those of annex K, as UVC
// cameras leave them out; nothing else is carried over from picture to picture.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "base/status.hpp"

namespace holdfast::jpeg_dc {

using Bytes = std::span<const std::uint8_t>;

// Why a picture was refused, in more detail than the seam's reasons. For the console; not sent on the wire.
enum class Error : std::uint8_t {
  kNone,
  kNoPicture,
  kTruncated,
  kNoMarker,
  kStrayMarker,
  kSegmentLength,
  kJfifVersion,
  kHuffmanTable,
  kNoHuffmanTable,
  kQuantTable,
  kNoQuantTable,
  kTwoFrames,
  kNoFrame,
  kEmptyPicture,
  kTooSmall,
  kTooLarge,
  kProcess,
  kPrecision,
  kComponents,
  kColourSpace,
  kSampling,
  kManyScans,
  kScanHeader,
  kBadCode,
  kPastLastCoefficient,
  kDcRange,
  kMarkerInData,
  kSpareData,
  kRestartOrder,
  kNoEnd,
};

struct ErrorInfo {
  Error error;
  Reason reason;          // as the seam says it
  std::string_view name;  // stable key for the console
  std::string_view text;
};

inline constexpr std::array<ErrorInfo, 30> kErrors{{
    {Error::kNone, Reason::kNone, "none", "decoded"},
    {Error::kNoPicture, Reason::kJpegDamaged, "no_picture", "the bytes do not begin with SOI"},
    {Error::kTruncated, Reason::kJpegDamaged, "truncated", "the bytes end before the picture does"},
    {Error::kNoMarker, Reason::kJpegDamaged, "no_marker", "something else stands where a marker must"},
    {Error::kStrayMarker, Reason::kJpegDamaged, "stray_marker", "a marker that has no place in the headers"},
    {Error::kSegmentLength, Reason::kJpegDamaged, "segment_length", "a segment's length does not fit its content"},
    {Error::kJfifVersion, Reason::kJpegDamaged, "jfif_version", "JFIF of another major version than 1"},
    {Error::kHuffmanTable, Reason::kJpegDamaged, "huffman_table", "a Huffman table that cannot be"},
    {Error::kNoHuffmanTable, Reason::kJpegDamaged, "no_huffman_table", "the scan names a Huffman table not sent"},
    {Error::kQuantTable, Reason::kJpegDamaged, "quant_table", "a quantisation table that cannot be"},
    {Error::kNoQuantTable, Reason::kJpegDamaged, "no_quant_table", "the frame names a quantisation table not sent"},
    {Error::kTwoFrames, Reason::kJpegDamaged, "two_frames", "a second frame header"},
    {Error::kNoFrame, Reason::kJpegDamaged, "no_frame", "a scan before the frame header"},
    {Error::kEmptyPicture, Reason::kJpegDamaged, "empty_picture", "width or height 0"},
    {Error::kTooSmall, Reason::kPictureTooSmall, "too_small", "smaller than the limit"},
    {Error::kTooLarge, Reason::kPictureTooLarge, "too_large", "larger than the fixed memory"},
    {Error::kProcess, Reason::kFrameFormat, "process", "progressive, lossless, hierarchical or arithmetic"},
    {Error::kPrecision, Reason::kFrameFormat, "precision", "not 8 bits per sample"},
    {Error::kComponents, Reason::kFrameFormat, "components", "neither 1 nor 3 components"},
    {Error::kColourSpace, Reason::kFrameFormat, "colour_space", "3 components that are not YCbCr"},
    {Error::kSampling, Reason::kFrameFormat, "sampling", "sampling factors impossible, or luma not the finest"},
    {Error::kManyScans, Reason::kFrameFormat, "many_scans", "more than one scan"},
    {Error::kScanHeader, Reason::kJpegDamaged, "scan_header", "the scan header contradicts the frame header"},
    {Error::kBadCode, Reason::kJpegDamaged, "bad_code", "bits that are no code, or a symbol that means nothing"},
    {Error::kPastLastCoefficient, Reason::kJpegDamaged, "past_last", "a block of more than 64 coefficients"},
    {Error::kDcRange, Reason::kJpegDamaged, "dc_range", "a luma level that 8-bit samples cannot give"},
    {Error::kMarkerInData, Reason::kJpegDamaged, "marker_in_data", "a marker before the last block"},
    {Error::kSpareData, Reason::kJpegDamaged, "spare_data", "bytes left over after the last block"},
    {Error::kRestartOrder, Reason::kJpegDamaged, "restart_order", "restart marker missing or out of order"},
    {Error::kNoEnd, Reason::kJpegDamaged, "no_end", "another marker than EOI after the scan"},
}};

[[nodiscard]] constexpr const ErrorInfo& info(Error error) {
  return kErrors[static_cast<std::size_t>(error)];
}

inline constexpr int kTableIds = 4;

// One Huffman code. `definition` is what DHT sends: 16 counts of codes per length, then the symbols in code order.
// Codes of one length are consecutive numbers, and every code is less than all longer ones (left-aligned), so that
// length l is the first with window < limit[l].
struct Code {
  // The last 512 windows, 0xFE00 and up: of the standard AC codes those longer than 11 bits. A search for one of them
  // would take 12 to 16 steps and a mispredicted branch (measured: 4 % of a dense picture's time).
  static constexpr std::uint32_t kFirstLong = 0x10000 - 512;
  std::array<std::uint16_t, 0x10000 - kFirstLong> long_codes;  // length << 8 | value; 0: no code
  std::array<std::uint8_t, 16 + 256> definition;
  std::size_t size = 0;                 // bytes of `definition` in use; 0: no table made yet
  std::array<std::uint32_t, 17> limit;  // first 16-bit window beyond the codes of length 1..16
  std::array<std::int32_t, 17> offset;  // place of a symbol in `definition` minus its code
};

struct Symbol {
  std::uint32_t length = 0;  // of its code; 0: these bits are no code
  std::uint32_t value = 0;
};

// Range: window16 holds the next 16 bits.
[[nodiscard]] Symbol find(const Code& code, std::uint32_t window16);

// False: more codes of a length than there are, or one of all ones, which T.81 reserves (C.2).
[[nodiscard]] bool make(Code& code, Bytes definition);
[[nodiscard]] bool made_of(const Code& code, Bytes definition);

struct Cursor {
  const std::uint8_t* at;
  const std::uint8_t* end;
};

// Any number of 0xFF, then the marker's code, which is neither 0 (a stuffed byte) nor 0xFF.
[[nodiscard]] Error read_marker(Cursor& cursor, std::uint8_t& code);

inline constexpr std::uint8_t kSof0 = 0xC0, kSof1 = 0xC1, kSof15 = 0xCF, kDht = 0xC4, kJpg = 0xC8, kDac = 0xCC;
inline constexpr std::uint8_t kRst0 = 0xD0, kSoi = 0xD8, kEoi = 0xD9, kSos = 0xDA, kDqt = 0xDB, kDri = 0xDD;
inline constexpr std::uint8_t kApp0 = 0xE0, kApp14 = 0xEE, kApp15 = 0xEF, kCom = 0xFE;

inline constexpr std::size_t kMaxComponents = 3;
inline constexpr std::int32_t kMaxBlocks = 10;  // in an MCU: T.81, B.2.3
inline constexpr std::int32_t kUnset = -1;

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
  std::array<Bytes, kTableIds> dc{};                                          // empty: not sent
  std::array<Bytes, kTableIds> ac{};
  std::int32_t restart_interval = 0;  // MCUs; 0: none
  bool jfif = false;
  std::int32_t adobe_transform = kUnset;
};

// From SOI to the end of the scan header; leaves the cursor at the first byte of entropy-coded data.
[[nodiscard]] Error read_headers(Headers& headers, Cursor& cursor);

}  // namespace holdfast::jpeg_dc
