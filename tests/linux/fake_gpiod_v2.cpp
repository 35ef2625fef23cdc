// SPDX-License-Identifier: Apache-2.0
// The functions of tests/linux/gpiod_v2/gpiod.h on tests/linux/gpio_kernel.hpp instead of a kernel.
#include <gpiod.h>

#include <cerrno>

#include "tests/linux/gpio_kernel.hpp"

using namespace holdfast::test;

struct gpiod_chip {
  Chip* chip = nullptr;
};
struct gpiod_chip_info {
  Chip* chip = nullptr;
};
struct gpiod_line_info {
  Wire* wire = nullptr;
};
struct gpiod_line_settings {
  Request wish;
};
struct gpiod_line_config {
  Request wish;
  unsigned offset = 0;
};
struct gpiod_request_config {
  std::string consumer;
};
struct gpiod_line_request {
  Wire* wire = nullptr;
  unsigned offset = 0;
};

namespace {

int fail(int error) {
  errno = error;
  return -1;
}

}  // namespace

extern "C" {

gpiod_chip* gpiod_chip_open(const char* path) {
  Chip* const opened = GpioKernel::open(path);
  return opened == nullptr ? nullptr : new gpiod_chip{opened};
}

void gpiod_chip_close(gpiod_chip* chip) {
  --GpioKernel::get().opened;
  delete chip;
}

gpiod_chip_info* gpiod_chip_get_info(gpiod_chip* chip) {
  if (GpioKernel::fails()) return nullptr;
  return new gpiod_chip_info{chip->chip};
}
void gpiod_chip_info_free(gpiod_chip_info* info) {
  delete info;
}
const char* gpiod_chip_info_get_name(gpiod_chip_info* info) {
  return info->chip->name.c_str();
}
const char* gpiod_chip_info_get_label(gpiod_chip_info* info) {
  return info->chip->label.c_str();
}
size_t gpiod_chip_info_get_num_lines(gpiod_chip_info* info) {
  return info->chip->wires.size();
}

gpiod_line_info* gpiod_chip_get_line_info(gpiod_chip* chip, unsigned offset) {
  if (GpioKernel::fails()) return nullptr;
  if (offset < chip->chip->wires.size()) return new gpiod_line_info{&chip->chip->wires[offset]};
  errno = EINVAL;
  return nullptr;
}
void gpiod_line_info_free(gpiod_line_info* info) {
  delete info;
}
const char* gpiod_line_info_get_name(gpiod_line_info* info) {
  return info->wire->name.empty() ? nullptr : info->wire->name.c_str();
}
bool gpiod_line_info_is_used(gpiod_line_info* info) {
  return info->wire->used;
}
const char* gpiod_line_info_get_consumer(gpiod_line_info* info) {
  return info->wire->user.empty() ? nullptr : info->wire->user.c_str();
}

gpiod_line_settings* gpiod_line_settings_new() {
  if (GpioKernel::fails()) return nullptr;
  return new gpiod_line_settings;
}
void gpiod_line_settings_free(gpiod_line_settings* settings) {
  delete settings;
}
int gpiod_line_settings_set_direction(gpiod_line_settings* settings, gpiod_line_direction direction) {
  if (GpioKernel::fails()) return -1;
  settings->wish.output = direction == GPIOD_LINE_DIRECTION_OUTPUT;
  return 0;
}
int gpiod_line_settings_set_bias(gpiod_line_settings* settings, gpiod_line_bias bias) {
  if (GpioKernel::fails()) return -1;
  if (bias == GPIOD_LINE_BIAS_PULL_UP) settings->wish.pull = Pull::kUp;
  if (bias == GPIOD_LINE_BIAS_PULL_DOWN) settings->wish.pull = Pull::kDown;
  return 0;
}
void gpiod_line_settings_set_active_low(gpiod_line_settings* settings, bool active_low) {
  settings->wish.active_low = active_low;
}
int gpiod_line_settings_set_output_value(gpiod_line_settings* settings, gpiod_line_value value) {
  if (GpioKernel::fails()) return -1;
  settings->wish.value = value == GPIOD_LINE_VALUE_ACTIVE;
  return 0;
}

gpiod_line_config* gpiod_line_config_new() {
  if (GpioKernel::fails()) return nullptr;
  return new gpiod_line_config;
}
void gpiod_line_config_free(gpiod_line_config* config) {
  delete config;
}
int gpiod_line_config_add_line_settings(gpiod_line_config* config, const unsigned* offsets, size_t num_offsets,
                                        gpiod_line_settings* settings) {
  if (GpioKernel::fails()) return -1;
  if (num_offsets != 1) return fail(EINVAL);
  config->wish = settings->wish;  // a copy, as the real one makes
  config->offset = offsets[0];
  return 0;
}

gpiod_request_config* gpiod_request_config_new() {
  if (GpioKernel::fails()) return nullptr;
  return new gpiod_request_config;
}
void gpiod_request_config_free(gpiod_request_config* config) {
  delete config;
}
void gpiod_request_config_set_consumer(gpiod_request_config* config, const char* consumer) {
  config->consumer = consumer;
}

gpiod_line_request* gpiod_chip_request_lines(gpiod_chip* chip, gpiod_request_config* req_cfg,
                                             gpiod_line_config* line_cfg) {
  if (GpioKernel::fails()) return nullptr;
  Request wish = line_cfg->wish;
  wish.consumer = req_cfg->consumer;
  Wire& wire = chip->chip->wires.at(line_cfg->offset);
  const int failed = request(wire, wish);
  if (failed != 0) {
    errno = failed;
    return nullptr;
  }
  ++GpioKernel::get().opened;
  return new gpiod_line_request{&wire, line_cfg->offset};
}

void gpiod_line_request_release(gpiod_line_request* request) {
  --GpioKernel::get().opened;
  release(*request->wire);
  delete request;
}

gpiod_line_value gpiod_line_request_get_value(gpiod_line_request* request, unsigned offset) {
  if (GpioKernel::fails()) return GPIOD_LINE_VALUE_ERROR;
  const int failed = offset != request->offset ? EINVAL : request->wire->refuse_io;
  if (failed != 0) {
    errno = failed;
    return GPIOD_LINE_VALUE_ERROR;
  }
  return get(*request->wire) ? GPIOD_LINE_VALUE_ACTIVE : GPIOD_LINE_VALUE_INACTIVE;
}

int gpiod_line_request_set_value(gpiod_line_request* request, unsigned offset, gpiod_line_value value) {
  if (GpioKernel::fails()) return -1;
  const int failed = offset != request->offset ? EINVAL : set(*request->wire, value == GPIOD_LINE_VALUE_ACTIVE);
  return failed == 0 ? 0 : fail(failed);
}

}  // extern "C"
