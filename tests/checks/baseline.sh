#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Holds what was measured against what was measured before: tests/checks/baseline.csv, rows of name, value and the band
# in percent of the value within which it may lie (another table: the environment's BASELINE).
#   baseline.sh [--update] GROUP...      lines "name value" on stdin; a GROUP is all of a name before its first dot
# The bands have two sides: a gain that nobody wrote down would hide the loss after it. A row of the groups that was not
# measured, and a measurement without a row, fail as well. --update writes the values and keeps the bands; a new row's is
# 2 %. Exit status: 0 all within, 1 not, 2 wrong arguments.
set -euo pipefail
table=${BASELINE:-$(dirname "${BASH_SOURCE[0]}")/baseline.csv}
update=0
if [[ ${1:-} == --update ]]; then update=1 && shift; fi
if (($# == 0)); then
  echo "usage: baseline.sh [--update] GROUP... <MEASURED" >&2
  exit 2
fi

new=$(mktemp)
trap 'rm -f "$new"' EXIT
status=0
awk -v groups="$*" -v update="$update" -v new="$new" '
  function group(name) { sub(/\..*/, "", name); return name }
  BEGIN { n = split(groups, list, " "); for (i = 1; i <= n; ++i) asked[list[i]] = 1 }
  FILENAME == "-" { if (group($1) in asked) measured[$1] = $2; next }
  FNR == 1 { print > new; next }
  {
    split($0, row, ",")
    name = row[1]; was = row[2] + 0; band = row[3] + 0
    if (!(group(name) in asked)) { print > new; next }
    if (!(name in measured)) { missing[name] = 1; next }
    is = measured[name] + 0
    delete measured[name]
    off = is - was; if (off < 0) off = -off
    within = off * 100 <= band * (was < 0 ? -was : was)
    printf "%-36s %12s, %s%s %% of %s\n", name, is, within ? "within " : "OUTSIDE ", band, was
    if (!within) bad = 1
    print name "," is "," band > new
  }
  END {
    for (name in missing) { print name ": not measured any more"; bad = 1 }
    for (name in measured) { print name ": " measured[name] ", has no row"; bad = 1; print name "," measured[name] ",2" | ("sort >>" new ".rows") }
    exit !update && bad
  }' - "$table" || status=$?
if ((update == 1)); then
  { head -n 1 "$new"; { tail -n +2 "$new"; [[ ! -f $new.rows ]] || cat "$new.rows"; } | sort; } >"$table"
  echo "written: $table"
elif ((status != 0)); then
  echo "error: a cost left its band (code grew, shrank or got faster; see above). Next: find out why; if it is meant," \
    "write it down by the same command with --update, and say in the commit what moved"
fi
rm -f "$new.rows"
exit "$status"
