// SPDX-License-Identifier: Apache-2.0
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "core/util/text.h"
#include "env_service/geometry/plane.h"
#include "tools/data/inspection.h"

namespace citylearn {
namespace {

constexpr double kSide = 400, kMargin = 40;  // pixels of a panel and around it
const char* const kColours[] = {"#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf", "#8c564b", "#e377c2"};

std::string escaped(const std::string& text) {
  std::string result;
  for (const char c : one_line(text))
    result += c == '&' ? "&amp;" : c == '<' ? "&lt;" : c == '>' ? "&gt;" : std::string(1, c);
  return result;
}

std::string label(double x, double y, const std::string& text, const char* colour = "#333") {
  return fmt::format("<text x=\"{:.0f}\" y=\"{:.0f}\" fill=\"{}\">{}</text>\n", x, y, colour, escaped(text));
}

/// Draws the routes in metres of a plane, north upwards, each with a dot where it begins.
std::string map_of(const std::vector<Route>& routes) {
  double north = 0, east = 0, least_x = 1e300, most_x = -1e300, least_y = 1e300, most_y = -1e300;
  bool first = true;
  std::vector<std::vector<std::pair<double, double>>> lines;
  for (const Route& route : routes) {
    lines.emplace_back();
    for (std::size_t i = 0; i < route.latitude.size(); ++i) {
      if (!std::isfinite(route.latitude[i]) || !std::isfinite(route.longitude[i])) continue;
      if (first) north = route.latitude[i], east = route.longitude[i], first = false;
      const double metres = kEarthRadius * kDegree, y = (route.latitude[i] - north) * metres,
                   x = std::remainder(route.longitude[i] - east, 360) * metres * std::cos(north * kDegree);
      lines.back().emplace_back(x, y);
      least_x = std::min(least_x, x), most_x = std::max(most_x, x);
      least_y = std::min(least_y, y), most_y = std::max(most_y, y);
    }
  }
  const double extent = std::max({most_x - least_x, most_y - least_y, 1.0});
  std::string svg = label(0, -8, fmt::format("routes, {:.0f} m wide, north is up; a dot begins each", extent));
  for (std::size_t i = 0; i < lines.size(); ++i) {
    const char* const colour = kColours[i % std::size(kColours)];
    std::string points;
    for (const auto& [x, y] : lines[i])
      points += fmt::format("{:.1f},{:.1f} ", (x - least_x) / extent * kSide, kSide - (y - least_y) / extent * kSide);
    svg += fmt::format("<polyline fill=\"none\" stroke=\"{}\" stroke-width=\"2\" points=\"{}\"/>\n", colour, points);
    const std::string begin = points.substr(0, points.find(' '));
    svg += fmt::format("<circle r=\"5\" fill=\"{}\" cx=\"{}\" cy=\"{}\"/>\n", colour, begin.substr(0, begin.find(',')),
                       begin.substr(begin.find(',') + 1));
    svg += label(8, 16.0 + 16 * static_cast<double>(i), routes[i].name, colour);
  }
  return svg;
}

/// Draws the counterpart of each frame, red where chance would be as similar, green where it is sure; below, how sure.
std::string plot_of(const SightMatch& match) {
  const double frames = static_cast<double>(match.counterparts.size());
  std::string svg =
      label(0, -22, match.other + " (upwards) by sight") + label(0, -8, "along " + match.route + "; below: how sure");
  const double width = kSide / frames, height = 40;
  for (std::size_t i = 0; i < match.counterparts.size(); ++i) {
    const double sure = match.confidence[i], x = width * static_cast<double>(i);
    const std::string colour = fmt::format("hsl({:.0f},80%,40%)", 120 * sure);
    if (match.counterparts[i] < 0) continue;
    svg += fmt::format("<circle r=\"2\" fill=\"{}\" cx=\"{:.1f}\" cy=\"{:.1f}\"/>", colour, x,
                       kSide - kSide * match.counterparts[i] / std::max(1, match.frames - 1));
    svg += fmt::format("<rect fill=\"{}\" x=\"{:.2f}\" y=\"{:.1f}\" width=\"{:.2f}\" height=\"{:.1f}\"/>\n", colour, x,
                       kSide + 10 + height * (1 - sure), width, height * sure);
  }
  return svg;
}

}  // namespace

std::string to_svg(const Inspection& inspection) {
  std::vector<std::string> panels;
  if (!inspection.routes.empty()) panels.push_back(map_of(inspection.routes));
  for (const SightMatch& match : inspection.matches) panels.push_back(plot_of(match));
  if (panels.empty()) panels.push_back(label(0, 16, "no recording has places, and none were compared by sight"));
  const double step = kSide + 2 * kMargin;
  std::string svg = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{:.0f}\" height=\"{:.0f}\" font-family=\"sans-serif\" "
      "font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
      step * static_cast<double>(panels.size()), kSide + 120);
  for (std::size_t i = 0; i < panels.size(); ++i)
    svg += fmt::format(
        "<g transform=\"translate({:.0f},{:.0f})\">\n<rect width=\"{}\" height=\"{}\" fill=\"none\" stroke=\"#ccc\"/>"
        "\n{}</g>\n",
        kMargin + step * static_cast<double>(i), kMargin, kSide, kSide, panels[i]);
  return svg + "</svg>\n";
}

}  // namespace citylearn
