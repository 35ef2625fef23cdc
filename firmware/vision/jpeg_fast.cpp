// SPDX-License-Identifier: Apache-2.0
#include "vision/jpeg_fast.hpp"

#include <algorithm>
#include <cstring>

#include "base/math.hpp"

namespace holdfast::jpeg_fast {
namespace {

using jpeg_dc::Code;
using jpeg_dc::Error;
using jpeg_dc::kIndexBits;
using jpeg_dc::kMaxDc;
using jpeg_dc::kMaxSkip;
using jpeg_dc::Scan;
using jpeg_dc::Symbol;

// Something that only the plain walk can judge.
constexpr Error kUnsure = Error::kNoPicture;

// ---- Tables ----

bool same(const Code& code, std::size_t size, const std::array<std::uint8_t, 16 + 256>& definition) {
  return code.size == size && std::equal(definition.begin(), definition.begin() + static_cast<std::ptrdiff_t>(size),
                                         code.definition.begin());
}

// Of a table that begins with DC; DC counts as a coefficient. Before it come `used` bits.
std::uint16_t first_entry(const Code& dc, const Code& ac, std::uint32_t index, std::uint32_t used = 0) {
  const Symbol symbol = find(dc, index << (16 - kIndexBits + used) & 0xFFFF);
  const std::uint32_t code_end = used + symbol.length;
  if (symbol.length == 0 || code_end > kIndexBits || code_end + symbol.value > kMaxSkip) return kSlowDc;
  return jpeg_dc::walk_entry(ac, index, code_end + symbol.value, 1);
}

constexpr bool ends(std::uint16_t entry) {
  return entry >= jpeg_dc::kEnded << 8;
}

// The same where another block of these codes follows: both, if the index settles the ends of both.
std::uint16_t pair_entry(const Code& dc, const Code& ac, std::uint32_t index) {
  const std::uint16_t one = first_entry(dc, ac, index);
  if (!ends(one)) return one;
  const std::uint16_t two = first_entry(dc, ac, index, one & 0xFF);
  return ends(two) ? static_cast<std::uint16_t>(two | kPair) : one;
}
static_assert(kMaxSkip < kPair);

std::int16_t difference_entry(const Code& dc, std::uint32_t index) {
  const Symbol symbol = find(dc, index << (16 - kIndexBits));
  if (symbol.length == 0 || symbol.length + symbol.value > kIndexBits) return State::kLongValue;
  const std::uint64_t window = std::uint64_t{index} << (64 - kIndexBits) << symbol.length;
  return static_cast<std::int16_t>(jpeg_dc::difference(window, symbol.value));
}

// The table, made unless it is that of these codes already.
const std::uint16_t* prepare(State::First& first, const jpeg_dc::Block& block, bool pairs) {
  const Code& dc = block.dc->code;
  const Code& ac = block.ac->code;
  if (!same(dc, first.dc_size, first.dc) || !same(ac, first.ac_size, first.ac) || pairs != first.pairs) {
    for (std::uint32_t i = 0; i < first.walk.size(); ++i) {
      first.walk[i] = pairs ? pair_entry(dc, ac, i) : first_entry(dc, ac, i);
    }
    first.dc = dc.definition;
    first.dc_size = dc.size;
    first.ac = ac.definition;
    first.ac_size = ac.size;
    first.pairs = pairs;
  }
  return first.walk.data();
}

void prepare(State& state, const Scan& scan) {
  const Code& luma_dc = scan.block[0].dc->code;
  if (!same(luma_dc, state.first[0].dc_size, state.first[0].dc)) {
    for (std::uint32_t i = 0; i < state.difference.size(); ++i) state.difference[i] = difference_entry(luma_dc, i);
  }
  const std::size_t luma = idx(scan.across) * idx(scan.down);  // the blocks of chroma follow these
  const jpeg_dc::Block& last = scan.block[scan.blocks - 1];
  const bool alike = scan.blocks > luma && scan.block[luma].dc == last.dc && scan.block[luma].ac == last.ac;
  const std::size_t mcus = idx(scan.mcus_across) * idx(scan.mcus_down);
  const auto bytes = static_cast<std::size_t>(scan.data.end - scan.data.at);
  state.pairs = alike && bytes * 8 <= mcus * scan.blocks * kSparse;
  std::array<Phase::After, jpeg_dc::kMaxBlocks> block;
  for (std::size_t i = 0; i < scan.blocks; ++i) {
    const std::size_t component = scan.block[i].component;
    const bool pairs = state.pairs && i >= luma && i + 1 < scan.blocks;
    const std::size_t table = component == 0 || !alike ? component : pairs ? 1 : 2;
    block[i] = {prepare(state.first[table], scan.block[i], pairs), &state.phase[i],
                component == 0 ? sizeof(std::uint32_t) : 0};
  }
  for (std::size_t i = 0; i < scan.blocks; ++i) {
    const jpeg_dc::Block& of = scan.block[i];
    state.phase[i] = {block[(i + 1) % scan.blocks], of.ac->walk.data(), &of.dc->code, &of.ac->code, {},
                      block[(i + 2) % scan.blocks]};
  }
  state.luma_blocks = static_cast<std::uint32_t>(luma);
}

const Lanes& lanes_of(const State& state, const Config& config) {
  return state.pairs ? config.walkers->pairs : config.walkers->single;
}

// The farthest end that a walk can be given so that its list of `room` more entries holds what it finds: a block takes
// two bits at least, one for DC and one for its end. The last look-ups may list three more.
std::uint64_t farthest(const Walk& walk, std::ptrdiff_t room) {
  return walk.position + 2 * static_cast<std::uint64_t>(std::max<std::ptrdiff_t>(room - 4, 0));
}

Walk begin_walk(const State& state, const std::uint8_t* bytes, std::span<std::uint32_t> list) {
  Walk walk;
  walk.bytes = bytes;
  walk.list = list.data();
  walk.table = state.first[0].walk.data();
  walk.phase = state.phase.data();
  *walk.list++ = 0;
  return walk;
}

// Levels of the blocks at `places`, from 0 on. A DC code that is bad gives 0: the walk has seen it, too.
void sum_differences(const State& state, const std::uint8_t* bytes, std::span<const std::uint32_t> places,
                     std::int16_t* values) {
  const Code& code = *state.phase[0].dc_code;
  // Modulo 2^16 when it is stored. Range: as many differences of 15 bits as a list has places.
  std::int32_t level = 0;
  static_assert((kMaxListed + 8) * 32767 <= INT32_MAX);
  for (const std::uint32_t place : places) {
    const std::uint64_t window = jpeg_dc::next_eight(bytes + (place >> 3)) << (place & 7);
    std::int32_t change = state.difference[window >> (64 - kIndexBits)];
    if (change == State::kLongValue) [[unlikely]] {
      const Symbol symbol = find(code, static_cast<std::uint32_t>(window >> 48));
      change = jpeg_dc::difference(window << symbol.length, symbol.length == 0 ? 0 : symbol.value);
    }
    level += change;
    *values++ = static_cast<std::int16_t>(level);
  }
}

// Takes room for `count` values. False: there is none.
bool take_values(State& state, std::uint32_t count, std::uint32_t& first) {
  first = state.valued.fetch_add(count, std::memory_order_relaxed);
  return first <= kMaxValues && count <= kMaxValues - first;
}

// ---- Slices, by all workers ----

class SliceJob final : public hal::Job {
 public:
  SliceJob(State& state, const Config& config, std::span<Worker> workers)
      : state_(state),
        lanes_(static_cast<std::size_t>(config.lanes)),
        walkers_(lanes_of(state, config)),
        workers_(workers) {}

