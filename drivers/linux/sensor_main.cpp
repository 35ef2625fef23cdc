// SPDX-License-Identifier: Apache-2.0
// holdfast-sensor: what a user or a unit may do with the sensor's USB port, so that holdfastd itself needs no right to
// USB. Looking reads sysfs alone; only `reset` opens a device, by libusb, and only the sensor that was found.
#include <libusb.h>

#include <cstddef>
#include <cstdio>
#include <cstring>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "drivers/linux/usb_sensor.hpp"

namespace {

using holdfast::drivers::find_sensor;
using holdfast::drivers::kSensorProduct;
using holdfast::drivers::kSensorVendor;
using holdfast::drivers::Search;
using holdfast::drivers::SensorSearch;
using holdfast::drivers::take_census;
using holdfast::drivers::UsbCensus;
using holdfast::drivers::UsbDevice;

constexpr char kUsage[] =
    "usage: holdfast-sensor reset SERIAL|--any   reset the sensor's USB port, as if it were replugged\n"
    "       --sysfs DIR   look there instead of /sys (tests)\n"
    "example: holdfast-sensor reset 2BNN-4ZE7\n"
    "exit status: 0 done, 1 it could not be, 2 the command line is wrong\n";
constexpr int kFailed = 1;
constexpr int kWrong = 2;

struct Command {
  std::string verb;
  std::string serial;
  bool any = false;
  std::string sysfs = "/sys";
};

bool fail(std::string_view message) {
  std::fprintf(stderr, "holdfast-sensor: %.*s\n", static_cast<int>(message.size()), message.data());
  return false;
}

bool parse(std::span<char*> words, Command& command) {
  for (std::size_t i = 0; i < words.size(); ++i) {
    const std::string_view word = words[i];
    const bool more = i + 1 < words.size();
    if (word == "--any") {
      command.any = true;
    } else if (word == "--sysfs" && more) {
      command.sysfs = words[++i];
    } else if (word.starts_with("-") || !command.serial.empty()) {
      return false;
    } else {
      (command.verb.empty() ? command.verb : command.serial) = word;
    }
  }
  // A wrong sensor is worse than none, so "whichever there is" has to be said.
  return command.verb == "reset" && command.any == command.serial.empty();
}

struct FreeList {
  void operator()(libusb_device** list) const { libusb_free_device_list(list, 1); }
};
struct CloseHandle {
  void operator()(libusb_device_handle* handle) const { libusb_close(handle); }
};
struct Leave {
  void operator()(libusb_context* context) const { libusb_exit(context); }
};

// The device at that place, if it is still one with the sensor's id.
std::unique_ptr<libusb_device_handle, CloseHandle> open(libusb_context* context, const UsbDevice& wanted, int& error) {
  libusb_device** all = nullptr;
  const ssize_t count = libusb_get_device_list(context, &all);
  const std::unique_ptr<libusb_device*, FreeList> list(all);
  error = LIBUSB_ERROR_NO_DEVICE;
  for (ssize_t i = 0; i < count; ++i) {
    libusb_device_descriptor descriptor{};
    if (libusb_get_bus_number(all[i]) != wanted.bus || libusb_get_device_address(all[i]) != wanted.address ||
        libusb_get_device_descriptor(all[i], &descriptor) != 0 || descriptor.idVendor != kSensorVendor ||
        descriptor.idProduct != kSensorProduct) {
      continue;
    }
    libusb_device_handle* handle = nullptr;
    error = libusb_open(all[i], &handle);
    return std::unique_ptr<libusb_device_handle, CloseHandle>(error == 0 ? handle : nullptr);
  }
  return nullptr;
}

int reset(const UsbCensus& census, const Command& command) {
  const SensorSearch search = find_sensor(census, command.serial);
  // A sensor whose video node does not come is the one that wants a reset.
  if (search.result != Search::kFound && search.result != Search::kNoNode) {
    (void)fail(search.message);
    return kFailed;
  }
  const std::string name =
      "GelSight Mini " + std::string(search.serial.view()) + " at " + std::string(search.device.path.view());
  libusb_context* context = nullptr;
  int error = libusb_init(&context);
  if (error == 0) {
    const std::unique_ptr<libusb_context, Leave> leave(context);
    const auto handle = open(context, search.device, error);
    if (handle != nullptr) error = libusb_reset_device(handle.get());
  }
  if (error == LIBUSB_ERROR_NOT_FOUND) error = 0;  // it came back as a new device: what a reset is for
  if (error == LIBUSB_ERROR_ACCESS) {
    (void)fail(name +
               ": no right to reset it. Likely cause: the udev rule of the board is not installed, or the user is "
               "not in its group. Next: install the rule and replug the sensor, or run this as root");
    return kFailed;
  }
  if (error != 0) {
    (void)fail(name + ": not reset: " + libusb_error_name(error) +
               ". Likely cause: unplugged at this moment, or no USB here. Next: replug it, then again");
    return kFailed;
  }
  std::printf("reset %s\n", name.c_str());
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const std::span<char*> words(argv + 1, argc > 0 ? static_cast<std::size_t>(argc - 1) : 0);
  if (words.size() == 1 && (std::strcmp(words[0], "--help") == 0 || std::strcmp(words[0], "-h") == 0)) {
    std::fputs(kUsage, stdout);
    return 0;
  }
  Command command;
  if (!parse(words, command)) {
    std::fputs(kUsage, stderr);
    return kWrong;
  }
  const auto census = std::make_unique<UsbCensus>();
  take_census(command.sysfs.c_str(), *census);
  return reset(*census, command);
}
