// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "policy_service/distributed/env_client.h"
#include "policy_service/rollout/policy.h"
#include "policy_service/run/score.h"

namespace citylearn {

/// The tasks of one evaluation. The same seed gives every policy the very same tasks, on whichever traversal.
struct EvaluationOptions {
  int first_frame = 0;
  int frames = 128;  ///< N
  int max_steps = 128;
  int tasks = 2000;
  std::uint64_t seed = 1;
  bool shuffle = false;               ///< show the frames in a random order
  std::string policy;                 ///< who acts, for records
  std::uint64_t update = 0;           ///< of the learner, whose parameters act; 0 = none
  std::uint64_t job = 0;              ///< that this is part of
  std::chrono::seconds patience{30};  ///< how long a vanished env_service is waited for
};

/// Walks all tasks of `options` on each seat at once. Holds the fleet's handlers while it runs.
class Evaluation {
 public:
  using MakePolicy = std::function<std::unique_ptr<Policy>(const Seat&)>;

  /// `seats` and `fleet` must outlive it. An EpisodeStat of this evaluation must reach add().
  Evaluation(Fleet& fleet, std::vector<Seat*> seats, const EvaluationOptions& options, MakePolicy make_policy);

  /// Sends the settings; call once. An env_service that restarts begins again from its first task: call again for it.
  void begin(Seat& seat);
  /// For Fleet::decide.
  bool decide(Seat& seat, const msg::Observation& observation, std::vector<std::uint8_t>& choice);
  /// Takes in a finished episode; repetitions and those of other settings are ignored.
  void add(const Seat& seat, const msg::EpisodeStat& episode);

  bool done() const;
  /// Share of tasks finished, 0..1.
  double share() const;
  std::uint64_t steps() const { return steps_; }
  /// Throws Error when an env_service has been silent for longer than the patience.
  void check_alive() const;
  bool takes_part(const Seat& seat) const { return parts_.contains(&seat); }
  /// By traversal, in the order of the tasks.
  std::map<std::string, Score> scores() const;

 private:
  struct Part {
    std::unique_ptr<Policy> policy;
    std::map<std::uint32_t, msg::EpisodeStat> episodes;  ///< by task
  };
  Fleet& fleet_;
  EvaluationOptions options_;
  MakePolicy make_policy_;
  std::map<const Seat*, Part> parts_;
  std::uint64_t steps_ = 0;
};

}  // namespace citylearn