 private:
  struct Claim {
    Walk walk;
    Slice* slice = nullptr;
    LaneMemory* memory = nullptr;
  };

  void do_work(std::size_t worker) override {
    std::array<Claim, kMaxLanes> claims;
    std::size_t active = 0;
    while (active < lanes_ && claim(claims[active], workers_[worker].lanes[active])) ++active;
    while (active != 0) {
      if (active == 3) {
        walkers_.three(claims[0].walk, claims[1].walk, claims[2].walk);
      } else if (active == 2) {
        walkers_.two(claims[0].walk, claims[1].walk);
      } else {
        walkers_.one(claims[0].walk);
      }
      for (std::size_t i = 0; i < active;) {
        if (claims[i].walk.position < claims[i].walk.end || set_end(claims[i])) {
          ++i;
          continue;
        }
        finish(claims[i]);
        if (!claim(claims[i], *claims[i].memory)) claims[i] = claims[--active];
      }
    }
  }

  // False: the slice is at its end, or its list is full.
  static bool set_end(Claim& claim) {
    const std::uint32_t* const list_end = claim.memory->list.data() + claim.memory->list.size();
    claim.walk.end = std::min<std::uint64_t>(claim.slice->bits, farthest(claim.walk, list_end - claim.walk.list));
    return claim.walk.position < claim.walk.end;
  }

