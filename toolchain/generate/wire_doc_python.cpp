// SPDX-License-Identifier: Apache-2.0
// What toolchain/python/holdfast/link.py knows of the wire: a module of tables.
#include <cstddef>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "base/status.hpp"
#include "link/command_frame.hpp"
#include "link/evidence_frame.hpp"
#include "link/link.hpp"
#include "link/load_frame.hpp"
#include "link/marker_frame.hpp"
#include "link/status_frame.hpp"
#include "toolchain/generate/wire_doc.hpp"

namespace holdfast::wire_doc {
namespace {

namespace sf = status_frame;
namespace cf = command_frame;
namespace ef = evidence_frame;
namespace lf = load_frame;
namespace mf = marker_frame;

template <typename Number>
std::string digits(Number number) {
  return std::to_string(static_cast<int>(number));
}

std::string python_text(std::string_view words) {
  return nlohmann::json(words).dump();
}

template <typename Table>
std::string python_frame(int version, link::Kind kind, std::string_view name, const Table& fields) {
  std::string out = "    (" + digits(version) + ", " + digits(kind) + "): (\n        " + python_text(name) +
                    ",\n        " + std::to_string(link::payload_bytes(fields)) + ",\n        (\n";
  for (const auto& field : fields) {
    out += "            (" + python_text(field.name) + ", " + digits(field.offset) + ", " +
           python_text(name_of(field.type)) + "),  # " + std::string(field.unit) + "; " + std::string(field.meaning) +
           "\n";
  }
  return out + "        ),\n    ),\n";
}

template <typename Rows>
std::string python_rows(const Rows& rows) {
  std::string out;
  for (const link::Row& r : rows) {
    out += "    " + digits(r.number) + ": " + python_text(r.name) + ",  # " + std::string(r.meaning) + "\n";
  }
  return out;
}

}  // namespace

std::string python_tables() {
  std::string out =
      "# SPDX-License-Identifier: Apache-2.0\n"
      "# Written by wire_doc from "
      "firmware/link/{link,status_frame,command_frame,marker_frame,evidence_frame,load_frame}.hpp and "
      "firmware/base/status.hpp; do not edit.\n"
      "\"\"\"Numbers and layouts of the frames on serial.\"\"\"\n\n";
  out += "VERSION = " + digits(link::kVersion) + "  # of what is sent\n";
  out += "LAST_VERSION = " + digits(link::kLastVersion) + "  # a second byte above it begins no frame\n";
  out += "MAX_WIRE_BYTES = " + std::to_string(link::kMaxWireBytes) + "\n";
  out += "FRESH_MS = " + std::to_string(sf::kFreshFor.count() / 1000) + "  # the receiver's rule\n\n";
  out += "# (version, kind): name, bytes of the payload, fields as (name, byte, type)\nFRAMES = {\n";
  out += python_frame(link::kVersion, link::Kind::kStatus, "status", sf::kFields);
  out += python_frame(sf::kHandVersion, link::Kind::kStatus, "status", sf::kHandFields);
  out += python_frame(link::kVersion, link::Kind::kCommand, "command", cf::kCommandFields);
  out += python_frame(link::kVersion, link::Kind::kAnswer, "answer", cf::kAnswerFields);
  out += python_frame(link::kVersion, link::Kind::kDisplacement, "displacement", mf::kDisplacementFields);
  out += python_frame(link::kVersion, link::Kind::kRest, "rest", mf::kRestFields);
  out += python_frame(link::kVersion, link::Kind::kEvidence, "evidence", ef::kFields);
  out += python_frame(link::kVersion, link::Kind::kLoad, "load", lf::kFields);
  out += "}\n\nFLAGS = {  # name: bit\n";
  for (const sf::Flag& f : sf::kFlags) {
    out += "    " + python_text(f.name) + ": " + digits(f.bit) + ",  # " + std::string(f.meaning) + "\n";
  }
  out += "}\n\nSTATES = {\n";
  for (const StateInfo& s : kStates) {
    out += "    " + digits(s.state) + ": " + python_text(s.name) + ",  # " + std::string(s.meaning) + "\n";
  }
  out += "}\n\n# name, what, likely cause, next step\nREASONS = {\n";
  for (const ReasonInfo& r : kReasons) {
    out += "    " + digits(r.reason) + ": (" + python_text(r.name) + ", " + python_text(r.what) + ", " +
           python_text(r.cause) + ", " + python_text(r.next) + "),\n";
  }
  out += "}\n\nCOMMANDS = {\n";
  for (const cf::CommandInfo& c : cf::kCommands) {
    out += "    " + python_text(c.name) + ": " + digits(c.command) + ",  # " + std::string(c.meaning) +
           "; argument: " + std::string(c.argument) + "\n";
  }
  out += "}\n\n# name, meaning\nRESULTS = {\n";
  for (const cf::ResultInfo& r : cf::kResults) {
    out += "    " + digits(r.result) + ": (" + python_text(r.name) + ", " + python_text(r.meaning) + "),\n";
  }
  out += "}\n\nCONTACTS = {\n" + python_rows(ef::kContacts);
  out += "}\n\nEVIDENCES = {\n" + python_rows(ef::kEvidences);
  out += "}\n\nBASES = {\n" + python_rows(lf::kBases);
  out += "}\n\nUNITS = (\n";
  for (const std::string_view unit : ef::kUnits) out += "    " + python_text(unit) + ",\n";
  return out + ")\n";
}

}  // namespace holdfast::wire_doc
