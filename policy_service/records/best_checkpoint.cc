// SPDX-License-Identifier: Apache-2.0
#include "policy_service/records/best_checkpoint.h"

#include <spdlog/spdlog.h>

#include <filesystem>
#include <utility>

#include "core/util/error.h"

namespace citylearn {
namespace {

/// Episodes of the present lesson, as many as the mean SPL is of. That of fewer may be luck, or of the lesson before.
constexpr std::uint64_t kSettled = 100;

/// Returns the figures of a checkpoint; none when too few episodes have ended.
std::optional<BestCheckpoint::Figures> figures_of(const Checkpoint& checkpoint) {
  const nlohmann::json progress = checkpoint.header.value("progress", nlohmann::json::object());
  const auto spl = progress.find("spl");
  if (spl == progress.end() || !spl->is_number() || progress.value("lesson_episodes", std::uint64_t{0}) < kSettled)
    return std::nullopt;
  return BestCheckpoint::Figures{progress.value("lesson", 0), spl->get<double>(),
                                 progress.value("updates", std::uint64_t{0})};
}

}  // namespace

BestCheckpoint::BestCheckpoint(const std::string& folder) : path_(folder + "/best.clk") {
  std::error_code none;
  if (!std::filesystem::exists(path_, none)) return;
  try {
    figures_ = figures_of(read_checkpoint(path_));
  } catch (const Error& error) {
    spdlog::warn("{}; the next checkpoint replaces it", error.what());
  }
}

void BestCheckpoint::consider(const Checkpoint& checkpoint) {
  const auto figures = figures_of(checkpoint);
  if (!figures) return;
  if (figures_ && std::pair(figures->lesson, figures->spl) < std::pair(figures_->lesson, figures_->spl)) return;
  write_checkpoint(path_, checkpoint);
  figures_ = figures;
}

}  // namespace citylearn