  bool claim(Claim& claim, LaneMemory& memory) {
    const std::uint32_t index = state_.claimed.fetch_add(1, std::memory_order_relaxed);
    if (index >= state_.slices) return false;
    Slice& slice = state_.slice[index];
    const std::uint8_t* at = slice.begin;
    std::size_t size = unstuff(at, slice.end, memory.bytes.data());
    slice.whole = at == slice.end;
    slice.bits = static_cast<std::uint32_t>(size * 8);
    const bool more = index + 1 < state_.slices && !state_.slice[index + 1].exact;
    if (slice.whole && more) {
      const auto overrun = std::min<std::ptrdiff_t>(slice.data_end - at, LaneMemory::kOverrun - 8);
      size += unstuff(at, at + overrun, memory.bytes.data() + size);
    }
    std::fill_n(memory.bytes.data() + size, LaneMemory::kOverrun, std::uint8_t{0});
    claim = {begin_walk(state_, memory.bytes.data(), memory.list), &slice, &memory};
    claim.walk.known = size * 8;
    set_end(claim);
    return true;
  }

  void finish(const Claim& claim) {
    Slice& slice = *claim.slice;
    slice.left = claim.walk;
    slice.listed = static_cast<std::uint32_t>(claim.walk.list - claim.memory->list.data());
    slice.whole =
        slice.whole && claim.walk.position >= slice.bits && take_values(state_, slice.listed, slice.first_value);
    if (!slice.whole) return;
    const std::span<const std::uint32_t> places(claim.memory->list.data(), slice.listed);
    sum_differences(state_, claim.memory->bytes.data(), places, state_.value.data() + slice.first_value);
    for (std::uint32_t i = slice.listed - std::min(slice.listed, Slice::kTail); i < slice.listed; ++i) {
      slice.tail[i % Slice::kTail] = places[i];
    }
    if (slice.exact) return;
    slice.started = 0;
    for (std::uint32_t i = 0; i < slice.listed && slice.started < kMaxStarts && places[i] <= 0xFFFF;
         i += state_.luma_blocks) {
      state_.starts[slice.starts][slice.started++] = static_cast<std::uint16_t>(places[i]);
    }
  }

