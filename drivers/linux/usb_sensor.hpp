// SPDX-License-Identifier: Apache-2.0
// Which USB device is the GelSight Mini, and which /dev/videoN is its picture: from sysfs alone, so that looking needs
// no right to any device and disturbs none.
//
// The USB id says nothing: 0c45:636d is a chip that other cameras have too. The product name does ("GelSight Mini R0B
// 2BNN-4ZE7"), and the serial number in it, which is on the case, tells one sensor from another. Numbers of video nodes
// change with every plug; each sensor has two, and the one with index 0 is the picture, the other one metadata.
// No heap: a driver looks again after every unplugging.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "drivers/linux/fixed_text.hpp"

namespace holdfast::drivers {

inline constexpr std::uint16_t kSensorVendor = 0x0c45;
inline constexpr std::uint16_t kSensorProduct = 0x636d;
inline constexpr std::string_view kSensorName = "GelSight Mini";
inline constexpr std::uint32_t kHighSpeed_mbit = 480;  // what its one mode, MJPEG of 8 megapixels, needs

struct UsbDevice {
  std::uint16_t vendor = 0;
  std::uint16_t product_id = 0;
  FixedText<63> manufacturer;  // printable ASCII; other letters show as '?'
  FixedText<63> product;
  FixedText<63> serial;  // as its descriptor has it; may be empty
  FixedText<31> path;    // the kernel's: bus-port.port, "1-1.2"
  std::uint32_t bus = 0;
  std::uint32_t address = 0;
  std::uint32_t speed_mbit = 0;  // 12: full, 480: high, 5000: super; 0: unknown
};

struct VideoNode {
  FixedText<31> name;  // "video0"
  FixedText<63> card;
  FixedText<31> usb;        // path of its USB device; of another bus, no such path
  std::uint32_t index = 0;  // among the nodes of its interface; 0: the picture
};

// USB cameras, and whatever has the sensor's id or name; and all video nodes. More than fit are left out.
struct UsbCensus {
  std::array<UsbDevice, 32> devices;
  std::size_t device_count = 0;
  std::array<VideoNode, 64> nodes;
  std::size_t node_count = 0;
};

// `sysfs` is "/sys"; what is not there is not listed.
void take_census(const char* sysfs, UsbCensus& census);

enum class Kinship : std::uint8_t { kSensor, kLookAlike, kStranger };
[[nodiscard]] Kinship kinship(const UsbDevice& device);
// What is on the case, without the dash: "2BNN4ZE7"; from the product name, else from the descriptor's serial number.
[[nodiscard]] FixedText<63> serial_of(const UsbDevice& device);
// The node of its picture; nothing: no driver has made one.
[[nodiscard]] const VideoNode* capture_node(const UsbCensus& census, const UsbDevice& device);

enum class Search : std::uint8_t {
  kFound,
  kNoNode,     // the sensor is there, its video node is not
  kNone,       // nothing that looks like one
  kLookAlike,  // the USB id, and another product name
  kOther,      // sensors, but not the one asked for
  kSeveral,    // several, and none was asked for
};

struct SensorSearch {
  Search result = Search::kNone;
  UsbDevice device;        // kFound, kNoNode
  FixedText<63> serial;    // of `device`
  FixedText<47> node;      // kFound: "/dev/video0"
  FixedText<511> message;  // one line: what, likely cause, next step. kFound: empty, or what is not as it should be
};

// `wanted`: a serial number, with or without its dash, in any case; empty: whichever there is, if it is the only one.
[[nodiscard]] SensorSearch find_sensor(const UsbCensus& census, std::string_view wanted);

}  // namespace holdfast::drivers
