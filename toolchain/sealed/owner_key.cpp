// SPDX-License-Identifier: Apache-2.0
#include "toolchain/sealed/owner_key.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sodium.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <string_view>
#include <system_error>

#include "drivers/common/input_file.hpp"
#include "store/sealed.hpp"

namespace holdfast::tool {
namespace {

namespace fs = std::filesystem;
using Seed = std::array<std::uint8_t, crypto_sign_SEEDBYTES>;
constexpr std::string_view kSecret = "secret ";
constexpr std::size_t kDigits = 2 * crypto_sign_SEEDBYTES;
using Line = std::array<char, kSecret.size() + kDigits + 1>;
static_assert(crypto_sign_SEEDBYTES == 32 && crypto_sign_PUBLICKEYBYTES == 32 && crypto_sign_SECRETKEYBYTES == 64);

// Empty, or why not; made by this call and by no other.
std::string write_new(const fs::path& path, mode_t mode, std::span<char> line) {
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, mode);
  if (fd < 0) return std::strerror(errno);
  line.back() = '\n';
  const bool written = ::write(fd, line.data(), line.size()) == static_cast<ssize_t>(line.size()) && ::fsync(fd) == 0;
  const int why = errno;
  (void)::close(fd);
  if (written) return {};
  std::error_code ignored;
  fs::remove(path, ignored);
  return std::strerror(why);
}

}  // namespace

OwnerKey::~OwnerKey() {
  sodium_memzero(secret_.data(), secret_.size());
}

std::string OwnerKey::read(const std::string& path) {
  constexpr std::string_view kGive = "give the owner.key that holdfast settings keygen made";
  std::ifstream in;
  if (std::string wrong = drivers::open_file(path, kGive, in); !wrong.empty()) return wrong;
  Line line{};
  in.read(line.data(), line.size());
  Seed seed{};
  std::size_t size = 0;
  const bool good =
      sodium_init() >= 0 && static_cast<std::size_t>(in.gcount()) == line.size() && line.back() == '\n' &&
      in.peek() == std::ifstream::traits_type::eof() &&
      std::string_view(line.data(), line.size()).starts_with(kSecret) &&
      sodium_hex2bin(seed.data(), seed.size(), line.data() + kSecret.size(), kDigits, nullptr, &size, nullptr) == 0 &&
      size == seed.size();
  if (good) {
    std::array<std::uint8_t, crypto_sign_PUBLICKEYBYTES> key{};
    (void)crypto_sign_seed_keypair(key.data(), secret_.data(), seed.data());
  }
  sodium_memzero(line.data(), line.size());
  sodium_memzero(seed.data(), seed.size());
  if (good) return {};
  return trouble(path + ": is no key to sign with", "another file", kGive);
}

void OwnerKey::sign(std::span<std::uint8_t> record) const {
  std::array<std::uint8_t, sealed::kSignatureBytes> signature{};
  const std::span<const std::uint8_t> part = sealed::signed_part(record);
  (void)crypto_sign_detached(signature.data(), nullptr, part.data(), part.size(), secret_.data());
  sealed::put_signature(record, signature);
}

std::string make_owner_keys(const std::string& folder) {
  if (sodium_init() < 0) {
    return "no random numbers are to be had. Likely cause: a container without them. Next: make the keys on another "
           "machine";
  }
  std::error_code error;
  fs::create_directory(folder, error);
  const fs::path secret = fs::path(folder) / "owner.key", key = fs::path(folder) / "owner.pub";
  for (const fs::path& path : {secret, key}) {
    if (!fs::exists(fs::symlink_status(path, error))) continue;
    return path.string() +
           ": is there already. Likely cause: the keys were made before, and devices know them. Next: use them, or "
           "give another folder";
  }
  Seed seed{};
  std::array<std::uint8_t, crypto_sign_PUBLICKEYBYTES> public_bytes{};
  std::array<std::uint8_t, crypto_sign_SECRETKEYBYTES> secret_bytes{};
  randombytes_buf(seed.data(), seed.size());
  (void)crypto_sign_seed_keypair(public_bytes.data(), secret_bytes.data(), seed.data());
  Line line{};
  std::copy(kSecret.begin(), kSecret.end(), line.begin());
  (void)sodium_bin2hex(line.data() + kSecret.size(), kDigits + 1, seed.data(), seed.size());
  std::string wrong = write_new(secret, 0600, line);
  sodium_memzero(seed.data(), seed.size());
  sodium_memzero(secret_bytes.data(), secret_bytes.size());
  sodium_memzero(line.data(), line.size());
  if (wrong.empty()) {
    (void)sodium_bin2hex(line.data(), line.size(), public_bytes.data(), public_bytes.size());
    wrong = write_new(key, 0644, std::span(line).first(kDigits + 1));
    if (!wrong.empty()) fs::remove(secret, error);
  }
  if (wrong.empty()) return {};
  return fmt::format(
      "{}: no keys could be written there: {}. Likely cause: the folder above it is not there or not "
      "yours. Next: give another folder",
      folder, wrong);
}

}  // namespace holdfast::tool
