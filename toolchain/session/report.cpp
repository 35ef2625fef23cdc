// SPDX-License-Identifier: Apache-2.0
#include "toolchain/session/report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <limits>
#include <map>
#include <span>
#include <string_view>

#include "toolchain/session/page.hpp"
#include "toolchain/support/atomic_file.hpp"
#include "toolchain/support/escape.hpp"

namespace holdfast::tool {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
// The receiver's rule (DESIGN.md, Outputs): GRIP_OK counts only while the last ALIVE edge is younger than
// this.
constexpr double kAliveFresh_s = 0.150;

constexpr int kWidth = 1080, kLeft = 62, kRight = 18;
constexpr int kColumns = kWidth - kLeft - kRight;  // one per unit of the drawing
constexpr std::size_t kMaxAliveEdges = 400;        // more would run together into a block

// The shown states by severity; colours from Okabe and Ito's palette, told apart also by the colour-blind.
struct StateLook {
  DeviceState state;
  std::string_view css;
};
constexpr std::array<StateLook, 6> kBySeverity{{{DeviceState::kOk, "ok"},
                                                {DeviceState::kReference, "reference"},
                                                {DeviceState::kBoot, "boot"},
                                                {DeviceState::kDegraded, "degraded"},
                                                {DeviceState::kSlip, "slip"},
                                                {DeviceState::kFault, "fault"}}};

int severity(DeviceState state) {
  for (std::size_t i = 0; i < kBySeverity.size(); ++i) {
    if (kBySeverity[i].state == state) return static_cast<int>(i);
  }
  return 0;
}

// Shortest text to a tenth of a drawing unit.
std::string px(double value) {
  const double tenths = std::round(value * 10) / 10;
  return fmt::format("{:g}", tenths == 0 ? 0 : tenths);
}

std::string minus(std::string text) {  // a typographic minus for the reader
  if (!text.empty() && text.front() == '-') text.replace(0, 1, "−");
  return text;
}

std::string plural(long n, std::string_view what) {
  return fmt::format("{} {}{}", n, what, n == 1 ? "" : "s");
}

struct Axis {
  double low = 0, high = 1, step = 1;
  int decimals = 0;
};

// About `count` ticks at 1, 2 or 5 times a power of ten; the ends are those given.
Axis nice_axis(double low, double high, int count) {
  if (!(high > low)) high = low + 1;
  const double rough = (high - low) / count;
  const double power = std::pow(10, std::floor(std::log10(rough)));
  const double lead = rough / power;
  const double step = (lead <= 1 ? 1 : lead <= 2 ? 2 : lead <= 5 ? 5 : 10) * power;
  const int decimals = std::max(0, static_cast<int>(-std::floor(std::log10(step) + 1e-9)));
  return {low, high, step, decimals};
}

std::vector<double> ticks(const Axis& axis) {
  std::vector<double> out;
  const double slack = 1e-6 * axis.step;
  const double first = std::ceil((axis.low - slack) / axis.step);
  for (int i = 0; (first + i) * axis.step <= axis.high + slack; ++i) out.push_back((first + i) * axis.step);
  return out;
}

std::string tick_text(double value, int decimals) {
  return minus(fmt::format("{:.{}f}", value == 0 ? 0 : value, decimals));
}

using Points = std::vector<std::pair<double, double>>;  // t_s, value; NaN breaks the line

// What one column of pixels has to show of the frames in it.
struct Column {
  int severity = -1;  // of the worst state; -1: no frame
  bool slip = false;
  bool low = false, high = false;  // GRIP_OK was LOW, HIGH
  bool fresh = false;              // the last ALIVE edge was young enough
};

class TimePlots {
 public:
  TimePlots(const std::vector<FrameRecord>& frames, const ReportInfo& info) : frames_(frames), info_(info) {
    t0_ = frames.front().t_s();
    const double span = frames.back().t_s() - t0_;
    last_dt_s_ = frames.size() > 1 ? frames.back().t_s() - frames[frames.size() - 2].t_s() : 0.04;
    scale_ = kColumns / std::max(span + last_dt_s_, 1e-6);
    fill_columns();
  }

  // The whole drawing. It says where its time begins, and its units per second: the cursor goes by that.
  std::string svg() {
    y_ = info_.marks.empty() ? 6 : 22;
    top_ = y_;
    why();
    loads();
    panel("Entropy E", "nat", 128, 0, {{"a", "", series(&FrameRecord::entropy_nat, &FrameRecord::features_valid)}});
    panel("Entropy rate dE/dt", "nat/s", 96, kNone,
          {{"a", "", series(&FrameRecord::entropy_rate_nat_s, &FrameRecord::rates_valid)}});
    panel("Mean marker speed", "mm/s", 118, kNone,
          {{"a", "Vx", series(&FrameRecord::vx_mm_s, &FrameRecord::rates_valid)},
           {"b", "Vy", series(&FrameRecord::vy_mm_s, &FrameRecord::rates_valid)}});
    if (info_.series) {
      panel("Truth: " + info_.series->name, info_.series->unit, 84, 0, {{"v", "", info_.series->points}});
    }
    state_band();
    grip_line();
    alive_line();
    const double bottom = y_ - 6;
    time_axis(bottom);
    return fmt::format(
        R"(<svg id="plots" viewBox="0 0 {0} {1}" role="img" aria-label="time plots" data-t0="{2:.6f}" data-scale="{3:.6f}" data-left="{4}">{5}{6}{7}<line id="hover" class="hover" x1="0" x2="0" y1="{8}" y2="{9}"/><line id="cursor" class="cursor" x1="0" x2="0" y1="{8}" y2="{9}"/></svg>)",
        kWidth, px(bottom + 40), t0_, scale_, kLeft, shading(bottom), body_, marks(bottom), px(top_), px(bottom));
  }

