// SPDX-License-Identifier: Apache-2.0
// What a fuzzer starts from, by the parser's own tables: seeds into a folder that is there, and words as libFuzzer's
// dictionary.
//   fuzz_seeds scene|model|link|modbus|console|mcap FOLDER DICTIONARY
#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/crc32.hpp"
#include "console/console.hpp"
#include "link/command_frame.hpp"
#include "store/models.hpp"
#include "store/settings.hpp"
#include "tests/fuzz/link_check.hpp"
#include "tests/fuzz/mcap_check.hpp"
#include "tests/fuzz/modbus_check.hpp"
#include "tests/fuzz/model_check.hpp"
#include "tests/fuzz/scene_check.hpp"

using namespace holdfast;

namespace {

struct Start {
  std::vector<std::string> seeds;
  std::string dictionary;

  void add(std::string_view word) { dictionary.append("\"").append(word).append("\"\n"); }
};

Start of_scenes() {
  Start start{test::scene_seeds(), ""};
  const auto add = [&](std::string_view word) { start.add("\\\"" + std::string(word) + "\\\""); };
  for (const scene::FieldInfo& field : scene::scene_fields()) add(field.path.substr(field.path.rfind('.') + 1));
  for (const auto section : {"level", "gel", "markers", "object", "texture", "effects", "picture", "expect", "goal"})
    add(section);
  for (const auto name : scene::kInjectNames) add(name);
  for (const auto name : scene::kContactLevelNames) add(name);
  for (const auto name : scene::kShapeNames) add(name);
  for (const auto name : scene::kTextureNames) add(name);
  for (const auto name : scene::kFaultNames) add(name);
  return start;
}

Start of_models() {
  Start start;
  for (const test::ModelBytes& bytes : test::model_seeds()) {
    std::string cut(bytes.begin(), bytes.begin() + 5228);  // the fuzzer puts the check sum back
    start.seeds.push_back(cut.erase(cut.find_last_not_of('\0') + 1));
  }
  for (const FeatureSet& set : kFeatureSets) start.add(set.name);
  for (const FeatureInfo& feature : kFeatures) start.add(feature.name);
  return start;
}

template <typename Seeds>
Start of_bytes(const Seeds& seeds, std::initializer_list<std::string_view> words) {
  Start start;
  for (const auto& bytes : seeds) start.seeds.emplace_back(bytes.begin(), bytes.end());
  for (const std::string_view word : words) start.add(word);
  return start;
}

Start of_mcap() {
  Start start = of_bytes(test::mcap_seeds(), {"\\x89MCAP0\\x0d\\x0a", "ros2", "ros2msg", "cdr", "lz4", "zstd", "jpeg"});
  for (const char op : std::string_view("123456789abcdef")) {  // opcode and the high bytes of a small length
    start.add(std::string("\\x0") + op + "\\x10\\x00\\x00\\x00\\x00\\x00\\x00\\x00");
  }
  return start;
}

// Every command, locked and not, edited lines, frames among text, stored parameters and models.
Start of_console() {
  Start start;
  std::vector<std::string>& seeds = start.seeds;
  std::string all;
  for (const console::CommandInfo& command : console::commands()) {
    const std::string name(command.name);
    seeds.push_back(std::string("\x01") + name + "\r");
    seeds.push_back(std::string("\x02") + name + " json\r");
    start.add(name + " ");
    all += name + "\r\n";
  }
  for (const ParamInfo& row : kParams) {
    seeds.push_back(std::string("\x01") + "set " + std::string(row.name) + " " + std::to_string(row.max) + "\r");
    start.add(row.name);
  }
  for (const char* const text :
       {"\x1B[A", "\x1B[C", "\x1B[D", "\x1B[3~", "\x17", "\x0B", "\x09", "\x03", " json\r", "watch on\r"}) {
    std::string escaped;
    for (const char* c = text; *c != 0; ++c) {
      std::array<char, 8> code{};
      (void)std::snprintf(code.data(), code.size(), "\\x%02X", static_cast<unsigned>(static_cast<unsigned char>(*c)));
      escaped += code.data();
    }
    start.add(escaped);
  }
  seeds.push_back("\x01" + all);
  seeds.push_back(std::string("\x01") + "vesrion\x1B[D\x1B[D\x1B[D\x7Frs\x05\r\x1B[A\r");
  seeds.push_back(std::string("\x01") + "log fr\t m\tjson\rwatch on\rtrace on\rwatch off\r");
  std::array<std::uint8_t, command_frame::kCommandBytes> wire{};
  command_frame::encode(command_frame::CommandFrame{5, command_frame::Command::kOpening, 1}, wire);
  std::string among("\x01watch on\r\0", 11);
  seeds.push_back(among + std::string(wire.begin(), wire.end()) + "status\r");
  // Two slots, and the lines that load the second of them.
  std::string slots;
  std::vector<std::uint8_t> record;
  Params params;
  params.raise_frames = 5;
  for (std::uint32_t sequence = 1; sequence <= 2; ++sequence) {
    std::vector<std::uint8_t> payload(settings::kMostPayload);
    payload.resize(settings::write(params, payload));
    record.assign(payload.size() + sealed::kAround, 0);
    (void)sealed::write(sealed::Kind::kSettings, sequence, payload, record);
    slots += std::string(record.begin(), record.end());
    if (sequence == 1) slots.resize(slots.size() + settings::kEntryBytes);  // both halves are as long
    params.hold_ms = 900;
  }
  seeds.push_back("\xF0" + slots);
  const auto in_hex = [](std::uint64_t value, int digits) {
    std::array<char, 20> text{};
    (void)std::snprintf(text.data(), text.size(), "%0*llX", digits, static_cast<unsigned long long>(value));
    return std::string(text.data());
  };
  const auto load = [&](const char* first, std::span<const std::uint8_t> bytes) {
    std::string lines = std::string("\x01") + first + "\r";
    for (std::size_t at = 0; at < bytes.size(); at += 100) {
      lines += "load " + std::to_string(at) + " ";
      for (const std::uint8_t byte : bytes.subspan(at, std::min<std::size_t>(100, bytes.size() - at))) {
        lines += in_hex(byte, 2);
      }
      lines += "\r";
    }
    seeds.push_back(lines + "load end " + in_hex(crc32(bytes), 8) + "\r");
  };
  load("load settings", record);
  // A model in the first slot and none in the second, the other way round, and the lines that load the latter.
  const FeatureSet& set = *find_feature_set("paper");
  std::vector<std::uint8_t> model(models::kMostBytes), none(sealed::kAround);
  (void)sealed::write(sealed::Kind::kModel, 7, test::model_bytes(set, test::RandomNodes(1, set, 3, 15).nodes()), model);
  (void)sealed::write(sealed::Kind::kModel, 8, {}, none);
  load("load model", none);
  model.resize(1700);  // behind its nodes there are zeros, and what the fuzzer puts right
  seeds.emplace_back("\x01model default\rmodel json\r");
  none.resize(model.size());
  seeds.push_back("\xE0" + std::string(model.begin(), model.end()) + std::string(none.begin(), none.end()));
  seeds.push_back("\xE0" + std::string(none.begin(), none.end()) + std::string(model.begin(), model.end()));
  return start;
}

bool write(const std::string& path, const std::string& bytes) {
  std::ofstream file(path, std::ios::binary);
  file << bytes;
  if (file.flush()) return true;
  std::fprintf(stderr, "error: cannot write %s (no such folder, or the disk is full). Next: make the folder\n",
               path.c_str());
  return false;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string_view target = argc == 4 ? argv[1] : "";
  const Start start = target == "scene"   ? of_scenes()
                      : target == "model" ? of_models()
                      : target == "link" ? of_bytes(test::link_seeds(), {"\\x00\\x04\\x01\\x01", "\\x00\\x05\\x01\\x02",
                                                                         "\\x00\\x05\\x01\\x03", "help\\x0a"})
                      : target == "modbus"
                          ? of_bytes(test::modbus_seeds(),
                                     {"\\x09\\x04\\x06", "\\x09\\x84", "\\x09\\x10\\x03\\xE8\\x00\\x03\\x01\\x30"})
                      : target == "mcap"    ? of_mcap()
                      : target == "console" ? of_console()
                                            : Start{};
  if (start.seeds.empty()) {
    std::fprintf(stderr, "usage: fuzz_seeds scene|model|link|modbus|console|mcap FOLDER DICTIONARY\n");
    return 2;
  }
  for (std::size_t k = 0; k < start.seeds.size(); ++k) {
    if (!write(argv[2] + ("/seed_" + std::to_string(k)), start.seeds[k])) return 1;
  }
  return write(argv[3], start.dictionary) ? 0 : 1;
}
