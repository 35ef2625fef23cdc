// SPDX-License-Identifier: Apache-2.0
#include "tests/support/folders.hpp"

namespace holdfast::test {

std::string source(const std::string& path) {
  return HOLDFAST_SOURCE_DIR "/" + path;
}

std::string program(const std::string& name) {
  return HOLDFAST_BIN_DIR "/" + name;
}

}  // namespace holdfast::test
