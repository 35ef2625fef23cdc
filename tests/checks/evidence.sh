#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# What the project promises, and what stands behind it: writes tests/EVIDENCE.md from claims.txt and evidence.csv, and
# the figures in all other documents.
#   evidence.sh [--measure [ID...]] [--check] [--list]
#     (nothing)   writes EVIDENCE.md and the figures in the documents
#     --measure   first runs the commands of all claims, or of those named, and puts figure, date and commit into
#                 evidence.csv; a + behind the commit: with changes that are not in it
#     --check     fails when a document is not what would be written, when a claim has no figure or a figure no claim,
#                 and when a cheap claim (its command is `awk ...`, or it has a line `again`) would say another figure now
#     --list      the claims' names and commands
# In a document <!--ID-->FIGURE<!--/-->, on one line, takes the figure of claim ID, <!--ID.2--> its second part (parts are
# separated by "; "), <!--ID.2-4--> a range of parts.
# claims.txt: one block a claim, of lines "key text":
#   [ID]      name of the claim
#   claim     what is promised
#   goal      the bound; "-" where the figure itself is the promise
#   run       the command, from the project's folder; claims that share one are measured together
#   find      sed -n script that prints the figure from the command's output, its last line counts
#   short     only where the goal is not reached: why
#   again     only where every machine says the same within two seconds or so: --check runs it where its program is built
# A claim that reads a committed .csv, which its command names, has that file's last commit.
# Times depend on the machine; ratios and counts are what may be compared.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh
claims=tests/checks/claims.txt attacks=tests/checks/attacks.txt figures=tests/checks/evidence.csv page=${EVIDENCE_PAGE:-tests/EVIDENCE.md}

# Documents that may take figures, one a line.
documents() {
  if [[ -n ${EVIDENCE_DOCUMENT:-} ]]; then
    printf '%s\n' "$EVIDENCE_DOCUMENT"
  else
    find . \( -name build -o -name node_modules -o -name .git \) -prune -o -name '*.md' -print | sort
  fi
}

