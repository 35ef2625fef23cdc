// SPDX-License-Identifier: Apache-2.0
// The documentation of scene files, written from the table that the reader works with.
#pragma once

#include <string>

namespace holdfast::scene_doc {

// The whole of tests/scenes/README.md: an example, fields, contact levels and limits.
[[nodiscard]] std::string scene_markdown();

}  // namespace holdfast::scene_doc
