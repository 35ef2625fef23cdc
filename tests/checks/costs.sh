#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# What the firmware costs on the Raspberry Pi 4, as lines "name value" for baseline.sh:
#   costs.sh [BUILD_DIR]      default build/rpi4, built and tested
# stack.*         bytes of the largest function and of the deepest chain of calls, from gcc's own call graph (-fcallgraph-info),
#                 and how many functions recurse or take a size that only the run knows: none. Calls through a pointer
#                 (the HAL, the JPEG decoder behind its seam) end a chain; so do calls into libraries
# code.*, data.*  bytes of code and constants in each folder of firmware/, and of static data in all of them: variables, and
#                 tables that hold addresses
# memory.*        bytes of the objects that hold all the firmware remembers (memory_sizes.cpp)
# instructions.*  of a frame, by count_instructions.sh; like memory.* from BUILD_DIR/measured, where the tests leave them
# The largest functions and the deepest chain are told on stderr.
set -euo pipefail
build=${1:-build/rpi4}
objects=$build/firmware/CMakeFiles/holdfast_firmware.dir

mapfile -t graphs < <(find "$objects" -name '*.ci' | sort)
if ((${#graphs[@]} == 0)); then
  echo "error: no call graph under $objects (not built for rpi4 by gcc). Next: cmake --build --preset rpi4" >&2
  exit 1
fi
awk -F '"' '
  function plain(label) { sub(/\\n.*/, "", label); gsub(/holdfast::/, "", label); return substr(label, 1, 110) }
  # Of the chain that begins there. A function that is met again on its own chain recurses.
  function deepest(f,    i, below, best, parts) {
    if (f in known) return known[f]
    if (f in open) { recursive[f] = 1; return 0 }
    open[f] = 1
    best = 0
    for (i = 1; i <= calls[f]; ++i) {
      below = deepest(callee[f, i])
      if (below > best) { best = below; next_of[f] = callee[f, i] }
    }
    delete open[f]
    return known[f] = bytes[f] + best
  }
  /^node:/ && match($4, /[0-9]+ bytes \([a-z,]*\)/) {
    split(substr($4, RSTART, RLENGTH), words, " ")
    if (!($2 in bytes) || words[1] + 0 > bytes[$2]) bytes[$2] = words[1] + 0
    if (words[3] ~ /dynamic/) unbounded[$2] = 1
    name[$2] = plain($4)
  }
  /^edge:/ { callee[$2, ++calls[$2]] = $4 }
  END {
    for (f in bytes) {
      if (bytes[f] > bytes[largest]) largest = f
      if (deepest(f) > known[start]) start = f
      print bytes[f], name[f] | "sort -rn | head -n 10 >&2"
    }
    for (f in recursive) { ++cycles; print "recursive: " name[f] > "/dev/stderr" }
    for (f in unbounded) { ++dynamic; print "of unknown size: " name[f] > "/dev/stderr" }
    print "stack.largest_function_bytes", bytes[largest]
    print "stack.deepest_chain_bytes", known[start]
    print "stack.recursive_functions", cycles + 0
    print "stack.unbounded_functions", dynamic + 0
    close("sort -rn | head -n 10 >&2")
    print "the deepest chain:" > "/dev/stderr"
    for (f = start; f != ""; f = next_of[f]) print bytes[f] + 0, name[f] > "/dev/stderr"
  }' "${graphs[@]}"

find "$objects" -name '*.o' -exec aarch64-linux-gnu-size {} + | awk -v start="$objects/" '
  NR > 1 && $6 != "(TOTALS)" {
    folder = substr($6, length(start) + 1); sub(/\/.*/, "", folder)
    code[folder] += $1; data += $2 + $3
  }
  END {
    for (folder in code) print "code." folder "_bytes", code[folder]
    print "data.static_bytes", data
  }'

cat "$build"/measured/*
