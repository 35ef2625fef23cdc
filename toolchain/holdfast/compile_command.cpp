// SPDX-License-Identifier: Apache-2.0
// holdfast compile: a model's text to the header that the firmware is built with and to the file that it can load.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "drivers/common/input_file.hpp"
#include "slip/model_file.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/support/atomic_file.hpp"
#include "toolchain/support/json_text.hpp"
#include "toolchain/treec/tree_model.hpp"

namespace holdfast::tool {
namespace {

namespace fs = std::filesystem;

struct CompileOptions {
  std::string model;
  std::string header;
  std::string binary;
  bool check = false;
  bool json = false;
};

struct Output {
  const char* option;
  const std::string& path;
  std::string bytes;
};

bool holds(const std::string& path, const std::string& bytes) {
  std::ifstream in;
  return drivers::open_file(path, in) && in &&
         std::equal(bytes.begin(), bytes.end(), std::istreambuf_iterator<char>(in), {});
}

void print(const treec::Model& model, const CompileOptions& options, const std::vector<Output>& outputs) {
  const auto leaves = std::ranges::count_if(model.nodes, &treec::Node::is_leaf);
  std::vector<std::string> read;
  for (std::size_t i = 0; i < model.features.size(); ++i) {
    if (std::ranges::any_of(model.nodes, [&](const treec::Node& node) {
          return !node.is_leaf && node.feature == static_cast<int>(i);
        })) {
      read.push_back(model.features[i].name);
    }
  }
  const std::string crc = fmt::format("{:08X}", model.text_crc32);
  if (options.json) {
    nlohmann::json out;
    out["name"] = model.name;
    out["feature_set"] = model.feature_set;
    out["features_read"] = read;
    out["nodes"] = model.nodes.size();
    out["leaves"] = leaves;
    out["depth"] = treec::depth(model);
    out["text_crc32"] = crc;
    for (const Output& output : outputs) out[output.option] = output.path;
    fmt::print("{}\n", text_of_json(out));
    return;
  }
  fmt::print("model     {}, CRC-32 of its text {}\n", model.name, crc);
  fmt::print("reads     {} of the set {}\n", fmt::join(read, ", "), model.feature_set);
  fmt::print("shape     {} nodes, {} leaves, at most {} predicates a frame\n", model.nodes.size(), leaves,
             treec::depth(model));
  for (const Output& output : outputs) {
    fmt::print("{:9} {}: {}\n", options.check ? "checked" : "written", output.option, output.path);
  }
}

int compile(const CompileOptions& options) {
  std::vector<OutputFiles::Asked> asked;
  if (!options.check) asked = {{"--header", options.header}, {"--binary", options.binary}};
  OutputFiles files(asked, {options.model}, "the model");
  if (!files.error().empty()) return fail(files.error());
  treec::Model model;
  if (const std::string error = read_model(options.model, model); !error.empty()) return fail(error);
  if (fs::path(options.model).filename() != model.name + ".tree") {
    return fail(fmt::format(
        "{}: the model inside is named {}. Likely cause: the file was copied or renamed. Next: name the file {}.tree, "
        "or the model as the file",
        options.model, model.name, model.name));
  }

  std::vector<Output> outputs;
  if (!options.header.empty()) outputs.push_back({"header", options.header, treec::emit(model)});
  if (!options.binary.empty()) {
    const treec::Binary binary = treec::to_binary(model);
    outputs.push_back({"binary", options.binary, {binary.begin(), binary.end()}});
  }
  if (!options.check) {
    for (const Output& output : outputs) *files.stream(std::string("--") + output.option) << output.bytes;
    if (const std::string error = files.commit(); !error.empty()) return fail(error);
  } else if (outputs.empty()) {
    return fail(
        "--check: nothing to compare with. Likely cause: no output was named. Next: add --header FILE or --binary "
        "FILE; without --check the model alone is checked");
  }
  for (const Output& output : outputs) {
    if (!options.check || holds(output.path, output.bytes)) continue;
    return fail(fmt::format(
        "{}: is not what {} compiles to. Likely cause: the model changed after it was compiled, or this file was "
        "edited. Next: run the same without --check",
        output.path, options.model));
  }
  print(model, options, outputs);
  return 0;
}

}  // namespace

void add_compile(CLI::App& app, std::vector<Command>& commands) {
  const auto options = std::make_shared<CompileOptions>();
  CLI::App* const command = app.add_subcommand("compile", "check a model and compile it for the firmware");
  command->add_option("MODEL", options->model, "model text, named as the model with .tree behind it")
      ->required()
      ->check(not_empty);
  command->add_option("--header", options->header, "write the branching form that the firmware is built with: C++")
      ->check(not_empty);
  command
      ->add_option("--binary", options->binary,
                   "write the form that the firmware loads (--model, and holdfast model seal): binary")
      ->check(not_empty);
  command->add_flag("--check", options->check, "write nothing; fail when a file is not what the model compiles to");
  command->add_flag("--json", options->json, "print the summary as JSON");
  command->footer(
      "Example:\n  holdfast compile toolchain/model/slip_v6.tree --header firmware/slip/slip_tree.gen.hpp "
      "--binary slip_v6.model");
  commands.push_back({command, [options] { return compile(*options); }});
}

}  // namespace holdfast::tool
