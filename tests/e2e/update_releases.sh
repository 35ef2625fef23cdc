#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Which update a board takes from a stick, and which it refuses, by the functions that the card has
# (board/image/card/usr/lib/holdfast/releases), run by the card's shell and awk, against dpkg's own order. RAUC is played by
# a script that says what a bundle's signed manifest would; tests/e2e/update_keys.sh has the real one.
# The last line is "N passed"; status 77: no dpkg, dash or mawk.
set -euo pipefail
releases=$(realpath "$(dirname "${BASH_SOURCE[0]}")/../../board/image/card/usr/lib/holdfast/releases")
# shellcheck source=tests/e2e/steps.sh
source "$(dirname "${BASH_SOURCE[0]}")/steps.sh"
needs dpkg dash mawk
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir "$work/bin" "$work/stick"
ln -s "$(command -v mawk)" "$work/bin/awk"
cat >"$work/bin/rauc" <<'RAUC'
#!/bin/sh
# rauc info --output-format=shell FILE: a bundle here is three words - board, version, number - or damaged.
read -r board version number <"$3"
[ -n "$number" ] || exit 1
printf "RAUC_MF_COMPATIBLE='holdfast-%s'\nRAUC_MF_VERSION='%s'\nRAUC_MF_BUILD='%s'\n" "$board" "$version" "$number"
RAUC
chmod +x "$work/bin/rauc"
card() { PATH=$work/bin:$PATH dash -c ". '$releases'; $1" card "${@:2}"; }

