// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <SQLiteCpp/Database.h>
#include <SQLiteCpp/Exception.h>
#include <SQLiteCpp/Statement.h>
#include <SQLiteCpp/Transaction.h>

#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <type_traits>

namespace citylearn {

// What the store adds to SQLiteCpp: errors that name the file, and values of our types in statements.

/// Opens an SQLite file for one thread at a time. Throws Error, naming the file.
SQLite::Database open_database(const std::string& path, int flags = SQLite::OPEN_READONLY);

/// Throws the Error for `fault`: what happened, in which file, what to do.
[[noreturn]] void throw_store_error(const SQLite::Exception& fault, const std::string& path);

/// Returns `work()`. An exception of SQLite becomes an Error that names the file.
template <class Work>
auto with_file_errors(const std::string& path, Work work) -> decltype(work()) {
  try {
    return work();
  } catch (const SQLite::Exception& fault) {
    throw_store_error(fault, path);
  }
}

void bind_value(SQLite::Statement& statement, int index, std::span<const std::uint8_t> blob);  ///< empty: NULL
template <class Value>
void bind_value(SQLite::Statement& statement, int index, const Value& value) {
  if constexpr (std::is_floating_point_v<Value>)
    statement.bind(index, static_cast<double>(value));  // NaN becomes NULL
  else if constexpr (std::is_integral_v<Value>)
    statement.bind(index, static_cast<std::int64_t>(value));  // 64 bits without sign keep their bits
  else
    statement.bind(index, value);
}
template <class Value>
void bind_value(SQLite::Statement& statement, int index, const std::optional<Value>& value) {
  value ? bind_value(statement, index, *value) : statement.bind(index);
}

/// Makes a statement ready to run again with these values for ?1, ?2 ... Nothing else may bring values into SQL.
template <class... Values>
SQLite::Statement& bind_values(SQLite::Statement& statement, const Values&... values) {
  statement.tryReset();  // reports the fault of the last run, which was reported already
  int index = 0;
  (bind_value(statement, ++index, values), ...);
  return statement;
}

/// Runs a statement without a result. Returns how many rows it changed.
template <class... Values>
int run(SQLite::Statement& statement, const Values&... values) {
  return bind_values(statement, values...).exec();
}
template <class... Values>
int run(SQLite::Database& database, const char* sql, const Values&... values) {
  SQLite::Statement statement(database, sql);
  return run(statement, values...);
}

/// Takes a column as a bool, a number or a text. NULL is 0 or "", of a floating-point number NaN.
template <class Value>
void read_value(const SQLite::Column& column, Value& value) {
  if constexpr (std::is_floating_point_v<Value>)
    value = column.isNull() ? std::numeric_limits<Value>::quiet_NaN() : static_cast<Value>(column.getDouble());
  else if constexpr (std::is_integral_v<Value>)
    value = static_cast<Value>(column.getInt64());
  else
    value = column.getString();
}
template <class Value>
void read_value(const SQLite::Column& column, std::optional<Value>& value) {
  value.reset();
  if (!column.isNull()) read_value(column, value.emplace());
}

/// Takes the columns of a row, from the first on.
template <class... Values>
void read_row(const SQLite::Statement& row, Values&... values) {
  int column = 0;
  (read_value(row.getColumn(column++), values), ...);
}
template <class Value>
Value value_at(const SQLite::Statement& row, int column) {
  Value value{};
  read_value(row.getColumn(column), value);
  return value;
}

}  // namespace citylearn
