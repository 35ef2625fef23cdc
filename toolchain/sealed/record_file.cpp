// SPDX-License-Identifier: Apache-2.0
#include "toolchain/sealed/record_file.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <ctime>
#include <fstream>
#include <memory>

#include "drivers/common/ed25519.hpp"
#include "drivers/common/input_file.hpp"
#include "drivers/common/trouble.hpp"
#include "toolchain/sealed/owner_key.hpp"
#include "toolchain/support/atomic_file.hpp"
#include "toolchain/support/cli.hpp"

namespace holdfast::tool {
void add_seal_options(CLI::App& command, SealOptions& options) {
  command.add_option("-o,--output", options.output, "write the record that a device loads")
      ->required()
      ->check(not_empty);
  command.add_option("--sign", options.key, "sign it with this owner.key")->check(not_empty);
  command
      .add_option("--sequence", options.sequence,
                  "its number, above that of what the device has; without it the seconds since 1970")
      ->check(
          CLI::Range(std::uint32_t{1}, UINT32_MAX - 1));  // behind the last one there is none (store/slot_store.hpp)
}

std::string write_record(sealed::Kind kind, std::span<const std::uint8_t> payload, const SealOptions& options,
                         std::uint32_t& sequence) {
  OwnerKey key;
  if (!options.key.empty()) {
    if (std::string error = key.read(options.key); !error.empty()) return error;
  }
  sequence = options.sequence != 0 ? options.sequence : static_cast<std::uint32_t>(std::time(nullptr));
  std::vector<std::uint8_t> record(payload.size() + sealed::kAround);
  (void)sealed::write(kind, sequence, payload, record);
  if (!options.key.empty()) key.sign(record);
  OutputFiles files({{"-o", options.output}}, {options.input, options.key});
  if (!files.error().empty()) return files.error();
  files.stream("-o")->write(reinterpret_cast<const char*>(record.data()), static_cast<std::streamsize>(record.size()));
  return files.commit();
}

std::string read_record(sealed::Kind kind, const std::string& path, const std::string& owner_key, std::string& bytes,
                        sealed::Record& record) {
  const bool settings = kind == sealed::Kind::kSettings;
  const char* const what = settings ? "settings" : "model";
  const char* const give =
      settings ? "give what holdfast settings compile wrote" : "give what holdfast model seal wrote";
  if (std::string error = drivers::read_file(path, what, give, bytes); !error.empty()) return error;
  std::unique_ptr<drivers::Ed25519> owner;
  if (!owner_key.empty()) {
    drivers::Ed25519::Key key{};
    if (const std::string error = drivers::read_public_key(owner_key, key); !error.empty()) {
      return error + ". Likely cause: another file. Next: give the owner.pub that holdfast settings keygen made";
    }
    owner = std::make_unique<drivers::Ed25519>(key);
  }
  const sealed::Refusal refusal = sealed::read(bytes_of(bytes), kind, owner.get(), record);
  if (refusal == sealed::Refusal::kUnsigned || refusal == sealed::Refusal::kSignature) {
    return fmt::format(
        "{}: {}. Likely cause: another key, or none, when it was made. Next: sign it with the owner.key that belongs "
        "to {}",
        path, refusal == sealed::Refusal::kUnsigned ? "is not signed" : "is not signed by this owner", owner_key);
  }
  if (refusal == sealed::Refusal::kNone && record.bytes == bytes.size()) return {};
  return fmt::format("{}: holds no {} whole and in one piece. Likely cause: {}. Next: make it again", path, what,
                     refusal == sealed::Refusal::kOtherKind ? "a record of another kind"
                                                            : "another file, a bad copy, or another version");
}

const char* signed_words(const sealed::Record& record, const std::string& owner_key) {
  if (!record.is_signed) return "not signed";
  return owner_key.empty() ? "signed" : "signed by this owner";
}

}  // namespace holdfast::tool
