#include "dashboard/store.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <set>

#include "dashboard/schema.h"
#include "dashboard/sqlite.h"

namespace citylearn {
namespace {

// Numbers that cannot be: no process lives so long, and SQLite's integers have a sign.
constexpr std::uint64_t kMostEpisodes = std::uint64_t{1} << 62;
constexpr int kUpdateBits = 40;  // of training.key
constexpr std::uint64_t kMostUpdates = (std::uint64_t{1} << kUpdateBits) - 1;

constexpr double kFlushEvery = 5;                    // seconds
constexpr double kSilence = 5;                       // seconds without a RunInfo: the run is not running
constexpr std::uint64_t kClocksDiffer = 10'000'000;  // microseconds, between hosts

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

/// SPL of one episode (score.h of policy_service says the same): Anderson et al. 2018.
double spl_of(const msg::EpisodeStat& episode) {
  if (!episode.completed()) return 0;
  const double longer = std::max(episode.shortest(), episode.steps());
  return longer > 0 ? episode.shortest() / longer : 1;
}

/// Settings of a learner's actors carry the time at which they took charge, not their process's start.
bool has_actors(const std::string& manifest) {
  const nlohmann::json json = nlohmann::json::parse(manifest, nullptr, false);
  return json.is_object() && json.contains("role") && json["role"] == "learner";
}

std::string escaped(const std::string& name) {
  std::string text;
  for (const char c : name) text += c == '/' ? "%2F" : c == '%' ? "%25" : std::string(1, c);
  return text;
}

/// A policy_service's process and the run that it makes now.
struct Process {
  std::int64_t run = 0;
  std::uint64_t last = 0;  // microseconds since 1970
  std::uint64_t updates = 0;
  std::uint64_t message = 0;  // number of its RunInfo
  std::uint64_t least = 0;    // of its updates that are recorded; 0: none is
  bool actors = false;
  bool ended = false;
  std::string agent, learner, manifest;
};

struct Source {
  std::int64_t id = 0;
  NumberSet episodes;  // recorded, here or elsewhere
  bool described = false;
};

}  // namespace

std::string run_name(const std::string& run, const std::string& policy, std::uint64_t seed) {
  return policy.empty() ? escaped(run) : escaped(run) + "/" + escaped(policy) + "/" + std::to_string(seed);
}

double now_seconds() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

struct Store::Inside {
  explicit Inside(const Options& options) : lock(options.path), database(opened(options), Database::Mode::kWrite) {
    prepared(database, options.most_bytes);
    prepare_statements();
    load_processes();
  }

  static const std::string& opened(const Options& options) {
    prepare_file(options.path);
    return options.path;
  }

  using ProcessKey = std::pair<std::uint64_t, std::string>;  // incarnation, policy
  using SourceKey = Sender;

  void prepare_statements();
  void load_processes();
  Source& source(const Sender& environment);
  Process* find(const Sender& policy);
  std::int64_t run_of_settings(const std::string& wire, std::uint64_t incarnation);
  std::int64_t unclaimed(const std::string& wire);
  void claim(const std::string& wire, std::uint64_t incarnation, const Process& process);

  struct Statements {
    explicit Statements(Database& d);
    Statement find_source, add_source, source_episodes, source_progress, describe_source;
    Statement add_episode, add_run_source, count_episodes;
    Statement find_run, add_run, add_unclaimed, find_unclaimed, run_again, run_pulse, run_ended, process, process_pulse;
    Statement claim_exactly, claim_since, claim_sources, count_again;
    Statement add_training, drop_training_from, drop_training_beyond, process_updates, least_update;
    Statement add_event, events;
  };

