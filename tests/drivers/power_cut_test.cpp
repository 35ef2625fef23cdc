// SPDX-License-Identifier: Apache-2.0
// The power is cut behind every system call of a store's file, and what was under way is torn in every way: what is
// read afterwards is the record before or the one after, whole; and never nothing, once one was stored.
#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "drivers/common/file_store.hpp"
#include "drivers/common/slot_file.hpp"
#include "slip/model_file.hpp"
#include "store/settings.hpp"
#include "store/slot_store.hpp"
#include "tests/support/power_disk.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;
using drivers::SlotFile;
using test::PowerDisk;
using Bytes = std::vector<std::uint8_t>;

namespace {

bool anything(std::span<const std::uint8_t> /*payload*/) {
  return true;
}

// The file without its thread: a store whose writes are over at once.
class Direct final : public hal::Store {
 public:
  Direct(PowerDisk& disk, std::size_t slot_bytes) : file_("folder/file", slot_bytes, disk) {}
  [[nodiscard]] const SlotFile& file() const { return file_; }

 private:
  [[nodiscard]] std::size_t do_slot_bytes() const override { return file_.error().empty() ? file_.slot_bytes() : 0; }
  [[nodiscard]] std::span<const std::uint8_t> do_found(std::size_t slot) const override { return file_.found(slot); }
  [[nodiscard]] bool do_readable(std::size_t slot) const override { return file_.readable(slot); }
  void do_begin(std::size_t slot, std::span<const std::uint8_t> bytes, bool both) override {
    error_ = file_.write(slot, bytes);
    if (error_ == 0 && both) error_ = file_.write(1 - slot, bytes);
    asked_ = true;
  }
  [[nodiscard]] State do_state() const override {
    return !asked_ ? State::kIdle : error_ == 0 ? State::kDone : State::kFailed;
  }
  [[nodiscard]] int do_error() const override { return error_; }

  SlotFile file_;
  bool asked_ = false;
  int error_ = 0;
};

struct What {
  sealed::Kind kind;
  std::size_t slot_bytes;
};
constexpr What kSettings{sealed::Kind::kSettings, settings::kMostBytes};
constexpr What kModel{sealed::Kind::kModel, model_file::kBytes + sealed::kAround};

// A process that uses the disk.
struct Process {
  Process(PowerDisk& disk, const What& what)
      : kind(what.kind), store(disk, what.slot_bytes), slots(what.kind, anything, &store, nullptr) {}
  // What a start would say of its settings.
  [[nodiscard]] settings::Found found() const {
    Params ignored;
    return settings::take(slots, ignored);
  }
  [[nodiscard]] Bytes read() const { return {slots.payload().begin(), slots.payload().end()}; }
  // Whether it said that the bytes are durable.
  bool save(const Bytes& payload) { return save(slots.next_sequence(), payload); }
  bool save(std::uint32_t sequence, const Bytes& payload) {
    Bytes record(payload.size() + sealed::kAround);
    (void)sealed::write(kind, sequence, payload, record);
    return slots.put(record, anything) == SlotStore::Put::kBegun && slots.settle() == hal::Store::State::kDone;
  }
  sealed::Kind kind;
  Direct store;
  SlotStore slots;
};

Bytes settings_with(std::int32_t hold_ms, bool many) {
  Params params;
  if (many) {
    for (const ParamInfo& row : kParams) params.*row.member = row.min;
    params.degraded_markers_pct = 50;
  }
  params.hold_ms = hold_ms;
  Bytes payload(settings::kMostPayload);
  payload.resize(settings::write(params, payload));
  return payload;
}

// As long as a model, and different in every sector.
Bytes model_with(std::uint8_t seed) {
  Bytes payload(model_file::kBytes);
  for (std::size_t k = 0; k < payload.size(); ++k) payload[k] = static_cast<std::uint8_t>(seed + k * 13 + k / 512);
  return payload;
}

}  // namespace

