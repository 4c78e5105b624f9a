// SPDX-License-Identifier: Apache-2.0
#include "dashboard/query/curve_reader.h"

#include <array>

#include "dashboard/store/database.h"
#include "dashboard/store/store_impl.h"

namespace citylearn {

struct CurveReader::Impl {
  explicit Impl(const std::string& file) : path(file), database(open_database(file)) {}
  const std::string path;
  SQLite::Database database;
};

CurveReader::CurveReader(const std::string& path)
    : impl_(with_file_errors(path, [&] { return std::make_unique<Impl>(path); })) {}
CurveReader::~CurveReader() = default;

std::vector<MetricRow> CurveReader::metrics(std::int64_t run) {
  return with_file_errors(impl_->path, [&] {
    SQLite::Statement row(impl_->database,
                          "SELECT name, points, step, value, least, greatest FROM metrics WHERE run = ? ORDER BY name");
    std::vector<MetricRow> all;
    bind_values(row, run);
    while (row.executeStep()) {
      MetricRow& metric = all.emplace_back();
      read_row(row, metric.name, metric.points, metric.step, metric.value, metric.least, metric.greatest);
    }
    return all;
  });
}

std::string CurveReader::summary(std::int64_t run) {
  return with_file_errors(impl_->path, [&] {
    SQLite::Statement row(impl_->database, "SELECT summary FROM runs WHERE id = ?");
    return bind_values(row, run).executeStep() ? value_at<std::string>(row, 0) : std::string();
  });
}

std::optional<Decimator> CurveReader::curve(const Query& query, std::size_t points) {
  return with_file_errors(impl_->path, [&]() -> std::optional<Decimator> {
    SQLite::Database& database = impl_->database;
    const SQLite::Transaction snapshot(database);
    SQLite::Statement found(database, "SELECT id FROM metrics WHERE run = ? AND name = ?");
    if (!bind_values(found, query.run, query.metric).executeStep()) return std::nullopt;
    const auto metric = value_at<std::int64_t>(found, 0);
    const std::string number = "key & " + std::to_string(kMostUpdates);
    const std::string x = query.x == Axis::kSteps ? "step" : query.x == Axis::kSeconds ? "time - ?3" : number;
    std::string where = " FROM points WHERE key BETWEEN ?1 AND ?2";
    if (query.from) where += " AND (" + x + ") >= ?4";
    if (query.to) where += " AND (" + x + ") <= ?5";
    const auto bound = [&](SQLite::Statement& statement) -> SQLite::Statement& {
      bind_values(statement, training_key(metric, 0), training_key(metric, kMostUpdates));
      if (query.x == Axis::kSeconds && statement.getBindParameterCount() >= 3) bind_value(statement, 3, query.started);
      if (query.from) bind_value(statement, 4, *query.from);
      if (query.to) bind_value(statement, 5, *query.to);
      return statement;
    };
    const auto end = [&](const char* order) {
      SQLite::Statement row(database, "SELECT key" + where + " ORDER BY key" + order + " LIMIT 1");
      return bound(row).executeStep() ? update_of(value_at<std::int64_t>(row, 0)) : 0;
    };
    Decimator rows(1, points, end(""), end(" DESC"));
    SQLite::Statement all(database, "SELECT key, " + x + ", value" + where + " ORDER BY key");
    bound(all);
    while (all.executeStep())
      rows.add(update_of(value_at<std::int64_t>(all, 0)),
               std::array{value_at<double>(all, 1), value_at<double>(all, 2)});
    rows.finish();
    return rows;
  });
}

}  // namespace citylearn
