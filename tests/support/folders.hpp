// SPDX-License-Identifier: Apache-2.0
// Where this source tree lies, and the programs that were built of it.
#pragma once

#include <string>

namespace holdfast::test {

// A file or folder of the source tree, by its path from the top: an absolute path.
[[nodiscard]] std::string source(const std::string& path);

// A program of this build, or what is made beside them, by its name: an absolute path.
[[nodiscard]] std::string program(const std::string& name);

inline const std::string kTool = program("holdfast");
inline const std::string kFirmware = program("holdfastd");
inline const std::string kFilm = source("tests/data/slip.mjpg");  // of a slip, as a camera sends it

}  // namespace holdfast::test
