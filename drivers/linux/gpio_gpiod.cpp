// SPDX-License-Identifier: Apache-2.0
#include "drivers/linux/gpio_gpiod.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <utility>
#include <variant>
#include <vector>

#include "drivers/common/trouble.hpp"

namespace holdfast::drivers {
namespace {

// All chips, as the kernel tells of them. ChipInfo only points, so both lists live as long as it is used.
struct Census {
  std::vector<gpiod::KernelChip> chips;
  std::vector<std::vector<LineInfo>> lines;
  std::vector<ChipInfo> infos;
  std::string refused;     // the first device file that does not open, with the reason
  bool forbidden = false;  // that reason is a missing right
};

Census take_census(const std::string& devices) {
  Census census;
  std::vector<std::string> paths;
  std::error_code error;
  for (std::filesystem::directory_iterator entry(devices, error), end; !error && entry != end; entry.increment(error)) {
    if (entry->path().filename().string().starts_with("gpiochip")) paths.push_back(entry->path().string());
  }
  std::sort(paths.begin(), paths.end());
  for (const std::string& path : paths) {
    gpiod::KernelChip chip;
    const int failed = gpiod::ask(path, chip);
    if (failed == 0) {
      census.chips.push_back(std::move(chip));
    } else if (census.refused.empty()) {
      census.refused = path + ": " + std::strerror(failed);
      census.forbidden = failed == EACCES || failed == EPERM;
    }
  }
  for (const gpiod::KernelChip& chip : census.chips) {
    std::vector<LineInfo>& lines = census.lines.emplace_back();
    for (const gpiod::KernelLine& line : chip.lines) lines.push_back({line.name, line.used, line.user});
  }
  for (std::size_t i = 0; i < census.chips.size(); ++i) {
    census.infos.push_back({census.chips[i].name, census.chips[i].label, census.lines[i]});
  }
  return census;
}

// A chip that does not open looks like one that is not there.
std::string with_refusal(std::string error, const Census& census) {
  if (census.refused.empty()) return error;
  const std::string what = census.refused + " (then: " + error.substr(0, error.find(". Likely cause: ")) + ")";
  if (!census.forbidden) {
    return trouble(what, "this device file is no GPIO chip, or its chip is just going", "compare with `gpiodetect`");
  }
  return trouble(what, "the user of this process is not in the group gpio",
                 "add it (usermod -aG gpio NAME, or SupplementaryGroups=gpio in the unit) and start again");
}

std::string refusal(const Wiring& wiring, const Place& place, const Census& census, int failed) {
  const gpiod::KernelChip& chip = census.chips[place.chip];
  const std::string line = std::string(name_of(wiring.role)) + ": line " + std::to_string(place.offset) + " of " +
                           chip.name + " (" + chip.label + "): ";
  if (failed == EBUSY) {
    return trouble(line + "taken by another process between the look and the request", "two programs start at once",
                   "see `gpioinfo " + chip.name + "`, end the other one and start again");
  }
  return trouble(line + "the kernel refused it: " + std::strerror(failed),
                 "this chip cannot use the line so (direction, or a pin that belongs to a device)",
                 "compare with `gpioinfo " + chip.name + "` and the kernel log, or wire another pin");
}

// Requests a line, an output LOW. Returns the kernel's errno, and says in `error` why the line is not what it should
// be.
int take(const Census& census, const Wiring& wiring, const Place& place, const std::string& consumer,
         gpiod::HeldLine& slot, std::string& error) {
  const bool output = std::holds_alternative<hal::Line>(wiring.role);
  const gpiod::Wish wish{place.offset, consumer + ":" + std::string(name_of(wiring.role)), output, wiring.active_low,
                         !output};
  const int failed = gpiod::request(census.chips[place.chip].path, wish, slot);
  if (failed != 0) {
    error = refusal(wiring, place, census, failed);
  } else if (output && gpiod::read(*slot) != 0) {
    error = trouble(std::string(name_of(wiring.role)) + ": told LOW, and does not read LOW",
                    "the wire is shorted or driven from outside, or the chip cannot read its outputs back",
                    "measure the pin with the wire off");
  }
  return failed;
}

}  // namespace

gpiod::HeldLine& GpiodGpio::slot_of(const Role& role) {
  if (const auto* const line = std::get_if<hal::Line>(&role)) return outputs_[static_cast<std::size_t>(*line)];
  return inputs_[static_cast<std::size_t>(*std::get_if<hal::Input>(&role))];
}

std::string GpiodGpio::open(const Config& config) {
  close();
  const Census census = take_census(config.devices);
  std::vector<Place> places(config.wiring.size());
  std::string error = find_all(census.infos, config.wiring, places);
  if (!error.empty()) return with_refusal(std::move(error), census);
  for (std::size_t i = 0; i < config.wiring.size(); ++i) {
    const Wiring& wiring = config.wiring[i];
    gpiod::HeldLine& slot = slot_of(wiring.role);
    if (slot != nullptr) {
      error = trouble(std::string(name_of(wiring.role)) + ": two rows of the table",
                      "a typing error in the wiring table", "leave one row for each role");
    } else {
      (void)take(census, wiring, places[i], config.consumer, slot, error);
    }
    if (!error.empty()) {
      close();
      return error;
    }
  }
  return "";
}

void GpiodGpio::close() {
  for (gpiod::HeldLine& line : outputs_) {
    if (line != nullptr) (void)gpiod::write(*line, false);
    line.reset();
  }
  for (gpiod::HeldLine& line : inputs_) line.reset();
}

GpiodGpio::Lowered GpiodGpio::lower(const Config& config) {
  const Census census = take_census(config.devices);
  Lowered lowered;
  for (const Wiring& wiring : config.wiring) {
    if (!std::holds_alternative<hal::Line>(wiring.role)) continue;
    gpiod::HeldLine line;
    const Found found = find(census.infos, wiring);
    std::string error = found.ok() ? "" : with_refusal(found.error, census);
    const int failed = found.ok() ? take(census, wiring, found.place, config.consumer, line, error) : 0;
    if (error.empty()) continue;
    lowered.all = lowered.all && (found.held || failed == EBUSY);
    lowered.problems += error + "\n";
  }
  return lowered;
}

bool GpiodGpio::do_set(hal::Line line, hal::Level level) {
  gpiod::Held* const held = outputs_[static_cast<std::size_t>(line)].get();
  const bool high = level == hal::Level::kHigh;
  return held != nullptr && gpiod::write(*held, high) && gpiod::read(*held) == (high ? 1 : 0);
}

std::optional<hal::Level> GpiodGpio::do_read(hal::Input input) {
  gpiod::Held* const held = inputs_[static_cast<std::size_t>(input)].get();
  const int level = held != nullptr ? gpiod::read(*held) : -1;
  if (level < 0) return std::nullopt;
  return level > 0 ? hal::Level::kHigh : hal::Level::kLow;
}

}  // namespace holdfast::drivers
