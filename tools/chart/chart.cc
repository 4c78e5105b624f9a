// SPDX-License-Identifier: Apache-2.0
#include "tools/chart/chart.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

namespace citylearn {
namespace {

// Margins, in SVG units; the left one grows with the numbers beside it.
constexpr double kLeft = 62, kTop = 44, kBottom = 56, kLegend = 300, kGap = 24;
constexpr double kAxisLabel = 34, kDigit = 7;  // room for the vertical axis' label, and for a figure of its numbers

// Okabe & Ito's colours, told apart by most colour-blind people, in shades with contrast on white and on black.
constexpr std::array kColours = {"#0b84c8", "#d55e00", "#009e73", "#b8860b",
                                 "#c0569b", "#7a6ff0", "#d0453b", "#5c9a1b"};
constexpr std::array kDashes = {"", "7 4", "2 3", "10 3 2 3"};

std::string number(double value, const char* format = "%.4g") {
  char text[32];
  std::snprintf(text, sizeof(text), format, value);
  return text;
}

std::string text_at(double x, double y, const std::string& kind, const std::string& text) {
  return "<text class=\"" + kind + "\" x=\"" + number(x) + "\" y=\"" + number(y) + "\">" + escaped(text) + "</text>\n";
}

std::string path(const std::string& attributes, const std::string& d) {
  return "<path " + attributes + " d=\"" + d + "\"/>\n";
}

/// Distance of labelled values, about `wanted` of them: 1, 2 or 5 times a power of ten.
double round_step(double span, int wanted) {
  const double rough = span / wanted, power = std::pow(10, std::floor(std::log10(rough)));
  const double factor = rough / power;
  return power * (factor <= 1 ? 1 : factor <= 2 ? 2 : factor <= 5 ? 5 : 10);
}

struct Tick {
  double at;
  bool labelled;
};

std::vector<Tick> ticks_of(const Axis& axis) {
  std::vector<Tick> ticks;
  if (axis.logarithmic) {
    const double decades = std::log10(axis.high / axis.low);
    for (double power = std::pow(10, std::floor(std::log10(axis.low))); power <= axis.high * 1.0001; power *= 10)
      for (int i = 1; i < 10; ++i)
        if (const double at = power * i; at >= axis.low * 0.9999 && at <= axis.high * 1.0001)
          ticks.push_back({at, i == 1 || (decades < 2 && (i == 2 || i == 5))});
    return ticks;
  }
  const double step = round_step(axis.high - axis.low, 5), half = step / 2;
  for (double i = std::ceil(axis.low / half - 1e-9); i * half <= axis.high + 1e-9 * step; ++i)
    ticks.push_back({i * half + 0.0, std::fmod(std::abs(i), 2) < 0.5});  // + 0: -0 would be written so
  return ticks;
}

/// Where a value lies on an axis: 0 at its low end, 1 at its high one.
double share(const Axis& axis, double value) {
  return axis.logarithmic ? std::log(value / axis.low) / std::log(axis.high / axis.low)
                          : (value - axis.low) / (axis.high - axis.low);
}

/// Margin left of the plot area, wide enough for the vertical axis' numbers.
double left_of(const Axis& y) {
  std::size_t longest = 0;
  for (const auto& [at, labelled] : ticks_of(y))
    if (labelled) longest = std::max(longest, number(at).size());
  return std::max(kLeft, kAxisLabel + kDigit * static_cast<double>(longest));
}

std::string header(const std::string& title, double left, double width, double height) {
  return "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 " + number(width) + " " + number(height) +
         "\" width=\"" + number(width) + "\" height=\"" + number(height) + "\" role=\"img\">\n<title>" +
         escaped(title) +
         "</title>\n<style>\n"
         "svg { background: #ffffff; color: #1f2328; font: 12px system-ui, sans-serif; }\n"
         "text { fill: currentColor; } .title { font-size: 15px; font-weight: 600; } .axis { font-size: 13px; }\n"
         ".middle { text-anchor: middle; } .end { text-anchor: end; } .tick { opacity: .8; }\n"
         ".grid { stroke: currentColor; stroke-opacity: .22; fill: none; } .faint { stroke-opacity: .08; }\n"
         ".curve { fill: none; stroke-width: 2; stroke-linejoin: round; } .band { fill-opacity: .18; stroke: none; }\n"
         ".whisker { stroke: currentColor; stroke-width: 1.5; fill: none; }\n"
         "@media (prefers-color-scheme: dark) { svg { background: #0d1117; color: #e6edf3; } }\n"
         "</style>\n" +
         text_at(left, 24, "title", title);
}

/// Axes, grid and the way from values to the drawing.
class Plot {
 public:
  Plot(const Chart& chart) : chart_(chart), left_(left_of(chart.y)) {}

