#pragma once

#include <string>
#include <vector>

#include "tools/chart/chart.h"
#include "tools/paper/work.h"

namespace citylearn::paper {

/// The weight that the paper's smoothing gives to what was before.
inline constexpr double kSmoothing = 0.9;

/// Of an array with nulls, which are NaN.
std::vector<double> numbers(const Json& array);

/// A figure of the trainings' curves ("reward", "spl", "length") over episodes, smoothed: mean of the seeds and its 95
/// % interval. `outcomes` as units of studies have them (study.h).
Line curve(const std::string& label, const std::vector<Json>& outcomes, const std::string& figure,
           double keep = kSmoothing);

}  // namespace citylearn::paper
