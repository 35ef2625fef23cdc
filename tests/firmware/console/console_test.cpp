// SPDX-License-Identifier: Apache-2.0
// The console as whoever is at the other end of the port has it.
#include "console/console.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <set>
#include <span>
#include <sstream>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/crc32.hpp"
#include "link/evidence_frame.hpp"
#include "link/load_frame.hpp"
#include "link/marker_frame.hpp"
#include "params/mode_prices.gen.hpp"
#include "store/slot_store.hpp"
#include "tests/fuzz/model_check.hpp"
#include "tests/support/console_desk.hpp"
#include "tests/support/spread_tree.hpp"

#include <CppUTest/TestHarness.h>
// last: CppUTest's headers redefine new
#include "tests/support/allocations.hpp"

using namespace holdfast;
using namespace std::chrono_literals;
using console::Console;
using console::Error;

namespace {

// What the console sends, taken apart as LINK.md says.
struct Heard {
  std::vector<status_frame::StatusFrame> statuses;
  std::vector<evidence_frame::EvidenceFrame> evidences;
  std::vector<load_frame::LoadFrame> loads;
  bool in_pairs = true;  // each evidence came directly behind the status frame of its number, a load behind that
  std::vector<marker_frame::MarkerFrame> displacements, rests;
  std::vector<command_frame::AnswerFrame> answers;
  std::string text;
  int damaged = 0;
};

Heard take_apart(const std::string& bytes) {
  Heard heard;
  link::Receiver receiver;
  int before = -1;  // sequence, where the frame before is a status frame
  for (const char c : bytes) {
    switch (receiver.push(static_cast<std::uint8_t>(c))) {
      case link::Event::kText:
        heard.text.append(receiver.text().begin(), receiver.text().end());
        break;
      case link::Event::kDamaged:
        ++heard.damaged;
        break;
      case link::Event::kFrame:
        if (const auto e = evidence_frame::read(receiver.payload()); e) {
          heard.evidences.push_back(*e);
          heard.in_pairs &= before == e->sequence;
        }
        if (const auto l = load_frame::read(receiver.payload()); l) {
          heard.loads.push_back(*l);
          heard.in_pairs &=
              heard.loads.size() == heard.evidences.size() && heard.evidences.back().sequence == l->sequence;
        }
        before = -1;
        if (const auto status = status_frame::read(receiver.payload()); status.ok()) {
          heard.statuses.push_back(status.frame);
          before = status.frame.sequence;
        }
        if (const auto d = marker_frame::read(link::Kind::kDisplacement, receiver.payload()); d) {
          heard.displacements.push_back(*d);
        }
        if (const auto r = marker_frame::read(link::Kind::kRest, receiver.payload()); r) heard.rests.push_back(*r);
        if (const auto a = command_frame::read_answer(receiver.payload()); a) heard.answers.push_back(*a);
        break;
      case link::Event::kNone:
        break;
    }
  }
  return heard;
}

// One predicate: slip is an entropy above 1 nat.
const std::vector<std::uint8_t> kLoaded =
    test::model_bytes(*find_feature_set("paper"), std::span(test::kSpreadTree.nodes).first(3), "loaded_one");

// As a sender begins it among text.
std::string frame_of(std::uint16_t sequence, command_frame::Command command, std::uint8_t argument) {
  std::array<std::uint8_t, command_frame::kCommandBytes> wire{};
  command_frame::encode(command_frame::CommandFrame{sequence, command, argument}, wire);
  return std::string(1, '\0').append(wire.begin(), wire.end());
}

// Whose signatures begin with 0x5A.
class Owner final : public hal::Verifier {
  [[nodiscard]] bool do_holds(std::span<const std::uint8_t> /*message*/,
                              std::span<const std::uint8_t, kSignatureBytes> signature) const override {
    return signature[0] == 0x5A;
  }
};

// Two texts in a pattern of %s.
std::string fmt_of(const char* pattern, const std::string& a, const std::string& b) {
  return StringFromFormat(pattern, a.c_str(), b.c_str()).asCharString();
}

}  // namespace

TEST_GROUP(Console) {
  test::ConsoleDesk desk;

  void start() {
    desk.start();
    CHECK(desk.started);
    desk.run(1s);
  }
  void start_unlocked() {
    start();
    (void)desk.unlock();
  }
  // The cable is out for a moment.
  void plug_anew() {
    desk.host.hang_up();
    desk.run(10ms);
    desk.host.reconnect();
  }
  // What is heard when this comes while a long answer waits for a reader, who then reads for so long.
  std::string typed_into_an_answer(const std::string& keys, Micros reads) {
    (void)desk.heard();
    desk.host.set_full(true);
    desk.type("log frames json\r");
    desk.run(100ms);
    desk.type(keys);
    desk.run(100ms);
    desk.host.set_full(false);
    desk.run(reads);
    return desk.heard();
  }
  // What the key for the line before brings.
  std::string line_before() {
    (void)desk.heard();
    desk.type("\x1B[A");
    desk.run(50ms);
    return desk.heard();
  }
  void teardown() override {
    desk.end();
  }
  void check_says(const char* line, const char* part) {
    STRCMP_CONTAINS(part, desk.say(line).c_str());
  }
  void check_error(const char* line, Error error) {
    std::string expected = "ERR ";
    expected += std::to_string(static_cast<int>(error));
    expected += " ";
    expected += console::info(error).name;
    const std::string answer = desk.say(line);
    STRCMP_CONTAINS((expected += ": ").c_str(), answer.c_str());
    STRCMP_CONTAINS(". Likely cause: ", answer.c_str());
    STRCMP_CONTAINS(". Next: ", answer.c_str());
  }
  void check_ok(const char* line) {
    STRCMP_CONTAINS("OK\r\n", desk.say(line).c_str());
  }
  static std::vector<std::uint8_t> record(std::uint32_t sequence, const Params& params) {
    std::vector<std::uint8_t> payload(settings::kMostPayload);
    payload.resize(settings::write(params, payload));
    std::vector<std::uint8_t> out(payload.size() + sealed::kAround);
    (void)sealed::write(sealed::Kind::kSettings, sequence, payload, out);
    return out;
  }
  static std::vector<std::uint8_t> model_record(std::uint32_t sequence, const std::vector<std::uint8_t>& payload) {
    std::vector<std::uint8_t> out(payload.size() + sealed::kAround);
    (void)sealed::write(sealed::Kind::kModel, sequence, payload, out);
    return out;
  }
  // Says all of it but the last line, which is returned.
  std::string load_model(std::span<const std::uint8_t> bytes) {
    return load(bytes, "load model");
  }
  std::string load(std::span<const std::uint8_t> bytes, const char* first = "load settings") {
    constexpr std::size_t kPiece = 120;
    check_ok(first);
    for (std::size_t at = 0; at < bytes.size(); at += kPiece) {
      std::string line = "load " + std::to_string(at) + " ";
      for (const std::uint8_t byte : bytes.subspan(at, std::min(kPiece, bytes.size() - at))) {
        line += "0123456789abcdef"[byte >> 4];
        line += "0123456789ABCDEF"[byte & 15];
      }
      check_ok(line.c_str());
    }
    std::array<char, 20> sum{};
    (void)std::snprintf(sum.data(), sum.size(), "load end %08X", crc32(bytes));
    return sum.data();
  }
  static std::vector<std::uint8_t> signed_record(std::uint32_t sequence, const Params& params) {
    std::vector<std::uint8_t> out = record(sequence, params);
    sealed::put_signature(out, std::array<std::uint8_t, sealed::kSignatureBytes>{0x5A});
    return out;
  }
  // As an earlier process left it.
  void lay(std::size_t slot, const std::vector<std::uint8_t>& bytes) {
    std::copy(bytes.begin(), bytes.end(), desk.stored.slot(slot).begin());
  }
  // What a first save leaves.
  void lay_both(const std::vector<std::uint8_t>& bytes) {
    for (const std::size_t slot : {0U, 1U}) lay(slot, bytes);
  }
  void lay_model(std::size_t slot, std::uint32_t sequence, bool as_owner) {
    std::vector<std::uint8_t> bytes = model_record(sequence, kLoaded);
    if (as_owner) sealed::put_signature(bytes, std::array<std::uint8_t, sealed::kSignatureBytes>{0x5A});
    std::copy(bytes.begin(), bytes.end(), desk.stored_models.slot(slot).begin());
  }
  void damage(std::size_t slot) {
    desk.stored.slot(slot)[sealed::kPayloadAt] ^= 1;
  }
  void restart() {
    desk.end();
    start();
  }
  [[nodiscard]] bool grip_ok() const {
    return desk.gpio.level(hal::Line::kGripOk) == hal::Level::kHigh;
  }
  void check_held() {
    CHECK_FALSE(grip_ok());
    const std::string status = desk.say("status json");
    STRCMP_CONTAINS(
        R"("state":"FAULT","reason":"config","what":"settings or the model are lost, damaged or out of range")",
        status.c_str());
    STRCMP_CONTAINS("give `stored` at the console", status.c_str());
  }
  void check_fine() {
    desk.run(400ms);
    check_says("status json", R"("state":"OK","reason":"none")");
    CHECK(grip_ok());
  }
  // What the next start would read.
  Params stored() {
    const SlotStore slots(sealed::Kind::kSettings, settings::good, &desk.stored, desk.place.owner);
    Params params;
    (void)settings::read(slots.payload(), params);
    return params;
  }
};

TEST(Console, TellsOfEveryChangeOfState) {
  start();
  const std::string text = desk.heard();
  STRCMP_CONTAINS("* BOOT none\r\n", text.c_str());
  STRCMP_CONTAINS("* REFERENCE learning\r\n", text.c_str());
  STRCMP_CONTAINS("* OK none\r\n", text.c_str());
  CHECK(text.ends_with("holdfast> \x1B[K"));
}

TEST(Console, SaysWhyItCannotStart) {
  desk.start();
  (void)desk.heard();
  desk.console->cannot_start(Reason::kGpioFailed);
  STRCMP_CONTAINS("* FAULT gpio_failed\r\n", desk.heard().c_str());
}

// Every command, locked and not: it ends, by OK or by an error that is in the table.
TEST(Console, AnswersEveryCommand) {
  start();
  for (const bool unlocked : {false, true}) {
    if (unlocked) STRCMP_CONTAINS("OK\r\n", desk.unlock().c_str());
    for (const console::CommandInfo& command : console::commands()) {
      std::string line(command.name);
      line += " one two three";
      const char* const refusal = command.changes && !unlocked ? "ERR 10 locked" : "ERR 4 arguments";
      if (command.name != "fault" || unlocked) STRCMP_CONTAINS_TEXT(refusal, desk.say(line).c_str(), line.c_str());
      if (command.name == "unlock" || command.name == "reboot" || command.name == "lock") continue;
      line = command.name;
      const std::string answer = desk.say(line);
      const bool locked = answer.find("ERR 10 locked") != std::string::npos;
      CHECK_TEXT(!answer.empty(), line.c_str());
      CHECK_EQUAL_TEXT(command.changes && !unlocked, locked, line.c_str());
    }
  }
  check_error("a b c d e f g h i", Error::kArguments);
  check_error("tasks some", Error::kArguments);
  check_error("model some", Error::kArguments);
  check_error("echo loud", Error::kArguments);
  check_error("trace loud", Error::kArguments);
  check_error("log frames nothing", Error::kArguments);
  check_error("tell arm 1x", Error::kArguments);
  check_error("log frames json markers", Error::kArguments);
}

