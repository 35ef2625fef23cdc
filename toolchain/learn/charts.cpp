// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/charts.hpp"
#include "toolchain/support/escape.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

namespace holdfast::learn::charts {
namespace {

constexpr std::array<std::string_view, 7> kColors{"#0072b2", "#d55e00", "#009e73", "#cc79a7",
                                                  "#56b4e9", "#e69f00", "#000000"};
constexpr std::string_view kInk = "#1d2126";
constexpr std::string_view kSoft = "#4a525b";
constexpr std::string_view kGrid = "#e4e7ea";

std::string_view color(std::size_t i) {
  return kColors[i % kColors.size()];
}

struct Scale {
  double low = 0.0;
  double high = 1.0;
  double from = 0.0;  // drawing units at `low`
  double to = 1.0;    // and at `high`

  [[nodiscard]] double operator()(double value) const {
    return from + (std::clamp(value, low, high) - low) / (high - low) * (to - from);
  }
};

// About `count` ticks at 1, 2 or 5 times a power of ten.
std::vector<double> ticks(double low, double high, int count) {
  const double rough = (high - low) / count;
  const double power = std::pow(10.0, std::floor(std::log10(rough)));
  const double lead = rough / power;
  const double step = (lead <= 1.0 ? 1.0 : lead <= 2.0 ? 2.0 : lead <= 5.0 ? 5.0 : 10.0) * power;
  std::vector<double> out;
  for (double i = std::ceil(low / step - 1e-6); i * step <= high + 1e-6 * step; ++i)
    out.push_back(i * step + 0.0);  // not -0
  return out;
}

class Svg {
 public:
  Svg(double width, double height, std::string_view title) : width_(width), height_(height), title_(title) {
    if (!title.empty()) text(12, 22, "start", title, 14, kInk, true);
  }

  void text(double x, double y, std::string_view anchor, std::string_view what, int size = 11,
            std::string_view fill = kSoft, bool bold = false) {
    body_ +=
        fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\" font-size=\"{}\" fill=\"{}\"{}>{}</text>\n", x,
                    y, anchor, size, fill, bold ? " font-weight=\"600\"" : "", tool::escape(what));
  }
  void box(double x, double y, double width, double height, std::string_view fill) {
    body_ += fmt::format("<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\" fill=\"{}\"/>\n", x, y,
                         width, height, fill);
  }
  void path(const std::string& d, std::string_view stroke, double width = 1.0, std::string_view more = "") {
    body_ +=
        fmt::format("<path d=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{}\"{}/>\n", d, stroke, width, more);
  }
  void line(double x0, double y0, double x1, double y1, std::string_view stroke = kGrid, double width = 1.0) {
    path(fmt::format("M{:.1f} {:.1f}L{:.1f} {:.1f}", x0, y0, x1, y1), stroke, width);
  }
  // Ticks of an upright axis, with lines across.
  void upright(const Scale& y, double left, double right, int count) {
    for (const double v : ticks(y.low, y.high, count)) {
      line(left, y(v), right, y(v));
      text(left - 6, y(v) + 4, "end", fmt::format("{:g}", v));
    }
  }
  [[nodiscard]] std::string done() const {
    return fmt::format(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0:.0f}\" height=\"{1:.0f}\" viewBox=\"0 0 {0:.0f} "
        "{1:.0f}\" "
        "role=\"img\" aria-label=\"{2}\" font-family=\"system-ui,sans-serif\">\n"
        "<rect width=\"{0:.0f}\" height=\"{1:.0f}\" fill=\"#ffffff\"/>\n{3}</svg>\n",
        width_, height_, tool::escape(title_), body_);
  }

 private:
  double width_;
  double height_;
  std::string title_;
  std::string body_;
};

// Room that a legend's entry takes: a sans-serif character of 11 units is 6.3 wide on average.
double entry_width(std::string_view name) {
  return 34.0 + 6.3 * static_cast<double>(name.size());
}

}  // namespace

