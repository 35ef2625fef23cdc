// SPDX-License-Identifier: Apache-2.0
// JPEG pictures to luma at 1/8: the firmware's own decoder, plain scalar form.
//
// Why 1/8 is cheap. JPEG cuts a picture into blocks of 8x8 pixels and sends each as 64 frequency coefficients. The
// first, called DC, is 8 times the block's mean, so luma at 1/8 needs one number per block and no inverse transform
// at all. The other 63 (AC) are 95 % of the bytes, but of them we need only to know where they end.
//
// What a block looks like in the bit stream (ITU-T T.81, F.2.2): a prefix code names the size s of the DC difference
// to the block before, then s bits hold it. Then AC symbols: a prefix code for one byte (run r, size s), r zeros are
// skipped, s bits hold the coefficient. (0,0) ends the block, (15,0) is 16 zeros, and the block also ends when the
// 63rd coefficient was sent. Colour pictures interleave: each MCU holds, say for 4:2:2, two luma blocks, one Cb, one
// Cr, and whether we want Cb or not, its bits lie between us and the next luma block.
//
// The method: walk, do not decode. The next kIndexBits bits index a table that says how many bits *all* symbols
// take which are settled by these bits, their values included, and by how many coefficients they advance. The value
// bits of the last symbol may lie beyond the index, because they are skipped unseen. Two to six look-ups walk a
// block of a typical camera picture, where a decoder needs one step per coefficient. One entry is 16 bits:
//
//     bits 0-7   bits to skip, at most kMaxSkip, so that three look-ups fit the 56 bits of a filled window
//     bits 8-13  coefficients to advance
//     bit 14     never set in a good entry; alone, it sends the symbol to the slow path (long or bad code)
//     bit 15     the block ended here
//
// With the upper byte added to the coefficient number k (1..63), bit 6 of the sum tells of a slow entry *and* of an
// advance past 63, bit 7 tells that the block is done: two tests per look-up are all the safety there is to pay for.
// The slow path takes exactly one symbol by the canonical rule and makes every judgement.
//
// What is refused: whatever libjpeg-turbo warns of or fails at, and more, because lost USB payload shows as small
// irregularities: codes that are in no table, an advance past coefficient 63, whole bytes left over before a
// marker, DC outside of what 8-bit samples can give, anything but EOI after the scan. Padding after EOI is ignored.
// What is accepted equals libjpeg-turbo's output (scale 1/8, JCS_GRAYSCALE) in every byte.
//
// Accepted streams: baseline and extended sequential Huffman (SOF0, SOF1) of 8 bits, one component, or YCbCr in a
// single interleaved scan in which luma has the highest sampling (4:4:4, 4:2:2, 4:2:0, 4:4:0, 4:1:1 and the like);
// any tables, restart intervals, fill bytes, APPn and COM. Tables that a picture does not bring are those of T.81
// annex K, as UVC cameras leave them out; nothing else is carried over from picture to picture.
//
// Memory: State, fixed. Reads stay inside the span. Time: at most one walk over the bytes, plus making at most
// eight tables when a picture brings others than the one before.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "base/status.hpp"
#include "vision/jpeg.hpp"
#include "vision/luma.hpp"

namespace holdfast::jpeg_dc {

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

// Index bits of a walk table. Price: 11 halves the tables (they compete for a first-level cache of 32 KB) and costs
// 9 % more look-ups; 13 gains 1 % on x86.
inline constexpr int kIndexBits = 12;
inline constexpr int kMaxSkip = 18;
inline constexpr int kDcIndexBits = 9;  // all codes of the standard DC tables
inline constexpr int kTableIds = 4;

// One Huffman code. `definition` is what DHT sends: 16 counts of codes per length, then the symbols in code order.
// Codes of one length are consecutive numbers, and every code is less than all longer ones (left-aligned), so that
// length l is the first with window < limit[l].
struct Code {
  std::array<std::uint8_t, 16 + 256> definition;
  std::size_t size = 0;                 // bytes of `definition` in use; 0: no table made yet
  std::array<std::uint32_t, 17> limit;  // first 16-bit window beyond the codes of length 1..16
  std::array<std::int32_t, 17> offset;  // place of a symbol in `definition` minus its code
};

struct DcTable {
  Code code;
  std::array<std::uint16_t, 1U << kDcIndexBits> first;  // size of the difference << 8 | length of the code; 0: slow
};

struct AcTable {
  Code code;
  std::array<std::uint16_t, 1U << kIndexBits> walk;  // see the head of this file
};

struct State {
  std::array<DcTable, kTableIds> dc;
  std::array<AcTable, kTableIds> ac;
  Error error = Error::kNone;     // of the last picture
  std::uint32_t tables_made = 0;  // since start; grows only when a picture brings other tables than the one before
};

// In pixels of the luma at 1/8. The upper limit is LumaBuffer's memory: kMaxLumaWidth x kMaxLumaHeight.
struct Limits {
  std::int32_t min_width = kMinLumaWidth;
  std::int32_t min_height = kMinLumaHeight;
};

// Result: ceil(width / 8) x ceil(height / 8) pixels. `out` is undefined unless ok(); state.error says why. The state
// serves the next picture after any error. kJpegDamaged, kFrameFormat, kPictureTooSmall, kPictureTooLarge.
[[nodiscard]] Status decode(State& state, std::span<const std::uint8_t> bytes, LumaBuffer& out, Limits limits = {});

// Behind the seam: 1/8 by the code above, other scales by another decoder, which must outlive this one.
class Decoder final : public JpegDecoder {
 public:
  explicit Decoder(JpegDecoder& other_scales) : other_scales_(other_scales) {}
  // Of the last picture at 1/8.
  [[nodiscard]] Error last_error() const { return state_.error; }

 private:
  [[nodiscard]] Status do_decode(std::span<const std::uint8_t> bytes, DecodeScale scale, LumaBuffer& out) override {
    if (scale != DecodeScale::kEighth) return other_scales_.decode(bytes, scale, out);
    return jpeg_dc::decode(state_, bytes, out);
  }

  JpegDecoder& other_scales_;
  State state_;
};

}  // namespace holdfast::jpeg_dc
