#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# board/image/flash.sh on loop devices: what it writes, and what it refuses to write. Every refusal says what, cause and
# next step, and leaves the device as it was.
# The last line is "N passed"; status 77: not root, or no loop devices here.
set -euo pipefail
flash=$(dirname "${BASH_SOURCE[0]}")/../../board/image/flash.sh
PATH=$PATH:/usr/sbin:/sbin
skip() {
  echo "SKIPPED: $1"
  exit 77
}
((EUID == 0)) || skip "loop devices need root. Next: sudo $0"
# shellcheck source=tests/e2e/steps.sh
source "$(dirname "${BASH_SOURCE[0]}")/steps.sh"
needs losetup lsblk sfdisk addpart mke2fs xz zstd script
export NO_COLOR=1
work=$(mktemp -d)
loops=() mounts=() whole='' holder=''
clean_up() {
  local one
  [[ -z $holder ]] || kill "$holder" 2>/dev/null || true
  for one in "${mounts[@]}"; do umount "$one" 2>/dev/null || true; done
  # Partitions that the kernel was told of outlive the file behind them.
  for one in 1 2; do [[ -z $whole ]] || delpart "$whole" "$one" 2>/dev/null || true; done
  for one in "${loops[@]}"; do losetup -d "$one" 2>/dev/null || true; done
  rm -rf "$work"
}
trap clean_up EXIT

# loop FILE OPTION...: `device` shows FILE.
loop() {
  device=$(losetup --find --show "${@:2}" "$1" 2>"$work/why") || skip "no loop device: $(<"$work/why")"
  loops+=("$device")
}
# disk NAME MEGABYTES: `file` of 0xFF, so that every byte that is written shows, and its `device`.
disk() {
  file=$work/$1
  head -c $(($2 * 1000000 / 4096 * 4096)) /dev/zero | tr '\0' '\377' >"$file"
  loop "$file" "${@:3}"
}
# refuses WHAT PATTERN COMMAND...: status 1, in the form of all our errors, and `file` is what it was.
refuses() {
  local before after status=0
  before=$(sha256sum <"$file")
  "${@:3}" >"$work/said" 2>&1 </dev/null || status=$?
  ((status == 1)) || fails "$1: status $status"
  grep -qE -- "^error: .*$2.* \(.+\)\. Next: .+" "$work/said" || fails "$1: no refusal for /$2/"
  after=$(sha256sum <"$file")
  [[ $before == "$after" ]] || fails "$1: refused, and written all the same"
  passes "$1"
}
has_image() {
  cmp -n "$(stat -c %s "$1")" "$1" "$file" || fails "$2: another content"
  [[ $(tail -c 4096 "$file" | tr -d '\377' | wc -c) == 0 ]] || fails "$2: more was written than the image"
  passes "$2"
}

# No whole number of blocks, nor of chunks.
head -c 41943552 /dev/urandom >"$work/a.img"
xz -0 -k "$work/a.img"
zstd -q -k "$work/a.img"

# ---- What it writes
disk plain 64
says "an image" "compared: 41943552 bytes" "$flash" --yes "$device" "$work/a.img"
[[ $(grep -cE '^(This will be overwritten|Next:)' "$work/said") == 2 ]] || fails "neither warning nor next steps"
[[ $(grep -c '^writing: ' "$work/said") -ge 2 ]] || fails "no progress"
has_image "$work/a.img" "byte by byte, and no byte more"
says "--verify finds it" "has the image: 41943552 bytes" "$flash" --verify "$device" "$work/a.img"
printf '\0' | dd of="$file" bs=1 seek=30000000 conv=notrunc status=none
refuses "one other byte is found when it is read back" "is not the image" "$flash" --verify "$device" "$work/a.img"
for packed in xz zst; do
  disk "$packed" 64
  says "a packed image (.img.$packed)" "compared: 41943552 bytes" "$flash" --yes "$device" "$work/a.img.$packed"
  has_image "$work/a.img" "unpacked (.img.$packed)"
done
sha256sum "$work/a.img" >"$work/a.img.sha256"
says "the sum beside the unpacked image" "a.img.sha256 says" "$flash" --yes "$device" "$work/a.img.xz"

disk question 64
says "somebody types its name" "compared: " \
  bash -c "printf '%s\n' '${device#/dev/}' | script -qec '$flash $device $work/a.img' /dev/null"
grep -q '100 % of 42 MB' "$work/said" || fails "no per cent on a terminal"
has_image "$work/a.img" "then it is written"

# The copy of a GPT goes to the end of a larger disk.
truncate -s 40M "$work/gpt.img"
printf 'label: gpt\n,8M\n,\n' | sfdisk --quiet "$work/gpt.img"
disk gpt 64
says "an image with a GPT" "its copy is at the end" "$flash" --yes "$device" "$work/gpt.img"
[[ $(tail -c 512 "$file" | head -c 8) == 'EFI PART' ]] || fails "there is no copy"
says "its table is sound" "^Disklabel type: gpt" sfdisk --list "$file"
! grep -qi 'corrupt\|mismatch\|backup' "$work/said" || fails "its table is not sound"

