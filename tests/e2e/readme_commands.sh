#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The commands of all documents, as they are written, one after the other in a clean folder with a recording and the
# scenes. One that is not run is in the list below with its reason; one that is in neither fails.
#   tests/e2e/readme_commands.sh [BIN]      default build/sim/bin
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=tests/e2e/steps.sh
source tests/e2e/steps.sh
bin=$(realpath "${1:-build/sim/bin}") source=$PWD
work=$(mktemp -d)
daemon=
trap '[[ -z $daemon ]] || kill "$daemon" 2>/dev/null || true; rm -rf "$work"' EXIT

# PATTERN (of the whole command), a tab, WHY it is not run here.
left_out=$(
  cat <<'LIST'
.*(tests/run\.sh|tests/checks/|toolchain/demo\.sh).*	a part of the tests, or what calls them
.*(sysroot\.sh|cmake|board/|flash\.sh).*	the cross build and the card: parts rpi4 and system
.*(/holdfast\.link|holdfast-ros2).*	tests/python/test_robot.py, test_mqtt.py, test_ros2.py
holdfast doctor	on a board; tests/toolchain/inventory_test.cpp
.*holdfast live	wants the sensor; with --play it runs
.*holdfast record grasp\.mcap --seconds 20	wants the sensor; tests/e2e/own_data.sh records scenes
.*(mug_1|own_data\.sh|--load mine).*	tests/e2e/own_data.sh
.*holdfast faults --.*	minutes: tests/run.sh --long
.*host_tests -v -sg Process	minutes: tests/run.sh --long
.*trade firmware .*	ten minutes; tests/e2e/tool_test.cpp runs a piece
.*evaluate --recorded .*	wants the recordings; tests/bench/recorded.sh
.*cluster/submit\.sh.*	tests/e2e/cluster.sh
.*(hanging\.avi|gel\.toml).*	wants a weight on a gel; tests/toolchain/weigh_test.cpp
.*trials .*	a minute; tests/e2e/trials_test.cpp
.*holdfast (dataset|train|fuse|evaluate|compile) .*	half an hour; the tests of learn run each in small
LIST
)

# Documents in the order in which a reader meets them. A line of a block is a command when it begins like one.
commands=$(for document in README.md toolchain/README.md toolchain/*/README.md drivers/sim/scene/README.md firmware/README.md \
  board/README.md tests/README.md .github/CONTRIBUTING.md; do
  sed -nE 's/^    ((\.\/)?(build\/sim\/bin|toolchain|tests|board)\/[^ ]+\.?.*|holdfast .*|[A-Z_]+=[^ ]+ build\/.*)$/\1/p' "$document"
done | sed -E 's/ +# .*$//' | awk '!seen[$0]++')

mkdir -p "$work/here/build/sim"
ln -s "$bin" "$work/here/build/sim/bin"
ln -s "$source/tests" "$source/toolchain" "$work/here/"
cp tests/data/slip.mjpg "$work/here/grasp.avi"
cd "$work/here"

# The documents' desk board, where another one that runs on this machine is not in its way.
port=$work/holdfast.console

# run COMMAND: to its end. A page or a console that waits for somebody ends as that somebody ends it.
run() {
  case $1 in
    *'live --play '*) timeout -s INT -k 10 4 bash -c "exec $1" || (($? == 124)) ;;
    *'live --board '*) at_a_board timeout -s INT -k 10 4 bash -c "exec $1" || (($? == 124)) ;;
    *'--host '*'/holdfast.console &') start "${1%&}" ;;
    *'/holdfast console '*'/holdfast.console') bash -c "$1" <<<'status' ;;
    *--record*) timeout -s INT -k 10 3 bash -c "exec $1" || (($? == 124)) ;;
    *) bash -c "$1" ;;
  esac
}
start() {
  [[ -z $daemon ]] || { kill "$daemon" && wait "$daemon"; } || true
  bash -c "exec $1" &
  daemon=$!
  until_answers
}
# The document tells further down how a desk's board is started.
at_a_board() {
  start "build/sim/bin/holdfastd --real-time --held --host $port"
  "$@"
}
until_answers() {
  for _ in $(seq 100); do
    if [[ -e $port ]] && build/sim/bin/holdfast console "$port" --run version; then return 0; fi
    sleep 0.1
  done
  return 1
}

ran=0
while IFS= read -r command; do
  if why=$(awk -F '\t' -v command="$command" 'command ~ "^(" $1 ")$" { print $2; found = 1; exit } END { exit !found }' <<<"$left_out"); then
    printf 'left out: %s (%s)\n' "$command" "$why"
    continue
  fi
  status=0
  start=$SECONDS
  run "${command//\/tmp\/holdfast.console/$port}" >"$work/said" 2>&1 </dev/null || status=$?
  ((status == 0)) || fails "'$command' ended with $status"
  passes "$command ($((SECONDS - start)) s)"
  ran=$((ran + 1))
done <<<"$commands"
((ran >= 15)) || { echo "only $ran commands were found" >"$work/said" && fails "the documents' commands"; }
echo "$passed passed"
