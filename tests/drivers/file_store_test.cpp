// SPDX-License-Identifier: Apache-2.0
// The thread and the real system calls of a store; what a power cut does is in power_cut_test.cpp.
#include "drivers/common/file_store.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <memory>
#include <thread>
#include <utility>
#include <vector>

#include "tests/support/power_disk.hpp"
#include "tests/support/temp_dir.hpp"

#include <CppUTest/TestHarness.h>

#include "tests/support/allocations.hpp"

using namespace holdfast;
using drivers::FileStore;
using State = hal::Store::State;
using Bytes = std::vector<std::uint8_t>;
using namespace std::chrono_literals;

namespace {

// A card that takes its time: fdatasync returns when it is let go.
class SlowCalls final : public drivers::FileCalls {
 public:
  std::atomic<bool> held{false};
  std::atomic<int> error{0};
  bool folder_is_zero = false;  // as in a process that was started without a standard input
  int folder_synced = 0;
  void let_go() {
    held = false;
    held.notify_all();
  }

  [[nodiscard]] int open(const char* path, How how) override {
    return how == How::kFolder && folder_is_zero ? 0 : system_.open(path, how);
  }
  void close(int fd) override {
    if (fd != 0) system_.close(fd);
  }
  [[nodiscard]] std::int64_t size(int fd) override { return system_.size(fd); }
  [[nodiscard]] std::int64_t pread(int fd, std::span<std::uint8_t> bytes, std::int64_t at) override {
    return system_.pread(fd, bytes, at);
  }
  [[nodiscard]] std::int64_t pwrite(int fd, std::span<const std::uint8_t> bytes, std::int64_t at) override {
    return system_.pwrite(fd, bytes, at);
  }
  [[nodiscard]] int allocate(int fd, std::int64_t size) override { return system_.allocate(fd, size); }
  [[nodiscard]] int fsync(int fd) override {
    if (fd != 0) return system_.fsync(fd);
    ++folder_synced;
    return 0;
  }
  [[nodiscard]] int fdatasync(int fd) override {
    held.wait(true);
    return error != 0 ? -error : system_.fdatasync(fd);
  }

 private:
  drivers::FileCalls& system_ = drivers::system_calls();
};

}  // namespace

TEST_GROUP(FileStore) {
  test::TempDir dir;
  std::filesystem::path path = dir.path() / "store";

  static State end_of(const FileStore& store) {
    const auto deadline = std::chrono::steady_clock::now() + 60s;
    while (store.state() == State::kBusy && std::chrono::steady_clock::now() < deadline) std::this_thread::yield();
    return store.state();
  }
  static bool begins_with(std::span<const std::uint8_t> slot, const Bytes& bytes) {
    return slot.size() >= bytes.size() && std::equal(bytes.begin(), bytes.end(), slot.begin());
  }
};

TEST(FileStore, IsReadByTheNextOne) {
  const Bytes one(600, 11), two(5000, 22);
  {
    FileStore store(path, 5000);
    STRCMP_EQUAL("", store.trouble().c_str());
    CHECK(store.state() == State::kIdle);
    CHECK(store.begin(0, one));
    CHECK(end_of(store) == State::kDone);
    const unsigned before = test::allocations();
    CHECK(store.begin(1, two));
    CHECK(end_of(store) == State::kDone);
    LONGS_EQUAL(before, test::allocations());
    LONGS_EQUAL(0, store.found(0)[0]);
    CHECK_FALSE(store.begin(2, one));
    CHECK_FALSE(store.begin(0, {}));
    CHECK_FALSE(store.begin(0, Bytes(5001)));
  }
  const FileStore next(path, 5000);
  CHECK(begins_with(next.found(0), one));
  CHECK(begins_with(next.found(1), two));
  LONGS_EQUAL(0, next.found(0)[600]);
  LONGS_EQUAL(2 * 8192, std::filesystem::file_size(path));
  struct stat about {};
  LONGS_EQUAL(0, ::stat(path.c_str(), &about));
  LONGS_EQUAL(0600, about.st_mode & 0777);
}

// What was meant for another option: neither padded nor written. Ours are those that begin as ours do, however short
// they were cut, or with zeros, and those of our size, whatever the card did to them.
TEST(FileStore, LeavesAFileOfSomebodyElsesAsItIs) {
  const Bytes magic{'H', 'D', 'S', 'R'};
  const auto takes = [&](const std::string& bytes) {
    test::write_file(path, bytes);
    FileStore store(path, 600, drivers::system_calls(), magic);
    CHECK_EQUAL(store.trouble().empty(), store.begin(0, magic));
    (void)end_of(store);
    return store.trouble().empty();
  };
  for (const std::string& others :
       {std::string("# robot.toml\n"), std::string("x"), std::string("HDX"), std::string(9000, 'x')}) {
    CHECK_FALSE(takes(others));
    STRCMP_EQUAL(others.c_str(), test::read_file(path).c_str());
  }
  for (const std::string& ours : {std::string(), std::string(1, '\0'), std::string(9000, '\0'), std::string("H"),
                                  std::string("HDS"), std::string("HDSR of old"), std::string(2 * 4096, 'x')}) {
    CHECK_TRUE(takes(ours));
  }
}

