// SPDX-License-Identifier: Apache-2.0
#include "tests/system/camera_commands.hpp"

#include <charconv>
#include <chrono>
#include <cstdint>
#include <optional>
#include <vector>

namespace holdfast::test {
namespace {

using Words = std::vector<std::string_view>;

Words split(std::string_view line) {
  Words words;
  while (true) {
    const std::size_t begin = line.find_first_not_of(" \t\r\n");
    if (begin == std::string_view::npos) return words;
    line.remove_prefix(begin);
    const std::size_t end = std::min(line.find_first_of(" \t\r\n"), line.size());
    words.push_back(line.substr(0, end));
    line.remove_prefix(end);
  }
}

std::optional<std::uint64_t> number(std::string_view word, int base = 10) {
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value, base);
  if (error != std::errc() || end != word.data() + word.size()) return std::nullopt;
  return value;
}

std::optional<bool> on_or_off(std::string_view word) {
  if (word == "on") return true;
  if (word == "off") return false;
  return std::nullopt;
}

std::string wrong(std::string_view what, std::string_view next) {
  return std::string("error: ").append(what).append(" (a typing error). Next: ").append(next);
}

std::optional<UsbCamera::Play> section(std::string_view first, std::string_view last, std::size_t pictures) {
  const std::optional<std::uint64_t> from = number(first), to = number(last);
  if (!from || !to || *from > *to || *to >= pictures) return std::nullopt;
  return UsbCamera::Play{static_cast<std::size_t>(*from), static_cast<std::size_t>(*to)};
}

std::string play(const Words& words, UsbCamera& camera) {
  const bool then = words.size() == 6 && words[3] == "then";
  if (words.size() != 3 && !then) return wrong("play takes two pictures", "play A B, or play A B then C D");
  const std::optional<UsbCamera::Play> first = section(words[1], words[2], camera.pictures());
  const std::optional<UsbCamera::Play> second = then ? section(words[4], words[5], camera.pictures()) : first;
  if (!first || !second) {
    return wrong("no such pictures", "give A <= B below " + std::to_string(camera.pictures()));
  }
  camera.play(*second, then ? first : std::nullopt);
  return "ok";
}

std::string as(const Words& words, UsbCamera& camera) {
  const std::size_t colon = words.size() < 4 ? std::string_view::npos : words.back().find(':');
  if (colon == std::string_view::npos) return wrong("as takes three things", "as NAME SERIAL VID:PID");
  const std::optional<std::uint64_t> vendor = number(words.back().substr(0, colon), 16);
  const std::optional<std::uint64_t> product = number(words.back().substr(colon + 1), 16);
  if (!vendor || !product || *vendor > 0xffff || *product > 0xffff) {
    return wrong("ids are hexadecimal", "0c45:636d for instance");
  }
  UsbIdentity identity = camera.identity();
  identity.vendor = static_cast<std::uint16_t>(*vendor);
  identity.product = static_cast<std::uint16_t>(*product);
  identity.serial = words[words.size() - 2];
  identity.name.clear();
  for (std::size_t k = 1; k + 2 < words.size(); ++k) identity.name.append(k > 1 ? " " : "").append(words[k]);
  camera.set_identity(identity);
  return "ok from the next plug on";
}

std::string status(const UsbCamera& camera) {
  return "ok frames=" + std::to_string(camera.frames()) + " picture=" + std::to_string(camera.picture()) + " " +
         camera.controls();
}

}  // namespace

std::string obey(std::string_view line, UsbCamera& camera, UsbredirPeer& peer) {
  const Words words = split(line);
  if (words.empty()) return wrong("an empty line", "see camera_commands.hpp");
  const std::string_view name = words[0];
  if (name == "play") return play(words, camera);
  if (name == "as") return as(words, camera);

  if (words.size() == 1) {
    if (name == "status") return status(camera);
    if (name == "plug" || name == "unplug") {
      name == "plug" ? peer.plug() : peer.unplug();
      return "ok";
    }
  }
  if (words.size() == 2 && (name == "stall" || name == "freeze")) {
    const std::optional<bool> on = on_or_off(words[1]);
    if (!on) return wrong("neither on nor off", "say on or off");
    name == "stall" ? camera.stall(*on) : camera.freeze(*on);
    return "ok";
  }
  if (words.size() == 2 && (name == "period" || name == "truncate" || name == "error" || name == "step")) {
    const std::optional<std::uint64_t> count = number(words[1]);
    if (!count || *count > 1'000'000) return wrong("no number from 0 to 1000000", "give one");
    if (name == "period") camera.set_period(std::chrono::milliseconds(*count));
    if (name == "truncate") camera.truncate(*count);
    if (name == "error") camera.fail(*count);
    return "ok";
  }
  return wrong("no command '" + std::string(line.substr(0, line.find('\n'))) + "'", "see camera_commands.hpp");
}

}  // namespace holdfast::test