 private:
  struct Curve {
    std::string_view css;
    std::string_view label;
    Points points;
  };

  [[nodiscard]] double x(double t_s) const { return kLeft + (t_s - t0_) * scale_; }
  [[nodiscard]] std::size_t column(double t_s) const {
    return static_cast<std::size_t>(std::clamp((t_s - t0_) * scale_, 0.0, kColumns - 1.0));
  }

  void fill_columns() {
    double last_edge_s = -1e9;
    for (std::size_t i = 0; i < frames_.size(); ++i) {
      const FrameRecord& f = frames_[i];
      const double until = i + 1 < frames_.size() ? frames_[i + 1].t_s() : f.t_s() + last_dt_s_;
      if (f.accepted) {
        last_edge_s = f.t_s();
        ++edges_;
      }
      const std::size_t first = column(f.t_s());
      const std::size_t end = std::max(first, column(until - 0.5 / scale_));
      for (std::size_t c = first; c <= end; ++c) {
        Column& column = columns_[c];
        column.severity = std::max(column.severity, severity(f.state));
        column.slip |= f.slip;
        (f.grip_ok ? column.high : column.low) = true;
        const double t_s = std::max(f.t_s(), t0_ + static_cast<double>(c) / scale_);
        column.fresh |= t_s - last_edge_s <= kAliveFresh_s;
      }
    }
  }

  [[nodiscard]] Points series(double FrameRecord::*value, bool FrameRecord::*valid) const {
    Points points;
    points.reserve(frames_.size());
    for (const FrameRecord& f : frames_) points.emplace_back(f.t_s(), f.*valid ? f.*value : kNone);
    return points;
  }

  // Calls `draw(first column, one past the last)` for each run of columns that agree with `pick`.
  void runs(const std::function<int(const Column&)>& pick,
            const std::function<void(int, std::size_t, std::size_t)>& draw) const {
    for (std::size_t c = 0; c < columns_.size();) {
      std::size_t end = c + 1;
      while (end < columns_.size() && pick(columns_[end]) == pick(columns_[c])) ++end;
      draw(pick(columns_[c]), c, end);
      c = end;
    }
  }

  // A line through all points, or through the extremes of each column when there are too many to see.
  [[nodiscard]] std::string path(const Points& points, const std::function<double(double)>& y) const {
    std::string d;
    bool down = false;
    const auto go = [&](const std::pair<double, double>& p) {
      d += (down ? 'L' : 'M') + px(x(p.first)) + ' ' + px(y(p.second));
      down = true;
    };
    if (points.size() <= 2 * kColumns) {
      for (const auto& p : points) std::isnan(p.second) ? void(down = false) : go(p);
      return d;
    }
    for (std::size_t i = 0; i < points.size();) {
      const std::size_t c = column(points[i].first);
      std::size_t low = points.size(), high = points.size();
      for (; i < points.size() && column(points[i].first) == c; ++i) {
        if (std::isnan(points[i].second)) continue;
        if (low == points.size() || points[i].second < points[low].second) low = i;
        if (high == points.size() || points[i].second > points[high].second) high = i;
      }
      if (low == points.size()) {
        down = false;
        continue;
      }
      go(points[std::min(low, high)]);
      if (low != high) go(points[std::max(low, high)]);
    }
    return d;
  }

