// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <string>
#include <tuple>
#include <vector>

#include "core/wire/messages.h"
#include "policy_service/rollout/collector.h"
#include "policy_service/rollout/rollout.h"

namespace citylearn {

/// The shape that every Trajectory of a run must have.
struct TrajectoryShape {
  int steps = 0;                             ///< L
  int features = 0;                          ///< D
  int state_size = 0;                        ///< of the network
  int frames = 0;                            ///< N
  std::shared_ptr<const StateMap> map = {};  ///< where actions lead; a queue needs it

  /// Throws Error naming the option when such a Trajectory is larger than a message may be.
  void require_fits() const;
};

/// Copies the data of `agent` in a rollout of one sequence (T = L) into the dimension and all fields from `state` on.
void pack(const Rollout& rollout, int agent, msg::Trajectory& trajectory);

/// Queues the actors' trajectories for a learner: each exactly once, in the order of its actor, at most `capacity` at a
/// time. It handles messages, but never the wire. Used by one thread.
class TrajectoryQueue {
 public:
  TrajectoryQueue(const TrajectoryShape& shape, int capacity);

  /// Notes which process an actor is; until then, the first that sends a trajectory. Another one numbers from 1 again.
  void register_actor(const std::string& actor, std::uint64_t incarnation);
  /// Divides the room among so many actors.
  void share_among(int actors) { actors_ = actors; }

  enum class Taken { kTaken, kRepeated, kNoRoom };
  /// `trajectory` is moved from when it is taken. `version` is the newest of the parameters. Those before the first one
  /// that the actor keeps are not waited for: it was told in this learner's name that they came. Throws Error naming
  /// the field when it is not like the shape.
  Taken take(msg::Trajectory& trajectory, std::uint64_t version);

  struct Window {
    std::uint64_t number = 0, limit = 0;  ///< as in LogAcknowledgement
  };
  Window window(const std::string& actor) const;

  /// Drops trajectories of another lesson, or of parameters more than `max_lag` updates old (0 = none is too old).
  /// Returns whether `count` are left.
  bool ready(int count, std::uint64_t version, std::uint32_t lesson, std::uint64_t max_lag);
  /// Moves the `count` oldest into a rollout of one sequence. The present lesson has `places`. Returns their mean lag.
  double assemble(int count, std::uint64_t version, int places, Rollout& rollout);
  /// Returns the episodes that ended in the trajectories taken since the last call.
  std::vector<FinishedEpisode> finished();

  std::size_t size() const { return queue_.size(); }
  std::size_t capacity() const { return capacity_; }
  std::uint64_t dropped() const { return dropped_; }

 private:
  struct Actor {
    std::uint64_t incarnation = 0, number = 0;       ///< all up to `number` are taken
    std::size_t queued = 0;                          ///< of this incarnation
    std::map<std::uint64_t, msg::Trajectory> early;  ///< after a gap
  };
  struct Entry {
    std::string actor;
    std::uint64_t incarnation;
    msg::Trajectory trajectory;
  };
  struct Episode {  ///< of one agent, going on
    msg::SettingsId settings;
    std::uint64_t next_step = 0;
    bool known = false;  ///< seen from its first observation on
    int start = 0, steps = 0;
    std::vector<int> goals = {};
    double reward = 0;
  };

  void check(const msg::Trajectory& trajectory, std::uint64_t version) const;
  void enqueue(const std::string& actor, Actor& known, std::uint64_t up_to);
  void follow(const std::string& actor, const msg::Trajectory& trajectory);
  std::size_t room(const Actor& actor) const;
  void leave(const Entry& entry);

  TrajectoryShape shape_;
  DistanceFields fields_;
  std::size_t capacity_;
  int actors_ = 1;
  std::map<std::string, Actor> known_;
  std::deque<Entry> queue_;
  std::map<std::tuple<std::string, std::string, std::uint32_t>, Episode> episodes_;  ///< by actor, environment, agent
  std::vector<FinishedEpisode> finished_;
  std::uint64_t dropped_ = 0;
};

}  // namespace citylearn
