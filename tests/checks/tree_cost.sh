#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Instructions that one verdict costs in each form of the committed tree (tests/bench/tree_bench.cpp), counted by callgrind:
#   tree_cost.sh VALGRIND TREE_BENCH FORM
# runs every form with 1000 and 11000 calls; the difference over 10000 is the cost of a call. What the loop, the call and
# the return cost (form "empty") is taken off the others.
# Fails when FORM costs more than 0.75 of emlearn's inline shape.
set -euo pipefail
if (($# != 3)); then
  echo "usage: tree_cost.sh VALGRIND TREE_BENCH FORM" >&2
  exit 2
fi
valgrind=$1 program=$2 judged=$3
few=1000 many=11000

# count FORM N: instructions of the whole program.
count() {
  local output
  if ! output=$("$valgrind" --tool=callgrind --callgrind-out-file=/dev/null "$program" "$@" 2>&1) ||
    ! sed -n 's/^==[0-9]*== Collected : \([0-9]\{1,\}\)$/\1/p' <<<"$output" | grep .; then
    echo "$output" >&2
    echo "error: no count for '$program $*' (a program error, or a valgrind without callgrind). Next: see above" >&2
    return 1
  fi
}

declare -A cost=()
for form in header emlearn empty; do
  short=$(count "$form" "$few")
  long=$(count "$form" "$many")
  cost[$form]=$(((long - short) * 10 / (many - few)))  # tenths
done
line="slip_tree:"
for form in header emlearn; do
  cost[$form]=$((cost[$form] - cost[empty]))
  line+=" $form $((cost[$form] / 10)).$((cost[$form] % 10))"
done
((cost[$judged] > 0 && cost[emlearn] > 0)) || { echo "$line: a form that costs nothing" >&2; exit 1; }
percent=$((cost[$judged] * 100 / cost[emlearn]))
echo "$line instructions (taken off: $((cost[empty] / 10)).$((cost[empty] % 10))); $judged is $((percent / 100)).$(printf %02d $((percent % 100))) of emlearn's shape (limit 0.75)"
((cost[$judged] * 100 <= cost[emlearn] * 75))
