// SPDX-License-Identifier: Apache-2.0
#include "dashboard/store/store.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <set>

#include "core/task/spl.h"
#include "dashboard/store/schema.h"
#include "dashboard/store/sqlite.h"

namespace citylearn {
namespace {

// Numbers that cannot be: no process lives so long, and SQLite's integers have a sign.
constexpr std::uint64_t kMostEpisodes = std::uint64_t{1} << 62;
constexpr int kUpdateBits = 40;  // of training.key
constexpr std::uint64_t kMostUpdates = (std::uint64_t{1} << kUpdateBits) - 1;

constexpr std::int64_t kMostEvents = 100'000;  // older ones go
constexpr double kFlushEvery = 5;              // seconds
constexpr double kSilence = 5;                 // seconds without a RunInfo: the run is not running

std::int64_t key_of(std::int64_t run, std::uint64_t update) {
  return (run << kUpdateBits) + static_cast<std::int64_t>(update);
}

std::uint64_t update_of(std::int64_t key) { return static_cast<std::uint64_t>(key) & kMostUpdates; }

/// The one dashboard of a file. A file of its own: closing any descriptor of the database would drop SQLite's locks.
class Lock {
 public:
  explicit Lock(const std::string& path) {
    const std::string name = path + ".lock";
    file_ = ::open(name.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    if (file_ < 0) throw Error(std::strerror(errno), name, "choose a store in a folder that can be written");
    if (::flock(file_, LOCK_EX | LOCK_NB) != 0) {
      const int fault = errno;
      ::close(file_);
      if (fault == EWOULDBLOCK) throw Error("another dashboard records here", path, "end it, or choose another file");
      throw Error(std::strerror(fault), name, "choose a store on a local disk");
    }
  }
  ~Lock() { ::close(file_); }
  Lock(const Lock&) = delete;
  Lock& operator=(const Lock&) = delete;

 private:
  int file_;
};

Database& prepared(Database& database, std::uint64_t most_bytes) {
  // Readers go on while the writer writes; a commit is on the disk when it returns.
  database.execute(
      "PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA foreign_keys = ON; PRAGMA cache_size = -16000;"
      "PRAGMA journal_size_limit = 67108864");
  if (most_bytes > 0) {
    const auto page = static_cast<std::uint64_t>(database.number("PRAGMA page_size"));
    database.number("PRAGMA max_page_count = " + std::to_string(std::max<std::uint64_t>(1, most_bytes / page)));
  }
  return database;
}

std::string escaped(const std::string& name) {
  std::string text;
  for (const char c : name) text += c == '/' ? "%2F" : c == '%' ? "%25" : std::string(1, c);
  return text;
}

/// A run, as far as new messages are compared with it.
struct Job {
  std::int64_t run = 0;
  std::string policy;
  std::uint64_t incarnation = 0;  // newest process that told of it
  std::uint64_t message = 0;      // number of its newest RunInfo
  std::uint64_t updates = 0;
  std::uint64_t least = 0;  // of that process's updates that are recorded; 0: none is
  bool ended = false;
  std::string agent, learner, manifest;
};

struct Source {
  std::int64_t id = 0;
  NumberSet episodes;  // recorded, here or elsewhere
  bool described = false;
};

}  // namespace

std::string run_id(const msg::RunInfo& info) {
  return escaped(info.header().session().c_str()) + "/" + escaped(info.header().sender().c_str()) + "/" +
         std::to_string(info.seed()) + "/" + std::to_string(info.run_id());
}

std::string run_id(const std::string& run) { return escaped(run); }

double now_seconds() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

struct Store::Inside {
  explicit Inside(const Options& options) : lock(options.path), database(opened(options), Database::Mode::kWrite) {
    prepared(database, options.most_bytes);
    statements = std::make_unique<Statements>(database);
    load_jobs();
  }

  static const std::string& opened(const Options& options) {
    prepare_file(options.path);
    return options.path;
  }

