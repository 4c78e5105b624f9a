// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "tools/chart/chart.h"
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

/// Values over episodes, NaN where there are none: from its last one on a seed is taken to stay as it was. Without that
/// a mean would leap where one ends that has fewer episodes than the others, as those that fail do.
void hold_last(std::vector<double>& values);
/// What a mean is of whose seeds were held: for captions.
constexpr const char* kMeanOfSeeds =
    "mean of the seeds with its 95 % interval (a seed with fewer episodes counts on with its last value)";

/// A figure of the trainings' curves ("reward", "spl", "length") over episodes, each seed's smoothed with the weight
/// `keep` for what was before, then held: mean of the seeds and its 95 % interval. `outcomes` as units of studies have
/// them (study.h).
Line mean_curve(const std::string& label, const std::vector<Json>& outcomes, const std::string& figure, double keep);

}  // namespace citylearn::paper
