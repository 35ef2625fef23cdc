// SPDX-License-Identifier: Apache-2.0
#include "toolchain/console/live_view.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>

#include "base/math.hpp"
#include "toolchain/console/canvas.hpp"

namespace holdfast::console_tool {
namespace {

constexpr int kPanel = 32;              // columns of the figures beside the markers
constexpr double kStaleS = 1.0;         // five times as long as between two fields
constexpr double kEntropyMost = 2.708;  // ln 15

Style style_of(DeviceState state) {
  switch (state) {
    case DeviceState::kOk:
      return Style::kGood;
    case DeviceState::kBoot:
    case DeviceState::kReference:
    case DeviceState::kDegraded:
      return Style::kWarn;
    case DeviceState::kSlip:
    case DeviceState::kFault:
      break;
  }
  return Style::kBad;
}

// ---- State, in words

// No frame for so long: what was told last is history.
bool is_silent(const LiveModel& model) {
  return model.away || !model.status || *model.silent_s() > kStaleS;
}

void draw_state(Canvas& canvas, int y, const LiveModel& model) {
  std::string_view state, cause, next;
  std::string what;
  Style style = Style::kBad;
  if (model.away) {
    state = "AWAY";
    what = "the port has gone";
    cause = "unplugged, or the firmware ended";
    next = "plug it in again: this goes on then";
  } else if (!model.status) {
    state = "WAITING";
    what = "no frame has come yet";
    cause = "the camera does not deliver, or the firmware has just started";
    next = "wait; status at the prompt says what the device is doing";
    style = Style::kWarn;
  } else if (is_silent(model)) {
    state = "SILENT";
    what = fmt::format("no frame for {:.0f} s; the last one said {} {}", *model.silent_s(),
                       info(model.status->state).name, info(model.status->reason).name);
    cause = "the firmware hangs, or somebody else reads the port";
    next = "wait; restart the device if it does not come back";
  } else {
    const ReasonInfo& why = info(model.status->reason);
    state = info(model.status->state).name;
    what = fmt::format("{}: {}", why.name, why.what);
    cause = why.cause;
    next = why.next;
    style = style_of(model.status->state);
  }
  canvas.put(1, y, state, style);
  canvas.put(11, y, what);
  canvas.put(1, y + 1, "cause", Style::kDim);
  canvas.put(11, y + 1, cause);
  canvas.put(1, y + 2, "next", Style::kDim);
  canvas.put(11, y + 2, next);
}

// ---- Figures

char32_t arrow(double dx, double dy, bool unicode) {
  constexpr std::u32string_view kArrows = U"→↘↓↙←↖↑↗";
  constexpr std::u32string_view kPlain = U">\\v/<\\^/";
  const auto eighth = static_cast<int>(std::lround(std::atan2(dy, dx) * 4 / std::numbers::pi));
  return (unicode ? kArrows : kPlain)[static_cast<std::size_t>((eighth + 8) % 8)];
}

std::string span_text(double seconds) {
  return seconds < 1.0 ? fmt::format("{:.0f} ms", seconds * 1000) : fmt::format("{:.1f} s", seconds);
}

void draw_lines_of_output(Canvas& canvas, int x, int y, const LiveModel& model) {
  const bool high = model.status && model.status->grip_ok;
  canvas.put(x, y, "GRIP_OK", Style::kDim);
  if (high && model.fresh()) {
    canvas.put(x + 9, y, "HIGH: fine", Style::kGood);
  } else {
    canvas.put(x + 9, y, high ? "HIGH, not believed" : "LOW: not fine", Style::kBad);
  }
  canvas.put(x, y + 1, "ALIVE", Style::kDim);
  if (model.fresh()) {
    canvas.put(x + 9, y + 1, "fresh", Style::kGood);
  } else {
    canvas.put(x + 9, y + 1,
               model.edge_s ? fmt::format("silent for {}", span_text(model.now_s - *model.edge_s)) : "no edge seen yet",
               Style::kBad);
  }
}

void draw_figures(Canvas& canvas, int x, int y, const LiveModel& model, bool unicode) {
  draw_lines_of_output(canvas, x, y, model);
  const auto row = [&](int k, std::string_view name, const std::string& text, Style style = Style::kPlain) {
    canvas.put(x, y + k, name, Style::kDim);
    return canvas.put(x + 9, y + k, text, style);
  };
  const bool silent = is_silent(model);
  const status_frame::StatusFrame told = silent ? status_frame::StatusFrame{} : *model.status;
  row(2, "slip", silent ? "-" : told.slip ? "YES" : "no", told.slip ? Style::kBad : Style::kPlain);
  if (told.features_valid) {
    const double speed = std::hypot(told.vx_um_s, told.vy_um_s) * 1e-3;
    row(3, "markers",
        model.field ? fmt::format("{} of {}", told.markers, model.field->grid.count())
                    : fmt::format("{}", told.markers));
    const int behind = row(4, "V", fmt::format("{:.2f} mm/s", speed));
    if (speed >= 0.1) canvas.set(behind + 1, y + 4, arrow(told.vx_um_s, told.vy_um_s, unicode));
    row(5, "E", fmt::format("{:.3f} nat", told.entropy_nat_q16 / 65536.0));
    row(6, "dE/dt", fmt::format("{:+.2f} nat/s", told.entropy_rate_nat_s_q8 / 256.0));
  } else {
    for (int k = 3; k < 7; ++k) row(k, std::array{"markers", "V", "E", "dE/dt"}[static_cast<std::size_t>(k - 3)], "-");
  }
  row(7, "rate", fmt::format("{:.1f} fps", model.fps()));
  row(8, "age",
      silent                                       ? "-"
      : told.age_100us == status_frame::kOldestAge ? "over 6.5 s"
                                                   : span_text(told.age_100us * 1e-4));
  row(9, "lost", fmt::format("{} frames", model.lost));
}

// ---- Markers

// Dots of half a column and a quarter of a row: squares, on most screens.
class Dots {
 public:
  Dots(int columns, int rows)
      : columns_(columns), rows_(rows), bits_(static_cast<std::size_t>(std::max(columns, 0) * std::max(rows, 0))) {}
  void set(double x, double y) {
    const auto dx = static_cast<int>(std::floor(x));
    const auto dy = static_cast<int>(std::floor(y));
    if (dx < 0 || dy < 0 || dx >= 2 * columns_ || dy >= 4 * rows_) return;
    // Braille numbers its dots down the left column, then the right one, and the lowest row last.
    constexpr std::array<std::array<std::uint8_t, 2>, 4> kBit{{{0x01, 0x08}, {0x02, 0x10}, {0x04, 0x20}, {0x40, 0x80}}};
    auto& bits = bits_[place(dx / 2, dy / 4)];
    bits = static_cast<std::uint8_t>(bits | kBit[static_cast<std::size_t>(dy % 4)][static_cast<std::size_t>(dx % 2)]);
  }
  [[nodiscard]] std::uint8_t at(int x, int y) const { return bits_[place(x, y)]; }
  [[nodiscard]] std::size_t place(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(columns_) + static_cast<std::size_t>(x);
  }

