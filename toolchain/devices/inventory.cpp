// SPDX-License-Identifier: Apache-2.0
#include "toolchain/devices/inventory.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <linux/gpio.h>
#include <sys/ioctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <filesystem>
#include <fstream>
#include <memory>
#include <span>
#include <string_view>
#include <system_error>

#include "drivers/linux/usb_sensor.hpp"

namespace holdfast::devices {
namespace {

namespace fs = std::filesystem;

std::string line_of(const fs::path& path) {
  std::ifstream in(path);
  std::string line;
  std::getline(in, line);
  while (!line.empty() && (line.back() == '\0' || line.back() == ' ')) line.pop_back();
  return line;
}

bool there(const fs::path& path) {
  std::error_code ignored;
  return fs::exists(path, ignored);
}

long number_of(std::string_view text, long otherwise) {
  long value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc{} ? value : otherwise;
}

// The names in a folder that start so, by number: video2 before video10.
std::vector<std::string> names_in(const fs::path& folder, std::string_view prefix) {
  std::vector<std::string> names;
  std::error_code error;
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    if (std::string name = at->path().filename().string(); name.starts_with(prefix)) names.push_back(std::move(name));
  }
  std::ranges::sort(names, [&](const std::string& a, const std::string& b) {
    const auto key = [](const std::string& name) {
      const std::size_t digits = name.find_first_of("0123456789");
      const std::string_view tail = std::string_view(name).substr(std::min(digits, name.size()));
      return std::pair(name.substr(0, digits), number_of(tail, -1));
    };
    return key(a) < key(b);
  });
  return names;
}

void judge(Item& item, Verdict verdict, std::string what, std::string fix = {}) {
  item.verdict = verdict;
  item.what = std::move(what);
  item.fix = std::move(fix);
}

// A device that cannot be opened is wrong whatever else it is.
void judge_rights(const Places& places, Item& item, std::string_view group) {
  if (item.verdict == Verdict::kNote || places.may_use(item.path)) return;
  judge(item, Verdict::kWrong, "no right to use it",
        fmt::format("add yourself to the group {} (sudo usermod -aG {} $USER) and log in again", group, group));
}

}  // namespace

Places this_computer() {
  Places places;
  places.chip = [](const std::string& path) -> std::optional<ChipName> {
    const int fd = ::open(path.c_str(), O_RDWR | O_CLOEXEC);
    if (fd < 0) return std::nullopt;
    gpiochip_info info{};
    const bool asked = ::ioctl(fd, GPIO_GET_CHIPINFO_IOCTL, &info) == 0;
    ::close(fd);
    if (!asked) return std::nullopt;
    return ChipName{info.label, info.lines};
  };
  places.may_use = [](const std::string& path) { return ::access(path.c_str(), R_OK | W_OK) == 0; };
  return places;
}

