// SPDX-License-Identifier: Apache-2.0
#include "dashboard/store/database.h"

#include <sqlite3.h>

#include "core/util/error.h"

namespace citylearn {
namespace {

// Readers and the writer do not wait for each other (WAL). Only a checkpoint may block them for a moment.
constexpr int kBusyTimeout = 5000;  // milliseconds

const char* remedy_of(int code) {
  switch (code & 0xFF) {
    case SQLITE_FULL:
      return "free some space";
    case SQLITE_IOERR:
      return "check the disk; free some space";
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
      return "restore a copy of it, or move it away to begin a new one";
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      return "another program holds it: end that one";
    case SQLITE_CANTOPEN:
    case SQLITE_PERM:
    case SQLITE_READONLY:
    case SQLITE_AUTH:
      return "choose a file in a folder that can be written";
    default:
      return "";
  }
}

}  // namespace

void throw_store_error(const SQLite::Exception& fault, const std::string& path) {
  throw Error(fault.what(), path, remedy_of(fault.getErrorCode()));
}

SQLite::Database open_database(const std::string& path, int flags) {
  return with_file_errors(path, [&] { return SQLite::Database(path, flags | SQLite::OPEN_NOMUTEX, kBusyTimeout); });
}

void bind_value(SQLite::Statement& statement, int index, std::span<const std::uint8_t> blob) {
  if (blob.empty())
    statement.bind(index);
  else
    statement.bind(index, blob.data(), static_cast<int>(blob.size()));
}

}  // namespace citylearn
