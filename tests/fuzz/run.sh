#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds the fuzz targets (preset fuzz; the table below), writes their seeds and runs them one after the other on one
# core. See --help.
# The last line is "N executions, no finding", or names the input that was found and how to replay it; exit status 0
# and 1.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh

usage() {
  cat <<'USAGE'
usage: tests/fuzz/run.sh [SECONDS | --runs N] [--build DIR] [--lines]
  SECONDS      how long to run, 1 to 1000000; default 60. The decoder takes a fifth of it, the others a tenth each.
  --runs N     instead: N inputs in all, 1000 or more, the fast readers more: of a hundred 50 frames,
               30 replies, 7 stored records, 5 MCAP files, 3 models, 2 trees, 1 scene, 1 picture, 1 of the console.
  --build DIR  where to build; default build/fuzz. The corpus stays there, so that the next run goes on from it.
  --lines      then tell which share of the code's lines the corpora reach (a second build in DIR-lines)
Needs clang-14 and libclang-rt-14-dev, and llvm-14 for --lines.
Example: tests/fuzz/run.sh 600 --lines
USAGE
}

seconds=60 runs=0 build=build/fuzz lines=0
while (($# > 0)); do
  case $1 in
    --build)
      build=${2:-}
      [[ -n $build ]] || { complain "--build names no folder" "a typing error" "see tests/fuzz/run.sh --help"; exit 2; }
      shift
      ;;
    --lines) lines=1 ;;
    --runs)
      [[ ${2:-} =~ ^[1-9][0-9]{3,8}$ ]] || {
        complain "--runs names no number from 1000 on" "a typing error" "see tests/fuzz/run.sh --help"
        exit 2
      }
      runs=$2
      shift
      ;;
    --help | -h) usage && exit 0 ;;
    *)
      if ! [[ $1 =~ ^[1-9][0-9]{0,6}$ ]]; then
        complain "'$1' is no number of seconds" "a typing error" "see tests/fuzz/run.sh --help"
        exit 2
      fi
      seconds=$1
      ;;
  esac
  shift
done

for tool in clang++-14 $( ((lines == 0)) || echo llvm-cov-14 llvm-profdata-14); do
  command -v "$tool" >/dev/null || {
    complain "no $tool" "not installed" "apt-get install clang-14 libclang-rt-14-dev llvm-14"
    exit 1
  }
done

# built DIR TARGETS [CMAKE_OPTION...]
built() {
  local dir=$1 targets=$2
  shift 2
  # shellcheck disable=SC2086  # several targets
  if ! quietly "$dir.log" cmake --preset fuzz -B "$dir" "$@" || ! quietly "$dir.log" ninja -C "$dir" $targets; then
    complain "the fuzz target does not build" "libFuzzer is not installed, or an error in the sources: see above" \
      "apt-get install clang-14 libclang-rt-14-dev"
    exit 1
  fi
}

# TARGET SHARE CODE: of a hundred inputs; what --lines reports on.
targets="scene 1 drivers/sim/scene/file/*.cpp
model 3 firmware/slip/model_file.cpp
tree 2 toolchain/treec/tree_model.cpp
link 50 firmware/link/link.cpp
modbus 30 firmware/grip/modbus_rtu.cpp
stored 7 firmware/store/settings.cpp firmware/store/models.cpp firmware/store/slot_store.cpp firmware/store/sealed.cpp
console 1 firmware/console/*.cpp
mcap 5 toolchain/log/mcap_reader.cpp
jpeg 1 firmware/vision/jpeg_*"

say "building in $build"
built "$build" "fuzz jpeg_fuzz fuzz_seeds jpeg_seeds"
while read -r name _; do mkdir -p "$build/findings" "$build/${name}_"{seeds,corpus}; done <<<"$targets"
"$build/bin/jpeg_seeds" "$build/jpeg_seeds" 1000
for name in scene model link modbus console mcap; do
  "$build/bin/fuzz_seeds" "$name" "$build/${name}_seeds" "$build/$name.dict"
done
cp "$build"/console_seeds/* "$build/stored_seeds"
cp toolchain/model/*.tree "$build/tree_seeds"
cp tests/fuzz/jpeg.dict "$build"
cp "$build/console.dict" "$build/stored.dict"
awk '/^[a-z]/ { for (k = 1; k <= NF; ++k) if (!seen[$k]++) print "\"" $k "\"" }' toolchain/model/slip_v1.tree \
  >"$build/tree.dict"

executed=0
# fuzzed NAME SHARE CODE: runs one target. The corpora keep their folders from run to run.
fuzzed() {
  local target=$1_fuzz program=fuzz corpus=$build/$1_corpus seeds=$build/$1_seeds code=$3 known=() limit status=0
  local log=$build/$target.log executions rate edges inputs found part=$((seconds / 10))
  [[ $1 != jpeg ]] || { part=$((seconds / 5)) && program=jpeg_fuzz; }
  export FUZZ_TARGET=$1
  limit=-max_total_time=$((part > 0 ? part : 1))
  ((runs == 0)) || limit=-runs=$((runs * $2 / 100))
  [[ ! -d tests/fuzz/regressions/$1 ]] || known=("tests/fuzz/regressions/$1")
  say "running $target with $limit"
  "$build/bin/$program" -seed=1 "$limit" -max_len=4096 -timeout=10 -use_value_profile=1 \
    -dict="$build/$1.dict" -artifact_prefix="$build/findings/" -print_final_stats=1 \
    "$corpus" "$seeds" "${known[@]}" >"$log" 2>&1 || status=$?
  executions=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
  rate=$(sed -n 's/^stat::average_exec_per_sec: *//p' "$log")
  edges=$(sed -n 's/.* cov: \([0-9]*\) .*/\1/p' "$log" | tail -n 1)
  inputs=$(find "$corpus" -type f | wc -l)
  executed=$((executed + ${executions:-0}))
  say "$target: ${executions:-?} executions (${rate:-?}/s), ${edges:-?} edges covered, $inputs inputs in $corpus"

  if ((lines == 1)); then
    built "$build-lines" "$program" \
      "-DCMAKE_CXX_FLAGS=-fsanitize=fuzzer-no-link -fprofile-instr-generate -fcoverage-mapping"
    LLVM_PROFILE_FILE=$build-lines/$target.profraw "$build-lines/bin/$program" -runs=0 "$corpus" "$seeds" \
      "${known[@]}" -artifact_prefix="$build/findings/" >"$build-lines/replay.log" 2>&1 || {
      complain "an input of the corpus is a finding in the other build" "a build from changing sources, or a finding" \
        "see $build-lines/replay.log"
      exit 1
    }
    llvm-profdata-14 merge -o "$build-lines/$target.profdata" "$build-lines/$target.profraw"
    # shellcheck disable=SC2086  # a pattern
    llvm-cov-14 report "$build-lines/bin/$program" -instr-profile="$build-lines/$target.profdata" $code
  fi

  if ((status != 0)); then
    found=$(sed -n 's/.*Test unit written to //p' "$log" | tail -n 1)
    grep -E "^(jpeg_fuzz|finding of .*): |ERROR: |runtime error: " "$log" >&2 || tail -n 5 "$log" >&2
    complain "the fuzzer stopped at an input" "see the line above and $log" \
      "replay it with FUZZ_TARGET=$1 $build/bin/$program ${found:-(no input was written)}"
    exit 1
  fi
}

while read -r name share code; do fuzzed "$name" "$share" "$code"; done <<<"$targets"
say "$executed executions, no finding"
