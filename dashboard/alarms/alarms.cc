// SPDX-License-Identifier: Apache-2.0
#include "dashboard/alarms/alarms.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <condition_variable>
#include <map>
#include <set>
#include <thread>
#include <utility>

#include "core/metrics/exposition.h"
#include "core/task/training_figures.h"
#include "core/util/error.h"
#include "core/util/text.h"
#include "dashboard/store/database.h"
#include "dashboard/store/store_impl.h"

namespace citylearn {
namespace {

using When = AlarmRule::When;

constexpr std::int64_t kPointsAtOnce = 100'000;  // of one rule and run; the rest is read at the next look
constexpr double kEarlier = 60;                  // seconds before a rule was made in which its runs were heard of
constexpr double kFlushEvery = 5;                // seconds
constexpr int kAlarmsListed = 200, kAlarmsKept = 10'000;
constexpr std::size_t kFiguresNamed = 6;

}  // namespace

struct Alarms::Impl {
  /// A run, as far as rules look at it.
  struct WatchedRun {
    std::int64_t row = 0;
    std::string name, session, tags;
    bool logged = false, ended = false;
    double started = 0, last = 0;
    std::uint64_t updates = 0;
  };

  /// How far a rule has looked at a run.
  struct Progress {
    std::int64_t newest = 0;    // update or record
    std::int64_t streak = 0;    // points in succession that fit the rule; negative: that do not
    double begin = 0;           // step of the first of them
    double moved = 0;           // when a new point was seen last
    std::uint64_t updates = 0;  // of the run, when it was looked at
    bool ended = false;         // likewise
    std::int64_t alarm = 0;     // that was raised and whose cause is there; 0: none
    // Of this process alone:
    bool raised = false;      // whether the alarm lasts, once all changes are written
    bool fresh = false;       // the rule has not looked at this run before
    bool dirty = false;       // differs from the store
    double started = 0;       // of the run
    bool raised_now = false;  // in this look
    std::int64_t metric = 0;  // row of `metrics`
  };

  /// A change that is not in the store yet.
  struct Change {
    const AlarmRule* rule = nullptr;
    const WatchedRun* run = nullptr;
    Progress* progress = nullptr;
    bool raised = false;
    std::string text;
  };

  Impl(Alarms& alarms, Store& records, Options given)
      : owner(alarms), store(records), options(std::move(given)), reader(open_database(records.path())), begun(now()) {
    with_file_errors(store.path(), [&] {
      SQLite::Statement all(
          reader,
          "SELECT id, runs, \"when\", figure, value, points, steps, minutes, created FROM alarm_rules ORDER BY id");
      while (all.executeStep()) {
        AlarmRule rule;
        std::string when;
        read_row(all, rule.id, rule.runs, when, rule.figure, rule.value, rule.points, rule.steps, rule.minutes,
                 rule.created);
        rule.when = when_of(when).value_or(When::kLost);
        rules.push_back(std::move(rule));
      }
    });
    if (options.period.count() > 0) thread = std::jthread([this](const std::stop_token& stop) { work(stop); });
  }

  double now() const { return options.now ? options.now() : seconds_since_epoch(); }

  void work(const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      poll();
      std::unique_lock guard(pause_mutex);
      pause.wait_for(guard, stop, options.period, [] { return false; });
    }
  }

  /// Looks at what is new for one rule, or for all.
  void poll(std::optional<std::int64_t> only = std::nullopt) {
    std::vector<Event> events;
    {
      const std::lock_guard guard(mutex);
      if (rules.empty()) return;
      try {
        events = with_file_errors(store.path(), [&] { return look(only); });
        failing = false;
      } catch (const Error& error) {
        // What the store has is where the next look begins. The recorder reports a full disk as an alarm of its own.
        progress.clear();
        changes.clear();
        if (!std::exchange(failing, true)) spdlog::warn("alarms of runs: {}", error.what());
      }
    }
    for (const Event& event : events) {
      spdlog::info("alarm: {}: {}", event.service, event.text);
      if (options.on_event) options.on_event(event);
    }
    if (!events.empty()) tell_change();
  }

  void tell_change() {
    try {
      if (options.on_change) options.on_change(owner);
    } catch (const Error& error) {
      spdlog::warn("alarms of runs: {}", error.what());
    }
  }