  using JobKey = std::pair<std::string, std::uint64_t>;  // run, as in headers, and job

  void load_jobs();
  Source& source(const Sender& environment);
  Job* find(const std::string& run, std::uint64_t job);
  std::int64_t unclaimed(const std::string& run);
  void claim(const std::string& run, std::uint64_t number, const Job& job);
  void add(const Event& event);

  struct Statements {
    explicit Statements(Database& d);
    Statement find_source, add_source, source_episodes, source_progress, describe_source;
    Statement add_episode, add_run_source, count_episodes;
    Statement add_run, add_unclaimed, find_unclaimed, run_again, run_pulse, run_ended;
    Statement claim_episodes, claim_sources, count_again;
    Statement add_training, drop_training_from, drop_training_beyond, process_updates, least_update;
    Statement add_event, drop_events, events;
  };

  Lock lock;
  Database database;
  std::unique_ptr<Statements> statements;
  std::map<JobKey, Job> jobs;
  std::map<Sender, Source> sources;
  std::map<std::string, std::int64_t> unclaimed_runs;
  std::set<std::pair<std::int64_t, std::int64_t>> run_sources;  // those in the table
  std::map<std::int64_t, Pulse> pulses;
  std::map<std::int64_t, double> unwritten;  // runs whose pulse is newer than the file's, since
};

Store::Inside::Statements::Statements(Database& d)
    : find_source(d,
                  "SELECT id, contiguous, dataset IS NOT NULL FROM sources WHERE run = ? AND environment = ? AND "
                  "incarnation = ?"),
      add_source(d, "INSERT INTO sources (run, environment, incarnation) VALUES (?, ?, ?)"),
      source_episodes(d, "SELECT episode FROM episodes WHERE source = ? AND episode > ? ORDER BY episode"),
      source_progress(d, "UPDATE sources SET contiguous = ?2, missed = missed + ?3 WHERE id = ?1"),
      describe_source(d,
                      "UPDATE sources SET dataset = ?, traversal = ?, condition = ?, hash = ?, frames = ?, "
                      "agents = ?, images = ? WHERE id = ?"),
      add_episode(d,
                  "INSERT INTO episodes (run, source, episode, job, agent, evaluation, task, "
                  "traversal, policy, \"update\", shuffled, start, goal, steps, shortest, reward, completed, spl, "
                  "recorded, path) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?) "
                  "ON CONFLICT DO NOTHING"),
      add_run_source(d, "INSERT OR IGNORE INTO run_sources (run, source) VALUES (?, ?)"),
      count_episodes(d, "UPDATE runs SET recorded = recorded + ?2, last = MAX(last, ?3) WHERE id = ?1"),
      add_run(d, "INSERT INTO runs (name, run, job, policy, seed, started, last) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?6)"),
      add_unclaimed(d, "INSERT INTO runs (name, run, started, last) VALUES (?1, ?2, ?3, ?3)"),
      find_unclaimed(d, "SELECT id FROM runs WHERE run = ? AND job IS NULL"),
      run_again(d,
                "UPDATE runs SET incarnation = ?2, agent = ?3, learner = ?4, updates = ?5, manifest = ?6, last = ?7, "
                "ended = ?8 WHERE id = ?1"),
      run_pulse(d, "UPDATE runs SET last = MAX(last, ?2), updates = ?3 WHERE id = ?1"),
      run_ended(d, "UPDATE runs SET ended = 1, last = MAX(last, ?2) WHERE id = ?1"),
      claim_episodes(d, "UPDATE episodes SET run = ?2 WHERE run = ?1 AND job = ?3"),
      claim_sources(d, "INSERT OR IGNORE INTO run_sources SELECT DISTINCT run, source FROM episodes WHERE run = ?"),
      count_again(d, "UPDATE runs SET recorded = recorded + ?2 WHERE id = ?1"),
      add_training(d,
                   "INSERT INTO training (key, incarnation, steps, episodes, wall, lesson, reward, spl, "
                   "steps_per_second, policy_loss, value_loss, entropy, divergence, clipped, gradient_norm, "
                   "learning_rate, lag) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?) "
                   "ON CONFLICT DO NOTHING"),
      drop_training_from(d, "DELETE FROM training WHERE key BETWEEN ?1 AND ?2 AND incarnation <> ?3"),
      drop_training_beyond(d, "DELETE FROM training WHERE key > ?1 AND key <= ?2"),
      process_updates(d, "SELECT key FROM training WHERE key BETWEEN ?1 AND ?2 AND incarnation = ?3 ORDER BY key"),
      least_update(d, "SELECT key FROM training WHERE key BETWEEN ?1 AND ?2 AND incarnation = ?3 ORDER BY key LIMIT 1"),
      add_event(d, "INSERT INTO events (time, run, service, kind, text) VALUES (?, ?, ?, ?, ?)"),
      drop_events(d, "DELETE FROM events WHERE id <= ?"),
      events(d, "SELECT time, run, service, kind, text FROM events ORDER BY id DESC LIMIT ?") {}

void Store::Inside::load_jobs() {
  jobs.clear();
  unclaimed_runs.clear();
  run_sources.clear();
  Statement all(database,
                "SELECT run, job, id, policy, incarnation, updates, ended, agent, learner, manifest FROM runs "
                "WHERE job IS NOT NULL");
  while (all.step()) {
    Job& job = jobs[{all.text(0), static_cast<std::uint64_t>(all.number(1))}];
    job.run = all.number(2);
    job.policy = all.text(3);
    job.incarnation = static_cast<std::uint64_t>(all.number(4));
    job.updates = static_cast<std::uint64_t>(all.number(5));
    job.ended = all.number(6) != 0;
    job.agent = all.text(7);
    job.learner = all.text(8);
    job.manifest = all.text(9);
    Statement& least = statements->least_update;
    least.bind(1, key_of(job.run, 1)).bind(2, key_of(job.run, kMostUpdates)).bind(3, job.incarnation);
    if (least.step()) job.least = update_of(least.number(0));
    least.reset();
  }
}

Source& Store::Inside::source(const Sender& environment) {
  const auto known = sources.find(environment);
  if (known != sources.end()) return known->second;
  Source source;
  Statements& s = *statements;
  s.find_source.bind(1, environment.run).bind(2, environment.id).bind(3, environment.incarnation);
  if (s.find_source.step()) {
    source.id = s.find_source.number(0);
    source.episodes.add(1, static_cast<std::uint64_t>(s.find_source.number(1)));
    source.described = s.find_source.number(2) != 0;
    s.find_source.reset();
    s.source_episodes.bind(1, source.id).bind(2, source.episodes.reach());
    while (s.source_episodes.step()) source.episodes.add(static_cast<std::uint64_t>(s.source_episodes.number(0)));
  }
  return sources.emplace(environment, std::move(source)).first->second;
}

Job* Store::Inside::find(const std::string& run, std::uint64_t job) {
  const auto known = jobs.find({run, job});
  return known == jobs.end() ? nullptr : &known->second;
}

/// 0 when there is no row for it yet.
std::int64_t Store::Inside::unclaimed(const std::string& run) {
  auto [known, fresh] = unclaimed_runs.try_emplace(run, 0);
  if (!fresh) return known->second;
  Statements& s = *statements;
  s.find_unclaimed.bind(1, run);
  if (s.find_unclaimed.step()) known->second = s.find_unclaimed.number(0);
  s.find_unclaimed.reset();
  return known->second;
}

/// Episodes may come before their RunInfo.
void Store::Inside::claim(const std::string& run, std::uint64_t number, const Job& job) {
  const std::int64_t nobody = unclaimed(run);
  if (nobody == 0) return;
  statements->claim_episodes.bind(1, nobody).bind(2, job.run).bind(3, number).run();
  const std::int64_t claimed = database.changes();
  if (claimed == 0) return;
  statements->claim_sources.bind(1, job.run).run();
  statements->count_again.bind(1, job.run).bind(2, claimed).run();
  statements->count_again.bind(1, nobody).bind(2, -claimed).run();
}

void Store::Inside::add(const Event& event) {
  Statement& s = statements->add_event;
  s.bind(1, event.time).bind(2, event.run).bind(3, event.service).bind(4, event.kind).bind(5, event.text).run();
  statements->drop_events.bind(1, database.last_rowid() - kMostEvents).run();
}

Store::Store(const Options& options) : inside_(std::make_unique<Inside>(options)) {}
Store::~Store() = default;

const std::string& Store::path() const { return inside_->database.path(); }

std::size_t Store::record(std::span<const msg::EpisodeStat> episodes, std::vector<Event>* lost) {
  std::lock_guard lock(mutex_);
  Inside& in = *inside_;
  Inside::Statements& s = *in.statements;
  const double now = now_seconds();
  // What is remembered changes when the file has: first all happens to copies.
  struct Change {
    Source source;
    std::uint64_t missed = 0;
    bool fresh = false;
  };
  std::map<Sender, Change> changes;
  std::map<std::int64_t, std::int64_t> counts;  // new episodes, by run
  std::map<std::string, std::int64_t> new_runs;
  std::set<std::pair<std::int64_t, std::int64_t>> new_run_sources;
  std::vector<Event> events;
  std::size_t fresh = 0;
  Transaction all(in.database);
  for (const msg::EpisodeStat& episode : episodes) {
    if (episode.episode() == 0 || episode.episode() > kMostEpisodes || episode.acknowledged() >= kMostEpisodes)
      continue;
    const Sender sender(episode.header());
    auto found = changes.find(sender);
    if (found == changes.end()) found = changes.emplace(sender, Change{in.source(sender)}).first;
    auto& [source, missed, changed] = found->second;
    if (source.id == 0) {
      s.add_source.bind(1, sender.run).bind(2, sender.id).bind(3, sender.incarnation).run();
      source.id = in.database.last_rowid();
    }
    if (const std::uint64_t given_up = episode.acknowledged(); given_up > source.episodes.reach()) {
      // Others recorded these, and the env_service has forgotten them since.
      const std::uint64_t first = source.episodes.reach() + 1;
      const std::uint64_t number = given_up - first + 1 - source.episodes.count(first, given_up);
      source.episodes.add(first, given_up);
      changed = true;
      if (number > 0) {
        missed += number;
        events.push_back({now, sender.run, sender.id, "alarm",
                          std::to_string(number) + " episodes up to number " + std::to_string(given_up) +
                              " were recorded by others alone, before this dashboard was known to " + sender.id});
        in.add(events.back());
      }
    }
    if (!source.episodes.add(episode.episode())) continue;
    changed = true;
    const Job* job = in.find(sender.run, episode.run_id());
    std::int64_t run = job ? job->run : in.unclaimed(sender.run);
    if (run == 0) {
      std::int64_t& made = new_runs[sender.run];
      if (made == 0) {
        const std::string name = run_id(sender.run);
        s.add_unclaimed.bind(1, name).bind(2, sender.run).bind(3, now).run();
        made = in.database.last_rowid();
      }
      run = made;
    }
    s.add_episode.bind(1, run)
        .bind(2, source.id)
        .bind(3, episode.episode())
        .bind(4, episode.run_id())
        .bind(5, episode.agent())
        .bind(6, episode.evaluation())
        .bind(7, episode.task())
        .bind(8, episode.traversal().c_str())
        .bind(9, episode.policy().c_str())
        .bind(10, episode.update())
        .bind(11, episode.shuffled())
        .bind(12, episode.start())
        .bind(13, episode.goal())
        .bind(14, episode.steps())
        .bind(15, episode.shortest())
        .bind(16, episode.reward())
        .bind(17, episode.completed())
        .bind(18, spl_of(episode.completed(), episode.shortest(), episode.steps()))
        .bind(19, now);
    if (episode.steps() == 0) {
      s.add_episode.bind(20, std::string_view());  // nothing done is not nothing known
    } else {
      s.add_episode.bind(20, std::span<const std::uint8_t>(episode.path()));
    }
    s.add_episode.run();
    if (in.database.changes() == 0) continue;
    ++fresh;
    ++counts[run];
    if (const std::pair pair(run, source.id); !in.run_sources.contains(pair) && new_run_sources.insert(pair).second)
      s.add_run_source.bind(1, run).bind(2, source.id).run();
  }
  for (const auto& [run, count] : counts) s.count_episodes.bind(1, run).bind(2, count).bind(3, now).run();
  for (const auto& [sender, change] : changes)
    if (change.fresh)
      s.source_progress.bind(1, change.source.id).bind(2, change.source.episodes.reach()).bind(3, change.missed).run();
  all.commit();
  for (auto& [sender, change] : changes) in.sources[sender] = std::move(change.source);
  for (const auto& [wire, run] : new_runs) in.unclaimed_runs[wire] = run;
  in.run_sources.merge(new_run_sources);
  for (const auto& [run, count] : counts) in.pulses[run].last = std::max(in.pulses[run].last, now);
  if (lost) lost->insert(lost->end(), events.begin(), events.end());
  return fresh;
}

std::uint64_t Store::recorded(const Sender& environment) {
  std::lock_guard lock(mutex_);
  return inside_->source(environment).episodes.reach();
}

void Store::describe(const msg::TraversalInfo& info) {
  std::lock_guard lock(mutex_);
  Inside& in = *inside_;
  const Sender sender(info.header());
  Source source = in.source(sender);
  if (source.described) return;
  Inside::Statements& s = *in.statements;
  Transaction all(in.database);
  if (source.id == 0) {
    s.add_source.bind(1, sender.run).bind(2, sender.id).bind(3, sender.incarnation).run();
    source.id = in.database.last_rowid();
  }
  s.describe_source.bind(1, info.dataset().c_str())
      .bind(2, info.traversal().c_str())
      .bind(3, info.condition().c_str())
      .bind(4, info.hash())
      .bind(5, info.frames())
      .bind(6, info.agents())
      .bind(7, info.images())
      .bind(8, source.id)
      .run();
  all.commit();
  source.described = true;
  in.sources[sender] = std::move(source);
}

bool Store::heard(const msg::RunInfo& info) {
  std::lock_guard lock(mutex_);
  Inside& in = *inside_;
  Inside::Statements& s = *in.statements;
  const Sender sender(info.header());
  const double now = now_seconds();
  Job* known = in.find(sender.run, info.run_id());
  // Kept for late joiners by its predecessor, or overtaken on the way.
  if (known && std::pair(sender.incarnation, info.header().message()) <= std::pair(known->incarnation, known->message))
    return false;
  Job job;
  if (known) job = *known;
  const bool successor = !known || known->incarnation != sender.incarnation;
  job.policy = sender.id;
  job.incarnation = sender.incarnation;
  job.message = info.header().message();
  job.updates = std::min(info.updates(), kMostUpdates);
  job.agent = info.agent().c_str();
  job.learner = info.learner().c_str();
  job.manifest.assign(info.manifest().begin(), info.manifest().end());
  job.ended = info.ended() || (job.ended && !successor);
  if (successor) job.least = 0;
  if (!successor && job.agent == known->agent && job.learner == known->learner && job.manifest == known->manifest &&
      job.ended == known->ended) {
    *known = std::move(job);
    in.pulses[known->run] = {now, known->updates};
    in.unwritten.try_emplace(known->run, now);
    return false;
  }
  Transaction all(in.database);
  if (!known) {
    const std::string name = run_id(info);
    s.add_run.bind(1, name)
        .bind(2, sender.run)
        .bind(3, info.run_id())
        .bind(4, sender.id)
        .bind(5, info.seed())
        .bind(6, now);
    s.add_run.run();
    job.run = in.database.last_rowid();
  }
  s.run_again.bind(1, job.run)
      .bind(2, job.incarnation)
      .bind(3, job.agent)
      .bind(4, job.learner)
      .bind(5, job.updates)
      .bind(6, job.manifest)
      .bind(7, now)
      .bind(8, job.ended)
      .run();
  // It begins with what it has: what its predecessors did beyond that is another story.
  if (successor && known)
    s.drop_training_beyond.bind(1, key_of(job.run, job.updates)).bind(2, key_of(job.run, kMostUpdates)).run();
  if (!known) in.claim(sender.run, info.run_id(), job);
  all.commit();
  in.run_sources.clear();
  in.pulses[job.run] = {now, job.updates};
  in.unwritten.erase(job.run);
  in.jobs[{sender.run, info.run_id()}] = std::move(job);
  return true;
}

void Store::ended(const Sender& policy) {
  std::lock_guard lock(mutex_);
  Inside& in = *inside_;
  for (auto& [key, job] : in.jobs) {
    if (job.ended || key.first != policy.run || job.policy != policy.id || job.incarnation != policy.incarnation)
      continue;
    in.statements->run_ended.bind(1, job.run).bind(2, now_seconds()).run();
    job.ended = true;
  }
}

std::size_t Store::record(std::span<const msg::TrainingStat> stats) {
  std::lock_guard lock(mutex_);
  Inside& in = *inside_;
  Inside::Statements& s = *in.statements;
  std::size_t taken = 0;
  std::map<Job*, std::uint64_t> leasts;  // of those who sent some
  Transaction all(in.database);
  for (const msg::TrainingStat& stat : stats) {
    if (stat.update() == 0 || stat.update() > kMostUpdates) continue;
    Job* job = in.find(stat.header().session().c_str(), stat.run_id());
    if (!job || job->incarnation != stat.header().incarnation()) continue;
    const std::int64_t key = key_of(job->run, stat.update());
    std::uint64_t& least = leasts.try_emplace(job, job->least).first->second;
    if (least == 0 || stat.update() < least) {
      // From here on the story is this process's.
      s.drop_training_from.bind(1, key).bind(2, key_of(job->run, kMostUpdates)).bind(3, job->incarnation).run();
      least = stat.update();
    }
    s.add_training.bind(1, key)
        .bind(2, job->incarnation)
        .bind(3, stat.steps())
        .bind(4, stat.episodes())
        .bind(5, stat.wall())
        .bind(6, stat.lesson())
        .bind(7, stat.reward())
        .bind(8, stat.spl())
        .bind(9, stat.steps_per_second())
        .bind(10, stat.policy_loss())
        .bind(11, stat.value_loss())
        .bind(12, stat.entropy())
        .bind(13, stat.approx_kl())
        .bind(14, stat.clip_fraction())
        .bind(15, stat.gradient_norm())
        .bind(16, stat.learning_rate())
        .bind(17, stat.policy_lag())
        .run();
    ++taken;
  }
  all.commit();
  for (const auto& [job, least] : leasts) job->least = least;
  return taken;
}

NumberSet Store::updates(const Sender& policy, std::uint64_t number) {
  std::lock_guard lock(mutex_);
  NumberSet updates;
  const Job* job = inside_->find(policy.run, number);
  if (!job) return updates;
  Statement& all = inside_->statements->process_updates;
  all.bind(1, key_of(job->run, 1)).bind(2, key_of(job->run, kMostUpdates)).bind(3, policy.incarnation);
  while (all.step()) updates.add(update_of(all.number(0)));
  return updates;
}

void Store::record(const Event& event) {
  std::lock_guard lock(mutex_);
  Inside& in = *inside_;
  Transaction all(in.database);
  in.add(event);
  all.commit();
}

std::vector<Event> Store::events(std::size_t limit) {
  std::lock_guard lock(mutex_);
  std::vector<Event> events;
  Statement& all = inside_->statements->events;
  all.bind(1, static_cast<std::int64_t>(limit));
  while (all.step()) events.push_back({all.real(0), all.text(1), all.text(2), all.text(3), all.text(4)});
  return events;
}

Store::Removal Store::remove(const std::string& name) {
  std::int64_t run = 0;
  const auto in_slices = [&](const char* sql) {
    // A transaction of a million rows would keep everybody waiting.
    constexpr std::int64_t kSlice = 4000;
    for (std::int64_t changes = kSlice; changes == kSlice;) {
      std::lock_guard lock(mutex_);
      Statement slice(inside_->database, sql);
      slice.bind(1, run).bind(2, kSlice).run();
      changes = inside_->database.changes();
    }
  };
  const auto running = [&] {
    Inside& in = *inside_;
    Statement row(in.database, "SELECT ended, last FROM runs WHERE id = ?");
    row.bind(1, run);
    const auto pulse = in.pulses.find(run);
    return row.step() && row.number(0) == 0 &&
           now_seconds() - std::max(row.real(1), pulse == in.pulses.end() ? 0 : pulse->second.last) < kSilence;
  };
  {
    std::lock_guard lock(mutex_);
    Statement found(inside_->database, "SELECT id FROM runs WHERE name = ?");
    if (!found.bind(1, name).step()) return Removal::kUnknown;
    run = found.number(0);
    if (running()) return Removal::kRunning;
  }
  in_slices("DELETE FROM episodes WHERE id IN (SELECT id FROM episodes WHERE run = ? LIMIT ?)");
  in_slices(
      "DELETE FROM training WHERE key IN (SELECT key FROM training WHERE key BETWEEN (?1 << 40) AND ((?1 + 1) << 40) - "
      "1 "
      "LIMIT ?2)");
  std::lock_guard lock(mutex_);
  Inside& in = *inside_;
  if (running()) return Removal::kRunning;  // it goes on after all: then what is left of it stays
  Transaction all(in.database);
  Statement(in.database, "DELETE FROM episodes WHERE run = ?").bind(1, run).run();  // that came meanwhile
  Statement(in.database, "DELETE FROM training WHERE key BETWEEN (?1 << 40) AND ((?1 + 1) << 40) - 1")
      .bind(1, run)
      .run();
  Statement(in.database, "DELETE FROM runs WHERE id = ?").bind(1, run).run();
  all.commit();
  in.pulses.erase(run);
  in.unwritten.erase(run);
  in.load_jobs();
  return Removal::kDone;
}

Store::Pulse Store::pulse(std::int64_t run) {
  std::lock_guard lock(mutex_);
  const auto known = inside_->pulses.find(run);
  return known == inside_->pulses.end() ? Pulse{} : known->second;
}

void Store::flush(bool at_once) {
  std::lock_guard lock(mutex_);
  Inside& in = *inside_;
  const double now = now_seconds();
  bool due = at_once && !in.unwritten.empty();
  for (const auto& [run, since] : in.unwritten) due = due || now - since >= kFlushEvery || since > now;
  if (!due) return;
  Transaction all(in.database);
  for (const auto& [run, since] : in.unwritten) {
    const Pulse& pulse = in.pulses[run];
    in.statements->run_pulse.bind(1, run).bind(2, pulse.last).bind(3, pulse.updates).run();
  }
  all.commit();
  in.unwritten.clear();
}

}  // namespace citylearn