  // `threshold`: a line at this value; 0: none.
  void panel(const std::string& name, const std::string& unit, int height, double floor,
             const std::vector<Curve>& curves, double threshold = 0) {
    double low = std::isnan(floor) ? 0 : floor, high = threshold;
    for (const Curve& curve : curves) {
      for (const auto& [t, v] : curve.points) {
        if (std::isnan(v)) continue;
        low = std::min(low, v);
        high = std::max(high, v);
      }
    }
    const double margin = 0.04 * (high - low);
    const Axis axis = nice_axis(low < 0 ? low - margin : low, high + margin, std::max(2, height / 22));
    const double plot_top = y_ + 20, plot_bottom = plot_top + height;
    const auto y = [&](double v) { return plot_bottom - (v - axis.low) / (axis.high - axis.low) * height; };
    for (const double v : ticks(axis)) {
      const bool zero = std::fabs(v) < axis.step / 4;
      body_ += fmt::format(R"(<path class="{}" d="M{} {}H{}"/><text x="{}" y="{}" text-anchor="end">{}</text>)",
                           zero ? "zero" : "grid", kLeft, px(y(v)), kLeft + kColumns, kLeft - 7, px(y(v) + 4),
                           tick_text(zero ? 0 : v, axis.decimals));
    }
    body_ += fmt::format(R"(<text class="name" x="{}" y="{}">{} <tspan font-weight="400">{}</tspan></text>)", kLeft,
                         px(y_ + 13), escape(name), unit.empty() ? "" : "(" + escape(unit) + ")");
    if (threshold > 0) {
      body_ += fmt::format(
          R"(<path class="truth" d="M{} {}H{}"/><text class="mark" x="{}" y="{}" text-anchor="end">threshold {:.0f}</text>)",
          kLeft, px(y(threshold)), kLeft + kColumns, kLeft + kColumns - 3, px(y(threshold) - 4), threshold);
    }
    double legend_x = kLeft + kColumns;
    // NOLINTNEXTLINE(modernize-loop-convert): clang 14 cannot read libstdc++ 12's std::views
    for (auto curve = curves.rbegin(); curve != curves.rend(); ++curve) {
      if (curve->label.empty()) continue;
      legend_x -= 28 + 7.5 * static_cast<double>(curve->label.size());
      body_ += fmt::format(R"(<path class="{}" d="M{} {}h22"/><text x="{}" y="{}">{}</text>)", curve->css, px(legend_x),
                           px(y_ + 9), px(legend_x + 27), px(y_ + 13), curve->label);
    }
    for (const Curve& curve : curves) {
      const bool dense = curve.points.size() > kColumns;
      body_ += fmt::format(R"(<path class="{}{}" d="{}"/>)", curve.css, dense ? " dense" : "", path(curve.points, y));
    }
    y_ = plot_bottom + 16;
  }

  // What decides, with its threshold. Without a picture between the dots the markers do, whose figures follow below.
  void why() {
    double threshold = 0;
    bool any = false;
    for (const FrameRecord& f : frames_) {
      any = any || f.contact_known;
      if (f.evidence == Evidence::kImprint) threshold = f.evidence_threshold;
    }
    if (!any) return;
    panel("Imprint's motion against the gel in 0.16 s", "um", 128, 0,
          {{"a", "imprint", series(&FrameRecord::imprint_um, &FrameRecord::features_valid)},
           {"b", "coarse", series(&FrameRecord::coarse_um, &FrameRecord::features_valid)}},
          threshold);
  }

  // The forces, and how much of the friction they use. Without a reading nothing.
  void loads() {
    Points shear, normal, use;
    load::Basis basis = load::Basis::kNone;
    for (const FrameRecord& f : frames_) {
      const bool known = f.features_valid && f.load_basis != load::Basis::kNone;
      if (known) basis = f.load_basis;
      shear.emplace_back(f.t_s(), known ? std::hypot(f.shear_x_n, f.shear_y_n) : kNone);
      normal.emplace_back(f.t_s(), known ? f.normal_n : kNone);
      use.emplace_back(f.t_s(), known && f.friction_use > 0 ? f.friction_use : kNone);
    }
    if (basis == load::Basis::kNone) return;
    const std::string how = basis == load::Basis::kNominal ? ", uncalibrated" : "";
    panel("Load on the gel", "N" + how, 96, 0, {{"a", "shear", shear}, {"b", "normal", normal}});
    panel("Friction use: shear over normal load", how.empty() ? "" : how.substr(2), 84, 0, {{"a", "", use}});
  }

  void row_name(std::string_view name, double height) {
    body_ += fmt::format(R"(<text class="name small" x="{}" y="{}" text-anchor="end">{}</text>)", kLeft - 7,
                         px(y_ + height / 2 + 4), name);
  }

  void state_band() {
    constexpr double kHeight = 22;
    row_name("State", kHeight);
    runs([](const Column& c) { return c.severity; },
         [&](int worst, std::size_t from, std::size_t to) {
           if (worst < 0) return;
           const StateLook& look = kBySeverity[static_cast<std::size_t>(worst)];
           const std::string_view name = holdfast::info(look.state).name;
           const auto width = static_cast<double>(to - from);
           body_ += fmt::format(R"(<rect class="state {}" x="{}" y="{}" width="{}" height="{}"/>)", look.css,
                                kLeft + from, px(y_), to - from, kHeight);
           if (width > 8.5 * static_cast<double>(name.size()) + 8) {
             body_ += fmt::format(R"(<text class="in {}" x="{}" y="{}">{}</text>)", look.css,
                                  px(kLeft + static_cast<double>(from) + width / 2), px(y_ + 15), name);
           }
         });
    y_ += kHeight + 10;
  }

  void grip_line() {
    constexpr double kHeight = 24;
    row_name("GRIP_OK", kHeight);
    const std::string high = px(y_ + 1), low = px(y_ + kHeight);
    std::string d;
    runs([](const Column& c) { return c.severity < 0 ? -1 : (c.high ? 1 : 0) + (c.low ? 2 : 0); },
         [&](int level, std::size_t from, std::size_t to) {
           const std::size_t x0 = kLeft + from, x1 = kLeft + to;
           const auto step = [&](const std::string& y) {
             d += d.empty() ? fmt::format("M{} {}", x0, y) : "V" + y;
             d += fmt::format("H{}", x1);
           };
           if (level == 1) {
             body_ += fmt::format(R"(<rect class="high" x="{}" y="{}" width="{}" height="{}"/>)", x0, high, to - from,
                                  kHeight - 1);
             step(high);
           } else if (level == 2) {
             step(low);
           } else if (level == 3) {  // both within a column: an upright line, then as the next column says
             step(high);
             d += "V" + low;
           }
         });
    body_ += fmt::format(R"(<path class="io" d="{}"/>)", d);
    y_ += kHeight + 10;
  }

