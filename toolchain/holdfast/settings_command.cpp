// SPDX-License-Identifier: Apache-2.0
// holdfast settings: TOML to the record that a device takes (firmware/store/sealed.hpp), the owner's keys, and what is
// in a record.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "drivers/common/input_file.hpp"
#include "store/settings.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/sealed/owner_key.hpp"
#include "toolchain/sealed/record_file.hpp"
#include "toolchain/sealed/settings_toml.hpp"
#include "toolchain/support/json_text.hpp"

namespace holdfast::tool {
namespace {

struct SettingsOptions {
  SealOptions seal;
  bool json = false;
};

int compile_settings(const SettingsOptions& options) {
  const SealOptions& seal = options.seal;
  std::string text;
  if (const std::string error = drivers::read_file(seal.input, "settings", "give a TOML file", text); !error.empty()) {
    return fail(error);
  }
  Params params;
  if (const std::string error = settings_of_toml(text, seal.input, params); !error.empty()) return fail(error);
  std::vector<std::uint8_t> payload(settings::kMostPayload);
  payload.resize(settings::write(params, payload));
  std::uint32_t sequence = 0;
  if (const std::string error = write_record(sealed::Kind::kSettings, payload, seal, sequence); !error.empty()) {
    return fail(error);
  }
  const std::size_t count = payload.size() / settings::kEntryBytes;
  const bool is_signed = !seal.key.empty();
  if (options.json) {
    fmt::print("{}\n",
               text_of_json(nlohmann::ordered_json{
                   {"output", seal.output}, {"settings", count}, {"sequence", sequence}, {"signed", is_signed}}));
  } else {
    fmt::print("{}: {} settings that differ from the defaults, number {}, {}\n", seal.output, count, sequence,
               is_signed ? "signed" : "not signed: for development mode only");
  }
  return 0;
}

int show_settings(const SettingsOptions& options) {
  std::string bytes;
  sealed::Record record;
  if (const std::string error =
          read_record(sealed::Kind::kSettings, options.seal.input, options.seal.key, bytes, record);
      !error.empty()) {
    return fail(error);
  }
  Params params;
  const settings::Loaded loaded = settings::read(record.payload, params);
  if (loaded == settings::Loaded::kNothing) {
    return fail(
        fmt::format("{}: holds no settings that go together. Likely cause: another version. Next: compile it again",
                    options.seal.input));
  }
  if (options.json) {
    nlohmann::ordered_json values;
    for (const ParamInfo& row : kParams) {
      if (params.*row.member != row.default_value) values[std::string(row.name)] = params.*row.member;
    }
    fmt::print("{}\n", text_of_json(nlohmann::ordered_json{{"sequence", record.sequence},
                                                           {"signed", record.is_signed},
                                                           {"all_known", loaded == settings::Loaded::kAll},
                                                           {"settings", values}}));
    return 0;
  }
  fmt::print("# number {}, {}{}\n{}", record.sequence, signed_words(record, options.seal.key),
             loaded == settings::Loaded::kAll ? "" : "; holds values that this version does not know",
             toml_of_settings(params));
  return 0;
}

int list() {
  for (const ParamInfo& row : kParams) {
    fmt::print("# {}; {} to {}{}{}; {}: {}\n# {} = {}\n", row.help, row.min, row.max, row.unit.empty() ? "" : " ",
               row.unit, kParamClassNames[static_cast<std::size_t>(row.kind)], row.why, row.name, row.default_value);
  }
  return 0;
}

}  // namespace

void add_settings(CLI::App& app, std::vector<Command>& commands) {
  const auto options = std::make_shared<SettingsOptions>();
  CLI::App* const command = app.add_subcommand("settings", "check, compile and sign settings for a device");
  command->require_subcommand(1);
  command->footer("Example:\n  holdfast settings compile robot.toml -o robot.settings --sign keys/owner.key");

  CLI::App* const compile_command =
      command->add_subcommand("compile", "check a TOML file of settings and compile it for a device");
  compile_command->add_option("TOML", options->seal.input, "settings, one name = value a line")
      ->required()
      ->check(not_empty);
  add_seal_options(*compile_command, options->seal);
  compile_command->add_flag("--json", options->json, "print the summary as JSON");
  compile_command->footer(
      "Example:\n  holdfast settings compile robot.toml -o robot.settings --sign keys/owner.key\n"
      "  holdfast console --load robot.settings --code-file code");
  commands.push_back({compile_command, [options] { return compile_settings(*options); }});

  CLI::App* const show_command = command->add_subcommand("show", "what is in a compiled file, as TOML");
  show_command->add_option("FILE", options->seal.input, "what compile wrote")->required()->check(not_empty);
  show_command->add_option("--owner-key", options->seal.key, "and whether the owner of this owner.pub signed it")
      ->check(not_empty);
  show_command->add_flag("--json", options->json, "as JSON");
  show_command->footer("Example:\n  holdfast settings show robot.settings --owner-key keys/owner.pub");
  commands.push_back({show_command, [options] { return show_settings(*options); }});

  CLI::App* const list_command = command->add_subcommand("list", "every parameter with its default, as TOML to edit");
  list_command->footer("Example:\n  holdfast settings list > robot.toml");
  commands.push_back({list_command, list});

  CLI::App* const keygen_command = command->add_subcommand("keygen", "make an owner's pair of keys");
  keygen_command
      ->add_option("FOLDER", options->seal.output, "gets owner.key, which signs, and owner.pub for the devices")
      ->required()
      ->check(not_empty);
  keygen_command->footer("Example:\n  holdfast settings keygen keys");
  commands.push_back({keygen_command, [options] {
                        const std::string error = make_owner_keys(options->seal.output);
                        if (!error.empty()) return fail(error);
                        fmt::print(
                            "{0}/owner.key signs: keep it, and show it to nobody\n{0}/owner.pub goes onto the "
                            "devices: holdfastd --owner-key\n",
                            options->seal.output);
                        return 0;
                      }});
}

}  // namespace holdfast::tool
