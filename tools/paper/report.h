#pragma once

#include <string>
#include <vector>

#include "tools/paper/statistics.h"

namespace citylearn::paper {

/// Rows of text under headings.
struct ReportTable {
  std::string name;  ///< of its CSV file
  std::string caption;
  std::vector<std::string> columns;
  std::vector<std::vector<std::string>> rows;
};

/// One HTML file that needs no other, with the figures and tables also as files beside it (NAME.svg, NAME.png,
/// NAME.csv).
class Report {
 public:
  /// `folder` exists.
  explicit Report(std::string folder) : folder_(std::move(folder)) {}

  void section(const std::string& name, const std::string& title);
  /// A paragraph; markup in it is text.
  void text(const std::string& paragraph);
  /// One that a reader must not miss: where we are worse, or what a figure does not tell.
  void remark(const std::string& paragraph);
  void table(const ReportTable& table);
  void figure(const std::string& name, const std::string& svg, const std::string& caption);
  void picture(const std::string& name, const std::string& png, const std::string& caption);

  /// Writes report.html. Throws Error.
  void write(const std::string& title, const std::string& about) const;

 private:
  std::string folder_, body_, contents_;
};

/// "0.941 (0.931..0.955)" with `digits` behind the point; without an interval the figure alone, and "-" for none.
std::string text_of(const Estimate& estimate, int digits);
std::string percent(const Estimate& estimate);
std::string fixed(double value, int digits);

}  // namespace citylearn::paper
