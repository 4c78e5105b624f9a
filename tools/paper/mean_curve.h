#pragma once

#include <string>
#include <vector>

#include "tools/chart/chart.h"
#include "tools/paper/work.h"

namespace citylearn::paper {

/// A figure of the trainings' curves ("reward", "spl", "length") over episodes, each seed's smoothed with the weight
/// `keep` for what was before: mean of the seeds and its 95 % interval. `outcomes` as units of studies have them
/// (study.h).
Line mean_curve(const std::string& label, const std::vector<Json>& outcomes, const std::string& figure, double keep);

}  // namespace citylearn::paper
