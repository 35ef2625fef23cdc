#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# MCAP files that the tool writes, read by the official reader (check_mcap.mjs): every message decoded by the schema in
# the file, pictures held against those that went in, and counts and times against what the tool says of the same file.
#   tests/npm/check_logs.sh [BUILD_DIR]      default build/sim, built
# Exit status 0: right, 77: skipped, anything else: wrong, with a line that says what.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh

build=${1:-build/sim}
tool=$build/bin/holdfast
[[ -x $tool ]] || {
  complain "no $tool" "not built" "cmake --preset sim && cmake --build --preset sim --target holdfast"
  exit 1
}
if ! command -v node >/dev/null; then
  say "SKIPPED: no node. Next: install nodejs and npm, then npm ci in tests/npm"
  exit 77
elif [[ ! -d tests/npm/node_modules/@mcap/core ]]; then
  say "SKIPPED: no tests/npm/node_modules. Next: npm ci in tests/npm"
  exit 77
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# said FILE: what our reader says of it, in the words of the official one's summary.
said() {
  "$tool" log info "$1" --json | node -e '
    const said = JSON.parse(require("node:fs").readFileSync(0, "utf8"));
    const line = (o) => [o.messages, o.first_ns, o.last_ns].join(" ");
    console.log([said.profile, said.library, said.bytes, said.chunks, line(said)].join(" "));
    for (const c of said.channels.sort((a, b) => (a.topic < b.topic ? -1 : 1))) {
      if (c.messages > 0) console.log(c.topic, c.schema, line(c));
    }'
}
# official FILE [PICTURES]: the same by the official reader.
official() {
  node tests/npm/check_mcap.mjs "$@" | tee "$work/official.json" | node -e '
    const read = JSON.parse(require("node:fs").readFileSync(0, "utf8"));
    const line = (o) => [o.messages, o.first_ns, o.last_ns].join(" ");
    console.log([read.profile, read.library, read.bytes, read.chunks, line(read)].join(" "));
    for (const [topic, c] of Object.entries(read.channels)) console.log(topic, c.schema, line(c));'
}
# agreed NAME FILE [PICTURES]
agreed() {
  local name=$1
  shift
  official "$@" >"$work/official"
  said "$1" >"$work/said"
  diff "$work/said" "$work/official" >&2 || {
    complain "$name: our reader and the official one disagree" "one of them reads the file wrongly" "see the lines above"
    exit 1
  }
  # shellcheck disable=SC2016  # a template of JavaScript
  say "$name: $(node -p 'const o = JSON.parse(require("node:fs").readFileSync(process.argv[1], "utf8"));
    `${o.messages} messages in ${o.chunks} chunks, ${o.pictures} pictures`' "$work/official.json")"
}
# field EXPRESSION: of the official reader's summary `o`.
field() {
  node -p "const o = JSON.parse(require('node:fs').readFileSync('$work/official.json', 'utf8')); $1"
}
# equal WHAT OURS THEIRS
equal() {
  [[ $2 == "$3" ]] || {
    complain "$1: $2 by the tool, $3 by the official reader" "our writer" "look at the file with holdfast log info"
    exit 1
  }
}

# A recording: all pictures, byte for byte.
summary=$("$tool" replay tests/data/slip.mjpg --json --mcap "$work/replay.mcap")
agreed "recording" "$work/replay.mcap" tests/data/slip.mjpg
equal "frames accepted" "$(node -p "($summary).accepted")" "$(field 'o.channels["/holdfast/slip"].accepted')"
equal "markers" "$(node -p "($summary).accepted * 63")" "$(field 'o.channels["/holdfast/markers"].markers')"

# A grasp as 8-megapixel JPEG, which slips, in many chunks.
summary=$("$tool" sim tests/scenes/sphere_slip.json --inject jpeg --json --mcap "$work/sim.mcap" --features "$work/f.csv")
"$tool" log export "$work/sim.mcap" --mjpg "$work/sim.mjpg" >/dev/null
agreed "simulated grasp" "$work/sim.mcap" "$work/sim.mjpg"
equal "frames with slip" "$(awk -F, 'NR > 1 && $10 == 1' "$work/f.csv" | wc -l)" \
  "$(field 'o.channels["/holdfast/slip"].slips')"
equal "states" "$(awk -F, 'NR > 1 && !seen[$3]++ { print $3 }' "$work/f.csv" | sort | paste -sd,)" \
  "$(field 'Object.keys(o.channels["/holdfast/slip"].states).sort().join(",")')"

# Without pictures, and with pictures that are encoded, of which some are refused.
"$tool" sim tests/scenes/empty_gel.json --inject markers --json --mcap "$work/none.mcap" >/dev/null 2>&1
agreed "grasp without pictures" "$work/none.mcap"
equal "pictures" 0 "$(field o.pictures)"
summary=$("$tool" sim tests/scenes/fault_garbage.json --json --mcap "$work/grey.mcap" --log "$work/grey.csv" 2>/dev/null)
agreed "grasp with grey pictures" "$work/grey.mcap"
equal "pictures" "$(node -p "($summary).frames")" "$(field o.pictures)"
node tests/npm/check_layouts.mjs "$work/grey.mcap" "$work/grey.csv"

# A file that was changed is refused.
cp "$work/replay.mcap" "$work/changed.mcap"
printf '\125' | dd of="$work/changed.mcap" bs=1 seek=100000 conv=notrunc status=none
if node tests/npm/check_mcap.mjs "$work/changed.mcap" >/dev/null 2>&1; then
  complain "the official reader takes a file that was changed" "check sums are not checked" "see tests/npm/check_mcap.mjs"
  exit 1
fi
say "logs: the official reader agrees"
