// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "core/task/spl.h"
#include "dashboard/store/store_impl.h"

namespace citylearn {
namespace {

// Larger numbers cannot be: no process lives so long, and SQLite's integers have a sign.
constexpr std::uint64_t kMaxEpisode = std::uint64_t{1} << 62;

}  // namespace

std::int64_t Store::Impl::add_source(const Sender& environment) {
  run(statements->add_source, environment.session, environment.id, environment.incarnation);
  return database.getLastInsertRowid();
}

Store::Impl::Source& Store::Impl::source(const Sender& environment) {
  const auto known = sources.find(environment);
  if (known != sources.end()) return known->second;
  Source source;
  SQLite::Statement& found =
      bind_values(statements->find_source, environment.session, environment.id, environment.incarnation);
  if (found.executeStep()) {
    std::uint64_t contiguous = 0, missed = 0;
    read_row(found, source.id, contiguous, missed, source.described);
    NumberSet recorded;
    if (missed == 0) recorded.add(1, contiguous);  // else some of them were given up, and may come all the same
    SQLite::Statement& episode = bind_values(statements->source_episodes, source.id, recorded.reach());
    while (episode.executeStep()) recorded.add(value_at<std::uint64_t>(episode, 0));
    source.episodes.record(recorded);
    source.episodes.give_up(1, contiguous);
  }
  found.reset();
  return sources.emplace(environment, std::move(source)).first->second;
}

std::size_t Store::Impl::record(std::span<const msg::EpisodeStat> episodes, std::vector<Event>* lost) {
  const double now = seconds_since_epoch();
  // What is remembered changes only when the file has: first all happens to copies.
  struct Change {
    Source source;
    bool changed = false;
  };
  std::map<Sender, Change> changes;
  std::map<std::int64_t, std::int64_t> counts;  // new episodes, by row of `runs`
  std::map<std::string, std::int64_t> new_rows;
  std::set<std::pair<std::int64_t, std::int64_t>> new_run_sources;
  std::vector<Event> events;
  std::size_t fresh = 0;
  SQLite::Transaction all(database, SQLite::TransactionBehavior::IMMEDIATE);
  for (const msg::EpisodeStat& episode : episodes) {
    const std::uint64_t given_up = episode.log().first() - 1, episode_number = episode.log().number();
    if (episode_number == 0 || episode_number > kMaxEpisode || given_up >= kMaxEpisode) continue;
    const Sender sender(episode.header());
    auto found = changes.find(sender);
    if (found == changes.end()) found = changes.emplace(sender, Change{source(sender)}).first;
    auto& [source, changed] = found->second;
    if (source.id == 0) source.id = add_source(sender);
    const NumberSet& settled = source.episodes.settled();
    if (given_up > settled.reach()) {
      // Others recorded these, and the env_service has forgotten them since.
      const std::uint64_t first = settled.reach() + 1;
      const std::uint64_t number = given_up - first + 1 - settled.count(first, given_up);
      source.episodes.give_up(first, given_up);
      changed = true;
      if (number > 0) {
        events.push_back({now, sender.session, sender.id, "alarm",
                          std::to_string(number) + " episodes up to number " + std::to_string(given_up) +
                              " were recorded only by others, before " + sender.id + " knew this dashboard"});
        add(events.back());
      }
    }
    if (!source.episodes.record(episode_number)) continue;
    changed = true;
    // Of several, that of the process whose settings these are, else the first one: another may merely name it.
    const KnownRun* known = find(sender.session, episode.run_id(), [&](const KnownRun& run) {
      return run.incarnation == episode.settings().incarnation();
    });
    if (!known) known = find(sender.session, episode.run_id(), [](const KnownRun&) { return true; });
    std::int64_t row = known ? known->row : unclaimed_row(sender.session);
    if (row == 0) {
      std::int64_t& made = new_rows[sender.session];
      if (made == 0) {
        run(statements->add_unclaimed, run_id(sender.session), sender.session, now);
        made = database.getLastInsertRowid();
      }
      row = made;
    }
    SQLite::Statement& add_episode = statements->add_episode;
    bind_values(add_episode, row, source.id, episode_number, episode.run_id(), episode.agent(), episode.evaluation(),
                episode.task(), episode.traversal().c_str(), episode.policy().c_str(), episode.update(),
                episode.shuffled(), episode.start(), episode.goal(), episode.steps(), episode.shortest(),
                episode.reward(), episode.completed(), spl_of(episode.completed(), episode.shortest(), episode.steps()),
                now);
    if (episode.steps() == 0)
      add_episode.bind(20, "");  // an empty path is not an unknown one
    else
      bind_value(add_episode, 20, std::span<const std::uint8_t>(episode.path()));
    if (add_episode.exec() == 0) continue;
    ++fresh;
    ++counts[row];
    if (const std::pair pair(row, source.id); !run_sources.contains(pair) && new_run_sources.insert(pair).second)
      run(statements->add_run_source, row, source.id);
  }
  for (const auto& [row, count] : counts) run(statements->count_episodes, row, count, now);
  for (const auto& [sender, change] : changes) {
    if (!change.changed) continue;
    const RecordedNumbers& numbers = change.source.episodes;
    const std::uint64_t reach = numbers.settled().reach();
    run(statements->source_progress, change.source.id, reach, reach - numbers.recorded().count(1, reach));
  }
  all.commit();
  for (auto& [sender, change] : changes) sources[sender] = std::move(change.source);
  for (const auto& [session, row] : new_rows) unclaimed_rows[session] = row;
  run_sources.merge(new_run_sources);
  for (const auto& [row, count] : counts) liveness[row].last = std::max(liveness[row].last, now);
  if (lost) lost->insert(lost->end(), events.begin(), events.end());
  return fresh;
}

void Store::Impl::describe(const msg::TraversalInfo& info) {
  const Sender sender(info.header());
  Source described = source(sender);
  if (described.described) return;
  SQLite::Transaction all(database, SQLite::TransactionBehavior::IMMEDIATE);
  if (described.id == 0) described.id = add_source(sender);
  run(statements->describe_source, info.dataset().c_str(), info.traversal().c_str(), info.condition().c_str(),
      info.hash(), info.frames(), info.agents(), info.images(), static_cast<std::uint32_t>(info.rule()),
      info.streets_hash(), described.id);
  all.commit();
  described.described = true;
  sources[sender] = std::move(described);
}

}  // namespace citylearn
