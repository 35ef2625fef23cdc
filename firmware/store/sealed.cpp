// SPDX-License-Identifier: Apache-2.0
#include "store/sealed.hpp"

#include <algorithm>
#include <cstring>

#include "base/crc32.hpp"
#include "base/little_endian.hpp"

namespace holdfast::sealed {
namespace {

void put_crc(std::span<std::uint8_t> record) {
  const std::size_t at = record.size() - 4;
  put_le32(record.subspan(at), crc32(record.first(at)));
}

}  // namespace

Refusal read(std::span<const std::uint8_t> bytes, Kind kind, const hal::Verifier* owner, Record& record) {
  if (bytes.size() < kAround) return Refusal::kNoRecord;
  if (!std::equal(kMagic.begin(), kMagic.end(), bytes.begin())) return Refusal::kNoRecord;
  if (bytes[4] != kVersion) return Refusal::kVersion;
  const std::size_t size = get_le<std::uint32_t>(bytes, kSizeAt);
  if (size > bytes.size() - kAround) return Refusal::kNoRecord;
  bytes = bytes.first(size + kAround);
  if (get_le<std::uint32_t>(bytes, bytes.size() - 4) != crc32(bytes.first(bytes.size() - 4))) return Refusal::kDamaged;
  const std::uint32_t sequence = get_le<std::uint32_t>(bytes, kSequenceAt);
  if (bytes[6] != 0 || bytes[7] != 0 || sequence == 0) return Refusal::kNoRecord;
  if (bytes[kKindAt] != static_cast<std::uint8_t>(kind)) return Refusal::kOtherKind;
  const auto signature = bytes.subspan(kPayloadAt + size).first<kSignatureBytes>();
  const bool is_signed = std::any_of(signature.begin(), signature.end(), [](std::uint8_t byte) { return byte != 0; });
  if (owner != nullptr) {
    if (!is_signed) return Refusal::kUnsigned;
    if (!owner->holds(bytes.first(kPayloadAt + size), signature)) return Refusal::kSignature;
  }
  record = {kind, sequence, bytes.subspan(kPayloadAt, size), bytes.size(), is_signed};
  return Refusal::kNone;
}

std::size_t write(Kind kind, std::uint32_t sequence, std::span<const std::uint8_t> payload,
                  std::span<std::uint8_t> out) {
  if (out.size() < kAround || payload.size() > out.size() - kAround) return 0;
  out = out.first(payload.size() + kAround);
  if (!payload.empty()) std::memmove(out.data() + kPayloadAt, payload.data(), payload.size());
  std::fill_n(out.begin(), kPayloadAt, std::uint8_t{0});
  std::copy(kMagic.begin(), kMagic.end(), out.begin());
  out[4] = kVersion;
  out[kKindAt] = static_cast<std::uint8_t>(kind);
  put_le32(out.subspan(kSequenceAt), sequence);
  put_le32(out.subspan(kSizeAt), static_cast<std::uint32_t>(payload.size()));
  std::fill_n(out.data() + kPayloadAt + payload.size(), kSignatureBytes, std::uint8_t{0});
  put_crc(out);
  return out.size();
}

std::span<const std::uint8_t> signed_part(std::span<const std::uint8_t> record) {
  return record.first(record.size() - kSignatureBytes - 4);
}

void put_signature(std::span<std::uint8_t> record, std::span<const std::uint8_t, kSignatureBytes> signature) {
  std::copy(signature.begin(), signature.end(), record.data() + signed_part(record).size());
  put_crc(record);
}

}  // namespace holdfast::sealed
