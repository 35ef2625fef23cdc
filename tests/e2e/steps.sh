# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash disable=SC2154
# The steps of a script that tries others: sourced, not run. Each that passes says "ok" and counts in `passed`; one that
# fails shows what was said, and ends the script. `work`, a folder, is the script's.
passed=0

# needs TOOL...: without one the script is skipped.
needs() {
  local tool
  for tool in "$@"; do
    command -v "$tool" >/dev/null && continue
    echo "SKIPPED: no $tool. Next: tests/run.sh --only packages"
    exit 77
  done
}
passes() {
  passed=$((passed + 1))
  echo "ok   $1"
}
fails() {
  printf 'error: %s:\n' "$1"
  sed 's/^/   | /' "$work/said"
  exit 1
}
# says WHAT PATTERN COMMAND...: it succeeds and says so.
says() {
  "${@:3}" >"$work/said" 2>&1 </dev/null || fails "$1: status $?"
  grep -qE -- "$2" "$work/said" || fails "$1: no word of /$2/"
  passes "$1"
}
# refuses WHAT PATTERN COMMAND...: it fails and says so.
refuses() {
  if "${@:3}" >"$work/said" 2>&1 </dev/null; then fails "$1: it was done"; fi
  grep -qE -- "$2" "$work/said" || fails "$1: no word of /$2/"
  passes "$1"
}
# is WHAT WANTED GOT
is() {
  echo "$3" >"$work/said"
  [[ $2 == "$3" ]] || fails "$1 is not '$2'"
  passes "$1"
}