std::vector<Item> cameras(const Places& places) {
  using drivers::Kinship;
  const auto census = std::make_unique<drivers::UsbCensus>();
  drivers::take_census(places.sys.c_str(), *census);
  std::vector<Item> items;
  std::size_t sensors = 0;
  std::vector<std::string> buses;  // of the sensors
  for (const drivers::VideoNode& node : std::span(census->nodes).first(census->node_count)) {
    const auto devices = std::span(census->devices).first(census->device_count);
    const auto device = std::ranges::find_if(
        devices, [&](const drivers::UsbDevice& one) { return one.path.view() == node.usb.view(); });
    const bool on_usb = device != devices.end() && !node.usb.empty();
    Item item{.kind = "camera",
              .path = places.dev + "/" + std::string(node.name.view()),
              .name = std::string(on_usb ? device->product.view() : node.card.view())};
    const Kinship kin = on_usb ? kinship(*device) : Kinship::kStranger;
    if (kin == Kinship::kStranger) {
      judge(item, Verdict::kNote, "another camera: it is left alone");
    } else if (kin == Kinship::kLookAlike) {
      judge(item, Verdict::kWrong, "has a GelSight's USB id 0c45:636d, but is none",
            "plug in the GelSight Mini; this one is refused by its name");
    } else if (node.index != 0) {
      judge(item, Verdict::kNote, "the sensor's metadata: pictures come from its first node");
    } else {
      ++sensors;
      const std::string serial(serial_of(*device).view());
      item.facts = {{"serial", serial},
                    {"speed_mbit_s", fmt::format("{}", device->speed_mbit)},
                    {"usb_bus", fmt::format("{}", device->bus)}};
      buses.push_back(item.facts[2].second);
      judge(item, Verdict::kGood, fmt::format("serial {}, {} Mb/s", serial, device->speed_mbit));
      if (device->speed_mbit < drivers::kHighSpeed_mbit) {
        judge(item, Verdict::kWrong, fmt::format("runs at {} Mb/s: too slow for its pictures", device->speed_mbit),
              "give it a USB 2 port of its own, without a hub, and a short cable");
      }
      judge_rights(places, item, "video");
    }
    items.push_back(std::move(item));
  }
  std::ranges::sort(items, {}, [](const Item& item) { return std::pair(item.path.size(), item.path); });
  if (sensors > 1) {
    for (Item& item : items) {
      if (item.verdict != Verdict::kGood) continue;
      const std::string& serial = item.facts[0].second;
      item.what += "; it is not the only one";
      item.fix =
          fmt::format("say which: holdfastd --sensor {0}, or of two fingers --sensor LEFT --right RIGHT", serial);
      const std::string& bus = item.facts[2].second;
      if (std::ranges::count(buses, bus) < 2) continue;
      item.what += fmt::format("; on USB bus {} with another", bus);
      item.fix += "; if the second one does not start, give it a USB controller of its own";
    }
  }
  if (sensors > 0) return items;
  Item none{.kind = "camera", .path = {}, .name = std::string(drivers::kSensorName)};
  judge(none, Verdict::kWrong, "not there", "plug it in; if it is, look at its micro-USB plug, which works loose");
  if (const drivers::SensorSearch search = find_sensor(*census, {}); search.result == drivers::Search::kNoNode) {
    none.name = std::string(search.device.product.view());
    judge(none, Verdict::kWrong, "is on USB, but has no video node", "load its driver: sudo modprobe uvcvideo");
  }
  items.push_back(std::move(none));
  return items;
}

std::vector<Item> gpio_chips(const Places& places) {
  std::vector<Item> items;
  for (const std::string& name : names_in(places.dev, "gpiochip")) {
    Item item{.kind = "gpio", .path = places.dev + "/" + name, .name = name};
    const std::optional<ChipName> chip = places.chip(item.path);
    if (chip) {
      item.name = chip->label;
      item.facts = {{"lines", fmt::format("{}", chip->lines)}};
      // Of a Pi 1 to 3, a Pi 4, a Pi 5.
      const bool header =
          chip->label == "pinctrl-bcm2835" || chip->label == "pinctrl-bcm2711" || chip->label == "pinctrl-rp1";
      judge(item, header ? Verdict::kGood : Verdict::kNote,
            fmt::format("{} lines{}", chip->lines, header ? ", the 40-pin header" : ""));
    } else {
      judge(item, Verdict::kGood, "a chip");
      judge_rights(places, item, "gpio");
      if (item.verdict == Verdict::kGood) judge(item, Verdict::kWrong, "does not say what it is", "look at dmesg");
    }
    items.push_back(std::move(item));
  }
  if (items.empty()) {
    Item none{.kind = "gpio", .path = {}, .name = "GPIO chips"};
    judge(none, Verdict::kNote, "there are none: no GRIP_OK by wire from here",
          "use a board with a header, or an MCP2221A bridge on USB");
    items.push_back(std::move(none));
  }
  return items;
}

std::vector<Item> serial_ports(const Places& places) {
  std::vector<Item> items;
  const fs::path ttys = fs::path(places.sys) / "class/tty";
  const std::string consoles = line_of(ttys / "console/active");
  const fs::path by_id = fs::path(places.dev) / "serial/by-id";
  for (const char* prefix : {"ttyUSB", "ttyACM", "ttyAMA", "ttyS"}) {
    for (const std::string& name : names_in(ttys, prefix)) {
      const fs::path here = ttys / name;
      // A place for a chip that is not there.
      if (!there(here / "device") || line_of(here / "type") == "0") continue;
      Item item{.kind = "serial", .path = places.dev + "/" + name, .name = name};
      for (const std::string& link : names_in(by_id, "")) {
        std::error_code ignored;
        if (fs::read_symlink(by_id / link, ignored).filename() == name) item.name = (by_id / link).string();
      }
      const std::string latency = line_of(here / "device/latency_timer");
      if (!latency.empty()) item.facts.emplace_back("latency_ms", latency);
      judge(item, Verdict::kGood, item.name == name ? "a port" : "name it so: its number changes");
      if (number_of(latency, 1) > 1) item.what += fmt::format("; collects input for {} ms until it is used", latency);
      const std::string padded = " " + consoles + " ";
      if (padded.find(" " + name + " ") != std::string::npos) {
        judge(item, Verdict::kNote, "the kernel's console writes to it: not for a gripper or a link",
              fmt::format("to use it, take console={} out of the kernel's command line (cmdline.txt) and boot again",
                          name));
      }
      judge_rights(places, item, "dialout");
      items.push_back(std::move(item));
    }
  }
  return items;
}

