// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>

namespace CLI {
class App;
}

namespace holdfast::tool {

// A command that brings its own options: what adds it puts it into the list of those that can be run.
struct Command {
  CLI::App* app = nullptr;
  std::function<int()> run;
};

}  // namespace holdfast::tool
