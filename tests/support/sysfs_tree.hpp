// SPDX-License-Identifier: Apache-2.0
// A piece of /sys in a folder, laid out as the kernel does it: classes and buses are links into devices/.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "tests/support/temp_dir.hpp"

namespace holdfast::test {

struct UsbCamera {
  std::string path;  // "1-1.2"
  std::string id = "0c45:636d";
  std::string product = {};
  std::string serial = {};
  std::string manufacturer = "Arducam Technology Co., Ltd.";
  std::string speed = "480";
  int first_node = -1;    // videoN of the picture, and N + 1 of its metadata; -1: no driver
  std::string card = {};  // empty: the product, cut as the kernel cuts it
};

class SysfsTree {
 public:
  SysfsTree() {
    std::filesystem::create_directories(dir_ / "bus/usb/devices");
    std::filesystem::create_directories(dir_ / "class/video4linux");
    // What every machine has beside: a root hub, and a camera port that is not on USB.
    device("usb1", {{"idVendor", "1d6b"}, {"idProduct", "0002"}, {"product", "xHCI Host Controller"}});
    node("platform/soc:csi", 10, "bcm2835-codec", "0");
  }

  [[nodiscard]] std::string root() const { return dir_.path().string(); }

  void plug(const UsbCamera& camera) {
    device(camera.path, {{"idVendor", camera.id.substr(0, 4)},
                         {"idProduct", camera.id.substr(5)},
                         {"product", camera.product},
                         {"serial", camera.serial},
                         {"manufacturer", camera.manufacturer},
                         {"speed", camera.speed},
                         {"busnum", camera.path.substr(0, 1)},
                         {"devnum", "7"}});
    const std::string interface = "usb1/" + camera.path + "/" + camera.path + ":1.0";
    std::filesystem::create_directories(dir_ / ("devices/" + interface));
    link("bus/usb/devices/" + camera.path + ":1.0", "devices/" + interface);
    if (camera.first_node < 0) return;
    const std::string card = camera.card.empty() ? (camera.product + ": " + camera.product).substr(0, 31) : camera.card;
    node(interface, camera.first_node, card, "0");
    node(interface, camera.first_node + 1, card, "1");
  }
  void unplug(const std::string& path) {
    std::filesystem::remove(dir_ / ("bus/usb/devices/" + path));
    std::filesystem::remove(dir_ / ("bus/usb/devices/" + path + ":1.0"));
    for (const auto& entry : std::filesystem::directory_iterator(dir_ / "class/video4linux")) {
      if (std::filesystem::read_symlink(entry.path()).string().find("/" + path + "/") != std::string::npos) {
        std::filesystem::remove(entry.path());
      }
    }
    std::filesystem::remove_all(dir_ / ("devices/usb1/" + path));
  }

 private:
  void put(const std::string& file, std::string_view text) { write_file(dir_ / file, std::string(text) + "\n"); }
  void link(const std::string& from, const std::string& to) {
    std::filesystem::remove(dir_ / from);
    std::filesystem::create_symlink(dir_ / to, dir_ / from);
  }
  void device(const std::string& path, std::initializer_list<std::pair<const char*, std::string>> attributes) {
    const std::string folder = path == "usb1" ? "devices/usb1" : "devices/usb1/" + path;
    std::filesystem::create_directories(dir_ / folder);
    for (const auto& [name, text] : attributes) {
      if (!text.empty()) put(folder + "/" + name, text);  // a device without a serial number has no such file
    }
    link("bus/usb/devices/" + path, folder);
  }
  void node(const std::string& parent, int number, const std::string& card, const std::string& index) {
    const std::string name = "video" + std::to_string(number);
    const std::string folder = "devices/" + parent + "/video4linux/" + name;
    std::filesystem::create_directories(dir_ / folder);
    put(folder + "/name", card);
    put(folder + "/index", index);
    // Relative, as in the kernel: "../../../1-1.2:1.0".
    const std::filesystem::path own = parent;
    std::filesystem::remove(dir_ / (folder + "/device"));
    std::filesystem::create_symlink("../../../" + own.filename().string(), dir_ / (folder + "/device"));
    link("class/video4linux/" + name, folder);
  }

  TempDir dir_;
};

}  // namespace holdfast::test