// Slots begin at whole pages, also in a file that had another length.
TEST(FileStore, HasWholePagesForEachSlot) {
  for (const auto& [slot, page] : {std::pair{1U, 4096U}, {4095U, 4096U}, {4096U, 4096U}, {4097U, 8192U}}) {
    for (const std::size_t had : {std::size_t{0}, std::size_t{100}}) {
      std::filesystem::remove(path);
      { const FileStore made(path, 1); }
      std::filesystem::resize_file(path, had);
      { const FileStore store(path, slot); }
      LONGS_EQUAL(2 * page, std::filesystem::file_size(path));
    }
  }
}

TEST(FileStore, MakesTheFoldersEntryDurableByAnyNumber) {
  SlowCalls calls;
  calls.folder_is_zero = true;
  const FileStore store(path, 200, calls);
  STRCMP_EQUAL("", store.trouble().c_str());
  LONGS_EQUAL(1, calls.folder_synced);
}

// A call that is not interrupted is made once, whatever an earlier one left in errno.
TEST(FileStore, AsksTheSystemOnce) {
  drivers::FileCalls& calls = drivers::system_calls();
  const int fd = calls.open(path.c_str(), drivers::FileCalls::How::kReadWriteOrMake);
  CHECK(fd >= 0);
  errno = EINTR;
  LONGS_EQUAL(0, calls.size(fd));
  LONGS_EQUAL(0, calls.fsync(fd));
  calls.close(fd);
}

// The caller goes on while the card is at work; an end waits for it.
TEST(FileStore, DoesNotHoldUpItsCaller) {
  SlowCalls calls;
  const Bytes one(100, 1), two(100, 2);
  auto store = std::make_unique<FileStore>(path, 200, calls);
  calls.held = true;
  CHECK(store->begin(0, one));
  CHECK(store->state() == State::kBusy);
  CHECK_FALSE(store->begin(1, two));
  calls.let_go();
  CHECK(end_of(*store) == State::kDone);
  calls.error = ENOSPC;
  CHECK(store->begin(1, two));
  CHECK(end_of(*store) == State::kFailed);
  LONGS_EQUAL(ENOSPC, store->error());
  calls.error = 0;
  calls.held = true;
  CHECK(store->begin(1, two));
  // It cannot end while the card is held, however often the other thread has its turn.
  std::atomic<bool> ended{false};
  std::thread end([&] {
    store.reset();
    ended = true;
  });
  for (int turn = 0; turn < 1000; ++turn) std::this_thread::yield();
  const bool early = ended;
  calls.let_go();
  end.join();
  CHECK_FALSE(early);
  const FileStore next(path, 200);
  CHECK(begins_with(next.found(0), one));
  CHECK(begins_with(next.found(1), two));
}

// Where neither slot holds anything: one after the other, and it is over when both are durable.
TEST(FileStore, WritesBothSlots) {
  SlowCalls calls;
  const Bytes one(600, 11);
  {
    FileStore store(path, 5000, calls);
    CHECK(store.begin(1, one, true));
    CHECK(end_of(store) == State::kDone);
    {
      const FileStore written(path, 5000);
      CHECK(begins_with(written.found(0), one) && begins_with(written.found(1), one));
    }
    calls.error = EIO;
    CHECK(store.begin(0, Bytes(600, 22), true));
    CHECK(end_of(store) == State::kFailed);
  }
  const FileStore next(path, 5000);
  CHECK(next.readable(0) && next.readable(1));
  CHECK_FALSE(next.readable(2));
  CHECK(begins_with(next.found(0), Bytes(600, 22)));  // and the other one was left alone
  CHECK(begins_with(next.found(1), one));
}

TEST(FileStore, SaysWhyItCannotStore) {
  FileStore folder(dir.path(), 200);
  STRCMP_CONTAINS("; nothing can be stored there", folder.trouble().c_str());
  LONGS_EQUAL(0, folder.slot_bytes());
  CHECK_FALSE(folder.begin(0, Bytes(10)));
  const FileStore nowhere(dir.path() / "none" / "store", 200);
  STRCMP_CONTAINS("No such file or directory", nowhere.trouble().c_str());
  LONGS_EQUAL(200, nowhere.found(0).size());
  CHECK_FALSE(nowhere.readable(0));
}
