// SPDX-License-Identifier: Apache-2.0
#include "tests/simulation/training/invariants.h"

#include <fstream>
#include <iterator>

#include "core/files/csv.h"
#include "tests/simulation/training/services.h"

namespace citylearn::simulation {
namespace {

std::vector<std::vector<std::string>> rows_of(const std::string& path) {
  std::vector<std::vector<std::string>> rows;
  std::ifstream file(path);
  std::string line;
  while (std::getline(file, line)) rows.push_back(csv_fields(line));
  return rows;
}

std::string text(const Source& source, std::uint64_t episode) {
  return "episode " + std::to_string(episode) + " of " + source.first + " (" + std::to_string(source.second) + ")";
}

std::string not_at_rest(const Evidence& evidence) { return evidence.at_rest ? "" : evidence.state; }

std::string not_trained(const Evidence& evidence) {
  return evidence.trained || !evidence.at_rest ? "" : evidence.state;
}

/// Checks no acknowledgements of recordings, which have gaps: not_replayed() does.
std::string lost_episode(const Evidence& evidence) {
  for (const auto& [name, records] : evidence.recorders)
    for (const auto& [source, last] : records.acknowledged) {
      if (name == kViewer) continue;
      const auto found = records.recorded.find(source);
      for (std::uint64_t episode = 1; episode <= last; ++episode)
        if (found == records.recorded.end() || !found->second.contains(episode))
          return text(source, episode) + " was acknowledged by " + name + ", which does not have it";
    }
  return "";
}

std::string doubled_episode(const Evidence& evidence) {
  for (const auto& [name, records] : evidence.recorders)
    for (const auto& [source, episodes] : records.recorded)
      for (const auto& [episode, count] : episodes)
        if (count > 1) return name + " has " + text(source, episode) + " " + std::to_string(count) + " times";
  return "";
}

std::string hole_in_numbers(const Evidence& evidence) {
  for (const auto& [source, episodes] : evidence.recorders.at(kPolicy).recorded)
    if (episodes.rbegin()->first != episodes.size())
      return source.first + " has " + std::to_string(episodes.size()) + " episodes, the last is number " +
             std::to_string(episodes.rbegin()->first);
  return "";
}

std::string wrong_updates(const Evidence& evidence) {
  if (!evidence.trained) return "";
  const auto rows = rows_of(evidence.output + "/metrics.csv");
  std::uint64_t update = 0, steps = 0, before = 0;
  for (std::size_t i = 1; i < rows.size(); ++i) {
    if (rows[i].size() < 2 || std::stoull(rows[i][0]) != ++update)
      return "row " + std::to_string(i) + " of metrics.csv should be update " + std::to_string(update);
    before = std::exchange(steps, std::stoull(rows[i][1]));
    if (steps <= before) return "update " + std::to_string(update) + " learned from nothing new";
  }
  return before < evidence.steps && steps >= evidence.steps
             ? ""
             : "the last updates end at steps " + std::to_string(before) + " and " + std::to_string(steps);
}

/// A restarted env_service begins its agents' episodes anew, so its training is another one.
std::string other_agent(const Evidence& evidence) {
  if (!evidence.trained || evidence.envs_restarted || evidence.expected_agent.empty()) return "";
  return evidence.agent == evidence.expected_agent ? "" : "the agent is " + evidence.agent.substr(0, 16);
}

std::string unrecorded_episode(const Evidence& evidence) {
  for (const auto& [source, last] : evidence.finished)
    for (const auto& [name, records] : evidence.recorders) {
      if (!records.ended) continue;
      const auto found = records.recorded.find(source);
      const std::size_t has = found == records.recorded.end() ? 0 : found->second.size();
      if (has < last) return name + " has " + std::to_string(has) + " episodes up to " + text(source, last);
    }
  return "";
}

/// Episodes that other recorders had before this one came are the only ones that a store does without.
std::string untold_hole(const Evidence& evidence) {
  for (const auto& [name, records] : evidence.recorders)
    for (const auto& [source, last] : records.settled) {
      std::uint64_t has = 0;
      if (const auto found = records.recorded.find(source); found != records.recorded.end())
        has = static_cast<std::uint64_t>(std::distance(found->second.begin(), found->second.upper_bound(last)));
      if (has + records.missed.at(source) != last)
        return name + " has " + std::to_string(has) + " episodes up to " + text(source, last) + " and misses " +
               std::to_string(records.missed.at(source));
    }
  return "";
}

std::string wrong_parameters(const Evidence& evidence) { return evidence.wrong_parameters; }

std::string too_much_memory(const Evidence& evidence) {
  constexpr std::size_t kMaxBytesPerProcess = 8 << 20;
  return evidence.memory <= kMaxBytesPerProcess * evidence.processes ? "" : std::to_string(evidence.memory) + " bytes";
}

std::string unexpected_error(const Evidence& evidence) {
  return evidence.unexpected_errors.empty() ? "" : evidence.unexpected_errors.front();
}

std::string unreadable_recording(const Evidence& evidence) { return evidence.recording_fault; }

std::string not_replayed(const Evidence& evidence) {
  if (!evidence.replayed) return "";
  const auto& stored = evidence.recorders.at(kViewer).recorded;
  for (const auto& [source, episodes] : evidence.recordings.recorded)
    for (const auto& [episode, count] : episodes)
      if (const auto found = stored.find(source); found == stored.end() || !found->second.contains(episode))
        return text(source, episode) + " is in a recording, but not in the store that it was replayed to";
  return "";
}

}  // namespace

const std::vector<Invariant>& invariants() {
  static const std::vector<Invariant> all = {
      {"at rest", "once nothing goes wrong any more, all services end in time", not_at_rest},
      {"trained", "the training ends with success", not_trained},
      {"no episode lost", "an acknowledged episode is recorded", lost_episode},
      {"no episode doubled", "an episode is recorded once at most", doubled_episode},
      {"no hole", "in episodes.csv the episodes of an env_service have the numbers from 1 on, without a gap",
       hole_in_numbers},
      {"updates once", "metrics.csv has every update once and in order, and ends with the step that was asked for",
       wrong_updates},
      {"same agent", "unless an env_service restarts, a lockstep training ends with the bytes of one without faults",
       other_agent},
      {"all recorded", "what env_services finish that end in calm, every recorder has that ends after them",
       unrecorded_episode},
      {"holes told", "what a store lacks of the episodes that it takes for settled, it counts as missed", untold_hole},
      {"parameters of the checkpoint", "what a learner announces after an update is what its checkpoint holds",
       wrong_parameters},
      {"memory bounded", "the services hold at most 8 MiB each, on average", too_much_memory},
      {"no error without cause",
       "a service ends with an error only while its disk is full or another process has its id", unexpected_error},
      {"recording readable", "every recording can be read up to where its process was killed", unreadable_recording},
      {"replayed", "a dashboard that recordings are replayed to without faults has all of their episodes",
       not_replayed},
  };
  return all;
}

}  // namespace citylearn::simulation
