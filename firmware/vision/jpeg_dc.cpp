// SPDX-License-Identifier: Apache-2.0
#include "vision/jpeg_dc.hpp"

namespace holdfast::jpeg_dc {
namespace {

// ---- Tables ----

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

bool make(AcTable& table, Bytes definition) {
  if (!make(table.code, definition)) return false;
  for (std::uint32_t index = 0; index < table.walk.size(); ++index) table.walk[index] = walk_entry(table.code, index);
  return true;
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
      scan.block[scan.blocks++] = {&dc, &ac, i, block % across, block / across};
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

// ---- Bits ----

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
      if (!any_ff(bytes)) {
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

// ---- The walk ----

struct SlowStep {
  Bits bits;
  std::uint32_t k = 0;
  Error error = Error::kNone;
};

[[gnu::noinline]] SlowStep slow_step(Bits bits, const Code& code, std::uint32_t k) {
  bits.fill();
  const AcStep step = ac_step(code, bits.peek(16), k);
  bits.skip(step.bits);
  bits.fill();
  return {bits, step.k, step.error};
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

}  // namespace

AcStep ac_step(const Code& code, std::uint32_t window16, std::uint32_t k) {
  const Symbol symbol = find(code, window16);
  const std::uint32_t run = symbol.value >> 4;
  const std::uint32_t size = symbol.value & 15;
  const bool means_nothing = size == 0 && run != 0 && run != 15;
  if (symbol.length == 0 || means_nothing) return {symbol.length, kEnded, Error::kBadCode};
  if (symbol.value == 0) return {symbol.length, kEnded};
  const std::uint32_t next = k + run + 1;
  if (next > 64) return {symbol.length + size, kEnded, Error::kPastLastCoefficient};
  return {symbol.length + size, next == 64 ? kEnded : next};
}

std::uint16_t walk_entry(const Code& code, std::uint32_t index, std::uint32_t used, std::uint32_t advance) {
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

Error read_mcus(Scan& scan, LumaBuffer& out) {
  Cursor& cursor = scan.data;
  Bits bits(cursor);
  std::int32_t dc = 0;
  std::int32_t to_restart = scan.restart_interval;
  std::uint8_t restart = kRst0;
  for (std::int32_t row = 0; row < scan.mcus_down; ++row) {
    for (std::int32_t column = 0; column < scan.mcus_across; ++column) {
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
        if (block.component == 0) {
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

Error open(State& state, Bytes bytes, const Limits& limits, LumaBuffer& out, Scan& scan) {
  scan.data = {bytes.data(), bytes.data() + bytes.size()};
  Headers headers;
  if (const Error error = read_headers(headers, scan.data); error != Error::kNone) return error;
  out.width = (headers.width + 7) / 8;
  out.height = (headers.height + 7) / 8;
  if (out.width > kMaxLumaWidth || out.height > kMaxLumaHeight) return Error::kTooLarge;
  if (out.width < limits.min_width || out.height < limits.min_height) return Error::kTooSmall;
  if (const Error error = prepare_scan(state, headers, scan); error != Error::kNone) return error;
  scan.mcus_across = (out.width + scan.across - 1) / scan.across;
  scan.mcus_down = (out.height + scan.down - 1) / scan.down;
  return Error::kNone;
}

Status decode(State& state, std::span<const std::uint8_t> bytes, LumaBuffer& out, Limits limits) {
  Scan scan;
  state.error = open(state, bytes, limits, out, scan);
  if (state.error == Error::kNone) state.error = read_mcus(scan, out);
  return {info(state.error).reason};
}

}  // namespace holdfast::jpeg_dc
