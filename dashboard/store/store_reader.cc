// SPDX-License-Identifier: Apache-2.0
#include "dashboard/store/store_reader.h"

#include <cstring>

#include "core/util/error.h"
#include "core/util/text.h"
#include "core/wire/streets.h"
#include "dashboard/store/database.h"
#include "dashboard/store/store_impl.h"

namespace citylearn {
namespace {

constexpr const char* kRunColumns =
    "SELECT id, name, session, policy, seed, agent, learner, started, last, ended, updates, recorded "
    "FROM runs ";

/// Returns "SELECT COLUMNS`more` FROM episodes ... WHERE ", the columns being those of an EpisodeRow.
std::string select_episodes(const char* more = "") {
  std::string columns;
  const EpisodeRow none;
  visit_episode(none, [&](const char*, const char* column, const auto&) {
    columns += (columns.empty() ? "" : ", ") + std::string(column);
  });
  return "SELECT " + columns + more + " FROM episodes e JOIN sources s ON s.id = e.source WHERE ";
}

/// Returns the episode and the column behind it.
std::pair<EpisodeRow, int> read_episode(const SQLite::Statement& row) {
  EpisodeRow episode;
  int column = 0;
  visit_episode(episode, [&](const char*, const char*, auto& value) { read_value(row.getColumn(column++), value); });
  return {episode, column};
}

/// The conditions of a filter. Parameter ?1 is the run's row, the others are bound by bind_filter().
std::string conditions(const EpisodeFilter& filter) {
  std::string sql = "e.run = ?1";
  const auto flag = [&](const char* name, const std::optional<bool>& value) {
    if (value) sql += std::string(" AND e.") + name + (*value ? " = 1" : " = 0");
  };
  flag("evaluation", filter.evaluation);
  flag("completed", filter.completed);
  flag("shuffled", filter.shuffled);
  if (filter.traversal) sql += " AND e.traversal = ?2";
  if (filter.policy) sql += " AND e.policy = ?3";
  if (filter.update) sql += " AND e.\"update\" = ?4";
  if (filter.before) sql += " AND e.id < ?5";
  return sql;
}

void bind_filter(SQLite::Statement& statement, std::int64_t run, const EpisodeFilter& filter) {
  bind_value(statement, 1, run);
  if (filter.traversal) bind_value(statement, 2, *filter.traversal);
  if (filter.policy) bind_value(statement, 3, *filter.policy);
  if (filter.update) bind_value(statement, 4, *filter.update);
  if (filter.before) bind_value(statement, 5, *filter.before);
}

/// Returns the SQL of a training figure. The update is in the key.
std::string column_of(const TrainingFigure& figure) {
  return figure.name == std::string_view("update") ? "key & " + std::to_string(kMaxUpdate) : figure.name;
}

/// Binds ?1 and ?2 to the first and the last training.key of a run.
SQLite::Statement& bind_run(SQLite::Statement& statement, std::int64_t run) {
  return bind_values(statement, training_key(run, 0), training_key(run, kMaxUpdate));
}

}  // namespace

struct StoreReader::Impl {
  explicit Impl(const std::string& file);
  RunRow run_row(const SQLite::Statement& row);

  /// Runs a statement with these values and calls `read` with each row. Throws Error that names the file.
  template <class Read, class... Values>
  void each_row(SQLite::Statement& statement, Read read, const Values&... values) {
    with_file_errors(path, [&] {
      bind_values(statement, values...);
      while (statement.executeStep()) read(statement);
    });
  }

