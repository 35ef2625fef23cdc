#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# baseline.sh refuses what is above its band, below it, not measured, or not known, and writes its table anew.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export BASELINE=$work/table.csv
printf 'name,value,band_pct\nother.x,5,0\nsize.a,100,2\nsize.b,50,0\n' >"$BASELINE"

# judged STATUS NAME VALUE...: what baseline.sh says about these measurements of the group size.
judged() {
  local wanted=$1 status=0
  shift
  printf '%s %s\n' "$@" | "$(dirname "${BASH_SOURCE[0]}")/baseline.sh" size >"$work/log" || status=$?
  ((status == wanted)) && return
  cat "$work/log"
  echo "error: '$*' gave status $status instead of $wanted"
  exit 1
}
judged 0 size.a 100 size.b 50
judged 0 size.a 102 size.b 50 another.group 7
judged 0 size.a 98 size.b 50
judged 1 size.a 103 size.b 50
judged 1 size.a 97 size.b 50
judged 1 size.a 100 size.b 51
judged 1 size.a 100
judged 1 size.a 100 size.b 50 size.c 1
printf 'size.a 103\nsize.c 1\n' | "$(dirname "${BASH_SOURCE[0]}")/baseline.sh" --update size >"$work/log"
diff "$BASELINE" <(printf 'name,value,band_pct\nother.x,5,0\nsize.a,103,2\nsize.c,1,2\n')
echo "baseline.sh refuses what it should"
