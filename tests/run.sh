#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs what is missing, builds, and runs the tests: without options those that prove the product in the shortest time,
# with --all every part, with --long the runs of hours, too. Works from a clean clone on Debian 12 with git and
# bash; the real recordings are used when they lie in ../shared/data/real beside the clone. See --help.
# The last line is "N passed, N failed, N skipped", summed over the parts; exit status 0 only when nothing failed.
set -uo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.." || exit 1
# shellcheck source=toolchain/packages.sh
source toolchain/packages.sh

parts=(packages format sim web system tidy coverage asan tsan rpi4 fuzz)
short_parts=(packages format sim)
declare -A what=(
  [packages]="install the Debian packages that are missing"
  [format]="clang-format on every source"
  [sim]="host build and its tests, heap calls from start() to stop() among them"
  [web]="npm packages: logs read by the official reader, page in Chromium"
  [tidy]="clang-tidy on what changed last and a sixteenth of the rest (--tidy: on every source that the host build compiles), beside the parts that follow"
  [coverage]="lines and branches of the firmware that its tests run, against baseline and list"
  [asan]="host build and tests by clang: memory, undefined behaviour and, in the firmware, integers that wrap or lose bits"
  [tsan]="tests of the worker threads with ThreadSanitizer"
  [rpi4]="aarch64 cross build, integer gate, tests and instruction counts under qemu-user"
  [system]="the cards; holdfastd with a stock kernel on an emulated machine: start, slip, replug, a kill, an update; beside the parts that follow"
  [deb]="the host tool as a Debian package: lintian, and a fresh root that installs it and plays a scene"
  [deb13]="the same built in a root of Debian 13, without the device libraries"
  [deb_arm64]="the same cross-built for arm64, run under qemu-user with what it depends on"
  [long]="the runs that take long: faults in pairs, soak, kills, book pulls, trials, all histograms"
  [fuzz]="fuzz the parsers with libFuzzer for a minute (tests/fuzz/run.sh for longer)"
)

usage() {
  cat <<'USAGE'
usage: tests/run.sh [--all] [--only PART]... [--long] [--system] [--tidy]
Installs what is missing (apt-get, with sudo when not root), builds, and runs the tests part by part: without options the
parts packages, format and sim without its longest tests, about twelve minutes of two cores on a machine that has installed and built nothing.
  --all        every part in full, what continuous integration runs: 40 minutes
  --only PART  just this part in full; may be given again. The parts, in order:
USAGE
  local part
  for part in "${parts[@]}" deb deb13 deb_arm64; do printf '                 %-9s %s\n' "$part" "${what[$part]}"; done
  cat <<'USAGE'
  --long       --all, or the parts named by --only, and the runs that take long, an hour or more: all pairs of faults, a
               soak of a day of frames, a million frames of the firmware without a heap call, 500 boards at an MQTT broker, 200 kills and stops, 200
               book pulls, 500 trials of each kind, the entropy of every histogram, what the sanitizers and the emulated
               processor are spared; on the emulated machine 100 replugs, 100 kills, 50 power cuts of an update and the heap calls of 10 000
               frames
  --system     add part system with all scenarios instead of the short set: hang, watchdog, gripper, two sensors, an update
               from a server, and the machine by itself
  --tidy       add part tidy on every source, 20 minutes on a fresh clone, instead of what changed of late and a share
  --help       this
Logs are in build/test-logs. NO_COLOR is honoured. What ccache, where it is installed, has compiled in another clone is
not compiled again.
Example: tests/run.sh --only sim
USAGE
}

chosen=() all=0 long=0 all_scenarios=0 whole_tidy=0
while (($# > 0)); do
  case $1 in
    --only)
      if [[ -z ${2:-} || -z ${what[$2]:-} ]]; then
        complain "--only '${2:-}' is no part" "a typing error" "give one of: ${parts[*]} deb deb13 deb_arm64"
        exit 2
      fi
      chosen+=("$2")
      shift
      ;;
    --all) all=1 ;;
    --long) long=1 ;;
    --system) all_scenarios=1 ;;
    --tidy) whole_tidy=1 ;;
    --help | -h) usage && exit 0 ;;
    *)
      complain "unknown option '$1'" "a typing error" "see tests/run.sh --help"
      exit 2
      ;;
  esac
  shift
