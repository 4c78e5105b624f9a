// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "core/task/training_figures.h"
#include "dashboard/store/store_impl.h"

namespace citylearn {
namespace {

constexpr double kFlushInterval = 5;  // seconds

}  // namespace

void Store::Impl::load_runs() {
  runs.clear();
  unclaimed_rows.clear();
  run_sources.clear();
  SQLite::Statement all(
      database,
      "SELECT session, run_id, id, policy, seed, incarnation, updates, ended, agent, learner, manifest "
      "FROM runs WHERE run_id IS NOT NULL ORDER BY id");
  while (all.executeStep()) {
    RunKey key;
    KnownRun known;
    read_row(all, key.first, key.second, known.row, known.policy, known.seed, known.incarnation, known.updates,
             known.ended, known.agent, known.learner, known.manifest);
    SQLite::Statement& least = bind_values(statements->least_update, training_key(known.row, 1),
                                           training_key(known.row, kMaxUpdate), known.incarnation);
    if (least.executeStep()) known.least = update_of(value_at<std::int64_t>(least, 0));
    least.reset();
    runs.emplace(key, std::move(known));
  }
}

/// Returns the run that this process goes on with; null when there is none.
Store::Impl::KnownRun* Store::Impl::find_of(const Sender& policy, std::uint64_t run_id) {
  return find(policy.session, run_id, [&policy](const KnownRun& run) {
    return run.policy == policy.id && run.incarnation == policy.incarnation;
  });
}

/// Returns 0 when there is no row for it yet.
std::int64_t Store::Impl::unclaimed_row(const std::string& session) {
  auto [known, fresh] = unclaimed_rows.try_emplace(session, 0);
  if (!fresh) return known->second;
  SQLite::Statement& found = bind_values(statements->find_unclaimed, session);
  if (found.executeStep()) read_row(found, known->second);
  found.reset();
  return known->second;
}

/// Hands a new run the episodes that came before its RunInfo.
void Store::Impl::claim_episodes(const std::string& session, std::uint64_t run_id, const KnownRun& known) {
  const std::int64_t unclaimed = unclaimed_row(session);
  if (unclaimed == 0) return;
  const std::int64_t claimed = run(statements->claim_episodes, unclaimed, known.row, run_id);
  if (claimed == 0) return;
  run(statements->claim_sources, known.row);
  run(statements->add_to_count, known.row, claimed);
  run(statements->add_to_count, unclaimed, -claimed);
}

bool Store::Impl::record(const msg::RunInfo& info) {
  const Sender sender(info.header());
  const double now = seconds_since_epoch();
  KnownRun* known = find(sender.session, info.run_id(),
                         [&](const KnownRun& run) { return run.policy == sender.id && run.seed == info.seed(); });
  const bool successor = !known || known->incarnation != sender.incarnation;
  // One of a predecessor that the middleware kept for late joiners, or one that was overtaken on the way.
  if (known &&
      (successor ? known->predecessors.contains(sender.incarnation) : info.header().message() <= known->message))
    return false;
  KnownRun next;
  if (known) next = *known;
  if (known && successor) next.predecessors.insert(known->incarnation);
  next.policy = sender.id;
  next.seed = info.seed();
  next.incarnation = sender.incarnation;
  next.message = info.header().message();
  next.updates = std::min(info.updates(), kMaxUpdate);
  next.agent = info.agent().c_str();
  next.learner = info.learner().c_str();
  next.manifest.assign(info.manifest().begin(), info.manifest().end());
  next.ended = info.ended() || (next.ended && !successor);
  if (successor) next.least = 0;
  if (!successor && next.agent == known->agent && next.learner == known->learner && next.manifest == known->manifest &&
      next.ended == known->ended) {
    *known = std::move(next);
    liveness[known->row] = {now, known->updates};
    unwritten.try_emplace(known->row, now);
    return false;
  }
  SQLite::Transaction all(database, SQLite::TransactionBehavior::IMMEDIATE);
  if (!known) {
    run(statements->add_run, run_id(info), sender.session, info.run_id(), sender.id, info.seed(), now);
    next.row = database.getLastInsertRowid();
  }
  run(statements->update_run, next.row, next.incarnation, next.agent, next.learner, next.updates, next.manifest, now,
      next.ended);
  if (!known) claim_episodes(sender.session, info.run_id(), next);
  all.commit();
  run_sources.clear();
  liveness[next.row] = {now, next.updates};
  unwritten.erase(next.row);
  if (known)
    *known = std::move(next);
  else
    runs.emplace(RunKey(sender.session, info.run_id()), std::move(next));
  return true;
}

void Store::Impl::mark_ended(const Sender& policy) {
  for (auto& [key, known] : runs) {
    if (known.ended || key.first != policy.session || known.policy != policy.id ||
        known.incarnation != policy.incarnation)
      continue;
    run(statements->run_ended, known.row, seconds_since_epoch());
    known.ended = true;
  }
}

std::size_t Store::Impl::record(std::span<const msg::TrainingStat> stats) {
  std::size_t taken = 0;
  std::map<KnownRun*, std::uint64_t> leasts;  // of those that sent some
  SQLite::Transaction all(database, SQLite::TransactionBehavior::IMMEDIATE);
  for (const msg::TrainingStat& stat : stats) {
    if (stat.update() == 0 || stat.update() > kMaxUpdate) continue;
    KnownRun* known = find_of(Sender(stat.header()), stat.log().stream());
    if (!known) continue;
    const std::int64_t key = training_key(known->row, stat.update());
    std::uint64_t& least = leasts.try_emplace(known, known->least).first->second;
    if (least == 0 || stat.update() < least) {
      // From here on the updates are this process's.
      run(statements->drop_training_from, key, training_key(known->row, kMaxUpdate), known->incarnation);
      least = stat.update();
    }
    SQLite::Statement& row = bind_values(statements->add_training, key, known->incarnation, stat.log().number());
    int column = 3;
    for (const TrainingFigure& figure : training_figures().subspan(1)) bind_value(row, ++column, figure.value(stat));
    row.exec();
    ++taken;
  }
  all.commit();
  for (const auto& [known, least] : leasts) known->least = least;
  return taken;
}

NumberSet Store::Impl::recorded_stats(const Sender& policy, std::uint64_t run_id) {
  NumberSet numbers;
  const KnownRun* known = find_of(policy, run_id);
  if (!known) return numbers;
  SQLite::Statement& row = bind_values(statements->process_stats, training_key(known->row, 1),
                                       training_key(known->row, kMaxUpdate), policy.incarnation);
  while (row.executeStep()) numbers.add(value_at<std::uint64_t>(row, 0));
  return numbers;
}

void Store::Impl::flush(bool at_once) {
  const double now = seconds_since_epoch();
  const bool due = std::any_of(unwritten.begin(), unwritten.end(), [&](const auto& entry) {
    return at_once || now - entry.second >= kFlushInterval || entry.second > now;
  });
  if (!due) return;
  SQLite::Transaction all(database, SQLite::TransactionBehavior::IMMEDIATE);
  for (const auto& [row, since] : unwritten)
    run(statements->run_liveness, row, liveness[row].last, liveness[row].updates);
  all.commit();
  unwritten.clear();
}

}  // namespace citylearn