  double left() const { return left_; }
  double right() const { return left_ + chart_.width; }
  double x(double value) const { return left_ + chart_.width * share(chart_.x, value); }
  double y(double value) const { return kTop + chart_.height * (1 - share(chart_.y, value)); }
  bool inside(double a, double b) const {
    return std::isfinite(a) && std::isfinite(b) && (!chart_.x.logarithmic || a > 0) && (!chart_.y.logarithmic || b > 0);
  }
  std::string point(double a, double b) const {
    const double left = std::clamp(x(a), left_, right()), top = std::clamp(y(b), kTop, kTop + chart_.height);
    return number(left, "%.1f") + "," + number(top, "%.1f") + " ";
  }

  std::string axes(bool along_x = true) const {
    std::string svg;
    if (along_x)
      for (const auto& [at, labelled] : ticks_of(chart_.x)) {
        svg += path(labelled ? "class=\"grid\"" : "class=\"grid faint\"",
                    "M" + number(x(at)) + " " + number(kTop) + "v" + number(chart_.height));
        if (labelled) svg += text_at(x(at), kTop + chart_.height + 18, "tick middle", number(at));
      }
    for (const auto& [at, labelled] : ticks_of(chart_.y)) {
      svg += path(labelled ? "class=\"grid\"" : "class=\"grid faint\"",
                  "M" + number(left_) + " " + number(y(at)) + "h" + number(chart_.width));
      if (labelled) svg += text_at(left_ - 8, y(at) + 4, "tick end", number(at));
    }
    svg += text_at(left_ + chart_.width / 2, kTop + chart_.height + 40, "axis middle", chart_.x.label);
    return svg + "<text class=\"axis middle\" transform=\"translate(18 " + number(kTop + chart_.height / 2) +
           ") rotate(-90)\">" + escaped(chart_.y.label) + "</text>\n";
  }

