// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "core/wire/node.h"
#include "core/wire/rejections.h"
#include "policy_service/env_client/env_client_options.h"
#include "policy_service/env_client/env_handle.h"
#include "policy_service/env_client/env_requirements.h"
#include "policy_service/env_client/service_monitor.h"
#include "policy_service/env_client/street_maps.h"

namespace citylearn {

/// Finds the env_services of a run, gives them tasks and decides once on each of their observations, over a transport
/// that may lose, repeat and reorder messages. An env_service that does not fit the run, or does not do its part, is
/// refused with an alarm; the others go on. Used by one thread. An EnvHandle keeps its address.
class EnvClient {
 public:
  /// Called for each new observation while the settings are in force. Fills `choice` and returns true, or returns false
  /// and calls answer() later.
  using Decide = std::function<bool(EnvHandle&, const msg::Observation&, std::vector<std::uint8_t>& choice)>;
  /// Called for each EpisodeStat, repetitions included. A caller that has recorded it calls acknowledge().
  using Finished = std::function<void(EnvHandle&, const msg::EpisodeStat&)>;
  /// Called when an env_service that fits appears or restarts; it then waits for settings.
  using Joined = std::function<void(EnvHandle&)>;

  explicit EnvClient(Node& node, const EnvClientOptions& options = {});
  ~EnvClient();
  Decide decide;
  std::function<void(EnvHandle&, msg::Belief&)> believe;  ///< Called in answer() where it is wanted, to fill it.
  Finished finished;
  Joined joined;
  std::function<void()> fetching;  ///< called while fetch_features() waits; what it throws ends the wait
  /// Lets the vendor's thread that receives an observation call decide() while spin() waits: see Node.
  void answer_at_once();
  /// Resends what is due, waits for messages until `deadline` at most (it may return earlier), and handles all that
  /// have come. An Error of decide() or joined() makes it refuse the env_service that they were called for.
  void spin(Clock::time_point deadline);

  /// Refuses the env_services that do not meet these, now and whenever they announce themselves. Where two env_services
  /// of one traversal differ, the one that joined later is refused.
  void require(EnvRequirements required);
  /// Goes on without an env_service, until it restarts.
  void refuse(EnvHandle& env, const std::string& why);

  /// Sends settings under a new SettingsId until they are confirmed. Fills their ids and by_reference. Settings by
  /// reference go out once the features of their route are here; this delays no other env_service. A refused one
  /// receives only the command to be idle.
  void command(EnvHandle& env, msg::TaskSettings settings);
  /// Sends the actions for the observation that waits.
  void answer(EnvHandle& env, const std::vector<std::uint8_t>& choice);
  /// Acknowledges all episodes up to this one.
  void acknowledge(EnvHandle& env, std::uint64_t episode);
  /// Makes every env_service keep its episodes until acknowledge(), beginning with all that it still has.
  void begin_recording();
  /// Lets env_services stop keeping episodes for this id. Where some are missing, they are kept for its next process.
  void end_recording();

  /// Returns the id of the live policy_service that the env_service works for instead of this one; empty: none.
  std::string other_policy(const EnvHandle& env) const;
  /// Receives observations, or does not. At first it does.
  void receive_observations(bool wanted);
  /// Begin and end hearing an env_service. Only with EnvClientOptions::attached_only.
  void attach(const std::string& id);
  void detach(const std::string& id);
  const std::map<std::string, std::unique_ptr<EnvHandle>>& envs() const { return envs_; }
  const ServiceMonitor& services() const { return services_; }
  /// Returns the features of frames first .. first + count - 1 of a traversal (count x D, frame-major), fetched over
  /// the wire. Throws Error when nothing arrives for `patience` (and refuses the env_service unless its encoder_service
  /// is gone), when the env_service is gone, or when the range does not lie on the traversal.
  std::vector<float> fetch_features(EnvHandle& env, int first, int count, std::chrono::milliseconds patience);

 private:
  EnvHandle* known(const msg::Header& header);
  EnvHandle* speaking(const msg::Header& header);
  void on_status(const msg::ServiceStatus& status);
  void on_info(const msg::TraversalInfo& info);
  std::string why_refused(const msg::TraversalInfo& info) const;
  void set_refusal(EnvHandle& env, const std::string& why);
  bool obeys_forged_settings(EnvHandle& env, const msg::TraversalInfo& info);
  void join_or_refuse(EnvHandle& env, bool fresh);
  void handle_streets();
  std::string trouble_of(const EnvHandle& env) const;
  void report_refusals();
  void contain(EnvHandle& env, const std::function<void()>& call);
  void on_observation(msg::Observation& observation);
  bool answers_requests(const EnvHandle& env) const;
  void ask_for_features();
  void send_due_settings();
  void send_acknowledgement(const EnvHandle& env, msg::ReaderState state = msg::READS);

  Node& node_;
  EnvClientOptions options_;
  Rejections rejections_;
  EnvRequirements required_;
  std::set<std::string> alarms_, attached_;  ///< ids of env_services with an alarm; those given to attach()
  FeatureCache features_;
  StreetMaps streets_;
  std::map<std::string, std::unique_ptr<EnvHandle>> envs_;
  std::map<std::string, EnvHandle*> first_;  ///< by traversal: the env_service with which others must agree
  std::uint32_t version_ = 0;
  bool wants_observations_ = true, records_ = false, undecided_ = false;  ///< last: an observation waits for answer()
  Clock::time_point next_acknowledgements_{}, next_refusals_{};
  ServiceMonitor services_;
  msg::Observation observation_;  // messages, kept to use their memory again
  msg::EpisodeStat episode_;
  msg::TraversalInfo info_;
  msg::TraversalChunk chunk_;
  msg::ServiceStatus status_;
  std::vector<std::uint8_t> choice_;
};

}  // namespace citylearn
