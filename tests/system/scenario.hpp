// SPDX-License-Identifier: Apache-2.0
// What scenarios share: where their files are, and a machine that several tests of a group use one after the other.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "tests/support/folders.hpp"
#include "tests/system/machine.hpp"

namespace holdfast::test {

// Made by the build (system_film), 83 pictures; film_main.cpp says what they show.
[[nodiscard]] inline std::filesystem::path film_path() {
  return program("system_film.mjpg");
}

// Made by board/image/build.sh.
[[nodiscard]] inline std::filesystem::path image_path() {
  return source("build/image/virt");
}

// The machine `name`, started when it is asked for first, has ended or does not answer; another name ends the one
// before. A test leaves it as it found it.
[[nodiscard]] inline Machine& shared_machine(const std::string& name, Machine::Config config) {
  static std::unique_ptr<Machine> machine;
  static std::string running;
  if (!machine || running != name || !machine->usable()) {
    machine.reset();
    config.name = name;
    if (config.image.empty()) config.image = image_path();
    config.film = film_path();
    machine = std::make_unique<Machine>(config);
    running = name;
    if (machine->problem().empty()) machine->await_boot();
  }
  return *machine;
}

}  // namespace holdfast::test
