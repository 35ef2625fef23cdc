#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Instructions that an aarch64 program spends per frame, counted by emulation:
#   count_instructions.sh QEMU PLUGIN LIMIT FEW MANY PROGRAM [ARGUMENT...]
# runs `PROGRAM ARGUMENT... N` with N = FEW and N = MANY frames; the difference over MANY - FEW is the cost of one
# frame without start-up. Fails when that is above LIMIT, or when PROGRAM fails. QEMU may carry arguments of its own
# ("qemu-aarch64 -L DIR"); it must be the one of the package qemu-user (the static one refuses plugins). The figure goes
# to the file MEASURED, too, when that is set, as "instructions.NAME figure" (costs.sh).
set -euo pipefail
if (($# < 6)); then
  echo "usage: count_instructions.sh QEMU PLUGIN LIMIT FEW MANY PROGRAM [ARGUMENT...]" >&2
  exit 2
fi
read -ra qemu <<<"$1"
plugin=$2 limit=$3 few=$4 many=$5
shift 5

output=$(mktemp)
trap 'rm -f "$output"' EXIT

# count N: the program's guest instructions with N frames.
count() {
  if ! "${qemu[@]}" -plugin "$plugin" "${program[@]}" "$1" >"$output" 2>&1; then
    cat "$output" >&2
    echo "error: '${program[*]} $1' failed under ${qemu[0]} (a program error, or a QEMU without plugins)." \
      "Next: see the lines above; plugins need the package qemu-user" >&2
    return 1
  fi
  if ! sed -n 's/^guest instructions: \([0-9]\{1,\}\)$/\1/p' "$output" | grep .; then
    echo "error: no instruction count for '${program[*]} $1' (the plugin did not run). Next: look at $plugin" >&2
    return 1
  fi
}

program=("$@")
short=$(count "$few")
long=$(count "$many")
per_frame=$(((long - short) / (many - few)))
echo "$(basename "$1"): $per_frame instructions per frame (limit $limit; $((many - few)) frames: $long - $short)"
if [[ -n ${MEASURED:-} ]]; then
  mkdir -p "$(dirname "$MEASURED")"
  echo "instructions.$(basename "$MEASURED") $per_frame" >"$MEASURED"
fi
((per_frame > 0 && per_frame <= limit))
