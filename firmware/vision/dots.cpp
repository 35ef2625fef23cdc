// SPDX-License-Identifier: Apache-2.0
#include "vision/dots.hpp"

#include <algorithm>

#include "base/math.hpp"

namespace holdfast::dots {
namespace {

struct Size {
  std::int32_t width = 0;
  std::int32_t height = 0;
};

// Block means of `step` x `step` pixels. Range: 16 * 16 blocks at most sum to 65 280: fits uint32 by far.
Size shrink(State& state, const LumaView& luma, std::int32_t step) {
  const Size size{luma.width / step, luma.height / step};
  const std::uint32_t area = static_cast<std::uint32_t>(step * step);
  for (std::int32_t y = 0; y < size.height; ++y) {
    std::uint8_t* out = state.small.data() + y * size.width;
    for (std::int32_t x = 0; x < size.width; ++x) {
      std::uint32_t sum = area / 2;
      for (std::int32_t j = 0; j < step; ++j) {
        const std::uint8_t* in = luma.row(y * step + j) + x * step;
        for (std::int32_t i = 0; i < step; ++i) sum += in[i];
      }
      out[x] = static_cast<std::uint8_t>(sum / area);
    }
  }
  return size;
}

// depth = clamp(mean over the box around the pixel - pixel, 0, 255); the box is cut at the picture's edge.
// Range: box sum <= 255 * area, so sum * (2^24 / area) <= 255 * 2^24 < 2^32.
void subtract_from_local_mean(State& state, Size size, std::int32_t radius) {
  std::fill_n(state.columns.begin(), size.width, 0U);
  const auto add_row = [&](std::int32_t y, bool plus) {
    const std::uint8_t* in = state.small.data() + y * size.width;
    for (std::int32_t x = 0; x < size.width; ++x) {
      if (plus) {
        state.columns[idx(x)] += in[x];
      } else {
        state.columns[idx(x)] -= in[x];
      }
    }
  };
  for (std::int32_t y = 0; y < std::min(radius, size.height); ++y) add_row(y, true);
  for (std::int32_t y = 0; y < size.height; ++y) {
    if (y + radius < size.height) add_row(y + radius, true);
    if (y - radius - 1 >= 0) add_row(y - radius - 1, false);
    const std::int32_t rows = std::min(y + radius, size.height - 1) - std::max(y - radius, 0) + 1;
    std::uint32_t sum = 0;
    for (std::int32_t x = 0; x < std::min(radius, size.width); ++x) sum += state.columns[idx(x)];
    std::int32_t last_columns = 0;
    std::uint32_t inverse_q24 = 0;
    const std::uint8_t* in = state.small.data() + y * size.width;
    std::uint8_t* out = state.depth.data() + y * size.width;
    for (std::int32_t x = 0; x < size.width; ++x) {
      if (x + radius < size.width) sum += state.columns[idx(x + radius)];
      if (x - radius - 1 >= 0) sum -= state.columns[idx(x - radius - 1)];
      const std::int32_t columns = std::min(x + radius, size.width - 1) - std::max(x - radius, 0) + 1;
      if (columns != last_columns) {
        last_columns = columns;
        inverse_q24 = (1U << 24) / static_cast<std::uint32_t>(rows * columns);
      }
      const auto mean = static_cast<std::int32_t>((sum * inverse_q24) >> 24);
      out[x] = static_cast<std::uint8_t>(std::clamp(mean - in[x], 0, 255));
    }
  }
}

// 2/5 of the depth that only 1.5 % of the pixels exceed. Dots cover 5 % (small print) to 20 % of the grid, so
// that depth lies inside the dots; on an empty picture it lies in the noise and the floor of 8 levels acts.
std::int32_t threshold_of(const State& state, Size size) {
  std::array<std::uint32_t, 256> histogram{};
  const std::int32_t pixels = size.width * size.height;
  for (std::int32_t i = 0; i < pixels; ++i) ++histogram[state.depth[idx(i)]];
  std::uint32_t above = 0;
  std::int32_t level = 255;
  while (level > 0) {
    above += histogram[idx(level)];
    if (above * 200 > static_cast<std::uint32_t>(pixels) * 3) break;
    --level;
  }
  return std::max(8, level * 2 / 5);
}

// Bounded by kMaxBlobs; path halving keeps it short.
std::int16_t root_of(State& state, std::int16_t blob) {
  while (state.blobs[idx(blob)].parent != blob) {
    Blob& b = state.blobs[idx(blob)];
    b.parent = state.blobs[idx(b.parent)].parent;
    blob = b.parent;
  }
  return blob;
}

void absorb(Blob& into, const Blob& from) {
  into.area += from.area;
  into.weight += from.weight;
  into.weight_x += from.weight_x;
  into.weight_y += from.weight_y;
  into.left = std::min(into.left, from.left);
  into.right = std::max(into.right, from.right);
  into.top = std::min(into.top, from.top);
  into.bottom = std::max(into.bottom, from.bottom);
}

// Connected components (8 neighbours) of depth > threshold, by runs. Returns the number of blobs, or -1 when
// they do not fit. Range: weight <= 255 * 204 800 = 5.2e7; weight_x <= 2.7e10 in int64.
int collect_blobs(State& state, Size size, std::int32_t threshold) {
  int blob_count = 0;
  int above_count = 0;
  for (std::int32_t y = 0; y < size.height; ++y) {
    auto& here = state.runs[idx(y & 1)];
    const auto& above = state.runs[idx((y & 1) ^ 1)];
    int here_count = 0;
    int a = 0;
    const std::uint8_t* depth = state.depth.data() + y * size.width;
    std::int32_t x = 0;
    while (x < size.width) {
      if (depth[x] <= threshold) {
        ++x;
        continue;
      }
      Blob run{};
      const std::int32_t begin = x;
      for (; x < size.width && depth[x] > threshold; ++x) {
        run.weight += depth[x];
        run.weight_x += std::int64_t{depth[x]} * x;
      }
      run.weight_y = std::int64_t{run.weight} * y;
      run.area = x - begin;
      run.left = static_cast<std::int16_t>(begin);
      run.right = static_cast<std::int16_t>(x - 1);
      run.top = run.bottom = static_cast<std::int16_t>(y);
      // Runs above that touch [begin - 1, x] belong to the same blob; both lists are sorted by x.
      while (a < above_count && above[idx(a)].end < begin) ++a;
      std::int16_t label = -1;
      for (int k = a; k < above_count && above[idx(k)].begin <= x; ++k) {
        const std::int16_t other = root_of(state, above[idx(k)].blob);
        if (label < 0) {
          label = other;
          absorb(state.blobs[idx(label)], run);
        } else if (other != label) {
          absorb(state.blobs[idx(label)], state.blobs[idx(other)]);
          state.blobs[idx(other)].parent = label;
        }
      }
      if (label < 0) {
        if (blob_count == kMaxBlobs) return -1;
        label = static_cast<std::int16_t>(blob_count++);
        run.parent = label;
        state.blobs[idx(label)] = run;
      }
      here[idx(here_count++)] = {static_cast<std::int16_t>(begin), static_cast<std::int16_t>(x), label};
    }
    above_count = here_count;
  }
  return blob_count;
}

// A disc fills 78 % of its bounding square; deformation and coarse sampling are given room.
bool looks_like_disc(const Blob& blob) {
  const std::int32_t width = blob.right - blob.left + 1;
  const std::int32_t height = blob.bottom - blob.top + 1;
  return width <= 2 * height + 1 && height <= 2 * width + 1 && blob.area * 100 >= 50 * width * height;
}

}  // namespace

Status detect(State& state, const Config& config, const LumaView& luma, Dots& out) {
  out.count = 0;
  out.width = luma.width;
  out.height = luma.height;
  const std::int32_t step =
      std::max((luma.width + kMaxWidth - 1) / kMaxWidth, (luma.height + kMaxHeight - 1) / kMaxHeight);
  const Size size = shrink(state, luma, step);
  subtract_from_local_mean(state, size, std::max(3, size.width / config.box_divisor));
  const std::int32_t threshold = threshold_of(state, size);
  const int blob_count = collect_blobs(state, size, threshold);
  if (blob_count < 0) return {Reason::kDotsOverflow};

  // Printed dots are 1/150 to 1/24 of the picture's width in radius, whatever gel and crop.
  const std::int32_t smallest = std::max(4, size.width * size.width / 12'000);
  const std::int32_t largest = size.width * size.width / 180;
  bool overflow = false;
  for (int i = 0; i < blob_count; ++i) {
    const Blob& blob = state.blobs[idx(i)];
    if (blob.parent != i || blob.area < smallest || blob.area > largest || !looks_like_disc(blob)) continue;
    if (out.count == kMaxDots) {
      overflow = true;
      break;
    }
    // Centre of the shrunken pixel (0,0) is (step - 1) / 2 in the working image.
    const auto position = [&](std::int64_t weighted) {
      return PixelsQ8::from_raw(
          static_cast<std::int32_t>(div_round(weighted * 256 * step, blob.weight) + (step - 1) * 128));
    };
    Dot& dot = out.dots[idx(out.count++)];
    dot.x = position(blob.weight_x);
    dot.y = position(blob.weight_y);
    dot.area = blob.area;
    dot.cut = blob.left == 0 || blob.top == 0 || blob.right == size.width - 1 || blob.bottom == size.height - 1;
  }
  if (overflow) return {Reason::kDotsOverflow};

  // Dots are printed alike: drop what differs much from the typical area. Typical = the area at which half of
  // all blob pixels are in smaller blobs, so that many specks of noise weigh little.
  std::array<std::int32_t, kMaxDots> areas{};
  std::int64_t total = 0;
  for (int i = 0; i < out.count; ++i) {
    areas[idx(i)] = out.dots[idx(i)].area;
    total += areas[idx(i)];
  }
  sort_few(areas.data(), out.count);
  std::int64_t sum = 0;
  std::int32_t typical = 0;
  for (int i = 0; i < out.count && sum * 2 < total; ++i) {
    typical = areas[idx(i)];
    sum += typical;
  }
  int kept = 0;
  for (int i = 0; i < out.count; ++i) {
    const Dot& dot = out.dots[idx(i)];
    if (dot.area * 20 > typical * 44 || (!dot.cut && dot.area * 20 < typical * 7)) continue;
    out.dots[idx(kept++)] = dot;
  }
  out.count = kept;
  return kOkStatus;
}

}  // namespace holdfast::dots
