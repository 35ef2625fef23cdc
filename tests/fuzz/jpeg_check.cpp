// SPDX-License-Identifier: Apache-2.0
#include "tests/fuzz/jpeg_check.hpp"

#include <algorithm>
#include <array>

namespace holdfast::test {
namespace {

using jpeg_dc::Error;

// Reasons for which we refuse what the library takes without a word.
struct Stricter {
  Error error;
  bool fill_before_stuffing;  // only with FF FF 00, of which the library makes one FF; T.81 (B.1.1.5) knows FF 00 only
};
constexpr std::array kStricter{
    // Kinds of pictures that the camera never sends.
    Stricter{Error::kProcess, false}, Stricter{Error::kManyScans, false}, Stricter{Error::kColourSpace, false},
    Stricter{Error::kSampling, false},
    // Headers: the library passes over RSTn, TEM and DNL, over APPn and COM of length 0 and 1, and takes a DC
    // divisor of 0.
    Stricter{Error::kStrayMarker, false}, Stricter{Error::kSegmentLength, false}, Stricter{Error::kQuantTable, false},
    // Data: it takes symbols that mean nothing for the end of the block, drops coefficients past the last and bytes
    // left over, lets the level go anywhere, and after the scan anything will do if an EOI comes some time.
    Stricter{Error::kBadCode, false}, Stricter{Error::kPastLastCoefficient, false}, Stricter{Error::kDcRange, false},
    Stricter{Error::kSpareData, false}, Stricter{Error::kNoEnd, false},  //
    Stricter{Error::kMarkerInData, true}, Stricter{Error::kNoMarker, true}};

bool is_stricter(Error error, std::span<const std::uint8_t> bytes) {
  constexpr std::array<std::uint8_t, 3> kFilled{0xFF, 0xFF, 0x00};
  return std::any_of(kStricter.begin(), kStricter.end(), [&](const Stricter& known) {
    return known.error == error &&
           (!known.fill_before_stuffing ||
            std::search(bytes.begin(), bytes.end(), kFilled.begin(), kFilled.end()) != bytes.end());
  });
}

constexpr jpeg_dc::Limits kWhole{1, 1};

// Without threads, which would make findings hard to repeat; the slices do not know.
class OneAfterTheOther final : public hal::Crew {
 public:
  explicit OneAfterTheOther(std::size_t workers) : workers_(workers) {}

 private:
  [[nodiscard]] std::size_t do_size() const override { return workers_; }
  void do_run(hal::Job& task) override {
    for (std::size_t i = 0; i < workers_; ++i) task.work(i);
  }

  std::size_t workers_;
};

struct Shape {
  std::size_t workers;
  std::int32_t lanes;
  std::int32_t slice;
  const jpeg_fast::Walkers& (*walkers)();
};
constexpr std::array<Shape, 4> kShapes{{{1, 1, 30, jpeg_fast::fastest_walkers},
                                        {1, 3, 100, jpeg_fast::fastest_walkers},
                                        {2, 2, 300, jpeg_fast::fastest_walkers},
                                        {1, 3, 200, jpeg_fast::baseline_walkers}}};

bool equal(const Oracle& oracle, const LumaBuffer& ours) {
  return oracle.width == ours.width && oracle.height == ours.height &&
         std::equal(oracle.pixels.begin(), oracle.pixels.end(), ours.pixels.begin());
}

}  // namespace

std::string JpegCheck::check(std::span<const std::uint8_t> bytes) {
  std::string finding = check_plain(bytes, *state_);
  if (!finding.empty() && check_plain(bytes, *std::make_unique<jpeg_dc::State>()).empty()) {
    finding += "; not with a fresh state: something stayed from the inputs before";
  }
  return finding.empty() ? check_fast(bytes) : finding;
}

std::string JpegCheck::check_fast(std::span<const std::uint8_t> bytes) {
  const jpeg_dc::ErrorInfo& plain = jpeg_dc::info(state_->error);
  for (const Shape& shape : kShapes) {
    OneAfterTheOther crew(shape.workers);
    const jpeg_fast::Config config{shape.lanes, shape.slice, shape.slice, &shape.walkers()};
    const Status status = jpeg_fast::decode(*fast_state_, config, workers_, crew, bytes, *fast_out_, kWhole);
    const std::size_t size = static_cast<std::size_t>(out_->width) * static_cast<std::size_t>(out_->height);
    const bool same =
        status.reason == plain.reason &&
        (!status.ok() || (fast_out_->width == out_->width && fast_out_->height == out_->height &&
                          std::equal(out_->pixels.begin(), out_->pixels.begin() + size, fast_out_->pixels.begin())));
    if (same) continue;
    return "fast walk, " + std::to_string(shape.workers) + " workers of " + std::to_string(shape.lanes) +
           " lanes, slices of " + std::to_string(shape.slice) + ": " +
           std::string(jpeg_dc::info(fast_state_->plain.error).name) + " instead of " + std::string(plain.name);
  }
  return {};
}

std::string JpegCheck::check_plain(std::span<const std::uint8_t> bytes, jpeg_dc::State& state) {
  const Status status = jpeg_dc::decode(state, bytes, *out_, kWhole);
  if (state.error >= Error{jpeg_dc::kErrors.size()}) return "an error that is not in the list";
  const jpeg_dc::ErrorInfo& said = jpeg_dc::info(state.error);
  if (status.reason != said.reason) return "status and error contradict each other";
  if (!status.ok()) {
    if (is_stricter(said.error, bytes) || !oracle_.decode(bytes)) return {};
    return "refused (" + std::string(said.name) + "), but the library accepts";
  }
  ++accepted_;
  if (!oracle_.decode(bytes)) return "accepted, but the library refuses or warns";
  return equal(oracle_, *out_) ? "" : "accepted, but not equal to the library";
}

}  // namespace holdfast::test
