// SPDX-License-Identifier: Apache-2.0
// The commands of the host tool, one function each: 0 = done, anything else = one line on stderr was printed.
#pragma once

#include <string>

#include "toolchain/holdfast/session.hpp"

namespace CLI {
class App;
}

namespace holdfast::tool {

struct CommonOptions {
  OutputPaths paths;
  std::string grid = "9x7";
  std::string mode = "fast";
  std::string model;
  std::string feature_set = "paper";
  bool json = false;
};

// Adds the options that replay and sim share.
void add_common_options(CLI::App& command, CommonOptions& options);

// Grid and mode to parameters; the model file to `tree` (false: the compiled one stays). Returns empty or an
// error line.
[[nodiscard]] std::string settle(const CommonOptions& options, Params& params, bool& auto_grid,
                                 std::unique_ptr<model::Tree>& tree, std::string& model_text);

struct ReplayOptions {
  CommonOptions common;
  std::string input;
  std::string reference = "first";
  double fps = 0;
};
[[nodiscard]] int replay(const ReplayOptions& options);

struct SimOptions {
  CommonOptions common;
  std::string scene;
  std::string camera = "3280x2464";
  bool list = false;
};
[[nodiscard]] int sim_grasp(const SimOptions& options);

// Lines for people and for programs.
void print_summary(const Session& session, const Summary& summary, const CommonOptions& options);
[[nodiscard]] int fail(const std::string& line);

}  // namespace holdfast::tool
