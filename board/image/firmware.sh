#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Fetches what starts a board before Linux into build/image/firmware-BOARD:
#   board/image/firmware.sh virt|rpi4 [--force]
# virt: Debian's U-Boot for QEMU. rpi4: Debian's U-Boot for the Raspberry Pi, and Raspberry Pi's own first stages, which
# are in Debian's component non-free-firmware: free to hand on, without source. `versions` says which they are.
# Does nothing when they are there. Needs apt, network, no root.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh
# shellcheck source=toolchain/apt_arm64.sh
source toolchain/apt_arm64.sh

board=${1:-}
[[ $board == virt || $board == rpi4 ]] || {
  complain "'$board' is no board" "a typing error" "board/image/firmware.sh virt, or rpi4"
  exit 2
}
to=build/image/firmware-$board
[[ ${2:-} != --force ]] || rm -rf "$to"
if [[ -f $to/versions ]]; then
  say "firmware: $to is complete"
  exit 0
fi
mkdir -p build/image
work=$(mktemp -d build/image/firmware.XXXXXX)
trap 'rm -rf "$work"' EXIT
trap 'exit 130' INT TERM
apt_arm64_in "$work"
mkdir "$work/debs" "$work/all" "$work/new"

# fetch PACKAGE [APT-OPTION...]: downloads it and unpacks it.
fetch() {
  local package=$1
  shift
  quietly "$work/update.log" "${apt_arm64[@]}" "$@" update &&
    quietly "$work/download.log" env -C "$work/debs" "${apt_arm64[@]}" "$@" download "$package" &&
    dpkg-deb -x "$work/debs/$package"_*.deb "$work/all"
}
# Where this machine gets Debian from, with the one component that it need not have switched on. Its folder of further
# sources is left out, so that nothing is told twice.
non_free_firmware() {
  # shellcheck disable=SC2016  # apt's own fields
  apt-get indextargets --format '$(REPO_URI) $(CODENAME)' 'Created-By: Packages' 2>/dev/null | awk '$2 == "bookworm" { print $1 }' |
    sort -u | sed 's,^\(.*\)$,deb [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] \1 bookworm non-free-firmware,' \
    >"$work/sources.list"
  [[ -s $work/sources.list ]]
}

say "firmware: fetching what starts the board $board"
case $board in
  virt)
    fetch u-boot-qemu || {
      complain "cannot fetch u-boot-qemu" "no network" "see the lines above, then run board/image/firmware.sh $board again"
      exit 1
    }
    cp "$work/all/usr/lib/u-boot/qemu_arm64/u-boot.bin" "$work/new/"
    ;;
  rpi4)
    fetch u-boot-rpi || {
      complain "cannot fetch u-boot-rpi" "no network, or the package source has no arm64" \
        "see the lines above, then run board/image/firmware.sh $board again"
      exit 1
    }
    if ! non_free_firmware || ! fetch raspi-firmware -o "Dir::Etc::SourceList=$PWD/$work/sources.list" -o Dir::Etc::SourceParts=/dev/null; then
      complain "cannot fetch raspi-firmware" "the package source has no component non-free-firmware, or there is no network" \
        "use a Debian mirror that carries non-free-firmware: a Pi does not start without its first stages"
      exit 1
    fi
    # One U-Boot for the Pi 3 and 4: what the emulated Pi 3 starts is what a Pi 4 starts.
    cp "$work/all/usr/lib/u-boot/rpi_arm64/u-boot.bin" "$work/all/usr/lib/raspi-firmware/"{start4.elf,fixup4.dat} "$work/new/"
    ;;
esac
for deb in "$work"/debs/*.deb; do
  # shellcheck disable=SC2016  # dpkg-deb's own fields
  dpkg-deb -W --showformat='${Package}\t${Version}\t${Architecture}\t${source:Package} ${source:Version}\t${Installed-Size}\n' "$deb"
done >"$work/new/versions"
rm -rf "$to"
mv "$work/new" "$to"
say "firmware: $to is ready ($(cut -f 1,2 "$to/versions" | tr '\t\n' '  '))"
