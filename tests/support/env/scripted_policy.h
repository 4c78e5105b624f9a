// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "core/wire/node.h"
#include "tests/support/env/walkers.h"
#include "tests/support/wait.h"

namespace citylearn::testing {

inline bool same(const msg::SettingsId& a, const msg::SettingsId& b) {
  return a.incarnation() == b.incarnation() && a.version() == b.version();
}

/// Drives one env_service with a Walker, and misbehaves as asked. Keeps all it heard.
class ScriptedPolicy {
 public:
  ScriptedPolicy(const MiddlewareOptions& middleware, const std::string& run, const std::string& environment,
                 const std::string& id = "policy")
      : environment_(environment), node({middleware, "policy_service", id, run}) {
    node.create_reader<msg::TraversalInfo>();
    node.create_reader_at<msg::Observation>(environment);
    node.create_reader<msg::EpisodeStat>();
    node.create_reader<msg::ServiceStatus>();
  }

 private:
  std::string environment_;

 public:
  Node node;

  // How to behave.
  Walker* walker = nullptr;                 ///< none: observations are not answered
  bool acknowledge = true;                  ///< EpisodeStats, up to the first gap
  std::function<void(msg::Action&)> spoil;  ///< changes an Action before it goes out

  // What was heard.
  msg::TraversalInfo info;
  int infos = 0;
  msg::Observation seen;  ///< the newest
  int observations = 0;
  std::map<std::uint64_t, msg::EpisodeStat> episodes;  ///< by number
  std::uint64_t recorded = 0;                          ///< all up to this one are in `episodes`
  msg::ServiceStatus status;

  /// New settings; sent until an Observation or a TraversalInfo carries them.
  void command(msg::TaskSettings settings) {
    settings.environment() = environment_;
    settings.settings().incarnation() = node.incarnation();
    settings.settings().version() = ++version_;
    commanded_ = settings;
    in_force_ = false;
    next_step_ = 0;
    next_send_ = Clock::now();
  }
  bool in_force() const { return in_force_; }
  const msg::TaskSettings& commanded() const { return commanded_; }
  std::uint64_t steps() const { return next_step_; }

  bool until(const std::function<bool()>& condition, milliseconds patience = kMaxWait) {
    return eventually([this] { spin(); }, condition, patience);
  }

  void spin() {
    const Clock::time_point now = Clock::now();
    if (version_ > 0 && !in_force_ && now >= next_send_) {
      node.publish(commanded_);
      next_send_ = now + milliseconds(100);
    }
    // As recorders do, which shows that they live.
    if (acknowledge && infos > 0 && !left_ && now >= next_acknowledgement_) send_acknowledgement(recorded);
    node.wait(now + milliseconds(20));
    while (node.take(taken_info_))
      if (taken_info_.header().sender() == environment_ &&
          std::pair(taken_info_.header().incarnation(), taken_info_.header().message()) >
              std::pair(info.header().incarnation(), info.header().message())) {  // others come late or twice
        const bool fresh = taken_info_.header().incarnation() > info.header().incarnation();
        info = taken_info_;
        if (fresh && acknowledge) send_acknowledgement(0);  // from now on episodes are kept for it
        ++infos;
        if (version_ > 0 && same(info.settings(), commanded_.settings())) in_force_ = true;
      }
    while (node.take(taken_observation_)) on_observation();
    while (node.take(taken_episode_)) {
      episodes.emplace(taken_episode_.log().number(), taken_episode_);
      while (episodes.contains(recorded + 1)) ++recorded;
      if (acknowledge) send_acknowledgement(recorded);
    }
    while (node.take(taken_status_))
      if (taken_status_.header().sender() == environment_) status = taken_status_;
  }

  void send_acknowledgement(std::uint64_t episode, bool leaving = false) {
    msg::EpisodeAcknowledgement message;
    left_ = leaving;
    message.state() = leaving ? msg::LEAVES : msg::READS;
    next_acknowledgement_ = Clock::now() + std::chrono::seconds(1);
    message.writer() = environment_;
    message.writer_incarnation() = info.header().incarnation();
    message.number() = episode;
    node.publish(message);
  }
  /// `seen`, answered by hand.
  void answer(const std::vector<std::uint8_t>& choice) {
    msg::Action action;
    action.environment() = environment_;
    action.environment_incarnation() = seen.header().incarnation();
    action.settings() = seen.settings();
    action.step() = seen.step();
    action.choice() = choice;
    if (spoil) spoil(action);
    last_action_ = action;
    node.publish(action);
  }

 private:
  void on_observation() {
    if (taken_observation_.header().sender() != environment_) return;
    ++observations;
    if (version_ == 0 || !same(taken_observation_.settings(), commanded_.settings())) return;
    in_force_ = true;
    const std::uint64_t step = taken_observation_.step();
    if (step < next_step_) {
      if (step + 1 == next_step_ && last_action_.step() == step) node.publish(last_action_);
      return;
    }
    if (step > next_step_) return;
    seen = taken_observation_;
    if (!walker) return;
    choice_.resize(seen.goal().size());
    bool all_idle = true;
    for (std::size_t agent = 0; agent < choice_.size(); ++agent) {
      const bool idle = seen.flags()[agent] & msg::FLAG_IDLE;
      choice_[agent] = idle ? std::uint8_t{kStay} : walker->act(seen, agent);
      all_idle = all_idle && idle;
    }
    ++next_step_;
    if (!all_idle) answer(choice_);
  }

  std::uint32_t version_ = 0;
  msg::TaskSettings commanded_;
  bool in_force_ = false, left_ = false;
  Clock::time_point next_acknowledgement_;
  std::uint64_t next_step_ = 0;
  Clock::time_point next_send_;
  std::vector<std::uint8_t> choice_;
  msg::Action last_action_;
  msg::TraversalInfo taken_info_;
  msg::Observation taken_observation_;
  msg::EpisodeStat taken_episode_;
  msg::ServiceStatus taken_status_;
};

}  // namespace citylearn::testing
