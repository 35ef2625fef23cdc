// SPDX-License-Identifier: Apache-2.0
#include "drivers/common/gpio_wiring.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include <CppUTest/TestHarness.h>
// after it: it checks
#include "tests/support/error_line.hpp"

using namespace holdfast;
using drivers::ChipInfo;
using drivers::Found;
using drivers::LineInfo;
using drivers::Place;
using drivers::Wiring;
using hal::Input;
using hal::Line;
using test::check_says;

namespace {

// A chip with lines of its own; ChipInfo only points.
struct Chip {
  std::string name;
  std::string label;
  std::vector<std::string> names;
  std::vector<LineInfo> lines;

  Chip(int number, std::string label_of, std::size_t count)
      : name("gpiochip" + std::to_string(number)), label(std::move(label_of)), names(count), lines(count) {}
  // The 40-pin header, as Raspberry Pi OS names it.
  Chip& with_header() {
    names[0] = "ID_SDA";
    names[1] = "ID_SCL";
    for (std::size_t i = 2; i < 28; ++i) names[i] = "GPIO" + std::to_string(i);
    return *this;
  }
};

std::vector<ChipInfo> listed(std::vector<Chip>& chips) {
  std::vector<ChipInfo> out;
  for (Chip& chip : chips) {
    for (std::size_t i = 0; i < chip.lines.size(); ++i) chip.lines[i].name = chip.names[i];
    out.push_back({chip.name, chip.label, chip.lines});
  }
  return out;
}

std::vector<Chip> pi4() {
  return {Chip(0, "pinctrl-bcm2711", 58).with_header(), Chip(1, "raspberrypi-exp-gpio", 8)};
}

// `header`: the number of the header's chip, 4 with older kernels and 0 with newer ones.
std::vector<Chip> pi5(int header) {
  std::vector<Chip> chips;
  int number = 10;
  for (const auto& [label, count] : {std::pair("gpio-brcmstb@107d508500", 32), {"gpio-brcmstb@107d517c00", 15}}) {
    chips.emplace_back(number++, label, static_cast<std::size_t>(count));
  }
  chips.push_back(Chip(header, "pinctrl-rp1", 54).with_header());
  return chips;
}

constexpr Wiring kByName{.role = Line::kGripOk, .line = "GPIO17", .chip = ""};

}  // namespace

TEST_GROUP(GpioWiring){};

TEST(GpioWiring, NamesAreFoundWhateverTheChipsNumber) {
  std::mt19937 random(1);
  for (int round = 0; round < 50; ++round) {
    for (std::vector<Chip> chips : {pi4(), pi5(0), pi5(4), pi5(13)}) {
      std::shuffle(chips.begin(), chips.end(), random);
      const std::vector<ChipInfo> all = listed(chips);
      const Found found = find(all, kByName);
      CHECK_TRUE(found.ok());
      LONGS_EQUAL(17, found.place.offset);
      CHECK_TRUE(chips[found.place.chip].names[17] == "GPIO17");
    }
  }
}

TEST(GpioWiring, LabelAndOffsetAreEnoughWithoutNames) {
  std::vector<Chip> chips{Chip(1, "raspberrypi-exp-gpio", 8), Chip(7, "pinctrl-bcm2835", 54)};
  const std::vector<ChipInfo> all = listed(chips);
  const Found found = find(all, {.role = Line::kAlive, .line = "", .chip = "pinctrl-bcm2835", .offset = 53});
  CHECK_TRUE(found.ok());
  CHECK_TRUE((found.place == Place{1, 53}));
  check_says(find(all, {.role = Line::kAlive, .line = "", .chip = "pinctrl-bcm2835", .offset = 54}).error,
             {"ALIVE: offset 54 of chip 'pinctrl-bcm2835'", "no such line", "gpiochip7 (pinctrl-bcm2835, 54 lines)"});
}

TEST(GpioWiring, WhatIsNotThereIsRefusedWithWhatIs) {
  std::vector<Chip> chips = pi4();
  const std::vector<ChipInfo> all = listed(chips);
  check_says(find(all, {.role = Input::kOpening, .line = "gpio_17", .chip = ""}).error,
             {"OPENING: line 'gpio_17'", "no such line", "gpiochip0 (pinctrl-bcm2711, 58 lines)",
              "gpiochip1 (raspberrypi-exp-gpio, 8 lines)", "nearest names: 'GPIO17', "});
  check_says(find(all, {.role = Line::kGripOk, .line = "", .chip = "pinctrl-rp1", .offset = 17}).error,
             {"GRIP_OK: offset 17 of chip 'pinctrl-rp1'", "no such chip", "pinctrl-bcm2711", "another board"});
  check_says(find({}, kByName).error, {"no such chip", "no GPIO chip"});
  // A line that has no name is not found by none.
  check_says(find(all, {.role = Line::kGripOk, .line = "", .chip = ""}).error, {"neither"});
  check_says(find(all, {.role = Line::kGripOk, .line = "", .chip = "pinctrl-bcm2711"}).error, {"neither"});
  // The other chip has the name, the one asked for has not: the label decides.
  check_says(find(all, {.role = Line::kGripOk, .line = "GPIO17", .chip = "raspberrypi-exp-gpio"}).error,
             {"no such line"});
  std::vector<Chip> nameless{Chip(0, "pinctrl-bcm2711", 58)};
  check_says(find(listed(nameless), kByName).error, {"none of their lines has a name", "the chip's label and the"});
}

