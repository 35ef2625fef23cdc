#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# How many small faults in the firmware its own tests notice: changes one operator, number or statement at a time
# (mutants.awk), and runs the tests of the stages on it.
#   tests/checks/mutate.sh [--sample N] [--seed S] [--list] [FILE...]     e.g. firmware/vision/*.cpp
#     FILE        sources under firmware/ (default: tactile and slip, without types and the compiled tree)
#     --sample N  so many, drawn with seed S (1), instead of all: one takes about 5 s of a core
#     --list      only print them
# First the file's own tests run, and those of the extremes; what they let live meets the tests of all stages, with the
# whole firmware built on it. Killed: a test fails, crashes or takes more than two minutes of a core. What does not compile is no
# mutant. Neither the digest of the recordings nor the host tests count: they notice that something changed, these say
# what is wrong.
# Survivors are told with their line. Needs build/sim, built. Exit status: 0 when the score is at least 85 %, 1 below, 2 wrong arguments.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh

sample=0 seed=1 list=0 files=()
while (($# > 0)); do
  case $1 in
    --sample | --seed)
      [[ ${2:-} =~ ^[0-9]+$ ]] || { complain "$1 '${2:-}' is no number" "a typing error" "give a whole number" && exit 2; }
      if [[ $1 == --sample ]]; then sample=$2; else seed=$2; fi
      shift
      ;;
    --list) list=1 ;;
    --help | -h) sed -n '3,15s/^# \{0,1\}//p' "${BASH_SOURCE[0]}" && exit 0 ;;
    firmware/*)
      [[ -f $1 ]] || { complain "$1 is not there" "a typing error" "name a source under firmware/" && exit 2; }
      files+=("$1")
      ;;
    *) complain "unknown argument '$1'" "a typing error, or not a file under firmware/" "see --help" && exit 2 ;;
  esac
  shift
done
if ((${#files[@]} == 0)); then
  mapfile -t files < <(find firmware/tactile firmware/slip -name '*.[ch]pp' ! -name types.hpp ! -name '*.gen.hpp' ! -name tree_io.hpp | sort)
fi
lib=build/sim
((list == 1)) || [[ -f $lib/firmware/libholdfast_firmware.a ]] || {
  complain "no $lib" "not built" "cmake --workflow --preset sim" && exit 2
}
work=build/mutate
mkdir -p "$work/base"
flags=(-std=c++20 -O0 -w -pipe -isystem /usr/include/opencv4 -D_GLIBCXX_ASSERTIONS -DHOLDFAST_LEAK_CHECK=1 "-DHOLDFAST_SOURCE_DIR=\"$PWD\"" "-DHOLDFAST_BIN_DIR=\"$PWD/$lib/bin\"" "-DHOLDFAST_VERSION=\"mutant\"")
stages=(classifier contact decision displacement dots entropy exposure extremes features field_features grid imprint math
  model_file picture_check pipeline reference_stage tracker units window)

for file in "${files[@]}"; do
  awk -f tests/checks/mutants.awk "$file" | sed "s|^|$file\t|"
done >"$work/all"
if ((sample > 0)); then
  shuf -n "$sample" --random-source=<(yes "$seed") "$work/all" | sort -t $'\t' -k1,1 -k2,2n -k3,3n >"$work/chosen"
else
  cp "$work/all" "$work/chosen"
fi
if ((list == 1)); then
  awk -F '\t' '{ print $1 ":" $2 ":" $3 ": " $6 }' "$work/chosen"
  exit 0
fi

# What each object is made of, so that a mutant costs only those that see it.
compile_base() {
  local source=$1 object
  object=$work/base/$(tr / _ <<<"$source").o
  g++ "${flags[@]}" -MMD -Ifirmware -I. -c "$source" -o "$object"
}
export -f compile_base
export work
sources=(tests/all_tests.cpp)
for stage in "${stages[@]}"; do sources+=("tests/firmware/${stage}_test.cpp"); done
mapfile -t firmware < <(find firmware -name '*.cpp' ! -name main.cpp | sort)
sources+=("${firmware[@]}" tests/support/reference.cpp)
jpeg_sources=()
if [[ ${files[*]} == *vision/jpeg* ]]; then jpeg_sources=(tests/jpeg/*_test.cpp tests/support/host_jpeg_streams.cpp); fi
printf '%s\n' "${sources[@]}" "${jpeg_sources[@]}" | FLAGS="$(printf '%q ' "${flags[@]}")" xargs -P "$(nproc)" -I {} bash -c \
  'eval "flags=($FLAGS)"; compile_base {}' || { complain "the tests do not compile" "see above" "build the sim preset first" && exit 1; }

# Unchanged, all of them pass: otherwise nothing that follows would mean anything.
libraries=(build/sim/drivers/libholdfast_sim.a build/sim/drivers/libholdfast_common.a
  build/sim/firmware/libholdfast_firmware.a -lCppUTest -lCppUTestExt -ljpeg -lpthread)
objects=()
for source in "${sources[@]}"; do objects+=("$work/base/$(tr / _ <<<"$source").o"); done
quietly "$work/base/link.log" g++ "${objects[@]}" "${libraries[@]}" -o "$work/base/tests" || exit 1
quietly "$work/base/tests.log" "$work/base/tests" || exit 1

# try NUMBER FILE LINE COLUMN LENGTH WITH WHAT: one mutant. Prints its fate.
try() {
  local dir=$work/m$1 file=$2 line=$3 column=$4 length=$5 with=$6 what=$7 fate=survived
  eval "flags=($FLAGS)"
  rm -rf "$dir"
  mkdir -p "$dir/$(dirname "$file")"
  awk -v line="$line" -v at="$column" -v length_="$length" -v with="$with" \
    'FNR == line { $0 = substr($0, 1, at - 1) with substr($0, at + length_) } { print }' "$file" >"$dir/$file"
  # A source that is mutated itself is found by its name, a header by the search path.
  make_object() {
    local source=$1
    [[ $source != "$file" ]] || source=$dir/$file
    g++ "${flags[@]}" "-I$dir/firmware" -Ifirmware "-I$dir" -I. -c "$source" -o "$dir/$(tr / _ <<<"$1").o" 2>/dev/null
  }
  run() {
    local -a objects=() rest=()
    local source object
    for source in "$@"; do
      object=$work/base/$(tr / _ <<<"$source").o
      if [[ $source == "$file" ]] || grep -qF " $file" "${object%.o}.d"; then
        [[ -f $dir/$(basename "$object") ]] || make_object "$source" || return 2
        objects+=("$dir/$(basename "$object")")
      else
        rest+=("$object")
      fi
    done
    # shellcheck disable=SC2086  # a list of words
    g++ "${objects[@]}" "${rest[@]}" $LIBRARIES -o "$dir/tests" 2>"$dir/link" || return 3
    local status=0
    (ulimit -t 120 && exec "$dir/tests") >"$dir/out" 2>&1 || status=$?
    ((status == 0))
  }
  local stem own=() status=0
  stem=$(basename "${file%.*}")
  case $stem in
    reference) own=(tests/firmware/tactile/reference_stage_test.cpp) ;;
    model) own=(tests/firmware/slip/model_file_test.cpp tests/firmware/slip/classifier_test.cpp) ;;
    jpeg_*) own=(tests/jpeg/*_test.cpp tests/support/host_jpeg_streams.cpp) ;;
    *) [[ ! -f tests/firmware/${stem}_test.cpp ]] || own=("tests/firmware/${stem}_test.cpp") ;;
  esac
  [[ $file != *.cpp ]] || own+=("$file")
  run tests/all_tests.cpp "${own[@]}" tests/firmware/extremes_test.cpp tests/support/reference.cpp || status=$?
  if ((status == 0)); then
    run "${ALL[@]}" || status=$?
  fi
  case $status in
    0) fate=survived ;;
    1) fate=killed ;;
    2) fate="no mutant" ;;
    *) fate="not linked" ;;
  esac
  printf '%s\t%s:%s:%s: %s\n' "$fate" "$file" "$line" "$column" "$what"
  rm -rf "$dir"
}
export -f try
FLAGS="$(printf '%q ' "${flags[@]}")"
export FLAGS LIBRARIES="${libraries[*]}"
export ALL_LIST="${sources[*]}"
nl -ba -w1 -s $'\t' "$work/chosen" | tr '\t' '\n' | xargs -d '\n' -n 7 -P "$(nproc)" bash -c \
  'read -ra ALL <<<"$ALL_LIST"; try "$@"' try | tee "$work/fates" | awk -F '\t' '
  $1 == "survived" { print } { if (++n % 25 == 0) print n " tried" > "/dev/stderr" }'
awk -F '\t' '
  { count[$1]++ }
  END {
    tried = count["killed"] + count["survived"]
    printf "%d mutants, %d killed, %d survived (%d did not compile, %d not linked): %.1f %%\n", tried, count["killed"],
      count["survived"], count["no mutant"], count["not linked"], tried ? 100 * count["killed"] / tried : 0
    exit !(tried && count["killed"] >= 0.85 * tried)
  }' "$work/fates"
