// SPDX-License-Identifier: Apache-2.0
#include "dashboard/store/decimate.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace citylearn {

Decimator::Decimator(std::size_t columns, std::size_t points, std::uint64_t first, std::uint64_t last)
    : width_(columns + 1),
      points_(std::max<std::size_t>(points, 2)),
      first_(first),
      last_(std::max(first, last)),
      buckets_(std::max<std::uint64_t>(1, (points_ - 2) / std::max<std::size_t>(2 * columns, 1))),
      least_(columns),
      greatest_(columns),
      least_rows_(columns * width_),
      greatest_rows_(columns * width_) {}

void Decimator::add(std::uint64_t update, std::span<const double> row) {
  if (total_ < points_) all_.insert(all_.end(), row.begin(), row.end());
  if (total_ == 0) first_row_.assign(row.begin(), row.end());
  last_row_.assign(row.begin(), row.end());
  ++total_;
  // As doubles: updates times buckets may be more than 64 bits hold.
  const double share = static_cast<double>(update - first_) / (static_cast<double>(last_ - first_) + 1);
  const auto bucket = std::min(buckets_ - 1, static_cast<std::uint64_t>(share * static_cast<double>(buckets_)));
  if (bucket != bucket_) close_bucket();
  bucket_ = bucket;
  for (std::size_t column = 0; column + 1 < width_; ++column) {
    const double value = row[column + 1];
    if (std::isnan(value)) continue;
    const auto take = [&](Extreme& extreme, std::vector<double>& rows) {
      extreme = {value, update, column, true};
      std::copy(row.begin(), row.end(), rows.begin() + static_cast<std::ptrdiff_t>(column * width_));
    };
    if (!least_[column].there || value < least_[column].value) take(least_[column], least_rows_);
    if (!greatest_[column].there || value > greatest_[column].value) take(greatest_[column], greatest_rows_);
  }
}

void Decimator::close_bucket() {
  std::vector<std::pair<std::uint64_t, const double*>> found;  // update, row
  const auto gather = [&](std::vector<Extreme>& extremes, const std::vector<double>& rows) {
    for (Extreme& extreme : extremes) {
      if (extreme.there) found.emplace_back(extreme.update, rows.data() + extreme.row * width_);
      extreme.there = false;
    }
  };
  gather(least_, least_rows_);
  gather(greatest_, greatest_rows_);
  std::sort(found.begin(), found.end());
  const auto end =
      std::unique(found.begin(), found.end(), [](const auto& a, const auto& b) { return a.first == b.first; });
  for (auto one = found.begin(); one != end; ++one) kept_.insert(kept_.end(), one->second, one->second + width_);
}

void Decimator::finish() {
  close_bucket();
  if (total_ <= points_) {
    kept_ = std::move(all_);
    return;
  }
  const auto same = [&](const std::vector<double>& row, const double* other) {
    return std::equal(row.begin(), row.end(), other,
                      [](double a, double b) { return a == b || (std::isnan(a) && std::isnan(b)); });
  };
  if (kept_.empty() || !same(first_row_, kept_.data()))
    kept_.insert(kept_.begin(), first_row_.begin(), first_row_.end());
  if (!same(last_row_, kept_.data() + kept_.size() - width_))
    kept_.insert(kept_.end(), last_row_.begin(), last_row_.end());
  if (rows() <= points_) return;
  // More columns than points can show: every so many-th row, the last one among them.
  std::vector<double> fewer;
  const std::size_t many = rows();
  for (std::size_t i = 0; i < points_; ++i) {
    const double* row = kept_.data() + (i * (many - 1) / (points_ - 1)) * width_;
    fewer.insert(fewer.end(), row, row + width_);
  }
  kept_ = std::move(fewer);
}

}  // namespace citylearn
