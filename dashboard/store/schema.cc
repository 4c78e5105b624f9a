// SPDX-License-Identifier: Apache-2.0
#include "dashboard/store/schema.h"

#include <fcntl.h>
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

constexpr std::int64_t kApplication = 0x434C4453;         // "CLDS": says whose file it is
constexpr std::uintmax_t kMaxFullCheckBytes = 256 << 20;  // bytes: about a second
constexpr std::string_view kMagic{"SQLite format 3\0", 16};

// Numbers of 64 bits without sign (seeds, hashes) are kept with their bits as SQLite's, which have one.
const char* const kFirst = R"(
-- What the page calls a run: a training or evaluation of one policy_service, or what no policy_service claims.
CREATE TABLE runs (
  id INTEGER PRIMARY KEY,
  name TEXT NOT NULL UNIQUE,           -- the ID of the API
  run TEXT NOT NULL,                   -- as in the messages' headers
  job INTEGER,                         -- as in RunInfo; NULL: what belongs to no job that was heard of
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
  recorded INTEGER NOT NULL DEFAULT 0, -- its rows of `episodes`
  UNIQUE (run, job)
);
-- A process of an env_service, whose episodes are numbered from 1 without gaps.
CREATE TABLE sources (
  id INTEGER PRIMARY KEY,
  run TEXT NOT NULL,
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
  UNIQUE (run, environment, incarnation)
);
CREATE TABLE run_sources (
  run INTEGER NOT NULL REFERENCES runs ON DELETE CASCADE,
  source INTEGER NOT NULL REFERENCES sources,
  PRIMARY KEY (run, source)
) WITHOUT ROWID;
CREATE TABLE episodes (
  id INTEGER PRIMARY KEY,
  run INTEGER NOT NULL REFERENCES runs,
  source INTEGER NOT NULL REFERENCES sources,
  episode INTEGER NOT NULL,
  job INTEGER NOT NULL,
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
CREATE INDEX episodes_of_evaluation ON episodes (run, policy, "update", shuffled, traversal, task) WHERE evaluation = 1;
CREATE INDEX episodes_worst ON episodes (run, spl, steps DESC) WHERE evaluation = 1;
-- One row an update. The key keeps a run's rows together, in their order: run * 2^40 + update.
CREATE TABLE training (
  key INTEGER PRIMARY KEY,
  incarnation INTEGER NOT NULL,        -- of the policy_service that sent it
  steps INTEGER NOT NULL,
  episodes INTEGER NOT NULL,
  wall REAL,
  lesson INTEGER NOT NULL,
  reward REAL,
  spl REAL,
  steps_per_second REAL,
  policy_loss REAL,
  value_loss REAL,
  entropy REAL,
  divergence REAL,
  clipped REAL,
  gradient_norm REAL,
  learning_rate REAL,
  lag REAL
);
CREATE TABLE events (
  id INTEGER PRIMARY KEY,
  time REAL NOT NULL,
  run TEXT NOT NULL,
  service TEXT NOT NULL,
  kind TEXT NOT NULL,
  text TEXT NOT NULL
);
)";

const char* const kPlainNames = R"(
ALTER TABLE runs RENAME COLUMN run TO session;
ALTER TABLE runs RENAME COLUMN job TO run_id;
ALTER TABLE sources RENAME COLUMN run TO session;
ALTER TABLE events RENAME COLUMN run TO session;
ALTER TABLE episodes RENAME COLUMN job TO run_id;
ALTER TABLE training RENAME COLUMN divergence TO approx_kl;
ALTER TABLE training RENAME COLUMN clipped TO clip_fraction;
ALTER TABLE training RENAME COLUMN lag TO policy_lag;
)";

// Two runs may have the same run_id: it is a time. `name` says all that tells runs apart.
const char* const kRunsByName = R"(
CREATE TABLE runs_by_name (
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
INSERT INTO runs_by_name SELECT id, name, session, run_id, policy, seed, agent, learner, incarnation, updates, manifest,
  started, last, ended, recorded FROM runs;
DROP TABLE runs;
ALTER TABLE runs_by_name RENAME TO runs;
)";

