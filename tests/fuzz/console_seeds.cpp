// SPDX-License-Identifier: Apache-2.0
// console_seeds FOLDER DICTIONARY: every command, locked and not, edited lines, frames among text, stored parameters
// and models; and the words of the console.
#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <span>
#include <string>
#include <vector>

#include "base/crc32.hpp"
#include "console/console.hpp"
#include "link/command_frame.hpp"
#include "store/models.hpp"
#include "store/settings.hpp"
#include "tests/fuzz/model_check.hpp"
#include "tests/fuzz/seed_file.hpp"

using namespace holdfast;

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: console_seeds FOLDER DICTIONARY\n");
    return 2;
  }
  std::vector<std::string> seeds;
  std::string dictionary;
  std::string all;
  for (const console::CommandInfo& command : console::commands()) {
    const std::string name(command.name);
    seeds.push_back(std::string("\x01") + name + "\r");
    seeds.push_back(std::string("\x02") + name + " json\r");
    dictionary += "\"" + name + " \"\n";
    all += name + "\r\n";
  }
  for (const ParamInfo& row : kParams) {
    seeds.push_back(std::string("\x01") + "set " + std::string(row.name) + " " + std::to_string(row.max) + "\r");
    dictionary += "\"" + std::string(row.name) + "\"\n";
  }
  for (const char* const text :
       {"\x1B[A", "\x1B[C", "\x1B[D", "\x1B[3~", "\x17", "\x0B", "\x09", "\x03", " json\r", "watch on\r"}) {
    std::string escaped;
    for (const char* c = text; *c != 0; ++c) {
      std::array<char, 8> code{};
      (void)std::snprintf(code.data(), code.size(), "\\x%02X", static_cast<unsigned>(static_cast<unsigned char>(*c)));
      escaped += code.data();
    }
    dictionary += "\"" + escaped + "\"\n";
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
  for (std::size_t k = 0; k < seeds.size(); ++k) {
    if (!test::write_seed(argv[1] + ("/seed_" + std::to_string(k)), seeds[k])) return 1;
  }
  return test::write_seed(argv[2], dictionary) ? 0 : 1;
}
