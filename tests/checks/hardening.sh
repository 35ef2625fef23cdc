#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Is an aarch64 binary built as something that stands in a network's way should be?
#   tests/checks/hardening.sh READELF OBJDUMP BINARY
# Position independent, relocations read-only and bound at start, no executable stack and nothing writable that is
# executable, stack protector, checked string functions, signed return addresses, and no path of the building machine.
set -euo pipefail
(($# == 3)) || { echo "usage: hardening.sh READELF OBJDUMP BINARY" >&2 && exit 2; }
readelf=$1 objdump=$2 binary=$3
wrong=0
# expect WHAT PATTERN TEXT; refuse WHAT PATTERN TEXT
expect() { grep -qE -- "$2" <<<"$3" || { echo "error: $(basename "$binary") has no $1. Next: look at the flags in toolchain/" >&2 && wrong=1; }; }
refuse() { ! grep -qE -- "$2" <<<"$3" || { echo "error: $(basename "$binary") has $1. Next: look at the flags in toolchain/" >&2 && wrong=1; }; }

header=$("$readelf" -hW "$binary")
segments=$("$readelf" -lW "$binary")
dynamic=$("$readelf" -dW "$binary")
symbols=$("$readelf" --dyn-syms -W "$binary")
code=$("$objdump" -d --no-show-raw-insn "$binary" | grep -cE '\b(paciasp|bti)\b' || true)
expect "position independence (PIE)" 'Type: +DYN' "$header"
expect "read-only relocations (RELRO)" 'GNU_RELRO' "$segments"
expect "binding at start (full RELRO)" 'BIND_NOW|FLAGS.*NOW' "$dynamic"
expect "stack of its own rights" 'GNU_STACK' "$segments"
refuse "an executable stack" 'GNU_STACK.*RWE' "$segments"
refuse "a segment that is writable and executable" 'LOAD.*RWE' "$segments"
expect "stack protector" '__stack_chk_fail' "$symbols"
expect "checked string functions (FORTIFY)" '__[a-z]+_chk(@|$| )' "$symbols"
refuse "a search path of the building machine" 'R(UN)?PATH' "$dynamic"
((code > 100)) || { echo "error: $(basename "$binary") signs no return addresses ($code found). Next: -mbranch-protection" >&2 && wrong=1; }
((wrong == 0)) || exit 1
echo "$(basename "$binary"): PIE, full RELRO, stack protector, FORTIFY, $code signed returns and landing pads"