  State& state_;
  std::size_t lanes_;
  const Lanes& walkers_;
  std::span<Worker> workers_;
};

// ---- Cutting ----

// Cuts [begin, end), at whose begin an MCU starts. False: more slices than there is memory for.
bool cut(State& state, const std::uint8_t* begin, const std::uint8_t* end, std::size_t lanes, const Config& config,
         std::size_t& guesses) {
  const auto size = static_cast<std::size_t>(end - begin);
  const auto slice_size = static_cast<std::size_t>(config.slice);
  // Lanes end together when each has the same number of slices.
  const std::size_t useful = std::clamp<std::size_t>(size / static_cast<std::size_t>(config.least_slice), 1, lanes);
  const std::size_t wanted = ((size + slice_size - 1) / slice_size + useful - 1) / useful * useful;
  const std::size_t count = std::clamp<std::size_t>(wanted, 1, 1 + kMaxGuesses - guesses);
  if (state.slices + count > kMaxSlices || size > count * kMaxSlice) return false;
  const std::uint8_t* from = begin;
  for (std::size_t i = 1; i <= count; ++i) {
    const std::uint8_t* to = begin + size * i / count;
    if (i < count && to[-1] == 0xFF) ++to;  // its stuffed zero belongs to it
    Slice& slice = state.slice[state.slices++];
    slice.begin = from;
    slice.end = to;
    slice.exact = i == 1;
    slice.data_end = end;
    if (!slice.exact) slice.starts = static_cast<std::uint32_t>(guesses++);
    from = to;
  }
  return true;
}

// The next marker at or after `at`: its first 0xFF. `end` if there is none.
const std::uint8_t* next_marker(const std::uint8_t* at, const std::uint8_t* end) {
  while (at != end) {
    at = static_cast<const std::uint8_t*>(std::memchr(at, 0xFF, static_cast<std::size_t>(end - at)));
    if (at == nullptr || end - at < 2) return end;
    if (at[1] != 0) return at;
    at += 2;
  }
  return end;
}

// Where the last EOI begins, with its fill bytes. Looked for from behind, because it is nearly always the last
// thing; a picture with another one in its padding is left to the plain walk when a marker turns up inside.
const std::uint8_t* last_end(const std::uint8_t* begin, const std::uint8_t* end) {
  for (const std::uint8_t* at = end; at - begin >= 2; --at) {
    if (at[-1] != jpeg_dc::kEoi || at[-2] != 0xFF) continue;
    at -= 2;
    while (at != begin && at[-1] == 0xFF) --at;
    return at;
  }
  return end;
}

Error cut(State& state, const Config& config, const Scan& scan, std::size_t lanes) {
  state.slices = 0;
  std::size_t guesses = 0;
  const std::uint8_t* at = scan.data.at;
  const std::uint8_t* end = scan.data.end;
  if (scan.restart_interval == 0) {
    const std::uint8_t* const eoi = last_end(at, end);
    if (eoi == end) return kUnsure;
    return cut(state, at, eoi, lanes, config, guesses) ? Error::kNone : kUnsure;
  }
  const std::int32_t mcus = scan.mcus_across * scan.mcus_down;
  const std::int32_t intervals = (mcus + scan.restart_interval - 1) / scan.restart_interval;
  const std::size_t each = std::max<std::size_t>(1, lanes / static_cast<std::size_t>(intervals));
  for (std::int32_t i = 0; i < intervals; ++i) {
    jpeg_dc::Cursor cursor{next_marker(at, end), end};
    if (!cut(state, at, cursor.at, each, config, guesses)) return kUnsure;
    std::uint8_t code = 0;
    if (read_marker(cursor, code) != Error::kNone) return kUnsure;
    const bool last = i + 1 == intervals;
    if (code != (last ? jpeg_dc::kEoi : static_cast<std::uint8_t>(jpeg_dc::kRst0 + i % 8))) return kUnsure;
    at = cursor.at;
  }
  return Error::kNone;
}

// ---- Stitching ----

class Stitcher {
 public:
  Stitcher(State& state, const Lanes& walkers) : state_(state), walkers_(walkers), per_mcu_(state.luma_blocks) {}

  // The slices [first, end), which hold `blocks` luma blocks and no more.
  Error stitch(std::size_t first, std::size_t end, std::uint32_t blocks) {
    level_ = 0;
    std::uint32_t from = 0;   // first block of the slice that counts
    std::uint32_t valid = 0;  // its position
    for (std::size_t i = first; i < end; ++i) {
      const Slice& slice = state_.slice[i];
      if (!slice.whole) return kUnsure;
      const std::uint32_t count = slice.listed - from;
      if (i + 1 == end) return last(slice, from, valid, blocks);
      if (count > blocks) return kUnsure;
      if (slice.left.bad > valid) return Error::kBadCode;
      add(slice.first_value, from, count);
      blocks -= count;
      if (const Error error = cross(slice, state_.slice[i + 1], count, blocks, from, valid); error != Error::kNone) {
        return error;
      }
    }
    return kUnsure;
  }

 private:
  // Blocks [from, from + count) of the values that begin at `first`.
  void add(std::uint32_t first, std::uint32_t from, std::uint32_t count) {
    if (count == 0) return;
    const std::int16_t* value = state_.value.data() + first;
    const std::int32_t base = level_ - (from == 0 ? 0 : value[from - 1]);
    state_.piece[state_.pieces++] = {first + from, count, base};
    level_ = static_cast<std::int16_t>(value[from + count - 1] + base);
  }

