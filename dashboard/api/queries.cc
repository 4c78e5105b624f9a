// SPDX-License-Identifier: Apache-2.0
// What is asked of logged runs and across runs: metrics, curves, what differs, SQL.
#include <algorithm>
#include <cmath>
#include <limits>

#include "core/files/json.h"
#include "core/util/text.h"
#include "dashboard/api/api.h"
#include "dashboard/api/parameters.h"
#include "dashboard/api/tables.h"
#include "dashboard/query/comparison.h"
#include "dashboard/query/curve_reader.h"
#include "dashboard/query/sql_query.h"

namespace citylearn {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kMostCompared = 64;
constexpr int kMostSqlRows = 100'000;

Json finite_or_null(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

void append_sql_value(std::string& text, const SqlQuery::Value& value, bool csv) {
  if (const auto* integer = std::get_if<std::int64_t>(&value)) {
    append_number(text, *integer);
  } else if (const auto* real = std::get_if<double>(&value); real && std::isfinite(*real)) {
    append_number(text, *real);
  } else if (const auto* words = std::get_if<std::string>(&value)) {
    csv ? append_csv(text, *words) : append_json(text, *words);
  } else if (const auto* blob = std::get_if<SqlQuery::Blob>(&value)) {
    const std::string said = std::to_string(blob->bytes) + " bytes";
    csv ? append_csv(text, said) : append_json(text, said);
  } else if (!csv) {
    text += "null";
  }
}

Json rows_json(const std::vector<ComparedFact>& facts, bool all) {
  Json rows = Json::array();
  for (const ComparedFact& fact : facts) {
    if (!fact.differs && !all) continue;
    Json values = Json::array();
    for (const auto& value : fact.values) values.push_back(value ? Json(*value) : Json(nullptr));
    rows.push_back({{"key", fact.key}, {"values", std::move(values)}, {"differs", fact.differs}});
  }
  return rows;
}

}  // namespace

Answer Api::metrics(const RunRow& row) {
  Json list = Json::array();
  for (const MetricRow& metric : CurveReader(store_.path()).metrics(row.id))
    list.push_back({{"name", metric.name},
                    {"points", metric.points},
                    {"step", finite_or_null(metric.step)},
                    {"value", finite_or_null(metric.value)},
                    {"least", finite_or_null(metric.least)},
                    {"greatest", finite_or_null(metric.greatest)}});
  return json_answer({{"id", row.name}, {"metrics", std::move(list)}});
}

Answer Api::curve(const RunRow& row, const Query& query) {
  allow_only(query, {"metric", "x", "points", "from", "to"});
  const auto metric = text_parameter(query, "metric");
  if (!metric) throw RequestError(400, "parameter 'metric' is missing: a name of GET /api/runs/ID/metrics");
  using Axis = CurveReader::Axis;
  static const std::map<std::string, Axis> kAxes = {
      {"steps", Axis::kSteps}, {"wall", Axis::kSeconds}, {"records", Axis::kRecords}};
  const std::string x = text_parameter(query, "x").value_or("steps");
  const auto axis = kAxes.find(x);
  if (axis == kAxes.end()) throw RequestError(400, "parameter 'x' must be steps, wall or records, is '" + x + "'");
  constexpr double kMost = 1e18;
  CurveReader::Query wanted{row.id, *metric, axis->second, row.started, {}, {}};
  wanted.from = number_parameter<double>(query, "from", -kMost, kMost);
  wanted.to = number_parameter<double>(query, "to", -kMost, kMost);
  const int points = number_parameter<int>(query, "points", 10, 20000).value_or(2000);
  const auto rows = CurveReader(store_.path()).curve(wanted, static_cast<std::size_t>(points));
  if (!rows) not_found("run '" + row.name + "' has no metric '" + *metric + "' (GET /api/runs/ID/metrics lists them)");
  Answer answer;
  std::string& text = answer.body;
  text = "{\"id\":";
  append_json(text, row.name);
  text += ",\"metric\":";
  append_json(text, *metric);
  text += ",\"x\":\"" + x + "\",\"total\":";
  append_number(text, rows->total());
  text += std::string(",\"decimated\":") + (rows->decimated() ? "true" : "false") + ",\"columns\":{";
  for (std::size_t column = 0; column < 2; ++column) {
    text += column == 0 ? "\"x\":[" : ",\"value\":[";
    for (std::size_t at = 0; at < rows->rows(); ++at) {
      if (at > 0) text += ',';
      const double value = rows->values()[2 * at + column];
      if (std::isfinite(value))
        append_number(text, value);
      else
        text += "null";
    }
    text += ']';
  }
  text += "}}";
  return answer;
}

Answer Api::compare(const Query& query) {
  allow_only(query, {"runs", "all"});
  const std::string given = text_parameter(query, "runs").value_or("");
  const bool all = flag_parameter(query, "all").value_or(false);
  std::vector<std::string> names;
  for (std::size_t begin = 0; begin < given.size();) {
    const std::size_t end = std::min(given.find('\n', begin), given.size());
    names.push_back(given.substr(begin, end - begin));
    begin = end + 1;
  }
  if (names.empty() || names.size() > kMostCompared)
    throw RequestError(400, "parameter 'runs' must be 1 to " + std::to_string(kMostCompared) + " IDs, one a line");
  std::vector<RunFacts> config, figures;
  BorrowedReader reader(*this);
  CurveReader curves(store_.path());
  for (const std::string& name : names) {
    const auto row = reader->run(name);
    if (!row) not_found("run '" + name + "' not found (GET /api/runs lists them)");
    RunFacts& options = config.emplace_back();
    add_json_leaves(options, reader->manifest(row->id));
    std::erase_if(options, [](const auto& one) { return one.first.starts_with("artefacts."); });  // where its files are
    RunFacts& final = figures.emplace_back();
    const auto add = [&final](const std::string& key, double value) {
      if (!std::isfinite(value)) return;
      final[key].clear();
      append_number(final[key], value);
    };
    if (row->newest) {
      add("reward", static_cast<float>(row->newest->reward));
      add("spl", static_cast<float>(row->newest->spl));
      add("steps", static_cast<double>(row->newest->steps));
      add("episodes", static_cast<double>(row->newest->episodes));
      add("wall", row->newest->wall);
    }
    for (const MetricRow& metric : curves.metrics(row->id)) add(metric.name, metric.value);
    add_json_leaves(final, curves.summary(row->id));
  }
  return json_answer({{"runs", names},
                      {"config", rows_json(citylearn::compare(config), all)},
                      {"figures", rows_json(citylearn::compare(figures), all)}});
}

Answer Api::sql(const Query& query) {
  Query wanted = query;
  if (query.method == "POST") {
    // A long query does not fit into an address.
    allow_only(query, {"format", "limit"});
    wanted.parameters["q"] = query.body;
  }
  allow_only(wanted, {"q", "format", "limit"});
  const auto text = text_parameter(wanted, "q");
  if (!text || text->empty()) throw RequestError(400, "parameter 'q' (with POST: the body) must be one SELECT");
  const std::string format = text_parameter(wanted, "format").value_or("json");
  if (format != "json" && format != "csv") throw RequestError(400, "parameter 'format' must be json or csv");
  const bool csv = format == "csv";
  SqlQuery::Options options;
  options.rows = static_cast<std::size_t>(number_parameter<int>(wanted, "limit", 1, kMostSqlRows).value_or(1000));
  const std::unique_lock one_at_a_time(sql_mutex_, std::try_to_lock);  // others would wait for a worker
  if (!one_at_a_time) {
    Answer answer = error_answer(503, "another SQL query runs: ask again in a second");
    answer.headers.emplace_back("Retry-After", "1");
    return answer;
  }
  SqlQuery::Result result;
  try {
    result = SqlQuery::run(store_.path(), *text, options);
  } catch (const Error& error) {
    throw RequestError(400, error.what());
  }
  Answer answer;
  std::string& body = answer.body;
  if (csv) {
    answer.type = "text/csv; charset=utf-8";
    answer.headers.emplace_back("Content-Disposition", "attachment; filename=\"query.csv\"");
    if (result.truncated) answer.headers.emplace_back("X-Truncated", "1");
  }
  const auto append_row = [&](const auto& row) {
    for (std::size_t i = 0; i < row.size(); ++i) {
      if (i > 0) body += ',';
      append_sql_value(body, row[i], csv);
    }
  };
  if (!csv) body += "{\"columns\":[";
  append_row(std::vector<SqlQuery::Value>(result.columns.begin(), result.columns.end()));
  body += csv ? "\n" : "],\"rows\":[";
  for (std::size_t i = 0; i < result.rows.size(); ++i) {
    if (!csv) body += i == 0 ? "[" : ",[";
    append_row(result.rows[i]);
    body += csv ? "\n" : "]";
  }
  if (!csv) body += std::string("],\"truncated\":") + (result.truncated ? "true" : "false") + "}";
  return answer;
}

}  // namespace citylearn
