// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <chrono>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

namespace citylearn {

struct Topic;

/// The part of the quality of service that decides whether a writer and a reader match. The defaults are those of our
/// own endpoints. Enumerators have DDS's values. Durations are seconds; kForever or more is infinite.
struct EndpointQos {
  static constexpr double kForever = 1e9;
  bool reliable = true;
  int durability = 1;       ///< 0..3: VOLATILE, TRANSIENT_LOCAL, TRANSIENT, PERSISTENT
  bool exclusive = false;   ///< ownership
  int liveliness = 0;       ///< 0..2: AUTOMATIC, MANUAL_BY_PARTICIPANT, MANUAL_BY_TOPIC
  double lease = kForever;  ///< of the liveliness
  double deadline = kForever;
  std::string partition = {};  ///< the first one
  bool xcdr1 = true;           ///< writes or reads this encoding
  bool keyed = false;          ///< of a topic with a key
};

/// Keeps the participants and endpoints that a middleware has discovered in its DDS domain, and reports what is wrong
/// with them. All methods may be called from any thread.
class DiscoveryMonitor {
 public:
  struct Participant {
    std::string name;    ///< as in MiddlewareOptions; empty when it has none
    std::string vendor;  ///< "fastdds", "cyclonedds", or the RTPS vendor id: "vendor 01.03"; may be empty
    std::vector<std::string> addresses;  ///< IPv4 addresses that it is reached at
  };
  struct Endpoint {
    std::string participant;  ///< name
    bool writes = false;
    std::string topic, type;
  };

  std::vector<Participant> participants();
  std::vector<Endpoint> endpoints();

  /// Returns what went wrong since the last call, a line each: "topic X: Y publishes type A, expected B", "topic X: Y
  /// publishes VOLATILE, expected TRANSIENT_LOCAL", or a peer at whose address no participant was discovered for
  /// kPeerTimeout.
  std::vector<std::string> faults();
  static constexpr std::chrono::seconds kPeerTimeout{4};
  /// Returns the lines of all calls of faults() that report a wrong type. Waiting does not mend those. Other faults may
  /// pass: peers may still come, and a program with another quality of service may have nothing to do with us.
  std::vector<std::string> wrong_types();

  /// With DDS Security, a participant that has no known endpoint after this time has shown no trusted identity.
  /// faults() reports each once.
  static constexpr std::chrono::seconds kIdentityTimeout{5};

  // The middleware calls these. Keys identify participants and endpoints for good (a GUID in any form).

  void participant_found(const std::string& key, const Participant& participant);
  void participant_lost(const std::string& key);
  /// Makes faults() report a participant that was refused, and that participant_found() does not tell of.
  void identity_refused(const std::string& key, const Participant& participant);
  void endpoint_found(const std::string& key, const std::string& participant, bool writes, const std::string& topic,
                      const std::string& type, const std::optional<EndpointQos>& qos = {});
  void endpoint_lost(const std::string& key);
  /// Registers a topic that this process writes or reads. Throws Error when it was registered with another type.
  void register_local_topic(const Topic& topic, bool writes);
  /// Makes faults() report participants whose endpoints stay unknown (security encrypts them) as untrusted from now on.
  void require_identity();
  /// Reports a fault when no participant is discovered at this IPv4 address; `peer` is what the user wrote.
  void expect_peer(const std::string& peer, const std::string& address);

 private:
  using Clock = std::chrono::steady_clock;
  struct Remote {
    std::string participant;  // key
    bool writes;
    std::string topic, type;
    std::optional<EndpointQos> qos;
    bool reported = false;
  };
  struct Local {
    std::string type;
    std::optional<EndpointQos> offered, requested;  // of our writers and readers, where there are some
  };
  struct Expected {
    std::string peer;
    Clock::time_point until;
  };
  std::string name_of(const std::string& participant) const;
  std::string fault_of(const Remote& remote) const;
  void add_stranger(const std::string& key, const Participant& participant, Clock::time_point until);
  void report_strangers(std::vector<std::string>& lines);

  std::mutex mutex_;
  std::map<std::string, Participant> participants_;
  std::map<std::string, Remote> endpoints_;
  std::map<std::string, Local> local_topics_;
  std::vector<std::string> wrong_types_;
  std::map<std::string, Expected> expected_;  // address -> not heard yet, not reported yet
  std::atomic<bool> changed_{false};
  std::atomic<bool> expecting_{false};
  struct Stranger {
    std::string who;
    Clock::time_point until;  // when it is reported
    bool reported = false, gone = false;
  };
  std::map<std::string, Stranger> strangers_;  // key
  std::atomic<bool> identity_required_{false};
  std::atomic<bool> unreported_strangers_{false};  // some are not reported yet
};

}  // namespace citylearn
