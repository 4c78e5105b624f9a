// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace citylearn {

/// One axis of a chart.
struct Axis {
  std::string label;  ///< with its unit: "training time, s"
  double low = 0, high = 1;
  bool logarithmic = false;  ///< low > 0 then
};

/// A line, with a band around it where `low` and `high` are given (as long as `y`).
struct Line {
  std::string label;  ///< empty: not in the legend
  std::vector<double> x, y;
  std::vector<double> low = {}, high = {};
  int colour = -1;      ///< of the palette; -1: by its place among the lines
  bool dashed = false;  ///< a yardstick rather than a measurement
  bool dots = false;    ///< points that nothing joins
};

struct Chart {
  std::string title;
  Axis x, y;
  std::vector<Line> lines;
  double width = 420, height = 420;  ///< of the plot area, in SVG units
};

/// A group of bars side by side, each with an interval, NaN where there is none.
struct Bars {
  struct Bar {
    double value = 0, low = 0, high = 0;
  };
  std::string title, unit;
  std::vector<std::string> groups;       ///< below the groups
  std::vector<std::string> names;        ///< of the bars in each group, for the legend
  std::vector<std::vector<Bar>> values;  ///< by group, then by name
  double most = 1;                       ///< upper end of the axis
};

/// SVGs with axes, grid and legend, that read on light and on dark grounds. Eight colours that most colour-blind people
/// tell apart, then dashes. Labels may hold any text. What is not finite is left out.
std::string svg_of(const Chart& chart);
std::string svg_of(const Bars& bars);

/// `text` for XML and HTML: markup escaped, control characters as spaces.
std::string escaped(const std::string& text);

/// Ends of an axis that hold all values, at round numbers. {0, 1} when there are none.
Axis axis_around(const std::string& label, const std::vector<double>& values, bool from_zero = false);

/// Likewise logarithmic, at powers of ten; values that are not above 0 are left out. {1, 10} when there are none.
Axis decades_around(const std::string& label, const std::vector<double>& values);

}  // namespace citylearn