 private:
  int columns_, rows_;
  std::vector<std::uint8_t> bits_;
};

struct Place {
  int x = 0, y = 0, columns = 0, rows = 0;
};

void draw_markers(Canvas& canvas, const Place& place, const LiveModel& model, bool unicode) {
  if (!model.rest) {
    canvas.put(place.x + 2, place.y + place.rows / 2, "no rest position of the markers yet", Style::kDim);
    return;
  }
  const DisplacementField& rest = *model.rest;
  double left = 0, right = 0, top = 0, bottom = 0;
  for (std::int32_t i = 0; i < rest.grid.count(); ++i) {
    const MarkerDisplacement& r = rest.markers[idx(i)];
    if (!r.valid) continue;
    left = std::min<double>(left, r.dx.raw());
    right = std::max<double>(right, r.dx.raw());
    top = std::min<double>(top, r.dy.raw());
    bottom = std::max<double>(bottom, r.dy.raw());
  }
  // Room for an arrow of a pitch at each edge.
  const double room = std::max(model.pitch_um(), 1.0) * 1.2;
  const double scale = std::min(2 * place.columns / (right - left + room), 4 * place.rows / (bottom - top + room));
  const double middle_x = place.columns - (left + right) / 2 * scale;
  const double middle_y = 2 * place.rows - (top + bottom) / 2 * scale;

  const bool shown = model.field && model.field->grid == rest.grid && model.now_s - model.field_s < kStaleS &&
                     !is_silent(model) && model.status->features_valid;
  const Style style = !shown ? Style::kDim : model.status->slip ? Style::kBad : Style::kWarn;
  Dots dots(place.columns, place.rows);
  struct Head {
    int x, y;
    char32_t letter;
    Style style;
  };
  std::vector<Head> heads;
  for (std::int32_t i = 0; i < rest.grid.count(); ++i) {
    const MarkerDisplacement& r = rest.markers[idx(i)];
    if (!r.valid) continue;
    const double x = middle_x + r.dx.raw() * scale;
    const double y = middle_y + r.dy.raw() * scale;
    const auto cell = [&](double at_x, double at_y, char32_t letter, Style how) {
      heads.push_back({static_cast<int>(std::floor(at_x / 2)), static_cast<int>(std::floor(at_y / 4)), letter, how});
    };
    // A letter would jump by a whole row where a position lies between two.
    const auto stand = [&](int size) {
      if (!unicode) return cell(x, y, size > 1 ? U'o' : U'.', style);
      for (int row = 0; row < size; ++row) {
        for (int col = 0; col < size; ++col) dots.set(x - 0.5 * (size - 1) + col, y - 0.5 * (size - 1) + row);
      }
    };
    if (!shown) {
      stand(1);
      continue;
    }
    const MarkerDisplacement& d = model.field->markers[idx(i)];
    if (!d.valid) {
      cell(x, y, unicode ? U'×' : U'x', Style::kBad);
      continue;
    }
    const double dx = d.dx.raw() * scale * model.magnified;
    const double dy = d.dy.raw() * scale * model.magnified;
    const double length = std::hypot(dx, dy);
    if (length < 2.0) {
      stand(2);
      continue;
    }
    const int steps = static_cast<int>(std::ceil(length)) * 2;
    for (int k = 0; k <= steps; ++k) dots.set(x + dx * k / steps, y + dy * k / steps);
    cell(x + dx, y + dy, arrow(dx, dy, unicode), style);
  }
  for (int y = 0; y < place.rows; ++y) {
    for (int x = 0; x < place.columns; ++x) {
      const std::uint8_t bits = dots.at(x, y);
      if (bits != 0) canvas.set(place.x + x, place.y + y, unicode ? char32_t{0x2800} + bits : U'.', style);
    }
  }
  for (const Head& head : heads) {
    if (head.x < 0 || head.x >= place.columns || head.y < 0 || head.y >= place.rows) continue;
    canvas.set(place.x + head.x, place.y + head.y, head.letter, head.style);
  }
}

// ---- The last ten seconds

struct Series {
  std::string_view name;
  double LiveSample::*value;
  double least, most;  // of the scale
  std::string_view unit;
};

// The sample farthest from 0 of each column's time.
std::vector<std::optional<double>> columns_of(const LiveModel& model, int columns, double LiveSample::*value) {
  std::vector<std::optional<double>> out(static_cast<std::size_t>(std::max(columns, 0)));
  for (const LiveSample& sample : model.samples) {
    const double share = 1.0 - (model.now_s - sample.at_s) / LiveModel::kShownS;
    const auto x = static_cast<std::int64_t>(std::floor(share * columns));
    if (!sample.measured || x < 0 || x >= columns) continue;
    std::optional<double>& cell = out[static_cast<std::size_t>(x)];
    if (!cell || std::abs(sample.*value) > std::abs(*cell)) cell = sample.*value;
  }
  return out;
}

void draw_series(Canvas& canvas, int y, const Series& series, const LiveModel& model, bool unicode) {
  constexpr std::u32string_view kBlocks = U"▁▂▃▄▅▆▇█";
  constexpr std::u32string_view kPlain = U"_.-:=+*#";
  constexpr int kLabel = 8, kScale = 21;
  canvas.put(1, y, series.name, Style::kDim);
  const int width = canvas.columns() - kLabel - kScale;
  const auto values = columns_of(model, width, series.value);
  for (int x = 0; x < width; ++x) {
    const auto& value = values[static_cast<std::size_t>(x)];
    if (!value) continue;
    const double share = (*value - series.least) / (series.most - series.least);
    const auto level = std::clamp(static_cast<int>(share * 8), 0, 7);
    canvas.set(kLabel + x, y, (unicode ? kBlocks : kPlain)[static_cast<std::size_t>(level)]);
  }
  canvas.put(canvas.columns() - kScale + 1, y,
             series.least < 0 ? fmt::format("+-{:.1f} {}", series.most, series.unit)
                              : fmt::format("0 to {:.1f} {}", series.most, series.unit),
             Style::kDim);
}

void draw_slip_band(Canvas& canvas, int y, const LiveModel& model, bool unicode) {
  constexpr int kLabel = 8, kScale = 21;
  canvas.put(1, y, "slip", Style::kDim);
  const int width = canvas.columns() - kLabel - kScale;
  std::vector<std::uint8_t> seen(static_cast<std::size_t>(std::max(width, 0)));  // 1: a frame came, 2: and it slipped
  for (const LiveSample& sample : model.samples) {
    const double share = 1.0 - (model.now_s - sample.at_s) / LiveModel::kShownS;
    const auto x = static_cast<std::int64_t>(std::floor(share * width));
    if (x < 0 || x >= width) continue;
    auto& cell = seen[static_cast<std::size_t>(x)];
    cell = std::max<std::uint8_t>(cell, sample.slip ? 2 : 1);
  }
  for (int x = 0; x < width; ++x) {
    const std::uint8_t cell = seen[static_cast<std::size_t>(x)];
    if (cell == 2) canvas.set(kLabel + x, y, unicode ? U'█' : U'#', Style::kBad);
    if (cell == 1) canvas.set(kLabel + x, y, unicode ? U'·' : U'.', Style::kDim);
  }
  canvas.put(canvas.columns() - kScale + 1, y, "last 10 s", Style::kDim);
}

// Rounded up to 1, 2 or 5 times a power of ten, so that the scale stands still.
double scale_of(const LiveModel& model, double LiveSample::*value, double least) {
  double most = least;
  for (const LiveSample& sample : model.samples) {
    if (sample.measured) most = std::max(most, std::abs(sample.*value));
  }
  const double power = std::pow(10.0, std::floor(std::log10(most)));
  for (const double step : {1.0, 2.0, 5.0}) {
    if (most <= step * power) return step * power;
  }
  return 10 * power;
}

void draw_events(Canvas& canvas, int y, int rows, const LiveModel& model) {
  for (int k = 0; k < rows && k < static_cast<int>(model.events.size()); ++k) {
    const LiveEvent& event = model.events[static_cast<std::size_t>(k)];
    canvas.put(1, y + k, fmt::format("{:>8.1f} s ago", std::max(model.now_s - event.at_s, 0.0)), Style::kDim);
    canvas.put(17, y + k, event.text);
  }
}

// ---- The whole

void rule(Canvas& canvas, int y, bool unicode) {
  for (int x = 0; x < canvas.columns(); ++x) canvas.set(x, y, unicode ? U'─' : U'-', Style::kDim);
}

void draw_head(Canvas& canvas, const LiveModel& model) {
  const int x = canvas.put(1, 0, "holdfast live", Style::kBold);
  const int behind = canvas.put(x + 2, 0, model.title);
  const int room = canvas.columns() - behind - 3;
  std::string_view port = model.port;
  if (static_cast<int>(port.size()) > room)
    port.remove_prefix(port.size() - static_cast<std::size_t>(std::max(room, 0)));
  canvas.put(canvas.columns() - 1 - static_cast<int>(port.size()), 0, port, Style::kDim);
}

void draw_small(Canvas& canvas, const LiveModel& model, const LiveLook& look) {
  draw_head(canvas, model);
  draw_state(canvas, 1, model);
  draw_lines_of_output(canvas, 1, 4, model);
  if (model.status && model.status->features_valid) {
    canvas.put(1, 6,
               fmt::format("E {:.3f} nat  dE/dt {:+.2f} nat/s  V {:.2f} mm/s", model.status->entropy_nat_q16 / 65536.0,
                           model.status->entropy_rate_nat_s_q8 / 256.0,
                           std::hypot(model.status->vx_um_s, model.status->vy_um_s) * 1e-3));
  }
  const int last = canvas.rows() - 1;
  for (int x = 0; x < canvas.columns(); ++x) canvas.set(x, last, U' ');
  canvas.put(1, last,
             fmt::format("q leaves; the whole view needs {}x{}, this is {}x{}", LiveLook::kColumns, LiveLook::kRows,
                         look.columns, look.rows),
             Style::kWarn);
}

}  // namespace

std::vector<std::string> draw(const LiveModel& model, const LiveLook& look) {
  Canvas canvas(look.columns, look.rows);
  if (look.columns < LiveLook::kColumns || look.rows < LiveLook::kRows) {
    draw_small(canvas, model, look);
    return canvas.lines(look.color);
  }
  const int events = std::clamp(look.rows / 4 - 4, 2, 8);
  const int series = look.rows - 1 - events - 4;
  const Place markers{1, 5, look.columns - kPanel - 2, series - 6};
  draw_head(canvas, model);
  draw_state(canvas, 1, model);
  rule(canvas, 4, look.unicode);
  canvas.put(2, 4, fmt::format(" markers, arrows {} times as long ", model.magnified), Style::kDim);
  draw_markers(canvas, markers, model, look.unicode);
  draw_figures(canvas, look.columns - kPanel, 5, model, look.unicode);
  rule(canvas, series - 1, look.unicode);
  draw_series(canvas, series, {"V", &LiveSample::speed_mm_s, 0, scale_of(model, &LiveSample::speed_mm_s, 1), "mm/s"},
              model, look.unicode);
  draw_series(canvas, series + 1, {"E", &LiveSample::entropy_nat, 0, kEntropyMost, "nat"}, model, look.unicode);
  const double rate = scale_of(model, &LiveSample::rate_nat_s, 1);
  draw_series(canvas, series + 2, {"dE/dt", &LiveSample::rate_nat_s, -rate, rate, "nat/s"}, model, look.unicode);
  draw_slip_band(canvas, series + 3, model, look.unicode);
  draw_events(canvas, series + 4, events, model);
  canvas.put(1, look.rows - 1, "q leaves", Style::kDim);
  return canvas.lines(look.color);
}

}  // namespace holdfast::console_tool
