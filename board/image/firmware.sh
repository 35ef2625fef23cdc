#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Fetches what starts a board before Linux into build/image/firmware-BOARD:
#   board/image/firmware.sh virt|rpi4 [--newer | --lock] [--force]
# virt: Debian's U-Boot for QEMU. rpi4: Debian's U-Boot for the Raspberry Pi, and Raspberry Pi's own first stages, which
# are in Debian's component non-free-firmware: free to hand on, without source. `inputs` says which they are.
# As locked unless --newer (toolchain/locked.sh). Does nothing when they are there. Needs apt, network, no root.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh
# shellcheck source=toolchain/apt_arm64.sh
source toolchain/apt_arm64.sh
# shellcheck source=toolchain/locked.sh
source toolchain/locked.sh

board=${1:-}
[[ $board == virt || $board == rpi4 ]] || {
  complain "'$board' is no board" "a typing error" "board/image/firmware.sh virt, or rpi4"
  exit 2
}
to=build/image/firmware-$board group=firmware-$board mode=locked
shift
for word in "$@"; do
  case $word in
    --force) rm -rf "$to" ;;
    --newer | --lock) mode=${word#--} ;;
    *) say "usage: board/image/firmware.sh virt|rpi4 [--newer | --lock] [--force]" && exit 2 ;;
  esac
done
if [[ -f $to/inputs && $mode != lock ]] && { [[ $mode == newer ]] || is_locked "$group" "$to/inputs"; }; then
  note_differences "$group" "$to/inputs"
  say "firmware: $to is complete"
  exit 0
fi
mkdir -p build/image
work=$(mktemp -d build/image/firmware.XXXXXX)
trap 'rm -rf "$work"' EXIT
trap 'exit 130' INT TERM
apt_arm64_in "$work"
mkdir "$work/all" "$work/new"

# Where this machine gets Debian from, and the one component that it need not have switched on.
with_non_free_firmware() {
  {
    # shellcheck disable=SC2016  # apt's own fields
    apt-get indextargets --format '$(REPO_URI) $(CODENAME) $(COMPONENT)' 'Created-By: Packages' 2>/dev/null |
      awk '/ bookworm/ && !seen[$0]++ { print; if ($2 == "bookworm") print $1, $2, "non-free-firmware" }' | sort -u |
      sed 's,^,deb [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] ,'
  } >"$work/sources.list"
  apt_arm64+=(-o "Dir::Etc::SourceList=$PWD/$work/sources.list" -o Dir::Etc::SourceParts=/dev/null)
  apt_cache_arm64+=(-o "Dir::Etc::SourceList=$PWD/$work/sources.list" -o Dir::Etc::SourceParts=/dev/null)
}

[[ $mode == lock ]] || say "firmware: fetching what starts the board $board"
packages=(u-boot-qemu)
if [[ $board == rpi4 ]]; then
  packages=(u-boot-rpi raspi-firmware)
  [[ -n ${HOLDFAST_APT_SOURCES:-} ]] || with_non_free_firmware
fi
if ! quietly "$work/update.log" "${apt_arm64[@]}" update; then
  complain "cannot fetch ${packages[*]}" "no network, or the package source has no arm64 or no component non-free-firmware" \
    "see the lines above; a Pi does not start without its first stages: use a Debian mirror that carries non-free-firmware"
  exit 1
fi
fetch "$group" "$work/debs" "$mode" "${packages[@]}"
[[ $mode != lock ]] || exit 0
for deb in "$work"/debs/*.deb; do dpkg-deb -x "$deb" "$work/all"; done
case $board in
  virt) cp "$work/all/usr/lib/u-boot/qemu_arm64/u-boot.bin" "$work/new/" ;;
  # One U-Boot for the Pi 3 and 4: what the emulated Pi 3 starts is what a Pi 4 starts.
  rpi4) cp "$work/all/usr/lib/u-boot/rpi_arm64/u-boot.bin" "$work/all/usr/lib/raspi-firmware/"{start4.elf,fixup4.dat} "$work/new/" ;;
esac
inputs "$work"/debs/*.deb >"$work/new/inputs"
rm -rf "$to"
mv "$work/new" "$to"
note_differences "$group" "$to/inputs"
say "firmware: $to is ready ($(cut -f 1,2 "$to/inputs" | tr '\t\n' '  '))"
