// SPDX-License-Identifier: Apache-2.0
// Our topics on DDS as a ROS 2 node would have them, by Cyclone DDS. Writers: reliable, volatile, keep last 10, which
// every subscriber of ROS matches, also one that asks for best effort ("sensor data"). The reader of commands likewise.
#pragma once

#include <dds/dds.h>

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "toolchain/log/messages.hpp"

namespace holdfast::ros2 {

struct Command {
  std::uint8_t command = 0, argument = 0;
};

struct Diagnosis {
  enum class Level : std::uint8_t { kOk = 0, kWarn = 1, kError = 2, kStale = 3 };  // of diagnostic_msgs
  Level level = Level::kStale;
  std::string name, message, hardware;
  std::vector<std::pair<std::string, std::string>> values;
};

class Dds {
 public:
  Dds() = default;
  ~Dds();
  Dds(const Dds&) = delete;
  Dds& operator=(const Dds&) = delete;

  // `commands`: take them, too. Empty, or what is wrong in one line.
  [[nodiscard]] std::string open(std::uint32_t domain, bool commands);

  void write(const log::FrameRecord& record);
  void write(const log::MarkerField& field);
  void write(const log::CompressedImage& picture);
  void write(const log::Time& stamp, const Diagnosis& diagnosis);
  void write_answer(Command command, std::uint8_t result, const char* result_name);
  [[nodiscard]] std::optional<Command> take_command() const;

  // Writes that the library refused, as when a reliable reader does not keep up.
  [[nodiscard]] std::uint64_t refused() const { return refused_; }

 private:
  [[nodiscard]] dds_entity_t writer(const dds_topic_descriptor_t& type, const char* topic) const;
  void put(dds_entity_t writer, const void* sample);

  dds_entity_t participant_ = 0, slip_ = 0, markers_ = 0, camera_ = 0, diagnostics_ = 0, answers_ = 0, commands_ = 0;
  std::uint64_t refused_ = 0;
};

}  // namespace holdfast::ros2