  const std::string path;
  SQLite::Database database;
  SQLite::Statement runs, run, newest, manifest, traversals, episode, groups, tasks, total;
};

StoreReader::Impl::Impl(const std::string& file)
    : path(file),
      database(open_database(file)),
      runs(database, std::string(kRunColumns) + "ORDER BY started DESC, id DESC"),
      run(database, std::string(kRunColumns) + "WHERE name = ?"),
      newest(database,
             "SELECT key, steps, episodes, wall, reward, spl, steps_per_second FROM training WHERE key BETWEEN ? AND ? "
             "ORDER BY key DESC LIMIT 1"),
      manifest(database, "SELECT manifest FROM runs WHERE id = ?"),
      // Of an environment that was started again the newest counts: SQLite takes the other columns from MAX()'s row.
      traversals(
          database,
          "SELECT s.environment, s.dataset, s.traversal, s.condition, s.hash, s.frames, s.agents, s.images, s.rule, "
          "MAX(s.incarnation) FROM run_sources r JOIN sources s ON s.id = r.source "
          "WHERE r.run = ? AND s.dataset IS NOT NULL GROUP BY s.environment ORDER BY s.environment"),
      episode(database, select_episodes(", e.path, s.hash, s.rule") + "e.id = ?"),
      groups(database,
             "SELECT policy, \"update\", shuffled, traversal, COUNT(*), MAX(id) FROM episodes "
             "WHERE run = ? AND evaluation = 1 GROUP BY policy, \"update\", shuffled, traversal"),
      tasks(database,
            "SELECT task, steps, shortest, reward, spl, completed FROM episodes WHERE run = ? AND evaluation = 1 AND "
            "policy = ? AND \"update\" = ? AND shuffled = ? AND traversal = ? ORDER BY task, id"),
      total(database, "SELECT SUM(recorded) FROM runs") {}

RunRow StoreReader::Impl::run_row(const SQLite::Statement& row) {
  RunRow r;
  read_row(row, r.id, r.name, r.session, r.policy, r.seed, r.agent, r.learner, r.started, r.last, r.ended, r.updates,
           r.recorded);
  if (bind_run(newest, r.id).executeStep()) {
    RunRow::Newest& n = r.newest.emplace(RunRow::Newest());
    read_row(newest, n.update, n.steps, n.episodes, n.wall, n.reward, n.spl, n.steps_per_second);
    n.update &= kMaxUpdate;
  }
  newest.reset();
  return r;
}

StoreReader::StoreReader(const std::string& path)
    : impl_(with_file_errors(path, [&] { return std::make_unique<Impl>(path); })) {}
StoreReader::~StoreReader() = default;

std::vector<RunRow> StoreReader::runs() {
  std::vector<RunRow> rows;
  impl_->each_row(impl_->runs, [&](const auto& row) { rows.push_back(impl_->run_row(row)); });
  return rows;
}

std::optional<RunRow> StoreReader::run(const std::string& name) {
  std::optional<RunRow> found;
  impl_->each_row(
      impl_->run, [&](const auto& row) { found = impl_->run_row(row); }, name);
  return found;
}

std::string StoreReader::manifest(std::int64_t run) {
  std::string text;
  impl_->each_row(
      impl_->manifest, [&](const auto& row) { read_row(row, text); }, run);
  return text;
}

std::vector<TraversalRow> StoreReader::traversals(std::int64_t run) {
  std::vector<TraversalRow> rows;
  const auto read = [&](const auto& row) {
    TraversalRow& t = rows.emplace_back();
    std::uint32_t rule = 0;
    read_row(row, t.environment, t.dataset, t.traversal, t.condition, t.hash, t.frames, t.agents, t.images, rule);
    t.rule = static_cast<StateRule>(rule);
  };
  impl_->each_row(impl_->traversals, read, run);
  return rows;
}

Decimator StoreReader::training(const TrainingQuery& query, std::size_t points) {
  const std::string x = column_of(*query.x);
  std::string where = " FROM training WHERE key BETWEEN ?1 AND ?2";
  if (query.from) where += " AND (" + x + ") >= ?3";
  if (query.to) where += " AND (" + x + ") <= ?4";
  const auto bind_query = [&](SQLite::Statement& statement) -> SQLite::Statement& {
    bind_run(statement, query.run);
    if (query.from) bind_value(statement, 3, *query.from);
    if (query.to) bind_value(statement, 4, *query.to);
    return statement;
  };
  return with_file_errors(impl_->path, [&] {
    const auto end = [&](const char* order) {
      SQLite::Statement row(impl_->database, "SELECT key" + where + " ORDER BY key" + order + " LIMIT 1");
      return bind_query(row).executeStep() ? update_of(value_at<std::int64_t>(row, 0)) : 0;
    };
    const SQLite::Transaction snapshot(impl_->database);
    Decimator rows(query.columns.size(), points, end(""), end(" DESC"));
    std::string sql = "SELECT key, " + x;
    for (const TrainingFigure* figure : query.columns) sql += ", " + column_of(*figure);
    SQLite::Statement all(impl_->database, sql + where + " ORDER BY key");
    bind_query(all);
    std::vector<double> row(query.columns.size() + 1);
    while (all.executeStep()) {
      for (std::size_t i = 0; i < row.size(); ++i) row[i] = value_at<double>(all, static_cast<int>(i) + 1);
      rows.add(update_of(value_at<std::int64_t>(all, 0)), row);
    }
    rows.finish();
    return rows;
  });
}

std::vector<EpisodeRow> StoreReader::episodes(std::int64_t run, const EpisodeFilter& filter, bool worst,
                                              std::size_t limit) {
  return with_file_errors(impl_->path, [&] {
    SQLite::Statement row(impl_->database, select_episodes() + conditions(filter) +
                                               (worst ? " ORDER BY e.spl, e.steps DESC, e.id" : " ORDER BY e.id DESC") +
                                               " LIMIT " + std::to_string(limit));
    bind_filter(row, run, filter);
    std::vector<EpisodeRow> found;
    while (row.executeStep()) found.push_back(read_episode(row).first);
    return found;
  });
}

std::uint64_t StoreReader::count(std::int64_t run, const EpisodeFilter& filter) {
  return with_file_errors(impl_->path, [&] {
    SQLite::Statement row(impl_->database, "SELECT COUNT(*) FROM episodes e WHERE " + conditions(filter));
    bind_filter(row, run, filter);
    return row.executeStep() ? value_at<std::uint64_t>(row, 0) : 0;
  });
}

std::optional<StoreReader::Replay> StoreReader::episode(std::int64_t rowid) {
  std::optional<Replay> found;
  const auto read = [&](const SQLite::Statement& row) {
    auto [episode, column] = read_episode(row);
    Replay& replay = found.emplace();
    replay.row = std::move(episode);
    if (const SQLite::Column path = row.getColumn(column); !path.isNull()) {
      const auto* bytes = static_cast<const std::uint8_t*>(path.getBlob());
      replay.path.emplace(bytes, bytes + path.getBytes());
    }
    replay.hash = value_at<std::optional<std::uint64_t>>(row, column + 1);
    replay.rule = static_cast<StateRule>(value_at<std::optional<std::uint32_t>>(row, column + 2).value_or(0));
  };
  impl_->each_row(impl_->episode, read, rowid);
  return found;
}

std::optional<RouteMap> StoreReader::map(std::uint64_t hash) {
  return with_file_errors(impl_->path, [&]() -> std::optional<RouteMap> {
    SQLite::Statement row(impl_->database,
                          "SELECT frames, position, latitude, longitude, rule, streets FROM maps WHERE hash = ?");
    if (!bind_values(row, hash).executeStep()) return std::nullopt;
    RouteMap map;
    map.frames = value_at<std::uint32_t>(row, 0);
    const auto read = [&](int column, auto& numbers) {
      const SQLite::Column blob = row.getColumn(column);
      numbers.resize(static_cast<std::size_t>(blob.getBytes()) / sizeof numbers[0]);
      if (!numbers.empty()) std::memcpy(numbers.data(), blob.getBlob(), numbers.size() * sizeof numbers[0]);
    };
    read(1, map.position);
    read(2, map.latitude);
    read(3, map.longitude);
    map.rule = static_cast<StateRule>(value_at<std::uint32_t>(row, 4));
    Bytes streets;
    read(5, streets);
    if (!streets.empty()) map.streets = std::make_shared<const StreetMap>(decode_streets(streets));
    return map;
  });
}

std::optional<StoreReader::PlacePicture> StoreReader::picture(std::uint64_t hash, std::uint32_t frame) {
  return with_file_errors(impl_->path, [&]() -> std::optional<PlacePicture> {
    SQLite::Statement row(
        impl_->database,
        "SELECT n.frame, p.type, p.bytes FROM (SELECT MAX(frame) AS frame FROM places WHERE hash = ?1 "
        "AND frame <= ?2 UNION ALL SELECT MIN(frame) FROM places WHERE hash = ?1 AND frame > ?2) n "
        "JOIN places f ON f.hash = ?1 AND f.frame = n.frame JOIN pictures p ON p.id = f.picture "
        "ORDER BY ABS(n.frame - ?2) LIMIT 1");
    if (!bind_values(row, hash, frame).executeStep()) return std::nullopt;
    PlacePicture found;
    read_row(row, found.frame, found.picture.type, found.picture.bytes);
    return found;
  });
}

std::vector<StoreReader::EvaluationGroup> StoreReader::evaluations(std::int64_t run) {
  std::vector<EvaluationGroup> groups;
  const auto read = [&](const auto& row) {
    EvaluationGroup& g = groups.emplace_back();
    read_row(row, g.key.policy, g.key.update, g.key.shuffled, g.key.traversal, g.episodes, g.newest);
  };
  impl_->each_row(impl_->groups, read, run);
  return groups;
}

std::vector<StoreReader::TaskRow> StoreReader::tasks(std::int64_t run, const EvaluationKey& key) {
  std::vector<TaskRow> rows;
  std::uint64_t last = 0;
  const auto read = [&](const auto& row) {
    std::uint64_t task = 0;
    TaskRow done;
    read_row(row, task, done.steps, done.shortest, done.reward, done.spl, done.completed);
    if (rows.empty() || task != last) rows.emplace_back();
    rows.back() = done;
    last = task;
  };
  impl_->each_row(impl_->tasks, read, run, key.policy, key.update, key.shuffled, key.traversal);
  return rows;
}

std::uint64_t StoreReader::episodes() {
  std::uint64_t total = 0;
  impl_->each_row(impl_->total, [&](const auto& row) { read_row(row, total); });
  return total;
}

}  // namespace citylearn
