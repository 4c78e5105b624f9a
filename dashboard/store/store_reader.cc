// SPDX-License-Identifier: Apache-2.0
#include "dashboard/store/store_reader.h"

#include <limits>

#include "core/util/error.h"

namespace citylearn {
namespace {

constexpr int kUpdateBits = 40;  // of training.key (schema.cc)
constexpr std::int64_t kMostUpdates = (std::int64_t{1} << kUpdateBits) - 1;

constexpr const char* kRunColumns =
    "SELECT id, name, run, policy, seed, agent, learner, started, last, ended, updates, recorded, job IS NULL FROM "
    "runs ";

#define CITYLEARN_EPISODE_COLUMNS                                                                         \
  "e.id, s.environment, s.incarnation, e.episode, e.agent, e.evaluation, e.task, e.traversal, e.policy, " \
  "e.\"update\", e.shuffled, e.start, e.goal, e.steps, e.shortest, e.reward, e.completed, e.spl, e.recorded"

std::uint64_t count_of(const Statement& row, int column) { return static_cast<std::uint64_t>(row.number(column)); }

EpisodeRow episode_row(const Statement& row) {
  EpisodeRow e;
  e.rowid = row.number(0);
  e.environment = row.text(1);
  e.incarnation = count_of(row, 2);
  e.episode = count_of(row, 3);
  e.agent = count_of(row, 4);
  e.evaluation = row.number(5) != 0;
  e.task = count_of(row, 6);
  e.traversal = row.text(7);
  e.policy = row.text(8);
  e.update = count_of(row, 9);
  e.shuffled = row.number(10) != 0;
  e.start = count_of(row, 11);
  e.goal = count_of(row, 12);
  e.steps = count_of(row, 13);
  e.shortest = count_of(row, 14);
  e.reward = row.real(15);
  e.completed = row.number(16) != 0;
  e.spl = row.real(17);
  e.recorded = row.real(18);
  return e;
}

/// The conditions of a filter, and their values in the same order.
class Conditions {
 public:
  explicit Conditions(const EpisodeFilter& filter) : filter_(filter) {
    if (filter.evaluation) sql_ += *filter.evaluation ? " AND e.evaluation = 1" : " AND e.evaluation = 0";
    if (filter.completed) sql_ += *filter.completed ? " AND e.completed = 1" : " AND e.completed = 0";
    if (filter.shuffled) sql_ += *filter.shuffled ? " AND e.shuffled = 1" : " AND e.shuffled = 0";
    if (filter.traversal) sql_ += " AND e.traversal = ?";
    if (filter.policy) sql_ += " AND e.policy = ?";
    if (filter.update) sql_ += " AND e.\"update\" = ?";
    if (filter.before) sql_ += " AND e.id < ?";
  }
  const std::string& sql() const { return sql_; }
  void bind(Statement& statement, int index) const {
    if (filter_.traversal) statement.bind(index++, *filter_.traversal);
    if (filter_.policy) statement.bind(index++, *filter_.policy);
    if (filter_.update) statement.bind(index++, *filter_.update);
    if (filter_.before) statement.bind(index++, *filter_.before);
  }

