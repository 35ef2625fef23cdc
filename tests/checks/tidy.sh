#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# clang-tidy over every source of ours that the sim board compiles, as .clang-tidy says; any finding is an error.
#   tests/checks/tidy.sh [--some]      configures build/tidy, where each source has a command of its own
# All of it takes 21 minutes of two cores on a fresh clone. --some, for a run that has to end sooner, looks at the 50 files
# that changed last, within twenty commits (a header by one source that includes it), and at a sixteenth of the rest, drawn
# by the newest commit's name: so every source is looked at again within some tens of commits, without a record of who was when.
# Compiler warnings are gcc's business (they are errors there), so clang's own are off.
# A file that passed is not looked at again until it, a header of ours that it includes, its compile command, the
# tool or a .clang-tidy changes: each pass leaves a stamp named by the hash of all these in HOLDFAST_TIDY_STAMPS, a folder
# that clones may share, or in BUILD_DIR/tidy.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=tests/checks/sources.sh
source tests/checks/sources.sh
# shellcheck source=toolchain/say.sh
source toolchain/say.sh

root=$PWD some=0
if [[ ${1:-} == --some ]]; then
  some=1
  shift
fi
build=build/tidy
quietly "$build.log" cmake --preset sim -B "$build" -DHOLDFAST_UNITY=OFF || exit 1
quietly "$build.log" cmake --build "$build" --target generated_headers || exit 1
tool=$(command -v clang-tidy-14 || command -v clang-tidy) || {
  complain "no clang-tidy" "not installed" "apt-get install clang-tidy, or run tests/run.sh --only packages"
  exit 1
}
stamps=${HOLDFAST_TIDY_STAMPS:-$build/stamps}
mkdir -p "$stamps"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# CMake writes one key a line. A file that is compiled twice is checked with its first command.
awk -v root="$root/" '
  { key = $1; value = $0; sub(/^ *"[a-z]*": "/, "", value); sub(/",?$/, "", value) }
  key == "\"command\":" { command = value }
  key == "\"file\":" {
    if (index(value, root) == 1 && !seen[value]++) print substr(value, length(root) + 1) "\t" command
  }' "$build/compile_commands.json" | sort >"$work/commands"
rules=$({ "$tool" --version; find . -name .clang-tidy -not -path './build/*' -exec cat {} +; } | sha256sum)

# chosen: the sources to look at.
if ((some)); then
  git log -n 20 --no-merges --name-only --format= -- . | grep -E '\.[ch]pp$' | awk '!seen[$0]++' |
    sed -n 1,50p >"$work/changed"
  # A changed header stands for the first source that includes it, by its path from the top or from firmware/.
  while read -r file; do
    if [[ $file == *.cpp ]]; then
      [[ ! -f $file ]] || echo "$file"
    else
      git grep -l -F "#include \"${file#firmware/}\"" -- '*.cpp' | sed -n 1p || true
    fi
  done <"$work/changed" >"$work/some"
  commit=$(git rev-parse HEAD)
  our_sources '*.cpp' | while read -r file; do
    share=$(sha256sum <<<"$commit $file")
    ((0x${share:0:4} % 16 != 0)) || echo "$file"
  done >>"$work/some"
  sort -u "$work/some" >"$work/chosen"
else
  our_sources '*.cpp' >"$work/chosen"
fi

# keyed FILE: FILE and the hash of all that a finding could come from, or "none".
# shellcheck disable=SC2317
keyed() {
  local command own made_of key=none
  command=$(awk -F '\t' -v file="$1" '$1 == file { print $2; exit }' "$work/commands")
  [[ -n $command ]] || return 0
  own="${command%% -o *} -MM -MT x ${command##* -c }"
  if made_of=$(cd "$build" && eval "$own" | tr -d "\\\\" | tr -s ' ' '\n' | grep "^$root/"); then
    key=$({ echo "$rules ${command//$root/.}" && xargs -d '\n' cat <<<"$made_of"; } 2>/dev/null | sha256sum | cut -d ' ' -f 1) || key=none
  fi
  printf '%s\t%s\n' "$1" "$key"
}
export -f keyed
export root rules build work
xargs -d '\n' -n 1 -P "$(nproc)" bash -c 'keyed "$@"' keyed <"$work/chosen" | sort >"$work/files"

total=0 known=0
while IFS=$'\t' read -r file key; do
  total=$((total + 1))
  if [[ $key != none && -e $stamps/$key ]]; then
    known=$((known + 1))
  else
    printf '%s\n%s\n' "$file" "$key"
  fi
done <"$work/files" >"$work/todo"

# check FILE KEY: one file; its findings only when there are any. Run by xargs below.
# shellcheck disable=SC2317
check() {
  local log=$work/log.$$
  if "$tool" -p "$build" --quiet --warnings-as-errors='*' --extra-arg=-Wno-everything "$1" \
    >"$log" 2>&1; then
    [[ $2 == none ]] || : >"$stamps/$2"
  else
    grep -vE '^[0-9]+ warnings? (generated|treated as error)' "$log" || true
    return 1
  fi
}
export -f check
export tool stamps

status=0
if [[ -s $work/todo ]]; then
  xargs -d '\n' -n 2 -P "$(nproc)" bash -c 'check "$@"' check <"$work/todo" || status=1
fi
left_out=$(comm -23 "$work/chosen" <(cut -f 1 "$work/files" | sort) | tr '\n' ' ')
[[ -z $left_out ]] || echo "tidy: not compiled for this board, so not checked: $left_out"
((some == 0)) || echo "tidy: left to other commits: $(comm -23 <(our_sources '*.cpp') "$work/chosen" | wc -l) files (tests/checks/tidy.sh looks at all)"
echo "tidy: $total files, $known of them unchanged since they passed$( ((status == 0)) || echo ', findings above')"
exit "$status"