  /// Returns the events that it has written.
  std::vector<Event> look(std::optional<std::int64_t> only) {
    const double time = now();
    const std::vector<WatchedRun> runs = watched_runs();
    std::set<std::int64_t> rows;
    for (const WatchedRun& run : runs) rows.insert(run.row);
    std::erase_if(progress, [&](const auto& entry) { return !rows.contains(entry.first.second); });
    for (const AlarmRule& rule : rules)
      if (rule.id == only.value_or(rule.id))
        for (const WatchedRun& run : runs)
          if (run.last >= rule.created - kEarlier && watches(rule, run.name, run.tags)) look(rule, run, time);
    const bool dirty = std::any_of(progress.begin(), progress.end(), [](const auto& one) { return one.second.dirty; });
    if (changes.empty() && !(dirty && time >= next_flush)) return {};
    return write(time);
  }

  std::vector<WatchedRun> watched_runs() {
    double oldest = rules.front().created;
    for (const AlarmRule& rule : rules) oldest = std::min(oldest, rule.created);
    std::vector<WatchedRun> runs;
    SQLite::Statement all(reader,
                          "SELECT id, name, session, tags, source <> '', ended, started, last, updates FROM runs "
                          "WHERE policy IS NOT NULL OR source <> ''");
    while (all.executeStep()) {
      WatchedRun run;
      read_row(all, run.row, run.name, run.session, run.tags, run.logged, run.ended, run.started, run.last,
               run.updates);
      const Store::Liveness liveness = store.liveness(run.row);
      run.last = std::max(run.last, liveness.last);
      run.updates = std::max(run.updates, liveness.updates);
      if (run.last >= oldest - kEarlier) runs.push_back(std::move(run));
    }
    return runs;
  }

  Progress& progress_of(const AlarmRule& rule, const WatchedRun& run, double time) {
    const std::pair key(rule.id, run.row);
    const auto old = progress.find(key);
    // The row of a run that was removed may be another run's by now.
    if (old != progress.end() && old->second.started != run.started) progress.erase(old);
    const auto [found, unknown] = progress.try_emplace(key);
    Progress& known = found->second;
    if (!unknown) return known;
    known.started = run.started;
    known.moved = time;
    known.updates = run.updates;
    SQLite::Statement stored(reader,
                             "SELECT newest, streak, begin, moved, updates, ended, alarm FROM alarm_progress "
                             "WHERE rule = ? AND run = ?");
    known.fresh = known.dirty = !bind_values(stored, rule.id, run.row).executeStep();
    if (!known.fresh)
      read_row(stored, known.newest, known.streak, known.begin, known.moved, known.updates, known.ended, known.alarm);
    known.raised = known.alarm != 0;
    return known;
  }

  void look(const AlarmRule& rule, const WatchedRun& run, double time) {
    Progress& seen = progress_of(rule, run, time);
    const bool same = !seen.fresh && seen.updates == run.updates && seen.ended == run.ended;
    // A training's updates are counted before all of them have come.
    if (same && (run.ended || run.logged) && (counts_points(rule) || (run.ended && !seen.raised))) return;
    seen.raised_now = false;
    const std::int64_t newest = seen.newest;
    const bool all_read = rule.figure.empty() || follow(rule, run, seen);
    const bool moved = rule.figure.empty() ? seen.updates != run.updates : seen.newest != newest;
    if (moved) seen.moved = time;
    // While the dashboard was away it heard nothing, which ends no alarm either.
    const double here = seen.raised ? 0 : begun;
    if (rule.when == When::kSilent) judge(rule, run, seen, time - std::max(seen.moved, here) > rule.minutes * 60);
    if (rule.when == When::kLost) judge(rule, run, seen, time - std::max(run.last, here) > kRunSilence);
    if (all_read) {
      if (run.ended && seen.raised) change(rule, run, seen, false, "");
      seen.dirty |= moved || seen.ended != run.ended || seen.updates != run.updates;
      seen.ended = run.ended;
      seen.updates = run.updates;
    } else {
      seen.updates = 0;  // so that the next look goes on
      seen.dirty = true;
    }
    seen.fresh = false;
  }

