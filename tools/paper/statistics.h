// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <vector>

namespace citylearn::paper {

/// A figure with the interval that holds its true value in 95 of 100 cases.
struct Estimate {
  double mean = 0, low = 0, high = 0;
  int n = 0;  ///< values it comes from; with fewer than 2 there is no interval (NaN)
};

/// Where values of a figure lie at all.
struct Range {
  double least = -INFINITY, most = INFINITY;
};
inline constexpr Range kShares{0, 1}, kCounts{0, INFINITY}, kRewards{-1, 1}, kExcesses{1, INFINITY};

/// Of the mean of independent values, seeds for example: Student's t, cut where no value can lie. Values that are not
/// finite are left out.
Estimate of_mean(const std::vector<double>& values, const Range& range = {});
/// Of a share of successes among independent trials (Wilson, JASA 1927).
Estimate of_share(double successes, int trials);

/// Exponential smoothing as TensorBoard does it: weight 1 - `keep` for the newest, without a pull to zero in the
/// beginning. Values that are not finite change nothing.
std::vector<double> smoothed(const std::vector<double>& values, double keep);

/// y at each of `at`, linear between the points (x rising); NaN outside of them.
std::vector<double> interpolated(const std::vector<double>& x, const std::vector<double>& y,
                                 const std::vector<double>& at);

}  // namespace citylearn::paper