# ---- The order of versions: first pairs that a comparison of names gets wrong, then whatever comes, against dpkg.
pairs="0.9.0 0.10.0
0.9.0 0.9.1
1.0~rc1 1.0
1.0 1.0.0
1.0-9 1.0-10
0.1.1 0.1.1-test
0.1.1-test 0.1.2
1.0a 1.0+
1.0a 1.0b
9 10
1.0~~ 1.0~
1.0.b 1.0.b1
00.9 0.10"
RANDOM=11
pieces=(0 1 2 9 10 09 . . - + '~' a b rc Z .0)
random_version() {
  version=
  until dpkg --validate-version "$version" 2>/dev/null; do
    version=$((RANDOM % 3))
    for ((k = RANDOM % 5; k > 0; k--)); do version+=${pieces[RANDOM % ${#pieces[@]}]}; done
  done
}
for _ in {1..300}; do
  random_version
  one=$version
  random_version
  pairs+=$'\n'"$one $version"
done
# shellcheck disable=SC2016  # the card's shell's
card 'while read -r a b; do
  if older "$a" "$b"; then echo before; elif older "$b" "$a"; then echo after; else echo same; fi
done' <<<"$pairs" >"$work/ours"
while read -r a b; do
  if dpkg --compare-versions "$a" lt "$b"; then echo before; elif dpkg --compare-versions "$a" gt "$b"; then
    echo after
  else echo same; fi
done <<<"$pairs" >"$work/dpkg"
while read -r pair ours theirs; do is "order of ${pair/,/ and }" "$theirs" "$ours"; done \
  < <(paste -d ' ' <(tr ' ' , <<<"$pairs") "$work/ours" "$work/dpkg")
((passed == 313)) || is "pairs that were compared" 313 "$passed"
is "one before the other" yes "$(grep -q before "$work/dpkg" && grep -q after "$work/dpkg" && echo yes)"

# ---- The newest on a stick.
# newest WANTED NAME=BOARD,VERSION,NUMBER...
newest() {
  local wanted=$1 one
  rm -f "$work/stick/"*
  for one in "${@:2}"; do tr , ' ' <<<"${one#*=}" >"$work/stick/${one%%=*}"; done
  # shellcheck disable=SC2016
  one=$(card 'newest "$1" virt' "$work/stick")
  is "newest of ${*:2}" "$wanted" "${one##*/}"
}
newest holdfast-0.10.0.raucb holdfast-0.9.0.raucb=virt,0.9.0,9 holdfast-0.10.0.raucb=virt,0.10.0,10
# Names say nothing.
newest holdfast-a.raucb holdfast-a.raucb=virt,0.10.0,10 holdfast-b.raucb=virt,0.9.0,9 holdfast-z-99.raucb=virt,0.8.0,8
newest holdfast-b.raucb holdfast-a.raucb=virt,1.0,3 holdfast-b.raucb=virt,1.0,10
newest holdfast-1.raucb holdfast-1.raucb=virt,1.0,3 holdfast-2.raucb=virt,1.0~rc2,2
# What is not signed, or for another board, or says what cannot be, hides nothing that is good, ...
newest holdfast-1.raucb holdfast-0.raucb=damaged holdfast-1.raucb=virt,0.1.0,1 holdfast-2.raucb=damaged \
  holdfast-3.raucb=rpi4,3.0,30 holdfast-4.raucb=virt,4.0,ten holdfast-5.raucb=virt,4.0,99999999999999999999 \
  'holdfast-6.raucb=virt,4.0;reboot,6'
# ... and is offered when there is nothing else, so that the board says what is wrong with it.
newest holdfast-1.raucb holdfast-1.raucb=damaged holdfast-2.raucb=damaged
newest "" other.raucb=virt,9.0,9
newest "" holdfast.txt=virt,9.0,9

# ---- What follows the running release.
printf 'version=0.10.0\nrelease=10\nfloor=8\n' >"$work/running"
# refusal WANTED VERSION NUMBER
refusal() {
  printf 'board=virt\nversion=%s\nrelease=%s\n' "$2" "$3" >"$work/offered"
  # shellcheck disable=SC2016
  is "release $3 ($2) after 10 (0.10.0)" "$1" "$(card 'refusal "$1" "$2"' "$work/offered" "$work/running")"
}
runs="10 (0.10.0), which runs"
refusal "" 0.11.0 11
refusal "" 0.10.0 11
refusal "" 0.100.0 4000
refusal "release 10 runs already" 0.11.0 10
refusal "release 9 (0.9.0) is older than $runs" 0.9.0 9
refusal "release 9 (0.11.0) is older than $runs" 0.11.0 9
refusal "release 11 (0.9.0) is older than $runs" 0.9.0 11
refusal "release 11 (0.10.0~rc1) is older than $runs" 0.10.0~rc1 11
refusal "release 7 is below 8, the oldest that this system goes back to" 0.7.0 7
refusal "release 7 is below 8, the oldest that this system goes back to" 0.20.0 7
for bad in "" ten -1 1.5 99999999999999999999; do refusal "it names no release" 0.11.0 "$bad"; done
refusal "it names no release" 'a b' 11
refusal "it names no release" '' 11

# ---- Going back: the owner names that very version on the card.
printf 'version=0.9.0\nrelease=9\n' >"$work/offered"
# back WANTED LINE
back() {
  printf '# settings\n%b\n' "$2" >"$work/conf"
  # shellcheck disable=SC2016
  is "going back by '$2'" "$1" "$(card 'if may_go_back "$1" "$2"; then echo yes; else echo no; fi' "$work/offered" "$work/conf")"
}
back yes HOLDFAST_GO_BACK_TO=0.9.0
back yes 'HOLDFAST_GO_BACK_TO=0.9.0\r'
back no HOLDFAST_GO_BACK_TO=0.9
back no HOLDFAST_GO_BACK_TO=0.9.00
back no HOLDFAST_GO_BACK_TO=
back no '#HOLDFAST_GO_BACK_TO=0.9.0'
back no ''
rm "$work/conf"
# shellcheck disable=SC2016
is "going back without a file" no "$(card 'if may_go_back "$1" "$2"; then echo yes; else echo no; fi' "$work/offered" "$work/conf")"
: >"$work/offered"
printf 'HOLDFAST_GO_BACK_TO=\n' >"$work/conf"
# shellcheck disable=SC2016
is "going back to nothing" no "$(card 'if may_go_back "$1" "$2"; then echo yes; else echo no; fi' "$work/offered" "$work/conf")"
echo "$passed passed"
