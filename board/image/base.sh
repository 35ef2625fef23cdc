#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Fetches and unpacks Debian 12 for arm64 into build/image/base.tar: what a board runs beside holdfastd, and nothing
# else - no package manager, no login manager. No maintainer script runs, so nothing of arm64 has to run here
# and the host stays as it is; what those scripts would have done is done by finish_root.sh. Does nothing when the
# same packages are there. Needs mmdebstrap, arch-test, apt, network, no root.
#   board/image/base.sh [--newer | --lock] [--force]
# As locked unless --newer (toolchain/locked.sh). --force fetches it again.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh
# shellcheck source=toolchain/apt_arm64.sh
source toolchain/apt_arm64.sh
# shellcheck source=toolchain/locked.sh
source toolchain/locked.sh

packages=(
  base-files base-passwd bash coreutils dash findutils grep gzip hostname libc-bin login mawk mount procps sed tar util-linux
  init-system-helpers kmod systemd-sysv udev usr-is-merged                  # starts and finds devices
  libcamera0.0.3 libcamera-ipa libgpiod2 libhidapi-hidraw0 libjpeg62-turbo  # what holdfastd links
  libsodium23 libstdc++6 libusb-1.0-0
  gpiod usbutils v4l-utils  # for a person who looks for a fault
  busybox-static dmsetup    # for the initrd
  dbus libubootenv-tool rauc rauc-service  # updates: RAUC, which is asked by D-Bus and tells U-Boot
)
base=build/image/base.tar
stamp=build/image/base.packages
taken=build/image/base.inputs  # toolchain/locked.sh, inputs()

mode=locked
for word in "$@"; do
  case $word in
    --force) rm -f "$base" "$stamp" "$taken" ;;
    --newer | --lock) mode=${word#--} ;;
    *) say "usage: board/image/base.sh [--newer | --lock] [--force]" && exit 2 ;;
  esac
done
if [[ -f $base && -f $taken && -f $stamp && $(cat "$stamp") == "${packages[*]}" && $mode != lock ]] &&
  { [[ $mode == newer ]] || is_locked base "$taken"; }; then
  note_differences base "$taken"
  say "base: $base is complete"
  exit 0
fi
for tool in mmdebstrap arch-test; do
  command -v "$tool" >/dev/null && continue
  complain "cannot unpack Debian for arm64" "$tool is not here" "apt-get install mmdebstrap arch-test"
  exit 1
done

mkdir -p build/image
work=$(mktemp -d build/image/base.XXXXXX)
trap 'rm -rf "$work"' EXIT
trap 'exit 130' INT TERM
apt_arm64_in "$work/apt"
[[ $mode == lock ]] || say "base: fetching ${#packages[@]} packages and what they need, for arm64"
if ! quietly "$work/update.log" "${apt_arm64[@]}" update; then
  complain "cannot look for packages" "no network, or the package source has no arm64" "see the lines above, then run board/image/base.sh again"
  exit 1
fi
mapfile -t all < <(closure "${packages[@]}")
fetch base "$work/debs" "$mode" "${all[@]}"
[[ $mode != lock ]] || exit 0
# An archive of these packages alone, so that mmdebstrap cannot take others.
for deb in "$work"/debs/*.deb; do
  dpkg-deb -f "$deb"
  printf 'Filename: %s\nSize: %s\nSHA256: %s\n\n' "${deb##*/}" "$(stat -c %s "$deb")" "$(sha256sum "$deb" | cut -d ' ' -f 1)"
done >"$work/debs/Packages"
inputs "$work"/debs/*.deb >"$work/inputs"
# The time of folders that are made here: that of the youngest package (in its first ar header), whenever this runs.
SOURCE_DATE_EPOCH=$(for deb in "$work"/debs/*.deb; do head -c 36 "$deb" | tail -c 12 && echo; done | sort -n | tail -n 1 | tr -d ' ')
export SOURCE_DATE_EPOCH
# Debian 12's packages expect /bin to be a link to /usr/bin, and none of them makes it: the hook does.
# The hardware database (12 MB) only names devices for people; holdfast's rules go by ids.
list=$(IFS=, && echo "${packages[*]}")
if ! quietly "$work/mmdebstrap.log" mmdebstrap --arch=arm64 --variant=extract --include="$list" \
  --hook-dir=/usr/share/mmdebstrap/hooks/merged-usr \
  --dpkgopt='path-exclude=/usr/share/doc/*' --dpkgopt='path-include=/usr/share/doc/*/copyright' \
  --dpkgopt='path-exclude=/usr/share/man/*' --dpkgopt='path-exclude=/usr/share/info/*' \
  --dpkgopt='path-exclude=/usr/share/locale/*' --dpkgopt='path-exclude=/usr/share/lintian/*' \
  --dpkgopt='path-exclude=/usr/share/bash-completion/*' --dpkgopt='path-exclude=/usr/share/zsh/*' \
  --dpkgopt='path-exclude=/lib/udev/hwdb.d/*' --dpkgopt='path-exclude=/usr/lib/udev/hwdb.d/*' \
  bookworm "$work/base.tar" "deb [trusted=yes] copy:$PWD/$work/debs ./"; then
  complain "mmdebstrap failed" "a package of those fetched is missing what it needs" "see the lines above; board/image/lock.sh"
  exit 1
fi
mv "$work/inputs" "$taken"
mv "$work/base.tar" "$base"
printf '%s\n' "${packages[*]}" >"$stamp"
note_differences base "$taken"
say "base: $base is ready ($(du -h "$base" | cut -f1))"