  /// Raises or ends the alarm of a state that the run is in, or not.
  void judge(const AlarmRule& rule, const WatchedRun& run, Progress& seen, bool fits) {
    if (!run.ended && fits != seen.raised) change(rule, run, seen, fits, "");
  }

  void change(const AlarmRule& rule, const WatchedRun& run, Progress& seen, bool raised, const std::string& detail) {
    changes.push_back({&rule, &run, &seen, raised, described(rule) + detail});
    seen.raised = raised;
    seen.raised_now |= raised;
    seen.dirty = true;
  }

  bool follow(const AlarmRule& rule, const WatchedRun& run, Progress& seen);
  void count(const AlarmRule& rule, const WatchedRun& run, Progress& seen, double step, double value);
  std::vector<Event> write(double time);
  std::optional<std::string> unknown_figure(const AlarmRule& rule);

  Alarms& owner;
  Store& store;
  const Options options;
  std::mutex mutex;
  SQLite::Database reader;
  const double begun;  // silence before is not the run's
  std::vector<AlarmRule> rules;
  std::map<std::pair<std::int64_t, std::int64_t>, Progress> progress;  // by rule and row of `runs`
  std::vector<Change> changes;
  double next_flush = 0;
  bool failing = false;
  std::mutex pause_mutex;
  std::condition_variable_any pause;
  std::jthread thread;  // last: it uses all of the above
};

/// Reads the points that have come since. Returns false when there are more.
bool Alarms::Impl::follow(const AlarmRule& rule, const WatchedRun& run, Progress& seen) {
  std::int64_t row = run.row;
  std::string columns, table = "training";
  if (run.logged) {
    if (seen.metric == 0) {
      SQLite::Statement found(reader, "SELECT id FROM metrics WHERE run = ? AND name = ?");
      if (!bind_values(found, run.row, rule.figure).executeStep()) return true;
      read_row(found, seen.metric);
    }
    row = seen.metric;
    columns = "step, value";
    table = "points";
  } else {
    const TrainingFigure* figure = find_training_figure(rule.figure);
    if (!figure) return true;
    const bool is_key = figure == &training_figures().front();
    columns = "steps, " + (is_key ? "key & " + std::to_string(kMostUpdates) : std::string(figure->name));
  }
  const std::int64_t first = training_key(row, 0), last = training_key(row, kMostUpdates);
  const std::string from = " FROM " + table + " WHERE key > ?1 AND key <= ?2 ORDER BY key ";
  if (seen.fresh && run.started < rule.created) {  // of what was there, only what the rule counts
    SQLite::Statement before(reader, "SELECT key" + from + "DESC LIMIT 1 OFFSET ?3");
    if (bind_values(before, first, last, rule.points).executeStep())
      seen.newest = value_at<std::int64_t>(before, 0) - first;
  }
  SQLite::Statement points(reader, "SELECT key, " + columns + from + "LIMIT ?3");
  bind_values(points, first + seen.newest, last, kPointsAtOnce);
  std::int64_t read = 0;
  for (; points.executeStep(); ++read) {
    std::int64_t key = 0;
    double step = 0, value = 0;
    read_row(points, key, step, value);
    seen.newest = key - first;
    if (counts_points(rule)) count(rule, run, seen, step, value);
  }
  if (read == 0 && seen.newest > 0) {
    // A run that resumed from an older checkpoint takes updates back.
    SQLite::Statement newest(reader, "SELECT key" + from + "DESC LIMIT 1");
    const bool any = bind_values(newest, first, last).executeStep();
    const std::int64_t there = any ? value_at<std::int64_t>(newest, 0) - first : 0;
    if (there < seen.newest) {
      seen.newest = there;
      seen.streak = 0;
    }
  }
  return read < kPointsAtOnce;
}

