#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Fails on folders that include each other in a circle, and prints the includes that make it up.
#   folders.sh [ROOT]      firmware/, hal/, drivers/ and toolchain/ below ROOT
#   folders.sh --selftest  a circle of three folders is found, and none where there is none
# Include paths start at ROOT or at ROOT/firmware, as CMake has it.
set -euo pipefail

# Lines "folder folder file -> file", one for each include of another folder.
edges() {
  find firmware hal drivers toolchain -name '*.[ch]pp' -exec grep -HoE '^#include "[^"]+/[^"/]+"' {} + |
    sed -E 's/:#include "/ /; s/"$//' | while read -r from to; do
      [[ ! -e firmware/$to ]] || to=firmware/$to
      [[ ! -e $to || ${from%/*} == "${to%/*}" ]] || echo "${from%/*} ${to%/*} $from -> $to"
    done
}

check() {
  local all circle
  cd "$1"
  all=$(edges)
  # tsort names the folders of a circle on stderr, one a line, behind the line that says so.
  circle=$(cut -d' ' -f1,2 <<<"$all" | tsort 2>&1 >/dev/null | sed '/loop:$/d; s/^tsort: //' | sort -u) || true
  if [[ -z $circle ]]; then
    echo "no circle among $(cut -d' ' -f1,2 <<<"$all" | tr ' ' '\n' | sort -u | wc -l) folders"
    return
  fi
  echo "error: folders include each other in a circle: ${circle//$'\n'/, }. Likely cause: a file in the wrong folder." \
    "Next: move what both need to a folder below both. The includes:"
  awk 'NR == FNR { in_circle[$1]; next } $1 in in_circle && $2 in in_circle { print "  " $3, $4, $5 }' \
    <(echo "$circle") - <<<"$all"
  return 1
}

if [[ ${1:-} != --selftest ]]; then
  check "${1:-$(dirname "$0")/../..}"
  exit
fi
root=$(mktemp -d)
trap 'rm -rf "$root"' EXIT
mkdir -p "$root"/{firmware/low,hal,drivers/mid,toolchain/top}
echo '#include "drivers/mid/b.hpp"' | tee "$root/toolchain/top/c.cpp" >"$root/toolchain/top/c.hpp"
echo '#include "low/a.hpp"' | tee "$root/firmware/low/a.cpp" >"$root/drivers/mid/b.hpp"
: >"$root/firmware/low/a.hpp"
(check "$root")
echo '#include "toolchain/top/c.hpp"' >"$root/firmware/low/a.hpp"
if (check "$root") >"$root/said" || [[ $(grep -c -- '->' "$root/said") != 4 ]]; then
  echo "error: a circle was not found:"
  cat "$root/said"
  exit 1
fi
echo "a circle of three folders is found"