  // Walks on from where `slice` was left until an MCU starts where `next` has one, too. `count`: blocks of `slice`
  // since an MCU started.
  Error cross(const Slice& slice, const Slice& next, std::uint32_t count, std::uint32_t& blocks, std::uint32_t& from,
              std::uint32_t& valid) {
    std::span<std::uint8_t> bytes = state_.seam_bytes;
    const std::span<std::uint32_t> list = state_.seam_list;
    Walk walk = slice.left;
    walk.bytes = bytes.data();
    walk.position -= slice.bits;
    walk.bad = 0;
    walk.list = list.data();
    const std::span<const std::uint16_t> starts(state_.starts[next.starts].data(), next.started);
    std::uint64_t filled = 0;
    std::uint32_t seen = 0;
    std::size_t start = 0;
    while (true) {
      const auto listed = static_cast<std::uint32_t>(walk.list - list.data());
      for (; seen < listed; ++seen) {
        if ((count + seen) % per_mcu_ != 0) continue;
        while (start < starts.size() && starts[start] < list[seen]) ++start;
        if (start == starts.size()) return kUnsure;
        if (starts[start] != list[seen]) continue;
        return join(next, walk, list.first(seen), static_cast<std::uint32_t>(start), blocks, from, valid);
      }
      if (walk.position >= filled) {
        const std::size_t room = bytes.size() - LaneMemory::kOverrun;
        const std::size_t wanted = filled == 0 ? 512 : room;
        const std::uint8_t* at = next.begin;
        const auto given = std::min(static_cast<std::size_t>(next.data_end - next.begin), wanted);
        const std::size_t size = unstuff(at, next.begin + given, bytes.data());
        std::fill_n(bytes.data() + size, LaneMemory::kOverrun, std::uint8_t{0});
        // The last bytes are not walked while more follow: a look-up there would read zeros that are not the picture's.
        const std::uint64_t known = at == next.data_end ? size * 8 : size < 16 ? 0 : (size - 16) * 8;
        if (known <= walk.position) return kUnsure;  // too little is left, or there is room for no more
        filled = known;
        walk.known = known;
      }
      walk.end = std::min({filled, walk.position + 64, farthest(walk, list.data() + list.size() - walk.list)});
      if (walk.end == walk.position) return kUnsure;
      walkers_.one(walk);
    }
  }

  // The seam's blocks before the match, then `next` from its MCU `start` on.
  Error join(const Slice& next, const Walk& walk, std::span<const std::uint32_t> seam, std::uint32_t start,
             std::uint32_t& blocks, std::uint32_t& from, std::uint32_t& valid) {
    if (walk.bad != 0) return Error::kBadCode;
    const auto count = static_cast<std::uint32_t>(seam.size());
    std::uint32_t first = 0;
    if (count > blocks || !take_values(state_, count, first)) return kUnsure;
    sum_differences(state_, walk.bytes, seam, state_.value.data() + first);
    add(first, 0, count);
    blocks -= count;
    from = start * per_mcu_;
    valid = state_.starts[next.starts][start];
    ++state_.counts.seams;
    state_.counts.longest_seam_bits = std::max(state_.counts.longest_seam_bits, valid);
    return Error::kNone;
  }

  // The last slice must hold all blocks that are left, and then end but for the bits that fill up its last byte.
  Error last(const Slice& slice, std::uint32_t from, std::uint32_t valid, std::uint32_t blocks) {
    const std::uint32_t beyond = from + blocks;  // the block that would follow
    if (beyond >= slice.listed) return Error::kMarkerInData;
    if (slice.listed - beyond > Slice::kTail) return Error::kSpareData;
    const std::uint32_t end = slice.tail[beyond % Slice::kTail];
    if (end > slice.bits) return Error::kMarkerInData;
    if (slice.bits - end >= 8) return Error::kSpareData;
    if (slice.left.bad > valid) return Error::kBadCode;
    add(slice.first_value, from, blocks);
    return Error::kNone;
  }

