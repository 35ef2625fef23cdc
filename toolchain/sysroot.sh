#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Fetches what the rpi4 build needs beyond Debian's cross packages - the libraries of the board's drivers, and CppUTest,
# for arm64, with all that they depend on, and the headers of OpenCV's core - into build/sysroot-aarch64.
# The host's package database and architectures stay as they are: apt runs on a state directory of its own, and the
# packages are only unpacked; no script of theirs runs, so nothing of them has to run here. Does nothing when the sysroot is complete. Needs apt, network, no root.
# --force builds it again.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh
# shellcheck source=toolchain/apt_arm64.sh
source toolchain/apt_arm64.sh

packages=(libcpputest-dev libjpeg62-turbo-dev libcamera-dev libgpiod-dev libusb-1.0-0-dev libhidapi-dev libsodium-dev
  libcli11-dev libfmt-dev nlohmann-json3-dev)
# Of these the headers alone, which need no other package: 1.6 MB to fetch. With its library core would bring 78
# packages, 63 MB, and the firmware links none of them (firmware/CMakeLists.txt).
headers=(libopencv-core-dev)
wanted="${packages[*]} ${headers[*]}"
sysroot=build/sysroot-aarch64
stamp=$sysroot/packages.txt

case ${1:-} in
  '') ;;
  --force) rm -rf "$sysroot" ;;
  *) say "usage: toolchain/sysroot.sh [--force]" && exit 2 ;;
esac

if [[ -f $stamp && $(head -n 1 "$stamp") == "$wanted" ]]; then
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
mkdir -p "$work/root" "$work/headers"
apt_arm64_in "$work"

say "sysroot: fetching $wanted for arm64"
if ! quietly "$work/update.log" "${apt_arm64[@]}" update ||
  ! quietly "$work/download.log" "${apt_arm64[@]}" -y --no-install-recommends --download-only install "${packages[@]}" ||
  ! quietly "$work/headers.log" env -C "$work/headers" "${apt_arm64[@]}" download "${headers[@]}"; then
  complain "cannot fetch $wanted for arm64" "no network, or the package source has no arm64" \
    "see the lines above, then run toolchain/sysroot.sh again"
  exit 1
fi
for deb in "$work"/cache/archives/*.deb; do
  printf '%s\n' "$(basename "$deb")" >>"$work/fetched"
  dpkg-deb -x "$deb" "$work/root"
  rm "$deb"
done
for deb in "$work"/headers/*.deb; do
  printf '%s (headers)\n' "$(basename "$deb")" >>"$work/fetched"
  dpkg-deb --fsys-tarfile "$deb" | tar -x -C "$work/root" ./usr/include
done
{ printf '%s\n' "$wanted" && cat "$work/fetched"; } >"$work/root/packages.txt"
rm -rf "$sysroot"
mv "$work/root" "$sysroot"
say "sysroot: $sysroot is ready ($(du -sh "$sysroot" | cut -f1), $(($(wc -l <"$stamp") - 1)) packages)"