std::string draw(const Bars& chart) {
  constexpr double kLeft = 48, kTop = 62, kPlot = 220, kBottom = 46;
  const auto groups = static_cast<double>(chart.groups.size());
  const auto solid = static_cast<double>(
      std::count_if(chart.series.begin(), chart.series.end(), [](const Bars::Series& s) { return !s.mark; }));
  const double pitch = std::max(70.0, 16.0 * solid + 20.0);
  double legend_width = 12;
  for (const Bars::Series& series : chart.series) legend_width += entry_width(series.name);
  const double width = std::max({kLeft + pitch * groups + 16, legend_width, 420.0});
  Svg svg(width, kTop + kPlot + kBottom, chart.title);
  const Scale y{chart.low, chart.high, kTop + kPlot, kTop};
  svg.upright(y, kLeft, kLeft + pitch * groups, 5);
  svg.text(12, kTop - 8, "start", chart.unit);
  double legend = 12;
  double slot = 0;
  const double bar = (pitch - 20.0) / std::max(1.0, solid);
  for (std::size_t s = 0; s < chart.series.size(); ++s) {
    const Bars::Series& series = chart.series[s];
    if (series.mark) {
      svg.line(legend, 36, legend + 14, 36, kInk, 2.5);
    } else {
      svg.box(legend, 30, 12, 12, color(s));
    }
    svg.text(legend + 18, 40, "start", series.name);
    legend += entry_width(series.name);
    for (std::size_t g = 0; g < chart.groups.size() && g < series.values.size(); ++g) {
      if (!series.values[g]) continue;
      const double left = kLeft + pitch * static_cast<double>(g);
      const double top = y(*series.values[g]);
      if (series.mark) {
        svg.line(left + 4, top, left + pitch - 4, top, kInk, 2.5);
      } else {
        svg.box(left + 10 + bar * slot, top, bar - 2, y(chart.low) - top, color(s));
      }
    }
    slot += series.mark ? 0 : 1;
  }
  svg.line(kLeft, y(chart.low), kLeft + pitch * groups, y(chart.low), kSoft);
  for (std::size_t g = 0; g < chart.groups.size(); ++g) {
    // Long names in two rows, so that neighbours do not run into each other.
    const bool lower = g % 2 == 1 && pitch < 90;
    svg.text(kLeft + pitch * (static_cast<double>(g) + 0.5), kTop + kPlot + (lower ? 32 : 16), "middle",
             chart.groups[g], 11, kInk);
  }
  return svg.done();
}

std::string draw(const Histograms& chart) {
  constexpr double kLeft = 48, kTop = 36, kHead = 20, kPlot = 90, kGap = 14, kWidth = 640, kBottom = 40;
  const double pitch = kHead + kPlot + kGap;
  const auto panels = static_cast<double>(chart.panels.size());
  Svg svg(kLeft + kWidth + 20, kTop + pitch * panels + kBottom, chart.title);
  const Scale x{0, chart.bin * chart.bins, kLeft, kLeft + kWidth};
  double top = kTop;
  for (const Histograms::Panel& panel : chart.panels) {
    std::vector<int> counts(static_cast<std::size_t>(chart.bins));
    for (const double value : panel.values) {
      ++counts[static_cast<std::size_t>(std::clamp(std::floor(value / chart.bin), 0.0, chart.bins - 1.0))];
    }
    const int most = std::max(1, *std::max_element(counts.begin(), counts.end()));
    svg.text(kLeft, top + 14, "start", panel.name, 12, kInk, true);
    svg.text(kLeft + kWidth, top + 14, "end", panel.note);
    const Scale y{0, static_cast<double>(most), top + kHead + kPlot, top + kHead};
    for (const double v : ticks(0, most, 3)) {
      if (v != std::floor(v)) continue;
      svg.line(kLeft, y(v), kLeft + kWidth, y(v));
      svg.text(kLeft - 6, y(v) + 4, "end", fmt::format("{:g}", v));
    }
    for (int b = 0; b < chart.bins; ++b) {
      const int count = counts[static_cast<std::size_t>(b)];
      if (count == 0) continue;
      const bool beyond = b == chart.bins - 1;
      svg.box(x(b * chart.bin) + 1, y(count), kWidth / chart.bins - 2, y(0) - y(count), color(beyond ? 1 : 0));
    }
    svg.line(kLeft, y(0), kLeft + kWidth, y(0), kSoft);
    top += pitch;
  }
  for (const double v : ticks(0, x.high, 10)) {
    if (v > x.high - 2.5 * chart.bin) continue;  // room for "more"
    svg.text(x(v), top + 4, "middle", fmt::format("{:g}", v));
  }
  svg.text(x(x.high - 0.5 * chart.bin), top + 4, "middle", "more");
  svg.text(kLeft + kWidth / 2, top + 24, "middle", chart.axis, 11, kInk);
  return svg.done();
}