std::vector<Item> bridges(const Places& places) {
  std::vector<Item> items;
  const fs::path raws = fs::path(places.sys) / "class/hidraw";
  for (const std::string& name : names_in(raws, "hidraw")) {
    std::ifstream in(raws / name / "device/uevent");
    bool bridge = false;
    std::string driver;
    for (std::string line; std::getline(in, line);) {
      bridge = bridge || line.find(":000004D8:000000DD") != std::string::npos;
      if (line.starts_with("DRIVER=")) driver = line.substr(7);
    }
    if (!bridge) continue;
    Item item{.kind = "bridge", .path = places.dev + "/" + name, .name = "MCP2221A"};
    item.facts = {{"driver", driver}};
    judge(item, Verdict::kGood, "four lines over USB");
    if (driver == "mcp2221") {
      judge(item, Verdict::kNote, "the kernel's own driver has it: its lines are a GPIO chip",
            "use that chip, or take the driver off: sudo modprobe -r hid_mcp2221");
    }
    judge_rights(places, item, "plugdev");
    items.push_back(std::move(item));
  }
  return items;
}

std::vector<Item> inventory(const Places& places) {
  std::vector<Item> all = cameras(places);
  for (const auto& some : {gpio_chips(places), serial_ports(places), bridges(places)}) {
    all.insert(all.end(), some.begin(), some.end());
  }
  return all;
}

std::vector<Item> system_state(const Places& places) {
  std::vector<Item> items;
  const auto add = [&](std::string name) -> Item& {
    Item& item = items.emplace_back();
    item.kind = "system";
    item.name = std::move(name);
    return item;
  };
  // Four buffers of 16 MB, the firmware's 5 MB, and room to breathe.
  constexpr long kLeastKb = 128 * 1024;
  std::ifstream memory(fs::path(places.proc) / "meminfo");
  long available_kb = 0;
  for (std::string word; memory >> word;) {
    if (word == "MemAvailable:") memory >> available_kb;
  }
  Item& room = add("memory");
  judge(room, Verdict::kGood, fmt::format("{} MB free", available_kb / 1024));
  if (available_kb < kLeastKb) judge(room, Verdict::kWrong, room.what, "end something: the camera takes 64 MB");

  // Raspberry Pi: bits 0 and 16, under-voltage now and since boot; 2 and 18, slowed down.
  if (const std::string throttled = line_of(fs::path(places.sys) / "devices/platform/soc/soc:firmware/get_throttled");
      !throttled.empty()) {
    unsigned long bits = 0;
    (void)std::from_chars(throttled.data(), throttled.data() + throttled.size(), bits, 16);
    Item& power = add("power");
    judge(power, Verdict::kGood, "no under-voltage since boot");
    if ((bits & 0x10001) != 0) {
      judge(power, Verdict::kWrong, "under-voltage since boot: USB frames come torn",
            "use the 5.1 V, 3 A supply and a short cable");
    } else if ((bits & 0x40004) != 0) {
      judge(power, Verdict::kNote, "was slowed down since boot", "cool it");
    }
  }
  // What firmware on a board needs of its kernel. A computer without a device tree is no board.
  std::string board = line_of(fs::path(places.proc) / "device-tree/model");
  if (board.empty()) {
    judge(add("this computer"), Verdict::kGood, "no board: holdfast live and record show and record the sensor here");
    return items;
  }
  judge(add("board"), Verdict::kGood, std::move(board));
  const auto limit = [&](const char* name, int resource, rlim_t least, const char* fix) {
    rlimit now{};
    Item& item = add(name);
    if (::getrlimit(static_cast<__rlimit_resource>(resource), &now) == 0 && now.rlim_cur >= least) {
      judge(item, Verdict::kGood, "allowed");
    } else {
      judge(item, Verdict::kNote, "not allowed to this user", fix);
    }
  };
  limit("lock memory", RLIMIT_MEMLOCK, 128U * 1024 * 1024, "the unit holdfastd.service has LimitMEMLOCK=infinity");
  limit("run first", RLIMIT_RTPRIO, 50, "the unit holdfastd.service has CPUSchedulingPolicy=fifo");
  return items;
}

}  // namespace holdfast::devices
