#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The lock of what a card is made of (toolchain/locked.sh), against a package archive that is made here and changes: a release
# gets the locked bytes or an error that names the package, a test gets what there is and a note. And the list of what is on
# a card has each package's hash. No network, no root.
# The last line is "N passed"; status 77: no apt, dpkg-deb or jq.
set -euo pipefail
tree=$(realpath "$(dirname "${BASH_SOURCE[0]}")/../..")
# shellcheck source=tests/e2e/steps.sh
source "$tree/tests/e2e/steps.sh"
needs apt-get dpkg-deb jq
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
chmod 755 "$work"
export NO_COLOR=1 HOLDFAST_LOCK=$work/lock HOLDFAST_APT_SOURCES=$work/sources.list
mkdir "$work/archive" "$work/tree"
cd "$work/tree" # build/debs is made here
echo "deb [trusted=yes] file:$work/archive ./" >"$work/sources.list"

# package NAME VERSION [DEPENDS] [TEXT]: into the archive, in the place of other versions.
package() {
  local dir=$work/package
  rm -rf "$dir" "$work/archive/$1"_*
  mkdir -p "$dir/DEBIAN" "$dir/usr/share"
  printf 'Package: %s\nVersion: %s\nArchitecture: arm64\nMaintainer: nobody\nDescription: for a test\n' "$1" "$2" >"$dir/DEBIAN/control"
  [[ -z ${3:-} ]] || echo "Depends: $3" >>"$dir/DEBIAN/control"
  echo "${4:-of a test}" >"$dir/usr/share/$1"
  dpkg-deb --root-owner-group -b "$dir" "$work/archive/$1_${2//:/%3a}_arm64.deb" >/dev/null
}
publish() {
  local deb
  for deb in "$work"/archive/*.deb; do
    dpkg-deb -f "$deb"
    printf 'Filename: %s\nSize: %s\nSHA256: %s\n\n' "${deb##*/}" "$(stat -c %s "$deb")" "$(sha256sum "$deb" | cut -d ' ' -f 1)"
  done >"$work/archive/Packages"
}
# take MODE: what base.sh does with its packages.
cat >"$work/take" <<'TAKE'
set -euo pipefail
source "$1/toolchain/say.sh"
source "$1/toolchain/apt_arm64.sh"
source "$1/toolchain/locked.sh"
rm -rf apt got
apt_arm64_in apt
quietly apt/update.log "${apt_arm64[@]}" update
mapfile -t all < <(closure tool)
fetch base got "$2" "${all[@]}"
[[ $2 != lock ]] || exit 0
inputs got/*.deb >taken
note_differences base taken
is_locked base taken && echo "as locked" || echo "not the lock's"
TAKE
take() { bash "$work/take" "$tree" "$1"; }
got() { (cd got && sha256sum -- *.deb); }

package tool 1.0 "library (>= 1:0.9)"
package library 1:0.10.0
package other 1
publish
take lock >"$work/said" 2>&1 || fails "lock"
cp "$work/said" "$work/lock"
is "what is locked" "library 1:0.10.0 arm64, tool 1.0 arm64, " "$(awk '$1 == "base" { printf "%s %s %s, ", $2, $3, $4 }' "$work/lock")"
is "hashes in the lock" "$(sha256sum "$work"/archive/{library,tool}_*.deb | cut -d ' ' -f 1)" "$(cut -d ' ' -f 5 "$work/lock")"

says "a release of what is there as locked" "^as locked" take locked
first=$(got)
says "a test of the same" "^as locked" take newer
says "once more, from build/debs" "^as locked" take locked
is "bytes of both" "$first" "$(got)"

# Debian replaces a package.
cp -r build/debs "$work/kept"
rm -rf build
package library 1:0.10.1
publish
refuses "a release when the archive has replaced a package" "error: .*library 1:0.10.0 is 1:0.10.1 there" take locked
is "files of a build that failed" "" "$(find got -name '*.deb' 2>/dev/null)"
says "a test then" "^note: not as locked: library 1:0.10.1 instead of 1:0.10.0" take newer
grep -q "not the lock's" "$work/said" || fails "a test then says that it is not the lock's"
# What was kept with the release builds it.
rm -rf build
mkdir build
cp -r "$work/kept" build/debs
says "a release from what was kept with it" "^as locked" take locked
is "bytes of it" "$first" "$(got)"

# A package with other bytes under the same name and version, in the archive and among what was kept.
rm -rf build
package library 1:0.10.0 "" "of somebody else"
publish
refuses "a release when a package has other bytes" "error: .*library 1:0.10.0 has other bytes there" take locked
says "a test then" "^note: not as locked: library 1:0.10.0 with other bytes" take newer
rm -rf build
mkdir build
cp -r "$work/kept" build/debs
for kept in build/debs/*.deb; do printf x >>"$kept"; done
refuses "a release from damaged copies" "other bytes than its SHA-256" take locked
package library 1:0.10.0
publish
rm -rf build

# It needs another package than before, and one is gone.
package tool 1.1 "library, other"
publish
says "a test when there is one package more" "^note: not as locked: other 1 is not in the lock" take newer
package tool 1.1
publish
says "a test when there is one package less" "^note: not as locked: library 1:0.10.0 is missing" take newer

# The list of what is on a card.
cd "$tree"
# shellcheck source=board/image/card.sh
source board/image/card.sh
# shellcheck disable=SC2034  # of card.sh
board=virt version=6.1 release_version=0.10.0 SOURCE_DATE_EPOCH=1700000000
printf 'tool\t1.0\tarm64\ttool 1.0\t3\t%064d\nlibrary\t1:0.10.0\tall\tlib 2\t3\t%064d\n' 1 2 >"$work/packages"
write_sbom "$(printf %064d 3)" >"$work/sbom"
is "hashes in the SBOM" "holdfast SHA256 $(printf %064d 3), tool SHA256 $(printf %064d 1), library SHA256 $(printf %064d 2)" \
  "$(jq -r '[.packages[] | "\(.name) \(.checksums[0].algorithm) \(.checksums[0].checksumValue)"] | join(", ")' "$work/sbom")"
# The lock that is committed: of these forms, and nothing else.
is "lines of the lock" "" "$(grep -vE '^(base|kernel|kernel-rt|firmware-virt|firmware-rpi4|sysroot|host) [a-z0-9.+-]+ [A-Za-z0-9.+:~-]+ [a-z0-9]+ [0-9a-f]{64}$' \
  board/image/packages.lock | grep -v '^# Written by board/image/lock.sh: group, package, version, architecture, SHA-256\.$' || true)"
is "groups of the lock" "base firmware-rpi4 firmware-virt host kernel kernel-rt sysroot " "$(grep -v '^#' board/image/packages.lock | cut -d ' ' -f 1 | sort -u | tr '\n' ' ')"
echo "$passed passed"
