#pragma once

#include <string>
#include <vector>

#include "tools/paper/statistics.h"
#include "tools/paper/work.h"

namespace citylearn::paper {

/// An array of an outcome, NaN for null.
std::vector<double> numbers(const Json& array);

/// What a training (see Study) had in the end: mean of a figure of its curve over the last 500 episodes. NaN when there
/// were none.
double final_value(const Json& outcome, const std::string& figure);

/// final_value of each seed.
Estimate final_values(const std::vector<Json>& outcomes, const std::string& figure);

}  // namespace citylearn::paper
