#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# How many small faults in the firmware its own tests notice: changes one operator, number or statement at a time
# (mutants.awk), and runs the tests on it.
#   tests/checks/mutate.sh [--sample N] [--seed S] [--list] [--again FATES] [FILE...]     e.g. firmware/vision/*.cpp
#     FILE        sources under firmware/ or drivers/ (default: the safety core - app, grip, slip, drivers/common - and
#                 tactile, without types, jpeg_turbo and what is generated)
#     --sample N  so many, drawn with seed S (1), instead of all: one takes about 3 s of a core when its own
#                 tests kill it, half a minute or more when nothing does
#     --list      only print them
#     --again     only those that the file build/mutate/fates of an earlier run calls survivors
# First the file's own tests run; what they let live meets all that can tell, with the whole firmware built on it. Killed:
# a test fails, crashes or takes more than two minutes of a core. What does not compile is no mutant. Neither the digest of
# the recordings nor the host tests count: they notice that something changed, these say what is wrong.
# Survivors are told with their line. Needs build/sim with firmware_tests, linux_tests and jpeg_tests. Exit status: 0 when
# the score is at least 92 %, 1 below, 2 wrong arguments.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh

sample=0 seed=1 list=0 again='' files=()
while (($# > 0)); do
  case $1 in
    --sample | --seed)
      [[ ${2:-} =~ ^[0-9]+$ ]] || { complain "$1 '${2:-}' is no number" "a typing error" "give a whole number" && exit 2; }
      if [[ $1 == --sample ]]; then sample=$2; else seed=$2; fi
      shift
      ;;
    --again)
      [[ -f ${2:-} ]] || { complain "--again '${2:-}' is not there" "no run before" "give the file fates of an earlier run" && exit 2; }
      again=$2
      shift
      ;;
    --list) list=1 ;;
    --help | -h) sed -n '3,17s/^# \{0,1\}//p' "${BASH_SOURCE[0]}" && exit 0 ;;
    firmware/* | drivers/*)
      [[ -f $1 ]] || { complain "$1 is not there" "a typing error" "name a source under firmware/ or drivers/" && exit 2; }
      files+=("$1")
      ;;
    *) complain "unknown argument '$1'" "a typing error, or not a file under firmware/ or drivers/" "see --help" && exit 2 ;;
  esac
  shift
done
if ((${#files[@]} == 0)); then
  mapfile -t files < <(find firmware/app firmware/link firmware/params firmware/store firmware/grip firmware/slip firmware/tactile drivers/common -name '*.[ch]pp' \
    ! -name types.hpp ! -name '*.gen.hpp' ! -name tree_io.hpp ! -name 'jpeg_turbo.*' | sort)
fi
build=build/sim work=build/mutate
mkdir -p "$work"
for file in "${files[@]}"; do
  awk -f tests/checks/mutants.awk "$file" | sed "s|^|$file\t|"
done >"$work/all"
if ((sample > 0)); then
  # By a hash of the line: shuf takes the few bytes of such a source as they are, and draws some files twice as often.
  LC_ALL=C sort -R --random-source=<(yes "$seed") "$work/all" | awk -v sample="$sample" 'NR <= sample' >"$work/chosen"
else
  cp "$work/all" "$work/chosen"
fi
if [[ -n $again ]]; then
  awk -F '\t' 'NR == FNR { if ($1 == "survived") alive[$2]; next } ($1 ":" $2 ":" $3 ": " $6) in alive' "$again" "$work/chosen" >"$work/left"
  mv "$work/left" "$work/chosen"
fi
if ((list == 1)); then
  awk -F '\t' '{ print $1 ":" $2 ":" $3 ": " $6 }' "$work/chosen"
  exit 0
fi

# The build itself is what a mutant is linked with: only the objects that see it are made anew.
programs=(firmware_tests linux_tests jpeg_tests)
for program in "${programs[@]}"; do
  [[ -x $build/bin/$program ]] || { complain "no $build/bin/$program" "not built" "cmake --workflow --preset sim" && exit 2; }
done
# FILE <tab> OBJECT that is made of it.
ninja -C "$build" -t deps | awk -v here="$PWD/" '
  /: #deps/ { object = substr($1, 1, length($1) - 1); next }
  { file = $1; sub(/^(\.\.\/)+/, "", file); if (index(file, here) == 1) file = substr(file, length(here) + 1) }
  file ~ /^(firmware|drivers)\// { print file "\t" object }' >"$work/seen"
# OBJECT <tab> SOURCE <tab> the options of its compiler: its own, but quick, and with bounds that are looked at.
ninja -C "$build" -t commands "${programs[@]}" | awk -v here="$PWD/" '
  / -c / {
    object = source = options = ""
    for (i = 1; i <= NF; ++i) {
      if ($i == "-o") object = $++i
      else if ($i == "-c") source = substr($++i, length(here) + 1)
      else if ($i == "-MT" || $i == "-MF") ++i
      else if ($i ~ /^-(D|std|I|isystem|f)/ && $i != "-DNDEBUG" || last == "-isystem") options = options " " $i
      last = $i
    }
    print object "\t" source "\t" options
  }' >"$work/commands"
# The linker's words of each program: objects, and what follows them.
for program in "${programs[@]}"; do
  ninja -C "$build" -t commands "$program" | tail -n 1 | sed 's/^: && [^ ]* //; s/ && :$//' | tr ' ' '\n' |
    awk -v objects="$work/$program.objects" -v rest="$work/$program.rest" -v out="bin/$program" '
      $0 == "-o" || $0 == out || $0 == "" { next }
      /\.o$/ { print > objects; next }
      { printf "%s ", $0 > rest }'
done

# What can tell of a mutant anywhere. Slow: of no use but for what they test themselves and the stages beside it.
slow='Imprint|Tracker|PictureCheck|Grid|Coarse|Entropy|Dots'
groups_of() { sed -nE 's/^TEST_GROUP\( *([A-Za-z0-9_]+)\).*/-sg \1/p' "$@" | tr '\n' ' '; }
export -f groups_of
mapfile -t stages < <(find tests/firmware -name "*_test.cpp" | sort)
for stage in contract crew devices file_keep file_store folder_notes gpio_wiring hande linux_serial power_cut; do
  stages+=("tests/drivers/${stage}_test.cpp")