TEST_GROUP(PowerCut) {
  std::vector<Bytes> allowed;  // that a start may find; empty bytes: nothing was stored
  long images = 0, lost = 0, mixed = 0, silent = 0, reported = 0;

  void teardown() override {
    LONGS_EQUAL(0, lost);
    LONGS_EQUAL(0, mixed);
    LONGS_EQUAL(0, silent);
  }

  // Only counts: it is called from within system calls, some of them a destructor's.
  void check(const PowerDisk& disk, const What& what) {
    disk.for_each_image([&](const PowerDisk::Image& image) {
      ++images;
      PowerDisk after(image);
      const Process next(after, what);
      const Bytes read = next.read();
      if (std::find(allowed.begin(), allowed.end(), read) == allowed.end()) ++(read.empty() ? lost : mixed);
      if (what.kind != sealed::Kind::kSettings) return;
      // A slot that is not whole is reported, and what was stored once never passes for a first start.
      const settings::Found found = next.found();
      if (settings::lost(found)) ++reported;
      if (found == settings::Found::kFirst && std::find(allowed.begin(), allowed.end(), Bytes{}) == allowed.end()) {
        ++silent;
      }
      const bool damaged = next.slots.slot(0).damaged() || next.slots.slot(1).damaged();
      if (damaged != settings::lost(found)) ++silent;
    });
  }
  void print(const char* what) {
    std::string line = "\n  ";
    UT_PRINT((line += std::to_string(images) + " crash images, " + what).c_str());
  }
  // From an empty disk on: all of them are saved one after the other, by one process or by one each.
  void save_all(const What& what, const std::vector<Bytes>& payloads, bool restart, std::size_t most_at_once) {
    PowerDisk disk;
    allowed = {{}};
    save_all(disk, what, payloads, restart, most_at_once);
  }
  // On from what is `allowed`.
  void save_all(PowerDisk & disk, const What& what, const std::vector<Bytes>& payloads, bool restart,
                std::size_t most_at_once) {
    disk.boundary = [&] { check(disk, what); };
    auto process = std::make_unique<Process>(disk, what);
    STRCMP_EQUAL("", process->store.file().error().c_str());
    disk.most_at_once = most_at_once;
    for (const Bytes& payload : payloads) {
      if (restart) {
        process.reset();
        process = std::make_unique<Process>(disk, what);
        CHECK(process->read() == allowed.back());
      }
      allowed.push_back(payload);
      CHECK(process->save(payload));
      allowed = {payload};
      check(disk, what);
    }
    disk.boundary = {};
  }
};

TEST(PowerCut, LeavesOldOrNewSettings) {
  std::vector<Bytes> payloads;
  for (int k = 1; k <= 8; ++k) payloads.push_back(settings_with(1000 + k, k % 3 == 0));
  for (const bool restart : {false, true}) {
    save_all(kSettings, payloads, restart, 0);
    save_all(kSettings, payloads, restart, 100);  // in several writes
  }
  CHECK(images >= 1000);
  CHECK(reported >= 1000);
  print("settings");
}

// Behind the last number, which is followed by 1.
TEST(PowerCut, LeavesOldOrNewSettingsBehindTheLastNumber) {
  std::vector<Bytes> payloads;
  for (int k = 1; k <= 4; ++k) payloads.push_back(settings_with(1000 + k, k % 3 == 0));
  for (const std::uint32_t first : {0xFFFFFFFEU, 0xFFFFFFFFU}) {
    PowerDisk disk;
    const Bytes before = settings_with(1000, true);
    {
      Process process(disk, kSettings);
      CHECK(process.save(first, before));
    }
    allowed = {before};
    save_all(disk, kSettings, payloads, true, 0);
    LONGS_EQUAL(first == 0xFFFFFFFEU ? 3 : 4, Process(disk, kSettings).slots.sequence());
  }
  CHECK(images >= 1000);
  print("settings behind the last number");
}

// Both slots damaged, as no cut leaves them: what is saved then goes into both, one after the other, so that until it
// has said so a start says that something is wrong, and afterwards none does.
TEST(PowerCut, FindsNothingOrTheNewSettingsBehindALoss) {
  const Bytes saved = settings_with(1, true);
  PowerDisk::Image image{true, Bytes(2 * SlotFile::kApart)};
  for (const std::size_t slot : {std::size_t{0}, std::size_t{1}}) image.bytes[slot * SlotFile::kApart + 7] = 0x55;
  PowerDisk disk(image);
  Process process(disk, kSettings);
  CHECK(process.found() == settings::Found::kLost);
  allowed = {{}, saved};
  long quiet = 0;
  disk.boundary = [&] {
    check(disk, kSettings);
    disk.for_each_image([&](const PowerDisk::Image& after) {
      PowerDisk other(after);
      const Process next(other, kSettings);
      if (!settings::lost(next.found()) && next.read() != saved) ++quiet;
    });
  };
  CHECK(process.save(saved));
  disk.boundary = {};
  LONGS_EQUAL(0, quiet);
  allowed = {saved};
  check(disk, kSettings);
  CHECK(Process(disk, kSettings).found() == settings::Found::kWhole);
  CHECK(images >= 10);
}

TEST(PowerCut, LeavesOldOrNewModel) {
  std::vector<Bytes> payloads;
  for (int k = 1; k <= 3; ++k) payloads.push_back(model_with(static_cast<std::uint8_t>(40 * k)));
  save_all(kModel, payloads, true, 0);
  CHECK(images >= 1000);
  print("models");
}