  void alive_line() {
    constexpr double kHeight = 20;
    row_name("ALIVE", kHeight);
    const double high = y_ + 1, low = y_ + kHeight;
    if (edges_ <= kMaxAliveEdges) {
      std::string d = fmt::format("M{} {}", kLeft, px(low));
      bool level = false;
      for (const FrameRecord& f : frames_) {
        if (!f.accepted) continue;
        level = !level;
        d += fmt::format("H{}V{}", px(x(f.t_s())), px(level ? high : low));
      }
      body_ += fmt::format(R"(<path class="io" d="{}H{}"/>)", d, kLeft + kColumns);
    } else {
      body_ += fmt::format(R"(<path class="io" d="M{} {}H{}"/>)", kLeft, px(low), kLeft + kColumns);
      runs([](const Column& c) { return c.fresh ? 1 : 0; },
           [&](int fresh, std::size_t from, std::size_t to) {
             if (fresh == 0) return;
             body_ += fmt::format(R"(<rect class="fresh" x="{}" y="{}" width="{}" height="{}"/>)", kLeft + from,
                                  px(high), to - from, kHeight - 1);
           });
    }
    y_ += kHeight + 14;
  }

  void time_axis(double bottom) {
    const Axis axis = nice_axis(t0_, t0_ + kColumns / scale_, 10);
    body_ += fmt::format(R"(<path class="axis" d="M{} {}H{}"/>)", kLeft, px(bottom), kLeft + kColumns);
    for (const double t : ticks(axis)) {
      body_ +=
          fmt::format(R"(<path class="axis" d="M{0} {1}v5"/><text x="{0}" y="{2}" text-anchor="middle">{3}</text>)",
                      px(x(t)), px(bottom), px(bottom + 18), tick_text(t, axis.decimals));
    }
    body_ += fmt::format(R"(<text x="{}" y="{}" text-anchor="middle">time of the recording (s)</text>)",
                         kLeft + kColumns / 2, px(bottom + 34));
  }

  [[nodiscard]] std::string shading(double bottom) const {
    std::string out;
    runs([](const Column& c) { return c.slip ? 1 : 0; },
         [&](int slip, std::size_t from, std::size_t to) {
           if (slip == 0) return;
           out += fmt::format(R"(<rect class="shade" x="{}" y="{}" width="{}" height="{}"/>)", kLeft + from, px(top_),
                              to - from, px(bottom - top_));
         });
    return out;
  }

  // The onset is named first; other marks where there is room left (the line stays, the summary names it).
  [[nodiscard]] std::string marks(double bottom) const {
    std::string out;
    std::vector<std::pair<double, double>> taken;
    for (const bool onset : {true, false}) {
      for (const TruthMark& mark : info_.marks) {
        const double at = x(mark.t_s);
        if (mark.onset != onset || !(at >= kLeft && at <= kLeft + kColumns)) continue;
        out += fmt::format(R"(<path class="truth" d="M{} {}V{}"/>)", px(at), px(top_ - 4), px(bottom));
        const double width = 7.0 * static_cast<double>(mark.name.size());
        const bool left = at + width > kWidth;
        const std::pair<double, double> room{left ? at - width : at, left ? at : at + width};
        const bool free = std::none_of(taken.begin(), taken.end(), [&](const auto& other) {
          return room.first < other.second && other.first < room.second;
        });
        if (!free) continue;
        taken.push_back(room);
        out += fmt::format(R"(<text class="mark" x="{}" y="{}" text-anchor="{}">{}</text>)", px(left ? at - 3 : at + 3),
                           px(top_ - 8), left ? "end" : "start", escape(mark.name));
      }
    }
    return out;
  }

