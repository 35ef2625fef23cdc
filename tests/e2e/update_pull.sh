#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Updates from the owner's server (board/pull), by the board's own scripts and shell: against an HTTPS server on loopback,
# with keys, channel and bundles as an owner makes them. Bundles are real, signed, and checked by the real RAUC; only their
# installation is played, by a stub `rauc` that calls the card's real update-check as RAUC does and keeps what it would
# have written. U-Boot's words are a file. With BIN, holdfastd itself says when nothing is held.
#   tests/e2e/update_pull.sh [BIN]      default build/sim/bin
# The last line is "N passed"; status 77: a tool is missing.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=tests/e2e/steps.sh
source tests/e2e/steps.sh
needs rauc openssl mksquashfs dash mawk curl python3
bin=$(realpath "${1:-build/sim/bin}") card=$PWD/board/image/card/usr/lib/holdfast
mkdir -p build/image
work=$(mktemp -d)
server='' daemon=
trap '[[ -z $server ]] || kill "$server" || true; [[ -z $daemon ]] || kill "$daemon" || true; rm -rf "$work"' EXIT
trap 'exit 130' INT TERM
export NO_COLOR=1 HOLDFAST_CA_PASS=file:$work/ca.pass HOLDFAST_SIGNER_PASS=file:$work/signer.pass
unset https_proxy HTTPS_PROXY all_proxy ALL_PROXY
echo "of the authority" >"$work/ca.pass"
echo "of the signer" >"$work/signer.pass"
keys=$work/keys

# ---- What the owner makes.
board/image/keys.sh "$keys" >"$work/said" 2>&1 || fails "keys"
board/image/keys.sh "$work/other_keys" >"$work/said" 2>&1 || fails "other keys"
says "keys of a server" "pull-ca.pem goes onto boards" board/pull/server_keys.sh "$work/tls" 127.0.0.1
board/pull/server_keys.sh "$work/other_tls" 127.0.0.1 >"$work/said" 2>&1 || fails "keys of another server"
board/pull/server_keys.sh "$work/name_tls" example.test >"$work/said" 2>&1 || fails "keys of another address"
is "the server's certificate holds from" "Jan  1 00:00:00 2020 GMT" "$(openssl x509 -in "$work/tls/server.cert.pem" -noout -startdate | cut -d = -f 2)"
# bundle NAME VERSION NUMBER [KEYS] [BOARD]
bundle() {
  mkdir -p "$work/slot"
  head -c 1048576 /dev/urandom >"$work/slot/root.img"
  head -c 4096 /dev/urandom >"$work/slot/kernel.img"
  printf 'release=%s\nversion=%s\nboard=%s\n' "$3" "$2" "${5:-virt}" >"$work/slot/release"
  board/image/bundle.sh "${5:-virt}" --keys "${4:-$keys}" --slot "$work/slot" --out "$work/$1" >"$work/said" 2>&1 || fails "bundle $1"
}
bundle second 0.2.0 2
bundle third 0.3.0 3
bundle old 0.0.9 0
bundle other 0.2.0 2 "$work/other_keys"
www=$work/www
channel() { board/pull/channel.sh virt "$www" --keys "${3:-$keys}" --bundle "$work/$1" --share "$2"; }
# offer NAME SHARE [KEYS]
offer() { channel "$@" >"$work/said" 2>&1 || fails "channel of $1"; }

# ---- The server.
mkdir "$work/control"
end() {
  kill "$1"
  wait "$1" 2>/dev/null || true
}
start_server() {
  if [[ -n $server ]]; then end "$server"; fi
  rm -f "$work/control/port"
  python3 tests/e2e/https_server.py "$www" "$work/$1/server.cert.pem" "$work/$1/server.key.pem" "$work/control" 2>"$work/said" &
  server=$!
  local end=$((SECONDS + 60))
  until [[ -f $work/control/port ]]; do
    ((SECONDS < end)) || fails "the server does not start"
    sleep 0.1
  done
  url=https://127.0.0.1:$(cat "$work/control/port")
}
requests() { cat "$work/control/log" 2>/dev/null || true; }
mkdir "$www"
start_server tls

