#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# How long a frame takes on a Raspberry Pi 4 and 5 that are not here: an estimate, and what the same method says of this
# machine beside what a clock says.
#   tests/bench/board_time.sh > toolchain/trade/board_time.csv
# 1. QEMU runs the shipped code, and blocks.c counts how often each block of instructions ran and where it went on.
# 2. Blocks that follow each other most of the time are put together to traces: a loop's body is one. llvm-mca says how
#    many cycles a trace takes when it runs again and again, on the model of the core that LLVM has: caches always hit,
#    branches are always foreseen.
# 3. Mispredicted branches (predictor of blocks.c) are added with their penalty.
# 4. high_ms also has the memory's part: JPEG and working memory read and written once, at what the board copies.
# Both ends are wider by the error that the method has here with the same program, and by 20 % at least: what LLVM knows
# of the boards' cores are models of their relatives. It takes too long for libjpeg-turbo's inverse transform, a straight
# line of 200 vector instructions whose runs the processor overlaps and a trace does not.
# Needs the presets sim and rpi4 (targets setting_cost, jpeg_cost), and the packages of the groups cross and bench; about
# seven minutes. As root, times are taken with a real-time priority.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh
for program in build/{sim,rpi4}/bin/{setting_cost,jpeg_cost}; do
  [[ -x $program ]] || { complain "no $program" "not built" "cmake --build --preset sim --target programs, and preset rpi4" && exit 2; }
done
for program in qemu-aarch64 qemu-x86_64 llvm-mca-19 llvm-mc-19 gcc; do
  command -v "$program" >/dev/null || { complain "no $program" "not installed" "source toolchain/packages.sh; ensure_packages cross bench" && exit 2; }
done
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
gcc -O2 -shared -fPIC -o "$work/blocks.so" tests/bench/blocks.c
film=$work/film.mjpg
build/sim/bin/setting_cost "$film"

# blocks OUT COMMAND...
blocks() {
  local out=$1
  shift
  setarch -R "$1" "${@:2:2}" -plugin "$work/blocks.so,out=$out" "${@:4}" >"$work/log" 2>&1 ||
    { cat "$work/log" >&2 && complain "'$*' failed" "see above" "run it by itself" && return 1; }
}

# traces FEW MANY: of what MANY ran beyond FEW. A file trace.N for each with its bytes; "N INSTRUCTIONS" lines on stdout,
# with all that traces cover counted to them; then "all INSTRUCTIONS MISPREDICTED".
traces() {
  rm -f "$work"/trace.*
  awk -v work="$work" '
    $1 == "mispredicted" { missed = $2 - missed; next }
    FNR == NR { count[$1] = -$2; next }
    {
      count[$1] += $2
      i = index($0, ">")
      code[$1] = substr($0, length($1 $2) + 3, i - length($1 $2) - 4)
      size[$1] = split(code[$1], words, " ")
      split(substr($0, i + 2), to, " ")
      next_of[$1] = to[1]
      share[$1] = $2 > 0 ? to[2] / $2 : 0
    }
    END {
      for (b in code) if (count[b] > 0) { all += count[b] * size[b]; printf "%.0f %s\n", count[b] * size[b], b > (work "/sorted") }
      close(work "/sorted")
      while (covered < 0.98 * all && (("sort -rn " work "/sorted") | getline line) > 0) {
        split(line, field, " ")
        first = field[2]
        if (first in used) continue
        ++n
        weight = length_now = 0
        for (b = first; (b in code) && !(b in used) && length_now < 600 && 4 * count[b] >= count[first]; b = next_of[b]) {
          used[b] = 1
          weight += count[b] * size[b]
          length_now += size[b]
          print code[b] > (work "/trace." n)
          if (share[b] < 0.5) break
        }
        close(work "/trace." n)
        covered += weight
        printf "%d %.0f\n", n, weight
      }
      printf "all %.0f %.0f\n", all, missed
    }' "$1" "$2"
}

# cycles TRIPLE CPU: of what `traces` said on stdin; "INSTRUCTIONS CYCLES MISPREDICTED".
cycles() {
  local n weight missed
  while read -r n weight missed; do
    if [[ $n == all ]]; then
      echo "all $weight $missed"
      continue
    fi
    tr ' ' '\n' <"$work/trace.$n" | sed -n '/./{s/../0x& /g;p}' >"$work/bytes"
    llvm-mc-19 -disassemble -triple="$1" -mcpu="$2" <"$work/bytes" 2>/dev/null |
      sed -E '/^\t(call|ret|bl|blr|rep)/d' >"$work/code.s" || true  # llvm-mca takes each of them for 100 cycles
    { llvm-mca-19 -mtriple="$1" -mcpu="$2" -iterations=100 -skip-unsupported-instructions=any "$work/code.s" 2>/dev/null || true; } |
      awk -v weight="$weight" '/^Instructions:/ { i = $2 } /^Total Cycles:/ { c = $3 } END { print weight, (i > 0 ? c / i : 0) }'
  done | awk '
    $1 == "all" { all = $2; missed = $3; next }
    $2 > 0 { known += $1; sum += $1 * $2 }
    END { printf "%.0f %.0f %.0f\n", all, sum * all / known, missed }'
}