// Nothing is done by a command that is refused for want of the code.
TEST(Console, ChangesNothingWhileLocked) {
  start();
  for (const char* const line : {"set raise_frames 5", "save", "defaults", "tell tare", "reboot", "reference learn",
                                 "fault camera off", "fault off"}) {
    check_error(line, Error::kLocked);
  }
  LONGS_EQUAL(2, desk.daemon->params().raise_frames);
  CHECK_FALSE(desk.console->asked_to_restart());
  CHECK(desk.daemon->app().state().reference.known);
  CHECK(desk.faults.begun.empty());
  LONGS_EQUAL(0, desk.faults.ended);
}

TEST(Console, MakesWrongCodesWaitLongerAndLonger) {
  start();
  desk.camera->set(sim::CameraSwitch::kOff);  // minutes of pictures would only take time
  Micros waited{};
  for (const Micros wait : {1s, 2s, 4s, 8s, 16s, 32s, 60s, 60s}) {
    check_error("unlock 7QX-41-reD", Error::kWrongCode);
    const Micros since = desk.clock.now();
    check_error("unlock 7QX-41-red", Error::kTooSoon);  // the right one does not help before
    desk.run(wait - (desk.clock.now() - since) - 100ms);
    check_error("unlock 7QX-41-red", Error::kTooSoon);
    desk.run(200ms);
    waited += wait;
  }
  STRCMP_CONTAINS("OK\r\n", desk.unlock().c_str());
  CHECK(desk.console->unlocked());
  check_ok("lock");
  CHECK_FALSE(desk.console->unlocked());
  check_error("unlock nonsense", Error::kWrongCode);  // the count began anew
  desk.run(1100ms);
  for (const char* const code : {"7QX-41-re", "7QX-41-redx", "x"}) {
    check_error((std::string("unlock ") + code).c_str(), Error::kWrongCode);
    desk.run(61s);
  }
  std::string longest("unlock ");
  check_error((longest += std::string(200, 'x')).c_str(), Error::kWrongCode);
  check_error("unlock", Error::kArguments);
}

// Longer than a code may be: it fits nothing, itself included.
TEST(Console, TakesNoCodeThatIsTooLong) {
  const std::string code(65, 'x');
  desk.place.code = code;
  start();
  check_error(("unlock " + code).c_str(), Error::kWrongCode);
}

TEST(Console, HasNothingToUnlockWithoutACode) {
  desk.place.code = {};
  start();
  check_error("unlock anything", Error::kNoCode);
}

TEST(Console, LocksItselfWhenNobodyTypes) {
  start();
  desk.camera->set(sim::CameraSwitch::kOff);
  (void)desk.unlock();
  desk.run(Console::kStaysUnlocked - 1s);
  check_ok("version");
  CHECK(desk.console->unlocked());
  desk.run(Console::kStaysUnlocked - 1s);
  CHECK(desk.console->unlocked());
  desk.run(2s);
  CHECK_FALSE(desk.console->unlocked());
}

TEST(Console, KeepsTheCodeOutOfTheHistory) {
  start();
  check_ok("version");
  (void)desk.unlock();
  const std::string shown = line_before();
  STRCMP_CONTAINS("version", shown.c_str());
  CHECK(shown.find(test::ConsoleDesk::kCode) == std::string::npos);
}

TEST(Console, SetsAndRefusesByTheTable) {
  start_unlocked();
  check_ok("set raise_frames 3");
  check_ok("set hold_ms = 300");
  check_ok("set max_gap_ms=300");
  LONGS_EQUAL(3, desk.console->params().raise_frames);
  LONGS_EQUAL(300, desk.console->params().hold_ms);
  LONGS_EQUAL(300, desk.console->params().max_gap_ms);
  for (const ParamInfo& row : kParams) {
    for (const std::int64_t wrong : {std::int64_t{row.min} - 1, std::int64_t{row.max} + 1}) {
      std::string line = "set " + std::string(row.name) + " " + std::to_string(wrong);
      const std::string answer = desk.say(line);
      STRCMP_CONTAINS("ERR 22 out_of_range: ", answer.c_str());
      STRCMP_CONTAINS(std::string(row.name).c_str(), answer.c_str());
      STRCMP_CONTAINS(std::to_string(wrong).c_str(), answer.c_str());
      std::string range = std::to_string(row.min) + " to ";
      STRCMP_CONTAINS((range += std::to_string(row.max)).c_str(), answer.c_str());
    }
  }
  check_error("set raise_frames three", Error::kNotANumber);
  check_error("set raise_frams 3", Error::kUnknownParameter);
  check_error("set raise_frames", Error::kArguments);
  check_error("set fault_markers_pct 99", Error::kContradiction);
  check_error("defaults nothing", Error::kUnknownParameter);
  check_ok("set fault_markers_pct 50");
  check_ok("set degraded_markers_pct 55");
  check_error("defaults fault_markers_pct", Error::kContradiction);
  check_error("=", Error::kUnknownCommand);
  check_error("get a=b", Error::kUnknownParameter);
  check_ok("defaults raise_frames");
  LONGS_EQUAL(2, desk.console->params().raise_frames);
  LONGS_EQUAL(300, desk.console->params().hold_ms);
  check_ok("defaults");
  CHECK(desk.console->params() == Params{});
}

// What a new value acts on: the next frame, the rest position, or the next start.
TEST(Console, AppliesWhatCanBeAppliedNow) {
  start_unlocked();
  for (const char* const line : {"set pitch_um 2000", "set mode balanced", "set grid_cols 8"}) {
    check_ok(line);
    CHECK_FALSE(desk.daemon->app().state().reference.known);
    check_ok("defaults");
    desk.run(1s);
    CHECK(desk.daemon->app().state().reference.known);
  }
  check_ok("set raise_frames 4");
  CHECK(desk.daemon->app().state().reference.known);
  LONGS_EQUAL(4, desk.daemon->params().raise_frames);
  check_ok("set gripper 1");
  LONGS_EQUAL(0, desk.daemon->params().gripper);
  LONGS_EQUAL(1, desk.console->params().gripper);
}

TEST(Console, StoresForTheNextStart) {
  start_unlocked();
  check_ok("set raise_frames 3");
  check_ok("save");
  check_ok("set hold_ms 500");
  check_ok("save");
  const SlotStore slots(sealed::Kind::kSettings, settings::good, &desk.stored, nullptr);
  Params read;
  CHECK(settings::read(slots.payload(), read) == settings::Loaded::kAll);
  LONGS_EQUAL(3, read.raise_frames);
  LONGS_EQUAL(500, read.hold_ms);
  LONGS_EQUAL(2, slots.sequence());
  check_says("version json", R"("takes":"anything: development mode","settings_sequence":2})");
  check_says("status json", R"("development":true})");
}

// OK comes when the bytes are durable; Ctrl-C ends the waiting and not the writing.
TEST(Console, WaitsForTheCard) {
  start_unlocked();
  check_ok("set hold_ms 500");
  desk.stored.set_slow(true);
  STRCMP_EQUAL("", desk.say("save").c_str());
  LONGS_EQUAL(1, desk.stored.writes());
  desk.stored.finish();
  desk.run(50ms);
  CHECK(desk.heard().starts_with("OK\r\n"));
  STRCMP_EQUAL("", desk.say("save").c_str());
  desk.type("\x03");
  desk.run(50ms);
  STRCMP_CONTAINS("ERR 33 interrupted", desk.heard().c_str());
  check_error("save", Error::kStillWriting);
  LONGS_EQUAL(2, desk.stored.writes());
  desk.stored.finish();
  desk.stored.set_slow(false);
  check_ok("save");
  check_says("version json", "\"settings_sequence\":3}");
}

TEST(Console, SaysWhyNothingWasWritten) {
  start_unlocked();
  check_ok("set hold_ms 500");
  check_ok("save");
  check_ok("set hold_ms 600");
  for (const std::size_t after : {std::size_t{0}, std::size_t{40}}) {
    desk.stored.set_failure(28, after);
    check_error("save", Error::kWriteFailed);
    check_says("save", "ERR 25 write_failed: error 28 of the system: ");
    Params read;
    const SlotStore slots(sealed::Kind::kSettings, settings::good, &desk.stored, nullptr);
    (void)settings::read(slots.payload(), read);
    LONGS_EQUAL(500, read.hold_ms);
  }
  desk.stored.set_failure(0);
  check_ok("save");
}

TEST(Console, HasNoPlaceToStoreWithoutOne) {
  desk.place.settings = nullptr;
  desk.place.models = nullptr;
  start_unlocked();
  check_error("save", Error::kNotStored);
  check_error("model default", Error::kNotStored);
  check_error(load_model(model_record(1, {})).c_str(), Error::kNotStored);
  check_error(load(record(1, {})).c_str(), Error::kNotStored);
  desk.end();
  // Nobody is sent to sign what cannot be stored afterwards.
  const hal::NoOwner owner;
  desk.place.owner = &owner;
  start_unlocked();
  check_error("save", Error::kNotStored);
  check_error("model default", Error::kNotStored);
}

TEST(Console, LoadsARecord) {
  start();
  const Params before = desk.console->params();
  Params params;
  params.hold_ms = 700;
  params.max_force = 200;
  for (const char* const line : {"load settings", "load 0 00", "load end 0", "load off"}) {
    check_error(line, Error::kLocked);
  }
  (void)desk.unlock();
  check_ok(load(record(7, params)).c_str());
  CHECK(stored() == params);
  CHECK(desk.console->params() == before);  // counts at the next start
  check_says("version json", "\"settings_sequence\":7}");
  check_error(load(record(7, params)).c_str(), Error::kTooOld);
  check_says(load(record(6, params)).c_str(), "ERR 29 too_old: the newest one here has number 7: ");
  check_ok("save");
  check_says("version json", "\"settings_sequence\":8}");
}

// Lines that are lost, damaged, twice there or in another order; and what is said without a beginning.
TEST(Console, LoadsAllOrNothing) {
  start_unlocked();
  const std::vector<std::uint8_t> whole = record(7, {});
  const std::string end = load(whole);
  check_ok("load off");
  check_error(end.c_str(), Error::kBroken);
  check_error("load 0 00", Error::kBroken);
  check_ok("load settings");
  check_error("load end 0G", Error::kArguments);
  check_error("load end G", Error::kArguments);
  check_error("load x 00", Error::kArguments);
  check_error("load 0", Error::kArguments);
  check_error("load -1 00", Error::kArguments);
  check_error("load 1x 00", Error::kArguments);
  check_error("load 1 00", Error::kBroken);
  for (const char* const hex : {"0", "000", "0g", "0x", "zz", "0G", ":0", "-1", "0/"}) {
    std::string line = "load 0 ";
    check_error((line += hex).c_str(), Error::kBroken);
  }
  check_ok("load 0 4844");
  check_error("load 0 4844", Error::kBroken);
  check_says("load 3 44", "ERR 34 broken: 2 bytes are here: ");
  check_ok("load 2 5352");
  check_error("load end 12345678", Error::kBroken);
  check_error("load 4 00", Error::kBroken);
  for (std::size_t missing = 1; missing < whole.size(); missing += 9) {
    (void)load(std::span(whole).first(whole.size() - missing));
    check_error(end.c_str(), Error::kBroken);
    check_error(load(std::span(whole).first(whole.size() - missing)).c_str(), Error::kWrongRecord);
  }
  for (std::size_t at = 0; at < whole.size(); ++at) {
    std::vector<std::uint8_t> damaged = whole;
    damaged[at] ^= 1;
    (void)load(damaged);
    check_error(end.c_str(), Error::kBroken);
    const std::string answer = desk.say(load(damaged));
    CHECK(answer.find("ERR 34 broken: ") != std::string::npos ||
          answer.find("ERR 35 wrong_record: ") != std::string::npos);
  }
  // More than any record has: the last lines find no room.
  check_ok("load settings");
  std::string answer;
  for (std::size_t at = 0; at <= console::Loading::kMostBytes; at += 100) {
    answer = desk.say("load " + std::to_string(at) + " " + std::string(200, '0'));
  }
  STRCMP_CONTAINS("ERR 34 broken", answer.c_str());
  // Somebody locks in between.
  (void)load(whole);
  check_ok("lock");
  (void)desk.unlock();
  check_error(end.c_str(), Error::kBroken);
  LONGS_EQUAL(0, desk.stored.writes());
  CHECK(stored() == Params{});
  check_ok(load(whole).c_str());
}

