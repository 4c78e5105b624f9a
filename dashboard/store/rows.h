// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <compare>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/task/state_map.h"

namespace citylearn {

struct RunRow {
  std::int64_t id = 0;
  std::string name, session;
  std::optional<std::string> policy;  ///< nothing: episodes that no run has claimed
  std::optional<std::uint64_t> seed;
  std::string agent, learner;
  double started = 0, last = 0;  ///< seconds since 1970
  bool ended = false;
  std::uint64_t updates = 0, recorded = 0;
  /// Figures of its newest recorded update.
  struct Newest {
    std::uint64_t update = 0, steps = 0, episodes = 0;
    double wall = 0, reward = 0, spl = 0, steps_per_second = 0;
  };
  std::optional<Newest> newest;
};

struct TraversalRow {
  std::string environment, dataset, traversal, condition;
  std::uint64_t hash = 0, frames = 0, agents = 0;
  bool images = false;
  StateRule rule = StateRule::kLine;
  std::uint64_t streets = 0;  ///< hash of their map
};

/// The places where the frames of a traversal were recorded, or the streets whose states they show.
struct RouteMap {
  std::uint32_t frames = 0;
  std::vector<float> position;                    ///< F, metres along the route; NaN where unknown
  std::vector<double> latitude, longitude;        ///< F, degrees; NaN where unknown; empty where no frame has one
  std::shared_ptr<const StreetMap> streets = {};  ///< in order; null: a line
  StateRule rule = StateRule::kLine;
};

/// A picture as a browser shows it.
struct PictureFile {
  std::string type;   ///< "image/jpeg"
  std::string bytes;  ///< empty: it cannot be read or decoded
};

struct EpisodeRow {
  std::int64_t rowid = 0;
  std::string environment;
  std::uint64_t incarnation = 0, episode = 0, agent = 0;
  bool evaluation = false;
  std::uint64_t task = 0;
  std::string traversal, policy;
  std::uint64_t update = 0;
  bool shuffled = false;
  std::uint64_t start = 0, goal = 0, steps = 0, shortest = 0;
  float reward = 0;
  bool completed = false;
  float spl = 0;
  double recorded = 0;  ///< seconds since 1970
};

/// Calls `field(name, column, value)` for each field of an episode: its name in the API, its column in the store (`e`
/// is `episodes`, `s` is `sources`) and its value.
template <class Row, class Field>
void visit_episode(Row& e, Field field) {
  field("rowid", "e.id", e.rowid);
  field("environment", "s.environment", e.environment);
  field("incarnation", "s.incarnation", e.incarnation);
  field("episode", "e.episode", e.episode);
  field("agent", "e.agent", e.agent);
  field("evaluation", "e.evaluation", e.evaluation);
  field("task", "e.task", e.task);
  field("traversal", "e.traversal", e.traversal);
  field("policy", "e.policy", e.policy);
  field("update", "e.\"update\"", e.update);
  field("shuffled", "e.shuffled", e.shuffled);
  field("start", "e.start", e.start);
  field("goal", "e.goal", e.goal);
  field("steps", "e.steps", e.steps);
  field("shortest", "e.shortest", e.shortest);
  field("reward", "e.reward", e.reward);
  field("completed", "e.completed", e.completed);
  field("spl", "e.spl", e.spl);
  field("recorded", "e.recorded", e.recorded);
}

/// Which episodes of a run.
struct EpisodeFilter {
  std::optional<bool> evaluation, completed, shuffled;
  std::optional<std::string> traversal, policy;
  std::optional<std::uint64_t> update;
  std::optional<std::int64_t> before;  ///< rowid
};

/// Identifies an evaluation by the tasks that belong to it.
struct EvaluationKey {
  std::string policy;
  std::uint64_t update = 0;
  bool shuffled = false;
  std::string traversal;
  auto operator<=>(const EvaluationKey&) const = default;
};

}  // namespace citylearn
