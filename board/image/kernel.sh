#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Fetches Debian's stock arm64 kernel into build/image/kernel: vmlinuz, modules with their index, the Raspberry Pi's
# device trees, `version` and `inputs`. Does nothing when it is there. Needs apt, kmod, network, no root; 60 MB are fetched.
#   board/image/kernel.sh [--rt] [--newer | --lock] [--force]
# --rt: the kernel with PREEMPT_RT, into build/image/kernel-rt. As locked unless --newer (toolchain/locked.sh). --force
# fetches it again.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh
# shellcheck source=toolchain/apt_arm64.sh
source toolchain/apt_arm64.sh
# shellcheck source=toolchain/locked.sh
source toolchain/locked.sh
PATH=$PATH:/usr/sbin:/sbin  # depmod

group=kernel kernel=build/image/kernel name=linux-image-arm64 pattern='linux-image-[0-9][^ ]*-arm64' force=0 mode=locked
for word in "$@"; do
  case $word in
    --force) force=1 ;;
    --newer | --lock) mode=${word#--} ;;
    --rt) group=kernel-rt kernel=build/image/kernel-rt name=linux-image-rt-arm64 pattern='linux-image-[0-9][^ ]*-rt-arm64' ;;
    *) say "usage: board/image/kernel.sh [--rt] [--newer | --lock] [--force]" && exit 2 ;;
  esac
done
((force == 0)) || rm -rf "$kernel"
if [[ -f $kernel/version && -f $kernel/inputs && $mode != lock ]] &&
  { [[ $mode == newer ]] || is_locked "$group" "$kernel/inputs"; }; then
  note_differences "$group" "$kernel/inputs"
  say "kernel: $(cat "$kernel/version") is here"
  exit 0
fi
for tool in apt-get dpkg-deb depmod; do
  command -v "$tool" >/dev/null && continue
  complain "cannot fetch the kernel" "$tool is not here" "on Debian: apt-get install apt dpkg kmod"
  exit 1
done

mkdir -p build/image
work=$(mktemp -d build/image/kernel.XXXXXX)
trap 'rm -rf "$work"' EXIT
trap 'exit 130' INT TERM
apt_arm64_in "$work"

# linux-image-arm64 only names the kernel of the day.
find_kernel() {
  "${apt_cache_arm64[@]}" depends "$name" | sed -n "s/^ *Depends: \\($pattern\\)\$/\\1/p" | head -n 1
}
[[ $mode == lock ]] || say "kernel: fetching Debian's $name"
if ! quietly "$work/update.log" "${apt_arm64[@]}" update || ! package=$(find_kernel) || [[ -z $package ]]; then
  complain "cannot fetch a kernel for arm64" "no network, or the package source has no arm64" \
    "see the lines above, then run board/image/kernel.sh again"
  exit 1
fi
fetch "$group" "$work/debs" "$mode" "$package"
[[ $mode != lock ]] || exit 0
mkdir "$work/all" "$work/kernel"
dpkg-deb -x "$work"/debs/*.deb "$work/all"
version=$(basename "$work"/all/boot/vmlinuz-*)
version=${version#vmlinuz-}
mv "$work/all/boot/vmlinuz-$version" "$work/kernel/vmlinuz"
mkdir -p "$work/kernel/lib"
mv "$work/all/lib/modules" "$work/kernel/lib/"
mv "$work/all/usr/lib/linux-image-$version/broadcom" "$work/kernel/dtb"
depmod -b "$work/kernel" "$version"
printf '%s\n' "$version" >"$work/kernel/version"
inputs "$work"/debs/*.deb >"$work/kernel/inputs"
rm -rf "$kernel"
mv "$work/kernel" "$kernel"
note_differences "$group" "$kernel/inputs"
say "kernel: $version is ready ($(du -sh "$kernel" | cut -f1))"
