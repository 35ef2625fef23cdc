// SPDX-License-Identifier: Apache-2.0
// What gpio_gpiod.cpp needs of libgpiod, in words that both of its interfaces can say: versions 1 and 2 share two
// function names and nothing else. gpio_gpiod_v1.cpp or gpio_gpiod_v2.cpp implements it; CMake picks by the version
// found. Errors are errno values, 0: done.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace holdfast::drivers::gpiod {

struct KernelLine {
  std::string name;  // empty: none
  bool used = false;
  std::string user;  // what the holder calls itself; the kernel keeps 31 letters
};

struct KernelChip {
  std::string path;  // of its device file
  std::string name;
  std::string label;
  std::vector<KernelLine> lines;
};

// What the kernel tells of a chip. Leaves nothing open.
[[nodiscard]] int ask(const std::string& path, KernelChip& chip);

struct Wish {
  std::uint32_t offset = 0;
  std::string consumer;
  bool output = false;      // requested with the logical level 0
  bool active_low = false;  // the kernel turns logical levels into those of the wire, the initial one too
  bool pull = false;        // inputs: a resistor towards the inactive level
};

// A line that is ours until the object goes.
struct Held;
struct Release {
  void operator()(Held* held) const;
};
using HeldLine = std::unique_ptr<Held, Release>;

[[nodiscard]] int request(const std::string& path, const Wish& wish, HeldLine& line);

// Logical levels. One system call, no heap; from any thread.
[[nodiscard]] bool write(Held& held, bool level);
[[nodiscard]] int read(Held& held);  // 0, 1, or -1: refused

}  // namespace holdfast::drivers::gpiod
