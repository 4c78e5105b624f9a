// SPDX-License-Identifier: Apache-2.0
#include "policy_service/run/metrics_log.h"

#include <spdlog/fmt/fmt.h>

#include <fstream>

#include "core/util/files.h"

namespace citylearn {
namespace {

constexpr const char* kHeader =
    "update,steps,episodes,lesson,wall,steps_per_second,reward,spl,policy_loss,value_loss,entropy,divergence,clipped,"
    "gradient_norm,learning_rate,lag";

}  // namespace

MetricsLog::MetricsLog(const std::string& path, std::uint64_t after_update) {
  std::string kept = std::string(kHeader) + "\n";
  if (after_update > 0) {
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

void MetricsLog::write(const msg::TrainingStat& s) {
  file_->add(fmt::format(
      "{},{},{},{},{:.3f},{:.0f},{:.5f},{:.5f},{:.6g},{:.6g},{:.5f},{:.6g},{:.5f},{:.5g},{:.6g},{:.3f}\n", s.update(),
      s.steps(), s.episodes(), s.lesson(), s.wall(), s.steps_per_second(), s.reward(), s.spl(), s.policy_loss(),
      s.value_loss(), s.entropy(), s.divergence(), s.clipped(), s.gradient_norm(), s.learning_rate(), s.lag()));
  file_->flush();
}

}  // namespace citylearn
