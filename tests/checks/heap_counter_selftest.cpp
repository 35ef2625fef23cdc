// SPDX-License-Identifier: Apache-2.0
// Proves that the heap counter counts: plants heap calls of every kind between the marks and nothing else.
// A plain program, not CppUTest, whose operator new would stand in front of libstdc++'s. Run with the counter
// preloaded. Exit status 0: every plant was seen and silence counted as silence.
#include <malloc.h>

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>

#include "heap_marks.hpp"

namespace {

// Keeps the compiler from dropping an allocation whose block nobody reads.
void keep(void* block) {
  asm volatile("" : : "g"(block) : "memory");
}

// Stays within the buffer that std::string carries for short texts.
void short_string() {
  std::string text = "short";
  text += '!';
  keep(text.data());
}

void long_string() {
  std::string text(100, 'x');
  text.append(100, 'y');
  keep(text.data());
}

void plant_new() {
  auto* value = new int(1);
  keep(value);
  delete value;
}

void plant_aligned_new() {
  struct alignas(64) Line {
    char bytes[64];
  };
  auto* line = new Line;
  keep(line);
  delete line;
}

void plant_malloc(std::size_t alignment) {
  void* block = alignment == 0 ? std::malloc(10) : aligned_alloc(alignment, alignment);
  keep(block);
  std::free(block);
}

void plant_posix_memalign() {
  void* block = nullptr;
  if (posix_memalign(&block, 64, 10) == 0) keep(block);
  std::free(block);
}

void plant_file() {
  std::FILE* file = std::fopen("/dev/null", "r");
  keep(file);
  if (file != nullptr) std::fclose(file);
}

struct Plant {
  const char* name;
  void (*act)();
  unsigned long at_least;  // allocations and, alike, releases: libraries may make more than the one asked for
  unsigned long at_most;
};

constexpr unsigned long kAny = 100;
constexpr Plant kPlants[] = {
    {"nothing", [] {}, 0, 0},
    {"free(NULL)", [] { std::free(nullptr); }, 0, 0},
    {"a string within its own buffer", short_string, 0, 0},
    {"malloc", [] { plant_malloc(0); }, 1, 1},
    {"calloc",
     [] {
       void* block = std::calloc(3, 3);
       keep(block);
       std::free(block);
     },
     1, 1},
    {"aligned_alloc", [] { plant_malloc(64); }, 1, 1},
    {"posix_memalign", plant_posix_memalign, 1, 1},
    {"memalign",
     [] {
       void* block = memalign(64, 10);
       keep(block);
       std::free(block);
     },
     1, 1},
    {"valloc",
     [] {
       void* block = valloc(10);
       keep(block);
       std::free(block);
     },
     1, 1},
    {"operator new, in libstdc++", plant_new, 1, 1},
    {"aligned operator new, in libstdc++", plant_aligned_new, 1, 1},
    {"growth of a std::string, in libstdc++", long_string, 2, 2},
    {"fopen, in libc", plant_file, 1, kAny},
    {"a thread", [] { std::thread(plant_new).join(); }, 2, kAny},
};

// realloc is counted as an allocation, so its figures differ from the table's "alike".
bool realloc_is_counted(const holdfast::test::HeapMarks& marks) {
  void* block = std::malloc(10);
  keep(block);
  marks.begin();
  block = std::realloc(block, 100'000);
  keep(block);
  const HeapCounts counts = marks.end();
  std::free(block);
  std::printf("%-40s %lu allocations, %lu releases\n", "realloc", counts.allocations, counts.releases);
  return counts.allocations == 1 && counts.releases == 0 && counts.first_caller != nullptr;
}

}  // namespace

int main() {
  const auto marks = holdfast::test::HeapMarks::find();
  if (!marks) {
    std::fputs("error: no heap counter (started without it). Next: LD_PRELOAD=libheap_counter.so\n", stderr);
    return 1;
  }
  int wrong = 0;
  for (const Plant& plant : kPlants) {
    marks->begin();
    plant.act();
    const HeapCounts counts = marks->end();
    const bool right = counts.allocations >= plant.at_least && counts.allocations <= plant.at_most &&
                       counts.releases >= plant.at_least && counts.releases <= plant.at_most &&
                       (counts.first_caller != nullptr) == (plant.at_least > 0);
    std::printf("%-40s %lu allocations, %lu releases%s\n", plant.name, counts.allocations, counts.releases,
                right ? "" : "  <- WRONG");
    wrong += right ? 0 : 1;
  }
  if (!realloc_is_counted(*marks)) ++wrong;
  std::printf("%d wrong\n", wrong);
  return wrong == 0 ? 0 : 1;
}
