// SPDX-License-Identifier: Apache-2.0
#include "toolchain/log/recording_file.hpp"

#include <fmt/format.h>

#include <memory>
#include <utility>
#include <vector>

#include "drivers/sim/container.hpp"
#include "toolchain/log/frame_reader.hpp"

namespace holdfast::log {

sim::Result<sim::Recording> open_recording(const std::filesystem::path& path, sim::RecordingOptions options) {
  const sim::MappedFile mapped(path);
  const auto bytes = mapped.bytes();
  if (!is_mcap(bytes)) return sim::Recording::open(path, std::move(options));
  std::vector<sim::StampedPicture> pictures;
  FrameVisit visit;
  visit.picture = [&](const CompressedImage& picture) {
    const Time& stamp = picture.header.stamp;
    pictures.push_back({static_cast<std::size_t>(picture.data.data() - bytes.data()), picture.data.size(),
                        Micros{std::int64_t{stamp.sec} * 1'000'000 + stamp.nanosec / 1000}});
  };
  const McapFile file = read_frames(bytes, visit);
  if (!file.faults.empty()) return sim::Error{fault_line(path.string(), file)};
  if (pictures.empty()) {
    return sim::Error{fmt::format(
        "{}: has no {}. Likely cause: it was made of a recording without JPEG pictures. Next: give that recording",
        path.string(), kCameraTopic)};
  }
  // Counted from the first, so that the wall clock's seconds cost no digits.
  const Micros first = pictures.front().time;
  for (sim::StampedPicture& picture : pictures) picture.time -= first;
  options.pictures = std::make_shared<const std::vector<sim::StampedPicture>>(std::move(pictures));
  return sim::Recording::open(path, std::move(options));
}

}  // namespace holdfast::log
