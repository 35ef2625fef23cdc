// SPDX-License-Identifier: Apache-2.0
// The kept reference: two slots in memory that anything may have happened to.
#include "store/checkpoint.hpp"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "drivers/sim/keep.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;

namespace {

// Of whose reads one fails, or gives another byte than before.
class Fickle final : public hal::Keep {
 public:
  explicit Fickle(sim::Keep& whole) : whole_(whole) {}
  int reads = 0;
  int fails = -1;
  int changes = -1;

 private:
  [[nodiscard]] std::size_t do_size() const override { return whole_.size(); }
  [[nodiscard]] bool do_read(std::size_t at, std::span<std::uint8_t> bytes) override {
    const int now = reads++;
    if (now == fails || !whole_.read(at, bytes)) return false;
    if (now == changes) bytes[bytes.size() / 2] ^= 1;
    return true;
  }
  [[nodiscard]] bool do_write(std::size_t, std::span<const std::uint8_t>) override { return false; }

  sim::Keep& whole_;
};

}  // namespace

TEST_GROUP(Checkpoint) {
  sim::Keep keep{checkpoint::kBytes};
  std::span<std::uint8_t> memory = keep.bytes();
  std::unique_ptr<checkpoint::State> writer = std::make_unique<checkpoint::State>();
  std::unique_ptr<checkpoint::State> reader = std::make_unique<checkpoint::State>();

  void teardown() override {
    writer.reset();
    reader.reset();
    keep = sim::Keep(0);
  }

  void fill(int number) {
    checkpoint::Contents& contents = writer->slot.contents;
    contents.sensor = checkpoint::identity_of("28D1-D7C6");
    contents.width = 410;
    contents.height = 308;
    contents.pitch_um = 2020;
    contents.pitch = PixelsQ8::from_raw(36 << 8);
    contents.rest.grid = contents.first.grid = {7, 9};
    for (std::size_t i = 0; i < 63; ++i) {
      contents.rest.markers[i] = {PixelsQ8::from_raw(static_cast<std::int32_t>(i) * 256 + number),
                                  PixelsQ8::from_raw(number), true};
    }
    contents.empty.frames = 10;
    contents.empty.samples_q4[5][7] = static_cast<std::uint16_t>(number);
  }
  void save(int number) {
    fill(number);
    CHECK_TRUE(checkpoint::save(*writer, keep));
  }
  // Which save() is found; 0: none.
  int found() {
    return checkpoint::load(*reader, keep) ? reader->slot.contents.rest.markers[0].y.raw() : 0;
  }
};

TEST(Checkpoint, FindsNothingInBlankMemoryAndWithoutMemory) {
  LONGS_EQUAL(0, found());
  LONGS_EQUAL(0, reader->discarded);
  hal::NoKeep none;
  CHECK_FALSE(checkpoint::load(*reader, none));
  fill(1);
  CHECK_FALSE(checkpoint::save(*writer, none));
  checkpoint::forget(*writer, none);
}

// A board that has less than both slots take: not a byte of it is the checkpoint's.
TEST(Checkpoint, LeavesMemoryThatIsTooSmallAlone) {
  fill(1);
  sim::Keep small(checkpoint::kBytes - 1);
  std::ranges::fill(small.bytes(), std::uint8_t{0xA5});
  CHECK_FALSE(checkpoint::save(*writer, small));
  CHECK_FALSE(checkpoint::load(*reader, small));
  checkpoint::forget(*writer, small);
  CHECK_TRUE(std::ranges::all_of(small.bytes(), [](std::uint8_t byte) { return byte == 0xA5; }));
}

TEST(Checkpoint, GivesBackTheNewestOfMany) {
  for (int k = 1; k <= 9; ++k) {
    save(k);
    LONGS_EQUAL(k, found());
    LONGS_EQUAL(k, reader->slot.contents.empty.samples_q4[5][7]);
    CHECK_TRUE(reader->slot.contents.sensor == checkpoint::identity_of("28D1-D7C6"));
  }
}

// A process killed at any byte of a write leaves the save before, or this one whole.
TEST(Checkpoint, SurvivesAWriteTornAtAnyByte) {
  save(1);
  save(2);
  const std::vector<std::uint8_t> before(memory.begin(), memory.end());
  save(3);
  const std::vector<std::uint8_t> after(memory.begin(), memory.end());
  std::size_t first = 0;
  while (before[first] == after[first]) ++first;
  std::size_t last = before.size();
  while (before[last - 1] == after[last - 1]) --last;
  for (std::size_t cut = 0; cut <= before.size(); cut += cut >= first && cut <= first + 64 ? 1 : 97) {
    std::copy_n(after.begin(), cut, memory.begin());
    std::copy(before.begin() + static_cast<std::ptrdiff_t>(cut), before.end(),
              memory.begin() + static_cast<std::ptrdiff_t>(cut));
    LONGS_EQUAL(cut >= last ? 3 : 2, found());
  }
}

