#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Makes a slip model from nothing, as the committed one was made: the samples, the tree of the markers, the imprint's
# threshold above it, the header of both. About ten minutes on two cores.
#   toolchain/model/train.sh WORK_FOLDER LABELS_CSV...     of recorded clips (holdfast evaluate --help has the columns)
# The threshold is read off all of them; the tree of the markers learns from the first alone (slip_v2 was made when there
# was no other), beside simulated grasps. The committed slip_v2 is of an earlier simulator: this one gives another tree.
# Writes WORK_FOLDER/*.csv, toolchain/model/slip_v2.tree, slip_v6.tree and firmware/slip/slip_tree.gen.hpp.
set -euo pipefail
top=$(cd "$(dirname "$0")/../.." && pwd)
holdfast=${HOLDFAST:-$top/build/sim/bin/holdfast}
work=${1:?"train.sh: no folder for the samples. Next: train.sh WORK_FOLDER LABELS_CSV..."}
shift
: "${1:?"train.sh: no label file. Next: train.sh WORK_FOLDER LABELS_CSV..."}"
mkdir -p "$work"
work=$(cd "$work" && pwd)

# Gels from 30 kPa (the softest in the literature; dots move up to 2 mm) to 110. Six sets as the scenes are, with markers that jitter by 1 to 2 um (what the tracker does at 320x240); one with perfect
# markers and one with 0.5 um (8 megapixels at 1/8): a tree that has never seen quiet markers calls them a slip.
part() { "$holdfast" dataset "$@" >/dev/null; }
(
  part --seed 1 --repeats 6 --shard 1/2 --out "$work/a1.csv"
  part --seed 7 --marker-noise-um 0 --out "$work/quiet.csv"
  part --seed 9 --shear-modulus-mpa 0.03 --out "$work/soft.csv"
) &
first=$!
part --seed 1 --repeats 6 --shard 2/2 --out "$work/a2.csv"
part --seed 8 --marker-noise-um 0.5 --out "$work/calm.csv"
part --seed 10 --shear-modulus-mpa 0.038 --marker-noise-um 0 --out "$work/soft_quiet.csv"
part --seed 11 --shear-modulus-mpa 0.035 --marker-noise-um 0.5 --out "$work/soft_calm.csv"
clips=()
for labels in "$@"; do
  clips+=("$work/clips_${#clips[@]}.csv")
  part --recordings "$labels" --out "${clips[-1]}"
done
wait "$first"
awk 'FNR > 1 || NR == 1' "$work/a1.csv" "$work/a2.csv" >"$work/grasps.csv"

cd "$work"
"$holdfast" train grasps.csv quiet.csv calm.csv soft.csv soft_quiet.csv soft_calm.csv "${clips[0]}" --set field --depth 16 \
  --min-leaf 80 --prune 0.00002 --slip-weight 0.1 --recorded-weight 10 --model "$top/toolchain/model/slip_v2.tree"
"$holdfast" fuse "${clips[@]}" --markers "$top/toolchain/model/slip_v2.tree" --model "$top/toolchain/model/slip_v6.tree"
"$holdfast" compile "$top/toolchain/model/slip_v6.tree" --header "$top/firmware/slip/slip_tree.gen.hpp"
