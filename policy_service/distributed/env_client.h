// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/wire/node.h"
#include "core/wire/presence.h"
#include "core/wire/rejections.h"
#include "policy_service/distributed/feature_cache.h"

namespace citylearn {

/// How env_services send what their agents see. What is decided from is the same either way.
enum class Observing {
  kAsFits,       ///< by reference where an observation with its features is larger than Fleet::kLargestWhole
  kWhole,        ///< with features
  kByReference,  ///< frames by name; their features are fetched before, once
};

struct FleetOptions {
  Observing observing = Observing::kAsFits;
  /// How long features may fail to come from services that live, before that is an error.
  std::chrono::milliseconds patience{30'000};
};

/// One env_service as a policy_service sees it.
struct Seat {
  std::string id;
  msg::TraversalInfo info;            ///< of the running incarnation
  msg::TaskSettings settings;         ///< last commanded; version 0 = none
  bool in_force = false;              ///< the env_service has confirmed them
  std::uint64_t next_step = 0;        ///< step of the observation to be answered next, under `settings`
  bool waiting = false;               ///< that observation has come and waits for answer()
  Presence presence;                  ///< last sign of life
  msg::Action last_action;            ///< sent again when the observation it answers is repeated
  Clock::time_point next_settings{};  ///< when they are sent again, while not in force
  /// Of the route, when `settings` ask for observations by reference. They go out once it is complete.
  std::shared_ptr<RouteFeatures> features;
  std::uint64_t charge = 0;        ///< incarnation that our settings carry; 0: that of this process
  std::uint64_t heard_charge = 0;  ///< the largest that the env_service's messages carried
  std::uint64_t acknowledged = 0;  ///< episodes up to this one, as it was told last
  bool busy = false;               ///< the env_service says that it gets actions from somebody

  std::string traversal() const { return info.traversal().c_str(); }
  std::uint64_t incarnation() const { return info.header().incarnation(); }
};

/// The env_services of a run: finds them, tells them what to do, answers their observations, each exactly once, over a
/// transport that may lose, repeat and reorder. Used by one thread; seats stay at their addresses.
class Fleet {
 public:
  /// Called for each new observation of a seat whose settings are in force. Fills `choice` and returns true, or returns
  /// false and calls answer() later.
  using Decide = std::function<bool(Seat&, const msg::Observation&, std::vector<std::uint8_t>& choice)>;
  /// Called for each EpisodeStat, repetitions included. Whoever records calls acknowledge().
  using Finished = std::function<void(Seat&, const msg::EpisodeStat&)>;
  /// Called when an env_service appears, or comes back as a new incarnation (it then waits for settings).
  using Joined = std::function<void(Seat&)>;

  explicit Fleet(Node& node, const FleetOptions& options = {});

  Decide decide;
  Finished finished;
  Joined joined;

  /// Handles everything that has come, re-sends what is due, then waits for more, at most until `deadline`. Throws
  /// Error when the features of a route do not come.
  void spin(Clock::time_point deadline);

  /// New settings for a seat, under a new SettingsId; sent until confirmed. `settings`' ids and by_reference are filled
  /// here. By reference, they wait for the features of the route, and other seats do not. Throws Error when a whole
  /// observation is asked for and too large, or the route does not lie on the traversal by whose frames it is named.
  void command(Seat& seat, msg::TaskSettings settings);
  /// Answers the observation that waits.
  void answer(Seat& seat, const std::vector<std::uint8_t>& choice);
  void acknowledge(Seat& seat, std::uint64_t episode);
  /// From now on every env_service keeps its episodes until acknowledge(), beginning with all that it still has. Told
  /// again once a second.
  void begin_recording();
  /// Nothing need be kept for this process any more.
  void end_recording();

  /// Later settings for this seat win over those of everybody who took charge before, whoever started last.
  void take_charge(Seat& seat);
  /// Somebody else has taken charge since.
  static bool lost(const Seat& seat) { return seat.charge > 0 && seat.heard_charge > seat.charge; }
  /// Stops whatever the seat was told to do from being sent again.
  static void let_go(Seat& seat);
  /// Who only records need not hear the observations, nor who only acts the episodes. Both are heard unless told.
  void hear(bool observations, bool episodes);

  /// By id.
  const std::map<std::string, std::unique_ptr<Seat>>& seats() const { return seats_; }
  /// Env_services with images that no encoder_service has completed yet, with the traversal of each; they have no seat.
  std::map<std::string, std::string> unencoded() const;
  /// What the encoder_services heard of lately say: "encoder: summer: 120 of 3576 frames encoded".
  struct Encoder {
    std::string says;
    bool working;
  };
  std::vector<Encoder> encoders() const;
  /// Heard of within the last `kSilence`.
  static bool alive(const Seat& seat);
  /// Bytes of an observation's features that still fit one datagram beside the rest; more are sent by reference.
  static constexpr std::size_t kLargestWhole = 60'000;

  /// Features of frames first .. first + count - 1 of a seat's traversal (count x D, frame-major), fetched over the
  /// wire. Throws Error when they are not complete by the deadline, or the range does not lie on the traversal.
  std::vector<float> fetch_features(Seat& seat, int first, int count, Clock::time_point deadline);

 private:
  Seat* known(const msg::Header& header);
  Seat* speaking(const msg::Header& header);
  bool serves_features(const msg::Header& header) const;
  void on_status(const msg::ServiceStatus& status);
  void on_info(const msg::TraversalInfo& info);
  void on_observation(msg::Observation& observation);
  bool by_reference(const Seat& seat) const;
  static bool complete(const Seat& seat, msg::Observation& observation);
  bool answers_requests(const Seat& seat) const;
  void ask_for_features();
  void send_due_settings();
  void send_acknowledgement(const Seat& seat, bool leaving);

  Node& node_;
  FleetOptions options_;
  Rejections rejections_;
  FeatureCache features_;
  std::map<std::string, std::unique_ptr<Seat>> seats_;
  template <class What>
  struct Heard {
    What what;
    Presence presence;
  };
  std::map<std::string, Heard<std::string>> unencoded_;  ///< traversal, by id of the env_service
  std::map<std::string, Heard<Encoder>> encoders_;       ///< by id
  std::map<std::uint64_t, Presence> beats_;              ///< of encoder_services, by incarnation
  std::uint32_t version_ = 0;
  bool hears_observations_ = true, hears_episodes_ = true, records_ = false;
  Clock::time_point next_acknowledgements_{};
  msg::Observation observation_;
  msg::EpisodeStat episode_;
  msg::TraversalInfo info_;
  msg::TraversalChunk chunk_;
  msg::ServiceStatus status_;
  std::vector<std::uint8_t> choice_;
};

}  // namespace citylearn
