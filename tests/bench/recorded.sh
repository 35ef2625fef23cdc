#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# `holdfast evaluate --recorded` of the label files in HOLDFAST_LABELS, in lines that the evidence reads: detection
# rate with its 95 % CI, latency in frames, false alarms an hour, alarms of whole trials, for each detector.
#   recorded.sh --pairs   the same of clips that are two fingers of a hand
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh
holdfast=${HOLDFAST:-build/sim/bin/holdfast}
[[ -x $holdfast ]] || { complain "no $holdfast" "not built" "cmake --build --preset sim" && exit 2; }
: "${HOLDFAST_LABELS:?"recorded.sh: no label files. Next: HOLDFAST_LABELS='clips/labels.csv ...'"}"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
# shellcheck disable=SC2086  # several files
"$holdfast" evaluate --recorded $HOLDFAST_LABELS "$@" --out "$work" >"$work/text"
sed -nE 's/.*It came ([0-9]+) times in labelled silence, and ([0-9]+) times of.*/losses: \1; \2/p' "$work/text"
prefix=""
[[ ${1:-} != --pairs ]] || prefix=pairs_

for table in silence trials; do
  awk -F, -v table="$table" '
    function hours(kind, bound) { return sprintf("%.0f", 60 * $at[kind "_" bound]) }
    function alarms(kind) {
      return sprintf("%d in %.1f min; %s an hour; %s-%s", $at[kind "_alarms"], $at[kind "_min"], hours(kind, "per_min"),
                     hours(kind, "low"), hours(kind, "high"))
    }
    function share(low, high) { return sprintf("%.0f-%.0f %%", $at[low], $at[high]) }
    FNR == 1 { for (i = 1; i <= NF; i++) at[$i] = i; next }
    { gsub(/"/, "") }
    $at["of"] != "all" { next }
    table == "silence" {
      n = $at["onsets"]
      printf "onsets %s: %d; %d; %d; of %d; %.0f %%; %s; %s\n", $1, $at["within_5"], $at["within_10"], $at["within_15"], n,
        100 * $at["within_10"] / n, share("within_10_low", "within_10_high"), $at["delay"]
      printf "alarms %s: %s; %s; %s\n", $1, alarms("silent"), alarms("shaken"), alarms("empty")
    }
    table == "trials" {
      printf "trials %s: %d; %d; %d; %d; %.2f; %d of %d; %s; %.0f an hour; of %d\n", $1, $at["empty_alarms"], $at["touch_alarms"],
        $at["hold_alarms"], $at["shake_alarms"], $at["per_trial"], $at["touches_alarmed"], $at["touches"],
        share("touches_alarmed_low", "touches_alarmed_high"), 60 * $at["whole_per_min"], $at["trials"]
    }' "$work/$prefix$table.csv"
done
