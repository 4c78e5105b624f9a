// SPDX-License-Identifier: Apache-2.0
#include "policy_service/records/best_checkpoint.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <filesystem>
#include <tuple>

#include "core/util/error.h"
#include "policy_service/learning/training_progress.h"

namespace citylearn {
namespace {

constexpr const char* kEvaluated = "evaluation_spl";  // in a checkpoint's header

/// Returns the figures of a checkpoint; none when nothing is known of its agent's SPL.
std::optional<BestCheckpoint::Figures> figures_of(const Checkpoint& checkpoint) {
  BestCheckpoint::Figures figures;
  const nlohmann::json progress = checkpoint.header.value("progress", nlohmann::json::object());
  figures.update = progress.value("updates", std::uint64_t{0});
  figures.lesson = progress.value("lesson", 0);
  // The mean SPL of fewer episodes may be luck, or of the lesson before.
  const auto spl = progress.find("spl");
  if (spl != progress.end() && spl->is_number() && progress.value("lesson_episodes", std::uint64_t{0}) >= kRecent)
    figures.training_spl = spl->get<double>();
  if (const auto found = checkpoint.header.find(kEvaluated); found != checkpoint.header.end() && found->is_number())
    figures.evaluation_spl = found->get<double>();
  return figures.training_spl || figures.evaluation_spl ? std::optional(figures) : std::nullopt;
}

/// Returns the figures that decide, in order. Each evaluation is on the whole route, whatever the lesson.
auto rank_of(const BestCheckpoint::Figures& figures) {
  return std::tuple(figures.evaluation_spl.has_value(), figures.evaluation_spl ? 0 : figures.lesson, figures.spl());
}

}  // namespace

std::string BestCheckpoint::Figures::description() const {
  return fmt::format("update {}, SPL {:.3f} in {}", update, spl(), evaluation_spl ? "evaluation" : "training");
}

BestCheckpoint::BestCheckpoint(const std::string& folder) : path_(folder + "/" + kBestCheckpoint) {
  std::error_code none;
  if (!std::filesystem::exists(path_, none)) return;
  try {
    figures_ = figures_of(read_checkpoint(path_));
  } catch (const Error& error) {
    spdlog::warn("{}; the next checkpoint replaces it", error.what());
  }
}

Checkpoint BestCheckpoint::evaluated(Checkpoint checkpoint, double spl) {
  checkpoint.header[kEvaluated] = spl;
  return checkpoint;
}

void BestCheckpoint::consider(const Checkpoint& checkpoint) {
  const auto figures = figures_of(checkpoint);
  if (!figures) return;
  if (figures_ && rank_of(*figures) < rank_of(*figures_)) return;
  write_checkpoint(path_, checkpoint);
  figures_ = figures;
}

}  // namespace citylearn
