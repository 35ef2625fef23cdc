#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Looks at the machine code of the fast JPEG walk (firmware/vision/jpeg_walk.cpp): the turn to the next block must be
# selects (cmov, csel), not a branch, because that branch is never predicted and costs a third of the speed and more.
# Usage: jpeg_selects.sh OBJDUMP OBJECT_OR_BINARY
# Each walk of N lanes takes 3 look-ups of every lane in its loop: 4 selects each, and one branch each, to the slow path.
# Each walk is there twice, without and with pairs of blocks; on x86-64 both are again twice.
set -euo pipefail

if (($# != 2)); then
  echo "usage: jpeg_selects.sh OBJDUMP OBJECT_OR_BINARY" >&2
  exit 2
fi
"$1" -d -C --no-show-raw-insn "$2" | awk '
  />:$/ {
    judge()
    walk = /walk_(baseline|bmi2)</
    if (walk) { lanes = gsub(/jpeg_fast::Walk&/, "&"); selects = inside = branches = 0 }
  }
  walk && /[ \t](cmovae[ \t]|csel[ \t].*, ne)/ { ++selects; branches = inside }
  walk && selects > 0 && /[ \t](j[a-ln-z][a-z]*|b\.[a-z]+|cbn?z|tbn?z)[ \t]/ { ++inside }
  function judge() {
    if (!walk) return
    ++walks
    printf "%d lanes: %d selects (want %d), %d branches among them (at most %d)\n",
      lanes, selects, 12 * lanes, branches, 3 * lanes
    if (selects != 12 * lanes || branches > 3 * lanes) bad = 1
    walk = 0
  }
  END {
    judge()
    if (walks != 6 && walks != 12) {
      print "error: " walks + 0 " walks found instead of 6 or 12: the function has another name now?"
      bad = 1
    }
    exit bad
  }'