  State& state_;
  const Lanes& walkers_;
  std::uint32_t per_mcu_;
  std::int32_t level_ = 0;
};

Error stitch(State& state, const Config& config, const Scan& scan) {
  state.pieces = 0;
  Stitcher stitcher(state, lanes_of(state, config));
  std::int32_t mcus = scan.mcus_across * scan.mcus_down;
  for (std::size_t first = 0; first < state.slices;) {
    std::size_t end = first + 1;
    while (end < state.slices && !state.slice[end].exact) ++end;
    const std::int32_t taken = scan.restart_interval == 0 ? mcus : std::min(mcus, scan.restart_interval);
    const auto blocks = static_cast<std::uint32_t>(taken) * state.luma_blocks;
    if (const Error error = stitcher.stitch(first, end, blocks); error != Error::kNone) return error;
    mcus -= taken;
    first = end;
  }
  return Error::kNone;
}

// ---- Pixels ----

// Levels of all pieces to samples, in the order of sending. Plain arithmetic, because gcc makes vector code of it.
Error make_samples(State& state, std::int32_t luma_quant) {
  std::uint8_t* out = state.in_order.data();
  std::int32_t outside = 0;  // negative once a level was outside of +-kMaxDc
  for (std::size_t i = 0; i < state.pieces; ++i) {
    const Piece piece = state.piece[i];  // a copy: bytes written may lie anywhere, as far as the compiler knows
    const std::int16_t* value = state.value.data() + piece.first;
    for (std::uint32_t j = 0; j < piece.count; ++j) {
      const auto level = static_cast<std::int16_t>(value[j] + piece.base);
      outside |= (level + kMaxDc) | (kMaxDc - level);
      out[j] = jpeg_dc::pixel(level, luma_quant);
    }
    out += piece.count;
  }
  return outside < 0 ? Error::kDcRange : Error::kNone;
}

// One line of the picture from the samples of its row of MCUs. The width of an MCU is a constant, because a division
// per pixel would cost an eighth of a picture's time.
template <std::int32_t kAcross>
void arrange_line(const std::uint8_t* from, std::int32_t per_mcu, std::int32_t width, std::uint8_t* line) {
  std::int32_t x = 0;
  for (; x + kAcross <= width; x += kAcross, from += per_mcu) std::copy_n(from, kAcross, line + x);
  std::copy_n(from, width - x, line + x);
}

void arrange(const State& state, const Scan& scan, LumaBuffer& out) {
  const std::int32_t per_mcu = scan.across * scan.down;
  const std::uint8_t* row = state.in_order.data();
  for (std::int32_t y = 0; y < out.height; ++y) {
    if (y != 0 && y % scan.down == 0) row += static_cast<std::ptrdiff_t>(scan.mcus_across) * per_mcu;
    std::uint8_t* line = out.pixels.data() + static_cast<std::ptrdiff_t>(y) * out.width;
    const std::uint8_t* from = row + static_cast<std::ptrdiff_t>(y % scan.down) * scan.across;
    if (scan.down == 1) {
      std::copy_n(from, out.width, line);
    } else if (scan.across == 1) {
      arrange_line<1>(from, per_mcu, out.width, line);
    } else if (scan.across == 2) {
      arrange_line<2>(from, per_mcu, out.width, line);
    } else if (scan.across == 3) {
      arrange_line<3>(from, per_mcu, out.width, line);
    } else {
      arrange_line<4>(from, per_mcu, out.width, line);
    }
  }
}

// Everything up to the pieces of the picture.
Error find_pieces(State& state, const Config& config, std::span<Worker> workers, hal::Crew& crew, const Scan& scan) {
  const auto lanes = static_cast<std::size_t>(config.lanes) * crew.size();
  const Error error = cut(state, config, scan, lanes);
  if (error != Error::kNone) return error;
  state.claimed.store(0, std::memory_order_relaxed);
  state.valued.store(0, std::memory_order_relaxed);
  SliceJob task(state, config, workers);
  crew.run(task);
  return stitch(state, config, scan);
}

Error decode_scan(State& state, const Config& config, std::span<Worker> workers, hal::Crew& crew, const Scan& scan,
                  LumaBuffer& out) {
  const std::int64_t blocks = std::int64_t{scan.mcus_across} * scan.mcus_down * scan.across * scan.down;
  if (blocks > static_cast<std::int64_t>(kMaxBlocksOfPicture)) return kUnsure;
  prepare(state, scan);
  Error error = find_pieces(state, config, workers, crew, scan);
  if (error != Error::kNone) return error;
  error = make_samples(state, scan.luma_quant);
  if (error != Error::kNone) return error;
  arrange(state, scan, out);
  return Error::kNone;
}

}  // namespace

Status decode(State& state, const Config& config, std::span<Worker> workers, hal::Crew& crew,
              std::span<const std::uint8_t> bytes, LumaBuffer& out, jpeg_dc::Limits limits) {
  Scan scan;
  Error& error = state.plain.error;
  ++state.counts.pictures;
  error = open(state.plain, bytes, limits, out, scan);
  if (error == Error::kNone) {
    error = decode_scan(state, config, workers, crew, scan, out);
    if (error == kUnsure) {
      ++state.counts.by_plain_walk;
      error = jpeg_dc::read_mcus(scan, out);
    }
  }
  return {info(error).reason};
}

}  // namespace holdfast::jpeg_fast