  const std::vector<FrameRecord>& frames_;
  const ReportInfo& info_;
  std::array<Column, kColumns> columns_{};
  std::size_t edges_ = 0;
  double t0_ = 0, last_dt_s_ = 0, scale_ = 1;  // scale: drawing units per second
  double y_ = 0, top_ = 0;
  std::string body_;
};

struct Card {
  std::string_view name;
  const Report::Moment* moment;
};

// One factor for all pictures, so that they can be compared: 1, 2 or 5 times a power of ten, the longest
// arrow at most an eighth of the picture (about a pitch of a 7x9 grid).
double common_factor(const std::vector<Card>& cards, double width) {
  double longest = 0;
  for (const Card& card : cards) {
    for (const Arrow& a : card.moment->arrows) {
      if (a.valid) longest = std::max(longest, std::hypot(a.dx_px, a.dy_px));
    }
  }
  double factor = 1;
  if (longest <= 0) return factor;
  for (const double candidate : {2.0, 5.0, 10.0, 20.0, 50.0}) {
    if (candidate * longest <= width / 8) factor = candidate;
  }
  return factor;
}

std::string quiver(const Report::Moment& moment, const ReportInfo& info, double factor) {
  double left = 0, top = 0, width = info.width_px, height = info.height_px;
  if (width <= 0 || height <= 0) {
    double right = -1e9, bottom = -1e9;
    left = top = 1e9;
    for (const Arrow& a : moment.arrows) {
      left = std::min(left, a.x_px), right = std::max(right, a.x_px);
      top = std::min(top, a.y_px), bottom = std::max(bottom, a.y_px);
    }
    const double margin = 0.1 * std::max({right - left, bottom - top, 10.0});
    left -= margin, top -= margin;
    width = right + margin - left, height = bottom + margin - top;
  }
  // Drawn 300 units wide whatever the picture's size, so that lines and dots look the same.
  const double k = 300 / width;
  const auto at_x = [&](double v) { return (v + 0.5 - left) * k; };
  const auto at_y = [&](double v) { return (v + 0.5 - top) * k; };
  std::string out = fmt::format(R"(<svg viewBox="0 0 300 {0}" role="img" aria-label="marker displacement">)"
                                R"(<rect class="axis" x="0.5" y="0.5" width="299" height="{1}"/>)",
                                px(height * k), px(height * k - 1));
  for (const Arrow& a : moment.arrows) {
    if (!a.valid) {
      out += fmt::format(R"(<path class="lost" stroke-width="1.6" d="M{0} {1}l8 8m0 -8l-8 8"/>)", px(at_x(a.x_px) - 4),
                         px(at_y(a.y_px) - 4));
      continue;
    }
    const double x0 = at_x(a.x_px - a.dx_px), y0 = at_y(a.y_px - a.dy_px);
    const double dx = factor * a.dx_px * k, dy = factor * a.dy_px * k, length = std::hypot(dx, dy);
    out += fmt::format(R"(<circle class="rest" cx="{}" cy="{}" r="2.2"/>)", px(x0), px(y0));
    if (length < 1) continue;
    const double head = std::min(6.0, 0.6 * length), ux = dx / length, uy = dy / length;
    const double tip_x = x0 + dx, tip_y = y0 + dy, neck_x = tip_x - head * ux, neck_y = tip_y - head * uy;
    out += fmt::format(
        R"(<path class="arrow" stroke-width="1.5" d="M{} {}L{} {}"/><path class="head" d="M{} {}L{} {}L{} {}Z"/>)",
        px(x0), px(y0), px(neck_x), px(neck_y), px(tip_x), px(tip_y), px(neck_x - 0.45 * head * uy),
        px(neck_y + 0.45 * head * ux), px(neck_x + 0.45 * head * uy), px(neck_y - 0.45 * head * ux));
  }
  return out + "</svg>";
}

std::string histogram(const FrameRecord& frame, const ReportInfo& info) {
  constexpr double kHigh = 84, kBottom = 96, kX0 = 26, kBar = 18;
  const std::uint32_t most = std::max(1U, *std::max_element(frame.histogram.begin(), frame.histogram.end()));
  std::string out = R"(<svg viewBox="0 0 300 130" role="img" aria-label="displacement histogram">)";
  const Axis axis = nice_axis(0, most * 1.04, 3);
  for (const double v : ticks(axis)) {
    const double y = kBottom - v / axis.high * kHigh;
    out += fmt::format(R"(<path class="grid" d="M{} {}H296"/><text x="{}" y="{}" text-anchor="end">{}</text>)", kX0,
                       px(y), kX0 - 4, px(y + 4), tick_text(v, axis.decimals));
  }
  for (int i = 0; i < kHistogramBins; ++i) {
    const double height = frame.histogram[static_cast<std::size_t>(i)] / axis.high * kHigh;
    if (height > 0) {
      out += fmt::format(R"(<rect class="bar" x="{}" y="{}" width="{}" height="{}"/>)", px(kX0 + i * kBar + 1),
                         px(kBottom - height), kBar - 2, px(height));
    }
  }
  const double range = info.histogram_range_mm > 0 ? info.histogram_range_mm : kHistogramBins;
  for (const int bin : {0, 5, 10, 15}) {
    out += fmt::format(R"(<text x="{}" y="110" text-anchor="middle">{:.2g}{}</text>)", px(kX0 + bin * kBar),
                       range * bin / kHistogramBins, bin == kHistogramBins ? "+" : "");
  }
  return out + fmt::format(R"(<text x="{}" y="126" text-anchor="middle">displacement ({}), markers</text></svg>)",
                           px(kX0 + kBar * kHistogramBins / 2), info.histogram_range_mm > 0 ? "mm" : "bin");
}

// Frames in which `slip` begins.
std::vector<std::size_t> slip_starts(const std::vector<FrameRecord>& frames) {
  std::vector<std::size_t> starts;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (frames[i].slip && (i == 0 || !frames[i - 1].slip)) starts.push_back(i);
  }
  return starts;
}

