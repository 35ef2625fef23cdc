# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# our_sources PATTERN...: our own source files whose name matches, one a line, from the top of the tree. Sourced.
# Found by folder and not by git, so that files not yet added are checked too. Generated text (*.gen.*) is left out:
# its own test compares it with the generator's output byte by byte.
our_sources() {
  local pattern names=()
  for pattern in "$@"; do names+=(-o -name "$pattern"); done
  find firmware hal drivers board toolchain tests -type f \( "${names[@]:1}" \) ! -name '*.gen.*' 2>/dev/null | sort
}
