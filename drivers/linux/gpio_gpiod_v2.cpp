// SPDX-License-Identifier: Apache-2.0
// libgpiod 2. Its set and get keep no state beside the descriptor (lib/line-request.c), so threads need no lock.
#include <gpiod.h>

#include <cerrno>

#include "drivers/linux/gpio_gpiod_library.hpp"

namespace holdfast::drivers::gpiod {
namespace {

template <auto kFree>
struct Free {
  template <typename Thing>
  void operator()(Thing* thing) const {
    kFree(thing);
  }
};
using Chip = std::unique_ptr<gpiod_chip, Free<gpiod_chip_close>>;
using Info = std::unique_ptr<gpiod_chip_info, Free<gpiod_chip_info_free>>;
using OneLine = std::unique_ptr<gpiod_line_info, Free<gpiod_line_info_free>>;
using Settings = std::unique_ptr<gpiod_line_settings, Free<gpiod_line_settings_free>>;
using LineConfig = std::unique_ptr<gpiod_line_config, Free<gpiod_line_config_free>>;
using RequestConfig = std::unique_ptr<gpiod_request_config, Free<gpiod_request_config_free>>;

std::string text_of(const char* text) {
  return text != nullptr ? text : "";
}

int last_error() {
  return errno != 0 ? errno : EIO;
}

gpiod_line_request* request_once(gpiod_chip* chip, const Wish& wish, bool pull) {
  const Settings settings(gpiod_line_settings_new());
  const LineConfig lines(gpiod_line_config_new());
  const RequestConfig config(gpiod_request_config_new());
  if (settings == nullptr || lines == nullptr || config == nullptr) return nullptr;
  gpiod_line_settings_set_active_low(settings.get(), wish.active_low);
  const bool set =
      gpiod_line_settings_set_direction(settings.get(),
                                        wish.output ? GPIOD_LINE_DIRECTION_OUTPUT : GPIOD_LINE_DIRECTION_INPUT) == 0 &&
      gpiod_line_settings_set_output_value(settings.get(), GPIOD_LINE_VALUE_INACTIVE) == 0 &&
      (!pull || gpiod_line_settings_set_bias(
                    settings.get(), wish.active_low ? GPIOD_LINE_BIAS_PULL_UP : GPIOD_LINE_BIAS_PULL_DOWN) == 0) &&
      gpiod_line_config_add_line_settings(lines.get(), &wish.offset, 1, settings.get()) == 0;
  if (!set) return nullptr;
  gpiod_request_config_set_consumer(config.get(), wish.consumer.c_str());
  return gpiod_chip_request_lines(chip, config.get(), lines.get());
}

}  // namespace

struct Held {
  gpiod_line_request* request = nullptr;
  unsigned offset = 0;
};

void Release::operator()(Held* held) const {
  gpiod_line_request_release(held->request);
  delete held;
}

int ask(const std::string& path, KernelChip& chip) {
  errno = 0;
  const Chip opened(gpiod_chip_open(path.c_str()));
  const Info info(opened != nullptr ? gpiod_chip_get_info(opened.get()) : nullptr);
  if (info == nullptr) return last_error();
  chip = {path, text_of(gpiod_chip_info_get_name(info.get())), text_of(gpiod_chip_info_get_label(info.get())), {}};
  const std::size_t count = gpiod_chip_info_get_num_lines(info.get());
  for (unsigned offset = 0; offset < count; ++offset) {
    const OneLine line(gpiod_chip_get_line_info(opened.get(), offset));
    if (line == nullptr) return last_error();
    chip.lines.push_back({text_of(gpiod_line_info_get_name(line.get())), gpiod_line_info_is_used(line.get()),
                          text_of(gpiod_line_info_get_consumer(line.get()))});
  }
  return 0;
}

int request(const std::string& path, const Wish& wish, HeldLine& line) {
  errno = 0;
  const Chip chip(gpiod_chip_open(path.c_str()));
  if (chip == nullptr) return last_error();
  gpiod_line_request* granted = request_once(chip.get(), wish, wish.pull);
  // A chip without resistors is fine with the kernel; one older than Linux 5.5 calls the flag invalid.
  if (granted == nullptr && wish.pull && (errno == EINVAL || errno == ENOTSUP)) {
    granted = request_once(chip.get(), wish, false);
  }
  if (granted == nullptr) return last_error();
  line.reset(new Held{granted, wish.offset});
  return 0;
}

bool write(Held& held, bool level) {
  return gpiod_line_request_set_value(held.request, held.offset,
                                      level ? GPIOD_LINE_VALUE_ACTIVE : GPIOD_LINE_VALUE_INACTIVE) == 0;
}

int read(Held& held) {
  const gpiod_line_value value = gpiod_line_request_get_value(held.request, held.offset);
  return value == GPIOD_LINE_VALUE_ERROR ? -1 : static_cast<int>(value == GPIOD_LINE_VALUE_ACTIVE);
}

}  // namespace holdfast::drivers::gpiod