done
short=0
if ((all || (long && ${#chosen[@]} == 0))); then
  chosen=("${parts[@]}")
elif ((${#chosen[@]} == 0)); then
  short=1
  chosen=("${short_parts[@]}")
fi
is_chosen() { [[ " ${chosen[*]} " == *" $1 "* ]]; }
# add PART: unless it is there.
add() { is_chosen "$1" || chosen+=("$1"); }
((whole_tidy == 0)) || add tidy
((all_scenarios == 0)) || add system
if ((long)); then
  add deb
  add deb13
  add deb_arm64
  add long
fi

# use_ccache: where it is installed and may write, the same sources are compiled once on a machine, whatever the clone's
# folder. CMake takes the launchers from here when it configures for the first time.
use_ccache() {
  local cache
  if [[ -z ${CMAKE_CXX_COMPILER_LAUNCHER:-} ]] && cache=$(ccache --get-config cache_dir 2>/dev/null) &&
    mkdir -p "$cache" 2>/dev/null && [[ -w $cache ]]; then
    export CMAKE_C_COMPILER_LAUNCHER=ccache CMAKE_CXX_COMPILER_LAUNCHER=ccache
    export CCACHE_BASEDIR=${CCACHE_BASEDIR:-$PWD} CCACHE_NOHASHDIR=1
  fi
}
stamps=${XDG_CACHE_HOME:-${HOME:-$PWD/build}/.cache}/holdfast/tidy
if mkdir -p "$stamps" 2>/dev/null && [[ -w $stamps ]]; then export HOLDFAST_TIDY_STAMPS=$stamps; fi

logs=build/test-logs
# Groups whose work is the same as their neighbours', only more of it: the sanitizers and the emulator leave them out.
slow_groups='ContactGridFine|GalleryTwice|FaultsSoak|host_tests.Grip|host_tests.Process|host_tests.ConsoleFlood'
# And what only --long runs there: under the sanitizers the host's own tools and the checks of documents; under the emulator
# what knows no processor - files, disks, texts, calls of the system that fail - and what the digest or the groups Twins (a
# form for one processor against the plain one) compare already.
not_sanitized='PowerCut|checks.evidence|checks.links'
not_emulated='PowerCut|FailingCalls|firmware_tests.Console|LineEditor|Entropy|Render|Tracker|ModelFile|firmware_tests.Models|Imprint|HandE|PictureCheck$|JpegDc|JpegFast$'
# What the run without options leaves to --all, as well.
not_short='RealClips|firmware_tests.Simulation|PowerCut|GalleryTwice|FaultsSoak|host_tests.Grip|JpegCorruption|JpegFuzz|PictureCheckOnClips|ContactGridFine|e2e.flash_loop'
not_short+='|checks.evidence_refuses|e2e.update_releases|python.lerobot|FailingCalls|python.mqtt|python.ros2|e2e.update_keys|ImprintClips|ImprintGrasps|LogFiles|ReplayReference|Flicker|e2e.update_pull|e2e.cluster|ConsoleFlood|EvaluateRecorded|host_tests.Paper|host_tests.Recordings|host_tests.Trade'
passed=0 failed=0 skipped=0
failures=() skips=() times=()

# count_one NAME STATUS: a check that is one test.
count_one() {
  if (($2 == 0)); then passed=$((passed + 1)); else failed=$((failed + 1)) && failures+=("$1"); fi
  return "$2"
}

# step NAME COMMAND...: COMMAND with its output in the log NAME and its time on the screen.
step() {
  local name=$1 start=$SECONDS status=0 verdict="done"
  shift
  quietly "$logs/${name// /-}.log" "$@" || status=$?
  ((status == 0)) || verdict="${red}failed${plain}"
  say "   $name: $verdict in $((SECONDS - start)) s"
  return "$status"
}

# build PRESET: configures and builds it, once; a failure counts as one failed test, whoever asks again.
declare -A built=()
build() {
  if [[ -z ${built[$1]:-} ]]; then
    local -a forget=()
    [[ -n ${CMAKE_CXX_COMPILER_LAUNCHER:-} ]] || forget=(-UCMAKE_C_COMPILER_LAUNCHER -UCMAKE_CXX_COMPILER_LAUNCHER)
    if step "$1 configure" cmake --preset "$1" "${forget[@]}" && step "$1 build" cmake --build --preset "$1"; then
      built[$1]=yes
    else
      built[$1]=no
      count_one "$1: build" 1
    fi
  elif [[ ${built[$1]} == no ]]; then
    say "   left out: the $1 build failed above"
  fi
  [[ ${built[$1]} == yes ]]
}

# run_ctest NAME PRESET CTEST-ARGUMENT...: runs the tests and counts them from ctest's own report.
run_ctest() {
  local name=$1 preset=$2 start=$SECONDS status=0 ok=0 bad=0 out=0 test result reason
  shift 2
  local report=$PWD/$logs/${name// /-}.xml log=$logs/${name// /-}.log
  rm -f "$report"
  ctest --preset "$preset" -j "$(nproc)" --output-junit "$report" "$@" >"$log" 2>&1 </dev/null || status=$?
  while IFS=$'\t' read -r test result reason; do
    case $result in
      run) ok=$((ok + 1)) ;;
      fail) bad=$((bad + 1)) && failures+=("$name: $test") ;;
      *) out=$((out + 1)) && skips+=("$name: $test: ${reason:-$result}") ;;
    esac
  done < <(read_report "$report")
  if ((bad == 0 && status != 0)); then
    bad=1
    failures+=("$name: ctest ended with status $status")
    tail -n 20 "$log" | sed 's/^/   | /'
  elif ((bad > 0)); then
    say "   what failed, from $log:"
    grep -E -A 4 'error: Failure in|runtime error:|ERROR: AddressSanitizer|\*\*\*(Failed|Timeout|Exception)|^[[:alpha:].]*[eE]rror:' "$log" |
      head -n 60 | sed 's/^/   | /'
  fi
  passed=$((passed + ok)) failed=$((failed + bad)) skipped=$((skipped + out))
  say "   $name: $ok passed, $bad failed, $out skipped in $((SECONDS - start)) s"
  ((bad == 0))
}

# read_report FILE: ctest's report (JUnit form) as lines of test, status (run, fail, notrun, disabled), reason to skip.
read_report() {
  [[ -s $1 ]] || return 0
  awk '
    function flush() { if (test != "") printf "%s\t%s\t%s\n", test, status, reason }
    /<testcase / {
      flush()
      test = $0; sub(/.*<testcase name="/, "", test); sub(/".*/, "", test)
      status = $0; sub(/.* status="/, "", status); sub(/".*/, "", status)
      reason = ""
    }
    /SKIPPED: / && reason == "" { reason = $0; sub(/.*SKIPPED: /, "", reason); sub(/<\/system-out>.*/, "", reason) }
    END { flush() }' "$1"
}

part_packages() {
  local status=0
  local -a groups=(build test)
  [[ ${chosen[*]} == "${short_parts[*]}" ]] || groups+=(lint cross system fuzz)
  ((all == 0 && long == 0)) || groups+=(cluster)
  ensure_packages "${groups[@]}" || status=1
  count_one packages "$status"
}
part_format() {
  local status=0
  step format tests/checks/format.sh || status=1
  count_one "format (tests/checks/format.sh --fix)" "$status"
}
# Half of the host's tests wait for processes and terminals: meanwhile, with what they leave of the cores, the builds of
# the parts to come. Those parts build again and find nothing to do, or what failed.
ahead_pid=''
begin_ahead() {
  (
    renice -n 19 -p "$BASHPID" >/dev/null
    ! is_chosen coverage || tests/checks/coverage.sh --build
    local preset
    for preset in asan tsan; do ! is_chosen "$preset" || build "$preset"; done
    if is_chosen rpi4 && toolchain/sysroot.sh --newer; then build rpi4; fi
  ) >"$logs/ahead.log" 2>&1 </dev/null &
  ahead_pid=$!
}
end_ahead() {
  [[ -z $ahead_pid ]] || wait "$ahead_pid"
  ahead_pid=''
}
part_sim() {
  local -a which=()
  ((short == 0)) || which=(--exclude-regex "$not_short")
  build sim || return 1
  ((short)) || step "sim programs" cmake --build --preset sim --target programs || count_one "sim: programs that only measure" 1
  begin_ahead
  if ! is_chosen coverage; then
    run_ctest "sim tests" sim "${which[@]}"
    return
  fi
  # The firmware's own tests run in part coverage of the same run, for the same processor. By name: of several label
  # expressions ctest leaves out only what matches all, and the preset has one.
  local status=0
  run_ctest "sim tests" sim --exclude-regex '^(firmware_tests|jpeg_tests)\.' || status=1
  run_ctest "sim physics" sim --label-regex '^physics$' || status=1
  return "$status"
}
# Begins here and goes on until end_tidy, with what the other parts leave of the cores.
tidy_pid=''
part_tidy() {
  local -a share=(--some)
  ((whole_tidy == 0)) || share=()
  nice -n 19 tests/checks/tidy.sh "${share[@]}" >"$logs/tidy.log" 2>&1 </dev/null &
  tidy_pid=$!
}
end_tidy() {
  local status=0
  wait "$tidy_pid" || status=1
  tidy_pid=''
  ((status == 0)) || sed 's/^/   | /' "$logs/tidy.log"
  grep '^tidy: ' "$logs/tidy.log" | sed 's/^/   /'
  count_one "tidy (tests/checks/tidy.sh)" "$status"
}
part_coverage() {
  local status=0
  step coverage tests/checks/coverage.sh || status=1
  sed 's/^/   /' "$logs/coverage.log"
  count_one "coverage (tests/checks/coverage.sh)" "$status"
}
part_asan() { build asan && run_ctest "asan tests" asan --exclude-regex "$slow_groups|$not_sanitized" --label-exclude 'physics|long|host_tests'; }
part_tsan() {
  build tsan || return 1
  local status=0
  step "tsan crew" build/tsan/bin/thread_tests -v -sg Crew || status=1
  step "tsan watchdog" build/tsan/bin/thread_tests -v -sg Watchdog || status=1
  step "tsan bridge" build/tsan/bin/thread_tests -v -sg LinuxBridge || status=1
  step "tsan jpeg" build/tsan/bin/thread_tests -v -sg JpegFast -sn NeverDisagreesWithItselfOrThePlainWalkOnCameraPictures ||
    status=1
  count_one "tsan (tests/run.sh --only tsan)" "$status"
}
part_fuzz() {
  local status=0
  step fuzz tests/fuzz/run.sh 60 || status=1
  grep -E 'executions|finding' "$logs/fuzz.log" | sed 's/^/   /'
  count_one "fuzz (tests/fuzz/run.sh)" "$status"
  ((status == 0)) || return 1
  step "fuzz digest build" ninja -C build/fuzz digest && step "fuzz digest" build/fuzz/bin/digest tests/checks/digest.txt
  count_one "digest by clang (build/fuzz/bin/digest tests/checks/digest.txt)" $?
}
# node_check NAME SCRIPT: a check that runs in node and says "N passed" at its end, or why it skips (status 77).
node_check() {
  local name=$1 start=$SECONDS status=0 log=$logs/${1// /-}.log
  node "$2" --bin build/sim/bin >"$log" 2>&1 </dev/null || status=$?
  case $status in
    0) passed=$((passed + $(sed -n '$s/ passed$//p' "$log"))) ;;
    77) skipped=$((skipped + 1)) skips+=("$name: $(sed -n 's/^SKIPPED: //p' "$log")") ;;
    *)
      tail -n 30 "$log" | sed 's/^/   | /'
      count_one "$name (node $2)" "$status"
      ;;
  esac
  say "   $name: $(tail -n 1 "$log") in $((SECONDS - start)) s"
}
part_web() {
  ensure_packages web || note "no Chromium: the page is left out"
  build sim || return 1
  if ! command -v npm >/dev/null; then
    skipped=$((skipped + 1)) skips+=("web: no npm. Next: apt-get install nodejs npm")
    return 0
  fi
  step "web packages" npm --prefix tests/npm ci || {
    count_one "web: npm ci in tests/npm" 1
    return 1
  }
  local status=0
  step "web logs" tests/npm/check_logs.sh || status=1
  sed 's/^/   /' "$logs/web-logs.log"
  count_one "web logs (tests/npm/check_logs.sh)" "$status"
  node_check "web lerobot" tests/npm/check_lerobot.mjs
  node_check "web wire" tests/npm/check_wire.mjs
  node_check "web page" tests/npm/check_page.mjs
  node_check "web live" tests/npm/check_live.mjs
}
# package NAME OPTION...: the Debian package of deb.sh OPTION...
package() {
  ensure_packages deb || return 1
  local name=$1 status=0
  shift
  step "$name" toolchain/install/deb.sh "$@" || status=1
  sed 's/^/   /' "$logs/$name.log"
  count_one "$name (toolchain/install/deb.sh $*)" "$status"
}
part_deb() { build sim && package deb --check; }
part_deb_arm64() { ensure_packages cross && build sim && package deb_arm64 --arch arm64 --check; }
part_deb13() { package deb13 --release trixie --check; }
part_long() {
  build sim || return 1
  step "long faults" build/sim/bin/holdfast faults --pairs
  count_one "holdfast faults --pairs" $?
  step "long soak" env HOLDFAST_SOAK_FRAMES=2160000 build/sim/bin/host_tests -v -sg FaultsSoak
  count_one "HOLDFAST_SOAK_FRAMES=2160000 host_tests -sg FaultsSoak" $?
  step "long fleet" env HOLDFAST_FLEET=500 ctest --test-dir build/sim -R '^python.mqtt$' --output-on-failure --no-tests=error
  count_one "HOLDFAST_FLEET=500 ctest --test-dir build/sim -R '^python.mqtt$'" $?
  step "long heap" ctest --test-dir build/sim -R '^checks.heap_free_luma_million$' --output-on-failure --no-tests=error
  count_one "ctest --test-dir build/sim -R '^checks.heap_free_luma_million$'" $?
  step "long kills" env HOLDFAST_KILLS=200 build/sim/bin/host_tests -v -sg Process
  count_one "HOLDFAST_KILLS=200 host_tests -sg Process" $?
  step "long grip" env HOLDFAST_GRIP_PULLS=200 build/sim/bin/host_tests -v -sg Grip
  count_one "HOLDFAST_GRIP_PULLS=200 host_tests -sg Grip" $?
  step "long trials" env HOLDFAST_TRIALS=500 build/sim/bin/host_tests -v -sg Trials
  count_one "HOLDFAST_TRIALS=500 host_tests -sg Trials" $?
  if step "long image" bash -c 'toolchain/sysroot.sh --newer && cmake --preset rpi4 && cmake --build --preset rpi4 &&
    cmake --build --preset sim --target system_film_made system_scenarios && tests/system/prepare.sh'; then
    step "long machine" env HOLDFAST_CYCLES=100 HOLDFAST_HEAP_FRAMES=10000 HOLDFAST_CUTS=50 build/sim/bin/system_scenarios -v \
      -sg Holdfastd -sg Card -sn LeaksNothingThroughKills -sn LeaksNothingThroughReplugs -sn TakesNoMemoryOnceItRuns \
      -sn OutlivesPowerCutsWhileItInstalls
    count_one "HOLDFAST_CYCLES=100 HOLDFAST_HEAP_FRAMES=10000 HOLDFAST_CUTS=50 system_scenarios -sg Holdfastd -sg Card" $?
    run_ctest "long rpi4 physics" rpi4 --label-regex physics --exclude-regex "$slow_groups"
    run_ctest "long rpi4 tests" rpi4 --tests-regex "$not_emulated"
  else
    count_one "long: image" 1
  fi
  if step "long asan" bash -c 'cmake --preset asan -DHOLDFAST_HOST_TESTS=ON &&
    cmake --build --preset asan && cmake --build --preset asan --target host_tests'; then
    run_ctest "long asan tests" asan --exclude-regex "$slow_groups"
    cmake --preset asan -DHOLDFAST_HOST_TESTS=OFF >/dev/null
  else
    count_one "long: asan" 1
  fi
  step "long histograms" env HOLDFAST_ALL_HISTOGRAMS=1 build/sim/bin/firmware_tests -v -sg Entropy
  count_one "HOLDFAST_ALL_HISTOGRAMS=1 firmware_tests -sg Entropy" $?
}
part_rpi4() {
  step "rpi4 sysroot" toolchain/sysroot.sh --newer || {
    count_one "rpi4: sysroot" 1
    return 1
  }
  build rpi4 || return 1
  say "   integer gate: base, vision, tactile and slip compile without floating-point registers"
  count_one "rpi4: integer gate" 0
  local status=0
  # That the simulator's arithmetic gives the same bits here is told by the group Portable, and the firmware's by the digest.
  run_ctest "rpi4 tests" rpi4 --exclude-regex "$slow_groups|$not_emulated" --label-exclude physics || status=1
  grep -oE '[a-z_]+: [0-9]+ instructions per frame \(limit [0-9]+' "$logs/rpi4-tests.xml" | grep -v insn_selftest | sed 's/^/   /; s/$/)/'
  return "$status"
}

# What the emulated machine needs of the builds.
build_for_system() {
  step "system sysroot" toolchain/sysroot.sh --newer || {
    count_one "system: sysroot" 1
    return 1
  }
  build rpi4 && build sim || return 1
  step "system film" cmake --build --preset sim --target system_film_made system_scenarios || {
    count_one "system: film" 1
    return 1
  }
}
run_system() {
  local -a made=(flat card)
  ((all_scenarios == 0)) || made+=(pull)
  step "system image" tests/system/prepare.sh "${made[@]}" || {
    count_one "system: image (tests/system/prepare.sh)" 1
    return 1
  }
  grep -h 'not as locked' "$logs/system-image.log" | sort -u | sed 's/^/   /'
  local status=0
  local -a pi=(board/image/build.sh rpi4 --newer)
  [[ ! -f build/image/virt/keys/keyring.pem ]] || pi+=(--keyring build/image/virt/keys/keyring.pem)
  # A mirror need not carry non-free-firmware, where the Pi's first stages are.
  if step "system first stages" board/image/firmware.sh rpi4 --newer; then
    step "system Pi card" "${pi[@]}" && step "system card image" tests/system/card_image.sh || status=1
    grep '^card: ' "$logs/system-card-image.log" | sed 's/^/   /'
    count_one "system: the Pi 4's card (tests/system/card_image.sh)" "$status"
    if ((all_scenarios)); then
      step "system raspi3b" tests/system/raspi3b.sh
      count_one "system: the Pi's card on an emulated Pi 3 (tests/system/raspi3b.sh)" $?
    fi
    status=0
  else
    skipped=$((skipped + 1)) skips+=("system: the Pi 4's card: its first stages (raspi-firmware) cannot be had, see $logs/system-first-stages.log")
  fi
  local -a scenarios=(-sg Holdfastd -sg Card -sn StartsAndBecomesFineOnAnEmptyGel -sn ASlipIsAnEdge -sn GoesOnAfterAReplug
    -sn DoesNotTakeAnotherCamera -sn IsBackAfterAKill -sn SkipsDamagedFrames -sn IsNotFooledByAFrozenPicture
    -sn MayDoNoMoreThanItNeeds -sn LeavesNoLineHighWhenItIsKilled -sn StartsByUBootAndBecomesFine
    -sn RefusesWhatItsOwnerDidNotSign -sn TakesTheNewestUpdateAndKeepsItOnceItsFramesAreOk)
  ((all_scenarios == 0)) || scenarios=()
  step "system scenarios" build/sim/bin/system_scenarios -v "${scenarios[@]}" || status=1
  grep -E '^TEST\(|^OK|^Errors' "$logs/system-scenarios.log" | sed 's/^/   /'
  count_one "system (build/sim/bin/system_scenarios)" "$status"
}
# run_system with counts of its own, which it writes down: the script's are beyond its reach when it goes on beside it.
count_system() {
  local passed=0 failed=0 skipped=0
  local -a failures=() skips=()
  run_system
  {
    echo "$passed $failed $skipped"
    ((${#failures[@]} == 0)) || printf 'failed: %s\n' "${failures[@]}"
    ((${#skips[@]} == 0)) || printf 'skipped: %s\n' "${skips[@]}"
  } >"$logs/system.counts"
}
# The emulated machine keeps one core busy, for a third of the time of all parts. So it begins here and goes on until
# end_system, when parts follow: those give way, because what waits for the machine waits for so many seconds.
system_pid=''
part_system() {
  build_for_system || return 1
  if [[ ${chosen[-1]} == system ]]; then
    run_system
    return
  fi
  rm -f "$logs/system.counts"
  # As a process group of its own, which an interrupt can end as a whole.
  set -m
  count_system >"$logs/system.log" 2>&1 </dev/null &
  set +m
  system_pid=$!
  renice -n 10 -p $$ >/dev/null 2>&1 || true
}
merge_system() {
  wait "$system_pid"
  system_pid=''
  cat "$logs/system.log"
  local good bad out line
  {
    read -r good bad out && while IFS= read -r line; do
      case $line in
        'failed: '*) failures+=("${line#failed: }") ;;
        *) skips+=("${line#skipped: }") ;;
      esac
    done
  } <"$logs/system.counts" || {
    good=0 bad=1 out=0
    failures+=("system: it ended without a result, see $logs/system.log")
  }
  passed=$((passed + good)) failed=$((failed + bad)) skipped=$((skipped + out))
}
end_system() {
  [[ -n $system_pid ]] || return 0
  heading "system: its end"
  timed "system end" merge_system
}

# processor_seconds: of all that this script has started and seen the end of.
processor_seconds() {
  local -a fields
  read -ra fields </proc/$$/stat
  echo $(((fields[15] + fields[16]) / $(getconf CLK_TCK)))
}

# timed NAME COMMAND: runs COMMAND, and keeps for the closing table how long it took and what it counted.
timed() {
  local start=$SECONDS cpu ok=$passed bad=$failed out=$skipped
  cpu=$(processor_seconds)
  "$2"
  times+=("$(printf '%-11s%9d%9d%9d%8d%9d' "$1" $((SECONDS - start)) $(($(processor_seconds) - cpu)) \
    $((passed - ok)) $((failed - bad)) $((skipped - out)))")
}

closing() {
  heading "result after $((SECONDS / 60)) min $((SECONDS % 60)) s"
  local line
  printf '%-11s%9s%9s%9s%8s%9s\n' part seconds "cpu s" passed failed skipped
  for line in "${times[@]}"; do say "$line"; done
  for line in "${skips[@]}"; do say "skipped: $line"; done
  ((short == 0)) || {
    say "left out: the parts web, coverage, asan, tsan, rpi4, tidy, system and fuzz (--all, or --only PART)"
    say "left out: of part sim ${not_short//|/, } (--all, or --only sim)"
  }
  ((short == 1 || long == 1)) || {
    say "left out under the sanitizers: the host tool, programs, physics, ${not_sanitized//|/, } (--long), ${slow_groups//|/, } (they ran in parts sim and coverage)"
    say "left out under emulation: physics, ${not_emulated//|/, } (--long), ${slow_groups//|/, } (they ran in parts sim and coverage)"
  }
  ((long == 1)) || say "left out (--long): the Debian package in a fresh root of Debian 12 and of 13, and for arm64 (--only deb, deb13, deb_arm64), pairs of faults, soak of 2160000 frames, a million frames without a heap call (100000 here), 500 boards at an MQTT broker (5 here), 200 kills, 200 book pulls, 500 trials of each kind, all histograms, what the sanitizers and the emulated processor are spared, 100 replugs and kills of the emulated machine, 50 power cuts of an update"
  ((all_scenarios == 1)) || say "left out (--system): on the emulated machine hang, gripper, watchdog, two sensors, the machine by itself, power cuts, fall-back, an update from a server, an emulated Pi 3"
  for line in "${failures[@]}"; do say "${red}failed:${plain} $line"; done
  say "$passed passed, $failed failed, $skipped skipped"
}

trap '[[ -z $tidy_pid$ahead_pid$system_pid ]] || kill -- $tidy_pid $ahead_pid ${system_pid:+-$system_pid}; failures+=("interrupted") failed=$((failed + 1)); closing; exit 130' INT TERM

mkdir -p "$logs"
for part in "${chosen[@]}"; do
  # It has an emulated machine of its own, in the same folders.
  [[ $part != long ]] || end_system
  heading "$part: ${what[$part]}"
  use_ccache
  if [[ -n $ahead_pid && $part != web ]]; then timed "builds" end_ahead; fi
  timed "$part" "part_$part"
done
if [[ -n $tidy_pid ]]; then
  heading "tidy: its end"
  timed "tidy's end" end_tidy
fi
end_system
closing
((failed == 0))
