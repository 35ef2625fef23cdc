#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The walk of somebody with a sensor and objects of his own, without a sensor: record, label, learn, load. Scenes stand
# before the camera, and their truth for the person who labels.
#   tests/e2e/own_data.sh [BIN]      default build/sim/bin
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=tests/e2e/steps.sh
source tests/e2e/steps.sh
bin=$(realpath "${1:-build/sim/bin}")
work=$(mktemp -d)
daemon=
trap '[[ -z $daemon ]] || kill "$daemon" 2>/dev/null || true; rm -rf "$work"' EXIT

record() { "$bin/holdfast" record "$work/$1.mcap" --play "tests/scenes/$1.json" --seconds "$2"; }
says "a slide is recorded" "^recorded .* frames$" record relief_slip_20_mm_s 2.36
says "a twist is recorded" "^recorded " record relief_twist 3.36
says "a hold is recorded" "^recorded " record bumps_hold 2.56

# As the report's page writes it, one line for each recording; frames of the scenes' truth.
cat >"$work/labels.csv" <<'LABELS'
clip,contact_start,contact_end,slip_start,slip_end,onset_recorded,silent_intervals,empty_intervals,confidence
relief_slip_20_mm_s.mcap,16,45,33,43,1,24-31:high,2-13,high
relief_twist.mcap,16,75,40,70,1,25-31:high,2-13,high
bumps_hold.mcap,16,63,,,0,25-62:high,2-13,high
LABELS
learn() { HOLDFAST="$bin/holdfast" toolchain/learn/own_data.sh "$work/labels.csv" "$work/own"; }
says "own_data.sh makes a model of them, and says how to load it" "^load it, .*  holdfast console .* --load .*own.sealed$" learn

# A device takes it and decides by it from its next start on.
start() {
  "$bin/holdfastd" --real-time --empty --host "$work/port" --models "$work/models" --settings "$work/settings" >"$work/daemon" 2>&1 &
  daemon=$!
  for _ in $(seq 100); do
    [[ -e $work/port ]] && "$bin/holdfast" console "$work/port" --run version >"$work/said" 2>&1 && return
    sleep 0.1
  done
  return 1
}
stop() {
  kill "$daemon"
  wait "$daemon" || fails "the device does not end in order"
  daemon=
}
echo desk >"$work/code"
start || fails "a device does not start"
load() { "$bin/holdfast" console "$work/port" --code-file "$work/code" --load "$work/own/own.sealed"; }
says "a device takes the model" "" load
stop
start || fails "it does not start anew"
says "and decides by it from its next start on" '"model":"own"' "$bin/holdfast" console "$work/port" --run 'version json'
stop
echo "$passed passed"
