#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Fetches and unpacks Debian 12 for arm64 into build/image/base.tar: what a board runs beside holdfastd, and nothing
# else - no package manager, no login manager. No maintainer script runs, so nothing of arm64 has to run here
# and the host stays as it is; what those scripts would have done is done by finish_root.sh. Does nothing when the
# same list of packages is there. Needs mmdebstrap, arch-test, network, no root. --force fetches it again.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh

packages=(
  base-files base-passwd bash coreutils dash findutils grep gzip hostname libc-bin login mawk mount procps sed tar util-linux
  init-system-helpers kmod systemd-sysv udev                                # starts and finds devices
  libcamera0.0.3 libcamera-ipa libgpiod2 libhidapi-hidraw0 libjpeg62-turbo  # what holdfastd links
  libsodium23 libstdc++6 libusb-1.0-0
  gpiod usbutils v4l-utils  # for a person who looks for a fault
  busybox-static dmsetup    # for the initrd
  dbus libubootenv-tool rauc rauc-service  # updates: RAUC, which is asked by D-Bus and tells U-Boot
)
base=build/image/base.tar
stamp=build/image/base.packages
versions=build/image/base.versions  # name, version, architecture, source, size: one package a line

case ${1:-} in
  '') ;;
  --force) rm -f "$base" "$stamp" "$versions" ;;
  *) say "usage: board/image/base.sh [--force]" && exit 2 ;;
esac
if [[ -f $base && -f $versions && -f $stamp && $(cat "$stamp") == "${packages[*]}" ]]; then
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
say "base: fetching ${#packages[@]} packages and what they need, for arm64"
# Debian 12's packages expect /bin to be a link to /usr/bin, and none of them makes it: the hook does.
# The hardware database (12 MB) only names devices for people; holdfast's rules go by ids.
list=$(IFS=, && echo "${packages[*]}")
# What was unpacked is told by the packages themselves, while they are still there.
cat >"$work/note_versions" <<'HOOK'
for deb in "$1"/var/cache/apt/archives/*.deb; do
  dpkg-deb -W --showformat='${Package}\t${Version}\t${Architecture}\t${source:Package} ${source:Version}\t${Installed-Size}\n' "$deb"
done | sort
HOOK
if ! quietly "$work/mmdebstrap.log" mmdebstrap --arch=arm64 --variant=extract --include="$list" \
  --extract-hook="sh '$PWD/$work/note_versions' \"\$1\" >'$PWD/$work/versions'" \
  --hook-dir=/usr/share/mmdebstrap/hooks/merged-usr \
  --dpkgopt='path-exclude=/usr/share/doc/*' --dpkgopt='path-include=/usr/share/doc/*/copyright' \
  --dpkgopt='path-exclude=/usr/share/man/*' --dpkgopt='path-exclude=/usr/share/info/*' \
  --dpkgopt='path-exclude=/usr/share/locale/*' --dpkgopt='path-exclude=/usr/share/lintian/*' \
  --dpkgopt='path-exclude=/usr/share/bash-completion/*' --dpkgopt='path-exclude=/usr/share/zsh/*' \
  --dpkgopt='path-exclude=/lib/udev/hwdb.d/*' --dpkgopt='path-exclude=/usr/lib/udev/hwdb.d/*' \
  bookworm "$work/base.tar"; then
  complain "mmdebstrap failed" "no network, or the package source has no arm64" \
    "see the lines above, then run board/image/base.sh again"
  exit 1
fi
mv "$work/versions" "$versions"
mv "$work/base.tar" "$base"
printf '%s\n' "${packages[*]}" >"$stamp"
say "base: $base is ready ($(du -h "$base" | cut -f1))"
