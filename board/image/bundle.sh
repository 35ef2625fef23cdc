#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Makes an update from what board/image/build.sh left: one signed file for RAUC, with root, kernel and release.
#   board/image/bundle.sh virt|rpi4 --keys DIR [--slot DIR] [--out FILE]
# --keys DIR: of board/image/keys.sh; signer.key.pem, signer.cert.pem and keyring.pem are enough. The key's passphrase is
# asked for at the terminal, or HOLDFAST_SIGNER_PASS says where it is, as openssl-passphrase-options(1).
# --slot: build/image/BOARD/slot unless given. --out: beside it, with board and version.
# How it gets onto a board: on a USB stick, see board/README.md.
set -euo pipefail
called_from=$PWD
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh
# shellcheck source=board/image/signer_pass.sh
source board/image/signer_pass.sh

board='' keys='' slot='' out=''
while (($# > 0)); do
  case $1 in
    virt | rpi4) board=$1 ;;
    --keys) keys=$(as_called "${2:-}") && shift ;;
    --slot) slot=$(as_called "${2:-}") && shift ;;
    --out) out=$(as_called "${2:-}") && shift ;;
    *)
      [[ $1 == --help || $1 == -h ]] || complain "unknown word '$1'" "a typing error" "see below"
      sed -n '3,8s/^# //p' board/image/bundle.sh
      [[ $1 == --help || $1 == -h ]] && exit 0
      exit 2
      ;;
  esac
  shift || true
done
: "${slot:=build/image/$board/slot}"
if [[ -z $board || -z $keys ]]; then
  complain "no board, or no keys" "it was forgotten" "board/image/bundle.sh rpi4 --keys keys"
  exit 2
fi
for file in "$slot/root.img" "$slot/kernel.img" "$slot/release" "$keys"/{signer.key.pem,signer.cert.pem,keyring.pem}; do
  [[ -f $file ]] && continue
  complain "there is no $file" "not built, or no key made" "board/image/build.sh $board, and board/image/keys.sh $keys"
  exit 1
done
command -v rauc >/dev/null || {
  complain "cannot make a bundle" "rauc is not here" "apt-get install rauc squashfs-tools"
  exit 1
}
if ! why=$(openssl verify -crl_check_all -CAfile "$keys/keyring.pem" "$keys/signer.cert.pem" 2>&1); then
  complain "boards would not take what $keys/signer.cert.pem signs: $(grep -m 1 '^error' <<<"$why")" "it was revoked, has expired, or is of another authority" \
    "board/image/keys.sh $keys --new-signer"
  exit 1
fi
signer_pass "$keys" board/image/bundle.sh
# plain_key: through a pipe to whoever reads it, never on a disk.
plain_key() { HOLDFAST_ASKED=${HOLDFAST_ASKED:-} openssl pkey -in "$keys/signer.key.pem" -passin "$pass" 2>/dev/null; }
if ! plain_key >/dev/null; then
  complain "$keys/signer.key.pem does not open" "another passphrase" "try again"
  exit 1
fi
version=$(sed -n 's/^version=//p' "$slot/release")
release=$(sed -n 's/^release=//p' "$slot/release")
: "${out:=build/image/$board/holdfast-$board-$version.raucb}"
mkdir -p build/image
work=$(mktemp -d build/image/bundle.XXXXXX)
trap 'rm -rf "$work"' EXIT
trap 'exit 130' INT TERM
mkdir "$work/content"
ln "$slot/root.img" "$slot/kernel.img" "$work/content/" 2>/dev/null || cp --sparse=always "$slot/root.img" "$slot/kernel.img" "$work/content/"
cp "$slot/release" "$work/content/"
cat >"$work/content/manifest.raucm" <<MANIFEST
[update]
compatible=holdfast-$board
version=$version
build=$release

[bundle]
format=verity

[image.rootfs]
filename=root.img

[image.kernel]
filename=kernel.img
MANIFEST
if ! quietly "$work/log" rauc bundle --keyring="$keys/keyring.pem" --cert="$keys/signer.cert.pem" --key=<(plain_key) "$work/content" "$work/new.raucb"; then
  complain "rauc made no bundle" "see the lines above" "look at the keys in $keys"
  exit 1
fi
mv "$work/new.raucb" "$out"
say "bundle: $out, $(($(stat -c %s "$out") / 1000000)) MB, release $release ($version)"
