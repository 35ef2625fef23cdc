// SPDX-License-Identifier: Apache-2.0
// What the page of a session knows of the wire: a module of constants for toolchain/page/wire.js.
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "base/status.hpp"
#include "link/evidence_frame.hpp"
#include "link/link.hpp"
#include "link/load_frame.hpp"
#include "link/marker_frame.hpp"
#include "link/status_frame.hpp"
#include "params/params.hpp"
#include "tactile/types.hpp"
#include "toolchain/generate/wire_doc.hpp"
#include "vision/markers.hpp"

namespace holdfast::wire_doc {
namespace {

namespace sf = status_frame;
namespace ef = evidence_frame;
namespace lf = load_frame;
namespace mf = marker_frame;
using Json = nlohmann::ordered_json;

template <typename Table>
Json places(const Table& table) {
  Json fields = Json::object();
  for (const auto& field : table) fields[std::string(field.name)] = {field.offset, name_of(field.type)};
  return fields;
}

template <typename Rows>
Json names_of(const Rows& rows) {
  Json out = Json::object();
  for (const link::Row& row : rows) out[std::to_string(row.number)] = row.name;
  return out;
}

// A table row a line: differences of the committed file can be read.
std::string lines_of(const Json& rows) {
  std::string out = "[\n";
  for (const Json& row : rows) out += "    " + row.dump() + ",\n";
  return out + "  ]";
}

}  // namespace

std::string page_tables() {
  Json states = Json::array(), reasons = Json::array(), flags = Json::object();
  for (const StateInfo& s : kStates) {
    states.push_back({{"number", static_cast<int>(s.state)}, {"name", s.name}, {"meaning", s.meaning}});
  }
  for (const ReasonInfo& r : kReasons) {
    reasons.push_back({{"number", static_cast<int>(r.reason)},
                       {"name", r.name},
                       {"what", r.what},
                       {"cause", r.cause},
                       {"next", r.next}});
  }
  for (const sf::Flag& flag : sf::kFlags) flags[std::string(flag.name)] = flag.bit;
  const Json kinds = {{"status", static_cast<int>(link::Kind::kStatus)},
                      {"displacement", static_cast<int>(link::Kind::kDisplacement)},
                      {"rest", static_cast<int>(link::Kind::kRest)},
                      {"evidence", static_cast<int>(link::Kind::kEvidence)},
                      {"load", static_cast<int>(link::Kind::kLoad)}};

  std::string out =
      "// SPDX-License-Identifier: Apache-2.0\n"
      "// Written by wire_doc from "
      "firmware/{link/{link,status_frame,marker_frame,evidence_frame,load_frame},params/params,base/status}.hpp; "
      "do not edit.\n"
      "export const WIRE = {\n";
  const auto entry = [&](std::string_view name, const std::string& value) {
    out += "  " + std::string(name) + ": " + value + ",\n";
  };
  entry("version", std::to_string(link::kVersion));
  entry("lastVersion", std::to_string(link::kLastVersion));
  entry("minWireBytes", std::to_string(link::wire_bytes(link::kMinPayloadBytes)));
  entry("maxWireBytes", std::to_string(link::kMaxWireBytes));
  entry("kinds", kinds.dump());
  entry("statusBytes", std::to_string(sf::kPayloadBytes));
  entry("status", places(sf::kFields).dump());
  entry("handVersion", std::to_string(sf::kHandVersion));
  entry("handStatusBytes", std::to_string(sf::kHandPayloadBytes));
  entry("handStatus", places(sf::kHandFields).dump());
  entry("flags", flags.dump());
  entry("oldestAge", std::to_string(sf::kOldestAge));
  entry("markerBytes", std::to_string(link::payload_bytes(mf::kDisplacementFields)));
  entry("markersPerFrame", std::to_string(mf::kPerFrame));
  entry("marker", places(mf::kDisplacementFields).dump());
  entry("evidenceBytes", std::to_string(ef::kPayloadBytes));
  entry("evidence", places(ef::kFields).dump());
  entry("contacts", names_of(ef::kContacts).dump());
  entry("evidences", names_of(ef::kEvidences).dump());
  entry("units", Json(ef::kUnits).dump());
  entry("loadBytes", std::to_string(lf::kPayloadBytes));
  entry("load", places(lf::kFields).dump());
  entry("bases", names_of(lf::kBases).dump());
  entry("maxMarkers", std::to_string(kMaxMarkers));
  entry("freshMs", std::to_string(sf::kFreshFor.count() / 1000));
  entry("bins", std::to_string(kHistogramBins));
  entry("histogramRangeUm", std::to_string(Params{}.histogram_range_um));
  entry("pitchUm", std::to_string(Params{}.pitch_um));
  entry("states", lines_of(states));
  entry("reasons", lines_of(reasons));
  return out + "};\n";
}

}  // namespace holdfast::wire_doc
