// SPDX-License-Identifier: Apache-2.0
// The two marks between which the preloaded heap counter (heap_counter.c) counts.
//
//   const auto marks = HeapMarks::find();            // nullopt: started without
//   LD_PRELOAD=libheap_counter.so marks->begin();
//   ... nothing here may touch the heap, in any thread ...
//   const HeapCounts counts = marks->end();
//   if (counts.allocations + counts.releases != 0) print_first_caller(counts);
//
// Looked up at run time and not linked, so that a program is the same with and without the counter. Programs
// that use this must not link CppUTest: it replaces operator new by its own, and that is no longer the product's heap.
#pragma once

#include <dlfcn.h>

#include <cstddef>
#include <cstdio>
#include <optional>

extern "C" {
#include "heap_counts.h"
}

namespace holdfast::test {

class HeapMarks {
 public:
  [[nodiscard]] static std::optional<HeapMarks> find() {
    const auto begin = reinterpret_cast<void (*)()>(dlsym(RTLD_DEFAULT, "holdfast_heap_begin"));
    const auto end = reinterpret_cast<HeapCounts (*)()>(dlsym(RTLD_DEFAULT, "holdfast_heap_end"));
    if (begin == nullptr || end == nullptr) return std::nullopt;
    return HeapMarks(begin, end);
  }

  void begin() const { begin_(); }
  [[nodiscard]] HeapCounts end() const { return end_(); }

 private:
  HeapMarks(void (*begin)(), HeapCounts (*end)()) : begin_(begin), end_(end) {}
  void (*begin_)();
  HeapCounts (*end_)();
};

// Where the first call came from: the library or program and the offset in it, as addr2line takes them.
inline void print_first_caller(const HeapCounts& counts) {
  Dl_info where{};
  if (counts.first_caller == nullptr || dladdr(counts.first_caller, &where) == 0) return;
  const auto offset = static_cast<const char*>(counts.first_caller) - static_cast<const char*>(where.dli_fbase);
  std::fprintf(stderr, "first heap call: %s, in %s (addr2line -Cfe %s 0x%zx)\n",
               where.dli_sname != nullptr ? where.dli_sname : "a function without a name", where.dli_fname,
               where.dli_fname, static_cast<std::size_t>(offset));
}

}  // namespace holdfast::test
