// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace holdfast::tool {

// JSON in one line. A name of a file need not be UTF-8, and JSON must be: what is none is replaced.
template <typename Json>
[[nodiscard]] std::string text_of_json(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace holdfast::tool
