// SPDX-License-Identifier: Apache-2.0
#include "dashboard/store/store.h"

#include <filesystem>
#include <fstream>

#include "core/task/training_figures.h"
#include "dashboard/store/route_store.h"
#include "dashboard/store/schema.h"
#include "dashboard/store/store_impl.h"

namespace citylearn {
namespace {

constexpr std::int64_t kMaxEvents = 100'000;  // older ones go
constexpr int kMaxLinks = 40;                 // as the kernel

std::string escaped(const std::string& name) {
  std::string text;
  for (const char c : name) text += c == '/' ? "%2F" : c == '%' ? "%25" : std::string(1, c);
  return text;
}

/// Returns the INSERT of an update: its key, the incarnation, its number in the log, and every other figure.
std::string insert_training() {
  std::string names = "key, incarnation, number", values = "?, ?, ?";
  for (const TrainingFigure& figure : training_figures().subspan(1)) {
    names += std::string(", ") + figure.name;
    values += ", ?";
  }
  return "INSERT INTO training (" + names + ") VALUES (" + values + ") ON CONFLICT DO NOTHING";
}

SQLite::Database open_for_writing(const Store::Options& options) {
  SQLite::Database database = open_database(options.path, SQLite::OPEN_READWRITE);
  with_file_errors(options.path, [&] {
    // Readers go on while the writer writes; a commit is on the disk when it returns.
    database.exec(
        "PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA foreign_keys = ON; PRAGMA cache_size = -16000;"
        "PRAGMA journal_size_limit = 67108864");
    for (const TrainingFigure& figure : training_figures().subspan(1)) {
      SQLite::Statement there(database, "SELECT 1 FROM pragma_table_info('training') WHERE name = ?");
      if (!bind_values(there, figure.name).executeStep())  // a figure that is newer than the file
        database.exec(std::string("ALTER TABLE training ADD COLUMN ") + figure.name + " REAL");
    }
    if (options.most_bytes == 0) return;
    const auto page = static_cast<std::uint64_t>(database.execAndGet("PRAGMA page_size").getInt64());
    database.exec("PRAGMA max_page_count = " + std::to_string(std::max<std::uint64_t>(1, options.most_bytes / page)));
  });
  return database;
}

/// Returns the file that a path leads to, which need not be there yet. Two dashboards may know it by different links.
std::string without_links(std::filesystem::path path) {
  std::error_code none;
  for (int links = 0; links < kMaxLinks && std::filesystem::is_symlink(path, none); ++links)
    path = path.parent_path() / std::filesystem::read_symlink(path, none);
  return path;
}

/// Returns why a second writer of a store is refused, and where the first one's page is, as publish_writer() says.
Error refusal(const std::string& path) {
  std::string page;
  std::ifstream(without_links(path) + ".lock") >> page;
  return Error("another dashboard records here", path,
               (page.empty() ? "" : "open " + page + ", or ") + "end it, or choose another file");
}

}  // namespace

std::string run_id(const msg::RunInfo& info) {
  return run_id(info.header().session().c_str(), info.header().sender().c_str(), info.seed(), info.run_id());
}

std::string run_id(const std::string& session, const std::string& policy, std::uint64_t seed, std::uint64_t run_id) {
  return escaped(session) + "/" + escaped(policy) + "/" + std::to_string(seed) + "/" + std::to_string(run_id);
}

std::string run_id(const std::string& session) { return escaped(session); }

Store::Impl::Impl(const Options& options)
    : path(options.path),
      // A file of its own, as closing any descriptor of the database would drop SQLite's locks.
      lock(without_links(path) + ".lock", refusal(path)),
      database((prepare_file(path), open_for_writing(options))) {
  with_file_errors(path, [&] {
    statements = std::make_unique<Statements>(database);
    load_runs();
  });
}

Store::Impl::Statements::Statements(const SQLite::Database& d)
    : find_source(
          d,
          "SELECT id, contiguous, missed, dataset IS NOT NULL FROM sources WHERE session = ? AND environment = ? AND "
          "incarnation = ?"),
      add_source(d, "INSERT INTO sources (session, environment, incarnation) VALUES (?, ?, ?)"),
      source_episodes(d, "SELECT episode FROM episodes WHERE source = ? AND episode > ? ORDER BY episode"),
      source_progress(d, "UPDATE sources SET contiguous = ?2, missed = ?3 WHERE id = ?1"),
      describe_source(d,
                      "UPDATE sources SET dataset = ?, traversal = ?, condition = ?, hash = ?, frames = ?, "
                      "agents = ?, images = ?, rule = ?, streets = ? WHERE id = ?"),
      add_episode(d,
                  "INSERT INTO episodes (run, source, episode, run_id, agent, evaluation, task, "
                  "traversal, policy, \"update\", shuffled, start, goal, steps, shortest, reward, completed, spl, "
                  "recorded, path) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?) "
                  "ON CONFLICT DO NOTHING"),
      add_run_source(d, "INSERT OR IGNORE INTO run_sources (run, source) VALUES (?, ?)"),
      count_episodes(d, "UPDATE runs SET recorded = recorded + ?2, last = MAX(last, ?3) WHERE id = ?1"),
      add_run(d,
              "INSERT INTO runs (name, session, run_id, policy, seed, started, last) "
              "VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?6)"),
      add_unclaimed(d, "INSERT INTO runs (name, session, started, last) VALUES (?1, ?2, ?3, ?3)"),
      find_unclaimed(d, "SELECT id FROM runs WHERE session = ? AND run_id IS NULL"),
      update_run(d,
                 "UPDATE runs SET incarnation = ?2, agent = ?3, learner = ?4, updates = ?5, manifest = ?6, last = ?7, "
                 "ended = ?8 WHERE id = ?1"),
      run_liveness(d, "UPDATE runs SET last = MAX(last, ?2), updates = ?3 WHERE id = ?1"),
      run_ended(d, "UPDATE runs SET ended = 1, last = MAX(last, ?2) WHERE id = ?1"),
      claim_episodes(d, "UPDATE episodes SET run = ?2 WHERE run = ?1 AND run_id = ?3"),
      claim_sources(d, "INSERT OR IGNORE INTO run_sources SELECT DISTINCT run, source FROM episodes WHERE run = ?"),
      add_to_count(d, "UPDATE runs SET recorded = recorded + ?2 WHERE id = ?1"),
      add_training(d, insert_training()),
      drop_training_from(d, "DELETE FROM training WHERE key BETWEEN ?1 AND ?2 AND incarnation <> ?3"),
      process_stats(d, "SELECT number FROM training WHERE key BETWEEN ?1 AND ?2 AND incarnation = ?3 ORDER BY key"),
      least_update(d, "SELECT key FROM training WHERE key BETWEEN ?1 AND ?2 AND incarnation = ?3 ORDER BY key LIMIT 1"),
      add_event(d, "INSERT INTO events (time, session, service, kind, text) VALUES (?, ?, ?, ?, ?)"),
      drop_events(d, "DELETE FROM events WHERE id <= ?"),
      events(d, "SELECT time, session, service, kind, text FROM events ORDER BY id DESC LIMIT ?") {}

void Store::Impl::add(const Event& event) {
  run(statements->add_event, event.time, event.session, event.service, event.kind, event.text);
  run(statements->drop_events, database.getLastInsertRowid() - kMaxEvents);
}

Store::Store(const Options& options) : impl_(std::make_unique<Impl>(options)) {}
Store::~Store() = default;

const std::string& Store::path() const { return impl_->path; }
void Store::publish_writer(const std::string& text) { impl_->lock.write(text); }

std::size_t Store::record(std::span<const msg::EpisodeStat> episodes, std::vector<Event>* lost) {
  return impl_->locked([&] { return impl_->record(episodes, lost); });
}

std::uint64_t Store::recorded_up_to(const Sender& environment) {
  return impl_->locked([&] { return impl_->source(environment).episodes.settled().reach(); });
}

void Store::describe(const msg::TraversalInfo& info) {
  impl_->locked([&] { impl_->describe(info); });
}

bool Store::record(const msg::RunInfo& info) {
  return impl_->locked([&] { return impl_->record(info); });
}

void Store::mark_ended(const Sender& policy) {
  impl_->locked([&] { impl_->mark_ended(policy); });
}

std::size_t Store::record(std::span<const msg::TrainingStat> stats) {
  return impl_->locked([&] { return impl_->record(stats); });
}

NumberSet Store::recorded_stats(const Sender& policy, std::uint64_t run_id) {
  return impl_->locked([&] { return impl_->recorded_stats(policy, run_id); });
}

void Store::record(const Event& event) {
  impl_->locked([&] {
    SQLite::Transaction all(impl_->database, SQLite::TransactionBehavior::IMMEDIATE);
    impl_->add(event);
    all.commit();
  });
}

std::vector<Event> Store::events(std::size_t limit) {
  return impl_->locked([&] {
    std::vector<Event> events;
    SQLite::Statement& row = bind_values(impl_->statements->events, limit);
    while (row.executeStep()) {
      Event& event = events.emplace_back();
      read_row(row, event.time, event.session, event.service, event.kind, event.text);
    }
    return events;
  });
}

Store::Liveness Store::liveness(std::int64_t row) {
  return impl_->locked([&] {
    const auto known = impl_->liveness.find(row);
    return known == impl_->liveness.end() ? Liveness{} : known->second;
  });
}

void Store::with_database(const std::function<void(SQLite::Database&)>& work) {
  impl_->locked([&] { work(impl_->database); });
}

void Store::flush(bool at_once) {
  impl_->locked([&] { impl_->flush(at_once); });
}

Store::Removal Store::remove(const std::string& name) {
  SQLite::Database& database = impl_->database;
  std::int64_t row = 0;
  const auto in_slices = [&](const char* sql) {
    // A transaction of a million rows would keep all others waiting.
    constexpr int kBatch = 4000;
    while (impl_->locked([&] { return run(database, sql, row, kBatch); }) == kBatch) {
    }
  };
  const auto running = [&] {
    SQLite::Statement state(database, "SELECT ended, last FROM runs WHERE id = ?");
    const auto heard = impl_->liveness.find(row);
    if (!bind_values(state, row).executeStep()) return false;
    bool ended = false;
    double last = 0;
    read_row(state, ended, last);
    if (heard != impl_->liveness.end()) last = std::max(last, heard->second.last);
    return !ended && seconds_since_epoch() - last < kRunSilence.count();
  };
  const Removal possible = impl_->locked([&] {
    SQLite::Statement found(database, "SELECT id FROM runs WHERE name = ?");
    if (!bind_values(found, name).executeStep()) return Removal::kUnknown;
    read_row(found, row);
    return running() ? Removal::kRunning : Removal::kDone;
  });
  if (possible != Removal::kDone) return possible;
  in_slices("DELETE FROM episodes WHERE id IN (SELECT id FROM episodes WHERE run = ? LIMIT ?)");
  in_slices(
      "DELETE FROM training WHERE key IN "
      "(SELECT key FROM training WHERE key BETWEEN (?1 << 40) AND ((?1 + 1) << 40) - 1 LIMIT ?2)");
  return impl_->locked([&] {
    if (running()) return Removal::kRunning;  // it went on after all: then what is left of it stays
    SQLite::Transaction all(database, SQLite::TransactionBehavior::IMMEDIATE);
    run(database, "DELETE FROM episodes WHERE run = ?", row);  // those that came meanwhile
    run(database, "DELETE FROM training WHERE key BETWEEN (?1 << 40) AND ((?1 + 1) << 40) - 1", row);
    run(database, "DELETE FROM runs WHERE id = ?", row);
    remove_unused_routes(database);
    all.commit();
    impl_->liveness.erase(row);
    impl_->unwritten.erase(row);
    impl_->load_runs();
    return Removal::kDone;
  });
}

}  // namespace citylearn
