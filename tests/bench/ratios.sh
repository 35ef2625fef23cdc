#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# How many times as fast as others: every ratio that tests/EVIDENCE.md promises, with its 95 % interval.
#   tests/bench/ratios.sh             by paired blocks (paired.hpp says how), a line "CLAIM: ..." for each; three to four minutes
#   tests/bench/ratios.sh --counts    beside it what does not depend on any machine's clock: instructions, branches and
#                                     mispredicted branches (callgrind's model) for each byte of the JPEG, libjpeg-turbo's and
#                                     ours with three lanes; three minutes
# Needs the preset bench: cmake --preset bench && cmake --build --preset bench --target jpeg_bench markers_bench jpeg_cost
# As root it takes a real-time priority, without which a busy machine leaves few blocks whole.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh
bin=build/bench/bin
for program in jpeg_bench markers_bench jpeg_cost; do
  [[ -x $bin/$program ]] || { complain "no $bin/$program" "not built" "see the head of ${BASH_SOURCE[0]}" && exit 2; }
done

if [[ ${1:-} != --counts ]]; then
  "$bin/jpeg_bench"
  "$bin/markers_bench"
  exit
fi

command -v valgrind >/dev/null || { complain "no valgrind" "not installed" "apt-get install valgrind" && exit 2; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$bin/jpeg_bench" --write "$work" >/dev/null
# events PICTURE WALK N: instructions, branches, mispredictions of the whole program.
events() {
  valgrind --tool=callgrind --branch-sim=yes --callgrind-out-file=/dev/null "$bin/jpeg_cost" "$@" 2>&1 |
    awk '/Collected :/ { print $4, $5 + $7, $6 + $8 }'
}
# A dense picture at which the ratio is worst, one like the default's, and the two kinds that no camera makes.
for name in 3280_s5_q92_420 3280_s3_q85_422 3280_flat_grey_422 1640_white_noise_422; do
  picture=$work/$name.jpg
  counts=()
  for arguments in "library 1" "library 3" "3 1" "3 3"; do
    read -ra words <<<"$arguments"
    counts+=("$(events "$picture" "${words[@]}")")
  done
  awk -v bytes="$(stat -c %s "$picture")" -v name="$name" '{
    for (i = 1; i <= 3; ++i) { theirs[i] = ($(3 + i) - $i) / 2 / bytes; ours[i] = ($(9 + i) - $(6 + i)) / 2 / bytes }
    printf "%s: %.1f and %.1f instructions; %.2f and %.2f branches; %.3f and %.3f mispredicted\n", name, theirs[1], ours[1],
      theirs[2], ours[2], theirs[3], ours[3]
  }' <<<"${counts[*]}"
done
