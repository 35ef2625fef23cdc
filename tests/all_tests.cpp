// SPDX-License-Identifier: Apache-2.0
// The runner of every CppUTest executable. HOLDFAST_LEAK_CHECK is 1 for programs of our own code alone: they
// must free what they take. It is 0 where OpenCV is linked, whose first-use statics CppUTest would report as
// leaks; libcamera has such, too, where it is run (tests/drivers/contract_test.cpp). Exit status: 0 all passed, 1 a
// failure, 77 all that ran passed but something was skipped (support/skip.hpp).
#include <cstdlib>

#include <CppUTest/CommandLineTestRunner.h>
#include <CppUTest/MemoryLeakWarningPlugin.h>

#include "tests/support/skip.hpp"

int main(int argc, char** argv) {
  if (HOLDFAST_LEAK_CHECK == 0 || std::getenv("HOLDFAST_REAL_DEVICES") != nullptr) {
    MemoryLeakWarningPlugin::turnOffNewDeleteOverloads();
  }
  if (CommandLineTestRunner::RunAllTests(argc, argv) != 0) return 1;
  return holdfast::test::skips == 0 ? 0 : holdfast::test::kSkippedStatus;
}
