#include "tools/paper/mean_curve.h"

#include <algorithm>
#include <cmath>

#include "tools/paper/statistics.h"

namespace citylearn::paper {
namespace {

constexpr int kPoints = 200;

/// Of an array with nulls, which are NaN.
std::vector<double> numbers(const Json& array) {
  std::vector<double> values;
  for (const Json& value : array) values.push_back(value.is_number() ? value.get<double>() : NAN);
  return values;
}

}  // namespace

Line mean_curve(const std::string& label, const std::vector<Json>& outcomes, const std::string& figure, double keep) {
  Line line{label, {}, {}};
  double last = 0;
  for (const Json& outcome : outcomes) last = std::max(last, outcome["episodes"].get<double>());
  for (int i = 1; i <= kPoints; ++i) line.x.push_back(last * i / kPoints);
  std::vector<std::vector<double>> seeds;
  for (const Json& outcome : outcomes) {
    const Json& curve = outcome["curve"];
    seeds.push_back(interpolated(numbers(curve["episodes"]), smoothed(numbers(curve[figure]), keep), line.x));
  }
  for (std::size_t i = 0; i < line.x.size(); ++i) {
    std::vector<double> values;
    for (const std::vector<double>& seed : seeds) values.push_back(seed[i]);
    const Estimate estimate = of_mean(values);
    line.y.push_back(estimate.mean);
    line.low.push_back(estimate.low);
    line.high.push_back(estimate.high);
  }
  return line;
}

}  // namespace citylearn::paper