done
all_groups=$(groups_of "${stages[@]}")
quick_groups=$(sed -E "s/-sg ($slow) //g" <<<"$all_groups")

# Unchanged, all of them pass: otherwise nothing that follows would mean anything.
# shellcheck disable=SC2086  # lists of words
quietly "$work/tests.log" "$build/bin/firmware_tests" $quick_groups || exit 1

# try NUMBER FILE LINE COLUMN LENGTH WITH WHAT: one mutant. Prints its fate.
try() {
  local dir=$PWD/$work/m$1 file=$2 line=$3 column=$4 length=$5 with=$6 what=$7
  rm -rf "$dir"
  mkdir -p "$dir/$(dirname "$file")"
  awk -v line="$line" -v at="$column" -v length_="$length" -v with="$with" \
    'FNR == line { $0 = substr($0, 1, at - 1) with substr($0, at + length_) } { print }' "$file" >"$dir/$file"
  local program=firmware_tests groups=$quick_groups own=() stem
  stem=$(basename "${file%.*}")
  case $file in
    */reference.hpp) own=(reference_stage) ;;
    */model.hpp | */model_file.*) own=(model_file classifier) ;;
    */coarse.*) own=(coarse) ;;
    */tree_io.hpp) own=(classifier) ;;
    */app.*) own=(app daemon) ;;
    */link.*) own=(command_frame status_frame) ;;
    */timing.hpp | */marker_frame.* | */recorder.*) own=(seeing) ;;
    */slot_store.*) own=(sealed) ;;
    */modes.hpp) own=(params) ;;
    */watchdog_thread.*) own=(watchdog) ;;
    */ed25519.*) own=(sealed) ;;
    */slot_file.*) own=(file_keep file_store) ;;
    */file_calls.*) own=(file_keep file_store folder_notes) ;;
    */monotonic_clock.*) own=(contract) ;;
    */hande.*) own=(hande) ;;
    *jpeg_*) program=jpeg_tests ;;
    *) own=("$stem") ;;
  esac
  [[ $file != firmware/tactile/* && $file != firmware/vision/* ]] || groups=$all_groups
  local sources=() test name
  for test in "${own[@]}"; do
    for name in tests/firmware/"$test"_test.cpp tests/firmware/*/"$test"_test.cpp "tests/drivers/${test}_test.cpp"; do
      [[ ! -f $name ]] || sources+=("$name")
    done
  done
  [[ $program != jpeg_tests ]] || { sources=(tests/jpeg/*_test.cpp) && groups=$(groups_of "${sources[@]}"); }

  # Compiles those of the given objects that see the file and have not been.
  compile() {
    local object source options made level
    while IFS=$'\t' read -r object source options; do
      made=$dir/$(tr / _ <<<"$object")
      [[ ! -f $made ]] || continue
      level=-O1
      [[ $source != tests/* ]] || level=-O0
      [[ $source != "$file" ]] || source=$dir/$file
      # shellcheck disable=SC2086  # a list of words
      eval "g++ -w -pipe $level -D_GLIBCXX_ASSERTIONS -I$dir/firmware -I$dir $options -c $source -o $made" 2>"$dir/log" || return 2
      printf '%s\n' "$object" >>"$dir/made"
    done < <(awk -F '\t' 'NR == FNR { wanted[$1]; next } $1 in wanted' - "$work/commands")
  }
  link() {
    local objects rest
    touch "$dir/made"
    objects=$(awk -v dir="$dir" 'NR == FNR { made[$0]; name = $0; gsub("/", "_", name); print dir "/" name; next } !($0 in made)' \
      "$dir/made" "$work/$1.objects")
    rest=$(<"$work/$1.rest")
    # shellcheck disable=SC2086  # lists of words
    (cd "$build" && g++ -fuse-ld=lld -Wl,--threads=1 $objects $rest -o "$dir/tests") 2>"$dir/log" || return 3
  }
  # The first failure ends it: grep leaves, and the next dot that is printed finds nobody.
  run() {
    { (ulimit -c 0 -t 120 && exec timeout 900 "$dir/tests" "$@") 2>&1 || printf '\nstatus %s\n' "$?"; } |
      grep -a -m 1 -oE 'Failure in TEST\(.*\)|^status .*' >"$dir/why" || return 0
    return 1
  }
  judge() {
    awk -F '\t' -v file="$file" '$1 == file { print $2 }' "$work/seen" | grep -E '/(holdfast_(firmware|common|sim|linux)|'"$program"')\.dir/' >"$dir/sees" || true
    # At first only what the file's own tests are made of, where many see it.
    awk -F '\t' -v own="${sources[*]}" -v file="$file" -v stem="/$stem." '
      BEGIN { split(own, list, " "); for (i in list) wanted[list[i]] }
      NR == FNR { sees[$1]; next }
      $1 in sees && ($2 in wanted || $2 == file || index($2, stem)) { print $1 }' "$dir/sees" "$work/commands" | compile || return
    link "$program" || return
    # shellcheck disable=SC2046  # a list of words
    run $(groups_of "${sources[@]}") || return
    compile <"$dir/sees" || return
    link "$program" || return
    # shellcheck disable=SC2086  # a list of words
    run $groups || return
    if [[ $file == drivers/common/* && $program == firmware_tests ]]; then
      link linux_tests || return
      run || return
    fi
  }
  local status=0 fate
  judge || status=$?
  case $status in
    0) fate=survived ;;
    1) fate=killed ;;
    2) fate="no mutant" ;;
    *) fate="not linked" ;;
  esac
  printf '%s\t%s:%s:%s: %s\t%s\n' "$fate" "$file" "$line" "$column" "$what" "$(cat "$dir/why" 2>/dev/null)"
  rm -rf "$dir"
}
export -f try
export build work quick_groups all_groups
nl -ba -w1 -s $'\t' "$work/chosen" | tr '\t' '\n' | xargs -d '\n' -n 7 -P "$(nproc)" bash -c 'try "$@"' try | tee "$work/fates" | awk -F '\t' '
  $1 == "survived" { print; fflush() } { if (++n % 25 == 0) print n " tried" > "/dev/stderr" }'
awk -F '\t' '
  { count[$1]++ }
  END {
    tried = count["killed"] + count["survived"]
    printf "%d mutants, %d killed, %d survived (%d did not compile, %d not linked): %.1f %%\n", tried, count["killed"],
      count["survived"], count["no mutant"], count["not linked"], tried ? 100 * count["killed"] / tried : 0
    exit !(tried && count["killed"] >= 0.92 * tried)
  }' "$work/fates"
