// SPDX-License-Identifier: Apache-2.0
// JPEG streams for the tests of our decoder, and the oracle that judges them.
//
// Oracle: libjpeg-turbo used straight, a new decompressor per picture, any warning counted as a refusal; luma at 1/8.
// Streams: a generator of all that the format knows (sampling, tables, divisors, restarts, coefficients no encoder
// would choose), the surgery that damages a stream, and pictures written bit by bit. Everything is fixed by its seed.
// Range: functions that take a stream apart (segments, find_segment, without, with_noise) want one that libjpeg wrote.
#pragma once

#include <cstddef>
#include <cstdint>
#include <random>
#include <span>
#include <string>
#include <vector>

namespace holdfast::test {

using Bytes = std::vector<std::uint8_t>;
using Random = std::mt19937;

[[nodiscard]] int in_range(Random& random, int low, int high);

struct Oracle {
  int width = 0;
  int height = 0;
  Bytes pixels;

  // True: accepted without a warning. A picture larger than LumaBuffer at 1/8 is refused unread: it has no memory here.
  [[nodiscard]] bool decode(std::span<const std::uint8_t> bytes);
};

// ---- Streams ----

struct Sampling {
  int across = 1;
  int down = 1;
};

enum class Tables { kStandard, kOptimised, kShuffled };
enum class Content { kFlat, kRamp, kNoise, kDots, kCoefficients, kSpecks };
enum class Colours { kGreyOrYcbcr, kRgb, kCmyk };  // the first: by the number of components

struct Recipe {
  int width = 64;
  int height = 48;
  std::vector<Sampling> sampling{{2, 1}, {1, 1}, {1, 1}};  // one entry: grey
  Content content = Content::kDots;
  Tables tables = Tables::kStandard;
  int quality = 85;
  bool own_quant = false;    // random divisors instead of those of `quality`
  int max_quant = 255;       // above 255: 16-bit DQT
  int restart_interval = 0;  // MCUs
  int table_offset = 0;      // Huffman ids 2 and 3 instead of 0 and 1
  bool progressive = false;
  bool scan_per_component = false;
  bool cr_as_luma = false;  // Cr by the Huffman tables of luma
  Colours colours = Colours::kGreyOrYcbcr;
};

[[nodiscard]] Recipe any_recipe(Random& random);
[[nodiscard]] Bytes encode(const Recipe& recipe, Random& random);
[[nodiscard]] Bytes encode(const Recipe& recipe, unsigned seed = 1);
// One of the streams that must be decoded: any recipe, with or without its standard tables, with or without noise.
[[nodiscard]] Bytes any_stream(unsigned seed);
// The same, but at most kSmallStream bytes: what a fuzzer can change in many ways in little time.
inline constexpr std::size_t kSmallStream = 2048;
[[nodiscard]] Bytes small_stream(unsigned seed);

// A picture as the camera sends it (4:2:2, standard tables), but with restart markers when the interval is not 0.
// Shape: `rgb` holds height rows of width times 3 bytes.
[[nodiscard]] Bytes encode_rgb(std::span<const std::uint8_t> rgb, int width, int height, int quality,
                               int restart_interval);

// A grey picture of one row of blocks, written bit by bit with the standard tables: "00" is a DC difference of 0,
// "1010" ends the block.
[[nodiscard]] Bytes grey_by_hand(int blocks, const std::string& bits, const Bytes& extra_segment = {});

// ---- Bytes of a stream ----

struct Segment {
  std::uint8_t marker = 0;
  std::size_t at = 0;    // of its 0xFF
  std::size_t size = 0;  // with marker and length
};

// SOI to SOS.
[[nodiscard]] std::vector<Segment> segments(const Bytes& bytes);
// The first byte of entropy-coded data.
[[nodiscard]] std::size_t data_begin(const Bytes& bytes);
// Of the first such segment; the end of the bytes when there is none.
[[nodiscard]] std::size_t find_segment(const Bytes& bytes, std::uint8_t marker);

[[nodiscard]] Bytes changed(Bytes bytes, std::size_t at, int value);
[[nodiscard]] Bytes inserted(Bytes bytes, std::size_t at, const Bytes& more);
[[nodiscard]] Bytes erased(Bytes bytes, std::size_t at, std::size_t count);
[[nodiscard]] Bytes zeroed(Bytes bytes, std::size_t at, std::size_t count);
// Without all such segments.
[[nodiscard]] Bytes without(Bytes bytes, std::uint8_t marker);
// What encoders and transports may add without changing the picture: fill bytes, comments, padding.
[[nodiscard]] Bytes with_noise(const Bytes& bytes, Random& random);

}  // namespace holdfast::test