  Lock lock;
  Database database;
  std::unique_ptr<Statements> statements;
  std::map<std::string, std::map<ProcessKey, Process>> processes;  // by run, as in headers
  std::map<SourceKey, Source> sources;
  std::map<std::pair<std::string, std::uint64_t>, std::int64_t> runs_of_settings;  // run_of_settings(), remembered
  std::map<std::string, std::int64_t> unclaimed_runs;
  std::set<std::pair<std::int64_t, std::int64_t>> run_sources;  // those in the table
  std::map<std::int64_t, std::uint64_t> newest;                 // incarnation, by run
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
                  "INSERT INTO episodes (run, source, episode, settings, version, agent, evaluation, task, "
                  "traversal, policy, \"update\", shuffled, start, goal, steps, shortest, reward, completed, spl, "
                  "recorded, path) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?) "
                  "ON CONFLICT DO NOTHING"),
      add_run_source(d, "INSERT OR IGNORE INTO run_sources (run, source) VALUES (?, ?)"),
      count_episodes(d, "UPDATE runs SET recorded = recorded + ?2, last = MAX(last, ?3) WHERE id = ?1"),
      find_run(d, "SELECT id, incarnation FROM runs WHERE name = ?"),
      add_run(d, "INSERT INTO runs (name, run, policy, seed, started, last) VALUES (?1, ?2, ?3, ?4, ?5, ?5)"),
      add_unclaimed(d, "INSERT INTO runs (name, run, started, last) VALUES (?1, ?2, ?3, ?3)"),
      find_unclaimed(d, "SELECT id FROM runs WHERE run = ? AND policy IS NULL"),
      run_again(d,
                "UPDATE runs SET incarnation = ?2, agent = ?3, learner = ?4, updates = ?5, manifest = ?6, last = ?7, "
                "ended = 0 WHERE id = ?1"),
      run_pulse(d, "UPDATE runs SET last = MAX(last, ?2), updates = ?3 WHERE id = ?1"),
      run_ended(d, "UPDATE runs SET ended = 1, last = MAX(last, ?2) WHERE id = ?1"),
      process(d,
              "INSERT INTO processes (wire, policy, incarnation, run, last, actors, ended) "
              "VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7) ON CONFLICT DO UPDATE SET run = ?4, last = ?5, actors = ?6, "
              "ended = ?7"),
      process_pulse(d,
                    "UPDATE processes SET last = ?4, ended = ?5 WHERE wire = ?1 AND policy = ?2 AND incarnation = ?3"),
      claim_exactly(d, "UPDATE episodes SET run = ?2 WHERE run = ?1 AND settings = ?3"),
      claim_since(d, "UPDATE episodes SET run = ?2 WHERE run = ?1 AND settings >= ?3"),
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
      events(d, "SELECT time, run, service, kind, text FROM events ORDER BY id DESC LIMIT ?") {}

void Store::Inside::prepare_statements() { statements = std::make_unique<Statements>(database); }

void Store::Inside::load_processes() {
  processes.clear();
  runs_of_settings.clear();
  unclaimed_runs.clear();
  run_sources.clear();
  newest.clear();
  Statement runs(database, "SELECT id, incarnation FROM runs");
  while (runs.step()) newest[runs.number(0)] = static_cast<std::uint64_t>(runs.number(1));
  Statement all(
      database,
      "SELECT p.wire, p.policy, p.incarnation, p.run, p.last, p.actors, p.ended, r.updates, r.agent, r.learner, "
      "r.manifest FROM processes p JOIN runs r ON r.id = p.run");
  while (all.step()) {
    Process& process = processes[all.text(0)][{static_cast<std::uint64_t>(all.number(2)), all.text(1)}];
    process.run = all.number(3);
    process.last = static_cast<std::uint64_t>(all.number(4));
    process.actors = all.number(5) != 0;
    process.ended = all.number(6) != 0;
    process.updates = static_cast<std::uint64_t>(all.number(7));
    process.agent = all.text(8);
    process.learner = all.text(9);
    process.manifest = all.text(10);
    Statement& least = statements->least_update;
    least.bind(1, key_of(process.run, 1)).bind(2, key_of(process.run, kMostUpdates)).bind(3, all.number(2));
    if (least.step()) process.least = update_of(least.number(0));
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

Process* Store::Inside::find(const Sender& policy) {
  const auto wire = processes.find(policy.run);
  if (wire == processes.end()) return nullptr;
  const auto process = wire->second.find({policy.incarnation, policy.id});
  return process == wire->second.end() ? nullptr : &process->second;
}

std::int64_t Store::Inside::unclaimed(const std::string& wire) {
  auto [known, fresh] = unclaimed_runs.try_emplace(wire, 0);
  if (!fresh) return known->second;
  Statements& s = *statements;
  s.find_unclaimed.bind(1, wire);
  if (s.find_unclaimed.step()) known->second = s.find_unclaimed.number(0);
  s.find_unclaimed.reset();
  return known->second;
}

/// 0 when nobody claims them and there is no row for those yet.
std::int64_t Store::Inside::run_of_settings(const std::string& wire, std::uint64_t incarnation) {
  const auto known = runs_of_settings.find({wire, incarnation});
  if (known != runs_of_settings.end()) return known->second;
  std::int64_t run = 0;
  if (const auto all = processes.find(wire); all != processes.end() && incarnation > 0) {
    for (const auto& [key, process] : all->second) {
      if (key.first == incarnation) {
        run = process.run;
        break;
      }
      // Whoever started last, as long as it was there.
      if (process.actors && key.first < incarnation && incarnation <= process.last + kClocksDiffer) run = process.run;
    }
  }
  if (run == 0) return unclaimed(wire);
  return runs_of_settings[{wire, incarnation}] = run;
}

void Store::Inside::claim(const std::string& wire, std::uint64_t incarnation, const Process& process) {
  const std::int64_t nobody = unclaimed(wire);
  if (nobody == 0) return;
  Statement& claiming = process.actors ? statements->claim_since : statements->claim_exactly;
  claiming.bind(1, nobody).bind(2, process.run).bind(3, incarnation).run();
  const std::int64_t claimed = database.changes();
  if (claimed == 0) return;
  statements->claim_sources.bind(1, process.run).run();
  statements->count_again.bind(1, process.run).bind(2, claimed).run();
  statements->count_again.bind(1, nobody).bind(2, -claimed).run();
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
        const Event& event = events.back();
        s.add_event.bind(1, event.time)
            .bind(2, event.run)
            .bind(3, event.service)
            .bind(4, event.kind)
            .bind(5, event.text);
        s.add_event.run();
      }
    }
    if (!source.episodes.add(episode.episode())) continue;
    changed = true;
    std::int64_t run = in.run_of_settings(sender.run, episode.settings().incarnation());
    if (run == 0) {
      std::int64_t& made = new_runs[sender.run];
      if (made == 0) {
        const std::string name = run_name(sender.run, "", 0);
        s.add_unclaimed.bind(1, name).bind(2, sender.run).bind(3, now).run();
        made = in.database.last_rowid();
      }
      run = made;
    }
    s.add_episode.bind(1, run)
        .bind(2, source.id)
        .bind(3, episode.episode())
        .bind(4, episode.settings().incarnation())
        .bind(5, episode.settings().version())
        .bind(6, episode.agent())
        .bind(7, episode.evaluation())
        .bind(8, episode.task())
        .bind(9, episode.traversal().c_str())
        .bind(10, episode.policy().c_str())
        .bind(11, episode.update())
        .bind(12, episode.shuffled())
        .bind(13, episode.start())
        .bind(14, episode.goal())
        .bind(15, episode.steps())
        .bind(16, episode.shortest())
        .bind(17, episode.reward())
        .bind(18, episode.completed())
        .bind(19, spl_of(episode))
        .bind(20, now);
    if (episode.steps() == 0) {
      s.add_episode.bind(21, std::string_view());  // nothing done is not nothing known
    } else {
      s.add_episode.bind(21, std::span<const std::uint8_t>(episode.path()));
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
  const auto now_microseconds = static_cast<std::uint64_t>(now * 1e6);
  const std::string name = run_name(sender.run, sender.id, info.seed());
  const std::uint64_t updates = std::min(info.updates(), kMostUpdates);
  s.find_run.bind(1, name);
  std::int64_t run = 0, incarnation = 0;
  if (s.find_run.step()) {
    run = s.find_run.number(0);
    incarnation = s.find_run.number(1);
    s.find_run.reset();
  }
  if (run != 0 && static_cast<std::uint64_t>(incarnation) > sender.incarnation) return false;  // kept for late joiners
  Process* known = in.find(sender);
  if (known && info.header().message() < known->message) return false;
  Process process;
  process.run = run;
  process.message = info.header().message();
  process.last = now_microseconds;
  process.updates = updates;
  process.agent = info.agent().c_str();
  process.learner = info.learner().c_str();
  process.manifest.assign(info.manifest().begin(), info.manifest().end());
  if (known && known->run == run && run != 0) {
    if (known->agent == process.agent && known->learner == process.learner && known->manifest == process.manifest) {
      known->message = process.message;
      known->last = now_microseconds;
      known->updates = std::max(known->updates, updates);
      Pulse& pulse = in.pulses[run];
      pulse.last = now;
      pulse.updates = known->updates;
      in.unwritten.try_emplace(run, now);
      return false;
    }
    process.ended = known->ended;
    process.least = known->least;
  }
  process.actors = has_actors(process.manifest);
  Transaction all(in.database);
  if (run == 0) {
    s.add_run.bind(1, name).bind(2, sender.run).bind(3, sender.id).bind(4, info.seed()).bind(5, now).run();
    process.run = run = in.database.last_rowid();
  }
  s.run_again.bind(1, run)
      .bind(2, sender.incarnation)
      .bind(3, process.agent)
      .bind(4, process.learner)
      .bind(5, updates)
      .bind(6, process.manifest)
      .bind(7, now)
      .run();
  // A process that makes one run after the other has done with the one before.
  if (known && known->run != run) s.run_ended.bind(1, known->run).bind(2, 0.0).run();
  s.process.bind(1, sender.run)
      .bind(2, sender.id)
      .bind(3, sender.incarnation)
      .bind(4, run)
      .bind(5, now_microseconds)
      .bind(6, process.actors)
      .bind(7, process.ended)
      .run();
  if (process.ended) s.run_ended.bind(1, run).bind(2, now).run();
  // It begins with what it has: what its predecessors did beyond that is another story.
  if (static_cast<std::uint64_t>(incarnation) < sender.incarnation)
    s.drop_training_beyond.bind(1, key_of(run, updates)).bind(2, key_of(run, kMostUpdates)).run();
  in.claim(sender.run, sender.incarnation, process);
  all.commit();
  in.processes[sender.run][{sender.incarnation, sender.id}] = process;
  in.newest[run] = sender.incarnation;
  in.runs_of_settings.clear();
  in.run_sources.clear();
  in.pulses[run] = {now, updates};
  in.unwritten.erase(run);
  return true;
}

void Store::ended(const Sender& policy) {
  std::lock_guard lock(mutex_);
  Inside& in = *inside_;
  Process* process = in.find(policy);
  if (!process || process->ended) return;
  Inside::Statements& s = *in.statements;
  const double now = now_seconds();
  Transaction all(in.database);
  s.run_ended.bind(1, process->run).bind(2, now).run();
  s.process_pulse.bind(1, policy.run)
      .bind(2, policy.id)
      .bind(3, policy.incarnation)
      .bind(4, process->last)
      .bind(5, true);
  s.process_pulse.run();
  all.commit();
  process->ended = true;
}

std::size_t Store::record(std::span<const msg::TrainingStat> stats) {
  std::lock_guard lock(mutex_);
  Inside& in = *inside_;
  Inside::Statements& s = *in.statements;
  std::size_t taken = 0;
  std::map<Sender, std::uint64_t> leasts;  // of those who sent some
  Transaction all(in.database);
  for (const msg::TrainingStat& stat : stats) {
    if (stat.update() == 0 || stat.update() > kMostUpdates) continue;
    const Sender sender(stat.header());
    const Process* process = in.find(sender);
    if (!process || in.newest[process->run] != sender.incarnation) continue;
    const std::int64_t key = key_of(process->run, stat.update());
    std::uint64_t& least = leasts.try_emplace(sender, process->least).first->second;
    if (least == 0 || stat.update() < least) {
      // From here on the story is this process's.
      s.drop_training_from.bind(1, key).bind(2, key_of(process->run, kMostUpdates)).bind(3, sender.incarnation).run();
      least = stat.update();
    }
    s.add_training.bind(1, key)
        .bind(2, sender.incarnation)
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
        .bind(13, stat.divergence())
        .bind(14, stat.clipped())
        .bind(15, stat.gradient_norm())
        .bind(16, stat.learning_rate())
        .bind(17, stat.lag())
        .run();
    ++taken;
  }
  all.commit();
  for (const auto& [sender, least] : leasts) in.find(sender)->least = least;
  return taken;
}

NumberSet Store::updates(const Sender& policy) {
  std::lock_guard lock(mutex_);
  NumberSet updates;
  const Process* process = inside_->find(policy);
  if (!process) return updates;
  Statement& all = inside_->statements->process_updates;
  all.bind(1, key_of(process->run, 1)).bind(2, key_of(process->run, kMostUpdates)).bind(3, policy.incarnation);
  while (all.step()) updates.add(update_of(all.number(0)));
  return updates;
}

void Store::record(const Event& event) {
  std::lock_guard lock(mutex_);
  Statement& add = inside_->statements->add_event;
  add.bind(1, event.time).bind(2, event.run).bind(3, event.service).bind(4, event.kind).bind(5, event.text).run();
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
  {
    std::lock_guard lock(mutex_);
    Inside& in = *inside_;
    Statement found(in.database, "SELECT id, ended, last FROM runs WHERE name = ?");
    if (!found.bind(1, name).step()) return Removal::kUnknown;
    run = found.number(0);
    const double last = std::max(found.real(2), in.pulses[run].last);
    if (found.number(1) == 0 && now_seconds() - last < kSilence) return Removal::kRunning;
  }
  in_slices("DELETE FROM episodes WHERE id IN (SELECT id FROM episodes WHERE run = ? LIMIT ?)");
  in_slices(
      "DELETE FROM training WHERE key IN (SELECT key FROM training WHERE key BETWEEN (?1 << 40) AND ((?1 + 1) << 40) - "
      "1 "
      "LIMIT ?2)");
  std::lock_guard lock(mutex_);
  Inside& in = *inside_;
  // Goes on after all: then what is left of it stays.
  if (now_seconds() - in.pulses[run].last < kSilence) return Removal::kRunning;
  Transaction all(in.database);
  Statement(in.database, "DELETE FROM runs WHERE id = ?").bind(1, run).run();
  all.commit();
  in.pulses.erase(run);
  in.unwritten.erase(run);
  in.load_processes();
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
  for (const auto& [wire, list] : in.processes)
    for (const auto& [key, process] : list)
      if (in.unwritten.contains(process.run) && in.newest[process.run] == key.first) {
        in.statements->process_pulse.bind(1, wire).bind(2, key.second).bind(3, key.first).bind(4, process.last);
        in.statements->process_pulse.bind(5, process.ended).run();
      }
  all.commit();
  in.unwritten.clear();
}

}  // namespace citylearn
