#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Signs what boards are to take: writes DIR/channel, and copies the bundle beside it. DIR is what the server serves.
#   board/pull/channel.sh virt|rpi4 DIR --keys KEYS --bundle FILE --share PERCENT
# --keys: of board/image/keys.sh; signer.key.pem, signer.cert.pem and keyring.pem are enough. The key's passphrase is asked
# for at the terminal, or HOLDFAST_SIGNER_PASS says where it is, as openssl-passphrase-options(1).
# --share: of a hundred boards, those that take it: 0 halts, 100 is all. Boards keep their place, so 10 is within 50.
# Each channel has a number above the one in DIR: boards take no older one. DIR/channel must therefore be the newest one.
set -euo pipefail
# shellcheck source=toolchain/say.sh
source "$(dirname "${BASH_SOURCE[0]}")/../../toolchain/say.sh"
# shellcheck source=board/image/signer_pass.sh
source "$(dirname "${BASH_SOURCE[0]}")/../image/signer_pass.sh"

usage() {
  sed -n '3,9s/^# //p' "${BASH_SOURCE[0]}"
  exit "$1"
}
board=${1:-} dir=${2:-} keys='' bundle='' share=''
[[ $board != --help && $board != -h ]] || usage 0
[[ ($board == virt || $board == rpi4) && -n $dir ]] || usage 2
shift 2
while (($# > 1)); do
  case $1 in
    --keys) keys=$2 ;;
    --bundle) bundle=$2 ;;
    --share) share=$2 ;;
    *) usage 2 ;;
  esac
  shift 2
done
[[ $# == 0 && -n $keys && -n $bundle && $share =~ ^(100|[0-9]{1,2})$ ]] || usage 2
share=$((10#$share))
for file in "$bundle" "$keys"/{signer.key.pem,signer.cert.pem,keyring.pem}; do
  [[ -f $file ]] && continue
  complain "there is no $file" "not built, or no key made" "board/image/bundle.sh, board/image/keys.sh"
  exit 1
done
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
# verified FILE OUT: as a board does it.
verified() {
  openssl cms -verify -inform DER -in "$1" -CAfile "$keys/keyring.pem" -no-CApath -no-CAstore -crl_check -no_check_time -out "$2" 2>"$work/said"
}
if ! info=$(rauc info --keyring="$keys/keyring.pem" --output-format=shell "$bundle" 2>"$work/said"); then
  sed 's/^/   | /' "$work/said" >&2
  complain "boards would not take $bundle" "another owner's, or damaged" "board/image/bundle.sh"
  exit 1
fi
manifest() { sed -n "s/^$1='\(.*\)'\$/\1/p" <<<"$info"; }
if [[ $(manifest RAUC_MF_COMPATIBLE) != "holdfast-$board" ]]; then
  complain "$bundle is for $(manifest RAUC_MF_COMPATIBLE)" "another board's" "give that of $board"
  exit 1
fi
mkdir -p "$dir"
number=0
if [[ -f $dir/channel ]]; then
  verified "$dir/channel" "$work/before" || {
    complain "$dir/channel is not signed by a signer of $keys" "another owner's folder" "give the folder of the newest channel"
    exit 1
  }
  number=$(sed -n 's/\r*$//; s/^number=\([0-9]*\)$/\1/p' "$work/before")
fi
name=holdfast-$board-$(manifest RAUC_MF_VERSION).raucb
sum=$(sha256sum <"$bundle" | cut -d ' ' -f 1)
if [[ -f $dir/$name && $(sha256sum <"$dir/$name" | cut -d ' ' -f 1) != "$sum" ]]; then
  complain "$dir/$name is another bundle of the same version" "it was built again" "raise version and release in board/image/release"
  exit 1
fi
cat >"$work/plain" <<CHANNEL
holdfast-channel=1
board=$board
number=$((number + 1))
release=$(manifest RAUC_MF_BUILD)
version=$(manifest RAUC_MF_VERSION)
bundle=$name
size=$(stat -c %s "$bundle")
sha256=$sum
share=$share
CHANNEL
signer_pass "$keys" board/pull/channel.sh
if ! HOLDFAST_ASKED=${HOLDFAST_ASKED:-} quietly "$work/log" openssl cms -sign -binary -nodetach -md sha256 -outform DER -in "$work/plain" \
  -signer "$keys/signer.cert.pem" -inkey "$keys/signer.key.pem" -passin "$pass" -out "$work/channel"; then
  complain "openssl signed no channel" "another passphrase, or see the lines above" "try again"
  exit 1
fi
if ! verified "$work/channel" /dev/null; then
  sed 's/^/   | /' "$work/said" >&2
  complain "boards would not take what $keys/signer.cert.pem signs" "it was revoked" "board/image/keys.sh $keys --new-signer"
  exit 1
fi
# The bundle first: a channel names only what is there.
[[ -f $dir/$name ]] || { cp "$bundle" "$dir/.new" && mv "$dir/.new" "$dir/$name"; }
cp "$work/channel" "$dir/.new"
chmod 644 "$dir/.new" "$dir/$name"
mv "$dir/.new" "$dir/channel"
say "channel: number $((number + 1)) offers release $(manifest RAUC_MF_BUILD) ($(manifest RAUC_MF_VERSION)) to $share of 100 boards. Next: serve $dir by https"
