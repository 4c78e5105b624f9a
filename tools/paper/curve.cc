// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/curve.h"

#include <algorithm>
#include <cmath>

#include "tools/paper/trials.h"

namespace citylearn::paper {
namespace {

constexpr double kLast = 500;  // episodes
constexpr int kPoints = 200;   // of a drawn curve

}  // namespace

std::vector<double> numbers(const Json& array) {
  std::vector<double> values;
  for (const Json& value : array) values.push_back(value.is_number() ? value.get<double>() : NAN);
  return values;
}

double final_value(const Json& outcome, const std::string& figure) {
  const std::vector<double> episodes = numbers(outcome["curve"]["episodes"]),
                            values = numbers(outcome["curve"][figure]);
  double sum = 0, weight = 0;
  for (std::size_t i = values.size(); i-- > 0 && episodes.back() - episodes[i] < kLast;) {
    const double count = episodes[i] - (i > 0 ? episodes[i - 1] : 0);
    if (!std::isfinite(values[i])) continue;
    sum += count * values[i];
    weight += count;
  }
  return weight > 0 ? sum / weight : NAN;
}

Estimate final_values(const std::vector<Json>& outcomes, const std::string& figure) {
  std::vector<double> values;
  for (const Json& outcome : outcomes) values.push_back(final_value(outcome, figure));
  return of_mean(values, range_of(figure));
}

void hold_last(std::vector<double>& values) {
  const auto last = std::find_if(values.rbegin(), values.rend(), [](double value) { return std::isfinite(value); });
  if (last != values.rend()) std::fill(values.rbegin(), last, *last);
}

Line mean_curve(const std::string& label, const std::vector<Json>& outcomes, const std::string& figure, double keep) {
  Line line{label, {}, {}};
  double last = 0;
  for (const Json& outcome : outcomes) last = std::max(last, outcome["episodes"].get<double>());
  for (int i = 1; i <= kPoints; ++i) line.x.push_back(last * i / kPoints);
  std::vector<std::vector<double>> seeds;
  for (const Json& outcome : outcomes) {
    const Json& curve = outcome["curve"];
    seeds.push_back(interpolated(numbers(curve["episodes"]), smoothed(numbers(curve[figure]), keep), line.x));
    hold_last(seeds.back());
  }
  for (std::size_t i = 0; i < line.x.size(); ++i) {
    std::vector<double> values;
    for (const std::vector<double>& seed : seeds) values.push_back(seed[i]);
    const Estimate estimate = of_mean(values, range_of(figure));
    line.y.push_back(estimate.mean);
    line.low.push_back(estimate.low);
    line.high.push_back(estimate.high);
  }
  return line;
}

}  // namespace citylearn::paper
