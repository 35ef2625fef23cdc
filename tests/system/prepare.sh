#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Makes what the scenarios start from: the board virt as preset rpi4 built it, and tests/system/root over it.
#   tests/system/prepare.sh [flat|card|pull]...   flat and card unless named
# flat: the disk that the emulator starts by itself. card: the card, a release after it as updates on USB sticks - as it
# should be, and not - and the owner's keys, which are made here and thrown away. pull: a card with what board/pull/README.md
# tells an owner to put on a system of his own, a network and Debian's curl and openssl among it; and what his server has.
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

# pull_root DIR: what a card has no part of. Its packages are not the lock's: no card has them.
pull_root() (
  # shellcheck source=toolchain/apt_arm64.sh
  source toolchain/apt_arm64.sh
  # shellcheck source=toolchain/locked.sh
  source toolchain/locked.sh
  local apt=$1.apt here module version
  board/image/kernel.sh --newer
  board/image/base.sh --newer
  apt_arm64_in "$apt"
  quietly "$apt/log" "${apt_arm64[@]}" update
  here=$(cut -f 1,2 --output-delimiter== build/image/base.inputs)
  # shellcheck disable=SC2046  # names
  fetch pull "$apt/debs" newer $(closure curl openssl | grep -vxF "$here")
  mkdir -p "$1/etc/holdfast"
  for deb in "$apt"/debs/*.deb; do dpkg-deb -x "$deb" "$1"; done
  rm -rf "$1"/usr/share/{doc,man,lintian}
  version=$(cat build/image/kernel/version)
  for module in net/core/failover drivers/net/net_failover drivers/net/virtio_net; do
    install -D -m 644 -t "$1/usr/lib/holdfast/network" "build/image/kernel/lib/modules/$version/kernel/$module.ko"
  done
  cp -r board/pull/root/. tests/system/pull_root/. "$1/"
  rm -rf "$apt"
)

pull() {
  local to=$out/pull place
  rm -rf "$to"
  mkdir -p "$to"
  echo "of the authority" >"$to/ca.pass"
  echo "of the signer" >"$to/signer.pass"
  export HOLDFAST_CA_PASS=file:$to/ca.pass HOLDFAST_SIGNER_PASS=file:$to/signer.pass
  board/image/keys.sh "$to/keys"
  board/pull/server_keys.sh "$to/tls" 10.0.2.100
  pull_root "$to/root"
  cp "$to/tls/pull-ca.pem" "$to/root/etc/holdfast/"
  printf 'version=0.10.0\nrelease=2\nfloor=1\n' >"$to/release"
  local -a build=(board/image/build.sh virt --newer --install tests/system/root --install "$to/root" --keyring "$to/keys/keyring.pem")
  "${build[@]}" --release "$to/release" --out "$to/later" >/dev/null
  "${build[@]}" --out "$to" | grep -v '^   '
  board/image/bundle.sh virt --keys "$to/keys" --slot "$to/later/slot" --out "$to/bundle"
  # The same offered twice: to all boards below this one's place in the rollout, and to one place more.
  place=$(HOLDFAST_RELEASES=board/image/card/usr/lib/holdfast/releases board/pull/root/usr/lib/holdfast/pull ring \
    "$(sed -n 's/^HOLDFAST_SERIAL=//p' "$to/root/etc/holdfast/pull.conf")")
  board/pull/channel.sh virt "$to/www" --keys "$to/keys" --bundle "$to/bundle" --share "$place"
  cp "$to/www/channel" "$to/www/channel.closed"
  board/pull/channel.sh virt "$to/www" --keys "$to/keys" --bundle "$to/bundle" --share $((place + 1))
  rm -rf "$to"/{later,root,slot,bundle,release}
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
    flat | card | pull) "$what" ;;
    *)
      complain "'$what' is nothing to prepare" "a typing error" "tests/system/prepare.sh flat, card, or pull"
      exit 2
      ;;
  esac
done
