#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# From your own labelled recordings to a model that a device loads: how the built-in model does on them, the imprint's
# threshold read off them, how that does, and the sealed record.
#   toolchain/learn/own_data.sh LABELS_CSV FOLDER [KEY]
#     LABELS_CSV  beside its recordings; the report's page writes it (Label this recording), one line for each recording
#     FOLDER      for the samples, the model and both evaluations
#     KEY         of the owner (holdfast settings keygen), for a device that has one
# The tree of the markers stays the built-in one, which learned from simulated grasps. Exit status: 0 done, 1 it could
# not be, 2 wrong arguments.
set -euo pipefail
top=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
# shellcheck source=toolchain/say.sh
source "$top/toolchain/say.sh"
holdfast=${HOLDFAST:-$top/build/sim/bin/holdfast}
(($# == 2 || $# == 3)) || { sed -n '3,11s/^# \{0,1\}//p' "${BASH_SOURCE[0]}" >&2 && exit 2; }
labels=$1 work=$2 key=${3:-}
[[ -x $holdfast ]] || { complain "no $holdfast" "not built" "cmake --workflow --preset sim" && exit 1; }
[[ -f $labels ]] || { complain "no $labels" "a typing error, or nothing is labelled yet" "label recordings in the report's page" && exit 1; }
mkdir -p "$work"

say "the built-in model on these recordings, which it never saw"
"$holdfast" evaluate --recorded "$labels" --json "$work/built_in.json"
"$holdfast" dataset --recordings "$labels" --out "$work/clips.csv"
say "the imprint's threshold, read off these recordings"
"$holdfast" fuse "$work/clips.csv" --markers "$top/toolchain/model/slip_v2.tree" --model "$work/own.tree"
say "the same recordings with it: in-sample, so an upper bound. Keep some apart that it has not seen"
"$holdfast" evaluate --recorded "$labels" --model "$work/own.tree" --json "$work/own.json"
"$holdfast" compile "$work/own.tree" --binary "$work/own.model"
"$holdfast" model seal "$work/own.model" -o "$work/own.sealed" ${key:+--sign "$key"}
say "load it, if the second table is no worse than the first:  holdfast console PORT --code-file FILE --load $work/own.sealed"