// load() reads both slots, and the newer one again.
TEST(Checkpoint, ASlotThatCannotBeReadIsNone) {
  save(1);
  save(2);
  const auto found_with = [&](int fails, int changes) {
    Fickle fickle(keep);
    fickle.fails = fails;
    fickle.changes = changes;
    return checkpoint::load(*reader, fickle) ? reader->slot.contents.rest.markers[0].y.raw() : 0;
  };
  LONGS_EQUAL(2, found_with(-1, -1));
  LONGS_EQUAL(2, found_with(0, -1));
  LONGS_EQUAL(1, found_with(1, -1));
  LONGS_EQUAL(0, found_with(2, -1));
  LONGS_EQUAL(0, found_with(-1, 2));
}

TEST(Checkpoint, BelievesNoSlotWithAFlippedBit) {
  save(1);
  save(2);
  const std::vector<std::uint8_t> sound(memory.begin(), memory.end());
  for (std::size_t byte = 0; byte < checkpoint::kReferenceBytes; byte += byte < 64 ? 1 : 101) {
    memory[byte] = static_cast<std::uint8_t>(sound[byte] ^ (1U << (byte % 8)));
    const int got = found();
    LONGS_EQUAL(byte < sizeof(checkpoint::Slot) ? 2 : 1, got);
    memory[byte] = sound[byte];
  }
  memory[100] ^= 1;
  memory[sizeof(checkpoint::Slot) + 100] ^= 1;
  LONGS_EQUAL(0, found());
  CHECK_TRUE(reader->discarded >= 2);
}

TEST(Checkpoint, RefusesWhatAnotherBuildMayHaveWritten) {
  const auto spoiled = [&](auto&& spoil) {
    std::ranges::fill(memory, std::uint8_t{0});
    *writer = {};
    save(1);
    checkpoint::Slot slot;
    std::memcpy(&slot, memory.data(), sizeof slot);
    spoil(slot);
    slot.crc = checkpoint::detail::crc_of(slot);
    std::memcpy(memory.data(), &slot, sizeof slot);
    return found();
  };
  LONGS_EQUAL(1, spoiled([](checkpoint::Slot&) {}));
  LONGS_EQUAL(0, spoiled([](checkpoint::Slot& s) { s.version = checkpoint::kVersion + 1; }));
  LONGS_EQUAL(0, spoiled([](checkpoint::Slot& s) { s.bytes -= 8; }));
  LONGS_EQUAL(0, spoiled([](checkpoint::Slot& s) { s.contents.rest.grid = s.contents.first.grid = {0, 9}; }));
  LONGS_EQUAL(1, spoiled([](checkpoint::Slot& s) { s.contents.rest.grid = s.contents.first.grid = {8, 16}; }));
  LONGS_EQUAL(0, spoiled([](checkpoint::Slot& s) { s.contents.rest.grid = {8, 16}; }));
  LONGS_EQUAL(0, spoiled([](checkpoint::Slot& s) { s.contents.rest.grid = s.contents.first.grid = {3, 43}; }));
  LONGS_EQUAL(0, spoiled([](checkpoint::Slot& s) { s.contents.rest.grid = s.contents.first.grid = {16, 16}; }));
  LONGS_EQUAL(0, spoiled([](checkpoint::Slot& s) { s.contents.empty.frames = -1; }));
  LONGS_EQUAL(0, spoiled([](checkpoint::Slot& s) { s.contents.empty.frames = 64 + 1; }));
  LONGS_EQUAL(0, spoiled([](checkpoint::Slot& s) { s.contents.empty.noise_relief = -1; }));
  LONGS_EQUAL(1, spoiled([](checkpoint::Slot& s) { s.contents.empty.noise_relief = imprint::kMostRelief; }));
  LONGS_EQUAL(0, spoiled([](checkpoint::Slot& s) { s.contents.empty.noise_relief = imprint::kMostRelief + 1; }));
  for (std::uint8_t byte = 1; byte <= 2; ++byte) {
    LONGS_EQUAL(byte == 1 ? 1 : 0, spoiled([&](checkpoint::Slot& s) {
                  std::memcpy(static_cast<void*>(&s.contents.empty.marked.back()), &byte, 1);
                }));
    LONGS_EQUAL(byte == 1 ? 1 : 0, spoiled([&](checkpoint::Slot& s) {
                  std::memcpy(static_cast<void*>(&s.contents.empty.learned[3]), &byte, 1);
                }));
    LONGS_EQUAL(byte == 1 ? 1 : 0, spoiled([&](checkpoint::Slot& s) {
                  std::memcpy(static_cast<void*>(&s.contents.rest.markers[3].valid), &byte, 1);
                }));
  }
  LONGS_EQUAL(1, spoiled([](checkpoint::Slot& s) { s.contents.empty.samples_q4.back().back() = 65280; }));
  LONGS_EQUAL(0, spoiled([](checkpoint::Slot& s) { s.contents.empty.samples_q4.back().back() = 65281; }));
  LONGS_EQUAL(0, spoiled([](checkpoint::Slot& s) {
                const std::int32_t far = PixelsQ8::kMax + 1;
                static_assert(sizeof far == sizeof s.contents.rest.markers[3].x);
                std::memcpy(static_cast<void*>(&s.contents.rest.markers[3].x), &far, sizeof far);
              }));
  LONGS_EQUAL(0, spoiled([](checkpoint::Slot& s) {
                const std::int32_t far = PixelsQ8::kMax + 1;
                std::memcpy(static_cast<void*>(&s.contents.first.markers[3].x), &far, sizeof far);
              }));
  LONGS_EQUAL(0, spoiled([](checkpoint::Slot& s) { s.contents.pitch = {}; }));
  LONGS_EQUAL(0, spoiled([](checkpoint::Slot& s) { s.contents.rest.grid = s.contents.first.grid = {7, 0}; }));
  LONGS_EQUAL(0, spoiled([](checkpoint::Slot& s) {
                const std::int32_t far = PixelsQ8::kMin - 1;
                std::memcpy(static_cast<void*>(&s.contents.rest.markers[127].y), &far, sizeof far);
              }));
  LONGS_EQUAL(0, spoiled([](checkpoint::Slot& s) {
                const std::int32_t wide = PixelsQ8::kMax + 1;
                std::memcpy(static_cast<void*>(&s.contents.pitch), &wide, sizeof wide);
              }));
}

