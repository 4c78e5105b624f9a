// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <set>
#include <string>

#include "core/exchange/object_fetch.h"
#include "core/wire/node.h"
#include "policy_service/network/agent_network.h"

namespace citylearn {

/// Returns one version of a learner's parameters as they travel (msg::Parameters).
ObjectBytes parameters_object(std::uint64_t learner_incarnation, std::uint64_t version, const std::string& agent,
                              const Vector<float>& values);

/// A network's parameters and the number of updates that made them.
struct VersionedParameters {
  std::uint64_t version = 0;
  Vector<float> values;
};

/// Puts the parameters of one learner together, and asks for what was lost or was sent before this actor started. Works
/// on two versions at most: the one it began with, so that a learner that is faster than the wire does not keep it from
/// ever being complete, and the newest. Used by one thread.
class ParameterFetch {
 public:
  /// `parameters`: of the network.
  ParameterFetch(const msg::LearnerInfo& info, std::ptrdiff_t parameters);

  /// Notes the version that the learner announces. Returns false when it is not of this network.
  bool expect(const msg::LearnerInfo& info);
  /// Returns false when the chunk is damaged. One that is known already changes nothing.
  bool take(const msg::ObjectChunk& chunk);
  /// Returns the newest complete version, null before the first.
  std::shared_ptr<const VersionedParameters> newest() const { return newest_; }
  /// Returns the versions that are not complete.
  const std::set<std::uint64_t>& missing() const { return wanted_; }
  /// Sends a request when it is time to.
  void request_missing(Node& node);

 private:
  void want(std::uint64_t version, bool whole);
  void drop_up_to(std::uint64_t version);
  bool finish(const FetchedObject& object);

  std::ptrdiff_t parameters_;
  std::uint64_t bytes_;  // of their object
  ObjectFetch object_;
  std::set<std::uint64_t> wanted_;
  std::shared_ptr<const VersionedParameters> newest_;
  msg::ParametersRequest request_;
  Clock::time_point next_request_{};  // not before: they are probably on their way
};

}  // namespace citylearn