TEST(Console, LoadsOnlyWhatItCanUse) {
  start_unlocked();
  Params contradiction;
  contradiction.fault_markers_pct = 99;
  check_error(load(record(7, contradiction)).c_str(), Error::kNotUsable);
  std::vector<std::uint8_t> unknown(8 + sealed::kAround);
  (void)sealed::write(sealed::Kind::kSettings, 7, std::vector<std::uint8_t>(8), unknown);
  check_error(load(unknown).c_str(), Error::kNotUsable);
  std::vector<std::uint8_t> model(8 + sealed::kAround);
  (void)sealed::write(sealed::Kind::kModel, 7, std::vector<std::uint8_t>(8), model);
  check_error(load(model).c_str(), Error::kWrongRecord);
  LONGS_EQUAL(0, desk.stored.writes());
}

// A model decides from the start after its loading, and says what it is; then the one that is compiled in again.
TEST(Console, LoadsAModel) {
  start();
  const std::string compiled = desk.say("model json");
  STRCMP_CONTAINS(R"("from":"compiled in","sequence":null,"next_start":"the same"})", compiled.c_str());
  check_says("version json", R"("model_from":"compiled in","model_sequence":null,)");
  const std::vector<std::uint8_t> record = model_record(7, kLoaded);
  for (const char* const line : {"load model", "model default"}) check_error(line, Error::kLocked);
  (void)desk.unlock();
  check_says(load_model(record).c_str(), "counts from the next start: reboot\r\nOK\r\n");
  check_says("model json", R"("from":"compiled in","sequence":null,"next_start":"what was stored since: reboot"})");
  check_says(load_model(record).c_str(), "ERR 29 too_old: the newest one here has number 7: ");
  check_error(load_model(model_record(6, kLoaded)).c_str(), Error::kTooOld);
  LONGS_EQUAL(1, desk.stored_models.writes());
  LONGS_EQUAL(0, desk.stored.writes());

  restart();
  check_says("model json",
             R"({"name":"loaded_one","feature_set":"paper","features":4,"nodes":3,"depth":1,"crc32":16909060,)"
             R"("from":"loaded","sequence":7,"next_start":"the same"})");
  check_says("version json",
             R"("model":"loaded_one","model_crc32":16909060,"model_from":"loaded","model_sequence":7,)");
  (void)desk.unlock();
  check_error("model json default", Error::kArguments);
  check_error("model default json", Error::kArguments);
  desk.stored_models.set_slow(true);
  STRCMP_EQUAL("", desk.say("model default").c_str());
  desk.type("\x03");
  desk.run(50ms);
  check_ok("lock");
  (void)desk.unlock();
  check_error("model default", Error::kStillWriting);
  check_error(load_model(model_record(9, kLoaded)).c_str(), Error::kStillWriting);
  check_ok("save");  // settings have a place of their own
  desk.stored_models.finish();
  desk.stored_models.set_slow(false);
  check_says("model default", "counts from the next start: reboot\r\nOK\r\n");
  check_says("model json", R"("from":"loaded","sequence":7,"next_start":"what was stored since: reboot"})");

  restart();
  std::string back = desk.say("model json");
  STRCMP_CONTAINS(R"("from":"compiled in","sequence":9,"next_start":"the same"})", back.c_str());
  CHECK_EQUAL(compiled.substr(0, compiled.find("\"from\"")), back.substr(0, back.find("\"from\"")));
  (void)desk.unlock();
  check_error(load_model(model_record(9, kLoaded)).c_str(), Error::kTooOld);
  check_ok(load_model(model_record(10, kLoaded)).c_str());
}

TEST(Console, SaysWhyAModelWasNotWritten) {
  start_unlocked();
  desk.stored_models.set_failure(28, 4000);
  check_says(load_model(model_record(7, kLoaded)).c_str(), "ERR 25 write_failed: error 28 of the system: ");
  restart();
  // What was torn is damaged, and a start says so.
  check_says("model json", R"("from":"compiled in: what was stored is lost or damaged","sequence":null)");
  check_held();
}

// Each in the words of who looked at it.
TEST(Console, LoadsOnlyModelsOfThisFirmware) {
  start_unlocked();
  std::vector<std::uint8_t> later = kLoaded;
  std::fill_n(later.begin() + 52, 32, std::uint8_t{0});
  test::put_name(later, 52, "later");
  std::vector<std::uint8_t> other = kLoaded;
  other[84] = 'x';
  std::vector<std::uint8_t> node = kLoaded;
  node[1146] = 30;
  std::vector<std::uint8_t> version = kLoaded;
  version[8] = 4;
  const auto refused = [&](const std::vector<std::uint8_t>& payload, model_file::Refusal why) {
    const model_file::RefusalInfo& row = model_file::info(why);
    std::string line = "ERR 37 not_this_model: ";
    line.append(row.what).append(". Likely cause: ").append(row.cause).append(". Next: ").append(row.next);
    check_says(load_model(model_record(7, payload)).c_str(), (line += "\r\n").c_str());
  };
  refused(test::repaired(later), model_file::Refusal::kSetUnknown);
  refused(test::repaired(other), model_file::Refusal::kFeatures);
  refused(test::repaired(node), model_file::Refusal::kNode);
  refused(test::repaired(version), model_file::Refusal::kVersion);
  refused({kLoaded.begin(), kLoaded.end() - 1}, model_file::Refusal::kSize);
  refused({1, 2, 3}, model_file::Refusal::kMagic);
  other[84] ^= 1;
  refused(other, model_file::Refusal::kCrc);
  // The words are that line's alone.
  check_says("set raise_frames x",
             "ERR 21 not_a_number: raise_frames = x (range 1 to 10 frames): the value is no whole");
  // Nor is a model settings, or the other way round.
  check_error(load(model_record(7, kLoaded)).c_str(), Error::kWrongRecord);
  check_error(load_model(record(7, {})).c_str(), Error::kWrongRecord);
  const std::vector<std::uint8_t> whole = model_record(7, kLoaded);
  std::vector<std::uint8_t> damaged = whole;
  damaged[3000] ^= 1;
  check_error(load_model(damaged).c_str(), Error::kBroken);
  check_error(load_model(std::span(whole).first(whole.size() - 1)).c_str(), Error::kWrongRecord);
  LONGS_EQUAL(0, desk.stored_models.writes());
  check_ok(load_model(whole).c_str());
}

// What was loaded over the console decides as the same tree does that was there from the beginning: every frame's
// features, verdict and request, in every bit.
TEST(Console, DecidesByTheModelThatWasLoaded) {
  struct Seen {
    std::uint32_t sequence;
    std::array<std::int32_t, kFeatureCount> features;
    Verdict verdict;
    GripRequest request;
    bool slip, grip_ok;
    bool operator==(const Seen&) const = default;
  };
  const auto decisions = [](const model::Tree* tree, const std::vector<std::uint8_t>& stored) {
    test::ConsoleDesk other;
    other.tree = tree;
    for (const std::size_t slot : {0U, 1U}) std::ranges::copy(stored, other.stored_models.slot(slot).begin());
    other.film(30, 30);
    other.start();
    std::vector<Seen> seen;
    for (const Micros until = other.clock.now() + 5s; other.clock.now() < until;) {
      other.turn();
      const pipeline::Result& result = other.daemon->app().result();
      if (!seen.empty() && seen.back().sequence == result.sequence) continue;
      Seen one{result.sequence,
               {},
               result.verdict,
               result.request,
               other.daemon->app().outputs().slip,
               other.daemon->app().outputs().grip_ok};
      for (std::size_t k = 0; k < kFeatures.size(); ++k) one.features[k] = kFeatures[k].read(result.features);
      seen.push_back(one);
    }
    other.end();
    return seen;
  };
  start_unlocked();
  check_ok(load_model(model_record(7, kLoaded)).c_str());
  const std::vector<std::uint8_t> stored(desk.stored_models.slot(0).begin(), desk.stored_models.slot(0).end());
  model::Tree tree;
  CHECK(model_file::read(kLoaded, tree) == model_file::Refusal::kNone);
  const std::vector<Seen> loaded = decisions(nullptr, stored), given = decisions(&tree, {}),
                          compiled = decisions(nullptr, {});
  const auto slips = [](const std::vector<Seen>& seen) { return std::ranges::count(seen, true, &Seen::slip); };
  CHECK(loaded.size() >= 50);
  CHECK(slips(loaded) > 5);
  CHECK(loaded == given);
  CHECK_FALSE(loaded == compiled);
}

// With its owner's key a device stores nothing by itself, and takes nothing that is not signed.
TEST(Console, TakesFromItsOwnerOnly) {
  const Owner owner;
  desk.place.owner = &owner;
  start_unlocked();
  check_says("version json", R"("takes":"what its owner signed","settings_sequence":null})");
  check_says("status json", R"("development":false})");
  check_ok("set force_step 5");  // until the next start
  check_error("save", Error::kNotSigned);
  Params params;
  params.hold_ms = 700;
  check_error(load(record(7, params)).c_str(), Error::kNotSigned);
  std::vector<std::uint8_t> bytes = record(7, params);
  std::array<std::uint8_t, sealed::kSignatureBytes> signature{0x11};
  sealed::put_signature(bytes, signature);
  check_error(load(bytes).c_str(), Error::kWrongSignature);
  LONGS_EQUAL(0, desk.stored.writes());
  signature[0] = 0x5A;
  sealed::put_signature(bytes, signature);
  check_ok(load(bytes).c_str());
  CHECK(stored() == params);
  check_error(load(bytes).c_str(), Error::kTooOld);

  // Nor models; and only the owner leads back to the one that is compiled in.
  check_error("model default", Error::kNotSigned);
  for (const std::vector<std::uint8_t>& payload : {kLoaded, std::vector<std::uint8_t>{}}) {
    std::vector<std::uint8_t> model = model_record(payload.empty() ? 8 : 7, payload);
    check_error(load_model(model).c_str(), Error::kNotSigned);
    signature[0] = 0x11;
    sealed::put_signature(model, signature);
    check_error(load_model(model).c_str(), Error::kWrongSignature);
    signature[0] = 0x5A;
    sealed::put_signature(model, signature);
    check_ok(load_model(model).c_str());
    check_error(load_model(model).c_str(), Error::kTooOld);
    desk.end();
    start_unlocked();
    check_says("model json",
               payload.empty() ? R"("from":"compiled in","sequence":8)" : R"("from":"loaded","sequence":7)");
  }
}

