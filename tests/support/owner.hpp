// SPDX-License-Identifier: Apache-2.0
// Somebody who owns devices: a pair of keys, another one for each seed.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include <sodium.h>

#include "drivers/common/ed25519.hpp"
#include "store/sealed.hpp"

namespace holdfast::test {

struct Owner {
  explicit Owner(std::uint8_t seed) {
    std::array<std::uint8_t, crypto_sign_SEEDBYTES> bytes{};
    bytes.fill(seed);
    (void)crypto_sign_seed_keypair(key.data(), secret.data(), bytes.data());
  }
  void sign(std::span<std::uint8_t> record) const {
    std::array<std::uint8_t, sealed::kSignatureBytes> signature{};
    const auto part = sealed::signed_part(record);
    (void)crypto_sign_detached(signature.data(), nullptr, part.data(), part.size(), secret.data());
    sealed::put_signature(record, signature);
  }
  drivers::Ed25519::Key key{};
  std::array<std::uint8_t, crypto_sign_SECRETKEYBYTES> secret{};
};

}  // namespace holdfast::test
