#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Which lines and branches of firmware/ the tests run:
#   coverage.sh [--update | --build]
# builds the preset coverage, runs firmware_tests, jpeg_tests and the digest of the recordings, and prints the share of
# lines and branches in each folder. Fails when a share leaves its band in baseline.csv, when a branch that no test takes
# is not in uncovered.txt, and when one that is there is taken; --update writes the shares; it also prints what uncovered.txt
# lacks and has too much, for a hand to put right. --build: no more than the build.
# Not counted: branches that only an exception takes, or that the compiler put where the source has none; comparisons that
# are "= default"; and the compiled tree, of which host_tests try every threshold; main(), a loop that ends when the
# process does and is tried as a process. Host tests do not count: what only they
# reach is shown nowhere on the Pi. Left out are the groups about the simulation itself, which take long and run none of it.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh
build=build/coverage listed=tests/checks/uncovered.txt update=()
[[ ${1:-} != --update ]] || update=(--update)

command -v gcovr >/dev/null || {
  complain "no gcovr" "not installed" "apt-get install gcovr, or run tests/run.sh --only packages"
  exit 1
}
export CCACHE_BASEDIR=  # the objects name the folder that they count in: another clone's are of no use
quietly "$build.log" cmake --preset coverage || exit 1
quietly "$build.log" cmake --build --preset coverage || exit 1
[[ ${1:-} != --build ]] || exit 0
find -L "$build" -name '*.gcda' -delete  # counts of earlier runs
quietly "$build/tests.log" ctest --test-dir "$build" -j "$(nproc)" --output-on-failure --no-tests=error \
  -R '^(firmware_tests|jpeg_tests)\.|^checks\.digest$' -LE physics || exit 1
quietly "$build/gcovr.log" gcovr --root . --filter firmware/ --exclude 'firmware/slip/slip_tree\.gen\.hpp' \
  --exclude 'firmware/main\.cpp' \
  --exclude-throw-branches --exclude-unreachable-branches --exclude-branches-by-pattern '.*= default;.*' \
  --gcov-ignore-parse-errors -j "$(nproc)" --csv "$build/coverage.csv" --json "$build/coverage.json" --json-pretty \
  "$build/firmware" "$build/drivers" "$build/tests" || exit 1

status=0
awk -F, '
  function add(name) { lines[name] += $2; ran[name] += $3; branches[name] += $5; taken[name] += $6 }
  NR > 1 { split($1, path, "/"); add(path[2]); add("all") }
  END {
    for (name in lines) {
      printf "coverage.lines_%s_pct %.1f\n", name, 100 * ran[name] / lines[name]
      printf "coverage.branches_%s_pct %.1f\n", name, 100 * taken[name] / branches[name]
    }
  }' "$build/coverage.csv" | sort | tests/checks/baseline.sh "${update[@]}" coverage || status=1

# Every line with a branch that was never taken, as "file: its text", against the list: the same lines, by their text,
# because numbers move with every edit.
awk '
  /"file":/ { gsub(/[",]/, "", $2); file = $2 }
  /"branches": \[/ { within = !/\]/; missed = 0 }
  within && /"count":/ { missed += $2 + 0 == 0 }
  /^ *\],?$/ { within = 0 }
  /"line_number":/ { if (missed) print file, $2 + 0; missed = 0 }' "$build/coverage.json" >"$build/uncovered"
while read -r file line; do
  printf '%s: %s\n' "$file" "$(sed -n "${line}s/^ *//p" "$file")"
done <"$build/uncovered" | sort -u >"$build/uncovered.now"
awk '/^firmware\//' "$listed" | sort -u >"$build/uncovered.listed"
# Taken or not by how two threads meet.
sed -n 's/^either //p' "$listed" >"$build/uncovered.either"
for list in now listed; do
  grep -vxFf "$build/uncovered.either" "$build/uncovered.$list" >"$build/uncovered.kept" || true
  mv "$build/uncovered.kept" "$build/uncovered.$list"
done
comm -23 "$build/uncovered.now" "$build/uncovered.listed" | sed 's/^/no test takes a branch of  /'
comm -13 "$build/uncovered.now" "$build/uncovered.listed" | sed 's/^/every branch is taken, or the line is gone:  /'
if ! cmp -s "$build/uncovered.now" "$build/uncovered.listed"; then
  status=1
  complain "$listed is not what was measured" "code or tests changed: see the lines above" \
    "write a test, or list the line under its reason, or take it off the list"
fi
say "$(wc -l <"$build/uncovered.now") lines with a branch that no test takes, of which $listed has $(wc -l <"$build/uncovered.listed")"
exit "$status"