// Settings that were stored and do not count: FAULT from the first frame on, whatever is filmed.
TEST(Console, HoldsFaultWhenItsSettingsAreLost) {
  Params safe;
  safe.max_force = 60;
  safe.latch = 1;
  lay(0, record(6, safe));
  lay(1, record(7, safe));
  damage(0);
  damage(1);
  start();
  STRCMP_CONTAINS("* FAULT config\r\n", desk.heard().c_str());
  check_held();
  check_says("version json", R"("settings_from":"defaults: what was stored is lost or damaged")");
  check_says("log json", R"("event":"settings","what":"lost","value":"")");
  check_says("stored json",
             R"({"slots":[{"record":"settings","slot":1,"number":null,"is":"the record's check sum is wrong"},)"
             R"({"record":"settings","slot":2,"number":null,"is":"the record's check sum is wrong"},)"
             R"({"record":"model","slot":1,"number":null,"is":"empty: never written to"},)");
  desk.run(30s);
  check_held();
  check_error("stored accept", Error::kLocked);
  (void)desk.unlock();
  check_ok("stored accept");
  check_fine();
  check_says("log json", R"("event":"settings","what":"lost","value":"accepted")");
  // Until the next start; what is saved, into both slots, counts for good.
  restart();
  check_held();
  (void)desk.unlock();
  check_ok("set max_force 60");
  check_held();
  desk.stored.set_failure(28, 40);
  check_error("save", Error::kWriteFailed);
  check_held();
  check_says("stored json", R"("slot":1,"number":null,"is":"unknown: reading or writing it failed")");
  desk.stored.set_failure(0);
  check_ok("save");
  check_fine();
  check_says("version json", R"("settings_from":"what was stored")");
  check_says("stored json", R"({"slots":[{"record":"settings","slot":1,"number":1,"is":"whole, the newest"},)"
                            R"({"record":"settings","slot":2,"number":1,"is":"whole, and older"},)");
  restart();
  check_fine();
  LONGS_EQUAL(60, desk.console->params().max_force);
  check_says("log json", R"("event":"settings","what":"whole","value":"")");
}

// Nor does it go back to an older record in silence: nobody knows what the damaged one said.
TEST(Console, HoldsFaultWhenItFallsBack) {
  Params older;
  older.max_force = 200;
  for (const std::size_t newer : {std::size_t{0}, std::size_t{1}}) {
    lay(1 - newer, record(6, older));
    lay(newer, record(7, {}));
    damage(newer);
    start();
    check_held();
    LONGS_EQUAL(200, desk.console->params().max_force);
    check_says("version json", R"("settings_from":"one of two records: the other, maybe the newer one, is damaged")");
    check_says("log json", R"("event":"settings","what":"one_of_two")");
    (void)desk.unlock();
    // Loading counts at the next start.
    Params loaded;
    loaded.max_force = 90;
    check_ok(load(record(8, loaded)).c_str());
    check_held();
    restart();
    check_fine();
    LONGS_EQUAL(90, desk.console->params().max_force);
    desk.end();
  }
}

// A place that the medium does not read, and zeros where a record must have been, are no first start.
TEST(Console, KnowsAFirstStartFromALoss) {
  start();
  check_fine();
  check_says("version json", R"("settings_from":"defaults: none were ever stored")");
  check_says("log json", R"("event":"settings","what":"first_start","value":"")");
  (void)desk.unlock();
  check_ok("stored accept");
  check_error("stored json accept", Error::kArguments);
  check_error("stored accept json", Error::kArguments);
  check_error("stored some", Error::kArguments);

  desk.stored.set_unreadable(true);
  restart();
  check_held();
  check_says("stored json", R"("slot":1,"number":null,"is":"unknown: reading or writing it failed")");
  desk.stored.set_unreadable(false);

  desk.place.settings = nullptr;
  restart();
  check_fine();
  check_says("version json", R"("settings_from":"defaults: there is no place to store any")");
  check_says("stored", "no place to store any");
  CHECK(desk.say("log").find("settings ") == std::string::npos);
}

// The first save writes both slots: zeros beside a record, in either of them, are no first start.
TEST(Console, KnowsAnErasedRecord) {
  start_unlocked();
  check_ok("set hold_ms 300");
  check_ok("save");
  const std::vector<std::uint8_t> saved(desk.stored.slot(0).begin(), desk.stored.slot(0).end());
  for (const std::size_t slot : {0U, 1U}) {
    std::ranges::fill(desk.stored.slot(slot), std::uint8_t{0});
    restart();
    check_held();
    check_says("stored", "erased: zeros, and whoever saves first writes both");
    LONGS_EQUAL(300, desk.console->params().hold_ms);
    lay_both(saved);
  }
}

// A value that this firmware does not know, or does not allow, was meant all the same.
TEST(Console, HoldsFaultWhenPartOfItsSettingsIsLost) {
  std::vector<std::uint8_t> bytes(8 + sealed::kAround);
  (void)sealed::write(sealed::Kind::kSettings, 7, std::vector<std::uint8_t>(8), bytes);
  lay_both(bytes);
  start();
  check_held();
  check_says("version json", R"("settings_from":"what was stored, without values that this firmware does not know")");
  (void)desk.unlock();
  check_ok("save");
  check_fine();
}

// An older record is what somebody may have put back: a device with an owner goes on with none but a newer one of his.
TEST(Console, IsNotRolledBack) {
  const Owner owner;
  desk.place.owner = &owner;
  Params older;
  older.max_force = 200;
  lay(0, signed_record(6, older));
  lay(1, signed_record(7, {}));
  damage(1);
  start();
  check_held();
  LONGS_EQUAL(255, desk.console->params().max_force);
  check_says("version json", R"("settings_from":"defaults: what was stored is lost or damaged")");
  (void)desk.unlock();
  check_error("stored accept", Error::kOwnersAlone);
  check_error("save", Error::kNotSigned);
  check_error(load(signed_record(6, older)).c_str(), Error::kTooOld);
  check_error(load(record(8, older)).c_str(), Error::kNotSigned);
  check_held();
  Params newer;
  newer.max_force = 90;
  check_ok(load(signed_record(7, newer)).c_str());
  check_held();
  restart();
  check_fine();
  LONGS_EQUAL(90, desk.console->params().max_force);

  // Both lost: what is loaded then goes into both, so that the start after it is a good one.
  damage(0);
  damage(1);
  restart();
  check_held();
  (void)desk.unlock();
  check_error("stored accept", Error::kOwnersAlone);
  check_ok(load(signed_record(9, newer)).c_str());
  restart();
  check_fine();
  LONGS_EQUAL(90, desk.console->params().max_force);
  // Settings of the time before it had an owner are not what the owner wants.
  lay(1, record(8, {}));
  restart();
  check_held();
  check_says("stored", "the record is not signed, and this device has an owner");
}

// Nor does another model than the newest one decide in silence: whichever slot is damaged, or both, FAULT is held until
// somebody who may says so, or another one was loaded. A device with an owner then goes by none of them.
TEST(Console, HoldsFaultWhenItsModelIsLost) {
  const Owner owner;
  for (const bool owned : {false, true}) {
    desk.place.owner = owned ? &owner : nullptr;
    for (const auto& damaged : std::vector<std::vector<std::size_t>>{{0}, {1}, {0, 1}}) {
      lay_model(0, 6, owned);
      lay_model(1, 7, owned);
      for (const std::size_t slot : damaged) desk.stored_models.slot(slot)[sealed::kPayloadAt + 100] ^= 1;
      start();
      check_held();
      const bool falls_back = !owned && damaged.size() == 1;
      const std::string number = falls_back ? std::to_string(7 - damaged[0]) : "null";
      const std::string from = falls_back ? "loaded: the other record, maybe the newer one, is damaged"
                                          : "compiled in: what was stored is lost or damaged";
      check_says("model json", fmt_of(R"("from":"%s","sequence":%s,"next_start":"the same")", from, number).c_str());
      check_says("version json", fmt_of(R"("model_from":"%s","model_sequence":%s)", from, number).c_str());
      check_says("log json", R"("event":"model","what":"damaged","value":"")");
      (void)desk.unlock();
      if (owned) {
        check_error("stored accept", Error::kOwnersAlone);
        check_error("model default", Error::kNotSigned);
      } else {
        check_ok("save");  // its settings are not what is lost
      }
      check_held();
      if (!owned) {
        check_ok("stored accept");
        check_fine();
        check_says("log json", R"("event":"model","what":"damaged","value":"accepted")");
        restart();
        check_held();
        (void)desk.unlock();
      }
      std::vector<std::uint8_t> newer = model_record(8, kLoaded);
      sealed::put_signature(newer, std::array<std::uint8_t, sealed::kSignatureBytes>{0x5A});
      check_ok(load_model(newer).c_str());
      check_held();  // it counts from the next start
      restart();
      check_fine();
      check_says("model json", R"("from":"loaded","sequence":8,"next_start":"the same")");
      desk.end();
    }
    desk.stored = sim::Store{settings::kMostBytes};  // what was saved is not signed
  }
}

// A change that can make GRIP_OK HIGH where it should be LOW needs the owner's signature; the rest needs the code.
TEST(Console, LeavesSafetyToItsOwner) {
  const Owner owner;
  for (const bool owned : {false, true}) {
    desk.place.owner = owned ? &owner : nullptr;
    start_unlocked();
    for (const ParamInfo& row : kParams) {
      const std::int32_t other = row.default_value == row.max ? row.max - 1 : row.default_value + 1;
      const std::string line = "set " + std::string(row.name) + " " + std::to_string(other);
      const bool refused = owned && row.kind == ParamClass::kSafety;
      const std::string answer = desk.say(line);
      STRCMP_CONTAINS_TEXT(refused ? "ERR 38 owners_alone: " : "OK\r\n", answer.c_str(), line.c_str());
      LONGS_EQUAL_TEXT(refused ? row.default_value : other, desk.console->params().*row.member, line.c_str());
      // Nothing is changed by saying what is so.
      check_ok(("set " + std::string(row.name) + " " + std::to_string(desk.console->params().*row.member)).c_str());
      check_ok(("defaults " + std::string(row.name)).c_str());
    }
    desk.end();
  }
  // Back to the defaults is a change like any other.
  Params strict;
  strict.latch = 1;
  strict.force_step = 9;
  lay_both(signed_record(7, strict));
  start_unlocked();
  for (const char* const line : {"set fault_markers_pct 1", "set hold_ms 0", "set opening_max_ms 60000", "set latch 0",
                                 "set force_step 5 latch 0", "defaults latch"}) {
    check_error(line, Error::kOwnersAlone);
  }
  check_says("set hold_ms 0",
             "ERR 38 owners_alone: hold_ms: this decides when GRIP_OK may be HIGH, and only the device's owner may say "
             "it. Likely cause: the device was given its owner's key. Next: write it into a TOML file, holdfast "
             "settings compile --sign, holdfast console --load, and reboot\r\n");
  check_ok("set force_step 5");
  check_ok("defaults force_step");
  check_ok("set force_step 5 start_force 9");
  check_says("defaults", "what the owner signed stays\r\nOK\r\n");
  strict.force_step = Params{}.force_step;
  CHECK(desk.console->params() == strict);
  CHECK(desk.daemon->params() == strict);
  check_error("set hold_ms 5001", Error::kRange);
  check_error("set fault_markers_pct 99", Error::kContradiction);
}

// The default of what is tuned may be above what the owner allows.
TEST(Console, KeepsADefaultThatTheOwnersSettingsRuleOut) {
  const Owner owner;
  desk.place.owner = &owner;
  Params weak;
  weak.max_force = 5;
  weak.start_force = 4;
  lay_both(signed_record(7, weak));
  start_unlocked();
  check_ok("set start_force 3 force_step 9");
  check_says("defaults", "what the owner signed stays\r\nOK\r\n");
  weak.start_force = 3;
  CHECK(desk.console->params() == weak);
}

// Behind the last number the device numbers anew.
TEST(Console, SavesBehindTheLastNumber) {
  Params params;
  params.hold_ms = 300;
  lay_both(record(0xFFFFFFFF, params));
  start_unlocked();
  LONGS_EQUAL(300, desk.console->params().hold_ms);
  for (int k = 1; k <= 3; ++k) {
    check_ok(("set hold_ms " + std::to_string(300 + k)).c_str());
    check_ok("save");
    check_says("version json", ("\"settings_sequence\":" + std::to_string(k) + "}").c_str());
    restart();
    (void)desk.unlock();
    LONGS_EQUAL(300 + k, desk.console->params().hold_ms);
    check_fine();
    if (k == 1) check_error(load(record(0xFFFFFFFF, params)).c_str(), Error::kTooOld);
  }
}

