// SPDX-License-Identifier: Apache-2.0
// libgpiod 1.5 and later. Two threads may set one line at once: beside its ioctl the library stores the value into an
// integer of the line that only its set_config and set_flags read, which nothing here calls (lib/core.c of 1.6).
#include <gpiod.h>

#include <cerrno>

#include "drivers/linux/gpio_gpiod_library.hpp"

namespace holdfast::drivers::gpiod {
namespace {

struct CloseChip {
  void operator()(gpiod_chip* chip) const { gpiod_chip_close(chip); }
};
using Chip = std::unique_ptr<gpiod_chip, CloseChip>;

std::string text_of(const char* text) {
  return text != nullptr ? text : "";
}

int last_error() {
  return errno != 0 ? errno : EIO;
}

}  // namespace

// The line belongs to the chip, which stays open with it.
struct Held {
  Chip chip;
  gpiod_line* line = nullptr;
};

void Release::operator()(Held* held) const {
  gpiod_line_release(held->line);
  delete held;
}

int ask(const std::string& path, KernelChip& chip) {
  errno = 0;
  const Chip opened(gpiod_chip_open(path.c_str()));
  if (opened == nullptr) return last_error();
  chip = {path, text_of(gpiod_chip_name(opened.get())), text_of(gpiod_chip_label(opened.get())), {}};
  const unsigned count = gpiod_chip_num_lines(opened.get());
  for (unsigned offset = 0; offset < count; ++offset) {
    gpiod_line* const line = gpiod_chip_get_line(opened.get(), offset);
    if (line == nullptr) return last_error();
    chip.lines.push_back(
        {text_of(gpiod_line_name(line)), gpiod_line_is_used(line), text_of(gpiod_line_consumer(line))});
  }
  return 0;
}

int request(const std::string& path, const Wish& wish, HeldLine& line) {
  errno = 0;
  Chip chip(gpiod_chip_open(path.c_str()));
  gpiod_line* const found = chip != nullptr ? gpiod_chip_get_line(chip.get(), wish.offset) : nullptr;
  if (found == nullptr) return last_error();
  const int pull = wish.active_low ? GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_UP : GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_DOWN;
  gpiod_line_request_config config{
      wish.consumer.c_str(), wish.output ? GPIOD_LINE_REQUEST_DIRECTION_OUTPUT : GPIOD_LINE_REQUEST_DIRECTION_INPUT,
      (wish.active_low ? GPIOD_LINE_REQUEST_FLAG_ACTIVE_LOW : 0) | (wish.pull ? pull : 0)};
  bool done = gpiod_line_request(found, &config, 0) == 0;
  // A chip without resistors is fine with the kernel; one older than Linux 5.5 calls the flag invalid.
  if (!done && wish.pull && (errno == EINVAL || errno == ENOTSUP)) {
    config.flags &= ~pull;
    done = gpiod_line_request(found, &config, 0) == 0;
  }
  if (!done) return last_error();
  line.reset(new Held{std::move(chip), found});
  return 0;
}

bool write(Held& held, bool level) {
  return gpiod_line_set_value(held.line, level ? 1 : 0) == 0;
}

int read(Held& held) {
  return gpiod_line_get_value(held.line);
}

}  // namespace holdfast::drivers::gpiod
