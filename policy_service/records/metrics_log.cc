// SPDX-License-Identifier: Apache-2.0
#include "policy_service/records/metrics_log.h"

#include <spdlog/fmt/fmt.h>

#include <fstream>

#include "core/files/files.h"
#include "core/task/training_figures.h"

namespace citylearn {
MetricsLog::MetricsLog(const std::string& path, std::uint64_t after_update) {
  std::string kept;
  for (const TrainingFigure& figure : training_figures()) kept += (kept.empty() ? "" : ",") + std::string(figure.name);
  kept += "\n";
  if (after_update > 0) {
    refuse_special_file(path);
    std::ifstream in(path);
    std::string line;
    while (std::getline(in, line)) {
      std::uint64_t update = 0, steps, episodes, lesson;
      double wall = 0;
      char tail = 0;
      if (std::sscanf(line.c_str(), "%lu,%lu,%lu,%lu,%lf%c", &update, &steps, &episodes, &lesson, &wall, &tail) != 6 ||
          update > after_update)
        continue;
      kept += line + "\n";
      wall_ = wall;
      kept_.emplace_back(episodes, wall);
    }
  }
  write_file(path, kept);
  file_.emplace(path);
}

double MetricsLog::wall_at(std::uint64_t episodes) const {
  for (const auto& [finished, wall] : kept_)
    if (finished >= episodes) return wall;
  return 0;
}

void MetricsLog::write(const msg::TrainingStat& stat) {
  std::string row;
  for (const TrainingFigure& figure : training_figures()) {
    if (!row.empty()) row += ',';
    const double value = figure.value(stat);
    row += figure.type == TrainingFigure::kCount ? std::to_string(static_cast<std::uint64_t>(value))
                                                 : fmt::format(fmt::runtime(figure.format), value);
  }
  file_->add(row + "\n");
  file_->flush();
}

}  // namespace citylearn
