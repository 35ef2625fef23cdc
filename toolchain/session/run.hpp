// SPDX-License-Identifier: Apache-2.0
// What replay and sim share: their options, the model that they ask for, their summary.
#pragma once

#include <memory>
#include <string>

#include "toolchain/session/session.hpp"
#include "toolchain/treec/tree_model.hpp"

namespace CLI {
class App;
}

namespace holdfast::tool {

struct CommonOptions {
  OutputPaths paths;
  std::string grid = "9x7";
  std::string mode = "fast";
  std::string model;
  std::string feature_set;  // empty = whatever the tree reads
  std::string settings;     // a device's, as TOML; grid and mode are those above
  bool json = false;
};

// Adds the options that replay and sim share.
void add_common_options(CLI::App& command, CommonOptions& options);

// Grid and mode to parameters; the model file to `tree` (false: the compiled one stays). Returns empty or an
// error line.
[[nodiscard]] std::string settle(const CommonOptions& options, Params& params, bool& auto_grid,
                                 std::unique_ptr<model::Tree>& tree, std::string& model_text);

// A model's text, read and checked. Returns empty or an error line.
[[nodiscard]] std::string read_model(const std::string& path, treec::Model& model);

// Lines for people, or JSON.
void print_summary(const Session& session, const Summary& summary, const CommonOptions& options);
}  // namespace holdfast::tool
