// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/piece.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cstddef>
#include <istream>
#include <ostream>

namespace holdfast::learn {
namespace {

constexpr std::string_view kHead = "holdfast evaluation piece,1,";
constexpr std::string_view kDigits = "0123456789abcdef";

// The number up to the next comma, which goes with it; no value: there is none.
template <typename Number>
std::optional<Number> taken(std::string_view& line, int base = 10) {
  Number value{};
  const auto [end, error] = std::from_chars(line.data(), line.data() + line.size(), value, base);
  if (error != std::errc{}) return std::nullopt;
  line.remove_prefix(static_cast<std::size_t>(end - line.data()));
  if (line.starts_with(',')) line.remove_prefix(1);
  return value;
}

std::optional<std::vector<std::uint8_t>> verdicts_of(std::string_view digits, std::size_t rows) {
  if (digits.size() != (rows + 3) / 4) return std::nullopt;
  std::vector<std::uint8_t> verdicts(rows);
  for (std::size_t i = 0; i < rows; ++i) {
    const std::size_t digit = kDigits.find(digits[i / 4]);
    if (digit == std::string_view::npos) return std::nullopt;
    verdicts[i] = static_cast<std::uint8_t>(digit >> (i % 4) & 1U);
  }
  return verdicts;
}

}  // namespace

void write_piece(std::ostream& out, const Piece& piece) {
  out << kHead << fmt::format("{:08x}\n", piece.run);
  for (const auto& [number, verdicts] : piece.said) {
    std::string digits((verdicts.size() + 3) / 4, '0');
    for (std::size_t i = 0; i < verdicts.size(); i += 4) {
      std::size_t digit = 0;
      for (std::size_t k = i; k < std::min(i + 4, verdicts.size()); ++k) digit |= std::size_t{verdicts[k]} << (k - i);
      digits[i / 4] = kDigits[digit];
    }
    out << fmt::format("{},{},{}\n", number, verdicts.size(), digits);
  }
  out << "end\n";
}

std::optional<std::string> read_piece(std::istream& in, std::string_view name, Piece& all) {
  int at = 1;
  const auto wrong = [&](std::string_view what, std::string_view cause, std::string_view next) {
    return fmt::format("{}:{}: {}. Likely cause: {}. Next: {}", name, at, what, cause, next);
  };
  std::string text;
  std::string_view line;
  const auto next_line = [&] {
    const bool there = static_cast<bool>(std::getline(in, text));
    line = text;
    return there;
  };
  if (!next_line() || !line.starts_with(kHead)) {
    return wrong("no piece of an evaluation", "another file, or of another version",
                 "give what holdfast evaluate --piece wrote");
  }
  line.remove_prefix(kHead.size());
  const auto run = taken<std::uint32_t>(line, 16);
  if (!run || !line.empty()) return wrong("no run", "the file was edited", "make that piece again");
  if (!all.said.empty() && *run != all.run) {
    return wrong("another run than the pieces before it", "made from other data or with other options",
                 "make it again with theirs");
  }
  all.run = *run;
  while (++at, next_line()) {
    if (line == "end") return std::nullopt;
    const auto number = taken<long>(line);
    const auto rows = number ? taken<std::uint32_t>(line) : std::nullopt;
    const auto verdicts = rows ? verdicts_of(line, *rows) : std::nullopt;
    if (!verdicts) return wrong("no verdicts", "the file was cut off or edited", "make that piece again");
    if (!all.said.emplace(*number, *verdicts).second) {
      return wrong(fmt::format("classifier {} is there twice", *number), "a piece given twice",
                   "give each of the N pieces once");
    }
  }
  return wrong("no end", "the file was cut off", "make that piece again");
}

}  // namespace holdfast::learn