# GHz of this core: a chain of multiplications takes three cycles each. Not additions of a constant, of which new cores
# make several at once.
ghz() {
  gcc -O1 -x c -o "$work/chain" - <<'END'
#include <stdio.h>
#include <time.h>
int main(void) {
  unsigned long a = 3, b = 5;
  const clock_t start = clock();
  for (long i = 0; i < 100000000; ++i)
    __asm__ volatile("imul %1, %0\n imul %1, %0\n imul %1, %0\n imul %1, %0" : "+r"(a) : "r"(b));
  printf("%.3f\n", 1.2 / ((double)(clock() - start) / CLOCKS_PER_SEC));
}
END
  "${real_time[@]}" "$work/chain"
}
real_time=()
chrt -f 1 true 2>/dev/null && real_time=(chrt -f 1)
here_ghz=$(ghz)
# Misprediction in cycles, from the vendors' optimisation guides and measurements of others: A72 15, A76 11, Zen 4 13.
here_penalty=13

# measured PROGRAM ARGUMENT...: median of 11 runs, microseconds.
measured() {
  for _ in {1..11}; do "${real_time[@]}" "$@" | awk '/ us each$/ { print $(NF - 2) }'; done | sort -n | sed -n 6p
}
run() {
  local preset=$1 program=$2
  shift 2
  local few=10 many=14
  [[ $program != jpeg_cost ]] || few=1 many=3
  local -a qemu=(qemu-x86_64 -cpu max)
  [[ $preset == sim ]] || qemu=(qemu-aarch64 -L build/sysroot-aarch64)
  blocks "$work/few" "${qemu[@]}" "build/$preset/bin/$program" "$@" "$few"
  blocks "$work/many" "${qemu[@]}" "build/$preset/bin/$program" "$@" "$many"
  runs=$((many - few))
  traces "$work/few" "$work/many" >"$work/traces"
}

echo "what,machine,GHz,million instructions,cycles an instruction,thousand mispredicted,estimate ms,low ms,high ms,measured ms,error %"
programs=("setting_cost|$film|mode=fast|decision; fast" "setting_cost|$film|mode=1|decision; balanced" "setting_cost|$film|mode=2|decision; precise"
  "jpeg_cost|scene|library|JPEG; libjpeg-turbo 1/8" "jpeg_cost|scene|plain|JPEG; plain walk" "jpeg_cost|scene|1|JPEG; 1 lane"
  "jpeg_cost|scene|2|JPEG; 2 lanes" "jpeg_cost|scene|3|JPEG; 3 lanes")
declare -A error=()
for line in "${programs[@]}"; do
  IFS='|' read -r program input setting name <<<"$line"
  say "$name, here" >&2
  run sim "$program" "$input" "$setting"
  read -r all sum missed < <(cycles x86_64-linux-gnu "$(llvm-mca-19 --version | sed -n 's/.*Host CPU: //p')" <"$work/traces")
  count=14
  [[ $program != jpeg_cost ]] || count=40
  us=$(measured "build/sim/bin/$program" "$input" "$setting" "$count")
  row=$(awk -v n="$name" -v all="$all" -v sum="$sum" -v missed="$missed" -v runs="$runs" -v ghz="$here_ghz" -v penalty="$here_penalty" -v us="$us" 'BEGIN {
    ms = (sum + penalty * missed) / runs / ghz / 1e6
    printf "%s,here,%s,%.2f,%.3f,%.1f,%.3f,,,%.3f,%.0f\n", n, ghz, all / runs / 1e6, sum / all, missed / runs / 1e3, ms, us / 1e3, 100 * (ms * 1e3 / us - 1)
  }')
  echo "$row"
  error[$name]=${row##*,}
done
for line in "${programs[@]}"; do
  IFS='|' read -r program input setting name <<<"$line"
  say "$name, boards" >&2
  run rpi4 "$program" "$input" "$setting"
  # Board, LLVM's model, GHz, penalty, GB/s of memory copied (published measurements: assumed, not measured here).
  # LLVM 19 gives an A72 the model of A57, its predecessor; it has none of A76, whose server form is Neoverse N1.
  while read -r board model ghz penalty copy; do
    read -r all sum missed < <(cycles aarch64-linux-gnu "$model" <"$work/traces")
    awk -v n="$name" -v board="$board" -v all="$all" -v sum="$sum" -v missed="$missed" -v runs="$runs" -v ghz="$ghz" -v penalty="$penalty" \
      -v copy="$copy" -v error="${error[$name]#-}" 'BEGIN {
      ms = (sum + penalty * missed) / runs / ghz / 1e6
      wide = (error > 20 ? error : 20) / 100
      memory = 4 / copy  # MB / (GB/s): 0.6 of JPEG, 3.4 at most of working memory (trade.csv)
      printf "%s,%s,%s,%.2f,%.3f,%.1f,%.2f,%.2f,%.2f,,\n", n, board, ghz, all / runs / 1e6, sum / all, missed / runs / 1e3, ms,
        ms * (1 - wide), (ms + memory) * (1 + wide)
    }'
  done <<'END'
Pi_4 cortex-a72 1.5 15 2.5
Pi_4 cortex-a72 1.8 15 2.5
Pi_5 neoverse-n1 2.4 11 5.5
END
done