// The lines of diff, pasted into another device, make it the same.
TEST(Console, TakesItsOwnDiffBack) {
  start_unlocked();
  for (const char* const line : {"set raise_frames 3", "set hold_ms 300", "set max_force 200", "set latch 1"}) {
    check_ok(line);
  }
  const Params wanted = desk.console->params();
  const std::string text = desk.say("diff");
  const std::string lines = text.substr(text.find("set "));
  check_ok("defaults");
  (void)desk.heard();
  desk.type("# a comment\r\n");
  desk.type(lines.substr(0, lines.find("OK\r\n")));
  desk.run(500ms);
  CHECK(desk.console->params() == wanted);
  CHECK(desk.heard().find("ERR") == std::string::npos);
  check_says("diff json", "{\"raise_frames\":3,\"hold_ms\":300,\"latch\":1,\"max_force\":200}\r\nOK");
  const std::string dump = desk.say("dump");
  for (const ParamInfo& row : kParams) STRCMP_CONTAINS((" " + std::string(row.name) + " ").c_str(), dump.c_str());
}

// Any settings, said again line by line on a device that has any others.
TEST(Console, TakesADumpBackWhateverItHas) {
  start_unlocked();
  const std::vector<std::string> all{"set fault_markers_pct 1 degraded_markers_pct 2",
                                     "set degraded_markers_pct 99 fault_markers_pct 98",
                                     "set max_force 10 start_force 9",
                                     "set start_force 200 max_force 255",
                                     "set grid_rows 16 grid_cols 8",
                                     "set grid_cols 16 grid_rows 8",
                                     "set left_sensor 1 right_sensor 2",
                                     "set left_sensor 2 right_sensor 1"};
  for (const std::string& line : all) check_error((line.substr(0, line.rfind(' '))).c_str(), Error::kArguments);
  std::vector<std::pair<Params, std::string>> dumps;
  for (std::size_t mask = 0; mask < 16; ++mask) {
    for (std::size_t pair = 0; pair < 4; ++pair) check_ok(all[2 * pair + (mask >> pair & 1)].c_str());
    dumps.emplace_back(desk.console->params(), desk.say("dump"));
  }
  for (const auto& [wanted, dump] : dumps) {
    std::istringstream lines(dump.substr(dump.find("set ")));
    for (std::string line; std::getline(lines, line) && line.starts_with("set ");) {
      line.pop_back();
      check_ok(line.c_str());
    }
    CHECK(desk.console->params() == wanted);
  }
  check_error("set raise_frames 3 nothing 4", Error::kUnknownParameter);
  check_error("set raise_frames 3 hold_ms x", Error::kNotANumber);
  CHECK(desk.console->params() == dumps.back().first);
}

TEST(Console, ShowsParameters) {
  start();
  const std::string table = desk.say("get");
  for (const ParamInfo& row : kParams) {
    const std::size_t at = table.find("\n" + std::string(row.name) + " ");
    CHECK(at != std::string::npos);
    const std::string line = table.substr(at + 1, table.find('\r', at) - at - 1);
    CHECK_TEXT(line.size() <= 80, line.c_str());
    STRCMP_CONTAINS(kParamClassNames[static_cast<std::size_t>(row.kind)].data(), line.c_str());
  }
  const std::string some = desk.say("get jpeg");
  STRCMP_CONTAINS("jpeg_threads", some.c_str());
  CHECK(some.find("grip_speed") == std::string::npos);
  check_error("get nothing", Error::kUnknownParameter);
  check_says("get raise_frames json",
             "{\"parameters\":[{\"name\":\"raise_frames\",\"value\":2,\"unit\":\"frames\",\"min\":1,\"max\":10,"
             "\"default\":2,\"applies\":\"at once\",\"help\":\"slips in a row until the request is raised; clear ones "
             "raise it at once\"");
}

TEST(Console, ExplainsCommandsAndParameters) {
  start();
  const std::string all = desk.say("help");
  for (const console::CommandInfo& command : console::commands()) {
    STRCMP_CONTAINS(std::string(command.help).c_str(), all.c_str());
  }
  check_says("help set", "PARAMETER VALUE");
  check_says("help hold_ms", "how long the request stays raised");
  check_says("help hold_ms", "class                 safety");
  check_says("help jpeg_lanes json", R"("class":"tuning","why":"the same bytes; what comes late is rejected"})");
  check_says("help mode", "relearned");
  check_error("help nothing", Error::kArguments);
  check_says("help json", R"({"commands":[{"name":"help","arguments":)");
  check_says("help help json", R"({"name":"help","arguments":"[COMMAND|PARAMETER] [json]")");
  // On a screen 80 wide no line is broken.
  std::size_t widest = 0;
  for (std::size_t begin = 0, end = all.find('\n'); end != std::string::npos;
       begin = end + 1, end = all.find('\n', begin)) {
    widest = std::max(widest, end - begin);
  }
  CHECK(widest <= 80);
}

TEST(Console, SuggestsTheNearestCommand) {
  start();
  check_says("statsu", "statsu (status?)");
  check_says("devces", "devces (devices?)");
  check_says("st", "ERR 1 unknown_command: st (set?)");
  const std::string none = desk.say("xylophone");
  STRCMP_CONTAINS("ERR 1 unknown_command: xylophone: ", none.c_str());
  check_error(std::string(100, 'q').c_str(), Error::kUnknownCommand);
}

TEST(Console, CompletesCommandsParametersAndWords) {
  start();
  const auto completed = [&](const char* keys) {
    (void)desk.heard();
    desk.type(keys);
    desk.run(30ms);
    desk.type("\x03");
    std::string text = desk.heard();
    desk.run(30ms);
    return text;
  };
  STRCMP_CONTAINS("version ", completed("ve\t").c_str());
  STRCMP_CONTAINS("raise_frames ", completed("get ra\t").c_str());
  STRCMP_CONTAINS("jpeg_", completed("get jp\t").c_str());
  STRCMP_CONTAINS("jpeg_threads  jpeg_lanes", completed("get jpeg_\t").c_str());
  STRCMP_CONTAINS("markers ", completed("log frames m\t").c_str());
  STRCMP_CONTAINS("defaults", completed("help defa\t").c_str());
  STRCMP_CONTAINS("mode", completed("help mod\t").c_str());
  STRCMP_CONTAINS("frames ", completed("log fr\t").c_str());
  STRCMP_CONTAINS("echo o", completed("echo \t").c_str());
  STRCMP_CONTAINS("version", completed("\t").c_str());  // all of them, on several lines
  (void)desk.unlock();
  STRCMP_CONTAINS("holdfast# get jpeg_", completed("get jpeg_\t").c_str());
  STRCMP_CONTAINS("raise_frames ", completed("set raise\t").c_str());
  CHECK(completed("nothing a\t").find("  ") == std::string::npos);
  CHECK(completed("version json more\t").find("more ") == std::string::npos);
  desk.type("echo off\r");
  desk.run(30ms);
  STRCMP_EQUAL("", completed("de\t").c_str());  // ambiguous, and nobody looks
}

TEST(Console, RefusesLongAndDamagedLines) {
  start();
  check_error(std::string(300, 'x').c_str(), Error::kTooLong);
  check_error("ver\x02sion", Error::kDamaged);
  const std::string with_nul("ver\0sion", 8);
  check_error(with_nul.c_str(), Error::kUnknownCommand);  // "ver" alone is none
  check_error("a b c d e f g h i", Error::kArguments);
  check_error("save json", Error::kArguments);
  check_ok("  version  ");
  check_ok("version\t");
  desk.type("   \r\n# only a comment\r");
  desk.run(50ms);
  CHECK(desk.heard().find("ERR") == std::string::npos);
}

TEST(Console, ShowsWhatTheDeviceDoes) {
  desk.params.gripper = 1;
  desk.gpio.drive(hal::Input::kTare, hal::Level::kLow);
  start();
  desk.run(4s);  // the gripper is activated
  const std::string status = desk.say("status");
  for (const char* const part :
       {"state                 OK\r\n", "fps                   25.00\r\n", "markers               63\r\n",
        "grip_ok               yes\r\n", "evidence              imprint 0 of 55 um, 0 frames in a row\r\n",
        "last_slip_s_ago       -\r\n", "supply                good\r\n"}) {
    STRCMP_CONTAINS(part, status.c_str());
  }
  CHECK(std::count(status.begin(), status.end(), '\n') <= 23);  // one screen
  check_says("tasks", "decode");
  check_says("tasks", "first_frame_ms        40 after the kernel started\r\n");
  check_says("tasks json", R"({"first_frame_ms":40,"tasks":[{"task":"decode","count":)");
  check_ok("tasks clear");
  const std::string devices = desk.say("devices json");
  STRCMP_CONTAINS("{\"device\":\"camera\",\"is\":\"28D1-D7C6\",\"well\":\"yes\",\"more\":\"started 1 times\"}",
                  devices.c_str());
  STRCMP_CONTAINS("\"is\":\"Robotiq Hand-E\"", devices.c_str());
  desk.gpio.drive(hal::Input::kTare, hal::Level::kHigh);
  check_says("devices", "TARE HIGH");
  check_says("modes json", R"({"mode":"fast","now":"yes","us":)");
  check_says("model", "slip_v6");
  check_says("version", "desk");
  check_says("frame json", "{\"sequence\":");
  check_says("frame", "dx_um");
  desk.run(1500ms);
  check_says("log", "REFERENCE");
}

TEST(Console, SaysOfEachDeviceWhatIsWrongWithIt) {
  desk.params.gripper = 1;
  desk.identity = "";
  desk.hand.trouble(sim::LineTrouble::kDeaf);
  desk.link.set_full(true);
  start();
  std::string devices = desk.say("devices json");
  for (const char* const part :
       {R"("is":"unnamed")", "not activated", R"({"device":"link","is":"status and commands","well":"no")",
        R"("is":"Robotiq Hand-E","well":"no")"}) {
    STRCMP_CONTAINS(part, devices.c_str());
  }
  desk.gpio.fail_next(1000);
  desk.camera->set(sim::CameraSwitch::kGone);
  CHECK_FALSE(desk.console->out().put(std::string(5000, 'x')));
  desk.run(200ms);
  devices = desk.say("devices");
  STRCMP_CONTAINS("lines     GRIP_OK, ALIVE        no", devices.c_str());
  STRCMP_CONTAINS("unplugged", devices.c_str());
  STRCMP_CONTAINS("console   this port             no     0 frames and 1 texts", devices.c_str());
}

TEST(Console, ShowsMarkersThatAreLost) {
  start_unlocked();
  check_ok("reference learn");
  STRCMP_CONTAINS("null", desk.say("frame json").c_str());
  desk.run(1s);
  desk.camera->set(sim::CameraSwitch::kDark);
  desk.run(1s);
  STRCMP_CONTAINS("\"quality\":\"exposure\"", desk.say("frame json").c_str());
}

TEST(Console, KnowsNoRateBeforeTheSecondFrame) {
  desk.start();
  check_says("status", "fps                   0.00");
}

TEST(Console, KnowsNoFirstFrameBeforeItCame) {
  desk.start();
  desk.camera->set(sim::CameraSwitch::kGone);
  check_says("tasks", "first_frame_ms        -");
  check_says("tasks json", R"({"first_frame_ms":null,"tasks":[)");
  desk.camera->set(sim::CameraSwitch::kNone);
  desk.run(3s);
  CHECK(desk.say("tasks json").find("null") == std::string::npos);
}

