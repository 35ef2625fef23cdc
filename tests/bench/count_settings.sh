#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Instructions of a frame in each setting of `holdfast trade`, from the bytes of a 3280x2464 JPEG to the decision, by
# QEMU's plugin; those of rivals on x86-64 alone.
#   tests/bench/count_settings.sh [SETTINGS...] > counts.csv
# prints a line settings,x86_64,aarch64 for each (all when none is named), for `holdfast trade show --counts`; without
# counts when the setting refuses the film. Counted are the last four of a film's 14 pictures, in which a sphere slips.
# Needs the presets sim and rpi4, built, and the package qemu-user; three minutes for all.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh

few=10 many=14
for program in build/sim/bin/holdfast build/sim/bin/rival_cost build/rpi4/bin/setting_cost build/rpi4/tests/checks/insn.so; do
  [[ -e $program ]] || { complain "no $program" "not built" "cmake --build --preset sim --target holdfast programs, and preset rpi4; see README.md" && exit 2; }
done
command -v qemu-x86_64 >/dev/null || { complain "no qemu-x86_64" "not installed" "apt-get install qemu-user" && exit 2; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
film=$work/film.mjpg
build/sim/bin/setting_cost "$film"

# instructions QEMU PROGRAM ARGUMENT...: of a frame.
instructions() {
  local qemu=$1
  shift
  # A limit that nothing reaches: this is no check.
  MEASURED=$work/measured tests/checks/count_instructions.sh "$qemu" build/rpi4/tests/checks/insn.so 1000000000000 "$few" "$many" "$@" \
    >/dev/null
  awk '{ print $2 }' "$work/measured"
}
x86_64() { instructions qemu-x86_64 "$@"; }
aarch64() { instructions "qemu-aarch64 -L /usr/aarch64-linux-gnu" "$@"; }

if (($# > 0)); then
  printf '%s\n' "$@" >"$work/settings"
else
  build/sim/bin/holdfast trade settings >"$work/settings"
fi
while read -r settings; do
  status=0
  [[ $settings == rival=* ]] || build/sim/bin/setting_cost "$film" "$settings" "$many" >/dev/null || status=$?
  ((status == 0 || status == 3)) || exit "$status"
  if ((status == 3)); then
    echo "$settings,,"
  elif [[ $settings == rival=* ]]; then
    x86=$(x86_64 build/sim/bin/rival_cost "$film" "${settings#rival=}")
    echo "$settings,$x86,"
  else
    x86=$(x86_64 build/sim/bin/setting_cost "$film" "$settings")
    arm=$(aarch64 build/rpi4/bin/setting_cost "$film" "$settings")
    echo "$settings,$x86,$arm"
  fi
done <"$work/settings"
