// SPDX-License-Identifier: Apache-2.0
#include "toolchain/log/frame_reader.hpp"

#include <fmt/format.h>

namespace holdfast::log {
namespace {

template <IsMessage T>
bool is_ours(const McapFile& file, const McapChannel& channel) {
  static const std::string text = schema_text<T>();
  const auto schema = file.schemas.find(channel.schema);
  return schema != file.schemas.end() && schema->second.encoding == "ros2msg" && channel.encoding == "cdr" &&
         schema->second.name == schema_name<T>() && schema->second.text == text;
}

}  // namespace

McapFile read_frames(std::span<const std::uint8_t> bytes, const FrameVisit& visit) {
  std::vector<McapFault> faults;
  const auto add_fault = [&](const McapMessage& message, const char* what) {
    if (faults.size() < McapFile::kMostFaults) {
      faults.push_back({static_cast<std::uint64_t>(message.data.data() - bytes.data()), what});
    }
  };
  const auto give = [&]<IsMessage T>(const McapFile& file, const McapMessage& message, std::string_view topic,
                                     const std::function<void(const T&)>& to) {
    const McapChannel& channel = file.channels.at(message.channel);
    if (channel.topic != topic) return;
    if (!is_ours<T>(file, channel)) return add_fault(message, "a message of ours by another schema");
    const std::optional<T> decoded = decode<T>(message.data);
    if (!decoded) return add_fault(message, "a message that is not what its schema says");
    if (to) to(*decoded);
  };
  McapFile file = read_mcap(bytes, [&](const McapFile& so_far, const McapMessage& message) {
    give(so_far, message, kSlipTopic, visit.slip);
    give(so_far, message, kCameraTopic, visit.picture);
    give(so_far, message, kMarkersTopic, std::function<void(const MarkerField&)>{});
    give(so_far, message, kAnnotationsTopic, std::function<void(const ImageAnnotations&)>{});
  });
  for (McapFault& fault : faults) {
    if (file.faults.size() < McapFile::kMostFaults) file.faults.push_back(std::move(fault));
  }
  return file;
}

std::string fault_line(const std::string& path, const McapFile& file) {
  const McapFault& first = file.faults.front();
  const char* cause = "the file was changed or damaged after it was written";
  const char* next = "copy it again, or record it again";
  if (first.at == 0) {
    cause = "another kind of file";
    next = "give what --mcap wrote";
  } else if (!file.whole) {
    cause = "an interrupted copy, or a recorder that was killed";
  } else if (first.what.find("another schema") != std::string::npos) {
    cause = "written by another version of holdfast";
    next = "read it with that version";
  } else if (first.what.find("compressed") != std::string::npos) {
    cause = "written by another program";
    next = "write it again without compression";
  }
  return fmt::format("{}: {} (at byte {}). Likely cause: {}. Next: {}", path, first.what, first.at, cause, next);
}

}  // namespace holdfast::log
