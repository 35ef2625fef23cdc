// SPDX-License-Identifier: Apache-2.0
#include "drivers/common/ed25519.hpp"

#include <sodium.h>

#include <fstream>

#include "drivers/common/input_file.hpp"

namespace holdfast::drivers {

static_assert(crypto_sign_PUBLICKEYBYTES == Ed25519::kKeyBytes);
static_assert(crypto_sign_BYTES == hal::Verifier::kSignatureBytes);

Ed25519::Ed25519(const Key& key) : key_(key), ready_(sodium_init() >= 0) {}

bool Ed25519::do_holds(std::span<const std::uint8_t> message,
                       std::span<const std::uint8_t, kSignatureBytes> signature) const {
  return ready_ && crypto_sign_verify_detached(signature.data(), message.data(), message.size(), key_.data()) == 0;
}

std::string read_public_key(const std::filesystem::path& path, Ed25519::Key& key) {
  std::ifstream in;
  if (!open_file(path, in)) return "the owner's key " + path.string() + " is not a regular file";
  std::string line;
  if (!in || !std::getline(in, line)) return "cannot read the owner's key from " + path.string();
  while (!line.empty() && (line.back() == '\r' || line.back() == ' ')) line.pop_back();
  std::size_t size = 0;
  const bool hex = line.size() == 2 * key.size() &&
                   sodium_hex2bin(key.data(), key.size(), line.data(), line.size(), nullptr, &size, nullptr) == 0;
  if (!hex || size != key.size()) return "the owner's key in " + path.string() + " is not 64 hex digits in one line";
  if (crypto_core_ed25519_is_valid_point(key.data()) != 1) {
    return "the owner's key in " + path.string() + " is not an Ed25519 public key";
  }
  return {};
}

}  // namespace holdfast::drivers
