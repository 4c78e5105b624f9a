// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/util/random.h"
#include "policy_service/env_client/env_client.h"
#include "policy_service/results/score.h"
#include "policy_service/rollout/policy.h"
#include "policy_service/rollout/task_waves.h"

namespace citylearn {

/// Return the seeds of an evaluation's tasks and of its agent's drawn actions, from that of the run.
inline std::uint64_t evaluation_task_seed(std::uint64_t seed) { return mix_seeds({seed, 102}); }
inline std::uint64_t evaluation_choice_seed(std::uint64_t seed) { return mix_seeds({seed, 103}); }

/// Performs all tasks of `settings` (mode EVALUATE) on several traversals at once. The env_services of a traversal
/// divide its tasks; what comes out is the same for any number of them, of any number of agents, that come and go. The
/// same seed gives every policy the very same tasks, on whichever traversal. Used by one thread.
class Evaluation {
 public:
  using MakePolicy = std::function<std::unique_ptr<Policy>(const EnvHandle&)>;

  /// `client` must outlive it.
  Evaluation(EnvClient& client, msg::TaskSettings settings, MakePolicy make_policy,
             const std::vector<std::string>& traversals);

  /// Lets an env_service take part if it has one of the traversals. One that takes part begins anew, as after a
  /// restart.
  void add(EnvHandle& env);
  /// Goes on without an env_service. Others do the tasks that it was to do, also those that it has done of them,
  /// because its policy alone knows what was seen.
  void remove(EnvHandle& env);
  bool includes(EnvHandle& env) const { return parts_.contains(&env); }
  std::vector<EnvHandle*> envs() const;
  /// Gives up a traversal that has no env_service.
  void drop(const std::string& traversal) { traversals_.erase(traversal); }
  /// Returns the traversals that are not done, with the number of env_services that take part in each.
  std::map<std::string, int> open() const;

  /// Chooses actions, as EnvClient::Decide.
  bool decide(EnvHandle& env, const msg::Observation& observation, std::vector<std::uint8_t>& choice);
  /// Fills what the agents believe, as EnvClient::believe.
  void believe(EnvHandle& env, msg::Belief& belief) const { parts_.at(&env).policy->believe(belief); }
  /// Takes in a finished episode; repetitions and those of other settings are ignored.
  void take(EnvHandle& env, const msg::EpisodeStat& episode);

  bool done() const { return open().empty(); }
  /// Returns the fraction of tasks finished, 0..1.
  double fraction() const;
  std::uint64_t steps() const { return steps_; }
  /// Returns the scores by traversal, in the order of the tasks.
  std::map<std::string, Score> scores() const;

 private:
  using Episodes = std::map<std::uint32_t, msg::EpisodeStat>;  // by task
  /// The work of one env_service.
  struct Part {
    std::string traversal;
    std::unique_ptr<Policy> policy;
    TaskRange range;       // that it performs now; empty: none
    std::uint64_t agents;  // that it was seen to have, as evaluations may have more than it announces
    Episodes episodes;
  };
  struct Traversal {
    TaskWaves waves;
    std::vector<TaskRange> waiting;              // of the present wave, for an env_service to perform
    std::map<std::uint32_t, SeenFeatures> seen;  // in the present wave's tasks that are done
    Episodes episodes;
  };

  void hand_out(const std::string& name);
  void give(EnvHandle& env, Part& part, Traversal& traversal, std::uint64_t most);

  EnvClient& client_;
  const msg::TaskSettings settings_;
  MakePolicy make_policy_;
  std::map<std::string, Traversal> traversals_;
  std::map<EnvHandle*, Part, ById> parts_;
  std::uint64_t steps_ = 0;
};

/// Lets an evaluation handle the messages of its env_services while it lives; other ones go where they went before.
class EvaluationHandlers {
 public:
  EvaluationHandlers(EnvClient& client, Evaluation& evaluation);
  ~EvaluationHandlers();
  EvaluationHandlers(const EvaluationHandlers&) = delete;
  EvaluationHandlers& operator=(const EvaluationHandlers&) = delete;

 private:
  EnvClient& client_;
  const EnvClient::Decide decide_;
  const decltype(EnvClient::believe) believe_;
  const EnvClient::Finished finished_;
  const EnvClient::Joined joined_;
};

}  // namespace citylearn
