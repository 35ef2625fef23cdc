#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# An authority for the server that boards fetch from, and the server's certificate by it.
#   board/pull/server_keys.sh DIR ADDRESS [ADDRESS]...
# ADDRESS: the server's numbers or names, as they stand in HOLDFAST_PULL_URL.
# DIR/pull-ca.pem        what boards believe, and nothing else
# DIR/server.cert.pem, server.key.pem   the server's
# DIR/pull-ca.key.pem    only needed to make another server's certificate: keep it apart
# Certificates hold from 2020 for 30 years: a board has no clock, and begins at the time at which its system was built.
# Updates do not rest on them: what is installed is signed by board/image/keys.sh's signer.
set -euo pipefail
# shellcheck source=toolchain/say.sh
source "$(dirname "${BASH_SOURCE[0]}")/../../toolchain/say.sh"
dir=${1:-}
if (($# < 2)) || [[ $dir == -* ]]; then
  say "usage: board/pull/server_keys.sh DIR ADDRESS [ADDRESS]..."
  exit 2
fi
shift
umask 077
mkdir -p "$dir"
work=$(mktemp -d "$dir/new.XXXXXX")
trap 'rm -rf "$work"' EXIT
names=
for address in "$@"; do
  if [[ $address =~ ^[0-9.]+$ || $address == *:* ]]; then names+=",IP:$address"; else names+=",DNS:$address"; fi
done
: >"$work/index.txt"
cat >"$work/conf" <<CONF
[ca]
default_ca = owner
[owner]
database = $work/index.txt
new_certs_dir = $work
rand_serial = yes
default_md = sha256
policy = any
[any]
commonName = supplied
[authority]
basicConstraints = critical,CA:TRUE,pathlen:0
keyUsage = critical,keyCertSign
subjectKeyIdentifier = hash
[server]
basicConstraints = critical,CA:FALSE
keyUsage = critical,digitalSignature
extendedKeyUsage = serverAuth
subjectAltName = ${names#,}
[request]
distinguished_name = name
[name]
CONF
# made COMMAND...: runs openssl, or says why not.
made() {
  quietly "$work/log" openssl "$@" && return
  complain "openssl made no certificate" "see the lines above" "try again"
  exit 1
}
span=(-startdate 20200101000000Z -enddate 20500101000000Z)
ca=$dir/pull-ca
if [[ ! -f $ca.key.pem ]]; then
  made req -config "$work/conf" -new -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -keyout "$work/ca.key" \
    -subj "/CN=Holdfast server authority $(openssl rand -hex 8)" -out "$work/ca.csr"
  made ca -config "$work/conf" -batch -notext -selfsign -keyfile "$work/ca.key" "${span[@]}" -extensions authority -in "$work/ca.csr" -out "$work/ca.pem"
  mv "$work/ca.pem" "$ca.pem"
  chmod 644 "$ca.pem"
  mv "$work/ca.key" "$ca.key.pem"
fi
made req -config "$work/conf" -new -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -keyout "$work/server.key" -subj "/CN=$1" -out "$work/server.csr"
made ca -config "$work/conf" -batch -notext -cert "$ca.pem" -keyfile "$ca.key.pem" "${span[@]}" -extensions server -in "$work/server.csr" -out "$work/server.pem"
mv "$work/server.pem" "$dir/server.cert.pem"
mv "$work/server.key" "$dir/server.key.pem"
say "server keys: $dir/pull-ca.pem goes onto boards, server.cert.pem and server.key.pem to the server. Next: move pull-ca.key.pem off this machine"
