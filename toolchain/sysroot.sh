#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Fetches what the rpi4 build needs beyond Debian's cross packages - the libraries of the board's drivers, and CppUTest,
# for arm64, with all that they depend on, and the headers of OpenCV's core - into build/sysroot-aarch64.
# The host's package database and architectures stay as they are: apt runs on a state directory of its own, and the
# packages are only unpacked; no script of theirs runs, so nothing of them has to run here. Does nothing when the sysroot is complete. Needs apt, network, no root.
#   toolchain/sysroot.sh [--newer | --lock] [--force]
# As locked unless --newer (toolchain/locked.sh). --force builds it again.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh
# shellcheck source=toolchain/apt_arm64.sh
source toolchain/apt_arm64.sh
# shellcheck source=toolchain/locked.sh
source toolchain/locked.sh

packages=(libcpputest-dev libjpeg62-turbo-dev libcamera-dev libgpiod-dev libusb-1.0-0-dev libhidapi-dev libsodium-dev
  libcli11-dev libfmt-dev nlohmann-json3-dev)
# Of these the headers alone, which need no other package: 1.6 MB to fetch. With its library core would bring 78
# packages, 63 MB, and the firmware links none of them (firmware/CMakeLists.txt).
headers=(libopencv-core-dev)
wanted="${packages[*]} ${headers[*]}"
sysroot=build/sysroot-aarch64
stamp=$sysroot/packages.txt

mode=locked
for word in "$@"; do
  case $word in
    --force) rm -rf "$sysroot" ;;
    --newer | --lock) mode=${word#--} ;;
    *) say "usage: toolchain/sysroot.sh [--newer | --lock] [--force]" && exit 2 ;;
  esac
done

if [[ -f $stamp && -f $sysroot/inputs && $(head -n 1 "$stamp") == "$wanted" && $mode != lock ]] &&
  { [[ $mode == newer ]] || is_locked sysroot "$sysroot/inputs"; }; then
  note_differences sysroot "$sysroot/inputs"
  say "sysroot: $sysroot is complete"
  exit 0
fi
if ! command -v apt-get >/dev/null || ! command -v dpkg-deb >/dev/null; then
  complain "cannot fetch arm64 packages" "this is not a Debian machine: apt-get or dpkg-deb is not here" \
    "use Debian 12, or unpack $wanted for arm64 into $sysroot by hand"
  exit 1
fi

mkdir -p build
work=$(mktemp -d build/sysroot.XXXXXX)
trap 'rm -rf "$work"' EXIT
trap 'exit 130' INT TERM
mkdir -p "$work/root"
apt_arm64_in "$work"

[[ $mode == lock ]] || say "sysroot: fetching $wanted for arm64"
if ! quietly "$work/update.log" "${apt_arm64[@]}" update; then
  complain "cannot fetch $wanted for arm64" "no network, or the package source has no arm64" \
    "see the lines above, then run toolchain/sysroot.sh again"
  exit 1
fi
mapfile -t all < <(closure "${packages[@]}")
fetch sysroot "$work/debs" "$mode" "${all[@]}" "${headers[@]}"
[[ $mode != lock ]] || exit 0
inputs "$work"/debs/*.deb >"$work/root/inputs"
for deb in "$work"/debs/*.deb; do
  name=$(basename "$deb")
  if [[ " ${headers[*]} " == *" ${name%%_*} "* ]]; then
    dpkg-deb --fsys-tarfile "$deb" | tar -x -C "$work/root" ./usr/include
    name+=" (headers)"
  else
    dpkg-deb -x "$deb" "$work/root"
  fi
  printf '%s\n' "$name" >>"$work/fetched"
done
{ printf '%s\n' "$wanted" && cat "$work/fetched"; } >"$work/root/packages.txt"
rm -rf "$sysroot"
mv "$work/root" "$sysroot"
say "sysroot: $sysroot is ready ($(du -sh "$sysroot" | cut -f1), $(($(wc -l <"$stamp") - 1)) packages)"
note_differences sysroot "$sysroot/inputs"