// The file system is full at any byte of a write: the save before is found, also after another try, which goes over the
// same slot; and once there is room again, the newest.
TEST(Checkpoint, SurvivesAWriteThatIsRefusedAtAnyByte) {
  for (const std::size_t room : {std::size_t{0}, std::size_t{20}, std::size_t{400}, std::size_t{1000}}) {
    keep = sim::Keep(checkpoint::kBytes);
    memory = keep.bytes();
    *writer = {};
    save(1);
    save(2);
    for (const int number : {3, 4}) {
      keep.set_room(room);
      fill(number);
      CHECK_FALSE(checkpoint::save(*writer, keep));
      LONGS_EQUAL(2, found());
    }
    keep.set_room(SIZE_MAX);
    save(5);
    LONGS_EQUAL(5, found());
  }
}

TEST(Checkpoint, IsGoneAfterForget) {
  save(1);
  save(2);
  checkpoint::forget(*writer, keep);
  LONGS_EQUAL(0, found());
  LONGS_EQUAL(0, reader->discarded);
  save(3);
  LONGS_EQUAL(3, found());
}

// The grip lies beside the reference: neither write touches the other, and TARE forgets the reference alone.
TEST(Checkpoint, KeepsTheGripBesideTheReference) {
  checkpoint::GripState grip;
  save(1);
  for (std::uint8_t force = 1; force < 10; ++force) {
    grip.slot.contents = {1, force};
    CHECK_TRUE(checkpoint::save(grip, keep));
  }
  checkpoint::GripState other;
  CHECK_TRUE(checkpoint::load(other, keep));
  LONGS_EQUAL(9, other.slot.contents.force);
  for (const std::uint8_t doing : std::initializer_list<std::uint8_t>{
           3, 0, 3}) {  // what is none of the three is not believed, the one before it is
    grip.slot.contents = {doing, 9};
    CHECK_TRUE(checkpoint::save(grip, keep) && checkpoint::load(other, keep));
    CHECK_TRUE(other.slot.contents.doing <= 2);
  }
  LONGS_EQUAL(1, found());
  checkpoint::forget(*writer, keep);
  LONGS_EQUAL(0, found());
  CHECK_TRUE(checkpoint::load(other, keep));
  memory[checkpoint::kBytes - 1] ^= 0xFF;
  memory[checkpoint::kReferenceBytes + 8] ^= 0xFF;
  (void)checkpoint::load(other, keep);
  CHECK_TRUE(other.slot.contents.doing <= 2 || other.discarded > 0);
  // Another build's grip is none, and nothing of it stays for the next one to be compared with.
  for (std::size_t at = checkpoint::kReferenceBytes; at < checkpoint::kBytes; at += sizeof(checkpoint::GripSlot)) {
    checkpoint::GripSlot slot;
    slot.magic = checkpoint::kMagic;
    slot.version = checkpoint::kVersion + 1;
    slot.bytes = sizeof slot;
    slot.sequence = 5;
    slot.contents = {checkpoint::Grip::kHolds, 20};
    slot.crc = checkpoint::detail::crc_of(slot);
    std::memcpy(&memory[at], &slot, sizeof slot);
  }
  CHECK_FALSE(checkpoint::load(other, keep));
  CHECK_TRUE(other.slot.contents == checkpoint::Grip{});
}

TEST(Checkpoint, CutsIdentitiesThatAreTooLong) {
  const std::string longer(74, 'x');
  CHECK_TRUE(checkpoint::identity_of(longer) == checkpoint::identity_of(longer.substr(0, 64)));
  CHECK_FALSE(checkpoint::identity_of("a") == checkpoint::identity_of("b"));
}