 private:
  const Chart& chart_;
  const double left_;
};

std::string dot(double x, double y, const std::string& fill) {
  return "<circle " + fill + " cx=\"" + number(x) + "\" cy=\"" + number(y) + "\" r=\"4.5\"/>\n";
}

std::string dots(const Plot& plot, const Line& line, const std::string& fill) {
  std::string svg;
  for (std::size_t i = 0; i < line.y.size(); ++i)
    if (plot.inside(line.x[i], line.y[i])) svg += dot(plot.x(line.x[i]), plot.y(line.y[i]), fill);
  return svg;
}

std::string curve(const Plot& plot, const Line& line, const std::string& stroke, const std::string& fill) {
  std::string svg;
  if (line.low.size() == line.y.size() && line.high.size() == line.y.size() && !line.y.empty()) {
    std::string there, back;
    for (std::size_t i = 0; i < line.y.size(); ++i) {
      if (!plot.inside(line.x[i], line.low[i]) || !plot.inside(line.x[i], line.high[i])) continue;
      there += plot.point(line.x[i], line.high[i]);
      back = plot.point(line.x[i], line.low[i]) + back;
    }
    svg += "<polygon class=\"band\" " + fill + " points=\"" + there + back + "\"/>\n";
  }
  std::string points, drawn;
  int count = 0;
  for (std::size_t i = 0; i < line.y.size(); ++i) {
    if (!plot.inside(line.x[i], line.y[i])) continue;
    const std::string next = plot.point(line.x[i], line.y[i]);
    if (next == drawn) continue;
    points += drawn = next;
    ++count;
  }
  if (count == 1) return svg + dots(plot, line, fill);  // a line of one point shows nothing
  return svg + "<polyline class=\"curve\" " + stroke + " points=\"" + points + "\"/>\n";
}

}  // namespace

std::string escaped(const std::string& text) {
  std::string result;
  for (const char c : text) {
    if (c == '<')
      result += "&lt;";
    else if (c == '>')
      result += "&gt;";
    else if (c == '&')
      result += "&amp;";
    else if (c == '"')
      result += "&quot;";
    else
      result += static_cast<unsigned char>(c) < ' ' ? ' ' : c;
  }
  return result;
}

Axis axis_around(const std::string& label, const std::vector<double>& values, bool from_zero) {
  double low = from_zero ? 0 : INFINITY, high = -INFINITY;
  for (const double value : values) {
    if (!std::isfinite(value)) continue;
    low = std::min(low, value);
    high = std::max(high, value);
  }
  if (high == -INFINITY) return {label, 0, 1};
  if (high <= low) high = low + 1;
  const double step = round_step(high - low, 5) / 2;
  return {label, std::floor(low / step + 1e-9) * step, std::ceil(high / step - 1e-9) * step};
}

Axis decades_around(const std::string& label, const std::vector<double>& values) {
  double low = INFINITY, high = -INFINITY;
  for (const double value : values) {
    if (!std::isfinite(value) || value <= 0) continue;
    low = std::min(low, std::floor(std::log10(value)));
    high = std::max(high, std::ceil(std::log10(value)));
  }
  if (high == -INFINITY) return {label, 1, 10, true};
  return {label, std::pow(10, low), std::pow(10, std::max(high, low + 1)), true};
}

std::string svg_of(const Chart& chart) {
  const auto labels = static_cast<double>(
      std::count_if(chart.lines.begin(), chart.lines.end(), [](const Line& line) { return !line.label.empty(); }));
  const Plot plot(chart);
  std::string svg = header(chart.title, plot.left(), plot.right() + kGap + kLegend,
                           std::max(kTop + chart.height + kBottom, kTop + 20 + 20 * labels)) +
                    plot.axes();
  double row = 0;
  for (std::size_t i = 0; i < chart.lines.size(); ++i) {
    const Line& line = chart.lines[i];
    const std::size_t colour = line.colour >= 0 ? static_cast<std::size_t>(line.colour) : i;
    const char* dashes = line.dashed ? kDashes[1] : kDashes[colour / kColours.size() % kDashes.size()];
    const std::string shade = kColours[colour % kColours.size()];
    const std::string stroke = "stroke=\"" + shade + "\" stroke-dasharray=\"" + dashes + "\"";
    const std::string fill = "fill=\"" + shade + "\"";
    svg += line.dots ? dots(plot, line, fill) : curve(plot, line, stroke, fill);
    if (line.label.empty()) continue;
    const double y = kTop + 12 + 20 * row++, x = plot.right() + kGap;
    svg += line.dots ? dot(x + 13, y - 4, fill)
                     : path("class=\"curve\" " + stroke, "M" + number(x) + " " + number(y - 4) + "h26");
    svg += text_at(x + 34, y, "label", line.label);
  }
  return svg + "</svg>\n";
}

std::string svg_of(const Bars& bars) {
  Chart frame;
  frame.y = {bars.unit, 0, bars.most};
  frame.width = std::max(420.0, 28.0 * static_cast<double>(bars.groups.size() * (bars.names.size() + 1)));
  frame.height = 320;
  const Plot plot(frame);
  std::string svg =
      header(bars.title, plot.left(), plot.right() + kGap + kLegend,
             std::max(kTop + frame.height + kBottom, kTop + 20 + 20 * static_cast<double>(bars.names.size()))) +
      plot.axes(false);
  const double group = frame.width / static_cast<double>(std::max<std::size_t>(1, bars.groups.size()));
  const double wide = group / (static_cast<double>(bars.names.size()) + 1);
  for (std::size_t g = 0; g < bars.groups.size(); ++g) {
    const double left = plot.left() + group * static_cast<double>(g) + wide / 2;
    for (std::size_t i = 0; i < bars.values[g].size(); ++i) {
      const Bars::Bar& bar = bars.values[g][i];
      if (!std::isfinite(bar.value)) continue;
      const double x = left + wide * static_cast<double>(i), top = plot.y(std::clamp(bar.value, 0.0, bars.most));
      svg += "<rect x=\"" + number(x) + "\" y=\"" + number(top) + "\" width=\"" + number(wide * 0.86) + "\" height=\"" +
             number(kTop + frame.height - top) + "\" fill=\"" + kColours[i % kColours.size()] + "\"/>\n";
      if (!std::isfinite(bar.low) || !std::isfinite(bar.high)) continue;
      const double low = plot.y(std::clamp(bar.low, 0.0, bars.most)),
                   high = plot.y(std::clamp(bar.high, 0.0, bars.most));
      svg += path("class=\"whisker\"", "M" + number(x + wide * 0.43) + " " + number(low) + "V" + number(high));
    }
    svg += text_at(left + group / 2 - wide / 2, kTop + frame.height + 18, "tick middle", bars.groups[g]);
  }
  for (std::size_t i = 0; i < bars.names.size(); ++i) {
    const double y = kTop + 12 + 20 * static_cast<double>(i), x = plot.right() + kGap;
    svg += "<rect x=\"" + number(x) + "\" y=\"" + number(y - 10) + "\" width=\"12\" height=\"12\" fill=\"" +
           std::string(kColours[i % kColours.size()]) + "\"/>\n" + text_at(x + 20, y, "label", bars.names[i]);
  }
  return svg + "</svg>\n";
}

}  // namespace citylearn
