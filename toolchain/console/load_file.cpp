// SPDX-License-Identifier: Apache-2.0
#include "toolchain/console/load_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>

#include "base/crc32.hpp"
#include "drivers/common/input_file.hpp"
#include "drivers/common/trouble.hpp"
#include "store/models.hpp"
#include "store/sealed.hpp"
#include "store/settings.hpp"

namespace holdfast::console_tool {
namespace {

// With its offset it fits a line of 255.
constexpr std::size_t kPiece = 120;

bool is_of(std::span<const std::uint8_t> bytes, sealed::Kind kind) {
  return bytes.size() > sealed::kKindAt && bytes[sealed::kKindAt] == static_cast<std::uint8_t>(kind);
}

}  // namespace

std::vector<std::string> load_lines(std::span<const std::uint8_t> bytes) {
  std::vector<std::string> lines{is_of(bytes, sealed::Kind::kModel) ? "load model" : "load settings"};
  for (std::size_t at = 0; at < bytes.size(); at += kPiece) {
    std::string line = fmt::format("load {} ", at);
    for (const std::uint8_t byte : bytes.subspan(at, std::min(kPiece, bytes.size() - at))) {
      line += fmt::format("{:02X}", byte);
    }
    lines.push_back(std::move(line));
  }
  lines.push_back(fmt::format("load end {:08X}", crc32(bytes)));
  return lines;
}

std::string load(Device& device, const std::string& path, std::vector<std::string>& report) {
  constexpr std::string_view kGive = "give what holdfast settings compile or holdfast model seal wrote";
  std::ifstream in;
  if (std::string wrong = drivers::open_file(path, kGive, in); !wrong.empty()) return wrong;
  std::vector<char> text(std::max(settings::kMostBytes, models::kMostBytes) + 1);
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  const std::span<const std::uint8_t> bytes(reinterpret_cast<const std::uint8_t*>(text.data()),
                                            static_cast<std::size_t>(std::max<std::streamsize>(in.gcount(), 0)));
  sealed::Record record;
  const sealed::Kind kind = is_of(bytes, sealed::Kind::kModel) ? sealed::Kind::kModel : sealed::Kind::kSettings;
  if (in.bad() || sealed::read(bytes, kind, nullptr, record) != sealed::Refusal::kNone ||
      record.bytes != bytes.size()) {
    return trouble(path + ": is nothing that a device loads", "a bad copy, or another one was meant", kGive);
  }
  for (const std::string& line : load_lines(bytes)) {
    const Answer answer = device.say(line);
    if (answer.ok()) continue;
    (void)device.say("load off");
    return answer.error;
  }
  report.push_back(fmt::format("{}: stored, number {}, {}; counts at the next start: reboot", path, record.sequence,
                               record.is_signed ? "signed" : "not signed"));
  return {};
}

}  // namespace holdfast::console_tool
