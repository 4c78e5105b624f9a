#!/usr/bin/env bash
# SQLiteCpp 3.2.1 (Debian 12): a Savepoint outside a transaction that leaves its scope unreleased rolls back, as its
# header says, but stays open, and with it the transaction it began. The connection reads what it writes afterwards, but
# commits nothing, not even what later Savepoints release: all is lost when it closes. No call fails. A Transaction that
# leaves its scope does end. Seen: "reads 3, kept 0" with a Savepoint and "reads 3, kept 3" with a Transaction.
# Needs g++ and apt-get of Debian 12.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; chmod 755 "$folder"; cd "$folder"
apt-get download -qq libsqlitecpp-dev=3.2.1-1 libsqlite3-0 2>/dev/null
for package in ./*.deb; do dpkg -x "$package" .; done
cat >open.cc <<'END'
#include <SQLiteCpp/SQLiteCpp.h>
#include <SQLiteCpp/Savepoint.h>
#include <cstdio>
int rows(SQLite::Database& database) { return database.execAndGet("SELECT COUNT(*) FROM letters").getInt(); }
template <typename Guard, typename... Name>
void write(const char* file, Name... name) {
  {
    SQLite::Database database(file, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
    database.exec("CREATE TABLE letters (letter)");
    { Guard undone(database, name...); database.exec("INSERT INTO letters VALUES ('a')"); }
    database.exec("INSERT INTO letters VALUES ('b'), ('c')");
    { SQLite::Savepoint kept(database, "second"); database.exec("INSERT INTO letters VALUES ('d')"); kept.release(); }
    std::printf("reads %d, ", rows(database));
  }
  SQLite::Database again(file);
  std::printf("kept %d\n", rows(again));
}
int main() {
  write<SQLite::Savepoint>("savepoint.db", "first");
  write<SQLite::Transaction>("transaction.db");
}
END
library=$(echo usr/lib/*-linux-gnu)
g++ -std=c++17 -isystem usr/include open.cc -o open "$library/libSQLiteCpp.a" "$library/libsqlite3.so.0"
seen=$(LD_LIBRARY_PATH=$library ./open)
echo "SQLiteCpp 3.2.1, after one row undone by a Savepoint, by a Transaction, and three written:"
echo "$seen"; [ "$seen" = "$(printf 'reads 3, kept 0\nreads 3, kept 3')" ]
