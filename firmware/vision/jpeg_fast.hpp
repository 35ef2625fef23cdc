// SPDX-License-Identifier: Apache-2.0
// JPEG pictures to luma at 1/8, fast form: the walk of vision/jpeg_dc without branches, several places of the picture
// at once, on several cores where there are any. Bit for bit the result of the plain form.
//
// Why the plain walk is slow. It takes few instructions, but each look-up needs the one before (5 cycles from the
// cache, 5 of arithmetic), and "does the block end here?" is a branch that nobody can predict: one miss per block.
//
// 1. No branch. A look-up either goes on in the AC table or turns to the next block, whose table begins with its DC
//    code and runs on into its AC codes. Both choices are computed, and one is selected (cmov, csel). The only thing
//    kept is where luma blocks begin; their DC differences are read from there in a second pass, whose look-ups do
//    not wait for each other.
//
// 2. Several lanes. What remains is waiting, so one thread walks two or three places of the picture by turns. That
//    needs places to begin, and JPEG has none: codes have no fixed place and no mark. But Huffman codes
//    *synchronise themselves*: started at a wrong bit, a decoder falls into step with the right one before long,
//    because from the first bit at which both begin a code in the same state, they are the same (Ferguson and
//    Rabinowitz 1984; for JPEG: Klein and Wiseman, "Parallel Huffman Decoding with Applications to JPEG Files", The
//    Computer Journal 46(5), 2003; on GPUs: Weissenberger and Schmidt, "Accelerating JPEG Decompression on GPUs",
//    arXiv:2111.09219). Measured over 800 000 random places of camera pictures: median 10 to 130 bytes, longest 2316.
//
//    So: the data is cut into slices at any bytes. Each is walked as if an MCU began at its first bit, and lists the
//    places of luma blocks. Then the slices are stitched in order: the walk of one is carried on beyond its end
//    until an MCU begins where the next slice has one in its list as well. From there on the list is right, for
//    certain: bit position and "an MCU begins" are the whole state. What stands before it is dropped.
//
// 3. Several cores. Slices are claimed one by one from a shared counter by the lanes of all workers (hal/crew.hpp),
//    so that a core that is busy elsewhere costs nothing.
//
//        picture   |======== 0 ========|======== 1 ========|======== 2 ========|
//        lists      0 0 0 0 0 0 0 0 0 0 ..1.1 1 1 1 1 1 1 1 ...2 2 2 2 2 2 2 2      . = dropped
//        stitched   0 0 0 0 0 0 0 0 0 0 s s 1 1 1 1 1 1 1 1 ss s 2 2 2 2 2 2 2      s = seam: walked on by slice before
//
//    DC is a sum over the whole picture. Each slice sums from 0 at its own start, dropped blocks included; a piece is
//    put right by one constant, the level before it minus its own sum there. All modulo 2^16, which is exact here,
//    because every level must be within +-2047 and one difference within +-32767.
//
// 4. Pairs. Where a picture has few bits, most blocks of chroma are empty: 4 bits each with the standard tables.
//    Nothing is kept of them, so that one look-up may walk two (kPair). Pictures with more bits are walked without:
//    they would pay for it at each look-up and find few pairs.
//
// Restart markers, where a picture has them, are places to begin that need no guess; an interval is cut into slices
// like a whole picture.
//
// What is refused is what the plain walk refuses. Every judgement that is not certain (no match at a seam, a list
// that is full, a marker where none should be, a bad code in the last bits) is left to the plain walk, which then
// does the picture again; counted in `by_plain_walk`. A damaged picture costs at most both.
//
// Memory, fixed: State 0.9 MB, and per worker 0.5 MB. A slice with its lists stays in the second-level cache.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <span>

#include "base/status.hpp"
#include "hal/crew.hpp"
#include "vision/jpeg_dc.hpp"
#include "vision/jpeg_walk.hpp"
#include "vision/luma.hpp"

