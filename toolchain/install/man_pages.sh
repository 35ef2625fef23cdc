#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The manual's pages, from what the programs' --help says, and the changelog of the package.
#   toolchain/install/man_pages.sh BIN OUT     BIN: folder of holdfast, holdfastd and, where it was built, holdfast-sensor; OUT: for *.1.gz
# Needs help2man. A page for each command of the tool: `man holdfast-replay`.
set -euo pipefail
top=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
# shellcheck source=toolchain/say.sh
source "$top/toolchain/say.sh"
(($# == 2)) || { sed -n '3,6s/^# \{0,1\}//p' "${BASH_SOURCE[0]}" >&2 && exit 2; }
bin=$1 out=$2
command -v help2man >/dev/null || { complain "no help2man" "not installed" "apt-get install help2man" && exit 1; }
mkdir -p "$out"
rm -f "$out"/*.gz
version=$("$bin/holdfast" --version)
# The date of the newest commit, so that the same sources give the same bytes.
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git -C "$top" log -1 --format=%ct 2>/dev/null || echo 0)}
export SOURCE_DATE_EPOCH
# page NAME TITLE COMMAND...
page() {
  local name=$1 title=$2 help
  shift 2
  help=$(mktemp)
  # The first line is the title, and help2man wants its own words for the usage.
  printf '#!/bin/sh\ncat <<"HELP"\n%s\nHELP\n' "$("$@" --help | sed -e '1d' -e 's/^Usage:/Usage:/')" >"$help"
  chmod +x "$help"
  help2man --no-info --no-discard-stderr --version-string="$version" --name="$title" --section=1 \
    --manual="Holdfast" --source="holdfast $version" "$help" |
    sed -e "s|$(basename "$help" | tr '[:lower:]' '[:upper:]')|${name^^}|g" -e "s|$(basename "$help")|$name|g" |
    gzip -9n >"$out/$name.1.gz"
  rm -f "$help"
}
page holdfast "the host side of the slip sensor" "$bin/holdfast"
page holdfastd "the firmware on a simulated board" "$bin/holdfastd"
[[ ! -x $bin/holdfast-sensor ]] || page holdfast-sensor "the GelSight Mini's USB port" "$bin/holdfast-sensor"
"$bin/holdfast" --help | sed -n '/^Subcommands:/,/^$/s/^  \([a-z]*\)  *\(.*\)$/\1 \2/p' | while read -r command title; do
  page "holdfast-$command" "$title" "$bin/holdfast" "$command"
done
sed 's/^/  /' "$top/.github/CHANGELOG.md" | gzip -9n >"$out/changelog.gz"
