// SPDX-License-Identifier: Apache-2.0
// For a test that cannot run here because something outside the repository is missing (the real recordings):
//   if (!clips_are_here) { holdfast::test::skip("no ../shared/data/real"); return; }
// The reason is printed and the group counts as skipped in ctest and tests/run.sh, unless one of its tests fails.
#pragma once

#include <cstdio>

namespace holdfast::test {

inline constexpr int kSkippedStatus = 77;  // ctest's SKIP_RETURN_CODE, as in automake
inline int skips = 0;

inline void skip(const char* reason) {
  ++skips;
  std::printf("\nSKIPPED: %s\n", reason);
}

}  // namespace holdfast::test
