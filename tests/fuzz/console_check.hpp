// SPDX-License-Identifier: Apache-2.0
// Any bytes at the console of a device that runs, and any bytes where its stored parameters, or its models, are.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/crc32.hpp"
#include "base/little_endian.hpp"
#include "console/console.hpp"
#include "drivers/sim/clock.hpp"
#include "drivers/sim/gpio.hpp"
#include "drivers/sim/hande.hpp"
#include "drivers/sim/keep.hpp"
#include "drivers/sim/serial.hpp"
#include "drivers/sim/store.hpp"
#include "store/models.hpp"
#include "store/settings.hpp"
#include "store/slot_store.hpp"

namespace holdfast::test {

// A camera that never sends anything: the console is what is tried here.
class DarkCamera final : public hal::Camera {
 public:
  explicit DarkCamera(sim::Clock& clock) : clock_(clock) {}

 private:
  [[nodiscard]] bool do_start() override { return true; }
  [[nodiscard]] hal::Capture do_next(hal::Frame& /*frame*/, Micros timeout) override {
    clock_.advance(timeout);
    return hal::Capture::kTimeout;
  }
  void do_release(const hal::Frame& /*frame*/) override {}
  void do_stop() override {}
  sim::Clock& clock_;
};

class NoDecoder final : public JpegDecoder {
 private:
  [[nodiscard]] Status do_decode(std::span<const std::uint8_t> /*bytes*/, DecodeScale /*scale*/,
                                 LumaBuffer& /*out*/) override {
    return {Reason::kJpegDamaged};
  }
};

// One for all inputs: a device is megabytes. What an input leaves behind is what the next one finds, as on a real one.
struct FuzzedDevice {
  static constexpr std::string_view kCode = "sesame";

  sim::Clock clock;
  sim::Gpio gpio{clock};
  sim::Serial link, host{1 << 16};
  sim::HandE hand{clock};
  sim::Keep keep{checkpoint::kBytes};
  sim::Store stored{settings::kMostBytes};
  sim::Store stored_models{models::kMostBytes};
  DarkCamera camera{clock};
  NoDecoder jpeg;
  std::unique_ptr<Daemon> daemon =
      std::make_unique<Daemon>(Devices{camera, gpio, link, clock, jpeg}, Periphery{hand, keep});
  std::unique_ptr<console::Console> console = std::make_unique<console::Console>(
      host, *daemon, clock,
      console::Place{.board = "fuzz", .code = kCode, .settings = &stored, .models = &stored_models});

