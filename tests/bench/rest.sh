#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# How often `holdfast replay --reference auto` is right, on recordings with labels: rest.sh LABELS.csv...
# A line for each clip with -v; then how many of the clips with an empty interval had one of its frames taken (within 5
# frames of it: labels are a person's), how many of those it called clear; and what it said of the clips without one.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
verbose=0
[[ ${1:-} != -v ]] || { verbose=1 && shift; }
(($# > 0)) || { echo "usage: tests/bench/rest.sh [-v] LABELS.csv..." >&2 && exit 2; }
for labels in "$@"; do
  folder=$(dirname "$labels")
  # clip and empty intervals of four frames and more; the note, the last column, may hold commas
  awk -F, 'NR == 1 { for (i = 1; i <= NF; ++i) if ($i == "empty_intervals") at = i; next } { print $1 "," $at }' "$labels" |
    while IFS=, read -r clip empty; do
      file=$folder/$clip
      [[ -f $file ]] || file=$folder/$clip.avi
      said=$(build/sim/bin/holdfast replay "$file" --grid auto --json 2>&1 </dev/null) || true
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
    printf "with an empty interval: %d; right %d (clear %d, unclear %d); wrong, called clear %d; wrong, called unclear %d; refused %d\n",
      with, right["clear"] + right["unclear"], right["clear"], right["unclear"], wrong["clear"], wrong["unclear"], wrong["refused"]
    printf "without one: %d; refused %d, called unclear %d, called clear %d\n", none["refused"] + none["unclear"] + none["clear"],
      none["refused"], none["unclear"], none["clear"]
  }'
