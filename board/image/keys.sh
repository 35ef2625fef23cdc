#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The owner's keys for updates: an authority (CA) that boards trust, and signers that it certifies, one at a time in use.
#   board/image/keys.sh DIR                    makes the authority and the first signer
#   board/image/keys.sh DIR --new-signer       the next signer; boards take what it signs without hearing of it first
#   board/image/keys.sh DIR --revoke CERT.pem  a signer that is not to be trusted any more: boards hear of it by the next release
# DIR/ca.key.pem             the authority's key, used for the three commands above alone: keep it apart, off the building machine
# DIR/signer.key.pem         signs bundles (board/image/bundle.sh)
# DIR/signer.cert.pem        goes into every bundle, certified by the authority; DIR/signers/ keeps all that there were
# DIR/keyring.pem            goes into images (board/image/build.sh --keyring): the authority's certificate, and what it revoked
# DIR/index.txt, serial, crlnumber   what the authority has signed and revoked
# Both keys are encrypted (AES-256, scrypt), each by a passphrase of its own, which is asked for at the terminal; for scripts
# HOLDFAST_CA_PASS and HOLDFAST_SIGNER_PASS say where it is, as openssl-passphrase-options(1): file:PATH, fd:N, env:NAME.
# An authority is good for 30 years, a signer for three: what it signed within them stays good. board/README.md has the rest.
set -euo pipefail
# shellcheck source=toolchain/say.sh
source "$(dirname "${BASH_SOURCE[0]}")/../../toolchain/say.sh"