std::string draw(const Clouds& chart) {
  constexpr double kSide = 400, kTop = 66, kGap = 24, kInset = 10;
  const auto panels = static_cast<double>(chart.panels.size());
  Svg svg(kGap + (kSide + kGap) * panels, kTop + kSide + 20, chart.title);
  svg.path("M18 38h0", color(0), 6, R"( stroke-linecap="round")");
  svg.text(28, 42, "start", chart.first_class);
  const double second = 28 + entry_width(chart.first_class);
  svg.path(fmt::format("M{:.1f} 38h8m-4 -4v8", second), color(1), 1.6);
  svg.text(second + 14, 42, "start", chart.second_class);
  double left = kGap;
  for (const Clouds::Panel& panel : chart.panels) {
    constexpr double kFar = std::numeric_limits<double>::infinity();
    double low_x = kFar, high_x = -kFar, low_y = kFar, high_y = -kFar;
    for (const Clouds::Dot& dot : panel.dots) {
      low_x = std::min(low_x, dot.x), high_x = std::max(high_x, dot.x);
      low_y = std::min(low_y, dot.y), high_y = std::max(high_y, dot.y);
    }
    const double span = std::max({high_x - low_x, high_y - low_y, 1e-9}) / 2;
    const double middle_x = (low_x + high_x) / 2;
    const double middle_y = (low_y + high_y) / 2;
    const Scale x{middle_x - span, middle_x + span, left + kInset, left + kSide - kInset};
    const Scale y{middle_y - span, middle_y + span, kTop + kSide - kInset, kTop + kInset};
    svg.text(left, kTop - 7, "start", panel.name, 12, kInk, true);
    svg.path(fmt::format("M{:.1f} {:.1f}h{:.1f}v{:.1f}h{:.1f}Z", left, kTop, kSide, kSide, -kSide), kSoft);
    std::string round;
    std::string cross;
    for (const Clouds::Dot& dot : panel.dots) {
      if (dot.second) {
        cross += fmt::format("M{:.1f} {:.1f}h4m-2 -2v4", x(dot.x) - 2, y(dot.y));
      } else {
        round += fmt::format("M{:.1f} {:.1f}h0", x(dot.x), y(dot.y));
      }
    }
    if (!round.empty()) svg.path(round, color(0), 3.2, R"( stroke-linecap="round" stroke-opacity="0.7")");
    if (!cross.empty()) svg.path(cross, color(1), 1.0, R"( stroke-opacity="0.8")");
    left += kSide + kGap;
  }
  return svg.done();
}

