// SPDX-License-Identifier: Apache-2.0
#include "drivers/common/empty_mark.hpp"

#include <chrono>
#include <filesystem>
#include <fstream>

#include "tests/support/temp_dir.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

using namespace holdfast;
using drivers::EmptyMark;
using namespace std::chrono_literals;

TEST_GROUP(EmptyMark) {
  test::TempDir dir;
  std::filesystem::path file = dir.path() / "empty";

  void leave_old() {
    std::ofstream(file) << "";
    std::filesystem::last_write_time(file, std::filesystem::file_time_type::clock::now() - 1h);
  }
  [[nodiscard]] bool there() const {
    return std::filesystem::exists(file);
  }
  [[nodiscard]] bool old() const {
    return std::filesystem::last_write_time(file) < std::filesystem::file_time_type::clock::now() - 30min;
  }
};

TEST(EmptyMark, IsThereOnlyWhileTheGelIsEmpty) {
  EmptyMark mark(file);
  CHECK(!there());
  mark.tell(false, 1);
  CHECK(!there());
  mark.tell(true, 2);
  CHECK(there());
  mark.tell(false, 2);
  CHECK(!there());
  mark.tell(true, 2);  // at once, whatever the frames count
  CHECK(there());
}

TEST(EmptyMark, DoesNotInheritTheOneOfAProcessBefore) {
  leave_old();
  const EmptyMark mark(file);
  CHECK(!there());
}

// An option that was given a wrong path must not cost what is there.
TEST(EmptyMark, LeavesAnotherFileAsItIs) {
  std::ofstream(file) << "precious";
  EmptyMark mark(file);
  STRCMP_CONTAINS("is another file, and stays as it is", mark.problem().c_str());
  STRCMP_CONTAINS("Next: ", mark.problem().c_str());
  mark.tell(true, 1);
  mark.tell(false, 2);
  LONGS_EQUAL(8, std::filesystem::file_size(file));

  std::filesystem::remove(file);
  std::filesystem::create_symlink(dir.path() / "elsewhere", file);
  EmptyMark linked(file);
  CHECK(!linked.problem().empty());
  linked.tell(true, 1);
  linked.tell(false, 2);
  CHECK(std::filesystem::is_symlink(file));
  CHECK(!std::filesystem::exists(dir.path() / "elsewhere"));
}

TEST(EmptyMark, LeavesAFileThatCameMeanwhile) {
  EmptyMark mark(file);
  CHECK(mark.problem().empty());
  std::ofstream(file) << "precious";
  mark.tell(true, 1);
  mark.tell(false, 2);
  LONGS_EQUAL(8, std::filesystem::file_size(file));
}

TEST(EmptyMark, StaysYoungByFramesAlone) {
  EmptyMark mark(file);
  mark.tell(true, 100);
  leave_old();
  for (int k = 0; k < 1000; ++k) mark.tell(true, 100);  // no frame comes: it grows old
  CHECK(old());
  mark.tell(true, 100 + EmptyMark::kEvery - 1);
  CHECK(old());
  mark.tell(true, 100 + EmptyMark::kEvery);
  CHECK(!old());
}

TEST(EmptyMark, CountsOnAfterAFault) {
  EmptyMark mark(file);
  mark.tell(true, 5000);
  leave_old();
  mark.tell(true, 0);  // App::ok_frames() begins anew; the next frame is no 5000 frames away
  CHECK(!old());
}

TEST(EmptyMark, IsMadeAgainWhenSomebodyRemovedIt) {
  EmptyMark mark(file);
  mark.tell(true, 1);
  std::filesystem::remove(file);
  mark.tell(true, 1 + EmptyMark::kEvery);
  CHECK(there());
}

TEST(EmptyMark, WritesThroughNoLink) {
  EmptyMark mark(file);
  const auto elsewhere = dir.path() / "elsewhere";
  std::filesystem::create_symlink(elsewhere, file);
  mark.tell(true, 1);
  CHECK(!std::filesystem::exists(elsewhere));
}

TEST(EmptyMark, WithoutAPathThereIsNone) {
  EmptyMark mark({});
  mark.tell(true, 1);
  mark.tell(false, 2);
  LONGS_EQUAL(0, std::distance(std::filesystem::directory_iterator(dir.path()), {}));
}
