// SPDX-License-Identifier: Apache-2.0
// Finds the frames of a recording that show the empty gel.
//
// Frames at rest are compared with each other, not with a threshold. An object adds relief to the picture between the
// dots and bends their lattice; print, lens and noise have nothing to do with either. So for two pictures a and b
//   t = (|a|^2 - |b|^2) / |a - b|^2
// is near +1 where a is loaded and b is not, near -1 the other way round, and between them where both are, whatever the
// size of the load. |.|^2 is the gradient energy of the picture on the gel, or the energy of the lattice's second
// differences. Each pair of intervals votes, as far as its difference stands out of the noise; the interval that most
// others are loaded against is the empty one.
//
// On the 200 recordings of ../shared/data (2026-11-25, in-sample: the constants were set on them) tests/bench/rest.sh
// counts how often it is right. Not seen: a touch that neither presses relief in nor bends the lattice (a bag of
// peanuts, straws); an object that stays in every frame and has no relief. It then says that it is not clear.
#pragma once

#include <functional>

#include "app/pipeline.hpp"
#include "drivers/sim/recording.hpp"
#include "vision/jpeg_decoder.hpp"

namespace holdfast::tool {

struct EmptyGel {
  long first = 0, last = 0;  // frames at rest
  long frame = 0;            // of them, the one to take
  bool at_rest = true;       // false: nothing rests in this recording, and `frame` is its first that shows the lattice
  bool clear = false;        // something is loaded beside them
};

// Reads the recording from its start and rewinds it. Price: one pass more. `progress`: frames read; false stops.
// Range: any recording; of a long one 48 intervals spread over it are compared.
[[nodiscard]] sim::Result<EmptyGel> find_empty_gel(sim::Recording& recording, const pipeline::Config& config,
                                                   JpegDecoder& jpeg, const std::function<bool(long)>& progress);

}  // namespace holdfast::tool