const char* const kNotes = R"(
ALTER TABLE runs ADD COLUMN tags TEXT NOT NULL DEFAULT '';  -- one a line
ALTER TABLE runs ADD COLUMN note TEXT NOT NULL DEFAULT '';
)";

// Runs that other programs logged here once. Their rows stay for SQLite's own tools; nothing shows them any more.
const char* const kLogged = R"(
ALTER TABLE runs ADD COLUMN source TEXT NOT NULL DEFAULT '';       -- what logs it: "python", "tensorboard", ...; '': none
ALTER TABLE runs ADD COLUMN title TEXT NOT NULL DEFAULT '';        -- as its program named it
ALTER TABLE runs ADD COLUMN log TEXT NOT NULL DEFAULT '';          -- identifies the log
ALTER TABLE runs ADD COLUMN received INTEGER NOT NULL DEFAULT 0;   -- records of the log that are here, from the first on
ALTER TABLE runs ADD COLUMN summary TEXT NOT NULL DEFAULT '';      -- final figures that the program set: JSON
CREATE TABLE metrics (
  id INTEGER PRIMARY KEY,
  run INTEGER NOT NULL REFERENCES runs ON DELETE CASCADE,
  name TEXT NOT NULL,
  points INTEGER NOT NULL DEFAULT 0,
  step REAL,                           -- of the newest point
  value REAL,                          -- likewise
  least REAL,
  greatest REAL,
  UNIQUE (run, name)
);
-- One row a point. The key keeps a metric's points together, in their order: metric * 2^40 + number of the record.
CREATE TABLE points (
  key INTEGER PRIMARY KEY,
  step REAL,
  time REAL,                           -- seconds since 1970
  value REAL                           -- NULL: no number
);
CREATE VIEW curves AS SELECT runs.name AS run, metrics.name AS metric, points.step, points.time, points.value
  FROM runs JOIN metrics ON metrics.run = runs.id
  JOIN points ON points.key BETWEEN metrics.id << 40 AND ((metrics.id + 1) << 40) - 1;
)";

// Alarms about runs, which are Prometheus' now (compose/prometheus). Likewise.
const char* const kAlarms = R"(
CREATE TABLE alarm_rules (
  id INTEGER PRIMARY KEY AUTOINCREMENT,  -- no later rule is taken for one that was removed
  runs TEXT NOT NULL,
  "when" TEXT NOT NULL,
  figure TEXT NOT NULL,
  value REAL,
  points INTEGER NOT NULL,
  steps REAL NOT NULL,
  minutes REAL NOT NULL,
  created REAL NOT NULL
);
CREATE TABLE alarms (
  id INTEGER PRIMARY KEY AUTOINCREMENT,
  rule INTEGER NOT NULL REFERENCES alarm_rules ON DELETE CASCADE,
  run INTEGER NOT NULL REFERENCES runs ON DELETE CASCADE,
  since REAL NOT NULL,
  over REAL,                           -- NULL: it lasts
  text TEXT NOT NULL
);
-- How far a rule has looked at a run.
CREATE TABLE alarm_progress (
  rule INTEGER NOT NULL REFERENCES alarm_rules ON DELETE CASCADE,
  run INTEGER NOT NULL REFERENCES runs ON DELETE CASCADE,
  newest INTEGER NOT NULL,             -- update or record
  streak INTEGER NOT NULL,             -- points in succession that fit the rule; negative: that do not
  begin REAL,                          -- step of the first of them
  moved REAL NOT NULL,                 -- when a new point was seen last
  updates INTEGER NOT NULL,            -- of the run, then
  ended INTEGER NOT NULL,              -- likewise
  alarm INTEGER NOT NULL,              -- that was raised and whose cause is there; 0: none
  PRIMARY KEY (rule, run)
) WITHOUT ROWID;
)";

// What the Route page shows of a run that is over. A traversal's hash names its map, the hash of a picture its bytes:
// each is here once, however many runs show it.
const char* const kRoutes = R"(
CREATE TABLE maps (
  hash INTEGER PRIMARY KEY,            -- of the traversal, as in `sources`
  frames INTEGER NOT NULL,
  position BLOB NOT NULL,              -- metres along the route: float32, one a frame
  latitude BLOB,                       -- degrees: float64, one a frame; NULL: no frame has one
  longitude BLOB
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
CREATE INDEX sources_of_hash ON sources (hash);
CREATE INDEX runs_of_source ON run_sources (source);
CREATE INDEX episodes_of_training ON episodes (run) WHERE evaluation = 0;
)";