// The object slips, and a second later it shows.
TEST(Console, RemembersASlip) {
  desk.tree = &test::kSpreadTree;
  desk.film(40, 12);
  start();
  desk.run(1s);
  const std::string status = desk.say("status json");
  const std::size_t at = status.find("\"last_slip_s_ago\":");
  CHECK(at != std::string::npos);
  CHECK(status.substr(at + 18, 4) != "null");
  check_says("log frames", "  1     0 ");  // slip, and GRIP_OK LOW
  check_ok("trace on");
  (void)desk.heard();
  desk.run(3s);
  STRCMP_CONTAINS("  SLIP\r\n", desk.heard().c_str());
}

TEST(Console, ShowsTheReferenceAndLearnsIt) {
  start();
  check_says("reference json", R"({"known":true,"rows":7,"cols":9,"lines_cut":0,"markers":63,"pitch_px":)");
  // Where LINK.md's rest positions count from, in the picture.
  const std::string text = desk.say("reference json");
  STRCMP_CONTAINS(R"("middle_x_px":)", text.c_str());
  const auto middle = marker_frame::middle_of(desk.daemon->app().state().reference.rest);
  CHECK(middle.has_value());
  DOUBLES_EQUAL(middle->x.raw() / 256.0, std::stod(text.substr(text.find("middle_x_px\":") + 13)), 0.01);
  DOUBLES_EQUAL(middle->y.raw() / 256.0, std::stod(text.substr(text.find("middle_y_px\":") + 13)), 0.01);
  STRCMP_CONTAINS(R"("width_px":)", text.c_str());
  (void)desk.unlock();
  check_ok("reference learn");
  desk.run(30ms);
  check_says("reference", "known                 no");
  check_says("reference json", R"("middle_x_px":null,"middle_y_px":null)");
  check_error("reference nonsense", Error::kArguments);
}

// A rest position learned now would hide what presses on the gel.
TEST(Console, DoesNotLearnAGelThatSomethingTouches) {
  start();
  desk.end();
  desk.film(0, 12);
  start_unlocked();
  check_error("reference learn", Error::kRefused);
}

TEST(Console, HasNothingToShowBeforeTheFirstFrame) {
  desk.start();
  check_error("frame", Error::kNothingYet);
  check_error("log fault", Error::kNothingYet);
  check_error("log frames", Error::kNothingYet);
}

TEST(Console, SpeaksForTheRobot) {
  start_unlocked();
  check_ok("tell opening 1");
  CHECK(desk.daemon->is_opening());
  check_ok("tell OPENING 0");
  CHECK_FALSE(desk.daemon->is_opening());
  check_ok("tell arm");
  check_error("tell grip 1", Error::kRefused);  // no gripper
  // In the words of the result, not in those of every refusal.
  check_says("tell grip 1", "no gripper is set up. Likely cause: the parameter `gripper` is 0. Next: set it");
  check_error("tell nonsense", Error::kArguments);  // and nothing of it in the next answer
  check_error("tell arm 7", Error::kArguments);
  check_error("tell arm x", Error::kArguments);
  check_error("tell nonsense", Error::kArguments);
  check_says("log", "OPENING                 done");
}

// Nobody can log in to a card: the console is where its owner hears of an update.
TEST(Console, TellsWhatTheBoardNoted) {
  start();
  check_says("version json", R"("board":"desk","release":null,"slot":null,"last_update":null,"link_version")");
  desk.place.notes = &desk.notes;
  start();
  check_says("version json", R"("release":null,"slot":null,"last_update":null,)");
  desk.notes.told = {"2 (0.1.1)", "B, kept", "installing \"x\x1b[2J\xc3\xa9\x7f\".raucb"};
  check_says("version json",
             R"--("release":"2 (0.1.1)","slot":"B, kept","last_update":"installing \"x?[2J???\".raucb",)--");
  check_says("version", "last_update           installing \"x?[2J???\".raucb\r\n");
  // The worst that can be noted still fits.
  desk.notes.told.fill(std::string(hal::Notes::kMostBytes, '"'));
  std::string worst;
  for (std::size_t k = 0; k < hal::Notes::kMostBytes; ++k) worst += "\\\"";
  check_says("version json", (R"("slot":")" + worst + R"(","last_update":")" + worst + R"(","link_version")").c_str());
  LONGS_EQUAL(0, desk.console->out().lost());
}

TEST(Console, MakesThingsFailWhereThatIsPossible) {
  start();
  check_says("fault", "gripper");
  (void)desk.unlock();
  check_ok("fault gripper mute");
  LONGS_EQUAL(1, desk.faults.begun.size());
  LONGS_EQUAL(1, desk.faults.begun[0]);
  check_ok("fault off");
  LONGS_EQUAL(1, desk.faults.ended);
  check_error("fault camera purple", Error::kArguments);
  check_error("fault camera", Error::kArguments);
  desk.end();
  desk.place.faults = nullptr;
  start();
  check_error("fault", Error::kNotHere);
}

// What happened before a fault can be read after it.
TEST(Console, KeepsTheFramesBeforeAFault) {
  desk.film(8);
  start();
  desk.run(2s);
  desk.camera->set(sim::CameraSwitch::kStuck);
  desk.run(500ms);
  CHECK(desk.daemon->app().outputs().state == DeviceState::kFault);
  desk.camera->set(sim::CameraSwitch::kNone);
  desk.run(1s);
  const std::string frames = desk.say("log fault markers json");
  STRCMP_CONTAINS("\"reason\":\"frame_frozen\"", frames.c_str());
  STRCMP_CONTAINS("\"state\":\"OK\"", frames.c_str());
  STRCMP_CONTAINS("\"displacement_um\":\"", frames.c_str());
  const std::string plain = desk.say("log frames");
  STRCMP_CONTAINS("entropy_rate_nat_s", plain.c_str());
  check_says("log events", "frame_frozen");
  check_error("log events markers", Error::kArguments);
  check_error("log nonsense", Error::kArguments);
}

TEST(Console, LogsSettingsAndCodes) {
  start();
  check_error("unlock wrong", Error::kWrongCode);
  desk.run(1100ms);
  (void)desk.unlock();
  check_ok("set raise_frames 3");
  check_ok("fault camera off");
  desk.camera->set(sim::CameraSwitch::kGone);
  desk.run(1s);
  const std::string log = desk.say("log");
  for (const char* const part :
       {"wrong_code", "unlocked", "setting         raise_frames            3", "fault_injected", "camera_gone"}) {
    STRCMP_CONTAINS(part, log.c_str());
  }
  STRCMP_CONTAINS("\"well\":\"no\"", desk.say("devices json").c_str());
}

TEST(Console, TellsOfALowSupplyAndOfItsEnd) {
  start();
  desk.run(4s);
  desk.supply.now = hal::Supply::State::kLow;
  desk.run(1s);
  const std::string status = desk.say("status json");
  STRCMP_CONTAINS("\"state\":\"DEGRADED\",\"reason\":\"board_undervoltage\"", status.c_str());
  STRCMP_CONTAINS("\"supply\":\"low\"", status.c_str());
  desk.supply.now = hal::Supply::State::kGood;
  desk.run(1s);
  check_says("status json", R"("state":"OK")");
  const std::string log = desk.say("log");
  STRCMP_CONTAINS("supply          low", log.c_str());
  STRCMP_CONTAINS("supply          good", log.c_str());
}

TEST(Console, AsksForARestart) {
  start_unlocked();
  check_ok("reboot");
  CHECK(desk.console->asked_to_restart());
}

// Frames between the lines: those of LINK.md, and every line still whole.
TEST(Console, StreamsFramesBetweenTheLines) {
  start();
  check_ok("watch on");
  (void)desk.heard();
  desk.run(1s);
  desk.type("version json\r");
  desk.run(200ms);
  const Heard heard = take_apart(desk.heard());
  LONGS_EQUAL(0, heard.damaged);
  CHECK(heard.statuses.size() >= 29);
  for (std::size_t k = 1; k < heard.statuses.size(); ++k) {
    LONGS_EQUAL(heard.statuses[k - 1].sequence + 1, heard.statuses[k].sequence);
  }
  LONGS_EQUAL(heard.statuses.size(), heard.evidences.size());
  LONGS_EQUAL(heard.statuses.size(), heard.loads.size());
  CHECK(heard.in_pairs);
  LONGS_EQUAL(13, heard.rests.size());
  CHECK(heard.displacements.size() >= 5 * 13);
  LONGS_EQUAL(0, heard.displacements.size() % 13);
  LONGS_EQUAL(7, heard.rests[0].rows);
  LONGS_EQUAL(9, heard.rests[0].cols);
  STRCMP_CONTAINS("{\"firmware\":", heard.text.c_str());
  desk.type("watch o");  // a line that is being typed is not broken by a frame
  desk.run(40ms);
  (void)desk.heard();
  desk.run(400ms);
  STRCMP_EQUAL("", desk.heard().c_str());
  check_ok("ff");
  (void)desk.heard();
  desk.run(200ms);
  STRCMP_EQUAL("", desk.heard().c_str());
  LONGS_EQUAL(0, desk.console->frames_lost());
}

// Before there is a rest position there are no markers to send.
TEST(Console, StreamsStatusAloneWhileItLearns) {
  desk.start();
  check_ok("watch on");
  desk.run(150ms);
  const Heard heard = take_apart(desk.heard());
  CHECK(!heard.statuses.empty());
  LONGS_EQUAL(0, heard.evidences.size() + heard.loads.size() + heard.displacements.size() + heard.rests.size());
}

// What it says of a picture is what `status` says.
TEST(Console, StreamsTheEvidenceThatStatusShows) {
  desk.tree = &test::kSpreadTree;
  desk.film(40, 12);
  start();
  check_ok("watch on");
  const App& app = desk.daemon->app();
  for (int k = 0; k < 5000 && !app.last_status().slip; ++k) desk.run(1ms);
  CHECK(app.last_status().slip);
  (void)desk.heard();
  const std::uint16_t before = app.last_status().sequence;
  for (int k = 0; k < 100 && app.last_status().sequence == before; ++k) desk.run(1ms);
  desk.run(5ms);
  const Heard heard = take_apart(desk.heard());
  LONGS_EQUAL(1, heard.evidences.size());
  const evidence_frame::EvidenceFrame& last = heard.evidences.back();
  const pipeline::Result& result = app.result();
  const ImprintFeatures& imprint = result.features.imprint;
  LONGS_EQUAL(imprint.motion.raw(), last.motion_log2_um_q8);
  LONGS_EQUAL(imprint.coarse.raw(), last.coarse_log2_um_q8);
  LONGS_EQUAL(imprint.growth.raw(), last.growth_log2_q8);
  LONGS_EQUAL(imprint.patches.raw(), last.patches);
  LONGS_EQUAL(result.run, last.run);
  LONGS_EQUAL(0, last.finger);
  const std::string status = desk.say("status json");
  LONGS_EQUAL(app.last_status().sequence, last.sequence);  // of no later picture
  const auto says = [&](const std::string& key, const std::string& value) {
    STRCMP_CONTAINS(("\"" + key + "\":" + value + ",").c_str(), status.c_str());
  };
  const auto quoted = [](std::string_view text) { return "\"" + std::string(text) + "\""; };
  const auto tenths = [](std::int32_t milli) {
    const std::int64_t t = div_round(milli, 100);
    return std::to_string(t / 10) + "." + std::to_string(t % 10);
  };
  LONGS_EQUAL(evidence_frame::kContactUnknown, last.contact);  // this tree does not read the picture
  says("contact", "null");
  CHECK(last.value_milli > last.threshold_milli);
  says("evidence", quoted(evidence_frame::kEvidences[last.evidence].name));
  says("evidence_value", tenths(last.value_milli));
  says("evidence_threshold", tenths(last.threshold_milli));
  says("evidence_unit", quoted(evidence_frame::kUnits[last.unit]));
  says("evidence_frames", std::to_string(last.run));

  const load_frame::LoadFrame& load = heard.loads.back();
  CHECK(load_frame::frame_of(last.sequence, 0, result.load) == load);
  LONGS_EQUAL(1, load.basis);
  CHECK(load.shear_x_mn != 0);
  says("load", quoted("uncalibrated"));
  const auto thousandths = [](int milli) -> std::string {
    return StringFromFormat("%s%d.%03d", milli < 0 ? "-" : "", std::abs(milli) / 1000, std::abs(milli) % 1000)
        .asCharString();
  };
  says("normal_n", thousandths(load.normal_mn));
  says("friction_use", thousandths(load.friction_use_permille));
}

