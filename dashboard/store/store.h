// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "core/wire/messages.h"
#include "dashboard/store/number_set.h"

namespace citylearn {

/// Something worth a line in the page's list.
struct Event {
  double time = 0;  ///< seconds since 1970
  std::string run;  ///< as in the messages' headers; empty: of the dashboard itself
  std::string service;
  std::string kind;  ///< "alarm", "run", ... (docs/reference/dashboard-api.md)
  std::string text;
};

/// A process of a service, as headers name it.
struct Sender {
  std::string run, id;
  std::uint64_t incarnation = 0;
  explicit Sender(const msg::Header& header)
      : run(header.session().c_str()), id(header.sender().c_str()), incarnation(header.incarnation()) {}
  Sender(std::string run_name, std::string service, std::uint64_t started)
      : run(std::move(run_name)), id(std::move(service)), incarnation(started) {}
  auto operator<=>(const Sender&) const = default;
};

/// ID of a run in the API: RUN/POLICY/SEED/JOB. '/' and '%' in names are escaped.
std::string run_id(const msg::RunInfo& info);
/// ID of what belongs to no job that was heard of: RUN.
std::string run_id(const std::string& run);

/// What the dashboard knows for good: runs, episodes, training statistics and events, in one SQLite file that survives
/// kill -9 and a full disk. This is its one writer; readers have connections of their own (store_reader.h). A method
/// returns when what it was given is on the disk, or throws Error: then nothing of it is there, and the call may be
/// made again. May be used by several threads, one waits for the other.
class Store {
 public:
  struct Options {
    std::string path;
    std::uint64_t most_bytes = 0;  ///< the file grows no larger; 0: as the disk allows
  };
  /// Throws Error, the file then untouched, when it is not a store, damaged, of a newer dashboard, or another dashboard
  /// has it.
  explicit Store(const Options& options);
  ~Store();
  Store(const Store&) = delete;
  Store& operator=(const Store&) = delete;

  /// Each episode once, in whatever order and however often it comes, all of them in one transaction. Returns how many
  /// were new. What its `acknowledged` says and the store does not have was recorded by others: `lost`, where given,
  /// gets an event for it.
  std::size_t record(std::span<const msg::EpisodeStat> episodes, std::vector<Event>* lost = nullptr);
  /// Up to this episode all of an env_service's are recorded, or will never come.
  std::uint64_t recorded(const Sender& environment);
  /// What an env_service hosts.
  void describe(const msg::TraversalInfo& info);

  /// A run begins or goes on. Episodes that came before it are claimed. Returns true when it was not known in this form
  /// (new, resumed, other options).
  bool heard(const msg::RunInfo& info);
  /// The policy_service said that it ends, and with it the job that it was at.
  void ended(const Sender& policy);
  /// Rows of updates, of the newest process of a job that was heard of; others are left out. A process that goes back
  /// to an older checkpoint takes the place of its predecessors from its first update on. Returns how many it took.
  std::size_t record(std::span<const msg::TrainingStat> stats);
  /// Updates of the job that this process made and that are recorded.
  NumberSet updates(const Sender& policy, std::uint64_t job);
  void record(const Event& event);
  /// Newest first.
  std::vector<Event> events(std::size_t limit);

  enum class Removal { kDone, kUnknown, kRunning };
  /// A run and its episodes, by name. Other writers get their turn in between.
  Removal remove(const std::string& name);

  /// What is known of runs before it is written.
  struct Pulse {
    double last = 0;  ///< heard of it, seconds since 1970
    std::uint64_t updates = 0;
  };
  Pulse pulse(std::int64_t run);
  /// Writes what was only remembered: at once, or what has waited for a few seconds.
  void flush(bool at_once = false);

  const std::string& path() const;

 private:
  struct Inside;
  std::mutex mutex_;
  std::unique_ptr<Inside> inside_;
};

/// Seconds since 1970.
double now_seconds();

}  // namespace citylearn
