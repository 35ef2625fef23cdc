#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# How often `holdfast replay` finds the empty gel by itself, on the recordings of the label files in HOLDFAST_LABELS. A frame
# of an empty interval counts, and one within 5 frames of it: labels are a person's. With -v a line for each clip.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh
holdfast=${HOLDFAST:-build/sim/bin/holdfast}
[[ -x $holdfast ]] || { complain "no $holdfast" "not built" "cmake --build --preset sim" && exit 2; }
: "${HOLDFAST_LABELS:?"rest.sh: no label files. Next: HOLDFAST_LABELS='clips/labels.csv ...'"}"
verbose=0
[[ ${1:-} != -v ]] || verbose=1
for labels in $HOLDFAST_LABELS; do
  folder=$(dirname "$labels")
  # clip and empty intervals of four frames and more; the note, the last column, may hold commas
  awk -F, 'NR == 1 { for (i = 1; i <= NF; ++i) if ($i == "empty_intervals") at = i; next } { print $1 "," $at }' "$labels" |
    while IFS=, read -r clip empty; do
      file=$folder/$clip
      [[ -f $file ]] || file=$folder/$clip.avi
      said=$("$holdfast" replay "$file" --grid auto --json 2>&1 </dev/null) || true
      printf '%s\t%s\t%s\n' "$clip" "$empty" "$(tr '\n' ' ' <<<"$said")"
    done
done | awk -F'\t' -v verbose="$verbose" '
  {
    has = 0; inside = 0; taken = -1; clear = 0
    if (match($3, /"frame":[0-9]+/)) taken = substr($3, RSTART + 8, RLENGTH - 8) + 0
    clear = $3 ~ /"clear":true/
    count = split($2, parts, ";")
    for (i = 1; i <= count; ++i) {
      split(parts[i], ends, "-")
      if (ends[2] - ends[1] >= 3) has = 1
      if (taken >= ends[1] - 5 && taken <= ends[2] + 5) inside = 1
    }
    what = taken < 0 ? "refused" : clear ? "clear" : "unclear"
    if (has) { ++with; right[what] += inside; wrong[what] += !inside }
    else ++none[what]
    if (verbose) print has ? (taken < 0 ? "refused" : inside ? "right" : "wrong") : "none", what, $1, taken, $2
  }
  END {
    printf "with: %d of %d; %d called unclear; %d wrong and called clear; without: %d of %d refused; %d called clear\n",
      right["clear"] + right["unclear"], with, right["unclear"] + wrong["unclear"], wrong["clear"], none["refused"],
      none["refused"] + none["unclear"] + none["clear"], none["clear"]
  }'
