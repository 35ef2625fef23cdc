# SPDX-License-Identifier: Apache-2.0
# For sourcing, behind toolchain/say.sh, by what signs with keys of board/image/keys.sh.
# signer_pass KEYS SCRIPT: `pass`, which openssl's -passin takes: what HOLDFAST_SIGNER_PASS says, or asked for at the
# terminal and then in HOLDFAST_ASKED, which has to be in openssl's environment. SCRIPT's head says more.
signer_pass() {
  pass=${HOLDFAST_SIGNER_PASS:-env:HOLDFAST_ASKED}
  [[ -z ${HOLDFAST_SIGNER_PASS:-} ]] || return 0
  if ! (: </dev/tty) 2>/dev/null; then
    complain "no passphrase of $1/signer.key.pem" "no terminal to ask at" "set HOLDFAST_SIGNER_PASS, see the head of $2"
    exit 1
  fi
  read -rsp "passphrase of $1/signer.key.pem: " HOLDFAST_ASKED </dev/tty && echo
}
