// SPDX-License-Identifier: Apache-2.0
// holdfast-sensor: what a user or a unit may do with the sensor's USB port, so that holdfastd itself needs no right to
// USB. Looking reads sysfs alone; only `reset` opens a device, by libusb, and only the sensor that was found.
#include <libusb.h>

#include <array>
#include <charconv>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <thread>

#include "drivers/linux/usb_sensor.hpp"

namespace {

using holdfast::drivers::capture_node;
using holdfast::drivers::find_sensor;
using holdfast::drivers::Kinship;
using holdfast::drivers::kSensorProduct;
using holdfast::drivers::kSensorVendor;
using holdfast::drivers::Search;
using holdfast::drivers::SensorSearch;
using holdfast::drivers::take_census;
using holdfast::drivers::UsbCensus;
using holdfast::drivers::UsbDevice;
using holdfast::drivers::VideoNode;
using std::chrono::steady_clock;

constexpr char kUsage[] =
    "usage: holdfast-sensor list [--json]                    cameras on USB, and which of them is the sensor\n"
    "       holdfast-sensor reset SERIAL|--any               reset the sensor's USB port, as if it were replugged\n"
    "       holdfast-sensor wait SERIAL|--any [--timeout S]  until the sensor and its video node are there (30 s)\n"
    "       --sysfs DIR   look there instead of /sys (tests)\n"
    "example: holdfast-sensor wait 2BNN-4ZE7 --timeout 60 && systemctl start holdfastd\n"
    "exit status: 0 done, 1 it could not be, 2 the command line is wrong\n";
constexpr int kFailed = 1;
constexpr int kWrong = 2;
constexpr std::chrono::milliseconds kLookAgain{100};

struct Command {
  std::string verb;
  std::string serial;
  bool any = false;
  bool json = false;
  unsigned timeout_s = 30;
  std::string sysfs = "/sys";
};

bool fail(std::string_view message) {
  std::fprintf(stderr, "holdfast-sensor: %.*s\n", static_cast<int>(message.size()), message.data());
  return false;
}

bool parse_seconds(std::string_view text, unsigned& seconds) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), seconds);
  return error == std::errc{} && end == text.data() + text.size();
}

bool parse(std::span<char*> words, Command& command) {
  for (std::size_t i = 0; i < words.size(); ++i) {
    const std::string_view word = words[i];
    const bool more = i + 1 < words.size();
    if (word == "--json") {
      command.json = true;
    } else if (word == "--any") {
      command.any = true;
    } else if (word == "--sysfs" && more) {
      command.sysfs = words[++i];
    } else if (word == "--timeout" && more) {
      if (!parse_seconds(words[++i], command.timeout_s)) return false;
    } else if (word.starts_with("-") || !command.serial.empty()) {
      return false;
    } else {
      (command.verb.empty() ? command.verb : command.serial) = word;
    }
  }
  if (command.verb == "list") return command.serial.empty() && !command.any;
  // A wrong sensor is worse than none, so "whichever there is" has to be said.
  return (command.verb == "reset" || command.verb == "wait") && command.any == command.serial.empty() && !command.json;
}

std::string in_quotes(std::string_view text) {
  std::string out = "\"";
  for (const char letter : text) {  // printable ASCII, see UsbDevice
    if (letter == '"' || letter == '\\') out += '\\';
    out += letter;
  }
  return out + "\"";
}

std::string_view name_of(Kinship kin) {
  switch (kin) {
    case Kinship::kSensor:
      return "sensor";
    case Kinship::kLookAlike:
      return "look-alike";
    case Kinship::kStranger:
      break;
  }
  return "camera";
}

std::string id_of(const UsbDevice& device) {
  std::array<char, 16> text{};
  std::snprintf(text.data(), text.size(), "%04x:%04x", device.vendor, device.product_id);
  return text.data();
}

int list(const Command& command, const UsbCensus& census) {
  const auto devices = std::span(census.devices).first(census.device_count);
  std::string json;
  for (const UsbDevice& device : devices) {
    const VideoNode* const node = capture_node(census, device);
    const std::string path = node != nullptr ? "/dev/" + std::string(node->name.view()) : "";
    const std::string serial(serial_of(device).view());
    const std::string kind(name_of(kinship(device)));
    if (command.json) {
      json += (json.empty() ? "" : ",\n") + std::string("  {\"kind\": ") + in_quotes(kind) +
              ", \"serial\": " + in_quotes(serial) + ", \"node\": " + in_quotes(path) +
              ", \"usb_path\": " + in_quotes(device.path) + ", \"usb_id\": " + in_quotes(id_of(device)) +
              ", \"manufacturer\": " + in_quotes(device.manufacturer) + ", \"product\": " + in_quotes(device.product) +
              ", \"speed_mbit\": " + std::to_string(device.speed_mbit) + "}";
    } else {
      std::printf("%-10s  %-9s  %-12s  %-8s  %s  %4u Mb/s  %s\n", kind.c_str(), serial.empty() ? "-" : serial.c_str(),
                  path.empty() ? "-" : path.c_str(), device.path.c_str(), id_of(device).c_str(), device.speed_mbit,
                  device.product.c_str());
    }
  }
  if (command.json) std::printf("[\n%s%s]\n", json.c_str(), json.empty() ? "" : "\n");
  if (!command.json && devices.empty()) std::printf("no camera on USB\n");
  const SensorSearch search = find_sensor(census, "");
  if (!search.message.empty()) (void)fail(search.message);
  return 0;
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
               ". Likely cause: unplugged at this moment, or no USB here. Next: holdfast-sensor list, then again");
    return kFailed;
  }
  std::printf("reset %s\n", name.c_str());
  return 0;
}

int wait(UsbCensus& census, const Command& command) {
  const auto until = steady_clock::now() + std::chrono::seconds(command.timeout_s);
  for (;;) {
    take_census(command.sysfs.c_str(), census);
    const SensorSearch search = find_sensor(census, command.serial);
    if (search.result == Search::kFound) {
      if (!search.message.empty()) (void)fail(search.message);
      std::printf("%s %s\n", search.serial.c_str(), search.node.c_str());
      return 0;
    }
    if (steady_clock::now() >= until) {
      (void)fail(search.message);
      return kFailed;
    }
    std::this_thread::sleep_for(kLookAgain);
  }
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
  if (command.verb == "list") return list(command, *census);
  if (command.verb == "reset") return reset(*census, command);
  return wait(*census, command);
}
