// SPDX-License-Identifier: Apache-2.0
// The file that outlives the process: full, cut under the process, and not there.
#include "drivers/common/file_keep.hpp"

#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <vector>

#include "tests/support/power_disk.hpp"
#include "tests/support/temp_dir.hpp"

#include <CppUTest/TestHarness.h>

#include "tests/support/allocations.hpp"

using namespace holdfast;
using drivers::FileKeep;
using Bytes = std::vector<std::uint8_t>;

namespace {

constexpr std::size_t kSize = 40'000;  // as large as a checkpoint: no single page

Bytes read_of(hal::Keep& keep, std::size_t at, std::size_t count) {
  Bytes bytes(count, 0xEE);
  CHECK_TRUE(keep.read(at, bytes));
  return bytes;
}

}  // namespace

TEST_GROUP(FileKeep) {
  test::TempDir dir;
  std::filesystem::path path = dir.path() / "keep";
};

TEST(FileKeep, IsReadByTheNextOne) {
  const Bytes record(20'000, 7);
  {
    FileKeep keep(path, kSize);
    LONGS_EQUAL(0, keep.error());
    LONGS_EQUAL(kSize, keep.size());
    CHECK_TRUE(read_of(keep, 0, kSize) == Bytes(kSize, 0));
    const unsigned allocations = test::allocations();
    CHECK_TRUE(keep.write(100, record));
    LONGS_EQUAL(allocations, test::allocations());
    CHECK_FALSE(keep.write(kSize - 1, record));
    CHECK_FALSE(keep.write(kSize + 1, {}));
  }
  FileKeep next(path, kSize);
  CHECK_TRUE(read_of(next, 100, record.size()) == record);
  std::array<std::uint8_t, 2> two{};
  CHECK_FALSE(next.read(kSize - 1, two));
}

// Every byte has a place from the start on: a file system that fills up later refuses nothing.
TEST(FileKeep, HasAPlaceForEveryByte) {
  { const FileKeep keep(path, kSize); }
  LONGS_EQUAL(kSize, std::filesystem::file_size(path));
  std::filesystem::resize_file(path, 0);
  std::filesystem::resize_file(path, kSize);  // as an earlier release left it: no byte has one
  { const FileKeep keep(path, kSize); }
  struct stat about {};
  LONGS_EQUAL(0, ::stat(path.c_str(), &about));
  CHECK_TRUE(static_cast<std::size_t>(about.st_blocks) * 512 >= kSize);
}

// Whoever may write the file may cut it while the process runs.
TEST(FileKeep, ACutFileIsZerosAndIsWrittenAnew) {
  FileKeep keep(path, kSize);
  const Bytes record(20'000, 7);
  CHECK_TRUE(keep.write(0, record));
  for (const std::size_t left : {std::size_t{0}, std::size_t{5000}}) {
    std::filesystem::resize_file(path, left);
    Bytes expected(record);
    std::fill(expected.begin() + static_cast<std::ptrdiff_t>(left), expected.end(), std::uint8_t{0});
    CHECK_TRUE(read_of(keep, 0, record.size()) == expected);
    CHECK_TRUE(keep.write(0, record));
    CHECK_TRUE(read_of(keep, 0, record.size()) == record);
  }
  std::filesystem::remove(path);
  CHECK_TRUE(keep.write(0, record));
  LONGS_EQUAL(0, keep.error());
}

// Full from the start on, and full when it is written: refused with the system's reason, and tried again.
TEST(FileKeep, AFullFileSystemRefusesAndTakesAgain) {
  const Bytes record(20'000, 7), other(20'000, 8);
  test::PowerDisk disk;
  disk.error = ENOSPC;
  disk.fails_at = 2;
  FileKeep keep(path, kSize, disk);
  LONGS_EQUAL(ENOSPC, keep.error());
  LONGS_EQUAL(kSize, keep.size());
  disk.fails_at = disk.calls + 1;  // still full
  CHECK_FALSE(keep.write(0, record));
  LONGS_EQUAL(ENOSPC, keep.error());
  CHECK_TRUE(keep.write(0, record));
  LONGS_EQUAL(0, keep.error());
  disk.fails_at = disk.calls + 1;
  disk.partly = 300;
  CHECK_FALSE(keep.write(20'000, other));
  LONGS_EQUAL(ENOSPC, keep.error());
  CHECK_TRUE(read_of(keep, 0, record.size()) == record);
  CHECK_TRUE(keep.write(20'000, other));
  LONGS_EQUAL(0, keep.error());
  CHECK_TRUE(read_of(keep, 20'000, other.size()) == other);
  disk.most_at_once = 4096;
  CHECK_TRUE(keep.write(0, other));
  CHECK_TRUE(read_of(keep, 0, other.size()) == other);
  disk.most_at_once = 1;
  CHECK_TRUE(keep.write(0, Bytes(10, 9)));
  CHECK_TRUE(read_of(keep, 0, 10) == Bytes(10, 9));
  disk.fails_at = disk.calls + 1;
  disk.error = EIO;
  Bytes room(10);
  CHECK_FALSE(keep.read(0, room));
}

TEST(FileKeep, LeavesAFileOfSomebodyElsesAsItIs) {
  const Bytes magic{'H', 'D', 'K', 'F'};
  for (const std::string& others : {std::string("RIFF of a video"), std::string(100'000, 'x')}) {
    test::write_file(path, others);
    FileKeep keep(path, kSize, drivers::system_calls(), magic);
    LONGS_EQUAL(EEXIST, keep.error());
    CHECK_FALSE(keep.write(0, magic));
    LONGS_EQUAL(EEXIST, keep.error());
    STRCMP_EQUAL(others.c_str(), test::read_file(path).c_str());
  }
  for (const std::string& ours : {std::string(), std::string(9, '\0'), std::string("HDKF"), std::string(kSize, 'x')}) {
    test::write_file(path, ours);
    FileKeep keep(path, kSize, drivers::system_calls(), magic);
    LONGS_EQUAL(0, keep.error());
    CHECK_TRUE(keep.write(0, magic));
  }
}

TEST(FileKeep, WithoutAFileThereIsNone) {
  FileKeep folder(dir.path(), kSize);
  LONGS_EQUAL(EISDIR, folder.error());
  LONGS_EQUAL(0, folder.size());
  FileKeep nowhere(dir.path() / "none" / "keep", kSize);
  LONGS_EQUAL(ENOENT, nowhere.error());
  CHECK_FALSE(nowhere.write(0, Bytes(1)));
  Bytes room(1);
  CHECK_FALSE(nowhere.read(0, room));
}
