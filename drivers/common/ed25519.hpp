// SPDX-License-Identifier: Apache-2.0
// The owner's signatures: Ed25519 (RFC 8032), by libsodium.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>

#include "hal/verifier.hpp"

namespace holdfast::drivers {

class Ed25519 final : public hal::Verifier {
 public:
  static constexpr std::size_t kKeyBytes = 32;
  using Key = std::array<std::uint8_t, kKeyBytes>;

  explicit Ed25519(const Key& key);

 private:
  [[nodiscard]] bool do_holds(std::span<const std::uint8_t> message,
                              std::span<const std::uint8_t, kSignatureBytes> signature) const override;

  Key key_;
  bool ready_;
};

// A public key from a file: one line of 64 hex digits, as `holdfast settings keygen` writes it. Empty, or what is
// wrong.
[[nodiscard]] std::string read_public_key(const std::filesystem::path& path, Ed25519::Key& key);

}  // namespace holdfast::drivers
