// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "tools/paper/work.h"

// Figures with the interval that holds their true value in 95 of 100 cases: {"mean", "low", "high", "n"}, null where
// there is no figure or no interval.

namespace citylearn::paper {

/// Returns the mean of independent values (Student's t); of fewer than 2 there is no interval. Values that are not
/// finite are left out.
Json mean_estimate(const std::vector<double>& values);
/// Returns the share of successes among independent trials (Wilson, JASA 1927).
Json share_estimate(double successes, int trials);

}  // namespace citylearn::paper
