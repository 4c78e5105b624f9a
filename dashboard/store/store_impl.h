// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "core/files/file_lock.h"
#include "dashboard/store/database.h"
#include "dashboard/store/store.h"

namespace citylearn {

/// The implementation of Store, used under its lock. Faults of SQLite leave these methods as SQLite::Exception.
struct Store::Impl {
  explicit Impl(const Options& options);

  /// Returns `work()` under the lock. A fault of SQLite becomes an Error that names the file.
  template <class Work>
  auto locked(Work work) {
    const std::lock_guard guard(mutex);
    return with_file_errors(path, work);
  }

  // store_episodes.cc
  std::size_t record(std::span<const msg::EpisodeStat> episodes, std::vector<Event>* lost);
  void describe(const msg::TraversalInfo& info);

  // store_runs.cc
  bool record(const msg::RunInfo& info);
  void mark_ended(const Sender& policy);
  std::size_t record(std::span<const msg::TrainingStat> stats);
  NumberSet recorded_stats(const Sender& policy, std::uint64_t run_id);
  void flush(bool at_once);
  void load_runs();

  void add(const Event& event);

  /// A run, as far as new messages are compared with it.
  struct KnownRun {
    std::int64_t row = 0;  // in `runs`
    std::string policy;
    std::uint64_t seed = 0;
    std::uint64_t incarnation = 0;         // newest process that sent its RunInfo
    std::set<std::uint64_t> predecessors;  // of it, as far as this process heard of them
    std::uint64_t message = 0;             // number of its newest RunInfo
    std::uint64_t updates = 0;
    std::uint64_t least = 0;  // of that process's updates that are recorded; 0: none is
    bool ended = false;
    std::string agent, learner, manifest;
  };
  struct Source {
    std::int64_t id = 0;
    RecordedNumbers episodes;  // given up: those that others alone recorded
    bool described = false;
  };
  using RunKey = std::pair<std::string, std::uint64_t>;  // session and run_id, as in messages

  Source& source(const Sender& environment);
  std::int64_t add_source(const Sender& environment);
  template <class Fits>
  KnownRun* find(const std::string& session, std::uint64_t run_id, Fits fits) {
    const auto [begin, end] = runs.equal_range({session, run_id});
    const auto found = std::find_if(begin, end, [&](const auto& entry) { return fits(entry.second); });
    return found == end ? nullptr : &found->second;
  }
  KnownRun* find_of(const Sender& policy, std::uint64_t run_id);
  std::int64_t unclaimed_row(const std::string& session);
  void claim_episodes(const std::string& session, std::uint64_t run_id, const KnownRun& run);

  struct Statements {
    explicit Statements(const SQLite::Database& d);
    SQLite::Statement find_source, add_source, source_episodes, source_progress, describe_source;
    SQLite::Statement add_episode, add_run_source, count_episodes;
    SQLite::Statement add_run, add_unclaimed, find_unclaimed, update_run, run_liveness, run_ended;
    SQLite::Statement claim_episodes, claim_sources, add_to_count;
    SQLite::Statement add_training, drop_training_from, process_stats, least_update;
    SQLite::Statement add_event, drop_events, events;
  };

  const std::string path;
  std::mutex mutex;
  FileLock lock;  // keeps a second dashboard off
  SQLite::Database database;
  std::unique_ptr<Statements> statements;
  std::multimap<RunKey, KnownRun> runs;  // several only where one process uses the run_id of another
  std::map<Sender, Source> sources;
  std::map<std::string, std::int64_t> unclaimed_rows;           // by session
  std::set<std::pair<std::int64_t, std::int64_t>> run_sources;  // those in the table
  std::map<std::int64_t, Liveness> liveness;                    // by row of `runs`
  std::map<std::int64_t, double> unwritten;                     // rows whose liveness is newer than the file's, since
};

// Numbers of 40 bits count the updates of a run in training.key; no process lives so long.
inline constexpr int kUpdateBits = 40;
inline constexpr std::uint64_t kMaxUpdate = (std::uint64_t{1} << kUpdateBits) - 1;

/// Returns training.key of an update of the run in `row`.
constexpr std::int64_t training_key(std::int64_t row, std::uint64_t update) {
  return (row << kUpdateBits) + static_cast<std::int64_t>(update);
}
constexpr std::uint64_t update_of(std::int64_t key) { return static_cast<std::uint64_t>(key) & kMaxUpdate; }

}  // namespace citylearn
