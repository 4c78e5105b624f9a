// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/task/training_figures.h"
#include "dashboard/store/decimate.h"
#include "dashboard/store/rows.h"

namespace citylearn {

/// Reads a store while it is written, over a connection of its own. Used by one thread at a time.
class StoreReader {
 public:
  /// Throws Error, naming the file, as all methods do.
  explicit StoreReader(const std::string& path);
  ~StoreReader();

  std::vector<RunRow> runs();  ///< newest first
  std::optional<RunRow> run(const std::string& name);
  std::string manifest(std::int64_t run);
  std::vector<TraversalRow> traversals(std::int64_t run);

  /// Rows of updates in their order, x first, then the columns, at most `points` of them; only those with
  /// `from` <= x <= `to`.
  struct TrainingQuery {
    std::int64_t run = 0;
    const TrainingFigure* x = nullptr;
    std::vector<const TrainingFigure*> columns;
    std::optional<double> from, to;
  };
  Decimator training(const TrainingQuery& query, std::size_t points);

  std::vector<EpisodeRow> episodes(std::int64_t run, const EpisodeFilter& filter, bool worst, std::size_t limit);
  std::uint64_t count(std::int64_t run, const EpisodeFilter& filter);
  struct Replay {
    EpisodeRow row;
    std::optional<std::vector<std::uint8_t>> path;  ///< as in EpisodeStat; nothing: not kept
    std::optional<std::uint64_t> hash;              ///< of the traversal
    StateRule rule = StateRule::kLine;              ///< likewise
  };
  std::optional<Replay> episode(std::int64_t rowid);

  std::optional<RouteMap> map(std::uint64_t hash);
  struct PlacePicture {
    std::uint32_t frame = 0;
    PictureFile picture;
  };
  /// Returns the picture of a frame, or where there is none that of the nearest frame that has one.
  std::optional<PlacePicture> picture(std::uint64_t hash, std::uint32_t frame);

  struct EvaluationGroup {
    EvaluationKey key;
    std::uint64_t episodes = 0;
    std::int64_t newest = 0;  ///< rowid
  };
  std::vector<EvaluationGroup> evaluations(std::int64_t run);
  struct TaskRow {
    std::uint64_t steps = 0, shortest = 0;
    double reward = 0, spl = 0;
    bool completed = false;
  };
  /// Each task once: what was done again counts as it was done last.
  std::vector<TaskRow> tasks(std::int64_t run, const EvaluationKey& key);

  std::uint64_t episodes();  ///< of all runs

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace citylearn