# ---- The board: the card's scripts with their folders moved here.
mkdir -p "$work/bin" "$work/usr/lib/holdfast" "$work/run"
for tool in awk:mawk sh:dash; do ln -s "$(command -v "${tool#*:}")" "$work/bin/${tool%:*}"; done
# moved FILE: a script of the card, its paths below $work.
moved() { sed "s,/run/holdfast-refused,$work/run/refused,g; s,/run/holdfast-back,$work/run/back,g; s,/run/holdfast-notes,$work/run/notes,g
  s,/usr/lib/holdfast/,$work/usr/lib/holdfast/,g; s,/etc/rauc/,$work/etc/,g; s,/boot/,$work/boot/,g" "$1"; }
for script in note releases update-check; do
  moved "$card/$script" >"$work/usr/lib/holdfast/$script"
  chmod +x "$work/usr/lib/holdfast/$script"
done
moved board/image/card/usr/sbin/holdfast-update >"$work/bin/holdfast-update"
mkdir "$work/etc" "$work/boot" "$work/installed"
sed "s/@board@/virt/; s,^path=.*,path=$work/etc/keyring.pem," board/image/rauc.conf >"$work/etc/system.conf"
cp "$keys/keyring.pem" "$work/etc/keyring.pem"
printf 'version=0.1.0\nrelease=1\nfloor=1\n' >"$work/usr/lib/holdfast/release"
cat >"$work/bin/rauc" <<RAUC
#!/bin/sh
# The stub: \`rauc install\` checks by the real one, calls update-check on what is in the bundle, and keeps the bundle.
real="$(command -v rauc) --conf=$work/etc/system.conf"
[ "\$1" = install ] || exec \$real "\$@"
\$real info "\$2" >"$work/rauc.said" 2>&1 || { echo "LastError: signature verification failed"; exit 1; }
rm -rf "$work/mounted"
mkdir "$work/mounted"
unsquashfs -q -n -f -d "$work/mounted" "\$2" >/dev/null 2>&1
RAUC_BUNDLE_MOUNT_POINT=$work/mounted RAUC_CURRENT_BOOTNAME=A "$work/usr/lib/holdfast/update-check" || { echo "LastError: refused"; exit 1; }
cp "\$2" "$work/installed/"
RAUC
# shellcheck disable=SC2016  # the stubs' own
for word in fw_printenv:'grep -s "^\$2=" WORDS | cut -d = -f 2' fw_setenv:'{ grep -v "^\$1=" WORDS; echo "\$1=\${2:-}"; } >WORDS.new; mv WORDS.new WORDS'; do
  printf '#!/bin/sh\n%s\n' "${word#*:}" | sed "s,WORDS,$work/words,g; s/\\\\//g" >"$work/bin/${word%%:*}"
done
chmod +x "$work/bin/"*
: >"$work/words"
export HOLDFAST_RELEASES=$work/usr/lib/holdfast/releases HOLDFAST_KEYRING=$work/etc/keyring.pem HOLDFAST_PULL_CA=$work/tls/pull-ca.pem \
  HOLDFAST_RELEASE=$work/usr/lib/holdfast/release HOLDFAST_PULL_FETCHED=$work/run/fetched HOLDFAST_PULL_OWN=$work/run/own \
  HOLDFAST_PULL_KEPT=$work/data HOLDFAST_EMPTY=$work/run/empty HOLDFAST_PULL_EMPTY_S=0 HOLDFAST_UPDATE=$work/bin/holdfast-update \
  HOLDFAST_NOTE=$work/usr/lib/holdfast/note HOLDFAST_SERIAL=10000000abcdef01
pull=$PWD/board/pull/root/usr/lib/holdfast/pull
on_board() { env PATH="$work/bin:$PATH" HOLDFAST_PULL_URL="${at:-$url}" HOLDFAST_PULL_RATE=100M dash "$pull" "$@"; }
sed -i "s,/etc/rauc/system.conf,$work/etc/system.conf," "$work/usr/lib/holdfast/releases"
fetch() { on_board fetch; }
install_it() { on_board install; }
# over_empty: installs over an empty gel, whose mark is kept young as holdfastd keeps it.
over_empty() {
  local young status=0
  while touch "$work/run/empty"; do sleep 0.5; done &
  young=$!
  install_it || status=$?
  end "$young"
  rm -f "$work/run/empty"
  return "$status"
}
# fresh: a board that has heard of nothing, and an owner who has signed nothing.
fresh() {
  rm -rf "$work/run/fetched" "$work/run/own" "$work/data" "$work/run/notes" "$work/installed" "$www" "$work/control/log" "$work/run/empty"
  mkdir -p "$work/run/fetched" "$work/installed" "$www"
  : >"$work/words"
}
installed() { (cd "$work/installed" && echo *.raucb) | sed 's/^\*.raucb$//'; }
fetched() { find "$work/run/fetched" -name 'bundle*'; }
told() { cat "$work/run/notes/update" 2>/dev/null || true; }

# ---- A good update.
fresh
says "a channel" "number 1 offers release 2 .0.2.0. to 100" channel second 100
says "it is fetched" "^release 2 is fetched$" fetch
says "nothing is installed while something is held" "waits until nothing is held" install_it
is "what the console says of it" "release 2 is fetched, and waits until nothing is held for 0 s" "$(told)"
is "what was installed" "" "$(installed)"
touch -d '-10 seconds' "$work/run/empty"
says "nor by a mark of a process that has died" "waits until nothing is held" install_it
touch -d '+1 hour' "$work/run/empty"
says "nor by one of another time" "waits until nothing is held" install_it
says "it is installed when nothing is held" "^installed holdfast-virt-0.2.0.raucb" over_empty
is "the bytes" "$(sha256sum <"$work/second")" "$(sha256sum <"$work/installed/holdfast-virt-0.2.0.raucb")"
is "the slot on trial" "BOOT_TRIAL=B" "$(grep BOOT_TRIAL "$work/words")"
is "the console" "installed holdfast-virt-0.2.0.raucb. Next: start the machine anew when the gripper holds nothing; it is kept once enough frames were OK" "$(told)"
is "the memory that is left of it" "" "$(find "$work/run" -name '*bundle*' -o -name '*.raucb')"
# The next hours: it is not installed over and over, neither before the start nor after a fall-back.
rm "$work/installed/"*
: >"$work/words"
says "the same is not fetched again" "was installed by this before" fetch
says "nor installed" "was installed by this before" install_it
offer second 50
says "nor by a newer channel" "was installed by this before" fetch
offer third 100
says "the release after it is" "^release 3 is fetched$" fetch
says "and installed" "^installed holdfast-virt-0.3.0.raucb" over_empty

# ---- A channel that was changed, or that another signed.
fresh
offer second 100
cp "$www/channel" "$work/channel.good"
at_byte() { # at_byte FILE OFFSET: every bit of that byte
  python3 -c 'import sys; b = bytearray(open(sys.argv[1], "rb").read()); b[int(sys.argv[2])] ^= 255; open(sys.argv[1], "wb").write(b)' "$1" "$2"
}
at_byte "$www/channel" "$(grep -abo 'share=100' "$work/channel.good" | cut -d : -f 1)"
refuses "a channel with a changed byte" "not signed by this board's owner" fetch
cp "$work/channel.good" "$www/channel"
at_byte "$www/channel" $(($(stat -c %s "$www/channel") - 20))
refuses "a channel with a changed signature" "not signed by this board's owner" fetch
head -c 300 "$work/channel.good" >"$www/channel"
refuses "half a channel" "not signed by this board's owner" fetch
: >"$www/channel"
refuses "an empty channel" "not signed by this board's owner" fetch
head -c 70000 /dev/zero >"$www/channel"
refuses "a channel that is too large" "could not be fetched" fetch
rm "$www/"*
refuses "no channel" "could not be fetched" fetch
offer other 100 "$work/other_keys"
refuses "another owner's channel" "not signed by this board's owner" fetch
cp "$work/second" "$www/holdfast-virt-0.2.0.raucb"
printf 'holdfast-channel=0\nboard=virt\n' >"$work/text"
signed() { openssl cms -sign -binary -nodetach -outform DER -in "$1" -signer "$keys/signer.cert.pem" -inkey "$keys/signer.key.pem" -passin "$HOLDFAST_SIGNER_PASS" -out "$www/channel"; }
signed "$work/text"
refuses "another file of the owner's" "is no channel" fetch
openssl cms -verify -inform DER -in "$work/channel.good" -noverify -out "$work/good.text" 2>/dev/null
for change in 's/^number=.*//' 's/^size=.*/size=-1/' 's/^sha256=.*/sha256=0/' 's/^share=.*/share=all/' 's,^bundle=.*,bundle=../../secret,' 's/^board=.*/board=rpi4/' 's/^size=.*/size=999999999/'; do
  sed "$change" "$work/good.text" >"$work/text"
  signed "$work/text"
  refuses "a signed channel after '$change'" "lacks a line|no SHA-256|for another board|larger than a slot" fetch
done
is "what was asked for but channels" "" "$(requests | grep -v '^/channel' || true)"
# The step with rights believes nothing of the step without.
cp "$work/channel.good" "$www/channel"
says "a good one" "is fetched" fetch
cp "$work/run/fetched/channel" "$work/channel.kept"
at_byte "$work/run/fetched/channel" "$(grep -abo 'share=100' "$work/run/fetched/channel" | cut -d : -f 1)"
refuses "a channel that was changed after it was fetched" "not signed by this board's owner" over_empty
cp "$work/channel.kept" "$work/run/fetched/channel"
at_byte "$work/run/fetched/bundle-$(sha256sum <"$work/second" | cut -d ' ' -f 1)" 1000
refuses "a bundle that was changed after it was fetched" "not the file that the channel names" over_empty
is "what was installed" "" "$(installed)"
# A revoked signer.
fresh
cp -r "$keys" "$work/stale"
board/image/keys.sh "$keys" --new-signer >"$work/said" 2>&1 || fails "a new signer"
offer second 100 "$work/stale"
cp "$www/channel" "$work/channel.stale"
board/image/keys.sh "$keys" --revoke "$work/stale/signer.cert.pem" >"$work/said" 2>&1 || fails "revoking"
says "a board that has not heard of the revocation takes it" "is fetched" fetch
cp "$keys/keyring.pem" "$work/etc/keyring.pem"
refuses "one that has does not" "not signed by this board's owner .*revoked" fetch
cp "$keys/keyring.pem" "$work/stale/keyring.pem"
refuses "nor can one be made any more" "revoked|would not take|not signed by a signer" channel second 100 "$work/stale"
bundle second 0.2.0 2
bundle third 0.3.0 3

# ---- An older channel, which was halted since.
fresh
offer second 100
cp "$www/channel" "$work/channel.1"
says "number 1" "is fetched" fetch
offer second 0
cp "$www/channel" "$work/channel.2"
says "number 2 halts it" "for 0 of 100 boards" fetch
is "what was fetched of it is gone" "" "$(fetched)"
says "number 2 is remembered" "for 0 of 100 boards" over_empty
cp "$work/channel.1" "$www/channel"
refuses "number 1 again" "number 1, and number 2 was seen before" fetch
cp "$work/channel.1" "$work/run/fetched/channel"
cp "$work/second" "$work/run/fetched/bundle-$(sha256sum <"$work/second" | cut -d ' ' -f 1)"
refuses "number 1 by a fetcher that lies" "number 1, and number 2 was seen before" over_empty
is "what was installed" "" "$(installed)"
cp "$work/channel.2" "$www/channel"
says "number 2 again is no replay" "for 0 of 100 boards" fetch
: >"$work/data/number"
refuses "a damaged memory of it opens nothing" "was seen before" fetch
rm -rf "$work/data"
touch "$work/data"
refuses "a memory that cannot be written opens nothing" "cannot be kept" install_it
rm "$work/data"

# ---- Releases that a board does not take, whatever the owner offers.
fresh
offer old 100
says "an older release" "release 0 is below 1|older than" fetch
printf 'HOLDFAST_GO_BACK_TO=0.0.9\n' >"$work/boot/holdfastd.conf"
says "not even one that a stick may bring" "release 0 is below 1|older than" fetch
rm "$work/boot/holdfastd.conf"

# ---- A bundle that was changed, or is another's behind the owner's channel.
fresh
offer second 100
at_byte "$www/holdfast-virt-0.2.0.raucb" 5000
refuses "a bundle with a changed byte" "not the file that the channel names" fetch
is "what is left of it" "" "$(fetched)"
head -c 2000000 /dev/zero >>"$www/holdfast-virt-0.2.0.raucb"
refuses "a bundle that is longer than said" "were fetched|not the file" fetch
is "and no more of it than said" yes "$(for file in "$work/run/fetched/"bundle-*; do [[ -f $file ]] && (($(stat -c %s "$file") > $(stat -c %s "$work/second") + 512)) && echo no; done | grep . || echo yes)"
refuses "no channel for another owner's bundle" "would not take" channel other 100
sed "s/^size=.*/size=$(stat -c %s "$work/other")/; s/^sha256=.*/sha256=$(sha256sum <"$work/other" | cut -d ' ' -f 1)/; s/^number=.*/number=7/" "$work/good.text" >"$work/text"
signed "$work/text"
cp "$work/other" "$www/holdfast-virt-0.2.0.raucb"
says "another owner's bundle behind a signed channel" "is fetched" fetch
refuses "is not installed by RAUC" "was not installed: signature verification failed" over_empty
is "what was installed" "" "$(installed)"
# Any while one is on trial, as by a stick.
fresh
offer second 100
says "a good one" "is fetched" fetch
echo BOOT_TRIAL=A >"$work/words"
refuses "waits while a release is on trial" "is on trial" over_empty
: >"$work/words"
says "fetched again" "is fetched" fetch
says "and is installed after it" "^installed" over_empty

# ---- The server goes away in the middle.
fresh
offer second 100
whole=$(stat -c %s "$work/second")
echo 400000 >"$work/control/cut"
refuses "a server that goes away" "^error: .*400000 of $whole bytes" fetch
says "nothing is installed of it" "is not fetched yet" over_empty
echo 300000 >"$work/control/cut"
refuses "and once more" "^error: .*700000 of $whole bytes" fetch
says "the third time it is whole" "is fetched" fetch
is "it went on from where it was" "0 400000 700000 " "$(requests | awk '/raucb/ { printf "%s ", $2 }')"
says "and is installed" "^installed" over_empty
is "the bytes" "$(sha256sum <"$work/second")" "$(sha256sum <"$work/installed/holdfast-virt-0.2.0.raucb")"
# What is there of a bundle that the channel names no more is no part of the next.
fresh
offer second 100
echo 400000 >"$work/control/cut"
refuses "a server that goes away" "400000 of" fetch
offer third 100
says "the next release begins anew" "release 3 is fetched" fetch
is "its first byte" "0" "$(requests | awk '/0.3.0/ { print $2 }')"

# ---- No room: on a small file system, which a name space of users may mount.
fresh
offer second 100
# small SIZE COMMAND: with what was fetched on a file system of that size.
small() {
  unshare -rm bash -c "mount -t tmpfs -o size=$1 small $work/run/fetched && $(declare -f fetch on_board); at=$url work=$work pull=$pull; $2"
}
if unshare -rm true 2>/dev/null; then
  refuses "a small file system" "no room for the bundle: $whole bytes are wanted" small 1800k fetch
  is "what was asked for of the bundle" "" "$(requests | grep raucb || true)"
  # Full in the middle: somebody else took the room that was there.
  printf '#!/bin/sh\necho head\necho x x x 999999 x x\n' >"$work/bin/df"
  chmod +x "$work/bin/df"
  says "a file system that is full in the middle, and has room later" "release 2 is fetched" \
    small 600k "! fetch 2>$work/full && mount -o remount,size=4m $work/run/fetched && fetch"
  rm "$work/bin/df"
  is "what it said of it" yes "$(grep -qE 'of [0-9]+ bytes of .* \(curl: 23\).*disk is full' "$work/full" && echo yes)"
  is "it went on from where it was" yes "$(requests | awk '/raucb/ && $2 > 0 { print "yes" }' | tail -n 1)"
else
  echo "left out: a small file system (no user namespaces here)"
fi

# ---- The ring.
# Each serial number on stdin and its place, by another tool.
places() {
  python3 -c 'import hashlib, sys
for serial in sys.stdin.read().split(): print(serial, int(hashlib.sha256(b"holdfast ring " + serial.encode()).hexdigest()[:7], 16) % 100)'
}
# serials N: of that many boards.
serials() {
  local k
  for ((k = 1; k <= $1; k++)); do printf '10000000%08x\n' $((k * 2654435761 % 4294967296)); done
}
fresh
place=$(on_board ring "$HOLDFAST_SERIAL")
is "a place by another tool" "$HOLDFAST_SERIAL $place" "$(places <<<"$HOLDFAST_SERIAL")"
offer second "$place"
says "a ring that is not open yet" "release 2 is for $place of 100 boards, and this one is at place $place" fetch
is "what was asked for of the bundle" "" "$(requests | grep raucb || true)"
offer second $((place + 1))
says "one wider" "is fetched" fetch
# Twenty more by both, and 4000 by the other tool: each place is as likely; four sigmas of 4000 * 0.3 * 0.7 are 116.
is "twenty places by another tool" "$(serials 20 | places)" "$(serials 20 | while read -r serial; do echo "$serial $(on_board ring "$serial")"; done)"
within=$(serials 4000 | places | awk '$2 < 30' | wc -l)
is "boards of 4000 within 30 of 100, 1200 on average" yes "$( ((within > 1084 && within < 1316)) && echo yes || echo "$within")"
if [[ ! -e /proc/device-tree/serial-number ]]; then
  HOLDFAST_SERIAL='' says "a board without a serial number" "has no serial number" fetch
fi

# ---- Whom a board speaks to.
fresh
offer second 100
start_server other_tls
refuses "a server of another authority" "could not be fetched" fetch
start_server name_tls
cp "$work/name_tls/pull-ca.pem" "$work/believed.pem"
HOLDFAST_PULL_CA=$work/believed.pem refuses "a server of another name" "could not be fetched" fetch
start_server tls
at=${url/https:/http:} refuses "no https" "is no https" fetch
at=$url/elsewhere refuses "a server that sends it elsewhere" "could not be fetched|not signed" fetch
is "what came of it" "" "$(installed)$(fetched)"
says "the right one" "is fetched" fetch

# ---- holdfastd says when nothing is held: an empty gel for a second, then an object that is held for ever.
if [[ -x $bin/holdfastd ]]; then
  # mark there|gone: it is, for a second of looks.
  mark() {
    local k
    for k in {1..50}; do
      if [[ -e $work/run/empty ]]; then [[ $1 == there ]] || return 1; else [[ $1 == gone ]] || return 1; fi
      sleep 0.02
    done
  }
  # until_mark there|gone
  until_mark() {
    local end=$((SECONDS + 120))
    until mark "$1"; do
      ((SECONDS < end)) || return 1
      sleep 0.1
    done
  }
  daemon() {
    "$bin/holdfastd" --real-time "$@" --empty-file "$work/run/empty" >"$work/daemon.out" 2>&1 &
    daemon=$!
  }
  touch "$work/run/empty"
  daemon
  until_mark gone || fails "the mark stays while something is held"
  says "nothing is installed while holdfastd has something in its grip" "waits until nothing is held" install_it
  end "$daemon"
  daemon --empty
  until_mark there || fails "an empty gel makes no mark"
  says "it is installed over an empty gel" "^installed" install_it
  end "$daemon"
  daemon=
else
  echo "left out: the mark of holdfastd (not built)"
fi

# ---- What boards are told is right.
refuses "a share above 100" "usage|--share" channel second 101
refuses "another board's bundle" "is for holdfast-virt" board/pull/channel.sh rpi4 "$www" --keys "$keys" --bundle "$work/second" --share 1
echo wrong >"$work/signer.pass"
refuses "another passphrase" "signed no channel" channel second 1
echo "$passed passed"
