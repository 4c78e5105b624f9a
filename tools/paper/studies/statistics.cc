// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/studies/statistics.h"

#include <boost/math/distributions/students_t.hpp>
#include <cmath>

#include "tools/lab/recognition/evaluation.h"

namespace citylearn::paper {
namespace {

Json estimate(double mean, double low, double high, int n) {
  return {{"mean", number(mean)}, {"low", number(low)}, {"high", number(high)}, {"n", n}};
}

}  // namespace

Json mean_estimate(const std::vector<double>& values) {
  double mean = 0, squares = 0;
  int n = 0;
  for (const double value : values) {
    if (!std::isfinite(value)) continue;
    const double step = value - mean;  // Welford's way: exact for equal values
    mean += step / ++n;
    squares = std::fma(step, value - mean, squares);
  }
  if (n < 2) return estimate(n ? mean : NAN, NAN, NAN, n);
  const double reach = boost::math::quantile(boost::math::students_t(n - 1), 0.975) * std::sqrt(squares / (n - 1) / n);
  return estimate(mean, mean - reach, mean + reach, n);
}

Json share_estimate(double successes, int trials) {
  if (trials < 1) return estimate(NAN, NAN, NAN, 0);
  const Interval interval = wilson_interval(successes, trials);
  return estimate(successes / trials, interval.low, interval.high, trials);
}

}  // namespace citylearn::paper
