// SPDX-License-Identifier: Apache-2.0
// Lets one system call of the drivers fail, whichever it is: the linker puts __wrap_x in the place of each x that our
// own code calls (tests/CMakeLists.txt, --wrap). Libraries call the system's as ever.
//
// A call that fails does nothing, but for close(): Linux frees the descriptor whatever it says.
#pragma once

#include <atomic>

namespace holdfast::test {

struct FailingCalls {
  std::atomic<int> counted{0};
  std::atomic<int> fails_at{0};  // from 1; 0: none
  std::atomic<int> error{0};
  std::atomic<bool> armed{false};

  // The call is counted, and whether it has to fail now: errno is set then.
  bool fails();

  void plan(int at, int with) {
    counted = 0;
    fails_at = at;
    error = with;
  }
  [[nodiscard]] bool failed() const { return fails_at != 0 && counted >= fails_at; }
};
FailingCalls& failing_calls();

// What happens in its scope is counted: the drivers' calls, and not those of the test.
class Armed {
 public:
  Armed() { failing_calls().armed = true; }
  ~Armed() { failing_calls().armed = false; }
  Armed(const Armed&) = delete;
  Armed& operator=(const Armed&) = delete;
};

}  // namespace holdfast::test