// In thousandths of what a gel of 35 kPa would carry: from the next frame on, without a word to the decision.
TEST(Console, TakesTheScaleOfAWeight) {
  desk.film(40, 12);
  start();
  desk.run(2s);
  check_says("status", "uncalibrated");
  (void)desk.unlock();
  check_ok("set shear_scale 2000");
  const App& app = desk.daemon->app();
  const std::uint16_t before = app.last_status().sequence;
  for (int k = 0; k < 100 && app.last_status().sequence == before; ++k) desk.run(1ms);
  check_says("status", "one_weight");
  check_says("status json", R"("load":"one_weight","load_within":)");
  CHECK(app.last_status().state == DeviceState::kOk || app.last_status().state == DeviceState::kSlip);
}

// LINK.md, What `watch on` takes of a line: 25 * 35 of status, 25 * 30 of evidence, 25 * 20 of load, 5 * 13 * 33 of
// displacement and,
// every five seconds, 13 * 33 of rest position; a picture more at either end.
TEST(Console, StreamsNoMoreBytesThanALineCarries) {
  start();
  check_ok("watch on");
  (void)desk.heard();
  desk.run(10s);
  const std::size_t bytes = desk.heard().size();
  CHECK(bytes <= 10 * (875 + 750 + 500 + 2145) + 3 * 429 + 85 + 429);
  CHECK(bytes >= 10 * (875 + 750 + 500 + 2145));
}

TEST(Console, TracesEveryFrameAndWatchesFiveTimesASecond) {
  start();
  check_ok("trace on");
  (void)desk.heard();
  desk.run(1s);
  std::string lines = desk.heard();
  LONGS_EQUAL(25, std::count(lines.begin(), lines.end(), '\n'));
  STRCMP_CONTAINS(" s  OK none  markers 63  v ", lines.c_str());
  STRCMP_CONTAINS("  GRIP_OK\r\n", lines.c_str());
  check_ok("trace off");
  check_ok("watch");
  (void)desk.heard();
  desk.run(1s);
  lines = desk.heard();
  LONGS_EQUAL(5, std::count(lines.begin(), lines.end(), '\n'));
  desk.type("\x03");
  desk.run(50ms);
  STRCMP_CONTAINS("holdfast> ", desk.heard().c_str());
  check_ok("watch screen");
  desk.camera->set(sim::CameraSwitch::kOff);
  desk.run(1s);
  STRCMP_CONTAINS("FAULT", desk.heard().c_str());  // nothing to say of markers then
  check_error("watch nonsense", Error::kArguments);
  check_error("trace", Error::kArguments);
}

TEST(Console, ObeysCommandFramesAmongTheTextWhereThatIsAllowed) {
  desk.place.host_commands = true;
  start();
  (void)desk.heard();
  std::string bytes("sta");
  bytes += frame_of(77, command_frame::Command::kOpening, 1);
  bytes += "tus\r";
  desk.type(bytes);
  desk.run(100ms);
  const Heard heard = take_apart(desk.heard());
  LONGS_EQUAL(1, heard.answers.size());
  LONGS_EQUAL(77, heard.answers[0].sequence);
  CHECK(heard.answers[0].result == command_frame::Outcome::kDone);
  CHECK(desk.daemon->is_opening());
  // A sound frame of another kind is nobody's.
  std::array<std::uint8_t, command_frame::kAnswerBytes> answer{};
  command_frame::encode(command_frame::AnswerFrame{}, answer);
  std::string other(1, '\0');
  other.append(answer.begin(), answer.end());
  desk.type(other);
  desk.run(50ms);
  check_ok("version");
}

// Every command that there is, and with every argument: what is not unlocked changes nothing, is answered and counted,
// and the first of each kind is in the log.
TEST(Console, ObeysNoCommandFrameWhileLocked) {
  desk.params.gripper = static_cast<std::int32_t>(Gripper::kHandE);
  start();
  (void)desk.heard();
  const MarkerField rest = desk.daemon->app().state().reference.rest;
  std::uint16_t sequence = 0;
  int sent = 0;
  for (int round = 0; round < 40; ++round) {  // 128 events fit into the log
    for (const command_frame::CommandInfo& row : command_frame::kCommands) {
      for (std::uint8_t argument = 0; argument <= row.max_argument; ++argument, ++sent) {
        desk.type(frame_of(++sequence, row.command, argument));
        desk.run(10ms);
        CHECK_FALSE(desk.daemon->is_opening());
      }
    }
  }
  const Heard heard = take_apart(desk.heard());
  LONGS_EQUAL(sent, heard.answers.size());
  for (const command_frame::AnswerFrame& answer : heard.answers) LONGS_EQUAL(5, static_cast<int>(answer.result));
  CHECK(desk.daemon->app().outputs().state == DeviceState::kOk);
  CHECK(grip_ok());
  CHECK_FALSE(desk.daemon->grip().go);
  LONGS_EQUAL(rest.markers[31].x.raw(), desk.daemon->app().state().reference.rest.markers[31].x.raw());
  LONGS_EQUAL(sent, desk.console->refused());
  check_says("devices", (", " + std::to_string(sent) + " commands refused").c_str());
  const std::string log = desk.say("log");
  for (const char* const name : {"TARE", "OPENING", "RELEASE", "ARM", "GRIP"}) {
    const std::size_t first = log.find(std::string("command         ") + name);
    CHECK_TEXT(first != std::string::npos, name);
    STRCMP_CONTAINS("locked", log.substr(first, log.find('\n', first) - first).c_str());
    CHECK_TEXT(log.find(std::string("command         ") + name, first + 1) == std::string::npos, name);
  }
  STRCMP_CONTAINS("state           OK", log.c_str());  // what happened before is in it still
}

TEST(Console, ObeysCommandFramesWhileUnlocked) {
  start_unlocked();
  desk.type(frame_of(1, command_frame::Command::kOpening, 1));
  desk.run(50ms);
  CHECK(desk.daemon->is_opening());
  check_ok("lock");
  desk.type(frame_of(2, command_frame::Command::kOpening, 0));
  desk.run(50ms);
  CHECK(desk.daemon->is_opening());
  LONGS_EQUAL(1, desk.console->refused());
  // The robot's own link is the robot's, locked or not.
  const std::string end = frame_of(3, command_frame::Command::kOpening, 0);
  CHECK(desk.link.feed({reinterpret_cast<const std::uint8_t*>(end.data()), end.size()}));
  desk.run(50ms);
  CHECK_FALSE(desk.daemon->is_opening());
}

// A frame that was refused is not kept: unlocking obeys what is said afterwards.
TEST(Console, DoesNotMakeUpForWhatItRefused) {
  start();
  desk.type(frame_of(1, command_frame::Command::kOpening, 1));
  desk.run(50ms);
  (void)desk.unlock();
  desk.run(100ms);
  CHECK_FALSE(desk.daemon->is_opening());
  desk.type(frame_of(1, command_frame::Command::kOpening, 1));  // a repetition: answered as before
  desk.run(50ms);
  CHECK_FALSE(desk.daemon->is_opening());
  desk.type(frame_of(2, command_frame::Command::kOpening, 1));
  desk.run(50ms);
  CHECK(desk.daemon->is_opening());
}

TEST(Console, LocksWhenTheCableIsPulled) {
  start_unlocked();
  desk.host.hang_up();
  desk.run(10ms);
  CHECK_FALSE(desk.console->unlocked());
  desk.host.reconnect();
  check_error("set hold_ms 300", Error::kLocked);
  desk.type(frame_of(1, command_frame::Command::kOpening, 1));
  desk.run(50ms);
  CHECK_FALSE(desk.daemon->is_opening());
  (void)desk.unlock();
  desk.host.change_hands();  // another program, from one read to the next
  check_error("tell opening 1", Error::kLocked);
  CHECK_FALSE(desk.daemon->is_opening());
  check_ok("version");
}

// What was typed before the cable was out does not happen when another one is in: no line of it, no half of one.
TEST(Console, DoesNothingThatWasLeftInTheCable) {
  start_unlocked();
  // Read, and not begun.
  for (const std::string& line :
       {std::string("tell opening 1\r"), "unlock " + std::string(test::ConsoleDesk::kCode) + "\r"}) {
    desk.type(line);
    desk.turn();
    plug_anew();
    desk.run(50ms);
    CHECK_FALSE(desk.daemon->is_opening());
    CHECK_FALSE(desk.console->unlocked());
    STRCMP_CONTAINS("ERR 33 interrupted", desk.heard().c_str());
  }

  // What is being written is written.
  (void)desk.unlock();
  desk.stored.set_slow(true);
  desk.type("save\r");
  desk.run(50ms);
  plug_anew();
  desk.stored.finish();
  desk.run(50ms);
  STRCMP_CONTAINS("OK\r\n", desk.heard().c_str());
  LONGS_EQUAL(1, desk.stored.writes());

  // In the queue behind an answer that nobody takes: lines, the code, a frame.
  desk.place.host_commands = true;
  restart();
  desk.host.set_full(true);
  for (int k = 0; k < 3; ++k) desk.type("get\r");
  desk.type("unlock " + std::string(test::ConsoleDesk::kCode) + "\rtell opening 1\r");
  desk.type(frame_of(1, command_frame::Command::kOpening, 1));
  desk.type("echo off\r");
  desk.run(500ms);
  desk.host.set_full(false);
  desk.host.change_hands();
  desk.type("status js");
  desk.run(1s);
  CHECK_FALSE(desk.console->unlocked());
  CHECK_FALSE(desk.daemon->is_opening());
  LONGS_EQUAL(1, desk.console->refused());
  const Heard heard = take_apart(desk.heard());
  LONGS_EQUAL(5, static_cast<int>(heard.answers.at(0).result));
  STRCMP_CONTAINS("ERR 33 interrupted", heard.text.c_str());
  STRCMP_CONTAINS("ERR 10 locked", heard.text.c_str());
  check_says("on", "\"unlocked\":false");  // whose line it is now
  desk.type("echo on\r");
  desk.run(50ms);

  // Half a line and half a frame.
  desk.type("unlock " + std::string(test::ConsoleDesk::kCode));
  desk.run(50ms);
  plug_anew();
  desk.type("\r");
  desk.run(50ms);
  CHECK_FALSE(desk.console->unlocked());
  const std::string frame = frame_of(2, command_frame::Command::kOpening, 1);
  desk.type(frame.substr(0, 6));
  desk.run(10ms);
  desk.host.change_hands();
  desk.type(frame.substr(6));
  desk.run(50ms);
  CHECK_FALSE(desk.daemon->is_opening());
  desk.type("\x03\r");
  desk.run(50ms);

  // Ctrl-C before it was looked at.
  desk.host.set_full(true);
  for (int k = 0; k < 3; ++k) desk.type("get\r");
  desk.run(500ms);
  desk.host.change_hands();
  desk.run(10ms);
  desk.host.set_full(false);
  desk.type("\x03");
  desk.run(300ms);
  STRCMP_CONTAINS("OK\r\n", desk.unlock().c_str());
  CHECK(desk.console->unlocked());
}

