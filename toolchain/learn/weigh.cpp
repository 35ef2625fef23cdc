// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/weigh.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace holdfast::learn {

void Weighing::add(long frame, const pipeline::Result& result) {
  Row row{.frame = frame, .at = result.timestamp};
  const load::Load& load = result.load;
  if (result.quality.ok() && result.referenced && load.basis != load::Basis::kNone) {
    const double x = load.shear_x.raw(), y = load.shear_y.raw();
    row.slips = result.request == GripRequest::kTighten;
    row.empty = result.contact.judged && !result.contact.touching;
    row.usable = !row.slips && !row.empty;
    row.strained = load.strained;
    row.within = load.within;
    row.reading_mn = force_ == Force::kShear ? std::hypot(x, y) : load.normal.raw();
  }
  rows_.push_back(row);
}

Weighing::Found Weighing::steadiest() const {
  Found best;
  for (std::size_t from = 0; from < rows_.size(); ++from) {
    double least = rows_[from].reading_mn, most = least, sum = 0, squares = 0;
    int within = 0;
    std::size_t to = from;
    for (; to < rows_.size() && rows_[to].usable; ++to) {
      const double reading = rows_[to].reading_mn;
      const double low = std::min(least, reading), high = std::max(most, reading);
      if (high - low > kSteady * (sum + reading) / static_cast<double>(to - from + 1)) break;
      least = low;
      most = high;
      sum += reading;
      squares += reading * reading;
      within += rows_[to].within ? 1 : 0;
    }
    if (to == from || rows_[to - 1].at - rows_[from].at < kLong) continue;
    const auto frames = static_cast<double>(to - from);
    const double mean = sum / frames;
    if (mean <= best.reading_mn) continue;
    best = {.first = rows_[from].frame,
            .last = rows_[to - 1].frame,
            .frames = static_cast<int>(to - from),
            .reading_mn = mean,
            .spread_mn = std::sqrt(std::max(squares / frames - mean * mean, 0.0)),
            .within = within};
  }
  return best;
}

std::variant<Weighing::Found, std::string> Weighing::find(double true_mn) const {
  const auto any = [&](bool Row::*what) {
    return std::ranges::any_of(rows_, [&](const Row& row) { return row.*what; });
  };
  if (!any(&Row::usable) && !any(&Row::slips)) {
    return any(&Row::empty)
               ? std::string(
                     "nothing touches the gel in it. Likely cause: another recording, or --from and --to leave "
                     "the weight out. Next: record the empty gel for a second, then the weight on it")
               : std::string(
                     "no frame has a reading of the forces. Likely cause: another lattice than 9x7 markers "
                     "2.02 mm apart, or no empty gel at its start. Next: see `holdfast replay --report`");
  }
  Found found = steadiest();
  if (found.frames == 0) {
    double most = 0;
    for (const Row& row : rows_) most = std::max(most, row.usable ? row.reading_mn : 0.0);
    return fmt::format(
        "the reading is steady within {:.0f} % for no {:.1f} s without a slip. Likely cause: {}. Next: {}",
        100 * kSteady, static_cast<double>(kLong.count()) * 1e-6,
        any(&Row::slips)   ? "the object slips or is moved all the time"
        : most < kFaint_mn ? "the weight is too small for the noise"
                           : "the weight swings, or was taken off too soon",
        most < kFaint_mn ? "take ten times the weight"
                         : "let the weight hang still for two seconds, or name still frames with --from and --to");
  }
  if (found.reading_mn < kLeast_mn) {
    return fmt::format(
        "the weight is too small: it reads {:.0f} mN in frames {} to {}. Likely cause: it is lighter than a gel can "
        "weigh to a few per cent, or does not hang on it. Next: take ten times the weight, or name its frames with "
        "--from and --to",
        found.reading_mn, found.first, found.last);
  }
  for (const Row& row : rows_) {
    if (row.frame < found.first || row.frame > found.last || !row.strained) continue;
    return fmt::format(
        "the weight is too large: markers move by more than {:.2f} mm, a quarter of the gel's thickness. Likely cause: "
        "a soft gel, or a small contact under much weight. Next: take half of the weight",
        load::kStrained_um * 1e-3);
  }
  found.scale_permille = static_cast<std::int32_t>(std::lround(1000.0 * true_mn / found.reading_mn));
  if (found.scale_permille < 100 || found.scale_permille > load::kMostScalePermille) {
    return fmt::format(
        "the gel would be {:.2f} times as stiff as one of 35 kPa: it reads {:.0f} mN under {:.0f} mN in frames {} to "
        "{}. Likely cause: other grams than those on the gel, or the wrong --as or --share. Next: look at the forces "
        "in "
        "`holdfast replay --report`",
        true_mn / found.reading_mn, found.reading_mn, true_mn, found.first, found.last);
  }
  return found;
}

}  // namespace holdfast::learn
