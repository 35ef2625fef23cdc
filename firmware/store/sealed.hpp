// SPDX-License-Identifier: Apache-2.0
// A record that a device takes from outside or from its own store: settings, or a model, behind a sequence that only
// grows, the owner's signature and a check sum. A slot of the store (slot_store.hpp), the file that `holdfast settings
// compile` writes and what the console's `load` takes are the same bytes.
//
// All numbers are little-endian.
//
//   offset  bytes  what
//        0      4  magic: "HDSR"
//        4      1  version of this table: 1
//        5      1  kind: 1 settings (settings.hpp), 2 model (models.hpp)
//        6      2  zero
//        8      4  sequence, 1 to 2^32 - 1; the larger is the newer (slot_store.hpp: and what follows the last one).
//                  The host takes the seconds since 1970, a device that stores by itself the next number
//       12      4  n: bytes of the payload
//       16      n  payload
//   16 + n     64  Ed25519 signature (RFC 8032) over all bytes before it; all zero: not signed
//   80 + n      4  CRC-32 of all bytes before it: a torn write and a bad copy are told apart from a forgery
//   84 + n
//
// The signature covers kind and sequence, so that neither a record of another kind nor an older one passes for this.
// It names no device: what an owner signs fits all devices with the owner's key.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "hal/verifier.hpp"

namespace holdfast::sealed {

enum class Kind : std::uint8_t { kSettings = 1, kModel = 2 };

inline constexpr std::array<std::uint8_t, 4> kMagic{'H', 'D', 'S', 'R'};
inline constexpr std::uint8_t kVersion = 1;
inline constexpr std::size_t kKindAt = 5;
inline constexpr std::size_t kSequenceAt = 8;
inline constexpr std::size_t kSizeAt = 12;
inline constexpr std::size_t kPayloadAt = 16;
inline constexpr std::size_t kSignatureBytes = hal::Verifier::kSignatureBytes;
// Around the payload.
inline constexpr std::size_t kAround = kPayloadAt + kSignatureBytes + 4;
static_assert(kAround == 84, "the table above says so");

enum class Refusal : std::uint8_t {
  kNone,
  kNoRecord,   // not the magic, a field that holds what it may not, or shorter than it says
  kVersion,    // made for another firmware
  kDamaged,    // by its check sum
  kOtherKind,  // settings for a model, or the other way round
  kUnsigned,
  kSignature,  // not the owner's, or not of these bytes
};

struct RefusalInfo {
  Refusal refusal;
  std::string_view what;   // what is wrong
  std::string_view cause;  // the likely cause
  std::string_view next;   // what to do next
};

inline constexpr auto kRefusals = std::to_array<RefusalInfo>({
    {Refusal::kNone, "nothing to report", "-", "-"},
    {Refusal::kNoRecord, "these bytes are no record", "another file, or one that was cut short",
     "load what holdfast settings or holdfast model wrote"},
    {Refusal::kVersion, "the record has a version that is not known here", "made for another firmware",
     "make it with the holdfast of this firmware, and load it"},
    {Refusal::kDamaged, "the record's check sum is wrong", "the power was cut while it was written, or the card wears",
     "load it again"},
    {Refusal::kOtherKind, "the record is of another kind", "the file of another option", "give each option its own"},
    {Refusal::kUnsigned, "the record is not signed, and this device has an owner", "it was stored in development mode",
     "sign it with the owner's key, and load it again"},
    {Refusal::kSignature, "the record's signature is not the owner's, or not of these bytes",
     "signed with another key, or changed afterwards", "sign it with the key whose other half this device has"},
});

[[nodiscard]] constexpr const RefusalInfo& info(Refusal refusal) {
  return kRefusals[static_cast<std::size_t>(refusal)];
}
static_assert(kRefusals.size() == std::size_t{static_cast<std::uint8_t>(Refusal::kSignature)} + 1);
static_assert(std::ranges::all_of(kRefusals, [](const RefusalInfo& row) { return &info(row.refusal) == &row; }));

struct Record {
  Kind kind = Kind::kSettings;
  std::uint32_t sequence = 0;
  std::span<const std::uint8_t> payload;  // in the bytes that were read
  std::size_t bytes = 0;                  // of the whole record
  bool is_signed = false;
};

// The record at the beginning of `bytes`, which may be longer: a slot. `owner` null: the device is in development mode,
// and no signature is looked at. Anything but kNone leaves `record` alone. Range: any bytes. Cost: a CRC, and one
// signature when there is an owner.
[[nodiscard]] Refusal read(std::span<const std::uint8_t> bytes, Kind kind, const hal::Verifier* owner, Record& record);

// An unsigned record. Its size; 0: it does not fit `out`. `payload` may be out.subspan(kPayloadAt) already.
[[nodiscard]] std::size_t write(Kind kind, std::uint32_t sequence, std::span<const std::uint8_t> payload,
                                std::span<std::uint8_t> out);

// Of a record that write() made: what is signed, and the same record with the signature in it.
[[nodiscard]] std::span<const std::uint8_t> signed_part(std::span<const std::uint8_t> record);
void put_signature(std::span<std::uint8_t> record, std::span<const std::uint8_t, kSignatureBytes> signature);

}  // namespace holdfast::sealed