namespace holdfast::jpeg_fast {

inline constexpr std::size_t kMaxSlice = 32 * 1024;  // bytes
inline constexpr std::size_t kMaxSlices = 1024;      // restart intervals of a picture, if none is cut

// Luma blocks of a slice. A flat picture takes 10 bits each with the standard tables: 26 215 in 32 KB.
inline constexpr std::size_t kMaxListed = 32 * 1024;

// MCU starts of a slice among which a seam looks for a match. Longest seen: 325.
inline constexpr std::size_t kMaxStarts = 512;
// Slices that begin with a guess, of one picture.
inline constexpr std::size_t kMaxGuesses = 128;

// Luma blocks of a picture: the largest at 1/8 that a camera of 8 megapixels sends, whole MCUs of 4:2:0 and 4:1:1, and
// room for what seams list twice. Larger pictures are the plain walk's.
inline constexpr std::size_t kMaxBlocksOfPicture = 412 * 308;
inline constexpr std::size_t kMaxValues = kMaxBlocksOfPicture + 24 * 1024;

// Bits a block, on average, up to which a picture is walked in pairs. Times as fast as without, three lanes on x86-64
// (measured): 1.18 at 5 bits, 1.05 to 1.15 at 7, 1.03 at 9, 1.02 at 12; 1.00 at 24, 0.96 from 60 on.
inline constexpr std::size_t kSparse = 12;

struct Config {
  // Lanes of a worker, 1..kMaxLanes. More hide more waiting, until registers run out: 3 on x86-64 (measured), 2 on
  // Cortex-A72 (estimate of a model).
  std::int32_t lanes = 3;
  // Slices, bytes, 16..kMaxSlice. Price: each seam walks the synchronisation distance twice and alone (about 100
  // bytes); longer slices have fewer seams, but leave the first-level cache colder and the last lanes longer alone
  // (12 to 32 KB: within 3 %). They are longer where kMaxGuesses asks for it.
  std::int32_t slice = static_cast<std::int32_t>(kMaxSlice);
  // A picture shorter than that for each lane of all workers is cut into shorter slices, down to this.
  std::int32_t least_slice = 1024;
  const Walkers* walkers = &fastest_walkers();
};

// Memory of one lane: a slice without stuffing, and where its luma blocks begin.
struct LaneMemory {
  // What a step reads beyond its position, and what the next slice gives of its bytes for it.
  static constexpr std::size_t kOverrun = 64;
  std::array<std::uint8_t, kMaxSlice + 2 * kOverrun> bytes;
  std::array<std::uint32_t, kMaxListed + 8> list;
};

struct Worker {
  std::array<LaneMemory, kMaxLanes> lanes;
};

struct Slice {
  // Given: bytes of the picture, and whether an MCU begins there for certain or by guess.
  const std::uint8_t* begin = nullptr;
  const std::uint8_t* end = nullptr;
  bool exact = false;
  const std::uint8_t* data_end = nullptr;  // of the picture or restart interval that it is cut from
  // Found.
  static constexpr std::uint32_t kTail = 16;
  bool whole = false;                       // no marker inside, list not full, values stored
  std::uint32_t bits = 0;                   // of the slice, unstuffed
  std::uint32_t listed = 0;                 // luma blocks, the one in which the walk was left included
  std::uint32_t first_value = 0;            // place of their values
  std::uint32_t starts = 0;                 // place of its MCU starts, if it began with a guess
  std::uint32_t started = 0;                // MCU starts kept there
  std::array<std::uint32_t, kTail> tail{};  // positions of the last blocks listed: block i at i % kTail
  Walk left;                                // the walk as it was left
};

// Luma blocks in order: `count` values from `first`, to which `base` is added.
struct Piece {
  std::uint32_t first = 0;
  std::uint32_t count = 0;
  std::int32_t base = 0;
};

struct Counts {
  std::uint32_t pictures = 0;
  std::uint32_t by_plain_walk = 0;      // of them, done again by the plain walk
  std::uint32_t seams = 0;              // of them all
  std::uint32_t longest_seam_bits = 0;  // farthest that two walks took to agree
};

struct State {
  jpeg_dc::State plain;
  Counts counts;
  // Tables that begin with DC, and of which codes they were made: one per component. Where Cb and Cr have the same
  // codes, they share the third (8 KB less in the first-level cache), and the second is for pairs.
  struct First {
    std::array<std::uint16_t, 1U << jpeg_dc::kIndexBits> walk;
    std::array<std::uint8_t, 16 + 256> dc;
    std::array<std::uint8_t, 16 + 256> ac;
    std::size_t dc_size = 0;
    std::size_t ac_size = 0;
    bool pairs = false;  // entries may have kPair
  };
  std::array<First, jpeg_dc::kMaxComponents> first;
  // Luma DC differences by the next kIndexBits bits; kLongValue: longer than that.
  static constexpr std::int16_t kLongValue = -32768;
  std::array<std::int16_t, 1U << jpeg_dc::kIndexBits> difference;
  std::array<Phase, jpeg_dc::kMaxBlocks> phase;
  // The picture in work.
  bool pairs = false;  // walked in pairs
  std::size_t slices = 0;
  std::uint32_t luma_blocks = 1;  // of an MCU
  std::atomic<std::uint32_t> claimed;
  std::atomic<std::uint32_t> valued;
  std::array<Slice, kMaxSlices> slice;
  std::array<std::array<std::uint16_t, kMaxStarts>, kMaxGuesses> starts;
  std::array<Piece, 2 * kMaxSlices> piece;
  std::size_t pieces = 0;
  std::array<std::int16_t, kMaxValues> value;              // DC level of a block, from 0 at the start of its slice
  std::array<std::uint8_t, kMaxBlocksOfPicture> in_order;  // samples in the order of sending
  std::array<std::uint8_t, 4096 + LaneMemory::kOverrun> seam_bytes;
  std::array<std::uint32_t, kMaxStarts * 8> seam_list;
};

// As jpeg_dc::decode. One worker's memory per member of the crew at least.
[[nodiscard]] Status decode(State& state, const Config& config, std::span<Worker> workers, hal::Crew& crew,
                            std::span<const std::uint8_t> bytes, LumaBuffer& out, jpeg_dc::Limits limits = {});

}  // namespace holdfast::jpeg_fast
