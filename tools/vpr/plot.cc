#include "tools/vpr/plot.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "core/error.h"

namespace citylearn::vpr {
namespace {

// Plot area and margins, in SVG units.
constexpr double kLeft = 62, kTop = 44, kSide = 420, kLegend = 300;

// Okabe & Ito's colours, told apart by most colour-blind people, in shades with contrast on white and on black.
constexpr std::array kColours = {"#0b84c8", "#d55e00", "#009e73", "#b8860b",
                                 "#c0569b", "#7a6ff0", "#d0453b", "#5c9a1b"};
constexpr std::array kDashes = {"", "7 4", "2 3", "10 3 2 3"};

std::string number(double value, const char* format = "%.4g") {
  char text[32];
  std::snprintf(text, sizeof(text), format, value);
  return text;
}

std::string escaped(const std::string& text) {
  std::string result;
  for (const char c : text) {
    if (c == '<')
      result += "&lt;";
    else if (c == '>')
      result += "&gt;";
    else if (c == '&')
      result += "&amp;";
    else
      result += static_cast<unsigned char>(c) < ' ' ? ' ' : c;
  }
  return result;
}

std::string text_at(double x, double y, const std::string& kind, const std::string& text) {
  return "<text class=\"" + kind + "\" x=\"" + number(x) + "\" y=\"" + number(y) + "\">" + escaped(text) + "</text>\n";
}

std::string point(double recall, double precision) {
  return number(kLeft + kSide * recall, "%.1f") + "," + number(kTop + kSide * (1 - precision), "%.1f") + " ";
}

std::string axes(const std::string& title) {
  std::string svg = text_at(kLeft, 24, "title", title);
  for (int i = 0; i <= 10; ++i) {
    const double at = kSide * i / 10;
    const bool labelled = i % 2 == 0;
    const std::string kind = labelled ? "grid" : "grid faint";
    svg += "<path class=\"" + kind + "\" d=\"M" + number(kLeft + at) + " " + number(kTop) + "v" + number(kSide) + "M" +
           number(kLeft) + " " + number(kTop + at) + "h" + number(kSide) + "\"/>\n";
    if (!labelled) continue;
    svg += text_at(kLeft + at, kTop + kSide + 18, "tick middle", number(i / 10.0, "%.1f"));
    svg += text_at(kLeft - 8, kTop + kSide - at + 4, "tick end", number(i / 10.0, "%.1f"));
  }
  svg += text_at(kLeft + kSide / 2, kTop + kSide + 40, "axis middle", "recall");
  svg += "<text class=\"axis middle\" transform=\"translate(18 " + number(kTop + kSide / 2) +
         ") rotate(-90)\">precision</text>\n";
  return svg;
}

}  // namespace

std::string precision_recall_svg(const std::string& title, const std::vector<Curve>& curves) {
  const double height = std::max(kTop + kSide + 56, kTop + 20 + 20 * static_cast<double>(curves.size()));
  const double width = kLeft + kSide + 24 + kLegend;
  std::string svg = "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 " + number(width) + " " + number(height) +
                    "\" width=\"" + number(width) + "\" height=\"" + number(height) + "\" role=\"img\">\n<title>" +
                    escaped(title) + "</title>\n";
  svg +=
      "<style>\n"
      "svg { background: #ffffff; color: #1f2328; font: 12px system-ui, sans-serif; }\n"
      "text { fill: currentColor; } .title { font-size: 15px; font-weight: 600; } .axis { font-size: 13px; }\n"
      ".middle { text-anchor: middle; } .end { text-anchor: end; } .tick { opacity: .8; }\n"
      ".grid { stroke: currentColor; stroke-opacity: .22; fill: none; } .faint { stroke-opacity: .08; }\n"
      ".curve { fill: none; stroke-width: 2; stroke-linejoin: round; }\n"
      "@media (prefers-color-scheme: dark) { svg { background: #0d1117; color: #e6edf3; } }\n"
      "</style>\n";
  svg += axes(title);
  for (std::size_t i = 0; i < curves.size(); ++i) {
    const std::string stroke = std::string("stroke=\"") + kColours[i % kColours.size()] + "\" stroke-dasharray=\"" +
                               kDashes[i / kColours.size() % kDashes.size()] + "\"";
    const Curve& curve = curves[i];
    std::string points;
    if (!curve.recall.empty()) points += point(0, curve.precision.front());
    // Points closer than a pixel to the last one drawn say nothing new.
    double drawn_recall = -1, drawn_precision = -1;
    for (std::size_t k = 0; k < curve.recall.size(); ++k) {
      const double step = std::hypot(curve.recall[k] - drawn_recall, curve.precision[k] - drawn_precision);
      if (step * kSide < 0.7 && k + 1 < curve.recall.size()) continue;
      points += point(drawn_recall = curve.recall[k], drawn_precision = curve.precision[k]);
    }
    svg += "<polyline class=\"curve\" " + stroke + " points=\"" + points + "\"/>\n";
    const double y = kTop + 12 + 20 * static_cast<double>(i), x = kLeft + kSide + 24;
    svg += "<path class=\"curve\" " + stroke + " d=\"M" + number(x) + " " + number(y - 4) + "h26\"/>\n";
    svg += text_at(x + 34, y, "label", curve.label);
  }
  return svg + "</svg>\n";
}

std::string matrix_png(const Eigen::Ref<const Eigen::MatrixXf>& matrix, int most) {
  const Eigen::Index block = std::max<Eigen::Index>(1, (std::max(matrix.rows(), matrix.cols()) + most - 1) / most);
  const Eigen::Index rows = (matrix.rows() + block - 1) / block, columns = (matrix.cols() + block - 1) / block;
  std::vector<float> finite;
  Eigen::MatrixXf small(rows, columns);
  for (Eigen::Index c = 0; c < columns; ++c)
    for (Eigen::Index r = 0; r < rows; ++r) {
      const float value = matrix
                              .block(r * block, c * block, std::min(block, matrix.rows() - r * block),
                                     std::min(block, matrix.cols() - c * block))
                              .maxCoeff();
      small(r, c) = value;
      if (std::isfinite(value)) finite.push_back(value);
    }
  float low = 0, high = 1;
  if (!finite.empty()) {
    const auto at = [&](double share) {
      const auto middle = finite.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(finite.size() - 1));
      std::nth_element(finite.begin(), middle, finite.end());
      return *middle;
    };
    low = at(0.01);
    high = at(0.99);
  }
  const float scale = high > low ? 255 / (high - low) : 0;
  cv::Mat grey(static_cast<int>(rows), static_cast<int>(columns), CV_8U), colour;
  for (int c = 0; c < grey.cols; ++c)
    for (int r = 0; r < grey.rows; ++r) {
      const float level = (small(r, c) - low) * scale;
      grey.at<std::uint8_t>(r, c) = std::isnan(level) ? 0 : static_cast<std::uint8_t>(std::clamp(level, 0.0f, 255.0f));
    }
  try {
    cv::applyColorMap(grey, colour, cv::COLORMAP_VIRIDIS);
    std::vector<std::uint8_t> file;
    cv::imencode(".png", colour, file);
    return {file.begin(), file.end()};
  } catch (const cv::Exception& error) {
    throw Error("the picture of the similarities cannot be made: " + error.err);
  }
}

}  // namespace citylearn::vpr