usage() {
  say "usage: board/image/keys.sh DIR [--new-signer | --revoke CERT.pem]"
  exit 2
}
dir=${1:-} what=${2:-} revoked=${3:-}
[[ -n $dir && $dir != -* ]] || usage
case $what in
  '' | --new-signer) (($# <= 2)) || usage ;;
  --revoke) (($# == 3)) || usage ;;
  *) usage ;;
esac
if [[ -z $what && -e $dir/ca.key.pem && ! -e $dir/keyring.pem ]]; then
  complain "$dir has an authority, and no keyring" "making them was broken off" "board/image/keys.sh $dir --new-signer makes what is missing"
  exit 1
fi
if [[ -z $what && -e $dir/ca.key.pem ]]; then
  complain "$dir/ca.key.pem is there" "an authority was made before" "use it, or name another folder: boards that trust it take no other"
  exit 1
fi
if [[ -n $what && ! -f $dir/ca.key.pem ]]; then
  complain "there is no $dir/ca.key.pem" "the authority's key is kept apart, or was never made" "put it there for this command, or board/image/keys.sh $dir"
  exit 1
fi
mkdir -p "$dir"
umask 077
work=$(mktemp -d "$dir/new.XXXXXX")
trap 'rm -rf "$work"' EXIT
trap 'exit 130' INT TERM

# ask NAME WHAT new|old: exports NAME_PASS, an openssl passphrase argument, from HOLDFAST_NAME_PASS or the terminal.
ask() {
  local given=HOLDFAST_$1_PASS first again
  if [[ -n ${!given:-} ]]; then
    printf -v "$1_PASS" %s "${!given}"
    return
  fi
  if ! (: </dev/tty) 2>/dev/null; then
    complain "no passphrase of $2" "no terminal to ask at" "set HOLDFAST_$1_PASS, see the head of board/image/keys.sh"
    exit 1
  fi
  read -rsp "passphrase of $2: " first </dev/tty && echo
  [[ $3 == old ]] || { read -rsp "the same again: " again </dev/tty && echo; }
  if [[ $3 == new && ($first != "$again" || ${#first} -lt 8) ]]; then
    complain "no passphrase of $2" "the two differ, or it has fewer than 8 characters" "try again"
    exit 1
  fi
  export "HOLDFAST_ASKED_$1=$first"
  printf -v "$1_PASS" %s "env:HOLDFAST_ASKED_$1"
}
# new_key NAME BITS PASS: an encrypted key; its plain form is never on a disk.
new_key() {
  local status=0
  openssl genpkey -quiet -algorithm RSA -pkeyopt "rsa_keygen_bits:$2" 2>"$work/log" |
    openssl pkcs8 -topk8 -scrypt -passout "$3" -out "$work/$1.key.pem" 2>>"$work/log" || status=$?
  ((status != 0)) || return 0
  sed 's/^/   | /' "$work/log"
  complain "openssl made no key" "no passphrase, or see the lines above" "try again"
  exit 1
}
# made WHAT COMMAND...: runs openssl, or says that it made no WHAT.
made() {
  quietly "$work/log" openssl "${@:2}" && return
  complain "openssl made no $1" "another passphrase, or see the lines above" "try again"
  exit 1
}

# openssl takes a $ in it for a name. Not by %q, which writes letters of other scripts in octal.
escaped=$(printf %s "$dir" | sed 's/[\\$"'"'"'`#]/\\&/g')
cat >"$work/ca.conf" <<CONF
[ca]
default_ca = owner
[owner]
database = $escaped/index.txt
new_certs_dir = $escaped/signers
serial = $escaped/serial
crlnumber = $escaped/crlnumber
certificate = $escaped/ca.cert.pem
private_key = $escaped/ca.key.pem
default_md = sha256
policy = any
unique_subject = no
[any]
organizationName = supplied
commonName = supplied
[authority]
basicConstraints = critical,CA:TRUE,pathlen:0
keyUsage = critical,keyCertSign,cRLSign
subjectKeyIdentifier = hash
[signer]
basicConstraints = critical,CA:FALSE
keyUsage = critical,digitalSignature
subjectKeyIdentifier = hash
authorityKeyIdentifier = keyid
[request]
distinguished_name = name
[name]
CONF

# Of two authorities in one keyring each has a name of its own: lists of the revoked are looked for by it.
new_authority() {
  new_key ca 4096 "$CA_PASS"
  made "authority" req -config "$work/ca.conf" -x509 -new -key "$work/ca.key.pem" -passin "$CA_PASS" -sha256 -days 10950 \
    -subj "/O=Holdfast owner/CN=authority $(openssl rand -hex 8)" -extensions authority -out "$work/ca.cert.pem"
  mkdir "$dir/signers"
  : >"$dir/index.txt"
  printf '01\n' >"$dir/serial"
  printf '01\n' >"$dir/crlnumber"
  mv "$work/ca.cert.pem" "$work/ca.key.pem" "$dir/"
}
new_signer() {
  new_key signer 3072 "$SIGNER_PASS"
  made "signer" req -config "$work/ca.conf" -new -key "$work/signer.key.pem" -passin "$SIGNER_PASS" -sha256 \
    -subj "/O=Holdfast owner/CN=signer $(cat "$dir/serial")" -out "$work/signer.csr"
  made "signer" ca -config "$work/ca.conf" -batch -notext -passin "$CA_PASS" -days 1095 -extensions signer \
    -in "$work/signer.csr" -out "$work/signer.cert.pem"
  mv "$work/signer.key.pem" "$work/signer.cert.pem" "$dir/"
}
# The list says from when to when it holds, and RAUC asks for the time of a bundle's signing: from before the first signer
# on, so that bundles that are older than the list stay good, for as long as the authority.
new_keyring() {
  made "list of what is revoked" ca -config "$work/ca.conf" -gencrl -passin "$CA_PASS" \
    -crl_lastupdate "$(date -u -d "$(openssl x509 -in "$dir/ca.cert.pem" -noout -startdate | cut -d = -f 2)" +%Y%m%d%H%M%SZ)" \
    -crl_nextupdate "$(date -u -d "$(openssl x509 -in "$dir/ca.cert.pem" -noout -enddate | cut -d = -f 2)" +%Y%m%d%H%M%SZ)" -out "$work/crl.pem"
  cat "$dir/ca.cert.pem" "$work/crl.pem" >"$work/keyring.pem"
  chmod 644 "$work/keyring.pem"
  mv "$work/keyring.pem" "$dir/"
}

case $what in
  '')
    ask CA "the authority's key" new
    ask SIGNER "the signer's key" new
    new_authority
    new_signer
    new_keyring
    say "keys: $dir/signer.key.pem signs, $dir/keyring.pem is built into cards. Next: keep a copy of $dir, move ca.key.pem off this machine; board/image/build.sh rpi4 --keyring $dir/keyring.pem"
    ;;
  --new-signer)
    ask CA "the authority's key" old
    ask SIGNER "the new signer's key" new
    new_signer
    [[ -e $dir/keyring.pem ]] || new_keyring # making them was broken off
    say "keys: $dir/signer.key.pem is a new one; the signer before is as good as it was. Next: --revoke, if it is not to be"
    ;;
  --revoke)
    # openssl goes by the number alone, which another authority's signer may have as well.
    serial=$(openssl x509 -in "$revoked" -noout -serial 2>/dev/null) || serial=none
    serial=${serial#serial=}
    if [[ ! -f $dir/signers/$serial.pem ]] || ! cmp -s <(openssl x509 -in "$revoked" -outform DER 2>/dev/null) <(openssl x509 -in "$dir/signers/$serial.pem" -outform DER 2>/dev/null); then
      complain "$revoked is no signer's certificate of $dir" "another file, or another authority's" "give one of $dir/signers/"
      exit 1
    fi
    if awk -F '\t' -v serial="$serial" '$1 == "R" && $4 == serial { found = 1 } END { exit !found }' "$dir/index.txt"; then
      complain "$revoked was revoked before" "the same command, given twice" "those that are good begin with V in $dir/index.txt"
      exit 1
    fi
    ask CA "the authority's key" old
    made "entry for $revoked" ca -config "$work/ca.conf" -passin "$CA_PASS" -revoke "$revoked"
    new_keyring
    say "keys: $revoked is revoked. Next: build a release with --keyring $dir/keyring.pem and a raised floor, sign it with another signer, install it everywhere"
    ;;
esac
