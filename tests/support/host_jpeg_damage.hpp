// SPDX-License-Identifier: Apache-2.0
// What damaged frames do to the tracking: frames of a simulated drag, damaged in transit, through the decoders and
// the firmware's tracker, in great numbers.
//
// A frame is encoded as the camera does it (4:2:2, quality 85), damaged in one place of its scan data, and decoded. It
// is rejected, or accepted and identical to the undamaged one in every pixel, or accepted and different. Different
// frames go on into the tracker as it was after the frame before; what passes the firmware's own checks there (enough
// markers) and moves a valid marker by more than kHarmPx is harmful.
//
// The firmware decodes 3280x2464 at 1/8 by its own decoder, asks vision/picture_check whether the picture can be what
// was sent, and decodes 640x480 at 1/2 by libjpeg-turbo (vision/luma_input). So at 3280x2464 two verdicts are counted:
// our decoder's, and that of decoder and check, which decides. At 640x480 three: the library's, which decides, our
// decoder's at 1/8 on the same bytes, and the library's with ours as a gate: accepted by both.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/sim/scene/picture/render.hpp"
#include "tests/support/host_jpeg_streams.hpp"
#include "vision/jpeg.hpp"
#include "vision/picture_check.hpp"
#include "vision/tracker.hpp"

namespace holdfast::test {

// Pixels of the working image.
inline constexpr double kHarmPx = 0.5;

enum class Damage {
  kLost512,           // bytes missing, as when USB packets are lost
  kZeroed512,         // the same, when the driver leaves the gap in
  kLost3072,          // a whole payload
  kTruncated,         // the rest of the frame missing,
  kTruncatedWithEnd,  // or replaced by EOI
  kBitFlipped,
  kByteChanged,
};
inline constexpr std::array kDamages{Damage::kLost512,    Damage::kZeroed512,        Damage::kLost3072,
                                     Damage::kTruncated,  Damage::kTruncatedWithEnd, Damage::kBitFlipped,
                                     Damage::kByteChanged};

[[nodiscard]] std::string_view name(Damage damage);
// Payload that did not come: the fault of USB cameras, of which none may pass. Changed bits are USB's own CRC to find.
[[nodiscard]] constexpr bool is_loss(Damage damage) {
  return damage < Damage::kBitFlipped;
}
// In one random place of the scan data. Range: more than 3072 bytes of it.
[[nodiscard]] Bytes damaged(const Bytes& whole, Damage damage, Random& random);

// One undamaged frame and what the firmware makes of it.
struct Shot {
  Bytes bytes;
  Bytes eighth;                                     // luma at 1/8 by our decoder
  Bytes working;                                    // the working image
  std::shared_ptr<const tracker::State> before;     // the tracker as the frame finds it
  picture_check::State check_before;                // the same of the check; at 3280 only
  std::array<scene::PointPx, kMaxMarkers> centres;  // where the tracker then sees the markers
};

// The first `shots` frames of a slow drag at 8 frames a second (25 in all); a restart marker every `restart_interval`
// MCUs.
struct DamagedFilm {
  int width = 640;  // 640 or 3280
  int restart_interval = 0;
  DecodeScale scale = DecodeScale::kHalf;
  std::vector<Shot> shots;
  std::string error;  // not empty: the firmware could not track the undamaged film
};
[[nodiscard]] DamagedFilm film(int width, int restart_interval, int shots);

struct Tally {
  long rejected = 0;
  long identical = 0;
  long different = 0;
  long harmful = 0;  // of the different
};

struct DamageFigures {
  long frames = 0;
  Tally ours;     // harmful is counted where the firmware works on our picture: at 3280
  Tally checked;  // what the firmware uses (ours at 3280, the library at 640), and the check. Fewer identical ones than
                  // ours: rejected though whole
  Tally library;  // at 640 only, as the next
  Tally both;
  // Lost payload that our decoder, or at 640 both decoders, took for a frame, and that made a difference.
  long losses_passed = 0;
};

// Frames number `first` to first + count - 1 of this kind of damage; each depends on film, damage, seed and number
// alone, so the figures do not depend on `threads`. Losses passed are written to `keep` unless it is empty.
[[nodiscard]] DamageFigures judge(const DamagedFilm& film, Damage damage, long first, long count, std::uint32_t seed,
                                  int threads, const std::filesystem::path& keep = {});
DamageFigures& operator+=(DamageFigures& sum, const DamageFigures& more);

}  // namespace holdfast::test
