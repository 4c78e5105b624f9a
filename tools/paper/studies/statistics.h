// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

namespace citylearn::paper {

/// A figure with the interval that holds its true value in 95 of 100 cases.
struct Estimate {
  double mean = 0, low = 0, high = 0;
  int n = 0;  ///< values it comes from; with fewer than 2 there is no interval (NaN)
};

/// Returns the mean of independent values (Student's t). Values that are not finite are left out.
Estimate of_mean(const std::vector<double>& values);
/// Returns the share of successes among independent trials (Wilson, JASA 1927).
Estimate of_share(double successes, int trials);

}  // namespace citylearn::paper
