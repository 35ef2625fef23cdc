// SPDX-License-Identifier: Apache-2.0
#include "drivers/common/folder_notes.hpp"

#include <sys/stat.h>

#include <array>
#include <filesystem>
#include <fstream>
#include <string>

#include "tests/support/temp_dir.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

using namespace holdfast;
using hal::Notes;

TEST_GROUP(FolderNotes) {
  test::TempDir dir;
  std::filesystem::path folder = dir.path() / "notes";
  drivers::FolderNotes notes{folder};
  std::array<char, Notes::kMostBytes> room{};

  void leave(const char* name, const std::string& text) {
    std::filesystem::create_directories(folder);
    std::ofstream(folder / name, std::ios::binary) << text;
  }
  std::string read(Notes::Of of) {
    return std::string(notes.read(of, room));
  }
};

TEST(FolderNotes, TellsTheFirstLineAsItIsNow) {
  STRCMP_EQUAL("", read(Notes::Of::kRelease).c_str());  // no folder yet
  leave("release", "2 (0.1.1)\nand more\n");
  leave("slot", "B, kept");
  STRCMP_EQUAL("2 (0.1.1)", read(Notes::Of::kRelease).c_str());
  STRCMP_EQUAL("B, kept", read(Notes::Of::kSlot).c_str());
  STRCMP_EQUAL("", read(Notes::Of::kUpdate).c_str());
  leave("slot", "A\n");
  STRCMP_EQUAL("A", read(Notes::Of::kSlot).c_str());
  leave("slot", "");
  STRCMP_EQUAL("", read(Notes::Of::kSlot).c_str());
}

TEST(FolderNotes, CutsALongLine) {
  leave("update", std::string(5000, 'x') + "\n");
  STRCMP_EQUAL(std::string(Notes::kMostBytes, 'x').c_str(), read(Notes::Of::kUpdate).c_str());
}

TEST(FolderNotes, GoesNeitherThroughALinkNorWaitsForAWriter) {
  leave("elsewhere", "secret\n");
  std::filesystem::create_symlink(folder / "elsewhere", folder / "release");
  STRCMP_EQUAL("", read(Notes::Of::kRelease).c_str());
  LONGS_EQUAL(0, ::mkfifo((folder / "slot").c_str(), 0600));
  STRCMP_EQUAL("", read(Notes::Of::kSlot).c_str());
  std::filesystem::create_directory(folder / "update");
  STRCMP_EQUAL("", read(Notes::Of::kUpdate).c_str());
}
