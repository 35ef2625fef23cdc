#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# What submit.sh has Slurm run: one shard, or the merge. Not for use by hand.
#   task.sh shard HOLDFAST SHARDS PIECES COMMAND...
#   task.sh merge HOLDFAST SHARDS PIECES OUT COMMAND...
set -euo pipefail
what=$1 holdfast=$2 shards=$3 pieces=$4
shift 4
[[ $what != merge ]] || { out=$1 && shift; }
export LC_ALL=C

# piece K: its file. Digits in front, so that the shell lists them in their order.
piece() { printf '%s/part_%05d' "$pieces" "$1"; }

if [[ $what == shard ]]; then
  k=${SLURM_ARRAY_TASK_ID:?"task.sh: no SLURM_ARRAY_TASK_ID. Likely cause: not run by Slurm. Next: toolchain/cluster/submit.sh"}
  # The tool puts its file in place when it is whole: what is there is done.
  file=$(piece "$k")
  [[ ! -s $file ]] || exit 0
  case $1 in
    dataset) exec "$holdfast" "$@" --shard "$k/$shards" --out "$file" ;;
    trade) exec "$holdfast" "$@" --shard "$k/$shards" --csv "$file" ;;
  esac
fi

for ((k = 1; k <= shards; k++)); do
  [[ -s $(piece "$k") ]] && continue
  echo "error: there is no $(piece "$k"). Likely cause: its task failed, see $pieces/log_$k. Next: the same submit.sh again computes what is missing" >&2
  exit 1
done
case $1 in
  dataset)
    # By find: the names of thousands of pieces do not fit on a command line. The header is the first one's.
    find "$pieces" -maxdepth 1 -name 'part_?????' -print0 | sort -z |
      { first=1; while IFS= read -r -d '' file; do
        if ((first)); then cat "$file"; else tail -n +2 "$file"; fi
        first=0
      done; } >"$out.new"
    mv "$out.new" "$out"
    ;;
  trade) "$holdfast" trade show "$pieces"/part_????? --csv "$out" ;;
esac