  FuzzedDevice() {
    (void)daemon->start({});
    console->start({});
  }
  // The most that one turn said.
  std::size_t turn() {
    const std::uint64_t before = host.output().total();
    daemon->poll();
    console->poll();
    return host.output().total() - before;
  }
};

// Empty, or what is wrong. The first byte says whether the device is unlocked and whether somebody reads.
inline std::string check_console_bytes(std::span<const std::uint8_t> bytes) {
  static FuzzedDevice device;
  if (bytes.empty()) return {};
  const unsigned how = bytes[0];
  const auto type = [&](std::string_view text) {
    return device.host.feed({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  };
  device.host.set_full(false);
  (void)type("\x03\rlock\r");
  if ((how & 1) != 0) (void)type("unlock sesame\r");
  for (int k = 0; k < 4; ++k) (void)device.turn();
  const Params before = device.console->params();
  const bool unlocked = device.console->unlocked();
  (void)device.daemon->obey({.command = command_frame::Command::kOpening, .argument = 0});
  device.host.set_full((how & 2) != 0);
  for (std::size_t at = 1; at < bytes.size(); at += 256) {
    (void)device.host.feed(bytes.subspan(at, std::min<std::size_t>(256, bytes.size() - at)));
    for (int k = 0; k < 6; ++k) {
      if (device.turn() > console::Console::kMostOut) return "more said in a turn than is allowed";
    }
  }
  const bool opened =
      std::search(bytes.begin(), bytes.end(), FuzzedDevice::kCode.begin(), FuzzedDevice::kCode.end()) != bytes.end();
  if (!unlocked && !opened && device.console->params() != before) return "a locked console changed a parameter";
  if (!unlocked && !opened && device.daemon->is_opening()) return "a locked console obeyed a command";
  if (!validate(device.console->params()).ok()) return "parameters that contradict each other";
  if (device.console->out().lost() != 0) return "an answer that did not fit";
  // Whatever came: Ctrl-C, and after a third of a second (half a frame may have come before it) it answers.
  device.host.set_full(false);
  (void)type("\x03\r");
  for (int k = 0; k < 70; ++k) (void)device.turn();
  device.host.clear_output();
  (void)type("\x03\rversion json\r");
  for (int k = 0; k < 40; ++k) (void)device.turn();
  const std::vector<std::uint8_t> said = device.host.output_bytes();
  constexpr std::string_view kAnswer = "{\"firmware\":\"holdfastd ";
  if (std::search(said.begin(), said.end(), kAnswer.begin(), kAnswer.end()) == said.end()) {
    return "it answers no more, but: " + std::string(said.begin(), said.end());
  }
  return {};
}

// The first half of the bytes in one slot and the rest in the other. Check sums are put right, where there is a place
// for them: the fuzzer would not find them.
inline void lay_into_slots(std::span<const std::uint8_t> bytes, sim::Store& store) {
  for (std::size_t k = 0; k < hal::Store::kSlots; ++k) {
    const std::span<std::uint8_t> slot = store.slot(k);
    const std::size_t from = k * (bytes.size() / 2);
    const std::size_t count = std::min(k == 0 ? bytes.size() / 2 : bytes.size() - from, slot.size());
    std::copy_n(bytes.begin() + static_cast<std::ptrdiff_t>(from), count, slot.begin());
    const std::size_t size = get_le<std::uint32_t>(slot, sealed::kSizeAt);
    if (size > slot.size() - sealed::kAround) continue;
    const std::size_t crc_at = size + sealed::kAround - 4;
    put_le32(slot.subspan(crc_at), crc32(slot.first(crc_at)));
  }
}

// Any bytes where parameters are stored, the first half in one slot and the rest in the other: what is read is valid,
// what is then stored is read again, and what is not signed is nothing to a device with an owner.
inline std::string check_settings_bytes(std::span<const std::uint8_t> bytes) {
  sim::Store store(settings::kMostBytes);
  lay_into_slots(bytes, store);
  SlotStore slots(sealed::Kind::kSettings, settings::good, &store, nullptr);
  Params read;
  (void)settings::read(slots.payload(), read);
  if (!validate(read).ok()) return "parameters that contradict each other were read";
  const hal::NoOwner owner;
  const SlotStore owned(sealed::Kind::kSettings, settings::good, &store, &owner);
  if (!owned.payload().empty()) return "nobody signed this";
  const auto blank = [&](std::size_t k) { return std::ranges::all_of(store.slot(k), [](auto b) { return b == 0; }); };
  Params none;
  const settings::Found found = settings::take(owned, none);
  if (found != (blank(0) && blank(1) ? settings::Found::kFirst : settings::Found::kLost) || none != Params{}) {
    return "what nobody signed was lost without a word";
  }
  if (slots.next_sequence() == 0) return {};
  std::vector<std::uint8_t> record(settings::kMostBytes);
  const std::size_t size = settings::write(read, std::span(record).subspan(sealed::kPayloadAt));
  record.resize(sealed::write(sealed::Kind::kSettings, slots.next_sequence(),
                              std::span(record).subspan(sealed::kPayloadAt, size), record));
  if (slots.put(record, settings::fits) != SlotStore::Put::kBegun) return "could not be stored";
  Params again;
  const SlotStore reader(sealed::Kind::kSettings, settings::good, &store, nullptr);
  (void)settings::read(reader.payload(), again);
  return again == read ? std::string() : "what was stored is not what is read";
}

// Any bytes where models are stored: what decides then is a tree that was proved to be one, or the compiled-in one;
// what is not signed is nothing to a device with an owner; and the way back is open. `repair`: the models' own check
// sums are put right as well.
inline std::string check_models_bytes(std::span<const std::uint8_t> bytes, bool repair) {
  sim::Store store(models::kMostBytes);
  lay_into_slots(bytes, store);
  for (std::size_t k = 0; repair && k < hal::Store::kSlots; ++k) {
    const std::span<std::uint8_t> slot = store.slot(k);
    const std::span<std::uint8_t> model = slot.subspan(sealed::kPayloadAt, models::kMostPayload);
    if (get_le<std::uint32_t>(slot, sealed::kSizeAt) != model.size()) continue;
    put_le32(model.last(4), crc32(model.first(model.size() - 4)));
    put_le32(slot.last(4), crc32(slot.first(slot.size() - 4)));
  }
  SlotStore slots(sealed::Kind::kModel, models::good, &store, nullptr);
  model::Tree tree;
  if (models::in_force(slots, tree) != nullptr && model_file::check(tree) != model_file::Refusal::kNone) {
    return "decides by what is no tree";
  }
  if (models::in_force(slots, tree) == nullptr && !slots.payload().empty()) return "in force, and does not decide";
  const hal::NoOwner owner;
  if (SlotStore(sealed::Kind::kModel, models::good, &store, &owner).sequence() != 0) return "nobody signed this";
  if (slots.next_sequence() == 0) return {};
  std::array<std::uint8_t, sealed::kAround> none{};
  (void)sealed::write(sealed::Kind::kModel, slots.next_sequence(), {}, none);
  if (slots.put(none, models::good) != SlotStore::Put::kBegun) return "there is no way back";
  const SlotStore next(sealed::Kind::kModel, models::good, &store, nullptr);
  return models::in_force(next, tree) == nullptr ? std::string() : "the way back leads elsewhere";
}

}  // namespace holdfast::test
