// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/report.h"

#include <openssl/evp.h>
#include <spdlog/spdlog.h>

#include <cmath>
#include <filesystem>

#include "core/util/error.h"
#include "core/util/files.h"
#include "core/util/sha256.h"
#include "tools/paper/drawing.h"
#include "tools/vpr/report.h"

namespace citylearn::paper {
namespace {

constexpr const char* kStyle =
    "body{font:16px/1.55 system-ui,sans-serif;max-width:1150px;margin:2rem auto;padding:0 1rem;color:#1f2328;"
    "background:#fff}h1{font-size:1.9rem;line-height:1.2}h2{margin-top:3rem;border-bottom:1px solid #d0d7de}"
    "nav a{margin-right:1rem}figure{margin:1.5rem 0;overflow-x:auto}figure img{max-width:100%;height:auto}"
    "figcaption,.caption{font-size:.9rem;color:#57606a;margin:1.5rem 0 .3rem}"
    ".wide{overflow-x:auto}table{border-collapse:collapse;font-size:.9rem;font-variant-numeric:tabular-nums}"
    "th,td{padding:.3rem .55rem;border-bottom:1px solid "
    "#d0d7de;text-align:left;white-space:nowrap}th{white-space:normal;vertical-align:bottom}"
    "td+td{text-align:right}th+th{text-align:right}.remark{border-left:4px solid #bf8700;padding:.2rem 1rem;"
    "background:#fff8c5}code{font-size:.9em}"
    "@media(prefers-color-scheme:dark){body{color:#e6edf3;background:#0d1117}h2,th,td{border-color:#30363d}"
    "figcaption,.caption{color:#9198a1}.remark{background:#2e2a1f}a{color:#4493f8}}";

std::string base64(const std::string& bytes) {
  std::string text(4 * ((bytes.size() + 2) / 3) + 1, '\0');
  const int length =
      EVP_EncodeBlock(reinterpret_cast<unsigned char*>(text.data()),
                      reinterpret_cast<const unsigned char*>(bytes.data()), static_cast<int>(bytes.size()));
  text.resize(static_cast<std::size_t>(length));
  return text;
}

std::string csv_line(const std::vector<std::string>& fields) {
  std::string line;
  for (std::size_t i = 0; i < fields.size(); ++i) line += (i ? "," : "") + vpr::csv_field(fields[i]);
  return line + "\n";
}

/// As short as it is exact to nine digits; empty when there is none.
std::string csv_number(double value) { return std::isfinite(value) ? fmt::format("{:.9g}", value) : ""; }

}  // namespace

std::string csv_of(const Chart& chart) {
  std::string csv = csv_line({"line", chart.x.label, chart.y.label, "low", "high"});
  for (const Line& line : chart.lines)
    for (std::size_t i = 0; i < line.y.size(); ++i)
      csv += csv_line({line.label, csv_number(line.x[i]), csv_number(line.y[i]),
                       i < line.low.size() ? csv_number(line.low[i]) : "",
                       i < line.high.size() ? csv_number(line.high[i]) : ""});
  return csv;
}

std::string csv_of(const Bars& bars) {
  std::string csv = csv_line({"group", "bar", bars.unit, "low", "high"});
  for (std::size_t group = 0; group < bars.values.size(); ++group)
    for (std::size_t i = 0; i < bars.values[group].size(); ++i) {
      const Bars::Bar& bar = bars.values[group][i];
      csv += csv_line(
          {bars.groups[group], bars.names[i], csv_number(bar.value), csv_number(bar.low), csv_number(bar.high)});
    }
  return csv;
}

Report::Report(std::string folder) : folder_(std::move(folder)), draws_(can_draw()) {}

void Report::file(const std::string& name, const std::string& contents) {
  if (!files_.try_emplace(name, sha256(contents)).second)
    throw Error("is in the report already", "'" + name + "'", "name each figure and table differently");
  write_file(folder_ + "/" + name, contents);
}

void Report::section(const std::string& name, const std::string& title) {
  contents_ += "<a href=\"#" + name + "\">" + escaped(title) + "</a>\n";
  body_ += "<h2 id=\"" + name + "\">" + escaped(title) + "</h2>\n";
}

void Report::text(const std::string& paragraph) { body_ += "<p>" + escaped(paragraph) + "</p>\n"; }

void Report::remark(const std::string& paragraph) { body_ += "<p class=\"remark\">" + escaped(paragraph) + "</p>\n"; }

void Report::table(const ReportTable& table) {
  std::string csv = csv_line(table.columns);
  body_ += "<p class=\"caption\">" + escaped(table.caption) + "</p>\n<div class=\"wide\"><table>\n<tr>";
  for (const std::string& column : table.columns) body_ += "<th scope=\"col\">" + escaped(column) + "</th>";
  body_ += "</tr>\n";
  for (const std::vector<std::string>& row : table.rows) {
    csv += csv_line(row);
    body_ += "<tr>";
    for (const std::string& field : row) body_ += "<td>" + escaped(field) + "</td>";
    body_ += "</tr>\n";
  }
  body_ += "</table></div>\n";
  file(table.name + ".csv", csv);
}

void Report::figure(const std::string& name, const Chart& chart, const std::string& caption) {
  this->chart(name, svg_of(chart), caption);
  file(name + "-lines.csv", csv_of(chart));
}

void Report::figure(const std::string& name, const Bars& bars, const std::string& caption) {
  chart(name, svg_of(bars), caption);
  file(name + "-bars.csv", csv_of(bars));
}

void Report::chart(const std::string& name, const std::string& svg, const std::string& caption) {
  file(name + ".svg", svg);
  if (draws_) {
    const std::string png = folder_ + "/" + name + ".png";
    if (draw(folder_ + "/" + name + ".svg", png))
      files_[name + ".png"] = sha256(read_file(png));
    else
      spdlog::warn("{} could not be drawn", png);
  }
  // As an image, so that its style stays its own.
  body_ += "<figure><img alt=\"" + escaped(caption) + "\" src=\"data:image/svg+xml;base64," + base64(svg) +
           "\"><figcaption>" + escaped(caption) + "</figcaption></figure>\n";
}

void Report::picture(const std::string& name, const std::string& png, const std::string& caption) {
  file(name + ".png", png);
  body_ += "<figure><img alt=\"" + escaped(caption) + "\" src=\"data:image/png;base64," + base64(png) +
           "\"><figcaption>" + escaped(caption) + "</figcaption></figure>\n";
}

void Report::no_picture(const std::string& name) {
  std::error_code error;
  std::filesystem::remove(folder_ + "/" + name + ".png", error);
  if (error) throw Error("cannot be removed: " + error.message(), folder_ + "/" + name + ".png");
}

void Report::write(const std::string& title, const std::string& about) {
  file("report.html",
       "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
       "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>" +
           escaped(title) + "</title>\n<style>" + kStyle + "</style>\n</head>\n<body>\n<h1>" + escaped(title) +
           "</h1>\n<p>" + escaped(about) + "</p>\n<nav>\n" + contents_ + "</nav>\n" + body_ + "</body>\n</html>\n");
}

std::string fixed(double value, int digits) {
  return std::isfinite(value) ? fmt::format("{:.{}f}", value, digits) : "-";
}

std::string text_of(const Estimate& estimate, int digits) {
  const std::string middle = fixed(estimate.mean, digits);
  if (!std::isfinite(estimate.low) || !std::isfinite(estimate.high)) return middle;
  return middle + " (" + fixed(estimate.low, digits) + ".." + fixed(estimate.high, digits) + ")";
}

std::string percent(const Estimate& estimate) {
  return text_of({100 * estimate.mean, 100 * estimate.low, 100 * estimate.high, estimate.n}, 1) + " %";
}

}  // namespace citylearn::paper
