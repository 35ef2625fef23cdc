#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The main job on a simulated grasp: installs what is missing, builds the tool for the sim board, sends a press, a
# shear and a slip as 3280x2464 JPEG frames through the firmware, and writes the report. Works from a clean clone on
# Debian 12 with git and bash. NO_COLOR is honoured.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=toolchain/packages.sh
source toolchain/packages.sh

report=build/demo/report.html
scene=tests/scenes/sphere_slip.json
demo=(build/sim/bin/holdfast sim "$scene" --report "$report" --overlay build/demo/overlay.png --features build/demo/features.csv)

case ${1:-} in
  '') ;;
  --help | -h)
    say "usage: toolchain/demo.sh    (installs, builds, runs: ${demo[*]})"
    exit 0
    ;;
  *)
    complain "unknown option '$1'" "the demo takes none" "run toolchain/demo.sh"
    exit 2
    ;;
esac
trap 'say ""; say "demo: interrupted; run toolchain/demo.sh again, it goes on where it stopped"; exit 130' INT TERM

# part NAME COMMAND...: runs COMMAND and says how long it took; ends the demo when it fails.
part() {
  local name=$1 start=$SECONDS
  shift
  heading "$name"
  if ! "$@"; then
    say ""
    say "${red}demo: failed${plain} at: $name (see the lines above)"
    exit 1
  fi
  say "   $((SECONDS - start)) s"
}

part "packages" ensure_packages build
# Without the tests, which would need more packages; tests/run.sh puts them back in.
part "configure (log: build/demo/configure.log)" quietly build/demo/configure.log cmake --preset sim -DBUILD_TESTING=OFF
part "build (log: build/demo/build.log)" quietly build/demo/build.log cmake --build --preset sim --target holdfast
part "a simulated grasp: ${demo[*]}" "${demo[@]}"
[[ -f $report ]] || {
  complain "the demo wrote no $report" "${demo[0]} ended early" "see its lines above"
  exit 1
}
say ""
say "${green}demo: done${plain} in $SECONDS s. The report: $PWD/$report"
