// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "dashboard/store/decimate.h"
#include "dashboard/store/sqlite.h"

namespace citylearn {

/// Figures of an update, under their names in TrainingStat and in the store.
struct TrainingColumn {
  const char* name;
  const char* sql;
  bool whole;  ///< a count; else a float, or (wall) a double
};
/// All of them, in the order of TrainingStat.
const std::vector<TrainingColumn>& training_columns();
/// Null where there is none of this name.
const TrainingColumn* find_training_column(const std::string& name);

struct RunRow {
  std::int64_t id = 0;
  std::string name, run;
  std::optional<std::string> policy;  ///< nothing: what belongs to no job that was heard of
  std::optional<std::uint64_t> seed;
  std::string agent, learner;
  double started = 0, last = 0;  ///< seconds since 1970
  bool ended = false;
  std::uint64_t updates = 0, recorded = 0;
  /// Of its newest update that is recorded.
  struct Newest {
    std::uint64_t update = 0, steps = 0, episodes = 0;
    double wall = 0, reward = 0, spl = 0, steps_per_second = 0;
  };
  std::optional<Newest> newest;
};

struct TraversalRow {
  std::string environment, dataset, traversal, condition;
  std::uint64_t hash = 0, frames = 0, agents = 0;
  bool images = false;
};

struct EpisodeRow {
  std::int64_t rowid = 0;
  std::string environment;
  std::uint64_t incarnation = 0, episode = 0, agent = 0;
  bool evaluation = false;
  std::uint64_t task = 0;
  std::string traversal, policy;
  std::uint64_t update = 0;
  bool shuffled = false;
  std::uint64_t start = 0, goal = 0, steps = 0, shortest = 0;
  double reward = 0;
  bool completed = false;
  double spl = 0, recorded = 0;
};

/// Which episodes of a run.
struct EpisodeFilter {
  std::optional<bool> evaluation, completed, shuffled;
  std::optional<std::string> traversal, policy;
  std::optional<std::uint64_t> update;
  std::optional<std::int64_t> before;  ///< rowid
};

/// Whose tasks an evaluation is made of.
struct EvaluationKey {
  std::string policy;
  std::uint64_t update = 0;
  bool shuffled = false;
  std::string traversal;
  auto operator<=>(const EvaluationKey&) const = default;
};

/// Reads a store while it is written, over a connection of its own. Used by one thread at a time.
class StoreReader {
 public:
  explicit StoreReader(const std::string& path);

  std::vector<RunRow> runs();  ///< newest first
  std::optional<RunRow> run(const std::string& name);
  std::string manifest(std::int64_t run);
  std::vector<TraversalRow> traversals(std::int64_t run);

  /// Rows of updates in their order, x first, then the columns, at most `points` of them; only those with
  /// `from` <= x <= `to`.
  struct TrainingQuery {
    std::int64_t run = 0;
    const TrainingColumn* x = nullptr;
    std::vector<const TrainingColumn*> columns;
    std::optional<double> from, to;
  };
  Decimator training(const TrainingQuery& query, std::size_t points);
  /// Every row of a run, all columns.
  void training(std::int64_t run, const std::function<void(const Statement&)>& each);

  std::vector<EpisodeRow> episodes(std::int64_t run, const EpisodeFilter& filter, bool worst, std::size_t limit);
  std::uint64_t count(std::int64_t run, const EpisodeFilter& filter);
  /// All of a run, in the order in which they were recorded.
  void episodes(std::int64_t run, const std::function<void(const EpisodeRow&)>& each);
  struct Replay {
    EpisodeRow row;
    std::optional<std::vector<std::uint8_t>> path;  ///< as in EpisodeStat; nothing: not kept
    std::optional<std::uint64_t> hash;              ///< of the traversal
  };
  std::optional<Replay> episode(std::int64_t rowid);

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
  RunRow run_row(const Statement& row);

  Database database_;
  Statement runs_, run_, newest_, manifest_, traversals_, training_, episodes_, episode_, groups_, tasks_, total_;
};

}  // namespace citylearn
