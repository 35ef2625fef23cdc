// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/tape.hpp"

#include <filesystem>
#include <fstream>

#include "tests/support/temp_dir.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

using namespace holdfast;
using sim::Tape;

TEST_GROUP(Tape) {
  test::TempDir dir;
  std::filesystem::path file = dir.path() / "tape";
  std::string error;

  [[nodiscard]] bool opens(bool create) {
    return Tape::file(file, Tape::Full::kDrop, create, error).has_value();
  }
};

TEST(Tape, IsReadByAnotherWhoOpensIt) {
  CHECK(!opens(false));  // not there
  std::optional<Tape> writer = Tape::file(file, Tape::Full::kDrop, true, error);
  std::optional<Tape> reader = Tape::file(file, Tape::Full::kDrop, false, error);
  CHECK(writer && reader);
  writer->write({.time_us = 7, .kind = sim::TapeKind::kUnsafe, .value = 1});
  const std::optional<sim::TapeEvent> event = reader->read();
  CHECK(event.has_value());
  LONGS_EQUAL(7, event->time_us);
}

// An option that was given a wrong path must not cost what is there.
TEST(Tape, LeavesAnotherFileAsItIs) {
  std::ofstream(file) << "precious";
  for (const bool create : {true, false}) {
    CHECK(!opens(create));
    STRCMP_CONTAINS("stays as it is", error.c_str());
    LONGS_EQUAL(8, std::filesystem::file_size(file));
  }
  const std::filesystem::path elsewhere = dir.path() / "elsewhere";
  std::ofstream(elsewhere) << "";
  std::filesystem::remove(file);
  std::filesystem::create_symlink(elsewhere, file);
  CHECK(!opens(true));
  LONGS_EQUAL(0, std::filesystem::file_size(elsewhere));
}
