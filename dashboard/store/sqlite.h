// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

struct sqlite3;
struct sqlite3_stmt;

namespace citylearn {

class Statement;

/// One connection to an SQLite file. Used by one thread at a time. Errors are Error, naming the file.
class Database {
 public:
  enum class Mode { kRead, kWrite, kCreate };
  Database(const std::string& path, Mode mode);
  ~Database();
  Database(const Database&) = delete;
  Database& operator=(const Database&) = delete;

  /// Statements without a result, or whose result does not matter.
  void execute(const std::string& sql);
  /// First column of the first row, as a number; 0 where there is none.
  std::int64_t number(const std::string& sql);
  std::string text(const std::string& sql);
  /// Rows that the last INSERT, UPDATE or DELETE changed.
  std::int64_t changes() const;
  std::int64_t last_rowid() const;
  const std::string& path() const { return path_; }

 private:
  friend class Statement;
  [[noreturn]] void fail(int code);

  std::string path_;
  sqlite3* connection_ = nullptr;
};

/// A prepared statement, to be used again and again. Values only ever get in by bind(): nothing that a name holds is
/// SQL.
class Statement {
 public:
  Statement(Database& database, std::string_view sql);
  ~Statement();
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  // Parameters, from 1. Texts and blobs must stay until the statement has run. NaN becomes NULL.
  Statement& bind(int index, std::int64_t value);
  Statement& bind(int index, std::uint64_t value) { return bind(index, static_cast<std::int64_t>(value)); }
  Statement& bind(int index, std::uint32_t value) { return bind(index, static_cast<std::int64_t>(value)); }
  Statement& bind(int index, int value) { return bind(index, static_cast<std::int64_t>(value)); }
  Statement& bind(int index, bool value) { return bind(index, static_cast<std::int64_t>(value)); }
  Statement& bind(int index, double value);
  Statement& bind(int index, float value) { return bind(index, static_cast<double>(value)); }
  Statement& bind(int index, std::string_view text);
  Statement& bind(int index, const char* text) { return bind(index, std::string_view(text)); }
  Statement& bind(int index, const std::string& text) { return bind(index, std::string_view(text)); }
  Statement& bind(int index, std::span<const std::uint8_t> blob);
  template <class T>
  Statement& bind(int index, const std::optional<T>& value) {
    return value ? bind(index, *value) : bind_null(index);
  }
  Statement& bind_null(int index);

  /// To the next row; false after the last one: the statement may then be bound anew.
  bool step();
  /// Runs it to its end.
  void run() {
    while (step()) {
    }
  }
  /// Gives up the rows that are left.
  void reset();

  // Columns of the row, from 0.
  bool null(int column) const;
  std::int64_t number(int column) const;
  double real(int column) const;  ///< NaN where NULL
  std::string text(int column) const;
  std::span<const std::uint8_t> blob(int column) const;  ///< until the next step()

 private:
  void check(int code);

  Database& database_;
  sqlite3_stmt* statement_ = nullptr;
};

/// All or nothing: what was not committed when it leaves its scope is undone.
class Transaction {
 public:
  enum class Kind { kWrite, kRead };  ///< what is read in one is of one moment
  explicit Transaction(Database& database, Kind kind = Kind::kWrite);
  ~Transaction();
  Transaction(const Transaction&) = delete;
  Transaction& operator=(const Transaction&) = delete;
  /// Returns when it is on the disk.
  void commit();

 private:
  Database& database_;
  bool open_ = true;
};

}  // namespace citylearn
