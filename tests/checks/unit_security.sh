#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Are our units free of errors, and may they do as little as is claimed? Every *.service in the tree, as systemd itself
# reads and rates it, without running one. Exit status 77: systemd-analyze is not here.
#   tests/checks/unit_security.sh [UNIT...]   these files instead
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh

# Highest exposure in tenths: systemd's scale goes from 0.0 to 10.0. A unit without a row may have 1.0; holdfastd has
# 0.4. A row says why one needs more: UNIT TENTHS REASON
thresholds() {
  cat <<'ROWS'
holdfast-stick@.service 40 mounts a stick where RAUC, another process, sees it: no file system of its own
holdfast-pull.service 12 fetches updates: the only unit with a network
holdfast-shell.service 100 the root shell of the emulated machine, which no board has
ROWS
}
host_units=/lib/systemd/system

if ! command -v systemd-analyze >/dev/null || [[ ! -d $host_units ]]; then
  say "SKIPPED: units are read by systemd-analyze, which is not here (apt-get install systemd)"
  exit 77
fi
units=("$@")
((${#units[@]} > 0)) || mapfile -t units < <(find board -name '*.service' -type f | sort)
if ((${#units[@]} == 0)); then
  complain "there is no unit to look at" "board/ has none" "look at the pattern in tests/checks/unit_security.sh"
  exit 1
fi

# A root of its own: systemd's units, ours, and the programs that ours start, as empty files.
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$work/lib/systemd/system"
cp -R "$host_units/." "$work/lib/systemd/system/"
names=()
for unit in "${units[@]}"; do
  names+=("$(basename "$unit")")
  cp "$unit" "$work/lib/systemd/system/"
  while read -r program; do
    mkdir -p "$work$(dirname "$program")"
    : >"$work$program"
    chmod +x "$work$program"
  done < <(sed -n 's/^Exec[A-Za-z]*=[-@:+!]*\(\/[^ ]*\).*/\1/p' "$unit")
done

wrong=0
for name in "${names[@]}"; do
  # Keys that it does not know are only notes to systemd: whatever it says is an error here. What it says of units that
  # are not ours is not ours. (--man: the programs of manuals are not in that root.)
  status=0
  told=$(systemd-analyze verify --man=no --recursive-errors=no --root="$work" "$name" 2>&1) || status=$?
  told=$(grep -F "$name" <<<"$told") || true
  if [[ -n $told ]] || ((status != 0)); then
    complain "systemd does not take $name as it is: ${told:-status $status}" "a key that it does not know, or one in another section" \
      "systemd-analyze verify, and man systemd.exec"
    wrong=1
  fi

  most=$(awk -v name="$name" '$1 == name { print $2 }' < <(thresholds))
  status=0
  rated=$(systemd-analyze security --no-pager --offline=yes --threshold="${most:-10}" --root="$work" "$name" 2>&1) || status=$?
  level=$(sed -n 's/^.*Overall exposure level for .*: \([0-9.]*\) .*/\1/p' <<<"$rated")
  if ((status != 0)) || [[ -z $level ]]; then
    grep '✗' <<<"$rated" | sed 's/^/   | /' >&2 || true
    complain "$name has an exposure of ${level:-no known size}, and may have $((${most:-10} / 10)).$((${most:-10} % 10))" \
      "a line of its sandbox is gone" "take back what is marked above, or say in $0 why it needs it"
    wrong=1
  else
    say "$name: exposure $level of 10, and nothing that systemd does not know"
  fi
done
exit "$wrong"