// Only a command keeps it open: noise, empty lines, refusals do not.
TEST(Console, LocksItselfAmongNoise) {
  start();
  desk.camera->set(sim::CameraSwitch::kOff);
  (void)desk.unlock();
  for (int k = 0; k < 11; ++k) {
    desk.run(57s);
    for (const char* const noise : {"\r", "\xFF\xFE\r", "qwzx\r", "# nothing\r"}) desk.type(noise);
    desk.type(std::string(300, 'x') + "\r");
    desk.type(frame_of(static_cast<std::uint16_t>(k), command_frame::Command::kArm, 0));
    desk.run(100ms);
  }
  CHECK_FALSE(desk.console->unlocked());
}

TEST(Console, LocksOnAWrongCode) {
  start_unlocked();
  check_error("unlock nonsense", Error::kWrongCode);
  CHECK_FALSE(desk.console->unlocked());
  check_error("set hold_ms 300", Error::kLocked);
}

// A code behind a mistyped word, or alone as at a prompt for it, does not wait for who comes next.
TEST(Console, KeepsMistypedCodesOutOfTheHistory) {
  start();
  check_ok("version");
  for (const char* const line : {"unlokc 7QX-41-red", "7QX-41-red", "UNLOCK 7QX-41-red"}) {
    check_error(line, Error::kUnknownCommand);
  }
  const std::string shown = line_before();
  STRCMP_CONTAINS("version", shown.c_str());
  CHECK(shown.find(test::ConsoleDesk::kCode) == std::string::npos);
}

// Noise that looks like the beginning of a frame holds nobody up for long.
TEST(Console, GivesUpAFrameThatDoesNotEnd) {
  start();
  desk.type(std::string("\0-\x03", 3));
  desk.run(Console::kFrameGap + 10ms);
  check_ok("version");
  desk.type(std::string("\0v", 2));
  desk.run(Console::kFrameGap + 10ms);
  check_ok("ersion");
  std::string too_long("\0x\x01", 3);
  desk.type(too_long += std::string(60, 'x'));
  desk.run(Console::kFrameGap + 10ms);
  check_ok("version");
  link::Receiver receiver;
  CHECK(receiver.give_up() == link::Event::kNone);
}

// Nobody reads: the answer waits, the device goes on, and when somebody reads again all of it comes.
TEST(Console, WaitsForASlowReader) {
  start();
  desk.run(2s);
  (void)desk.heard();
  desk.type("log frames json\rversion\r");
  desk.host.set_full(true);
  desk.run(2s);
  CHECK(desk.daemon->app().outputs().state == DeviceState::kOk);
  LONGS_EQUAL(0, desk.host.output_bytes().size());
  desk.camera->set(sim::CameraSwitch::kStuck);  // the state changes meanwhile: told when the answer is whole
  desk.run(500ms);
  desk.camera->set(sim::CameraSwitch::kNone);
  desk.host.set_full(false);
  desk.run(2s);
  const std::string text = desk.heard();
  STRCMP_CONTAINS("]}\r\nOK\r\n", text.c_str());
  STRCMP_CONTAINS("link_version", text.c_str());
  LONGS_EQUAL(0, desk.console->out().lost());
}

// A watch that nobody reads loses whole frames, and says how many.
TEST(Console, DropsFramesThatNobodyReads) {
  start();
  check_ok("watch on");
  desk.host.set_full(true);
  desk.run(20s);
  CHECK(desk.console->frames_lost() > 100);
  desk.host.set_full(false);
  (void)desk.heard();
  desk.run(1s);
  const Heard heard = take_apart(desk.heard());
  LONGS_EQUAL(0, heard.damaged);
  CHECK(heard.statuses.size() > 20);
  check_ok("trace on");
  desk.host.set_full(true);
  const std::uint32_t before = desk.console->frames_lost();
  desk.run(20s);
  CHECK(desk.console->frames_lost() > before);
  desk.host.set_full(false);
}

TEST(Console, IsInterruptedInTheMiddleOfAnAnswer) {
  start();
  desk.run(2s);
  const std::string text = typed_into_an_answer("version\r\x03", 200ms);
  STRCMP_CONTAINS("ERR 33 interrupted", text.c_str());
  CHECK(text.find("link_version") == std::string::npos);
  check_ok("version");
}

// Each RELEASE frame holds the byte that is Ctrl-C for people: the robot's command is obeyed, and the answer goes on.
TEST(Console, AReleaseInterruptsNoAnswer) {
  desk.place.host_commands = true;
  start();
  desk.run(2s);
  const std::string text = typed_into_an_answer(frame_of(78, command_frame::Command::kRelease, 0), 10s);
  CHECK(text.find("interrupted") == std::string::npos);
  const Heard heard = take_apart(text);
  LONGS_EQUAL(1, heard.answers.size());
  LONGS_EQUAL(78, heard.answers[0].sequence);
  // Right behind a frame it is Ctrl-C again.
  const std::string cut = typed_into_an_answer(frame_of(79, command_frame::Command::kRelease, 0) + "\x03", 10s);
  STRCMP_CONTAINS("ERR 33 interrupted", cut.c_str());
}

// Against its contract, but boards do it.
TEST(Console, NeitherStaysUnlockedNorRefusesForLongWhenTheClockIsSetBack) {
  desk.clock.advance(2h);
  start();
  STRCMP_CONTAINS("OK", desk.unlock().c_str());
  desk.seen_clock.by = 1h;
  desk.run(Console::kStaysUnlocked + 1s);
  check_error("set latch 1", Error::kLocked);
  for (int k = 0; k < 7; ++k) {
    (void)desk.say("unlock wrong");
    desk.run(Console::kLongestWait + 1s);
  }
  (void)desk.say("unlock wrong");
  desk.seen_clock.by = 2h;
  desk.run(Console::kLongestWait + 1s);
  STRCMP_CONTAINS("OK", desk.unlock().c_str());
}

// Work of one turn is bounded, whatever comes and however much of it.
TEST(Console, DoesABoundedAmountOfWorkPerTurn) {
  start();
  std::uint32_t random = 5;
  const Micros since = desk.clock.now();
  std::uint64_t accepted = desk.gpio.edges(hal::Line::kAlive);
  for (int turn = 0; turn < 4000; ++turn) {
    std::string noise;
    for (int k = 0; k < 5000; ++k) {  // 1 MB/s at 5 ms a turn
      random = random * 1664525 + 1013904223;
      noise += static_cast<char>(random >> 24);
    }
    desk.type(noise);
    const std::size_t before = desk.host.output_bytes().size();
    desk.turn();
    CHECK(desk.host.output_bytes().size() - before <= Console::kMostOut);
    desk.host.clear_output();
  }
  const double seconds = static_cast<double>((desk.clock.now() - since).count()) * 1e-6;
  accepted = desk.gpio.edges(hal::Line::kAlive) - accepted;
  CHECK(static_cast<double>(accepted) > 24.5 * seconds);
  // Back within a second.
  for (const Micros until = desk.clock.now() + 900ms; desk.clock.now() < until;) desk.turn();
  desk.type("\r");
  check_ok("version");
}

// More than it keeps, behind an answer that nobody reads: what is lost damages the line that it cuts, and Ctrl-C is
// heard all the same.
TEST(Console, HearsCtrlCBehindMoreThanItKeeps) {
  start();
  desk.run(2s);
  (void)desk.heard();
  desk.host.set_full(true);
  std::string lines = "log frames json\r";
  for (int k = 0; k < 600; ++k) lines += "version\r";
  for (std::size_t at = 0; at < lines.size(); at += 500) {
    desk.type(lines.substr(at, 500));
    desk.run(100ms);
  }
  desk.host.set_full(false);
  desk.run(20s);
  const std::string text = desk.heard();
  STRCMP_CONTAINS("ERR 3 line_damaged", (text + desk.say("x")).c_str());
  check_ok("version");
  desk.host.set_full(true);
  for (std::size_t at = 0; at < lines.size(); at += 500) {
    desk.type(lines.substr(at, 500));
    desk.run(100ms);
  }
  desk.type("\x03");
  desk.run(50ms);
  desk.host.set_full(false);
  desk.run(200ms);
  (void)desk.heard();
  check_says("version", "link_version");
  // Nothing runs, but what is typed cannot be echoed: Ctrl-C goes before that as well.
  check_ok("trace on");
  desk.host.set_full(true);
  desk.run(20s);
  desk.type(std::string(300, 'x'));
  desk.run(50ms);
  desk.type("\x03");
  desk.run(50ms);
  desk.host.set_full(false);
  desk.run(1s);
  CHECK(desk.heard().find("xxx") == std::string::npos);
  check_ok("version");
}

TEST(Console, KeepsNobodyWaitingAfterAHangUp) {
  start();
  desk.type("log frames js");
  desk.run(20ms);
  desk.host.hang_up();
  desk.run(5s);
  desk.host.reconnect();
  desk.type("\x03");
  check_ok("version");
}

TEST(Console, PromptsNobodyWhereNobodyCanType) {
  desk.place.prompts = false;
  start();
  STRCMP_EQUAL("* BOOT none\r\n* REFERENCE learning\r\n* OK none\r\n", desk.heard().c_str());
  check_says("echo on", "OK");
  desk.type("\r");
  desk.run(50ms);
  STRCMP_CONTAINS("holdfast> ", desk.heard().c_str());
  check_error("echo", Error::kArguments);
}

// Every command, answered to its end, without the heap.
TEST(Console, TakesNoMemory) {
  start_unlocked();
  for (const console::CommandInfo& command : console::commands()) {
    if (command.name == "reboot" || command.name == "lock") continue;
    for (const char* const form : {"\r", " json\r", "\t\x1B[A\r"}) {
      desk.type(command.name);
      desk.type(form);
      const unsigned before = test::allocations();
      for (int k = 0; k < 40; ++k) desk.turn();
      LONGS_EQUAL_TEXT(before, test::allocations(), std::string(command.name).c_str());
    }
  }
}

// From the last line of a record, taken or refused, to its answer.
TEST(Console, LoadsWithoutMemory) {
  start_unlocked();
  std::vector<std::uint8_t> other = kLoaded;
  other[84] = 'x';
  const std::vector<std::vector<std::uint8_t>> records{model_record(7, test::repaired(other)),
                                                       model_record(7, kLoaded)};
  for (const std::vector<std::uint8_t>& bytes : records) {
    desk.type(load_model(bytes) + "\r");
    const unsigned before = test::allocations();
    for (int k = 0; k < 40; ++k) desk.turn();
    LONGS_EQUAL(before, test::allocations());
  }
  LONGS_EQUAL(1, desk.stored_models.writes());
}

TEST(Console, HasACauseAndANextStepForEveryError) {
  std::set<std::string_view> names;
  for (const console::ErrorInfo& row : console::kErrors) {
    CHECK(!row.what.empty() && !row.cause.empty() && !row.next.empty());
    CHECK(names.insert(row.name).second);
    CHECK(console::info(row.error).name == row.name);
  }
  CHECK(console::info(Error::kNone).name == console::kErrors[0].name);
  for (const ReasonInfo& row : kReasons) CHECK(!row.what.empty() && !row.cause.empty() && !row.next.empty());
  for (const command_frame::ResultInfo& row : command_frame::kResults) CHECK(!row.cause.empty() && !row.next.empty());
}
