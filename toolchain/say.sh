# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash disable=SC2034,SC2154
# How our scripts speak, and what they take a path for: sourced, not run. Colours only on a terminal and never under NO_COLOR.

if [[ -t 1 && -t 2 && -z ${NO_COLOR:-} && ${TERM:-dumb} != dumb ]]; then
  bold=$'\e[1m' red=$'\e[31m' green=$'\e[32m' yellow=$'\e[33m' plain=$'\e[0m'
else
  bold='' red='' green='' yellow='' plain=''
fi

say() { printf '%s\n' "$*"; }
heading() { printf '\n%s== %s%s\n' "$bold" "$*" "$plain"; }
note() { printf '%snote:%s %s\n' "$yellow" "$plain" "$*"; }

# complain WHAT CAUSE NEXT: one line on stderr - what happened, the likely cause, what to do next.
complain() { printf '%serror:%s %s (%s). Next: %s\n' "$red" "$plain" "$1" "$2" "$3" >&2; }

# quietly LOG COMMAND...: runs COMMAND with its output in LOG; on failure shows the errors in it. The caller keeps the status.
quietly() {
  local log=$1 status=0
  shift
  mkdir -p "$(dirname "$log")"
  "$@" >"$log" 2>&1 </dev/null || status=$?
  if ((status != 0)); then
    say "   failed with status $status: $*"
    say "   the errors in $log, or its last lines:"
    { grep -E -m 30 '(^|[ :])([Ee]rror|FATAL_ERROR|FAILED)([: ]|$)|undefined reference' "$log" || tail -n 40 "$log"; } |
      sed 's/^/   | /'
  fi
  return "$status"
}

# as_called PATH: what the caller means by it, in a script that has gone elsewhere from $called_from.
as_called() {
  if [[ -z $1 || $1 == /* || $called_from == "$PWD" ]]; then printf %s "$1"; else printf %s "$called_from/$1"; fi
}
