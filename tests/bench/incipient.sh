#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Latency of detection from the first incipient frame, and from half-slip, on the grasps of `holdfast trials`.
#   tests/bench/incipient.sh KIND [COUNT [SEED]]     slide, closing_slip, turn ...; 60 of seed 1
# Incipient: part of the contact slips, without a break until more than half of it does (half-slip). A rise of `slip`
# up to two frames before half-slip counts as its detection, as in `holdfast trials`. One line, medians in frames.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh
holdfast=${HOLDFAST:-build/sim/bin/holdfast}
[[ -x $holdfast ]] || { complain "no $holdfast" "not built" "cmake --build --preset sim" && exit 2; }
kind=${1:?"incipient.sh: no kind of trial. Next: incipient.sh slide"} count=${2:-60} seed=${3:-1}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

for ((k = 0; k < count; k++)); do
  "$holdfast" trials "$kind" --seed "$seed" --scene "$k" >"$work/scene.json"
  "$holdfast" sim "$work/scene.json" --truth "$work/truth.csv" --features "$work/features.csv" >/dev/null
  # Columns by name: both tables may grow.
  awk -F, '
    FNR == 1 { for (i = 1; i <= NF; i++) at[FILENAME, $i] = i; next }
    FILENAME ~ /truth/ {
      level = $at[FILENAME, "slip_level"]
      if (half != "") next
      if (level == 0) begun = ""
      else if (begun == "") begun = FNR - 2
      if (level >= 2) half = FNR - 2
      next
    }
    half == "" { exit }
    {
      slip = $at[FILENAME, "slip"]
      if (slip && !was) rose = FNR - 2
      if (slip && FNR - 2 >= half || slip && !was && FNR - 2 >= half - 2) { print rose - begun, rose - half; found = 1; exit }
      was = slip
    }
    END { if (half != "" && !found) print "missed" }' "$work/truth.csv" "$work/features.csv"
done >"$work/delays"

median() { sort -n | awk '{ v[NR] = $1 } END { print NR == 0 ? "-" : NR % 2 ? v[(NR + 1) / 2] : (v[NR / 2] + v[NR / 2 + 1]) / 2 }'; }
onsets=$(wc -l <"$work/delays")
detected=$(grep -vc missed "$work/delays" || true)
incipient=$(awk '$1 != "missed" { print $1 }' "$work/delays" | median)
half=$(awk '$1 != "missed" { print $2 }' "$work/delays" | median)
say "$kind: $detected of $onsets onsets detected; $half frames after half-slip; $incipient frames after the first incipient frame"
