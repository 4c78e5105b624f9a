// SPDX-License-Identifier: Apache-2.0
#include "env_service/dataset_io/features.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>

#include "core/files/files.h"
#include "core/wire/messages.h"
#include "env_service/dataset_io/dataset.h"
#include "env_service/files/text_table.h"

namespace citylearn {
namespace {

/// A table of numbers, one frame a line.
class Table {
 public:
  Table(const std::string& path, Traversal& traversal) : path_(path), traversal_(traversal) {}

  void parse(std::string_view text) {
    each_line(text, [this](std::string_view line, int number) {
      line_ = number;
      parse_line(line);
    });
    if (traversal_.frames == 0) throw Error("has no frames", path_);
    if (traversal_.frames == 1) throw Error("has only one frame, a route needs two", path_);
    const std::vector<float>& all = traversal_.features;
    if (std::equal(all.begin() + traversal_.dimension, all.end(), all.begin()))
      spdlog::warn("{}: all its frames have the same features: no place can be told from another", path_);
    refuse_header_and_index();
  }

 private:
  [[noreturn]] void fail(const std::string& what, const std::string& remedy = "") const {
    throw Error(what, path_ + ":" + std::to_string(line_), remedy);
  }

  /// Refuses a first line that numbers the columns and a first or last column that numbers the lines, up or down, or
  /// has times, as pandas writes them beside features. Features that are all whole numbers may look so too, but for a
  /// header of 8 columns.
  void refuse_header_and_index() const {
    const auto frames = static_cast<std::size_t>(traversal_.frames),
               columns = static_cast<std::size_t>(traversal_.dimension);
    if (columns < 2) return;
    const float* const first = traversal_.features.data();
    bool header = first[0] == 0 || first[0] == 1, fractions = false;
    for (std::size_t i = 1; i < columns; ++i) header = header && first[i] == first[i - 1] + 1;
    for (const float* row = first + columns; row != first + frames * columns; row += columns)
      fractions = fractions || std::any_of(row, row + columns, [](float x) { return x != std::floor(x); });
    if (header && (fractions || columns >= 8))
      throw Error("numbers the columns", path_ + ":1", "remove this line, as features have no header");
    for (const std::size_t column : {std::size_t{0}, columns - 1}) {
      const float mean_step = (first[(frames - 1) * columns + column] - first[column]) / static_cast<float>(frames - 1);
      const bool usual = column == 0 && first[columns] > first[0];
      bool index = frames > (usual ? 2 : 7), rises = frames > 7, times = true, even = frames > 15;
      for (const float* at = first + column + columns; at < first + frames * columns; at += columns) {
        const float before = *(at - columns), step = *at - before;
        index =
            index && std::abs(step) >= 1 && step == first[column + columns] - first[column] && *at == std::floor(*at);
        rises = rises && step >= 1 && before == std::floor(before) && *at == std::floor(*at);
        times = times && step >= 0 && before >= 1e8F;
        even = even && std::abs(step / mean_step - 1) < 0.5F;
      }
      if (fractions && (index || rises || times))
        throw Error("column " + std::to_string(column + 1) + " has " +
                        (index || rises ? "the numbers of lines" : "times") + ", not a feature",
                    path_, "remove it; of pandas: to_csv(index=False, header=False)");
      if (even) spdlog::warn("{}: column {} rises or falls evenly, as times do: is it a feature?", path_, column + 1);
    }
  }

  void parse_line(std::string_view line) {
    if (line.empty()) {
      if (!empty_line_) empty_line_ = line_;
      return;
    }
    // Empty lines may end a file. Between frames they mean that one is missing, and that would move all that follow.
    if (empty_line_) {
      line_ = empty_line_;
      fail("an empty line between frames", "remove it, or put the missing frame there");
    }
    if (traversal_.frames == static_cast<int>(msg::MAX_FRAMES))
      fail("more than " + std::to_string(msg::MAX_FRAMES) + " frames");
    int columns = 0;
    for (const char* at = line.data();;) {
      at = parse_number(at, line.data() + line.size(), ++columns);
      if (at == line.data() + line.size()) break;
      ++at;  // the comma
    }
    if (traversal_.frames == 0) traversal_.dimension = columns;
    if (columns != traversal_.dimension)
      fail(std::to_string(columns) + " columns, the lines before have " + std::to_string(traversal_.dimension));
    ++traversal_.frames;
    float largest = 0;
    for (int i = 1; i <= columns; ++i) largest = std::max(largest, std::abs(traversal_.features.end()[-i]));
    if (largest == 0 && !std::exchange(has_zeros_, true))
      spdlog::warn("{}:{}: only zeros; places with such features look alike", path_, line_);
    // Lengths are sums of squares, which would overflow or vanish.
    if (largest > 1e15F || (largest > 0 && largest < 1e-15F))
      fail(fmt::format("its largest number is {:.2g}, with which lengths cannot be computed", largest),
           "multiply the features of all recordings by one number");
  }

  /// Returns where the number's column ends: at a comma or at `end`.
  const char* parse_number(const char* at, const char* end, int column) {
    const auto where = [column] { return " in column " + std::to_string(column); };
    if (column > kMaxDimension) fail("more than " + std::to_string(kMaxDimension) + " columns");
    const auto blank = [](char c) { return c == ' ' || c == '\t'; };
    while (at != end && blank(*at)) ++at;
    float value = 0;
    const bool plus = at + 1 < end && *at == '+' && at[1] != '-';  // from_chars knows no plus sign
    auto [after, error] = std::from_chars(at + plus, end, value);
    if (error == std::errc::result_out_of_range) {
      // Too small for a float is zero; too large is an error. strtof distinguishes them, whatever the digits.
      const float nearest = std::strtof(std::string(at + plus, after).c_str(), nullptr);
      value = std::isinf(nearest) ? nearest : 0.0f;
    }
    while (error != std::errc::invalid_argument && after != end && blank(*after)) ++after;
    if (error == std::errc::invalid_argument || (after != end && *after != ',')) {
      const std::string_view token(at, static_cast<std::size_t>(std::find(at, end, ',') - at));
      fail(token.empty() ? "nothing" + where() : "'" + printable(token) + "'" + where() + " is not a number",
           "features are numbers between commas, without a header or names");
    }
    if (!std::isfinite(value)) fail("a number that is not finite" + where());
    const std::string_view digits(at, static_cast<std::size_t>(after - at));
    if (digits.size() > 1 && digits[0] == '0' && digits[1] >= '0' && digits[1] <= '9')
      fail("'" + printable(digits) + "'" + where() + " begins with 0, as digits behind a comma within a number do",
           "write decimals with a point, and thousands without a comma");
    traversal_.features.push_back(value);
    return after;
  }

  const std::string& path_;
  Traversal& traversal_;
  int line_ = 0;
  bool has_zeros_ = false;
  int empty_line_ = 0;  // the first empty line since the last frame; 0 = none
};

}  // namespace

void read_features(const std::string& path, Traversal& traversal) {
  const std::string text = read_file(path);
  traversal.features.reserve(text.size() / 8);
  Table(path, traversal).parse(text);
  traversal.features.shrink_to_fit();
}

}  // namespace citylearn
