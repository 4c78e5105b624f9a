// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/statistics.h"

#include <algorithm>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <limits>

#include "encoder_service/recognition/evaluation.h"

namespace citylearn::paper {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

}  // namespace

Estimate of_mean(const std::vector<double>& values, const Range& range) {
  Estimate result{0, kNone, kNone, 0};
  double squares = 0;
  for (const double value : values) {
    if (!std::isfinite(value)) continue;
    ++result.n;
    const double step = value - result.mean;  // Welford's way: exact for equal values
    result.mean += step / result.n;
    squares += step * (value - result.mean);
  }
  if (result.n == 0) result.mean = kNone;
  if (result.n < 2) return result;
  const double n = result.n;
  const double reach = boost::math::quantile(boost::math::students_t(n - 1), 0.975) * std::sqrt(squares / (n - 1) / n);
  result.low = std::max(result.mean - reach, range.least);
  result.high = std::min(result.mean + reach, range.most);
  return result;
}

Estimate of_share(double successes, int trials) {
  if (trials < 1) return {kNone, kNone, kNone, 0};
  const Interval interval = wilson_interval(successes, trials);
  return {successes / trials, interval.low, interval.high, trials};
}

std::vector<double> smoothed(const std::vector<double>& values, double keep) {
  std::vector<double> result;
  double sum = 0, weight = 0;
  for (const double value : values) {
    if (std::isfinite(value)) {
      sum = keep * sum + (1 - keep) * value;
      weight = keep * weight + (1 - keep);
    }
    result.push_back(weight > 0 ? sum / weight : kNone);
  }
  return result;
}

std::vector<double> interpolated(const std::vector<double>& x, const std::vector<double>& y,
                                 const std::vector<double>& at) {
  std::vector<double> result;
  for (const double where : at) {
    const auto after = std::lower_bound(x.begin(), x.end(), where);
    if (after == x.end() || (after == x.begin() && where < x.front())) {
      result.push_back(kNone);
      continue;
    }
    const auto i = static_cast<std::size_t>(after - x.begin());
    if (i == 0 || x[i] == where) {
      result.push_back(y[i]);
      continue;
    }
    const double share = (where - x[i - 1]) / (x[i] - x[i - 1]);
    result.push_back(y[i - 1] + share * (y[i] - y[i - 1]));
  }
  return result;
}

}  // namespace citylearn::paper
