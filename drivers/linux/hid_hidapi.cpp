// SPDX-License-Identifier: Apache-2.0
#include "drivers/linux/hid_hidapi.hpp"

#include <hidapi.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <vector>

namespace holdfast::drivers {
namespace {

struct FreeList {
  void operator()(hid_device_info* list) const { hid_free_enumeration(list); }
};

struct Candidate {
  std::string path;
  std::string serial;
};

std::string narrow(const wchar_t* text) {
  std::string out;
  for (; text != nullptr && *text != L'\0'; ++text)
    out += *text >= L' ' && *text <= L'~' ? static_cast<char>(*text) : '?';
  return out;
}

std::vector<Candidate> candidates(std::uint16_t vendor, std::uint16_t product) {
  std::vector<Candidate> found;
  const std::unique_ptr<hid_device_info, FreeList> list(hid_enumerate(vendor, product));
  for (const hid_device_info* info = list.get(); info != nullptr; info = info->next) {
    found.push_back({info->path, narrow(info->serial_number)});
  }
  return found;
}

// A HID device with this id that the kernel's own driver has: it has no hidraw device then.
std::string kernel_driver_of(const std::string& id) {
  std::error_code error;
  for (std::filesystem::directory_iterator entry("/sys/bus/hid/devices", error), end; !error && entry != end;
       entry.increment(error)) {
    if (entry->path().filename().string().find(id) == std::string::npos) continue;
    std::error_code ignored;
    return std::filesystem::read_symlink(entry->path() / "driver", ignored).filename().string();
  }
  return "";
}

std::string id_of(std::uint16_t vendor, std::uint16_t product) {
  std::array<char, 16> text{};
  std::snprintf(text.data(), text.size(), "%04X:%04X", vendor, product);
  return text.data();
}

}  // namespace

void HidapiPort::Close::operator()(hid_device_* device) const {
  hid_close(device);
}

std::string HidapiPort::open(std::uint16_t vendor, std::uint16_t product, std::string_view serial) {
  device_.reset();
  lock_.reset();
  const std::string id = id_of(vendor, product);
  std::vector<Candidate> found = candidates(vendor, product);
  if (found.empty()) {
    const std::string driver = kernel_driver_of(id);
    if (!driver.empty()) {
      return "HID device " + id + ": the kernel's driver '" + driver +
             "' has it, and leaves no hidraw device. Likely cause: the module was loaded when it was plugged in. Next: "
             "wire by the GPIO chip that this driver made (gpiodetect), or unload the module (modprobe -r) and replug";
    }
    return "HID device " + id +
           ": not there. Likely cause: not plugged in, or a cable without data wires. Next: look for it with lsusb";
  }
  std::string names;
  for (const Candidate& candidate : found) names += (names.empty() ? "'" : ", '") + candidate.serial + "'";
  if (!serial.empty()) std::erase_if(found, [&](const Candidate& candidate) { return candidate.serial != serial; });
  if (found.size() != 1) {
    return "HID device " + id + ": " + (found.empty() ? "none with serial '" + std::string(serial) + "'" : "several") +
           "; there is " + names +
           ". Likely cause: another one is plugged in. Next: give the serial number of the one to use";
  }
  lock_.reset(std::fopen(found.front().path.c_str(), "r+e"));
  if (lock_ != nullptr && ::flock(::fileno(lock_.get()), LOCK_EX | LOCK_NB) != 0) {
    return "HID device " + id + ": " + found.front().path +
           " is in use. Likely cause: a holdfastd runs that drives it. Next: end that one first";
  }
  device_.reset(hid_open_path(found.front().path.c_str()));
  if (device_ != nullptr) return "";
  // hidapi tells its reason in words only; the system knows.
  const bool allowed = ::access(found.front().path.c_str(), R_OK | W_OK) == 0;
  return "HID device " + id + ": " + found.front().path + " does not open (" +
         (allowed ? narrow(hid_error(nullptr)) : std::strerror(errno)) +
         "). Likely cause: the udev rule of the board is not installed, or the user is not in its group. Next: install "
         "the rule and replug";
}

bool HidapiPort::do_send(const Report& report) {
  std::array<std::uint8_t, std::tuple_size_v<Report> + 1> numbered{};  // number 0: the device numbers none
  std::copy(report.begin(), report.end(), numbered.begin() + 1);
  return device_ != nullptr &&
         hid_write(device_.get(), numbered.data(), numbered.size()) == static_cast<int>(numbered.size());
}

HidPort::Got HidapiPort::do_receive(Report& report, std::chrono::milliseconds at_most) {
  if (device_ == nullptr) return Got::kGone;
  const int size = hid_read_timeout(device_.get(), report.data(), report.size(), static_cast<int>(at_most.count()));
  if (size < 0) return Got::kGone;
  return size == static_cast<int>(report.size()) ? Got::kReport : Got::kNothing;
}

}  // namespace holdfast::drivers
