// SPDX-License-Identifier: Apache-2.0
// Counts heap calls between two marks, in every thread and from every library of the process.
//
// Preloaded (LD_PRELOAD), because only then the calls from inside shared libraries are seen: libstdc++'s
// operator new, libc's own fopen, a JPEG library. Linking with --wrap sees only the calls of the objects
// being linked. Counted: malloc, calloc, realloc, free of a block, posix_memalign, aligned_alloc, memalign,
// valloc, pvalloc; reallocarray and operator new come in through these. free(NULL) is not counted: it touches
// no heap. Not counted: memory from the kernel without the heap (mmap, brk, thread stacks). The work itself
// is done by glibc's own entry points (__libc_*), so nothing here needs dlsym, which may allocate. The
// program finds the marks with dlsym: see heap_marks.hpp. With AddressSanitizer, which brings a heap of its
// own, this library must not be used.
#include <errno.h>
#include <stdatomic.h>
#include <stddef.h>

#include "heap_counts.h"

void* __libc_malloc(size_t size);
void* __libc_calloc(size_t count, size_t size);
void* __libc_realloc(void* block, size_t size);
void __libc_free(void* block);
void* __libc_memalign(size_t alignment, size_t size);
void* __libc_valloc(size_t size);
void* __libc_pvalloc(size_t size);

static atomic_bool counting;
static atomic_ulong allocations;
static atomic_ulong releases;
static _Atomic(void*) first_caller;

static void count(atomic_ulong* which, void* caller) {
  if (!atomic_load_explicit(&counting, memory_order_relaxed)) return;
  void* none = NULL;
  atomic_compare_exchange_strong(&first_caller, &none, caller);
  atomic_fetch_add(which, 1);
}

#define COUNT(which) count(&(which), __builtin_return_address(0))

void holdfast_heap_begin(void) {
  atomic_store(&allocations, 0);
  atomic_store(&releases, 0);
  atomic_store(&first_caller, NULL);
  atomic_store(&counting, 1);
}

struct HeapCounts holdfast_heap_end(void) {
  atomic_store(&counting, 0);
  struct HeapCounts counts = {atomic_load(&allocations), atomic_load(&releases), atomic_load(&first_caller)};
  return counts;
}

void* malloc(size_t size) {
  COUNT(allocations);
  return __libc_malloc(size);
}

void* calloc(size_t number, size_t size) {
  COUNT(allocations);
  return __libc_calloc(number, size);
}

void* realloc(void* block, size_t size) {
  COUNT(allocations);
  return __libc_realloc(block, size);
}

void free(void* block) {
  if (block != NULL) COUNT(releases);
  __libc_free(block);
}

void* memalign(size_t alignment, size_t size) {
  COUNT(allocations);
  return __libc_memalign(alignment, size);
}

void* aligned_alloc(size_t alignment, size_t size) {
  COUNT(allocations);
  return __libc_memalign(alignment, size);
}

int posix_memalign(void** block, size_t alignment, size_t size) {
  COUNT(allocations);
  if (alignment % sizeof(void*) != 0 || alignment == 0 || (alignment & (alignment - 1)) != 0) return EINVAL;
  void* fresh = __libc_memalign(alignment, size);
  if (fresh == NULL) return ENOMEM;
  *block = fresh;
  return 0;
}

void* valloc(size_t size) {
  COUNT(allocations);
  return __libc_valloc(size);
}

void* pvalloc(size_t size) {
  COUNT(allocations);
  return __libc_pvalloc(size);
}
