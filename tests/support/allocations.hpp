// SPDX-License-Identifier: Apache-2.0
// How often operator new was called so far, in a test program with HOLDFAST_LEAK_CHECK=1. What a C library takes by
// malloc is not in it. Include it last: CppUTest redefines new.
#pragma once

#include <CppUTest/TestHarness.h>
// after it: they need what it defines
#include <CppUTest/MemoryLeakDetector.h>
#include <CppUTest/MemoryLeakWarningPlugin.h>

namespace holdfast::test {

inline unsigned allocations() {
  return MemoryLeakWarningPlugin::getGlobalDetector()->getCurrentAllocationNumber();
}

}  // namespace holdfast::test
