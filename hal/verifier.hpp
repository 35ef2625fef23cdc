// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

namespace holdfast::hal {

// Tells whether the owner of this device signed something. No heap.
class Verifier {
 public:
  static constexpr std::size_t kSignatureBytes = 64;

  virtual ~Verifier() = default;
  [[nodiscard]] bool holds(std::span<const std::uint8_t> message,
                           std::span<const std::uint8_t, kSignatureBytes> signature) const {
    return do_holds(message, signature);
  }

 private:
  [[nodiscard]] virtual bool do_holds(std::span<const std::uint8_t> message,
                                      std::span<const std::uint8_t, kSignatureBytes> signature) const = 0;
};

// A device whose owner is not known: nothing holds.
class NoOwner final : public Verifier {
 private:
  [[nodiscard]] bool do_holds(std::span<const std::uint8_t> /*message*/,
                              std::span<const std::uint8_t, kSignatureBytes> /*signature*/) const override {
    return false;
  }
};

}  // namespace holdfast::hal
