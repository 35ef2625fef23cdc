// SPDX-License-Identifier: Apache-2.0
#include "toolchain/generate/wire_doc.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <initializer_list>
#include <map>
#include <span>
#include <sstream>
#include <string_view>
#include <vector>

#include "app/supervisor.hpp"
#include "base/math.hpp"
#include "base/status.hpp"
#include "console/errors.hpp"
#include "link/command_frame.hpp"
#include "link/evidence_frame.hpp"
#include "link/link.hpp"
#include "link/load_frame.hpp"
#include "link/marker_frame.hpp"
#include "link/status_frame.hpp"
#include "params/modes.hpp"
#include "params/params.hpp"

namespace holdfast::wire_doc {
namespace {

namespace sf = status_frame;
namespace cf = command_frame;
namespace ef = evidence_frame;
namespace lf = load_frame;
namespace mf = marker_frame;

template <typename Number>
std::string text(Number number) {
  return std::to_string(static_cast<std::int64_t>(number));
}

std::string code(std::string_view name) {
  return "`" + std::string(name) + "`";
}

std::string row(std::initializer_list<std::string_view> cells) {
  std::string line = "|";
  for (const std::string_view cell : cells) line += " " + std::string(cell) + " |";
  return line + "\n";
}

std::string head(std::initializer_list<std::string_view> cells) {
  std::string lines = row(cells) + "|";
  for (std::size_t i = 0; i < cells.size(); ++i) lines += "---|";
  return lines + "\n";
}

template <typename Table>
std::string layout(const Table& fields) {
  std::string out = head({"byte", "name", "type", "unit", "meaning"});
  for (const auto& field : fields) {
    out += row({text(field.offset), code(field.name), name_of(field.type), field.unit, field.meaning});
  }
  return out;
}

std::string hex(std::span<const std::uint8_t> wire) {
  std::string out = "```\n";
  for (std::size_t i = 0; i < wire.size(); ++i) {
    char digits[4];
    std::snprintf(digits, sizeof digits, "%02x", static_cast<unsigned>(wire[i]));
    out += std::string(digits) + (i + 1 == wire.size() || i % 17 == 16 ? "\n" : " ");
  }
  return out + "```\n";
}

// A grasp that slips: every field differs from 0 and from its neighbours.
constexpr sf::StatusFrame kStatus{.sequence = 513,
                                  .timestamp_us = 16'909'060,
                                  .age_100us = 412,
                                  .state = DeviceState::kSlip,
                                  .reason = Reason::kSlipDetected,
                                  .slip = true,
                                  .grip_ok = false,
                                  .features_valid = true,
                                  .alive = true,
                                  .markers = 63,
                                  .vx_um_s = -1500,
                                  .vy_um_s = 250,
                                  .entropy_nat_q16 = 131'072,
                                  .entropy_rate_nat_s_q8 = 1024};
constexpr cf::CommandFrame kCommand{.sequence = 258, .command = cf::Command::kTare, .argument = 1};
constexpr cf::AnswerFrame kAnswer{.sequence = 258, .command = cf::Command::kTare, .result = cf::Outcome::kDone};

// What that status stands on.
constexpr ef::EvidenceFrame kWhy{.sequence = 513,
                                 .finger = 0,
                                 .contact = 2,
                                 .evidence = 1,
                                 .unit = 1,
                                 .run = 2,
                                 .patches = 45,
                                 .value_milli = 61'440,
                                 .threshold_milli = 34'000,
                                 .motion_log2_um_q8 = 1521,
                                 .coarse_log2_um_q8 = 256,
                                 .growth_log2_q8 = -12};

// And the forces then.
constexpr lf::LoadFrame kForces{.sequence = 513,
                                .finger = 0,
                                .basis = 2,
                                .flags = 1,
                                .shear_x_mn = -300,
                                .shear_y_mn = 400,
                                .normal_mn = 1250,
                                .friction_use_permille = 400};

std::string examples() {
  std::array<std::uint8_t, sf::kWireBytes> status{};
  std::array<std::uint8_t, cf::kCommandBytes> command{};
  std::array<std::uint8_t, cf::kAnswerBytes> answer{};
  sf::encode(kStatus, status);
  cf::encode(kCommand, command);
  cf::encode(kAnswer, answer);
  std::array<std::uint8_t, ef::kWireBytes> why{};
  ef::encode(kWhy, why);
  std::array<std::uint8_t, lf::kWireBytes> forces{};
  lf::encode(kForces, forces);
  sf::StatusFrame of_hand = kStatus;
  of_hand.fingers = 3;
  of_hand.healthy = 2;
  of_hand.contact = 3;
  std::array<std::uint8_t, sf::kMostWireBytes> hand{};
  sf::encode(of_hand, hand);
  return hex(status) + "Status: sequence " + text(kStatus.sequence) + ", timestamp " + text(kStatus.timestamp_us) +
         " us, age " + text(kStatus.age_100us) + " x 0.1 ms, state " + std::string(info(kStatus.state).name) +
         ", reason " + std::string(info(kStatus.reason).name) + ", flags slip + features_valid + alive, " +
         text(kStatus.markers) + " markers, vx " + text(kStatus.vx_um_s) + " um/s, vy " + text(kStatus.vy_um_s) +
         " um/s, entropy " + text(kStatus.entropy_nat_q16) + " / 65536 nat, entropy rate " +
         text(kStatus.entropy_rate_nat_s_q8) + " / 256 nat/s.\n\n" + hex(command) + "Command: sequence " +
         text(kCommand.sequence) + ", TARE, argument " + text(kCommand.argument) + ".\n\n" + hex(answer) +
         "Its answer: done.\n\n" + hex(why) + "Evidence: sequence " + text(kWhy.sequence) +
         ", finger 0, HELD, imprint " + text(kWhy.value_milli) + " of " + text(kWhy.threshold_milli) + " um/1000, " +
         text(kWhy.run) + " frames in a row, " + text(kWhy.patches) + " patches, motion " +
         text(kWhy.motion_log2_um_q8) + " / 256, coarse " + text(kWhy.coarse_log2_um_q8) + " / 256, growth " +
         text(kWhy.growth_log2_q8) + " / 256.\n\n" + hex(forces) + "Load: sequence " + text(kForces.sequence) +
         ", finger 0, one_weight, within, shear " + text(kForces.shear_x_mn) + " and " + text(kForces.shear_y_mn) +
         " mN, normal " + text(kForces.normal_mn) + " mN, friction use " + text(kForces.friction_use_permille) +
         " / 1000.\n\n" + hex(hand) +
         "Status, version 2: the first one, of a hand with two fingers, of which the right one is healthy and both are "
         "in contact.\n";
}

std::string framing() {
  return "All integers are little endian, in two's complement. The payload of a frame is the fields of its table; on "
         "the wire it is COBS of the payload, then one 0x00. A payload has at most " +
         text(link::kMaxPayloadBytes) +
         " bytes, so that COBS adds exactly one byte and every frame of a kind has the same length.\n\n" +
         head({"kind", "frame", "from", "bytes on the wire"}) +
         row({text(link::Kind::kStatus), "status", "holdfastd, once per camera frame",
              text(sf::kWireBytes) + "; version 2: " + text(sf::kMostWireBytes)}) +
         row({text(link::Kind::kCommand), "command", "robot", text(cf::kCommandBytes)}) +
         row({text(link::Kind::kAnswer), "answer", "holdfastd, one for each command", text(cf::kAnswerBytes)}) +
         row({text(link::Kind::kDisplacement), "displacement", "holdfastd, where `watch on` was said",
              text(mf::kWireBytes)}) +
         row({text(link::Kind::kRest), "rest position", "likewise", text(mf::kWireBytes)}) +
         row({text(link::Kind::kEvidence), "evidence", "likewise, behind the status frame", text(ef::kWireBytes)}) +
         row({text(link::Kind::kLoad), "load", "likewise, behind the evidence", text(lf::kWireBytes)}) +
         "\nCRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, not reflected, no final xor; \"123456789\" gives "
         "0x29B1. A receiver drops a frame whose length, COBS or CRC is wrong and waits for the next 0x00. It skips "
         "kinds and versions that it does not know, and ignores flag bits that it does not know.\n\n"
         "### Frames beside lines of text\n\n"
         "On the port `link` there are frames alone. On the port `host` they stand between lines of text, never inside "
         "one, and there **a frame begins and ends with 0x00**. A sender may always begin with one: delimiters may "
         "repeat. A receiver distinguishes them like this:\n\n"
         "1. A 0x00 begins anew, whatever came before it.\n"
         "2. When the second byte behind it is 0x01 to 0x08 (the version), a frame has begun. Otherwise both bytes are "
         "text, and so is all that follows up to the next 0x00. Lines hold no such bytes: none is taken for a frame.\n"
         "3. The next 0x00 ends the frame; its CRC decides. What is no frame is dropped, not read as text.\n"
         "4. " +
         text(link::kMaxWireBytes) +
         " bytes without a 0x00 are no frame: they are dropped, with all that follows to the end of the line (CR or "
         "LF).\n"
         "5. A 0x00 in the middle of a line belongs to the line, which is no command then: the halves of a broken line "
         "never become one.\n"
         "6. On the port `host`, a frame that has begun and is not followed by another byte for 200 ms is given "
         "up.\n\n";
}

std::string commands() {
  std::string out = "\n### Commands\n\n" + head({"number", "name", "meaning", "argument"});
  for (const cf::CommandInfo& row_of : cf::kCommands) {
    out += row({text(row_of.command), row_of.name, row_of.meaning, row_of.argument});
  }
  out +=
      "\n### Repetition\n\n"
      "Every command is answered. When no answer comes, send **the same frame again**, the same sequence included: a "
      "repetition less than " +
      text(cf::Once::kForget.count() / 1000) +
      " ms after the frame before is answered again with the same result and not executed again. A new command takes "
      "another sequence, also when it says the same. After a start, begin with another sequence than the last one, or "
      "be silent for that time first. Each port keeps its own last command.\n\n"
      "### Who is obeyed\n\n"
      "On the port `link` every command. On the port `host`, the console's, a command is obeyed while the console is "
      "unlocked, or where holdfastd was started with `--host-commands`. Otherwise it is answered `locked`, the "
      "console's "
      "`devices` counts it, and `log` has the first of each kind.\n\n"
      "### How long OPENING lasts\n\n"
      "From the first OPENING 1, or RELEASE, for `opening_max_ms` (" +
      text(Params{}.opening_max_ms) +
      " ms by default); said again it is the same one, and its time runs on. Another one begins only after an end - "
      "OPENING 0, GRIP 1, or the line OPENING going LOW - or after something was touched anew, which a model that does "
      "not read the picture cannot tell. Until then OPENING is answered `overdue`; RELEASE opens the gripper all the "
      "same, and what slips meanwhile is told.\n\n";
  out += "## Answer frame, version " + text(link::kVersion) + "\n\n" + layout(cf::kAnswerFields);
  out += "\n### Results\n\n" + head({"number", "name", "meaning"});
  for (const cf::ResultInfo& row_of : cf::kResults) {
    out += row({text(row_of.result), code(row_of.name), row_of.meaning});
  }
  return out;
}

std::string why() {
  std::string out = "\n## Evidence frame, version " + text(link::kVersion) + "\n\n" +
                    "On the port `host`, after the console's command `watch on`: behind every status frame whose "
                    "features are valid, what its verdict stands on; of a hand, what that of the finger says whose "
                    "picture it was. The status frame decides, this one explains: "
                    "do not act on it.\n\n" +
                    layout(ef::kFields);
  out += "\n### Contact\n\n" + head({"number", "name", "meaning"});
  for (const ef::Row& row_of : ef::kContacts) out += row({text(row_of.number), row_of.name, row_of.meaning});
  out += "\n### Evidence\n\n" + head({"number", "name", "meaning"});
  for (const ef::Row& row_of : ef::kEvidences) out += row({text(row_of.number), code(row_of.name), row_of.meaning});
  out += "\n### Units\n\n" + head({"number", "unit"});
  for (std::size_t i = 0; i < ef::kUnits.size(); ++i) out += row({text(i), ef::kUnits[i]});
  return out;
}

std::string forces() {
  std::string out = "\n## Load frame, version " + text(link::kVersion) + "\n\n" +
                    "On the port `host`, after the console's command `watch on`: behind every evidence frame, the "
                    "forces that the displacement field of that picture stands for, and the share of the friction that "
                    "they use. They are **uncalibrated** until a known weight was used (`holdfast calibrate "
                    "--weight`), and nothing is decided by them. How exact they are: "
                    "[toolchain](../../toolchain/README.md#forces).\n\n" +
                    layout(lf::kFields) + "\n### Basis\n\n" + head({"number", "name", "meaning"});
  for (const link::Row& row_of : lf::kBases) out += row({text(row_of.number), code(row_of.name), row_of.meaning});
  out += "\n### Load flags\n\n" + head({"bit", "name", "meaning"});
  for (const link::Row& row_of : lf::kFlags) out += row({text(row_of.number), row_of.name, row_of.meaning});
  return out;
}

// What `watch on` takes of a line, with the 0x00 before each frame.
std::string budget() {
  constexpr std::size_t kFps = 25, kBytesPerSecond = 115'200 / 10;
  const std::size_t pieces = idx(mf::frames_of({7, 9})) * (mf::kWireBytes + 1);
  const std::size_t status = kFps * (sf::kWireBytes + 1);
  const std::size_t why = kFps * (ef::kWireBytes + 1);
  const std::size_t load = kFps * (lf::kWireBytes + 1);
  const std::size_t displacement = kFps / mf::kEvery * pieces;
  const std::size_t rest = kFps * pieces / mf::kRestEvery;
  const std::size_t sum = status + why + load + displacement + rest;
  return "\n## What `watch on` takes of a line\n\nWith 63 markers and " + text(kFps) +
         " pictures a second, the 0x00 before each frame included:\n\n" + head({"frames", "bytes a second"}) +
         row({"status", text(status)}) + row({"evidence", text(why)}) + row({"load", text(load)}) +
         row({"displacement", text(displacement)}) + row({"rest position", text(rest)}) + row({"all", text(sum)}) +
         "\n115200 baud carry " + text(kBytesPerSecond) +
         " bytes a second: " + text((sum * 100 + kBytesPerSecond / 2) / kBytesPerSecond) +
         " % are taken, the rest is for answers.\n";
}

}  // namespace

std::string_view name_of(link::WireType type) {
  switch (type) {
    case link::WireType::kU8:
      return "u8";
    case link::WireType::kU16:
      return "u16";
    case link::WireType::kU32:
      return "u32";
    case link::WireType::kI16:
      return "i16";
    case link::WireType::kI32:
      return "i32";
  }
  return "";
}

std::string link_markdown() {
  std::string out =
      "<!-- SPDX-License-Identifier: Apache-2.0 -->\n"
      "<!-- Written by wire_doc from "
      "firmware/link/{link,status_frame,command_frame,marker_frame,evidence_frame,load_frame}.hpp "
      "and "
      "firmware/base/status.hpp; do not edit. -->\n"
      "# Frames on serial\n\n"
      "For programs in C or C++ there is a header: [toolchain/robot](../../toolchain/robot/README.md).\n\n"
      "## Framing\n\n";
  out += framing();
  out += "## Status frame, version " + text(link::kVersion) + "\n\n" + layout(sf::kFields);
  out +=
      "\n**The receiver's rule:** `grip_ok` counts only while the last change of `alive` is younger than " +
      text(sf::kFreshFor.count() / 1000) +
      " ms by the receiver's own clock. A missing frame is not fine, and neither is the first frame alone.\n\n"
      "**Late frames.** A frame that was held up on its way is not fine either. Its lag is the time of its arrival "
      "minus "
      "`timestamp_us`; the clocks need not agree, because the least lag so far is the base. A frame whose `alive` "
      "changed and whose lag exceeds the base by more than " +
      text(sf::kFreshFor.count() / 1000) +
      " ms is late. The base rises by 250 ppm of the time, so "
      "that clocks that differ by up to 200 ppm make no frame late. The receiver starts a new base, and confirms "
      "nothing for 500 ms, in these cases:\n\n"
      "* The device was restarted: sequence and timestamp contradict each other (less than 10 ms or more than " +
      text(sf::kFreshFor.count() / 1000) +
      " ms "
      "a frame), and the frame is late or the sequence repeats or skips more than 1000.\n"
      "* A lag is more than " +
      text(sf::kFreshFor.count() / 1000) +
      " ms below the base. In the first 500 ms of a base 20 ms are enough: a backlog is being "
      "delivered.\n"
      "* No such frame came for 30 minutes: `timestamp_us` wraps after 71.\n\n"
      "[The header](../../toolchain/robot/README.md) and the Python package do this.\n\n"
      "**Known limitation: a link must not buffer.** A constant delay cannot be seen by a receiver, because it looks "
      "like another clock. Discard what waits in a port when it is opened. A bridge must drop what it cannot deliver "
      "at "
      "once. After a silence of S seconds a frame may be S/4 ms older before it is late. In a hand that continues "
      "without its left finger (`lost_finger`) `timestamp_us` does not change, and late frames are not detected.\n\n"
      "### Flags\n\n";
  out += head({"bit", "name", "meaning"});
  for (const sf::Flag& flag : sf::kFlags) out += row({text(flag.bit), flag.name, flag.meaning});
  out += "\nAll other bits are sent as 0.\n\n### States\n\n" + head({"number", "name", "meaning"});
  for (const StateInfo& state : kStates) out += row({text(state.state), state.name, state.meaning});
  out += "\n### Reasons\n\n" + head({"number", "name", "what", "likely cause", "next step"});
  for (const ReasonInfo& reason : kReasons) {
    out += row({text(reason.reason), code(reason.name), reason.what, reason.cause, reason.next});
  }
  out +=
      "\n## Status frame, version " + text(sf::kHandVersion) + "\n\n" +
      "From a device of two fingers whose parameter `status_version` is 2. A device of one finger sends version 1 "
      "for ever, and one of two as well where nobody asked for version 2.\n\n" +
      layout(sf::kHandFields) +
      "\nOne frame for each picture of either finger. In both versions `state`, `reason`, `flags` and the receiver's "
      "rule are the hand's: `grip_ok` is HIGH only while every finger is OK, and `alive` toggles when every finger "
      "had an accepted frame since it last did. Where the parameter `lost_finger` is 1, both leave out a finger that "
      "is at FAULT while the other is not. `timestamp_us`, `age_100us`, `markers` and the four features are the left "
      "finger's last picture, repeated with the right one's. Why a finger is not healthy is said by the console's "
      "`devices`.\n\n"
      "**Compatibility:** a receiver of version 1 hears nothing of version 2, and by its rule takes nothing for "
      "fine. One that is older than version 2 takes the longer frame for a damaged one.\n";
  out += "\n## Command frame, version " + text(link::kVersion) + "\n\n" + layout(cf::kCommandFields) + commands();
  out += "\n## Marker frames, version " + text(link::kVersion) + "\n\n" +
         "On the port `host`, after the console's command `watch on`: the displacements of every fifth picture, " +
         text(mf::kPerFrame) +
         " markers a frame, and the rest positions when they are learned and now and then. A marker that is seen and "
         "has a rest position stands at the sum of both.\n\n" +
         layout(mf::kDisplacementFields) + why() + forces() + budget();
  return out + "\n## Examples\n\n" + examples();
}

std::string states_markdown() {
  std::string out =
      "<!-- SPDX-License-Identifier: Apache-2.0 -->\n"
      "<!-- Written by wire_doc from firmware/app/supervisor.hpp and firmware/base/status.hpp; do not edit. -->\n"
      "# States\n\n"
      "GRIP_OK is HIGH in OK only, and counts only while the last edge of ALIVE is younger than 150 ms. On SLIP: "
      "tighten. On FAULT: hold, and look at the reason.\n\n";
  out += head({"number", "state", "meaning"});
  for (const StateInfo& state : kStates) out += row({text(state.state), state.name, state.meaning});
  out +=
      "\n## What leads to them\n\n"
      "Asked from the top for every frame, and for every frame that does not come; the first line that applies "
      "decides.\n\n";
  out += head({"from", "when", "state", "reason"});
  for (const supervisor::Rule& rule : supervisor::kRules) {
    std::string why;
    switch (rule.why) {
      case supervisor::Why::kRow:
        why = code(info(rule.reason).name);
        break;
      case supervisor::Why::kRejection:
        why = "why the frame was rejected, or did not come";
        break;
      case supervisor::Why::kFault:
        why = "what is at fault";
        break;
      case supervisor::Why::kStrain:
        why = "which of them";
        break;
    }
    out += row({rule.only_in_fault ? "FAULT" : "any", rule.when, rule.stays ? "as it was" : info(rule.to).name, why});
  }
  out +=
      "\n## Sources\n\nWho has a say beside the frames, each with a reason of its own; of several the first "
      "counts.\n\n";
  out += head({"source", "leads to"});
  for (const supervisor::SourceInfo& source : supervisor::kSources) {
    out += row({source.what, info(source.leads_to).name});
  }
  out += "\n## Reasons\n\n";
  out += head({"number", "name", "what", "likely cause", "next step"});
  for (const ReasonInfo& reason : kReasons) {
    out += row({text(reason.reason), code(reason.name), reason.what, reason.cause, reason.next});
  }
  return out;
}

namespace {

std::vector<std::string> cells_of(const std::string& line) {
  std::vector<std::string> cells;
  std::istringstream in(line);
  for (std::string cell; std::getline(in, cell, ',');) cells.push_back(cell);
  return cells;
}

}  // namespace

std::string mode_prices(const std::string& trade_csv) {
  std::istringstream in(trade_csv);
  std::string line;
  std::getline(in, line);
  const std::vector<std::string> names = cells_of(line);
  std::map<std::string, std::map<std::string, std::string>> modes;
  while (std::getline(in, line)) {
    const std::vector<std::string> cells = cells_of(line);
    std::map<std::string, std::string> row_of;
    for (std::size_t k = 0; k < names.size() && k < cells.size(); ++k) row_of[names[k]] = cells[k];
    if (row_of["knob"] == "mode") modes[row_of["value"]] = row_of;
  }
  std::string out =
      "// SPDX-License-Identifier: Apache-2.0\n"
      "// Written by wire_doc from toolchain/trade/trade.csv, which `holdfast trade` measured; do not edit.\n"
      "#pragma once\n\n#include <array>\n#include <cstdint>\n\n#include \"params/modes.hpp\"\n\nnamespace holdfast "
      "{\n\n"
      "// What a mode costs and gains: CPU time of a frame on the machine that measured (compare, do not rely on it),\n"
      "// aarch64 instructions, memory it works on, how well it sees filmed markers, and what it detects on "
      "recordings.\n"
      "struct ModePrice {\n"
      "  std::int32_t us = 0;\n"
      "  std::int32_t kilo_instructions = 0;\n"
      "  std::int32_t memory_bytes = 0;\n"
      "  std::int32_t marker_error_upx = 0;    // RMS, in millionths of a pixel of a picture 320 wide\n"
      "  std::int32_t entropy_error_unat = 0;  // in millionths of a nat\n"
      "  std::int32_t onsets_milli_pct = 0;       // of recorded onsets, detected within 10 frames\n"
      "  std::int32_t alarms_milli_per_hour = 0;  // false ones where the recordings are silent\n"
      "};\n\n"
      "// In the order of kModes.\ninline constexpr std::array<ModePrice, kModes.size()> kModePrices{{\n";
  for (const Mode& mode : kModes) {
    const auto found = modes.find(std::string(mode.name));
    if (found == modes.end()) return "";
    const auto value = [&](const char* name) { return std::strtod(found->second[name].c_str(), nullptr); };
    const auto number = [](double scaled) { return std::to_string(std::llround(scaled)); };
    const double onsets = std::max(value("clip_onsets"), 1.0);
    out += "    {" + number(value("us_p50")) + ", " + number(value("instructions_aarch64") * 1e-3) + ", " +
           number(value("memory_bytes")) + ", " + number(value("marker_rms_px") * 1e6) + ", " +
           number(value("film_entropy_error_nat") * 1e6) + ", " + number(value("clip_within_10") / onsets * 1e5) +
           ", " + number(value("clip_alarms_per_hour") * 1e3) + "},\n";
  }
  return out + "}};\n\n}  // namespace holdfast\n";
}

std::string errors_markdown() {
  std::string out =
      "<!-- SPDX-License-Identifier: Apache-2.0 -->\n"
      "<!-- Written by wire_doc from firmware/base/status.hpp, firmware/console/errors.hpp and "
      "firmware/link/command_frame.hpp; do not edit. -->\n"
      "# Errors\n\n"
      "## Reasons of a state\n\n"
      "In the status frame, behind the state on the console, and in the log. [STATES.md](app/STATES.md) says which of "
      "them lead to which state.\n\n";
  out += head({"number", "name", "what", "likely cause", "next step"});
  for (const ReasonInfo& reason : kReasons) {
    out += row({text(reason.reason), code(reason.name), reason.what, reason.cause, reason.next});
  }
  out +=
      "\n## Refusals of the console\n\n"
      "A command that was not carried out ends with `ERR <number> <name>: ...`.\n\n";
  out += head({"number", "name", "what", "likely cause", "next step"});
  for (const console::ErrorInfo& error : console::kErrors) {
    out += row({text(error.error), code(error.name), error.what, error.cause, error.next});
  }
  out += "\n## Refusals of a command frame\n\n" + head({"number", "name", "what", "likely cause", "next step"});
  for (const cf::ResultInfo& result : cf::kResults) {
    if (result.result == cf::Outcome::kDone) continue;
    out += row({text(result.result), code(result.name), result.meaning, result.cause, result.next});
  }
  out +=
      "\n## Messages of the tools\n\n"
      "`holdfast`, `holdfastd` and the scripts end with one line on standard error that says what happened, the likely "
      "cause and the next step. Exit status: 1 it could not be done; 2 the command line is wrong (`holdfast`: 1, "
      "too).\n";
  return out;
}

std::string parameters_markdown() {
  std::string out =
      "<!-- SPDX-License-Identifier: Apache-2.0 -->\n"
      "<!-- Written by wire_doc from firmware/params/params.hpp; do not edit. -->\n"
      "# Parameters\n\n"
      "`get` and `help NAME` show them at the console, `holdfast settings list` on the host. A wrong value of class "
      "**safety** can make GRIP_OK HIGH where it should be LOW, or harm what is held: a device with its owner's key "
      "takes these from a file only that the owner has signed (`holdfast settings compile --sign`, then `holdfast "
      "console --load`, then `reboot`). **tuning** and **display** can be set at the console of any device that is "
      "unlocked, until the next start.\n\n";
  out += head({"name", "class", "why", "default", "range", "counts", "what", "price"});
  for (const ParamInfo& info_of : kParams) {
    const std::string unit = info_of.unit.empty() ? "" : " " + std::string(info_of.unit);
    out += row({code(info_of.name), kParamClassNames[static_cast<std::size_t>(info_of.kind)], info_of.why,
                text(info_of.default_value) + unit, text(info_of.min) + " to " + text(info_of.max) + unit,
                kAppliesNames[static_cast<std::size_t>(info_of.applies)], info_of.help, info_of.price});
  }
  return out;
}

}  // namespace holdfast::wire_doc
