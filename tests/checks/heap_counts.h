// SPDX-License-Identifier: Apache-2.0
// What the heap counter hands back: shared by the preloaded library (C) and the programs it watches (C++).
#ifndef HOLDFAST_TESTS_CHECKS_HEAP_COUNTS_H
#define HOLDFAST_TESTS_CHECKS_HEAP_COUNTS_H

struct HeapCounts {
  unsigned long allocations;  // calls that ask for memory, realloc included
  unsigned long releases;     // calls that give a block back
  void* first_caller;         // code address of the first call counted, or null
};

#endif
