// SPDX-License-Identifier: Apache-2.0
#include "drivers/common/gpio_wiring.hpp"

#include <algorithm>
#include <array>
#include <numeric>
#include <utility>
#include <vector>

#include "drivers/common/trouble.hpp"

namespace holdfast::drivers {
namespace {

constexpr std::array<std::string_view, hal::kLineCount> kLineNames{"GRIP_OK", "ALIVE", "INCREASE", "DECREASE"};
constexpr std::array<std::string_view, hal::kInputCount> kInputNames{"TARE", "OPENING", "RELEASE", "ARM"};
constexpr std::size_t kNamesTold = 3;

std::string in_quotes(std::string_view text) {
  return "'" + std::string(text) + "'";
}

std::string listed(const ChipInfo& chip) {
  return std::string(chip.name) + " (" + std::string(chip.label) + ", " + std::to_string(chip.lines.size()) + " lines)";
}

std::string listed(std::span<const ChipInfo> chips) {
  std::string out;
  for (const ChipInfo& chip : chips) out += (out.empty() ? "" : ", ") + listed(chip);
  return out.empty() ? "no GPIO chip" : out;
}

std::string wanted(const Wiring& wiring) {
  std::string out = std::string(name_of(wiring.role)) + ": ";
  if (wiring.line.empty())
    return out + "offset " + std::to_string(wiring.offset) + " of chip " + in_quotes(wiring.chip);
  return out + "line " + in_quotes(wiring.line) + (wiring.chip.empty() ? "" : " of chip " + in_quotes(wiring.chip));
}

Found refusal(const Wiring& wiring, const std::string& what, const std::string& cause, const std::string& next) {
  return {{}, trouble(wanted(wiring) + ": " + what, cause, next)};
}

char lower(char letter) {
  return letter >= 'A' && letter <= 'Z' ? static_cast<char>(letter - 'A' + 'a') : letter;
}

// How many letters differ, are missing or too many; upper and lower case are the same.
std::size_t distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = std::exchange(row[0], i + 1);
    for (std::size_t k = 0; k < b.size(); ++k) {
      const std::size_t changed = diagonal + (lower(a[i]) == lower(b[k]) ? 0 : 1);
      diagonal = std::exchange(row[k + 1], std::min({changed, row[k] + 1, row[k + 1] + 1}));
    }
  }
  return row.back();
}

// The chip's names that look most like `name`.
std::string nearest(std::span<const ChipInfo> chips, std::string_view name) {
  std::vector<std::pair<std::size_t, std::string_view>> names;
  for (const ChipInfo& chip : chips) {
    for (const LineInfo& line : chip.lines) {
      if (!line.name.empty()) names.emplace_back(distance(line.name, name), line.name);
    }
  }
  std::stable_sort(names.begin(), names.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  std::string out;
  for (std::size_t i = 0; i < std::min(names.size(), kNamesTold); ++i) {
    out += (i == 0 ? "" : ", ") + in_quotes(names[i].second);
  }
  return out.empty() ? "none of their lines has a name" : "nearest names: " + out;
}

// A chip that is listed under two device files is one chip: Raspberry Pi OS links gpiochip4 to gpiochip0 on a Pi 5.
bool listed_before(std::span<const ChipInfo> chips, std::size_t index) {
  const auto before = chips.first(index);
  return std::any_of(before.begin(), before.end(),
                     [&](const ChipInfo& chip) { return chip.name == chips[index].name; });
}

std::vector<Place> places_of(std::span<const ChipInfo> chips, const Wiring& wiring) {
  std::vector<Place> places;
  for (std::size_t c = 0; c < chips.size(); ++c) {
    const ChipInfo& chip = chips[c];
    if ((!wiring.chip.empty() && chip.label != wiring.chip) || listed_before(chips, c)) continue;
    for (std::size_t k = 0; k < chip.lines.size(); ++k) {
      const auto offset = static_cast<std::uint32_t>(k);
      if (wiring.line.empty() ? offset == wiring.offset : chip.lines[k].name == wiring.line) {
        places.push_back({c, offset});
      }
    }
  }
  return places;
}

}  // namespace

std::string_view name_of(const Role& role) {
  if (const auto* const line = std::get_if<hal::Line>(&role)) return kLineNames[static_cast<std::size_t>(*line)];
  return kInputNames[static_cast<std::size_t>(*std::get_if<hal::Input>(&role))];
}

Found find(std::span<const ChipInfo> chips, const Wiring& wiring) {
  if (wiring.line.empty() && (wiring.chip.empty() || wiring.offset == kNoOffset)) {
    return refusal(wiring, "neither a line's name nor a chip's label with an offset",
                   "a row of the table is not filled", "give one of them in the board's wiring table");
  }
  const bool chip_found = std::any_of(chips.begin(), chips.end(), [&](const ChipInfo& chip) {
    return wiring.chip.empty() || chip.label == wiring.chip;
  });
  if (chips.empty() || !chip_found) {
    return refusal(wiring, "no such chip; there is " + listed(chips),
                   "another board, or /dev/gpiochip* may not be read",
                   "compare with `gpiodetect`; run on the board that the table is for, in the group gpio");
  }
  const std::vector<Place> places = places_of(chips, wiring);
  if (places.empty() && wiring.line.empty()) {
    return refusal(wiring, "the chip has no such line; there is " + listed(chips), "a typing error in the wiring table",
                   "give an offset from 0 on, below the number of its lines");
  }
  if (places.empty()) {
    return refusal(wiring, "no such line; there is " + listed(chips) + "; " + nearest(chips, wiring.line),
                   "a typing error, another board, or a kernel that names its lines otherwise",
                   "compare with `gpioinfo`; where lines have no names give the chip's label and the offset");
  }
  if (places.size() > 1) {
    std::string where;
    for (const Place& place : places) {
      where += (where.empty() ? "" : " and ") + ("line " + std::to_string(place.offset)) + " of " +
               listed(chips[place.chip]);
    }
    return refusal(wiring, "ambiguous: " + where, "a second GPIO chip uses the same name",
                   "give the chip's label as well, or its label and the offset");
  }
  const Place place = places.front();
  const LineInfo& line = chips[place.chip].lines[place.offset];
  if (line.used) {
    Found found = refusal(wiring,
                          "line " + std::to_string(place.offset) + " of " + listed(chips[place.chip]) + " is used by " +
                              (line.user.empty() ? "someone whom the kernel does not name" : in_quotes(line.user)),
                          "another process holds the line, or a device of the kernel is on this pin",
                          "end that process, take its dtoverlay out of config.txt, or wire another pin");
    found.held = true;
    return found;
  }
  return {place, ""};
}

std::string find_all(std::span<const ChipInfo> chips, std::span<const Wiring> table, std::span<Place> places) {
  for (std::size_t i = 0; i < table.size(); ++i) {
    Found found = find(chips, table[i]);
    if (!found.ok()) return std::move(found.error);
    for (std::size_t k = 0; k < i; ++k) {
      if (places[k] == found.place) {
        return refusal(table[i], "the same line as " + std::string(name_of(table[k].role)),
                       "a typing error in the wiring table", "give each row a line of its own")
            .error;
      }
    }
    places[i] = found.place;
  }
  return "";
}

}  // namespace holdfast::drivers