std::string draw(const Curves& chart) {
  constexpr double kLeft = 54, kTop = 76, kPlot = 260, kWidth = 340, kGap = 30, kBottom = 48;
  constexpr double kZero = 30;  // width of the part of the axis that stands for 0
  const auto panels = static_cast<double>(chart.panels.size());
  double legend_width = 12;
  for (const Curves::Series& series : chart.series) legend_width += entry_width(series.name);
  Svg svg(std::max((kLeft + kWidth + kGap) * panels, legend_width), kTop + kPlot + kBottom, chart.title);
  double least = 1e9;
  double most = 1e-9;
  for (const Curves::Series& series : chart.series) {
    for (const auto& points : series.panels) {
      for (const Curves::Point& point : points) {
        if (point.x > 0) least = std::min(least, point.x), most = std::max(most, point.x);
      }
    }
  }
  if (most < least) least = 0.1, most = 1.0;
  const double first = std::floor(std::log10(least) + 1e-9);
  const double last = std::max(first + 1, std::ceil(std::log10(most) - 1e-9));
  double legend = 12;
  for (std::size_t s = 0; s < chart.series.size(); ++s) {
    svg.line(legend, 38, legend + 16, 38, color(s), 2.5);
    svg.text(legend + 20, 42, "start", chart.series[s].name);
    legend += entry_width(chart.series[s].name);
  }
  for (std::size_t p = 0; p < chart.panels.size(); ++p) {
    const Curves::Panel& panel = chart.panels[p];
    const double left = kLeft + (kLeft + kWidth + kGap - 10) * static_cast<double>(p);
    const Scale x{first, last, left + kZero, left + kWidth};
    const Scale y{panel.low, panel.high, kTop + kPlot, kTop};
    svg.text(left, kTop - 10, "start", panel.name, 12, kInk, true);
    svg.upright(y, left, left + kWidth, 5);
    svg.text(left + 6, kTop + kPlot + 16, "middle", "0");
    for (double decade = first; decade <= last + 1e-9; ++decade) {
      svg.line(x(decade), kTop, x(decade), kTop + kPlot);
      svg.text(x(decade), kTop + kPlot + 16, "middle", fmt::format("{:g}", std::pow(10.0, decade)));
    }
    svg.line(left, kTop + kPlot, left + kWidth, kTop + kPlot, kSoft);
    svg.text(left + kWidth / 2, kTop + kPlot + 36, "middle", chart.axis, 11, kInk);
    for (std::size_t s = 0; s < chart.series.size(); ++s) {
      if (p >= chart.series[s].panels.size()) continue;
      std::string d;
      std::string dots;
      for (const Curves::Point& point : chart.series[s].panels[p]) {
        const double at = point.x > 0 ? x(std::log10(point.x)) : left + 6;
        d += fmt::format("{}{:.1f} {:.1f}", d.empty() ? 'M' : 'L', at, y(point.y));
        dots += fmt::format("M{:.1f} {:.1f}h0", at, y(point.y));
      }
      if (d.empty()) continue;
      svg.path(d, color(s), 1.6, R"( stroke-linejoin="round")");
      svg.path(dots, color(s), 6, R"( stroke-linecap="round")");
    }
  }
  return svg.done();
}

namespace {

// The axis of some values, a little beyond them; logarithmic ones in decades.
Scale scale_of(const Scatter::Panel& panel, double Scatter::Dot::*value, bool logarithmic, double from, double to) {
  double low = std::numeric_limits<double>::infinity();
  double high = -low;
  for (const Scatter::Dot& dot : panel.dots) {
    const double at = logarithmic ? std::log10(dot.*value) : dot.*value;
    low = std::min(low, at);
    high = std::max(high, at);
  }
  if (!(low <= high)) low = 0.0, high = 1.0;
  const double margin = high > low ? 0.06 * (high - low) : logarithmic ? 0.1 : std::max(0.05 * std::abs(low), 1e-9);
  return {low - margin, high + margin, from, to};
}

// 1, 2 and 5 times powers of ten, as logarithms.
std::vector<double> log_ticks(const Scale& scale) {
  std::vector<double> out;
  for (double decade = std::floor(scale.low); decade <= scale.high; ++decade) {
    for (const double lead : {1.0, 2.0, 5.0}) {
      const double at = decade + std::log10(lead);
      if (at >= scale.low && at <= scale.high) out.push_back(at);
    }
  }
  return out;
}

// Puts labels beside their dots where they cover neither a label nor a dot; one that fits nowhere is left out.
class Labels {
 public:
  Labels(double left, double right) : left_(left), right_(right) {}

  void keep_free(double x, double y) { boxes_.push_back({x - 4, y - 4, x + 4, y + 4}); }
  void put(Svg& svg, const Scatter::Dot& dot, double x, double y) {
    const int size = dot.large ? 11 : 9;
    const double width = 0.58 * size * static_cast<double>(dot.label.size());
    for (const double dy : {-6.0, 13.0, -17.0, 24.0, -28.0, 35.0}) {
      for (const bool right : {true, false}) {
        const double from = right ? x + 8 : x - 8 - width;
        const Box box{from, y + dy - 0.8 * size, from + width, y + dy + 0.2 * size};
        const bool covers = std::any_of(boxes_.begin(), boxes_.end(), [&](const Box& b) {
          return box.x0 < b.x1 && b.x0 < box.x1 && box.y0 < b.y1 && b.y0 < box.y1;
        });
        if (covers || box.x0 < left_ || box.x1 > right_) continue;
        boxes_.push_back(box);
        return svg.text(from, y + dy, "start", dot.label, size, dot.large ? kInk : kSoft, dot.large);
      }
    }
  }

 private:
  struct Box {
    double x0, y0, x1, y1;
  };
  double left_, right_;
  std::vector<Box> boxes_;
};

}  // namespace

