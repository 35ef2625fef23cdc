// SPDX-License-Identifier: Apache-2.0
// Notes as files: the first line of each, in a folder that lies in memory (on a card /run/holdfast-notes). Whoever
// leaves one puts a whole file in the place of the old one.
#pragma once

#include <array>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>

#include "hal/notes.hpp"

namespace holdfast::drivers {

// The folder may come later, or never.
class FolderNotes final : public hal::Notes {
 public:
  explicit FolderNotes(const std::filesystem::path& folder);

 private:
  [[nodiscard]] std::string_view do_read(Of of, std::span<char, kMostBytes> room) override;

  std::array<std::string, kNames.size()> paths_;  // made up once: reading takes no memory
};

}  // namespace holdfast::drivers
