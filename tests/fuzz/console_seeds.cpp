// SPDX-License-Identifier: Apache-2.0
// console_seeds FOLDER DICTIONARY: every command, locked and not, edited lines, frames among text, stored parameters;
// and the words of the console.
#include <array>
#include <cstdint>
#include <cstdio>
#include <string>
#include <vector>

#include "app/command_frame.hpp"
#include "app/settings.hpp"
#include "base/crc32.hpp"
#include "console/console.hpp"
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
  std::string lines = "\x01load settings\rload 0 ";
  for (const std::uint8_t byte : record) lines += in_hex(byte, 2);
  lines += "\rload end " + in_hex(crc32(record), 8) + "\r";
  seeds.push_back(lines);
  for (std::size_t k = 0; k < seeds.size(); ++k) {
    if (!test::write_seed(argv[1] + ("/seed_" + std::to_string(k)), seeds[k])) return 1;
  }
  return test::write_seed(argv[2], dictionary) ? 0 : 1;
}
