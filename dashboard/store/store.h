// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/exchange/timing.h"
#include "core/util/number_set.h"
#include "core/util/wall_clock.h"
#include "core/wire/messages.h"

namespace SQLite {  // NOLINT(readability-identifier-naming): the library calls it so
class Database;
}

namespace citylearn {

/// Something worth a line in the page's list of events.
struct Event {
  double time = 0;      ///< seconds since 1970
  std::string session;  ///< as in the messages' headers; empty: of the dashboard itself
  std::string service;
  std::string kind;  ///< "alarm", "run", ... (docs/reference/dashboard-api.md)
  std::string text;
};

/// A process of a service, as headers name it.
struct Sender {
  std::string session, id;
  std::uint64_t incarnation = 0;
  explicit Sender(const msg::Header& header)
      : session(header.session().c_str()), id(header.sender().c_str()), incarnation(header.incarnation()) {}
  Sender(std::string session_name, std::string service, std::uint64_t started)
      : session(std::move(session_name)), id(std::move(service)), incarnation(started) {}
  auto operator<=>(const Sender&) const = default;
};

/// Returns the ID of a run in the API: SESSION/POLICY/SEED/RUN_ID. '/' and '%' in names are escaped.
std::string run_id(const msg::RunInfo& info);
std::string run_id(const std::string& session, const std::string& policy, std::uint64_t seed, std::uint64_t run_id);
/// Returns the ID of the episodes of a session that no run has claimed: SESSION.
std::string run_id(const std::string& session);

/// Keeps runs, episodes, training statistics and events for good, in one SQLite file that survives
/// kill -9 and a full disk. This is its one writer; readers have connections of their own (store_reader.h). A method
/// returns when what it was given is on the disk. Otherwise it throws Error, nothing of it is kept, and the call may be
/// repeated. May be used by several threads, one waits for the other.
class Store {
 public:
  struct Options {
    std::string path;
    std::uint64_t most_bytes = 0;  ///< the file grows no larger; 0: as the disk allows
  };
  /// Throws Error, without a change, for a file that is not a store, is damaged, newer, or used by another dashboard.
  explicit Store(const Options& options);
  ~Store();
  Store(const Store&) = delete;
  Store& operator=(const Store&) = delete;

  /// Records each episode once, in whatever order and however often it comes, all in one transaction. Returns how many
  /// were new. Adds an event to `lost`, where given, for acknowledged episodes that only others recorded.
  std::size_t record(std::span<const msg::EpisodeStat> episodes, std::vector<Event>* lost = nullptr);
  /// Returns the number up to which all episodes of an env_service are recorded, or will never come.
  std::uint64_t recorded_up_to(const Sender& environment);
  /// Records what an env_service hosts.
  void describe(const msg::TraversalInfo& info);

  /// Records that a run begins or goes on; it gets the episodes that came before this message. Removes nothing. Returns
  /// true when the run is new, resumed, or has other options.
  bool record(const msg::RunInfo& info);
  /// Records that a policy_service, and with it its run, has ended.
  void mark_ended(const Sender& policy);
  /// Records updates of the newest process of each known run and ignores others. A process that went back to an older
  /// checkpoint replaces its predecessors' updates from its first one on. Returns how many it took.
  std::size_t record(std::span<const msg::TrainingStat> stats);
  /// Returns the numbers, in its log, of the recorded updates of a run that this process made.
  NumberSet recorded_stats(const Sender& policy, std::uint64_t run_id);
  void record(const Event& event);
  /// Returns the newest events, newest first.
  std::vector<Event> events(std::size_t limit);

  enum class Removal { kDone, kUnknown, kRunning };
  /// Removes a run and its episodes, in steps that let other writers in between.
  Removal remove(const std::string& name);

  /// News of a run that is written only every few seconds.
  struct Liveness {
    double last = 0;  ///< message from it, seconds since 1970
    std::uint64_t updates = 0;
  };
  Liveness liveness(std::int64_t row);
  /// Writes liveness that has waited for a few seconds, or all of it at once.
  void flush(bool at_once = false);

  /// Calls `work` with the file's one writing connection, while no other method of the store runs.
  void with_database(const std::function<void(SQLite::Database&)>& work);

  const std::string& path() const;
  /// Says in the file PATH.lock, for programs of this machine, where they find this writer. Throws Error.
  void publish_writer(const std::string& text);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace citylearn