// Why a frame says slip, in a sentence.
std::string why_text(const FrameRecord& frame) {
  constexpr std::array<std::string_view, 5> kWords{"", "the imprint moved against the gel by",
                                                   "the imprint's coarse shape moved against the gel by",
                                                   "the markers' flow is", ""};
  const std::string_view words = kWords[static_cast<std::size_t>(frame.evidence)];
  if (words.empty()) return "";
  std::string out = fmt::format("{} {:.3g} {} (threshold {:.3g})", words, frame.evidence_value, frame.evidence_unit,
                                frame.evidence_threshold);
  if (frame.evidence_frames > 1) out += fmt::format(", {} frames in a row", frame.evidence_frames);
  return out;
}

struct Delay {
  bool raised = false;
  bool early = false;  // raised already when the onset came
  long frames = 0;
  double ms = 0;
  std::size_t at = 0;
};

// Frames keep whole microseconds, marks do not.
bool is_before(const FrameRecord& frame, double t_s) {
  return frame.t_s() < t_s - 0.5e-6;
}

// From the first frame that could show the onset to the first frame that says slip.
Delay delay_from(const std::vector<FrameRecord>& frames, double onset_s) {
  Delay delay;
  const auto first = std::find_if(frames.begin(), frames.end(), [&](const auto& f) { return !is_before(f, onset_s); });
  const auto raised = std::find_if(first, frames.end(), [](const FrameRecord& f) { return f.slip; });
  if (raised == frames.end()) return delay;
  delay.raised = true;
  delay.early = raised == first && first != frames.begin() && std::prev(first)->slip;
  delay.frames = static_cast<long>(raised - first);
  delay.ms = std::max(raised->t_s() - onset_s, 0.0) * 1000;
  delay.at = static_cast<std::size_t>(raised - frames.begin());
  return delay;
}

std::string delay_text(const Delay& delay, const std::string& mark) {
  if (!delay.raised) return fmt::format("Slip was not raised after {}", mark);
  if (delay.early) return fmt::format("Slip was already raised at {}", mark);
  if (delay.frames == 0) return fmt::format("Slip raised in the first frame of {} ({:.0f} ms)", mark, delay.ms);
  return fmt::format("Slip raised {} ({:.0f} ms) after {}", plural(delay.frames, "frame"), delay.ms, mark);
}

struct Totals {
  long accepted = 0, with_features = 0, grip_ok = 0;
  double mean_markers = 0;
  std::uint32_t worst_markers = 0;
  long worst_markers_frame = 0;
  std::map<Reason, long> reasons;
};

Totals summarise(const std::vector<FrameRecord>& frames) {
  Totals s;
  s.worst_markers = std::numeric_limits<std::uint32_t>::max();
  for (const FrameRecord& f : frames) {
    s.accepted += f.accepted ? 1 : 0;
    s.grip_ok += f.grip_ok ? 1 : 0;
    if (f.reason != Reason::kNone) ++s.reasons[f.reason];
    if (!f.features_valid) continue;
    ++s.with_features;
    s.mean_markers += f.markers;
    if (f.markers < s.worst_markers) s.worst_markers = f.markers, s.worst_markers_frame = f.frame;
  }
  if (s.with_features > 0) s.mean_markers /= static_cast<double>(s.with_features);
  return s;
}

std::string percent(long part, std::size_t whole) {
  const double value = 100.0 * static_cast<double>(part) / static_cast<double>(whole);
  // "100 %" is said only when it is true.
  return part == static_cast<long>(whole) ? "100 %" : fmt::format("{:.1f} %", std::min(value, 99.9));
}

std::string verdict(const std::vector<FrameRecord>& frames, const ReportInfo& info,
                    const std::vector<std::size_t>& starts) {
  std::string text, small;
  std::string_view css = starts.empty() ? "ok" : "slip";
  const auto onset = std::find_if(info.marks.begin(), info.marks.end(), [](const auto& m) { return m.onset; });
  if (onset != info.marks.end()) {
    const Delay delay = delay_from(frames, onset->t_s);
    text = delay_text(delay, onset->name);
    small = fmt::format("Truth: {} at {:.3f} s.", onset->name, onset->t_s);
    if (delay.raised)
      small += fmt::format(" Raised in frame {}, {:.3f} s.", frames[delay.at].frame, frames[delay.at].t_s());
    const auto before =
        std::count_if(starts.begin(), starts.end(), [&](std::size_t i) { return is_before(frames[i], onset->t_s); });
    small += fmt::format(" {} before it.", before == 0 ? "No alarm" : plural(before, "alarm"));
    if (!delay.raised) css = "fault";
  } else if (starts.empty()) {
    text = "No slip raised";
    small = fmt::format("{} over {:.2f} s.", plural(static_cast<long>(frames.size()), "frame"),
                        frames.back().t_s() - frames.front().t_s());
  } else {
    const FrameRecord& first = frames[starts.front()];
    text = fmt::format("Slip raised {}, first at {:.3f} s",
                       starts.size() == 1 ? "once" : plural(static_cast<long>(starts.size()), "time"), first.t_s());
    small = fmt::format("First in frame {}.", first.frame);
    if (const std::string why = why_text(first); !why.empty()) small += " Why: " + why + ".";
  }
  return fmt::format(R"(<div class="verdict {}">{}<small>{}</small></div>)", css, escape(text), escape(small));
}

std::string tile(const std::string& value, const std::string& name) {
  return fmt::format("<div class=\"tile\"><b>{}</b><span>{}</span></div>", escape(value), escape(name));
}

