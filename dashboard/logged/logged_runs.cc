// SPDX-License-Identifier: Apache-2.0
#include "dashboard/logged/logged_runs.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "core/files/json.h"
#include "core/util/error.h"
#include "core/util/wall_clock.h"
#include "dashboard/store/database.h"
#include "dashboard/store/store_impl.h"

namespace citylearn {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kLongestName = 128;  // of a project or a run

/// A row of `runs`, as far as a log changes it.
struct LoggedRow {
  std::int64_t id = 0;
  std::string log, config, summary;
  std::uint64_t received = 0, rows = 0;
};

std::string unescaped(const std::string& text) {
  std::string name;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const std::string_view code = std::string_view(text).substr(i, 3);
    if (code == "%2F" || code == "%25") {
      name += code == "%2F" ? '/' : '%';
      i += 2;
    } else {
      name += text[i];
    }
  }
  return name;
}

/// Returns whether it is UTF-8: other names could not be asked for.
bool is_text(const std::string& name) {
  try {
    Json(name).dump();
    return true;
  } catch (const Json::exception&) {
    return false;
  }
}

/// Returns the members of a JSON object with those of `additions` over them.
std::string merged_json(const std::string& object, const std::vector<std::string>& additions, const std::string& what) {
  Json all = parse_json_or_null(object);
  if (!all.is_object()) all = Json::object();
  for (const std::string& addition : additions) all.update(parse_json_or_null(addition));
  std::string text = all.dump(-1, ' ', false, Json::error_handler_t::replace);
  if (text.size() > kLongestConfig)
    throw Error(what + " has more than " + std::to_string(kLongestConfig) + " bytes", "", "log less of it");
  return text;
}

LoggedRow row_of(SQLite::Database& database, const std::string& id, const LogBatch& batch, double now) {
  LoggedRow row;
  SQLite::Statement found(database, "SELECT id, log, manifest, summary, received, updates FROM runs WHERE name = ?");
  if (bind_values(found, id).executeStep()) {
    read_row(found, row.id, row.log, row.config, row.summary, row.received, row.rows);
    return row;
  }
  const std::string project = unescaped(id.substr(0, id.find('/')));
  run(database, "INSERT INTO runs (name, session, started, last, source, log) VALUES (?1, ?2, ?3, ?3, ?4, ?5)", id,
      project, now, batch.source, batch.log);
  row.id = database.getLastInsertRowid();
  row.log = batch.log;
  return row;
}

/// What the points of a batch add to a metric.
struct MetricNews {
  std::int64_t id = 0;
  std::uint64_t points = 0, newest = 0;
  double step = 0, value = std::nan(""), least = std::nan(""), greatest = std::nan("");
};

/// Returns the metrics of the batch, which it makes where they are new.
std::vector<MetricNews> metrics_of(SQLite::Database& database, std::int64_t row, const LogBatch& batch) {
  SQLite::Statement add(database, "INSERT INTO metrics (run, name) VALUES (?, ?) ON CONFLICT DO NOTHING");
  SQLite::Statement find(database, "SELECT id FROM metrics WHERE run = ? AND name = ?");
  std::vector<MetricNews> news(batch.metrics().size());
  int added = 0;
  for (std::size_t i = 0; i < news.size(); ++i) {
    const std::string& name = batch.metrics()[i];
    added += run(add, row, name);
    if (bind_values(find, row, name).executeStep()) read_row(find, news[i].id);
    find.reset();
  }
  if (added > 0) {
    SQLite::Statement count(database, "SELECT COUNT(*) FROM metrics WHERE run = ?");
    if (bind_values(count, row).executeStep() && value_at<std::size_t>(count, 0) > kMostMetrics)
      throw Error("a run has at most " + std::to_string(kMostMetrics) + " metrics", batch.metrics().front(),
                  "count in the step, not in the metrics' names");
  }
  return news;
}

/// Inserts the points of records behind `received`. Returns how many such records there are.
std::uint64_t insert_points(SQLite::Database& database, std::int64_t row, const LogBatch& batch,
                            std::uint64_t received) {
  std::vector<MetricNews> news = metrics_of(database, row, batch);
  std::vector<LoggedPoint> points;
  points.reserve(batch.points().size());
  std::copy_if(batch.points().begin(), batch.points().end(), std::back_inserter(points),
               [&](const LoggedPoint& point) { return point.record > received; });
  std::uint64_t records = 0, last = 0;
  for (const LoggedPoint& point : points) records += std::exchange(last, point.record) != point.record;
  // In the order of their keys: neighbours in the file.
  std::stable_sort(points.begin(), points.end(), [&](const LoggedPoint& a, const LoggedPoint& b) {
    return std::pair(news[a.metric].id, a.record) < std::pair(news[b.metric].id, b.record);
  });
  SQLite::Statement add(database,
                        "INSERT INTO points (key, step, time, value) VALUES (?, ?, ?, ?) ON CONFLICT DO NOTHING");
  for (const LoggedPoint& point : points) {
    MetricNews& metric = news[point.metric];
    if (run(add, training_key(metric.id, point.record), point.step, point.time, point.value) == 0) continue;
    ++metric.points;
    metric.step = point.step;
    if (!std::isfinite(point.value)) continue;
    metric.value = point.value;
    metric.least = std::fmin(metric.least, point.value);
    metric.greatest = std::fmax(metric.greatest, point.value);
  }
  SQLite::Statement update(database,
                           "UPDATE metrics SET points = points + ?2, step = ?3, value = COALESCE(?4, value), "
                           "least = MIN(COALESCE(least, ?5), COALESCE(?5, least)), "
                           "greatest = MAX(COALESCE(greatest, ?6), COALESCE(?6, greatest)) WHERE id = ?1");
  for (const MetricNews& metric : news)
    if (metric.points > 0)
      run(update, metric.id, metric.points, metric.step, metric.value, metric.least, metric.greatest);
  return records;
}

