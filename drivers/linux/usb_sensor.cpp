// SPDX-License-Identifier: Apache-2.0
#include "drivers/linux/usb_sensor.hpp"

#include <dirent.h>
#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <optional>
#include <span>

namespace holdfast::drivers {
namespace {

constexpr int kMostEntries = 4096;  // of a folder: sysfs has as many as there are devices
constexpr int kDevicesTold = 4;

class Descriptor {
 public:
  explicit Descriptor(int fd) : fd_(fd) {}
  ~Descriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  [[nodiscard]] int get() const { return fd_; }

 private:
  int fd_;
};

FixedText<255> joined(std::string_view a, std::string_view b) {
  FixedText<255> path(a);
  path += "/";
  path += b;
  return path;
}

// opendir() would take heap.
template <typename Visit>
void for_each_entry(const char* folder, Visit visit) {
  const Descriptor dir(::open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  alignas(dirent64) std::array<char, 4096> buffer{};
  int entries = 0;
  while (dir.get() >= 0 && entries < kMostEntries) {
    const ssize_t size = ::getdents64(dir.get(), buffer.data(), buffer.size());
    if (size <= 0) return;
    for (ssize_t at = 0; at < size && entries < kMostEntries; ++entries) {
      const auto* const entry = reinterpret_cast<const dirent64*>(buffer.data() + at);
      at += entry->d_reclen;
      visit(std::string_view(entry->d_name));
    }
  }
}

// One line of text. A device chooses its own words: what is not printable must not reach a terminal or a log.
FixedText<63> attribute(std::string_view folder, std::string_view name) {
  const Descriptor file(::open(joined(folder, name).c_str(), O_RDONLY | O_CLOEXEC));
  std::array<char, 64> buffer{};
  const ssize_t size = file.get() >= 0 ? ::read(file.get(), buffer.data(), buffer.size()) : 0;
  std::string_view line(buffer.data(), static_cast<std::size_t>(std::max<ssize_t>(size, 0)));
  line = line.substr(0, line.find('\n'));
  for (char& letter : std::span(buffer).first(line.size())) {
    if (letter < ' ' || letter > '~') letter = '?';
  }
  return line;
}

std::uint32_t number(std::string_view text, int base) {
  std::uint32_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, base);
  return error == std::errc{} ? value : 0;
}

// "1-1.2" of the node's link to "../../../1-1.2:1.0".
FixedText<31> usb_path_of(const char* node) {
  std::array<char, 256> target{};
  const ssize_t size = ::readlink(joined(node, "device").c_str(), target.data(), target.size());
  std::string_view path(target.data(), static_cast<std::size_t>(std::max<ssize_t>(size, 0)));
  const std::size_t slash = path.rfind('/');
  if (slash != std::string_view::npos) path = path.substr(slash + 1);
  const std::size_t colon = path.find(':');
  return colon != std::string_view::npos ? path.substr(0, colon) : std::string_view();
}

char upper(char letter) {
  return letter >= 'a' && letter <= 'z' ? static_cast<char>(letter - 'a' + 'A') : letter;
}

bool is_serial_letter(char letter) {
  return (letter >= 'A' && letter <= 'Z') || (letter >= '0' && letter <= '9');
}

FixedText<63> plain(std::string_view serial) {
  FixedText<63> out;
  for (const char letter : serial) {
    const char big = upper(letter);
    if (is_serial_letter(big)) out += std::string_view(&big, 1);
  }
  return out;
}

// "2BNN-4ZE7", wherever it stands.
std::optional<std::string_view> serial_in(std::string_view product) {
  constexpr std::size_t kHalf = 4;
  constexpr std::size_t kLength = 2 * kHalf + 1;
  for (std::size_t at = 0; at + kLength <= product.size(); ++at) {
    const std::string_view word = product.substr(at, kLength);
    const bool alone = (at == 0 || product[at - 1] == ' ') &&
                       (at + kLength == product.size() || !is_serial_letter(product[at + kLength]));
    const std::string_view left = word.substr(0, kHalf);
    const std::string_view right = word.substr(kHalf + 1);
    if (alone && word[kHalf] == '-' && std::all_of(left.begin(), left.end(), is_serial_letter) &&
        std::all_of(right.begin(), right.end(), is_serial_letter)) {
      return word;
    }
  }
  return std::nullopt;
}

template <std::size_t kMost>
void append_number(FixedText<kMost>& text, std::uint32_t value, int base = 10, std::size_t width = 1) {
  std::array<char, 16> digits{};
  const auto [end, error] = std::to_chars(digits.data(), digits.data() + digits.size(), value, base);
  const auto size = static_cast<std::size_t>(end - digits.data());
  for (std::size_t i = size; i < width; ++i) text += "0";
  text += std::string_view(digits.data(), size);
}

// "'USB 2.0 Camera' (0c45:636d) at 1-1.3"
template <std::size_t kMost>
void append_device(FixedText<kMost>& text, const UsbDevice& device) {
  text += "'";
  text += device.product;
  text += "' (";
  append_number(text, device.vendor, 16, 4);
  text += ":";
  append_number(text, device.product_id, 16, 4);
  text += ") at ";
  text += device.path;
}

std::span<const UsbDevice> devices_of(const UsbCensus& census) {
  return std::span(census.devices).first(census.device_count);
}

template <std::size_t kMost, typename Wanted, typename Append>
void append_list(FixedText<kMost>& text, const UsbCensus& census, Wanted wanted, Append append) {
  int told = 0;
  for (const UsbDevice& device : devices_of(census)) {
    if (!wanted(device) || ++told > kDevicesTold) continue;
    if (told > 1) text += ", ";
    append(device);
  }
  if (told > kDevicesTold) text += ", and more";
}

bool is(const UsbDevice& device, Kinship kin) {
  return kinship(device) == kin;
}

bool is_called(const UsbDevice& device, std::string_view wanted) {
  const FixedText<63> name = plain(wanted);
  return serial_of(device).view() == name.view() || plain(device.serial).view() == name.view();
}

// Of no sensor that fits, or of several.
void tell_what_there_is(SensorSearch& search, const UsbCensus& census, std::string_view wanted, bool several) {
  FixedText<511>& text = search.message;
  const auto sensor = [](const UsbDevice& device) { return is(device, Kinship::kSensor); };
  const auto look_alike = [](const UsbDevice& device) { return is(device, Kinship::kLookAlike); };
  const auto any = [](const UsbDevice&) { return true; };
  const auto whole = [&](const UsbDevice& device) { append_device(text, device); };
  const auto short_form = [&](const UsbDevice& device) {
    text += serial_of(device);
    text += " at ";
    text += device.path;
  };
  const auto devices = devices_of(census);
  const auto count = std::count_if(devices.begin(), devices.end(), sensor);
  if (several) {
    search.result = Search::kSeveral;
    text += wanted.empty() ? "several GelSight Minis and no serial number given: " : "several GelSight Minis fit: ";
    append_list(text, census, sensor, short_form);
    text += ". Likely cause: two fingers on one board. Next: give the serial number of the one to use";
  } else if (count > 0) {
    search.result = Search::kOther;
    text += "no GelSight Mini ";
    text += wanted;
    text += "; there is ";
    append_list(text, census, sensor, short_form);
    text +=
        ". Likely cause: another sensor was plugged in. Next: plug in the right one, or give the serial number of "
        "the one that is there; its gel has to be learned anew";
  } else if (std::any_of(devices.begin(), devices.end(), look_alike)) {
    search.result = Search::kLookAlike;
    text += "no GelSight Mini; the same USB id has ";
    append_list(text, census, look_alike, whole);
    text += ". Likely cause: another camera with the same chip. Next: plug in the sensor; that camera may stay";
  } else {
    search.result = Search::kNone;
    text += "no GelSight Mini on USB; ";
    text += devices.empty() ? "no camera at all" : "there is ";
    append_list(text, census, any, whole);
    text += ". Likely cause: not plugged in, or a loose micro-USB connector. Next: plug it in, on a port of the board";
  }
}

}  // namespace

void take_census(const char* sysfs, UsbCensus& census) {
  census.device_count = census.node_count = 0;
  const auto folder = joined(sysfs, "class/video4linux");
  for_each_entry(folder.c_str(), [&](std::string_view name) {
    if (!name.starts_with("video") || census.node_count == census.nodes.size()) return;
    const auto node = joined(folder, name);
    census.nodes[census.node_count++] = {name, attribute(node, "name"), usb_path_of(node.c_str()),
                                         number(attribute(node, "index"), 10)};
  });
  const auto nodes = std::span(census.nodes).first(census.node_count);
  const auto devices = joined(sysfs, "bus/usb/devices");
  for_each_entry(devices.c_str(), [&](std::string_view name) {
    // An interface ("1-1.2:1.0") has none of a device's attributes, and falls through.
    if (census.device_count == census.devices.size()) return;
    const auto of = joined(devices, name);
    UsbDevice device;
    device.vendor = static_cast<std::uint16_t>(number(attribute(of, "idVendor"), 16));
    device.product_id = static_cast<std::uint16_t>(number(attribute(of, "idProduct"), 16));
    device.manufacturer = attribute(of, "manufacturer");
    device.product = attribute(of, "product");
    device.serial = attribute(of, "serial");
    device.path = name;
    device.bus = number(attribute(of, "busnum"), 10);
    device.address = number(attribute(of, "devnum"), 10);
    device.speed_mbit = number(attribute(of, "speed"), 10);
    const bool camera =
        std::any_of(nodes.begin(), nodes.end(), [&](const VideoNode& node) { return node.usb.view() == name; });
    if (camera || !is(device, Kinship::kStranger) || device.product.view().starts_with(kSensorName)) {
      census.devices[census.device_count++] = device;
    }
  });
}

Kinship kinship(const UsbDevice& device) {
  if (device.vendor != kSensorVendor || device.product_id != kSensorProduct) return Kinship::kStranger;
  return device.product.view().starts_with(kSensorName) ? Kinship::kSensor : Kinship::kLookAlike;
}

FixedText<63> serial_of(const UsbDevice& device) {
  return plain(serial_in(device.product).value_or(device.serial.view()));
}

const VideoNode* capture_node(const UsbCensus& census, const UsbDevice& device) {
  const auto nodes = std::span(census.nodes).first(census.node_count);
  const auto found = std::find_if(nodes.begin(), nodes.end(), [&](const VideoNode& node) {
    return node.usb.view() == device.path.view() && node.index == 0;
  });
  return found != nodes.end() ? &*found : nullptr;
}

SensorSearch find_sensor(const UsbCensus& census, std::string_view wanted) {
  SensorSearch search;
  const auto devices = devices_of(census);
  const auto fits = [&](const UsbDevice& device) {
    return is(device, Kinship::kSensor) && (wanted.empty() || is_called(device, wanted));
  };
  const auto found = std::find_if(devices.begin(), devices.end(), fits);
  const bool several = std::count_if(devices.begin(), devices.end(), fits) > 1;
  if (found == devices.end() || several) {
    tell_what_there_is(search, census, wanted, several);
    return search;
  }
  search.device = *found;
  search.serial = serial_of(*found);
  FixedText<511>& text = search.message;
  const VideoNode* const node = capture_node(census, *found);
  if (node == nullptr) {
    search.result = Search::kNoNode;
    text += "GelSight Mini ";
    text += search.serial;
    text += " at ";
    text += found->path;
    text +=
        " has no video node. Likely cause: uvcvideo is not loaded, or gave up on it. Next: modprobe uvcvideo, see "
        "the kernel log, or `holdfast-sensor reset ";
    text += search.serial;
    text += "`";
    return search;
  }
  search.result = Search::kFound;
  search.node += "/dev/";
  search.node += node->name;
  if (found->speed_mbit != 0 && found->speed_mbit < kHighSpeed_mbit) {
    text += "GelSight Mini ";
    text += search.serial;
    text += " at ";
    text += found->path;
    text += " runs at ";
    append_number(text, found->speed_mbit);
    text +=
        " Mb/s instead of 480. Likely cause: a full-speed hub, or a cable without good data wires. Next: a port of "
        "the board itself, another cable";
  }
  return search;
}

}  // namespace holdfast::drivers
