// SPDX-License-Identifier: Apache-2.0
// A program whose cost per frame is known, for the instruction counter's own test: `insn_selftest N` executes
// 1000 nops N times. The loop around them adds at most 10 instructions.
#include <stdlib.h>

int main(int argc, char** argv) {
  const long frames = argc > 1 ? strtol(argv[1], NULL, 10) : 0;
  for (long i = 0; i < frames; ++i) {
    __asm__ volatile(".rept 1000\n\tnop\n\t.endr");
  }
  return 0;
}
