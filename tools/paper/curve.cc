#include "tools/paper/curve.h"

#include <cmath>

namespace citylearn::paper {
namespace {

constexpr double kLast = 500;  // episodes

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
  return of_mean(values);
}

}  // namespace citylearn::paper
