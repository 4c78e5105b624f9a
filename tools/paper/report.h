// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>
#include <vector>

#include "tools/chart/chart.h"
#include "tools/paper/statistics.h"

namespace citylearn::paper {

/// Rows of text under headings.
struct ReportTable {
  std::string name;  ///< of its CSV file
  std::string caption;
  std::vector<std::string> columns;
  std::vector<std::vector<std::string>> rows;
};

/// One HTML file that needs no other, with its figures and tables also as files beside it: tables as NAME.csv, charts
/// as NAME.svg, NAME.png (where there is `rsvg-convert`, which draws it) and NAME-lines.csv or NAME-bars.csv, pictures
/// as NAME.png.
class Report {
 public:
  /// `folder` exists.
  explicit Report(std::string folder);

  void section(const std::string& name, const std::string& title);
  /// A paragraph; markup in it is text.
  void text(const std::string& paragraph);
  /// One that a reader must not miss: where we are worse, or what a figure does not tell.
  void remark(const std::string& paragraph);
  void table(const ReportTable& table);
  void figure(const std::string& name, const Chart& chart, const std::string& caption);
  void figure(const std::string& name, const Bars& bars, const std::string& caption);
  void picture(const std::string& name, const std::string& png, const std::string& caption);
  /// Removes the one that an earlier report has left. Throws Error.
  void no_picture(const std::string& name);

  /// Writes report.html. Throws Error.
  void write(const std::string& title, const std::string& about);
  /// Writes another file beside it. Throws Error, also when the name is taken.
  void file(const std::string& name, const std::string& contents);

  /// SHA-256 of what was written, by name.
  const std::map<std::string, std::string>& files() const { return files_; }
  /// False: no chart is there as PNG, for want of rsvg-convert.
  bool draws() const { return draws_; }

 private:
  void chart(const std::string& name, const std::string& svg, const std::string& caption);

  std::string folder_, body_, contents_;
  std::map<std::string, std::string> files_;
  const bool draws_;
};

/// The points of a chart's lines: line, x, y, low, high. What is not finite is empty.
std::string csv_of(const Chart& chart);
/// The bars of a chart: group, name, value, low, high.
std::string csv_of(const Bars& bars);

/// "0.941 (0.931..0.955)" with `digits` behind the point; without an interval the figure alone, and "-" for none.
std::string text_of(const Estimate& estimate, int digits);
std::string percent(const Estimate& estimate);
std::string fixed(double value, int digits);

}  // namespace citylearn::paper
