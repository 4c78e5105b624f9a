// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/studies/statistics.h"

#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <limits>

#include "tools/lab/recognition/evaluation.h"

namespace citylearn::paper {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

}  // namespace

Estimate of_mean(const std::vector<double>& values) {
  Estimate result{0, kNone, kNone, 0};
  double squares = 0;
  for (const double value : values) {
    if (!std::isfinite(value)) continue;
    ++result.n;
    const double step = value - result.mean;  // Welford's way: exact for equal values
    result.mean += step / result.n;
    squares = std::fma(step, value - result.mean, squares);
  }
  if (result.n == 0) result.mean = kNone;
  if (result.n < 2) return result;
  const double n = result.n;
  const double reach = boost::math::quantile(boost::math::students_t(n - 1), 0.975) * std::sqrt(squares / (n - 1) / n);
  result.low = result.mean - reach;
  result.high = result.mean + reach;
  return result;
}

Estimate of_share(double successes, int trials) {
  if (trials < 1) return {kNone, kNone, kNone, 0};
  const Interval interval = wilson_interval(successes, trials);
  return {successes / trials, interval.low, interval.high, trials};
}

}  // namespace citylearn::paper