# ---- What it refuses
disk refused 64
refuses "nobody to ask" "nobody is there to say yes" "$flash" "$device" "$work/a.img"
refuses "another answer" "left as it is" bash -c \
  "printf 'yes\n' | script -qec '$flash $device $work/a.img' /dev/null | sed 's/^Type [^:]*: error/error/;s/\r//'; exit \${PIPESTATUS[1]}"
refuses "no such device" "there is no /dev/nosuch" "$flash" --yes /dev/nosuch "$work/a.img"
refuses "a file" "is no disk" "$flash" --yes "$file" "$work/a.img"
refuses "another kind of device" "is no disk" "$flash" --yes /dev/null "$work/a.img"
refuses "no such image" "there is no image" "$flash" --yes "$device" "$work/b.img"
refuses "another kind of file" "is no .img" "$flash" --yes "$device" "$work/said"
: >"$work/empty.img"
refuses "an empty image" "is empty" "$flash" --yes "$device" "$work/empty.img"
head -c 20000000 "$work/a.img.xz" >"$work/short.img.xz"
refuses "half a packed image" "cannot be unpacked" "$flash" --yes "$device" "$work/short.img.xz"
cp "$work/a.img" "$work/sum.img"
echo "$(printf '%064d' 1)  sum.img" >"$work/sum.img.sha256"
refuses "another sum" "is not what .*sum.img.sha256 says" "$flash" --yes "$device" "$work/sum.img"
rm "$work/sum.img.sha256"
refuses "the image's own loop device" "shows .* itself" bash -c \
  "own=\$(losetup --find --show '$work/sum.img') && '$flash' --yes \$own '$work/sum.img'; status=\$?; losetup -d \$own; exit \$status"
exec {lock}<"$device"
flock "$lock"
refuses "another program at work on it" "is locked" "$flash" --yes "$device" "$work/a.img"
exec {lock}<&-
disk small 40
refuses "a disk that is too small" "is too small: .* the image has 41943552" "$flash" --yes "$device" "$work/a.img"
disk sealed 64 --read-only
refuses "a card that is locked" "is read-only" "$flash" --yes "$device" "$work/a.img"

# Told to the kernel, which may not know tables of partitions itself.
disk parted 64
whole=$device
addpart "$whole" 1 2048 40960
addpart "$whole" 2 43008 60000
until [[ -b ${whole}p1 && -b ${whole}p2 ]]; do sleep 0.1; done
refuses "a partition" "is a partition" "$flash" --yes "${whole}p1" "$work/a.img"
mke2fs -q -F -t ext4 "${whole}p2"
# Should it not be refused, there is neither --yes nor a terminal.
system=$(lsblk -nsrpo NAME,TYPE "$(findmnt -nvo SOURCE /)" 2>/dev/null | awk '$2 == "disk" { print $1; exit }') || true
[[ -z $system ]] || refuses "the disk of the system" "this system runs from" "$flash" "$system" "$work/a.img"

mkdir "$work/mnt" "$work/tmpfs"
if ! mount "${whole}p2" "$work/mnt" 2>"$work/why"; then
  echo "note: nothing may be mounted here ($(<"$work/why")): $passed passed without mounted disks"
  exit 0
fi
mounts+=("$work/mnt")
refuses "a disk with a mounted partition" "is in use: .*p2 is mounted at .*/mnt" "$flash" --yes "$whole" "$work/a.img"
head -c 1000000 /dev/zero >"$work/mnt/inside.img"
sync "$work/mnt/inside.img"
refuses "the disk that the image lies on" "inside.img lies on" "$flash" --yes "$whole" "$work/mnt/inside.img"
umount "$work/mnt"
# Where this process does not see it.
mkfifo "$work/there"
unshare --mount bash -c "mount '${whole}p2' '$work/mnt' && echo there >'$work/there' && exec sleep 60" &
holder=$!
read -r _ <"$work/there"
refuses "a disk that is mounted in another name space" "is mounted at .*/mnt" "$flash" --yes "$whole" "$work/a.img"
kill "$holder"
wait "$holder" 2>/dev/null || true
holder=''
says "the same disk once it is free" "compared: " "$flash" --yes "$whole" "$work/a.img"

# A card with less room than it claims.
mount -t tmpfs -o size=20m none "$work/tmpfs"
mounts+=("$work/tmpfs")
truncate -s 64M "$work/tmpfs/liar"
loop "$work/tmpfs/liar"
if "$flash" --yes "$device" "$work/a.img" >"$work/said" 2>&1 </dev/null; then fails "a card that claims more than it has"; fi
grep -qE '^error: (writing to .* failed|what .* has is not the image)' "$work/said" || fails "a card that claims more than it has"
passes "a card that claims more than it has"
losetup -d "$device"
echo "$passed passed"
