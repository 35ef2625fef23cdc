// SPDX-License-Identifier: Apache-2.0
// Those functions of libgpiod 1 that gpio_gpiod_v1.cpp calls, on tests/linux/gpio_kernel.hpp instead of a kernel;
// declared by the real library's header.
#include <gpiod.h>

#include <cerrno>
#include <map>
#include <memory>

#include "tests/linux/gpio_kernel.hpp"

using namespace holdfast::test;

struct gpiod_line {
  Wire* wire = nullptr;
  bool requested = false;
};

struct gpiod_chip {
  Chip* chip = nullptr;
  std::map<unsigned, gpiod_line> lines;  // the real one frees its lines when it is closed, and releases them
};

extern "C" {

gpiod_chip* gpiod_chip_open(const char* path) {
  Chip* const opened = GpioKernel::open(path);
  return opened == nullptr ? nullptr : new gpiod_chip{opened, {}};
}

void gpiod_chip_close(gpiod_chip* chip) {
  for (auto& [offset, line] : chip->lines) gpiod_line_release(&line);
  --GpioKernel::get().opened;
  delete chip;
}

const char* gpiod_chip_name(gpiod_chip* chip) {
  return chip->chip->name.c_str();
}
const char* gpiod_chip_label(gpiod_chip* chip) {
  return chip->chip->label.c_str();
}
unsigned gpiod_chip_num_lines(gpiod_chip* chip) {
  return static_cast<unsigned>(chip->chip->wires.size());
}

gpiod_line* gpiod_chip_get_line(gpiod_chip* chip, unsigned offset) {
  if (GpioKernel::fails()) return nullptr;
  if (offset >= chip->chip->wires.size()) {
    errno = EINVAL;
    return nullptr;
  }
  gpiod_line& line = chip->lines[offset];
  line.wire = &chip->chip->wires[offset];
  return &line;
}

const char* gpiod_line_name(gpiod_line* line) {
  return line->wire->name.empty() ? nullptr : line->wire->name.c_str();
}
const char* gpiod_line_consumer(gpiod_line* line) {
  return line->wire->user.empty() ? nullptr : line->wire->user.c_str();
}
bool gpiod_line_is_used(gpiod_line* line) {
  return line->wire->used;
}

int gpiod_line_request(gpiod_line* line, const gpiod_line_request_config* config, int default_val) {
  if (GpioKernel::fails()) return -1;
  Request wish;
  wish.output = config->request_type == GPIOD_LINE_REQUEST_DIRECTION_OUTPUT;
  wish.active_low = (config->flags & GPIOD_LINE_REQUEST_FLAG_ACTIVE_LOW) != 0;
  if ((config->flags & GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_DOWN) != 0) wish.pull = Pull::kDown;
  if ((config->flags & GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_UP) != 0) wish.pull = Pull::kUp;
  wish.value = default_val != 0;
  wish.consumer = config->consumer;
  const int failed = request(*line->wire, wish);
  if (failed != 0) {
    errno = failed;
    return -1;
  }
  ++GpioKernel::get().opened;
  line->requested = true;
  return 0;
}

void gpiod_line_release(gpiod_line* line) {
  if (!line->requested) return;
  line->requested = false;
  --GpioKernel::get().opened;
  release(*line->wire);
}

int gpiod_line_get_value(gpiod_line* line) {
  if (GpioKernel::fails()) return -1;
  if (!line->requested || line->wire->refuse_io != 0) {
    errno = line->requested ? line->wire->refuse_io : EPERM;
    return -1;
  }
  return get(*line->wire) ? 1 : 0;
}

int gpiod_line_set_value(gpiod_line* line, int value) {
  if (GpioKernel::fails()) return -1;
  const int failed = line->requested ? set(*line->wire, value != 0) : EPERM;
  if (failed == 0) return 0;
  errno = failed;
  return -1;
}

}  // extern "C"
