// SPDX-License-Identifier: Apache-2.0
#include "vision/picture_check.hpp"

#include <algorithm>
#include <cstdlib>

#include "base/math.hpp"

namespace holdfast::picture_check {
namespace {

std::int32_t columns_of(std::int32_t width) {
  return width / kGroup * kGroup;
}

void measure(const LumaView& luma, std::int32_t cap, RowSteps& out) {
  out[0] = 0;
  for (std::int32_t y = 1; y < luma.height; ++y) {
    const Rows rows{luma.row(std::max(y - 2, 0)), luma.row(y - 1), luma.row(y),
                    luma.row(std::min(y + 1, luma.height - 1))};
    out[idx(y)] = row_steps(rows, columns_of(luma.width), cap);
  }
}

// From row y on, a block apart. Range: 0 <= y < height - 2 * block.
std::int32_t three_rows(const RowSteps& steps, std::int32_t y, std::int32_t block) {
  return steps[idx(y)] + steps[idx(y + block)] + steps[idx(y + 2 * block)];
}

// The largest excess of a sum over those of the picture before; steps up and down are different things.
std::int32_t worst_excess(const RowSteps& seen, const RowSteps& believed, std::int32_t height, std::int32_t block) {
  std::int32_t worst = 0;
  const std::int32_t last = height - 2 * block - 1;
  for (std::int32_t y = 0; y <= last; y += block) {
    std::int32_t most = 0;
    std::int32_t least = 0;
    for (std::int32_t near = std::max(y - 1, 0); near <= std::min(y + 1, last); ++near) {
      const std::int32_t before = three_rows(believed, near, block);
      most = std::max(most, before);
      least = std::min(least, before);
    }
    const std::int32_t now = three_rows(seen, y, block);
    worst = std::max({worst, now - most, least - now});
  }
  return worst;
}

}  // namespace

std::int32_t row_steps_scalar(const Rows& rows, std::int32_t columns, std::int32_t cap) {
  std::int32_t sum = 0;
  for (std::int32_t x = 0; x < columns; ++x) {
    const std::int32_t difference = rows.row[x] - rows.above[x];
    const std::int32_t before = std::abs(rows.above[x] - rows.two_above[x]);
    const std::int32_t after = std::abs(rows.below[x] - rows.row[x]);
    const std::int32_t step = std::clamp(std::abs(difference) - std::max(before, after), 0, cap);
    sum += difference > 0 ? step : -step;
  }
  return sum;
}

std::int32_t worst_cell(const LumaView& luma, std::int32_t cap, std::int32_t block) {
  const std::int32_t width = 2 * block;
  using Steps = std::array<std::int32_t, kMaxLumaWidth / (2 * kLeastCellBlock)>;  // of a row of cells
  std::array<Steps, 3> steps{};  // this rim, and those one and two blocks above; above the picture: none
  std::int32_t worst = 0;
  for (std::int32_t y = block; y + 1 < luma.height; y += block) {
    std::rotate(steps.begin(), steps.end() - 1, steps.end());
    const Rows rows{luma.row(y - 2), luma.row(y - 1), luma.row(y), luma.row(y + 1)};
    for (std::int32_t cell = 0; cell < luma.width / width; ++cell) {
      const std::int32_t x = cell * width;
      const std::int32_t now =
          row_steps_scalar({rows.two_above + x, rows.above + x, rows.row + x, rows.below + x}, width, cap);
      steps[0][idx(cell)] = now;
      for (const std::size_t above : {1U, 2U}) {
        const std::int32_t before = steps[above][idx(cell)];
        worst = std::max(worst, std::max(std::min(now, -before), std::min(-now, before)));
      }
    }
  }
  return worst * 100 / (width * cap);
}

Status update(State& state, const Config& config, const LumaView& luma, std::int32_t block) {
  measure(luma, config.cap, state.seen);
  const std::int32_t cell = block >= kLeastCellBlock ? worst_cell(luma, config.cap, block) : 0;
  const bool first = state.width != luma.width || state.height != luma.height;
  const bool implausible = !first && (worst_excess(state.seen, state.believed, luma.height, block) * 100 >
                                          columns_of(luma.width) * config.cap * config.limit_pct ||
                                      cell - state.believed_cell > config.limit_pct);
  if (implausible && state.refused_in_a_row < config.patience) {
    ++state.refused_in_a_row;
    return {Reason::kJpegDamaged};
  }
  state.refused_in_a_row = 0;
  state.believed = state.seen;
  state.believed_cell = cell;
  state.width = luma.width;
  state.height = luma.height;
  return kOkStatus;
}

}  // namespace holdfast::picture_check
