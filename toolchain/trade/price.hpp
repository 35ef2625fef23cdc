// SPDX-License-Identifier: Apache-2.0
// What one setting costs and gains, measured: time, memory, and what is left of the truth.
//
// Time is thread CPU time of this machine, median over the frames; ratios are what may be compared between machines. Of
// several threads it is the critical path's, in frames whose helpers came in time (play/timed_crew.hpp).
// Marker error: RMS over all markers and frames of the films, in px of a picture 320 wide. Error of E: mean of |E minus
// the E of the true displacements in the same bins|. Decisions are counted on recordings, as in learn/clip_score.hpp:
// films are too few for them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>

#include "toolchain/learn/clip_score.hpp"
#include "toolchain/learn/dataset.hpp"
#include "toolchain/trade/film.hpp"
#include "toolchain/trade/knobs.hpp"

namespace holdfast::trade {

// Of the films: from the JPEG's bytes on.
struct PictureTally {
  double us_p50 = 0.0;  // a frame, all of it
  double us_p99 = 0.0;
  double decode_us_p50 = 0.0;
  double rms_px = 0.0;
  long missed = 0;    // markers, of all frames
  long rejected = 0;  // frames
  long frames = 0;
  // Of pictures whose bytes were lost in one place, those that are taken for whole all the same.
  long damaged = 0;
  long damaged_used = 0;
  std::optional<double> entropy_error_nat;  // nothing: a rival, or no frame had a reference
};

struct Price {
  std::int64_t memory_bytes = 0;     // of the pipeline and the decoder with the pictures that this setting works on
  std::optional<PictureTally> seen;  // rms and entropy mean nothing when all was rejected
  std::optional<learn::ClipScore> recorded;
};

// One setting on trial. Whoever tries several shows each frame to all of them by turns: what the machine does meanwhile
// meets all alike.
class Trialled {
 public:
  explicit Trialled(const Point& point);
  ~Trialled();
  Trialled(Trialled&&) noexcept;
  Trialled& operator=(Trialled&&) = delete;
  Trialled(const Trialled&) = delete;
  Trialled& operator=(const Trialled&) = delete;

  // Frame k = 0, 1, ... of a film through the pipeline. Nothing happens when the point needs pictures of another width.
  void show(const Film& film, std::size_t k);
  // A recording likewise, with the lattice that is found in it; a setting that finds no rest position detects nothing.
  // Nothing happens when the point needs other pictures, or is a rival.
  void show(const learn::RecordedClip& clip);
  [[nodiscard]] Price price() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace holdfast::trade