/// Counts a point, which may raise or end the alarm.
void Alarms::Impl::count(const AlarmRule& rule, const WatchedRun& run, Progress& seen, double step, double value) {
  bool fits = !std::isfinite(value);
  if (rule.when != When::kNotFinite) {
    if (std::isnan(value)) return;  // neither below nor above
    fits = rule.when == When::kBelow ? value < rule.value : value > rule.value;
  }
  if (fits && seen.streak <= 0) {
    seen.streak = 0;
    seen.begin = step;
  }
  seen.streak = fits ? seen.streak + 1 : std::min<std::int64_t>(seen.streak, 0) - 1;
  const auto enough = static_cast<std::int64_t>(rule.points);
  // At most one alarm a look: a figure that crosses the bound with each point raises few.
  if (!seen.raised && !seen.raised_now && seen.streak >= enough && step - seen.begin >= rule.steps)
    change(rule, run, seen, true, fmt::format(": {:g} at step {:.0f}", value, step));
  if (seen.raised && -seen.streak >= enough) change(rule, run, seen, false, "");
}

/// Commits all changes, and how far the rules have looked. Returns the events of the changes.
std::vector<Event> Alarms::Impl::write(double time) {
  std::vector<Event> events;
  store.with_database([&](SQLite::Database& database) {
    SQLite::Transaction all(database, SQLite::TransactionBehavior::IMMEDIATE);
    SQLite::Statement raise(
        database,
        "INSERT INTO alarms (rule, run, since, text) SELECT ?1, ?2, ?3, ?4 WHERE EXISTS (SELECT 1 FROM runs "
        "WHERE id = ?2)");
    SQLite::Statement end(database, "UPDATE alarms SET over = COALESCE(over, ?2) WHERE id = ?1");
    SQLite::Statement event(database,
                            "INSERT INTO events (time, session, service, kind, text) VALUES (?, ?, ?, 'alarm', ?)");
    for (const Change& one : changes) {
      if (one.raised) {
        if (run(raise, one.rule->id, one.run->row, time, one.text) == 0) continue;  // the run was removed meanwhile
        one.progress->alarm = database.getLastInsertRowid();
      } else {
        run(end, std::exchange(one.progress->alarm, 0), time);
      }
      if (!one.raised && one.run->ended) continue;
      events.push_back({time, one.run->session, one.run->name, "alarm", (one.raised ? "" : "resolved: ") + one.text});
      run(event, time, events.back().session, events.back().service, events.back().text);
    }
    SQLite::Statement save(
        database,
        "INSERT INTO alarm_progress (rule, run, newest, streak, begin, moved, updates, ended, alarm) "
        "SELECT ?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9 WHERE EXISTS (SELECT 1 FROM runs WHERE id = ?2) "
        "ON CONFLICT (rule, run) DO UPDATE SET newest = ?3, streak = ?4, begin = ?5, moved = ?6, "
        "updates = ?7, ended = ?8, alarm = ?9");
    for (auto& [key, seen] : progress)
      if (seen.dirty)
        run(save, key.first, key.second, seen.newest, seen.streak, seen.begin, seen.moved, seen.updates, seen.ended,
            seen.alarm);
    run(database, "DELETE FROM alarms WHERE over IS NOT NULL AND id <= (SELECT MAX(id) FROM alarms) - ?", kAlarmsKept);
    all.commit();
  });
  for (auto& [key, seen] : progress) seen.dirty = false;
  next_flush = time + kFlushEvery;
  changes.clear();
  return events;
}

/// Returns a sentence when there are runs that the rule watches, and none of them has its figure.
std::optional<std::string> Alarms::Impl::unknown_figure(const AlarmRule& rule) {
  if (rule.figure.empty() || find_training_figure(rule.figure)) return std::nullopt;
  std::set<std::string> known;
  bool any = false;
  SQLite::Statement all(reader,
                        "SELECT id, name, tags, source <> '' FROM runs WHERE policy IS NOT NULL OR source <> ''");
  SQLite::Statement metrics(reader, "SELECT name FROM metrics WHERE run = ? ORDER BY name");
  while (all.executeStep()) {
    WatchedRun run;
    read_row(all, run.row, run.name, run.tags, run.logged);
    if (!watches(rule, run.name, run.tags)) continue;
    any = true;
    if (!run.logged) continue;
    bind_values(metrics, run.row);
    while (metrics.executeStep()) {
      const auto name = value_at<std::string>(metrics, 0);
      if (name == rule.figure) return std::nullopt;
      if (known.size() < kFiguresNamed) known.insert(name);
    }
    metrics.reset();
  }
  if (!any) return std::nullopt;
  return "none of the runs '" + rule.runs + "' has a figure '" + rule.figure + "'" +
         (known.empty() ? ": trainings have " + joined(training_figures(), &TrainingFigure::name)
                        : ": they have, for example, " + joined(std::vector<std::string>(known.begin(), known.end())));
}