std::string row(const std::string& name, const std::string& value) {
  return value.empty() ? "" : fmt::format("<tr><th>{}</th><td>{}</td></tr>\n", escape(name), escape(value));
}

std::string summary_table(const std::vector<FrameRecord>& frames, const ReportInfo& info, const Totals& s,
                          const std::vector<std::size_t>& starts) {
  std::string out = "<table>";
  out += row("Input", info.input) + row("Grid", info.grid) + row("Mode", info.mode) + row("Model", info.model) +
         row("Reference", info.reference);
  out += row("Frames", fmt::format("{} over {:.3f} s", frames.size(), frames.back().t_s() - frames.front().t_s()));
  out += row("Accepted frames", fmt::format("{} ({})", s.accepted, percent(s.accepted, frames.size())));
  if (s.with_features > 0) {
    out += row("Markers", fmt::format("mean {:.2f} of {}, worst {} in frame {}", s.mean_markers, info.grid_markers,
                                      s.worst_markers, s.worst_markers_frame));
  }
  std::string times;
  constexpr std::size_t kListed = 12;
  for (std::size_t i = 0; i < std::min(starts.size(), kListed); ++i) {
    times += fmt::format("{}{:.3f} s (frame {})", i == 0 ? "" : ", ", frames[starts[i]].t_s(), frames[starts[i]].frame);
  }
  if (starts.size() > kListed) times += fmt::format(" and {} more", starts.size() - kListed);
  out += row("Slip raised", starts.empty() ? "never" : times);
  for (const TruthMark& mark : info.marks) {
    out +=
        row("Truth: " + mark.name, fmt::format("{:.3f} s", mark.t_s) +
                                       (mark.onset ? ". " + delay_text(delay_from(frames, mark.t_s), mark.name) : ""));
  }
  out += row("GRIP_OK HIGH", fmt::format("{} frames ({})", s.grip_ok, percent(s.grip_ok, frames.size())));
  out += row("Saturated values", std::to_string(info.saturations));
  for (const auto& [name, value] : info.facts) out += row(name, value);
  return out + "</table>";
}

std::string reason_table(const Totals& s) {
  if (s.reasons.empty()) return "";
  std::string out = "<h2>Reasons given</h2>\n<table class=\"wide\">";
  out +=
      "<tr><th>Reason</th><th style=\"text-align:right\">Frames</th><th>What</th><th>Likely "
      "cause</th><th>Next step</th></tr>\n";
  for (const auto& [reason, count] : s.reasons) {
    const ReasonInfo& r = holdfast::info(reason);
    out += fmt::format("<tr><td>{}</td><td class=\"n\">{}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n", escape(r.name),
                       count, escape(r.what), escape(r.cause), escape(r.next));
  }
  return out + "</table>\n";
}

// Each alarm with what it stands on, and each loss of the contact.
std::string alarm_table(const std::vector<FrameRecord>& frames, const std::vector<std::size_t>& starts) {
  constexpr std::size_t kListed = 40;
  struct Event {
    const FrameRecord* frame;
    std::string what, why;
  };
  std::vector<Event> events;
  events.reserve(starts.size());
  for (const std::size_t i : starts) events.push_back({&frames[i], "slip raised", why_text(frames[i])});
  for (std::size_t i = 1; i < frames.size(); ++i) {
    if (frames[i].reason != Reason::kContactLost || frames[i - 1].reason == Reason::kContactLost) continue;
    events.push_back({&frames[i], "contact lost", "the contact ended, and nobody said that the gripper opens"});
  }
  if (events.empty()) return "";
  std::stable_sort(events.begin(), events.end(),
                   [](const Event& a, const Event& b) { return a.frame->frame < b.frame->frame; });
  std::string out =
      "<h2>Alarms, and why</h2>\n<table class=\"wide\"><tr><th>Frame</th><th>Time (s)</th><th>What</th>"
      "<th>Why</th><th>Contact</th></tr>\n";
  for (const Event& event : std::span(events).first(std::min(events.size(), kListed))) {
    out += fmt::format("<tr><td class=\"n\">{}</td><td class=\"n\">{:.3f}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n",
                       event.frame->frame, event.frame->t_s(), event.what, escape(event.why),
                       event.frame->contact_known ? contact::kPhaseNames[static_cast<std::size_t>(event.frame->contact)]
                                                  : std::string_view("not known"));
  }
  out += "</table>\n";
  if (events.size() > kListed) out += fmt::format("<p class=\"note\">and {} more</p>\n", events.size() - kListed);
  return out;
}

std::string state_legend(const std::vector<FrameRecord>& frames, bool shaded) {
  const auto accepted = static_cast<std::size_t>(
      std::count_if(frames.begin(), frames.end(), [](const FrameRecord& f) { return f.accepted; }));
  std::array<bool, kBySeverity.size()> seen{};
  for (const FrameRecord& f : frames) seen[static_cast<std::size_t>(severity(f.state))] = true;
  std::string out = "<div class=\"legend\">";
  for (std::size_t i = 0; i < seen.size(); ++i) {
    if (!seen[i]) continue;
    const StateInfo& state = holdfast::info(kBySeverity[i].state);
    out += fmt::format(R"(<span class="{}"><i class="chip"></i><b>{}</b> {}</span>)", kBySeverity[i].css,
                       escape(state.name), escape(state.meaning));
  }
  if (shaded) out += R"(<span class="slip"><i class="chip" style="opacity:.3"></i>shaded: slip decision raised</span>)";
  if (accepted > kMaxAliveEdges) out += "<span><b>ALIVE</b> filled while its last edge is younger than 150 ms</span>";
  return out + "</div>";
}

}  // namespace

