// SPDX-License-Identifier: Apache-2.0
// What may be said at the prompt, learned from the device's own help, and the words of this side beside it.
#pragma once

#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "toolchain/console/device.hpp"

namespace holdfast::console_tool {

struct Word {
  std::string name;
  std::string arguments;  // as `help json` writes them: words in capitals stand for something else
  std::string help;
};

// What is done here and not by the device.
[[nodiscard]] const std::array<Word, 5>& local_words();

struct Vocabulary {
  std::vector<Word> commands;
  std::vector<std::string> parameters;
};
// Empty of what the device did not tell: then nothing is completed.
[[nodiscard]] Vocabulary learn_vocabulary(Device& device);

struct Completion {
  std::string insert;                // what all choices go on with; with a blank behind it when there is one only
  std::vector<std::string> choices;  // when nothing can be inserted
};
// `before`: the line up to the cursor.
[[nodiscard]] Completion complete(const Vocabulary& vocabulary, std::string_view before);

}  // namespace holdfast::console_tool
