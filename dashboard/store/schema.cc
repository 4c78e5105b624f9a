// SPDX-License-Identifier: Apache-2.0
#include "dashboard/store/schema.h"

#include <fcntl.h>
#include <spdlog/spdlog.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "core/util/error.h"
#include "dashboard/store/database.h"

namespace citylearn {
namespace {

constexpr std::int64_t kApplication = 0x434C4453;  // "CLDS": says whose file it is
constexpr std::string_view kMagic{"SQLite format 3\0", 16};

constexpr std::int64_t kVersion = 10;  // of kSchema; raise it whenever it needs what earlier files lack

// Numbers of 64 bits without sign (seeds, hashes) are kept with their bits as SQLite's, which have one.
const char* const kSchema = R"(
-- What the page calls a run: a training or evaluation of one policy_service, or what no policy_service claims. Two runs
-- may have the same run_id: it is a time. `name` says all that tells runs apart.
CREATE TABLE runs (
  id INTEGER PRIMARY KEY,
  name TEXT NOT NULL UNIQUE,           -- the ID of the API
  session TEXT NOT NULL,               -- as in the messages' headers
  run_id INTEGER,                      -- as in RunInfo; NULL: what belongs to no run that was heard of
  policy TEXT,                         -- id of the policy_service
  seed INTEGER,
  agent TEXT,
  learner TEXT,
  incarnation INTEGER NOT NULL DEFAULT 0,  -- newest of the policy_service
  updates INTEGER NOT NULL DEFAULT 0,  -- so far, as it told
  manifest TEXT,
  started REAL NOT NULL,
  last REAL NOT NULL,                  -- heard of it, at least; written now and then
  ended INTEGER NOT NULL DEFAULT 0,    -- it said so
  recorded INTEGER NOT NULL DEFAULT 0  -- its rows of `episodes`
);
-- A process of an env_service, whose episodes are numbered from 1 without gaps.
CREATE TABLE sources (
  id INTEGER PRIMARY KEY,
  session TEXT NOT NULL,
  environment TEXT NOT NULL,
  incarnation INTEGER NOT NULL,
  contiguous INTEGER NOT NULL DEFAULT 0,  -- all its episodes up to this one are recorded, here or elsewhere
  missed INTEGER NOT NULL DEFAULT 0,      -- of them, those recorded elsewhere
  dataset TEXT,                           -- NULL: its TraversalInfo has not come
  traversal TEXT,
  condition TEXT,
  hash INTEGER,
  frames INTEGER,
  agents INTEGER,
  images INTEGER,
  rule INTEGER,                           -- as in TraversalInfo
  streets INTEGER,                        -- hash of its street map; 0: it has none
  UNIQUE (session, environment, incarnation)
);
CREATE INDEX sources_of_hash ON sources (hash);
CREATE TABLE run_sources (
  run INTEGER NOT NULL REFERENCES runs ON DELETE CASCADE,
  source INTEGER NOT NULL REFERENCES sources,
  PRIMARY KEY (run, source)
) WITHOUT ROWID;
CREATE INDEX runs_of_source ON run_sources (source);
CREATE TABLE episodes (
  id INTEGER PRIMARY KEY,
  run INTEGER NOT NULL REFERENCES runs,
  source INTEGER NOT NULL REFERENCES sources,
  episode INTEGER NOT NULL,
  run_id INTEGER NOT NULL,
  agent INTEGER NOT NULL,
  evaluation INTEGER NOT NULL,
  task INTEGER NOT NULL,
  traversal TEXT NOT NULL,
  policy TEXT NOT NULL,
  "update" INTEGER NOT NULL,
  shuffled INTEGER NOT NULL,
  start INTEGER NOT NULL,
  goal INTEGER NOT NULL,
  steps INTEGER NOT NULL,
  shortest INTEGER NOT NULL,
  reward REAL,
  completed INTEGER NOT NULL,
  spl REAL NOT NULL,
  recorded REAL NOT NULL,
  path BLOB,                           -- as in EpisodeStat; NULL: not kept
  UNIQUE (source, episode)
);
CREATE INDEX episodes_of_run ON episodes (run);
CREATE INDEX episodes_of_training ON episodes (run) WHERE evaluation = 0;
CREATE INDEX episodes_of_evaluation ON episodes (run, policy, "update", shuffled, traversal, task) WHERE evaluation = 1;
CREATE INDEX episodes_worst ON episodes (run, spl, steps DESC) WHERE evaluation = 1;
-- One row an update. The key keeps a run's rows together, in their order: run * 2^40 + update. The figures' columns are
-- added when a store is opened (training_figures.inc).
CREATE TABLE training (
  key INTEGER PRIMARY KEY,
  incarnation INTEGER NOT NULL,        -- of the policy_service that sent it
  number INTEGER                       -- in the log of its process
);
CREATE TABLE events (
  id INTEGER PRIMARY KEY,
  time REAL NOT NULL,
  session TEXT NOT NULL,
  service TEXT NOT NULL,
  kind TEXT NOT NULL,
  text TEXT NOT NULL
);
-- What the Route page shows of a run that is over. A traversal's hash names its map, the hash of a picture its bytes:
-- each is here once, however many runs show it.
CREATE TABLE maps (
  hash INTEGER PRIMARY KEY,            -- of the traversal, as in `sources`
  frames INTEGER NOT NULL,
  position BLOB,                       -- metres along the route: float32, one a frame; NULL: on streets
  latitude BLOB,                       -- degrees: float64, one a frame; NULL: no frame has one
  longitude BLOB,
  rule INTEGER NOT NULL,               -- of its states, as in TraversalInfo
  streets BLOB                         -- the object Streets; NULL: a line
);
CREATE TABLE pictures (
  id INTEGER PRIMARY KEY,
  content TEXT NOT NULL UNIQUE,        -- SHA-256 of `bytes`
  type TEXT NOT NULL,                  -- "image/jpeg"
  bytes BLOB NOT NULL
);
-- The picture of a frame of a traversal.
CREATE TABLE places (
  hash INTEGER NOT NULL,
  frame INTEGER NOT NULL,
  picture INTEGER NOT NULL REFERENCES pictures,
  PRIMARY KEY (hash, frame)
) WITHOUT ROWID;
CREATE INDEX places_of_picture ON places (picture);
)";

/// Returns whether there is something in the file. Throws Error when that is certainly not SQLite.
bool holds_something(const std::string& path) {
  std::error_code none;
  const auto status = std::filesystem::status(path, none);
  if (!std::filesystem::exists(status)) return false;
  if (!std::filesystem::is_regular_file(status)) throw Error("is not a regular file", path, "choose another file");
  std::ifstream in(path, std::ios::binary);
  if (!in) throw Error(std::strerror(errno), path, "choose another file");
  char begin[kMagic.size()];
  in.read(begin, sizeof begin);
  if (in.gcount() == 0) return false;
  if (std::string_view(begin, static_cast<std::size_t>(in.gcount())) != kMagic)
    throw Error("is not a store of the dashboard", path, "choose another file");
  return true;
}

/// Checks, without writing anything, whose file it is and whether it is whole. Returns its schema.
std::int64_t inspect(const std::string& path) {
  SQLite::Database database = open_database(path);
  const auto number = [&](const char* sql) { return database.execAndGet(sql).getInt64(); };
  const std::int64_t application = number("PRAGMA application_id");
  const std::int64_t schema = number("PRAGMA user_version");
  if (application != kApplication) {
    // A dashboard killed before its first transaction leaves an empty file.
    if (application == 0 && schema == 0 && number("SELECT COUNT(*) FROM sqlite_schema") == 0) return 0;
    throw Error("is an SQLite file of another program", path, "choose another file");
  }
  if (schema > kVersion)
    throw Error("has schema " + std::to_string(schema) + ", this dashboard knows " + std::to_string(kVersion), path,
                "it was written by a newer dashboard: use that one, or another file");
  if (const std::string fault = database.execAndGet("PRAGMA quick_check(1)").getString(); fault != "ok")
    throw Error("is damaged: " + fault, path, "restore a copy of it, or move it away to begin a new one");
  return schema;
}

/// Moves an older store aside, with all that is committed, so that a new one begins in its place.
void set_aside(const std::string& path, std::int64_t schema) {
  const std::string aside = path + ".schema-" + std::to_string(schema);
  if (std::filesystem::exists(aside))
    throw Error("is of an earlier dashboard, and " + aside + " exists", path, "move one of them away");
  // What is committed is then in the file itself.
  open_database(path, SQLite::OPEN_READWRITE).exec("PRAGMA journal_mode = DELETE");
  std::error_code fault;
  std::filesystem::rename(path, aside, fault);
  if (fault)
    throw Error("cannot be renamed: " + fault.message(), path, "choose a file in a folder that can be written");
  spdlog::warn("{} is of an earlier dashboard: it is {} now, and a new store begins", path, aside);
}

}  // namespace

void prepare_file(const std::string& path) {
  std::int64_t schema = 0;
  if (holds_something(path)) {
    schema = with_file_errors(path, [&] { return inspect(path); });
    if (::chmod(path.c_str(), 0600) != 0) throw Error(std::strerror(errno), path, "choose a file of your own");
    if (schema == kVersion) return;
    if (schema > 0) with_file_errors(path, [&] { set_aside(path, schema); });
  }
  // Created here, so that others cannot read it even for a moment; SQLite gives its other files the same mode.
  const int file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
  if (file < 0) throw Error(std::strerror(errno), path, "choose a file in a folder that can be written");
  ::close(file);
  SQLite::Database database = open_database(path, SQLite::OPEN_READWRITE);
  with_file_errors(path, [&] {
    database.exec("PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL");
    SQLite::Transaction all(database, SQLite::TransactionBehavior::IMMEDIATE);
    database.exec(kSchema);
    database.exec("PRAGMA application_id = " + std::to_string(kApplication));
    database.exec("PRAGMA user_version = " + std::to_string(kVersion));
    all.commit();
  });
}

}  // namespace citylearn
