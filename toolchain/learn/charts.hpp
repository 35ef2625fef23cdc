// SPDX-License-Identifier: Apache-2.0
// The pictures of an evaluation as SVG: each stands alone as a file and inside of an HTML page, dark on white, readable
// in print and by the colour-blind (Okabe and Ito's palette, and shapes beside colours).
// Range: any finite values; those outside of an axis are drawn on its edge. Texts are escaped here.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace holdfast::learn::charts {

// Text for XML and HTML; control characters become blanks.
// Groups of upright bars. No value: no bar. Marks are short lines across the group, for figures of somebody else.
struct Bars {
  struct Series {
    std::string name;
    std::vector<std::optional<double>> values;  // one a group
    bool mark = false;
  };
  std::string title;
  std::string unit;
  double low = 0.0;
  double high = 100.0;
  std::vector<std::string> groups;
  std::vector<Series> series;  // at most 4
};
[[nodiscard]] std::string draw(const Bars& chart);

// Counts by bin, one panel above the other on the same axis. The last bin takes what lies beyond.
struct Histograms {
  struct Panel {
    std::string name;
    std::string note;
    std::vector<double> values;
  };
  std::string title;
  std::string axis;
  double bin = 1.0;
  int bins = 25;
  std::vector<Panel> panels;
};
[[nodiscard]] std::string draw(const Histograms& chart);

// Points of two classes, panels side by side, each scaled to its own extent, without axes.
struct Clouds {
  struct Dot {
    double x = 0.0;
    double y = 0.0;
    bool second = false;
  };
  struct Panel {
    std::string name;
    std::vector<Dot> dots;
  };
  std::string title;
  std::string first_class;
  std::string second_class;
  std::vector<Panel> panels;
};
[[nodiscard]] std::string draw(const Clouds& chart);

// Lines over a logarithmic axis that begins with 0; panels side by side share the axis and the series' colours.
struct Curves {
  struct Point {
    double x = 0.0;  // >= 0
    double y = 0.0;
  };
  struct Series {
    std::string name;
    std::vector<std::vector<Point>> panels;  // the points in each panel
  };
  struct Panel {
    std::string name;
    double low = 0.0;
    double high = 1.0;
  };
  std::string title;
  std::string axis;
  std::vector<Panel> panels;
  std::vector<Series> series;  // at most 7
};
[[nodiscard]] std::string draw(const Curves& chart);

// Points of several kinds over two axes, panels side by side. A front is a dashed line through the dots that are on it.
// On a logarithmic axis values must be above 0. A label for which there is no room is left out: dots that matter most
// come first.
struct Scatter {
  struct Axis {
    std::string name;
    bool logarithmic = false;
  };
  struct Dot {
    double x = 0.0;
    double y = 0.0;
    std::size_t kind = 0;
    std::string label = {};
    bool large = false;
    bool on_front = false;
  };
  struct Panel {
    std::string name;
    Axis x;
    Axis y;
    std::vector<Dot> dots;
  };
  std::string title;
  std::vector<std::string> kinds;  // at most 7
  std::vector<Panel> panels;
};
[[nodiscard]] std::string draw(const Scatter& chart);

// Pictures of draw(), one below the other in one file.
[[nodiscard]] std::string stacked(const std::vector<std::string>& pictures);

}  // namespace holdfast::learn::charts
