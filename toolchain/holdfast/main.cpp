// SPDX-License-Identifier: Apache-2.0
#include "toolchain/holdfast/commands.hpp"

int main(int argc, char** argv) {
  return holdfast::tool::command_line(argc, argv, HOLDFAST_VERSION);
}