void Report::add(const FrameRecord& frame, std::span<const Arrow> arrows, const TrackPicture& picture) {
  const auto keep = [&] { return Moment{frame, {arrows.begin(), arrows.end()}}; };
  if (frame.slip && !first_slip_) first_slip_ = keep();
  if (frame.features_valid) {
    if (rest_frame_ >= 0 ? frame.frame == static_cast<std::uint32_t>(rest_frame_) : !rest_) rest_ = keep();
    if (!peak_ || frame.entropy_nat > peak_->frame.entropy_nat) peak_ = keep();
    end_ = keep();
  }
  frames_.push_back(frame);
  track_.add(frame, arrows, picture);
}

std::string Report::html(const ReportInfo& info) const {
  std::string out = page::begin(info.title);
  out += fmt::format("<header><h1>{}</h1><p class=\"sub\">{}</p></header>\n", escape(info.title), escape(info.input));
  if (frames_.empty()) return out + "<p>The recording gave no frames.</p>\n" + page::end("null");

  const std::vector<std::size_t> starts = slip_starts(frames_);
  const Totals s = summarise(frames_);
  out += "<div class=\"recorded\">" + verdict(frames_, info, starts) + "</div>\n";
  out += "<div class=\"watch\">\n" + page::explorer();

  TimePlots plots(frames_, info);
  out += "<div class=\"recorded\"><h2>Over time</h2>\n<figure>" + plots.svg() +
         "\n<p class=\"readout\" id=\"readout\">&#160;</p>" + state_legend(frames_, !starts.empty()) +
         "</figure></div></div>\n<div class=\"recorded\">" + alarm_table(frames_, starts);

  std::vector<Card> cards;
  const auto offer = [&](std::string_view name, const std::optional<Moment>& moment) {
    if (moment) cards.push_back({name, &*moment});
  };
  offer(rest_frame_ >= 0 ? "Rest" : "First", rest_), offer("Largest entropy", peak_), offer("First slip", first_slip_),
      offer("End", end_);
  if (!cards.empty()) {
    double width = info.width_px;
    for (const Card& card : cards) {
      for (const Arrow& a : card.moment->arrows) width = info.width_px > 0 ? width : std::max(width, a.x_px);
    }
    const double factor = info.arrow_factor > 0 ? info.arrow_factor : common_factor(cards, width);
    out += fmt::format(
        "<h2>Chosen moments</h2>\n<p class=\"sub\">Arrows start at the marker's rest position and show {} times its "
        "displacement; a cross marks a lost marker.</p>\n<div class=\"moments\">\n",
        fmt::format("{:g}", factor));
    for (const Card& card : cards) {
      const FrameRecord& f = card.moment->frame;
      out += fmt::format("<figure><h3>{}</h3><figcaption>frame {}, {:.3f} s · {}{}</figcaption>", card.name, f.frame,
                         f.t_s(), holdfast::info(f.state).name,
                         f.features_valid ? fmt::format("<br/>E = {:.3f} nat", f.entropy_nat) : "");
      if (!card.moment->arrows.empty()) out += quiver(*card.moment, info, factor);
      if (f.features_valid) out += histogram(f, info);
      out += "</figure>\n";
    }
    out += "</div>\n";
  }

  out += "<h2>Summary</h2>\n<div class=\"tiles\">" + tile(std::to_string(frames_.size()), "frames") +
         tile(percent(s.accepted, frames_.size()), "accepted") +
         tile(s.with_features > 0 ? fmt::format("{:.2f} / {}", s.mean_markers, s.worst_markers) : "–",
              fmt::format("markers of {}, mean / worst", info.grid_markers)) +
         tile(std::to_string(starts.size()), "times slip raised") +
         tile(percent(s.grip_ok, frames_.size()), "of frames with GRIP_OK HIGH") + "</div>\n" +
         summary_table(frames_, info, s, starts) + "\n" + reason_table(s);
  if (!info.notes.empty()) {
    out += "<h2>Notes</h2>\n";
    for (const std::string& note : info.notes) out += "<p class=\"note\">" + escape(note) + "</p>\n";
  }
  out +=
      "<p class=\"note\" style=\"margin-top:28px\">GRIP_OK counts only while the last ALIVE edge is younger than 150 "
      "ms. Holdfast is not a certified safety function.</p>\n";
  return out + "</div>\n" + page::end(track_.json(info));
}

std::string Report::write(const std::filesystem::path& path, const ReportInfo& info,
                          const std::filesystem::path& input) const {
  AtomicFile file(path, input);
  if (!file.error().empty()) return file.error();
  file.stream() << html(info);
  return file.commit();
}

}  // namespace holdfast::tool
