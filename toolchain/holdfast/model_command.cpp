// SPDX-License-Identifier: Apache-2.0
// holdfast model: a compiled model to the record that a device takes (firmware/store/sealed.hpp), and what is in one.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "drivers/common/input_file.hpp"
#include "store/models.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/sealed/record_file.hpp"
#include "toolchain/support/json_text.hpp"

namespace holdfast::tool {
namespace {

struct ModelOptions {
  SealOptions seal;
  bool compiled_in = false;
  bool json = false;
};

constexpr const char* kCompiledIn = "the model that is compiled in";

std::string refusal_line(const std::string& path, model_file::Refusal refusal) {
  const model_file::RefusalInfo& why = model_file::info(refusal);
  return fmt::format("{}: {}. Likely cause: {}. Next: {}", path, why.what, why.cause, why.next);
}

nlohmann::ordered_json json_of(const model::Tree& tree) {
  return {{"name", std::string(name_of(tree))},
          {"feature_set", std::string(tree.set->name)},
          {"nodes", tree.count},
          {"depth", model::depth_of(tree)},
          {"text_crc32", fmt::format("{:08X}", tree.text_crc32)},
          {"crc32", tree.text_crc32}};  // as the console writes it
}

std::string text_of(const model::Tree& tree) {
  return fmt::format("{}, CRC-32 of its text {:08X} (at the console {}), set {}, {} nodes", name_of(tree),
                     tree.text_crc32, tree.text_crc32, tree.set->name, tree.count);
}

int seal_model(const ModelOptions& options) {
  if (options.compiled_in == !options.seal.input.empty()) {
    return fail(
        "holdfast model seal: give either a compiled model or --compiled-in. Likely cause: one was left out, or both "
        "were given. Next: holdfast model seal --help shows how");
  }
  std::string bytes;
  model::Tree tree;
  if (!options.compiled_in) {
    if (const std::string error =
            drivers::read_file(options.seal.input, "model", "give what holdfast compile --binary wrote", bytes);
        !error.empty()) {
      return fail(error);
    }
    if (const auto refusal = model_file::read(bytes_of(bytes), tree); refusal != model_file::Refusal::kNone) {
      return fail(refusal_line(options.seal.input, refusal));
    }
  }
  std::uint32_t sequence = 0;
  if (const std::string error = write_record(sealed::Kind::kModel, bytes_of(bytes), options.seal, sequence);
      !error.empty()) {
    return fail(error);
  }
  const bool is_signed = !options.seal.key.empty();
  if (options.json) {
    nlohmann::ordered_json out{{"output", options.seal.output}, {"sequence", sequence}, {"signed", is_signed}};
    out["model"] = options.compiled_in ? nlohmann::ordered_json() : json_of(tree);
    fmt::print("{}\n", text_of_json(out));
  } else {
    fmt::print("{}: {}; number {}, {}\n", options.seal.output, options.compiled_in ? kCompiledIn : text_of(tree),
               sequence, is_signed ? "signed" : "not signed: for development mode only");
  }
  return 0;
}

int show_model(const ModelOptions& options) {
  std::string bytes;
  sealed::Record record;
  if (const std::string error = read_record(sealed::Kind::kModel, options.seal.input, options.seal.key, bytes, record);
      !error.empty()) {
    return fail(error);
  }
  const bool compiled_in = record.payload.empty();
  model::Tree tree;
  const auto refusal = compiled_in ? model_file::Refusal::kNone : model_file::read(record.payload, tree);
  if (refusal != model_file::Refusal::kNone) return fail(refusal_line(options.seal.input, refusal));
  if (options.json) {
    nlohmann::ordered_json out{{"sequence", record.sequence}, {"signed", record.is_signed}};
    out["model"] = compiled_in ? nlohmann::ordered_json() : json_of(tree);
    fmt::print("{}\n", text_of_json(out));
  } else {
    fmt::print("{}; number {}, {}\n", compiled_in ? kCompiledIn : text_of(tree), record.sequence,
               signed_words(record, options.seal.key));
  }
  return 0;
}

}  // namespace

void add_model(CLI::App& app, std::vector<Command>& commands) {
  const auto options = std::make_shared<ModelOptions>();
  CLI::App* const command = app.add_subcommand("model", "seal and sign a compiled model for a device");
  command->require_subcommand(1);
  command->footer("Example:\n  holdfast model seal slip_v6.model -o slip_v6.sealed --sign keys/owner.key");

  CLI::App* const seal_command = command->add_subcommand("seal", "check a compiled model and seal it for a device");
  seal_command->add_option("MODEL", options->seal.input, "what holdfast compile --binary wrote")->check(not_empty);
  seal_command->add_flag("--compiled-in", options->compiled_in,
                         "no model: a device that loads it goes back to the one that is compiled in");
  add_seal_options(*seal_command, options->seal);
  seal_command->add_flag("--json", options->json, "print the summary as JSON");
  seal_command->footer(
      "Example:\n  holdfast compile slip_v6.tree --binary slip_v6.model\n"
      "  holdfast model seal slip_v6.model -o slip_v6.sealed --sign keys/owner.key\n"
      "  holdfast console --load slip_v6.sealed --code-file code");
  commands.push_back({seal_command, [options] { return seal_model(*options); }});

  CLI::App* const show_command = command->add_subcommand("show", "what is in a sealed file");
  show_command->add_option("FILE", options->seal.input, "what seal wrote")->required()->check(not_empty);
  show_command->add_option("--owner-key", options->seal.key, "and whether the owner of this owner.pub signed it")
      ->check(not_empty);
  show_command->add_flag("--json", options->json, "as JSON");
  show_command->footer("Example:\n  holdfast model show slip_v6.sealed --owner-key keys/owner.pub");
  commands.push_back({show_command, [options] { return show_model(*options); }});
}

}  // namespace holdfast::tool
