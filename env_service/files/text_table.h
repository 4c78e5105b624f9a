// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace citylearn {

/// Returns the text without blanks and tabs at its ends.
std::string_view trimmed(std::string_view text);
/// Calls `visit(line, number)` for each line of a text, without blanks and tabs at its ends; numbers begin with 1. Line
/// ends may be LF, CRLF or CR alone; a byte order mark is skipped.
void each_line(std::string_view text, const std::function<void(std::string_view line, int number)>& visit);
/// Returns the first 20 characters of a field for a message; those that a terminal cannot show become '?'.
std::string printable(std::string_view field);

/// Returns the number that is a field of its own, as between separators; kUnknown when the field is missing or anything
/// else.
double field_number(const std::vector<std::string_view>& fields, std::size_t index);

/// Rows of a text file of fields. Line ends may be LF, CRLF or CR alone; a byte order mark, empty lines and lines that
/// begin with '#' are skipped. A row with more fields than the header names is refused.
class TextTable {
 public:
  struct Options {
    char separator = ',';  ///< ' ' stands for any run of blanks and tabs
    bool header = true;    ///< the first row names the columns
  };
  TextTable(const std::string& path, const Options& options);

  int rows() const;
  int columns(int row) const;
  bool has(const std::string& column) const;
  const std::vector<std::string>& unused() const;  ///< columns with a name for which nothing was asked yet
  /// Returns a field by its column's name or index, without blanks at its ends. Throws Error for an unknown column.
  std::string_view text(int row, const std::string& column) const;
  std::string_view text(int row, int column) const;
  /// Returns the field as a finite number. Throws Error otherwise.
  double number(int row, const std::string& column) const;
  double number(int row, int column) const;
  /// Returns where the row stands, "PATH:LINE".
  std::string place(int row) const;
  /// Throws Error about this row: "PATH:LINE: what (remedy)".
  [[noreturn]] void fail(int row, const std::string& what, const std::string& remedy = "") const;
  const std::string& path() const;

 private:
  struct Impl;
  std::shared_ptr<const Impl> impl_;
};

}  // namespace citylearn
