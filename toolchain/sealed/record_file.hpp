// SPDX-License-Identifier: Apache-2.0
// Files that hold a record for a device (firmware/store/sealed.hpp): how `holdfast settings` and `holdfast model` write
// and read them.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "store/sealed.hpp"

namespace CLI {
class App;
}

namespace holdfast::tool {

struct SealOptions {
  std::string input, output;
  std::string key;             // signs it; empty: nobody does
  std::uint32_t sequence = 0;  // 0: the seconds since 1970
};

// -o, --sign and --sequence.
void add_seal_options(CLI::App& command, SealOptions& options);

// Empty, or one line; `sequence`: the number that it got.
[[nodiscard]] std::string write_record(sealed::Kind kind, std::span<const std::uint8_t> payload,
                                       const SealOptions& options, std::uint32_t& sequence);

// A whole file that is one record of this kind. `owner_key` empty: any signature, or none, will do. The record lies in
// `bytes`. Empty, or one line.
[[nodiscard]] std::string read_record(sealed::Kind kind, const std::string& path, const std::string& owner_key,
                                      std::string& bytes, sealed::Record& record);

// "signed by this owner", "signed", "not signed".
[[nodiscard]] const char* signed_words(const sealed::Record& record, const std::string& owner_key);

[[nodiscard]] inline std::span<const std::uint8_t> bytes_of(const std::string& text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

}  // namespace holdfast::tool
