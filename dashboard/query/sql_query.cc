// SPDX-License-Identifier: Apache-2.0
#include "dashboard/query/sql_query.h"

#include <sqlite3.h>

#include <memory>
#include <string_view>

#include "core/util/error.h"

namespace citylearn {
namespace {

using Time = std::chrono::steady_clock::time_point;

constexpr int kSteps = 1000;             // of SQLite's machine, between two looks at the clock
constexpr int kLongestText = 200'000;    // bytes of the SQL
constexpr int kLongestValue = 16 << 20;  // bytes
constexpr int kBusy = 2000;              // milliseconds

int authorize(void*, int action, const char*, const char* second, const char*, const char*) {
  switch (action) {
    case SQLITE_SELECT:
    case SQLITE_READ:
    case SQLITE_RECURSIVE:
      return SQLITE_OK;
    case SQLITE_FUNCTION:
      return std::string_view(second ? second : "") == "load_extension" ? SQLITE_DENY : SQLITE_OK;
    default:
      return SQLITE_DENY;
  }
}

int stop_at(void* deadline) { return std::chrono::steady_clock::now() > *static_cast<const Time*>(deadline) ? 1 : 0; }

SqlQuery::Value value_of(sqlite3_stmt* row, int column) {
  const auto size = static_cast<std::size_t>(sqlite3_column_bytes(row, column));
  switch (sqlite3_column_type(row, column)) {
    case SQLITE_INTEGER:
      return static_cast<std::int64_t>(sqlite3_column_int64(row, column));
    case SQLITE_FLOAT:
      return sqlite3_column_double(row, column);
    case SQLITE_TEXT:
      return std::string(reinterpret_cast<const char*>(sqlite3_column_text(row, column)), size);
    case SQLITE_BLOB:
      return SqlQuery::Blob{size};
    default:
      return {};
  }
}

}  // namespace

SqlQuery::Result SqlQuery::run(const std::string& path, const std::string& sql, const Options& options) {
  sqlite3* opened = nullptr;
  const int status = sqlite3_open_v2(path.c_str(), &opened, SQLITE_OPEN_READONLY | SQLITE_OPEN_NOMUTEX, nullptr);
  const std::unique_ptr<sqlite3, int (*)(sqlite3*)> database(opened, sqlite3_close_v2);
  if (status != SQLITE_OK) throw Error(sqlite3_errstr(status), path);
  sqlite3_busy_timeout(opened, kBusy);
  sqlite3_limit(opened, SQLITE_LIMIT_LENGTH, kLongestValue);
  sqlite3_limit(opened, SQLITE_LIMIT_SQL_LENGTH, kLongestText);
  sqlite3_limit(opened, SQLITE_LIMIT_ATTACHED, 0);
  sqlite3_set_authorizer(opened, authorize, nullptr);
  Time deadline = std::chrono::steady_clock::now() + options.time;
  sqlite3_progress_handler(opened, kSteps, stop_at, &deadline);
  const auto fail = [&](int code) {
    if (code == SQLITE_INTERRUPT)
      throw Error("took longer than " + std::to_string(options.time.count()) + " ms", "the SQL",
                  "choose fewer rows, for example by run and metric");
    if (code == SQLITE_AUTH) throw Error(sqlite3_errmsg(opened), "the SQL", "only SELECT is possible here");
    throw Error(sqlite3_errmsg(opened), "the SQL");
  };

  sqlite3_stmt* prepared = nullptr;
  const char* rest = nullptr;
  const int fault = sqlite3_prepare_v2(opened, sql.data(), static_cast<int>(sql.size()), &prepared, &rest);
  const std::unique_ptr<sqlite3_stmt, int (*)(sqlite3_stmt*)> statement(prepared, sqlite3_finalize);
  if (fault != SQLITE_OK) fail(fault);
  const std::string_view behind(rest, static_cast<std::size_t>(sql.data() + sql.size() - rest));
  if (!prepared || behind.find_first_not_of("; \t\r\n") != behind.npos) throw Error("must be one SELECT", "the SQL");

  Result result;
  const int columns = sqlite3_column_count(prepared);
  for (int i = 0; i < columns; ++i) result.columns.emplace_back(sqlite3_column_name(prepared, i));
  std::size_t bytes = 0;
  for (int step; (step = sqlite3_step(prepared)) != SQLITE_DONE;) {
    if (step != SQLITE_ROW) fail(step);
    std::vector<Value> row;
    for (int i = 0; i < columns; ++i) {
      row.push_back(value_of(prepared, i));
      bytes += sizeof(Value);
      if (const auto* text = std::get_if<std::string>(&row.back())) bytes += text->size();
    }
    if (result.rows.size() >= options.rows || bytes > options.bytes) {
      result.truncated = true;
      break;
    }
    result.rows.push_back(std::move(row));
  }
  return result;
}

}  // namespace citylearn
