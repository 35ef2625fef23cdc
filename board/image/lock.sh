#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Pins what a card is made of: writes board/image/packages.lock, every Debian package by name, version and SHA-256, as the
# archive and this machine have them today, and says what changed. Then build, test, and commit the lock with the release.
#   board/image/lock.sh [--check]     --check: only says what would change; status 1 when something would
# Groups: base, kernel, kernel-rt, firmware-BOARD (on the card), sysroot (what holdfastd is built against), host (the tools
# that make it). Needs apt, network, no root; fetches package lists, no packages.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh
# shellcheck source=toolchain/apt_arm64.sh
source toolchain/apt_arm64.sh
# shellcheck source=toolchain/locked.sh
source toolchain/locked.sh

[[ $# == 0 || $* == --check ]] || {
  say "usage: board/image/lock.sh [--check]"
  exit 2
}
mkdir -p build
new=$(mktemp build/lock.XXXXXX)
trap 'rm -f "$new"' EXIT
trap 'exit 130' INT TERM
{
  echo "# Written by board/image/lock.sh: group, package, version, architecture, SHA-256."
  board/image/base.sh --lock
  board/image/kernel.sh --lock
  board/image/kernel.sh --rt --lock
  board/image/firmware.sh virt --lock
  board/image/firmware.sh rpi4 --lock
  toolchain/sysroot.sh --lock
  host_rows
} >"$new"
if cmp -s "$new" "$lock_file"; then
  say "lock: $lock_file is as the archive is: $(grep -vc '^#' "$new") packages"
  exit 0
fi
[[ ! -f $lock_file ]] || diff <(cut -d ' ' -f 1-3 "$lock_file") <(cut -d ' ' -f 1-3 "$new") | sed -n 's/^</   was/p; s/^>/   is /p' || true
[[ ${1:-} != --check ]] || {
  say "lock: $lock_file is not as the archive is, see above. Next: board/image/lock.sh"
  exit 1
}
mv "$new" "$lock_file"
chmod 644 "$lock_file"
say "lock: $lock_file names $(grep -vc '^#' "$lock_file") packages. Next: build, test, commit it"
