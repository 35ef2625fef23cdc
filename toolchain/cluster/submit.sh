#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs a command of the tool as a Slurm job array, one shard a task, and a job behind it that merges the shards.
#   toolchain/cluster/submit.sh SHARDS OUT dataset OPTION...          OUT: the samples, CSV
#   toolchain/cluster/submit.sh SHARDS OUT trade firmware OPTION...   OUT: the table, CSV
# The options are the tool's own, without --out, --csv and --shard, which this adds.
# Prints the number of the merge job, which ends well only when OUT is whole. Pieces are kept in OUT.pieces: the same line
# again computes only what is missing there; other options over the same pieces are refused.
# HOLDFAST: the tool, build/sim/bin/holdfast unless given; the same path, and OUT, have to be there on every machine.
# HOLDFAST_SBATCH: options for every sbatch, as "--partition=long --time=2:00:00".
# HOLDFAST_AT_ONCE: how many tasks of the array run at a time; all that fit unless given.
set -euo pipefail
here=$(realpath "$(dirname "${BASH_SOURCE[0]}")")
# shellcheck source=toolchain/say.sh
source "$here/../say.sh"

usage() {
  sed -n '3,12s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"
  exit "$1"
}
[[ ${1:-} != --help && ${1:-} != -h ]] || usage 0
shards=${1:-} out=${2:-} command=${3:-}
(($# >= 3)) || usage 2
shift 2
if [[ ! $shards =~ ^[1-9][0-9]{0,4}$ ]]; then
  complain "'$shards' is no number of shards" "a typing error" "give 1 to 99999, see --help"
  exit 2
fi
case "$*" in
  dataset* | "trade firmware"*) ;;
  *)
    complain "'$command' cannot be split" "it has no --shard" "dataset, or trade firmware"
    exit 2
    ;;
esac
for word in "$@"; do
  case $word in
    --recordings | --recordings=*)
      [[ $command == trade ]] || {
        complain "$word cannot be split" "recordings are read as one piece" "run the tool itself"
        exit 2
      }
      ;;
    --out | --out=* | --csv | --csv=* | --modes | --modes=* | --shard | --shard=*)
      complain "$word is for a whole run" "each task has a piece, and this script names the files" "leave it out"
      exit 2
      ;;
  esac
done
holdfast=$(realpath "${HOLDFAST:-$here/../../build/sim/bin/holdfast}")
if [[ ! -x $holdfast ]]; then
  complain "there is no $holdfast" "it is not built, or HOLDFAST names another place" "cmake --build --preset sim --target holdfast"
  exit 1
fi
if ! command -v sbatch >/dev/null; then
  complain "there is no sbatch" "Slurm is not installed here" "apt-get install slurm-client, on a machine of a cluster"
  exit 1
fi
mkdir -p "$(dirname "$out")"
out=$(realpath "$out")
pieces=$out.pieces
mkdir -p "$pieces"
# Pieces of other options, of another number of shards or of another build would be merged without a word.
asked=$(printf '%s ' "$shards" "$@" && sha256sum <"$holdfast" | cut -d ' ' -f 1)
if [[ -f $pieces/asked && $(cat "$pieces/asked") != "$asked" ]]; then
  complain "$pieces has pieces of another run" "other options, another number of shards, or the tool was built anew" \
    "remove the folder, or name another OUT"
  exit 1
fi
printf '%s\n' "$asked" >"$pieces/asked"

read -ra more <<<"${HOLDFAST_SBATCH:-}"
array=$(sbatch --parsable --array="1-$shards${HOLDFAST_AT_ONCE:+%$HOLDFAST_AT_ONCE}" --ntasks=1 --cpus-per-task=1 \
  --job-name="holdfast-$command" --output="$pieces/log_%a" "${more[@]}" "$here/task.sh" shard "$holdfast" "$shards" "$pieces" "$@")
array=${array%%;*}
# kill-on-invalid-dep: a merge that can never run is no job to leave behind.
merge=$(sbatch --parsable --dependency="afterok:$array" --kill-on-invalid-dep=yes --ntasks=1 --cpus-per-task=1 \
  --job-name="holdfast-merge" --output="$pieces/log_merge" "${more[@]}" "$here/task.sh" merge "$holdfast" "$shards" "$pieces" "$out" "$@")
printf '%s\n' "${merge%%;*}"
