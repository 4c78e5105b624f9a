// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace citylearn {

/// Thins rows of columns so that no peak is lost: divides them into buckets of equally many updates and keeps of each
/// bucket the rows in which a column is least or greatest. Keeps the first and the last row too.
class Decimator {
 public:
  /// Keeps at most `points` rows (at least 2) of x and `columns` further columns; the updates will be in first..last.
  Decimator(std::size_t columns, std::size_t points, std::uint64_t first, std::uint64_t last);

  /// Adds a row, x first, in the order of the updates. NaN is never least or greatest.
  void add(std::uint64_t update, std::span<const double> row);
  void finish();

  std::uint64_t total() const { return total_; }
  bool decimated() const { return rows() < total_; }
  std::size_t rows() const { return kept_.size() / width_; }
  /// After finish(): rows() x (1 + columns), row-major.
  const std::vector<double>& values() const { return kept_; }

 private:
  struct Extreme {
    double value = 0;
    std::uint64_t update = 0;
    std::size_t row = 0;  ///< in bucket_rows_
    bool there = false;
  };
  void close_bucket();

  const std::size_t width_, points_;
  const std::uint64_t first_, last_, buckets_;
  std::uint64_t total_ = 0, bucket_ = 0;
  std::vector<double> all_;  ///< the first `points` rows, in case there are no more
  std::vector<double> kept_, first_row_, last_row_;
  std::vector<Extreme> least_, greatest_;
  std::vector<double> least_rows_, greatest_rows_;  ///< of the bucket: columns x width
};

}  // namespace citylearn