# "ID<tab>claim<tab>goal<tab>run<tab>find<tab>short<tab>again", one a line. An empty cell is "-", because read skips empty ones.
table() {
  awk -v OFS='\t' '
    function text() { sub(/^[a-z]+ +/, ""); return $0 }
    function put() {
      if (id == "") return
      if (claim == "" || goal == "" || run == "" || find == "") {
        print "claims.txt: [" id "] lacks a line" > "/dev/stderr"
        exit bad = 1
      }
      print id, claim, goal, run, find, short == "" ? "-" : short, again == "" ? "-" : again
    }
    /^#/ || /^$/ { next }
    /^\[/ { put(); id = substr($0, 2, length($0) - 2); claim = goal = run = find = short = again = ""; next }
    $1 == "claim" { claim = text() }
    $1 == "goal" { goal = text() }
    $1 == "run" { run = text() }
    $1 == "find" { find = text() }
    $1 == "short" { short = text() }
    $1 == "again" { again = text() }
    END { if (!bad) put(); exit bad }' "$claims"
}

# commit_of RUN: what a figure of this command is measured on.
commit_of() {
  local file
  file=$(grep -oE '[a-z_/]+\.csv' <<<"$1" || true)
  if [[ -n $file ]]; then
    printf '%s of %s' "$(git log -1 --format=%h -- "$file")" "${file##*/}"
  else
    git rev-parse --short HEAD | tr -d '\n'
    git diff --quiet HEAD -- . ':!*.md' ":!$figures" ":!$claims" || printf +
  fi
}

measure() {
  local -A wanted=()
  local id claim goal run find short again out log figure built status=0 all=$(($# == 0))
  # A figure is of the commit that it names: in a clone that was moved on, the programs are of another one.
  if [[ -x build/sim/bin/holdfast ]]; then
    built=$(build/sim/bin/holdfast --version)
    [[ $built == *"+g$(git rev-parse --short=7 HEAD)" ]] || {
      complain "build/sim is of ${built##*+g}, and this is $(git rev-parse --short=7 HEAD)" "a commit or a checkout since it was built" \
        "cmake --build --preset sim, then measure again"
      return 1
    }
  fi
  for id in "$@"; do wanted[$id]=1; done
  out=$(mktemp -d)
  while IFS=$'\t' read -r id claim goal run find short again; do
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
    if [[ $figure == *nan* ]]; then
      complain "[$id]: '$run' measured nothing: $figure" "the machine was too busy" "measure again"
      status=1
      continue
    fi
    if [[ -z $figure ]]; then
      complain "[$id]: no figure in the output of '$run'" "the command says it in other words now" "mend the line 'find'"
      status=1
      continue
    fi
    figure=${figure//,/;}
    touch "$figures"
    awk -F, -v id="$id" '$1 != id' "$figures" >"$out/kept"
    { [[ -s $out/kept ]] && cat "$out/kept"; printf '%s,%s,%s,%s\n' "$id" "$(date -u +%F)" "$(commit_of "$run")" "$figure"; } | sort >"$out/new"
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
[claims.txt](checks/claims.txt) and [evidence.csv](checks/evidence.csv); `--measure` runs the commands again. `commit` is the commit that was
measured (with +: and changes to it), or, of a figure that is read from a committed file, the commit that last changed that file. Times are of
one machine of two cores; ratios, counts and errors are what may be compared.

| promise | goal | measured | on | commit | by |
|---|---|---|---|---|---|
END
  local id claim goal run find short again row date commit figure
  while IFS=$'\t' read -r id claim goal run find short again; do
    row=$(awk -F, -v id="$id" '$1 == id' "$figures" 2>/dev/null || true)
    if [[ -z $row ]]; then
      complain "[$id] has no figure" "never measured" "tests/checks/evidence.sh --measure $id"
      return 1
    fi
    IFS=, read -r _ date commit figure <<<"$row"
    [[ $short == "-" ]] || figure="$figure. **Short**: $short"
    # shellcheck disable=SC2016  # backquotes of Markdown
    printf '| %s | %s | %s | %s | %s | `%s` |\n' "$claim" "$goal" "$figure" "$date" "$commit" "${run//|/\\|}"
  done < <(table)
  local orphan
  orphan=$(comm -13 <(table | cut -f1 | sort) <(cut -d, -f1 "$figures" | sort))
  [[ -z $orphan ]] || {
    complain "figures of no claim: $orphan" "a claim was renamed or went" "take the line out of $figures"
    return 1
  }
  render_attacks
}

# From attacks.txt; each of its tests has to be there.
render_attacks() {
  printf '\n## Attacks\n\n| attack | before | now | tests |\n|---|---|---|---|\n'
  local attack before now tests test
  while IFS='|' read -r attack before now tests; do
    [[ $attack != '#'* ]] || continue
    for test in $tests; do
      if [[ $test == */* ]]; then
        [[ -f tests/$test ]]
      else
        grep -rqF --include='*.cpp' "TEST(${test%.*}, ${test#*.})" tests
      fi || {
        complain "$attacks: no test $test" "it was renamed or went" "name the test that took its place"
        return 1
      }
    done
    # shellcheck disable=SC2016,SC2086  # backquotes of Markdown; words
    printf '|%s|%s|%s| %s|\n' " $attack" "$before" "$now" "$(printf '`%s` ' $tests)"
  done <"$attacks"
}

# fill FILE: the document with its figures put in.
fill() {
  awk -v file="$1" '
    FNR == NR { id = $0; sub(/,.*/, "", id); sub(/^[^,]*,[^,]*,[^,]*,/, ""); figure[id] = $0; next }
    {
      rest = $0
      out = ""
      while (match(rest, /<!--[a-z][a-z0-9_]*(\.[0-9]+(-[0-9]+)?)?-->/)) {
        name = substr(rest, RSTART + 4, RLENGTH - 7)
        out = out substr(rest, 1, RSTART + RLENGTH - 1)
        rest = substr(rest, RSTART + RLENGTH)
        end = index(rest, "<!--/-->")
        split(name, word, ".")
        count = word[1] in figure ? split(figure[word[1]], part, "; ") : 0
        last = split(word[2], range, "-")
        from = last == 0 ? 1 : range[1]
        to = last == 0 ? count : range[last]
        if (count == 0 || from < 1 || to > count || end == 0) {
          print "error: " file ": " name ": " (end == 0 ? "no <!--/--> behind it on its line" : "no such figure") \
            ". Likely cause: a typing error, or the claim says something else now. Next: compare with tests/checks/evidence.csv" > "/dev/stderr"
          exit 1
        }
        for (k = from; k <= to; ++k) out = out (k == from ? "" : "; ") part[k]
        rest = substr(rest, end)
      }
      print out rest
    }' "$figures" "$1"
}

# Every document with figures, and EVIDENCE.md, rewritten.
write() {
  local rendered document
  rendered=$(render) && printf '%s\n' "$rendered" >"$page" || return 1
  while read -r document; do
    rendered=$(fill "$document") || return 1
    cmp -s - "$document" <<<"$rendered" || printf '%s\n' "$rendered" >"$document"
  done < <(documents)
}

check() {
  local status=0 document id claim goal run find short again figure committed program
  diff <(render) "$page" || {
    complain "$page is not what claims and figures say (lines above)" "one of the three was changed alone" \
      "tests/checks/evidence.sh"
    status=1
  }
  while read -r document; do
    diff <(fill "$document") "$document" || {
      complain "$document has other figures than the evidence (lines above)" "one of the two was changed alone" \
        "tests/checks/evidence.sh"
      status=1
    }
  done < <(documents)
  local -A said=()
  while IFS=$'\t' read -r id claim goal run find short again; do
    [[ $run == "awk "* || $again != "-" ]] || continue
    program=$(grep -oE 'build/[a-z]+/bin/[a-z_]+' <<<"$run" | head -n 1 || true)
    [[ -z $program || -x $program ]] || continue
    [[ -n ${said[$run]:-} ]] || said[$run]=$(bash -c "$run" 2>&1 </dev/null || true)
    figure=$(sed -n "$find" <<<"${said[$run]}" | tail -n 1)
    committed=$(awk -F, -v id="$id" '$1 == id { sub(/^[^,]*,[^,]*,[^,]*,/, ""); print }' "$figures")
    [[ ${figure//,/;} == "$committed" ]] || {
      complain "[$id] is '$committed' in $figures and '$figure' now" "the code, or the file that it reads, has changed" \
        "tests/checks/evidence.sh --measure $id"
      status=1
    }
  done < <(table)
  return "$status"
}

case ${1:-} in
  --measure)
    shift
    status=0
    measure "$@" || status=1
    write || status=1
    exit "$status"
    ;;
  --check) check ;;
  --list) table | awk -F '\t' '{ print $1 ": " $4 }' ;;
  "") write ;;
  *) complain "unknown argument '$1'" "a typing error" "see the head of ${BASH_SOURCE[0]}" && exit 2 ;;
esac
