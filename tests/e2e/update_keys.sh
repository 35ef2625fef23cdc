#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The owner's keys (board/image/keys.sh), and which bundles a board takes by them: real ones by RAUC, looked at with the
# board's own configuration and functions. All keys are made here and thrown away.
# The last line is "N passed"; status 77: no rauc, openssl or mksquashfs.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=tests/e2e/steps.sh
source "tests/e2e/steps.sh"
needs rauc openssl mksquashfs dash
mkdir -p build/image
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export NO_COLOR=1 HOLDFAST_CA_PASS=file:$work/ca.pass HOLDFAST_SIGNER_PASS=file:$work/signer.pass
echo "of the authority" >"$work/ca.pass"
echo "of the signer" >"$work/signer.pass"
keys=$work/keys

# bundle NAME VERSION NUMBER [KEYS]: a small one for the board virt.
bundle() {
  mkdir -p "$work/slot"
  head -c 65536 /dev/urandom >"$work/slot/root.img"
  head -c 4096 /dev/urandom >"$work/slot/kernel.img"
  printf 'release=%s\nversion=%s\nboard=virt\n' "$3" "$2" >"$work/slot/release"
  board/image/bundle.sh virt --keys "${4:-$keys}" --slot "$work/slot" --out "$work/$1"
}
# board KEYRING COMMAND...: RAUC as a board with that keyring has it.
mkdir "$work/bin"
cat >"$work/bin/rauc" <<RAUC
#!/bin/sh
exec $(command -v rauc) --conf='$work/system.conf' "\$@"
RAUC
chmod +x "$work/bin/rauc"
board() {
  sed "s/@board@/virt/; s,^path=.*,path=$1," board/image/rauc.conf >"$work/system.conf"
  PATH=$work/bin:$PATH "${@:2}"
}
info() { board "$1" rauc info "$2"; }

says "keys" "signer.key.pem signs" board/image/keys.sh "$keys"
for key in ca signer; do
  is "$key.key.pem at rest" "-----BEGIN ENCRYPTED PRIVATE KEY-----" "$(head -n 1 "$keys/$key.key.pem")"
  is "plain keys beside $key.key.pem" "" "$(grep -rlE 'BEGIN (RSA |EC )?PRIVATE KEY' "$keys" || true)"
  is "who may read $key.key.pem" 600 "$(stat -c %a "$keys/$key.key.pem")"
done
refuses "the authority's passphrase for the signer's key" "Could not read|maybe wrong password|bad decrypt" \
  openssl pkey -in "$keys/signer.key.pem" -passin "$HOLDFAST_CA_PASS" -noout
refuses "a second authority over the first" "is there" board/image/keys.sh "$keys"
refuses "no passphrase" "no passphrase" env -u HOLDFAST_SIGNER_PASS setsid -w board/image/keys.sh "$work/none"
refuses "a passphrase that is nowhere" "openssl made no key" env HOLDFAST_SIGNER_PASS=env:NOWHERE board/image/keys.sh "$work/half"
refuses "an authority that was broken off" "and no keyring" board/image/keys.sh "$work/half"
says "what is missing" "is a new one" board/image/keys.sh "$work/half" --new-signer
is "its keyring" "it is" "$([[ -s $work/half/keyring.pem ]] && echo it is)"
is "the signer's certificate" "no CA" "$(openssl x509 -in "$keys/signer.cert.pem" -noout -ext basicConstraints | grep -q CA:FALSE && echo no CA)"

# The authority's key is kept apart: bundles need the signer's alone.
mv "$keys/ca.key.pem" "$work/apart.pem"
says "a bundle" "release 2 .0.9.0." bundle first 0.9.0 2
says "by names from where one stands" "release 2 .0.9.0." env -C "$work" "$PWD/board/image/bundle.sh" virt --keys keys --slot slot --out there
is "its place" "it is" "$([[ -s $work/there ]] && echo it is)"
is "what it leaves of the key" "" "$(grep -rlE 'BEGIN (RSA |EC )?PRIVATE KEY' "$work" build/image/bundle.* 2>/dev/null || true)"
cp "$keys/keyring.pem" "$work/before.pem"
says "a board takes it" "Verified|signature correct" info "$work/before.pem" "$work/first"
echo wrong >"$work/signer.pass"
refuses "a bundle by another passphrase" "does not open" bundle never 0.9.0 2
echo "of the signer" >"$work/signer.pass"
refuses "a new signer without the authority's key" "there is no .*ca.key.pem" board/image/keys.sh "$keys" --new-signer
mv "$work/apart.pem" "$keys/ca.key.pem"

# Whom the authority did not sign, whatever it calls itself.
board/image/keys.sh "$work/other_keys" >"$work/said" 2>&1 || fails "other keys"
says "a bundle by another owner" "release 9" bundle other 9.0 9 "$work/other_keys"
refuses "a board does not take it" "unable to get local issuer certificate" info "$work/before.pem" "$work/other"
cp -r "$keys" "$work/mixed"
cp "$work/other_keys"/signer.* "$work/mixed/"
refuses "no bundle by a signer of another authority" "would not take" bundle never 9.0 9 "$work/mixed"
# A signer certifies nobody: not an authority, so what it signs is nobody's.
openssl req -new -newkey rsa:2048 -nodes -keyout "$work/under.key" -subj "/O=Holdfast owner/CN=authority" -out "$work/under.csr" 2>/dev/null
openssl x509 -req -in "$work/under.csr" -CA "$keys/signer.cert.pem" -CAkey "$keys/signer.key.pem" -passin "$HOLDFAST_SIGNER_PASS" \
  -days 30 -out "$work/under.pem" 2>/dev/null
