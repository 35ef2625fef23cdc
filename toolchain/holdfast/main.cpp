// SPDX-License-Identifier: Apache-2.0
#include "toolchain/holdfast/command_line.hpp"

int main(int argc, char** argv) {
  return holdfast::tool::command_line(argc, argv, HOLDFAST_VERSION);
}
