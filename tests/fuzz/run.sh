#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds the fuzz targets (preset fuzz): the JPEG decoder, and the readers of scene files, compiled
# models, frames on the link, a gripper's replies, the console and MCAP files. Writes their seeds and runs them one after
# the other on one core. See --help.
# The last line is "no finding", or names the input that was found and how to replay it; exit status 0 and 1.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh

usage() {
  cat <<'USAGE'
usage: tests/fuzz/run.sh [SECONDS] [--build DIR] [--lines]
  SECONDS      how long to run, 1 to 1000000; default 60. Scenes take a fifth of it, models, frames,
               replies, the console and MCAP files a tenth each, the decoder the rest.
  --build DIR  where to build; default build/fuzz. The corpus stays there, so that the next run goes on from it.
  --lines      then tell which share of the code's lines the corpora reach (a second build in DIR-lines)
Needs clang-14 and libclang-rt-14-dev, and llvm-14 for --lines.
Example: tests/fuzz/run.sh 600 --lines
USAGE
}

seconds=60 build=build/fuzz lines=0
while (($# > 0)); do
  case $1 in
    --build)
      build=${2:-}
      [[ -n $build ]] || { complain "--build names no folder" "a typing error" "see tests/fuzz/run.sh --help"; exit 2; }
      shift
      ;;
    --lines) lines=1 ;;
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

say "building in $build"
built "$build" "jpeg_fuzz jpeg_seeds scene_fuzz scene_seeds model_fuzz model_seeds link_fuzz link_seeds \
  modbus_fuzz modbus_seeds console_fuzz console_seeds mcap_fuzz mcap_seeds"
mkdir -p "$build"/{seeds,corpus,findings} "$build"/{scene,model,link,modbus,console,mcap}_{seeds,corpus}
"$build/bin/jpeg_seeds" "$build/seeds" 1000
"$build/bin/scene_seeds" "$build/scene_seeds" "$build/scene.dict"
"$build/bin/model_seeds" "$build/model_seeds" "$build/model.dict"
"$build/bin/link_seeds" "$build/link_seeds" "$build/link.dict"
"$build/bin/modbus_seeds" "$build/modbus_seeds" "$build/modbus.dict"
"$build/bin/console_seeds" "$build/console_seeds" "$build/console.dict"
"$build/bin/mcap_seeds" "$build/mcap_seeds" "$build/mcap.dict"

# fuzzed TARGET SECONDS CORPUS SEEDS DICTIONARY KNOWN CODE: runs one target; CODE is what --lines reports on. The corpora
# keep their folders from run to run.
fuzzed() {
  local target=$1 seconds=$2 corpus=$build/$3 seeds=$build/$4 dictionary=$5 code=$7
  local log=$build/$target.log status=0 known=() executions rate edges inputs found
  [[ ! -d $6 ]] || known=("$6")
  say "running $target for $seconds s"
  "$build/bin/$target" -seed=1 -max_total_time="$seconds" -max_len=4096 -timeout=10 -use_value_profile=1 \
    -dict="$dictionary" -artifact_prefix="$build/findings/" -print_final_stats=1 \
    "$corpus" "$seeds" "${known[@]}" >"$log" 2>&1 || status=$?
  executions=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
  rate=$(sed -n 's/^stat::average_exec_per_sec: *//p' "$log")
  edges=$(sed -n 's/.* cov: \([0-9]*\) .*/\1/p' "$log" | tail -n 1)
  inputs=$(find "$corpus" -type f | wc -l)
  say "$target: ${executions:-?} executions (${rate:-?}/s), ${edges:-?} edges covered, $inputs inputs in $corpus"

  if ((lines == 1)); then
    built "$build-lines" "$target" \
      "-DCMAKE_CXX_FLAGS=-fsanitize=fuzzer-no-link -fprofile-instr-generate -fcoverage-mapping"
    LLVM_PROFILE_FILE=$build-lines/$target.profraw "$build-lines/bin/$target" -runs=0 "$corpus" "$seeds" \
      "${known[@]}" -artifact_prefix="$build/findings/" >"$build-lines/replay.log" 2>&1 || {
      complain "an input of the corpus is a finding in the other build" "a build from changing sources, or a finding" \
        "see $build-lines/replay.log"
      exit 1
    }
    llvm-profdata-14 merge -o "$build-lines/$target.profdata" "$build-lines/$target.profraw"
    # shellcheck disable=SC2086  # a pattern
    llvm-cov-14 report "$build-lines/bin/$target" -instr-profile="$build-lines/$target.profdata" $code
  fi

  if ((status != 0)); then
    found=$(sed -n 's/.*Test unit written to //p' "$log" | tail -n 1)
    grep -E "^$target: |ERROR: |runtime error: " "$log" >&2 || tail -n 5 "$log" >&2
    complain "the fuzzer stopped at an input" "see the line above and $log" \
      "replay it with $build/bin/$target ${found:-(no input was written)}"
    exit 1
  fi
}

scene_seconds=$((seconds / 5 > 0 ? seconds / 5 : 1))
tenth=$((seconds / 10 > 0 ? seconds / 10 : 1))
rest=$((seconds - scene_seconds - 5 * tenth))
fuzzed scene_fuzz "$scene_seconds" scene_corpus scene_seeds "$build/scene.dict" tests/fuzz/regressions/scene \
  "drivers/sim/scene/file/*.cpp"
fuzzed model_fuzz "$tenth" model_corpus model_seeds "$build/model.dict" tests/fuzz/regressions/model \
  "firmware/slip/model_file.cpp"
fuzzed link_fuzz "$tenth" link_corpus link_seeds "$build/link.dict" tests/fuzz/regressions/link "firmware/link/link.cpp"
fuzzed modbus_fuzz "$tenth" modbus_corpus modbus_seeds "$build/modbus.dict" tests/fuzz/regressions/modbus \
  "firmware/grip/modbus_rtu.cpp"
fuzzed console_fuzz "$tenth" console_corpus console_seeds "$build/console.dict" tests/fuzz/regressions/console \
  "firmware/console/*.cpp firmware/store/settings.cpp firmware/store/models.cpp"
fuzzed mcap_fuzz "$tenth" mcap_corpus mcap_seeds "$build/mcap.dict" tests/fuzz/regressions/mcap \
  "toolchain/log/mcap_reader.cpp"
fuzzed jpeg_fuzz $((rest > 0 ? rest : 1)) corpus seeds tests/fuzz/jpeg.dict \
  tests/fuzz/regressions/jpeg "firmware/vision/jpeg_*"
say "no finding"
