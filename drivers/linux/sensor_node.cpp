// SPDX-License-Identifier: Apache-2.0
#include "drivers/linux/sensor_node.hpp"

#include <fcntl.h>

#include <algorithm>
#include <array>

namespace holdfast::drivers {
namespace {

// The kernel numbers them from 0 and gives the first free number: nobody has so many.
constexpr int kMostNodes = 64;
constexpr std::string_view kVendor = "0c45";
constexpr std::string_view kProductId = "636d";
constexpr std::string_view kProduct = "GelSight Mini";

// The first line of a file of sysfs; empty: not there.
template <std::size_t kCapacity>
void read_line(Kernel& kernel, const Text<192>& path, Text<kCapacity>& out) {
  out.clear();
  const int fd = kernel.open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return;
  std::array<char, kCapacity> bytes{};
  const ssize_t count = kernel.read(fd, bytes.data(), bytes.size());
  (void)kernel.close(fd);
  if (count <= 0) return;
  const std::string_view text(bytes.data(), static_cast<std::size_t>(count));
  out << text.substr(0, text.find('\n'));
}

// Product names have a dash in the serial, USB's own serial has none.
bool same_serial(std::string_view a, std::string_view b) {
  const auto next = [](std::string_view& text) {
    while (text.starts_with('-')) text.remove_prefix(1);
    const char c = text.empty() ? '\0' : text.front();
    text.remove_prefix(std::min<std::size_t>(1, text.size()));
    return c;
  };
  const std::size_t most = a.size() + b.size();
  for (std::size_t i = 0; i <= most; ++i) {
    const char x = next(a);
    if (x != next(b)) return false;
    if (x == '\0') return true;
  }
  return false;
}

}  // namespace

bool find_sensor(Kernel& kernel, const SensorSearch& search, SensorNode& found, Text<320>& problem) {
  problem.clear();
  int sensors = 0;
  SensorNode other;     // another sensor than asked for
  Text<64> look_alike;  // a camera of the same id
  for (int number = 0; number < kMostNodes; ++number) {
    const auto read = [&](std::string_view name, auto& out) {
      Text<192> path;
      path << search.sysfs << "/class/video4linux/video" << number << "/" << name;
      read_line(kernel, path, out);
    };
    Text<8> index;
    read("index", index);
    if (index.view() != "0") continue;  // not there, or the metadata
    Text<8> vendor, id;
    read("device/../idVendor", vendor);
    read("device/../idProduct", id);
    if (vendor.view() != kVendor || id.view() != kProductId) continue;
    SensorNode node;
    read("device/../product", node.product);
    read("device/../serial", node.serial);
    if (!node.product.view().starts_with(kProduct)) {
      look_alike = node.product;
      continue;
    }
    if (!search.serial.empty() && !same_serial(node.serial.view(), search.serial)) {
      other = node;
      continue;
    }
    node.path << search.devices << "/video" << number;
    if (++sensors == 1) {
      found = node;
    } else {
      problem.clear();
      problem << "two sensors are plugged in, " << found.serial.view() << " and " << node.serial.view()
              << ". Likely cause: a hand with two fingers. Next: say which by its serial (--sensor)";
    }
  }
  if (sensors == 1) return true;
  if (sensors > 1) return false;
  if (!other.product.empty()) {
    problem << "no sensor " << search.serial << ", but '" << other.product.view() << "' (" << other.serial.view()
            << "). Likely cause: another fingertip was plugged in. Next: plug in the one that was asked for, or change "
               "--sensor";
  } else if (!look_alike.empty()) {
    problem
        << "'" << look_alike.view()
        << "' has a GelSight's USB id 0c45:636d but is none. Likely cause: a webcam of the same maker. Next: plug in "
           "the GelSight Mini";
  } else {
    problem << "no GelSight Mini on USB (0c45:636d). Likely cause: unplugged, its connector loose, or without power. "
               "Next: plug it in; holdfast devices lists what is there";
  }
  return false;
}

}  // namespace holdfast::drivers
