#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Makes what the scenarios start from: the board virt as preset rpi4 built it, and tests/system/root over it.
#   tests/system/prepare.sh [flat|card]...   both unless named
# flat: the disk that the emulator starts by itself. card: the card, a release after it as updates on USB sticks - as it
# should be, and not - and the owner's keys, which are made here and thrown away.
set -euo pipefail
PATH=$PATH:/usr/sbin:/sbin  # mke2fs
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh

stage=build/image/stage
out=build/image/virt

flat() {
  rm -rf "$stage"
  # The HAL's contract is run on the machine's real devices, too.
  mkdir -p "$stage/usr/lib/holdfast"
  cp build/rpi4/bin/firmware_tests "$stage/usr/lib/holdfast/"
  # A disk that a scenario makes stand still.
  mke2fs -q -F -t ext4 -O ^has_journal "$stage/usr/lib/holdfast/disk.ext4" 2M
  board/image/build.sh virt --newer --flat --install "$stage" --install tests/system/root
}

# stick NAME BUNDLE [BUNDLE]: a USB stick with it, and with another one whose name comes behind it.
stick() {
  local image=$out/sticks/$1.img
  truncate -s $(($(stat -c %s "$2") + 8000000)) "$image"
  mkfs.vfat "$image" >/dev/null
  mcopy -i "$image" "$2" ::holdfast-virt-0.10.0.raucb
  [[ -z ${3:-} ]] || mcopy -i "$image" "$3" ::holdfast-virt-0.9.0.raucb
}

card() {
  local keys=$out/keys work=$out/work later=$out/later
  rm -rf "$keys" "$work" "$later" "$out/sticks"
  mkdir -p "$work" "$out/sticks"
  head -c 18 /dev/urandom | base64 >"$work/ca.pass"
  head -c 18 /dev/urandom | base64 >"$work/signer.pass"
  export HOLDFAST_CA_PASS=file:$work/ca.pass HOLDFAST_SIGNER_PASS=file:$work/signer.pass
  board/image/keys.sh "$work/other"
  # The first signer was revoked before the card was made.
  board/image/keys.sh "$keys"
  cp -r "$keys" "$work/revoked_keys"
  board/image/keys.sh "$keys" --new-signer
  board/image/keys.sh "$keys" --revoke "$work/revoked_keys/signer.cert.pem"
  printf 'version=0.10.0\nrelease=2\nfloor=1\n' >"$work/release"
  board/image/build.sh virt --newer --install tests/system/root --keyring "$keys/keyring.pem" --release "$work/release" \
    --out "$later" >/dev/null
  board/image/build.sh virt --newer --install tests/system/root --keyring "$keys/keyring.pem" | grep -v '^   '
  board/image/bundle.sh virt --keys "$keys" --slot "$later/slot" --out "$work/good"
  board/image/bundle.sh virt --keys "$work/other" --slot "$later/slot" --out "$work/wrong_key"
  # What is to be refused before it is written need not be large.
  mkdir "$work/small"
  head -c 65536 /dev/urandom >"$work/small/root.img"
  head -c 65536 /dev/urandom >"$work/small/kernel.img"
  printf 'release=3\nversion=0.11.0\nboard=virt\n' >"$work/small/release"
  board/image/bundle.sh virt --keys "$work/revoked_keys" --slot "$work/small" --out "$work/revoked"
  printf 'release=1\nversion=0.9.0\nboard=virt\n' >"$work/small/release"
  board/image/bundle.sh virt --keys "$keys" --slot "$work/small" --out "$work/back"
  # The same once more under a higher number, so that it can be offered when it runs already.
  sed -i 's/^release=.*/release=3/' "$later/slot/release"
  board/image/bundle.sh virt --keys "$keys" --slot "$later/slot" --out "$work/again"
  sed -i 's/^board=.*/board=rpi4/' "$later/slot/release"
  board/image/bundle.sh virt --keys "$keys" --slot "$later/slot" --out "$work/other_board"
  sed -i 's/^board=.*/board=virt/; s/^release=.*/release=0/' "$later/slot/release"
  board/image/bundle.sh virt --keys "$keys" --slot "$later/slot" --out "$work/older"
  head -c $(($(stat -c %s "$work/again") * 2 / 3)) "$work/again" >"$work/truncated"
  # A byte of the signature, which is the file's end but for its length; and one of the pictures of the partitions.
  cp "$work/again" "$work/bad_signature"
  flip "$work/bad_signature" $(($(stat -c %s "$work/again") - 300))
  cp "$work/again" "$work/damaged"
  flip "$work/damaged" 20000000
  local name
  stick good "$work/good" "$work/back"
  for name in again back wrong_key revoked older other_board truncated bad_signature damaged; do stick "$name" "$work/$name"; done
  rm -rf "$work" "$later"
}

# flip FILE OFFSET: every bit of that byte.
flip() {
  local byte
  byte=$(od -An -tu1 -j "$2" -N 1 "$1")
  # shellcheck disable=SC2059  # a byte by its number
  printf "\\x$(printf %02x $((byte ^ 255)))" | dd of="$1" bs=1 seek="$2" conv=notrunc status=none
}

(($# > 0)) || set -- flat card
for what in "$@"; do
  case $what in
    flat | card) "$what" ;;
    *)
      complain "'$what' is nothing to prepare" "a typing error" "tests/system/prepare.sh flat, or card"
      exit 2
      ;;
  esac
done
