#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# What the project promises, and what stands behind it: writes tests/EVIDENCE.md from claims.txt and evidence.csv.
#   evidence.sh [--measure [ID...]] [--check] [--list]
#     (nothing)   writes EVIDENCE.md
#     --measure   first runs the commands of all claims, or of those named, and puts figure and date into evidence.csv
#     --check     fails when EVIDENCE.md is not what would be written, when a claim has no figure or a figure no claim
#     --list      the claims' names and commands
# claims.txt: one block a claim, of lines "key text":
#   [ID]      name of the claim
#   claim     what is promised
#   goal      the bound; "-" where the figure itself is the promise
#   run       the command, from the project's folder; claims that share one are measured together
#   find      sed -n script that prints the figure from the command's output, its last line counts
#   short     only where the goal is not reached: why
# Times depend on the machine; ratios and counts are what may be compared.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh
claims=tests/checks/claims.txt figures=tests/checks/evidence.csv page=${EVIDENCE_PAGE:-tests/EVIDENCE.md}

# "ID<tab>claim<tab>goal<tab>run<tab>find<tab>short", one a line. An empty cell is "-", because read skips empty ones.
table() {
  awk -v OFS='\t' '
    function text() { sub(/^[a-z]+ +/, ""); return $0 }
    function put() {
      if (id == "") return
      if (claim == "" || goal == "" || run == "" || find == "") {
        print "claims.txt: [" id "] lacks a line" > "/dev/stderr"
        exit bad = 1
      }
      print id, claim, goal, run, find, short == "" ? "-" : short
    }
    /^#/ || /^$/ { next }
    /^\[/ { put(); id = substr($0, 2, length($0) - 2); claim = goal = run = find = short = ""; next }
    $1 == "claim" { claim = text() }
    $1 == "goal" { goal = text() }
    $1 == "run" { run = text() }
    $1 == "find" { find = text() }
    $1 == "short" { short = text() }
    END { if (!bad) put(); exit bad }' "$claims"
}

measure() {
  local -A wanted=()
  local id claim goal run find short out log figure status=0 all=$(($# == 0))
  for id in "$@"; do wanted[$id]=1; done
  out=$(mktemp -d)
  while IFS=$'\t' read -r id claim goal run find short; do
    ((all == 1)) || [[ -n ${wanted[$id]:-} ]] || continue
    unset "wanted[$id]"
    log=$out/$(cksum <<<"$run" | cut -d' ' -f1)
    if [[ ! -f $log ]]; then
      say "measuring: $run"
      bash -c "$run" >"$log" 2>&1 </dev/null || {
        complain "'$run' failed, so [$id] has no figure" "a broken promise, or something is not built" "$(tail -n 1 "$log")"
        status=1
        : >"$log"
        continue
      }
    fi
    figure=$(sed -n "$find" "$log" | tail -n 1)
    if [[ -z $figure ]]; then
      complain "[$id]: no figure in the output of '$run'" "the command says it in other words now" "mend the line 'find'"
      status=1
      continue
    fi
    figure=${figure//,/;}
    touch "$figures"
    awk -F, -v id="$id" '$1 != id' "$figures" >"$out/kept"
    { [[ -s $out/kept ]] && cat "$out/kept"; printf '%s,%s,%s\n' "$id" "$(date -u +%F)" "$figure"; } | sort >"$out/new"
    cp "$out/new" "$figures"
    say "$id: $figure"
  done < <(table)
  rm -rf "$out"
  for id in "${!wanted[@]}"; do
    complain "no claim '$id'" "a typing error" "see --list"
    status=1
  done
  return "$status"
}

render() {
  cat <<'END'
# Evidence

What README and the design promise, the command that measures it, and what it said. Written by `tests/checks/evidence.sh` from
[claims.txt](checks/claims.txt) and [evidence.csv](checks/evidence.csv); `--measure` runs the commands again. Times are of one machine of two
cores; ratios, counts and errors are what may be compared.

| promise | goal | measured | on | by |
|---|---|---|---|---|
END
  local id claim goal run find short row date figure
  while IFS=$'\t' read -r id claim goal run find short; do
    row=$(awk -F, -v id="$id" '$1 == id' "$figures" 2>/dev/null || true)
    if [[ -z $row ]]; then
      complain "[$id] has no figure" "never measured" "tests/checks/evidence.sh --measure $id"
      return 1
    fi
    IFS=, read -r _ date figure <<<"$row"
    [[ $short == "-" ]] || figure="$figure. **Short**: $short"
    # shellcheck disable=SC2016  # backquotes of Markdown
    printf '| %s | %s | %s | %s | `%s` |\n' "$claim" "$goal" "$figure" "$date" "${run//|/\\|}"
  done < <(table)
  local orphan
  orphan=$(comm -13 <(table | cut -f1 | sort) <(cut -d, -f1 "$figures" | sort))
  [[ -z $orphan ]] || {
    complain "figures of no claim: $orphan" "a claim was renamed or went" "take the line out of $figures"
    return 1
  }
}

case ${1:-} in
  --measure)
    shift
    status=0
    measure "$@" || status=1
    rendered=$(render) && printf '%s\n' "$rendered" >"$page" || status=1
    exit "$status"
    ;;
  --check)
    diff <(render) "$page" || {
      complain "$page is not what claims and figures say (lines above)" "one of the three was changed alone" \
        "tests/checks/evidence.sh"
      exit 1
    }
    ;;
  --list) table | awk -F '\t' '{ print $1 ": " $4 }' ;;
  "") rendered=$(render) && printf '%s\n' "$rendered" >"$page" ;;
  *) complain "unknown argument '$1'" "a typing error" "see the head of ${BASH_SOURCE[0]}" && exit 2 ;;
esac
