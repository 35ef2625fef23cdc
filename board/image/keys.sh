#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Makes the owner's key for updates: board/image/keys.sh DIR
#   DIR/owner.key.pem   signs bundles (board/image/bundle.sh); whoever has it can put anything on the boards. Keep it off them
#   DIR/owner.cert.pem  goes into images (board/image/build.sh --keyring), which take only what that key has signed
# One key for all boards of an owner, good for 30 years: a board has no network to hear of another by. For a new key, build
# a release with both certificates in one file, install it everywhere, and sign with the new key from then on.
set -euo pipefail
# shellcheck source=toolchain/say.sh
source "$(dirname "${BASH_SOURCE[0]}")/../../toolchain/say.sh"

dir=${1:-}
if [[ -z $dir || $dir == -* ]]; then
  say "usage: board/image/keys.sh DIR"
  exit 2
fi
if [[ -e $dir/owner.key.pem ]]; then
  complain "$dir/owner.key.pem is there" "a key was made before" "use it, or name another folder: boards that trust it take no other"
  exit 1
fi
mkdir -p "$dir"
umask 077
work=$(mktemp -d "$dir/new.XXXXXX")
trap 'rm -rf "$work"' EXIT
trap 'exit 130' INT TERM
if ! quietly "$work/log" openssl req -x509 -newkey rsa:3072 -sha256 -nodes -days 10950 -subj "/O=Holdfast owner/CN=updates" \
  -addext "keyUsage=critical,digitalSignature,keyCertSign" -addext "basicConstraints=critical,CA:TRUE" \
  -keyout "$work/owner.key.pem" -out "$work/owner.cert.pem"; then
  complain "openssl made no key" "see the lines above" "apt-get install openssl"
  exit 1
fi
chmod 644 "$work/owner.cert.pem"
mv "$work/owner.cert.pem" "$work/owner.key.pem" "$dir/"
say "keys: $dir/owner.key.pem signs, $dir/owner.cert.pem is built into cards. Next: board/image/build.sh rpi4 --keyring $dir/owner.cert.pem"