mkdir "$work/content"
cp "$work/slot"/* "$work/content/"
printf '[update]\ncompatible=holdfast-virt\nversion=9.0\nbuild=9\n[bundle]\nformat=verity\n[image.rootfs]\nfilename=root.img\n' >"$work/content/manifest.raucm"
rauc bundle --cert="$work/under.pem" --key="$work/under.key" --intermediate="$keys/signer.cert.pem" "$work/content" "$work/under" >/dev/null 2>&1 ||
  fails "a bundle by one that a signer certifies"
refuses "a board does not take what a signer certifies" "invalid CA certificate|unable to get|path length" info "$work/before.pem" "$work/under"

# The next signer: boards take it without having heard of it.
cp "$keys/signer.cert.pem" "$work/old.cert.pem"
cp "$keys/signer.key.pem" "$work/old.key.pem"
says "a new signer" "a new one" board/image/keys.sh "$keys" --new-signer
says "a bundle by it" "release 3" bundle second 0.10.0 3
says "a board that has not heard of it takes it" "Verified|signature correct" info "$work/before.pem" "$work/second"
says "the signer before is as good as it was" "Verified|signature correct" info "$work/before.pem" "$work/first"

# The signer before is revoked: by the keyring that the next release brings.
foreign="$work/the other's #1 \$keys, schlüssel"
says "another authority, in a folder of another kind of name" "signer.key.pem signs" board/image/keys.sh "$foreign"
refuses "its signer, which has the same number, revoked here" "is no signer's certificate of" board/image/keys.sh "$keys" --revoke "$foreign/signers/01.pem"
refuses "the authority itself revoked" "is no signer's certificate of" board/image/keys.sh "$keys" --revoke "$keys/ca.cert.pem"
refuses "a key revoked" "is no signer's certificate of" board/image/keys.sh "$keys" --revoke "$work/old.key.pem"
is "who is good" "V V" "$(cut -c 1 "$keys/index.txt" | xargs)"
says "revoked" "is revoked" board/image/keys.sh "$keys" --revoke "$work/old.cert.pem"
refuses "revoked twice" "revoked before" board/image/keys.sh "$keys" --revoke "$work/old.cert.pem"
refuses "a board with the new keyring does not take what it signed" "certificate revoked" info "$keys/keyring.pem" "$work/first"
says "the new one's is taken, although it is older than the list" "Verified|signature correct" info "$keys/keyring.pem" "$work/second"
says "a board with the old keyring takes both" "Verified|signature correct" info "$work/before.pem" "$work/first"
cp -r "$keys" "$work/stale"
cp "$work/old.cert.pem" "$work/stale/signer.cert.pem"
cp "$work/old.key.pem" "$work/stale/signer.key.pem"
refuses "no bundle by a signer that is revoked" "certificate revoked" bundle never 0.11.0 4 "$work/stale"
# A keyring without a list would take everybody, or nobody.
refuses "a board with the authority alone takes nothing" "unable to get certificate CRL" info "$keys/ca.cert.pem" "$work/second"

# A new authority: by a release that has both keyrings.
cat "$keys/keyring.pem" "$work/other_keys/keyring.pem" >"$work/both.pem"
says "a board with both authorities takes the old one's" "Verified|signature correct" info "$work/both.pem" "$work/second"
says "and the new one's" "Verified|signature correct" info "$work/both.pem" "$work/other"
refuses "but not the one that is revoked" "certificate revoked" info "$work/both.pem" "$work/first"

# The newest on a stick, by what RAUC finds signed: names say nothing, and what is damaged or not ours hides nothing.
mkdir "$work/stick"
cp "$work/second" "$work/stick/holdfast-virt-0.10.0.raucb"
cp "$work/first" "$work/stick/holdfast-virt-0.9.0.raucb"
cp "$work/other" "$work/stick/holdfast-virt-9.0.raucb"
head -c 9000 "$work/second" >"$work/stick/holdfast-virt-0.11.0.raucb"
# shellcheck disable=SC2016  # the card's shell's
newest() { basename "$(board "$1" dash -c '. board/image/card/usr/lib/holdfast/releases; newest "$1" virt' card "$work/stick")"; }
is "the newest of a stick" holdfast-virt-0.10.0.raucb "$(newest "$work/before.pem")"
is "the newest of a stick where another owner is trusted, too" holdfast-virt-9.0.raucb "$(newest "$work/both.pem")"
mv "$work/stick/holdfast-virt-0.10.0.raucb" "$work/stick/holdfast-a.raucb"
is "the newest whatever its name" holdfast-a.raucb "$(newest "$keys/keyring.pem")"
echo "$passed passed"
