// SPDX-License-Identifier: Apache-2.0
// The noise of a given gel at rest, and whether a model's thresholds stand clear of it.
//
// At rest each feature has a distribution of its own: of tracking noise, of the light, of the codec. A threshold
// inside it turns noise into verdicts. Distance is told in sigmas, a sigma being the larger of the standard deviation
// and the spread that outliers do not move (1.4826 times the median distance from the median): dE/dt of a still gel
// is 0 in most frames, where the second is 0 and the first is not.
// Six sigmas: noise that is normal crosses them once in 10^9 frames, 500 days at 25 fps.
//
// Which thresholds count: those that rest frames come to, and at which the way that they do not take can end in slip.
// Frames on both sides of a threshold are its noise, too, but no harm as long as both ways end in hold: what may
// happen further down is told by the thresholds there.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "app/pipeline.hpp"
#include "toolchain/learn/samples.hpp"
#include "toolchain/treec/tree_model.hpp"

namespace holdfast::learn {

inline constexpr double kClearSigmas = 6.0;
inline constexpr double kCloseSigmas = 3.0;

// One feature at rest, raw.
struct RestFigures {
  double mean = 0.0;
  double deviation = 0.0;
  double median = 0.0;
  double robust = 0.0;  // 1.4826 times the median distance from the median
  std::int32_t least = 0;
  std::int32_t most = 0;

  [[nodiscard]] double sigma() const { return deviation > robust ? deviation : robust; }
};
[[nodiscard]] RestFigures figures_of(std::span<const Features> rest, int feature);

// Takes frames of a gel that nothing should touch.
class RestStudy {
 public:
  // `state` and `config`: of the pipeline that made `result` of the frame. Left out are frames without a rest position,
  // and a quarter of a second after the first with one: rates and memories still start from 0 there.
  void add(long frame, const pipeline::Result& result, const pipeline::State& state, const pipeline::Config& config);

  [[nodiscard]] std::span<const Features> rest() const { return rest_; }
  [[nodiscard]] long frames() const { return frames_; }  // seen
  // Frames in which more than a tenth of the markers were off their rest by more than the firmware calls still
  // (tactile/reference.hpp): something touches.
  [[nodiscard]] std::span<const long> moved() const { return moved_; }
  // Standard deviation about each marker's own mean, over all markers, um; 1 um is the unit of the firmware.
  struct Jitter {
    double x_um = 0.0;
    double y_um = 0.0;
    double worst_um = 0.0;  // of one marker's coordinate
  };
  [[nodiscard]] Jitter jitter() const;

 private:
  struct Sums {
    long count = 0;
    double x = 0, y = 0, xx = 0, yy = 0;
  };

  std::vector<Features> rest_;
  std::vector<long> moved_;
  long frames_ = 0;
  std::optional<Micros> first_;  // with a rest position
  std::array<Sums, kMaxMarkers> sums_{};
};

enum class Clearance : std::uint8_t {
  kClear,     // kClearSigmas and more; or no noise at all, and one step of the feature does not flip it
  kClose,     // less
  kInside,    // below kCloseSigmas; or frames on both sides, and one of them says slip
  kNoMatter,  // rest frames do not come here, or hold whichever way they go
};
[[nodiscard]] std::string_view name_of(Clearance clearance);

struct ThresholdCheck {
  int node = 0;     // id in the model
  int feature = 0;  // of kFeatures
  std::int32_t threshold = 0;
  long below = 0;  // rest frames that came here with x <= threshold, and with x above it
  long above = 0;
  // Steps by which the nearest rest frame would have to change to go the other way; 0: some go either way.
  std::int64_t margin = 0;
  std::optional<double> sigmas;  // from the mean of the frames that came here to the threshold; none: no noise
  Clearance clearance = Clearance::kNoMatter;
};

struct LeafCheck {
  int node = 0;
  Verdict verdict = Verdict::kHold;
  long frames = 0;  // rest frames that end here
};

struct ModelCheck {
  std::vector<ThresholdCheck> thresholds;  // in the order of the model
  std::vector<LeafCheck> leaves;

  [[nodiscard]] Clearance worst() const;   // kClear when nothing matters
  [[nodiscard]] long slip_frames() const;  // rest frames that the model calls slip
};

// Range: a checked model (treec::check), at least one frame.
[[nodiscard]] ModelCheck check_rest(const treec::Model& model, std::span<const Features> rest);

// The text of the tree that is compiled into this build.
[[nodiscard]] std::string_view compiled_model_text();
// A tree of the paper's four features, which stays at hand beside it.
[[nodiscard]] std::string_view paper_model_text();

}  // namespace holdfast::learn