Alarms::Alarms(Store& store, Options options) : impl_(std::make_unique<Impl>(*this, store, std::move(options))) {}
Alarms::~Alarms() = default;

std::optional<std::string> Alarms::refusal(const AlarmRule& rule) {
  if (auto fault = fault_of(rule)) return fault;
  const std::lock_guard guard(impl_->mutex);
  if (impl_->rules.size() >= kMostAlarmRules)
    return "there are " + std::to_string(kMostAlarmRules) + " rules already: remove one first";
  return with_file_errors(impl_->store.path(), [&] { return impl_->unknown_figure(rule); });
}

AlarmRule Alarms::add(AlarmRule rule) {
  {
    const std::lock_guard guard(impl_->mutex);
    rule.created = impl_->now();
    impl_->store.with_database([&](SQLite::Database& database) {
      run(database,
          "INSERT INTO alarm_rules (runs, \"when\", figure, value, points, steps, minutes, created) "
          "VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
          rule.runs, std::string(name_of(rule.when)), rule.figure, rule.value, rule.points, rule.steps, rule.minutes,
          rule.created);
      rule.id = database.getLastInsertRowid();
    });
    impl_->rules.push_back(rule);
  }
  impl_->poll(rule.id);  // what comes from now on counts
  impl_->tell_change();
  return rule;
}

bool Alarms::remove(std::int64_t rule) {
  {
    const std::lock_guard guard(impl_->mutex);
    const auto is = [&](const AlarmRule& one) { return one.id == rule; };
    if (std::none_of(impl_->rules.begin(), impl_->rules.end(), is)) return false;
    impl_->store.with_database(
        [&](SQLite::Database& database) { run(database, "DELETE FROM alarm_rules WHERE id = ?", rule); });
    std::erase_if(impl_->rules, is);
    std::erase_if(impl_->progress, [&](const auto& one) { return one.first.first == rule; });
  }
  impl_->tell_change();
  return true;
}

bool Alarms::dismiss(std::int64_t alarm) {
  int dismissed = 0;
  impl_->store.with_database([&](SQLite::Database& database) {
    dismissed = run(database, "UPDATE alarms SET over = ?2 WHERE id = ?1 AND over IS NULL", alarm, impl_->now());
  });
  if (dismissed > 0) impl_->tell_change();
  return dismissed > 0;
}

std::vector<AlarmRule> Alarms::rules() {
  const std::lock_guard guard(impl_->mutex);
  return impl_->rules;
}

std::vector<RunAlarm> Alarms::alarms() {
  const std::lock_guard guard(impl_->mutex);
  return with_file_errors(impl_->store.path(), [&] {
    std::vector<RunAlarm> list;
    SQLite::Statement all(
        impl_->reader,
        "SELECT a.id, a.rule, r.name, a.since, a.over, a.text FROM alarms a JOIN runs r ON r.id = a.run "
        "ORDER BY a.over IS NOT NULL, a.id DESC LIMIT ?");
    bind_values(all, kAlarmsListed);
    while (all.executeStep()) {
      RunAlarm& one = list.emplace_back();
      read_row(all, one.id, one.rule, one.run, one.since, one.over, one.text);
    }
    return list;
  });
}

void Alarms::poll() { impl_->poll(); }

std::string Alarms::metrics() {
  std::map<std::int64_t, std::string> words;
  for (const AlarmRule& rule : rules()) words[rule.id] = described(rule);
  Exposition lines;
  lines.family("citylearn_run_alarm", "Alarms of runs that last, by run and rule.");
  for (const RunAlarm& alarm : alarms())
    if (!alarm.over)
      lines.sample(1, "{" + metric_label("run", alarm.run) + "," + metric_label("rule", words[alarm.rule]) + "," +
                          metric_label("rule_id", std::to_string(alarm.rule)) + "}");
  return lines.text();
}

}  // namespace citylearn