const char* const kNumberedFigures = R"(
ALTER TABLE training ADD COLUMN number INTEGER;  -- in the log of its process; NULL: its messages had none
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

/// Returns "ok", or what is damaged. Of a large file the points that were logged once are left out: reading them all
/// would take long.
std::string damage(SQLite::Database& database, const std::string& path) {
  if (std::filesystem::file_size(path) <= kMaxFullCheckBytes)
    return database.execAndGet("PRAGMA quick_check(1)").getString();
  std::vector<std::string> tables;
  SQLite::Statement all(database, "SELECT name FROM sqlite_schema WHERE type = 'table' AND name <> 'points'");
  while (all.executeStep()) tables.push_back(value_at<std::string>(all, 0));
  for (const std::string& table : tables)
    if (std::string fault = database.execAndGet("PRAGMA quick_check(\"" + table + "\")").getString(); fault != "ok")
      return fault;
  return "ok";
}

/// Checks, without writing anything, whose file it is and whether it is whole. Returns its schema.
std::int64_t inspect(const std::string& path, std::size_t newest) {
  SQLite::Database database = open_database(path);
  const auto number = [&](const char* sql) { return database.execAndGet(sql).getInt64(); };
  const std::int64_t application = number("PRAGMA application_id");
  const std::int64_t schema = number("PRAGMA user_version");
  if (application != kApplication) {
    // A dashboard killed before its first transaction leaves an empty file.
    if (application == 0 && schema == 0 && number("SELECT COUNT(*) FROM sqlite_schema") == 0) return 0;
    throw Error("is an SQLite file of another program", path, "choose another file");
  }
  if (schema > static_cast<std::int64_t>(newest))
    throw Error("has schema " + std::to_string(schema) + ", this dashboard knows " + std::to_string(newest), path,
                "it was written by a newer dashboard: use that one, or another file");
  if (const std::string fault = damage(database, path); fault != "ok")
    throw Error("is damaged: " + fault, path, "restore a copy of it, or move it away to begin a new one");
  return schema;
}

/// Writes a whole copy of what is committed.
void keep_copy(SQLite::Database& database, const std::string& copy) {
  std::error_code none;
  std::filesystem::remove(copy, none);  // of an upgrade that was interrupted
  run(database, "VACUUM INTO ?", copy);
  std::filesystem::permissions(copy, std::filesystem::perms::owner_read | std::filesystem::perms::owner_write);
}

}  // namespace

const std::vector<std::string>& schema_steps() {
  static const std::vector<std::string> steps = {kFirst,  kPlainNames, kRunsByName, kNotes,
                                                 kLogged, kAlarms,     kRoutes,     kNumberedFigures};
  return steps;
}

void prepare_file(const std::string& path, const std::vector<std::string>& steps) {
  std::int64_t schema = 0;
  if (holds_something(path)) {
    schema = with_file_errors(path, [&] { return inspect(path, steps.size()); });
  } else {
    // Created here, so that others cannot read it even for a moment; SQLite gives its other files the same mode.
    const int file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
    if (file < 0) throw Error(std::strerror(errno), path, "choose a file in a folder that can be written");
    ::close(file);
  }
  if (::chmod(path.c_str(), 0600) != 0) throw Error(std::strerror(errno), path, "choose a file of your own");
  SQLite::Database database = open_database(path, SQLite::OPEN_READWRITE);
  with_file_errors(path, [&] {
    database.exec("PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL");
    if (schema == static_cast<std::int64_t>(steps.size())) return;
    if (schema > 0) keep_copy(database, path + ".schema-" + std::to_string(schema));
    SQLite::Transaction all(database, SQLite::TransactionBehavior::IMMEDIATE);
    for (auto step = static_cast<std::size_t>(schema); step < steps.size(); ++step) database.exec(steps[step]);
    database.exec("PRAGMA application_id = " + std::to_string(kApplication));
    database.exec("PRAGMA user_version = " + std::to_string(steps.size()));
    all.commit();
  });
}

}  // namespace citylearn