void update_row(SQLite::Database& database, const LoggedRow& row, const LogBatch& batch, double now) {
  if (batch.beginning()) {
    const LogBeginning& begins = *batch.beginning();
    std::string tags;
    for (const std::string& tag : begins.tags) tags += tag + "\n";
    // What people have written on the page stays.
    run(database,
        "UPDATE runs SET started = ?2, title = CASE ?3 WHEN '' THEN title ELSE ?3 END, tags = CASE tags WHEN '' THEN "
        "?4 ELSE tags END, "
        "note = CASE note WHEN '' THEN ?5 ELSE note END WHERE id = ?1",
        row.id, begins.started, begins.title, tags, begins.note);
  }
  if (!batch.config().empty())
    run(database, "UPDATE runs SET manifest = ?2 WHERE id = ?1", row.id,
        merged_json(row.config, batch.config(), "the configuration"));
  if (!batch.summary().empty())
    run(database, "UPDATE runs SET summary = ?2 WHERE id = ?1", row.id,
        merged_json(row.summary, batch.summary(), "the summary"));
  run(database,
      "UPDATE runs SET received = ?2, updates = ?3, ended = COALESCE(?4, ended), last = MAX(last, ?5) WHERE id = ?1",
      row.id, batch.end_record() - 1, row.rows, batch.ended, now);
}

}  // namespace

std::uint32_t LogBatch::index_of(std::string_view metric) {
  const auto [place, fresh] = indices_.try_emplace(std::string(metric), static_cast<std::uint32_t>(metrics_.size()));
  if (fresh) metrics_.emplace_back(metric);
  return place->second;
}

bool has_control(std::string_view text, std::string_view allowed) {
  return std::any_of(text.begin(), text.end(),
                     [&](char c) { return ((c >= 0 && c < ' ') || c == '\x7F') && allowed.find(c) == allowed.npos; });
}

std::optional<std::string> fault_of_metric(const std::string& name) {
  if (!name.empty() && name.size() <= kLongestMetric && !has_control(name)) return std::nullopt;
  return "a metric has a name of one line of 1 to " + std::to_string(kLongestMetric) + " bytes";
}

std::optional<std::string> fault_of_logged_id(const std::string& id) {
  const std::size_t slash = id.find('/');
  const std::string form = "the ID of a logged run is PROJECT/NAME, in which '/' and '%' of a name are %2F and %25";
  if (slash == id.npos || id.find('/', slash + 1) != id.npos) return form;
  for (const std::string& name : {unescaped(id.substr(0, slash)), unescaped(id.substr(slash + 1))}) {
    if (name.empty() || name.size() > kLongestName || has_control(name) || !is_text(name))
      return "a project and a run have names of 1 to " + std::to_string(kLongestName) +
             " bytes of UTF-8 without control characters";
  }
  return std::nullopt;
}

LoggedRuns::Outcome LoggedRuns::append(const std::string& id, const LogBatch& batch) {
  Outcome outcome;
  LoggedRow row;
  const double now = seconds_since_epoch();
  store_.with_database([&](SQLite::Database& database) {
    SQLite::Transaction all(database, SQLite::TransactionBehavior::IMMEDIATE);
    row = row_of(database, id, batch, now);
    outcome = {row.received, row.log != batch.log};
    const bool news = batch.first() <= row.received + 1 && batch.end_record() > row.received + 1;
    if (!outcome.other_log && news) {
      if (!batch.points().empty()) row.rows += insert_points(database, row.id, batch, row.received);
      update_row(database, row, batch, now);
      outcome.received = batch.end_record() - 1;
    } else if (!outcome.other_log && batch.ended) {
      run(database, "UPDATE runs SET ended = ?2 WHERE id = ?1", row.id, *batch.ended);
    }
    all.commit();
  });
  if (!outcome.other_log) store_.set_liveness(row.id, {now, row.rows});
  return outcome;
}

}  // namespace citylearn