std::string draw(const Scatter& chart) {
  constexpr double kLeft = 64, kTop = 76, kPlot = 320, kWidth = 430, kGap = 20, kBottom = 48;
  double legend_width = 12;
  for (const std::string& kind : chart.kinds) legend_width += entry_width(kind);
  Svg svg(std::max((kLeft + kWidth + kGap) * static_cast<double>(chart.panels.size()), legend_width),
          kTop + kPlot + kBottom, chart.title);
  double legend = 12;
  for (std::size_t k = 0; k < chart.kinds.size(); ++k) {
    svg.path(fmt::format("M{:.1f} 38h0", legend + 8), color(k), 9, R"( stroke-linecap="round")");
    svg.text(legend + 20, 42, "start", chart.kinds[k]);
    legend += entry_width(chart.kinds[k]);
  }
  for (std::size_t p = 0; p < chart.panels.size(); ++p) {
    const Scatter::Panel& panel = chart.panels[p];
    const double left = kLeft + (kLeft + kWidth + kGap) * static_cast<double>(p);
    const Scale x = scale_of(panel, &Scatter::Dot::x, panel.x.logarithmic, left, left + kWidth);
    const Scale y = scale_of(panel, &Scatter::Dot::y, panel.y.logarithmic, kTop + kPlot, kTop);
    svg.text(left, kTop - 10, "start", panel.name + ": " + panel.y.name, 12, kInk, true);
    const auto shown = [](double at, bool logarithmic) {
      return fmt::format("{:.3g}", logarithmic ? std::pow(10.0, at) : at);
    };
    for (const double at : panel.x.logarithmic ? log_ticks(x) : ticks(x.low, x.high, 6)) {
      svg.line(x(at), kTop, x(at), kTop + kPlot);
      svg.text(x(at), kTop + kPlot + 16, "middle", shown(at, panel.x.logarithmic));
    }
    for (const double at : panel.y.logarithmic ? log_ticks(y) : ticks(y.low, y.high, 6)) {
      svg.line(left, y(at), left + kWidth, y(at));
      svg.text(left - 6, y(at) + 4, "end", shown(at, panel.y.logarithmic));
    }
    svg.text(left + kWidth / 2, kTop + kPlot + 36, "middle", panel.x.name, 11, kInk);
    std::vector<std::pair<double, double>> front;
    const auto place = [&](const Scatter::Dot& dot) {
      return std::pair(x(panel.x.logarithmic ? std::log10(dot.x) : dot.x),
                       y(panel.y.logarithmic ? std::log10(dot.y) : dot.y));
    };
    Labels labels(left, left + kWidth + kGap);
    for (const Scatter::Dot& dot : panel.dots) labels.keep_free(place(dot).first, place(dot).second);
    for (const Scatter::Dot& dot : panel.dots) {
      const auto [at_x, at_y] = place(dot);
      svg.path(fmt::format("M{:.1f} {:.1f}h0", at_x, at_y), color(dot.kind), dot.large ? 12 : 7,
               R"( stroke-linecap="round")");
      labels.put(svg, dot, at_x, at_y);
      if (dot.on_front) front.emplace_back(at_x, at_y);
    }
    std::sort(front.begin(), front.end());
    std::string d;
    for (const auto& at : front) d += fmt::format("{}{:.1f} {:.1f}", d.empty() ? 'M' : 'L', at.first, at.second);
    if (!d.empty()) svg.path(d, kInk, 1.0, R"( stroke-dasharray="4 3")");
  }
  return svg.done();
}

std::string stacked(const std::vector<std::string>& pictures) {
  double width = 0;
  double height = 0;
  std::string body;
  for (const std::string& picture : pictures) {
    const auto size = [&](std::string_view name) {
      return std::stod(picture.substr(picture.find(name) + name.size()));
    };
    body += fmt::format("<svg y=\"{:.0f}\"{}", height, picture.substr(std::string_view("<svg").size()));
    width = std::max(width, size("width=\""));
    height += size("height=\"");
  }
  return fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0:.0f}\" height=\"{1:.0f}\" viewBox=\"0 0 {0:.0f} "
      "{1:.0f}\">\n<rect width=\"{0:.0f}\" height=\"{1:.0f}\" fill=\"#ffffff\"/>\n{2}</svg>\n",
      width, height, body);
}

}  // namespace holdfast::learn::charts