// A process is killed behind each of its calls; the next one goes on with what the page cache shows, which the medium
// need not have yet; and then the power is cut, too.
TEST(PowerCut, AfterAKillLeavesOldOrNewSettings) {
  const Bytes first = settings_with(1, false), second = settings_with(2, true), third = settings_with(3, false);
  std::vector<PowerDisk> killed;
  std::vector<bool> stored;
  PowerDisk disk;
  bool over = false;
  disk.boundary = [&] {
    killed.push_back(disk);
    stored.push_back(over);
  };
  {
    Process process(disk, kSettings);
    CHECK(process.save(first));
    over = true;
    CHECK(process.save(second));
  }
  disk.boundary = {};
  CHECK(killed.size() > 8);
  for (std::size_t k = 0; k < killed.size(); ++k) {
    PowerDisk& left = killed[k];
    allowed = stored[k] ? std::vector<Bytes>{first, second} : std::vector<Bytes>{{}, first};
    left.boundary = [&] { check(left, kSettings); };
    Process next(left, kSettings);
    CHECK(std::find(allowed.begin(), allowed.end(), next.read()) != allowed.end());
    // What it believes now is what stays.
    allowed = {next.read()};
    check(left, kSettings);
    allowed.push_back(third);
    CHECK(next.save(third));
    allowed = {third};
    check(left, kSettings);
    left.boundary = {};
  }
  print("killed and cut");
}

// What a cut left is gone on with: the next save is stored, whatever lies in the slots.
TEST(PowerCut, IsGoneOnFrom) {
  const Bytes first = settings_with(1, false), second = settings_with(2, true), third = settings_with(3, false);
  PowerDisk disk;
  Process process(disk, kSettings);
  CHECK(process.save(first));
  disk.boundary = [&] {
    disk.for_each_image([&](const PowerDisk::Image& image) {
      PowerDisk after(image);
      Process next(after, kSettings);
      after.boundary = [&] {
        allowed = {next.read(), third};
        check(after, kSettings);
      };
      CHECK(next.save(third));
      after.boundary = {};
      allowed = {third};
      check(after, kSettings);
    });
  };
  CHECK(process.save(second));
  disk.boundary = {};
  print("cut twice");
}

// Each call fails in turn, a write after none or some of its bytes: it is told, the old record stays or the new one is
// there whole, and the next try stores.
TEST(PowerCut, AFailedCallLosesNothing) {
  const Bytes first = settings_with(1, false), second = settings_with(2, true), third = settings_with(3, false);
  for (const int error : {EIO, ENOSPC, EROFS}) {
    for (const std::size_t partly : {std::size_t{0}, std::size_t{50}, std::size_t{512}}) {
      for (int k = 1; k <= 2; ++k) {
        PowerDisk disk;
        Process process(disk, kSettings);
        CHECK(process.save(first));
        disk.error = error;
        disk.partly = partly;
        disk.fails_at = disk.calls + k;
        allowed = {first, second};
        disk.boundary = [&] { check(disk, kSettings); };
        CHECK_FALSE(process.save(second));
        LONGS_EQUAL(error, process.slots.error());
        disk.boundary = {};
        allowed = {first, second, third};
        CHECK(process.save(third));
        allowed = {third};
        check(disk, kSettings);
      }
    }
  }
}

// Of a start, too: nothing can be stored then, and what can be read is read.
TEST(PowerCut, AStartThatFailsReadsWhatItCan) {
  const Bytes first = settings_with(1, false);
  PowerDisk disk;
  {
    Process process(disk, kSettings);
    CHECK(process.save(first));
  }
  for (int k = 1; k <= 5; ++k) {  // open, size, fsync, open of the folder, its fsync
    PowerDisk other(disk);
    other.fails_at = k;
    other.error = EROFS;
    Process process(other, kSettings);
    STRCMP_CONTAINS("folder/file: ", process.store.file().error().c_str());
    CHECK(process.read() == first);
    CHECK(process.found() == settings::Found::kWhole);
    CHECK_FALSE(process.save(settings_with(2, false)));
  }
  // A slot that cannot be read may be the one in force: what was stored next, as number 1 again, would have gone over
  // it, or been older than it at the next start.
  for (int k = 7; k <= 8; ++k) {  // the two slots
    PowerDisk other(disk);
    other.fails_at = k;
    Process process(other, kSettings);
    STRCMP_CONTAINS("folder/file: Input/output error; nothing can be stored there",
                    process.store.file().error().c_str());
    CHECK_FALSE(process.save(settings_with(2, false)));
    Process next(other, kSettings);
    CHECK(next.read() == first);
    CHECK(next.save(settings_with(2, false)));
  }
  PowerDisk empty;
  empty.fails_at = 1;
  const Process process(empty, kSettings);
  CHECK(process.read().empty());
  // Nobody knows what lies there.
  CHECK(process.found() == settings::Found::kLost);
  for (const int slot : {7, 8}) {  // its bytes, behind the close of the folder
    PowerDisk unread(disk);
    unread.fails_at = slot;
    CHECK(Process(unread, kSettings).found() == settings::Found::kEither);
  }
}
