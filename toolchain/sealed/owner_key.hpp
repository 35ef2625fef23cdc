// SPDX-License-Identifier: Apache-2.0
// The owner's keys on the host: owner.key, which signs and stays with the owner, and owner.pub, which goes onto the
// devices. Each is one line: `secret ` and 64 hex digits, the seed of RFC 8032's private key; and 64 hex digits, the
// public key. So neither is taken for the other: a public key used as a seed would sign with a key that all can read.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>

namespace holdfast::tool {

class OwnerKey {
 public:
  OwnerKey() = default;
  ~OwnerKey();
  OwnerKey(const OwnerKey&) = delete;
  OwnerKey& operator=(const OwnerKey&) = delete;

  // Empty, or one line: what, likely cause, next step.
  [[nodiscard]] std::string read(const std::string& path);
  // A record of write() (store/sealed.hpp).
  void sign(std::span<std::uint8_t> record) const;

 private:
  std::array<std::uint8_t, 64> secret_{};
};

// Makes the folder unless it is there, and both files, which must not be; owner.key is for its owner's eyes only.
// Empty, or one line.
[[nodiscard]] std::string make_owner_keys(const std::string& folder);

}  // namespace holdfast::tool
