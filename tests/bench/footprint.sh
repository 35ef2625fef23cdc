#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# What holdfastd takes of a machine: memory that is resident, how much of its fixed memory it ever touches, its size as a
# file, and what passes from start to the first decision.
#   tests/bench/footprint.sh [FRAMES]     default 50, of 3280x2464 JPEG: 20 s
# Memory is of the host's build with the simulated camera, in virtual time: its heap is the simulator's and not stated; fixed
# memory and code are the firmware's as on a board. The first decision comes when the empty gel is known: virtual time of a
# simulated one, which does not depend on the machine. Needs the preset sim, and rpi4 for the size.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh
frames=${1:-50}
for program in build/sim/bin/holdfastd build/sim/bin/holdfast build/rpi4/bin/holdfastd; do
  [[ -x $program ]] || { complain "no $program" "not built" "cmake --build --preset sim, and rpi4" && exit 2; }
done
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# The program without what debuggers read.
aarch64-linux-gnu-strip -o "$work/stripped" build/rpi4/bin/holdfastd
echo "size: $(stat -c %s "$work/stripped" | awk '{ printf "%.2f", $1 / 1e6 }') MB on the board"

build/sim/bin/holdfastd --seconds "$((frames / 25))" >"$work/out" &
pid=$!
# The last look before it ends counts: after all frames but the last few.
while cp "/proc/$pid/smaps" "$work/smaps.new" 2>/dev/null && [[ -s $work/smaps.new ]]; do
  mv "$work/smaps.new" "$work/smaps"
  sleep 0.1
done
wait "$pid"
grep -q '^\* OK' "$work/out" || { complain "holdfastd was never OK" "a bug" "run it by hand" && exit 1; }
awk '
  # A map begins; what has no name behind the program'"'"'s writable map is its zeroed memory.
  /^[0-9a-f]+-[0-9a-f]+ / {
    kind = $6 ~ /holdfastd$/ ? ($2 ~ /w/ ? "fixed" : "code") : $6 == "" && kind == "fixed" ? "fixed" : "other"
  }
  $1 == "Rss:" { rss[kind] += $2 }
  $1 == "Size:" { size[kind] += $2 }
  END {
    printf "resident: fixed memory %.1f of %.1f MB; code %.1f of %.1f\n", rss["fixed"] / 1024, size["fixed"] / 1024,
      rss["code"] / 1024, size["code"] / 1024
  }' "$work/smaps"

build/sim/bin/holdfast sim tests/scenes/empty_gel.json --inject jpeg --log "$work/log.csv" >"$work/sim" || { cat "$work/sim" >&2 && exit 1; }
awk -F, '
  NR == 1 { for (i = 1; i <= NF; ++i) column[$i] = i; next }
  $column["state"] == 2 { printf "first decision: frame %d; %.0f ms after the first\n", NR - 1, $column["t_s"] * 1000; exit }' "$work/log.csv"