 private:
  const EpisodeFilter& filter_;
  std::string sql_;
};

std::string all_columns() {
  std::string list;
  for (const TrainingColumn& column : training_columns()) list += (list.empty() ? "" : ", ") + std::string(column.sql);
  return list;
}

}  // namespace

const std::vector<TrainingColumn>& training_columns() {
  static const std::vector<TrainingColumn> columns = {{"update", "key & 1099511627775", true},
                                                      {"steps", "steps", true},
                                                      {"episodes", "episodes", true},
                                                      {"lesson", "lesson", true},
                                                      {"wall", "wall", false},
                                                      {"steps_per_second", "steps_per_second", false},
                                                      {"reward", "reward", false},
                                                      {"spl", "spl", false},
                                                      {"policy_loss", "policy_loss", false},
                                                      {"value_loss", "value_loss", false},
                                                      {"entropy", "entropy", false},
                                                      {"approx_kl", "divergence", false},
                                                      {"clip_fraction", "clipped", false},
                                                      {"gradient_norm", "gradient_norm", false},
                                                      {"learning_rate", "learning_rate", false},
                                                      {"policy_lag", "lag", false}};
  return columns;
}

const TrainingColumn* find_training_column(const std::string& name) {
  for (const TrainingColumn& column : training_columns())
    if (name == column.name) return &column;
  return nullptr;
}

StoreReader::StoreReader(const std::string& path)
    : database_(path, Database::Mode::kRead),
      runs_(database_, std::string(kRunColumns) + "ORDER BY started DESC, id DESC"),
      run_(database_, std::string(kRunColumns) + "WHERE name = ?"),
      newest_(
          database_,
          "SELECT key, steps, episodes, wall, reward, spl, steps_per_second FROM training WHERE key BETWEEN ? AND ? "
          "ORDER BY key DESC LIMIT 1"),
      manifest_(database_, "SELECT manifest FROM runs WHERE id = ?"),
      // Of an environment that was started again the newest counts: that is what SQLite gives beside MAX().
      traversals_(database_,
                  "SELECT s.environment, s.dataset, s.traversal, s.condition, s.hash, s.frames, s.agents, s.images, "
                  "MAX(s.incarnation) FROM run_sources r JOIN sources s ON s.id = r.source "
                  "WHERE r.run = ? AND s.dataset IS NOT NULL GROUP BY s.environment ORDER BY s.environment"),
      training_(database_, "SELECT " + all_columns() + " FROM training WHERE key BETWEEN ? AND ? ORDER BY key"),
      episodes_(database_, "SELECT " CITYLEARN_EPISODE_COLUMNS
                           " FROM episodes e JOIN sources s ON s.id = e.source WHERE e.run = ? ORDER BY e.id"),
      episode_(database_, "SELECT " CITYLEARN_EPISODE_COLUMNS
                          ", e.path, s.hash FROM episodes e JOIN sources s ON s.id = e.source WHERE e.id = ?"),
      groups_(database_,
              "SELECT policy, \"update\", shuffled, traversal, COUNT(*), MAX(id) FROM episodes "
              "WHERE run = ? AND evaluation = 1 GROUP BY policy, \"update\", shuffled, traversal"),
      tasks_(database_,
             "SELECT task, steps, shortest, reward, spl, completed FROM episodes WHERE run = ? AND evaluation = 1 AND "
             "policy = ? AND \"update\" = ? AND shuffled = ? AND traversal = ? ORDER BY task, id"),
      total_(database_, "SELECT SUM(recorded) FROM runs") {}

RunRow StoreReader::run_row(const Statement& row) {
  RunRow run;
  run.id = row.number(0);
  run.name = row.text(1);
  run.run = row.text(2);
  if (row.number(12) == 0) {
    run.policy = row.text(3);
    run.seed = count_of(row, 4);
  }
  run.agent = row.text(5);
  run.learner = row.text(6);
  run.started = row.real(7);
  run.last = row.real(8);
  run.ended = row.number(9) != 0;
  run.updates = count_of(row, 10);
  run.recorded = count_of(row, 11);
  newest_.bind(1, run.id << kUpdateBits).bind(2, (run.id << kUpdateBits) + kMostUpdates);
  if (newest_.step()) {
    RunRow::Newest newest;
    newest.update = count_of(newest_, 0) & static_cast<std::uint64_t>(kMostUpdates);
    newest.steps = count_of(newest_, 1);
    newest.episodes = count_of(newest_, 2);
    newest.wall = newest_.real(3);
    newest.reward = newest_.real(4);
    newest.spl = newest_.real(5);
    newest.steps_per_second = newest_.real(6);
    run.newest = newest;
  }
  newest_.reset();
  return run;
}

std::vector<RunRow> StoreReader::runs() {
  std::vector<RunRow> rows;
  while (runs_.step()) rows.push_back(run_row(runs_));
  return rows;
}

std::optional<RunRow> StoreReader::run(const std::string& name) {
  std::optional<RunRow> row;
  run_.bind(1, name);
  while (run_.step()) row = run_row(run_);
  return row;
}

std::string StoreReader::manifest(std::int64_t run) {
  std::string text;
  manifest_.bind(1, run);
  while (manifest_.step()) text = manifest_.text(0);
  return text;
}

std::vector<TraversalRow> StoreReader::traversals(std::int64_t run) {
  std::vector<TraversalRow> rows;
  traversals_.bind(1, run);
  while (traversals_.step())
    rows.push_back({traversals_.text(0), traversals_.text(1), traversals_.text(2), traversals_.text(3),
                    count_of(traversals_, 4), count_of(traversals_, 5), count_of(traversals_, 6),
                    traversals_.number(7) != 0});
  return rows;
}

Decimator StoreReader::training(const TrainingQuery& query, std::size_t points) {
  std::string where = " FROM training WHERE key BETWEEN ?1 AND ?2";
  if (query.from) where += " AND (" + std::string(query.x->sql) + ") >= ?3";
  if (query.to) where += " AND (" + std::string(query.x->sql) + ") <= ?4";
  const auto bind = [&](Statement& statement) {
    statement.bind(1, query.run << kUpdateBits).bind(2, (query.run << kUpdateBits) + kMostUpdates);
    if (query.from) statement.bind(3, *query.from);
    if (query.to) statement.bind(4, *query.to);
  };
  const auto end = [&](const char* order) {
    Statement row(database_, "SELECT key" + where + " ORDER BY key" + order + " LIMIT 1");
    bind(row);
    return row.step() ? static_cast<std::uint64_t>(row.number(0) & kMostUpdates) : 0;
  };
  Transaction one_moment(database_, Transaction::Kind::kRead);
  Decimator rows(query.columns.size(), points, end(""), end(" DESC"));
  std::string sql = "SELECT key, " + std::string(query.x->sql);
  for (const TrainingColumn* column : query.columns) sql += ", " + std::string(column->sql);
  Statement all(database_, sql + where + " ORDER BY key");
  bind(all);
  std::vector<double> row(query.columns.size() + 1);
  while (all.step()) {
    for (std::size_t i = 0; i < row.size(); ++i) row[i] = all.real(static_cast<int>(i) + 1);
    rows.add(static_cast<std::uint64_t>(all.number(0) & kMostUpdates), row);
  }
  rows.finish();
  return rows;
}

void StoreReader::training(std::int64_t run, const std::function<void(const Statement&)>& each) {
  training_.bind(1, run << kUpdateBits).bind(2, (run << kUpdateBits) + kMostUpdates);
  while (training_.step()) each(training_);
}

std::vector<EpisodeRow> StoreReader::episodes(std::int64_t run, const EpisodeFilter& filter, bool worst,
                                              std::size_t limit) {
  const Conditions conditions(filter);
  Statement rows(database_, "SELECT " CITYLEARN_EPISODE_COLUMNS
                            " FROM episodes e JOIN sources s ON s.id = e.source WHERE e.run = ?" +
                                conditions.sql() +
                                (worst ? " ORDER BY e.spl, e.steps DESC, e.id" : " ORDER BY e.id DESC") + " LIMIT " +
                                std::to_string(limit));
  rows.bind(1, run);
  conditions.bind(rows, 2);
  std::vector<EpisodeRow> found;
  while (rows.step()) found.push_back(episode_row(rows));
  return found;
}

std::uint64_t StoreReader::count(std::int64_t run, const EpisodeFilter& filter) {
  const Conditions conditions(filter);
  Statement rows(database_, "SELECT COUNT(*) FROM episodes e WHERE e.run = ?" + conditions.sql());
  rows.bind(1, run);
  conditions.bind(rows, 2);
  return rows.step() ? count_of(rows, 0) : 0;
}

void StoreReader::episodes(std::int64_t run, const std::function<void(const EpisodeRow&)>& each) {
  episodes_.bind(1, run);
  while (episodes_.step()) each(episode_row(episodes_));
}

std::optional<StoreReader::Replay> StoreReader::episode(std::int64_t rowid) {
  std::optional<Replay> found;
  episode_.bind(1, rowid);
  while (episode_.step()) {
    Replay& replay = found.emplace();
    replay.row = episode_row(episode_);
    if (!episode_.null(19)) {
      const auto path = episode_.blob(19);
      replay.path.emplace(path.begin(), path.end());
    }
    if (!episode_.null(20)) replay.hash = count_of(episode_, 20);
  }
  return found;
}

std::vector<StoreReader::EvaluationGroup> StoreReader::evaluations(std::int64_t run) {
  std::vector<EvaluationGroup> groups;
  groups_.bind(1, run);
  while (groups_.step())
    groups.push_back({{groups_.text(0), count_of(groups_, 1), groups_.number(2) != 0, groups_.text(3)},
                      count_of(groups_, 4),
                      groups_.number(5)});
  return groups;
}

std::vector<StoreReader::TaskRow> StoreReader::tasks(std::int64_t run, const EvaluationKey& key) {
  std::vector<TaskRow> rows;
  tasks_.bind(1, run).bind(2, key.policy).bind(3, key.update).bind(4, key.shuffled).bind(5, key.traversal);
  std::uint64_t task = 0;
  while (tasks_.step()) {
    if (rows.empty() || count_of(tasks_, 0) != task) rows.emplace_back();
    task = count_of(tasks_, 0);
    rows.back() = {count_of(tasks_, 1), count_of(tasks_, 2), tasks_.real(3), tasks_.real(4), tasks_.number(5) != 0};
  }
  return rows;
}

std::uint64_t StoreReader::episodes() {
  std::uint64_t total = 0;
  while (total_.step()) total = count_of(total_, 0);
  return total;
}

}  // namespace citylearn
