// SPDX-License-Identifier: Apache-2.0
// holdfast settings: TOML to the record that a device takes (firmware/app/sealed.hpp), the owner's keys, and what is in
// a record.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdint>
#include <ctime>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

#include "app/sealed.hpp"
#include "app/settings.hpp"
#include "drivers/common/ed25519.hpp"
#include "toolchain/holdfast/atomic_file.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/holdfast/owner_key.hpp"
#include "toolchain/holdfast/settings_toml.hpp"

namespace holdfast::tool {
namespace {

constexpr std::size_t kMostText = 1U << 16U;

struct Options {
  std::string input, output, key;
  std::uint32_t sequence = 0;  // 0: the seconds since 1970
  bool json = false;
};

std::string read_file(const std::string& path, const char* wanted, std::string& bytes) {
  std::ifstream in(path, std::ios::binary);
  bytes.resize(kMostText);
  in.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  bytes.resize(static_cast<std::size_t>(std::max<std::streamsize>(in.gcount(), 0)));
  if (!in.bad() && in.eof()) return {};
  return fmt::format("{}: {}. Likely cause: no such file, no right to read it, or another one was meant. Next: give {}",
                     path, in.eof() || bytes.empty() ? "cannot be read" : "is larger than any settings", wanted);
}

int compile(const Options& options) {
  std::string text;
  if (const std::string error = read_file(options.input, "a TOML file", text); !error.empty()) return fail(error);
  Params params;
  if (const std::string error = settings_of_toml(text, options.input, params); !error.empty()) return fail(error);
  OwnerKey key;
  if (!options.key.empty()) {
    if (const std::string error = key.read(options.key); !error.empty()) return fail(error);
  }
  std::vector<std::uint8_t> payload(settings::kMostPayload), record(settings::kMostBytes);
  payload.resize(settings::write(params, payload));
  const std::uint32_t sequence =
      options.sequence != 0 ? options.sequence : static_cast<std::uint32_t>(std::time(nullptr));
  record.resize(sealed::write(sealed::Kind::kSettings, sequence, payload, record));
  if (!options.key.empty()) key.sign(record);
  AtomicFile file(options.output, options.input);
  if (!file.error().empty()) return fail(file.error());
  file.stream().write(reinterpret_cast<const char*>(record.data()), static_cast<std::streamsize>(record.size()));
  if (const std::string error = file.commit(); !error.empty()) return fail(error);
  const std::size_t count = payload.size() / settings::kEntryBytes;
  if (options.json) {
    fmt::print(
        "{}\n",
        nlohmann::ordered_json{
            {"output", options.output}, {"settings", count}, {"sequence", sequence}, {"signed", !options.key.empty()}}
            .dump());
  } else {
    fmt::print("{}: {} settings that differ from the defaults, number {}, {}\n", options.output, count, sequence,
               options.key.empty() ? "not signed: for development mode only" : "signed");
  }
  return 0;
}

int show(const Options& options) {
  std::string text;
  if (const std::string error = read_file(options.input, "what holdfast settings compile wrote", text);
      !error.empty()) {
    return fail(error);
  }
  const std::span<const std::uint8_t> bytes(reinterpret_cast<const std::uint8_t*>(text.data()), text.size());
  std::unique_ptr<drivers::Ed25519> owner;
  if (!options.key.empty()) {
    drivers::Ed25519::Key key{};
    if (const std::string error = drivers::read_public_key(options.key, key); !error.empty()) {
      return fail(error + ". Likely cause: another file. Next: give the owner.pub that holdfast settings keygen made");
    }
    owner = std::make_unique<drivers::Ed25519>(key);
  }
  sealed::Record record;
  const sealed::Refusal refusal = sealed::read(bytes, sealed::Kind::kSettings, owner.get(), record);
  Params params;
  const bool readable = refusal == sealed::Refusal::kNone && record.bytes == bytes.size();
  if (refusal == sealed::Refusal::kUnsigned || refusal == sealed::Refusal::kSignature) {
    return fail(fmt::format("{}: {}. Likely cause: {}. Next: sign it with the owner.key that belongs to {}",
                            options.input,
                            refusal == sealed::Refusal::kUnsigned ? "is not signed" : "is not signed by this owner",
                            "another key, or none, when it was compiled", options.key));
  }
  const settings::Loaded loaded = readable ? settings::read(record.payload, params) : settings::Loaded::kNothing;
  if (loaded == settings::Loaded::kNothing) {
    return fail(
        fmt::format("{}: holds no settings that are whole and go together. Likely cause: another file, a bad "
                    "copy, or another version. Next: compile it again",
                    options.input));
  }
  const char* const is_signed = !record.is_signed ? "not signed" : owner ? "signed by this owner" : "signed";
  if (options.json) {
    nlohmann::ordered_json values;
    for (const ParamInfo& row : kParams) {
      if (params.*row.member != row.default_value) values[std::string(row.name)] = params.*row.member;
    }
    fmt::print("{}\n", nlohmann::ordered_json{{"sequence", record.sequence},
                                              {"signed", record.is_signed},
                                              {"all_known", loaded == settings::Loaded::kAll},
                                              {"settings", values}}
                           .dump());
    return 0;
  }
  fmt::print("# number {}, {}{}\n{}", record.sequence, is_signed,
             loaded == settings::Loaded::kAll ? "" : "; holds values that this version does not know",
             toml_of_settings(params));
  return 0;
}

int list() {
  for (const ParamInfo& row : kParams) {
    fmt::print("# {}; {} to {}{}{}\n# {} = {}\n", row.help, row.min, row.max, row.unit.empty() ? "" : " ", row.unit,
               row.name, row.default_value);
  }
  return 0;
}

}  // namespace

void add_settings(CLI::App& app, std::vector<Command>& commands) {
  const auto options = std::make_shared<Options>();
  CLI::App* const command = app.add_subcommand("settings", "check, compile and sign settings for a device");
  command->require_subcommand(1);

  CLI::App* const compile_command =
      command->add_subcommand("compile", "check a TOML file of settings and compile it for a device");
  compile_command->add_option("TOML", options->input, "settings, one name = value a line")
      ->required()
      ->check(not_empty);
  compile_command->add_option("-o,--output", options->output, "write the record that a device loads")
      ->required()
      ->check(not_empty);
  compile_command->add_option("--sign", options->key, "sign it with this owner.key")->check(not_empty);
  compile_command
      ->add_option("--sequence", options->sequence,
                   "its number, above that of what the device has; without it the seconds since 1970")
      ->check(CLI::Range(std::uint32_t{1}, UINT32_MAX));
  compile_command->add_flag("--json", options->json, "print the summary as JSON");
  compile_command->footer(
      "Example:\n  holdfast settings compile robot.toml -o robot.settings --sign keys/owner.key\n"
      "  holdfast console --load robot.settings --code-file code");
  commands.push_back({compile_command, [options] { return compile(*options); }});

  CLI::App* const show_command = command->add_subcommand("show", "what is in a compiled file, as TOML");
  show_command->add_option("FILE", options->input, "what compile wrote")->required()->check(not_empty);
  show_command->add_option("--owner-key", options->key, "and whether the owner of this owner.pub signed it")
      ->check(not_empty);
  show_command->add_flag("--json", options->json, "as JSON");
  show_command->footer("Example:\n  holdfast settings show robot.settings --owner-key keys/owner.pub");
  commands.push_back({show_command, [options] { return show(*options); }});

  CLI::App* const list_command = command->add_subcommand("list", "every parameter with its default, as TOML to edit");
  list_command->footer("Example:\n  holdfast settings list > robot.toml");
  commands.push_back({list_command, list});

  CLI::App* const keygen_command = command->add_subcommand("keygen", "make an owner's pair of keys");
  keygen_command->add_option("FOLDER", options->output, "gets owner.key, which signs, and owner.pub for the devices")
      ->required()
      ->check(not_empty);
  keygen_command->footer("Example:\n  holdfast settings keygen keys");
  commands.push_back({keygen_command, [options] {
                        const std::string error = make_owner_keys(options->output);
                        if (!error.empty()) return fail(error);
                        fmt::print(
                            "{0}/owner.key signs: keep it, and show it to nobody\n{0}/owner.pub goes onto the "
                            "devices: holdfastd --owner-key\n",
                            options->output);
                        return 0;
                      }});
}

}  // namespace holdfast::tool