// By the letters that differ, are missing or too many; upper and lower case are the same. Of equal ones the first.
TEST(GpioWiring, TheNearestNameComesFirst) {
  std::vector<Chip> chips{Chip(0, "chip", 2)};
  for (const auto& [asked, one, other, nearest] : {std::array{"a1", "B1", "A1", "'A1', 'B1'"},
                                                   {"z1", "Y1", "Z1", "'Z1', 'Y1'"},
                                                   {"GPIO1", "GPI317", "GPIO17", "'GPIO17', 'GPI317'"},
                                                   {"ab", "abc", "xab", "'abc', 'xab'"}}) {
    chips[0].names = {one, other};
    check_says(find(listed(chips), {.role = Line::kGripOk, .line = asked, .chip = ""}).error,
               {std::string("nearest names: ") + nearest});
  }
}

TEST(GpioWiring, TwoLinesOfOneNameAreAmbiguousUnlessTheLabelDecides) {
  std::vector<Chip> chips = pi4();
  chips.emplace_back(2, "20-0020", 8).names[3] = "GPIO17";  // an expander with names from its overlay
  check_says(find(listed(chips), kByName).error,
             {"ambiguous", "line 17 of gpiochip0", "line 3 of gpiochip2 (20-0020, 8 lines)"});
  Wiring wiring = kByName;
  wiring.chip = "20-0020";
  CHECK_TRUE((find(listed(chips), wiring).place == Place{2, 3}));
  wiring.chip = "pinctrl-bcm2711";
  CHECK_TRUE((find(listed(chips), wiring).place == Place{0, 17}));
  // Two expanders of one label: an offset says nothing.
  chips.emplace_back(3, "20-0020", 8);
  check_says(find(listed(chips), {.role = Line::kAlive, .line = "", .chip = "20-0020", .offset = 1}).error,
             {"ambiguous", "gpiochip2", "gpiochip3"});
}

TEST(GpioWiring, OneChipUnderTwoDeviceFilesIsOneChip) {
  std::vector<Chip> chips = pi5(0);
  chips.push_back(Chip(0, "pinctrl-rp1", 54).with_header());  // gpiochip4, a link
  const Found found = find(listed(chips), kByName);
  CHECK_TRUE(found.ok());
  CHECK_TRUE((found.place == Place{2, 17}));
}

TEST(GpioWiring, LineOfAnotherIsRefused) {
  std::vector<Chip> chips = pi4();
  chips[0].lines[17].used = true;
  check_says(find(listed(chips), kByName).error, {"line 17 of gpiochip0", "is used by someone"});
  chips[0].lines[17].user = "pigpiod";
  check_says(find(listed(chips), kByName).error, {"is used by 'pigpiod'"});
  check_says(find(listed(chips), {.role = Line::kGripOk, .line = "", .chip = "pinctrl-bcm2711", .offset = 17}).error,
             {"is used by 'pigpiod'"});
}

TEST(GpioWiring, WholeTableIsFoundOrRefused) {
  std::vector<Chip> chips = pi5(4);
  const std::vector<ChipInfo> all = listed(chips);
  std::array<Wiring, 3> table{{{.role = Line::kGripOk, .line = "GPIO17", .chip = "", .active_low = true},
                               {.role = Line::kAlive, .line = "", .chip = "pinctrl-rp1", .offset = 27},
                               {.role = Input::kArm, .line = "GPIO22", .chip = "pinctrl-rp1"}}};
  std::array<Place, 3> places{};
  STRCMP_EQUAL("", find_all(all, table, places).c_str());
  CHECK_TRUE((places == std::array<Place, 3>{{{2, 17}, {2, 27}, {2, 22}}}));
  table[2] = {.role = Input::kArm, .line = "GPIO27", .chip = ""};
  check_says(find_all(all, table, places), {"ARM: line 'GPIO27'", "the same line as ALIVE"});
  table[1].offset = 99;
  check_says(find_all(all, table, places), {"ALIVE: offset 99"});
}

TEST(GpioWiring, EveryRoleHasItsName) {
  std::vector<std::string_view> names(hal::kLineCount + hal::kInputCount);
  for (std::size_t i = 0; i < names.size(); ++i) {
    const bool line = i < hal::kLineCount;
    names[i] =
        line ? drivers::name_of(static_cast<Line>(i)) : drivers::name_of(static_cast<Input>(i - hal::kLineCount));
  }
  const std::vector<std::string_view> want{"GRIP_OK", "ALIVE",   "INCREASE", "DECREASE",
                                           "TARE",    "OPENING", "RELEASE",  "ARM"};
  CHECK_TRUE(names == want);
}
